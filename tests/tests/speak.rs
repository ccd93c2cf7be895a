//! What the robot says, by the real voice: texts as they are published, and the sound in a file.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use control::{ServicePhase, Status};
use guidedog_tests::{Ears, Live, Place, is_alive, pid_of, pids, service, signal, told, until, vx_mps};
use messages::{ModeClass, SpeechPhase, SpeechSaid, Urgency};
use serde_json::Value;

/// Whether the voice is there.
fn has_voice() -> bool {
    let there = Command::new("espeak-ng").arg("--version").output().is_ok();
    test_data::has(there, "espeak-ng is missing: scripts/test installs it")
}

/// A configuration in which the robot speaks, to a file, with these keys besides.
fn config(place: &Place, more: &str) -> String {
    let path = place.path().join("speak.toml");
    let tone = format!("tone_player = [\"sh\", \"-c\", \"cat > {}\"]", place.path().join("tone.wav").display());
    std::fs::write(&path, format!("[speak]\non = true\nfile = \"said.wav\"\n{tone}\n{more}\n")).expect("written");
    path.to_string_lossy().into_owned()
}

/// A run that speaks and is ready for a cue, and who listens to it.
fn speaking<'a>(place: &'a Place, more: &str) -> (Live<'a>, Ears) {
    let mut run = Live::up(place, "speak", &["--faults", "--config", &config(place, more)]);
    run.wait("the voice is up", |status| service(status, "speak").state == ServicePhase::Ready);
    let ears = Ears::on(run.dir());
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    (run, ears)
}

/// Gives the cue until the robot walks: on a busy machine a fault may come between.
fn walk(place: &Place, run: &mut Live<'_>) {
    let given = Cell::new(None::<Instant>);
    run.wait("the robot walks", |status| {
        let ready = status.mode.ready_for_cue && status.mode.class == ModeClass::Fault;
        if ready && given.get().is_none_or(|at| at.elapsed() > Duration::from_secs(1)) {
            given.set(Some(Instant::now()));
            let _ = place.guidedog(&["cue", "forward", "--run", "speak"]);
        }
        status.mode.class == ModeClass::Run && vx_mps(status) > 0.2
    });
}

/// Whether that is what the robot said last.
fn says(status: &Status, text: &str) -> bool {
    status.said.as_ref().is_some_and(|said| said.text == text)
}

/// Whether the robot said that last, and to its end. What it assumes of the floor is said once, at any time, and may
/// come after it.
fn has_said(status: &Status, text: &str) -> bool {
    let is_last = [text, "I cannot see the floor beside you."].iter().any(|text| says(status, text));
    is_last && status.said.as_ref().is_some_and(|said| said.phase == SpeechPhase::Ended)
}

/// From the stop to the first sample of each sentence about one, milliseconds.
fn latencies_ms(said: &[SpeechSaid], urgency: Urgency) -> Vec<u64> {
    let begun = said.iter().filter(|said| said.phase == SpeechPhase::Begun && said.urgency == urgency);
    begun.map(|said| (said.first_sample_ns - said.about_ns) / 1_000_000).collect()
}

/// Whether the sentences come in that order, whatever is between them.
fn in_order(texts: &[String], wanted: &[&str]) -> bool {
    let mut left = texts.iter();
    wanted.iter().all(|text| left.any(|said| said == text))
}

/// Seconds of speech in a WAV.
fn speech_s(path: &Path) -> f64 {
    let mut wav = hound::WavReader::open(path).expect("a WAV");
    let rate_hz = wav.spec().sample_rate;
    let samples: Vec<f64> = wav.samples::<i16>().map(|sample| f64::from(sample.expect("whole")) / 32_768.0).collect();
    guidedog_tests::speech_s(&samples, rate_hz)
}

#[test]
fn a_walk_is_told_from_the_first_cue_to_the_end() {
    if !has_voice() {
        return;
    }
    let place = Place::new();
    let (mut run, ears) = speaking(&place, "");
    ears.wait("Ready.", 1);
    walk(&place, &mut run);
    ears.wait("Forward.", 1);
    signal(pid_of(&run.status(), "lidar"), "KILL");
    ears.wait("Stopped: lidar lost, restarting.", 1);
    ears.wait("Ready.", 2);
    walk(&place, &mut run);
    ears.wait("Forward.", 2);
    assert!(place.guidedog(&["stop", "--run", "speak"]).status.success());
    ears.wait("Stopped by the operator.", 1);
    assert!(!place.guidedog(&["cue", "left", "--run", "speak"]).status.success(), "the run is locked");
    ears.wait("Not now: I am locked.", 1);
    run.wait("what is said is told", |status| has_said(status, "Not now: I am locked."));
    assert!(place.guidedog(&["resume", "--run", "speak"]).status.success());
    ears.wait("Ready.", 3);
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    let (said, texts) = (ears.said(), ears.texts());
    let wanted = [
        "Ready.",
        "Forward.",
        "Stopped: lidar lost, restarting.",
        "Ready.",
        "Forward.",
        "Stopped by the operator.",
        "Not now: I am locked.",
        "Unlocked.",
        "Ready.",
        "Stopped. Goodbye.",
    ];
    assert!(in_order(&texts, &wanted), "{texts:?}");
    let last = said.last().expect("something was said");
    assert_eq!((last.text.as_str(), last.phase), ("Stopped. Goodbye.", SpeechPhase::Ended), "the last word is heard");
    let stops = latencies_ms(&said, Urgency::Stop);
    assert!(stops.len() >= 3 && stops.iter().all(|ms| *ms < 1000), "{stops:?}");
    let heard_s: f64 =
        said.iter().filter(|said| said.phase == SpeechPhase::Ended).map(|said| said.duration_ns as f64 / 1e9).sum();
    let spoken_s = speech_s(&place.path().join("said.wav"));
    assert!(heard_s > 4.0 && spoken_s > 0.4 * heard_s && spoken_s < 2.0 * heard_s, "{spoken_s} of {heard_s}");
    let told = &report["latency_us"]["stop_to_speech"];
    assert!(told["n"].as_u64() >= Some(3) && told["p95"].as_f64() < Some(1e6), "{told}");
    let _ = ears.stop();
    place.assert_empty();
}

#[test]
fn every_stop_of_many_is_told_within_a_second_whoever_dies() {
    if !has_voice() {
        return;
    }
    let place = Place::new();
    let (mut run, ears) = speaking(&place, "");
    let victims = ["lidar", "odometry", "policy", "shield", "locomotion", "depth"];
    for victim in victims.into_iter().chain(victims) {
        walk(&place, &mut run);
        let before = ears.said().len();
        signal(pid_of(&run.status(), victim), "KILL");
        let is_told = |said: &SpeechSaid| said.urgency == Urgency::Stop && said.first_sample_ns > 0;
        until(&format!("the loss of {victim} is told"), || ears.said()[before..].iter().any(is_told));
    }
    let mut stops = latencies_ms(&ears.said(), Urgency::Stop);
    stops.sort_unstable();
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    eprintln!("from the stop to the first sample, ms: {stops:?}; {}", report["latency_us"]["stop_to_speech"]);
    assert!(stops.len() >= 12 && stops[stops.len() * 95 / 100] < 1000, "{stops:?}");
    let _ = ears.stop();
    place.assert_empty();
}

#[test]
fn a_lost_voice_stops_nobody_is_heard_as_a_tone_and_speaks_again() {
    if !has_voice() {
        return;
    }
    let place = Place::new();
    let (mut run, ears) = speaking(&place, "");
    walk(&place, &mut run);
    for (with, lives) in [("KILL", 2), ("STOP", 3)] {
        signal(pid_of(&run.status(), "speak"), with);
        run.wait("the voice is back", |status| {
            let speak = service(status, "speak");
            speak.incarnation == lives && speak.state == ServicePhase::Ready
        });
        let tone = place.path().join("tone.wav");
        until("a tone is heard", || tone.exists());
        run.wait("the tone is played", |_| hound::WavReader::open(&tone).is_ok());
        assert!(speech_s(&tone) > 0.4);
        std::fs::remove_file(&tone).expect("ours");
    }
    assert!(place.guidedog(&["stop", "--run", "speak"]).status.success());
    ears.wait("Stopped by the operator.", 1);
    run.wait("it is heard", |status| has_said(status, "Stopped by the operator."));
    let (report, code) = run.end();
    assert_eq!((code, &report["restarts"]["speak"]), (0, &Value::from(2)), "{report:#}");
    // A busy machine may stop the robot for want of beats of others.
    let stops = report["stops"].as_array().expect("stops");
    assert!(!stops.iter().any(|stop| stop["service"] == "speak"), "nobody is stopped by it: {stops:#?}");
    // Two sentences and more, but on a machine that is too busy for a voice.
    assert!(speech_s(&place.path().join("said.wav")) > 0.5, "the file goes on");
    let _ = ears.stop();
    place.assert_empty();
}

#[test]
fn the_supervisors_own_death_is_told_and_then_nobody_is_left() {
    if !has_voice() {
        return;
    }
    let place = Place::new();
    let (mut run, ears) = speaking(&place, "");
    walk(&place, &mut run);
    let status = run.status();
    let ours = pids(&status);
    signal(run.pid(), "KILL");
    ears.wait("Stopped for good. Get help.", 1);
    until("every process has ended", || !ours.iter().any(|pid| is_alive(*pid)));
    let said = ears.stop();
    let last = said.last().expect("something was said");
    assert_eq!((last.text.as_str(), last.phase), ("Stopped for good. Get help.", SpeechPhase::Ended));
    let _ = run.finish();
    let (report, _) = place.json(&["walk", "--speed", "0", "--time-limit", "3s", "--json"]);
    assert!(report["duration_s"].is_number(), "the next run cleans up: {report:#}");
    place.assert_empty();
}

#[test]
fn the_goal_is_told_before_the_run_ends() {
    if !has_voice() {
        return;
    }
    let place = Place::new();
    let config = config(&place, "language = \"de\"\nverbosity = \"stops\"");
    let lines = "start = { at = [24, 0], yaw_deg = 0 }\ngoal = { at = [33.5, 0], within_m = 1.5 }\ntime_limit_s = 240\n\
        [[cue]]\nkind = \"forward\"\nat_s = 1.0";
    let scenario = place.scenario("corridor.toml", lines);
    let walk = ["walk", "--config", &config, "--scenario", &scenario, "--json", "--name", "walk"];
    let walk = place.command(&walk).spawn().expect("guidedog starts");
    let dir = place.path().join("r").join("walk");
    until("the walk begins", || place.guidedog(&["status", "--json", "--run", "walk"]).status.success());
    let ears = Ears::on(dir);
    let output = walk.wait_with_output().expect("it ends");
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_eq!(report["reached"], true, "{report:#}");
    let said = ears.stop();
    let last = said.last().expect("something was said");
    assert_eq!((last.text.as_str(), last.phase), ("Ziel erreicht.", SpeechPhase::Ended), "{said:?}");
    assert!(!said.iter().any(|said| said.text.as_str() == "Geradeaus."), "only stops: {said:?}");
    place.assert_empty();
}

#[test]
fn without_a_voice_the_texts_are_published_and_the_walk_goes_on() {
    let hangs = "voice = [\"sleep\", \"600\"]";
    for (more, what) in [
        ("voice = [\"no-such-voice\"]", "no-such-voice is not there"),
        (hangs, "sleep: "),
        ("voice = [\"sh\", \"-c\", \"echo no voices >&2; exit 1\", \"{text}\"]", "no voices"),
    ] {
        let place = Place::new();
        let (mut run, ears) = speaking(&place, more);
        walk(&place, &mut run);
        signal(pid_of(&run.status(), "lidar"), "KILL");
        ears.wait("Stopped: lidar lost, restarting.", 1);
        let is_stop = |said: &SpeechSaid| said.text.as_str() == "Stopped: lidar lost, restarting.";
        let said = ears.said().into_iter().find(is_stop).expect("it is there");
        assert_eq!((said.phase, said.duration_ns), (SpeechPhase::Unheard, 0), "{more}");
        let status = run.wait("what is wrong is told", |status| told(status, what));
        assert_eq!(service(&status, "speak").restarts, 0, "{status:#?}");
        walk(&place, &mut run);
        let (report, code) = run.end();
        assert_eq!(code, 0, "{report:#}");
        let _ = ears.stop();
        place.assert_empty();
    }
}

#[test]
fn a_player_that_fails_is_told_and_one_that_is_cut_short_leaves_nobody() {
    if !has_voice() {
        return;
    }
    let place = Place::new();
    let path = place.path().join("speak.toml");
    let player = "player = [\"sh\", \"-c\", \"cat > /dev/null; sleep 600; true\"]";
    std::fs::write(&path, format!("[speak]\non = true\n{player}\n")).expect("written");
    let mut run = Live::up(&place, "speak", &["--config", &path.to_string_lossy()]);
    run.wait("ready is told", |status| says(status, "Ready."));
    // It plays for too long, and is cut short by what is more urgent.
    assert!(place.guidedog(&["stop", "--run", "speak"]).status.success());
    run.wait("the stop is told", |status| says(status, "Stopped by the operator."));
    run.wait("the player is given up", |status| told(status, "it plays for too long"));
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
}

#[test]
fn a_wrong_language_is_told_with_file_and_key_before_anything_starts() {
    let place = Place::new();
    let mine: PathBuf = place.path().join("mine.toml");
    let english = std::fs::read_to_string(guidedog_tests::project().join("config/languages/en.toml")).expect("there");
    std::fs::write(&mine, english.replace("arrived = \"You have arrived.\"\n", "")).expect("written");
    for (more, what) in [
        ("language = \"mine.toml\"", "mine.toml: stops.arrived is missing"),
        ("language = \"nowhere.toml\"", "nowhere.toml"),
        ("language = \"klingon\"", "en, de"),
        ("verbosity = \"loud\"", "line 5"),
        ("voice = []", "speak.voice"),
    ] {
        let output = place.guidedog(&["up", "--name", "speak", "--config", &config(&place, more)]);
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(what), "{more}: {told}");
    }
    place.assert_empty();
}

#[test]
fn in_stepped_time_nobody_speaks_and_that_is_told() {
    let place = Place::new();
    let config = config(&place, "");
    let (report, code) = place.json(&["walk", "--speed", "0", "--config", &config, "--time-limit", "3s", "--json"]);
    assert!(report["notes"].to_string().contains("in stepped time the robot does not speak"), "{code}: {report:#}");
    assert!(!place.path().join("said.wav").exists());
    place.assert_empty();
}
