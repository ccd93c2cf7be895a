//! The geometric engine through the built-in scenarios: simulated lidar with noise, depth camera, physics, shield.
//!
//! `GEO_TRACE=1 cargo test -- --nocapture NAME` prints every decision.

#![allow(clippy::print_stdout)]

use guidance::depth::DepthView;
use guidance::handler::{HandlerEstimate, HandlerLimits};
use guidance::interaction::DelayedHarness;
use guidance::memory::Memory;
use guidance::scan::Beams;
use guidance::se2::{pose2, se2, wrap_angle};
use guidance::shield::{Draw, EdgeDistance, Evidence, Judgement, Reach, Shield, ShieldConfig, choose, suppress};
use guidance::{ActionTable, Se2};
use guidedog_policies::geometric::{GeometricConfig, GeometricEngine, Observation, Plan};
use messages::{CueKind, Pose2, ScanHeader, Twist2, WorldTruth};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use world::{
    CueSequence, DepthConfig, DepthSensor, LidarConfig, LidarSensor, Physics, PhysicsConfig, Route, Scenario, Scene,
    World,
};

/// Ticks in a decision period of 0.5 s.
const TICKS: u64 = 50;

#[derive(Debug)]
struct Report {
    reached: bool,
    time_s: f64,
    all_unsafe: u32,
    changed: u32,
    times: Vec<Duration>,
    plan: Plan,
    truth: WorldTruth,
}

/// The shield as on the robot: one per walk, judged once per decision.
struct Guard {
    shield: Shield,
    estimate: HandlerEstimate,
    beams: Beams,
    depth: DepthView,
    memory: Memory,
    judgements: Vec<Judgement>,
}

impl Guard {
    fn new() -> Self {
        let harness = DelayedHarness::new(Pose2::new(-0.75, -0.35, 0.0), 0.4, 0.5).expect("the default harness");
        let limits =
            HandlerLimits { radius_m: 0.25, seen_radius_m: 0.25, speed_max_mps: 0.5, not_seen_ns: 1_000_000_000 };
        let shield = Shield::new(ShieldConfig {
            robot_radius_m: 0.30,
            margin_m: 0.0,
            unknown_gap_m: 0.10,
            escape: true,
            unseen_limit_m2: None,
            back_from_edges_m: None,
            reach: Reach::default(),
            edges: EdgeDistance::default(),
        });
        Self {
            shield,
            estimate: HandlerEstimate::new(harness, limits),
            beams: Beams::default(),
            depth: DepthView::default(),
            memory: Memory::new(settings::MemorySettings::default().config(None)),
            judgements: Vec::new(),
        }
    }

    /// The actions that are unsafe, as a mask.
    fn judge(&mut self, table: &ActionTable, robot: &Se2, scan: (&ScanHeader, &[f32]), now_ns: u64) -> u32 {
        self.beams.fill(scan.0, scan.1).expect("a good scan");
        self.estimate.predict(robot, 1.0);
        self.estimate.correct(&self.beams, now_ns);
        self.estimate.begin_step(robot);
        let body = self.estimate.body(self.beams.sigma_m());
        self.memory.update(now_ns, robot, &self.beams, Some(&self.depth), &body);
        let evidence = Evidence { depth: Some(&self.depth), memory: Some(&self.memory), ..Evidence::scan(&self.beams) };
        self.shield.judge_actions(table, evidence, &self.estimate, &mut self.judgements)
    }
}

fn walk(world: World, start: Pose2, route: &Route, seed: u64) -> Report {
    let mut world = Arc::new(world);
    let table = ActionTable::eight();
    let mut physics = Physics::new(Arc::clone(&world), PhysicsConfig::default(), start).expect("a free start");
    let mut lidar = LidarSensor::new(LidarConfig::default(), seed, 1).expect("the default lidar");
    let depth_config = DepthConfig { width: 320, height: 240, ..DepthConfig::default() };
    let mut depth = DepthSensor::new(depth_config, seed, 1).expect("the default camera");
    let mut engine = GeometricEngine::new(GeometricConfig::default(), table.clone());
    let mut guard = Guard::new();
    let mut cues = CueSequence::new(route);
    let (mut cue, mut cue_start) = (CueKind::Stop, se2(start));
    let (mut ranges, mut pixels) = (vec![0.0; lidar.config().beams], vec![0; depth.pixels()]);
    let (mut all_unsafe, mut changed, mut reached, mut times) = (0, 0, false, Vec::new());
    let limit_s = route.time_limit_s.unwrap_or(300.0);
    for decision in 0..(limit_s / 0.5) as u64 {
        let truth = physics.truth();
        reached = route.goal.is_some_and(|goal| goal.reached(truth.world_from_robot));
        if reached {
            break;
        }
        let robot = se2(truth.world_from_robot);
        let mut new = false;
        if let Some(kind) = cues.due(decision as f64 * 0.5, truth.world_from_robot) {
            (cue, cue_start, new) = (kind, robot, true);
        }
        let axis = [0.0, 0.0, FRAC_PI_2, -FRAC_PI_2][cue as usize];
        if axis != 0.0 && wrap_angle((cue_start.inverse() * robot).rotation.angle()) * axis.signum() > FRAC_PI_4 {
            let yaw = cue_start.rotation.angle() + axis;
            (cue, cue_start, new) = (CueKind::Forward, Se2::new(robot.translation.vector, yaw), true);
        }
        let scene = Scene::from_truth(Arc::make_mut(&mut world), &truth);
        lidar.scan(&scene, decision, &mut ranges);
        depth.render(&scene, decision, &mut pixels);
        guard.depth.fill(&depth.depth_header(), &pixels).expect("a good frame");
        let header = lidar.scan_header();
        let begun = Instant::now();
        let shares = engine.decide(&Observation {
            scan: &header,
            ranges: &ranges,
            obstacles: guard.depth.points(),
            shield: None,
            handler: None,
            odom_from_robot: truth.world_from_robot,
            odometry_incarnation: 1,
            start_from_robot: pose2(&(cue_start.inverse() * robot)),
            cue,
            cue_is_new: new,
            formation: messages::Formation::Beside,
        });
        times.push(begun.elapsed());
        let wanted: Vec<f64> = shares[..table.len()].iter().map(|share| f64::from(*share)).collect();
        let best = choose(&wanted, Draw::ArgMax, decision);
        let unsafe_mask = guard.judge(&table, &robot, (&header, &ranges), decision * 500_000_000);
        let suppressed = suppress(&wanted, unsafe_mask, 0.0);
        let action = if best == ActionTable::STOP {
            best
        } else {
            let moving = unsafe_mask | 1 << ActionTable::STOP;
            all_unsafe += u32::from(moving.count_ones() as usize == table.len());
            let action = choose(&suppressed.probabilities[..table.len()], Draw::ArgMax, decision);
            changed += u32::from(action != best);
            action
        };
        trace(decision, &truth, cue, engine.plan(), [&table.actions()[action].name, &table.actions()[best].name]);
        let velocity = if action == 0 { Twist2::ZERO } else { table.actions()[action].velocity(0.5) };
        (0..TICKS).for_each(|_| physics.step(velocity));
    }
    times.sort();
    let time_s = physics.ticks() as f64 * world::TICK_S;
    Report { reached, time_s, all_unsafe, changed, times, plan: engine.plan(), truth: physics.truth() }
}

fn trace(decision: u64, truth: &WorldTruth, cue: CueKind, plan: Plan, [done, wanted]: [&str; 2]) {
    if std::env::var_os("GEO_TRACE").is_none() {
        return;
    }
    let pose = truth.world_from_robot;
    println!(
        "{:6.1} ({:6.2} {:6.2} {:6.1}) {:<8} {plan:?} {done} ({wanted}) collisions {}/{}",
        decision as f64 * 0.5,
        pose.x_m,
        pose.y_m,
        pose.yaw_rad.to_degrees(),
        cue.name(),
        truth.robot_collisions,
        truth.handler_collisions,
    );
}

fn check(name: &str, report: &Report) {
    let at = |share: f64| report.times[((report.times.len() - 1) as f64 * share) as usize];
    println!(
        "{name:<14} {} {:?} t {:5.1} s, {:5.1} m, at {:?}, collisions {}/{}, hit by others {}, all unsafe {}, \
         changed {}, decision p50 {:?} p99 {:?}",
        if report.reached { "reached" } else { "NOT REACHED" },
        report.plan,
        report.time_s,
        report.truth.distance_m,
        report.truth.world_from_robot,
        report.truth.robot_collisions,
        report.truth.handler_collisions,
        report.truth.hit_by_others,
        report.all_unsafe,
        report.changed,
        at(0.5),
        at(0.99),
    );
}

fn scenario(name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios").join(format!("{name}.toml"));
    let scenario = Scenario::load(&path).expect("a scenario");
    let mut good = true;
    for seed in 1..=2 {
        let world = scenario.load_world().expect("its world");
        let report = walk(world, scenario.start, &scenario.route, seed);
        check(name, &report);
        good &= report.reached && (report.truth.robot_collisions, report.truth.handler_collisions) == (0, 0);
    }
    assert!(good, "{name}: not reached, or a collision");
}

#[test]
fn corridor() {
    scenario("corridor");
}

#[test]
fn curve() {
    scenario("curve");
}

#[test]
fn l_turn() {
    scenario("l-turn");
}

#[test]
fn left_at_tee() {
    scenario("left-at-tee");
}

#[test]
fn crossing() {
    scenario("crossing");
}

#[test]
fn cluttered() {
    scenario("cluttered");
}

#[test]
fn opening_doors() {
    scenario("opening-doors");
}

/// Real floor plans, where the data lies beside the checkout: 42 m of corridor past doors, up to where a doorway of
/// 0.8 m ends it for the team; and along another one, then right.
#[test]
fn real_floor() {
    let Some(path) = test_data::data("maps/utexas_gdc/3.yaml") else { return };
    let mut good = true;
    for (start, route) in [(Pose2::new(-46.4, -11.5, 0.0), SOUTH), (Pose2::new(-8.0, 23.8, 0.2), NORTH)] {
        let route = Route::from_toml("real floor", route).expect("a route");
        let report = walk(World::load(&path).expect("the floor plan"), start, &route, 1);
        check("real floor", &report);
        good &= report.reached && (report.truth.robot_collisions, report.truth.handler_collisions) == (0, 0);
    }
    assert!(good);
}

const SOUTH: &str = r#"
goal = { at = [-4.5, -12.0], within_m = 1.0 }
time_limit_s = 180

[[cue]]
kind = "forward"
at_s = 1.0
"#;

const NORTH: &str = r#"
goal = { at = [3.0, 19.5], within_m = 1.5 }
time_limit_s = 180

[[cue]]
kind = "forward"
at_s = 1.0

[[cue]]
kind = "right"
at = [2.0, 23.5]
within_m = 1.5
"#;
