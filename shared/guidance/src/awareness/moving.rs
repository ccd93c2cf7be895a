//! How the robot moves, as far as permits tell: what it moved before carries it on.

use messages::{Twist2, s_from_ns};

/// A robot follows a command with about this time constant, seconds.
const FOLLOWS_S: f64 = 0.15;

/// The last permit's velocity, and how the robot moved when it came.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moving {
    command: Twist2,
    before: Twist2,
    since_ns: u64,
}

impl Moving {
    /// A permit of that velocity (robot frame; zero where it grants none) is given.
    pub fn permit(&mut self, now_ns: u64, velocity: Twist2) {
        if velocity != self.command {
            *self = Self { command: velocity, before: self.at(now_ns), since_ns: now_ns };
        }
    }

    /// How the robot moves now (robot frame).
    #[must_use]
    pub fn at(&self, now_ns: u64) -> Twist2 {
        let kept = (-s_from_ns(now_ns.saturating_sub(self.since_ns)) / FOLLOWS_S).exp();
        let mix = |before: f64, command: f64| command + (before - command) * kept;
        Twist2 {
            vx_mps: mix(self.before.vx_mps, self.command.vx_mps),
            vy_mps: mix(self.before.vy_mps, self.command.vy_mps),
            wz_radps: mix(self.before.wz_radps, self.command.wz_radps),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Moving;
    use messages::{NS_PER_S, Twist2};

    #[test]
    fn a_robot_goes_on_as_before_and_comes_to_what_it_is_permitted() {
        let on = Twist2 { vx_mps: 0.5, ..Twist2::ZERO };
        let mut moving = Moving::default();
        moving.permit(NS_PER_S, on);
        assert!(moving.at(NS_PER_S).is_zero());
        // The same again begins nothing anew.
        moving.permit(NS_PER_S + NS_PER_S / 10, on);
        assert!((moving.at(2 * NS_PER_S).vx_mps - 0.5).abs() < 1e-3);
        moving.permit(2 * NS_PER_S, Twist2::ZERO);
        assert!((moving.at(2 * NS_PER_S).vx_mps - 0.5).abs() < 1e-3);
        assert!(moving.at(3 * NS_PER_S).vx_mps < 1e-3);
    }
}
