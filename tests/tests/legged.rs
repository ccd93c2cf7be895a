//! Guided walks of a legged robot: in MuJoCo, a physics simulation that this project did not write, and by the simple
//! model of its gait in the project's own world.

use std::fs;

use guidedog_tests::{Place, has_legs};
use serde_json::Value;

use crate::walks::walk;

/// Faults of a walk but the boot.
fn faults(report: &Value) -> Vec<&Value> {
    let stops = report["stops"].as_array().expect("stops");
    stops.iter().filter(|stop| stop["class"] == "fault" && stop["reason"] != "boot").collect()
}

#[test]
fn a_go2_guides_a_handler_down_a_corridor_and_two_walks_are_one() {
    if has_legs() {
        let report = two_walks_are_one("corridor", &["--physics", "mujoco"]);
        assert_eq!(
            (&report["legs"]["model"]["known"], &report["legs"]["policy"]["known"]),
            (&true.into(), &true.into())
        );
    }
}

/// The robot lags, overruns, sways and tilts, and knows its attitude to half a degree.
#[test]
fn a_robot_that_sways_in_the_flat_world_guides_a_handler_round_a_corner() {
    two_walks_are_one("l-turn", &["--noise", "legged"]);
}

fn two_walks_are_one(scenario: &str, options: &[&str]) -> Value {
    let report = walk(scenario, options);
    assert_eq!(report["reached"], true, "{report:#}");
    for who in ["robot", "handler", "hit_by_others"] {
        assert_eq!(report["collisions"][who], 0, "{who}");
    }
    assert_eq!(report["missed_decisions"], 0);
    assert_eq!(faults(&report), Vec::<&Value>::new());
    let again = walk(scenario, options);
    for key in ["digest", "decisions", "verdicts", "stops", "distance_m", "duration_s"] {
        assert_eq!(report[key], again[key], "{key}");
    }
    assert_eq!(report["digest"].as_str().map(str::len), Some(64));
    report
}

/// A configuration of real sensors and that link, which `--emulated` leads to emulated devices.
fn linked(place: &Place, link: &str) -> String {
    let path = place.path().join("linked.toml");
    let sources = "lidar.source = \"device\"\ndepth.source = \"device\"\nodometry.source = \"device\"\n";
    fs::write(&path, format!("{sources}locomotion.link = {link:?}\n")).expect("written");
    path.to_string_lossy().into_owned()
}

/// What a walk touched: robot and handler.
fn touches(report: &Value) -> [u64; 2] {
    ["robot", "handler"].map(|who| report["collisions"][who].as_u64().unwrap_or(u64::MAX))
}

/// Beams of an RPLIDAR over its turns, frames with their own time, attitudes by the robot's own state: what the swaying
/// body's drivers make of them.
#[test]
fn a_go2_is_guided_by_real_drivers_and_a_real_link() {
    if !has_legs() {
        return;
    }
    let place = Place::new();
    let lines = "start = { at = [0, 0], yaw_deg = 0 }\ngoal = { at = [4, 0], within_m = 0.5 }\ntime_limit_s = 60\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0";
    let scenario = place.scenario("corridor.toml", lines);
    let (report, code) = place.json(&["walk", "--physics", "mujoco", "--emulated", "--scenario", &scenario, "--json"]);
    assert_eq!((code, &report["reached"]), (0, &true.into()), "{report:#}");
    assert_eq!((touches(&report), faults(&report)), ([0, 0], Vec::new()), "{report:#}");
    for text in ["answers", "samples a second", "a program is connected"] {
        assert!(report["notes"].to_string().contains(text), "{text}: {report:#}");
    }
    place.assert_empty();
}

/// Nothing in a run's time begins with the physics' own.
#[test]
fn a_go2_walks_in_real_time_as_well() {
    if !has_legs() {
        return;
    }
    let place = Place::new();
    let (report, _) = place.json(&["walk", "--physics", "mujoco", "--time-limit", "20s", "--json"]);
    assert!(report["distance_m"].as_f64().is_some_and(|way_m| way_m > 1.0), "{report:#}");
    place.assert_empty();
}

#[test]
fn legs_that_cannot_be_used_are_told_before_anything_is_started() {
    if !has_legs() {
        return;
    }
    let place = Place::new();
    let file = |text: &str| {
        let path = place.path().join("legs.toml");
        fs::write(&path, text).expect("written");
        path.to_string_lossy().into_owned()
    };
    let no_policy = place.path().join("no.onnx");
    fs::write(&no_policy, "this is no policy").expect("written");
    for (text, told) in [
        ("policy = \"none.onnx\"", "simulation.mujoco.policy"),
        ("model = \"none.xml\"", "simulation.mujoco.model"),
        ("policy_sha256 = \"0123\"", "policy.onnx has the digest d6c8be"),
        ("friction = 9.0", "simulation.mujoco.friction"),
        ("velocity_loop = \"hard\"", "unknown variant `hard`"),
    ] {
        let config = file(&format!("[simulation.mujoco]\n{text}\n"));
        let output = place.guidedog(&["walk", "--physics", "mujoco", "--config", &config]);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}: {error}");
        assert!(error.contains(told), "{text}: {error}");
    }
    let sources = "lidar.source = \"device\"\nodometry.source = \"device\"\nlocomotion.link = \"unitree\"\n";
    let emulated = "simulation.emulated.on = true\ndepth = { source = \"device\", device = \"realsense\" }\n";
    let config = file(&format!("{sources}{emulated}"));
    let output = place.guidedog(&["walk", "--physics", "mujoco", "--config", &config]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && error.contains("\"realsense\" is not emulated"), "{error}");
    let config = file("[simulation.mujoco]\npolicy = \"no.onnx\"\n");
    let output = place.guidedog(&["walk", "--physics", "mujoco", "--config", &config, "--speed", "0"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && error.contains("no.onnx"), "{error}");
    place.assert_empty();
}

/// All scenarios and routes, both velocity loops, three seeds: half an hour. `scripts/nightly physics` runs it.
#[test]
#[ignore = "half an hour: scripts/nightly physics"]
fn a_go2_guides_a_handler_through_every_scenario() {
    if !has_legs() {
        return;
    }
    let scenarios =
        ["corridor", "curve", "l-turn", "left-at-tee", "crossing", "cluttered", "route-a", "route-b", "route-c"];
    let (place, mut wrong) = (Place::new(), Vec::new());
    for velocity_loop in ["soft", "stiff"] {
        let config = place.path().join("legs.toml");
        fs::write(&config, format!("[simulation.mujoco]\nvelocity_loop = {velocity_loop:?}\n")).expect("written");
        let config = config.to_string_lossy().into_owned();
        for scenario in scenarios {
            let (flat, _) = place.json(&["walk", "--scenario", scenario, "--speed", "0", "--json"]);
            for seed in ["1", "2", "3"] {
                let common = ["walk", "--physics", "mujoco", "--scenario", scenario, "--speed", "0", "--json"];
                let more = ["--seed", seed, "--config", &config];
                let (report, _) = place.json(&[&common[..], &more[..]].concat());
                let touches = touches(&report);
                let times = [&report, &flat].map(|report| report["duration_s"].as_f64().unwrap_or(f64::NAN));
                let line = format!(
                    "{scenario} {velocity_loop} {seed}: reached {}, touches {touches:?}, {:.1} s ({:.1}), {} faults",
                    report["reached"],
                    times[0],
                    times[1],
                    faults(&report).len()
                );
                eprintln!("{line}");
                let good = report["reached"] == true && touches == [0, 0] && faults(&report).is_empty();
                if !good || times[0] > 1.25 * times[1] {
                    wrong.push(line);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Three scenarios behind the real drivers, over each link that can be emulated, in real time: a quarter of an hour. A
/// walk that fails is tried again with other seeds, twice at most: a machine that is busy with other things is late.
#[test]
#[ignore = "a quarter of an hour: scripts/nightly physics"]
fn a_go2_is_guided_over_every_link() {
    if !has_legs() {
        return;
    }
    let (place, mut wrong) = (Place::new(), Vec::new());
    for scenario in ["corridor", "l-turn", "curve"] {
        let (flat, _) = place.json(&["walk", "--scenario", scenario, "--speed", "0", "--json"]);
        let limit_s = 1.25 * flat["duration_s"].as_f64().expect("a duration");
        for link in ["unitree", "go2", "ros2"] {
            let config = linked(&place, link);
            let is_good = (1..=3).any(|seed: u32| {
                let (seed, limit) = (seed.to_string(), format!("{limit_s:.0}s"));
                let common = ["walk", "--physics", "mujoco", "--emulated", "--scenario", scenario, "--json"];
                let more = ["--config", &config, "--seed", &seed, "--time-limit", &limit];
                let (report, _) = place.json(&[&common[..], &more[..]].concat());
                let duration_s = report["duration_s"].as_f64().unwrap_or(f64::NAN);
                eprintln!(
                    "{scenario} {link} {seed}: reached {}, touches {:?}, {duration_s:.1} s ({limit_s:.1}), {} faults",
                    report["reached"],
                    touches(&report),
                    faults(&report).len()
                );
                report["reached"] == true && touches(&report) == [0, 0] && faults(&report).is_empty()
            });
            if !is_good {
                wrong.push(format!("{scenario} {link}"));
            }
        }
    }
    place.assert_empty();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
