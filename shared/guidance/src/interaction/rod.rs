//! The rotating rod (Wang et al. 2021): the handler walks at the end of a rod that turns freely about the robot's grip.

use messages::Pose2;
use nalgebra::Vector2;

use super::{HarnessError, Interaction, REACH_M, checked_offset};
use crate::se2::{Point, Se2};

/// Nearer to the grip than this the rod has no direction of its own, metres.
const NO_DIRECTION_M: f64 = 1e-9;

/// A rod of fixed length between the robot's grip and the handler, who faces the grip.
#[derive(Debug, Clone, PartialEq)]
pub struct RotatingRod {
    grip: Point,
    length_m: f64,
}

impl RotatingRod {
    /// A rod of `length_m` held at `(x_m, y_m)` of the robot's frame.
    ///
    /// # Errors
    /// Where the grip is not on a robot or the length is none.
    pub fn new(grip_x_m: f64, grip_y_m: f64, length_m: f64) -> Result<Self, HarnessError> {
        let grip = checked_offset(Pose2::new(grip_x_m, grip_y_m, 0.0))?;
        if !(length_m > 0.0 && length_m <= REACH_M) {
            return Err(HarnessError::Rod(length_m));
        }
        Ok(Self { grip: Point::from(grip.translation.vector), length_m })
    }

    fn at_its_end(&self, away: Vector2<f64>) -> Se2 {
        Se2::new(self.grip.coords + away * self.length_m, (-away.y).atan2(-away.x))
    }
}

impl Interaction for RotatingRod {
    /// Straight behind the grip: a rod that is pulled forward ends there.
    fn robot_from_default(&self) -> Se2 {
        self.at_its_end(-Vector2::x())
    }

    /// The handler goes no farther than the rod makes them: along the rod, so that its length is kept. The share of the
    /// step does not matter; a rod does not wait.
    fn follow(&self, robot_from_handler: &Se2, start_from_now: &Se2, _fraction: f64) -> Se2 {
        let stayed = start_from_now.inverse() * robot_from_handler;
        let away = stayed.translation.vector - self.grip.coords;
        self.at_its_end(away.try_normalize(NO_DIRECTION_M).unwrap_or(-Vector2::x()))
    }

    fn lag_m(&self, _speed_mps: f64) -> f64 {
        0.0
    }

    /// Anywhere around the grip.
    fn astray_m(&self, _speed_mps: f64) -> f64 {
        2.0 * self.length_m
    }

    /// A rod that swings recovers by the way that the robot makes, not by time: nothing is sure to be forgotten in a
    /// step.
    fn remembered(&self) -> f64 {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::{Interaction, RotatingRod};
    use crate::interaction::{HarnessError, place};
    use crate::se2::{Point, Se2, se2};
    use messages::Pose2;

    fn rod() -> RotatingRod {
        RotatingRod::new(-0.3, 0.0, 0.8).expect("a rod")
    }

    #[test]
    fn its_length_is_kept_whatever_the_robot_does() {
        let grip = Point::new(-0.3, 0.0);
        let mut handler = rod().robot_from_default();
        for motion in [(0.25, 0.0, 0.0), (0.0, 0.0, 0.5), (0.2, 0.1, -0.7), (-0.1, 0.0, 0.0)] {
            handler = rod().step(&handler, &se2(Pose2::new(motion.0, motion.1, motion.2)));
            assert!(((place(&handler) - grip).norm() - 0.8).abs() < 1e-12);
        }
    }

    #[test]
    fn a_robot_that_turns_about_its_grip_leaves_the_handler_where_they_were() {
        // A turn about the robot's middle moves the grip only a little.
        let turn = Se2::new(nalgebra::Vector2::zeros(), 0.2);
        let before = rod().robot_from_default();
        let after = turn * rod().step(&before, &turn);
        assert!((place(&after) - place(&before)).norm() < 0.03);
    }

    #[test]
    fn a_pulled_rod_comes_in_line() {
        let mut handler = se2(Pose2::new(-0.3, 0.8, 0.0));
        for _ in 0..40 {
            handler = rod().step(&handler, &se2(Pose2::new(0.25, 0.0, 0.0)));
        }
        assert!((place(&handler) - Point::new(-1.1, 0.0)).norm() < 1e-3 && handler.rotation.angle().abs() < 1e-3);
    }

    #[test]
    fn what_is_no_rod_is_refused() {
        assert_eq!(RotatingRod::new(0.0, 0.0, 0.0), Err(HarnessError::Rod(0.0)));
        assert!(matches!(RotatingRod::new(f64::NAN, 0.0, 1.0), Err(HarnessError::Offset { .. })));
    }
}
