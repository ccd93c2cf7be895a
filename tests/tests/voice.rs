//! What the handler says steers the robot: a synthetic voice into a pipe that stands for a microphone.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use control::Status;
use guidedog_tests::{Ears, Live, Mouth, Place, WATCHDOG, can_hear, microphone, spoken_cue, told};
use messages::{CueKind, MicrophoneState, ModeClass, Urgency};

/// Somebody who speaks into a pipe, which this makes.
fn into_pipe(pipe: &Path) -> Mouth {
    assert!(Command::new("mkfifo").arg(pipe).status().is_ok_and(|made| made.success()), "a pipe");
    // Opened for both, it never waits for a reader.
    Mouth::into(OpenOptions::new().read(true).write(true).open(pipe).expect("opened"))
}

/// A run that hears what is said into a pipe, with these lines in its configuration.
fn hearing<'a>(place: &'a Place, config: &str) -> (Live<'a>, Mouth) {
    let (pipe, file) = (place.path().join("microphone"), place.path().join("voice.toml"));
    std::fs::write(&file, config).expect("written");
    let mouth = into_pipe(&pipe);
    let (pipe, file) = (pipe.to_string_lossy(), file.to_string_lossy());
    let scenario = ["--scenario", "left-at-tee", "--policy", "geometric"];
    let mut run = Live::up(place, "voice", &[&scenario[..], &["--config", &file, "--voice", &pipe]].concat());
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    run.wait("it hears", |status| microphone(status) == MicrophoneState::Hearing);
    (run, mouth)
}

#[test]
fn spoken_cues_start_turn_and_stop_the_robot_and_a_tone_is_heard_before_it_starts() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let (mut run, mouth) = hearing(&place, "[speak]\nfile = \"said.wav\"\n");
    let ears = Ears::on(run.dir());
    mouth.say_until(&mut run, "forward", |status| spoken_cue(status, CueKind::Forward));
    let walked = run.wait_walking();
    assert!(spoken_cue(&walked, CueKind::Forward), "{walked:#?}");
    ears.wait("Forward.", 1);
    mouth.say_until(&mut run, "left", |status| spoken_cue(status, CueKind::Left));
    ears.wait("Left.", 1);
    mouth.say_until(&mut run, "stop", |status| status.mode.cue.is_none());
    let _ = run.end();
    let said = ears.stop();
    let place_of = |text: &str| said.iter().position(|said| said.text.as_str() == text).expect(text);
    let tone = &said[place_of("(tone)")];
    assert_eq!((tone.urgency, tone.duration_ns), (Urgency::Tone, 200_000_000));
    let started = &said[place_of("Forward.")];
    assert!(started.about_ns >= tone.first_sample_ns + tone.duration_ns, "{tone:?} {started:?}");
    // Who walks needs none; on a busy machine a fault may come between.
    let walked = &said[place_of("Forward.")..place_of("Left.")];
    let came = |urgency: Urgency| walked.iter().any(|said| said.urgency == urgency);
    assert!(!came(Urgency::Tone) || came(Urgency::Stop), "{walked:?}");
    drop(mouth);
    place.assert_empty();
}

#[test]
fn without_its_tone_a_spoken_cue_does_not_start_the_robot_unless_that_is_wanted() {
    if !can_hear() {
        return;
    }
    for (config, starts) in [
        ("[speak]\nplayer = [\"no-such-player\"]\n", false),
        ("[speak]\nplayer = [\"no-such-player\"]\n[cue.voice]\ntone = false\n", true),
    ] {
        let place = Place::new();
        let (mut run, mouth) = hearing(&place, config);
        let is_told = |status: &Status| told(status, "is not given: the tone before it");
        let missing = run.status().no_start_by_voice.unwrap_or_default();
        assert_eq!(missing.contains("no-such-player, which is missing"), !starts, "{config}: {missing}");
        mouth.say_until(&mut run, "forward", |status| is_told(status) || spoken_cue(status, CueKind::Forward));
        let status = run.status();
        assert_eq!((is_told(&status), status.mode.class == ModeClass::Run), (!starts, starts), "{config}: {status:#?}");
        let _ = run.end();
        drop(mouth);
        place.assert_empty();
    }
}

#[test]
fn a_word_that_is_said_twice_starts_the_robot_where_that_is_wanted_in_place_of_the_tone() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let config = "[speak]\nplayer = [\"no-such-player\"]\n[cue.voice]\nrepeat = true\n";
    let (mut run, mouth) = hearing(&place, config);
    assert_eq!(run.status().no_start_by_voice, None);
    mouth.say("forward");
    mouth.wait(3.0);
    mouth.wait_until_said();
    assert!(run.status().mode.cue.is_none(), "once is not enough: {:#?}", run.status());
    mouth.say_until(&mut run, "forward, forward", |status| spoken_cue(status, CueKind::Forward));
    let _ = run.end();
    drop(mouth);
    place.assert_empty();
}

/// A Linux input device's event: a key goes down, or up.
fn key_event(key: u16, is_down: bool) -> Vec<u8> {
    let mut bytes = vec![0; 16];
    bytes.extend(1_u16.to_le_bytes());
    bytes.extend(key.to_le_bytes());
    bytes.extend(i32::from(is_down).to_le_bytes());
    bytes
}

#[test]
fn with_a_key_to_speak_a_direction_counts_only_while_it_is_held_and_stop_always() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let key = place.path().join("key");
    assert!(Command::new("mkfifo").arg(&key).status().is_ok_and(|made| made.success()), "a pipe");
    let mut presses = OpenOptions::new().read(true).write(true).open(&key).expect("opened");
    let config = format!(
        "[speak]\nfile = \"said.wav\"\n[cue.voice]\ntone = false\ntalk = {{ device = \"{}\", key = 57 }}\n",
        key.display()
    );
    let (mut run, mouth) = hearing(&place, &config);
    mouth.say("forward");
    mouth.wait_until_said();
    assert!(run.status().mode.cue.is_none(), "nobody holds it: {:#?}", run.status());
    presses.write_all(&key_event(57, true)).expect("written");
    mouth.say_until(&mut run, "forward", |status| spoken_cue(status, CueKind::Forward));
    let _ = run.wait_walking();
    presses.write_all(&key_event(57, false)).expect("written");
    mouth.say_until(&mut run, "stop", |status| status.mode.cue.is_none());
    let _ = run.end();
    drop((mouth, presses));
    std::fs::remove_file(&key).expect("removed");
    place.assert_empty();
}

#[test]
fn without_its_files_a_voice_is_told_what_is_missing_and_the_other_cues_go_on() {
    let place = Place::new();
    let config = place.path().join("voice.toml");
    let text = "[cue.voice]\ntone = false\nsource = \"stream\"\nstream = \"none\"\nembedding = \"missing.onnx\"\n";
    std::fs::write(&config, text).expect("written");
    let mut run = Live::up(&place, "voice", &["--config", &config.to_string_lossy()]);
    run.wait("it is told", |status| told(status, "missing.onnx is missing: it is shipped with cues.toml"));
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    let _ = place.guidedog(&["cue", "forward", "--run", "voice"]);
    run.wait_walking();
    let _ = run.end();
    std::fs::remove_file(&config).expect("removed");
    place.assert_empty();
}

#[test]
fn a_stop_that_is_said_right_after_forward_stops_the_robot_though_it_speaks_itself() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let (mut run, mouth) = hearing(&place, "[speak]\nfile = \"said.wav\"\n");
    let ears = Ears::on(run.dir());
    for pause_s in [0.3, 0.6] {
        let since = Instant::now();
        let told = |text: &str| ears.texts().iter().filter(|said| *said == text).count();
        let before = told("Forward.");
        // On a busy machine the cue may be refused, or a fault come between: said again.
        while told("Forward.") == before {
            assert!(since.elapsed() < WATCHDOG, "never given: {:?}", ears.texts());
            run.wait("a cue would be taken", |status| {
                status.mode.cue.is_none() && (status.mode.ready_for_cue || status.mode.class == ModeClass::Run)
            });
            mouth.say("forward");
            mouth.wait(pause_s);
            mouth.say("stop");
            mouth.wait_until_said();
            run.wait("the robot stands", |status| status.mode.cue.is_none());
        }
    }
    let (report, _) = run.end();
    assert!(report["distance_m"].as_f64().is_some_and(|distance_m| distance_m < 2.0), "{report:#}");
    drop(mouth);
    let _ = ears.stop();
    place.assert_empty();
}
