//! The second lidar takes actions away, and the robot stands without its scans.

use super::{MS, action, depth_header, header, mode, odometry, open_scan, ready_with, scan_header, wall_mm};
use crate::core::Core;
use messages::{ModeClass, Outcome, Permit, Pose2, SecondScanHeader};
use settings::{LidarSettings, Settings};

/// A core with a second lidar.
fn two_lidars() -> Core {
    let mut settings = Settings::default();
    settings.lidar.second = Some(Box::new(LidarSettings::default()));
    ready_with(&settings)
}

/// A scan that looks ahead over 90 degrees, in which everything is so far away, metres.
fn second_scan(stamp_ms: u64, range_m: f32) -> (SecondScanHeader, Vec<f32>) {
    let mut scan = scan_header(stamp_ms);
    (scan.angle_min_rad, scan.angle_increment_rad) = (-0.785, 0.0175);
    (scan.robot_from_lidar, scan.height_m) = (Pose2::new(0.2, 0.0, 0.0), 0.12);
    // Where it has moved it sees something else.
    let ranges_m = (0..90).map(|i| range_m + 0.001 * (i as f32 * stamp_ms as f32).sin()).collect();
    (SecondScanHeader { header: header(stamp_ms, stamp_ms), scan, pitch_rad: 0.0 }, ranges_m)
}

/// The permit for a step ahead where the second lidar's scan is so old, milliseconds, and shows that.
fn decides(core: &mut Core, decision: u64, old_ms: u64, range_m: f32) -> Permit {
    let ms = 500 * decision;
    core.take_mode(&mode(ModeClass::Run, ms - 10));
    core.take_odometry(&odometry(ms - 10, 0.0));
    core.take_depth(&depth_header(ms - 10), &wall_mm(5000));
    let (header, ranges_m) = second_scan(ms - old_ms, range_m);
    core.take_second(&header, &ranges_m);
    core.on_scan(ms * MS, &scan_header(ms - 10), &open_scan());
    core.on_action(ms * MS, &action(decision, 1)).expect("the active policy's")
}

#[test]
fn without_the_second_lidars_scans_nothing_is_granted() {
    let mut core = two_lidars();
    let none = core.on_action(1000 * MS, &action(2, 1)).expect("the active policy's");
    assert_eq!(none.outcome, Outcome::StaleSecondScan);
    assert_eq!(decides(&mut core, 3, 20, 3.0).outcome, Outcome::Granted);
    assert_eq!(decides(&mut core, 4, 300, 3.0).outcome, Outcome::StaleSecondScan);
    let permit = decides(&mut core, 5, 110, 3.0);
    assert_eq!(
        (permit.outcome, permit.expiry_ns),
        (Outcome::Granted, (2500 - 110 + 250) * MS),
        "its stamp and max age"
    );
    assert_eq!(decides(&mut core, 6, 20, f32::NAN).outcome, Outcome::StaleSecondScan, "all its beams are unknown");
}

#[test]
fn what_the_second_lidar_alone_sees_forbids() {
    let mut core = two_lidars();
    assert_eq!(decides(&mut core, 3, 20, 3.0).outcome, Outcome::Granted);
    let permit = decides(&mut core, 4, 20, 0.25);
    assert_eq!((permit.outcome, permit.unsafe_mask >> 1 & 1), (Outcome::Stop, 1), "it goes ahead");
    // It does not remember.
    assert_eq!(decides(&mut core, 5, 20, 3.0).outcome, Outcome::Granted);
}
