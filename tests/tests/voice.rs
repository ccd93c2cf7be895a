//! What the handler says steers the robot: a synthetic voice into a pipe that stands for a microphone.

use std::collections::VecDeque;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use guidedog_tests::{Ears, Live, Place, RATE_HZ, WATCHDOG, can_hear, spoken};
use messages::Urgency;
use serde_json::Value;

/// 20 ms.
const PIECE: usize = RATE_HZ as usize / 50;

/// A microphone that is not there: near-silence, and what is said into it.
struct Microphone {
    said: Arc<Mutex<VecDeque<i16>>>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Microphone {
    fn at(pipe: &Path) -> Self {
        assert!(Command::new("mkfifo").arg(pipe).status().is_ok_and(|made| made.success()), "a pipe");
        // Opened for both, it never waits for a reader.
        let mut pipe = OpenOptions::new().read(true).write(true).open(pipe).expect("opened");
        let (said, over) = (Arc::new(Mutex::new(VecDeque::new())), Arc::new(AtomicBool::new(false)));
        let (queue, end) = (Arc::clone(&said), Arc::clone(&over));
        let thread = std::thread::spawn(move || {
            let (begun, mut sent, mut state) = (Instant::now(), 0_u32, 1_u32);
            while !end.load(Ordering::Relaxed) {
                let mut piece = Vec::with_capacity(2 * PIECE);
                for _ in 0..PIECE {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let hiss = (state >> 28) as i16 - 8;
                    let sample: i16 = queue.lock().expect("nobody panics with it").pop_front().unwrap_or(0);
                    piece.extend(sample.saturating_add(hiss).to_le_bytes());
                }
                pipe.write_all(&piece).expect("the pipe has room");
                sent += 1;
                std::thread::sleep((Duration::from_millis(20) * sent).saturating_sub(begun.elapsed()));
            }
        });
        Self { said, over, thread: Some(thread) }
    }

    fn say(&self, word: &str) {
        self.said.lock().expect("nobody panics with it").extend(spoken(word));
    }
}

impl Drop for Microphone {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Says a word until it is in force: on a busy machine a fault may come between.
fn say_until(run: &mut Live<'_>, microphone: &Microphone, word: &str, wanted: impl Fn(&Value) -> bool) {
    let mut said: Option<Instant> = None;
    let begun = Instant::now();
    while !wanted(&run.status()) {
        if said.is_none_or(|at| at.elapsed() > Duration::from_secs(4)) {
            microphone.say(word);
            said = Some(Instant::now());
        }
        assert!(begun.elapsed() < WATCHDOG, "\"{word}\" was never heard: {:#}", run.status());
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A run that hears what is said into a pipe, with these lines in its configuration.
fn hearing<'a>(place: &'a Place, config: &str) -> (Live<'a>, Microphone) {
    let (pipe, file) = (place.path().join("microphone"), place.path().join("voice.toml"));
    std::fs::write(&file, config).expect("written");
    let microphone = Microphone::at(&pipe);
    let (pipe, file) = (pipe.to_string_lossy(), file.to_string_lossy());
    let scenario = ["--scenario", "left-at-tee", "--policy", "geometric"];
    let mut run = Live::up(place, "voice", &[&scenario[..], &["--config", &file, "--voice", &pipe]].concat());
    run.wait("it is ready for a cue", |status| status["mode"]["ready_for_cue"] == true);
    run.wait("it hears", |status| status["microphone"]["state"] == "hearing");
    (run, microphone)
}

fn given(status: &Value, cue: &str) -> bool {
    status["mode"]["cue"]["kind"] == cue && status["mode"]["cue"]["source"] == "voice"
}

#[test]
fn spoken_cues_start_turn_and_stop_the_robot_and_a_tone_is_heard_before_it_starts() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let (mut run, microphone) = hearing(&place, "[speak]\nfile = \"said.wav\"\n");
    let ears = Ears::on(run.dir());
    say_until(&mut run, &microphone, "forward", |status| given(status, "forward"));
    let walked = run.wait_walking();
    assert_eq!(walked["mode"]["cue"]["source"], "voice", "{walked:#}");
    ears.wait("Forward.", 1);
    say_until(&mut run, &microphone, "left", |status| given(status, "left"));
    say_until(&mut run, &microphone, "stop", |status| status["mode"]["cue"].is_null());
    let _ = run.end();
    let said = ears.stop();
    let place_of = |text: &str| said.iter().position(|said| said.text.as_str() == text).expect(text);
    let tone = &said[place_of("(tone)")];
    assert_eq!((tone.urgency, tone.duration_ns), (Urgency::Tone, 200_000_000));
    let started = &said[place_of("Forward.")];
    assert!(started.about_ns >= tone.first_sample_ns + tone.duration_ns, "{tone:?} {started:?}");
    drop(microphone);
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
        let (mut run, microphone) = hearing(&place, config);
        let is_told = |status: &Value| status["notes"].to_string().contains("is not given: the tone before it");
        say_until(&mut run, &microphone, "forward", |status| is_told(status) || given(status, "forward"));
        let status = run.status();
        assert_eq!((is_told(&status), status["mode"]["class"] == "run"), (!starts, starts), "{config}: {status:#}");
        let _ = run.end();
        drop(microphone);
        place.assert_empty();
    }
}

#[test]
fn without_its_files_a_voice_is_told_what_to_run_and_the_other_cues_go_on() {
    let place = Place::new();
    let config = place.path().join("voice.toml");
    let text = "[cue.voice]\ntone = false\nsource = \"stream\"\nstream = \"none\"\nembedding = \"missing.onnx\"\n";
    std::fs::write(&config, text).expect("written");
    let mut run = Live::up(&place, "voice", &["--config", &config.to_string_lossy()]);
    run.wait("it is told", |status| status.to_string().contains("scripts/cue-embedding"));
    run.wait("it is ready for a cue", |status| status["mode"]["ready_for_cue"] == true);
    let _ = place.guidedog(&["cue", "forward", "--run", "voice"]);
    run.wait_walking();
    let _ = run.end();
    std::fs::remove_file(&config).expect("removed");
    place.assert_empty();
}
