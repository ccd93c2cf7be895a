//! Interaction models: where the handler will be when the robot moves (Kim et al. 2023, section 4).
//!
//! A model is stepped once per decision with the robot's motion; [`Interaction::follow`] tells where the handler is
//! within the step. All offsets are the handler in the robot's frame.

mod delayed;
mod rigid;
mod rod;

use messages::Pose2;

use crate::se2::{Point, Se2};

pub use delayed::{Converted, DelayedHarness};
pub use rigid::RigidHarness;
pub use rod::RotatingRod;

/// Speed at which the lag of a parameter set is judged, metres per second: the forward action of the table.
const LAG_SPEED_MPS: f64 = 0.5;
/// A harness is no longer than this; a lag over it is no harness, metres.
pub(crate) const HARNESS_M: f64 = 1.0;
/// Nobody holds a harness from farther away, metres.
const REACH_M: f64 = 2.0;

/// Why a parameter set is no model of a handler.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HarnessError {
    /// Alpha is a share of what is remembered, below 1.
    #[error("alpha = {0} is not in [0, 1)")]
    Alpha(f64),
    /// The handler would lag by more than a harness is long.
    #[error("alpha = {alpha} lags by {lag_m:.2} m at {LAG_SPEED_MPS} m/s, more than a harness of {HARNESS_M} m")]
    Lag {
        /// As given.
        alpha: f64,
        /// alpha / (1 - alpha) v dt.
        lag_m: f64,
    },
    /// The default offset is not finite or beyond arm and harness.
    #[error("the offset ({x_m}, {y_m}) is not finite, or over {REACH_M} m")]
    Offset {
        /// Forward.
        x_m: f64,
        /// Left.
        y_m: f64,
    },
    /// The decision period is not a time.
    #[error("dt = {0} s is not over 0")]
    Dt(f64),
    /// The rod has no length, or is longer than arm and harness.
    #[error("a rod of {0} m is not over 0 and at most {REACH_M} m long")]
    Rod(f64),
}

/// How a handler follows the robot.
pub trait Interaction {
    /// Where the handler is when the robot has long walked straight and slowly.
    fn robot_from_default(&self) -> Se2;

    /// Where the handler is when the robot has made the part `start_from_now` of its motion in the share `fraction` of
    /// the step: in the robot's frame of now, from where they were in its frame at the step's start.
    fn follow(&self, robot_from_handler: &Se2, start_from_now: &Se2, fraction: f64) -> Se2;

    /// The same at the end of the step.
    fn step(&self, robot_from_handler: &Se2, start_from_end: &Se2) -> Se2 {
        self.follow(robot_from_handler, start_from_end, 1.0)
    }

    /// How far behind the default offset the handler stays in a straight walk at a speed, metres.
    fn lag_m(&self, speed_mps: f64) -> f64;

    /// How far from the default offset a handler may be of whom nothing else is known, metres.
    fn astray_m(&self, speed_mps: f64) -> f64 {
        self.lag_m(speed_mps)
    }

    /// The share of an unknown offset that is left after a step: how fast a guess gets better.
    fn remembered(&self) -> f64;
}

/// One of the models.
#[derive(Debug, Clone, PartialEq)]
pub enum InteractionModel {
    /// A fixed offset.
    Rigid(RigidHarness),
    /// A rod that turns about the robot's grip.
    Rod(RotatingRod),
    /// The delayed harness.
    Delayed(DelayedHarness),
}

impl InteractionModel {
    fn inner(&self) -> &dyn Interaction {
        match self {
            Self::Rigid(model) => model,
            Self::Rod(model) => model,
            Self::Delayed(model) => model,
        }
    }

    /// The same handler, who walks at another default offset (robot frame). A handler at a rod is behind the robot
    /// already.
    ///
    /// # Errors
    /// Where the offset is no harness's.
    pub fn at(&self, robot_from_handler: Pose2) -> Result<Self, HarnessError> {
        Ok(match self {
            Self::Rigid(_) => Self::Rigid(RigidHarness::new(robot_from_handler)?),
            Self::Rod(rod) => Self::Rod(rod.clone()),
            Self::Delayed(model) => {
                Self::Delayed(DelayedHarness::new(robot_from_handler, model.alpha(), model.dt_s())?)
            }
        })
    }
}

impl Interaction for InteractionModel {
    fn robot_from_default(&self) -> Se2 {
        self.inner().robot_from_default()
    }

    fn follow(&self, robot_from_handler: &Se2, start_from_now: &Se2, fraction: f64) -> Se2 {
        self.inner().follow(robot_from_handler, start_from_now, fraction)
    }

    fn lag_m(&self, speed_mps: f64) -> f64 {
        self.inner().lag_m(speed_mps)
    }

    fn astray_m(&self, speed_mps: f64) -> f64 {
        self.inner().astray_m(speed_mps)
    }

    fn remembered(&self) -> f64 {
        self.inner().remembered()
    }
}

impl From<DelayedHarness> for InteractionModel {
    fn from(model: DelayedHarness) -> Self {
        Self::Delayed(model)
    }
}

fn checked_offset(offset: Pose2) -> Result<Se2, HarnessError> {
    let Pose2 { x_m, y_m, .. } = offset;
    if offset.is_finite() && x_m.hypot(y_m) <= REACH_M {
        Ok(crate::se2::se2(offset))
    } else {
        Err(HarnessError::Offset { x_m, y_m })
    }
}

/// The place of a pose.
#[must_use]
pub fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}
