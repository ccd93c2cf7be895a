//! Who stops: the shield where it leaves nothing but stop, the policy where it stands although more is allowed.

use super::{MS, action, handler_place, open_scan, ready, scan_header};
use guidance::ActionTable;
use messages::{NO_BEAM, Outcome, Permit};

/// How far beyond robot and handler everything stands, metres.
const GAP_M: f64 = 0.02;
/// What the shield takes them for, metres: the robot, and the handler.
const RADII_M: [f64; 2] = [0.35, 0.30];

/// The way from the robot along a beam to where it leaves the hull of robot and handler, metres.
fn leaves_m(angle_rad: f64) -> f64 {
    let (x_m, y_m) = handler_place();
    let is_within = |range_m: f64| {
        let (at_x_m, at_y_m) = (range_m * angle_rad.cos(), range_m * angle_rad.sin());
        (0..=50).map(|i| f64::from(i) / 50.0).any(|share| {
            let radius_m = RADII_M[0] + share * (RADII_M[1] - RADII_M[0]);
            (at_x_m - share * x_m).hypot(at_y_m - share * y_m) <= radius_m
        })
    };
    (0..500).map(|i| 0.005 * f64::from(i)).take_while(|range_m| is_within(*range_m)).last().unwrap_or(0.0)
}

/// Walls all round, just beyond robot and handler.
fn walled_in() -> Vec<f32> {
    let angle_rad = |i: usize| -std::f64::consts::PI + (i as f64).to_radians();
    let walls = (0..360).map(|i| (leaves_m(angle_rad(i)) + GAP_M) as f32);
    open_scan().into_iter().zip(walls).map(|(range, wall)| range.min(wall)).collect()
}

fn judged(ranges: &[f32], wanted: usize) -> Permit {
    let mut core = ready();
    core.on_scan(1000 * MS, &scan_header(990), ranges);
    core.on_action(1000 * MS, &action(2, wanted)).expect("a verdict")
}

#[test]
fn where_only_stop_is_left_the_shield_stops_and_names_its_beam() {
    for wanted in [ActionTable::STOP, 1] {
        let permit = judged(&walled_in(), wanted);
        assert_eq!(permit.unsafe_mask, 0b1111_1110, "{wanted}");
        assert_eq!((permit.outcome, permit.all_unsafe), (Outcome::AllUnsafe, true), "{wanted}");
        assert!(permit.beam != NO_BEAM && permit.margin_m < 0.0, "{wanted}: {permit:?}");
    }
}

#[test]
fn a_policy_that_stands_is_told_what_forbids_its_first_choice_that_moves() {
    let of = |probabilities: &[(usize, f32)]| {
        let mut core = ready();
        core.on_scan(1000 * MS, &scan_header(990), &walled_in());
        let mut action = action(2, ActionTable::STOP);
        action.probabilities.fill(0.0);
        probabilities.iter().for_each(|(index, p)| action.probabilities[*index] = *p);
        let permit = core.on_action(1000 * MS, &action).expect("a verdict");
        (permit.beam, permit.threshold_m)
    };
    let (forward, aside) = (of(&[(1, 1.0)]), of(&[(4, 1.0)]));
    assert_ne!(forward, aside);
    assert_eq!(of(&[(0, 0.6), (1, 0.3), (4, 0.1)]), forward);
    assert_eq!(of(&[(0, 0.6), (1, 0.1), (4, 0.3)]), aside);
}

#[test]
fn where_more_is_allowed_a_policy_that_stands_stops_itself() {
    let permit = judged(&open_scan(), ActionTable::STOP);
    assert_eq!((permit.outcome, permit.all_unsafe), (Outcome::Stop, false));
}
