//! Robot and handler stay within the hulls of a walk's permits.

use std::fs;
use std::path::Path;

use episodes::{Excess, Walked};
use guidedog_tests::{Place, has_legs};
use recording::{Reader, Record};

/// Holds a recording's permits against where robot and handler went.
fn judge(path: &Path) -> Excess {
    let mut reader = Reader::open(path).expect("a recording");
    let recorded = reader.settings().expect("readable").expect("the recording of a run");
    let settings = settings::load_over("the recording", &recorded, None).expect("settings");
    let mut walked = Walked::new(&settings).expect("a handler's model");
    for record in reader {
        match record.expect("a whole recording") {
            Record::Odometry(odometry) => walked.take_odometry(&odometry),
            Record::LidarScan(scan) => walked.take_scan(&scan.header, &scan.data),
            Record::ShieldPermit(permit) => walked.take_permit(&permit).expect("judged on what came before"),
            Record::WorldTruth(truth) => walked.take_truth(&truth),
            _ => {}
        }
    }
    walked.finish()
}

/// Records a walk and judges it.
fn walked(place: &Place, name: &str, options: &[&str]) -> (Excess, bool) {
    let recording = place.path().join(format!("{name}.mcap"));
    let to = recording.to_string_lossy().into_owned();
    let (report, _) = place.json(&[&["walk", "--speed", "0", "--json", "--record", &to], options].concat());
    let excess = judge(&recording);
    eprintln!("{name}: reached {}, {excess}", report["reached"]);
    assert!(excess.decisions > 100, "{name}: {report:#}");
    (excess, report["reached"] == true)
}

#[test]
fn robot_and_handler_stay_within_the_permits_hulls() {
    let place = Place::new();
    let (excess, has_reached) = walked(&place, "legged", &["--scenario", "l-turn", "--noise", "legged"]);
    assert_eq!((excess.beyond(), has_reached), (0, true), "{excess}");
    place.assert_empty();
}

/// A Go2 in MuJoCo, whose handler pushes it on. Now and then a decision's hull does not hold them whole:
/// docs/evaluation.md has the figures, and what falls short of none.
#[test]
#[ignore = "ten minutes: scripts/nightly physics"]
fn robot_and_handler_in_mujoco_stay_within_the_permits_hulls() {
    for velocity_loop in ["soft", "stiff"].into_iter().filter(|_| has_legs()) {
        let (place, mut all) = (Place::new(), Excess::default());
        let config = place.path().join("legs.toml");
        fs::write(&config, format!("[simulation.mujoco]\nvelocity_loop = {velocity_loop:?}\n")).expect("written");
        let config = config.to_string_lossy().into_owned();
        for scenario in ["corridor", "curve", "l-turn", "left-at-tee", "crossing", "cluttered"] {
            for seed in ["1", "2", "3"] {
                let options = ["--physics", "mujoco", "--scenario", scenario, "--seed", seed, "--config", &config];
                all.add(walked(&place, &format!("{scenario}-{seed}-{velocity_loop}"), &options).0);
            }
        }
        eprintln!("{velocity_loop}: {all}");
        assert!(100 * all.beyond() <= all.decisions, "{velocity_loop}: {all}");
        let p99_m = [&all.robot_beyond_m, &all.handler_beyond_m].map(|figures| Excess::quantile_m(figures, 0.99));
        assert!(p99_m[0].max(p99_m[1]) < 0.0, "{velocity_loop}: {all}");
    }
}
