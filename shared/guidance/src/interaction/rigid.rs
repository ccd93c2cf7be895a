//! The rigid harness (Kim et al. 2023, eq. 2, as a full offset in the plane).

use messages::Pose2;

use super::{HarnessError, Interaction, checked_offset};
use crate::se2::Se2;

/// The handler is always at the same place of the robot's frame, facing the same way.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidHarness {
    robot_from_handler: Se2,
}

impl RigidHarness {
    /// A harness with that offset (robot frame).
    ///
    /// # Errors
    /// Where the offset is not finite or beyond arm and harness.
    pub fn new(robot_from_handler: Pose2) -> Result<Self, HarnessError> {
        Ok(Self { robot_from_handler: checked_offset(robot_from_handler)? })
    }
}

impl Interaction for RigidHarness {
    fn robot_from_default(&self) -> Se2 {
        self.robot_from_handler
    }

    fn follow(&self, _robot_from_handler: &Se2, _start_from_now: &Se2, _fraction: f64) -> Se2 {
        self.robot_from_handler
    }

    fn lag_m(&self, _speed_mps: f64) -> f64 {
        0.0
    }

    fn remembered(&self) -> f64 {
        0.0
    }
}
