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
