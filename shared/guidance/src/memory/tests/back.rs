//! What a step back asks for.

use super::edges::{Bench, cliff};
use super::floor::FOOTING;
use super::handler;
use crate::handler::{HandlerBody, Seen};
use crate::se2::Point;
use messages::{Pose2, UnsafeCause};

const BACK: Pose2 = Pose2::new(-0.15, 0.0, 0.0);

/// Where a scan saw the handler.
fn seen_at(x_m: f64) -> Seen {
    let at = Point::new(x_m, -0.35);
    Seen { at, next: at, by_default_m: 0.83 }
}

/// The handler as a scan saw them.
fn seen() -> HandlerBody {
    HandlerBody { seen: Some(seen_at(-0.75)), ..handler() }
}

/// A pair that has walked a metre over level floor, which the camera saw before.
fn walked() -> Bench {
    let mut bench = Bench::watching(FOOTING);
    bench.sees_handler = true;
    for step in 0..=20 {
        bench.sees(200 * step, 0.1 * step as f64, |_, _| 0.0);
    }
    bench
}

#[test]
fn it_leads_over_floor_that_was_seen_or_trodden_and_over_no_other() {
    let judgement = walked().judge_with(BACK, seen());
    assert!(judgement.safe, "{judgement:?}");
    // At the start nothing behind the pair was ever seen.
    let mut begins = Bench::watching(FOOTING);
    begins.sees_handler = true;
    begins.sees(0, 0.0, |_, _| 0.0);
    let judgement = begins.judge_with(BACK, seen());
    assert_eq!((judgement.safe, judgement.cause), (false, UnsafeCause::FloorUnseen), "{judgement:?}");
}

#[test]
fn it_is_forbidden_where_floor_is_not_remembered() {
    let judgement = Bench::new().judge_with(BACK, seen());
    assert_eq!(judgement.cause, UnsafeCause::FloorUnseen, "{judgement:?}");
}

#[test]
fn no_handle_is_pushed_into_a_handler() {
    let bench = walked();
    let at = |x_m: f64| HandlerBody { center: Point::new(x_m, -0.35), seen: Some(seen_at(x_m)), ..handler() };
    for (body, is_safe) in [(at(-0.75), true), (at(-0.70), true), (at(-0.55), false), (handler(), false)] {
        let judgement = bench.judge_with(BACK, body);
        assert_eq!(judgement.safe, is_safe, "{body:?}: {judgement:?}");
        assert!(is_safe || judgement.cause == UnsafeCause::Handler, "{judgement:?}");
        assert!(bench.judge_with(Pose2::new(0.15, 0.0, 0.0), body).safe, "any other motion is free");
    }
    // Who walks up to the robot is near by the next scan.
    let comes = Seen { next: Point::new(-0.55, -0.35), ..seen_at(-0.75) };
    assert!(!bench.judge_with(BACK, HandlerBody { seen: Some(comes), ..handler() }).safe);
}

/// A pair that walked over a floor with an edge somewhere, and looked about at the end.
fn beside_an_edge(ground_m: impl Fn(f64, f64) -> f64 + Copy) -> Bench {
    let mut bench = Bench::watching(FOOTING);
    bench.sees_handler = true;
    for step in 0..=20 {
        let x_m = 0.1 * step as f64;
        bench.sees(200 * step, x_m, move |x, y| ground_m(x + x_m, y));
    }
    bench
}

#[test]
fn an_edge_within_a_metre_forbids_it_on_whatever_side() {
    let judge = |bench: Bench| bench.judge_with(BACK, seen());
    let ahead = |edge_m: f64| {
        let mut bench = walked();
        for frame in 0..9 {
            bench.sees(5_000 + 33 * frame, 2.0, cliff(edge_m));
        }
        bench
    };
    assert_eq!(judge(ahead(1.2)).cause, UnsafeCause::DropOff, "0.9 m before the robot");
    assert!(judge(ahead(2.0)).safe);
    for side in [1.0, -1.0] {
        let beside = |edge_m: f64| beside_an_edge(move |_, y| if side * y > edge_m { -0.5 } else { 0.0 });
        assert_eq!(judge(beside(1.1)).cause, UnsafeCause::DropOff, "beside the pair, {side}");
    }
    assert!(judge(beside_an_edge(|_, y| if y > 1.8 { -0.5 } else { 0.0 })).safe);
    // A step that may be taken is one to stumble over.
    let step = beside_an_edge(|x, _| if x > 2.7 { -0.09 } else { 0.0 });
    assert_eq!(judge(step).cause, UnsafeCause::DropOff, "a low step");
}
