//! Robot, handler and people in motion.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests are tests too")]

use std::sync::Arc;

use guidance::se2::Point;
use guidedog_world::floor::rectangle;
use guidedog_world::{
    Hole, LegsConfig, Moves, Person, Physics, PhysicsConfig, Prism, RobotConfig, Walk, World, WorldError,
};
use messages::{Pose2, Twist2, WorldTruth};

const FORWARD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 };

fn start(world: World) -> Physics {
    Physics::new(Arc::new(world), PhysicsConfig::default(), Pose2::default()).unwrap()
}

fn run(physics: &mut Physics, command: Twist2, seconds: f64) -> WorldTruth {
    for _ in 0..(seconds * 100.0) as usize {
        physics.step(command);
    }
    physics.truth()
}

fn walls(x: f64) -> World {
    World::new(2.6, vec![Prism::wall(vec![Point::new(x, -3.0), Point::new(x, 3.0)], [0.0, 2.6])])
}

#[test]
fn the_handler_follows_with_the_lag_of_the_delayed_harness() {
    let mut physics = start(World::new(2.6, vec![]));
    let truth = run(&mut physics, FORWARD, 6.0);
    let lag = truth.world_from_robot.x_m - truth.world_from_handler.x_m - 0.75;
    // alpha / (1 - alpha) v dt = 0.4 / 0.6 * 0.5 * 0.5
    assert!((lag - 1.0 / 6.0).abs() < 1e-3, "{lag}");
    assert!((truth.world_from_handler.y_m + 0.35).abs() < 1e-9);
    let truth = run(&mut physics, Twist2::ZERO, 4.0);
    assert!((truth.world_from_robot.x_m - truth.world_from_handler.x_m - 0.75).abs() < 1e-4);
    assert!((truth.distance_m - truth.world_from_robot.x_m).abs() < 1e-9 && truth.robot_twist.is_zero());
}

#[test]
fn accelerations_are_bounded_and_stopping_is_the_fastest() {
    let mut physics = start(World::new(2.6, vec![]));
    assert!((run(&mut physics, FORWARD, 0.1).robot_twist.vx_mps - 0.2).abs() < 1e-9);
    run(&mut physics, FORWARD, 1.0);
    assert!((run(&mut physics, Twist2::ZERO, 0.1).robot_twist.vx_mps - 0.1).abs() < 1e-9);
    let nan = Twist2 { vx_mps: f64::NAN, ..FORWARD };
    assert!(run(&mut physics, nan, 0.1).robot_twist.is_zero(), "what is not a number is a stop");
}

fn on_legs(world: World) -> Physics {
    let legs = LegsConfig {
        delay_s: 0.04,
        time_constant_s: [0.12, 0.1, 0.2],
        stride_s: 0.48,
        roll_rad: 0.02,
        pitch_rad: 0.03,
        rise_m: 0.01,
        lean_rad_per_mps: 0.2,
        sway_m: 0.004,
        sway_rad: 0.01,
        slip: 0.03,
        standing_m: 0.3,
    };
    let config = PhysicsConfig { legs: Some(legs), ..PhysicsConfig::default() };
    Physics::new(Arc::new(world), config, Pose2::default()).unwrap()
}

#[test]
fn a_robot_on_legs_lags_overruns_and_sways() {
    let mut physics = on_legs(World::new(2.6, vec![]));
    let begun = run(&mut physics, FORWARD, 4.0);
    assert!((begun.world_from_robot.x_m - 1.92).abs() < 0.06, "{:?}", begun.world_from_robot);
    assert!(begun.attitude.is_known() && begun.attitude.is_usable() && begun.attitude.pitch_rad != 0.0);
    let stood = run(&mut physics, Twist2::ZERO, 2.0);
    let overrun_m = stood.world_from_robot.x_m - begun.world_from_robot.x_m;
    assert!((0.06..0.10).contains(&overrun_m), "{overrun_m}");
    let mut again = on_legs(World::new(2.6, vec![]));
    run(&mut again, FORWARD, 4.0);
    assert_eq!(run(&mut again, Twist2::ZERO, 2.0), stood);
    let mut physics = on_legs(walls(2.0));
    let truth = run(&mut physics, FORWARD, 10.0);
    assert!(truth.robot_collisions >= 1 && truth.world_from_robot.x_m <= 1.7 + 1e-6, "{truth:?}");
}

#[test]
fn a_long_body_touches_with_its_nose_and_cannot_turn_into_a_wall() {
    let robot = RobotConfig { radius_m: 0.2, nose_m: 0.2, ..RobotConfig::default() };
    let config = PhysicsConfig { robot, ..PhysicsConfig::default() };
    let start = |world: World| Physics::new(Arc::new(world), config.clone(), Pose2::default());
    let mut physics = start(walls(2.0)).unwrap();
    let truth = run(&mut physics, FORWARD, 10.0);
    assert!(truth.robot_collisions == 1 && (truth.world_from_robot.x_m - 1.6).abs() < 1e-6, "{truth:?}");
    assert!(start(walls(0.39)).is_err() && start(walls(0.41)).is_ok());
    // A wall along its left side, where a round body would turn freely.
    let along = World::new(2.6, vec![Prism::wall(vec![Point::new(-3.0, 0.3), Point::new(3.0, 0.3)], [0.0, 2.6])]);
    let mut physics = start(along).unwrap();
    let truth = run(&mut physics, Twist2 { wz_radps: 0.35, ..Twist2::ZERO }, 6.0);
    assert!(truth.robot_collisions == 1 && truth.world_from_robot.yaw_rad < 0.53, "{truth:?}");
}

#[test]
fn a_motion_into_a_wall_is_refused_and_counted_once() {
    let mut physics = start(walls(2.0));
    let truth = run(&mut physics, FORWARD, 10.0);
    assert_eq!((truth.robot_collisions, truth.handler_collisions, truth.hit_by_others), (1, 0, 0));
    assert!((truth.world_from_robot.x_m - 1.7).abs() < 1e-6, "{:?}", truth.world_from_robot);
    let truth = run(&mut physics, Twist2 { vx_mps: -0.5, ..Twist2::ZERO }, 1.0);
    assert!(truth.world_from_robot.x_m < 1.4, "the way back is free");
    let truth = run(&mut physics, FORWARD, 5.0);
    assert_eq!(truth.robot_collisions, 2, "and the next touch is another one");
}

#[test]
fn who_leaves_the_floor_falls_once_and_lies_there() {
    let hole = |at: (f64, f64)| Hole { outline: rectangle(Pose2::new(at.0, at.1, 0.0), 3.0, 1.0), depth_m: 0.5 };
    for (at, falls) in [((1.0, 0.0), [1, 0]), ((0.5, -1.0), [0, 1])] {
        let world = World::new(2.6, Vec::new()).with_holes(vec![hole(at)]);
        let mut physics = start(world);
        let fallen = run(&mut physics, FORWARD, 6.0);
        assert_eq!([fallen.robot_falls, fallen.handler_falls], falls);
        assert_eq!((fallen.robot_collisions, fallen.handler_collisions), (0, 0));
        let later = run(&mut physics, FORWARD, 1.0);
        assert_eq!(later, fallen);
    }
    let beside = World::new(2.6, Vec::new()).with_holes(vec![hole((-1.0, 0.6))]);
    let refused = Physics::new(Arc::new(beside), PhysicsConfig::default(), Pose2::default());
    assert!(matches!(refused, Err(WorldError::StartBlocked { who: "robot", .. })), "it would start over an edge");
}

#[test]
fn a_handler_can_be_led_into_something() {
    let table = Prism::cuboid(Point::new(2.0, -0.7), [0.5, 0.5], 0.0, [0.0, 0.8]);
    let mut physics = start(World::new(2.6, vec![table]));
    let truth = run(&mut physics, FORWARD, 10.0);
    assert_eq!((truth.robot_collisions, truth.handler_collisions), (0, 1));
    let (robot, handler) = (truth.world_from_robot, truth.world_from_handler);
    assert!((robot.x_m - handler.x_m).hypot(robot.y_m - handler.y_m) < 1.51, "the harness holds the robot");
}

#[test]
fn what_hangs_high_is_for_the_handler_only_and_a_step_for_nobody() {
    let shelf = Prism::cuboid(Point::new(2.0, 0.0), [0.5, 3.0], 0.0, [1.2, 1.6]);
    let truth = run(&mut start(World::new(2.6, vec![shelf])), FORWARD, 10.0);
    assert_eq!((truth.robot_collisions, truth.handler_collisions), (0, 1));
    let step = Prism::cuboid(Point::new(2.0, 0.0), [0.5, 3.0], 0.0, [0.0, 0.015]);
    let truth = run(&mut start(World::new(2.6, vec![step])), FORWARD, 10.0);
    assert_eq!((truth.robot_collisions, truth.handler_collisions), (0, 0));
}

fn towards(yields: bool) -> World {
    let path = vec![Point::new(3.0, 0.0), Point::new(-3.0, 0.0)];
    let (walk, moves) = (Walk::Once, Moves::Path);
    let person = Person { path, speed_mps: 0.8, radius_m: 0.25, walk, yields, start_s: 0.0, moves };
    World::new(2.6, vec![]).with_people(vec![person])
}

#[test]
fn touches_with_people_are_blamed_on_who_moves_into_whom() {
    let truth = run(&mut start(towards(false)), Twist2::ZERO, 8.0);
    assert_eq!((truth.robot_collisions, truth.handler_collisions, truth.hit_by_others), (0, 0, 1));
    let truth = run(&mut start(towards(true)), Twist2::ZERO, 8.0);
    assert_eq!(truth.hit_by_others, 0);
    assert!(truth.walkers[0].x_m > 1.1, "who yields has stopped");
    let truth = run(&mut start(towards(true)), FORWARD, 8.0);
    assert_eq!((truth.robot_collisions, truth.hit_by_others), (1, 0));
    let truth = run(&mut start(towards(false)), FORWARD, 8.0);
    assert_eq!((truth.robot_collisions, truth.hit_by_others), (1, 0), "both moved: the robot should not have");
}

#[test]
fn a_start_inside_something_is_refused() {
    for (x, y) in [(0.0, 0.0), (-0.75, -0.35), (0.45, 0.0)] {
        let world = World::new(2.6, vec![Prism::cuboid(Point::new(x, y), [0.4, 0.4], 0.3, [0.0, 1.0])]);
        assert!(Physics::new(Arc::new(world), PhysicsConfig::default(), Pose2::default()).is_err());
    }
}

#[test]
fn the_same_commands_give_the_same_truth() {
    let truths: Vec<_> = (0..2)
        .map(|_| {
            let mut physics = start(towards(false));
            run(&mut physics, Twist2 { vx_mps: 0.4, vy_mps: 0.1, wz_radps: 0.3 }, 20.0)
        })
        .collect();
    assert_eq!(truths[0], truths[1]);
}
