//! With a sound card, though none is there: a handler speaks into a microphone, the robot answers by a loudspeaker,
//! both through ALSA as on the robot (PulseAudio's null devices behind it).

use std::fs;
use std::io::{BufRead, BufReader};
use std::time::Instant;

use control::Status;
use guidedog_tests::{
    Ears, Live, Mouth, Place, RATE_HZ, SoundRig, WATCHDOG, can_hear, has_sound, microphone, service, speech_s,
    spoken_cue, told,
};
use messages::{CueKind, MicrophoneState, SpeechPhase, SpeechSaid, Urgency};
use serde_json::Value;

fn config(place: &Place, text: &str) -> String {
    let path = place.path().join("sound.toml");
    fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

/// From near the tee into its left arm.
fn scenario(place: &Place) -> String {
    let lines = "start = { at = [9, 0], yaw_deg = 0 }\ngoal = { at = [18, 5], within_m = 1.5 }\ntime_limit_s = 200";
    place.scenario("left-at-tee.toml", lines)
}

/// Seconds that the loudspeaker was to be heard, as the robot tells it.
fn said_s(said: &[SpeechSaid]) -> f64 {
    let whole = said.iter().filter(|said| said.phase == SpeechPhase::Ended);
    whole.map(|said| said.duration_ns as f64 / 1e9).sum()
}

#[test]
fn spoken_cues_lead_through_a_junction_and_the_answers_are_heard() {
    if !(has_sound() && can_hear()) {
        return;
    }
    let mut rig = SoundRig::new();
    rig.listen();
    let place = Place::with_sound(&rig);
    let mouth = Mouth::into(rig.mouth());
    let (config, scenario) = (config(&place, "[cue.voice]\nmicrophone = \"default\"\n"), scenario(&place));
    let mut run = Live::walk(&place, "walk", &["--voice", "--config", &config, "--scenario", &scenario]);
    run.wait("it hears", |status| microphone(status) == MicrophoneState::Hearing);
    let ears = Ears::on(run.dir());
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    mouth.say_until(&mut run, "forward", |status| spoken_cue(status, CueKind::Forward));
    // A fault on a busy machine voids the cue; whoever walks says it again.
    let near = |status: &Status| status.world.as_ref().is_some_and(|world| world.robot[0] > 13.0);
    let since = Instant::now();
    while !near(&run.status()) {
        let status =
            mouth.say_until(&mut run, "forward", |status| spoken_cue(status, CueKind::Forward) || near(status));
        assert!(since.elapsed() < WATCHDOG, "it never comes near the junction: {status:#?}");
    }
    mouth.say_until(&mut run, "left", |status| spoken_cue(status, CueKind::Left));
    let (report, code) = run.finish();
    assert_eq!((code, &report["reached"]), (0, &Value::from(true)), "{report:#}");
    let (said, texts) = (ears.said(), ears.texts());
    let mut left = texts.iter();
    let wanted = ["(tone)", "Forward.", "Left.", "You have arrived."];
    assert!(wanted.iter().all(|text| left.any(|said| said == text)), "{texts:?}");
    for tone in said.iter().filter(|said| said.urgency == Urgency::Tone && said.phase == SpeechPhase::Ended) {
        let late_ms = (tone.header.stamp_ns - tone.first_sample_ns - tone.duration_ns) / 1_000_000;
        eprintln!("the tone's player ended {late_ms} ms after its length");
    }
    let (told_s, heard_s) = (said_s(&said), speech_s(&rig.heard(), RATE_HZ));
    eprintln!("told {told_s:.1} s, heard {heard_s:.1} s, {texts:?}");
    assert!(told_s > 1.5 && heard_s > 0.4 * told_s && heard_s < 1.5 * told_s, "{heard_s} of {told_s}");
    let _ = ears.stop();
    place.assert_empty();
}

/// Whatever the voice's state, an operator's cue makes the robot walk.
fn others_go_on(place: &Place, run: &mut Live<'_>) {
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    let _ = place.guidedog(&["cue", "forward", "--run", "sound"]);
    run.wait_walking();
}

#[test]
fn a_microphone_that_is_none_dead_or_lost_is_told_and_one_that_comes_back_is_heard_again() {
    if !(has_sound() && can_hear()) {
        return;
    }
    let mut rig = SoundRig::new();
    let place = Place::with_sound(&rig);
    let wait_told = |run: &mut Live<'_>, what: &str| run.wait(what, |status| told(status, what));
    let source = "[speak]\non = true\nfile = \"said.wav\"\n[cue.voice]\nsource = \"microphone\"\n";
    let none = config(&place, &format!("{source}microphone = \"hw:17\"\n"));
    let mut run = Live::up(&place, "sound", &["--config", &none]);
    let status = wait_told(&mut run, "the microphone \"hw:17\" cannot be opened");
    assert!(told(&status, "arecord -L"), "{status:#?}");
    run.wait("it is not heard", |status| microphone(status) == MicrophoneState::Lost);
    others_go_on(&place, &mut run);
    assert_eq!(run.end().1, 0);

    let there = config(&place, source);
    let mut run = Live::up(&place, "sound", &["--config", &there]);
    // Nobody speaks into it: a null device gives exact zeros.
    wait_told(&mut run, "exact zeros");
    run.wait("it is dead", |status| microphone(status) == MicrophoneState::Dead);
    others_go_on(&place, &mut run);
    let mouth = Mouth::into(rig.mouth());
    run.wait("it hears", |status| microphone(status) == MicrophoneState::Hearing);
    wait_told(&mut run, "gives sound again");
    mouth.say_until(&mut run, "stop", |status| status.mode.cue.is_none());
    rig.unplug();
    drop(mouth);
    run.wait("it is lost", |status| microphone(status) == MicrophoneState::Lost);
    rig.plug_in();
    let mouth = Mouth::into(rig.mouth());
    run.wait("it hears again", |status| microphone(status) == MicrophoneState::Hearing);
    mouth.say_until(&mut run, "forward", |status| spoken_cue(status, CueKind::Forward));
    run.wait_walking();
    assert_eq!(service(&run.status(), "cue").restarts, 0);
    assert_eq!(run.end().1, 0);
    place.assert_empty();
}

#[test]
fn a_loudspeaker_that_is_none_is_told_and_the_walk_goes_on() {
    if !(has_sound() && can_hear()) {
        return;
    }
    let rig = SoundRig::new();
    let place = Place::with_sound(&rig);
    let none = config(&place, "[speak]\non = true\nplayer = [\"aplay\", \"-q\", \"-D\", \"hw:17\", \"-\"]\n");
    let mut run = Live::up(&place, "sound", &["--config", &none]);
    run.wait("it is told", |status| told(status, "not heard: aplay"));
    others_go_on(&place, &mut run);
    assert_eq!(run.end().1, 0);
    place.assert_empty();
}

#[test]
fn a_handler_is_enrolled_by_the_microphone() {
    if !(has_sound() && can_hear()) {
        return;
    }
    let rig = SoundRig::new();
    let place = Place::with_sound(&rig);
    let mouth = Mouth::into(rig.mouth());
    let anna = place.path().join("anna");
    let enrol = ["cue", "enrol", "--json", "--quiet", "-o", &anna.to_string_lossy()];
    let mut enrolling = place.command(&enrol).spawn().expect("guidedog starts");
    let told = BufReader::new(enrolling.stderr.take().expect("it is piped"));
    let mut asked = 0;
    for line in told.lines().map_while(Result::ok) {
        if let Some(word) = line.strip_prefix("say \"").and_then(|rest| rest.split('"').next()) {
            asked += 1;
            mouth.wait(0.7);
            // Somebody who is not understood well: others have nothing to win.
            mouth.say_by("es", word);
        }
    }
    let output = enrolling.wait_with_output().expect("it ends");
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_eq!((asked, report["clips"].as_u64()), (35, Some(35)), "{report:#}");
    let (cues, others) = (&report["own"]["cues_heard"], &report["own"]["others_taken"]);
    assert!(cues["of"] == 100 && cues["after"].as_u64() >= Some(88) && others["of"] == 40, "{report:#}");
    assert!(anna.join("head.onnx").is_file());
    place.assert_empty();
}
