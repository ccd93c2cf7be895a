//! Both sides of what is remembered, on a body that sways and with a noisy camera: what is not there is not remembered,
//! and what is there and out of sight is not forgotten.

#![allow(clippy::print_stdout, reason = "the figures are worth reading")]

use std::sync::Arc;

use guidance::Awareness;
use guidance::se2::{Point, se2};
use messages::{Attitude, DepthHeader, Header, Odometry, Pose2, ScanHeader, Twist2, WorldTruth};
use settings::{Profile, Settings};
use world::{
    DepthConfig, DepthSensor, LidarConfig, LidarSensor, OdometryConfig, OdometrySensor, Physics, PhysicsConfig,
};
use world::{Prism, Scene, World};

/// Everything between floor and head, metres.
const BODY_M: [f64; 2] = [0.03, 1.9];
/// A remembered point this far from anything, and farther than it is uncertain, is of nothing, metres: three sigma of
/// the lidar, and half a cell.
const OFF_M: f64 = 0.10;
/// Low things stand this far apart along the corridor, metres, and so far to either side.
const EVERY_M: f64 = 1.5;
const ASIDE_M: f64 = 0.85;

/// A Go2 on legs, whose camera has 160x120 pixels and the noise of Redwood 1.0.
fn go2() -> Settings {
    let mut settings = settings::load(Profile::Go2, None).expect("it is built in");
    settings.simulation.noise = settings::SimulatedNoise::Legged;
    (settings.depth.width, settings.depth.height, settings.depth.redwood) = (160, 120, 1.0);
    settings
}

/// A corridor, and in it low blocks to either side of the way: below the lidar's plane.
fn corridor(block_m: Option<f64>) -> World {
    let wall = |y_m: f64| Prism::wall(vec![Point::new(-3.0, y_m), Point::new(40.0, y_m)], [0.0, 2.6]);
    let mut prisms = vec![wall(1.6), wall(-1.6)];
    let block = |i: usize, high_m: f64| {
        let aside_m = if i.is_multiple_of(2) { ASIDE_M } else { -ASIDE_M };
        Prism::cuboid(Point::new(2.0 + EVERY_M * i as f64, aside_m), [0.2, 0.2], 0.0, [0.0, high_m])
    };
    prisms.extend(block_m.into_iter().flat_map(|high_m| (0..18).map(move |i| block(i, high_m))));
    World::new(2.6, prisms)
}

/// What is remembered on a walk.
#[derive(Debug, Default)]
struct Figures {
    remembered: usize,
    false_points: usize,
    /// Blocks that stood beside robot or handler and out of sight, and how many of them were remembered.
    passed: usize,
    known: usize,
}

/// The sensors of a walk, and what is made of them.
struct Walk {
    world: Arc<World>,
    lidar: LidarSensor,
    camera: DepthSensor,
    odometry: OdometrySensor,
    awareness: Awareness,
    ranges_m: Vec<f32>,
    pixels_mm: Vec<u16>,
}

impl Walk {
    fn new(settings: &Settings, world: World, seed: u64) -> Self {
        let lidar = LidarSensor::new(LidarConfig::from(&settings.lidar), seed, 1).expect("a lidar");
        let camera = DepthSensor::new(DepthConfig::from(&settings.depth), seed, 1).expect("a camera");
        let odometry = OdometrySensor::new(OdometryConfig::from(&settings.odometry), seed, 1).expect("odometry");
        let model = settings.interaction().expect("a handler");
        Self {
            world: Arc::new(world),
            ranges_m: vec![0.0; lidar.config().beams],
            pixels_mm: vec![0; camera.pixels()],
            lidar,
            camera,
            odometry,
            awareness: Awareness::new(model, settings.awareness_config()),
        }
    }

    /// Looks at the world from where the robot is at a tick of 10 ms.
    fn look(&mut self, tick: u64, truth: &WorldTruth) {
        let reading = self.odometry.update(tick, truth.world_from_robot, truth.robot_twist);
        if !tick.is_multiple_of(10) {
            return;
        }
        let scene = Scene::from_truth(Arc::make_mut(&mut self.world), truth);
        self.lidar.scan(&scene, tick, &mut self.ranges_m);
        self.camera.render(&scene, tick, &mut self.pixels_mm);
        let header = Header { stamp_ns: tick * 10_000_000, seq: tick, ..Header::default() };
        let attitude = self.odometry.attitude(tick, &truth.attitude);
        self.awareness.take_odometry(&Odometry {
            header,
            odom_from_robot: reading.odom_from_robot,
            twist: reading.twist,
            attitude: Attitude { stamp_ns: header.stamp_ns, ..attitude },
            ..Odometry::default()
        });
        if tick == 0 {
            self.awareness.rest();
        }
        let frame = DepthHeader { header, ..self.camera.depth_header() };
        self.awareness.take_depth(&frame, &self.pixels_mm);
        assert_eq!(self.awareness.refused_frames(), 0, "usable");
        let scan = ScanHeader { header, ..self.lidar.scan_header() };
        assert!(self.awareness.take_scan(header.stamp_ns, 1.0, &scan, &self.ranges_m), "usable");
        if tick.is_multiple_of(50) {
            self.awareness.begin_step();
        }
    }

    fn count(&self, truth: &WorldTruth, figures: &mut Figures) {
        let world_from_robot = se2(truth.world_from_robot);
        let hidden = self.awareness.evidence(0).memory.map_or(&[][..], |memory| memory.hidden());
        let places: Vec<(Point, f64)> =
            hidden.iter().map(|spot| (world_from_robot * spot.place, spot.uncertainty_m)).collect();
        let handler = se2(truth.world_from_handler);
        let on_handler = |place: &Point| (handler.inverse() * place).coords.norm() < 0.35;
        let is_false = |(at, uncertainty_m): &&(Point, f64)| {
            self.world.clearance(*at, BODY_M, 1.0) > OFF_M + uncertainty_m && !on_handler(at)
        };
        figures.remembered += places.len();
        figures.false_points += places.iter().filter(is_false).count();
        for block in self.world.prisms().iter().filter(|prism| prism.solid) {
            let middle = nalgebra::center(&block.outline[0], &block.outline[2]);
            let ahead_m = (world_from_robot.inverse() * middle).x;
            // From beside the robot's middle, where the camera no longer sees it, to behind the handler.
            if (-1.0..0.2).contains(&ahead_m) && truth.world_from_robot.x_m > 3.0 {
                figures.passed += 1;
                figures.known += usize::from(places.iter().any(|(at, _)| (at - middle).norm() < 0.3));
            }
        }
    }
}

fn walk(block_m: Option<f64>, seed: u64) -> Figures {
    let (settings, mut figures) = (go2(), Figures::default());
    let mut walk = Walk::new(&settings, corridor(block_m), seed);
    let config = PhysicsConfig { seed, ..PhysicsConfig::from(&settings) };
    let mut physics = Physics::new(Arc::clone(&walk.world), config, Pose2::default()).expect("a free start");
    for tick in 0..5_000 {
        let truth = physics.truth();
        walk.look(tick, &truth);
        if tick.is_multiple_of(50) {
            walk.count(&truth, &mut figures);
        }
        // Along the middle: what slips is steered back.
        let pose = truth.world_from_robot;
        let wz_radps = (-0.5 * pose.y_m - pose.yaw_rad).clamp(-0.35, 0.35);
        physics.step(Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps });
    }
    figures
}

#[test]
fn hardly_anything_is_remembered_where_nothing_is() {
    let mut all = Figures::default();
    for (block_m, seed) in [(None, 1), (None, 2), (Some(0.12), 3)] {
        let figures = walk(block_m, seed);
        println!("{block_m:?} {seed}: {figures:?}");
        all.remembered += figures.remembered;
        all.false_points += figures.false_points;
    }
    assert!(all.remembered > 1_000, "{all:?}");
    assert!(all.false_points * 200 < all.remembered, "{all:?}");
}

#[test]
fn a_low_thing_that_is_out_of_sight_is_remembered_until_the_handler_has_passed_it() {
    let mut all = Figures::default();
    for seed in 1..=2 {
        let figures = walk(Some(0.12), seed);
        println!("{seed}: {figures:?}");
        all.passed += figures.passed;
        all.known += figures.known;
    }
    assert!(all.passed > 50, "{all:?}");
    assert!(all.known * 100 >= all.passed * 99, "{all:?}");
}
