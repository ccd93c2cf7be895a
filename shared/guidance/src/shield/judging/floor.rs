//! What the floor forbids: edges and steps, and floor that was not seen.

use messages::UnsafeCause;
use nalgebra::Vector2;

use super::{KeptOff, Present, SLIGHT};
use crate::depth::DepthView;
use crate::hull::{Disc, Discs};
use crate::interaction::place;
use crate::memory::{FLOOR_CELL_M, Floor, Memory, Remembered, RememberedStep};
use crate::se2::Point;
use crate::second::SecondView;
use crate::shield::{Judgement, Motion};

/// A turn on the spot may lead the pair this far over floor that was never seen, metres.
const TURN_ASSUMED_M: f64 = 0.3;
/// Any other motion may lead over a rim this wide around the pair, metres.
const RIM_ASSUMED_M: f64 = 0.15;
/// No part of a body comes farther than this from floor that was seen, metres, also over several motions. The middle of
/// a handler then stands at most 0.25 m beyond it.
const ASSUMED_M: f64 = 0.5;
/// Half of a cell of floor, metres.
const RIM_M: f64 = FLOOR_CELL_M / 2.0;

impl Present<'_> {
    /// Robot and handler tread only on floor that was seen, but for what is assumed. They keep from what lies beyond an
    /// edge, as from an edge beside their way. An edge is told rather than floor that was not seen.
    pub(super) fn judge_floor(&self, discs: &Discs, motion: &Motion, judgement: &mut Judgement) {
        let (way, turns) = (motion.robot.translation.vector, motion.robot.rotation.angle().abs() > SLIGHT);
        let is_on_spot = way.norm() < SLIGHT;
        if is_on_spot && !turns || self.sorted.unseen_floor.is_empty() {
            return;
        }
        let edge_m = self.config.edges.beside_m;
        let bounds = discs.iter().fold(Bounds::NONE, |bounds, disc| bounds.with(disc, edge_m));
        self.count(0, self.sorted.unseen_floor.len() as u64, 0);
        let mut least = None::<Forbidden>;
        for (place, floor) in self.sorted.unseen_floor.iter().filter(|(place, _)| bounds.contains(place)) {
            // Robot and handler do not tread on the margin. Half a cell is the map's resolution.
            let needed_m = if *floor == Floor::Beyond { edge_m } else { -self.config.margin_m - RIM_M };
            self.count(0, 0, 1);
            let Some(away_m) = self.swept.of(discs).nearer_m(*place, needed_m) else { continue };
            let from_here_m = self.hull().signed_distance_m(*place);
            let may_assume =
                || if is_on_spot { from_here_m <= TURN_ASSUMED_M } else { self.is_rim(*place, from_here_m, &way) };
            // The strip at the start is for going ahead. Aside it is as good as unseen.
            let is_strip = *floor == Floor::Assumed && !self.is_aside(*place, &way);
            let is_unseen = matches!(floor, Floor::Unseen | Floor::Assumed);
            // What lies so deep in the present hull was judged when it came there. Way and drift take the memory of it
            // away, and it would hold them for good.
            let is_under = from_here_m <= needed_m;
            let is_assumed = is_strip || is_unseen && (is_under || may_assume() && self.is_near_seen(*place));
            let is_left = *floor == Floor::Beyond && from_here_m < edge_m && !self.gets_closer(*place, motion);
            if is_assumed || is_left {
                judgement.assumes_floor |= is_assumed && from_here_m > 0.0;
                continue;
            }
            let found = Forbidden { place: *place, is_edge: *floor == Floor::Beyond, away_m, needed_m };
            least = least.filter(|least| !found.outdoes(least)).or(Some(found));
        }
        let Some(Forbidden { place, is_edge, away_m, needed_m }) = least else { return };
        let cause = if is_edge { UnsafeCause::DropOff } else { UnsafeCause::FloorUnseen };
        judgement.forbid_floor(cause, place, away_m, needed_m);
    }

    /// Floor is assumed only close to floor that was seen.
    fn is_near_seen(&self, place: Point) -> bool {
        self.memory.is_some_and(|memory| memory.has_floor_near(place, ASSUMED_M))
    }

    /// Whether floor that was not seen is assumed about a pair that goes on: a rim about where they stand. The camera
    /// does not look aside: ahead of a way there, only a gap in floor that was seen is assumed.
    fn is_rim(&self, place: Point, from_here_m: f64, way: &Vector2<f64>) -> bool {
        let is_open = self.is_aside(place, way) && !self.is_gap(place, way);
        from_here_m <= if is_open { 0.0 } else { RIM_ASSUMED_M }
    }

    /// Whether a motion leads aside, to a place.
    fn is_aside(&self, place: Point, way: &Vector2<f64>) -> bool {
        way.y.abs() > SLIGHT && self.is_ahead(place, way)
    }

    /// Whether a place lies within 60 degrees of a way, as seen from the one of robot and handler that is nearer to it.
    fn is_ahead(&self, place: Point, way: &Vector2<f64>) -> bool {
        let from_robot = place - Point::origin();
        let from_handler = self.handler.map(|handler| place - handler.center);
        let to = from_handler.filter(|from| from_robot.norm() >= from.norm()).unwrap_or(from_robot);
        2.0 * way.dot(&to) > way.norm() * to.norm()
    }

    /// Whether floor was seen shortly beyond a place on a way.
    fn is_gap(&self, place: Point, way: &Vector2<f64>) -> bool {
        let beyond = |steps: f64| place + way * (steps * FLOOR_CELL_M / way.norm());
        let is_seen = |place: Point| self.memory.is_some_and(|memory| memory.has_seen_floor(place));
        [1.0, 2.0].map(beyond).into_iter().any(is_seen)
    }

    /// Edges. An edge within 60 degrees of the way is ahead. With a memory, one frame alone may be noise.
    pub(super) fn edges(&self, motion: &Motion) -> impl Iterator<Item = KeptOff> {
        let alone = self.depth.filter(|_| self.memory.is_none());
        let seen = alone.map_or(&[][..], DepthView::edges).iter().map(|edge| (*edge, 0.0));
        let remembered = self.memory.map_or(&[][..], Memory::edges).iter();
        let second = self.second.filter(|_| self.memory.is_none());
        let seen = seen.chain(second.map_or(&[][..], SecondView::edges).iter().map(|edge| (*edge, 0.0)));
        let all = seen.chain(remembered.map(|edge| (edge.place, edge.uncertainty_m)));
        let needed_m = self.kept_from_edge_m(motion);
        all.map(move |(place, uncertainty_m)| {
            let kept_m = uncertainty_m + needed_m(place);
            KeptOff::of(UnsafeCause::DropOff, place, kept_m)
        })
    }

    /// Low steps that the handler has not allowed. As much is kept from them as from edges. No word lets the robot turn
    /// on the spot beside them: there they have the causes of high ones.
    pub(super) fn low_steps(&self, motion: &Motion) -> impl Iterator<Item = KeptOff> {
        let needed_m = self.kept_from_edge_m(motion);
        let is_asked = motion.robot.translation.vector.norm() > SLIGHT;
        let low = self.steps(motion).filter(|(step, _, is_low)| *is_low && !step.is_allowed);
        low.map(move |(step, rise_m, _)| {
            let cause = match (rise_m < 0.0, is_asked) {
                (true, true) => UnsafeCause::LowStepDown,
                (true, false) => UnsafeCause::DropOff,
                (false, true) => UnsafeCause::LowStepUp,
                (false, false) => UnsafeCause::StepUp,
            };
            let Remembered { place, uncertainty_m, .. } = step.at;
            KeptOff { step_m: rise_m, ..KeptOff::of(cause, place, uncertainty_m + needed_m(place)) }
        })
    }

    /// Steps that are too high on this way, allowed or not. From one that leads up no more is kept than from any thing.
    pub(super) fn high_steps(&self, motion: &Motion) -> impl Iterator<Item = KeptOff> {
        let needed_m = self.kept_from_edge_m(motion);
        self.steps(motion).filter(|(.., is_low)| !is_low).map(move |(step, rise_m, _)| {
            let Remembered { place, uncertainty_m, .. } = step.at;
            let (cause, needed_m) =
                if rise_m < 0.0 { (UnsafeCause::DropOff, needed_m(place)) } else { (UnsafeCause::StepUp, 0.0) };
            KeptOff { step_m: rise_m, ..KeptOff::of(cause, place, uncertainty_m + needed_m) }
        })
    }

    /// Steps, by how much the floor rises there on a motion's way, and whether such a step may be allowed. Who turns
    /// on the spot goes where the handler goes.
    fn steps(&self, motion: &Motion) -> impl Iterator<Item = (&RememberedStep, f64, bool)> {
        let way = motion.robot.translation.vector;
        let handler_goes = || Some(place(&motion.handler?) - self.handler?.center);
        let way = if way.norm() > SLIGHT { way } else { handler_goes().unwrap_or(way) };
        let max = self.memory.and_then(Memory::step_max);
        let all = self.memory.map_or(&[][..], Memory::steps).iter();
        all.map(move |step| {
            let rise_m = if step.onward.dot(&way) < 0.0 { -step.rise_m } else { step.rise_m };
            (step, rise_m, max.is_some_and(|max| max.allows(rise_m)))
        })
    }

    /// What a motion keeps from an edge at a place, metres.
    fn kept_from_edge_m(&self, motion: &Motion) -> impl Fn(Point) -> f64 {
        let ends = [Some(place(&motion.robot)), motion.handler.as_ref().map(place)];
        let way = motion.robot.translation.vector.try_normalize(SLIGHT);
        let needed = self.config.edges;
        move |edge| {
            // Of robot and handler, the one that is nearer to it.
            let from = ends.into_iter().flatten().map(|end| edge - end).min_by(|a, b| a.norm().total_cmp(&b.norm()));
            let to = from.and_then(|from| from.try_normalize(SLIGHT));
            let towards = way.zip(to).map_or(0.0, |(way, to)| (2.0 * way.dot(&to)).clamp(0.0, 1.0));
            needed.beside_m + (needed.ahead_m - needed.beside_m) * towards
        }
    }
}

/// Floor that forbids a motion.
#[derive(Debug, Clone, Copy)]
struct Forbidden {
    place: Point,
    is_edge: bool,
    away_m: f64,
    needed_m: f64,
}

impl Forbidden {
    /// An edge before floor that was not seen, and what lies deeper in the hull.
    fn outdoes(&self, other: &Self) -> bool {
        let short_m = |of: &Self| of.needed_m - of.away_m;
        (self.is_edge, short_m(self)) > (other.is_edge, short_m(other))
    }
}

/// A box about discs (robot frame).
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: Point,
    high: Point,
}

impl Bounds {
    const NONE: Self =
        Self { low: Point::new(f64::INFINITY, f64::INFINITY), high: Point::new(f64::NEG_INFINITY, f64::NEG_INFINITY) };

    fn with(self, disc: &Disc, more_m: f64) -> Self {
        let reach = Vector2::repeat(disc.radius_m + more_m);
        Self { low: self.low.inf(&(disc.center - reach)), high: self.high.sup(&(disc.center + reach)) }
    }

    fn contains(&self, place: &Point) -> bool {
        (self.low.x..=self.high.x).contains(&place.x) && (self.low.y..=self.high.y).contains(&place.y)
    }
}
