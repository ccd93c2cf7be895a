//! Runs recorded, and recordings played back, on the real processes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use control::ServicePhase;
use guidedog_tests::{Live, Place, WATCHDOG, pid_of, service, signal};
use messages::ModeClass;
use recording::{Reader, Record};
use serde_json::Value;

/// Small frames, so that a walk is quick.
const CONFIG: &str = "[depth]\nwidth = 160\nheight = 120\n";

fn file(place: &Place, name: &str, text: &str) -> String {
    let path = place.path().join(name);
    fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

/// A stepped walk of that many seconds around a corner, recorded: its report, and the recording.
fn recorded_walk(place: &Place, seconds: u32) -> (Value, String) {
    let config = file(place, "small.toml", CONFIG);
    let recording = place.path().join("walk.mcap").to_string_lossy().into_owned();
    let limit = format!("{seconds}s");
    let args = ["walk", "--scenario", "l-turn", "--speed", "0", "--time-limit", &limit, "--config", &config, "--json"];
    let (report, code) = place.json(&[&args[..], &["--record", &recording]].concat());
    assert_eq!(code, 1, "it is too short for the goal: {report:#}");
    (report, recording)
}

fn lost(report: &Value) -> u64 {
    report["lost"].as_object().map_or(1, |lost| lost.values().filter_map(Value::as_u64).sum())
}

#[test]
fn a_stepped_walk_replays_to_the_very_permits_that_it_recorded() {
    let place = Place::new();
    let (walk, recording) = recorded_walk(&place, 24);
    assert_eq!((&walk["not_recorded"], lost(&walk)), (&0.into(), 0));
    // The whole run, at two speeds; and single streams into the same simulated walk.
    let runs: [&[&str]; 4] = [
        &["--speed", "0"],
        &["--speed", "60"],
        &["--speed", "0", "--streams", "depth,cue"],
        &["--speed", "0", "--streams", "scan,odometry"],
    ];
    for (i, args) in runs.into_iter().enumerate() {
        let (replay, code) = place.json(&[&["replay", &recording, "--json"], args].concat());
        assert_eq!((code, lost(&replay)), (0, 0), "{args:?}: {replay:#}");
        assert_eq!(replay["digest"], walk["digest"], "{args:?}: {replay:#}");
        if i < 2 {
            let compared = &replay["compared"];
            assert_eq!(compared["exact"], true);
            let recorded = compared["permits"]["recorded"].as_u64().expect("a count");
            assert!(recorded > 200 && compared["actions"]["recorded"].as_u64().is_some_and(|n| n > 40), "{compared:#}");
            assert_eq!(compared["permits"]["equal"], recorded);
            assert_eq!(compared["actions"]["equal"], compared["actions"]["recorded"]);
            assert_eq!(compared["permits"]["additional"], 0);
            assert!(replay["depth_frames"].as_u64().is_some_and(|n| n > 300));
        }
    }
    let (bench, code) = place.json(&["bench", "replay", &recording, "--repeat", "2", "--json"]);
    assert_eq!((code, &bench["equal_to_recording"], &bench["well"]), (0, &2.into(), &true.into()), "{bench:#}");
    place.assert_empty();
}

#[test]
fn a_replay_can_be_recorded_and_its_recording_replays_as_well() {
    let place = Place::new();
    let (walk, recording) = recorded_walk(&place, 6);
    let again = place.path().join("again.mcap").to_string_lossy().into_owned();
    let (replay, code) = place.json(&["replay", &recording, "--speed", "0", "--record", &again, "--json"]);
    assert_eq!((code, &replay["digest"]), (0, &walk["digest"]), "{replay:#}");
    let (third, code) = place.json(&["replay", &again, "--speed", "0", "--json"]);
    assert_eq!((code, &third["digest"]), (0, &walk["digest"]), "{third:#}");
    // Everything that was played came out as it went in, but for what has no counterpart.
    let played = |path: &str| -> Vec<Record> {
        let records = Reader::open(Path::new(path)).expect("whole").map(|record| record.expect("whole"));
        records.filter(|record| !matches!(record, Record::WorldTruth(_) | Record::LocomotionState(_))).collect()
    };
    let (first, second) = (played(&recording), played(&again));
    assert_eq!(first.len(), second.len());
    let different = first.iter().zip(&second).find(|(one, other)| !one.is_same(other));
    assert!(different.is_none(), "{different:?}");
}

#[test]
fn other_settings_are_held_against_the_recorded_decisions() {
    let place = Place::new();
    let (_, recording) = recorded_walk(&place, 12);
    let (same, code) = place.json(&["replay", &recording, "--against", "--json"]);
    assert_eq!((code, &same["compared"]["decided_differently"]), (0, &0.into()), "{same:#}");
    // With a body as wide as the corridor nothing is safe any more.
    let wide = file(&place, "wide.toml", "[shield]\nmargin_m = 0.5\n[robot]\nradius_m = 0.9\n");
    let (other, code) = place.json(&["replay", &recording, "--against", "--config", &wide, "--json"]);
    assert_eq!((code, &other["experiment"]), (7, &true.into()), "{other:#}");
    let differences = other["differences"].as_array().expect("a list");
    let walked = |d: &&Value| d["cause"] == "decision" && d["recorded"]["outcome"] == "granted";
    let first = differences.iter().find(walked).expect("a decision differs");
    assert_eq!(
        (&first["recorded"]["outcome"], &first["replayed"]["outcome"]),
        (&"granted".into(), &"all_unsafe".into())
    );
    assert!(first["recorded"]["action"].is_string() && first["decision"].as_u64().is_some_and(|n| n > 0), "{first:#}");
}

#[test]
fn a_part_is_played_again_and_again_and_the_cue_in_force_with_it() {
    let place = Place::new();
    let (_, recording) = recorded_walk(&place, 12);
    let play = || {
        let args = ["--from", "5s", "--to", "9s", "--loop", "3", "--speed", "0", "--json"];
        let (report, code) = place.json(&[&["replay", &recording], &args[..]].concat());
        assert_eq!((code, lost(&report)), (0, 0), "{report:#}");
        report
    };
    let (one, other) = (play(), play());
    assert_eq!(one["digest"], other["digest"]);
    let ended = |reason: &str| {
        let stops = one["stops"].as_array().expect("a list").iter();
        stops.filter(|stop| stop["reason"] == reason && stop["ended"] == true).count()
    };
    assert_eq!((ended("boot"), ended("pose_jump")), (1, 2), "{:#}", one["stops"]);
    let granted = one["verdicts_by_outcome"]["granted"].as_u64().expect("the robot walked");
    assert!(granted > 60, "{one:#}");
}

#[test]
fn a_killed_recorder_loses_at_most_half_a_second_and_the_next_goes_on_beside() {
    let place = Place::new();
    let config = file(&place, "small.toml", CONFIG);
    let recording = place.path().join("live.mcap");
    let name = recording.to_string_lossy().into_owned();
    // Slow enough to last, and with time for a look; what is lost does not depend on the machine's load.
    let args = ["--scenario", "corridor", "--speed", "4", "--config", &config, "--record", &name];
    let mut run = Live::up(&place, "rec", &args);
    run.wait("it walks and is recorded", |status| status.now_s > 4.0);
    let status = run.status();
    let (now_s, epoch) = (status.now_s, status.mode.epoch);
    signal(pid_of(&status, "recorder"), "KILL");
    run.wait("the recorder is back", |status| {
        let recorder = service(status, "recorder");
        recorder.incarnation == 2 && recorder.state == ServicePhase::Ready && status.now_s > now_s + 2.0
    });
    let mode = run.status().mode;
    assert_eq!((mode.epoch, mode.class), (epoch, ModeClass::Run), "no stop");
    let (report, _) = run.end();
    assert_eq!(report["restarts"]["recorder"], 1, "{report:#}");

    let torn = place.guidedog(&["recording", "check", &name]);
    assert_eq!(torn.status.code(), Some(2), "it is told to be torn");
    let told = String::from_utf8_lossy(&torn.stderr).into_owned();
    assert!(told.contains("live.mcap is torn: it ends at byte") && told.contains("recording recover"), "{told}");
    let (recovered, code) = place.json(&["recording", "recover", &name, "--json"]);
    assert_eq!(code, 0, "{recovered:#}");
    let whole = place.path().join("live.recovered.mcap");
    let (checked, code) = place.json(&["recording", "check", &whole.to_string_lossy(), "--json"]);
    assert_eq!((code, &checked["whole"]), (0, &true.into()), "{checked:#}");
    let mut last_ns = [0; 2];
    for record in Reader::open(&whole).expect("whole") {
        let record = record.expect("whole");
        last_ns[usize::from(matches!(record, Record::DepthFrame(_)))] = record.time_ns();
    }
    for last_ns in last_ns {
        assert!(last_ns as f64 / 1e9 >= now_s - 0.5, "recorded to {last_ns} ns, killed after {now_s} s");
    }
    let (next, code) =
        place.json(&["recording", "check", &place.path().join("live.2.mcap").to_string_lossy(), "--json"]);
    assert_eq!((code, &next["whole"]), (0, &true.into()), "{next:#}");
}

/// A file system with so little room, where this user may have one.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn new(place: &Place) -> Option<Self> {
        let path = place.path().join("disk");
        fs::create_dir(&path).expect("made");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=600k", "tmpfs"]).arg(&path).output();
        mounted.is_ok_and(|output| output.status.success()).then_some(Self(path))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_ends_the_recording_and_not_the_walk() {
    let place = Place::new();
    let disk = SmallDisk::new(&place);
    // The recorder's own tests have a disk of their own making.
    if !test_data::may(disk.is_some(), "no file system may be mounted here") {
        return;
    }
    let disk = disk.expect("it is mounted");
    let config = file(&place, "small.toml", CONFIG);
    let recording = disk.0.join("full.mcap").to_string_lossy().into_owned();
    let args = ["walk", "--scenario", "corridor", "--speed", "0", "--config", &config, "--json"];
    let (report, code) = place.json(&[&args[..], &["--record", &recording]].concat());
    assert_eq!((code, &report["reached"]), (0, &true.into()), "{report:#}");
    let notes = report["notes"].to_string();
    assert!(notes.contains("recording ended, and can be recovered") && notes.contains("full"), "{notes}");
    assert!(report["not_recorded"].as_u64().is_some_and(|n| n > 100), "{report:#}");
    let stops = report["stops"].as_array().expect("a list").iter().filter(|stop| stop["class"] == "fault");
    assert_eq!(stops.count(), 1, "boot alone: {report:#}");
    let whole = place.path().join("whole.mcap").to_string_lossy().into_owned();
    let (recovered, code) = place.json(&["recording", "recover", &recording, "-o", &whole, "--json"]);
    assert_eq!(code, 0, "{recovered:#}");
    assert!(recovered["recovered"][0]["info"]["records"]["odometry"].as_u64().is_some_and(|n| n > 50), "{recovered:#}");
    place.assert_empty();
}

#[test]
fn a_live_run_is_recorded_on_demand_and_nothing_is_overwritten() {
    let place = Place::new();
    let config = file(&place, "small.toml", CONFIG);
    let mut run = Live::up(&place, "live", &["--scenario", "corridor", "--config", &config]);
    run.wait_walking();
    let path = |name: &str| place.path().join(name).to_string_lossy().into_owned();
    for name in ["one.mcap", "two.mcap"] {
        let (info, code) = place.json(&["record", "-o", &path(name), "--duration", "1s", "--run", "live", "--json"]);
        assert_eq!((code, &info["whole_run"]), (0, &false.into()), "{info:#}");
        for topic in ["lidar/scan", "depth/frame", "odometry", "shield/permit", "mode", "policy/action", "world/truth"]
        {
            assert!(info["records"][topic].as_u64().is_some_and(|n| n > 0), "{topic}: {info:#}");
        }
        assert_eq!(service(&run.status(), "recorder").state, ServicePhase::Off);
    }
    let (refused, code) = place.json(&["record", "-o", &path("one.mcap"), "--run", "live", "--json"]);
    assert!(code == 2 && refused["error"].as_str().is_some_and(|e| e.contains("already exists")), "{refused:#}");
    let (_, code) = place.json(&["record", "-o", &path("x.mcap"), "--run", "nobody", "--json"]);
    assert_eq!(code, 4);
    let (report, _) = run.end();
    assert_eq!(report["lost_by_consumer"]["cue"]["recorder"], 0);
    // What was recorded in real time replays in stepped time, the same every time.
    let replay = || {
        let (report, code) = place.json(&["replay", &path("two.mcap"), "--speed", "0", "--json"]);
        assert_eq!((code, lost(&report)), (0, 0), "{report:#}");
        report["digest"].clone()
    };
    assert_eq!(replay(), replay());
    place.assert_empty();
}

#[test]
fn what_is_no_recording_is_told_by_name_and_byte() {
    let place = Place::new();
    let (_, recording) = recorded_walk(&place, 3);
    let whole = fs::read(&recording).expect("readable");
    let cut = place.path().join("cut.mcap");
    fs::write(&cut, &whole[..whole.len() / 2]).expect("written");
    let mut changed = whole.clone();
    changed[whole.len() / 2] ^= 0x20;
    let damaged = place.path().join("damaged.mcap");
    fs::write(&damaged, changed).expect("written");
    let foreign = file(&place, "foreign.mcap", "no MCAP at all");
    let cases = [
        (cut.to_string_lossy().into_owned(), "is torn: it ends at byte"),
        (damaged.to_string_lossy().into_owned(), "at byte"),
        (foreign, "does not begin with MCAP's magic bytes"),
        (place.path().join("none.mcap").to_string_lossy().into_owned(), "No such file"),
    ];
    for (path, what) in &cases {
        for args in [&["recording", "check", path][..], &["replay", path, "--speed", "0"]] {
            let output = place.guidedog(args);
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{args:?}: {told}");
            assert!(told.contains(what) && told.contains(path.rsplit('/').next().unwrap_or(path)), "{args:?}: {told}");
        }
    }
    fs::remove_file(place.path().join("walk.depth.mcap")).expect("it was there");
    let output = place.guidedog(&["replay", &recording, "--speed", "0"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && told.contains("walk.depth.mcap is missing"), "{told}");
    for args in [["--streams", "depth"], ["--from", "9s"], ["--to", "0s"], ["--streams", "walls"]] {
        let output = place.guidedog(&[&["replay", &recording, "--speed", "0"], &args[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    place.assert_empty();
}

#[test]
fn pythons_reader_reads_what_was_recorded() {
    let python = std::env::var_os("GUIDEDOG_PYTHON").unwrap_or_default();
    let missing = "GUIDEDOG_PYTHON is not set: scripts/test makes a Python with the package mcap, and sets it";
    if !test_data::has(!python.is_empty(), missing) {
        return;
    }
    let place = Place::new();
    let (walk, recording) = recorded_walk(&place, 6);
    let script = guidedog_tests::project().join("scripts/read_recording.py");
    let begun = Instant::now();
    let output = Command::new(python).arg(script).arg(&recording).output().expect("Python starts");
    assert!(begun.elapsed() < WATCHDOG);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    for topic in ["lidar/scan", "depth/frame", "odometry", "shield/permit", "policy/action", "world/truth", "cue"] {
        assert_eq!(read["messages"][topic], walk["published"][topic], "{topic}: {read:#}");
    }
    assert_eq!(read["schemas"]["lidar/scan"], "foxglove.LaserScan");
    assert_eq!(read["schemas"]["depth/frame"], "foxglove.RawImage");
    assert_eq!(
        (&read["schemas"]["log"], &read["schemas"]["scene"]),
        (&"foxglove.Log".into(), &"foxglove.SceneUpdate".into())
    );
    assert_eq!(read["messages"]["scene"], read["messages"]["shield/permit"]);
    assert!(read["logged"].as_array().is_some_and(|lines| lines.contains(&"run: cue forward".into())), "{read:#}");
    assert_eq!(read["depth"], serde_json::json!({ "width": 160, "height": 120, "encoding": "16UC1", "bytes": 38400 }));
    assert_eq!(read["granted_on_scans"], walk["verdicts_by_outcome"]["granted"]);
}
