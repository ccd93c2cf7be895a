//! Walks with a handler who lets the handle go.

use guidedog_tests::{Place, has_legs, project, touches};
use serde_json::{Value, json};

/// A walk along the corridor whose handler lets go at 6 s for 5 s; the report.
fn lets_go(more: &[&str]) -> Value {
    let place = Place::new();
    let lines = "goal = { at = [10, 0], within_m = 0.5 }\ntime_limit_s = 120\nstart = { at = [0, 0], yaw_deg = 0 }\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0\n[[handler]]\ndoes = \"let_go\"\nat_s = 6.0\nfor_s = 5.0\n";
    let world = project().join("config/worlds/corridor.toml");
    let scenario = place.scenario(&world.to_string_lossy(), lines);
    let (report, _) = place.json(&[&["walk", "--scenario", &scenario, "--speed", "0", "--json"], more].concat());
    place.assert_empty();
    report
}

/// The robot waits for a handler who lets go, and goes on once they hold the handle again.
fn assert_waited(report: &Value) {
    assert_eq!((&report["reached"], touches(report)), (&json!(true), [0, 0]), "{report:#}");
    let stops = report["stops"].as_array().expect("stops");
    let waits: Vec<_> = stops.iter().filter(|stop| stop["reason"] == "handler_not_seen").collect();
    assert!(!waits.is_empty() && waits.iter().all(|stop| stop["ended"] == json!(true)), "{report:#}");
    // They stand for five seconds, of which the first shows that nobody is there, and have been back for one.
    let waited_s = report["stopped_s_by_reason"]["handler_not_seen"].as_f64().expect("a time");
    assert!((3.0..15.0).contains(&waited_s), "{waited_s}");
}

#[test]
fn the_robot_waits_for_a_handler_who_lets_go_and_goes_on_when_they_are_back() {
    assert_waited(&lets_go(&[]));
}

#[test]
fn a_robot_on_legs_waits_for_a_handler_who_lets_go() {
    if has_legs() {
        assert_waited(&lets_go(&["--physics", "mujoco"]));
    }
}
