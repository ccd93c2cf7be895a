//! Real laser logs through the very same policy, shield and locomotion.

use guidedog_tests::{Place, data};
use serde_json::Value;

fn sum(values: &Value) -> u64 {
    values.as_object().map_or(0, |map| map.values().filter_map(Value::as_u64).sum())
}

fn import(place: &Place, log: &str) -> Option<String> {
    let log = data(log)?.to_string_lossy().into_owned();
    let recording = place.path().join("log.mcap").to_string_lossy().into_owned();
    let (report, code) = place.json(&["import", "carmen", &log, "-o", &recording, "--json"]);
    assert_eq!(code, 0, "{report:#}");
    Some(recording)
}

#[test]
fn a_whole_log_replays_the_same_twice_and_every_scan_is_answered() {
    let place = Place::new();
    let Some(recording) = import(&place, "lidar/radish_mit-csail.clf.bz2") else { return };
    let replay = || {
        let (report, code) = place.json(&["replay", &recording, "--speed", "0", "--json"]);
        assert_eq!(code, 0, "{report:#}");
        report
    };
    let (first, second) = (replay(), replay());
    assert_eq!(first["scans"], 1988);
    assert_eq!(first["verdicts"].as_u64().map(|v| v + sum(&first["refusals"])), Some(1988), "{first:#}");
    assert_eq!(sum(&first["lost"]), 0);
    let duration_s = first["duration_s"].as_f64().expect("a duration");
    assert!(first["decisions"].as_f64().is_some_and(|n| n >= 0.9 * duration_s / 0.5), "{first:#}");
    for key in ["digest", "verdicts", "refusals", "stops", "published", "taken"] {
        assert_eq!(first[key], second[key], "{key}");
    }
    assert!(first["input_anomalies"].is_object());
    place.assert_empty();
}

#[test]
fn a_gap_in_a_log_stops_the_robot_and_the_cue_is_given_again() {
    let place = Place::new();
    let Some(recording) = import(&place, "lidar/radish_aces.clf.bz2") else { return };
    let (report, code) = place.json(&["replay", &recording, "--speed", "0", "--duration", "560s", "--json"]);
    assert_eq!(code, 0, "{report:#}");
    // 3.03 s without a scan, 541 s in.
    let stale = report["stops"]
        .as_array()
        .and_then(|stops| stops.iter().find(|stop| stop["reason"] == "stream_stale" && stop["stream"] == "lidar/scan"));
    let stale = stale.unwrap_or_else(|| panic!("the gap was not seen: {report:#}"));
    assert_eq!(stale["class"], "fault");
    assert_eq!(stale["ended"], true, "the cue was given again");
    assert!(stale["lasted_s"].as_f64().is_some_and(|s| s > 2.0));
}

#[test]
fn real_time_loses_no_scan() {
    let place = Place::new();
    let Some(recording) = import(&place, "lidar/radish_fr079.clf.bz2") else { return };
    let (report, code) = place.json(&["replay", &recording, "--duration", "10s", "--json"]);
    assert_eq!(code, 0, "{report:#}");
    assert_eq!(report["lost"]["lidar/scan"], 0);
    assert_eq!(report["verdicts"].as_u64().map(|v| v + sum(&report["refusals"])), report["scans"].as_u64());
    assert!(report["latency_us"]["scan_to_permit"]["p99"].is_number(), "{report:#}");
}

#[test]
fn a_recorded_robot_that_hit_nothing_is_seldom_flagged() {
    let place = Place::new();
    let Some(recording) = import(&place, "lidar/radish_fr079.clf.bz2") else { return };
    // The paper's algorithm knows no margin.
    let config = place.path().join("paper.toml");
    std::fs::write(&config, "[shield]\nmargin_m = 0.0\n").expect("written");
    let config = config.to_string_lossy();
    let (report, code) = place.json(&["shield", "--recording", &recording, "--config", &config, "--json"]);
    assert_eq!((code, report["scans"].as_u64()), (0, Some(4934)), "{report:#}");
    let flagged = |radius_m: f64| {
        let moves = report["moves"].as_array().expect("a list");
        let row = moves.iter().find(|row| row["robot_radius_m"] == radius_m).expect("a row");
        row["share_flagged"].as_f64().expect("a share")
    };
    // The robot is some 0.2 m in radius; a larger disc is flagged more often, never less.
    assert!(flagged(0.2) < 0.02 && flagged(0.2) <= flagged(0.25) && flagged(0.25) <= flagged(0.3), "{report:#}");
    assert!(flagged(0.3) < 0.1, "{report:#}");
}

/// 42 % of what this RPLIDAR sent says nothing.
#[test]
fn a_lidar_that_often_sees_nothing_freezes_nobody_once_its_own_mount_is_left_out() {
    let place = Place::new();
    let Some(capture) = data("rplidar/living_room_90/frame_0001.bin") else { return };
    let (capture, recording) = (capture.to_string_lossy().into_owned(), place.path().join("room.mcap"));
    let recording = recording.to_string_lossy().into_owned();
    let no_motion = |field_of_view: &str| {
        let args =
            ["import", "rplidar", &capture, "-o", &recording, "--field-of-view", field_of_view, "--force", "--json"];
        let (report, code) = place.json(&args);
        assert_eq!(code, 0, "{report:#}");
        let (report, code) = place.json(&["shield", "--recording", &recording, "--json"]);
        assert_eq!((code, report["scans"].as_u64()), (0, Some(12)), "{report:#}");
        let with_all = report["team"].as_array().and_then(|rows| rows.last()).expect("a row").clone();
        assert_eq!(with_all["rules"], serde_json::json!({ "escape": true, "memory": true }));
        with_all["share_no_motion"].as_f64().expect("a share")
    };
    assert!(no_motion("200") < 0.1);
    assert_eq!(no_motion("360"), 1.0, "what the mount hides was never seen free");
}
