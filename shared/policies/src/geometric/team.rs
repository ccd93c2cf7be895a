//! Robot and handler as one body: how the handler trails, and how much room the two have.

use super::GeometricConfig;
use super::grid::Window;
use guidance::se2::Point;
use guidance::{Disc, Hull, Interaction, InteractionModel, Se2};

/// Discs that fill the room between robot and handler.
const BETWEEN: usize = 4;

/// The interaction model and the two discs.
#[derive(Debug, Clone)]
pub struct Team {
    model: InteractionModel,
    robot_radius_m: f64,
    handler_radius_m: f64,
}

impl Team {
    /// The team that the configuration describes.
    pub fn new(config: &GeometricConfig) -> Self {
        Self {
            model: config.model.clone(),
            robot_radius_m: config.robot_radius_m,
            handler_radius_m: config.handler_radius_m,
        }
    }

    /// Where the handler walks when nothing disturbs them.
    pub fn robot_from_handler(&self) -> Se2 {
        self.model.robot_from_default()
    }

    /// The handler after the robot has moved, both times in the robot's frame of the moment.
    pub fn follow(&self, start_from_end: &Se2, robot_from_handler: &Se2) -> Se2 {
        self.model.step(robot_from_handler, start_from_end)
    }

    /// The swept hull of a motion from one place of the team to another, as the shield has it.
    pub fn hull(before: &[(Point, f64); 2], after: &[(Point, f64); 2]) -> Hull {
        Hull::new([before[0], before[1], after[0], after[1]].map(|(center, radius_m)| Disc { center, radius_m }))
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
