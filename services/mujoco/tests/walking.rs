//! A Go2 walks in MuJoCo as it is told, and what its sensors would see is there. Needs what scripts/mujoco brings.

use std::path::{Path, PathBuf};

use guidedog_mujoco::legs::{Legs, LegsError, VelocityLoop, attitude};
use guidedog_mujoco::rays::Rays;
use guidedog_mujoco::scene;
use messages::{Pose2, Twist2};
use mujoco_rs::prelude::*;
use world::World;

/// Height of the body over the floor before the first step, metres.
const BODY_M: f64 = 0.32;

fn brought(file: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/legs").join(file);
    assert!(path.exists(), "{} is missing: run scripts/mujoco", path.display());
    path
}

fn world(text: &str) -> World {
    World::from_toml("test.toml", text, Path::new("")).expect("a world")
}

/// A robot in a world, and how it walks.
struct Robot {
    data: MjData<Box<MjModel>>,
    legs: Legs,
}

impl Robot {
    fn new(world: &World, keeps: VelocityLoop) -> Self {
        let model = scene::build(&brought("go2/go2.xml"), world, Pose2::default(), BODY_M).expect("a scene");
        let legs = Legs::new(&model, &brought("go2/policy.onnx"), keeps).expect("legs");
        let mut data = MjData::new(Box::new(model));
        legs.pose(&mut data);
        Self { data, legs }
    }

    fn walk(&mut self, seconds: f64, vx_mps: f64, vy_mps: f64, wz_radps: f64) {
        for _ in 0..(seconds / scene::STEP_S).round() as u64 {
            self.legs.drive(&mut self.data, Twist2 { vx_mps, vy_mps, wz_radps }).expect("the policy decides");
            self.data.step();
        }
    }

    /// Place on the floor, metres, and heading, radians.
    fn pose(&self) -> Pose2 {
        let (_, _, yaw_rad) = attitude(&self.data).euler_angles();
        Pose2::new(self.data.qpos()[0], self.data.qpos()[1], yaw_rad)
    }
}

#[test]
fn it_walks_as_fast_as_it_is_told_and_stands_still_after_it() {
    for keeps in [VelocityLoop::SOFT, VelocityLoop::STIFF] {
        let mut robot = Robot::new(&world(""), keeps);
        robot.walk(1.0, 0.0, 0.0, 0.0);
        assert!(robot.legs.stands(), "{keeps:?}");
        robot.walk(2.0, 0.5, 0.0, 0.0);
        let from = robot.pose();
        robot.walk(4.0, 0.5, 0.0, 0.0);
        let way_m = robot.pose().x_m - from.x_m;
        assert!((1.8..2.2).contains(&way_m), "{way_m} m in 4 s at 0.5 m/s: {keeps:?}");
        let from = robot.pose();
        robot.walk(3.0, 0.0, 0.0, 0.0);
        let stood = robot.pose();
        assert!(robot.legs.stands() && (stood.x_m - from.x_m).abs() < 0.2, "{from:?} {stood:?}");
        robot.walk(5.0, 0.0, 0.0, 0.0);
        let drift_m = (robot.pose().x_m - stood.x_m).hypot(robot.pose().y_m - stood.y_m);
        assert!(drift_m < 0.01 && (robot.pose().yaw_rad - stood.yaw_rad).abs() < 0.02, "{drift_m} m: {keeps:?}");
        robot.walk(2.0, 0.0, 0.0, 0.349);
        let from = robot.pose();
        robot.walk(4.0, 0.0, 0.0, 0.349);
        let turned_rad = robot.pose().yaw_rad - from.yaw_rad;
        assert!((1.2..1.7).contains(&turned_rad), "{turned_rad} rad in 4 s at 0.349 rad/s: {keeps:?}");
    }
}

#[test]
fn two_walks_are_equal_to_the_bit() {
    let walk = || {
        let mut robot = Robot::new(&world(""), VelocityLoop::SOFT);
        robot.walk(3.0, 0.5, 0.1, 0.2);
        robot.data.qpos().iter().map(|number| number.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(walk(), walk());
}

#[test]
fn a_wall_stops_it() {
    let mut robot = Robot::new(&world("[[wall]]\npoints = [[1.0, -2.0], [1.0, 2.0]]\n"), VelocityLoop::SOFT);
    robot.walk(6.0, 0.5, 0.0, 0.0);
    assert!((0.4..0.8).contains(&robot.pose().x_m), "{:?}", robot.pose());
}

#[test]
fn a_ray_meets_what_mujocos_own_ray_meets() {
    let text = "[[wall]]\npoints = [[-3.0, 2.0], [8.0, 2.5]]\n\
                [[box]]\nat = [2.0, 0.5]\nsize = [0.6, 0.4]\nyaw_deg = 30\nz = [0.5, 1.5]\n\
                [[pillar]]\nat = [1.5, -1.5]\nradius_m = 0.3\n";
    let mut robot = Robot::new(&world(text), VelocityLoop::SOFT);
    let mut rays = Rays::new(&robot.data, &[scene::SEEN]);
    let mut groups = [0; 6];
    groups[scene::SEEN as usize] = 1;
    let mut met = 0;
    for i in 0..5000 {
        let angle = |of: f64| (f64::from(i) * of).sin();
        let way = nalgebra::Vector3::new(angle(1.1), angle(2.3), 0.6 * angle(3.7)).normalize();
        let from = [0.3 * angle(0.7), 0.3 * angle(0.9), 0.4 + 0.2 * angle(1.3)];
        let found = rays.cast(&from, &way.into(), 10.0);
        let (_, theirs) = robot.data.ray(&from, &way.into(), Some(&groups), true, None, None);
        let theirs = (0.0..10.0).contains(&theirs).then_some(theirs);
        assert_eq!(found, theirs, "from {from:?} along {way:?}");
        met += usize::from(found.is_some());
    }
    assert!((1000..5000).contains(&met), "{met}");
}

#[test]
fn what_is_no_go2_is_refused_with_what_it_lacks() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("box.xml");
    std::fs::write(
        &file,
        "<mujoco><worldbody><body name='base'><freejoint/><geom size='1'/></body></worldbody></mujoco>",
    )
    .expect("written");
    let model = scene::build(&file, &world(""), Pose2::default(), 1.0).expect("a scene");
    let missing = Legs::new(&model, &brought("go2/policy.onnx"), VelocityLoop::SOFT).err().expect("refused");
    assert!(matches!(&missing, LegsError::Missing(what) if what == "joint FR_hip_joint"), "{missing}");
    let error = scene::build(&folder.path().join("none.xml"), &world(""), Pose2::default(), 1.0).expect_err("refused");
    assert!(error.file.ends_with("none.xml"), "{error}");
}
