//! What a sensor looks at: the world at one moment.

use guidance::Tilt;
use guidance::se2::{Point, Se2, se2};
use messages::{Pose2, Walker, WorldTruth};
use nalgebra::Vector3;

use crate::World;

/// Radius of the handler's body as sensors see it, metres.
pub const HANDLER_SEEN_RADIUS_M: f64 = 0.20;
/// Height of the handler and of walking people, metres.
pub const PERSON_HEIGHT_M: f64 = 1.75;

/// A world at one moment. Sensors do not see the robot that carries them.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// What stands still, and doors.
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
    /// A robot there, its body held like that, and nobody about it.
    #[must_use]
    pub fn without_people(world: &'a World, world_from_robot: Pose2, tilt: Option<Tilt>) -> Self {
        Self { world, world_from_robot, tilt, world_from_handler: None, walkers: &[] }
    }

    /// The scene that a truth tells of: doors are turned as it says.
    #[must_use]
    pub fn from_truth(world: &'a mut World, truth: &'a WorldTruth) -> Self {
        world.turn_doors(&truth.doors_rad);
        Self {
            world,
            world_from_robot: truth.world_from_robot,
            tilt: Tilt::of(&truth.attitude),
            world_from_handler: Some(truth.world_from_handler),
            walkers: &truth.walkers[..(truth.walker_count as usize).min(truth.walkers.len())],
        }
    }

    /// How far a ray leads to what it meets first, in lengths of `way` (world frame): floor, the wall of a hole, a
    /// thing, a wall of the floor plan, a person. None where it meets nothing within `max`. Ramps are not asked.
    pub(crate) fn meets(&self, eye: &Vector3<f64>, way: &Vector3<f64>, max: f64) -> Option<f64> {
        let (origin, over) = (Point::from(eye.xy()), way.xy());
        let mut least = self.world.ground_along(eye, way).unwrap_or(f64::INFINITY);
        let heights_m = [eye.z, eye.z + way.z * max];
        let band_m = [heights_m[0].min(heights_m[1]), heights_m[0].max(heights_m[1])];
        self.world.faces_in_sight(origin, band_m, max, |a, b, [z0_m, z1_m]| {
            let (side, to_a) = (b - a, a - origin);
            let turn = over.perp(&side);
            let (t, along) = (to_a.perp(&side) / turn, to_a.perp(&over) / turn);
            // A ray along the face has neither.
            if t >= 0.0 && (0.0..=1.0).contains(&along) && (z0_m..=z1_m).contains(&(eye.z + way.z * t)) {
                least = least.min(t);
            }
        });
        for (center, radius_m) in self.bodies() {
            let to = center - origin;
            let (ahead, square) = (to.dot(&over), over.norm_squared());
            let within = ahead * ahead - square * (to.norm_squared() - radius_m * radius_m);
            let t = (ahead - within.max(0.0).sqrt()) / square;
            if within >= 0.0 && t >= 0.0 && (0.0..=PERSON_HEIGHT_M).contains(&(eye.z + way.z * t)) {
                least = least.min(t);
            }
        }
        if let (Some(map), Some(direction)) = (self.world.map(), over.try_normalize(f64::MIN_POSITIVE)) {
            let range_m = map.cast(origin, direction, max * over.norm());
            least = range_m.map_or(least, |range_m| least.min(range_m / over.norm()));
        }
        (least <= max).then_some(least)
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
