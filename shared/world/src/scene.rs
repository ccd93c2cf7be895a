//! What a sensor looks at: the world at one moment.

use guidance::Tilt;
use guidance::se2::{Point, Se2, se2};
use messages::{Pose2, Walker, WorldTruth};

use crate::World;

/// Radius of the handler's body as sensors see it, metres.
pub const HANDLER_SEEN_RADIUS_M: f64 = 0.20;
/// Height of the handler and of walking people, metres.
pub const PERSON_HEIGHT_M: f64 = 1.75;

/// A world at one moment. Sensors do not see the robot that carries them.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// What stands still.
    pub world: &'a World,
    /// The robot.
    pub world_from_robot: Pose2,
    /// How its body is held; level without it.
    pub tilt: Option<Tilt>,
    /// The handler; `None` where there is none.
    pub world_from_handler: Option<Pose2>,
    /// Walking people.
    pub walkers: &'a [Walker],
}

impl<'a> Scene<'a> {
    /// The scene that a truth tells of.
    #[must_use]
    pub fn from_truth(world: &'a World, truth: &'a WorldTruth) -> Self {
        Self {
            world,
            world_from_robot: truth.world_from_robot,
            tilt: Tilt::of(&truth.attitude),
            world_from_handler: Some(truth.world_from_handler),
            walkers: &truth.walkers[..(truth.walker_count as usize).min(truth.walkers.len())],
        }
    }

    /// Where something mounted on the robot is.
    pub(crate) fn world_from(&self, robot_from_mount: Pose2) -> Se2 {
        se2(self.world_from_robot) * se2(robot_from_mount)
    }

    /// Handler and walking people as (centre, radius) in the world.
    pub(crate) fn bodies(&self) -> impl Iterator<Item = (Point, f64)> + '_ {
        let handler = self.world_from_handler.map(|pose| (Point::new(pose.x_m, pose.y_m), HANDLER_SEEN_RADIUS_M));
        let walkers = self.walkers.iter().map(|walker| (Point::new(walker.x_m, walker.y_m), walker.radius_m));
        handler.into_iter().chain(walkers)
    }
}
