//! Guided walks of the whole process stack.

use std::process::{Child, Command};

use guidedog_tests::{Place, data, has_legs, touches};
use serde_json::Value;

fn assert_good(report: &Value, scenario: &str, distance_m: f64) {
    assert_eq!(report["reached"], true, "{scenario}: {report:#}");
    assert_eq!(report["collisions"]["robot"], 0, "{scenario}");
    assert_eq!(report["collisions"]["handler"], 0, "{scenario}");
    assert!(report["distance_m"].as_f64().is_some_and(|d| d >= distance_m), "{scenario}: {}", report["distance_m"]);
    assert_eq!(report["missed_decisions"], 0, "{scenario}");
    let lost = report["lost"].as_object().expect("lost by topic");
    assert!(lost.values().all(|n| n == 0), "{scenario}: {lost:?}");
}

pub(crate) fn walk(scenario: &str, more: &[&str]) -> Value {
    let place = Place::new();
    let mut args = vec!["walk", "--scenario", scenario, "--speed", "0", "--json"];
    args.extend(more);
    let (report, code) = place.json(&args);
    assert_eq!(code, 0, "{scenario}: {report:#}");
    place.assert_empty();
    report
}

#[test]
fn every_built_in_scenario_is_walked_without_a_collision() {
    // The corridor and the tee are walked by tests below.
    for scenario in ["curve", "cluttered", "crossing", "l-turn"] {
        assert_good(&walk(scenario, &[]), scenario, 30.0);
    }
}

/// One overtakes, two come the other way side by side, and one stops in the way.
#[test]
fn people_of_the_social_force_model_are_met_without_a_touch() {
    let report = walk("people", &[]);
    assert_good(&report, "people", 30.0);
    assert_eq!(report["collisions"]["hit_by_others"], 0, "{report:#}");
}

/// A leaf opens beside the way, and two open across it until they shut again.
#[test]
fn doors_that_open_before_the_robot_are_passed_without_a_touch() {
    assert_good(&walk("opening-doors", &[]), "opening-doors", 30.0);
}

#[test]
fn a_robot_on_legs_passes_doors_that_open() {
    if has_legs() {
        let report = walk("opening-doors", &["--physics", "mujoco"]);
        assert_eq!((&report["reached"], touches(&report)), (&Value::Bool(true), [0, 0]), "{report:#}");
    }
}

/// Kim et al. 2023, section 3: the robot makes up for the handler's errors.
#[test]
fn a_handler_who_faces_off_the_way_and_cues_too_early_or_too_late_gets_there() {
    for (orientation, timing) in [("20", "-1"), ("-20", "1.5")] {
        let errors = ["--orientation-error", orientation, "--timing-error", timing];
        assert_good(&walk("left-at-tee", &errors), "left-at-tee", 30.0);
    }
}

/// A process that computes for nothing until it is dropped.
struct Hog(Child);

impl Hog {
    fn new() -> Self {
        Self(Command::new("sh").args(["-c", "while :; do :; done"]).spawn().expect("a shell"))
    }
}

impl Drop for Hog {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_walk_in_stepped_time_is_the_same_on_a_loaded_machine() {
    let quiet = walk("left-at-tee", &[]);
    assert_good(&quiet, "left-at-tee", 30.0);
    let hog = Hog::new();
    let loaded = walk("left-at-tee", &[]);
    drop(hog);
    for key in
        ["digest", "decisions", "verdicts", "refusals", "published", "taken", "stops", "distance_m", "duration_s"]
    {
        assert_eq!(quiet[key], loaded[key], "{key}");
    }
    assert_eq!(quiet["digest"].as_str().map(str::len), Some(64));
    assert_ne!(quiet["digest"], walk("left-at-tee", &["--seed", "2"])["digest"], "another seed is another walk");
}

#[test]
fn a_walk_in_real_time_reports_its_latencies() {
    let place = Place::new();
    let (report, code) = place.json(&["walk", "--scenario", &place.along_corridor(2.0), "--json"]);
    assert_eq!((code, &report["reached"]), (0, &true.into()), "{report:#}");
    assert_eq!(report["collisions"]["robot"], 0);
    for latency in ["scan_to_permit", "permit_to_command", "depth_to_consumer"] {
        assert!(report["latency_us"][latency]["n"].as_u64().is_some_and(|n| n > 5), "{latency}: {report:#}");
    }
    place.assert_empty();
}

#[test]
fn two_runs_live_side_by_side() {
    let place = Place::new();
    let run = |name| place.command(&["walk", "--speed", "0", "--json", "--name", name]).spawn().expect("starts");
    let (one, two) = (run("one"), run("two"));
    let reports = [one, two].map(|child| child.wait_with_output().expect("ends"));
    let digests = reports.map(|output| {
        let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
        assert_good(&report, "corridor", 30.0);
        report["digest"].clone()
    });
    assert_eq!(digests[0], digests[1]);
    place.assert_empty();
}

/// A walk of 40 s ahead on the third floor of a real building; the report.
fn on_a_real_floor(start: &str) -> Option<Value> {
    let map = data("maps/utexas_gdc/3.yaml")?;
    let place = Place::new();
    let route = place.path().join("route.toml");
    std::fs::write(&route, "time_limit_s = 40\n[[cue]]\nkind = \"forward\"\nat_s = 1.0\n").expect("written");
    let (map, route) = (map.to_string_lossy().into_owned(), route.to_string_lossy().into_owned());
    let args = ["walk", "--map", &map, "--start", start, "--cues", &route, "--speed", "0", "--json"];
    let (report, code) = place.json(&args);
    assert_eq!(code, 0, "{report:#}");
    assert_eq!(touches(&report), [0, 0], "{report:#}");
    place.assert_empty();
    Some(report)
}

/// In the middle of a corridor, and with the handler 0.1 m from the wall. There the pair once turned to and fro for
/// good: every plan led aside, over floor that the camera had not seen.
#[test]
fn a_real_floor_is_walked() {
    for start in ["-46.4,-11.5,0.0", "6.0,31.0,180deg"] {
        let Some(report) = on_a_real_floor(start) else { return };
        assert!(report["distance_m"].as_f64().is_some_and(|d| d > 10.0), "{start}: {report:#}");
        assert!(report["longest_freeze_s"].as_f64().is_some_and(|s| s < 20.0), "{start}: {report:#}");
    }
}

#[test]
fn what_standing_still_costs_is_measured_of_every_service() {
    let place = Place::new();
    let (report, code) = place.json(&["bench", "idle", "--seconds", "2", "--json"]);
    let services = report["services"].as_array().unwrap_or_else(|| panic!("{report:#}"));
    assert_eq!((code, services.len()), (0, 10), "{report:#}");
    for figure in ["rss_kib", "wake_ups_per_s"] {
        assert!(services.iter().all(|service| service[figure].as_f64() > Some(0.0)), "{figure}: {report:#}");
    }
    assert!(report["sleeper_cpu_percent"].as_f64().is_some_and(|percent| percent > 0.0), "{report:#}");
    place.assert_empty();
}
