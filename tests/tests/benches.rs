//! Every bench measures something: a bench that no test runs breaks unseen. Speed is not checked here.
//! `bench faults`, `odometry`, `replay` and `idle` are run beside what they measure.

use guidedog_tests::Place;
use serde_json::Value;

/// The rows of the report of a bench that ended well.
fn rows(args: &[&str]) -> Vec<Value> {
    let place = Place::new();
    let (report, code) = place.json(&[&["bench"], args, &["--json"]].concat());
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
    report["rows"].as_array().unwrap_or_else(|| panic!("no rows: {report:#}")).clone()
}

/// Whether each row has this number, and it is above zero.
fn assert_each(rows: &[Value], numbers: &[&str]) {
    assert!(!rows.is_empty());
    for row in rows {
        for number in numbers {
            assert!(row.pointer(number).and_then(Value::as_f64).is_some_and(|n| n > 0.0), "{number}: {row:#}");
        }
    }
}

#[test]
fn transport_tells_how_long_messages_of_both_programs_took() {
    let rows = rows(&["transport", "--seconds", "4"]);
    assert_eq!(rows.len(), 8, "four sizes at two rates");
    assert_each(&rows, &["/n", "/ours_us/p50", "/plain_us/p50", "/ratio"]);
}

#[test]
fn shield_world_depth_and_decoders_measure_every_row() {
    let shield = rows(&["shield", "--times", "20"]);
    assert_eq!(shield.len(), 6, "two tables with three scans");
    assert_each(&shield, &["/ours_us/p50", "/pseudo_code_us/p50", "/ratio"]);
    let world = rows(&["world", "--times", "1"]);
    assert_eq!(world.len(), 7);
    assert_each(&world, &["/decisions_per_s/p50", "/decisions_per_s/n", "/per_decision/beams", "/per_decision/faces"]);
    // All but the first row judge.
    assert_each(&world[1..], &["/per_decision/motions", "/per_decision/places", "/per_decision/held"]);
    assert_eq!(world[0].pointer("/per_decision/motions"), Some(&Value::from(0.0)));
    let depth = rows(&["depth", "--times", "16"]);
    assert_eq!(depth.len(), 3, "three sizes");
    assert_each(&depth, &["/level_us/p50", "/swaying_us/p50", "/attitude_us/p50", "/attitude_us/n"]);
    assert_each(&rows(&["decoders", "--times", "1"]), &["/bytes_per_s/p50", "/samples_per_s"]);
}

#[test]
fn link_measures_a_quiet_and_a_busy_machine() {
    let rows = rows(&["link", "--seconds", "1"]);
    assert_eq!(rows.len(), 4, "each with and without real-time priority");
    assert_each(&rows, &["/n", "/max_us"]);
}

#[test]
fn swaps_and_kills_are_counted() {
    let place = Place::new();
    let (report, _) = place.json(&["bench", "swaps", "--count", "1", "--json"]);
    assert_eq!((&report["done"], report["failed"].as_array().map(Vec::len)), (&1.into(), Some(0)), "{report:#}");
    assert_each(&[report], &["/decided_ms/n", "/decided_ms/p50"]);
    let (report, _) = place.json(&["bench", "soak", "--kills", "1", "--warm-up", "1", "--json"]);
    assert_eq!(report.pointer("/kills/orphans"), Some(&Value::from(0)), "{report:#}");
    assert_each(&[report], &["/kills/n", "/kills/before/shm_files", "/kills/after/shm_files"]);
    place.assert_empty();
}
