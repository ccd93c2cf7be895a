//! How often a team has stepped back at a place.

use guidance::Se2;
use guidance::se2::Point;

/// A team steps back so often before it has come as far as this from where it did first, metres.
const STEPS_MAX: u32 = 2;
const AWAY_M: f64 = 0.5;
/// A motion that goes back by more is a step back, metres.
const BACK_M: f64 = 0.05;

/// See the module.
#[derive(Debug, Clone, Copy, Default)]
pub struct Backed {
    steps: u32,
    /// Where the first one began (odometry frame).
    at: Point,
}

impl Backed {
    /// The robot has come to a pose (odometry frame) by a motion, at that share of its speed.
    pub fn take(&mut self, odom_from_robot: &Se2, last_motion: &Se2, speed: f64) {
        let here = Point::from(odom_from_robot.translation.vector);
        if (here - self.at).norm() > AWAY_M {
            self.steps = 0;
        }
        if last_motion.translation.x < -BACK_M * speed {
            if self.steps == 0 {
                self.at = here;
            }
            self.steps += 1;
        }
    }

    /// Whether the team may step back once more.
    pub fn may_step(&self) -> bool {
        self.steps < STEPS_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::{Backed, Se2};

    #[test]
    fn a_team_steps_back_twice_at_a_place_and_again_elsewhere() {
        let (mut backed, mut pose) = (Backed::default(), Se2::translation(3.0, 1.0));
        let mut goes = |x_m: f64, yaw_rad: f64| {
            let motion = Se2::new(nalgebra::Vector2::new(x_m, 0.0), yaw_rad);
            pose *= motion;
            backed.take(&pose, &motion, 1.0);
            backed.may_step()
        };
        assert!(goes(0.25, 0.0) && goes(-0.15, 0.0) && goes(0.0, 0.2) && goes(0.1, 0.0));
        assert!(!goes(-0.15, 0.0) && !goes(0.25, 0.0) && !goes(0.2, 0.0));
        assert!(goes(0.4, 0.0), "half a metre on");
    }
}
