//! The geometric engine through the built-in scenarios: simulated lidar with noise, depth camera and physics.
//!
//! `GEO_TRACE=1 cargo test -- --nocapture NAME` prints every decision.

#![allow(clippy::print_stdout)]

mod support;

use guidance::ActionTable;
use guidance::se2::{Point, pose2, se2, wrap_angle};
use guidedog_policy::geometric::{GeometricConfig, GeometricEngine, Observation, Plan};
use messages::{CueKind, DepthHeader, Pose2, Twist2};
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
    truth: messages::WorldTruth,
}

/// Obstacle points (robot frame) of a depth frame: what is higher than 0.06 m and lower than 1.9 m, every 8th pixel.
fn obstacles(header: &DepthHeader, pixels: &[u16]) -> Vec<Point> {
    let camera = header.robot_from_camera;
    let (sin, cos) = camera.pitch_rad.sin_cos();
    let robot_from_camera = se2(Pose2::new(camera.x_m, camera.y_m, camera.yaw_rad));
    let mut places = Vec::new();
    for row in (0..header.height as usize).step_by(8) {
        for column in (0..header.width as usize).step_by(8) {
            let depth_m = f64::from(pixels[row * header.width as usize + column]) / 1000.0;
            let right = (column as f64 - header.cx_px) / header.fx_px * depth_m;
            let down = (row as f64 - header.cy_px) / header.fy_px * depth_m;
            let height_m = camera.z_m - down * cos - depth_m * sin;
            if depth_m > 0.0 && depth_m < 5.0 && (0.06..1.9).contains(&height_m) {
                places.push(robot_from_camera * Point::new(depth_m * cos - down * sin, -right));
            }
        }
    }
    places
}

fn walk(world: World, start: Pose2, route: &Route, seed: u64, with_depth: bool) -> Report {
    let world = Arc::new(world);
    let table = ActionTable::eight();
    let mut physics = Physics::new(Arc::clone(&world), PhysicsConfig::default(), start).expect("a free start");
    let lidar = LidarSensor::new(LidarConfig::default(), seed, 1).expect("the default lidar");
    let depth_config = DepthConfig { width: 320, height: 240, ..DepthConfig::default() };
    let mut depth = DepthSensor::new(depth_config, seed, 1).expect("the default camera");
    let mut engine = GeometricEngine::new(GeometricConfig::default(), table.clone());
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
            (cue, cue_start, new) = (CueKind::Forward, guidance::Se2::new(robot.translation.vector, yaw), true);
        }
        let scene = Scene::from_truth(&world, &truth);
        lidar.scan(&scene, decision, &mut ranges);
        let mut places = Vec::new();
        if with_depth {
            depth.render(&scene, decision, &mut pixels);
            places = obstacles(&depth.depth_header(), &pixels);
        }
        let header = lidar.scan_header();
        let begun = Instant::now();
        let shares = engine.decide(&Observation {
            scan: &header,
            ranges: &ranges,
            obstacles: &places,
            odom_from_robot: truth.world_from_robot,
            odometry_incarnation: 1,
            start_from_robot: pose2(&(cue_start.inverse() * robot)),
            cue,
            cue_is_new: new,
        });
        times.push(begun.elapsed());
        let ranked = |a: &usize, b: &usize| shares[*a].total_cmp(&shares[*b]).then(b.cmp(a));
        let best = (0..table.len()).max_by(ranked).unwrap_or(0);
        let mut action = best;
        if best != ActionTable::STOP {
            let handler = robot.inverse() * se2(truth.world_from_handler);
            let mut hits = support::hits(&header, &ranges, &handler);
            hits.extend(places.iter().filter(|place| place.coords.norm() < 2.5));
            let allowed = support::allowed(&hits, &handler, &table).into_iter().max_by(ranked);
            all_unsafe += u32::from(allowed.is_none());
            changed += u32::from(allowed.is_some_and(|action| action != best));
            action = allowed.unwrap_or(ActionTable::STOP);
        }
        if std::env::var_os("GEO_TRACE").is_some() {
            let pose = truth.world_from_robot;
            println!(
                "{:6.1} ({:6.2} {:6.2} {:6.1}) {:<8} {:?} {} ({}) coll {}/{}",
                decision as f64 * 0.5,
                pose.x_m,
                pose.y_m,
                pose.yaw_rad.to_degrees(),
                cue.name(),
                engine.plan(),
                table.actions()[action].name,
                table.actions()[best].name,
                truth.robot_collisions,
                truth.handler_collisions,
            );
        }
        let velocity = if action == 0 { Twist2::ZERO } else { table.actions()[action].velocity(0.5) };
        (0..TICKS).for_each(|_| physics.step(velocity));
    }
    times.sort();
    let time_s = physics.ticks() as f64 * world::TICK_S;
    Report { reached, time_s, all_unsafe, changed, times, plan: engine.plan(), truth: physics.truth() }
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
        let report = walk(world, scenario.start, &scenario.route, seed, true);
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

/// Real floor plans, where the data lies beside the checkout: 42 m of corridor past doors, up to where a doorway of
/// 0.8 m ends it for the team; and along another one, then right.
#[test]
fn real_floor() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/maps/utexas_gdc/3.yaml");
    if !path.exists() {
        println!("real floor: no {}, skipped", path.display());
        return;
    }
    let mut good = true;
    for (start, route) in [(Pose2::new(-46.4, -11.5, 0.0), SOUTH), (Pose2::new(-8.0, 23.8, 0.2), NORTH)] {
        let route = Route::from_toml("real floor", route).expect("a route");
        let report = walk(World::load(&path).expect("the floor plan"), start, &route, 1, true);
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
