//! The configuration explains itself: what is in force, where it comes from, and what is wrong with it.

use std::fs;

use guidedog_tests::{Live, Place};
use serde_json::Value;

/// The error of a verb that refuses its input.
fn refused(place: &Place, args: &[&str]) -> String {
    let output = place.guidedog(args);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {told}");
    told
}

#[test]
fn every_value_is_shown_with_its_origin() {
    let place = Place::new();
    let file = place.path().join("robot.toml");
    fs::write(&file, "[lidar]\nrate_hz = 9.0\nbeams = 720\n").expect("written");
    let args = ["config", "show", "--config", &file.to_string_lossy(), "--set", "lidar.rate_hz=8"];
    let output = place.guidedog(&args);
    let shown = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let origin = |line: &str| {
        let line =
            shown.lines().find(|shown| shown.starts_with(line)).unwrap_or_else(|| panic!("no {line} in\n{shown}"));
        line.split(" # ").nth(1).expect("an origin").to_owned()
    };
    assert_eq!(origin("rate_hz = 8.0"), "--set lidar.rate_hz=8");
    assert_eq!(origin("beams = 720"), format!("{}:3", file.display()));
    assert!(origin("keep_runs = 20").starts_with("config/guidedog.toml:"));
    // It is a configuration itself, and gives the same.
    let whole = place.path().join("whole.toml");
    fs::write(&whole, &shown).expect("written");
    let (given, _) = place.json(&[&args[..], &["--json"]].concat());
    let (again, _) = place.json(&["config", "show", "--config", &whole.to_string_lossy(), "--json"]);
    assert_eq!(given["settings"], again["settings"]);
    assert_eq!(given["origins"]["lidar.rate_hz"], "--set lidar.rate_hz=8");
    let (schema, code) = place.json(&["config", "schema"]);
    assert_eq!((code, &schema["additionalProperties"]), (0, &Value::from(false)));
}

#[test]
fn single_values_are_set_in_every_run() {
    let place = Place::new();
    let route = place.along_corridor(1.5);
    let recording = place.path().join("walk.mcap").to_string_lossy().into_owned();
    let walk = ["walk", "--json", "--speed", "0", "--scenario", &route, "--record", &recording];
    let (report, _) = place.json(&[&walk[..], &["--set", "policy.model=geometric"]].concat());
    assert_eq!(report["policy"]["engine"], "geometric", "{report:#}");
    let replay = ["replay", &recording, "--speed", "0", "--json"];
    let (as_recorded, _) = place.json(&replay);
    let (report, _) = place.json(&[&replay[..], &["--set", "policy.model=guide"]].concat());
    assert_eq!(as_recorded["policy"]["engine"], "geometric");
    assert_ne!(report["policy"]["engine"], "geometric");
    let evaluate = ["evaluate", "--episodes", "2", "--policy", "geometric", "--json", "--set", "depth.width=32"];
    let (report, _) = place.json(&[&evaluate[..], &["--set", "depth.height=16"]].concat());
    assert_eq!(report["policy"], "geometric", "{report:#}");
    let mut run = Live::up(&place, "demo", &["--scenario", "corridor", "--set", "policy.model=geometric"]);
    run.wait_walking();
    let (told, _) = place.json(&["policy", "show", "--json"]);
    assert_eq!(told["active"]["runs"]["engine"], "geometric", "{told:#}");
    let _ = run.end();
}

#[test]
fn what_does_not_go_together_names_the_line_of_the_operators_file() {
    let place = Place::new();
    let file = place.path().join("robot.toml");
    fs::write(&file, "[odometry]\nrate_hz = 50.0\n\n[depth]\nsource = \"absent\"\nneeded = true\n").expect("written");
    let config = file.to_string_lossy().into_owned();
    let told = refused(&place, &["config", "show", "--config", &config]);
    assert!(told.contains(&format!("{config}: line 6: depth.needed")), "{told}");
    for verb in ["walk", "up", "evaluate"] {
        let told = refused(&place, &[verb, "--set", "odometry.scale_sigma=inf"]);
        assert!(told.contains("--set odometry.scale_sigma=inf: odometry.scale_sigma = inf"), "{told}");
        let told = refused(&place, &[verb, "--set", "lidar.beems=3"]);
        assert!(told.contains("--set lidar.beems=3: unknown field `beems`"), "{told}");
    }
}
