//! Walks with a handler who lets the handle go.

use guidedog_tests::{Place, has_legs, programs, project, touches};
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

/// A walk through a doorway of 0.9 m by a robot that speaks, with these lines in its configuration and these arguments;
/// the report.
fn through_the_narrow_door(lines: &str, more: &[&str]) -> Value {
    let place = Place::new();
    let config = place.path().join("speak.toml");
    std::fs::write(&config, format!("[speak]\non = true\nfile = \"said.wav\"\n{lines}")).expect("written");
    let scenario = project().join("config/scenarios/narrow-door.toml");
    let (scenario, config) = (scenario.to_string_lossy(), config.to_string_lossy());
    let args = ["walk", "--scenario", &scenario, "--speed", "0", "--config", &config, "--json"];
    let (report, _) = place.json(&[&args[..], more].concat());
    place.assert_empty();
    report
}

/// The robot asks the handler to come behind it, and beside it again after the door.
fn assert_passes_the_narrow_door(report: &Value) {
    assert_eq!((&report["reached"], &report["collisions"]["robot"]), (&json!(true), &json!(0)), "{report:#}");
    assert_eq!(stops(report, &["narrow", "wide"]), ["narrow", "wide"], "{report:#}");
    // The robot waits for its voice, and the handler takes three seconds.
    for reason in ["narrow", "wide"] {
        let asked_s = report["stopped_s_by_reason"][reason].as_f64().expect("a time");
        assert!((4.5..10.0).contains(&asked_s), "{reason}: {asked_s}");
    }
}

/// The stops of a walk for one of these reasons, in order.
fn stops(report: &Value, reasons: &[&str]) -> Vec<String> {
    let all = report["stops"].as_array().expect("stops").iter();
    let named = all.filter_map(|stop| stop["reason"].as_str()).filter(|reason| reasons.contains(reason));
    named.map(str::to_owned).collect()
}

#[test]
fn a_policy_swapped_in_while_the_robot_asks_for_single_file_asks_anew() {
    let swap = format!("verb = \"policy_swap\", exe = {:?}", programs().join("guidedog-policy"));
    // The robot asks from 18 s on, and the handler is behind at 23 s.
    let report = through_the_narrow_door(
        &format!("[policy.swap]\ndecisions = 2\nprobation = \"1s\"\n[[planned]]\nat = \"19.5s\"\nask = {{ {swap} }}\n"),
        &[],
    );
    assert_eq!((&report["reached"], touches(&report)), (&json!(true), [0, 0]), "{report:#}");
    assert_eq!(report["policy_swaps"][0]["state"], "done", "{report:#}");
    let asked = stops(&report, &["narrow", "wide"]);
    assert!(asked.len() > 2 && asked.last().is_some_and(|last| last == "wide"), "{asked:?}, {report:#}");
}

#[test]
fn a_shield_that_is_killed_while_the_handler_is_behind_goes_on_in_single_file() {
    // The handler is behind from 23 to 30 s.
    let report = through_the_narrow_door(
        "[faults]\nallowed = true\n[[planned]]\nat = \"27s\"\n\
         ask = { verb = \"inject\", target = \"shield\", fault = \"kill\" }\n",
        &[],
    );
    assert_eq!((&report["reached"], touches(&report)), (&json!(true), [0, 0]), "{report:#}");
    let found = stops(&report, &["narrow", "service_died", "wide"]);
    assert_eq!(found, ["narrow", "service_died", "wide"], "the handler is not asked again: {report:#}");
}

#[test]
fn the_handler_comes_behind_through_a_narrow_door_and_beside_again_after_it() {
    let report = through_the_narrow_door("", &[]);
    assert_eq!(touches(&report), [0, 0], "{report:#}");
    assert_passes_the_narrow_door(&report);
}

/// A handler right behind the robot walks on when it stops, and does not reach it. Beside it, they may touch the
/// corridor's wall after a stop.
#[test]
fn a_robot_on_legs_passes_a_narrow_door_untouched_by_the_handler_behind_it() {
    if has_legs() {
        assert_passes_the_narrow_door(&through_the_narrow_door("", &["--physics", "mujoco"]));
    }
}

#[test]
fn a_robot_that_does_not_speak_says_why_it_stands_before_a_narrow_passage() {
    let place = Place::new();
    let walls = "[[wall]]\npoints = [[-3, 0.9], [14, 0.9], [14, -0.9], [-3, -0.9], [-3, 0.9]]\n";
    let jamb = |y_m: f64| format!("[[box]]\nat = [5, {y_m}]\nsize = [2.0, 0.45]\nz = [0, 2.6]\n");
    let world = place.path().join("passage.toml");
    std::fs::write(&world, format!("{walls}{}{}", jamb(0.675), jamb(-0.675))).expect("written");
    let lines = "goal = { at = [11, 0], within_m = 0.5 }\ntime_limit_s = 60\nstart = { at = [0, 0.15], yaw_deg = 0 }\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0\n";
    let scenario = place.scenario(&world.to_string_lossy(), lines);
    let (report, _) = place.json(&["walk", "--scenario", &scenario, "--speed", "0", "--json"]);
    assert_eq!((&report["reached"], touches(&report)), (&json!(false), [0, 0]), "{report:#}");
    let narrow_s = report["stopped_s_by_reason"]["narrow"].as_f64().expect("a time");
    assert!(narrow_s > 20.0, "{report:#}");
    place.assert_empty();
}
