//! Deaths, faults, stops and swaps that are planned for a step: stepped time finds every run alike, to the byte.

use std::fs;

use guidedog_tests::{Place, programs};
use serde_json::Value;

/// Small frames, so that a walk is quick.
const COMMON: &str = "[depth]\nwidth = 160\nheight = 120\n[faults]\nallowed = true\n[policy.swap]\ndecisions = 2\n\
                      probation = \"1s\"\n[supervision]\nstep_limit = \"2s\"\n";

fn planned(place: &Place, plan: &[(&str, &str)]) -> String {
    let table = |(at, ask): &(&str, &str)| format!("[[planned]]\nat = \"{at}\"\nask = {{ {ask} }}\n");
    let path = place.path().join("plan.toml");
    fs::write(&path, format!("{COMMON}{}", plan.iter().map(table).collect::<String>())).expect("written");
    path.to_string_lossy().into_owned()
}

fn walk(place: &Place, config: &str, (speed, limit): (&str, &str), more: &[&str]) -> Value {
    let args =
        ["walk", "--scenario", "corridor", "--speed", speed, "--time-limit", limit, "--config", config, "--json"];
    place.json(&[&args[..], more].concat()).0
}

/// The stops that need a cue to go on, boot apart: what they were for.
fn stops(report: &Value) -> Vec<&str> {
    let stops = report["stops"].as_array().expect("stops").iter().filter(|stop| stop["class"] != "hold");
    stops.map(|stop| stop["why"].as_str().unwrap_or_default()).collect()
}

#[test]
fn a_plan_of_deaths_stops_and_swaps_is_the_same_walk_every_time() {
    let place = Place::new();
    let swap = format!("verb = \"policy_swap\", exe = {:?}", programs().join("guidedog-policy"));
    let config = planned(
        &place,
        &[
            ("5s", r#"verb = "inject", target = "lidar", fault = "kill""#),
            ("10.01s", r#"verb = "inject", target = "shield", fault = "kill""#),
            ("15s", r#"verb = "inject", target = "policy", fault = "hang""#),
            ("20s", r#"verb = "inject", target = "service/odometry", fault = "exit_on_start""#),
            // The shield's next life waits for odometry's, which is on its way.
            ("20.02s", r#"verb = "inject", target = "shield", fault = "kill""#),
            ("25s", r#"verb = "inject", target = "lidar/scan", fault = "intermittent", for = "1s", seed = 7"#),
            ("30s", r#"verb = "stop""#),
            ("31s", r#"verb = "resume""#),
            ("36s", &swap),
            ("42s", r#"verb = "inject", target = "depth", fault = "kill""#),
        ],
    );
    // Every death and its restart hang on wall time, which differs between these runs.
    let runs = [("0", "46s"), ("10", "46s"), ("0", "46s")].map(|pace| walk(&place, &config, pace, &[]));
    for report in &runs {
        let told = stops(report).join("; ");
        for what in ["lidar", "shield", "policy", "odometry", "operator_stop", "depth"] {
            assert!(told.contains(what), "{what}: {told}");
        }
        assert_eq!(report["policy_swaps"][0]["state"], "done", "{:#}", report["policy_swaps"]);
        assert!(report["distance_m"].as_f64().is_some_and(|m| m > 8.0), "{report:#}");
        assert_eq!(report["digest"], runs[0]["digest"], "{:#}\n{:#}", report["notes"], runs[0]["notes"]);
        assert_eq!(report["stops"], runs[0]["stops"]);
    }
    place.assert_empty();
}

#[test]
fn what_was_planned_happens_again_in_a_replay() {
    let place = Place::new();
    let config = planned(
        &place,
        &[
            ("3s", r#"verb = "inject", target = "shield", fault = "kill""#),
            ("7s", r#"verb = "stop""#),
            ("8s", r#"verb = "resume""#),
            ("11s", r#"verb = "inject", target = "policy", fault = "kill""#),
        ],
    );
    let recording = place.path().join("walk.mcap").to_string_lossy().into_owned();
    let walked = walk(&place, &config, ("0", "16s"), &["--record", &recording]);
    let (replayed, code) = place.json(&["replay", &recording, "--speed", "0", "--json"]);
    assert_eq!(
        (code, &replayed["digest"]),
        (0, &walked["digest"]),
        "{:#}\n{:#}",
        replayed["compared"],
        replayed["notes"]
    );
    place.assert_empty();
}

#[test]
fn a_plan_that_cannot_be_is_refused_before_anything_starts() {
    let place = Place::new();
    for (plan, what) in [
        (r#"verb = "inject", target = "lidar", fault = "rust""#, "there is no fault rust"),
        (r#"verb = "inject", target = "walls", fault = "kill""#, "no line walls"),
        (r#"verb = "policy_swap""#, "neither an executable nor a model"),
        (r#"verb = "status""#, "status"),
    ] {
        let config = planned(&place, &[("1s", plan)]);
        let (refused, code) = place.json(&["walk", "--speed", "0", "--config", &config, "--json"]);
        let told = refused["error"].as_str().unwrap_or_default();
        assert!(code == 2 && told.contains(what), "{plan}: {refused:#}");
    }
    let config = planned(&place, &[("1s", r#"verb = "inject", target = "lidar", fault = "kill""#)]);
    let text = fs::read_to_string(&config).expect("readable").replace("allowed = true", "allowed = false");
    fs::write(&config, text).expect("written");
    let (refused, code) = place.json(&["walk", "--speed", "0", "--config", &config, "--json"]);
    assert!(code == 2 && refused["error"].to_string().contains("faults.allowed"), "{refused:#}");
    let unknown = fs::read_to_string(&config).expect("readable").replace("lidar", "walls");
    fs::write(&config, unknown).expect("written");
    let (refused, _) = place.json(&["walk", "--speed", "0", "--config", &config, "--json"]);
    assert!(refused["error"].to_string().contains("line 11: planned[0]"), "{refused:#}");
    place.assert_empty();
}
