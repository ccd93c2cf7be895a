//! Features, networks and rules held against those of `scripts/train/cues`, which made `golden.json`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use guidedog_hearing::{
    CueRules, Ears, FRAMES_A_STEP, Head, LABELS, LogMel, Mel, ModelFiles, Networks, Periodicity, Recogniser, Rules,
    Sound, level_db,
};
use serde_json::{Value, json};

fn golden() -> Value {
    serde_json::from_str(include_str!("golden.json")).expect("JSON")
}

/// What `golden.json` says of its signal, in words.
fn signal() -> Vec<f32> {
    let mut state = 1_u32;
    let tone = |hz: f64, sweep: f64, t: f64| (std::f64::consts::TAU * (hz * t + sweep * t * t)).sin();
    (0..48_000_u32)
        .map(|n| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (t, noise) = (f64::from(n) / 16_000.0, f64::from(state) / f64::from(1_u32 << 31) - 1.0);
            let second = if n / 4000 % 2 == 1 { 0.1 * tone(1200.0, 300.0, t) } else { 0.0 };
            let sound = 0.3 * tone(200.0, 150.0, t) + second + 0.02 * noise;
            if (16_000..20_000).contains(&n) { 0.0 } else { sound as f32 }
        })
        .collect()
}

fn numbers(value: &Value) -> Vec<f32> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number") as f32).collect()
}

fn by_number(value: &Value) -> BTreeMap<usize, Value> {
    let entries = value.as_object().expect("an object").iter();
    entries.map(|(at, value)| (at.parse().expect("a number"), value.clone())).collect()
}

fn frames(signal: &[f32]) -> Vec<Mel> {
    let (mut mel, mut frames) = (LogMel::default(), Vec::new());
    mel.push(signal, |frame| frames.push(frame));
    frames
}

#[test]
fn frames_and_their_levels_are_those_of_training() {
    let (golden, signal) = (golden(), signal());
    for (at, sample) in by_number(&golden["samples"]) {
        assert!((f64::from(signal[at]) - sample.as_f64().expect("a number")).abs() < 1e-6, "sample {at}");
    }
    let frames = frames(&signal);
    for (at, expected) in by_number(&golden["log_mel"]) {
        for (found, expected) in frames[at].iter().zip(numbers(&expected)) {
            assert!((found - expected).abs() < 1e-3, "frame {at}: {found}, not {expected}");
        }
    }
    for (at, expected) in by_number(&golden["levels_db"]) {
        let (found, expected) = (level_db(&frames[at]), expected.as_f64().expect("a number"));
        assert!((found - expected).abs() < 1e-2, "frame {at}: {found} dB, not {expected}");
    }
    let mut periodicities = Vec::new();
    Periodicity::default().push(&signal, |periodicity| periodicities.push(f64::from(periodicity)));
    for (at, expected) in by_number(&golden["periodicity"]) {
        let (found, expected) = (periodicities[at], expected.as_f64().expect("a number"));
        assert!((found - expected).abs() < 1e-4, "frame {at}: periodicity {found}, not {expected}");
    }
}

/// The rules of a case as they stand in a manifest.
fn rules(case: &Value) -> Rules {
    let of = |key: &str| case["rules"][key].clone();
    let ms = |key: &str| json!(format!("{}ms", (of(key).as_f64().expect("seconds") * 1000.0).round()));
    let manifest = json!({
        "stop": { "threshold": of("stop"), "steps": of("stop_steps") },
        "direction": {
            "threshold": {
                "forward": case["rules"]["directions"][0],
                "left": case["rules"]["directions"][1],
                "right": case["rules"]["directions"][2],
                "go": case["rules"]["directions"][3],
            },
            "steps": of("direction_steps"),
            "isolated": of("isolated"),
        },
        "start": { "forward": case["rules"]["starts"][0], "go": case["rules"]["starts"][1] },
        "refractory": ms("refractory_s"),
        "isolation": {
            "quiet": ms("quiet_s"), "segment_max": ms("segment_max_s"), "wait_max": ms("wait_max_s"),
            "reach": ms("reach_s"), "margin_db": of("margin_db"), "depth_db": of("depth_db"),
            "floor_rise_db": of("floor_rise_db"), "floor_fall": of("floor_fall"),
        },
        "voice": {
            "periodicity": of("periodicity"), "voiced": ms("voiced_s"), "above_floor_db": of("above_floor_db"),
        },
        "talk": {
            "reach": ms("talk_s"), "voiced": ms("talk_voiced_s"), "depth_db": of("talk_depth_db"),
            "stop": { "threshold": of("talk_stop"), "steps": of("talk_stop_steps") },
        },
    });
    serde_json::from_value(manifest).expect("rules")
}

#[test]
fn rules_are_followed_as_in_training() {
    for case in golden()["rules"].as_array().expect("cases") {
        let (mut rules, mut found, mut step) = (CueRules::new(rules(case), false), Vec::new(), 0_u64);
        let voiced = case["periodicity"].as_f64().expect("a number") as f32;
        for span in case["spans"].as_array().expect("spans") {
            let p = span["probability"].as_f64().expect("a number") as f32;
            let label = span["label"].as_str().expect("a label");
            // What is left is the other words'.
            let share = |of: &str| if of == "other" { 1.0 - p } else { 0.0 };
            let probabilities = LABELS.map(|of| share(of) + if of == label { p } else { 0.0 });
            for _ in 0..span["steps"].as_u64().expect("a count") {
                let level_db = span["level_db"].as_f64().expect("a number");
                // What is not loud is not periodic either.
                let periodicity = if level_db > -40.0 { voiced } else { 0.0 };
                if let Some(heard) = rules.take(&probabilities, &[Sound { level_db, periodicity }; FRAMES_A_STEP]) {
                    let score = (f64::from(heard.score) * 1e4).round() / 1e4;
                    found.push(json!({
                        "cue": heard.kind.name(), "step": step, "heard": step - heard.steps_ago, "score": score,
                    }));
                }
                step += 1;
            }
        }
        assert_eq!(json!(found), case["detections"], "{}", case["name"]);
    }
}

fn files() -> ModelFiles {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/cues");
    let onnx_runtime = std::env::var_os("GUIDEDOG_ONNX_RUNTIME").map(PathBuf::from);
    ModelFiles { manifest: folder.join("cues.toml"), embedding: folder.join("embedding.onnx"), onnx_runtime }
}

#[test]
fn networks_give_what_they_gave_in_training() {
    let (files, golden) = (files(), golden());
    let head = Head::read(&files.manifest).expect("it is there");
    let mut networks = Networks::new(&head, &files).expect("they load");
    assert_eq!(golden["head"]["sha256"], json!(head.manifest.sha256), "golden.py was not run for this head");
    let (signal, frames) = (signal(), frames(&signal()));
    let embeddings = networks.embed(&frames).expect("it runs");
    for (at, expected) in by_number(&golden["embeddings"]) {
        for (found, expected) in embeddings[at].iter().zip(numbers(&expected)) {
            assert!((found - expected).abs() < 2e-2, "embedding {at}: {found}, not {expected}");
        }
    }
    // The whole way, in pieces as a microphone brings them.
    let mut recogniser = Recogniser::load(&files).expect("it loads");
    let mut found = Vec::new();
    for piece in signal.chunks(777) {
        recogniser.push(piece, Ears::Open, |step| found.push(step.probabilities)).expect("it runs");
    }
    let expected = golden["head"]["probabilities"].as_array().expect("steps");
    assert_eq!(found.len(), expected.len());
    for (step, (found, expected)) in found.iter().zip(expected).enumerate() {
        for (found, expected) in found.iter().zip(numbers(expected)) {
            assert!((found - expected).abs() < 2e-3, "step {step}: {found}, not {expected}");
        }
    }
}
