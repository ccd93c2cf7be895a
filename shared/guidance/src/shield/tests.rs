use super::judging::nearest_on_arc;
use super::{
    Draw, EdgeDistance, Evidence, Judgement, Motion, Reach, Shield, ShieldConfig, choose, suppress, waits_at_edge,
};
use crate::action::ActionTable;
use crate::handler::{HandlerBody, HandlerEstimate, HandlerLimits, Seen};
use crate::hull::{Disc, Hull};
use crate::interaction::{DelayedHarness, Interaction, place};
use crate::memory::{Memory, MemoryConfig};
use crate::scan::Beams;
use crate::scan::tests::header;
use crate::se2::{Point, Se2, exp, pose2, se2};
use messages::{Pose2, ScanHeader, Twist2, UnsafeCause};
use proptest::prelude::*;

fn config(escape: bool) -> ShieldConfig {
    ShieldConfig {
        robot_radius_m: 0.3,
        margin_m: 0.0,
        unknown_gap_m: 0.1,
        escape,
        unseen_limit_m2: None,
        back_from_edges_m: None,
        reach: Reach::default(),
        edges: EdgeDistance::default(),
    }
}

fn handler() -> HandlerEstimate {
    let harness = DelayedHarness::new(Pose2::new(-0.75, -0.35, 0.0), 0.4, 0.5).expect("a harness");
    let limits = HandlerLimits { radius_m: 0.25, seen_radius_m: 0.25, speed_max_mps: 0.5, not_seen_ns: 1_000_000_000 };
    let mut handler = HandlerEstimate::new(harness, limits);
    for _ in 0..20 {
        handler.begin_step(&crate::Se2::identity());
    }
    handler
}

/// A scan in the open with a small thing at each point.
fn scan(header: &ScanHeader, count: usize, points: &[Point]) -> Beams {
    let mut ranges = vec![f32::INFINITY; count];
    for point in points {
        let angle = point.y.atan2(point.x) - header.angle_min_rad;
        let i = (angle / header.angle_increment_rad).round() as usize % count;
        ranges[i] = ranges[i].min(point.coords.norm() as f32);
    }
    let mut beams = Beams::default();
    beams.fill(header, &ranges).expect("usable");
    beams
}

fn judge(beams: &Beams, escape: bool) -> (u32, Vec<Judgement>) {
    let mut judgements = Vec::new();
    let table = ActionTable::eight();
    let mask = Shield::new(config(escape)).judge_actions(&table, Evidence::scan(beams), &handler(), &mut judgements);
    (mask, judgements)
}

#[test]
fn in_the_open_everything_is_safe() {
    let (mask, judgements) = judge(&scan(&header(), 360, &[]), true);
    assert_eq!(mask, 0);
    assert!(judgements.iter().all(|j| j.unseen_area_m2 < 1e-9));
}

#[test]
fn something_ahead_forbids_forward_and_says_by_which_beam() {
    let (mask, judgements) = judge(&scan(&header(), 360, &[Point::new(0.5, 0.0)]), true);
    assert_eq!(mask & 0b10, 0b10, "forward");
    assert_eq!(mask & 0b1, 0, "stop");
    let forward = judgements[1];
    assert_eq!(forward.beam, Some(180));
    assert!((forward.threshold_m - 0.55).abs() < 1e-6 && (forward.margin_m + 0.05).abs() < 1e-6, "{forward:?}");
}

#[test]
fn the_space_between_robot_and_handler_must_be_free() {
    let between = Point::new(-0.35, -0.16);
    let (mask, _) = judge(&scan(&header(), 360, &[between]), false);
    assert_eq!(mask, 0xff, "the paper's algorithm: a point in the present hull makes every action unsafe");
}

#[test]
fn with_the_escape_rule_only_getting_closer_is_unsafe() {
    // Ahead of the robot and within its disc: only what does not come closer is left.
    let (mask, _) = judge(&scan(&header(), 360, &[Point::new(0.28, 0.0)]), true);
    assert_eq!(mask & 0b10, 0b10, "forward comes closer");
    assert_eq!(mask & 0b1, 0, "stop does not");
}

#[test]
fn beams_on_the_handler_are_masked_and_others_are_not() {
    let on_handler = Point::new(-0.75 + 0.15, -0.35 + 0.12);
    assert_eq!(judge(&scan(&header(), 360, &[on_handler]), false).0, 0);
    let (_, judgements) = judge(&scan(&header(), 360, &[on_handler]), false);
    assert!(judgements[1].unseen_area_m2 > 0.0, "what is behind the handler is blind");
}

/// The model has drawn the estimate to where a handler should walk; this one has not come there yet.
#[test]
fn where_the_handler_was_seen_is_in_the_hull_and_is_no_obstacle() {
    let taken = handler().body(0.01);
    let at = Point::new(-0.75, -0.60);
    let late = HandlerBody { seen: Some(Seen { at, next: at, by_default_m: 0.83 }), ..taken };
    let motion = Motion::new(Se2::translation(0.25, 0.0), Se2::translation(-0.6, -0.35));
    let mut shield = Shield::new(config(false));
    let beside = Point::new(-0.75, -0.83);
    let mut holds = |body| Hull::new(shield.swept(&motion, Twist2::ZERO, body)).contains(beside);
    assert_eq!((holds(taken), holds(late)), (false, true));
    let mut is_safe = |point: Point, body| {
        let (beams, mut judgements) = (scan(&header(), 360, &[point]), Vec::new());
        shield.judge_motions([motion.clone()].into_iter(), Evidence::scan(&beams), body, &mut judgements);
        judgements[0].safe
    };
    let on_them = Point::new(-0.62, -0.68);
    assert!(is_safe(on_them, late), "it is the handler whom the beam meets");
    // Something between the two places is in the way.
    assert!(!is_safe(Point::new(-0.40, -0.40), late));
}

#[test]
fn a_wide_run_of_unknown_beams_ahead_is_unsafe_and_one_beam_is_not() {
    for (unknown, expected) in [(1usize, false), (40, true)] {
        let mut ranges = vec![9.0f32; 360];
        ranges[180 - unknown / 2..=180 + (unknown - 1) / 2].fill(f32::NAN);
        let mut beams = Beams::default();
        beams.fill(&header(), &ranges).expect("usable");
        let (mask, _) = judge(&beams, true);
        assert_eq!(mask & 0b10 != 0, expected, "{unknown} unknown beams ahead, forward");
        assert_eq!(mask & 0b1, 0, "stop needs nothing beyond the present hull");
    }
}

#[test]
fn a_run_of_unknown_beams_goes_on_over_the_end_of_a_whole_turn() {
    let mut header = header();
    header.angle_min_rad = 0.0;
    let mut ranges = vec![9.0f32; 360];
    ranges[..8].fill(f32::NAN);
    ranges[352..].fill(f32::NAN);
    let mut beams = Beams::default();
    beams.fill(&header, &ranges).expect("usable");
    // Eight beams make 2 x 0.55 sin(4 deg) = 0.077 m, sixteen 0.153 m.
    assert_eq!(judge(&beams, true).0 & 0b10, 0b10);
}

/// Forward by the beams that are unknown, of `count` beams of a degree from straight ahead on.
fn forward_is_unsafe(count: usize, unknown: &[std::ops::Range<usize>]) -> bool {
    let from_ahead = ScanHeader { angle_min_rad: 0.0, ..header() };
    let mut ranges = vec![9.0f32; count];
    unknown.iter().for_each(|run| ranges[run.clone()].fill(f32::NAN));
    judge_ranges(&from_ahead, &ranges) & 0b10 != 0
}

#[test]
fn only_the_run_that_begins_a_whole_turn_goes_on_from_its_end() {
    assert!(!forward_is_unsafe(360, &[0..4, 355..360]), "nine beams are 0.086 m");
    assert!(forward_is_unsafe(360, &[0..6, 354..360]), "twelve are 0.115 m");
    assert!(!forward_is_unsafe(360, &[4..10, 352..360]), "the first run begins after the turn");
    assert!(!forward_is_unsafe(350, &[0..8, 342..350]), "this turn is not whole");
}

#[test]
fn what_the_field_of_view_lacks_is_unseen_and_not_unsafe() {
    let mut front = header();
    front.angle_min_rad = -std::f64::consts::FRAC_PI_2;
    front.angle_increment_rad = std::f64::consts::PI / 180.0;
    let mut beams = Beams::default();
    beams.fill(&front, &[5.0; 181]).expect("usable");
    let (mask, judgements) = judge(&beams, true);
    assert_eq!(mask, 0);
    assert!(judgements[0].unseen_area_m2 > 0.3, "half the robot and all of the handler");
}

#[test]
fn a_lidar_outside_the_hull_takes_what_occludes_it_as_unsafe() {
    let mut outside = header();
    outside.robot_from_lidar = Pose2::new(2.0, 0.0, 0.0);
    let mut ranges = vec![9.0f32; 360];
    assert_eq!(judge_ranges(&outside, &ranges) & 0b10, 0);
    // Beam 0 looks back at the robot from 2 m ahead; something 1 m before it hides the way.
    ranges[0] = 1.0;
    assert_eq!(judge_ranges(&outside, &ranges) & 0b10, 0b10);
}

fn judge_ranges(header: &ScanHeader, ranges: &[f32]) -> u32 {
    let mut beams = Beams::default();
    beams.fill(header, ranges).expect("usable");
    judge(&beams, true).0
}

#[test]
fn suppression_normalises_and_holds_when_all_is_unsafe() {
    let p = [0.2, 0.6, 0.2];
    let soft = suppress(&p, 0b010, 0.5);
    assert!((soft.probabilities[1] - 0.3 / 0.7).abs() < 1e-12 && !soft.all_unsafe);
    let hard = suppress(&p, 0b010, 0.0);
    assert_eq!(hard.probabilities[1], 0.0);
    assert!((hard.probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    let hold = suppress(&p, 0b111, 0.0);
    assert!(hold.all_unsafe && hold.probabilities[ActionTable::STOP] == 1.0);
    let plain = suppress(&p, 0b111, 0.5);
    assert!(plain.all_unsafe && (plain.probabilities[1] - 0.6).abs() < 1e-12);
}

#[test]
fn drawing_follows_the_probabilities_and_never_takes_a_zero() {
    let p = [0.1, 0.0, 0.9];
    let mut counts = [0u32; 3];
    for n in 0..10_000 {
        counts[choose(&p, Draw::Seeded(7), n)] += 1;
    }
    assert_eq!(counts[1], 0);
    assert!((900..1100).contains(&counts[0]), "{counts:?}");
    assert_eq!(choose(&p, Draw::Seeded(7), 3), choose(&p, Draw::Seeded(7), 3));
    assert_eq!(choose(&p, Draw::ArgMax, 0), 2);
}

#[test]
fn one_motion_is_judged_as_one_of_many() {
    let beams = scan(&header(), 360, &[Point::new(0.5, 0.0)]);
    let (_, judgements) = judge(&beams, true);
    for (i, action) in ActionTable::eight().actions().iter().enumerate() {
        let motion = Shield::predict(&handler(), &action.start_from_end());
        let alone = Shield::new(config(true)).judge(&motion, Evidence::scan(&beams), &handler());
        assert_eq!(alone, judgements[i], "{}", action.name);
    }
}

#[test]
fn thresholds_come_in_the_lidars_own_order() {
    let mut clockwise = header();
    clockwise.angle_min_rad = 3.0;
    clockwise.angle_increment_rad = -0.02;
    let mut beams = Beams::default();
    beams.fill(&clockwise, &[5.0; 300]).expect("usable");
    let motion = Shield::predict(&handler(), &ActionTable::eight().actions()[1].start_from_end());
    let thresholds = Shield::new(config(false)).thresholds_m(&motion, &beams, handler().body(0.01));
    let disc = |center, radius_m| Disc { center, radius_m };
    let (here, radius_m) = (place(handler().robot_from_handler()), handler().radius_m());
    let hull = Hull::new([
        disc(Point::origin(), 0.3),
        disc(here, radius_m),
        disc(place(&motion.robot), 0.3),
        disc(place(&motion.handler.expect("a handler")), radius_m),
    ]);
    assert_eq!(thresholds.len(), 300);
    for (i, threshold) in thresholds.iter().enumerate() {
        let angle = 3.0 - 0.02 * i as f64;
        let truth = hull.threshold_m(Point::origin(), nalgebra::Vector2::new(angle.cos(), angle.sin()));
        assert!((threshold - truth).abs() < 1e-9, "beam {i}: {threshold} {truth}");
    }
    // From outside the hull too.
    clockwise.robot_from_lidar = Pose2::new(2.0, 0.5, 0.0);
    beams.fill(&clockwise, &[5.0; 300]).expect("usable");
    let thresholds = Shield::new(config(false)).thresholds_m(&motion, &beams, handler().body(0.01));
    assert!(thresholds.len() == 300 && thresholds.iter().any(|threshold| *threshold > 0.0));
    for (i, threshold) in thresholds.iter().enumerate() {
        let angle = 3.0 - 0.02 * i as f64;
        let truth = hull.threshold_m(Point::new(2.0, 0.5), nalgebra::Vector2::new(angle.cos(), angle.sin()));
        assert!((threshold - truth).abs() < 1e-9, "beam {i}: {threshold} {truth}");
    }
}

#[test]
fn the_remainder_goes_on_with_robot_and_handler() {
    let velocity = Twist2 { vx_mps: 0.5, vy_mps: 0.1, wz_radps: 0.4 };
    let motion = Shield::remainder(&handler(), &Se2::identity(), velocity, 0.3);
    let robot = exp(velocity, 0.3);
    assert!((motion.robot.inverse() * robot).translation.vector.norm() < 1e-12);
    // The step's whole motion is what is left of it: the model's own step from where the handler is.
    let truth = robot * handler().model().step(handler().robot_from_handler(), &robot);
    assert!((place(&motion.handler.expect("a handler")) - place(&truth)).norm() < 1e-12);
}

#[test]
fn of_equals_the_first_is_taken_and_draws_are_those_of_splitmix64() {
    assert_eq!(choose(&[0.2, 0.4, 0.4], Draw::ArgMax, 0), 1);
    assert_eq!(choose(&[0.4, 0.2, 0.4], Draw::ArgMax, 0), 0);
    // The surest is drawn only where it is to stop.
    assert!((0..1000).all(|n| choose(&[0.3, 0.3, 0.4], Draw::Surest(7), n) == 2));
    assert!((0..1000).all(|n| choose(&[1.0, 0.0, 0.0], Draw::Surest(7), n) == 0));
    let stops = [0.4, 0.3, 0.3];
    assert!((0..1000).all(|n| choose(&stops, Draw::Surest(7), n) == choose(&stops, Draw::Seeded(7), n)));
    assert!((0..20).any(|n| choose(&stops, Draw::Surest(7), n) != 0), "stands for good");
    // The first outputs of the published generator with seed 0, as shares of 2^64.
    for (n, output) in [(1u64, 0xe220_a839_7b1d_cdaf_u64), (2, 0x6e78_9e6a_a1b9_65f4), (3, 0x06c4_5d18_8009_454f)] {
        let share = output as f64 / 2f64.powi(64);
        let below = [share - 1e-12, 1.0 - share + 1e-12];
        let above = [share + 1e-12, 1.0 - share - 1e-12];
        assert_eq!((choose(&below, Draw::Seeded(0), n), choose(&above, Draw::Seeded(0), n)), (1, 0), "draw {n}");
    }
}

#[test]
fn an_unknown_beam_is_excused_only_as_far_as_it_was_seen_free() {
    let reading = |i: usize, ahead_m: f64| if (165..195).contains(&i) { ahead_m } else { 9.0 };
    let mut unknown = Beams::default();
    unknown.fill_with(&header(), 360, |i| reading(i, f64::NAN)).expect("usable");
    // Forward reaches 0.55 m. What was seen to 0.56 m is not free to there, by three sigma.
    for (seen_m, forbidden) in [(0.56, true), (0.75, false)] {
        let mut before = Beams::default();
        before.fill_with(&header(), 360, |i| reading(i, seen_m)).expect("usable");
        let mut memory = Memory::new(MemoryConfig {
            kept_ns: 1,
            kept_off_plane_ns: 1,
            free_ns: 1_000_000_000,
            drift: 0.0,
            footing: None,
        });
        memory.update(0, &Se2::identity(), &before, None, &handler().body(0.01));
        memory.update(1, &Se2::identity(), &unknown, None, &handler().body(0.01));
        let evidence = Evidence { memory: Some(&memory), ..Evidence::scan(&unknown) };
        let motion = Shield::predict(&handler(), &ActionTable::eight().actions()[1].start_from_end());
        let judgement = Shield::new(config(true)).judge(&motion, evidence, &handler());
        let cause = if forbidden { UnsafeCause::Unknown } else { UnsafeCause::None };
        assert_eq!(judgement.cause, cause, "seen to {seen_m} m");
    }
}

/// 0 to 2 pi inclusive, as some drivers send it: the last beam is the first once more.
#[test]
fn the_last_beam_of_a_turn_that_ends_where_it_began_counts() {
    for mount_rad in [0.0, std::f64::consts::PI, 1.0] {
        let inclusive = ScanHeader {
            angle_min_rad: -mount_rad,
            angle_increment_rad: std::f64::consts::TAU / 360.0,
            robot_from_lidar: Pose2::new(0.0, 0.0, mount_rad),
            ..header()
        };
        for near in [0, 360] {
            let mut ranges = [5.0f32; 361];
            ranges[near] = 0.4;
            assert_eq!(judge_ranges(&inclusive, &ranges) & 0b10, 0b10, "beam {near} of a lidar turned by {mount_rad}");
        }
    }
}

#[test]
fn the_escape_rule_holds_for_a_lidar_outside_the_hull() {
    let outside = ScanHeader { robot_from_lidar: Pose2::new(2.0, 0.0, 0.0), ..header() };
    // Beam 0 looks back at the robot: something stands 0.28 m before its middle, within its disc.
    let mut ranges = vec![f32::INFINITY; 360];
    ranges[0] = 1.72;
    let mut beams = Beams::default();
    beams.fill(&outside, &ranges).expect("usable");
    for (x_m, safe) in [(-0.1, true), (0.1, false)] {
        let motion = Shield::predict(&handler(), &Se2::translation(x_m, 0.0));
        assert_eq!(Shield::new(config(true)).judge(&motion, Evidence::scan(&beams), &handler()).safe, safe, "{x_m} m");
        assert!(!Shield::new(config(false)).judge(&motion, Evidence::scan(&beams), &handler()).safe);
    }
}

proptest! {
    #![proptest_config(crate::testing::cases())]

    #[test]
    fn the_nearest_place_of_an_arc_is_the_nearest_of_many(
        (vx, vy, wz) in (-0.5..0.5f64, -0.5..0.5f64, prop_oneof![Just(0.0), -6.0..6.0f64]),
        (x, y) in (-1.0..1.0f64, -1.0..1.0f64),
    ) {
        let (twist, point) = (Twist2 { vx_mps: vx, vy_mps: vy, wz_radps: wz }, Point::new(x, y));
        let sampled = (0..=2000).map(|i| (place(&exp(twist, f64::from(i) / 2000.0)) - point).norm());
        let (nearest, truth) = (nearest_on_arc(&twist, point), sampled.fold(f64::INFINITY, f64::min));
        prop_assert!(nearest <= truth + 1e-9 && nearest > truth - 5e-4, "{nearest}, not {truth}");
    }
}

fn long_body() -> ShieldConfig {
    let reach = Reach { nose_m: 0.18, ..Reach::default() };
    ShieldConfig { robot_radius_m: 0.22, reach, ..config(true) }
}

#[test]
fn a_long_body_reaches_ahead_and_not_aside() {
    let table = ActionTable::eight();
    let mask_of = |config: ShieldConfig, point: Point| {
        let beams = scan(&header(), 360, &[point]);
        Shield::new(config).judge_actions(&table, Evidence::scan(&beams), &handler(), &mut Vec::new())
    };
    let stop = ActionTable::STOP;
    let forward = table.actions().iter().position(|action| action.start_from_end().translation.x > 0.2).expect("it is");
    // A disc of 0.3 m that goes 0.25 m ahead does not reach it; the nose does.
    let ahead = Point::new(0.58, 0.0);
    assert_eq!(mask_of(config(true), ahead) & 1 << forward, 0);
    assert_ne!(mask_of(long_body(), ahead) & 1 << forward, 0);
    // Beside the body there is more room than beside a disc.
    let aside = Point::new(0.20, 0.26);
    assert_ne!(mask_of(config(false), aside) & 1 << forward, 0);
    assert_eq!(mask_of(ShieldConfig { escape: false, ..long_body() }, aside) & 1 << forward, 0);
    assert_eq!(mask_of(long_body(), ahead) & 1 << stop, 0, "who stands does not reach it");
}

#[test]
fn who_turns_on_the_spot_does_not_swing_the_nose_against_what_stands_beside_it() {
    let table = ActionTable::eight();
    // It presses on the body already, left of the nose.
    let beams = scan(&header(), 360, &[Point::new(0.30, 0.17)]);
    let mut judgements = Vec::new();
    Shield::new(long_body()).judge_actions(&table, Evidence::scan(&beams), &handler(), &mut judgements);
    for (action, judgement) in table.actions().iter().zip(&judgements) {
        let end = action.start_from_end();
        if end.translation.vector.norm() < 1e-9 && end.rotation.angle() > 0.0 {
            assert!(!judgement.safe, "{action:?}: {judgement:?}");
        }
    }
    assert!(judgements[ActionTable::STOP].safe, "who stands does not come nearer");
}

#[test]
fn who_is_to_go_over_an_edge_waits_where_no_way_ahead_is_left() {
    let table = ActionTable::eight();
    let ahead: Vec<bool> = table.actions().iter().map(|action| action.velocity(0.5).vx_mps > 0.0).collect();
    let forward = ahead.iter().position(|ahead| *ahead).expect("one leads ahead");
    let turn = table.actions().iter().position(|action| action.velocity(0.5).wz_radps > 0.0).expect("one turns");
    let judged = |cause: UnsafeCause, but: Option<usize>| -> Vec<Judgement> {
        let forbidden = |i: usize| ahead[i] && but != Some(i);
        (0..table.len())
            .map(|i| {
                if forbidden(i) {
                    Judgement { safe: false, cause, ..Judgement::default() }
                } else {
                    Judgement::default()
                }
            })
            .collect()
    };
    let last = ahead.iter().rposition(|ahead| *ahead).filter(|last| *last != forward);
    assert!(waits_at_edge(&table, &judged(UnsafeCause::DropOff, None), forward));
    assert!(!waits_at_edge(&table, &judged(UnsafeCause::Beam, None), forward), "a wall is gone round");
    assert!(!waits_at_edge(&table, &judged(UnsafeCause::DropOff, None), turn), "it is not wanted");
    assert!(!waits_at_edge(&table, &judged(UnsafeCause::DropOff, last), forward), "a way past it is left");
    assert!(!waits_at_edge(&table, &[], forward));
}

#[test]
fn the_hull_ends_where_robot_and_handler_come_to_rest() {
    let rest = se2(Pose2::new(-0.75, -0.35, 0.0));
    let reach = Reach { nose_m: 0.18, carried_s: [0.14, 0.12, 0.17], robot_from_rest: Some(rest), walks_on_s: 0.0 };
    let stands = ShieldConfig { reach, ..long_body() };
    let (table, beams) = (ActionTable::eight(), scan(&header(), 360, &[]));
    let handler = handler();
    for action in table.actions() {
        let motion = Shield::predict(&handler, &action.start_from_end());
        let moves = action.velocity(0.5);
        let thresholds_m = |config: &ShieldConfig| {
            let discs = Shield::new(config.clone()).swept(&motion, moves, handler.body(0.0));
            let hull = Hull::new(discs);
            beams.beams().iter().map(|beam| hull.threshold_m(beams.origin(), beam.direction)).collect::<Vec<_>>()
        };
        let (ends, stands) = (thresholds_m(&long_body()), thresholds_m(&stands));
        // The hull cuts a turn short by what the nose bulges between its ends.
        assert!(ends.iter().zip(&stands).all(|(ends, stands)| *stands >= ends - 2e-3), "{action:?}");
        let (more, moved) = (ends.iter().zip(&stands).map(|(a, b)| b - a).fold(0.0, f64::max), pose2(&motion.robot));
        if moved.x_m > 0.2 && moved.y_m == 0.0 {
            assert!((more - 0.07).abs() < 0.03, "straight on it overruns by 7 cm: {more}");
        }
        assert!(more < 0.25, "{action:?}: {more}");
        // Where it comes to rest is within.
        let on = se2(Pose2::new(0.14 * moves.vx_mps, 0.12 * moves.vy_mps, 0.17 * moves.wz_radps));
        let at_rest = place(&(on * motion.robot * rest));
        let beam = beams.fan().nearest(at_rest).expect("all around");
        assert!(stands[beam] > (at_rest - beams.origin()).norm(), "{action:?}");
    }
}

#[test]
fn the_hull_holds_the_way_that_a_handler_walks_on_after_the_robot_stops() {
    let rest = se2(Pose2::new(-0.75, -0.35, 0.0));
    let at_once = Reach { nose_m: 0.18, robot_from_rest: Some(rest), ..Reach::default() };
    let handler = handler();
    let forward = Twist2 { vx_mps: 0.5, ..Twist2::ZERO };
    let depth_m = |reach: Reach, moves: Twist2, at: Point| {
        let motion = Shield::predict(&handler, &se2(Pose2::new(0.1, 0.0, 0.0)));
        let shield = ShieldConfig { reach, ..long_body() };
        -Hull::new(Shield::new(shield).swept(&motion, moves, handler.body(0.0))).signed_distance_m(at)
    };
    // The handler's own right edge, 20 cm further ahead than where they come to rest: 0.5 m/s for 0.4 s.
    let edge = Point::new(0.1 - 0.75 + 0.2, -0.35 - 0.25);
    let slow = Reach { walks_on_s: 0.4, ..at_once };
    let margin_m = long_body().margin_m;
    assert!(depth_m(at_once, forward, edge) < 0.0, "{}", depth_m(at_once, forward, edge));
    assert!((depth_m(slow, forward, edge) - margin_m).abs() < 1e-9, "{}", depth_m(slow, forward, edge));
    // Beside a robot that stands or turns on the spot, a handler has no speed to walk on with.
    for moves in [Twist2::ZERO, Twist2 { wz_radps: 0.9, ..Twist2::ZERO }] {
        assert_eq!(depth_m(slow, moves, edge), depth_m(at_once, moves, edge));
    }
    // Where the hull ends with the motion, nothing comes after it.
    let ends = Reach { robot_from_rest: None, ..slow };
    assert_eq!(depth_m(ends, forward, edge), depth_m(Reach { walks_on_s: 0.0, ..ends }, forward, edge));
}

#[test]
fn a_robot_alone_needs_room_for_itself_and_for_no_handler() {
    // Something stands where a handler would walk, and something beside the robot's way.
    let beside = [Point::new(-0.75, -0.05), Point::new(0.2, 0.33)];
    let beams = scan(&header(), 360, &beside);
    let table = ActionTable::eight();
    let judge = |escape: bool| {
        let mut judgements = Vec::new();
        let mut shield = Shield::new(config(escape));
        (shield.judge_actions_alone(&table, Evidence::scan(&beams), &mut judgements), judgements)
    };
    let forbids = |mask: u32, name: &str| mask >> table.index_of(name).expect(name) & 1 == 1;
    let (mask, judgements) = judge(true);
    assert!(!forbids(mask, "forward") && !forbids(mask, "turn_left") && forbids(mask, "sidestep_left"), "{mask:b}");
    // The same hull as that of a handler who is nowhere but within the robot's own disc.
    let inside = HandlerBody { center: Point::origin(), radius_m: 0.3, mask_radius_m: None, seen: None };
    let motions = table.actions().iter().map(|action| Motion::new(action.start_from_end(), action.start_from_end()));
    let mut within = Vec::new();
    Shield::new(config(true)).judge_motions(motions, Evidence::scan(&beams), inside, &mut within);
    for (alone, within) in judgements.iter().zip(&within) {
        assert_eq!((alone.safe, alone.cause), (within.safe, within.cause));
        assert!((alone.margin_m - within.margin_m).abs() < 1e-9, "{alone:?} {within:?}");
    }
    assert!(judge(false).0.count_ones() >= mask.count_ones());
}
