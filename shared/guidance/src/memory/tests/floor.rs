//! Floor that was seen, that was assumed, and that was neither.

use super::edges::{Bench, cliff};
use crate::depth::StepMax;
use crate::memory::{Floor, Footing};
use crate::se2::{Point, Se2};
use messages::{Pose2, UnsafeCause};

pub(super) const FOOTING: Footing = Footing {
    radius_m: 0.3,
    nose_m: 0.0,
    handler_m: 0.25,
    overrun_m: 0.1,
    overrun_rad: 0.0,
    step_max: StepMax { down_m: 0.12, up_m: 0.06 },
};
const FORWARD: Pose2 = Pose2::new(0.3, 0.0, 0.0);
const ASIDE: Pose2 = Pose2::new(0.0, 0.3, 0.0);

fn flat(_: f64, _: f64) -> f64 {
    0.0
}

/// What is known of the floor at a place (robot frame).
fn floor(bench: &Bench, x_m: f64, y_m: f64) -> Floor {
    let place = Point::new(x_m, y_m);
    let mut near = bench.memory.unseen_floor(place, 0.071);
    near.next().map_or(Floor::Seen, |(_, floor)| floor)
}

#[test]
fn floor_that_goes_on_level_is_assumed_up_to_the_first_that_is_seen() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, flat);
    assert_eq!(floor(&bench, 1.6, 0.0), Floor::Seen);
    assert_eq!(floor(&bench, 0.7, 0.0), Floor::Assumed);
    assert_eq!(floor(&bench, 0.7, 1.2), Floor::Unseen, "beside the pair's width");
    assert_eq!(floor(&bench, -1.5, 0.0), Floor::Unseen);
    assert_eq!(floor(&bench, 0.0, 0.0), Floor::Seen, "the robot stands on it");
    assert_eq!(floor(&bench, -0.75, -0.35), Floor::Assumed, "no scan saw the handler there");
    let (ahead, aside) = (bench.judge(FORWARD), bench.judge(ASIDE));
    assert!(ahead.safe && ahead.assumes_floor, "{ahead:?}");
    assert_eq!((aside.safe, aside.cause), (false, UnsafeCause::FloorUnseen), "{aside:?}");
    assert!(aside.place.is_some(), "{aside:?}");
    let askew = bench.judge(Pose2::new(0.12, -0.12, 0.0));
    assert_eq!(askew.cause, UnsafeCause::FloorUnseen, "the strip is for going ahead: {askew:?}");
    assert!(bench.judge(Pose2::new(0.0, 0.0, 0.2)).safe, "a turn may go a hand's breadth over floor that was not seen");
    assert!(bench.judge(Pose2::default()).safe, "nothing keeps one from standing");
}

#[test]
fn floor_that_lies_lower_is_not_assumed_to_go_on() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, |x, _| if x > 0.7 { -0.1 } else { 0.0 });
    let ahead = bench.judge(FORWARD);
    assert!(!ahead.safe, "{ahead:?}");
}

#[test]
fn what_was_assumed_in_the_first_metre_lasts_until_the_pair_has_passed() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, flat);
    let beside = |at_m: f64| (0.7 - at_m, 0.35);
    for step in 1..=40 {
        let at_m = 0.1 * step as f64;
        bench.sees_nothing(500 * step, at_m);
        // The handler comes 0.75 m behind the robot.
        let (x_m, y_m) = beside(at_m);
        let is_near = x_m.hypot(y_m) < 1.5;
        assert_eq!(floor(&bench, x_m, y_m) == Floor::Assumed, is_near, "{at_m} m on");
    }
    bench.sees(21_000, 4.0, flat);
    assert_eq!(floor(&bench, 0.7, 0.0), Floor::Unseen, "nothing else is assumed on the way");
}

#[test]
fn step_by_step_a_pair_comes_no_farther_from_floor_that_was_seen() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees_handler = true;
    bench.sees_nothing(0, 0.0);
    let may_go_on = |bench: &Bench, to_m: f64| (to_m, bench.judge(Pose2::new(0.2, 0.0, 0.0)).safe);
    let steps: Vec<_> = (1..=20)
        .map(|step| {
            let to_m = 0.05 * f64::from(step);
            bench.sees_nothing(500 * u64::try_from(step).expect("small"), to_m);
            may_go_on(&bench, to_m)
        })
        .collect();
    assert!(steps[0].1, "a rim is assumed: {steps:?}");
    assert!(steps.iter().all(|(to_m, may)| !may || *to_m < 0.5), "{steps:?}");
}

#[test]
fn drift_takes_away_more_of_the_rim_the_farther_they_come() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, flat);
    let far = |bench: &Bench| (0..30).filter(|i| floor(bench, 0.1 * f64::from(*i) + 0.05, 0.05) == Floor::Seen).count();
    let before = far(&bench);
    // To and fro: five radians.
    (1..=10).for_each(|turn| bench.turns(100 * turn, 0.5 * (turn % 2) as f64));
    let after = far(&bench);
    assert!(before >= after + 2, "{before} cells ahead were seen before, {after} after");
}

#[test]
fn on_a_straight_way_drift_takes_a_cell_of_the_rim_wherever_it_lies() {
    for offset in 0..8 {
        let mut bench = Bench::watching(FOOTING);
        let from_m = 0.1 * f64::from(offset);
        bench.sees(0, from_m, flat);
        // The farthest cell ahead, counted in the odometry frame.
        let far = |bench: &Bench, at_m: f64| {
            let is_seen = |i: &i32| floor(bench, 0.1 * f64::from(*i) + 0.05 - at_m, 0.05) == Floor::Seen;
            (0..60).rev().find(is_seen)
        };
        let before = far(&bench, from_m);
        (1..=23).for_each(|step| bench.sees_nothing(200 * step, from_m + 0.1 * step as f64));
        let after = far(&bench, from_m + 2.3);
        assert!(before.zip(after).is_some_and(|(before, after)| after < before), "{offset}: {before:?}, {after:?}");
    }
}

#[test]
fn a_turn_at_the_start_makes_no_floor_under_the_handler() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees_handler = true;
    (0..=9).for_each(|turn| bench.turns(100 * turn, 0.15 * turn as f64));
    // Where the handler stood at first, and where they came to.
    let now = |x_m: f64, y_m: f64| Se2::rotation(-1.35) * Point::new(x_m, y_m);
    let (first, last) = (now(-0.75, -0.35), Point::new(-0.75, -0.35));
    assert_eq!(floor(&bench, first.x, first.y), Floor::Seen);
    assert!(bench.memory.has_seen_floor(first) && !bench.memory.has_seen_floor(last), "they trod on it");
}

#[test]
fn floor_is_let_go_after_three_metres_and_stays_while_they_stand() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, flat);
    bench.sees_nothing(3_600_000, 0.0);
    assert_eq!(floor(&bench, 1.6, 0.0), Floor::Seen, "an hour later");
    for step in 1..=31 {
        bench.sees_nothing(3_600_000 + 100 * step, 0.1 * step as f64);
    }
    assert_eq!(floor(&bench, 2.8 - 3.1, 0.8), Floor::Unseen);
}

#[test]
fn who_goes_slowly_loses_no_floor_under_the_pair_and_all_that_is_far_off() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, flat);
    (1..=12).for_each(|step| bench.sees_nothing(2_000 * step, 0.1 * step as f64));
    assert_eq!(floor(&bench, 1.6 - 1.2, 0.0), Floor::Seen);
    assert_eq!(floor(&bench, 2.9 - 1.2, 0.0), Floor::Unseen);
}

#[test]
fn what_lies_beyond_an_edge_is_kept_off_before_the_edge_is_sure() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees(0, 0.0, cliff(1.5));
    assert!(bench.memory.edges().is_empty(), "one frame");
    assert_eq!(floor(&bench, 1.8, 0.0), Floor::Beyond);
    bench.sees_nothing(100, 0.9);
    let ahead = bench.judge(FORWARD);
    assert_eq!((ahead.safe, ahead.cause), (false, UnsafeCause::DropOff), "{ahead:?}");
    assert!(ahead.place.is_some_and(|place| (0.5..1.0).contains(&place.x)), "{ahead:?}");
}

#[test]
fn a_robot_whose_place_is_lost_keeps_the_floor_and_the_edges_about_it() {
    let mut bench = Bench::watching(FOOTING);
    for frame in 0..8 {
        bench.sees(33 * frame, 0.0, cliff(1.5));
    }
    bench.sees_nothing(1_000, 0.7);
    assert_eq!(floor(&bench, 0.5, 0.3), Floor::Seen);
    assert_eq!(bench.judge(FORWARD).cause, UnsafeCause::DropOff);
    // Another odometry frame, in which it stands elsewhere and turned.
    let odom_from_robot = Se2::new(nalgebra::Vector2::new(-20.0, 7.0), 2.0);
    bench.memory.anchor(&odom_from_robot);
    bench.memory.move_to(1_100_000_000, &odom_from_robot);
    assert_eq!(floor(&bench, 0.5, 0.2), Floor::Seen);
    assert_eq!(floor(&bench, -1.4, 1.0), Floor::Unseen);
    let ahead = bench.judge(FORWARD);
    assert_eq!((ahead.safe, ahead.cause), (false, UnsafeCause::DropOff), "{ahead:?}");
    let edges = bench.memory.edges();
    assert!(edges.iter().any(|edge| (0.7..0.9).contains(&edge.place.x) && edge.uncertainty_m >= 0.1), "{edges:?}");
}

#[test]
fn a_pair_is_not_held_for_good_by_the_floor_it_stands_over() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees_handler = true;
    bench.sees(0, 0.0, flat);
    // The camera is covered from there on; they go on and come back, and what it saw is let go.
    (1..=31).for_each(|step| bench.sees_nothing(200 * step, 0.1 * step as f64));
    // They turn to and fro there, until drift has taken away what they trod on.
    (1..=80).for_each(|turn| bench.turns(10_000 + 500 * turn, 0.35 * (turn % 2) as f64));
    let between = Point::new(-0.4, -0.2);
    assert!(floor(&bench, between.x, between.y) != Floor::Seen && !bench.memory.has_floor_near(between, 0.5));
    let turned = bench.judge(Pose2::new(0.0, 0.0, 0.02));
    assert!(turned.safe, "no part of them comes to new floor: {turned:?}");
    let ahead = bench.judge(FORWARD);
    assert_eq!((ahead.safe, ahead.cause), (false, UnsafeCause::FloorUnseen), "{ahead:?}");
}

#[test]
fn turn_by_turn_a_pair_does_not_come_round_over_floor_that_was_never_seen() {
    let mut bench = Bench::watching(FOOTING);
    bench.sees_handler = true;
    bench.sees_nothing(0, 0.0);
    let turn_rad = 10f64.to_radians();
    let may_turn: Vec<bool> = (0..18)
        .map(|turn| {
            bench.turns(500 * (turn + 1), turn_rad * turn as f64);
            bench.judge(Pose2::new(0.0, 0.0, turn_rad)).safe
        })
        .collect();
    assert!(may_turn[0] && !may_turn.iter().all(|may| *may), "{may_turn:?}");
}
