//! A handler's voice is learnt: `guidedog cue enrol` by clips of a synthetic voice.

use std::fs;
use std::path::{Path, PathBuf};

use guidedog_tests::{Place, can_hear, spoken_by, write_wav};
use serde_json::Value;

const CUES: [&str; 4] = ["forward", "left", "right", "stop"];

/// Three clips of each cue, by a voice that is not easily understood.
fn clips(place: &Place, name: &str) -> PathBuf {
    let folder = place.path().join(name);
    for cue in CUES {
        for (number, speed) in ["120", "150", "180"].into_iter().enumerate() {
            let samples = spoken_by("es", speed, cue);
            write_wav(&folder.join(cue).join(format!("{number}.wav")), &samples);
        }
    }
    folder
}

fn enrol(place: &Place, args: &[&str]) -> (Value, i32) {
    place.json(&[&["cue", "enrol", "--json"], args].concat())
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Recall of all cues by the head that a configuration names.
fn recall(place: &Place, clips: &Path, manifest: &Path) -> f64 {
    let config = place.path().join("voice.toml");
    fs::write(&config, format!("[cue.voice]\nmodel = \"{}\"\n", manifest.display())).expect("written");
    let (report, code) = place.json(&["evaluate-cues", "--json", "--config", &text(&config), &text(clips)]);
    assert_eq!(code, 0, "{report:#}");
    report["conditions"]["clean"]["recall"]["all"]["mean"].as_f64().expect("a rate")
}

#[test]
fn a_voice_is_learnt_and_that_can_be_taken_back() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let (clips, anna) = (clips(&place, "clips"), place.path().join("anna"));
    let (manifest, before) = (anna.join("head.toml"), place.path().join("anna.before").join("head.toml"));
    let (report, code) = enrol(&place, &["-o", &text(&anna), "--from", &text(&clips)]);
    assert_eq!((code, report["clips"].as_u64()), (0, Some(12)), "{report:#}");
    assert_eq!(report["head"], text(&manifest).as_str());
    let heard = &report["own"]["cues_heard"];
    assert!(heard["after"].as_u64() >= heard["before"].as_u64() && heard["of"] == 48, "{report:#}");
    assert!(report["other_voices"]["others_taken"]["of"].as_u64() > Some(500), "{report:#}");
    let (after, shipped) = (recall(&place, &clips, &manifest), recall(&place, &clips, &before));
    assert!(after > 0.9 && after >= shipped, "{after}, {shipped} before");
    assert_eq!(fs::read_dir(anna.join("clips").join("left")).expect("they are kept").count(), 3);
    let enrolled = fs::read_to_string(&manifest).expect("there");
    // Undoing it twice brings it back, and the same clips give the same head.
    for now in [&shipped, &after] {
        assert_eq!(enrol(&place, &["-o", &text(&anna), "--undo"]).1, 0);
        assert_eq!(recall(&place, &clips, &manifest), *now);
    }
    assert_eq!(fs::read_to_string(&manifest).expect("there"), enrolled);
    assert_eq!(enrol(&place, &["-o", &text(&anna), "--from", &text(&clips)]).0["sha256"], report["sha256"]);
    assert_eq!(fs::read_to_string(&manifest).expect("there"), enrolled);
}

#[test]
fn what_cannot_be_enrolled_is_told_and_leaves_everything_as_it_is() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let (few, mine) = (place.path().join("few"), place.path().join("mine"));
    write_wav(&few.join("left").join("1.wav"), &spoken_by("en-us", "150", "left"));
    let broken = place.path().join("broken");
    fs::create_dir_all(broken.join("stop")).expect("made");
    fs::write(broken.join("stop").join("1.wav"), b"RIFF\0\0\0\0WAVE").expect("written");
    fs::create_dir_all(&mine).expect("made");
    fs::write(mine.join("letter.txt"), "dear").expect("written");
    let empty = place.path().join("empty");
    fs::create_dir_all(&empty).expect("made");
    let other = place.path().join("other.toml");
    fs::write(&other, "sha256 = \"00\"\n").expect("written");
    let silent = place.path().join("silent");
    write_wav(&silent.join("stop").join("1.wav"), &[1; 16_000]);
    let (swapped, dangling) = (place.path().join("swapped"), place.path().join("dangling"));
    for (cue, said) in [("forward", "stop"), ("stop", "forward")] {
        for number in ["1", "2", "3"] {
            write_wav(&swapped.join(cue).join(format!("{number}.wav")), &spoken_by("en-us", "150", said));
        }
    }
    std::os::unix::fs::symlink("nowhere", &dangling).expect("linked");
    let new = text(&place.path().join("new"));
    for (args, what) in [
        (vec!["-o", &new, "--from", &text(&few)], "left: 1 clips, and at least 3 are needed"),
        (vec!["-o", &new, "--from", &text(&broken)], "1.wav: no samples came"),
        (vec!["-o", &new, "--from", &text(&empty)], "no WAV or FLAC file"),
        (vec!["-o", &text(&mine), "--from", &text(&few)], "mine: it is no folder that"),
        (vec!["-o", &new, "--from", &text(&silent)], "1.wav: nothing is to be heard in it"),
        (vec!["-o", &new, "--from", &text(&swapped)], "most clips of \"forward\" were heard as \"stop\""),
        (vec!["-o", &text(&dangling), "--from", &text(&few)], "dangling: it is no folder that"),
        (vec!["-o", &new, "--undo"], "nothing was enrolled there"),
        (vec!["-o", &new, "--base", &text(&other), "--from", &text(&few)], "other.toml"),
        (vec!["-o", &new, "--base", "nowhere.toml", "--from", &text(&few)], "nowhere.toml"),
    ] {
        let (told, code) = enrol(&place, &args);
        assert_eq!(code, 2, "{args:?}: {told:#}");
        assert!(told["error"].as_str().is_some_and(|error| error.contains(what)), "{args:?}: {told:#}");
        for left in ["new", "new.new", "new.before"] {
            assert!(!place.path().join(left).exists(), "{args:?}: {left}");
        }
    }
    assert_eq!(fs::read_to_string(mine.join("letter.txt")).expect("there"), "dear");
}

/// Who is understood already has nothing to win, and other voices have something to lose.
#[test]
fn an_enrolment_that_would_do_more_harm_than_good_changes_nothing_and_says_so() {
    if !can_hear() {
        return;
    }
    let (place, mut clips) = (Place::new(), Vec::new());
    let folder = place.path().join("clips");
    for word in ["forward", "go", "left", "right", "stop", "seven", "yellow"] {
        for speed in ["130", "150", "170"] {
            clips.push((word, spoken_by("en-us", speed, word)));
        }
    }
    for (number, (word, samples)) in clips.iter().enumerate() {
        write_wav(&folder.join(word).join(format!("{number:02}.wav")), samples);
    }
    let new = place.path().join("new");
    let (told, code) = enrol(&place, &["-o", &text(&new), "--from", &text(&folder)]);
    let error = told["error"].as_str().unwrap_or_default();
    assert_eq!(code, 1, "{told:#}");
    assert!(error.contains("nothing was changed") && error.contains("your other words"), "{error}");
    assert!(["new", "new.new", "new.before"].iter().all(|name| !place.path().join(name).exists()));
}

#[test]
fn what_lies_beside_and_is_somebody_elses_is_left_as_it_is() {
    if !can_hear() {
        return;
    }
    let place = Place::new();
    let (clips, anna) = (clips(&place, "clips"), text(&place.path().join("anna")));
    for beside in ["anna.new", "anna.before"] {
        let thesis = place.path().join(beside).join("thesis.txt");
        fs::create_dir_all(thesis.parent().expect("a folder")).expect("made");
        fs::write(&thesis, "mine").expect("written");
        let (told, code) = enrol(&place, &["-o", &anna, "--from", &text(&clips)]);
        assert_eq!(code, 2, "{told:#}");
        assert!(told["error"].as_str().is_some_and(|error| error.contains(beside)), "{told:#}");
        assert_eq!(fs::read_to_string(&thesis).expect("it stays"), "mine");
        assert!(!place.path().join("anna").exists());
        fs::remove_dir_all(thesis.parent().expect("a folder")).expect("ours");
    }
    // What was spoken and has trained nothing yet is not written over by what is copied.
    let spoken = place.path().join("anna.new").join("clips").join("stop").join("01.wav");
    write_wav(&spoken, &spoken_by("en-us", "150", "stop"));
    fs::write(place.path().join("anna.new").join("origin"), "spoken\n").expect("written");
    let (told, code) = enrol(&place, &["-o", &anna, "--from", &text(&clips)]);
    assert_eq!(code, 2, "{told:#}");
    assert!(told["error"].as_str().is_some_and(|error| error.contains("goes on with it")), "{told:#}");
    assert!(spoken.is_file());
}
