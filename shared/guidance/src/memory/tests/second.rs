//! What the second lidar alone sees is remembered: edges, and what stands in its plane where it looks down.

use super::{MS, handler, memory, scan};
use crate::depth::DepthView;
use crate::depth::ramp_tests::seen as seen_ground;
use crate::depth::tests::{camera_160, held};
use crate::memory::Memory;
use crate::se2::{Point, Se2};
use crate::second::SecondView;
use messages::{Pose2, ScanHeader, SecondScanHeader};

/// Where its plane meets the floor, metres ahead of the robot.
const LINE_M: f64 = 1.16;

/// A lidar 0.4 m above the floor that looks ahead and 25 degrees down.
fn header() -> SecondScanHeader {
    let scan = ScanHeader {
        angle_min_rad: -0.5,
        angle_increment_rad: 0.01,
        range_min_m: 0.1,
        range_max_m: 8.0,
        sigma_m: 0.01,
        robot_from_lidar: Pose2::new(0.3, 0.0, 0.0),
        height_m: 0.4,
        ..ScanHeader::default()
    };
    SecondScanHeader { scan, pitch_rad: 25.0_f64.to_radians(), ..SecondScanHeader::default() }
}

/// It sees level floor, but over the beams about its axis, which end at such a share of the way to the floor.
fn looks(view: &mut SecondView, share: f32) {
    let header = header();
    let to_floor_m = |angle_rad: f64| 0.4 / (angle_rad.cos() * header.pitch_rad.sin());
    let range_m = |i: usize| to_floor_m(header.scan.angle_min_rad + 0.01 * i as f64) as f32;
    let shared = |i: usize| range_m(i) * if (40..61).contains(&i) { share } else { 1.0 };
    view.fill(&header, &(0..101).map(shared).collect::<Vec<_>>(), None).expect("usable");
}

/// The memory of a standing robot whose second lidar gave this number of such scans.
fn saw(share: f32, scans: u64) -> Memory {
    let (mut memory, mut view) = (memory(), SecondView::default());
    for number in 1..=scans {
        memory.update(100 * number * MS, &Se2::identity(), &scan(&[]), None, &handler());
        looks(&mut view, share);
        memory.update_second(100 * number * MS, &Se2::identity(), &view, &handler());
    }
    memory
}

#[test]
fn a_low_thing_is_remembered_when_the_plane_has_passed_over_it() {
    let mut memory = saw(0.7, 8);
    let at_m = |memory: &Memory| memory.hidden().iter().map(|thing| thing.place.x).fold(f64::NAN, f64::min);
    assert!((at_m(&memory) - (0.3 + 0.7 * (LINE_M - 0.3))).abs() < 0.06, "{}", at_m(&memory));
    let mut view = SecondView::default();
    looks(&mut view, 1.0);
    let closer = Se2::translation(0.4, 0.0);
    memory.update(1_000 * MS, &closer, &scan(&[]), None, &handler());
    memory.update_second(1_000 * MS, &closer, &view, &handler());
    assert!((at_m(&memory) - 0.5).abs() < 0.06, "{}", at_m(&memory));
    // After more than a minute nothing is said of it any more, where the robot stands.
    memory.update_second(70_000 * MS, &closer, &view, &handler());
    assert!(memory.hidden().is_empty());
    assert!(saw(0.7, 1).hidden().is_empty(), "one scan may be noise");
}

#[test]
fn the_handler_is_no_thing() {
    let mut view = SecondView::default();
    looks(&mut view, 0.7);
    let at = view.points()[10];
    let body = crate::handler::HandlerBody { center: at, ..handler() };
    let mut memory = memory();
    for number in 1..=8 {
        memory.update_second(100 * number * MS, &Se2::identity(), &view, &body);
    }
    let near = |place: &Point| (place - at).norm() < 0.1;
    assert!(!memory.hidden().iter().any(|thing| near(&thing.place)), "{:?}", memory.hidden());
}

#[test]
fn an_edge_that_the_second_lidar_alone_sees_stays_though_the_camera_sees_floor() {
    let (mut memory, mut view, mut camera) = (memory(), SecondView::default(), DepthView::default());
    let level = seen_ground(&camera_160(), &|_, _| 0.0);
    for number in 1..=8 {
        camera.fill_tilted(&camera_160(), &level, Some(&held(2.0, 3.0))).expect("usable");
        memory.update(100 * number * MS, &Se2::identity(), &scan(&[]), Some(&camera), &handler());
        looks(&mut view, 1.5);
        memory.update_second(100 * number * MS, &Se2::identity(), &view, &handler());
    }
    assert!(memory.edges().iter().any(|edge| (edge.place.x - LINE_M).abs() < 0.06), "{:?}", memory.edges());
    // It lets go once it sees floor there, as often as it saw none.
    for number in 9..=30 {
        looks(&mut view, 1.0);
        memory.update_second(100 * number * MS, &Se2::identity(), &view, &handler());
    }
    assert!(memory.edges().is_empty(), "{:?}", memory.edges());
}
