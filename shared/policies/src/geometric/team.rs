//! Robot and handler as one body: how the handler trails, and how much room the two have.

use super::GeometricConfig;
use super::grid::Window;
use guidance::se2::Point;
use guidance::{Disc, Hull, Interaction, InteractionModel, Se2};

/// Discs that fill the room between robot and handler.
const BETWEEN: usize = 4;
/// Half the width of a team side by side (0.3 m to the left of its middle and 0.25 m + 0.35 m - 0.15 m to the right)
/// and a little more. Its middle lies so far to the left of the robot, which has its handler on the right.
const BESIDE: Width = Width { fits_m: 0.47, middle_y_m: -0.15 };
/// A team in single file needs so much more than the robot's own disc, metres.
const FILE_RESERVE_M: f64 = 0.02;

/// How wide a team is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Width {
    /// Its middle fits where there is so much clearance, metres.
    pub fits_m: f64,
    /// Where its middle lies from the robot, to the left, metres.
    pub middle_y_m: f64,
}

/// The interaction model and the two discs.
#[derive(Debug, Clone)]
pub struct Team {
    model: InteractionModel,
    width: Width,
    robot_radius_m: f64,
    handler_radius_m: f64,
}

impl Team {
    /// The team that the configuration describes, side by side.
    pub fn beside(config: &GeometricConfig) -> Self {
        Self::new(config, &config.model, BESIDE)
    }

    /// The team in single file, whose handler follows by `model`.
    pub fn behind(config: &GeometricConfig, model: &InteractionModel) -> Self {
        let fits_m = config.robot_radius_m.max(config.handler_radius_m) + FILE_RESERVE_M;
        Self::new(config, model, Width { fits_m, middle_y_m: 0.0 })
    }

    fn new(config: &GeometricConfig, model: &InteractionModel, width: Width) -> Self {
        let (robot_radius_m, handler_radius_m) = (config.robot_radius_m, config.handler_radius_m);
        Self { model: model.clone(), width, robot_radius_m, handler_radius_m }
    }

    /// How the handler follows.
    pub fn model(&self) -> &InteractionModel {
        &self.model
    }

    /// How wide it is.
    pub fn width(&self) -> Width {
        self.width
    }

    /// Its middle, in the frame of the robot's pose.
    pub fn middle(&self, robot: &Se2) -> Point {
        robot * Point::new(0.0, self.width.middle_y_m)
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
