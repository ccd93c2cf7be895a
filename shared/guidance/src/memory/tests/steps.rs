//! Steps in the floor, and what the shield makes of them before and after the handler has them taken.

use super::edges::Bench;
use super::floor::FOOTING;
use crate::depth::StepMax;
use crate::memory::Footing;
use crate::se2::Point;
use messages::{Pose2, UnsafeCause};

const FORWARD: Pose2 = Pose2::new(0.15, 0.0, 0.0);

/// Ground that rises by so much from there on; less than 0: it falls.
fn step(at_m: f64, rise_m: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, _| if x > at_m { rise_m } else { 0.0 }
}

/// The robot walks up to such ground, 0.7 m from where it began.
fn before(ground_m: impl Fn(f64, f64) -> f64 + Copy) -> Bench {
    before_with(FOOTING, ground_m)
}

fn before_with(footing: Footing, ground_m: impl Fn(f64, f64) -> f64 + Copy) -> Bench {
    let mut bench = Bench::watching(footing);
    for n in 0..8 {
        let x_m = 0.1 * f64::from(n);
        bench.sees(100 * n as u64, x_m, move |x, y| ground_m(x + x_m, y));
    }
    bench
}

#[test]
fn a_low_step_forbids_until_the_handler_has_it_taken() {
    for rise_m in [-0.1, -0.08, -0.05, 0.05] {
        let mut bench = before(&step(1.3, rise_m));
        let judged = bench.judge(FORWARD);
        let cause = if rise_m < 0.0 { UnsafeCause::LowStepDown } else { UnsafeCause::LowStepUp };
        assert_eq!(judged.cause, cause, "{rise_m}: {judged:?}");
        assert!((judged.step_m - rise_m).abs() < 0.01, "{rise_m}: {judged:?}");
        let place = judged.place.expect("it is told where");
        assert!((0.5..0.65).contains(&place.x), "{rise_m}: {place}");
        assert!(bench.judge(Pose2::new(0.0, 0.0, 0.2)).safe, "it may turn");
        // One that is said of another place is not taken.
        bench.memory.allow_step(Point::new(1.8, 0.0));
        assert_eq!(bench.judge(FORWARD).cause, cause);
        bench.memory.allow_step(Point::new(0.7 + place.x, place.y));
        assert!(bench.judge(FORWARD).safe, "{rise_m}: {:?}", bench.judge(FORWARD));
        // It goes on over it: floor beyond is floor, though no frame shows both sides any more.
        for n in 8..14 {
            let x_m = 0.1 * f64::from(n);
            bench.sees(100 * n as u64, x_m, move |x, y| step(1.3, rise_m)(x + x_m, y));
            let judged = bench.judge(FORWARD);
            assert!(judged.safe, "{rise_m}, at {x_m}: {judged:?}");
        }
        assert!(bench.memory.edges().is_empty(), "{:?}", bench.memory.edges());
    }
}

#[test]
fn a_step_that_is_too_high_is_never_taken() {
    for (rise_m, cause) in [
        (-0.16, UnsafeCause::DropOff),
        (-0.115, UnsafeCause::DropOff),
        (0.1, UnsafeCause::StepUp),
        (0.17, UnsafeCause::StepUp),
    ] {
        let mut bench = before(&step(1.1, rise_m));
        let forward = Pose2::new(0.3, 0.0, 0.0);
        let judged = bench.judge(forward);
        assert_eq!(judged.cause, cause, "{rise_m}: {judged:?}");
        for y in -3..4 {
            bench.memory.allow_step(Point::new(1.1, 0.1 * f64::from(y)));
        }
        assert!(!bench.judge(forward).safe, "{rise_m}, whatever the handler says");
    }
}

#[test]
fn a_step_that_is_measured_a_little_below_the_limit_is_not_taken() {
    let max = FOOTING.step_max;
    // One of 12.1 cm was measured as 11.95 cm; the robot took it, and fell.
    assert!(!max.allows(-0.112) && max.allows(-0.109));
    assert!(!max.allows(0.061) && max.allows(0.059));
    let never = StepMax { down_m: 0.0, ..max };
    assert!(!never.allows(-0.001) && never.allows(0.005), "the limit down does not limit rises");
}

#[test]
fn a_lower_limit_forbids_what_it_no_longer_allows() {
    let step_max = StepMax { down_m: 0.04, up_m: 0.03 };
    let footing = Footing { step_max, ..FOOTING };
    for (rise_m, cause) in [(-0.06, UnsafeCause::DropOff), (0.05, UnsafeCause::StepUp)] {
        let mut bench = before_with(footing, &step(1.1, rise_m));
        let forward = Pose2::new(0.3, 0.0, 0.0);
        assert_eq!(bench.judge(forward).cause, cause, "{rise_m}: {:?}", bench.judge(forward));
        (-3..4).for_each(|y| bench.memory.allow_step(Point::new(1.1, 0.1 * f64::from(y))));
        assert_eq!(bench.judge(forward).cause, cause, "{rise_m}, whatever the handler says");
    }
}

#[test]
fn on_the_way_back_a_step_counts_by_the_way_it_then_leads() {
    for (rise_m, back) in [(-0.08, UnsafeCause::StepUp), (-0.05, UnsafeCause::None), (0.05, UnsafeCause::None)] {
        let mut bench = before(&step(1.3, rise_m));
        let place = bench.judge(FORWARD).place.expect("it is told where");
        bench.memory.allow_step(Point::new(0.7 + place.x, place.y));
        for n in 8..30 {
            let x_m = 0.1 * f64::from(n);
            bench.sees(100 * n as u64, x_m, move |x, y| step(1.3, rise_m)(x + x_m, y));
        }
        // It lies 1.6 m behind: the way there is forbidden where the step is too high to be climbed, taken or not.
        let judged = bench.judge(Pose2::new(-0.9, 0.0, 0.0));
        let found = if judged.cause.is_edge() { judged.cause } else { UnsafeCause::None };
        assert_eq!(found, back, "{rise_m}: {judged:?}");
    }
}

#[test]
fn a_loss_of_place_ends_what_the_handler_allowed() {
    let mut bench = before(&step(1.3, -0.08));
    let place = bench.judge(FORWARD).place.expect("it is told where");
    bench.memory.allow_step(Point::new(0.7 + place.x, place.y));
    assert!(bench.memory.steps().iter().any(|step| step.is_allowed));
    bench.memory.anchor(&crate::Se2::identity());
    bench.memory.move_to(bench.memory.now_ns, &crate::Se2::identity());
    assert!(!bench.memory.steps().is_empty());
    assert!(bench.memory.steps().iter().all(|step| !step.is_allowed), "{:?}", bench.memory.steps());
}

#[test]
fn the_step_after_it_is_announced_as_well() {
    let mut bench = before(|x, _| if x > 1.7 { -0.2 } else { step(1.3, -0.1)(x, 0.0) });
    let first = bench.judge(FORWARD);
    assert_eq!(first.cause, UnsafeCause::LowStepDown, "{first:?}");
    let place = first.place.expect("it is told where");
    bench.memory.allow_step(Point::new(0.7 + place.x, place.y));
    assert!(bench.judge(FORWARD).safe);
    let second = bench.judge(Pose2::new(0.55, 0.0, 0.0));
    assert!(second.cause.is_edge() && second.place.is_some_and(|place| place.x > 0.8), "{second:?}");
}

#[test]
fn neither_ramps_nor_mats_are_steps() {
    let ramp = |slope: f64| move |x: f64, _: f64| (x - 1.2).max(0.0) * slope;
    for slope in [-1.0 / 8.0, -1.0 / 12.0, 1.0 / 12.0, 1.0 / 8.0] {
        assert!(before(ramp(slope)).memory.steps().is_empty(), "{slope}");
    }
    for rise_m in [-0.02, 0.01, 0.02] {
        assert!(before(&step(1.3, rise_m)).memory.steps().is_empty(), "{rise_m}");
    }
}

#[test]
fn a_step_goes_where_floor_is_seen_without_one() {
    let mut bench = before(&step(1.7, -0.08));
    assert!(!bench.memory.steps().is_empty());
    // A plank is put there.
    for n in 0..20 {
        bench.sees(1_000 + 33 * n, 0.7, |_, _| 0.0);
    }
    let left: Vec<_> = bench.memory.steps().iter().filter(|step| step.at.place.y.abs() < 0.3).collect();
    assert!(left.is_empty(), "{left:?}");
}
