//! The world of a run in motion: a quantum at a time, as the simulator of stepped time asks for it.

use std::path::Path;

use guidance::se2::{Point, se2};
use guidedog_simulator::{Motion, Simulator};
use messages::{Attitude, Formation, MAX_WALKERS, Pose2, Twist2, Walker, WorldFrame, WorldScan, WorldTruth};
use mujoco_rs::prelude::*;
use nalgebra::{Rotation2, Vector2, Vector3};
use settings::{Mujoco, Settings};
use transport::{FramePublisher, Io, Rhythm, TransportError};
use world::floor::Falls;
use world::{
    Agent, DepthConfig, DepthSensor, Disturbance, LidarConfig, LidarSensor, People, PhysicsConfig, Scenario, TICK_S,
    World,
};

use crate::legs::{self, Legs, VelocityLoop};
use crate::person::{Person, PersonConfig};
use crate::rays::Rays;
use crate::robot::{Robot, RobotError};
use crate::scene::{self, STEP_S, Scene};
use crate::sight::Sight;
use crate::touch::Touches;

/// Steps of the physics in a quantum.
const STEPS: u64 = (TICK_S / STEP_S).round() as u64;
/// What a ray meets so close to height 0 is the floor, metres.
const FLOOR_M: f64 = 1e-3;
/// Beams of a scan that an emulated lidar takes its samples from, at every quantum: five to a degree, and none older
/// than a quantum. In a building of 24,000 boxes that is a sixth of a core (`examples/pace.rs`).
const EMULATED_BEAMS: usize = 1800;

/// The service.
pub type LeggedSimulator = Simulator<LeggedMotion>;

/// Reads the scenario and puts robot and handler in their places.
///
/// # Errors
/// Where a file cannot be read or is wrong, the start is not free, or a port cannot be opened.
pub fn open(io: &mut Io) -> Result<LeggedSimulator, TransportError> {
    Simulator::of(io, |io, settings, scenario, world| {
        let motion = LeggedMotion::new(settings, scenario, &world).map_err(TransportError::service)?;
        motion.seen_by(settings, io)
    })
}

/// A legged robot and a handler, and what their sensors see.
pub struct LeggedMotion {
    data: MjData<Box<MjModel>>,
    legs: Legs,
    person: Person,
    people: People,
    touches: Touches,
    /// Radii of robot and handler as people see them, metres.
    radii_m: [f64; 2],
    sensors: Option<Sensors>,
    standing_m: f64,
    world: World,
    falls: Falls,
    /// The robot's discs are so far ahead of its middle and behind it, metres.
    nose_m: f64,
    distance_m: f64,
    steps: u64,
    /// How the handler disturbs the walk.
    disturbances: Vec<Disturbance>,
}

/// Sensors, and where their readings go.
struct Sensors {
    /// What the lidar sees, and what the camera sees besides: dirty glass.
    lidar_rays: Rays,
    camera_rays: Rays,
    lidar: LidarSensor,
    camera: DepthSensor,
    scans: (FramePublisher<WorldScan>, Rhythm),
    frames: (FramePublisher<WorldFrame>, Rhythm),
    ranges_m: Vec<Option<f64>>,
    inverse_depths: Vec<f32>,
}

/// What keeps the world from beginning.
#[derive(Debug, thiserror::Error)]
pub enum MotionError {
    /// The settings do not name a file.
    #[error("simulation.mujoco.{0} names no file")]
    NoFile(&'static str),
    /// The scene cannot be built.
    #[error(transparent)]
    Scene(#[from] scene::SceneError),
    /// What stands beside the model is wrong.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The robot cannot walk.
    #[error(transparent)]
    Legs(#[from] legs::LegsError),
}

impl LeggedMotion {
    /// Robot and handler at the scenario's start, at rest.
    ///
    /// # Errors
    /// Where model or policy cannot be used.
    pub fn new(settings: &Settings, scenario: &Scenario, world: &World) -> Result<Self, MotionError> {
        let mujoco = &settings.simulation.mujoco;
        let file: &Path = mujoco.model.as_deref().ok_or(MotionError::NoFile("model"))?;
        let policy: &Path = mujoco.policy.as_deref().ok_or(MotionError::NoFile("policy"))?;
        let person = person(settings, mujoco);
        let robot = Robot::of(file)?;
        let scene = Scene { robot: file, world, start: scenario.start, body_m: robot.body_m, person: Some(person) };
        let mut model = scene.build()?;
        scene::scale_mass(&mut model, mujoco.mass_scale);
        scene::set_friction(&mut model, mujoco.friction);
        let legs = Legs::new(&model, &robot, policy, VelocityLoop::from(mujoco.velocity_loop))?;
        let person = Person::new(&model, person)?;
        let touches = Touches::new(&model, legs.feet())?;
        let mut data = MjData::new(Box::new(model));
        // Recomputes what MuJoCo derives from the masses.
        data.set_const();
        legs.pose(&mut data);
        person.pose(&mut data);
        let mut motion = Self {
            data,
            legs,
            person,
            people: People::new(&world.people()[..world.people().len().min(MAX_WALKERS)]),
            touches,
            radii_m: [settings.robot.radius_m.get(), settings.handler.radius_m.get()],
            sensors: None,
            standing_m: settings.robot.body_height_m.get(),
            world: world.clone(),
            falls: Falls::default(),
            nose_m: settings.robot.nose_m,
            distance_m: 0.0,
            steps: 0,
            disturbances: scenario.disturbances.clone(),
        };
        motion.place_people();
        Ok(motion)
    }

    /// With the sensors of the settings, whose drivers listen.
    ///
    /// # Errors
    /// Where a sensor is out of its bounds or a topic cannot be opened.
    fn seen_by(mut self, settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let (seed, incarnation) = (settings.simulation.seed, io.identity().incarnation);
        let (mut lidar, mut scans_hz) = (LidarConfig::from(&settings.lidar), settings.lidar.rate_hz.get());
        if settings.simulation.emulated.on {
            (lidar, scans_hz) = (lidar.all_round(EMULATED_BEAMS), 1.0 / TICK_S);
        }
        let lidar = LidarSensor::new(lidar, seed, incarnation);
        let camera = DepthSensor::new(DepthConfig::from(&settings.depth), seed, incarnation);
        let (lidar, camera) = (lidar.map_err(TransportError::service)?, camera.map_err(TransportError::service)?);
        let (beams, pixels) = (lidar.config().beams, camera.pixels());
        self.sensors = Some(Sensors {
            lidar_rays: Rays::new(&self.data, &[scene::SEEN], &[scene::PERSON]).over(&self.world),
            camera_rays: Rays::new(&self.data, &[scene::SEEN, scene::SEEN_BY_CAMERA], &[scene::PERSON])
                .over(&self.world),
            lidar,
            camera,
            scans: (io.frame_publisher(beams)?, Rhythm::at_hz(scans_hz)),
            frames: (io.frame_publisher(pixels)?, Rhythm::at_hz(settings.depth.rate_hz.get())),
            ranges_m: Vec::with_capacity(beams),
            inverse_depths: vec![0.0; pixels],
        });
        Ok(self)
    }

    /// Lets people walk and doors swing for one quantum. Returns whether robot or handler blocks one of them.
    fn move_people(&mut self) -> bool {
        let at = [self.world_from_robot(), self.person.place(&self.data)];
        let agent = |i: usize| Agent { at: Point::new(at[i].x_m, at[i].y_m), radius_m: self.radii_m[i] };
        let (time_s, agents) = (self.steps as f64 * STEP_S, [agent(0), agent(1)]);
        let walkers = self.people.walkers().map(|walker| Agent::from(&walker));
        let in_way: Vec<Agent> = agents.iter().copied().chain(walkers).collect();
        self.world.swing(time_s, TICK_S, &in_way);
        let mut is_walked_into = false;
        self.people.step(&self.world, time_s, TICK_S, &agents, |_, _| is_walked_into = true);
        self.place_people();
        is_walked_into
    }

    /// Puts people and leaves where they are, in the order in which they were added to the scene.
    fn place_people(&mut self) {
        let people = self.people.walkers().map(|walker| ([walker.x_m, walker.y_m, 0.0], 0.0));
        let doors = self.world.doors().zip(self.world.doors_rad());
        let leaves = doors.map(|((door, _), at_rad)| ([door.hinge.x, door.hinge.y, 0.0], at_rad));
        let places: Vec<_> = people.chain(leaves).collect();
        for (number, (place, yaw_rad)) in places.into_iter().enumerate() {
            self.data.mocap_pos_mut()[number] = place;
            self.data.mocap_quat_mut()[number] = scene::turned(yaw_rad);
        }
    }

    fn walkers(&self) -> [Walker; MAX_WALKERS] {
        let mut walkers = [Walker::default(); MAX_WALKERS];
        walkers.iter_mut().zip(self.people.walkers()).for_each(|(slot, walker)| *slot = walker);
        walkers
    }

    fn world_from_robot(&self) -> Pose2 {
        let (_, _, yaw_rad) = legs::attitude(&self.data).euler_angles();
        Pose2::new(self.data.qpos()[0], self.data.qpos()[1], yaw_rad)
    }

    fn velocity(&self) -> Twist2 {
        let (attitude, rates) = (legs::attitude(&self.data), self.data.qvel());
        let (_, _, yaw_rad) = attitude.euler_angles();
        let level = Rotation2::new(-yaw_rad) * Vector2::new(rates[0], rates[1]);
        let turns = attitude * nalgebra::Vector3::new(rates[3], rates[4], rates[5]);
        Twist2 { vx_mps: level.x, vy_mps: level.y, wz_radps: turns.z }
    }

    fn look_for_falls(&mut self) {
        let (robot, handler) = (se2(self.world_from_robot()), self.person.place(&self.data));
        let robot = [self.nose_m, -self.nose_m].map(|ahead_m| robot * Point::new(ahead_m, 0.0));
        self.falls.look(&self.world, [&robot, &[Point::new(handler.x_m, handler.y_m)]], self.radii_m);
    }

    fn attitude(&self) -> Attitude {
        let (roll_rad, pitch_rad, _) = legs::attitude(&self.data).euler_angles();
        let at = Point::new(self.data.qpos()[0], self.data.qpos()[1]);
        // Over the floor under the body, as legs tell it.
        let height_m = self.data.qpos()[2] - self.world.floor_m(at);
        // Any stamp marks it as known. The publisher sets the real one.
        Attitude { stamp_ns: 1, roll_rad, pitch_rad, height_m, standing_m: self.standing_m }
    }
}

/// The handler of the settings.
fn person(settings: &Settings, mujoco: &Mujoco) -> PersonConfig {
    let handler = PhysicsConfig::from(settings).handler;
    PersonConfig {
        robot_from_handler: handler.robot_from_handler,
        behind_m: handler.behind_m,
        radius_m: handler.radius_m,
        height_m: handler.height_m,
        mass_kg: mujoco.handler_mass_kg,
        reaction_s: mujoco.handler_reaction.s(),
        acceleration_mps2: mujoco.handler_acceleration_mps2,
    }
}

impl Motion for LeggedMotion {
    fn step(&mut self, command: Twist2) -> Result<(), TransportError> {
        let (before, is_walked_into) = (self.world_from_robot(), self.move_people());
        for _ in 0..STEPS {
            let time_s = self.steps as f64 * STEP_S;
            let disturbance = self.disturbances.iter().find(|disturbance| disturbance.is_at(time_s));
            self.person.walk(&mut self.data, disturbance.map(|disturbance| disturbance.kind));
            self.legs.drive(&mut self.data, command).map_err(TransportError::service)?;
            scene::step(&mut self.data).map_err(TransportError::service)?;
            self.touches.look(&self.data, is_walked_into);
            self.steps += 1;
        }
        let after = self.world_from_robot();
        self.look_for_falls();
        self.distance_m += (after.x_m - before.x_m).hypot(after.y_m - before.y_m);
        Ok(())
    }

    fn form(&mut self, formation: Formation) {
        self.person.form(formation);
    }

    fn truth(&self) -> WorldTruth {
        WorldTruth {
            world_from_robot: self.world_from_robot(),
            robot_twist: self.velocity(),
            attitude: self.attitude(),
            world_from_handler: self.person.place(&self.data),
            distance_m: self.distance_m,
            robot_collisions: self.touches.robot(),
            handler_collisions: self.touches.handler(),
            hit_by_others: self.touches.by_others(),
            robot_falls: self.falls.robot(),
            handler_falls: self.falls.handler(),
            walker_count: self.people.len() as u32,
            walkers: self.walkers(),
            doors_rad: self.world.doors_rad(),
            ..WorldTruth::default()
        }
    }

    fn sense(&mut self, stamp_ns: u64) -> Result<(), TransportError> {
        let Some(sensors) = &mut self.sensors else { return Ok(()) };
        let base = Sight::of(&self.data, self.standing_m);
        sensors.scan(&self.data, &base, stamp_ns)?;
        sensors.photograph(&self.data, &self.world, &base, stamp_ns)
    }
}

impl Sensors {
    fn scan(&mut self, data: &MjData<Box<MjModel>>, base: &Sight, stamp_ns: u64) -> Result<(), TransportError> {
        let Some(number) = self.scans.1.due(stamp_ns) else { return Ok(()) };
        self.lidar_rays.look(data);
        base.scan(self.lidar.config(), &mut self.lidar_rays, &mut self.ranges_m);
        let mut loan = self.scans.0.loan(self.ranges_m.len())?;
        loan.meta_mut().scan = self.lidar.scan_header();
        self.lidar.measure(|beam| self.ranges_m[beam], number, loan.data_mut());
        self.scans.0.publish(stamp_ns, loan).map(|_| ())
    }

    fn photograph(
        &mut self,
        data: &MjData<Box<MjModel>>,
        world: &World,
        base: &Sight,
        stamp_ns: u64,
    ) -> Result<(), TransportError> {
        let Some(number) = self.frames.1.due(stamp_ns) else { return Ok(()) };
        self.camera_rays.look(data);
        let (header, reach_m) = (self.camera.depth_header(), self.camera.config().range_max_m);
        let camera = &self.camera;
        let is_dark = |pixel: [usize; 2], at: &Vector3<f64>| {
            let is_floor = !world.dark_floor().is_empty() && at.z.abs() < FLOOR_M;
            is_floor && camera.is_dark(world, Point::from(at.xy()), number, pixel)
        };
        base.photograph(&header, reach_m, &mut self.camera_rays, is_dark, &mut self.inverse_depths);
        let mut loan = self.frames.0.loan(self.inverse_depths.len())?;
        loan.meta_mut().depth = header;
        let (width, depths) = (header.width as usize, &self.inverse_depths);
        let draw = |row: usize, out: &mut [f32]| out.copy_from_slice(&depths[row * width..(row + 1) * width]);
        self.camera.measure(draw, number, loan.data_mut());
        self.frames.0.publish(stamp_ns, loan).map(|_| ())
    }
}
