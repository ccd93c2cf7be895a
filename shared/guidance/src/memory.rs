//! What the shield remembers: obstacles that were seen and cannot be seen now, and what was seen free a moment ago.
//!
//! A shield that looks at one scan is blind behind the handler and where its sensors do not look (Kim et al. 2023,
//! sections 5 and 7). What stood there when it was last seen still stands there, as far as anybody knows. Where the
//! lidar sees now, the scan of now alone counts: memory adds nothing to it.

mod floor;
mod spots;

use std::collections::VecDeque;

use nalgebra::Vector2;

use crate::contact::Contacts;
use crate::depth::{DepthView, FloorStep, StepMax};
use crate::handler::HandlerBody;
use crate::hull::{Disc, Discs};
use crate::scan::{BeamKind, Beams, Fan};
use crate::se2::{Point, Se2};
use crate::second::SecondView;
pub use floor::{CELL_M as FLOOR_CELL_M, Floor};
use floor::{FloorMap, Here};
use spots::{CELL_M, SPOTS, Sight, Sighting, Source, Spot, Spots};

/// Points farther from the robot than this are let go, metres: no hull reaches so far, and twice as much is less than
/// what the cells cover.
const REACH_M: f64 = 3.9;
/// However long ago a point was seen, it is let go only once the robot has walked this far since, metres.
const WALKED_MIN_M: f64 = 1.0;
/// Who waits for so long may be walked around: what only the lidar saw is let go, nanoseconds. What the camera saw
/// stays: it lies below what the camera sees from there.
const STANDING_MAX_NS: u64 = 60_000_000_000;
/// What the camera sees this near to the end of a beam, the lidar sees as well, metres.
const SAME_M: f64 = 0.15;
/// A robot that moved by less, metres and radians, has not moved.
const WAY_MIN_M: f64 = 0.01;
const TURN_MIN_RAD: f64 = 0.01;
/// The place of an edge is never taken to be farther off, metres: it would hold a robot that turns beside it.
const EDGE_OFF_MAX_M: f64 = 0.3;
/// At most so many scans tell what was free a moment ago.
const GLIMPSES: usize = 8;

/// How long, and how exactly, is remembered.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryConfig {
    /// Obstacles are kept for so long after they were last seen, nanoseconds; longer while the robot stands.
    pub kept_ns: u64,
    /// What the camera alone saw, from near by and in more than one frame: it lies below the lidar's plane, or hangs
    /// above it, and does not walk away as people do. What a single frame saw is let go after `kept_ns`, also while the
    /// robot stands.
    pub kept_off_plane_ns: u64,
    /// What a scan saw free counts as free for so long, nanoseconds.
    pub free_ns: u64,
    /// By how much a remembered place is off: metres for each metre walked, and for each radian turned and metre away.
    pub drift: f64,
    /// The room that the robot stands on. None: floor is not remembered, and floor that was never seen forbids nothing.
    pub footing: Option<Footing>,
}

/// The room that the robot stands on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footing {
    /// Radius of its discs, metres.
    pub radius_m: f64,
    /// They are so far ahead of its middle and behind it, metres.
    pub nose_m: f64,
    /// Radius of the handler's disc, metres.
    pub handler_m: f64,
    /// It walks at most so far after its place was lost, metres,
    pub overrun_m: f64,
    /// and turns at most so far, radians.
    pub overrun_rad: f64,
    /// How high a step is that may be taken.
    pub step_max: StepMax,
}

/// A remembered obstacle that cannot be seen now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Remembered {
    /// Robot frame of now.
    pub place: Point,
    /// It may be this far from there, metres.
    pub uncertainty_m: f64,
    /// A sensor saw it while the handler was far away, so it is not a part of the handler. This holds when they come
    /// close to it.
    pub is_apart: bool,
}

/// A step in the floor that more than one frame saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RememberedStep {
    /// The last floor before it.
    pub at: Remembered,
    /// By how much the floor rises there along `onward`, metres; less than 0: it falls.
    pub rise_m: f64,
    /// The way in which it was seen (robot frame of now).
    pub onward: Vector2<f64>,
    /// The handler allows it, the one way or the other.
    pub is_allowed: bool,
}

/// How far the robot has come, along its way.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Odometer {
    walked_m: f64,
    turned_rad: f64,
}

impl Odometer {
    const ZERO: Self = Self { walked_m: 0.0, turned_rad: 0.0 };

    /// By how much a place seen at `then` is off when it is so far away.
    fn error_m(&self, then: &Self, drift: f64, distance_m: f64) -> f64 {
        drift * (self.walked_m - then.walked_m + (self.turned_rad - then.turned_rad) * distance_m)
    }
}

/// What one scan saw free.
#[derive(Debug, Clone)]
struct Glimpse {
    at_ns: u64,
    at: Odometer,
    odom_from_robot: Se2,
    fan: Fan,
    sigma_m: f64,
    /// As far as each beam saw, metres; 0 where it says nothing.
    readings_m: Vec<f64>,
}

/// The memory, in the odometry frame.
#[derive(Debug, Clone)]
pub struct Memory {
    config: MemoryConfig,
    /// Obstacles.
    spots: Spots,
    /// The last floor before drops.
    edges: Spots,
    /// Steps in the floor that could be taken, and those that lead up and could not.
    steps: Spots,
    /// What the second lidar alone saw: drops, and what stands.
    second_edges: Spots,
    second_things: Spots,
    floor: Option<FloorMap>,
    /// The oldest first.
    glimpses: VecDeque<Glimpse>,
    /// Of the newest scan.
    stamp_ns: u64,
    now_ns: u64,
    /// Where the robot was when its way was last counted.
    odom_from_counted: Option<Se2>,
    odom_from_robot: Se2,
    odometer: Odometer,
    hidden: Vec<Remembered>,
    edges_now: Vec<Remembered>,
    steps_now: Vec<RememberedStep>,
    contacts: Contacts,
}

impl Memory {
    /// A memory of nothing.
    #[must_use]
    pub fn new(config: MemoryConfig) -> Self {
        Self {
            floor: config.footing.is_some().then(FloorMap::new),
            config,
            spots: Spots::new(),
            edges: Spots::new(),
            steps: Spots::new(),
            second_edges: Spots::new(),
            second_things: Spots::new(),
            glimpses: VecDeque::new(),
            stamp_ns: 0,
            now_ns: 0,
            odom_from_counted: None,
            odom_from_robot: Se2::identity(),
            odometer: Odometer::default(),
            hidden: Vec::with_capacity(2 * SPOTS),
            edges_now: Vec::with_capacity(2 * SPOTS),
            steps_now: Vec::with_capacity(SPOTS),
            contacts: Contacts::default(),
        }
    }

    /// Forgets everything: a new odometry frame, or a jump within one.
    pub fn clear(&mut self) {
        *self = Self::new(self.config.clone());
    }

    /// The odometry frame is another one, or the robot jumped within it, and it stood meanwhile. Floor and edges stay
    /// where they are about it; all else is forgotten.
    pub fn anchor(&mut self, odom_from_robot: &Se2) {
        let Some(footing) = self.config.footing else { return self.anchor_second(odom_from_robot) };
        let (before, drift) = (self.odom_from_robot, self.config.drift);
        // What turns away by an angle is off by as much of its distance.
        let off_m = footing.overrun_m + footing.overrun_rad * floor::ANCHORED_M;
        let mut kept = Self::new(self.config.clone());
        (kept.odometer, kept.odom_from_robot) = (self.odometer, *odom_from_robot);
        (kept.now_ns, kept.stamp_ns) = (self.now_ns, self.stamp_ns);
        std::mem::swap(&mut kept.floor, &mut self.floor);
        if let Some(floor) = &mut kept.floor {
            let here = Here { now_ns: self.now_ns, at: self.odometer, odom_from_robot: &before };
            floor.anchor(&here, odom_from_robot, off_m, drift);
        }
        let (now_from_then, walked_m) = (odom_from_robot * before.inverse(), off_m / drift.max(f64::MIN_POSITIVE));
        kept.edges.take_over(&self.edges, &now_from_then, walked_m);
        kept.second_edges.take_over(&self.second_edges, &now_from_then, walked_m);
        kept.steps.take_over(&self.steps, &now_from_then, walked_m);
        *self = kept;
    }

    /// Where floor is not remembered, what the second lidar saw of edges stays.
    fn anchor_second(&mut self, odom_from_robot: &Se2) {
        let mut kept = Self::new(self.config.clone());
        (kept.odometer, kept.odom_from_robot) = (self.odometer, *odom_from_robot);
        (kept.now_ns, kept.stamp_ns) = (self.now_ns, self.stamp_ns);
        let now_from_then = odom_from_robot * self.odom_from_robot.inverse();
        let walked_m = EDGE_OFF_MAX_M / self.config.drift.max(f64::MIN_POSITIVE);
        kept.second_edges.take_over(&self.second_edges, &now_from_then, walked_m);
        *self = kept;
    }

    /// Takes in a scan of that stamp and the newest depth frame, both seen from where the robot is now, and who of the
    /// handler is in them: what ends on the handler is never remembered.
    pub fn update<'a>(
        &mut self,
        stamp_ns: u64,
        odom_from_robot: &Se2,
        beams: &Beams,
        depth: Option<&DepthView>,
        handler: impl Into<Option<&'a HandlerBody>>,
    ) {
        let handler = handler.into();
        let masks = |place: Point| handler.is_some_and(|handler| handler.masks(place));
        self.stamp_ns = stamp_ns;
        self.count_way(odom_from_robot);
        self.look_again(odom_from_robot, beams, depth, handler);
        let frame = depth.map_or(0, DepthView::number);
        let center = handler.map(|handler| handler.center);
        let sighting = Sighting { seen_ns: stamp_ns, seen_at: self.odometer, frame, odom_from_robot, handler: center };
        for beam in beams.beams().iter().filter(|beam| beam.kind == BeamKind::Hit && !masks(beam.end)) {
            self.spots.see(&sighting, beam.end, f64::NEG_INFINITY, Source::Lidar, &self.config);
        }
        let (points, rises_m) = depth.map_or((&[][..], &[][..]), |depth| (depth.points(), depth.rises_m()));
        for (point, rise_m) in points.iter().zip(rises_m) {
            if !masks(*point) && !ends_at(beams, *point) {
                self.spots.see(&sighting, *point, *rise_m, Source::Camera, &self.config);
            }
        }
        for edge in depth.map_or(&[][..], DepthView::edges) {
            self.edges.see(&sighting, *edge, f64::NEG_INFINITY, Source::Edge, &self.config);
        }
        for step in depth.map_or(&[][..], DepthView::steps) {
            self.steps.see(&sighting, step.place, step.rise_m, Source::Step, &self.config);
        }
        if let (Some(floor), Some(footing)) = (&mut self.floor, self.config.footing) {
            let here = Here { now_ns: stamp_ns, at: self.odometer, odom_from_robot };
            let robot = |ahead_m: f64| Disc { center: Point::new(ahead_m, 0.0), radius_m: footing.radius_m };
            let mut bodies = Discs::from([robot(footing.nose_m), robot(-footing.nose_m)]);
            if let Some(handler) = handler {
                bodies.push(Disc { center: handler.center, radius_m: handler.radius_m.min(footing.handler_m) });
            }
            // Where the handler was not seen they may stand elsewhere.
            let is_seen = handler.is_some_and(|handler| handler.seen.is_some());
            floor.update(&here, &bodies, if is_seen { 3 } else { 2 }, depth);
        }
        self.spots.keep(|spot| spot.sight != Sight::Due);
        self.edges.keep(|spot| spot.sight != Sight::Due);
        self.steps.keep(|spot| spot.sight != Sight::Due);
        self.glimpse(odom_from_robot, beams);
        self.move_to(stamp_ns, odom_from_robot);
    }

    /// Takes in a scan of the second lidar of that stamp, from where the robot was then, and where the handler was:
    /// what ends on them is never remembered, but what was seen while they were elsewhere stays. The second lidar alone
    /// lets go of an edge that it saw. What stands at the height of its plane is remembered where it looks down: nearer
    /// to the robot it is below that plane.
    pub fn update_second<'a>(
        &mut self,
        stamp_ns: u64,
        odom_from_robot: &Se2,
        second: &SecondView,
        handler: impl Into<Option<&'a HandlerBody>>,
    ) {
        let handler = handler.into();
        let masks = |place: Point| handler.is_some_and(|handler| handler.masks(place));
        let (robot_from_odom, odometer, number) = (odom_from_robot.inverse(), self.odometer, second.number());
        let kept_ns = self.config.kept_ns;
        self.second_edges.keep(|edge| {
            let place = robot_from_odom * edge.odom;
            let distance_m = place.coords.norm();
            let is_gone = second.showed_floor(place) && !edge.outweighs(distance_m, number);
            !is_gone && distance_m < REACH_M
        });
        self.second_things.keep(|thing| {
            let place = robot_from_odom * thing.odom;
            let age_ns = stamp_ns.saturating_sub(thing.seen_ns);
            let walked_on = odometer.walked_m - thing.seen_at.walked_m > WALKED_MIN_M;
            let is_old = age_ns > kept_ns && (walked_on || thing.is_doubtful()) || age_ns > STANDING_MAX_NS;
            !is_old && (thing.is_apart || !masks(place)) && !second.showed_floor(place) && place.coords.norm() < REACH_M
        });
        let center = handler.map(|handler| handler.center);
        let sighting =
            Sighting { seen_ns: stamp_ns, seen_at: odometer, frame: number, odom_from_robot, handler: center };
        for edge in second.edges() {
            self.second_edges.see(&sighting, *edge, f64::NEG_INFINITY, Source::Edge, &self.config);
        }
        for point in second.points().iter().filter(|point| second.looks_down() && !masks(**point)) {
            self.second_things.see(&sighting, *point, f64::NEG_INFINITY, Source::Camera, &self.config);
        }
        let odom_from_robot = self.odom_from_robot;
        self.move_to(self.now_ns, &odom_from_robot);
    }

    /// The jitter of a robot that stands is no way: else what it remembers would grow for as long as it stands.
    fn count_way(&mut self, odom_from_robot: &Se2) {
        let before = *self.odom_from_counted.get_or_insert(*odom_from_robot);
        let moved = before.inverse() * odom_from_robot;
        let (walked_m, turned_rad) = (moved.translation.vector.norm(), moved.rotation.angle().abs());
        if walked_m > WAY_MIN_M || turned_rad > TURN_MIN_RAD {
            self.odom_from_counted = Some(*odom_from_robot);
            self.odometer.walked_m += walked_m;
            self.odometer.turned_rad += turned_rad;
        }
    }

    /// What the new scan and frame say of each spot: each sensor sees that what it saw is gone, and nobody stands
    /// where the handler stands.
    fn look_again(
        &mut self,
        odom_from_robot: &Se2,
        beams: &Beams,
        depth: Option<&DepthView>,
        handler: Option<&HandlerBody>,
    ) {
        let robot_from_odom = odom_from_robot.inverse();
        let (stamp_ns, odometer) = (self.stamp_ns, self.odometer);
        // The mask is wider than the handler by the lidar's error, and something else may stand there. A wall beside
        // them has the same error, and stays.
        let off_m = 3.0 * beams.sigma_m();
        let body = handler.and_then(|body| Some((body.center, body.mask_radius_m? - off_m)));
        let on_handler = |spot: &Spot, place: Point| {
            let least_m = if spot.is_apart { off_m } else { 0.0 };
            body.is_some_and(|(center, body_m)| (place - center).norm() <= body_m - least_m)
        };
        let look = |spot: &mut Spot| {
            let place = robot_from_odom * spot.odom;
            let visible = match spot.source {
                Source::Lidar => on_handler(spot, place) || sees_as_far_as(beams, place, spot.is_apart, handler),
                Source::Camera => depth.is_some_and(|depth| depth.sees_free_up_to(place, spot.rise_m)),
                Source::Edge => depth.is_some_and(|depth| {
                    depth.sees_floor(place) && !spot.outweighs(place.coords.norm(), depth.number())
                }),
                Source::Step => depth.is_some_and(|depth| {
                    depth.shows_no_step(place) && !spot.outweighs(place.coords.norm(), depth.number())
                }),
            };
            spot.sight = if visible { Sight::Due } else { Sight::Hidden };
            let age_ns = stamp_ns.saturating_sub(spot.seen_ns);
            let walked_on = odometer.walked_m - spot.seen_at.walked_m > WALKED_MIN_M;
            let old = age_ns > spot.kept_ns && (walked_on || spot.is_doubtful())
                || age_ns > STANDING_MAX_NS && spot.source == Source::Lidar;
            !old && place.coords.norm() < REACH_M
        };
        self.spots.keep(look);
        self.edges.keep(look);
        self.steps.keep(look);
    }

    fn glimpse(&mut self, odom_from_robot: &Se2, beams: &Beams) {
        let oldest = if self.glimpses.len() == GLIMPSES { self.glimpses.pop_front() } else { None };
        let mut readings_m = oldest.map(|glimpse| glimpse.readings_m).unwrap_or_default();
        readings_m.clear();
        readings_m.extend(beams.beams().iter().map(|beam| beam.reading_m));
        self.glimpses.push_back(Glimpse {
            at_ns: self.stamp_ns,
            at: self.odometer,
            odom_from_robot: *odom_from_robot,
            fan: beams.fan(),
            sigma_m: beams.sigma_m(),
            readings_m,
        });
    }

    /// From now on told as of now, from where the robot is.
    pub fn move_to(&mut self, now_ns: u64, odom_from_robot: &Se2) {
        self.now_ns = now_ns;
        self.odom_from_robot = *odom_from_robot;
        let robot_from_odom = odom_from_robot.inverse();
        let (odometer, drift) = (self.odometer, self.config.drift);
        let remembered = |spot: &Spot| {
            let place = robot_from_odom * spot.odom;
            let uncertainty_m = odometer.error_m(&spot.seen_at, drift, place.coords.norm());
            Remembered { place, uncertainty_m, is_apart: spot.is_apart }
        };
        self.hidden.clear();
        self.hidden.extend(self.spots.iter().filter(|spot| spot.sight == Sight::Hidden).map(remembered));
        self.hidden.extend(self.second_things.iter().filter(|thing| !thing.is_doubtful()).map(remembered));
        self.edges_now.clear();
        let edges = self.edges.iter().chain(self.second_edges.iter());
        self.edges_now.extend(edges.filter(|edge| edge.was_seen_again()).map(remembered));
        self.steps_now.clear();
        self.steps_now.extend(self.steps.iter().filter(|step| step.was_seen_again()).map(|step| RememberedStep {
            at: remembered(step),
            rise_m: step.rise_m,
            onward: robot_from_odom.rotation * step.onward,
            is_allowed: step.is_allowed(odometer),
        }));
        self.edges_now
            .iter_mut()
            .chain(self.steps_now.iter_mut().map(|step| &mut step.at))
            .for_each(|edge| edge.uncertainty_m = edge.uncertainty_m.min(EDGE_OFF_MAX_M));
    }

    /// The robot was to move by `begin_from_end` from where it was, and did not get there.
    pub fn feel(&mut self, odom_from_begin: &Se2, begin_from_end: &Se2) {
        self.contacts.feel(self.now_ns, odom_from_begin, begin_from_end);
    }

    /// Whether a motion from here leads to where one did not get before.
    #[must_use]
    pub fn meets_contact(&self, robot_from_end: &Se2) -> bool {
        self.contacts.is_met(self.now_ns, &self.odom_from_robot, robot_from_end)
    }

    /// The obstacles that cannot be seen now.
    #[must_use]
    pub fn hidden(&self) -> &[Remembered] {
        &self.hidden
    }

    /// The last floor before drops that more than one frame saw, also where it is seen now. It stays until floor is
    /// seen there.
    #[must_use]
    pub fn edges(&self) -> &[Remembered] {
        &self.edges_now
    }

    /// The steps in the floor that more than one frame saw.
    #[must_use]
    pub fn steps(&self) -> &[RememberedStep] {
        &self.steps_now
    }

    /// How high a step may be that is taken. None where floor is not remembered.
    #[must_use]
    pub fn step_max(&self) -> Option<StepMax> {
        self.config.footing.map(|footing| footing.step_max)
    }

    /// The low steps that more than one frame saw, taken or not, from where the robot is there (robot frame).
    pub fn low_steps_from(&self, odom_from_robot: &Se2) -> impl Iterator<Item = FloorStep> {
        let robot_from_odom = odom_from_robot.inverse();
        let max = self.step_max();
        let seen_again = self.steps.iter().filter(|step| step.was_seen_again());
        let ahead = seen_again.map(move |step| {
            let is_back = (robot_from_odom.rotation * step.onward).x < 0.0;
            let rise_m = if is_back { -step.rise_m } else { step.rise_m };
            FloorStep { place: robot_from_odom * step.odom, rise_m }
        });
        ahead.filter(move |step| max.is_some_and(|max| max.allows(step.rise_m)))
    }

    /// The handler allows the low step at a place (odometry frame).
    pub fn allow_step(&mut self, place: Point) {
        self.steps.allow(place, self.odometer.walked_m);
        let odom_from_robot = self.odom_from_robot;
        self.move_to(self.now_ns, &odom_from_robot);
    }

    /// The handler allows no low step any more.
    pub fn allow_no_step(&mut self) {
        self.steps.allow_none();
        self.steps_now.iter_mut().for_each(|step| step.is_allowed = false);
    }

    /// Whether the floor at a place (robot frame) was seen.
    #[must_use]
    pub fn has_seen_floor(&self, place: Point) -> bool {
        self.has_seen_floor_at(self.odom_from_robot * place)
    }

    /// The same at a place in the odometry frame.
    #[must_use]
    pub fn has_seen_floor_at(&self, place: Point) -> bool {
        let cell = floor::cell_of(place);
        self.floor.as_ref().is_some_and(|map| map.floor(cell, &self.here(), self.config.drift) == Floor::Seen)
    }

    /// Whether floor is remembered.
    #[must_use]
    pub fn watches_floor(&self) -> bool {
        self.floor.is_some()
    }

    /// Whether a motion to the side may tread at a place (robot frame): the floor there was seen or trodden. Anywhere
    /// where floor is not remembered.
    #[must_use]
    pub fn carries(&self, place: Point) -> bool {
        let cell = floor::cell_of(self.odom_from_robot * place);
        self.floor
            .as_ref()
            .is_none_or(|map| matches!(map.floor(cell, &self.here(), self.config.drift), Floor::Seen | Floor::Trodden))
    }

    /// Whether floor within a radius of a place (robot frame) was seen, or goes on level from the start up to the first
    /// that was.
    #[must_use]
    pub fn has_floor_near(&self, place: Point, radius_m: f64) -> bool {
        let at = self.odom_from_robot * place;
        self.floor.as_ref().is_some_and(|map| map.is_near(at, radius_m, &self.here(), self.config.drift))
    }

    /// Cells near a place that were neither seen nor trodden (robot frame), and what is known of each. None where floor
    /// is not remembered.
    pub fn unseen_floor(&self, about: Point, radius_m: f64) -> impl Iterator<Item = (Point, Floor)> {
        let robot_from_odom = self.odom_from_robot.inverse();
        let (at, drift) = (self.odom_from_robot * about, self.config.drift);
        self.floor.iter().flat_map(move |map| {
            let here = self.here();
            let unseen = floor::cells_about(at, radius_m).filter_map(move |(key, middle)| {
                let floor = map.floor(key, &here, drift);
                (!matches!(floor, Floor::Seen | Floor::Trodden)).then_some((middle, floor))
            });
            unseen.map(move |(middle, floor)| (robot_from_odom * middle, floor))
        })
    }

    /// Cells of floor within reach that lie beyond an edge (robot frame).
    pub fn beyond_edges(&self) -> impl Iterator<Item = Point> {
        let has_any = self.floor.as_ref().is_some_and(FloorMap::has_beyond);
        let all = has_any.then(|| self.unseen_floor(Point::origin(), REACH_M)).into_iter().flatten();
        all.filter(|(_, floor)| *floor == Floor::Beyond).map(|(place, _)| place)
    }

    fn here(&self) -> Here<'_> {
        Here { now_ns: self.now_ns, at: self.odometer, odom_from_robot: &self.odom_from_robot }
    }

    /// Whether one of the last scans saw that nothing is at a point (robot frame), nor on the way to it.
    #[must_use]
    pub fn saw_free(&self, point: Point) -> bool {
        let recent = self.glimpses.iter().rev();
        let mut recent = recent.take_while(|glimpse| self.now_ns.saturating_sub(glimpse.at_ns) <= self.config.free_ns);
        recent.any(|glimpse| {
            let then = glimpse.odom_from_robot.inverse() * (self.odom_from_robot * point);
            let distance_m = (then - glimpse.fan.origin).norm();
            let error_m = self.odometer.error_m(&glimpse.at, self.config.drift, distance_m);
            let enough_m = distance_m + 3.0 * glimpse.sigma_m + error_m;
            let beside = glimpse.fan.beside(then);
            beside.is_some_and(|(a, b)| glimpse.readings_m[a] > enough_m && glimpse.readings_m[b] > enough_m)
        })
    }
}

/// Whether the beam towards a place shows what is there: it passes, or ends on it.
fn sees_as_far_as(beams: &Beams, place: Point, is_apart: bool, handler: Option<&HandlerBody>) -> bool {
    let Some(beam) = beams.fan().nearest(place).map(|i| beams.beams()[i]) else { return false };
    let distance_m = (place - beams.origin()).norm();
    let on_handler = beam.kind == BeamKind::Hit && handler.is_some_and(|handler| handler.masks(beam.end));
    let off_m = CELL_M + 3.0 * beams.sigma_m();
    // What the handler hides begins where the beam ends. A beam that ends on a wall close beside them counts as theirs,
    // too.
    let noise_m = if !on_handler {
        off_m
    } else if is_apart {
        -off_m
    } else {
        0.0
    };
    beam.kind != BeamKind::Unknown && distance_m <= beam.reading_m + noise_m
}

/// Whether the beam towards a place ends there.
fn ends_at(beams: &Beams, place: Point) -> bool {
    let nearest = beams.fan().nearest(place).map(|i| beams.beams()[i]);
    nearest.is_some_and(|beam| beam.kind == BeamKind::Hit && (beam.end - place).norm() <= SAME_M)
}

#[cfg(test)]
mod tests;
