use super::{HandlerEstimate, HandlerLimits, Sighting};
use crate::interaction::{DelayedHarness, Interaction, InteractionModel, RotatingRod};
use crate::scan::Beams;
use crate::scan::tests::header;
use crate::se2::{Point, Se2, se2};
use messages::Pose2;

fn estimate() -> HandlerEstimate {
    let harness = DelayedHarness::new(Pose2::new(-0.75, -0.35, 0.0), 0.4, 0.5).expect("a harness");
    let limits = HandlerLimits { radius_m: 0.25, seen_radius_m: 0.25, speed_max_mps: 0.5, not_seen_ns: 1_000_000_000 };
    HandlerEstimate::new(harness, limits)
}

/// What a lidar at the robot's origin sees of a round handler in the open.
fn scan_of(center: Option<Point>) -> Beams {
    let header = header();
    let ranges: Vec<f32> = (0..360)
        .map(|i| {
            let angle = header.angle_min_rad + f64::from(i) * header.angle_increment_rad;
            let direction = nalgebra::Vector2::new(angle.cos(), angle.sin());
            let hit = center.and_then(|center| {
                let along = center.coords.dot(&direction);
                let root = along * along - (center.coords.norm_squared() - 0.25 * 0.25);
                (root >= 0.0 && along > 0.0).then(|| along - root.sqrt())
            });
            hit.unwrap_or(f64::INFINITY) as f32
        })
        .collect();
    let mut beams = Beams::default();
    beams.fill(&header, &ranges).expect("usable");
    beams
}

#[test]
fn a_handler_who_walks_a_little_elsewhere_is_found() {
    let truth = Point::new(-0.85, -0.25);
    let mut estimate = estimate();
    for i in 0..30 {
        assert_eq!(estimate.correct(&scan_of(Some(truth)), i), Sighting::Seen);
    }
    let error = (estimate.robot_from_handler().translation.vector - truth.coords).norm();
    assert!(error < 0.04, "{error}");
    assert!((estimate.radius_m() - 0.25).abs() < 1e-12, "a sighting ends the widening");
}

#[test]
fn a_wall_beside_the_handler_does_not_draw_the_estimate() {
    // A wall 0.4 m to the right of the handler's middle.
    let truth = Point::new(-0.75, -0.35);
    let mut estimate = estimate();
    let handler = scan_of(Some(truth));
    let ranges: Vec<f32> = handler
        .beams()
        .iter()
        .map(|beam| {
            let wall = if beam.direction.y < -1e-6 { -0.75 / beam.direction.y } else { f64::INFINITY };
            let seen = if beam.kind == crate::scan::BeamKind::Hit { beam.reading_m } else { f64::INFINITY };
            seen.min(wall) as f32
        })
        .collect();
    let mut beams = Beams::default();
    beams.fill(&header(), &ranges).expect("usable");
    for i in 0..30 {
        assert_eq!(estimate.correct(&beams, i), Sighting::Seen);
    }
    let error = (estimate.robot_from_handler().translation.vector - truth.coords).norm();
    assert!(error < 0.04, "{error}");
}

#[test]
fn a_second_without_the_handler_is_handler_not_seen() {
    let mut estimate = estimate();
    let empty = scan_of(None);
    assert_eq!(estimate.correct(&empty, 0), Sighting::Absent);
    estimate.correct(&empty, 999_999_999);
    assert!(!estimate.is_lost());
    estimate.correct(&empty, 1_000_000_000);
    assert!(estimate.is_lost());
}

/// An estimate whose handler has been lost.
fn lost() -> HandlerEstimate {
    let mut estimate = estimate();
    for at_ns in [0, 1_000_000_000] {
        estimate.correct(&scan_of(None), at_ns);
    }
    assert!(estimate.is_lost());
    estimate
}

/// Whether a handler is still lost after scans at these times, milliseconds, that show a person in their place.
fn is_lost_after(estimate: &mut HandlerEstimate, ms: impl Iterator<Item = u64>, at: impl Fn(u64) -> Point) -> bool {
    for ms in ms {
        estimate.correct(&scan_of(Some(at(ms))), ms * 1_000_000);
    }
    estimate.is_lost()
}

#[test]
fn a_handler_who_takes_the_handle_again_is_back_after_a_second() {
    let there = |_| Point::new(-0.7, -0.3);
    let mut estimate = lost();
    assert!(is_lost_after(&mut estimate, (1100..2100).step_by(100), there));
    assert!(!is_lost_after(&mut estimate, 2100..2101, there));
}

#[test]
fn a_handler_who_is_to_walk_elsewhere_is_lost_until_they_have_stood_there_for_a_second() {
    let behind = estimate().model().at(Pose2::new(-1.1, 0.0, 0.0)).expect("a harness");
    let mut estimate = estimate();
    estimate.take_place(&behind);
    assert!(is_lost_after(&mut estimate, (0..3000).step_by(100), |_| Point::new(-0.75, -0.35)), "beside");
    assert!(is_lost_after(&mut estimate, (3000..4000).step_by(100), |_| Point::new(-1.05, 0.05)));
    assert!(!is_lost_after(&mut estimate, 4000..4001, |_| Point::new(-1.05, 0.05)));
    let place = estimate.robot_from_handler().translation.vector;
    // The same place once more changes nothing.
    estimate.take_place(&behind);
    assert!(!estimate.is_lost() && (place.x + 1.1).abs() < 0.1, "{place}");
}

#[test]
fn neither_a_passer_by_nor_a_gap_in_the_looks_nor_a_new_odometry_frame_brings_a_handler_back() {
    let passes = |mps: f64| move |ms: u64| Point::new(-0.75 + mps * (ms as f64 / 1e3 - 2.0), -0.35);
    assert!(is_lost_after(&mut lost(), (1100..4000).step_by(100), passes(0.5)));
    assert!(is_lost_after(&mut lost(), (1100..9000).step_by(600), passes(0.0)), "looks that are too far apart");
    let mut estimate = lost();
    is_lost_after(&mut estimate, (1100..1900).step_by(100), passes(0.0));
    estimate.reset(&Se2::identity());
    assert!(is_lost_after(&mut estimate, (1900..2800).step_by(100), passes(0.0)));
}

#[test]
fn what_the_field_of_view_does_not_hold_is_predicted_and_never_lost() {
    let mut front = header();
    front.angle_min_rad = -std::f64::consts::FRAC_PI_2;
    front.angle_increment_rad = std::f64::consts::PI / 180.0;
    let mut beams = Beams::default();
    beams.fill(&front, &[5.0; 181]).expect("usable");
    let mut estimate = estimate();
    assert_eq!(estimate.correct(&beams, 0), Sighting::NotVisible);
    estimate.correct(&beams, u64::MAX);
    assert!(!estimate.is_lost());
}

#[test]
fn the_widening_decays_by_alpha_at_standstill_too() {
    let mut estimate = estimate();
    let lag = 0.4 / 0.6 * 0.25;
    assert!((estimate.radius_m() - 0.25 - lag).abs() < 1e-9);
    estimate.begin_step(&Se2::identity());
    assert!((estimate.radius_m() - 0.25 - 0.4 * lag).abs() < 1e-9);
}

#[test]
fn a_stopped_robot_keeps_its_handler() {
    let mut estimate = estimate();
    estimate.begin_step(&Se2::identity());
    // Half of the forward action, then a stop: the handler is where the half leads to.
    estimate.predict(&se2(Pose2::new(0.125, 0.0, 0.0)), 1.0);
    assert!((estimate.robot_from_handler().translation.x - (-0.75 - 0.4 * 0.125)).abs() < 1e-9);
}

#[test]
fn a_rod_may_point_anywhere_and_is_followed_there() {
    let rod = RotatingRod::new(-0.3, 0.0, 0.8).expect("a rod");
    let limits = HandlerLimits { radius_m: 0.25, seen_radius_m: 0.25, speed_max_mps: 0.5, not_seen_ns: 1_000_000_000 };
    let mut estimate = HandlerEstimate::new(InteractionModel::Rod(rod), limits);
    assert!(estimate.radius_m() > 1.0, "their place is unknown: {}", estimate.radius_m());
    for i in 0..30 {
        let _ = estimate.correct(&scan_of(Some(Point::new(-1.1, 0.0))), i);
    }
    // The robot turns on the spot by a quarter, and the handler stands behind as far as the rod lets them.
    let by = Se2::rotation(std::f64::consts::FRAC_PI_2 / 18.0);
    let (mut turned, mut truth) = (Se2::identity(), se2(Pose2::new(-1.1, 0.0, 0.0)));
    for i in 1..=18 {
        estimate.begin_step(&turned);
        truth = estimate.model().step(&truth, &by);
        turned *= by;
        estimate.predict(&turned, 1.0);
        let seen = Point::from(truth.translation.vector);
        for n in 0..5 {
            assert_eq!(estimate.correct(&scan_of(Some(seen)), 100 * i + n), Sighting::Seen, "turn {i}");
        }
        let error = (estimate.robot_from_handler().translation.vector - seen.coords).norm();
        assert!(error < 0.06, "turn {i}: off by {error} m");
    }
    let default = estimate.model().robot_from_default().translation.vector;
    assert!((truth.translation.vector - default).norm() > 0.4, "far beyond any leash about the default");
}

#[test]
fn a_handler_who_moves_is_expected_on_by_the_next_scan_and_one_not_seen_nowhere() {
    let mut estimate = estimate();
    for (n, x_m) in [-0.80, -0.75].into_iter().enumerate() {
        let _ = estimate.correct(&scan_of(Some(Point::new(x_m, -0.35))), n as u64);
    }
    let seen = estimate.body(0.01).seen.expect("seen");
    assert!((seen.at - Point::new(-0.75, -0.35)).norm() < 0.02, "{seen:?}");
    assert!((seen.next - seen.at - nalgebra::Vector2::new(0.0625, 0.0)).norm() < 0.02, "{seen:?}");
    // Where the robot turns on the spot, they stay where they are.
    estimate.predict(&se2(Pose2::new(0.0, 0.0, 0.1)), 1.0);
    let turned = estimate.body(0.01).seen.expect("seen");
    assert!((se2(Pose2::new(0.0, 0.0, 0.1)) * turned.at - seen.at).norm() < 1e-9);
    let _ = estimate.correct(&scan_of(None), 2);
    assert_eq!(estimate.body(0.01).seen, None);
}
