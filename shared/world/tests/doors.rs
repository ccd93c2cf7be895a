//! Doors that open during a walk.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::Arc;

use guidance::DelayedHarness;
use guidance::se2::{Point, Se2};
use guidedog_world::door::HOLDS_OFF_M;
use guidedog_world::{
    Agent, Bodies, Door, HandlerProfile, LidarConfig, LidarSensor, Opens, Physics, PhysicsConfig, Prism, Scene, SeenBy,
    Team, World,
};
use messages::{Pose2, Twist2, WorldTruth};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const ON: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 };
const TALL: [f64; 2] = [0.02, 1.8];

/// A leaf of 0.9 m in the wall to the right, which swings across the way.
fn door(opens: Opens, stays_s: f64) -> Door {
    Door {
        hinge: Point::new(3.0, -1.0),
        size_m: [0.9, 0.04],
        z: [0.0, 2.05],
        swing_rad: [0.0, FRAC_PI_2],
        speed_radps: 1.0,
        opens,
        stays_s,
        seen_by: SeenBy::Both,
    }
}

fn corridor(door: Door) -> World {
    let wall = |y_m: f64| Prism::wall(vec![Point::new(-5.0, y_m), Point::new(20.0, y_m)], [0.0, 2.6]);
    World::new(2.6, vec![wall(-1.05), wall(1.05)]).with_doors([door])
}

fn swing_for(world: &mut World, [from_s, to_s]: [f64; 2], agents: &[Agent]) {
    let ticks = ((to_s - from_s) * 100.0).round() as usize;
    for tick in 0..ticks {
        world.swing(from_s + 0.01 * tick as f64, 0.01, agents);
    }
}

#[test]
fn a_door_opens_stays_and_shuts_again() {
    let mut world = corridor(door(Opens::At(1.0), 2.0));
    let in_way = Point::new(3.0, -0.5);
    let clearance_m = |world: &World| world.clearance(in_way, TALL, 1.0);
    let shut_m = clearance_m(&world);
    swing_for(&mut world, [0.0, 0.9], &[]);
    assert_eq!((world.doors_rad()[0], clearance_m(&world)), (0.0, shut_m));
    swing_for(&mut world, [0.9, 2.0], &[]);
    assert!((world.doors_rad()[0] - 1.0).abs() < 0.02, "{}", world.doors_rad()[0]);
    swing_for(&mut world, [2.0, 4.4], &[]);
    assert_eq!(world.doors_rad()[0], FRAC_PI_2);
    assert_eq!(clearance_m(&world), 0.0, "the leaf stands there");
    assert!(world.is_blocked(Point::new(2.0, -0.5), Point::new(4.0, -0.5), 0.3, TALL));
    let range_m = world.cast(Point::new(0.0, -0.5), nalgebra::Vector2::x(), 0.4, 10.0);
    assert!(range_m.is_some_and(|range_m| (range_m - 2.98).abs() < 1e-9), "{range_m:?}");
    swing_for(&mut world, [4.4, 20.0], &[]);
    assert_eq!((world.doors_rad()[0], clearance_m(&world)), (0.0, shut_m), "once, and no more");
    assert!(!world.swing(20.0, 10.0, &[]));
}

#[test]
fn a_door_waits_for_the_robot_to_come_near() {
    let mut world = corridor(door(Opens::Near(2.0), 2.0));
    let robot = |x_m: f64| Agent { at: Point::new(x_m, 0.0), radius_m: 0.3 };
    swing_for(&mut world, [0.0, 10.0], &[robot(1.0), robot(3.0)]);
    assert_eq!(world.doors_rad()[0], 0.0, "the handler opens nothing");
    swing_for(&mut world, [10.0, 10.5], &[robot(1.5)]);
    assert!(world.doors_rad()[0] > 0.4);
}

/// Who stands in the way, on both ways of the leaf.
#[test]
fn a_leaf_stops_before_who_is_in_its_way_and_tries_again() {
    let mut world = corridor(door(Opens::At(0.0), 1.0));
    let agent = Agent { at: Point::new(3.2, 0.3), radius_m: 0.25 };
    let room_m = |world: &World| world.clearance(agent.at, TALL, 5.0) - agent.radius_m;
    swing_for(&mut world, [0.0, 5.0], &[agent]);
    let held_rad = world.doors_rad()[0];
    assert!((0.1..1.2).contains(&held_rad), "{held_rad}");
    assert!((room_m(&world) - HOLDS_OFF_M).abs() < 0.03, "{}", room_m(&world));
    swing_for(&mut world, [5.0, 6.6], &[]);
    assert_eq!(world.doors_rad()[0], FRAC_PI_2);
    let beyond = Agent { at: Point::new(3.9, -0.6), radius_m: 0.25 };
    swing_for(&mut world, [6.6, 20.0], &[beyond]);
    let held_rad = world.doors_rad()[0];
    assert!((0.5..1.5).contains(&held_rad), "{held_rad}");
    swing_for(&mut world, [20.0, 22.0], &[]);
    assert_eq!(world.doors_rad()[0], 0.0);
}

/// A leaf neither touches nor jumps over an agent that stands, whatever the length of a step.
#[test]
fn a_leaf_touches_nobody() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut held = 0;
    for _ in 0..500 {
        let mut within = |[least, most]: [f64; 2]| random.random_range(least..most);
        let swing_rad = [within([-3.0, 3.0]), within([-3.0, 3.0])];
        let (size_m, speed_radps, dt_s) = ([within([0.3, 2.0]), 0.04], within([0.1, 3.0]), within([0.01, 1.0]));
        let door = Door { size_m, swing_rad, speed_radps, ..door(Opens::At(0.0), 0.5) };
        let mut world = World::new(2.6, Vec::new()).with_doors([door]);
        let at = Point::new(within([1.0, 5.0]), within([-3.0, 1.0]));
        let agent = Agent { at, radius_m: within([0.1, 0.4]) };
        // The leaf's corners are off its middle line by half of its thickness.
        let room_m = |world: &World| world.clearance(agent.at, TALL, 9.0) - agent.radius_m + 0.02;
        let least_m = room_m(&world).min(HOLDS_OFF_M) - 0.02;
        let (mut is_held, steps) = (false, 200);
        for step in 0..steps {
            let has_moved = world.swing(f64::from(step) * dt_s, dt_s, &[agent]);
            is_held |= !has_moved && (world.doors_rad()[0] - swing_rad[0]).abs() > 1e-9;
            assert!(room_m(&world) >= least_m, "{agent:?} {} {least_m}", room_m(&world));
        }
        held += usize::from(is_held);
    }
    assert!(held > 100, "{held}");
}

/// The simulator's truth tells sensors of other processes how doors are turned.
#[test]
fn a_robot_that_walks_up_to_a_door_is_not_touched_by_it_and_sees_it() {
    let world = corridor(door(Opens::Near(2.2), 3.0));
    let start = Pose2::new(0.0, 0.0, 0.0);
    let mut physics = Physics::new(Arc::new(world.clone()), PhysicsConfig::default(), start).expect("a free start");
    let config = LidarConfig { sigma_m: 0.0, drop_out: 0.0, ..LidarConfig::default() };
    let mut lidar = LidarSensor::new(config, 1, 1).expect("a lidar");
    let (mut sensors, mut ranges_m) = (world, vec![0.0; lidar.config().beams]);
    let (mut least_m, mut truth) = (f64::INFINITY, physics.truth());
    for tick in 0..1500_u64 {
        // Where the leaf crosses its way it waits.
        let ahead = Point::new(truth.world_from_robot.x_m + 0.8, truth.world_from_robot.y_m);
        let is_free = physics.world().clearance(ahead, TALL, 0.4) >= 0.4;
        physics.step(if is_free { ON } else { Twist2::ZERO });
        truth = physics.truth();
        let scene = Scene::from_truth(&mut sensors, &truth);
        assert_eq!(scene.world.prisms(), physics.world().prisms());
        if tick.is_multiple_of(10) {
            lidar.scan(&scene, tick, &mut ranges_m);
            let nearest_m = ranges_m.iter().copied().filter(|range_m| *range_m > 0.0).fold(f32::INFINITY, f32::min);
            least_m = f64::min(least_m, f64::from(nearest_m));
        }
    }
    assert_eq!((truth.robot_collisions, truth.handler_collisions), (0, 0));
    assert!(truth.world_from_robot.x_m > 5.0 && truth.doors_rad[0] == 0.0, "{truth:?}");
    assert!(least_m < 0.9, "the leaf came between the walls and the robot: {least_m}");
}

#[test]
fn a_team_that_stands_is_not_touched_by_a_door() {
    let mut world = corridor(door(Opens::Near(9.0), 3.0));
    let at = Se2::translation(3.2, 0.5);
    let team = Team::new(&world, Bodies::default(), HandlerProfile::exact(DelayedHarness::default()), &at);
    for _ in 0..20 {
        let mut walked = team.clone();
        team.swing_doors(&mut world, 0.5);
        assert!(!walked.step(&world, Twist2::ZERO, 0.5).collided() && team.is_free(&world, 0.0));
    }
    assert!(world.doors_rad()[0] > 0.0, "it begins to open");
}

#[test]
fn doors_of_a_world_file() {
    let text = "[[door]]\nhinge = [3, -1]\nlength_m = 0.9\nshut_deg = 0\nopen_deg = 90\nopens_near_m = 2\n";
    let read = |text: &str| World::from_toml("w.toml", text, Path::new(""));
    let world = read(text).expect("a world");
    let (found, prism) = world.doors().next().expect("a door");
    let expected = Door { stays_s: 5.0, speed_radps: 60.0_f64.to_radians(), ..door(Opens::Near(2.0), 5.0) };
    assert_eq!((found, &world.prisms()[prism]), (&expected, &expected.leaf(0.0)));
    let glass = read(&format!("{text}seen_by = \"camera\"\n")).expect("a world");
    assert_eq!(glass.prisms()[0].seen_by, SeenBy::Camera);
    for (text, expected) in [
        (format!("\n{text}opens_s = 3\n"), "w.toml:2: door: needs either opens_s or opens_near_m"),
        (text.replace("opens_near_m = 2", "stays_s = 1"), "w.toml:1: door: needs either"),
        (text.replace("0.9", "0"), "w.toml:1: length_m: 0 is not in"),
        (format!("{text}speed_degps = 0\n"), "w.toml:1: speed_degps: 0 is not in"),
        (format!("{text}seen_by = \"all\"\n"), "w.toml:7: unknown variant `all`"),
        (text.repeat(9), "w.toml:49: door: there are over 8 doors"),
    ] {
        let error = read(&text).expect_err("wrong").to_string();
        assert!(error.starts_with(expected), "{error}");
    }
    let two = read(&text.repeat(2)).expect("a world");
    let mut turned = two.clone();
    let truth = WorldTruth { doors_rad: [0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..WorldTruth::default() };
    assert_eq!(Scene::from_truth(&mut turned, &truth).world.prisms().len(), 2);
    assert_eq!(turned.doors_rad(), truth.doors_rad);
    assert_eq!(turned.prisms()[1], expected.leaf(1.0));
}
