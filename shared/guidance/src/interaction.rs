//! The delayed harness: where the handler will be (Kim et al. 2023, section 4).

use crate::se2::{Point, Se2, wrap_angle};
use messages::Pose2;
use nalgebra::Vector2;

/// Speed at which the lag of a parameter set is judged, metres per second: the forward action of the table.
const LAG_SPEED_MPS: f64 = 0.5;
/// A harness is no longer than this; a lag over it is no harness, metres.
const HARNESS_M: f64 = 1.0;

/// Why a parameter set is no delayed harness.
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
    #[error("the offset ({x_m}, {y_m}) is not finite, or over 2 m")]
    Offset {
        /// Forward.
        x_m: f64,
        /// Left.
        y_m: f64,
    },
    /// The decision period is not a time.
    #[error("dt = {0} s is not over 0")]
    Dt(f64),
}

/// The delayed harness: the offset that an action changed is remembered by the share alpha, the rest is recovered.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayedHarness {
    robot_from_default: Se2,
    alpha: f64,
    dt_s: f64,
}

impl Default for DelayedHarness {
    /// A handler at the robot's right, 0.75 m behind and 0.35 m beside, who remembers 0.4 in half a second.
    fn default() -> Self {
        let robot_from_default = crate::se2::se2(Pose2::new(-0.75, -0.35, 0.0));
        Self { robot_from_default, alpha: 0.4, dt_s: 0.5 }
    }
}

impl DelayedHarness {
    /// A harness with that default offset (robot frame), that remembers the share `alpha` per step of `dt_s`.
    ///
    /// # Errors
    /// Where the parameters are no harness's.
    pub fn new(robot_from_handler: Pose2, alpha: f64, dt_s: f64) -> Result<Self, HarnessError> {
        if !(0.0..1.0).contains(&alpha) {
            return Err(HarnessError::Alpha(alpha));
        }
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(HarnessError::Dt(dt_s));
        }
        let Pose2 { x_m, y_m, .. } = robot_from_handler;
        if !robot_from_handler.is_finite() || x_m.hypot(y_m) > 2.0 {
            return Err(HarnessError::Offset { x_m, y_m });
        }
        let lag_m = alpha / (1.0 - alpha) * LAG_SPEED_MPS * dt_s;
        if lag_m > HARNESS_M {
            return Err(HarnessError::Lag { alpha, lag_m });
        }
        Ok(Self { robot_from_default: crate::se2::se2(robot_from_handler), alpha, dt_s })
    }

    /// The default offset.
    #[must_use]
    pub fn robot_from_default(&self) -> &Se2 {
        &self.robot_from_default
    }

    /// The remembered share per step.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// The largest lag at a speed, metres: alpha / (1 - alpha) v dt.
    #[must_use]
    pub fn lag_m(&self, speed_mps: f64) -> f64 {
        self.alpha / (1.0 - self.alpha) * speed_mps * self.dt_s
    }

    /// Where the handler is relative to the robot after an action: the temporary offset `o^ = x^H_t - x^R_{t+1}`, drawn
    /// towards the default one in the robot's frame at t+1, the angle on the short arc
    /// (Kim et al. 2023, section 4, Delayed Harness Model).
    #[must_use]
    pub fn step(&self, robot_from_handler: &Se2, start_from_end: &Se2) -> Se2 {
        self.follow(robot_from_handler, start_from_end, 1.0)
    }

    /// The same within a step: the robot has made the part `start_from_now` of its motion in the share `fraction` of
    /// the step. At 0 nothing is recovered yet, at 1 it is [`DelayedHarness::step`].
    #[must_use]
    pub fn follow(&self, robot_from_handler: &Se2, start_from_now: &Se2, fraction: f64) -> Se2 {
        let temporary = start_from_now.inverse() * robot_from_handler;
        let remembered = 1.0 - (1.0 - self.alpha) * fraction.clamp(0.0, 1.0);
        let default = &self.robot_from_default;
        let place: Vector2<f64> =
            default.translation.vector + (temporary.translation.vector - default.translation.vector) * remembered;
        let turn = wrap_angle(temporary.rotation.angle() - default.rotation.angle());
        Se2::new(place, wrap_angle(default.rotation.angle() + remembered * turn))
    }

    /// The same handler described with another step: `alpha(dt) = alpha_ref ^ (dt / dt_ref)`, to first order only:
    /// finer steps lag more.
    ///
    /// # Errors
    /// Where `dt_s` is not a time, or the lag becomes more than a harness.
    pub fn with_dt(&self, dt_s: f64) -> Result<Self, HarnessError> {
        let alpha = self.alpha.powf(dt_s / self.dt_s);
        Self::new(crate::se2::pose2(&self.robot_from_default), alpha, dt_s)
    }
}

/// The place of a pose.
#[must_use]
pub fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}

#[cfg(test)]
mod tests {
    use super::{DelayedHarness, HarnessError};
    use crate::se2::{Se2, se2};
    use messages::Pose2;

    const OFFSET: Pose2 = Pose2::new(-0.75, -0.35, 0.0);

    fn harness(alpha: f64) -> DelayedHarness {
        DelayedHarness::new(OFFSET, alpha, 0.5).expect("a harness")
    }

    #[test]
    fn walking_straight_the_lag_settles_at_alpha_over_one_minus_alpha_steps() {
        for alpha in [0.0, 0.4, 0.7] {
            let forward = se2(Pose2::new(0.25, 0.0, 0.0));
            let mut offset = se2(OFFSET);
            for _ in 0..100 {
                offset = harness(alpha).step(&offset, &forward);
            }
            let lag = OFFSET.x_m - offset.translation.x;
            assert!((lag - alpha / (1.0 - alpha) * 0.25).abs() < 1e-9, "{lag} for {alpha}");
        }
    }

    #[test]
    fn at_standstill_the_handler_recovers_the_default_offset() {
        let mut offset = se2(Pose2::new(-1.1, 0.2, 0.5));
        for _ in 0..60 {
            offset = harness(0.4).step(&offset, &Se2::identity());
        }
        assert!((offset.translation.x - OFFSET.x_m).abs() < 1e-9 && offset.rotation.angle().abs() < 1e-9);
    }

    #[test]
    fn within_a_step_it_goes_from_the_present_to_the_step() {
        let (from, motion) = (se2(Pose2::new(-0.9, -0.3, 0.1)), se2(Pose2::new(0.2, 0.1, 0.3)));
        let whole = harness(0.4).step(&from, &motion);
        assert_eq!(harness(0.4).follow(&from, &motion, 1.0), whole);
        assert!(
            (harness(0.4).follow(&from, &Se2::identity(), 0.0).translation.vector - from.translation.vector).norm()
                < 1e-12
        );
    }

    #[test]
    fn a_turn_of_a_half_circle_is_recovered_on_the_short_arc() {
        let offset = harness(0.4).step(&se2(Pose2::new(-0.75, -0.35, 3.0)), &se2(Pose2::new(0.0, 0.0, -0.5)));
        // 3.5 rad is -2.78 the short way; 40 % of it is remembered.
        assert!((offset.rotation.angle() + 0.4 * (std::f64::consts::TAU - 3.5)).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_harness_is_refused_with_the_reason() {
        assert_eq!(DelayedHarness::new(OFFSET, 1.0, 0.5), Err(HarnessError::Alpha(1.0)));
        assert!(matches!(DelayedHarness::new(OFFSET, 0.9, 0.5), Err(HarnessError::Lag { .. })));
        assert!(matches!(DelayedHarness::new(Pose2::new(-3.0, 0.0, 0.0), 0.4, 0.5), Err(HarnessError::Offset { .. })));
        assert!(harness(0.4).with_dt(0.25).is_ok());
    }
}
