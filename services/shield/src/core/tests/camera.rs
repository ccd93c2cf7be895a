//! What the camera sees, and a camera that does not see the floor.

use super::{Core, MS, PIXELS, action, depth_header, mode, odometry, open_scan, ready, scan_header, wall_mm};
use messages::{DepthHeader, Mode, ModeClass, Outcome, Pose3, StopKind, StopReason};

#[test]
fn what_depth_alone_sees_forbids_too() {
    let mut core = ready();
    // Half a metre ahead at camera height, over the whole image: within the hull of forward.
    core.take_depth(&depth_header(995), &[500; PIXELS]);
    let permit = core.on_action(1000 * MS, &action(2, 1)).expect("a verdict");
    assert_ne!(permit.outcome, Outcome::Granted);
}

#[test]
fn a_covered_camera_is_not_free() {
    let mut core = ready();
    core.take_depth(&depth_header(995), &[0; PIXELS]);
    assert_eq!(core.on_action(1000 * MS, &action(2, 1)).map(|p| p.outcome), Some(Outcome::StaleDepth));
}

#[test]
fn a_camera_that_sees_nothing_right_before_a_wall_is_not_covered() {
    let mut core = ready();
    let mut before_a_wall = open_scan();
    for (i, range_m) in before_a_wall.iter_mut().enumerate() {
        let ahead = (i as f64 - 180.0).to_radians().cos();
        *range_m = if ahead > 0.3 { (0.45 / ahead) as f32 } else { *range_m };
    }
    let mount = Pose3 { x_m: 0.25, z_m: 0.45, ..Pose3::default() };
    core.take_depth(&DepthHeader { robot_from_camera: mount, ..depth_header(995) }, &[0; PIXELS]);
    core.on_scan(1000 * MS, &scan_header(995), &before_a_wall);
    let permit = core.on_action(1000 * MS, &action(2, 2)).expect("a verdict");
    assert_eq!(permit.outcome, Outcome::Granted, "it may turn away: {permit:?}");
    assert_eq!(permit.unsafe_mask >> 1 & 1, 1, "and not go on");
}

/// A frame of a wall so far ahead, in which the floor says nothing.
fn wall_without_floor_mm(mm: u16) -> Vec<u16> {
    wall_mm(mm).into_iter().map(|pixel| if pixel < mm { 0 } else { pixel }).collect()
}

/// What comes of three seconds with such frames, ten a second, from then on.
fn outcomes(core: &mut Core, from_ms: u64, epoch: u64, pixels: fn(u16) -> Vec<u16>) -> Vec<Outcome> {
    let tick = |i: u64| {
        let ms = from_ms + 100 * i;
        core.take_mode(&Mode { epoch, ..mode(ModeClass::Run, ms - 10) });
        core.take_odometry(&odometry(ms - 10, 0.0));
        core.take_depth(&depth_header(ms - 10), &pixels(5000 + i as u16));
        core.on_scan(ms * MS, &scan_header(ms - 10), &open_scan());
        let decision = action(ms / 500, 1);
        core.on_action(ms * MS, &decision);
        core.on_scan((ms + 1) * MS, &scan_header(ms - 9), &open_scan()).outcome
    };
    (0..30).map(tick).collect()
}

#[test]
fn a_camera_that_shows_no_floor_holds_the_robot_until_another_cue_and_longer_where_it_still_shows_none() {
    let mut core = ready();
    let blind = outcomes(&mut core, 1100, 3, wall_without_floor_mm);
    let first = blind.iter().position(|outcome| *outcome == Outcome::NoFloor);
    assert!(first.is_some_and(|first| (15..=22).contains(&first)), "{blind:?}");
    assert!(blind[first.unwrap_or(0)..].iter().all(|outcome| *outcome == Outcome::NoFloor), "{blind:?}");
    // The supervisor makes a fault of it, and a cue that comes later runs in the epoch of the fault.
    let reason = StopReason::of(StopKind::NoFloor);
    core.take_mode(&Mode { epoch: 4, reason, ..mode(ModeClass::Fault, 4000) });
    let again = outcomes(&mut core, 9100, 4, wall_without_floor_mm);
    assert!(again[..10].iter().all(|outcome| *outcome != Outcome::NoFloor), "a new cue may try again: {again:?}");
    assert_eq!(again.last(), Some(&Outcome::NoFloor));
    core.take_mode(&Mode { epoch: 5, reason, ..mode(ModeClass::Fault, 12_000) });
    assert!(outcomes(&mut core, 13_100, 5, wall_mm).iter().all(|outcome| *outcome != Outcome::NoFloor));
}
