//! How a robot answers a command, from the recording of a run of single motions to a configuration that loads.

use std::fs;

use guidedog_tests::Place;

/// Three rounds of the course.
const ROUNDS: &str = "135s";

/// A recorded walk with small depth frames; the recording's path.
fn recorded(place: &Place, args: &[&str]) -> String {
    let config = place.path().join("small.toml");
    // The course leads aside and back, where the camera has seen no floor.
    fs::write(&config, "[depth]\nwidth = 64\nheight = 48\n[shield.floor]\nwatched = false\n").expect("written");
    let recording = place.path().join(format!("{}.mcap", args[1])).to_string_lossy().into_owned();
    let rest = ["--config", &config.to_string_lossy(), "--speed", "0", "--record", &recording, "--json"];
    let (report, _) = place.json(&[&["walk"], args, &rest].concat());
    for who in ["robot", "handler"] {
        assert_eq!(report["collisions"][who], 0, "{report:#}");
    }
    recording
}

#[test]
fn the_response_of_a_simulated_robot_is_identified_and_loads_and_is_never_measured() {
    let place = Place::new();
    let recording = recorded(&place, &["--scenario", "steps", "--policy", "steps", "--time-limit", ROUNDS]);
    let output = place.path().join("response.toml").to_string_lossy().into_owned();
    let fit = ["fit-robot", &recording, "--output", &output, "--json"];
    let (report, code) = place.json(&fit);
    assert_eq!((code, &report["origin"]), (0, &"simulated".into()), "{report:#}");
    let number = |path: &str| report.pointer(path).and_then(serde_json::Value::as_f64).expect(path);
    for motion in ["forward", "sidestep_left", "sidestep_right", "turn_right", "diagonal_left", "diagonal_right"] {
        assert_eq!(number(&format!("/motions/{motion}")), 3.0, "{report:#}");
    }
    for axis in ["forward", "sideways", "turn"] {
        // The simulated robot does at once what it is told, and its odometry is a little wrong.
        assert!(number(&format!("/axes/{axis}/answer_s/value")) <= 0.03, "{axis}: {report:#}");
        assert!((number(&format!("/axes/{axis}/gain/value")) - 1.0).abs() < 0.05, "{axis}: {report:#}");
    }
    assert!(number("/overrun/forward/along_m/max") < 0.02, "{report:#}");
    assert!(number("/way_off_m/max") < 0.05 && number("/turn_off_rad/max") < 0.10, "{report:#}");

    let text = fs::read_to_string(&output).expect("it was written");
    assert!(text.contains("[robot.response]\norigin = \"simulated\"\nlag = \""), "{text}");
    let (walk, code) = place.json(&["walk", "--config", &output, "--time-limit", "5s", "--speed", "0", "--json"]);
    assert!(code == 1 && walk["distance_m"].as_f64().is_some_and(|way_m| way_m > 0.5), "{walk:#}");

    let (again, code) = place.json(&fit);
    assert!(code == 2 && again["error"].as_str().is_some_and(|why| why.contains("response.toml")), "{again}");
    assert_eq!(fs::read_to_string(&output).expect("it is there"), text, "it is kept as it was");

    let table = place.guidedog(&["fit-robot", &recording]);
    let told = String::from_utf8_lossy(&table.stdout).into_owned();
    for what in ["forward: delay, ms", "overrun, turn_left: heading, deg", "error of way, cm", "origin = \"simulated\""]
    {
        assert!(told.contains(what), "{what}: {told}");
    }
    place.assert_empty();
}

#[test]
fn a_recording_that_tells_too_little_is_refused_with_what_is_missing() {
    let place = Place::new();
    let walk = recorded(&place, &["--scenario", "corridor", "--time-limit", "10s"]);
    let other = place.path().join("other.mcap").to_string_lossy().into_owned();
    fs::write(&other, "no recording").expect("written");
    for (recording, told) in [
        (walk.as_str(), "no turn to the left of at least 1 s followed by a zero of at least 1.5 s"),
        (&other, "is not a recording"),
        ("nowhere.mcap", "nowhere.mcap"),
    ] {
        let (report, code) = place.json(&["fit-robot", recording, "--json"]);
        let error = report["error"].as_str().unwrap_or_default();
        assert!(code == 2 && error.contains(told), "{recording}: {report}");
    }
    let replayed = place.path().join("replayed.mcap").to_string_lossy().into_owned();
    let _ = place.json(&["replay", &walk, "--speed", "0", "--record", &replayed, "--json"]);
    let (report, code) = place.json(&["fit-robot", &replayed, "--json"]);
    assert!(code == 2 && report["error"].as_str().is_some_and(|why| why.contains("in a replay")), "{report}");
}

#[test]
fn steps_guide_no_one() {
    let place = Place::new();
    let (report, code) = place.json(&["evaluate", "--policy", "steps", "--episodes", "1", "--json"]);
    assert!(code == 2 && report["error"].as_str().is_some_and(|why| why.contains("guides no one")), "{report}");
}
