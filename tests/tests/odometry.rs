//! Odometry corrected by scans, in walks of the whole process stack.

use std::path::Path;

use guidance::se2::{Se2, se2};
use guidedog_tests::{Place, data};
use recording::{Reader, Record};
use serde_json::Value;

/// Odometry that has a wrong scale and a heading that wanders by 8 degrees after 10 m. Small frames make a walk quick.
fn settings(is_matched: bool) -> String {
    let drift = "[odometry]\nscale_sigma = 0.05\nyaw_walk_rad_per_sqrt_m = 0.04\n";
    format!("{drift}[odometry.matching]\non = {is_matched}\n[depth]\nwidth = 160\nheight = 120\n")
}

/// A walk round a curve in stepped time: its report, and how far its odometry was off the truth in the end and at most,
/// metres.
fn walk(place: &Place, name: &str, seed: &str, is_matched: bool) -> (Value, f64, f64) {
    let (config, recording) = (place.path().join("odometry.toml"), place.path().join(name));
    std::fs::write(&config, settings(is_matched)).expect("written");
    let (config, file) = (config.to_string_lossy().into_owned(), recording.to_string_lossy().into_owned());
    let args = ["walk", "--scenario", "curve", "--speed", "0", "--seed", seed, "--config", &config, "--json"];
    let (report, code) = place.json(&[&args[..], &["--record", &file]].concat());
    assert_eq!(code, 0, "seed {seed}, matching {is_matched}: {report:#}");
    let (last_m, most_m) = errors(&recording);
    (report, last_m, most_m)
}

fn errors(recording: &Path) -> (f64, f64) {
    let (mut truths, mut poses) = (Vec::new(), Vec::new());
    for record in Reader::open(recording).expect("a recording") {
        match record.expect("whole") {
            Record::WorldTruth(truth) => truths.push((truth.header.stamp_ns, se2(truth.world_from_robot))),
            Record::Odometry(pose) => poses.push((pose.header.stamp_ns, se2(pose.odom_from_robot))),
            _ => {}
        }
    }
    truths.sort_by_key(|(stamp_ns, _)| *stamp_ns);
    let truth_at = |at_ns: u64| {
        let found = truths.binary_search_by_key(&at_ns, |(stamp_ns, _)| *stamp_ns).expect("a pose is of a moment");
        truths[found].1
    };
    let (first_ns, odom_from_first) = *poses.first().expect("there were poses");
    let world_from_odom = truth_at(first_ns) * odom_from_first.inverse();
    let off_m = |&(stamp_ns, pose): &(u64, Se2)| {
        (truth_at(stamp_ns).inverse() * world_from_odom * pose).translation.vector.norm()
    };
    let all: Vec<f64> = poses.iter().map(off_m).collect();
    (all[all.len() - 1], all.iter().copied().fold(0.0, f64::max))
}

#[test]
fn odometry_that_drifts_ends_nearer_to_the_truth_where_scans_correct_it() {
    for seed in ["2", "3"] {
        let place = Place::new();
        let (raw, raw_last_m, raw_most_m) = walk(&place, "raw.mcap", seed, false);
        let (ours, last_m, most_m) = walk(&place, "ours.mcap", seed, true);
        eprintln!("seed {seed}: in the end {raw_last_m:.2} m off, {last_m:.2} m where scans correct it");
        eprintln!("seed {seed}: at most {raw_most_m:.2} m off, {most_m:.2} m where scans correct it");
        assert!(raw["distance_m"].as_f64() > Some(25.0), "{raw:#}");
        assert!(raw_last_m > 0.5 && last_m < 0.5 * raw_last_m && most_m < raw_most_m, "seed {seed}");
        // No correction was taken for a jump, or for a robot that does not obey.
        let stops = |report: &Value| report["stops"].as_array().map(Vec::len);
        assert!(stops(&ours) <= stops(&raw), "{:#}", ours["stops"]);
        assert_eq!((&ours["collisions"]["robot"], &ours["collisions"]["handler"]), (&0.into(), &0.into()));
        place.assert_empty();
    }
}

#[test]
fn a_walk_with_scans_matched_is_the_same_every_time_and_replays_to_the_byte() {
    let place = Place::new();
    let (first, ..) = walk(&place, "walk.mcap", "1", true);
    let (again, ..) = walk(&place, "again.mcap", "1", true);
    for key in ["digest", "decisions", "verdicts", "published", "taken", "distance_m"] {
        assert_eq!(first[key], again[key], "{key}");
    }
    let file = place.path().join("walk.mcap").to_string_lossy().into_owned();
    let (replayed, code) = place.json(&["replay", &file, "--speed", "0", "--against", "--json"]);
    assert_eq!(code, 0, "{replayed:#}");
    place.assert_empty();
}

#[test]
fn matching_what_is_not_there_is_refused_with_its_key() {
    let place = Place::new();
    for text in [
        "[odometry]\nsource = \"replayed\"\n[odometry.matching]\non = true\n",
        "[odometry.matching]\non = true\nfeed_mps = 0.5\n",
        "[odometry.matching]\non = true\nfeed_mph = 0.05\n",
    ] {
        let config = place.path().join("odometry.toml");
        std::fs::write(&config, text).expect("written");
        let output = place.guidedog(&["walk", "--config", &config.to_string_lossy()]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        let key = if text.contains("mph") { "feed_mph" } else { "odometry.matching." };
        assert!(output.status.code() == Some(2) && told.contains(key), "{text}: {told}");
    }
    place.assert_empty();
}

#[test]
fn aces_is_less_than_half_as_far_off_as_by_its_wheels() {
    let (Some(log), Some(relations)) = (data("lidar/radish_aces.clf.bz2"), data("lidar/radish_aces.relations")) else {
        return;
    };
    let (log, relations) = (log.to_string_lossy().into_owned(), relations.to_string_lossy().into_owned());
    let (report, code) = Place::new().json(&["bench", "odometry", &log, "--relations", &relations, "--json"]);
    assert_eq!(code, 0, "{report:#}");
    let (told, all) = (&report["logs"][0], &report["logs"][0]["relations"]["all"]);
    assert_eq!((&all["n"], &told["relations"]["unmatched"]), (&1279.into(), &0.into()), "each is of two scans");
    let mean = |whose: &str, what: &str| all[whose][what]["mean"].as_f64().expect("a mean");
    for what in ["translation_m", "rotation_deg"] {
        let (raw, ours) = (mean("raw", what), mean("ours", what));
        eprintln!("{what}: {raw:.3} raw, {ours:.3} ours");
        assert!(ours < 0.5 * raw, "{all:#}");
    }
    let count = |what: &str| told[what].as_u64().expect("a count");
    assert!(count("refused") * 100 < count("accepted"), "{told:#}");
}
