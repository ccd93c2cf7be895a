//! The handler: a body that walks by itself, one hand on a stiff handle on the robot's back.
//!
//! It is no delayed harness, which the shield takes a handler for: it feels where the handle goes, answers after its
//! reaction time, speeds up no faster than a person does, and turns as the robot is turned. What it does not follow
//! pulls on the robot, by a spring and a damper at the hand.

use std::collections::VecDeque;

use guidance::se2::{pose2, se2, wrap_angle};
use messages::{Formation, Pose2};
use mujoco_rs::prelude::*;
use nalgebra::{Rotation2, Vector2, Vector3};
use world::{DisturbanceKind, HandlerConfig, RETURNING_MPS};

use crate::legs::attitude;
use crate::scene::{STEP_S, SceneError};

/// The handle on the robot's body (x forward, y left, z up), metres: above and behind it, to the handler's side.
pub const BODY_FROM_HANDLE_M: [f64; 3] = [-0.45, -0.12, 0.50];
/// The hand of a handler beside the robot, seen from their middle, metres: it is at the handle where they walk at the
/// default place.
const HAND_M: [f64; 2] = [0.30, 0.23];
/// The harness between handle and hand: stiffness, N/m, damping, N s/m, and the most that it pulls, N.
const STIFFNESS: f64 = 150.0;
const DAMPING: f64 = 40.0;
const PULL_MAX_N: f64 = 150.0;
/// How a person closes up: m/s per metre that the hand is off, and the time in which a wanted speed is reached, s.
const CLOSING_PER_S: f64 = 1.0;
const SPEEDING_UP_S: f64 = 0.3;
/// How a person turns: rad/s per radian off, the most of it, and the time in which it is reached, s.
const TURNING_PER_S: f64 = 2.0;
const TURNING_MAX_RADPS: f64 = 1.5;
const TURNING_UP_S: f64 = 0.2;
/// A handler who is caught stands after this time, s.
const CAUGHT_S: f64 = 0.05;
/// A handler takes the handle again from so near, metres.
const TAKES_M: f64 = 0.1;
/// The handler feels the handle's speed over this many steps.
const FELT_STEPS: usize = 20;

/// What a handler is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PersonConfig {
    /// Where the handler walks, in the robot's frame.
    pub robot_from_handler: Pose2,
    /// In single file they walk so far behind the robot's middle, metres.
    pub behind_m: f64,
    /// Radius of the body, metres.
    pub radius_m: f64,
    /// Height, metres.
    pub height_m: f64,
    /// Mass, kilograms.
    pub mass_kg: f64,
    /// Until what is felt is answered, seconds.
    pub reaction_s: f64,
    /// The most that a person speeds up or slows down, m/s^2.
    pub acceleration_mps2: f64,
}

impl Default for PersonConfig {
    fn default() -> Self {
        let HandlerConfig { robot_from_handler, behind_m, radius_m, height_m, .. } = HandlerConfig::default();
        let (mass_kg, reaction_s, acceleration_mps2) = (70.0, 0.3, 2.0);
        Self { robot_from_handler, behind_m, radius_m, height_m, mass_kg, reaction_s, acceleration_mps2 }
    }
}

/// Name of the handler's body in the model.
pub const BODY: &str = "handler";
/// Names of its joints: along x, along y, and its turning (world frame).
pub const JOINTS: [&str; 3] = ["handler_x", "handler_y", "handler_yaw"];

/// What the handler felt in a step: the handle's place, its own hand's (world frame), metres, and the robot's heading,
/// radians.
#[derive(Debug, Clone, Copy)]
struct Felt {
    handle: Vector2<f64>,
    hand: Vector2<f64>,
    yaw_rad: f64,
}

/// The handler.
#[derive(Debug)]
pub struct Person {
    config: PersonConfig,
    /// Body of the robot, and where each joint's angle and rate are in the state.
    robot: usize,
    angles: [usize; 3],
    rates: [usize; 3],
    turning_kgm2: f64,
    /// From the newest to the oldest that is still to be answered.
    felt: VecDeque<Felt>,
    forces: Vec<f64>,
    pull_n: f64,
    holds: bool,
    formation: Formation,
}

impl Person {
    /// The handler of a scene that was built with one.
    ///
    /// # Errors
    /// Where the scene has none.
    pub fn new(model: &MjModel, config: PersonConfig) -> Result<Self, SceneError> {
        let missing = |what: &str| SceneError { file: "the scene".to_owned(), what: format!("it has no {what}") };
        let robot = model.name_to_id(MjtObjBase::mjOBJ_BODY, "base").ok_or_else(|| missing("body base"))?;
        let (mut angles, mut rates) = ([0; 3], [0; 3]);
        for (axis, name) in JOINTS.into_iter().enumerate() {
            let joint = model.name_to_id(MjtObjBase::mjOBJ_JOINT, name).ok_or_else(|| missing(name))?;
            (angles[axis], rates[axis]) = (model.jnt_qposadr()[joint] as usize, model.jnt_dofadr()[joint] as usize);
        }
        // A cylinder about its axis.
        let turning_kgm2 = config.mass_kg * config.radius_m * config.radius_m / 2.0;
        let forces = vec![0.0; model.ffi().nv as usize];
        Ok(Self {
            config,
            robot,
            angles,
            rates,
            turning_kgm2,
            felt: VecDeque::new(),
            forces,
            pull_n: 0.0,
            holds: true,
            formation: Formation::Beside,
        })
    }

    /// The handler was asked to walk there: they let the handle go, and take it again in their new place.
    pub fn form(&mut self, formation: Formation) {
        if self.formation != formation {
            (self.formation, self.holds) = (formation, false);
        }
    }

    /// The hand seen from the handler's middle, metres.
    fn hand_m(&self) -> Vector2<f64> {
        let [x_m, y_m, _] = BODY_FROM_HANDLE_M;
        match self.formation {
            Formation::Beside => Vector2::from(HAND_M),
            Formation::Behind => Vector2::new(x_m + self.config.behind_m, y_m),
        }
    }

    /// Puts the handler beside the robot, where they walk.
    pub fn pose(&self, data: &mut MjData<Box<MjModel>>) {
        let (_, _, yaw_rad) = attitude(data).euler_angles();
        let robot = Pose2::new(data.qpos()[0], data.qpos()[1], yaw_rad);
        let at = pose2(&(se2(robot) * se2(self.config.robot_from_handler)));
        for (angle, value) in self.angles.into_iter().zip([at.x_m, at.y_m, at.yaw_rad]) {
            data.qpos_mut()[angle] = value;
        }
        data.forward();
    }

    /// Where the handler is (world frame).
    #[must_use]
    pub fn place(&self, data: &MjData<Box<MjModel>>) -> Pose2 {
        let [x_m, y_m, yaw_rad] = self.angles.map(|angle| data.qpos()[angle]);
        Pose2::new(x_m, y_m, yaw_rad)
    }

    /// What pulls at the handle, newtons.
    #[must_use]
    pub fn pull_n(&self) -> f64 {
        self.pull_n
    }

    /// Sets the forces of the next step of the physics: the handler's own, and the harness's on both. The handler
    /// follows, but for a disturbance. A handler who let the handle go walks straight
    /// back to it, and takes it.
    pub fn walk(&mut self, data: &mut MjData<Box<MjModel>>, disturbance: Option<DisturbanceKind>) {
        let attitude = attitude(data);
        let arm = attitude * Vector3::from(BODY_FROM_HANDLE_M);
        let base = Vector3::from_column_slice(&data.qpos()[..3]);
        let [x_m, y_m, own_rad] = self.angles.map(|angle| data.qpos()[angle]);
        let [vx_mps, vy_mps, own_radps] = self.rates.map(|rate| data.qvel()[rate]);
        let (own, reach) = (Vector2::new(vx_mps, vy_mps), Rotation2::new(own_rad) * self.hand_m());
        let hand = Vector2::new(x_m, y_m) + reach;
        let (_, _, yaw_rad) = attitude.euler_angles();
        self.felt.push_front(Felt { handle: (base + arm).xy(), hand, yaw_rad });
        self.felt.truncate(self.reaction_steps() + FELT_STEPS + 1);

        let hand_moves = own + own_radps * Vector2::new(-reach.y, reach.x);
        let is_near = ((base + arm).xy() - hand).norm() <= TAKES_M;
        self.holds = disturbance != Some(DisturbanceKind::LetGo) && (self.holds || is_near);
        let pull = match disturbance {
            _ if !self.holds => Vector2::zeros(),
            Some(DisturbanceKind::Pull(by_n)) => self.pull(&hand_moves) - Rotation2::new(yaw_rad) * Vector2::from(by_n),
            Some(DisturbanceKind::LetGo | DisturbanceKind::Snag) | None => self.pull(&hand_moves),
        };
        self.pull_n = pull.norm();
        let (push, turning_nm) = match disturbance {
            Some(DisturbanceKind::LetGo) => self.stand(&own, own_radps),
            // What has caught the handler bears the pull.
            Some(DisturbanceKind::Snag) => self.caught(&own, own_radps, &pull, &reach),
            Some(DisturbanceKind::Pull(_)) | None => self.answer(&own, own_rad, own_radps),
        };
        self.forces.fill(0.0);
        let (force, at) = ([-pull.x, -pull.y, 0.0], (base + arm).into());
        // It fails where the body is not there, and it was found when this began.
        let applied = data.apply_ft(&force, &[0.0; 3], &at, self.robot, &mut self.forces);
        debug_assert!(applied.is_ok(), "{applied:?}");
        self.forces[self.rates[0]] += push.x + pull.x;
        self.forces[self.rates[1]] += push.y + pull.y;
        self.forces[self.rates[2]] += turning_nm + reach.perp(&pull);
        data.qfrc_applied_mut().copy_from_slice(&self.forces);
    }

    fn reaction_steps(&self) -> usize {
        (self.config.reaction_s / STEP_S) as usize
    }

    /// What the handler felt `steps_ago` steps ago, and the velocity of the handle then, m/s.
    fn felt(&self, steps_ago: usize) -> (Felt, Vector2<f64>) {
        let last = self.felt.len() - 1;
        let [then, before] = [steps_ago, steps_ago + FELT_STEPS].map(|steps| self.felt[steps.min(last)]);
        (then, (then.handle - before.handle) / (FELT_STEPS as f64 * STEP_S))
    }

    /// The harness's force on the hand, N.
    fn pull(&self, hand_moves: &Vector2<f64>) -> Vector2<f64> {
        let (now, handle_moves) = self.felt(0);
        let pull = STIFFNESS * (now.handle - now.hand) + DAMPING * (handle_moves - hand_moves);
        pull.cap_magnitude(PULL_MAX_N)
    }

    /// A handler who comes to stand: force, N, and moment, Nm.
    fn stand(&self, own: &Vector2<f64>, own_radps: f64) -> (Vector2<f64>, f64) {
        let slowing_down = (-own / SPEEDING_UP_S).cap_magnitude(self.config.acceleration_mps2);
        (self.config.mass_kg * slowing_down, -self.turning_kgm2 * own_radps / TURNING_UP_S)
    }

    /// A handler who is caught.
    fn caught(
        &self,
        own: &Vector2<f64>,
        own_radps: f64,
        pull: &Vector2<f64>,
        reach: &Vector2<f64>,
    ) -> (Vector2<f64>, f64) {
        let push = -self.config.mass_kg * own / CAUGHT_S - pull;
        (push, -self.turning_kgm2 * own_radps / CAUGHT_S - reach.perp(pull))
    }

    /// What the handler does about what was felt a reaction time ago: force, N, and moment, Nm.
    fn answer(&self, own: &Vector2<f64>, own_rad: f64, own_radps: f64) -> (Vector2<f64>, f64) {
        let (then, handle_moves) = self.felt(self.reaction_steps());
        let to_handle = then.handle - then.hand;
        let wanted = match self.holds {
            true => handle_moves + CLOSING_PER_S * to_handle,
            false => (CLOSING_PER_S * to_handle).cap_magnitude(RETURNING_MPS),
        };
        let speeding_up = ((wanted - own) / SPEEDING_UP_S).cap_magnitude(self.config.acceleration_mps2);
        let off_rad = wrap_angle(then.yaw_rad - own_rad);
        let turning = (TURNING_PER_S * off_rad).clamp(-TURNING_MAX_RADPS, TURNING_MAX_RADPS);
        let moment_nm = self.turning_kgm2 * (turning - own_radps) / TURNING_UP_S;
        (self.config.mass_kg * speeding_up, moment_nm)
    }
}
