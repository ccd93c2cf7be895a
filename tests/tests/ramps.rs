//! Ramps of 1:12, in MuJoCo: up, a plateau, and down.

use std::fs;

use guidedog_tests::{Place, has_legs};
use serde_json::Value;

/// A corridor of 2.4 m. The ramps are 3 m long and rise by 0.25 m.
fn world(place: &Place) -> String {
    let path = place.path().join("ramps.toml");
    let text = "[[wall]]\npoints = [[-3, -1.2], [16, -1.2], [16, 1.2], [-3, 1.2], [-3, -1.2]]\n\
        [[ramp]]\nat = [2.5, 0]\nsize = [3, 2.4]\nrise_m = 0.25\n\
        [[ramp]]\nat = [5.5, 0]\nsize = [2, 2.4]\nfrom_m = 0.25\nrise_m = 0\n\
        [[ramp]]\nat = [10.5, 0]\nyaw_deg = 180\nsize = [3, 2.4]\nrise_m = 0.25\n";
    fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

fn scenario(place: &Place, goal_m: f64, limit_s: u32) -> String {
    let lines = format!(
        "start = {{ at = [0, 0], yaw_deg = 0 }}\ngoal = {{ at = [{goal_m}, 0], within_m = 0.5 }}\n\
         time_limit_s = {limit_s}\n[[cue]]\nkind = \"forward\"\nat_s = 1.0"
    );
    place.scenario(&world(place), &lines)
}

fn assert_walked(goal_m: f64, velocity_loop: &str, seed: &str) {
    let place = Place::new();
    let config = place.path().join("loop.toml");
    fs::write(&config, format!("[simulation.mujoco]\nvelocity_loop = {velocity_loop:?}\n")).expect("written");
    let (scenario, config) = (scenario(&place, goal_m, 90), config.to_string_lossy().into_owned());
    let args = ["walk", "--physics", "mujoco", "--scenario", &scenario, "--config", &config, "--seed", seed];
    let (report, _) = place.json(&[&args[..], &["--speed", "0", "--json"]].concat());
    let what = format!("{velocity_loop}, seed {seed}: {report:#}");
    assert_eq!(report["reached"], true, "{what}");
    for who in ["robot", "handler"] {
        assert_eq!(report["collisions"][who], 0, "{what}");
    }
    let is_fault = |stop: &&Value| stop["class"] == "fault" && stop["reason"] != "boot";
    assert_eq!(report["stops"].as_array().expect("stops").iter().find(is_fault), None, "{what}");
    place.assert_empty();
}

#[test]
fn the_flat_world_has_no_ramps() {
    let place = Place::new();
    let scenario = scenario(&place, 4.0, 10);
    let output = place.command(&["walk", "--scenario", &scenario]).output().expect("it runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && told.contains("ramps need --physics mujoco"), "{told}");
    place.assert_empty();
}

#[test]
fn a_go2_walks_up_a_ramp_over_a_plateau_and_down() {
    if has_legs() {
        assert_walked(13.0, "soft", "4");
    }
}

#[test]
#[ignore = "two minutes: scripts/nightly physics"]
fn a_go2_walks_up_and_down_ramps_with_either_loop() {
    if !has_legs() {
        return;
    }
    for velocity_loop in ["soft", "stiff"] {
        for seed in ["1", "2", "3", "4", "5"] {
            assert_walked(13.0, velocity_loop, seed);
        }
    }
}
