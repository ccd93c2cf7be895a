//! What Nav2's collision monitor is tested to do, asked of the swept hull.
//!
//! The monitor scales a velocity down; the shield takes an action away. Both stand on one figure: for how long a
//! velocity may be held before something is touched. What has no counterpart here is listed with its reason, and a
//! scenario that is neither held nor listed fails.

use std::collections::BTreeMap;

use guidedog_guidance::se2::{Point, exp};
use guidedog_guidance::{Beams, EdgeDistance, Evidence, HandlerBody, Motion, Reach, ScanError, Shield, ShieldConfig};
use messages::{ScanHeader, Twist2};
use serde_json::Value;

const DOES_NOT_APPLY: [(&str, &str); 4] = [
    ("S2", "a zone that limits the speed: the shield drops actions and scales none"),
    ("S3", "a zone that slows down: likewise"),
    ("I2", "a concave zone: the hull is convex"),
    ("O1", "an old source yields no points and motion goes on: here it stops; services/shield/src/core/tests.rs"),
];

fn scenarios() -> Option<BTreeMap<String, Value>> {
    let text = std::fs::read_to_string(test_data::data("peers/nav2_collision_monitor.json")?).expect("readable");
    let all: Value = serde_json::from_str(&text).expect("JSON");
    let steps = all["steps"].as_array().expect("a list");
    Some(steps.iter().map(|step| (step["id"].as_str().expect("an id").to_owned(), step.clone())).collect())
}

fn velocity(step: &Value) -> Twist2 {
    let at = |i: usize| step["cmd"][i].as_f64().expect("a number");
    Twist2 { vx_mps: at(0), vy_mps: at(1), wz_radps: at(2) }
}

/// 360 beams of one degree, all of one reading.
fn ring(distance_m: f64) -> Beams {
    scan(&[], distance_m)
}

/// Points in the open, each met by a beam of its own.
fn points(points: &[(f64, f64)]) -> Beams {
    scan(points, f64::INFINITY)
}

fn scan(points: &[(f64, f64)], elsewhere_m: f64) -> Beams {
    // Fine enough that points 0.02 m apart have beams of their own.
    let count = if points.is_empty() { 360 } else { 3600 };
    let increment_rad = std::f64::consts::TAU / f64::from(count);
    let mut readings_m = vec![elsewhere_m; count as usize];
    for (x, y) in points {
        let beam = (y.atan2(*x).rem_euclid(std::f64::consts::TAU) / increment_rad).round() as usize % readings_m.len();
        readings_m[beam] = x.hypot(*y);
    }
    let header = ScanHeader {
        angle_increment_rad: increment_rad,
        range_min_m: 0.1,
        range_max_m: 100.0,
        ..ScanHeader::default()
    };
    let mut beams = Beams::default();
    beams.fill_with(&header, readings_m.len(), |i| readings_m[i]).expect("usable");
    beams
}

/// Whether a robot of that radius, without a handler, may hold the velocity for so long.
fn is_free(radius_m: f64, velocity: Twist2, time_s: f64, beams: &Beams) -> bool {
    let mut shield = Shield::new(ShieldConfig {
        robot_radius_m: radius_m,
        margin_m: 0.0,
        unknown_gap_m: 0.1,
        escape: false,
        unseen_limit_m2: None,
        back_from_edges_m: None,
        reach: Reach::default(),
        edges: EdgeDistance::default(),
    });
    let robot = exp(velocity, time_s);
    let alone = HandlerBody { center: Point::origin(), radius_m, mask_radius_m: None, seen: None };
    let mut judgements = Vec::new();
    let motion = Motion::new(robot, robot);
    shield.judge_motions([motion].into_iter(), Evidence::scan(beams), alone, &mut judgements);
    judgements[0].safe
}

/// For how long it may hold the velocity before it touches something, seconds; at most `most_s`.
fn collision_time_s(radius_m: f64, velocity: Twist2, beams: &Beams, most_s: f64) -> f64 {
    let (mut free_s, mut touched_s) = (0.0, most_s);
    for _ in 0..40 {
        let middle = f64::midpoint(free_s, touched_s);
        if is_free(radius_m, velocity, middle, beams) {
            free_s = middle;
        } else {
            touched_s = middle;
        }
    }
    free_s
}

#[test]
fn every_scenario_is_held_or_listed() {
    let Some(scenarios) = scenarios() else { return };
    let held = ["S1", "S4", "S5", "A1", "A2", "A3", "A4", "T1", "C1", "C2", "C3", "I1", "I3"];
    for id in scenarios.keys() {
        let listed = DOES_NOT_APPLY.iter().any(|(other, why)| other == id && !why.is_empty());
        assert!(held.contains(&id.as_str()) != listed, "{id} is neither held nor listed, or both");
    }
    assert_eq!(scenarios.len(), held.len() + DOES_NOT_APPLY.len());
}

#[test]
fn a_stop_zone_is_the_present_hull() {
    let Some(scenarios) = scenarios() else { return };
    // The square of half-length 1 holds, and is held by, discs of 1 and 1.42 m; each has the same answers.
    for (id, free) in [("S1", true), ("S4", false), ("S5", true)] {
        let step = &scenarios[id];
        let beams = ring(step["obstacle_d"].as_f64().expect("a distance"));
        for radius_m in [1.0, 1.42] {
            assert_eq!(is_free(radius_m, velocity(step), 1.0, &beams), free, "{id}, {radius_m} m");
        }
        assert_eq!(step["expect"] == step["cmd"], free, "{id}");
    }
}

#[test]
fn the_time_to_collision_is_how_long_the_swept_hull_is_free() {
    let Some(scenarios) = scenarios() else { return };
    for id in ["A1", "A2", "A3", "A4"] {
        let step = &scenarios[id];
        let (velocity, beams) = (velocity(step), ring(step["obstacle_d"].as_f64().expect("a distance")));
        // Before a collision the monitor keeps one second: it scales by the time to collision in seconds.
        let expected = match id {
            "A2" => 0.371_391,
            "A3" => 0.0,
            _ => 1.0,
        };
        let time_s = collision_time_s(1.0, velocity, &beams, 1.0);
        assert!((time_s - expected).abs() <= 0.01 * expected + 1e-9, "{id}: {time_s} s, not {expected}");
    }
    let ahead = |x: f64, y: f64| Twist2 { vx_mps: x, vy_mps: y, wz_radps: 0.0 };
    for (id, velocity, seen) in [
        ("C1", ahead(0.5, 0.0), [(0.7, 0.01), (0.7, -0.01)]),
        ("C2", ahead(-0.5, 0.0), [(-0.7, 0.01), (-0.7, -0.01)]),
        ("C3", ahead(0.0, 0.5), [(0.01, 0.6), (-0.01, 0.6)]),
    ] {
        let (expected, tolerance) = (&scenarios[id]["expect_s"], &scenarios[id]["tol"]);
        let (expected, tolerance) = (expected.as_f64().expect("seconds"), tolerance.as_f64().expect("seconds"));
        let time_s = collision_time_s(0.5, velocity, &points(&seen), 2.0);
        assert!((time_s - expected).abs() <= tolerance, "{id}: {time_s} s, not {expected}");
    }
}

#[test]
fn points_are_inside_or_not() {
    let Some(_) = scenarios() else { return };
    let stand = Twist2::ZERO;
    for (id, outside) in [("I1", &[(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][..]), ("I3", &[(1.0, 0.0)][..])] {
        assert!(is_free(0.5, stand, 1.0, &points(outside)), "{id}");
        let with = [outside, &[(-0.1, 0.3)]].concat();
        assert!(
            !is_free(0.5, stand, 1.0, &points(&with)),
            "{id}: one point is enough, where the monitor waits for two"
        );
    }
}

/// T1: a source that says nothing stops.
#[test]
fn a_scan_that_says_nothing_is_refused() {
    let header = ScanHeader {
        angle_increment_rad: std::f64::consts::TAU / 360.0,
        range_min_m: 0.1,
        range_max_m: 12.0,
        ..ScanHeader::default()
    };
    let mut beams = Beams::default();
    assert_eq!(beams.fill(&header, &[f32::NAN; 360]), Err(ScanError::AllUnknown(360)));
    assert!(beams.beams().is_empty(), "nothing is left to be judged by");
}
