//! What holds of the shield in every case, held against truths that know nothing of how it is done.
//!
//! Ten thousand cases each, or as many as `PROPTEST_CASES` says: `scripts/nightly` asks for a million.

use std::f64::consts::{PI, TAU};

use guidedog_guidance::boundary::{Boundary, Directions};
use guidedog_guidance::interaction::place;
use guidedog_guidance::se2::{Point, Se2, exp, log, pose2, se2};
use guidedog_guidance::shield::suppress;
use guidedog_guidance::{
    Beams, Disc, EdgeDistance, Evidence, HandlerBody, Hull, Judgement, Motion, Reach, Shield, ShieldConfig,
};
use messages::{Pose2, ScanHeader, UnsafeCause};
use nalgebra::Vector2;
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;

fn cases() -> ProptestConfig {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    let cases = asked.unwrap_or(10_000);
    let failure_persistence = Some(Box::new(FileFailurePersistence::WithSource("regressions")) as Box<_>);
    ProptestConfig { cases, max_global_rejects: cases.saturating_mul(10), failure_persistence, ..Default::default() }
}

/// One moment: a scan of any layout from any mount, robot and handler of any size, and one motion.
#[derive(Debug, Clone)]
struct Moment {
    header: ScanHeader,
    readings_m: Vec<f64>,
    robot_radius_m: f64,
    handler: Pose2,
    handler_radius_m: f64,
    mask_radius_m: Option<f64>,
    robot_end: Pose2,
    handler_end: Pose2,
}

fn pose(xy_m: f64, yaw_rad: f64) -> impl Strategy<Value = Pose2> {
    (-xy_m..xy_m, -xy_m..xy_m, -yaw_rad..yaw_rad).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
}

/// Layouts: a whole turn or a sector, either way around, from any angle on; or a turn whose last beam is the first once
/// more, or goes beyond it by up to half a beam.
fn layout() -> impl Strategy<Value = (f64, f64, usize)> {
    let field_rad = prop_oneof![2 => Just(TAU), 2 => 0.2..6.0f64, 1 => Just(0.0), 1 => -0.5..0.0f64];
    let first_rad = prop_oneof![-7.0..7.0f64, Just(0.0), Just(-PI), Just(PI)];
    (3usize..120, first_rad, field_rad, any::<bool>()).prop_map(|(count, first_rad, field_rad, clockwise)| {
        // Not over 0: by how much of a beam the last one goes beyond the first, a turn later.
        let turns_over = TAU / (count as f64 - 1.0 + field_rad * 0.9);
        let increment_rad = if field_rad > 0.0 { field_rad / count as f64 } else { turns_over };
        (first_rad, if clockwise { -increment_rad } else { increment_rad }, count)
    })
}

/// `mount_m`: how far the lidar is from the robot's middle at most.
fn moment(mount_m: f64) -> impl Strategy<Value = Moment> {
    let bodies = (0.05..0.6f64, pose(1.2, PI), 0.05..0.6f64, proptest::option::of(0.0..0.3f64));
    (layout(), pose(mount_m, PI), bodies, pose(0.4, 0.6), pose(1.2, PI))
        .prop_flat_map(|(layout, mount, bodies, robot_end, handler_end)| {
            let readings = proptest::collection::vec(0.05..4.0f64, layout.2);
            (Just((layout, mount, bodies, robot_end, handler_end)), readings)
        })
        .prop_map(|((layout, mount, bodies, robot_end, handler_end), readings_m)| Moment {
            header: ScanHeader {
                angle_min_rad: layout.0,
                angle_increment_rad: layout.1,
                range_min_m: 0.01,
                range_max_m: 12.0,
                robot_from_lidar: mount,
                ..ScanHeader::default()
            },
            readings_m,
            robot_radius_m: bodies.0,
            handler: bodies.1,
            handler_radius_m: bodies.2,
            mask_radius_m: bodies.3.map(|margin_m| bodies.2 + margin_m),
            robot_end,
            handler_end,
        })
}

fn disc(pose: Pose2, radius_m: f64) -> Disc {
    Disc { center: Point::new(pose.x_m, pose.y_m), radius_m }
}

impl Moment {
    fn discs(&self) -> [Disc; 4] {
        let (robot_m, handler_m) = (self.robot_radius_m, self.handler_radius_m);
        [
            disc(Pose2::default(), robot_m),
            disc(self.handler, handler_m),
            disc(self.robot_end, robot_m),
            disc(self.handler_end, handler_m),
        ]
    }

    fn beams(&self) -> Beams {
        let mut beams = Beams::default();
        beams.fill_with(&self.header, self.readings_m.len(), |i| self.readings_m[i]).expect("usable");
        beams
    }

    /// By the paper's algorithm: no escape rule, no memory.
    fn judge(&self) -> Judgement {
        self.judge_by(false)
    }

    fn judge_by(&self, escape: bool) -> Judgement {
        self.judge_with(ShieldConfig { escape, ..self.config() })
    }

    fn config(&self) -> ShieldConfig {
        ShieldConfig {
            robot_radius_m: self.robot_radius_m,
            margin_m: 0.0,
            unknown_gap_m: 0.1,
            escape: false,
            unseen_limit_m2: None,
            back_from_edges_m: None,
            reach: Reach::default(),
            edges: EdgeDistance::default(),
        }
    }

    fn judge_with(&self, config: ShieldConfig) -> Judgement {
        let mut shield = Shield::new(config);
        let motion = Motion::new(se2(self.robot_end), se2(self.handler_end));
        let mut judgements = Vec::new();
        let beams = self.beams();
        shield.judge_motions([motion].into_iter(), Evidence::scan(&beams), self.body(), &mut judgements);
        judgements[0]
    }

    fn body(&self) -> HandlerBody {
        HandlerBody {
            center: disc(self.handler, 0.0).center,
            radius_m: self.handler_radius_m,
            mask_radius_m: self.mask_radius_m,
            seen: None,
        }
    }

    /// Where each beam that is judged ends, by the lidar's own number: nothing of [`Beams`] in it.
    fn ends(&self) -> Vec<(usize, Point)> {
        let lidar = se2(self.header.robot_from_lidar);
        let end = |i: usize| {
            let angle = self.header.angle_min_rad + i as f64 * self.header.angle_increment_rad;
            lidar * Point::new(self.readings_m[i] * angle.cos(), self.readings_m[i] * angle.sin())
        };
        let mask_m = self.mask_radius_m.unwrap_or(-1.0);
        let ends = (0..self.readings_m.len()).map(|i| (i, end(i)));
        ends.filter(|(_, end)| (end - disc(self.handler, 0.0).center).norm() > mask_m).collect()
    }

    /// By how much robot or handler come nearer to a point on their way, metres.
    fn comes_nearer_m(&self, point: Point) -> f64 {
        let twist = log(&se2(self.robot_end), 1.0);
        let (from, to) = (disc(self.handler, 0.0).center, disc(self.handler_end, 0.0).center);
        let way = (0..=1000).map(|i| {
            let share = f64::from(i) / 1000.0;
            let (robot, handler) = (place(&exp(twist, share)), from + (to - from) * share);
            (point.coords.norm() - (point - robot).norm()).max((point - from).norm() - (point - handler).norm())
        });
        way.fold(f64::MIN, f64::max)
    }

    /// The part of the hull that no beam sees, where each beam stands for half an increment to either side, square
    /// metres.
    fn unseen_area_m2(&self, hull: &Hull) -> f64 {
        let lidar = se2(self.header.robot_from_lidar);
        let (origin, increment_rad) = (place(&lidar), self.header.angle_increment_rad);
        let count = self.readings_m.len();
        let way = |angle: f64| lidar.rotation * Vector2::new(angle.cos(), angle.sin());
        let mut unseen_m2 = 0.0;
        for i in 0..count {
            let direction = way(self.header.angle_min_rad + i as f64 * increment_rad);
            let threshold_m = hull.threshold_m(origin, direction);
            let reading_m = if self.readings_m[i].is_nan() { 0.0 } else { self.readings_m[i] };
            unseen_m2 += (threshold_m.powi(2) - reading_m.min(threshold_m).powi(2)) * increment_rad.abs() / 2.0;
        }
        let rest_rad = TAU - count as f64 * increment_rad.abs();
        if rest_rad > increment_rad.abs() / 2.0 {
            let steps = 4000;
            let begin = self.header.angle_min_rad + (count as f64 - 0.5) * increment_rad;
            for i in 0..steps {
                let angle = begin + increment_rad.signum() * rest_rad * (f64::from(i) + 0.5) / f64::from(steps);
                unseen_m2 += hull.threshold_m(origin, way(angle)).powi(2) / 2.0 * rest_rad / f64::from(steps);
            }
        }
        unseen_m2
    }

    fn lidar_is_inside(&self) -> bool {
        Hull::new(self.discs()).signed_distance_m(place(&se2(self.header.robot_from_lidar))) < -1e-6
    }
}

/// Corners of a polygon that lies within the hull and misses it by under 20 um, by parry's convex hull.
fn polygon(discs: &[Disc; 4]) -> Vec<Point> {
    let corners = discs.iter().flat_map(|disc| {
        (0..360).map(move |i| {
            let angle = TAU * f64::from(i) / 360.0;
            let corner = disc.center + Vector2::new(angle.cos(), angle.sin()) * disc.radius_m;
            parry2d_f64::math::Vector::new(corner.x, corner.y)
        })
    });
    let corners: Vec<_> = corners.collect();
    parry2d_f64::transformation::convex_hull(&corners).iter().map(|p| Point::new(p.x, p.y)).collect()
}

/// Where a ray enters a convex polygon and where it leaves it; none where it misses it.
fn crossing(polygon: &[Point], origin: Point, direction: Vector2<f64>) -> Option<(f64, f64)> {
    let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        let inwards = Vector2::new(-(b - a).y, (b - a).x);
        let (ahead, inside) = (inwards.dot(&direction), inwards.dot(&(origin - a)));
        if ahead.abs() < 1e-15 {
            if inside < 0.0 {
                return None;
            }
        } else if ahead > 0.0 {
            enters = enters.max(-inside / ahead);
        } else {
            leaves = leaves.min(-inside / ahead);
        }
    }
    (enters < leaves && leaves > 0.0).then_some((enters, leaves))
}

/// The widest run of unknown beams beyond the present hull, metres, and by how much the nearest beam decides on that
/// question of beyond or not, metres.
fn widest_unknown_chord(moment: &Moment) -> (f64, f64) {
    let [robot, handler, ..] = moment.discs();
    let (present, swept) = (Hull::new([robot, handler, robot, handler]), Hull::new(moment.discs()));
    let lidar = se2(moment.header.robot_from_lidar);
    let (count, increment_rad) = (moment.readings_m.len(), moment.header.angle_increment_rad);
    let mut closest_m = f64::INFINITY;
    let beyond: Vec<Option<f64>> = (0..count)
        .map(|i| {
            let angle = moment.header.angle_min_rad + i as f64 * increment_rad;
            let direction = lidar.rotation * Vector2::new(angle.cos(), angle.sin());
            let (at, before) =
                (swept.threshold_m(place(&lidar), direction), present.threshold_m(place(&lidar), direction));
            if moment.readings_m[i].is_nan() {
                closest_m = closest_m.min((at - before - 1e-9).abs());
            }
            (moment.readings_m[i].is_nan() && at > before + 1e-9).then_some(at)
        })
        .collect();
    let whole_turn = increment_rad.abs() * (count as f64 + 0.5) >= TAU;
    let mut widest_m = 0.0f64;
    // From every beam on, as long as the run goes; over the end only where the lidar sees all around.
    for first in 0..count {
        let (mut n, mut farthest_m) = (0usize, 0.0f64);
        while n < count && (whole_turn || first + n < count) {
            let Some(threshold_m) = beyond[(first + n) % count] else { break };
            farthest_m = farthest_m.max(threshold_m);
            n += 1;
            let half_rad = (n as f64 * increment_rad.abs() / 2.0).min(PI / 2.0);
            widest_m = widest_m.max(2.0 * farthest_m * half_rad.sin());
        }
    }
    (widest_m, closest_m)
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn a_seen_point_is_unsafe_exactly_where_it_is_inside_the_hull(moment in moment(0.5)) {
        prop_assume!(moment.lidar_is_inside());
        let hull = Hull::new(moment.discs());
        let judgement = moment.judge();
        let depths: Vec<f64> = moment.ends().iter().map(|(_, end)| hull.signed_distance_m(*end)).collect();
        let deepest = depths.iter().copied().fold(f64::INFINITY, f64::min);
        if deepest < -1e-9 {
            prop_assert!(!judgement.safe, "a point {} m inside is judged free", -deepest);
            prop_assert_eq!(judgement.cause, UnsafeCause::Beam);
        } else if deepest > 1e-3 {
            prop_assert!(judgement.safe, "the nearest point is {deepest} m outside: {:?}", judgement);
        }
        // The beam that is named is one of those judged, and its figures add up.
        if let Some(beam) = judgement.beam {
            prop_assert!(moment.ends().iter().any(|(i, _)| *i == beam));
            prop_assert!((judgement.reading_m - moment.readings_m[beam]).abs() < 1e-12);
            prop_assert!((judgement.reading_m - judgement.threshold_m - judgement.margin_m).abs() < 1e-9);
        }
    }

    #[test]
    fn from_outside_whatever_occludes_the_hull_is_unsafe(moment in moment(3.0)) {
        let polygon = polygon(&moment.discs());
        let lidar = se2(moment.header.robot_from_lidar);
        prop_assume!(Hull::new(moment.discs()).signed_distance_m(place(&lidar)) > 1e-3);
        let judgement = moment.judge();
        let (mut occluded, mut clear) = (false, true);
        for (i, _) in moment.ends() {
            let angle = moment.header.angle_min_rad + i as f64 * moment.header.angle_increment_rad;
            let direction = lidar.rotation * Vector2::new(angle.cos(), angle.sin());
            let Some((enters, leaves)) = crossing(&polygon, place(&lidar), direction) else { continue };
            // A ray that only grazes is neither.
            occluded |= moment.readings_m[i] < leaves - 1e-3;
            clear &= moment.readings_m[i] > leaves + 1e-3 && leaves - enters > 0.05;
        }
        let grazes = moment.readings_m.iter().enumerate().any(|(i, _)| {
            let angle = moment.header.angle_min_rad + i as f64 * moment.header.angle_increment_rad;
            let direction = lidar.rotation * Vector2::new(angle.cos(), angle.sin());
            let side = |p: &Point| direction.perp(&(p - place(&lidar)));
            let (low, high) = polygon.iter().map(side).fold((f64::MAX, f64::MIN), |(a, b), s| (a.min(s), b.max(s)));
            low.abs() < 1e-3 || high.abs() < 1e-3
        });
        if occluded {
            prop_assert!(!judgement.safe, "the hull is occluded: {:?}", judgement);
        } else if clear && !grazes {
            prop_assert!(judgement.safe, "nothing stands before the hull or in it: {:?}", judgement);
        }
    }

    #[test]
    fn thresholds_are_where_a_ray_leaves_parrys_hull(
        moment in moment(0.5), count in 3usize..200, first in -7.0..7.0f64,
    ) {
        prop_assume!(moment.lidar_is_inside());
        let origin = place(&se2(moment.header.robot_from_lidar));
        let angles: Vec<f64> = (0..count).map(|i| first + TAU * i as f64 / count as f64).collect();
        let (x, y): (Vec<f64>, Vec<f64>) = angles.iter().map(|angle| (angle.cos(), angle.sin())).unzip();
        let beams = Directions { x: &x, y: &y, first_rad: first, increment_rad: TAU / count as f64 };
        let discs = moment.discs();
        let boundary = Boundary::of(&discs);
        let seen = boundary.seen_from(origin);
        prop_assume!(seen.is_some());
        let mut thresholds = Vec::new();
        seen.expect("assumed").over(beams).thresholds_m(&mut thresholds);
        let (polygon, hull) = (polygon(&discs), Hull::new(discs));
        for i in 0..count {
            let direction = Vector2::new(x[i], y[i]);
            // The polygon lies within the hull by up to 0.6 (1 - cos(0.5 deg)) = 23 um, along the boundary's normal.
            let end = origin + direction * thresholds[i];
            prop_assert!(hull.signed_distance_m(end).abs() < 1e-9, "not on the boundary: {}", thresholds[i]);
            match crossing(&polygon, origin, direction) {
                Some((_, leaves)) => prop_assert!(leaves < thresholds[i] + 1e-9
                    && hull.signed_distance_m(origin + direction * leaves) > -3e-5, "{leaves} {}", thresholds[i]),
                // Only from between the polygon and the boundary.
                None => prop_assert!(hull.signed_distance_m(origin) > -3e-5),
            }
        }
    }

    #[test]
    fn turning_or_mirroring_everything_changes_no_verdict(moment in moment(1.0), turn in -PI..PI) {
        let judgement = moment.judge();
        prop_assume!(judgement.margin_m.abs() > 1e-6);
        let rotation = Se2::rotation(turn);
        let about = |pose: Pose2| pose2(&(rotation * se2(pose) * rotation.inverse()));
        let turned = Moment {
            header: ScanHeader {
                robot_from_lidar: pose2(&(rotation * se2(moment.header.robot_from_lidar))), ..moment.header
            },
            handler: about(moment.handler),
            robot_end: about(moment.robot_end),
            handler_end: about(moment.handler_end),
            ..moment.clone()
        };
        let mirror = |pose: Pose2| Pose2::new(pose.x_m, -pose.y_m, -pose.yaw_rad);
        let mirrored = Moment {
            header: ScanHeader {
                robot_from_lidar: mirror(moment.header.robot_from_lidar),
                angle_min_rad: -moment.header.angle_min_rad,
                angle_increment_rad: -moment.header.angle_increment_rad,
                ..moment.header
            },
            handler: mirror(moment.handler),
            robot_end: mirror(moment.robot_end),
            handler_end: mirror(moment.handler_end),
            ..moment.clone()
        };
        for other in [turned, mirrored].map(|moment| moment.judge()) {
            prop_assert_eq!(judgement.safe, other.safe);
            let same = judgement.margin_m == other.margin_m || (judgement.margin_m - other.margin_m).abs() < 1e-6;
            // A ray that grazes a hull that the lidar is outside of meets it or not by rounding.
            prop_assert!(same || !moment.lidar_is_inside(), "{} {}", judgement.margin_m, other.margin_m);
        }
    }

    #[test]
    fn moving_everything_changes_no_threshold(moment in moment(1.0), dx in -5.0..5.0f64, dy in -5.0..5.0f64) {
        let shift = Vector2::new(dx, dy);
        let (origin, beams) = (place(&se2(moment.header.robot_from_lidar)), moment.beams());
        let here = Hull::new(moment.discs());
        let there = Hull::new(moment.discs().map(|disc| Disc { center: disc.center + shift, ..disc }));
        for beam in beams.beams() {
            let (a, b) = (here.threshold_m(origin, beam.direction), there.threshold_m(origin + shift, beam.direction));
            let grazes = !moment.lidar_is_inside();
            prop_assert!((a - b).abs() < 1e-6 || grazes, "{a} {b}");
        }
    }

    /// Points strictly inside the present hull forbid only what brings robot or handler nearer to them.
    #[test]
    fn the_escape_rule_allows_what_comes_no_nearer_and_nothing_else(moment in moment(0.5)) {
        prop_assume!(moment.lidar_is_inside());
        let [robot, handler, ..] = moment.discs();
        let (present, swept) = (Hull::new([robot, handler, robot, handler]), Hull::new(moment.discs()));
        let (mut forbidden, mut allowed) = (false, true);
        for (_, end) in moment.ends() {
            let (now_m, then_m) = (present.signed_distance_m(end), swept.signed_distance_m(end));
            let pressing = now_m < -1e-6;
            // A thousandth of the way is up to 2.4 mm long, and the nearest place lies beside one of them.
            let nearer_m = if pressing { moment.comes_nearer_m(end) } else { 0.0 };
            forbidden |= then_m < -1e-6 && (now_m > 1e-6 || (pressing && nearer_m > 1.001e-4));
            allowed &= then_m > 1e-6 || (pressing && nearer_m < 0.5e-4);
        }
        let judgement = moment.judge_by(true);
        prop_assert!(!(forbidden && judgement.safe), "forbidden, and judged safe");
        prop_assert!(!allowed || judgement.safe, "allowed, and judged unsafe: {:?}", judgement);
    }

    /// A run of n unknown beams beyond the present hull, t the largest threshold of them, is unsafe where
    /// 2 t sin(n inc / 2) is over the gap.
    #[test]
    fn a_run_of_unknown_beams_is_unsafe_where_its_chord_is_over_the_gap(
        moment in moment(0.5), unknown in proptest::collection::vec(prop_oneof![Just(true), any::<bool>()], 120),
        known in 0..120usize,
    ) {
        prop_assume!(moment.lidar_is_inside());
        let count = moment.readings_m.len();
        // What is known is free; one beam at least says something.
        let blind = |i: usize| i != known % count && unknown[i];
        let readings_m: Vec<f64> = (0..count).map(|i| if blind(i) { f64::NAN } else { 4.0 }).collect();
        let moment = Moment { readings_m, mask_radius_m: None, ..moment };
        let (chord_m, decides_by_m) = widest_unknown_chord(&moment);
        prop_assume!((chord_m - 0.1).abs() > 1e-6 && decides_by_m > 5e-10);
        let judgement = moment.judge();
        prop_assert_eq!(judgement.safe, chord_m <= 0.1, "the widest chord is {} m", chord_m);
        prop_assert_eq!(judgement.cause, if judgement.safe { UnsafeCause::None } else { UnsafeCause::Unknown });
    }

    #[test]
    fn what_no_beam_sees_of_the_hull_is_told_and_may_be_limited(
        moment in moment(0.5), unknown in proptest::collection::vec(0..4u8, 120),
    ) {
        prop_assume!(moment.lidar_is_inside());
        let blind = |(i, reading_m): (usize, f64)| if i > 0 && unknown[i] == 0 { f64::NAN } else { reading_m };
        let readings_m = moment.readings_m.iter().copied().enumerate().map(blind).collect();
        let moment = Moment { readings_m, ..moment };
        let truth_m2 = moment.unseen_area_m2(&Hull::new(moment.discs()));
        for escape in [false, true] {
            let judgement = moment.judge_by(escape);
            let told_m2 = judgement.unseen_area_m2;
            prop_assert!((told_m2 - truth_m2).abs() < 1e-3 * (1.0 + truth_m2), "{told_m2}, not {truth_m2}");
            for (limit_m2, limited) in [(told_m2 + 1e-6, false), (told_m2 - 1e-6, true)] {
                let by_limit = moment.judge_with(ShieldConfig {
                    escape, unseen_limit_m2: Some(limit_m2), ..moment.config()
                });
                prop_assert_eq!(by_limit.safe, judgement.safe && !limited);
                if judgement.safe && limited {
                    prop_assert_eq!(by_limit.cause, UnsafeCause::Unseen);
                }
            }
        }
    }

    #[test]
    fn from_outside_what_is_not_seen_is_the_hull_less_what_is(moment in moment(3.0)) {
        let hull = Hull::new(moment.discs());
        let lidar = se2(moment.header.robot_from_lidar);
        prop_assume!(hull.signed_distance_m(place(&lidar)) > 1e-3);
        let polygon = polygon(&moment.discs());
        let whole_m2: f64 = (0..polygon.len())
            .map(|i| polygon[i].coords.perp(&polygon[(i + 1) % polygon.len()].coords) / 2.0)
            .sum();
        let increment_rad = moment.header.angle_increment_rad;
        let seen_m2: f64 = (0..moment.readings_m.len())
            .filter_map(|i| {
                let angle = moment.header.angle_min_rad + i as f64 * increment_rad;
                let direction = lidar.rotation * Vector2::new(angle.cos(), angle.sin());
                let (enters, leaves) = crossing(&polygon, place(&lidar), direction)?;
                let reading_m = moment.readings_m[i].min(leaves);
                Some((reading_m.powi(2) - enters.max(0.0).powi(2)).max(0.0) * increment_rad.abs() / 2.0)
            })
            .sum();
        let (told_m2, truth_m2) = (moment.judge().unseen_area_m2, (whole_m2 - seen_m2).max(0.0));
        prop_assert!((told_m2 - truth_m2).abs() < 5e-3 * (1.0 + whole_m2), "{told_m2}, not {truth_m2}");
    }

    #[test]
    fn a_margin_is_as_larger_bodies(moment in moment(0.5), margin_m in 0.0..0.2f64, escape in any::<bool>()) {
        let larger = Moment {
            robot_radius_m: moment.robot_radius_m + margin_m,
            handler_radius_m: moment.handler_radius_m + margin_m,
            ..moment.clone()
        };
        let with_margin = moment.judge_with(ShieldConfig { margin_m, escape, ..moment.config() });
        prop_assert_eq!(with_margin, larger.judge_by(escape));
    }

    #[test]
    fn larger_bodies_are_never_safer(moment in moment(0.5), robot_m in 0.0..0.3f64, handler_m in 0.0..0.3f64) {
        let larger = Moment {
            robot_radius_m: moment.robot_radius_m + robot_m,
            handler_radius_m: moment.handler_radius_m + handler_m,
            ..moment.clone()
        };
        let (small, large) = (moment.judge(), larger.judge());
        prop_assert!(large.margin_m <= small.margin_m + 1e-9, "{} {}", large.margin_m, small.margin_m);
        prop_assert!(small.safe || !large.safe || small.margin_m > -1e-9);
    }

    #[test]
    fn a_greater_beta_never_takes_more_from_an_unsafe_action(
        weights in proptest::collection::vec(0.0..1.0f64, 2..10), mask in any::<u32>(),
        a in 0.0..=1.0f64, b in 0.0..=1.0f64,
    ) {
        let sum: f64 = weights.iter().sum();
        prop_assume!(sum > 1e-6);
        let p: Vec<f64> = weights.iter().map(|weight| weight / sum).collect();
        let mask = mask & ((1 << p.len()) - 1);
        let (less, more) = (suppress(&p, mask, a.min(b)), suppress(&p, mask, a.max(b)));
        let safe: f64 = (0..p.len()).filter(|i| mask >> i & 1 == 0).map(|i| p[i]).sum();
        prop_assume!(safe > 1e-9);
        for i in 0..p.len() {
            let grows = more.probabilities[i] - less.probabilities[i];
            let fine = if mask >> i & 1 == 1 { grows > -1e-12 } else { grows < 1e-12 };
            prop_assert!(fine, "action {i}: {grows}");
        }
        prop_assert!((more.probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    }
}
