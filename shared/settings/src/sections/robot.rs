//! The robot's section: its body, and how it answers a command.

use guidance::accord;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::devices::is_default;
use crate::units::{Millis, Positive};

/// The robot's body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Robot {
    /// Radius of the disc that stands for the robot, metres.
    pub radius_m: Positive,
    /// Two such discs stand for a long body, so far ahead of its middle and behind it, metres; 0 is one disc.
    pub nose_m: f64,
    /// Height of the body's origin (`base_link`) above the floor while the robot stands, metres: heights of sensors
    /// are told for it.
    pub body_height_m: Positive,
    /// Lets a real robot walk though `response` was not measured on it, as it has to for the measurement.
    #[serde(skip_serializing_if = "is_default")]
    pub profile_unmeasured: bool,
    /// How it answers a command when all is well.
    pub response: Response,
    /// How its body sways.
    pub gait: Gait,
}

/// Where the numbers of [`Response`] come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// They were measured on this robot.
    Measured,
    /// They were measured on a robot in a simulation.
    Simulated,
    /// They were not measured.
    #[default]
    Assumed,
}

impl Origin {
    /// Its name in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Simulated => "simulated",
            Self::Assumed => "assumed",
        }
    }
}

/// How a healthy robot answers a command. A larger error stops it (`odometry_contradicts`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Response {
    /// Where these numbers come from: a real robot walks by measured ones alone ([`crate::check_origin`]).
    #[serde(skip_serializing_if = "is_default")]
    pub origin: Origin,
    /// Until it does what is commanded, its odometry's own age included.
    pub lag: Millis,
    /// Largest error of its way in half a second, metres. The limit is 1.4 times as large for 1 s, 1.75 times for 2 s.
    pub way_off_m: Positive,
    /// The same of its heading, radians.
    pub turn_off_rad: Positive,
    /// Overrun after a command of zero at the fastest action: along the body's axis, and across it, metres.
    pub overrun_m: [f64; 2],
    /// Overrun of a turn, radians.
    pub overrun_rad: f64,
    /// A command takes effect after this; read where the simulated robot walks on legs.
    pub delay: Millis,
    /// Time constants of its velocity ahead, aside and of turns, seconds; likewise.
    pub time_constant_s: [f64; 3],
}

/// How the body of a legged robot sways: `simulation.noise = "legged"` simulates it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Gait {
    /// Period of a stride.
    pub stride: Millis,
    /// Sway while it walks, one standard deviation: roll, radians,
    pub roll_rad: f64,
    /// pitch, radians,
    pub pitch_rad: f64,
    /// height, metres,
    pub rise_m: f64,
    /// its place to either side, metres,
    pub sway_m: f64,
    /// and its heading, radians.
    pub sway_rad: f64,
    /// Roll of a sidestep, radians for 1 m/s.
    pub lean_rad_per_mps: f64,
    /// Slip, one standard deviation, as a share of the speed.
    pub slip: f64,
}

impl Default for Gait {
    fn default() -> Self {
        Self {
            stride: Millis::of_ms(500),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            rise_m: 0.0,
            sway_m: 0.0,
            sway_rad: 0.0,
            lean_rad_per_mps: 0.0,
            slip: 0.0,
        }
    }
}

impl Response {
    /// What odometry is held to.
    #[must_use]
    pub fn accord(&self) -> accord::Response {
        accord::Response {
            lag_ns: self.lag.ns(),
            way_off_m: self.way_off_m.get(),
            turn_off_rad: self.turn_off_rad.get(),
        }
    }
}

impl Default for Response {
    fn default() -> Self {
        Self {
            origin: Origin::Assumed,
            lag: Millis::of_ms(150),
            way_off_m: Positive::of(0.05),
            turn_off_rad: Positive::of(0.10),
            overrun_m: [0.0; 2],
            overrun_rad: 0.0,
            delay: Millis::of_ms(10),
            time_constant_s: [0.0; 3],
        }
    }
}

impl Default for Robot {
    fn default() -> Self {
        Self {
            radius_m: Positive::of(0.30),
            nose_m: 0.0,
            body_height_m: Positive::of(0.30),
            profile_unmeasured: false,
            response: Response::default(),
            gait: Gait::default(),
        }
    }
}
