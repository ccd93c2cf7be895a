//! The delayed harness: where the handler will be (Kim et al. 2023, section 4).

use messages::Pose2;
use nalgebra::Vector2;

use super::{HARNESS_M, HarnessError, Interaction, LAG_SPEED_MPS, checked_offset};
use crate::se2::{Se2, pose2, se2, wrap_angle};

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
        let robot_from_default = se2(Pose2::new(-0.75, -0.35, 0.0));
        Self { robot_from_default, alpha: 0.4, dt_s: 0.5 }
    }
}

impl DelayedHarness {
    /// A harness with that default offset (robot frame), that remembers the share `alpha` per step of `dt_s`.
    ///
    /// # Errors
    /// Where the parameters are no harness's.
    pub fn new(robot_from_handler: Pose2, alpha: f64, dt_s: f64) -> Result<Self, HarnessError> {
        let harness = Self::unbounded(robot_from_handler, alpha, dt_s)?;
        checked_offset(robot_from_handler)?;
        let lag_m = harness.lag_m(LAG_SPEED_MPS);
        if lag_m > HARNESS_M {
            return Err(HarnessError::Lag { alpha, lag_m });
        }
        Ok(harness)
    }

    /// The model with any parameters for which it is defined, a harness's or not: for who fits them or compares models.
    ///
    /// # Errors
    /// Where alpha is not in [0, 1), or a number is none.
    pub fn unbounded(robot_from_handler: Pose2, alpha: f64, dt_s: f64) -> Result<Self, HarnessError> {
        if !(0.0..1.0).contains(&alpha) {
            return Err(HarnessError::Alpha(alpha));
        }
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(HarnessError::Dt(dt_s));
        }
        if !robot_from_handler.is_finite() {
            return Err(HarnessError::Offset { x_m: robot_from_handler.x_m, y_m: robot_from_handler.y_m });
        }
        Ok(Self { robot_from_default: se2(robot_from_handler), alpha, dt_s })
    }

    /// The remembered share per step.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// The step that `alpha` is for, seconds.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        self.dt_s
    }

    /// For how long the handler is behind, in a straight walk: alpha / (1 - alpha) dt, seconds.
    #[must_use]
    pub fn lag_s(&self) -> f64 {
        self.alpha / (1.0 - self.alpha) * self.dt_s
    }

    /// [`DelayedHarness::with_dt`] without asking whether the result is a harness's.
    ///
    /// # Errors
    /// Where `dt_s` is not a time.
    pub fn in_steps_of(&self, dt_s: f64) -> Result<Self, HarnessError> {
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(HarnessError::Dt(dt_s));
        }
        // The power of 1 would be off by rounding.
        let alpha = if dt_s == self.dt_s { self.alpha } else { self.alpha.powf(dt_s / self.dt_s) };
        Ok(Self { alpha, dt_s, ..self.clone() })
    }

    /// The same handler described with another step: `alpha(dt) = alpha_ref ^ (dt / dt_ref)`. At standstill both
    /// recover alike; in a walk the conversion holds to first order only, and its error is told: a finer step lags
    /// more.
    ///
    /// # Errors
    /// Where `dt_s` is not a time, or the lag becomes more than a harness.
    pub fn with_dt(&self, dt_s: f64) -> Result<Converted, HarnessError> {
        let converted = self.in_steps_of(dt_s)?;
        let harness = Self::new(pose2(&converted.robot_from_default), converted.alpha, dt_s)?;
        let lag_error_s = harness.lag_s() - self.lag_s();
        Ok(Converted { harness, lag_error_s })
    }
}

/// A harness in another step.
#[derive(Debug, Clone, PartialEq)]
pub struct Converted {
    /// The harness.
    pub harness: DelayedHarness,
    /// By how much longer it lags behind in a straight walk than the one that was fitted, seconds: at v m/s the
    /// handler is predicted v times this too far behind.
    pub lag_error_s: f64,
}

impl Interaction for DelayedHarness {
    fn robot_from_default(&self) -> Se2 {
        self.robot_from_default
    }

    /// The temporary offset `o^ = x^H_t - x^R_{t+1}`, drawn towards the default one in the robot's frame at t+1, the
    /// angle on the short arc (Kim et al. 2023, section 4, Delayed Harness Model). Within the step, at 0 nothing is
    /// recovered yet, at 1 all that a step recovers.
    fn follow(&self, robot_from_handler: &Se2, start_from_now: &Se2, fraction: f64) -> Se2 {
        let temporary = start_from_now.inverse() * robot_from_handler;
        let remembered = 1.0 - (1.0 - self.alpha) * fraction.clamp(0.0, 1.0);
        let default = &self.robot_from_default;
        let place: Vector2<f64> =
            default.translation.vector + (temporary.translation.vector - default.translation.vector) * remembered;
        let turn = wrap_angle(temporary.rotation.angle() - default.rotation.angle());
        Se2::new(place, wrap_angle(default.rotation.angle() + remembered * turn))
    }

    fn lag_m(&self, speed_mps: f64) -> f64 {
        self.lag_s() * speed_mps
    }

    fn remembered(&self) -> f64 {
        self.alpha
    }
}

#[cfg(test)]
mod tests {
    use super::{DelayedHarness, HarnessError, Interaction};
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
        assert_eq!(harness(0.4).with_dt(0.0), Err(HarnessError::Dt(0.0)));
    }

    #[test]
    fn in_another_step_it_recovers_alike_at_standstill_and_tells_how_much_more_it_lags() {
        let fitted = harness(0.4);
        let fine = fitted.with_dt(0.25).expect("a harness");
        let (mut once, mut twice) = (se2(Pose2::new(-1.1, 0.2, 0.5)), se2(Pose2::new(-1.1, 0.2, 0.5)));
        once = fitted.step(&once, &Se2::identity());
        for _ in 0..2 {
            twice = fine.harness.step(&twice, &Se2::identity());
        }
        assert!((once.translation.vector - twice.translation.vector).norm() < 1e-12);
        // Walked straight at 0.5 m/s in both steps, the finer one stays behind by what it says.
        let settle = |model: &DelayedHarness| {
            let mut offset = se2(OFFSET);
            for _ in 0..200 {
                offset = model.step(&offset, &se2(Pose2::new(0.5 * model.dt_s(), 0.0, 0.0)));
            }
            offset.translation.x
        };
        let farther = settle(&fitted) - settle(&fine.harness);
        assert!((farther - 0.5 * fine.lag_error_s).abs() < 1e-9 && farther > 0.0, "{farther}");
    }
}
