//! The rules for a step back alone: no camera looks where it leads, and the handler stands there.

use messages::UnsafeCause;

use super::{Present, SLIGHT, push_robot};
use crate::hull::{Disc, Discs};
use crate::interaction::place;
use crate::memory::{FLOOR_CELL_M, Memory};
use crate::se2::Point;
use crate::shield::{Judgement, Motion};

/// A handler who does not back up may end up so much nearer to the robot than by default, metres: an arm bends.
const GIVES_M: f64 = 0.25;

impl Present<'_> {
    /// A step back leads over floor alone that was seen or trodden, and stays far from every edge. The lidar has to see
    /// the handler far enough from where the robot ends, so that the handle does not push into a handler who stands.
    pub(super) fn judge_back(&self, discs: &Discs, motion: &Motion, judgement: &mut Judgement) {
        let Some(from_edges_m) = self.config.back_from_edges_m.filter(|_| motion.robot.translation.x < -SLIGHT) else {
            return;
        };
        let stands_at = self.carried * motion.robot;
        let mut robot = Discs::none();
        push_robot(&mut robot, self.config, &stands_at);
        // A robot that is alone pushes no handle into anybody.
        let leaves_room = self.handler.is_none_or(|handler| {
            let Some(seen) = handler.seen else { return false };
            let is_far = |middle: Point| {
                let touches = |disc: &Disc| (middle - disc.center).norm() < disc.radius_m + handler.radius_m;
                (middle - place(&stands_at)).norm() >= seen.by_default_m - GIVES_M && !robot.iter().any(touches)
            };
            is_far(seen.at) && is_far(seen.next)
        });
        if !leaves_room {
            judgement.forbid(UnsafeCause::Handler);
        }
        let Some(memory) = self.memory.filter(|memory| memory.watches_floor()) else {
            judgement.forbid(UnsafeCause::FloorUnseen);
            return;
        };
        let swept = self.swept.of(discs);
        // An uncertainty that is no number excuses nothing.
        let near = edges(memory).find(|(place, uncertainty_m)| {
            self.count(0, 1, 1);
            let within_m = from_edges_m + uncertainty_m;
            !within_m.is_finite() || swept.nearer_m(*place, within_m).is_some()
        });
        if let Some((place, uncertainty_m)) = near {
            let needed_m = from_edges_m + uncertainty_m;
            judgement.forbid_floor(UnsafeCause::DropOff, place, swept.signed_distance_m(place), needed_m);
        }
        // Robot and handler do not tread on the margin; half a cell is the map's resolution.
        let treads_m = -self.config.margin_m - FLOOR_CELL_M / 2.0;
        let stands_on = |place: Point| {
            self.now.iter().any(|disc| (place - disc.center).norm() <= disc.radius_m - self.config.margin_m)
        };
        let is_trodden_on = |place: Point| {
            self.count(0, 1, 1);
            swept.nearer_m(place, treads_m).is_some() && !stands_on(place)
        };
        let mut unseen = self.sorted.unseen_floor.iter().map(|(place, _)| *place);
        if let Some(place) = unseen.find(|place| is_trodden_on(*place)) {
            judgement.forbid_floor(UnsafeCause::FloorUnseen, place, swept.signed_distance_m(place), treads_m);
        }
    }
}

/// Edges, steps, and what lies beyond an edge (robot frame), and by how much each may be off, metres.
fn edges(memory: &Memory) -> impl Iterator<Item = (Point, f64)> {
    let steps = memory.steps().iter().map(|step| &step.at);
    let remembered = memory.edges().iter().chain(steps).map(|at| (at.place, at.uncertainty_m));
    remembered.chain(memory.beyond_edges().map(|place| (place, 0.0)))
}
