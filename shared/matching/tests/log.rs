//! A real robot's log against relations that people checked by hand.

use std::path::{Path, PathBuf};

use guidance::se2::{Se2, se2};
use guidedog_matching::{Corrected, CorrectedConfig, LegNoise, MatcherConfig};
use messages::Pose2;
use recording::{Record, carmen};

/// A file of the real inputs; `None`, with a message, where they are missing and need not be there.
fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("GUIDEDOG_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = folder.join(name);
    if path.is_file() {
        return Some(path);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing", path.display());
    eprintln!("skipped: {} is missing", path.display());
    None
}

/// Of each scan: when it was sent, and where the robot was by odometry and by ours.
fn places(log: &Path) -> Vec<(f64, [Se2; 2])> {
    let legs = LegNoise { place_m_per_sqrt_m: 0.15, yaw_rad_per_sqrt_m: 0.1, yaw_rad_per_sqrt_rad: 0.4 };
    let matcher = MatcherConfig { legs, left_out: Vec::new() };
    let mut corrected = Corrected::new(CorrectedConfig { matcher, feed_mps: 0.05, feed_radps: 0.1 });
    let (mut places, mut newest) = (Vec::new(), None);
    let take = |record, sent_s: Option<f64>| match record {
        Record::Scan { header, ranges_m } => {
            corrected.take_scan(&header, &ranges_m);
            newest = sent_s.map(|sent_s| (header.header.stamp_ns, sent_s));
        }
        Record::Odometry(raw) => {
            corrected.take_odometry(&raw);
            // Refusals are counted.
            let _ = corrected.work();
            if let Some((_, sent_s)) = newest.take_if(|(stamp_ns, _)| *stamp_ns == raw.header.stamp_ns) {
                places.push((sent_s, [se2(raw.odom_from_robot), *corrected.matched()]));
            }
        }
        _ => {}
    };
    carmen::read(log, take).expect("a log");
    let health = corrected.health();
    assert!(health.refused * 100 < health.accepted, "{health:?}");
    places
}

#[test]
fn aces_is_less_than_half_as_far_off_as_by_its_wheels() {
    let (Some(log), Some(relations)) = (data("lidar/radish_aces.clf.bz2"), data("lidar/radish_aces.relations")) else {
        return;
    };
    let places = places(&log);
    let at = |time_s: f64| {
        let after = places.partition_point(|(sent_s, _)| *sent_s < time_s - 1e-3);
        places.get(after).filter(|(sent_s, _)| *sent_s < time_s + 1e-3).map(|(_, poses)| poses)
    };
    let mut errors: [Vec<(f64, f64)>; 2] = Default::default();
    for line in std::fs::read_to_string(relations).expect("relations").lines() {
        let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().expect("a number")).collect();
        let (Some(first), Some(second)) = (at(numbers[0]), at(numbers[1])) else { continue };
        let checked = se2(Pose2::new(numbers[2], numbers[3], numbers[7]));
        for (which, errors) in errors.iter_mut().enumerate() {
            let off = checked.inverse() * first[which].inverse() * second[which];
            errors.push((off.translation.vector.norm(), off.rotation.angle().abs().to_degrees()));
        }
    }
    let mean = |errors: &[(f64, f64)]| {
        let n = errors.len() as f64;
        (errors.iter().map(|(way, _)| way).sum::<f64>() / n, errors.iter().map(|(_, turn)| turn).sum::<f64>() / n)
    };
    let [raw, ours] = errors.each_ref().map(|errors| mean(errors));
    eprintln!("{} relations: {raw:?} raw, {ours:?} ours", errors[0].len());
    assert_eq!(errors[0].len(), 1279, "each relation is of two scans");
    assert!(ours.0 < 0.5 * raw.0 && ours.1 < 0.5 * raw.1, "{raw:?} raw, {ours:?} ours");
}
