//! How one motion is judged: everything that all motions from one moment share is prepared once.

mod back;
mod floor;

use std::cell::{Cell, OnceCell};
use std::f64::consts::TAU;

use messages::{Twist2, UnsafeCause};

use super::{Evidence, Judgement, Motion, ShieldConfig, Work};
use crate::boundary::{Boundary, Readings, Room, Seen, positive_turn};
use crate::depth::DepthView;
use crate::handler::HandlerBody;
use crate::hull::{Disc, Discs, Hull};
use crate::interaction::place;
use crate::memory::{Floor, Memory};
use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2, exp, log};
use crate::second::SecondView;

/// An action's hull reaches beyond the present one where its threshold is greater by more than rounding, metres.
const BEYOND_M: f64 = 1e-9;
/// The escape rule allows what comes nearer by less than this, metres: what is abeam, give or take a centimetre, when
/// the robot goes straight on.
const CLOSER_M: f64 = 1e-4;
/// A shorter way, a smaller turn or a smaller difference of direction counts as none: metres, radians, share.
const SLIGHT: f64 = 1e-3;
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
    /// Room for the present hull and for that of a motion, for a boundary, and for its parts.
    hulls: [Hull; 2],
    boundary: Boundary,
    parts: Room,
    pub(super) work: Work,
}

impl Sorted {
    /// With room for the greatest hull: no decision is the first to need it.
    pub(super) fn with_room() -> Self {
        let hulls = [Hull::with_room(), Hull::with_room()];
        Self { hulls, boundary: Boundary::with_room(), parts: Room::for_all(), ..Self::default() }
    }
}

/// A hull, all at once: few motions have anything so near that they ask for it.
struct Asked {
    hull: OnceCell<Hull>,
    room: Cell<Hull>,
}

impl Asked {
    fn within(room: Hull) -> Self {
        Self { hull: OnceCell::new(), room: Cell::new(room) }
    }

    /// The hull of these discs, always the same ones until [`Self::renew`].
    fn of(&self, discs: &Discs) -> &Hull {
        self.hull.get_or_init(|| {
            let mut hull = self.room.take();
            hull.take(*discs);
            hull
        })
    }

    fn renew(&mut self) {
        if let Some(hull) = self.hull.take() {
            self.room.set(hull);
        }
    }

    fn give_room(&mut self) -> Hull {
        self.renew();
        self.room.take()
    }
}

/// What all motions from one moment have in common.
pub(super) struct Present<'a> {
    config: &'a ShieldConfig,
    beams: &'a Beams,
    depth: Option<&'a DepthView>,
    second: Option<&'a SecondView>,
    memory: Option<&'a Memory>,
    /// None: the robot is alone.
    handler: Option<HandlerBody>,
    /// The robot's discs and the handler's, now.
    now: Discs,
    /// Where the robot is carried by what it moved before.
    carried: Se2,
    /// Where the handler of a robot that stands comes to on their way to rest (robot frame).
    walks_on: Option<Point>,
    /// The present hull, and that of the motion that is judged.
    here: Asked,
    swept: Asked,
    work: Cell<Work>,
    sorted: &'a mut Sorted,
}

impl Drop for Present<'_> {
    fn drop(&mut self) {
        self.sorted.hulls = [self.here.give_room(), self.swept.give_room()];
        self.sorted.work = self.work.get();
    }
}

impl<'a> Present<'a> {
    pub fn prepare(
        config: &'a ShieldConfig,
        Evidence { beams, depth, second, memory, moves }: Evidence<'a>,
        handler: Option<HandlerBody>,
        sorted: &'a mut Sorted,
    ) -> Self {
        let mut now = Discs::none();
        push_robot(&mut now, config, &Se2::identity());
        if let Some(handler) = &handler {
            handler.mask_centers().for_each(|center| now.push(handler_disc(config, handler, center)));
        }
        let [here, swept] = std::mem::take(&mut sorted.hulls).map(Asked::within);
        let work = Cell::new(sorted.work);
        let carried = config.reach.carries_to(&moves);
        let walks_on = config.reach.walks_on(&moves);
        let mut present =
            Self { config, beams, depth, second, memory, handler, now, carried, walks_on, here, swept, work, sorted };
        present.sort();
        present
    }

    fn count(&self, motions: u64, places: u64, held: u64) {
        let work = self.work.get();
        let (motions, places, held) = (work.motions + motions, work.places + places, work.held + held);
        self.work.set(Work { motions, places, held });
    }

    fn hull(&self) -> &Hull {
        self.here.of(&self.now)
    }

    /// What concerns few beams is looked for where they are: on the handler, and in the present hull.
    fn sort(&mut self) {
        let beams = self.beams;
        // Who asks for the hull needs all of `self`: the lists go back when they are filled.
        let mut sorted = std::mem::take(self.sorted);
        sorted.readings.copy_from(beams.readings());
        sorted.present_m.resize(beams.beams().len(), 0.0);
        sorted.masked.clear();
        sorted.pressing.clear();
        self.find_masked(&mut sorted);
        let mut boundary = std::mem::take(&mut sorted.boundary);
        boundary.take(&self.now);
        match boundary.seen_from(beams.origin()) {
            Some(seen) => {
                let parts = seen.over_in(beams.directions(), std::mem::take(&mut sorted.parts));
                parts.some_thresholds_m(beams.unknown(), |i, threshold_m| sorted.present_m[i] = threshold_m);
                let is_hit = |i: &usize| beams.beams()[*i].kind == BeamKind::Hit;
                if self.config.escape {
                    parts.each_below(&sorted.readings, |i, _| sorted.pressing.extend(Some(i).filter(is_hit)));
                }
                sorted.parts = parts.into_room();
            }
            None => self.sort_from_outside(&mut sorted),
        }
        sorted.boundary = boundary;
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
        let Some((handler, mask_m)) = self.handler.and_then(|handler| Some((handler, handler.mask_radius_m?))) else {
            return;
        };
        for center in handler.mask_centers() {
            for i in self.beams.fan().towards(center, mask_m).into_iter().flatten() {
                let beam = &self.beams.beams()[i];
                let is_new = sorted.readings.get(i).is_finite();
                if is_new && beam.kind == BeamKind::Hit && handler.masks(beam.end) {
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
        let stands_at = self.carried * motion.robot;
        push_robot(&mut discs, self.config, &stands_at);
        let handler = self.handler.zip(motion.handler);
        if let Some((body, ends_at)) = &handler {
            let mut push = |center: Point| discs.push(handler_disc(self.config, body, center));
            push(place(&(self.carried * ends_at)));
            if let Some(rest) = &self.config.reach.robot_from_rest {
                push(place(&(stands_at * rest)));
            }
            if let Some(beyond_rest) = self.walks_on {
                push(stands_at * beyond_rest);
            }
        }
        // Where it is carried another way than it is to go, the hull of beginning and end leaves out the corners.
        if !is_along(&self.carried, &motion.robot) {
            push_robot(&mut discs, self.config, &self.carried);
            push_robot(&mut discs, self.config, &motion.robot);
            if let Some((body, ends_at)) = &handler {
                let follows = self.config.reach.robot_from_rest.map_or(body.center, |rest| place(&rest));
                discs.push(handler_disc(self.config, body, self.carried * follows));
                discs.push(handler_disc(self.config, body, place(ends_at)));
            }
        }
        // They are not there yet: nothing there is excused as if they were.
        if let Some((body, _)) = &handler
            && let Some(seen) = body.seen.filter(|seen| seen.next != seen.at)
        {
            discs.push(handler_disc(self.config, body, seen.next));
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
        let mut boundary = std::mem::take(&mut self.sorted.boundary);
        boundary.take(&discs);
        let mut judgement = Judgement::default();
        self.swept.renew();
        self.count(1, 0, 0);
        match boundary.seen_from(self.beams.origin()) {
            Some(seen) => self.judge_from_within(&seen, motion, &mut judgement),
            None => self.judge_from_outside(&discs, &boundary, motion, &mut judgement),
        }
        self.sorted.boundary = boundary;
        self.judge_points(&discs, motion, &mut judgement);
        self.judge_floor(&discs, motion, &mut judgement);
        self.judge_back(&discs, motion, &mut judgement);
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
        let parts = seen.over_in(beams.directions(), std::mem::take(&mut self.sorted.parts));
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
        self.sorted.parts = parts.into_room();
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
    fn judge_from_outside(&mut self, discs: &Discs, whole: &Boundary, motion: &Motion, judgement: &mut Judgement) {
        let (swept, beams) = (self.swept.of(discs), self.beams);
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
        let seen = self.depth.map_or(&[][..], DepthView::points).iter();
        let seen = seen.map(|point| KeptOff::of(UnsafeCause::Point, *point, 0.0));
        let remembered = self.memory.map_or(&[][..], Memory::hidden).iter().map(|spot| KeptOff {
            may_be_theirs: !spot.is_apart,
            ..KeptOff::of(UnsafeCause::Memory, spot.place, spot.uncertainty_m)
        });
        let second = self.second.map_or(&[][..], SecondView::points).iter();
        let second = second.map(|point| KeptOff::of(UnsafeCause::Second, *point, 0.0));
        let points = seen.chain(second).chain(remembered);
        // A high step comes before its points, whose cause says less. A low one comes last: it is the cause where
        // nothing else forbids.
        let all = self.high_steps(motion).chain(points).chain(self.edges(motion)).chain(self.low_steps(motion));
        for KeptOff { cause, place: point, may_be_theirs, kept_m: uncertainty_m, step_m } in all {
            if cause.is_low_step() && !judgement.safe && !judgement.cause.is_low_step() {
                break;
            }
            self.count(0, 1, 0);
            let within_m = reach_m + uncertainty_m;
            if point.coords.norm_squared() >= within_m * within_m {
                continue;
            }
            self.count(0, 0, 1);
            let Some(away_m) = self.swept.of(discs).nearer_m(point, uncertainty_m) else { continue };
            if may_be_theirs && self.handler.is_some_and(|handler| handler.masks(point)) {
                continue;
            }
            let inside_m = away_m - uncertainty_m;
            // An uncertainty that is no number excuses nothing.
            let is_near = |away_m: f64| away_m < uncertainty_m;
            let pressing = self.config.escape && self.hull().nearer_m(point, uncertainty_m).is_some_and(is_near);
            if pressing && !self.gets_closer(point, motion) {
                continue;
            }
            if inside_m < judgement.margin_m {
                // It is no beam's any more.
                judgement.margin_m = inside_m;
                (judgement.beam, judgement.place) = (None, Some(point));
                judgement.step_m = step_m;
                if judgement.cause.is_low_step() {
                    judgement.cause = cause;
                }
                (judgement.reading_m, judgement.threshold_m) = (inside_m + uncertainty_m, uncertainty_m);
            }
            judgement.forbid(cause);
        }
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
        let handler_comes_closer = self.handler.zip(motion.handler).is_some_and(|(body, ends_at)| {
            let goes_closer =
                |from: Point| nearest_on_line(from, place(&ends_at), point) < (point - from).norm() - CLOSER_M;
            body.mask_centers().any(goes_closer)
        });
        to_m < from_m - CLOSER_M || handler_comes_closer
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

/// A place from which a motion keeps (robot frame).
#[derive(Debug, Clone, Copy)]
struct KeptOff {
    cause: UnsafeCause,
    place: Point,
    /// It may be the handler's own, where it is close to them.
    may_be_theirs: bool,
    /// It keeps so much from it: what is kept from an edge, and how far off it may be, metres.
    kept_m: f64,
    /// How much the floor rises there by a step, metres; less than 0: it falls. 0: no step is measured.
    step_m: f64,
}

impl KeptOff {
    /// What is no step.
    fn of(cause: UnsafeCause, place: Point, kept_m: f64) -> Self {
        Self { cause, place, may_be_theirs: !cause.is_floor(), kept_m, step_m: 0.0 }
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

/// The handler's disc at a place.
fn handler_disc(config: &ShieldConfig, handler: &HandlerBody, center: Point) -> Disc {
    Disc { center, radius_m: handler.radius_m + config.margin_m }
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
