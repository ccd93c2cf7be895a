//! What the handler hides, and what is close beside them.

use super::{HANDLER, MS, Memory, POST_M, handler, judge, judge_with, memory, scan};
use crate::handler::HandlerBody;
use crate::scan::Beams;
use crate::scan::tests::header;
use crate::se2::{Point, Se2};
use crate::shield::Evidence;
use messages::{Pose2, UnsafeCause};

/// Behind the handler as the robot sees them, and in the way when it turns left by half a radian.
const BEHIND: Point = Point::new(-0.67, -0.67);
const FORWARD: Pose2 = Pose2::new(0.15, 0.0, 0.0);
const RIGHT: Pose2 = Pose2::new(0.0, 0.0, -0.1);

#[test]
fn what_the_handler_hides_is_still_there() {
    let mut memory = memory();
    // The robot comes from where it sees the post beside the handler.
    let odom_from_before = Se2::translation(-1.0, 0.0);
    let before = odom_from_before.inverse() * BEHIND;
    memory.update(0, &odom_from_before, &scan(&[HANDLER, (before, POST_M)]), None, &handler());
    assert!(memory.hidden().is_empty(), "the lidar sees it: the scan alone counts");
    let hides = (Point::new(-0.39, -0.39), 0.22);
    let hiding = HandlerBody { center: hides.0, ..handler() };
    let beams = scan(&[hides, (BEHIND, POST_M)]);
    memory.update(2000 * MS, &Se2::identity(), &beams, None, &hiding);
    assert!(!memory.hidden().is_empty(), "the handler stands before it");
    for spot in memory.hidden() {
        assert!((spot.place - BEHIND).norm() < 0.05, "{spot:?}");
        assert!((spot.uncertainty_m - 0.03).abs() < 1e-9, "after a metre: {spot:?}");
    }
    let evidence = Evidence { memory: Some(&memory), ..Evidence::scan(&beams) };
    let turn = Pose2::new(0.0, 0.0, 0.5);
    let judgement = judge_with(evidence, hiding, turn);
    assert!(!judgement.safe && judgement.cause == UnsafeCause::Memory, "{judgement:?}");
    assert!(judgement.margin_m < 0.0 && judgement.beam.is_none(), "the margin is no beam's: {judgement:?}");
    assert!(judge_with(Evidence { memory: None, ..evidence }, hiding, turn).safe, "without memory nobody knows");
}

#[test]
fn a_jamb_that_the_handler_walks_up_to_is_not_taken_for_theirs() {
    let mut memory = memory();
    let jamb = Point::new(-0.62, -0.57);
    let odom_from_before = Se2::translation(-1.0, 0.0);
    let before = odom_from_before.inverse() * jamb;
    let beams = scan(&[HANDLER, (jamb, 0.01)]);
    let ahead = |memory: &Memory| judge(Evidence { memory: Some(memory), ..Evidence::scan(&beams) }, FORWARD);
    assert!(ahead(&memory).safe, "a beam that ends so close to the handler is taken for theirs");
    memory.update(0, &odom_from_before, &scan(&[HANDLER, (before, POST_M)]), None, &handler());
    for look in 0..10 {
        memory.update((2000 + 100 * look) * MS, &Se2::identity(), &beams, None, &handler());
    }
    assert!(memory.hidden().iter().any(|spot| spot.is_apart && (spot.place - jamb).norm() < 0.06));
    let (ahead, aside) = (ahead(&memory), judge(Evidence { memory: Some(&memory), ..Evidence::scan(&beams) }, RIGHT));
    assert_eq!((ahead.safe, ahead.cause), (false, UnsafeCause::Memory), "{ahead:?}");
    assert!(aside.safe, "what leads away from it is free: {aside:?}");
}

#[test]
fn what_ends_on_the_handler_never_enters_and_where_they_stand_nothing_else_does() {
    let mut memory = memory();
    memory.update(0, &Se2::identity(), &scan(&[HANDLER]), None, &handler());
    // The handler is gone, and something hides where they were.
    let screen = (Point::new(-0.4, -0.187), 0.15);
    let gone = HandlerBody { center: Point::new(-0.75, 0.5), ..handler() };
    memory.update(100 * MS, &Se2::identity(), &scan(&[screen]), None, &gone);
    assert!(memory.hidden().is_empty());
    // A thing was seen, and now the handler stands there.
    let thing = Point::new(-0.75, 0.5);
    memory.update(200 * MS, &Se2::identity(), &scan(&[(thing, POST_M)]), None, &handler());
    memory.update(300 * MS, &Se2::identity(), &scan(&[(thing, 0.22)]), None, &gone);
    memory.update(400 * MS, &Se2::identity(), &scan(&[(Point::new(-0.3, 0.2), 0.1)]), None, &handler());
    assert!(memory.hidden().is_empty(), "{:?}", memory.hidden());
}

#[test]
fn just_behind_the_handler_is_hidden_and_just_behind_a_wall_is_the_wall() {
    for (masked, remains) in [(true, true), (false, false)] {
        let mut memory = memory();
        let thing = Point::new(-1.04, -0.35);
        memory.update(0, &Se2::identity(), &scan(&[(thing, 0.01)]), None, &handler());
        assert_eq!(memory.spots.all().len(), 1);
        // 0.05 m before it something ends the beams: the handler's far side, or a wall.
        let distance_m = thing.coords.norm() - 0.05;
        let mut beams = Beams::default();
        beams.fill_with(&header(), 360, |_| distance_m).expect("usable");
        let body = HandlerBody { mask_radius_m: masked.then_some(0.28), ..handler() };
        memory.update(100 * MS, &Se2::identity(), &beams, None, &body);
        assert_eq!(memory.hidden().iter().any(|spot| (spot.place - thing).norm() < 0.02), remains, "masked {masked}");
    }
}
