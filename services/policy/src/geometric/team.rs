//! Robot and handler as one body: how the handler trails, and how much room the two have.

use super::GeometricConfig;
use super::grid::Window;
use guidance::Se2;
use guidance::se2::{Point, se2, wrap_angle};
use nalgebra::Vector2;

/// Discs that fill the room between robot and handler.
const BETWEEN: usize = 4;

/// The delayed harness and the two discs (Kim et al. 2023, delayed harness; design section 8).
#[derive(Debug, Clone)]
pub struct Team {
    /// Where the rigid harness would hold the handler.
    pub robot_from_handler: Se2,
    alpha: f64,
    robot_radius_m: f64,
    handler_radius_m: f64,
}

impl Team {
    /// The team that the configuration describes.
    pub fn new(config: &GeometricConfig) -> Self {
        Self {
            robot_from_handler: se2(config.robot_from_handler),
            alpha: config.alpha.clamp(0.0, 0.95),
            robot_radius_m: config.robot_radius_m,
            handler_radius_m: config.handler_radius_m,
        }
    }

    /// The handler after the robot has moved, both times in the robot's frame of the moment.
    pub fn follow(&self, start_from_end: &Se2, robot_from_handler: &Se2) -> Se2 {
        let held = start_from_end.inverse() * robot_from_handler;
        let rigid = &self.robot_from_handler;
        let place: Vector2<f64> = rigid.translation.vector.lerp(&held.translation.vector, self.alpha);
        let turn = wrap_angle(held.rotation.angle() - rigid.rotation.angle());
        Se2::new(place, rigid.rotation.angle() + self.alpha * turn)
    }

    /// The two discs: robot and handler, in the frame of the poses.
    pub fn discs(&self, robot: &Se2, robot_from_handler: &Se2) -> [(Point, f64); 2] {
        let handler = robot * robot_from_handler;
        [
            (Point::from(robot.translation.vector), self.robot_radius_m),
            (Point::from(handler.translation.vector), self.handler_radius_m),
        ]
    }

    /// From the team (and what lies between the two) to the nearest obstacle, metres; negative where one is inside.
    pub fn room_m(&self, window: &Window, discs: &[(Point, f64); 2]) -> f64 {
        let [(robot, robot_radius_m), (handler, handler_radius_m)] = discs;
        let mut room_m = f64::INFINITY;
        for i in 0..=BETWEEN {
            let share = i as f64 / BETWEEN as f64;
            let place = robot + (handler - robot) * share;
            let radius_m = robot_radius_m + (handler_radius_m - robot_radius_m) * share;
            room_m = room_m.min(window.clearance_at(place) - radius_m);
        }
        room_m
    }
}

/// Half-way between two positions of the team.
pub fn half_way(a: &[(Point, f64); 2], b: &[(Point, f64); 2]) -> [(Point, f64); 2] {
    [(nalgebra::center(&a[0].0, &b[0].0), a[0].1), (nalgebra::center(&a[1].0, &b[1].0), a[1].1)]
}

#[cfg(test)]
mod tests {
    use super::{GeometricConfig, Se2, Team};
    use nalgebra::Vector2;

    #[test]
    fn at_a_steady_walk_the_lag_is_alpha_over_one_minus_alpha_steps() {
        let team = Team::new(&GeometricConfig::default());
        let step = Se2::new(Vector2::new(0.25, 0.0), 0.0);
        let handler = (0..60).fold(team.robot_from_handler, |handler, _| team.follow(&step, &handler));
        assert!((handler.translation.x - (-0.75 - 0.4 / 0.6 * 0.25)).abs() < 1e-9);
        assert!((handler.translation.y + 0.35).abs() < 1e-12);
    }
}
