//! What a policy of joint positions needs to know of its robot, and what drives the joints: a file beside the model.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::scene::STEP_S;

/// Numbers of a description lie within this.
const MOST: f64 = 1e4;

/// A legged robot whose body is named `base`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Height of the body above the floor in its pose, with a little air under the feet, metres.
    pub body_m: f64,
    /// From one decision of the policy to the next, milliseconds: whole steps of the physics.
    pub decision_ms: f64,
    /// What the body's rates of turning are multiplied by before the policy hears them, and those of the joints.
    pub rates_scale: f64,
    /// See `rates_scale`.
    pub joint_rates_scale: f64,
    /// Of a joint that walks, as the policy was trained.
    pub walking: Gains,
    /// Of a joint that stands.
    pub standing: Gains,
    /// Geoms that touch the floor. The whole bodies that have them may.
    pub feet: Vec<String>,
    /// The joints in the policy's order.
    pub joint: Vec<Joint>,
}

/// How a motor holds a joint.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Nm/rad.
    pub stiffness: f64,
    /// Nm s/rad.
    pub damping: f64,
}

/// A joint of the policy.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Name of the model's joint.
    pub name: String,
    /// Name of the model's motor, which takes a moment.
    pub motor: String,
    /// The angle that the policy's output starts from, radians.
    pub pose_rad: f64,
    /// Radians per unit of the policy's output.
    pub scale_rad: f64,
}

/// What is wrong with a description.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}", file.display())]
pub struct RobotError {
    /// Where it stands.
    pub file: PathBuf,
    /// What is wrong.
    pub what: String,
}

impl Robot {
    /// The Go2 and the policy that `scripts/mujoco` brings.
    #[must_use]
    pub fn go2() -> Self {
        // Hip, thigh, calf.
        let parts = [("hip", 0.0, 0.125), ("thigh", 0.8, 0.25), ("calf", -1.5, 0.25)];
        let legs = ["FR", "FL", "RR", "RL"];
        let joint = |leg: &str, (part, pose_rad, scale_rad): (&str, f64, f64)| {
            let motor = format!("{leg}_{part}");
            Joint { name: format!("{motor}_joint"), motor, pose_rad, scale_rad }
        };
        Self {
            body_m: 0.32,
            decision_ms: 20.0,
            rates_scale: 0.25,
            joint_rates_scale: 0.05,
            walking: Gains { stiffness: 20.0, damping: 0.5 },
            standing: Gains { stiffness: 80.0, damping: 2.0 },
            feet: legs.map(str::to_owned).into(),
            joint: legs.into_iter().flat_map(|leg| parts.map(|part| joint(leg, part))).collect(),
        }
    }

    /// The robot of a model: as the file beside it says that has the same name and ends in `.toml`; without one, a Go2.
    ///
    /// # Errors
    /// Where that file cannot be read or is wrong.
    pub fn of(model: &Path) -> Result<Self, RobotError> {
        let file = model.with_extension("toml");
        let wrong = |what: String| RobotError { file: file.clone(), what };
        if !file.try_exists().map_err(|error| wrong(error.to_string()))? {
            return Ok(Self::go2());
        }
        let text = std::fs::read_to_string(&file).map_err(|error| wrong(error.to_string()))?;
        let robot: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string().trim_end().to_owned()))?;
        robot.check().map_err(wrong)?;
        Ok(robot)
    }

    /// Steps of the physics in a decision.
    #[must_use]
    pub fn decision_steps(&self) -> u64 {
        (self.decision_ms / 1e3 / STEP_S).round() as u64
    }

    fn check(&self) -> Result<(), String> {
        let gains = [("walking", self.walking), ("standing", self.standing)];
        let gains = gains.into_iter().flat_map(|(key, gains)| {
            [(format!("{key}.stiffness"), gains.stiffness), (format!("{key}.damping"), gains.damping)]
        });
        let scales = [("rates_scale", self.rates_scale), ("joint_rates_scale", self.joint_rates_scale)];
        let positive = [("body_m", self.body_m), ("decision_ms", self.decision_ms)].into_iter().chain(scales);
        for (key, value) in positive.map(|(key, value)| (key.to_owned(), value)).chain(gains) {
            if !(value > 0.0 && value <= MOST) {
                return Err(format!("{key} = {value} is not over 0 and up to {MOST}"));
            }
        }
        if (self.decision_steps() as f64 * STEP_S * 1e3 - self.decision_ms).abs() > 1e-9 || self.decision_steps() == 0 {
            return Err(format!("decision_ms = {} is no multiple of {} ms", self.decision_ms, STEP_S * 1e3));
        }
        if self.feet.is_empty() || self.joint.is_empty() {
            return Err("feet and [[joint]] name none".to_owned());
        }
        for (number, joint) in self.joint.iter().enumerate() {
            if !(joint.pose_rad.abs() <= MOST && joint.scale_rad.abs() <= MOST) {
                return Err(format!("joint {} ({}): pose_rad or scale_rad is too great", number + 1, joint.name));
            }
            if self.joint[..number].iter().any(|other| other.name == joint.name || other.motor == joint.motor) {
                return Err(format!("joint {} ({}): its joint or motor is named before", number + 1, joint.name));
            }
        }
        Ok(())
    }
}
