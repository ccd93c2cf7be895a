//! Who walks with a robot: a handler, or nobody.

use super::{HandlerBody, HandlerEstimate, Sighting};
use crate::scan::Beams;
use crate::se2::Se2;

/// Who walks with the robot, as [`crate::Awareness`] needs to know it.
pub trait Company {
    /// After a gap, a restart or a new odometry frame: nothing is known any more.
    fn reset(&mut self, odom_from_robot: &Se2);
    /// The robot stands at rest here, and they stand where they do by default.
    fn rest(&mut self, odom_from_robot: &Se2);
    /// A decision begins.
    fn begin_step(&mut self, odom_from_robot: &Se2);
    /// The share `fraction` of the step has passed, and the robot is here.
    fn predict(&mut self, odom_from_robot: &Se2, fraction: f64);
    /// Takes in what the lidar sees.
    fn look(&mut self, beams: &Beams, now_ns: u64);
    /// The room that they take, where a lidar is off by `sigma_m`; none: nobody is there.
    fn room(&self, sigma_m: f64) -> Option<HandlerBody>;
    /// Whether they should be there, and are missing.
    fn is_lost(&self) -> bool;
}

/// The robot walks alone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Nobody;

impl Company for Nobody {
    fn reset(&mut self, _odom_from_robot: &Se2) {}
    fn rest(&mut self, _odom_from_robot: &Se2) {}
    fn begin_step(&mut self, _odom_from_robot: &Se2) {}
    fn predict(&mut self, _odom_from_robot: &Se2, _fraction: f64) {}
    fn look(&mut self, _beams: &Beams, _now_ns: u64) {}
    fn room(&self, _sigma_m: f64) -> Option<HandlerBody> {
        None
    }
    fn is_lost(&self) -> bool {
        false
    }
}

impl Company for HandlerEstimate {
    fn reset(&mut self, odom_from_robot: &Se2) {
        Self::reset(self, odom_from_robot);
    }
    fn rest(&mut self, odom_from_robot: &Se2) {
        *self = Self::new(self.model.clone(), self.limits.clone());
        Self::reset(self, odom_from_robot);
    }
    fn begin_step(&mut self, odom_from_robot: &Se2) {
        Self::begin_step(self, odom_from_robot);
    }
    fn predict(&mut self, odom_from_robot: &Se2, fraction: f64) {
        Self::predict(self, odom_from_robot, fraction);
    }
    fn look(&mut self, beams: &Beams, now_ns: u64) {
        let _: Sighting = self.correct(beams, now_ns);
    }
    fn room(&self, sigma_m: f64) -> Option<HandlerBody> {
        Some(self.body(sigma_m))
    }
    fn is_lost(&self) -> bool {
        Self::is_lost(self)
    }
}
