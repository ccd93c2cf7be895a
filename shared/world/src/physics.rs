//! Robot, handler and people in motion, and the truth about what they touch. One tick is 10 ms.
//!
//! The robot follows a commanded body velocity within its accelerations, or as its [`Legs`] do. The handler is drawn
//! after it by the harness: the offset in the robot's frame relaxes to its default with a time constant. A handler who
//! is held up for a second lets the handle go, and walks back to it. A motion that
//! would touch something is cut off before the touch and counted, once until there is room again. Where the footprint
//! of robot or handler leaves the floor it has fallen.

mod handler;

use std::sync::Arc;

use guidance::se2::{Point, Se2, exp, pose2, se2, wrap_angle};
use messages::{Attitude, Header, MAX_WALKERS, Pose2, Twist2, Walker, WorldTruth};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::floor::Falls;
use crate::outline::Outline;
use crate::people::Agent;
use crate::{ConfigError, Legs, LegsConfig, People, World, WorldError};
use handler::Hand;

pub use handler::RETURNING_MPS;

/// One tick, seconds: the quantum of stepped time.
pub const TICK_S: f64 = messages::QUANTUM_NS as f64 * 1e-9;
/// A touch ends when there is this much room again, metres.
const RELEASE_M: f64 = 0.02;
/// Whoever comes closer to somebody faster than this has walked into them, metres per second.
const CLOSING_MPS: f64 = 0.05;

/// What the robot's body can do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobotConfig {
    /// Radius of the disc around the body, metres.
    pub radius_m: f64,
    /// Two such discs stand for a long body, so far ahead of its middle and behind it, metres; 0 is one disc.
    pub nose_m: f64,
    /// Height of the body, metres: what is above it does not touch it.
    pub height_m: f64,
    /// Speeding up and changing direction, m/s^2.
    pub acceleration_mps2: f64,
    /// Slowing down at a command of zero, m/s^2.
    pub braking_mps2: f64,
    /// Change of the turning rate, rad/s^2.
    pub turn_acceleration_radps2: f64,
    /// Change of the turning rate at a command of zero, rad/s^2.
    pub turn_braking_radps2: f64,
    /// The fastest it can walk, m/s.
    pub speed_max_mps: f64,
    /// The fastest it can turn, rad/s.
    pub turn_max_radps: f64,
}

impl Default for RobotConfig {
    fn default() -> Self {
        Self {
            radius_m: 0.30,
            nose_m: 0.0,
            height_m: 0.60,
            acceleration_mps2: 2.0,
            braking_mps2: 4.0,
            turn_acceleration_radps2: 6.0,
            turn_braking_radps2: 12.0,
            speed_max_mps: 1.5,
            turn_max_radps: 2.5,
        }
    }
}

/// How the handler follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HandlerConfig {
    /// Where the handler walks when the robot does not turn or change speed.
    pub robot_from_handler: Pose2,
    /// In single file they walk so far behind the robot, metres, centre to centre.
    pub behind_m: f64,
    /// The delayed harness (Kim et al. 2023, eq. 2): remembered share of the offset per step of `dt_s`, 0 to 0.9.
    pub alpha: f64,
    /// The step that `alpha` is for, seconds.
    pub dt_s: f64,
    /// Radius of the disc around the body, metres.
    pub radius_m: f64,
    /// Height of the body, metres.
    pub height_m: f64,
    /// Swaying to either side while walking, metres.
    pub sway_m: f64,
    /// Period of the swaying, seconds.
    pub sway_period_s: f64,
    /// The robot cannot get farther away than the harness and an arm reach, metres, centre to centre.
    pub reach_m: f64,
}

impl Default for HandlerConfig {
    fn default() -> Self {
        Self {
            robot_from_handler: Pose2::new(-0.75, -0.35, 0.0),
            behind_m: 1.2,
            alpha: 0.4,
            dt_s: 0.5,
            radius_m: 0.25,
            height_m: 1.80,
            sway_m: 0.0,
            sway_period_s: 1.2,
            reach_m: 1.5,
        }
    }
}

impl HandlerConfig {
    /// The time constant that lags at a steady speed v as `alpha` does, v alpha / (1 - alpha) dt, seconds.
    #[must_use]
    pub fn time_constant_s(&self) -> f64 {
        self.alpha / (1.0 - self.alpha) * self.dt_s
    }
}

/// Robot and handler.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsConfig {
    /// The robot.
    pub robot: RobotConfig,
    /// The handler.
    pub handler: HandlerConfig,
    /// How the robot walks on legs; none: it follows every command within its accelerations.
    pub legs: Option<LegsConfig>,
    /// The sway of its legs depends on it.
    pub seed: u64,
}

impl PhysicsConfig {
    /// Refuses what no robot or handler is like.
    ///
    /// # Errors
    /// Names the first key that is out of its bounds.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let (robot, handler) = (&self.robot, &self.handler);
        let offset = handler.robot_from_handler;
        ConfigError::check("robot.radius_m", robot.radius_m, 0.05, 2.0)?;
        ConfigError::check("robot.nose_m", robot.nose_m, 0.0, 1.0)?;
        ConfigError::check("robot.height_m", robot.height_m, 0.05, 3.0)?;
        ConfigError::check("robot.acceleration_mps2", robot.acceleration_mps2, 0.01, 1000.0)?;
        ConfigError::check("robot.braking_mps2", robot.braking_mps2, 0.01, 1000.0)?;
        ConfigError::check("robot.turn_acceleration_radps2", robot.turn_acceleration_radps2, 0.01, 1000.0)?;
        ConfigError::check("robot.turn_braking_radps2", robot.turn_braking_radps2, 0.01, 1000.0)?;
        ConfigError::check("robot.speed_max_mps", robot.speed_max_mps, 0.01, 10.0)?;
        ConfigError::check("robot.turn_max_radps", robot.turn_max_radps, 0.01, 20.0)?;
        ConfigError::check("handler.robot_from_handler.x_m", offset.x_m, -3.0, 3.0)?;
        ConfigError::check("handler.robot_from_handler.y_m", offset.y_m, -3.0, 3.0)?;
        ConfigError::check("handler.robot_from_handler.yaw_rad", offset.yaw_rad, -3.2, 3.2)?;
        ConfigError::check("handler.behind_m", handler.behind_m, 0.1, 3.0)?;
        ConfigError::check("handler.alpha", handler.alpha, 0.0, 0.9)?;
        ConfigError::check("handler.dt_s", handler.dt_s, 0.01, 10.0)?;
        ConfigError::check("handler.radius_m", handler.radius_m, 0.05, 2.0)?;
        ConfigError::check("handler.height_m", handler.height_m, 0.05, 3.0)?;
        ConfigError::check("handler.sway_m", handler.sway_m, 0.0, 0.3)?;
        ConfigError::check("handler.sway_period_s", handler.sway_period_s, 0.1, 60.0)?;
        ConfigError::check("handler.reach_m", handler.reach_m, offset.x_m.hypot(offset.y_m), 10.0)
    }
}

/// Robot or handler as a disc that may touch things.
#[derive(Debug, Clone)]
struct Body {
    radius_m: f64,
    z: [f64; 2],
    touching: bool,
    /// Whether the touch with each walking person has been counted.
    with_person: [bool; MAX_WALKERS],
    collisions: u32,
}

/// Steps and ramps are walked over: what is not higher is no obstacle, metres.
pub(crate) const STEP_M: f64 = 0.02;

const ROBOT: usize = 0;
const HANDLER: usize = 1;

/// The world in motion.
#[derive(Debug, Clone)]
pub struct Physics {
    world: Arc<World>,
    config: PhysicsConfig,
    people: People,
    walkers: [Walker; MAX_WALKERS],
    world_from_robot: Se2,
    world_from_handler: Se2,
    twist: Twist2,
    legs: Option<Legs>,
    hand: Hand,
    bodies: [Body; 2],
    hit_by_others: u32,
    falls: Falls,
    distance_m: f64,
    ticks: u64,
}

impl Physics {
    /// Robot at `start` (world frame), handler at the default offset, both at rest.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds, the start is not finite, robot or handler would stand in
    /// something, or the world has ramps, which this physics does not know.
    pub fn new(world: Arc<World>, config: PhysicsConfig, start: Pose2) -> Result<Self, WorldError> {
        config.validate()?;
        if !start.is_finite() {
            return Err(WorldError::StartNotFinite);
        }
        if !world.ramps().is_empty() {
            return Err(WorldError::Ramps);
        }
        let world_from_robot = se2(start);
        let body = |radius_m, height_m| Body {
            radius_m,
            z: [STEP_M, height_m],
            touching: false,
            with_person: [false; MAX_WALKERS],
            collisions: 0,
        };
        let mut physics = Self {
            falls: Falls::default(),
            people: People::new(&world.people()[..world.people().len().min(MAX_WALKERS)]),
            walkers: [Walker::default(); MAX_WALKERS],
            world_from_robot,
            world_from_handler: world_from_robot * se2(config.handler.robot_from_handler),
            twist: Twist2::ZERO,
            legs: config.legs.clone().map(|legs| Legs::new(legs, config.seed)).transpose()?,
            hand: Hand::default(),
            bodies: [
                body(config.robot.radius_m, config.robot.height_m),
                body(config.handler.radius_m, config.handler.height_m),
            ],
            hit_by_others: 0,
            distance_m: 0.0,
            ticks: 0,
            world,
            config,
        };
        physics.note_walkers();
        physics.check_start("robot", ROBOT)?;
        physics.check_start("handler", HANDLER)?;
        Ok(physics)
    }

    fn check_start(&self, who: &'static str, body: usize) -> Result<(), WorldError> {
        let (at, needed_m) = (self.place(body), self.bodies[body].radius_m);
        let clearance_m = self.clearance(body, needed_m);
        if clearance_m >= needed_m {
            return Ok(());
        }
        Err(WorldError::StartBlocked { who, x_m: at.x, y_m: at.y, needed_m, clearance_m })
    }

    /// The world that everybody is in.
    #[must_use]
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Ticks so far.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// The truth; header and the command in force are left for the publisher.
    #[must_use]
    pub fn truth(&self) -> WorldTruth {
        WorldTruth {
            header: Header::default(),
            world_from_robot: pose2(&self.world_from_robot),
            robot_twist: self.twist,
            attitude: self.legs.as_ref().map_or(Attitude::default(), Legs::attitude),
            world_from_handler: pose2(&self.world_from_handler),
            command: Twist2::ZERO,
            command_since_ns: 0,
            distance_m: self.distance_m,
            robot_collisions: self.bodies[ROBOT].collisions,
            handler_collisions: self.bodies[HANDLER].collisions,
            hit_by_others: self.hit_by_others,
            robot_falls: self.falls.robot(),
            handler_falls: self.falls.handler(),
            walker_count: self.people.len() as u32,
            walkers: self.walkers,
            doors_rad: self.world.doors_rad(),
        }
    }

    /// One tick of [`TICK_S`] under a commanded velocity (robot frame). A command that is not finite counts as zero.
    /// Where robot or handler has fallen neither moves any more.
    pub fn step(&mut self, command: Twist2) {
        self.swing_doors();
        self.move_people();
        if self.falls.any() {
            self.twist = Twist2::ZERO;
            self.ticks += 1;
            return;
        }
        let command = if command.is_finite() { command } else { Twist2::ZERO };
        match &mut self.legs {
            Some(legs) => self.twist = legs.go(command, TICK_S),
            None => self.accelerate(command),
        }
        self.move_robot();
        self.move_handler();
        for body in [ROBOT, HANDLER] {
            self.release(body);
        }
        let radii_m = [ROBOT, HANDLER].map(|body| self.bodies[body].radius_m);
        self.falls.look(&self.world, [&self.outline(ROBOT), &self.outline(HANDLER)], radii_m);
        self.ticks += 1;
    }

    fn place(&self, body: usize) -> Point {
        let pose = if body == ROBOT { &self.world_from_robot } else { &self.world_from_handler };
        Point::from(pose.translation.vector)
    }

    /// The discs of a body.
    fn outline(&self, body: usize) -> Outline {
        match body {
            ROBOT => Outline::of(&self.world_from_robot, self.config.robot.nose_m),
            _ => Outline::of(&self.world_from_handler, 0.0),
        }
    }

    /// The discs of robot and handler, and whose each of them is.
    fn agents(&self) -> (Vec<Agent>, Vec<usize>) {
        let (mut agents, mut bodies) = (Vec::with_capacity(3), Vec::with_capacity(3));
        for body in [ROBOT, HANDLER] {
            for at in self.outline(body).iter() {
                agents.push(Agent { at: *at, radius_m: self.bodies[body].radius_m });
                bodies.push(body);
            }
        }
        (agents, bodies)
    }

    fn swing_doors(&mut self) {
        if self.world.doors().len() == 0 {
            return;
        }
        let (mut agents, _) = self.agents();
        agents.extend(self.walkers[..self.people.len()].iter().map(Agent::from));
        Arc::make_mut(&mut self.world).swing(self.ticks as f64 * TICK_S, TICK_S, &agents);
    }

    fn move_people(&mut self) {
        if self.people.is_empty() {
            return;
        }
        let (agents, bodies) = self.agents();
        let (mut touches, mut count) = ([(0, 0); 3 * MAX_WALKERS], 0);
        self.people.step(&self.world, self.ticks as f64 * TICK_S, TICK_S, &agents, |person, agent| {
            touches[count] = (person, bodies[agent]);
            count += 1;
        });
        for &(person, agent) in &touches[..count] {
            // Who was walking into the person is told by the agent's own motion.
            if !self.bodies[agent].with_person[person] && !self.closes_in(agent, person) {
                self.bodies[agent].with_person[person] = true;
                self.hit_by_others += 1;
            }
        }
        self.note_walkers();
    }

    fn note_walkers(&mut self) {
        for (slot, walker) in self.walkers.iter_mut().zip(self.people.walkers()) {
            *slot = walker;
        }
    }

    /// Whether the robot's motion leads the agent into a person: the handler is taken to move as the robot does.
    fn closes_in(&self, agent: usize, person: usize) -> bool {
        let walker = &self.walkers[person];
        let to_person = Point::new(walker.x_m, walker.y_m) - self.place(agent);
        let velocity = self.world_from_robot.rotation * Vector2::new(self.twist.vx_mps, self.twist.vy_mps);
        velocity.dot(&to_person) > CLOSING_MPS * to_person.norm()
    }

    /// Takes the velocity towards the command, as fast as the body can.
    fn accelerate(&mut self, command: Twist2) {
        let robot = &self.config.robot;
        let stopping = command.is_zero();
        let (rate, turn_rate) = match stopping {
            true => (robot.braking_mps2, robot.turn_braking_radps2),
            false => (robot.acceleration_mps2, robot.turn_acceleration_radps2),
        };
        let now = Vector2::new(self.twist.vx_mps, self.twist.vy_mps);
        let wanted = Vector2::new(command.vx_mps, command.vy_mps).cap_magnitude(robot.speed_max_mps);
        let next = now + (wanted - now).cap_magnitude(rate * TICK_S);
        let turn = command.wz_radps.clamp(-robot.turn_max_radps, robot.turn_max_radps) - self.twist.wz_radps;
        let turn = turn.clamp(-turn_rate * TICK_S, turn_rate * TICK_S);
        self.twist = Twist2 { vx_mps: next.x, vy_mps: next.y, wz_radps: self.twist.wz_radps + turn };
    }

    fn move_robot(&mut self) {
        let wanted = self.world_from_robot * exp(self.twist, TICK_S);
        let (from, to) = (self.place(ROBOT), Point::from(wanted.translation.vector));
        let share = self.free_share(ROBOT, &self.outline(ROBOT), &Outline::of(&wanted, self.config.robot.nose_m));
        let cut = share < 1.0;
        let mut reached = if cut { from + (to - from) * share } else { to };
        // A round body turns on the spot whatever is beside it.
        let turned = if cut && self.config.robot.nose_m > 0.0 { share } else { 1.0 };
        let before_rad = self.world_from_robot.rotation.angle();
        let yaw_rad = match turned < 1.0 {
            true => before_rad + turned * wrap_angle(wanted.rotation.angle() - before_rad),
            false => wanted.rotation.angle(),
        };
        let (handler, reach_m) = (self.place(HANDLER), self.config.handler.reach_m);
        let (before, after) = ((from - handler).norm(), (reached - handler).norm());
        let pulled = self.hand.holds() && after > reach_m && after > before;
        if pulled {
            reached = from;
        }
        if cut || pulled {
            self.twist = Twist2 { vx_mps: 0.0, vy_mps: 0.0, ..self.twist };
            if let Some(legs) = &mut self.legs {
                legs.halt();
            }
        }
        self.distance_m += (reached - from).norm();
        self.world_from_robot = placed(reached, yaw_rad);
    }

    /// How much of its way a body gets, on which each of its discs goes straight; counts what it runs into.
    fn free_share(&mut self, body: usize, from: &Outline, to: &Outline) -> f64 {
        let Body { radius_m, z, .. } = self.bodies[body];
        let (mut share, mut meets_world, mut ran_into_person) = (1.0_f64, false, false);
        for (from, to) in from.iter().zip(to.iter()) {
            if let Some(free) = self.world.free_share(*from, *to, radius_m, z) {
                share = share.min(free);
                meets_world = true;
            }
            for person in 0..self.people.len() {
                let walker = self.walkers[person];
                let center = Point::new(walker.x_m, walker.y_m);
                let limit = radius_m + walker.radius_m;
                let Some(free) = crate::sweep::free_share(*from, *to, limit, |p| (p - center).norm()) else { continue };
                share = share.min(free);
                // One touch is one event, whoever began it.
                ran_into_person |= !std::mem::replace(&mut self.bodies[body].with_person[person], true);
            }
        }
        let state = &mut self.bodies[body];
        let ran_into_world = meets_world && !std::mem::replace(&mut state.touching, true);
        state.collisions += u32::from(ran_into_world || ran_into_person);
        share
    }

    /// Ends the touches that have room again.
    fn release(&mut self, body: usize) {
        let outline = self.outline(body);
        let Body { radius_m, z, touching, .. } = self.bodies[body];
        let room = radius_m + RELEASE_M;
        if touching && outline.iter().all(|at| self.world.clearance(*at, z, room) >= room) {
            self.bodies[body].touching = false;
        }
        for (walker, counted) in self.walkers.iter().zip(&mut self.bodies[body].with_person) {
            let center = Point::new(walker.x_m, walker.y_m);
            *counted &= outline.iter().any(|at| (center - at).norm() < room + walker.radius_m);
        }
    }

    /// Room around the middles of a body's discs, people included, metres, at most `up_to_m`.
    fn clearance(&self, body: usize, up_to_m: f64) -> f64 {
        let of_disc = |at: &Point| {
            let to_walker = |walker: &Walker| (Point::new(walker.x_m, walker.y_m) - at).norm() - walker.radius_m;
            let walkers = self.walkers[..self.people.len()].iter().map(to_walker);
            let in_world_m = self.world.clearance(*at, self.bodies[body].z, up_to_m).min(self.world.to_edge_m(*at));
            walkers.fold(in_world_m, f64::min)
        };
        self.outline(body).iter().map(of_disc).fold(up_to_m, f64::min)
    }
}

/// A pose from scratch, so that rounding does not pile up in the rotation.
fn placed(at: Point, yaw_rad: f64) -> Se2 {
    Se2::new(at.coords, yaw_rad)
}
