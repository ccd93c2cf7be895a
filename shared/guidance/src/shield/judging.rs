//! How one motion is judged: everything that all motions from one moment share is prepared once.

use std::cell::OnceCell;
use std::f64::consts::TAU;

use messages::{Twist2, UnsafeCause};
use nalgebra::Vector2;

use super::{Evidence, Judgement, Motion, ShieldConfig};
use crate::boundary::{Boundary, Readings, Seen, positive_turn};
use crate::depth::DepthView;
use crate::handler::HandlerBody;
use crate::hull::{Disc, Discs, Hull};
use crate::interaction::place;
use crate::memory::{FLOOR_CELL_M, Floor, Memory};
use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2, exp, log};

/// An action's hull reaches beyond the present one where its threshold is greater by more than rounding, metres.
const BEYOND_M: f64 = 1e-9;
/// The escape rule allows what comes nearer by less than this, metres: what is abeam, give or take a centimetre, when
/// the robot goes straight on.
const CLOSER_M: f64 = 1e-4;
/// A shorter way, a smaller turn or a smaller difference of direction counts as none: metres, radians, share.
const SLIGHT: f64 = 1e-3;
/// A turn on the spot may lead the pair this far over floor that was never seen, metres.
const TURN_ASSUMED_M: f64 = 0.3;
/// Any other motion may lead over a rim this wide around the pair, metres.
const RIM_ASSUMED_M: f64 = 0.15;
/// No part of a body comes farther than this from floor that was seen, metres, also over several motions. The middle of
/// a handler then stands at most 0.25 m beyond it.
const ASSUMED_M: f64 = 0.5;
/// Half of a cell of floor, metres.
const RIM_M: f64 = FLOOR_CELL_M / 2.0;
/// No hull reaches farther over the floor, metres.
const FLOOR_M: f64 = 2.0;
/// A motion that turns by less is straight, radians.
const STRAIGHT_RAD: f64 = 1e-9;

/// The scan sorted by what each beam means now. Kept from scan to scan, so that a steady state allocates nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Sorted {
    /// Thresholds of the present hull, metres: of the unknown beams alone.
    present_m: Vec<f64>,
    /// Readings to be held against thresholds: without unknown beams and those of the lists below.
    readings: Readings,
    masked: Vec<usize>,
    /// Beams that end strictly inside the present hull, for the escape rule.
    pressing: Vec<usize>,
    /// Floor near the robot that was not seen (robot frame).
    unseen_floor: Vec<(Point, Floor)>,
    /// The beam with the least margin of the motion before: mostly it is the next one's too.
    guess: Option<usize>,
}

/// What all motions from one moment have in common.
pub(super) struct Present<'a> {
    config: &'a ShieldConfig,
    beams: &'a Beams,
    depth: Option<&'a DepthView>,
    memory: Option<&'a Memory>,
    handler: HandlerBody,
    /// The robot's discs and the handler's, now.
    now: Discs,
    /// Where the robot is carried by what it moved before.
    carried: Se2,
    /// Where the handler of a robot that stands comes to on their way to rest (robot frame).
    walks_on: Option<Point>,
    handler_disc: Disc,
    /// The present hull, all at once: only few ask for it.
    hull: OnceCell<Hull>,
    sorted: &'a mut Sorted,
}

impl<'a> Present<'a> {
    pub fn prepare(
        config: &'a ShieldConfig,
        Evidence { beams, depth, memory, moves }: Evidence<'a>,
        handler: HandlerBody,
        sorted: &'a mut Sorted,
    ) -> Self {
        let handler_disc = Disc { center: handler.center, radius_m: handler.radius_m + config.margin_m };
        let mut now = Discs::none();
        push_robot(&mut now, config, &Se2::identity());
        now.push(handler_disc);
        if let Some(center) = handler.elsewhere() {
            now.push(Disc { center, ..handler_disc });
        }
        let hull = OnceCell::new();
        let carried = config.reach.carries_to(&moves);
        let walks_on = config.reach.walks_on(&moves);
        let mut present =
            Self { config, beams, depth, memory, handler, now, carried, walks_on, handler_disc, hull, sorted };
        present.sort(&Boundary::of(&now));
        present
    }

    fn hull(&self) -> &Hull {
        self.hull.get_or_init(|| Hull::new(self.now))
    }

    /// What concerns few beams is looked for where they are: on the handler, and in the present hull.
    fn sort(&mut self, boundary: &Boundary) {
        let beams = self.beams;
        // Who asks for the hull needs all of `self`: the lists go back when they are filled.
        let mut sorted = std::mem::take(self.sorted);
        sorted.readings.copy_from(beams.readings());
        sorted.present_m.resize(beams.beams().len(), 0.0);
        sorted.masked.clear();
        sorted.pressing.clear();
        self.find_masked(&mut sorted);
        match boundary.seen_from(beams.origin()) {
            Some(seen) => {
                let parts = seen.over(beams.directions());
                parts.some_thresholds_m(beams.unknown(), |i, threshold_m| sorted.present_m[i] = threshold_m);
                let is_hit = |i: &usize| beams.beams()[*i].kind == BeamKind::Hit;
                if self.config.escape {
                    parts.each_below(&sorted.readings, |i, _| sorted.pressing.extend(Some(i).filter(is_hit)));
                }
            }
            None => self.sort_from_outside(&mut sorted),
        }
        for i in &sorted.pressing {
            sorted.readings.leave_out(*i);
        }
        sorted.unseen_floor.clear();
        let unseen = self.memory.into_iter().flat_map(|memory| memory.unseen_floor(Point::origin(), FLOOR_M));
        sorted.unseen_floor.extend(unseen);
        sorted.guess = sorted.readings.nearest();
        *self.sorted = sorted;
    }

    fn find_masked(&self, sorted: &mut Sorted) {
        let Some(mask_m) = self.handler.mask_radius_m else { return };
        for center in self.handler.mask_centers() {
            for i in self.beams.fan().towards(center, mask_m).into_iter().flatten() {
                let beam = &self.beams.beams()[i];
                let is_new = sorted.readings.get(i).is_finite();
                if is_new && beam.kind == BeamKind::Hit && self.handler.masks(beam.end) {
                    sorted.masked.push(i);
                    sorted.readings.leave_out(i);
                }
            }
        }
        sorted.masked.sort_unstable();
    }

    fn sort_from_outside(&self, sorted: &mut Sorted) {
        let (beams, hull) = (self.beams, self.hull());
        for i in beams.unknown() {
            sorted.present_m[*i] = hull.threshold_m(beams.origin(), beams.beams()[*i].direction);
        }
        for (i, beam) in beams.beams().iter().enumerate().filter(|_| self.config.escape) {
            // Masked beams are left out already.
            if beam.kind == BeamKind::Hit && sorted.readings.get(i).is_finite() && hull.contains(beam.end) {
                sorted.pressing.push(i);
            }
        }
    }

    /// Robot and handler, now and at the end: where they stand after a stop there, and between.
    pub fn discs(&self, motion: &Motion) -> Discs {
        let mut discs = self.now;
        let handler = |center: Point| Disc { center, radius_m: self.handler_disc.radius_m };
        let stands_at = self.carried * motion.robot;
        push_robot(&mut discs, self.config, &stands_at);
        discs.push(handler(place(&(self.carried * motion.handler))));
        if let Some(rest) = &self.config.reach.robot_from_rest {
            discs.push(handler(place(&(stands_at * rest))));
        }
        if let Some(beyond_rest) = self.walks_on {
            discs.push(handler(stands_at * beyond_rest));
        }
        // Where it is carried another way than it is to go, the hull of beginning and end leaves out the corners.
        if !is_along(&self.carried, &motion.robot) {
            push_robot(&mut discs, self.config, &self.carried);
            push_robot(&mut discs, self.config, &motion.robot);
            let follows = self.config.reach.robot_from_rest.map_or(self.handler.center, |rest| place(&rest));
            discs.push(handler(self.carried * follows));
            discs.push(handler(place(&motion.handler)));
        }
        // They are not there yet: nothing there is excused as if they were.
        if let Some(seen) = self.handler.seen.filter(|seen| seen.next != seen.at) {
            discs.push(handler(seen.next));
        }
        discs
    }

    /// Every beam's threshold, metres, counter-clockwise.
    pub fn thresholds_m(&self, motion: &Motion) -> Vec<f64> {
        let discs = self.discs(motion);
        let mut thresholds_m = Vec::new();
        match Boundary::of(&discs).seen_from(self.beams.origin()) {
            Some(seen) => seen.over(self.beams.directions()).thresholds_m(&mut thresholds_m),
            None => all_thresholds(&Hull::new(discs), self.beams, &mut thresholds_m),
        }
        thresholds_m
    }

    /// Judges one motion (Kim et al. 2023, alg. 1 lines 5-8).
    pub fn judge(&mut self, motion: &Motion) -> Judgement {
        let discs = self.discs(motion);
        let boundary = Boundary::of(&discs);
        let mut judgement = Judgement::default();
        match boundary.seen_from(self.beams.origin()) {
            Some(seen) => self.judge_from_within(&seen, motion, &mut judgement),
            None => self.judge_from_outside(&discs, motion, &mut judgement),
        }
        self.judge_points(&discs, motion, &mut judgement);
        self.judge_floor(&discs, motion, &mut judgement);
        if self.memory.is_some_and(|memory| memory.meets_contact(&motion.robot)) {
            judgement.forbid(UnsafeCause::Contact);
        }
        if self.config.unseen_limit_m2.is_some_and(|limit| judgement.unseen_area_m2 > limit) {
            judgement.forbid(UnsafeCause::Unseen);
        }
        judgement
    }

    /// A lidar inside the hull: each beam leaves it once.
    fn judge_from_within(&mut self, seen: &Seen<'_>, motion: &Motion, judgement: &mut Judgement) {
        let beams = self.beams;
        let parts = seen.over(beams.directions());
        let (margin_m, beam) = parts.least_margin_m(&self.sorted.readings, self.sorted.guess);
        self.sorted.guess = beam;
        if let Some(beam) = beam {
            self.note(beam, margin_m, judgement);
        }
        let half = beams.increment_rad() / 2.0;
        let mut unseen_m2 = 0.0;
        let mut behind = |i: usize, threshold_m: f64| {
            let reading_m = beams.beams()[i].reading_m.min(threshold_m);
            unseen_m2 += (threshold_m * threshold_m - reading_m * reading_m) * half;
        };
        let sorted = &*self.sorted;
        parts.some_thresholds_m(&sorted.masked, &mut behind);
        parts.some_thresholds_m(&sorted.pressing, |i, threshold_m| {
            behind(i, threshold_m);
            if self.gets_closer(beams.beams()[i].end, motion) {
                self.note(i, beams.beams()[i].reading_m - threshold_m, judgement);
            }
        });
        let mut run = UnknownRun::default();
        parts.some_thresholds_m(beams.unknown(), |i, threshold_m| {
            behind(i, threshold_m);
            run.take(self, i, threshold_m, judgement);
        });
        run.close(self, judgement);
        // What is blocked hides what is behind it.
        if margin_m < 0.0 {
            parts.each_below(&sorted.readings, behind);
        }
        judgement.unseen_area_m2 += unseen_m2;
        // What lies outside the field of view is seen by no beam; each beam stands for half an increment to either
        // side.
        let count = beams.beams().len() as f64;
        let rest = TAU - count * beams.increment_rad();
        if rest > half {
            let last = beams.directions().first_rad + (count - 0.5) * beams.increment_rad();
            judgement.unseen_area_m2 += seen.area_between_m2(last, last + rest);
        }
    }

    /// A lidar outside the hull: a beam may meet it or not, and whatever stands before or in it occludes it.
    fn judge_from_outside(&mut self, discs: &Discs, motion: &Motion, judgement: &mut Judgement) {
        let (swept, beams) = (Hull::new(*discs), self.beams);
        let mut seen_m2 = 0.0;
        let mut run = UnknownRun::default();
        for (i, beam) in beams.beams().iter().enumerate() {
            let (enters_m, threshold_m) = swept.crossing_m(beams.origin(), beam.direction).unwrap_or((0.0, 0.0));
            let (near_m, far_m) = (enters_m.max(0.0), beam.reading_m.min(threshold_m));
            seen_m2 += (far_m * far_m - near_m * near_m).max(0.0) * beams.increment_rad() / 2.0;
            if beam.kind == BeamKind::Unknown {
                run.take(self, i, threshold_m, judgement);
            } else if self.sorted.readings.get(i).is_finite()
                || (self.sorted.pressing.binary_search(&i).is_ok() && self.gets_closer(beam.end, motion))
            {
                self.note(i, beam.reading_m - threshold_m, judgement);
            }
        }
        run.close(self, judgement);
        let whole = Boundary::of(discs);
        let whole_m2 = whole.seen_from(discs[0].center).map_or(0.0, |hull| hull.area_between_m2(0.0, TAU));
        judgement.unseen_area_m2 += (whole_m2 - seen_m2).max(0.0);
    }

    /// Kim et al. 2023, alg. 1 line 8: a reading less than its threshold is unsafe.
    fn note(&self, beam: usize, margin_m: f64, judgement: &mut Judgement) {
        if margin_m < judgement.margin_m {
            let reading_m = self.beams.beams()[beam].reading_m;
            judgement.margin_m = margin_m;
            judgement.beam = Some(self.beams.number_of(beam));
            (judgement.reading_m, judgement.threshold_m) = (reading_m, reading_m - margin_m);
        }
        if margin_m < 0.0 {
            judgement.forbid(UnsafeCause::Beam);
        }
    }

    /// Virtual beams: what the camera sees, and what is remembered and cannot be seen, strictly inside the hull.
    fn judge_points(&self, discs: &Discs, motion: &Motion, judgement: &mut Judgement) {
        let reach_m = discs.iter().map(|disc| disc.center.coords.norm() + disc.radius_m).fold(0.0, f64::max);
        let seen = self.depth.map_or(&[][..], DepthView::points).iter().map(|point| (UnsafeCause::Point, *point, 0.0));
        let remembered = self.memory.map_or(&[][..], Memory::hidden).iter();
        let remembered = remembered.map(|spot| (UnsafeCause::Memory, spot.place, spot.uncertainty_m));
        let mut swept = None;
        for (cause, point, uncertainty_m) in seen.chain(remembered).chain(self.edges(motion)) {
            let within_m = reach_m + uncertainty_m;
            if point.coords.norm_squared() >= within_m * within_m {
                continue;
            }
            let swept = swept.get_or_insert_with(|| Hull::new(*discs));
            let inside_m = swept.signed_distance_m(point) - uncertainty_m;
            if inside_m >= 0.0 || (cause != UnsafeCause::DropOff && self.handler.masks(point)) {
                continue;
            }
            let pressing = self.config.escape && self.hull().signed_distance_m(point) < uncertainty_m;
            if pressing && !self.gets_closer(point, motion) {
                continue;
            }
            if inside_m < judgement.margin_m {
                // It is no beam's any more.
                judgement.margin_m = inside_m;
                (judgement.beam, judgement.place) = (None, Some(point));
                (judgement.reading_m, judgement.threshold_m) = (inside_m + uncertainty_m, uncertainty_m);
            }
            judgement.forbid(cause);
        }
    }

    /// Robot and handler tread only on floor that was seen, but for what is assumed. They keep from what lies beyond an
    /// edge, as from an edge beside their way. An edge is told rather than floor that was not seen.
    fn judge_floor(&self, discs: &Discs, motion: &Motion, judgement: &mut Judgement) {
        let (way, turns) = (motion.robot.translation.vector, motion.robot.rotation.angle().abs() > SLIGHT);
        let is_on_spot = way.norm() < SLIGHT;
        if is_on_spot && !turns || self.sorted.unseen_floor.is_empty() {
            return;
        }
        let edge_m = self.config.edges.beside_m;
        let bounds = discs.iter().fold(Bounds::NONE, |bounds, disc| bounds.with(disc, edge_m));
        let (mut swept, mut least) = (None, None::<Forbidden>);
        for (place, floor) in self.sorted.unseen_floor.iter().filter(|(place, _)| bounds.contains(place)) {
            // Robot and handler do not tread on the margin. Half a cell is the map's resolution.
            let needed_m = if *floor == Floor::Beyond { edge_m } else { -self.config.margin_m - RIM_M };
            let away_m = swept.get_or_insert_with(|| Hull::new(*discs)).signed_distance_m(*place);
            if away_m >= needed_m {
                continue;
            }
            let from_here_m = self.hull().signed_distance_m(*place);
            let may_assume =
                || if is_on_spot { from_here_m <= TURN_ASSUMED_M } else { self.is_rim(*place, from_here_m, &way) };
            let is_assumed =
                *floor == Floor::Assumed || *floor == Floor::Unseen && may_assume() && self.is_near_seen(*place);
            let is_left = *floor == Floor::Beyond && from_here_m < edge_m && !self.gets_closer(*place, motion);
            if is_assumed || is_left {
                judgement.assumes_floor |= is_assumed && from_here_m > 0.0;
                continue;
            }
            let found = Forbidden { place: *place, is_edge: *floor == Floor::Beyond, away_m, needed_m };
            least = least.filter(|least| !found.outdoes(least)).or(Some(found));
        }
        let Some(Forbidden { place, is_edge, away_m, needed_m }) = least else { return };
        if judgement.safe {
            (judgement.beam, judgement.place) = (None, Some(place));
            (judgement.reading_m, judgement.threshold_m) = (away_m, needed_m);
            judgement.margin_m = away_m - needed_m;
        }
        judgement.forbid(if is_edge { UnsafeCause::DropOff } else { UnsafeCause::FloorUnseen });
    }

    /// Floor is assumed only close to floor that was seen.
    fn is_near_seen(&self, place: Point) -> bool {
        self.memory.is_some_and(|memory| memory.has_floor_near(place, ASSUMED_M))
    }

    /// Whether floor that was not seen is assumed about a pair that goes on: a rim about where they stand. The camera
    /// does not look aside: ahead of a way there, only a gap in floor that was seen is assumed.
    fn is_rim(&self, place: Point, from_here_m: f64, way: &Vector2<f64>) -> bool {
        let goes_aside = way.y.abs() > SLIGHT;
        let is_open = goes_aside && self.is_ahead(place, way) && !self.is_gap(place, way);
        from_here_m <= if is_open { 0.0 } else { RIM_ASSUMED_M }
    }

    /// Whether a place lies within 60 degrees of a way, as seen from the one of robot and handler that is nearer to it.
    fn is_ahead(&self, place: Point, way: &Vector2<f64>) -> bool {
        let from = [Point::origin(), self.handler.center].map(|body| place - body);
        let to = if from[0].norm() < from[1].norm() { from[0] } else { from[1] };
        2.0 * way.dot(&to) > way.norm() * to.norm()
    }

    /// Whether floor was seen shortly beyond a place on a way.
    fn is_gap(&self, place: Point, way: &Vector2<f64>) -> bool {
        let beyond = |steps: f64| place + way * (steps * FLOOR_CELL_M / way.norm());
        let is_seen = |place: Point| self.memory.is_some_and(|memory| memory.has_seen_floor(place));
        [1.0, 2.0].map(beyond).into_iter().any(is_seen)
    }

    /// Edges, as points in a hull: what is needed to them counts as uncertainty. An edge within 60 degrees of the way
    /// is ahead. With a memory, one frame alone may be noise.
    fn edges(&self, motion: &Motion) -> impl Iterator<Item = (UnsafeCause, Point, f64)> {
        let alone = self.depth.filter(|_| self.memory.is_none());
        let seen = alone.map_or(&[][..], DepthView::edges).iter().map(|edge| (*edge, 0.0));
        let remembered = self.memory.map_or(&[][..], Memory::edges).iter();
        let all = seen.chain(remembered.map(|edge| (edge.place, edge.uncertainty_m)));
        let ends = [place(&motion.robot), place(&motion.handler)];
        let way = motion.robot.translation.vector.try_normalize(SLIGHT);
        let needed = self.config.edges;
        all.map(move |(edge, uncertainty_m)| {
            // Of robot and handler, the one that is nearer to it.
            let from = ends.map(|end| edge - end).into_iter().min_by(|a, b| a.norm().total_cmp(&b.norm()));
            let to = from.and_then(|from| from.try_normalize(SLIGHT));
            let towards = way.zip(to).map_or(0.0, |(way, to)| (2.0 * way.dot(&to)).clamp(0.0, 1.0));
            let needed_m = needed.beside_m + (needed.ahead_m - needed.beside_m) * towards;
            (UnsafeCause::DropOff, edge, uncertainty_m + needed_m)
        })
    }

    /// Whether robot or handler come nearer to a point anywhere on their way: the escape rule allows only what does
    /// not.
    fn gets_closer(&self, point: Point, motion: &Motion) -> bool {
        let nose_m = self.config.reach.nose_m;
        let (from_m, to_m) = if nose_m > 0.0 {
            (from_axis_m(&Se2::identity(), nose_m, point), nearest_to_axis_m(&motion.robot, nose_m, point))
        } else {
            (point.coords.norm(), nearest_on_arc(&log(&motion.robot, 1.0), point))
        };
        let handler = [Some(self.handler.center), self.handler.elsewhere()];
        let goes_closer =
            |from: Point| nearest_on_line(from, place(&motion.handler), point) < (point - from).norm() - CLOSER_M;
        to_m < from_m - CLOSER_M || handler.into_iter().flatten().any(goes_closer)
    }

    /// Whether the camera sees, or one of the last scans saw, that an unknown beam's way beyond the present hull is
    /// free.
    fn is_known_free(&self, beam: usize, threshold_m: f64) -> bool {
        let present_m = self.sorted.present_m[beam];
        [threshold_m, (threshold_m + present_m) / 2.0].into_iter().all(|t| {
            let point = self.beams.origin() + self.beams.beams()[beam].direction * t;
            self.depth.is_some_and(|depth| depth.sees_free(point))
                || self.memory.is_some_and(|memory| memory.saw_free(point))
        })
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

/// Whether a robot is carried the way that it is to go, as far as it is carried at all.
fn is_along(carried: &Se2, goes: &Se2) -> bool {
    let (way, on) = (carried.translation.vector, goes.translation.vector);
    let (turn_rad, turns_rad) = (carried.rotation.angle(), goes.rotation.angle());
    let (carried_m, goes_m) = (way.norm(), on.norm());
    let straight = carried_m < SLIGHT || on.dot(&way) > (1.0 - SLIGHT) * carried_m * goes_m && turns_rad.abs() < SLIGHT;
    let turning = turn_rad.abs() < SLIGHT || turn_rad * turns_rad > 0.0 && goes_m < SLIGHT;
    // A stop adds nothing to where it is carried.
    straight && turning || goes_m < SLIGHT && turns_rad.abs() < SLIGHT
}

/// The robot's discs at a pose.
fn push_robot(discs: &mut Discs, config: &ShieldConfig, pose: &Se2) {
    let radius_m = config.robot_radius_m + config.margin_m;
    if config.reach.nose_m > 0.0 {
        for ahead_m in [config.reach.nose_m, -config.reach.nose_m] {
            discs.push(Disc { center: pose * Point::new(ahead_m, 0.0), radius_m });
        }
    } else {
        discs.push(Disc { center: place(pose), radius_m });
    }
}

/// The distance of a point to the axis of a long body, metres.
fn from_axis_m(pose: &Se2, nose_m: f64, point: Point) -> f64 {
    nearest_on_line(pose * Point::new(-nose_m, 0.0), pose * Point::new(nose_m, 0.0), point)
}

/// The least distance of a point to the axis of a long body on its way, metres: looked at in eight places.
fn nearest_to_axis_m(robot_from_end: &Se2, nose_m: f64, point: Point) -> f64 {
    let twist = log(robot_from_end, 1.0);
    let places = (1..=8).map(|i| from_axis_m(&exp(twist, f64::from(i) / 8.0), nose_m, point));
    places.fold(f64::INFINITY, f64::min)
}

/// The least distance of a point to the way of a body that moves from the origin for a second, metres.
pub(super) fn nearest_on_arc(twist: &Twist2, point: Point) -> f64 {
    let end = place(&exp(*twist, 1.0));
    let turn = twist.wz_radps;
    if turn.abs() < STRAIGHT_RAD {
        return nearest_on_line(Point::origin(), end, point);
    }
    // A constant body velocity goes round one point, which is beside it.
    let middle = Point::new(-twist.vy_mps / turn, twist.vx_mps / turn);
    let (begin, to) = (Point::origin() - middle, point - middle);
    let after = if turn > 0.0 { positive_turn(&begin, &to) } else { positive_turn(&to, &begin) };
    if after <= turn.abs() {
        return (to.norm() - begin.norm()).abs();
    }
    point.coords.norm().min((point - end).norm())
}

/// The least distance of a point to the way from one place straight to another, metres.
fn nearest_on_line(from: Point, to: Point, point: Point) -> f64 {
    let way = to - from;
    let share = (point - from).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE);
    (point - (from + way * share.clamp(0.0, 1.0))).norm()
}

fn all_thresholds(hull: &Hull, beams: &Beams, thresholds_m: &mut Vec<f64>) {
    thresholds_m.clear();
    thresholds_m.extend(beams.beams().iter().map(|beam| hull.threshold_m(beams.origin(), beam.direction)));
}

/// A run of unknown beams within the part of the hull that is beyond the present one.
#[derive(Debug, Default)]
struct UnknownRun {
    first: usize,
    count: usize,
    threshold_m: f64,
    /// The run that began with the very first beam, for a lidar that sees all around.
    at_start: Option<(usize, f64)>,
}

impl UnknownRun {
    fn take(&mut self, present: &Present<'_>, beam: usize, threshold_m: f64, judgement: &mut Judgement) {
        let counts =
            threshold_m > present.sorted.present_m[beam] + BEYOND_M && !present.is_known_free(beam, threshold_m);
        if !counts {
            return;
        }
        if self.count > 0 && beam != self.first + self.count {
            self.end(present, judgement);
        }
        if self.count == 0 {
            self.first = beam;
        }
        self.count += 1;
        self.threshold_m = self.threshold_m.max(threshold_m);
    }

    fn end(&mut self, present: &Present<'_>, judgement: &mut Judgement) {
        if self.count > 0 && self.first == 0 {
            self.at_start = Some((self.count, self.threshold_m));
        }
        if is_gap(present, self.count, self.threshold_m) {
            judgement.forbid(UnsafeCause::Unknown);
        }
        (self.count, self.threshold_m) = (0, 0.0);
    }

    /// The last run of a whole turn goes on in the first.
    fn close(&mut self, present: &Present<'_>, judgement: &mut Judgement) {
        let reaches_end = self.count > 0 && self.first + self.count == present.beams.beams().len();
        if let Some((count, threshold_m)) = self.at_start.filter(|_| reaches_end && present.beams.is_whole_turn()) {
            self.count += count;
            self.threshold_m = self.threshold_m.max(threshold_m);
        }
        self.end(present, judgement);
    }
}

fn is_gap(present: &Present<'_>, count: usize, threshold_m: f64) -> bool {
    let half = (count as f64 * present.beams.increment_rad() / 2.0).min(std::f64::consts::FRAC_PI_2);
    count > 0 && 2.0 * threshold_m * half.sin() > present.config.unknown_gap_m
}
