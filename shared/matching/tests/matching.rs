//! What the corrector makes of worlds whose truth is known.

mod common;

use common::{Place, SCAN_NS, config, header, odometry, walk};
use guidance::Disc;
use guidance::se2::{Point, Se2, pose2, se2};
use guidedog_matching::{Corrected, Refusal};
use messages::{Pose2, ScanHeader};
use nalgebra::Vector2;
use proptest::prelude::*;

fn motion(x_m: f64, y_m: f64, yaw_rad: f64) -> Se2 {
    Se2::new(Vector2::new(x_m, y_m), yaw_rad)
}

fn nobody(_: u64) -> Vec<Point> {
    Vec::new()
}

/// How far one pose is from another: metres, radians.
fn off(a: &Se2, b: &Se2) -> (f64, f64) {
    let off = a.inverse() * b;
    (off.translation.vector.norm(), off.rotation.angle().abs())
}

#[test]
fn a_displacement_in_a_room_is_found_to_the_millimetre() {
    for said in [motion(0.1, 0.02, 0.06), motion(0.1, -0.05, 0.04), motion(0.05, 0.06, 0.01)] {
        let (corrected, _, truth) = walk(&Place::room(), 2, [motion(0.05, 0.02, 0.03), said], 0.0, nobody);
        let (way_m, turn_rad) = off(corrected.matched(), &truth);
        assert!(way_m < 0.002 && turn_rad < 0.001, "{said}: {way_m} m, {turn_rad} rad");
        assert_eq!((corrected.health().accepted, corrected.health().unseen_rad), (2, None));
        assert!(corrected.health().inlier_share > 0.9, "{:?}", corrected.health());
    }
}

#[test]
fn a_robot_that_slips_is_put_right_through_noise() {
    // 2 m round a bend; the legs have a fifth too much of the way and lose 23 degrees of the turn.
    let steps = [motion(0.05, 0.0, 0.02), motion(0.06, 0.0, 0.01)];
    let (corrected, _, truth) = walk(&Place::room(), 41, steps, 0.04, nobody);
    let raw = (0..40).fold(Se2::identity(), |pose, _| pose * steps[1]);
    let (way_m, turn_rad) = off(corrected.matched(), &truth);
    assert!(off(&raw, &truth).0 > 0.3 && off(&raw, &truth).1 > 0.35);
    assert!(way_m < 0.03 && turn_rad < 0.015, "{way_m} m, {turn_rad} rad, {:?}", corrected.health());
    assert_eq!(corrected.health().refused, 0);
}

#[test]
fn along_a_bare_corridor_the_legs_stay_right_and_across_it_the_walls() {
    let steps = [motion(0.05, 0.0, 0.0), motion(0.05, 0.005, 0.004)];
    let (corrected, out, truth) = walk(&Place::corridor(), 101, steps, 0.04, nobody);
    let at = pose2(corrected.matched());
    assert!((at.x_m - truth.translation.x).abs() < 0.1, "{at:?}");
    assert!(at.y_m.abs() < 0.03 && at.yaw_rad.abs() < 0.01, "{at:?}");
    let unseen_rad = corrected.health().unseen_rad.expect("nothing tells the way along it");
    assert!(unseen_rad.sin().abs() < 0.1, "{unseen_rad}");
    // After 5 m nobody knows the way along to better than the legs do; across it the walls say it.
    assert!(out.sigma[0] > 0.25 && out.sigma[1] < 0.2 && out.sigma[2] < 0.1, "{:?}", out.sigma);
}

#[test]
fn somebody_who_walks_by_drags_nothing_along() {
    // The robot stands; three people walk past in a row, at 1 m/s.
    let still = [Se2::identity(), Se2::identity()];
    let people = |step: u64| [0.0, 0.5, 1.0].map(|behind| Point::new(0.1 * step as f64 - 2.0 - behind, 1.0)).to_vec();
    let (corrected, _, truth) = walk(&Place::room(), 50, still, 0.04, people);
    let (way_m, turn_rad) = off(corrected.matched(), &truth);
    assert!(way_m < 0.01 && turn_rad < 0.005, "{way_m} m, {turn_rad} rad");
}

#[test]
fn a_body_that_comes_along_holds_the_match_back_unless_it_is_left_out() {
    let steps = [motion(0.05, 0.0, 0.0), motion(0.05, 0.0, 0.0)];
    let mut corrected = [Vec::new(), vec![Disc { center: Point::new(-0.7, 0.0), radius_m: 0.5 }]].map(|left_out| {
        let mut config = config();
        config.matcher.left_out = left_out;
        Corrected::new(config)
    });
    let mut robot = Se2::identity();
    for step in 1..=60 {
        let mut place = Place::corridor();
        let body = |y_m: f64| [robot * Point::new(-0.6, y_m - 0.2), robot * Point::new(-0.6, y_m + 0.2)];
        place.walls.extend([-0.2, 0.2].map(body));
        let (header, ranges_m) = place.scan(step * SCAN_NS, &robot, 0.02);
        for corrected in &mut corrected {
            corrected.take_scan(&header, &ranges_m);
            corrected.take_odometry(&odometry(step * SCAN_NS, &robot));
            let _ = corrected.work();
        }
        if step < 60 {
            robot *= steps[0];
        }
    }
    let [held, free] = corrected.map(|corrected| (corrected.matched().translation.x - robot.translation.x).abs());
    assert!(free < 0.02, "{free}");
    assert!(held > 10.0 * free.max(0.005), "the world of this test would show it: {held}");
}

#[test]
fn what_goes_out_is_continuous_and_comes_to_the_matched_pose() {
    let (mut corrected, place) = (Corrected::new(config()), Place::room());
    let (mut last, mut most) = (None::<Se2>, 0.0_f64);
    for step in 1..=100_u64 {
        // The legs stumble by 20 cm and 6 degrees, once, though the robot stands.
        let leg = if step < 20 { Se2::identity() } else { motion(0.2, 0.0, 0.1) };
        let (header, ranges_m) = place.scan(step * SCAN_NS, &Se2::identity(), 0.02);
        corrected.take_scan(&header, &ranges_m);
        let out = corrected.take_odometry(&odometry(step * SCAN_NS, &leg));
        let _ = corrected.work();
        let now = se2(out.odom_from_robot);
        if step != 20
            && let Some(last) = last
        {
            let (way_m, turn_rad) = off(&last, &now);
            most = most.max(way_m);
            assert!(way_m <= 0.005 + 1e-6 && turn_rad <= 0.01 + 1e-6, "step {step}: {way_m} m, {turn_rad} rad");
        }
        if step == 22 {
            assert!(out.sigma[0] > 0.15, "it knows that it is not there yet: {:?}", out.sigma);
        }
        last = Some(now);
    }
    assert!(most > 0.004, "the correction was fed in");
    let (way_m, turn_rad) = off(&last.expect("there were poses"), &Se2::identity());
    assert!(way_m < 0.01 && turn_rad < 0.005, "{way_m} m, {turn_rad} rad");
    assert!(corrected.pending().0 < 0.01);
}

#[test]
fn a_lidar_that_is_stuck_or_says_nothing_is_refused_and_the_legs_go_on() {
    let place = Place::room();
    let (header_1, ranges_m) = place.scan(SCAN_NS, &Se2::identity(), 0.02);
    let unknown = vec![f32::NAN; 360];
    let cases: [(&str, &[f32]); 4] =
        [("stuck", &ranges_m), ("unknown", &unknown), ("empty", &[]), ("zero", &[0.0; 360])];
    for (name, ranges_m) in cases {
        let mut corrected = Corrected::new(config());
        corrected.take_scan(&header_1, &place.scan(SCAN_NS, &Se2::identity(), 0.02).1);
        corrected.take_odometry(&odometry(SCAN_NS, &Se2::identity()));
        assert_eq!(corrected.work(), Ok(()));
        for step in 2..=30 {
            let leg = motion(0.05 * (step - 1) as f64, 0.0, 0.0);
            corrected.take_scan(&ScanHeader { ..header(step * SCAN_NS) }, ranges_m);
            let out = corrected.take_odometry(&odometry(step * SCAN_NS, &leg));
            let refused = corrected.work();
            assert!(refused.is_err(), "{name}: {refused:?}");
            assert!((out.odom_from_robot.x_m - leg.translation.x).abs() < 1e-9, "{name}: {out:?}");
        }
        let health = corrected.health();
        assert_eq!((health.accepted, health.refused, health.refused_in_a_row), (1, 29, 29), "{name}");
        assert_eq!(name == "stuck", health.last_refusal == Some(Refusal::Repeated));
        let sigma = corrected.take_odometry(&odometry(31 * SCAN_NS, &motion(1.5, 0.0, 0.0))).sigma;
        assert!(sigma[0] > 0.15, "{name}: the legs alone are not trusted with less, {sigma:?}");
    }
}

#[test]
fn another_world_is_refused_first_and_begun_anew_then() {
    let (mut corrected, room) = (Corrected::new(config()), Place::room());
    let mut elsewhere = room.clone();
    // Somebody carries it 1.5 m aside, into the same room turned by a right angle.
    let turned = motion(1.5, 0.7, std::f64::consts::FRAC_PI_2);
    elsewhere.walls.iter_mut().flatten().for_each(|end| *end = turned * *end);
    for step in 1..=60_u64 {
        let place = if step < 20 { &room } else { &elsewhere };
        let (header, ranges_m) = place.scan(step * SCAN_NS, &Se2::identity(), 0.02);
        corrected.take_scan(&header, &ranges_m);
        corrected.take_odometry(&odometry(step * SCAN_NS, &Se2::identity()));
        let _ = corrected.work();
    }
    let health = corrected.health();
    assert!(health.refused >= 5 && health.restarts >= 1 && health.refused_in_a_row == 0, "{health:?}");
    assert!(off(corrected.matched(), &Se2::identity()).0 < 0.1, "nothing led it there: {}", corrected.matched());
}

#[test]
fn without_scans_the_pose_is_the_legs_own_and_less_and_less_certain() {
    let mut corrected = Corrected::new(config());
    let mut last = 0.0;
    for step in 1..=50_u64 {
        let leg = motion(0.05 * step as f64, 0.0, 0.01 * step as f64);
        let raw = odometry(step * SCAN_NS, &leg);
        let out = corrected.take_odometry(&raw);
        assert!(off(&se2(out.odom_from_robot), &leg).0 < 1e-9 && out.header == raw.header);
        assert!(step == 1 || out.sigma[0] > last, "{step}: {:?}", out.sigma);
        last = out.sigma[0];
    }
    assert!(last > 0.2, "{last}");
    let nan = messages::Odometry {
        odom_from_robot: Pose2::new(f64::NAN, 0.0, 0.0),
        ..odometry(60 * SCAN_NS, &Se2::identity())
    };
    assert!(corrected.take_odometry(&nan).odom_from_robot.x_m.is_nan(), "whoever reads it has to judge it");
    assert!(corrected.take_odometry(&odometry(61 * SCAN_NS, &Se2::identity())).odom_from_robot.is_finite());
}

fn readings() -> impl Strategy<Value = Vec<f32>> {
    let reading = prop_oneof![any::<f32>(), 0.0..30.0_f32, Just(f32::NAN), Just(2.0_f32)];
    prop::collection::vec(reading, 0..400)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Turning and moving the frame of the legs turns and moves the answer, and nothing else.
    #[test]
    fn the_frame_of_the_legs_makes_no_difference(x_m in -50.0..50.0, y_m in -50.0..50.0, yaw_rad in -3.1..3.1) {
        let frame = motion(x_m, y_m, yaw_rad);
        let place = Place::room();
        let (mut here, mut there) = (Corrected::new(config()), Corrected::new(config()));
        for step in 1..=15_u64 {
            let share = step as f64;
            let (header, ranges_m) = place.scan(step * SCAN_NS, &motion(0.05 * share, 0.0, 0.02 * share), 0.03);
            let leg = motion(0.06 * share, 0.005 * share, 0.018 * share);
            for (corrected, leg) in [(&mut here, leg), (&mut there, frame * leg)] {
                corrected.take_scan(&header, &ranges_m);
                corrected.take_odometry(&odometry(step * SCAN_NS, &leg));
                let _ = corrected.work();
            }
        }
        prop_assert_eq!(here.health().accepted, there.health().accepted);
        let (way_m, turn_rad) = off(&(frame * here.matched()), there.matched());
        prop_assert!(way_m < 1e-3 && turn_rad < 1e-3, "{} m, {} rad", way_m, turn_rad);
    }

    /// Whatever comes: no panic, no pose that is none, and every scan counted.
    #[test]
    fn no_scan_breaks_it(
        scans in prop::collection::vec((readings(), -7.0..7.0, -0.5..0.5, any::<bool>()), 1..12),
    ) {
        let (mut corrected, place) = (Corrected::new(config()), Place::room());
        for (step, (ranges_m, angle_min_rad, angle_increment_rad, is_good)) in (1..).zip(scans) {
            let leg = motion(0.05 * step as f64, 0.0, 0.0);
            let good = place.scan(step * SCAN_NS, &leg, 0.02);
            let bad = (ScanHeader { angle_min_rad, angle_increment_rad, ..header(step * SCAN_NS) }, ranges_m);
            let (header, ranges_m) = if is_good { good } else { bad };
            corrected.take_scan(&header, &ranges_m);
            let out = corrected.take_odometry(&odometry(step * SCAN_NS, &leg));
            let _ = corrected.work();
            prop_assert!(out.odom_from_robot.is_finite() && out.sigma.iter().all(|sigma| sigma.is_finite()));
            prop_assert!(pose2(corrected.matched()).is_finite());
            prop_assert_eq!(corrected.health().accepted + corrected.health().refused, step);
        }
    }
}
