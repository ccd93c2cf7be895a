//! Wrong files and arguments: a clear error that names file, line or key, a documented exit code, and nothing started.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::process::Command;

use guidedog_tests::{Place, data, project};

/// Runs `guidedog` with bad input: it must say all of `said` on standard error and exit with 2.
fn refused(place: &Place, args: &[&str], said: &[&str]) {
    let output = place.guidedog(args);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
    assert!(!text.contains("panicked"), "{text}");
    for word in said {
        assert!(text.contains(word), "{args:?} does not say {word:?}: {text}");
    }
    place.assert_empty();
}

fn file(place: &Place, name: &str, content: impl AsRef<[u8]>) -> String {
    let path = place.path().join(name);
    fs::write(&path, content).expect("written");
    path.to_string_lossy().into_owned()
}

#[test]
fn a_wrong_configuration_names_file_and_line() {
    let place = Place::new();
    let unknown = file(&place, "a.toml", "[lidar]\nbeems = 3\n");
    refused(&place, &["walk", "--config", &unknown], &["a.toml", "line 2", "beems"]);
    let wrong = file(&place, "b.toml", "\n[max_age]\nscan = \"0s\"\n");
    refused(&place, &["walk", "--config", &wrong], &["b.toml", "line 3"]);
    let conflict = file(&place, "c.toml", "[depth]\nsource = \"absent\"\n");
    refused(&place, &["walk", "--config", &conflict], &["c.toml", "depth.needed"]);
    refused(&place, &["walk", "--config", "/nowhere/x.toml"], &["/nowhere/x.toml"]);
}

#[test]
fn a_policy_that_cannot_decide_is_told_before_anything_is_started() {
    let place = Place::new();
    for verb in ["walk", "up"] {
        refused(&place, &[verb, "--policy", "/nowhere/x.onnx"], &["/nowhere/x.onnx"]);
        let bytes = file(&place, "x.onnx", "no network");
        refused(&place, &[verb, "--policy", &bytes], &["x.toml"]);
    }
    // The manifest is right, and the runtime cannot load what it names: one message, and no row of restarts.
    let shipped = fs::read_to_string(project().join("config/policies/guide.toml")).expect("it is shipped");
    let digest = shipped.lines().find(|line| line.starts_with("sha256 = ")).expect("a digest");
    let of_no_network = "sha256 = \"bd108b5c39016c09b9872915cc48ecdd12a48fed1658cbf299823f5591cbb93a\"";
    let bytes = file(&place, "bad.onnx", "no network");
    file(&place, "bad.toml", shipped.replace(digest, of_no_network));
    for verb in ["walk", "up"] {
        refused(&place, &[verb, "--policy", &bytes], &["bad.onnx"]);
        refused(&place, &[verb, "--record", "/proc/walk.mcap"], &["/proc/walk.mcap: "]);
    }
    let model = file(&place, "of-ten.geometric", "");
    let digest = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
    let observation = "lidar-depth-pose-cue/1";
    let manifest = format!("sha256 = {digest:?}\nobservation = {observation:?}\nactions = \"ten\"\ndt = \"500ms\"\n");
    file(&place, "of-ten.toml", manifest);
    refused(&place, &["walk", "--policy", &model], &["of-ten.toml", "of 10 actions", "of 9 actions"]);
}

#[test]
fn a_missing_world_or_scenario_is_named() {
    let place = Place::new();
    refused(&place, &["walk", "--scenario", "moon"], &["moon", "corridor"]);
    let scenario = "world = \"gone.toml\"\nstart = { at = [0, 0], yaw_deg = 0 }\n\
        goal = { at = [1, 0], within_m = 1 }\ntime_limit_s = 10\n";
    let lost = file(&place, "s.toml", scenario);
    refused(&place, &["walk", "--scenario", &lost], &["gone.toml"]);
    let route = file(&place, "r.toml", "[[cue]]\nkind = \"up\"\nat_s = 1\n");
    refused(&place, &["walk", "--cues", &route], &["r.toml", "2"]);
}

#[test]
fn a_bad_map_names_its_file() {
    let place = Place::new();
    let yaml =
        "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
    let map = file(&place, "m.yaml", yaml);
    let walk = |place: &Place, said: &[&str]| {
        refused(place, &["walk", "--map", &map, "--start", "1,1,0"], said);
    };
    walk(&place, &["m.pgm"]);
    file(&place, "m.pgm", "P5\n100 100\n255\nshort");
    walk(&place, &["m.pgm"]);
    file(&place, "m.pgm", "P5\n999999 999999\n255\n");
    walk(&place, &["m.pgm"]);
    file(&place, "m.pgm", "no image");
    walk(&place, &["m.pgm"]);
    file(&place, "m.pgm", [b"P5\n40 40\n255\n".as_slice(), &[254u8; 1600]].concat());
    refused(&place, &["walk", "--map", &map, "--start", "1,one,0"], &["--start"]);
    refused(&place, &["walk", "--map", &map, "--start", "900,1,0"], &["start"]);
    file(&place, "m.yaml", yaml.replace("0.05", "0"));
    walk(&place, &["m.yaml", "resolution"]);
}

#[test]
fn a_log_or_recording_that_is_none_is_refused() {
    let place = Place::new();
    let out = place.path().join("o.mcap").to_string_lossy().into_owned();
    let text = file(&place, "t.log", "hello world\n");
    refused(&place, &["import", "carmen", &text, "-o", &out], &["t.log", "1"]);
    let empty = file(&place, "e.log", "");
    refused(&place, &["import", "carmen", &empty, "-o", &out], &["e.log"]);
    refused(&place, &["replay", &text], &["t.log"]);
    refused(&place, &["replay", "/nowhere.mcap"], &["/nowhere.mcap"]);
    assert!(!fs::exists(&out).expect("readable"), "nothing is left of a refused import");
    if let Some(log) = data("lidar/radish_mit-csail.clf.bz2") {
        let cut = fs::read(log).expect("readable");
        let cut = file(&place, "cut.clf.bz2", &cut[..cut.len() / 2]);
        refused(&place, &["import", "carmen", &cut, "-o", &out], &["cut.clf.bz2"]);
    }
}

/// A named pipe that nobody writes to: whoever opened it would wait for ever.
fn fifo(place: &Place, name: &str) -> String {
    let path = place.path().join(name);
    let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo is there");
    assert!(made.success());
    path.to_string_lossy().into_owned()
}

#[test]
fn a_folder_and_a_pipe_are_no_files() {
    let place = Place::new();
    let out = place.path().join("o.mcap").to_string_lossy().into_owned();
    let folder = place.path().join("folder");
    fs::create_dir(&folder).expect("made");
    for (path, name) in [(folder.to_string_lossy().into_owned(), "folder"), (fifo(&place, "pipe"), "pipe")] {
        refused(&place, &["walk", "--config", &path], &[name]);
        refused(&place, &["walk", "--scenario", &path], &[name]);
        refused(&place, &["walk", "--cues", &path], &[name]);
        refused(&place, &["walk", "--map", &path, "--start", "1,1,0"], &[name]);
        refused(&place, &["replay", &path], &[name]);
        refused(&place, &["import", "carmen", &path, "-o", &out], &[name]);
        refused(&place, &["import", "rplidar", &path, "-o", &out], &[name]);
        refused(&place, &["fit", &path], &[name, "not a file"]);
        refused(&place, &["shield", "--recording", &path], &[name]);
        let yaml = format!(
            "image: {name}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        );
        let map = file(&place, "m.yaml", yaml);
        refused(&place, &["walk", "--map", &map, "--start", "1,1,0"], &[name]);
    }
    assert!(!fs::exists(&out).expect("readable"), "nothing is left of a refused import");
}

#[test]
fn a_hostile_recording_is_refused_by_every_command_that_reads_one() {
    let place = Place::new();
    let mcap = b"\x89MCAP0\r\n";
    // A footer that names a summary before the file, one of all the memory there is, and one that is none.
    for (name, middle) in [("a.mcap", &[2u8, 20, 0, 0, 0, 0, 0, 0, 0][..]), ("b.mcap", &[0xff; 64]), ("c.mcap", &[])] {
        let bytes = [mcap.as_slice(), middle, &[0xff; 20], mcap].concat();
        let path = file(&place, name, bytes);
        refused(&place, &["replay", &path], &[name]);
        refused(&place, &["shield", "--recording", &path], &[name]);
        let cut = file(&place, "cut.mcap", mcap);
        refused(&place, &["replay", &cut], &["cut.mcap", "torn"]);
    }
}

#[test]
fn walks_to_fit_that_are_none_name_file_and_line() {
    let place = Place::new();
    let heading =
        "subject,trajectory,repetition,t_s,robot_x_m,robot_y_m,robot_yaw_rad,human_x_m,human_y_m,human_yaw_rad\n";
    let row = |t: f64| format!("a,1,1,{t},0,0,0,-0.7,0,0\n");
    let data = file(&place, "d.csv", format!("{heading}{}{}{}", row(0.0), row(0.9), row(0.5)));
    refused(&place, &["fit", &data], &["d.csv:4", "comes after"]);
    let data = file(&place, "d.csv", format!("{heading}{}{}", row(0.0), row(0.9)));
    refused(&place, &["fit", &data], &["d.csv:3", "gap"]);
    let data = file(&place, "d.csv", "subject,trajectory\na,1\n");
    refused(&place, &["fit", &data], &["d.csv:1", "repetition", "missing"]);
    refused(&place, &["fit", "/nowhere.csv"], &["/nowhere.csv"]);
}

#[test]
fn a_script_that_is_not_there_names_the_key_that_names_it() {
    let place = Place::new();
    let config = file(&place, "c.toml", "[cue]\nscript = \"gone.toml\"\n");
    refused(&place, &["walk", "--config", &config], &["cue.script", "gone.toml"]);
}

#[test]
fn what_cannot_be_written_is_told() {
    let place = Place::new();
    let full = || fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    for args in [&["--help"][..], &["walk", "--help"], &["--version"], &["doctor", "--json"]] {
        let output = place.command(args).stdout(full()).output().expect("it starts");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{args:?}: {text}");
        assert!(text.contains("standard output"), "{args:?}: {text}");
    }
    place.assert_empty();
}

#[test]
fn scripts_refuse_what_they_do_not_know() {
    for args in [&["properties", "extra"][..], &["fuzz", "soon"], &["training", "extra"], &["nothing"]] {
        let output = Command::new(project().join("scripts/nightly")).args(args).output().expect("it starts");
        assert_eq!(output.status.code(), Some(2), "{args:?}");
    }
}

#[test]
fn wrong_arguments_are_usage_errors() {
    let place = Place::new();
    for args in [&["wlak"][..], &["walk", "--sped", "3"], &["cue", "up"], &["walk", "--speed", "-1"], &["import"]] {
        let output = place.guidedog(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(!output.stderr.is_empty());
    }
    let mut command = place.command(&["evaluate", "--policy"]);
    let output = command.arg(OsStr::from_bytes(b"m/\xff.onnx")).output().expect("it starts");
    assert_eq!(output.status.code(), Some(2), "a path that is not UTF-8: {output:?}");
    let output = place.guidedog(&["status"]);
    assert_eq!(output.status.code(), Some(4), "no run is alive");
}

#[test]
fn the_help_lists_every_exit_code() {
    let output = Place::new().guidedog(&["--help"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for verb in ["walk", "up", "status", "why", "cue", "stop", "resume", "doctor", "import", "replay", "bench"] {
        assert!(text.contains(verb), "{verb}: {text}");
    }
    assert!(text.to_lowercase().contains("exit"), "{text}");
    assert!(project().join("config/guidedog.toml").exists());
}
