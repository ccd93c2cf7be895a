//! Where a robot gets to on a floor without walls.

use messages::{Attitude, Pose2, Twist2, s_from_ns};
use unitree::State;

/// Of a robot that tells it, percent.
const CHARGE_PERCENT: u8 = 80;

/// A floor without walls, and a robot on it that takes every velocity at once.
#[derive(Debug, Default)]
pub struct OpenFloor {
    /// Since the robot was switched on.
    pose: Pose2,
    moved_ns: Option<u64>,
}

impl OpenFloor {
    /// Moves on to now at that velocity: what the robot's sensors then know.
    pub fn go_on(&mut self, now_ns: u64, velocity: Twist2) -> State {
        let since_s = self.moved_ns.map_or(0.0, |moved_ns| s_from_ns(now_ns.saturating_sub(moved_ns)));
        self.moved_ns = Some(now_ns);
        let Pose2 { x_m, y_m, yaw_rad } = self.pose;
        let (sin, cos) = (yaw_rad + velocity.wz_radps * since_s / 2.0).sin_cos();
        self.pose = Pose2::new(
            x_m + (velocity.vx_mps * cos - velocity.vy_mps * sin) * since_s,
            y_m + (velocity.vx_mps * sin + velocity.vy_mps * cos) * since_s,
            yaw_rad + velocity.wz_radps * since_s,
        );
        State::held(self.pose, &Attitude::default(), velocity, Some(CHARGE_PERCENT))
    }
}
