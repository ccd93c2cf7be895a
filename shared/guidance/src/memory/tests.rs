use super::{Memory, MemoryConfig, Remembered};
use crate::depth::DepthView;
use crate::handler::HandlerBody;
use crate::hull::{Disc, Hull};
use crate::scan::Beams;
use crate::scan::tests::header;
use crate::se2::{Point, Se2, exp, log, se2};
use crate::shield::{EdgeDistance, Evidence, Judgement, Motion, Reach, Shield, ShieldConfig};
use messages::{DepthHeader, Pose2, Pose3, UnsafeCause};
use proptest::prelude::*;

mod back;
mod edges;
mod floor;
mod handler;
mod hanging;
mod second;
mod steps;

const MS: u64 = 1_000_000;

fn memory() -> Memory {
    Memory::new(MemoryConfig {
        kept_ns: 10_000 * MS,
        kept_off_plane_ns: 60_000 * MS,
        free_ns: 500 * MS,
        drift: 0.03,
        footing: None,
    })
}

fn handler() -> HandlerBody {
    HandlerBody { center: Point::new(-0.75, -0.35), radius_m: 0.25, mask_radius_m: Some(0.28), seen: None }
}

fn pose_nearby() -> impl Strategy<Value = Pose2> {
    (-6.0..6.0f64, -6.0..6.0f64, -3.0..3.0f64).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
}

/// Round things in the open, as a lidar at the robot's origin sees them.
fn scan(things: &[(Point, f64)]) -> Beams {
    let header = header();
    let reading = |i: usize| {
        let angle = header.angle_min_rad + i as f64 * header.angle_increment_rad;
        let direction = nalgebra::Vector2::new(angle.cos(), angle.sin());
        let meets = things.iter().filter_map(|(center, radius_m)| {
            let along = center.coords.dot(&direction);
            let root = along * along - (center.coords.norm_squared() - radius_m * radius_m);
            (root >= 0.0 && along > 0.0).then(|| along - root.sqrt())
        });
        meets.fold(f64::INFINITY, f64::min)
    };
    let mut beams = Beams::default();
    beams.fill_with(&header, 360, reading).expect("usable");
    beams
}

fn judge(evidence: Evidence<'_>, start_from_end: Pose2) -> Judgement {
    judge_with(evidence, handler(), start_from_end)
}

fn config() -> ShieldConfig {
    ShieldConfig {
        robot_radius_m: 0.3,
        margin_m: 0.0,
        unknown_gap_m: 0.1,
        escape: true,
        unseen_limit_m2: None,
        back_from_edges_m: None,
        reach: Reach::default(),
        edges: EdgeDistance::default(),
    }
}

fn judge_with(evidence: Evidence<'_>, body: HandlerBody, start_from_end: Pose2) -> Judgement {
    let robot = se2(start_from_end);
    let after = robot * Se2::translation(-0.75, -0.35);
    let mut judgements = Vec::new();
    let motion = Motion::new(robot, after);
    Shield::new(config()).judge_motions([motion].into_iter(), evidence, body, &mut judgements);
    judgements[0]
}

const POST_M: f64 = 0.04;
const HANDLER: (Point, f64) = (Point::new(-0.75, -0.35), 0.22);

#[test]
fn a_beam_that_passes_clears_and_a_new_frame_forgets() {
    let mut memory = memory();
    let post = Point::new(1.0, 0.3);
    memory.update(0, &Se2::identity(), &scan(&[(post, POST_M)]), None, &handler());
    // Something nearer hides it, then goes, and the post is gone too.
    memory.update(100 * MS, &Se2::identity(), &scan(&[(Point::new(0.6, 0.18), 0.1)]), None, &handler());
    assert!(!memory.hidden().is_empty());
    let mut forgetful = memory.clone();
    memory.update(200 * MS, &Se2::identity(), &scan(&[]), None, &handler());
    memory.update(300 * MS, &Se2::identity(), &scan(&[(Point::new(0.6, 0.18), 0.1)]), None, &handler());
    assert!(memory.hidden().is_empty());
    forgetful.clear();
    forgetful.move_to(0, &Se2::identity());
    assert!(forgetful.hidden().is_empty() && !forgetful.saw_free(Point::new(0.5, -0.5)));
}

/// A camera at the robot's nose that sees something low straight ahead, or the bare floor.
fn camera(low_at_m: Option<f64>) -> DepthView {
    view(low_at_m, 20..44)
}

/// The same over the whole width of the image.
fn camera_across(low_at_m: Option<f64>) -> DepthView {
    view(low_at_m, 0..64)
}

fn view(low_at_m: Option<f64>, columns: std::ops::Range<usize>) -> DepthView {
    let mut view = DepthView::default();
    fill(&mut view, low_at_m, columns);
    view
}

/// Sees something low straight ahead in several frames, from where the robot stands at the beginning.
fn see_often(memory: &mut Memory, frames: u64, beams: &Beams, low_at_m: f64) {
    let mut view = DepthView::default();
    for i in 0..frames {
        fill(&mut view, Some(low_at_m), 20..44);
        memory.update(i, &Se2::identity(), beams, Some(&view), &handler());
    }
}

fn frame_header() -> DepthHeader {
    DepthHeader {
        width: 64,
        height: 48,
        fx_px: 32.0,
        fy_px: 32.0,
        cx_px: 31.5,
        cy_px: 23.5,
        robot_from_camera: Pose3 { x_m: 0.25, z_m: 0.45, ..Pose3::default() },
        ..DepthHeader::default()
    }
}

/// One frame more.
fn fill(view: &mut DepthView, low_at_m: Option<f64>, columns: std::ops::Range<usize>) {
    let header = frame_header();
    let pixels: Vec<u16> = (0..64 * 48)
        .map(|i| {
            let below = ((i / 64) as f64 - 23.5) / 32.0;
            let floor_m = if below > 0.0 { (0.45 / below).min(9.0) } else { 9.0 };
            let ahead = columns.contains(&(i % 64));
            // What is 0.2 m high, seen from 0.45 m: only rays that fall by 0.25 m before it end on it.
            let box_m = low_at_m.filter(|at| ahead && at * below > 0.25);
            let depth_m = box_m.map_or(floor_m, |at| at.min(floor_m));
            if depth_m < 0.3 { 0 } else { (depth_m * 1000.0) as u16 }
        })
        .collect();
    view.fill(&header, &pixels).expect("usable");
}

#[test]
fn what_was_low_ahead_is_there_when_the_camera_looks_over_it_and_goes_when_it_sees_the_floor() {
    let mut memory = memory();
    // The lidar looks over it, at a wall behind.
    let open = scan(&[HANDLER, (Point::new(4.0, 0.0), 1.0)]);
    see_often(&mut memory, 2, &open, 0.6);
    // 0.4 m on, the camera is 0.2 m from it and sees nothing there.
    let odom_from_robot = Se2::translation(0.4, 0.0);
    let near = camera(Some(0.2));
    memory.update(1000 * MS, &odom_from_robot, &open, Some(&near), &handler());
    assert!(memory.hidden().iter().any(|spot| (spot.place.x - 0.45).abs() < 0.02), "{:?}", memory.hidden());
    let evidence = Evidence { depth: Some(&near), memory: Some(&memory), ..Evidence::scan(&open) };
    let forward = Pose2::new(0.25, 0.0, 0.0);
    assert_eq!(judge(evidence, forward).cause, UnsafeCause::Memory);
    assert!(judge(Evidence { memory: None, ..evidence }, forward).safe);
    // However long it stands there.
    memory.update(60_000 * MS, &odom_from_robot, &open, Some(&near), &handler());
    assert!(!memory.hidden().is_empty());
    // Back again, and it is gone.
    memory.update(61_000 * MS, &Se2::identity(), &open, Some(&camera(None)), &handler());
    memory.update(62_000 * MS, &odom_from_robot, &open, Some(&camera(None)), &handler());
    assert!(memory.hidden().is_empty(), "{:?}", memory.hidden());
}

#[test]
fn what_is_old_is_forgotten_once_the_robot_has_walked_on() {
    let mut memory = memory();
    let post = Point::new(-1.0, 0.5);
    let screen = (Point::new(-0.5, 0.25), 0.15);
    memory.update(0, &Se2::identity(), &scan(&[(post, POST_M)]), None, &handler());
    memory.update(50_000 * MS, &Se2::identity(), &scan(&[screen]), None, &handler());
    let spot = *memory.hidden().first().expect("kept while the robot stands");
    assert!(spot.uncertainty_m < 1e-12);
    // Half a turn and back: a place 1.1 m away is off by 0.03 x 2 x 0.5 x 1.1 m.
    memory.update(
        50_100 * MS,
        &Se2::rotation(0.5),
        &scan(&[(se2(Pose2::new(0.0, 0.0, -0.5)) * screen.0, 0.15)]),
        None,
        &handler(),
    );
    memory.update(50_200 * MS, &Se2::identity(), &scan(&[screen]), None, &handler());
    let spot = *memory.hidden().first().expect("kept");
    assert!((spot.uncertainty_m - 0.03 * spot.place.coords.norm()).abs() < 1e-9, "{spot:?}");
    // It stays hidden on the way, and after more than a metre it is let go.
    for (i, x) in [(1u64, 0.4), (2, 0.8), (3, 1.1)] {
        let back = Se2::translation(x, 0.0).inverse();
        memory.update(51_000 * MS + i, &back.inverse(), &scan(&[(back * screen.0, 0.2)]), None, &handler());
    }
    assert!(memory.hidden().iter().all(|spot| spot.place.x > -1.8), "{:?}", memory.hidden());
}

#[test]
fn what_the_camera_alone_saw_from_near_by_is_kept_longer() {
    let open = scan(&[HANDLER]);
    // Seen so far ahead, passed, and more than a metre walked since; then too near to something to see the floor.
    let kept = |seen_at_m: f64, after_ns: u64| {
        let mut memory = memory();
        see_often(&mut memory, 12, &open, seen_at_m - 0.25);
        for (i, x) in [(0, seen_at_m - 0.4), (1, seen_at_m + 0.8)] {
            memory.update(after_ns + i, &Se2::translation(x, 0.0), &open, Some(&camera(Some(0.2))), &handler());
        }
        memory.hidden().iter().any(|spot| (spot.place.x + 0.8).abs() < 0.1)
    };
    assert!(kept(1.5, 9_000 * MS) && kept(2.5, 9_000 * MS));
    assert!(kept(1.5, 59_000 * MS) && !kept(2.5, 11_000 * MS));
    assert!(!kept(1.5, 61_000 * MS));
}

/// A frame's noise is no obstacle for a minute, and the same frame judged twice is no more evidence.
#[test]
fn what_one_frame_saw_is_let_go_sooner_even_where_the_robot_stands() {
    let open = scan(&[HANDLER, (Point::new(4.0, 0.0), 1.0)]);
    // Seen in a number of frames from 0.85 or 1.45 m away; then too near for the camera.
    let kept = |frames: u64, low_at_m: f64, after_ns: u64| {
        let mut memory = memory();
        see_often(&mut memory, frames, &open, low_at_m);
        let near = Se2::translation(low_at_m - 0.2, 0.0);
        memory.update(after_ns, &near, &open, Some(&camera(Some(0.2))), &handler());
        !memory.hidden().is_empty()
    };
    assert!(kept(1, 0.6, 9_000 * MS) && !kept(1, 0.6, 11_000 * MS));
    assert!(kept(2, 0.6, 59_000 * MS));
    // From farther away a pixel tells less.
    assert!(!kept(4, 1.2, 11_000 * MS) && kept(5, 1.2, 59_000 * MS));
    let mut memory = memory();
    let same = camera(Some(0.6));
    for i in 0..10 {
        memory.update(i, &Se2::identity(), &open, Some(&same), &handler());
    }
    memory.update(11_000 * MS, &Se2::translation(0.4, 0.0), &open, Some(&camera(Some(0.2))), &handler());
    assert!(memory.hidden().is_empty(), "{:?}", memory.hidden());
}

#[test]
fn what_only_the_lidar_saw_is_let_go_after_a_minute_even_where_the_robot_stands() {
    let mut memory = memory();
    let screen = scan(&[(Point::new(-0.5, 0.25), 0.15)]);
    memory.update(0, &Se2::identity(), &scan(&[(Point::new(-1.0, 0.5), POST_M)]), None, &handler());
    memory.update(59_000 * MS, &Se2::identity(), &screen, None, &handler());
    assert!(!memory.hidden().is_empty());
    memory.update(61_000 * MS, &Se2::identity(), &screen, None, &handler());
    assert!(memory.hidden().is_empty(), "whoever it was may be gone: {:?}", memory.hidden());
}

/// The mask is wider than the handler by what the lidar is off.
#[test]
fn what_stands_close_to_the_handler_is_not_forgotten() {
    for (beside_m, remains) in [(0.27, true), (0.2, false)] {
        let mut memory = memory();
        let post = HANDLER.0 + nalgebra::Vector2::new(0.0, -beside_m);
        let elsewhere = HandlerBody { center: Point::new(-0.75, 0.5), ..handler() };
        memory.update(0, &Se2::identity(), &scan(&[(post, 0.01)]), None, &elsewhere);
        // The handler stands beside it, and hides it; then they go on, and it is hidden still.
        memory.update(100 * MS, &Se2::identity(), &scan(&[(HANDLER.0, 0.22)]), None, &handler());
        memory.update(200 * MS, &Se2::identity(), &scan(&[(post - post.coords * 0.4, 0.15)]), None, &elsewhere);
        assert_eq!(memory.hidden().iter().any(|spot| (spot.place - post).norm() < 0.03), remains, "{beside_m} m");
    }
}

#[test]
fn what_the_outermost_columns_saw_can_be_seen_gone() {
    let mut memory = memory();
    let everywhere = camera_across(Some(1.4));
    memory.update(0, &Se2::identity(), &scan(&[]), Some(&everywhere), &handler());
    memory.update(100 * MS, &Se2::identity(), &scan(&[]), Some(&camera_across(None)), &handler());
    assert!(everywhere.points().len() == 64 && memory.hidden().is_empty(), "{:?}", memory.hidden());
}

#[test]
fn free_is_counted_from_the_scans_stamp_to_now() {
    let mut memory = memory();
    memory.update(1000 * MS, &Se2::identity(), &scan(&[]), None, &handler());
    let ahead = Point::new(1.0, 0.01);
    memory.move_to(1500 * MS, &Se2::identity());
    assert!(memory.saw_free(ahead));
    memory.move_to(1501 * MS, &Se2::identity());
    assert!(!memory.saw_free(ahead), "no scan since: it is nobody's knowledge any more");
}

#[test]
fn what_was_seen_free_a_moment_ago_counts_for_unknown_beams() {
    let mut memory = memory();
    let open = scan(&[HANDLER]);
    memory.update(1000 * MS, &Se2::identity(), &open, None, &handler());
    let mut half_blind = Beams::default();
    let reading = |i: usize| if (165..195).contains(&i) { f64::NAN } else { open.beams()[i].reading_m };
    half_blind.fill_with(&header(), 360, reading).expect("usable");
    let forward = Pose2::new(0.25, 0.0, 0.0);
    assert_eq!(judge(Evidence::scan(&half_blind), forward).cause, UnsafeCause::Unknown);
    let mut judged_after = |ms: u64| {
        memory.update(ms * MS, &Se2::identity(), &half_blind, None, &handler());
        judge(Evidence { memory: Some(&memory), ..Evidence::scan(&half_blind) }, forward).safe
    };
    assert!(judged_after(1400), "seen 0.4 s ago");
    assert!(!judged_after(1600), "too long ago, and the scans since saw nothing there");
}

#[test]
fn the_uncertainty_grows_from_where_a_thing_was_last_seen() {
    let mut memory = memory();
    let screened = |at_m: f64, turn: f64| {
        // The post stands at (3, 1) in the odometry frame, and now something nearer hides it.
        let odom_from_robot = se2(Pose2::new(at_m, 0.0, turn));
        let post = odom_from_robot.inverse() * Point::new(3.0, 1.0);
        (odom_from_robot, post, scan(&[(post - post.coords.normalize() * 0.4, 0.15)]))
    };
    // Two metres and a radian there and back before it is seen at all.
    for (at_m, turn) in [(0.0, 0.0), (1.0, 0.5), (0.0, 0.0)] {
        memory.update(0, &se2(Pose2::new(at_m, 0.0, turn)), &scan(&[]), None, &handler());
    }
    let (odom_from_robot, post, _) = screened(0.5, 0.0);
    memory.update(100 * MS, &odom_from_robot, &scan(&[(post, POST_M)]), None, &handler());
    let (odom_from_robot, post, beams) = screened(0.9, 0.2);
    memory.update(200 * MS, &odom_from_robot, &beams, None, &handler());
    let hidden: Vec<_> = memory.hidden().iter().filter(|spot| (spot.place - post).norm() < 0.1).collect();
    assert!(!hidden.is_empty());
    for spot in hidden {
        let expected = 0.03 * (0.4 + 0.2 * spot.place.coords.norm());
        assert!((spot.uncertainty_m - expected).abs() < 1e-9, "{spot:?}, not {expected}");
    }
    // Long ago now, and 0.9 m since: it stays. 0.2 m more, and it goes.
    let (odom_from_robot, _, beams) = screened(1.4, 0.2);
    memory.update(20_000 * MS, &odom_from_robot, &beams, None, &handler());
    assert!(memory.hidden().iter().any(|spot| spot.uncertainty_m > 0.03));
    let (odom_from_robot, _, beams) = screened(1.6, 0.2);
    memory.update(20_100 * MS, &odom_from_robot, &beams, None, &handler());
    assert!(memory.hidden().iter().all(|spot| spot.uncertainty_m < 0.03), "{:?}", memory.hidden());
}

#[test]
fn what_lidar_and_camera_both_see_only_the_lidar_has_to_see_gone() {
    let mut memory = memory();
    let ahead = Point::new(1.0, 0.0);
    let (wall, camera_sees) = (scan(&[(ahead, 0.05)]), camera(Some(0.75)));
    assert!(camera_sees.points().iter().any(|point| (point - ahead).norm() < 0.1), "{:?}", camera_sees.points());
    memory.update(0, &Se2::identity(), &wall, Some(&camera_sees), &handler());
    // The lidar sees it gone, and the camera is covered by something near.
    memory.update(100 * MS, &Se2::identity(), &scan(&[]), None, &handler());
    assert!(memory.hidden().iter().all(|spot| (spot.place - ahead).norm() > 0.06), "{:?}", memory.hidden());
    // What the camera sees on the handler is the handler.
    let in_view = HandlerBody { center: ahead, ..handler() };
    let mut memory = super::Memory::new(memory.config.clone());
    memory.update(0, &Se2::identity(), &scan(&[]), Some(&camera_sees), &in_view);
    memory.update(100 * MS, &Se2::identity(), &scan(&[]), None, &handler());
    assert!(memory.hidden().iter().all(|spot| (spot.place - ahead).norm() > 0.25), "{:?}", memory.hidden());
}

/// The camera sees a place, in a frame of that number.
fn sees(memory: &mut Memory, odom_from_robot: &Se2, place: Point, frame: u64) {
    let by =
        super::Sighting { seen_ns: memory.stamp_ns, seen_at: memory.odometer, frame, odom_from_robot, handler: None };
    memory.spots.see(&by, place, 0.0, super::Source::Camera, &memory.config);
}

#[test]
fn a_thing_seen_again_is_averaged_and_one_of_another_kind_takes_its_place() {
    let mut memory = memory();
    let one = |range_m: f64| {
        let mut beams = Beams::default();
        beams.fill_with(&header(), 360, |i| if i == 180 { range_m } else { f64::INFINITY }).expect("usable");
        beams
    };
    memory.update(0, &Se2::identity(), &one(1.01), None, &handler());
    memory.update(100 * MS, &Se2::identity(), &one(1.04), None, &handler());
    assert_eq!(memory.spots.all().len(), 1);
    assert!((memory.spots.all()[0].odom.x - (1.01 + 0.4 * 0.03)).abs() < 1e-9, "{:?}", memory.spots);
    // Another cell: both are there until the scan after.
    memory.update(200 * MS, &Se2::identity(), &one(1.06), None, &handler());
    assert!((memory.spots.all()[0].odom.x - 1.06).abs() < 1e-9 && memory.spots.all().len() == 1, "{:?}", memory.spots);
    sees(&mut memory, &Se2::identity(), Point::new(1.07, 0.0), 1);
    assert_eq!(
        (memory.spots.all().len(), memory.spots.all()[0].odom.x),
        (1, 1.07),
        "nothing is averaged between sensors"
    );
    // The same slot eight metres on is another cell.
    sees(&mut memory, &Se2::translation(8.0, 0.0), Point::new(1.09, 0.0), 2);
    assert_eq!((memory.spots.all().len(), memory.spots.all()[0].odom.x), (1, 9.09));
}

#[test]
fn free_is_what_lies_before_the_reading_by_three_sigma_and_the_drift() {
    let mut memory = memory();
    let mut beams = Beams::default();
    beams.fill_with(&header(), 360, |_| 2.0).expect("usable");
    memory.update(0, &Se2::identity(), &beams, None, &handler());
    let ahead = |x: f64| Point::new(x, 1e-3);
    assert!(memory.saw_free(ahead(1.969)) && !memory.saw_free(ahead(1.971)));
    // 0.5 m back and forth: 0.03 m more.
    for x in [0.5, 0.0] {
        let nothing = scan(&[(Point::new(0.2, 0.0), 0.15)]);
        memory.update(10 * MS, &Se2::translation(x, 0.0), &nothing, None, &handler());
    }
    assert!(memory.saw_free(ahead(1.939)) && !memory.saw_free(ahead(1.941)));
}

proptest! {
    #![proptest_config(crate::testing::cases())]

    /// Memory takes nothing away but what was unknown: whatever was seen to be in the way stays in the way.
    #[test]
    fn memory_excuses_nothing_but_unknown_beams(
        readings in proptest::collection::vec(prop_oneof![3 => 0.3..3.0f64, 1 => Just(f64::NAN)], 90),
        before in proptest::collection::vec(prop_oneof![3 => 0.3..3.0f64, 1 => Just(f64::NAN)], 90),
        (x, y, yaw) in (-0.2..0.2f64, -0.2..0.2f64, -0.3..0.3f64),
        (dx, dy, turn) in (-0.3..0.3f64, -0.3..0.3f64, -0.3..0.3f64),
    ) {
        let header = messages::ScanHeader { angle_increment_rad: std::f64::consts::TAU / 90.0, ..header() };
        let (mut then, mut now) = (Beams::default(), Beams::default());
        prop_assume!(then.fill_with(&header, 90, |i| before[i]).is_ok());
        prop_assume!(now.fill_with(&header, 90, |i| readings[i]).is_ok());
        let mut memory = memory();
        let odom_from_robot = se2(Pose2::new(x, y, yaw));
        memory.update(0, &Se2::identity(), &then, None, &handler());
        memory.update(100 * MS, &odom_from_robot, &now, None, &handler());
        let motion = Pose2::new(dx, dy, turn);
        let alone = judge(Evidence::scan(&now), motion);
        let with = judge(Evidence { memory: Some(&memory), ..Evidence::scan(&now) }, motion);
        if with.safe {
            prop_assert!(alone.safe || alone.cause == UnsafeCause::Unknown, "{:?}", alone);
        } else if alone.safe {
            prop_assert_eq!(with.cause, UnsafeCause::Memory);
        }
    }

    /// A hidden spot forbids a motion exactly where it lies in the swept hull, give or take what is not known of its
    /// place; in the present hull only what comes nearer to it; and where the handler stands nothing that may be
    /// theirs.
    #[test]
    fn a_hidden_spot_is_judged_as_a_point_of_its_uncertainty(
        (x, y, uncertainty_m) in (-2.0..1.2f64, -1.5..1.5f64, 0.0..0.3f64),
        (dx, dy, turn) in (-0.3..0.3f64, -0.3..0.3f64, -0.5..0.5f64),
        (escape, is_apart) in any::<(bool, bool)>(),
    ) {
        let place = Point::new(x, y);
        let mut memory = memory();
        memory.hidden.push(Remembered { place, uncertainty_m, is_apart });
        let open = scan(&[HANDLER]);
        let motion = Pose2::new(dx, dy, turn);
        let robot = se2(motion);
        let disc = |center, radius_m| Disc { center, radius_m };
        let here = [disc(Point::origin(), 0.3), disc(handler().center, 0.25)];
        let there = [Point::from(robot.translation.vector), robot * Point::new(-0.75, -0.35)];
        let there = [disc(there[0], 0.3), disc(there[1], 0.25)];
        let swept_m = Hull::new([here[0], here[1], there[0], there[1]]).signed_distance_m(place) - uncertainty_m;
        let present_m = Hull::new([here[0], here[1], here[0], here[1]]).signed_distance_m(place) - uncertainty_m;
        prop_assume!(swept_m.abs() > 1e-9 && present_m.abs() > 1e-9);
        let mut shield = Shield::new(ShieldConfig { escape, ..config() });
        let mut judge = |memory: &Memory| {
            let (evidence, mut judgements) = (Evidence { memory: Some(memory), ..Evidence::scan(&open) }, Vec::new());
            let motion = Motion::new(robot, robot * Se2::translation(-0.75, -0.35));
            shield.judge_motions([motion].into_iter(), evidence, handler(), &mut judgements);
            judgements[0]
        };
        let judgement = judge(&memory);
        let in_the_way = swept_m < 0.0 && (is_apart || !handler().masks(place));
        if !in_the_way {
            prop_assert!(judgement.safe, "{:?}", judgement);
        } else if !escape || present_m > 0.0 {
            prop_assert_eq!((judgement.safe, judgement.cause), (false, UnsafeCause::Memory));
            prop_assert!(judgement.margin_m <= swept_m + 1e-12);
            memory.hidden.clear();
            prop_assert!((judgement.margin_m - judge(&memory).margin_m.min(swept_m)).abs() < 1e-12);
        } else {
            // In the present hull: the ends of the way tell for what is clear, the properties of the beams for the
            // rest.
            let nearer = |from: Point, to: Point| (place - to).norm() < (place - from).norm() - 1e-3;
            let forbidden = nearer(Point::origin(), there[0].center) || nearer(handler().center, there[1].center);
            prop_assert!(!forbidden || !judgement.safe, "{:?}", judgement);
            let from = handler().center;
            let comes = (0..=200).map(|i| {
                let share = f64::from(i) / 200.0;
                let robot = Point::from(exp(log(&robot, 1.0), share).translation.vector);
                let handler = from + (there[1].center - from) * share;
                (place.coords.norm() - (place - robot).norm()).max((place - from).norm() - (place - handler).norm())
            });
            let allowed = comes.fold(f64::MIN, f64::max) < 0.5e-4;
            prop_assert!(!allowed || judgement.safe, "{:?}", judgement);
        }
    }

    /// As many spots as there are cells with a hit, each where its cell says, whatever came before.
    #[test]
    fn every_hit_has_its_cell(
        scans in proptest::collection::vec((proptest::collection::vec(0.3..4.5f64, 60), pose_nearby()), 1..6),
    ) {
        let header = messages::ScanHeader { angle_increment_rad: std::f64::consts::TAU / 60.0, ..header() };
        let mut memory = memory();
        for (n, (readings, pose)) in scans.iter().enumerate() {
            let (mut beams, odom_from_robot) = (Beams::default(), se2(*pose));
            beams.fill_with(&header, 60, |i| readings[i]).expect("usable");
            memory.update(n as u64 * 100 * MS, &odom_from_robot, &beams, None, &handler());
            prop_assert!(memory.spots.is_consistent());
            for beam in beams.beams().iter().filter(|beam| !handler().masks(beam.end)) {
                let kept = beam.end.coords.norm() < 3.9;
                let cell = super::spots::cell_of(odom_from_robot * beam.end);
                let end = odom_from_robot * beam.end;
                let near = |spot: &super::Spot| spot.cell() == cell && (spot.odom - end).norm() < 0.08;
                prop_assert!(!kept || memory.spots.iter().any(near), "{:?}", beam.end);
            }
        }
    }

    /// A place that was seen free lies before what the beams on either side of it ended on.
    #[test]
    fn nothing_behind_a_hit_was_seen_free(
        before in proptest::collection::vec(0.3..3.0f64, 360), angle in -3.1..3.1f64, range in 0.2..3.5f64,
        (x, y, yaw) in (-0.2..0.2f64, -0.2..0.2f64, -0.3..0.3f64),
    ) {
        let mut then = Beams::default();
        then.fill_with(&header(), 360, |i| before[i]).expect("usable");
        let mut memory = memory();
        memory.update(0, &Se2::identity(), &then, None, &handler());
        let odom_from_robot = se2(Pose2::new(x, y, yaw));
        memory.move_to(0, &odom_from_robot);
        let odom = Point::new(range * angle.cos(), range * angle.sin());
        if memory.saw_free(odom_from_robot.inverse() * odom) {
            let right = ((angle + std::f64::consts::PI).to_degrees()) as usize;
            prop_assert!(before[right % 360].min(before[(right + 1) % 360]) > range + 0.03 - 1e-9);
        }
    }
}
