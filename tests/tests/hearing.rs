//! `guidedog evaluate-cues` on words of a synthetic voice, and on what is no sound.

use std::fs;
use std::path::{Path, PathBuf};

use guidedog_tests::{Place, RATE_HZ, can_hear, spoken, write_wav};
use serde_json::Value;

const CUES: [&str; 5] = ["forward", "go", "left", "right", "stop"];
const OTHERS: [&str; 3] = ["marvin", "seven", "yellow"];

/// A folder a word, and a minute in which nobody gives a cue.
fn words(place: &Place) -> PathBuf {
    let folder = place.path().join("clips");
    for word in CUES.iter().chain(&OTHERS) {
        write_wav(&folder.join(word).join("a.wav"), &spoken(word));
    }
    let mut state = 1_u32;
    let hiss = |_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 26) as i16 - 32
    };
    write_wav(&folder.join("noise").join("hiss.wav"), &(0..60 * RATE_HZ).map(hiss).collect::<Vec<i16>>());
    folder
}

fn evaluate(place: &Place, args: &[&str]) -> (Value, i32) {
    place.json(&[&["evaluate-cues", "--json"], args].concat())
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Without what depends on the machine.
fn without_cost(mut report: Value) -> Value {
    for condition in report["conditions"].as_object_mut().expect("conditions").values_mut() {
        condition.as_object_mut().expect("figures").remove("cpu_share");
    }
    report
}

#[test]
fn words_and_streams_are_counted_with_intervals_and_the_same_seed_gives_the_same() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let clips = words(&place);
    let (report, code) = evaluate(&place, &[&text(&clips), "--conditions", "clean,noise20"]);
    assert_eq!((code, report["files"].as_u64()), (0, Some(9)), "{report:#}");
    let clean = &report["conditions"]["clean"];
    let recall = &clean["recall"]["all"];
    assert_eq!(recall["n"], 5, "{clean:#}");
    let [mean, lo, hi] = ["mean", "lo", "hi"].map(|key| recall[key].as_f64().expect("a number"));
    assert!(lo < mean && mean <= hi && mean >= 0.75, "{clean:#}");
    assert_eq!(clean["false_accepts"]["all"]["n"], 3, "{clean:#}");
    assert!(CUES.iter().all(|cue| clean["recall"][cue]["n"] == 1), "{clean:#}");
    let alarms = &clean["alarms_per_hour"]["directions"];
    assert_eq!(alarms["mean"], 0.0, "nobody is heard in a hiss: {clean:#}");
    // A minute; the near-silence before and behind it is no part of it.
    assert!((alarms["hours"].as_f64().expect("hours") - 60.0 / 3600.0).abs() < 1e-6, "{clean:#}");
    let p95 = clean["latency_s"]["p95"].as_f64().expect("there are cues");
    assert!((-0.5..1.5).contains(&p95) && clean["cpu_share"].as_f64() > Some(0.0), "{clean:#}");
    let (again, _) = evaluate(&place, &[&text(&clips), "--conditions", "clean,noise20", "--workers", "1"]);
    assert_eq!(without_cost(report.clone()), without_cost(again));
    // Each clip's outcome is there; against itself no model is better.
    let outcomes = clean["clips"].as_array().expect("outcomes");
    let right = |outcome: &&Value| CUES.contains(&outcome["word"].as_str().unwrap_or("")) && outcome["right"] == true;
    let share = outcomes.iter().filter(right).count() as f64 / 5.0;
    assert!(outcomes.len() == 9 && (share - mean).abs() < 1e-9, "{clean:#}");
    let shipped = guidedog_tests::project().join("config/cues/cues.toml");
    let (paired, code) = evaluate(&place, &[&text(&clips), "--against", &text(&shipped)]);
    let stop = &paired["conditions"]["clean"]["against"]["right"]["stop"];
    assert!(code == 0 && stop["n"] == 1 && stop["mean"] == 0.0 && stop["lo"].as_f64() < Some(0.0), "{paired:#}");
    // A list says the same words, with paths from its own folder; without a word it is a stream.
    let list = place.path().join("list.txt");
    fs::write(&list, "clips/stop/a.wav\tstop\n\nclips/seven/a.wav seven\nclips/noise/hiss.wav\n").expect("written");
    let (listed, _) = evaluate(&place, &[&text(&list)]);
    let listed = &listed["conditions"]["clean"];
    let n = |path: &str| listed.pointer(path).and_then(Value::as_u64);
    assert_eq!((n("/recall/stop/n"), n("/false_accepts/seven/n")), (Some(1), Some(1)), "{listed:#}");
}

/// A WAV of this format with a second of samples, its header saying so many bytes.
fn wav(channels: u16, rate_hz: u32, said: u32) -> Vec<u8> {
    let mut bytes = b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\x01\0".to_vec();
    bytes.extend(channels.to_le_bytes());
    bytes.extend(rate_hz.to_le_bytes());
    bytes.extend((rate_hz * u32::from(channels) * 2).to_le_bytes());
    bytes.extend((channels * 2).to_le_bytes());
    bytes.extend([16, 0]);
    bytes.extend(b"data");
    bytes.extend(said.to_le_bytes());
    bytes.extend(vec![1; 2 * RATE_HZ as usize]);
    bytes
}

#[test]
fn what_is_no_sound_is_told_with_file_and_line() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let at = |name: &str| place.path().join(name);
    fs::write(at("short.wav"), wav(1, RATE_HZ, 99_999)).expect("written");
    fs::write(at("stereo.wav"), wav(2, RATE_HZ, 32_000)).expect("written");
    fs::write(at("fast.wav"), wav(1, 44_100, 32_000)).expect("written");
    fs::write(at("swift.wav"), wav(1, 1_000_000, 32_000)).expect("written");
    fs::write(at("none.flac"), "no FLAC").expect("written");
    fs::write(at("song.wav"), "ID3 what is called so and is none").expect("written");
    fs::write(at("empty.wav"), &wav(1, RATE_HZ, 0)[..44]).expect("written");
    fs::write(at("list.txt"), "  # a remark\nnowhere.wav left\n").expect("written");
    fs::write(at("short.txt"), "short.wav\tstop\n").expect("written");
    fs::create_dir_all(at("empty").join("stop")).expect("made");
    fs::write(at("cues.toml"), "sha256 = 1\n").expect("written");
    fs::write(at("voice.toml"), "[cue.voice]\nmodel = \"cues.toml\"\n").expect("written");
    for (args, what) in [
        (vec![text(&at("short.wav"))], "short.wav: it was cut off"),
        (vec![text(&at("swift.wav"))], "swift.wav: 1 channels at 1000000 Hz: this is no recorded speech"),
        (vec![text(&at("none.flac"))], "none.flac: it is no whole FLAC file"),
        (vec![text(&at("song.wav"))], "song.wav: it is no whole WAV file"),
        (vec![text(&at("empty.wav"))], "empty.wav: no samples are in it"),
        (vec![text(&at("list.txt"))], "list.txt:2: "),
        (vec![text(&at("short.txt"))], "short.txt:1: "),
        (vec![text(&at("empty"))], "no WAV or FLAC file is there"),
        (vec![text(&at("nowhere"))], "nowhere"),
        (vec![text(&at("empty")), "--config".to_owned(), text(&at("voice.toml"))], "cues.toml"),
    ] {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let (told, code) = evaluate(&place, &args);
        assert_eq!(code, 2, "{args:?}: {told:#}");
        assert!(told["error"].as_str().is_some_and(|error| error.contains(what)), "{args:?}: {told:#}");
    }
    // In a folder, other rates and channels are heard, and what cannot be read is left out and told.
    fs::remove_file(at("list.txt")).expect("there");
    let (report, code) = evaluate(&place, &[&text(place.path())]);
    let left_out = report["left_out"].as_array().expect("a list");
    assert_eq!((code, report["files"].as_u64(), left_out.len()), (0, Some(2), 5), "{report:#}");
    let told =
        left_out.iter().filter_map(|one| one["why"].as_str()).any(|why| why.contains("song.wav: it is no whole"));
    assert!(told, "{report:#}");
    // Nor does a walk begin in which nobody would be heard.
    for (name, what) in [("fast.wav", "44100 Hz"), ("song.wav", "no whole WAV"), ("empty.wav", "no samples")] {
        let (told, code) = place.json(&["walk", "--json", "--voice", &text(&at(name))]);
        assert_eq!(code, 2, "{name}: {told:#}");
        assert!(told["error"].as_str().is_some_and(|error| error.contains(what)), "{name}: {told:#}");
    }
}
