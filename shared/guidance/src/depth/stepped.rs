//! Steps in the floor, as a depth frame shows them.

use super::DepthView;
use super::steps::{Look, Step, StepMax};
use crate::se2::Point;

/// What falls deeper shows as an edge, metres.
const EDGE_M: f64 = 0.1;

/// A step in the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorStep {
    /// The last floor before it (robot frame).
    pub place: Point,
    /// By how much the floor rises there, away from the robot, metres; less than 0: it falls.
    pub rise_m: f64,
}

impl DepthView {
    /// A view that looks for steps in the floor. One that can be taken ends no floor.
    #[must_use]
    pub fn with_steps(step_max: StepMax) -> Self {
        Self { step_max: Some(step_max), ..Self::default() }
    }

    /// Low steps that are known, seen from where the robot is at the next frame's stamp: floor beyond them lies lower
    /// or higher, though that frame may not show why.
    pub fn expect_steps(&mut self, known: impl Iterator<Item = FloorStep>) {
        self.known.clear();
        self.known.extend(known);
    }

    /// Finds the steps in the floor, and takes those that can be taken out of the floor that is to be trimmed.
    pub(super) fn find_steps(&mut self, apart_at_1_m: f64, height_m: f64) {
        let Some(max) = self.step_max else { return };
        let (eye, forward) = (self.camera, self.forward);
        let known = self.known.iter().map(|step| {
            let to = step.place - eye;
            Step { along_m: to.dot(&forward), left_m: forward.perp(&to), rise_m: step.rise_m }
        });
        let look = Look { ahead_m: eye.coords.dot(&forward), height_m, apart_at_1_m };
        self.stepped.find(&look, &max, known);
        if self.stepped.is_level() {
            return;
        }
        for i in 0..self.low.len() {
            let to = Point::from(self.low[i].xy()) - self.camera;
            self.low[i].z -= self.stepped.level_m(to.dot(&self.forward), self.forward.perp(&to), self.low[i].z);
        }
    }

    pub(super) fn place_steps(&mut self) {
        self.steps.clear();
        let is_told = |step: &&Step| step.rise_m > -EDGE_M || self.step_max.is_some_and(|max| max.allows(step.rise_m));
        for step in self.stepped.steps().iter().filter(is_told) {
            let place = self.now_from_stamped * self.place(step.along_m, step.left_m);
            self.steps.push(FloorStep { place, rise_m: step.rise_m });
        }
    }

    /// Steps in the floor up or down, robot frame, also those that are too high to be taken. A deep fall that cannot be
    /// taken is among [`Self::edges`] instead.
    #[must_use]
    pub fn steps(&self) -> &[FloorStep] {
        &self.steps
    }

    /// Whether floor is seen to go on at a point (robot frame) without a step.
    #[must_use]
    pub fn shows_no_step(&self, point: Point) -> bool {
        let to = self.stamped_from_now * point - self.camera;
        self.stepped.is_plain(to.dot(&self.forward), self.forward.perp(&to))
    }
}
