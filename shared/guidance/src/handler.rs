//! The shield's estimate of where the handler is: predicted by an interaction model along the robot's own motion,
//! corrected by what the lidar sees near it.

mod company;
mod lost;

use std::iter;

use crate::hull::Disc;
use crate::interaction::{HARNESS_M, Interaction, InteractionModel, place};
use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2};
use lost::Lost;

pub use company::{Company, Nobody};

/// Share of a correction that one scan makes.
const GAIN: f64 = 0.7;
/// One scan moves the estimate by at most this, metres.
const CORRECTION_MAX_M: f64 = 0.10;
/// Hits on the handler that a correction needs.
const HITS_MIN: usize = 3;
/// What lies farther than this and three sigma from the body's edge is not the body's, metres: a wall beside them.
const OFF_EDGE_M: f64 = 0.06;
/// A fit is repeated so often, each time without what lies off the edge that it found.
const FITS: usize = 6;
/// Hits on one side of a disc say little about its distance across: each round goes farther than their mean.
const STEP: f64 = 1.6;
/// The prediction counts for as much as so many hits.
const PRIOR_HITS: f64 = 1.0;
/// Beams through the middle of the handler's disc of which so large a share passes say that nobody is there.
const PASSING_SHARE: f64 = 0.8;
/// Two places of the handler that are nearer to each other are one, metres.
const APART_M: f64 = 0.01;
/// The most that the handler is taken to go from one scan to the next, metres: a scan may have been lost.
const WENT_MAX_M: f64 = 0.30;
/// From a scan to the verdict on the next one, in periods of scans.
const UNTIL_NEXT: f64 = 1.25;
/// The estimate strays from the default offset by at most this beyond the model's largest lag, metres.
const STRAY_MAX_M: f64 = 0.30;

/// What the estimate is held to.
#[derive(Debug, Clone, PartialEq)]
pub struct HandlerLimits {
    /// Radius of the disc that stands for the handler, metres.
    pub radius_m: f64,
    /// Radius of what a lidar sees of them, metres: the disc has room for arms and a bag, which its plane does not
    /// meet.
    pub seen_radius_m: f64,
    /// The fastest that the robot goes, for the model's largest lag, metres per second.
    pub speed_max_mps: f64,
    /// Nobody where the handler should be, where visible, for this long is `handler_not_seen`, nanoseconds.
    pub not_seen_ns: u64,
}

/// What a scan said of the handler.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sighting {
    /// Somebody is there.
    Seen,
    /// Beams pass through where the handler should be.
    Absent,
    /// Outside the field of view, hidden, or too few beams: nothing can be said.
    NotVisible,
}

/// The room that the handler takes, robot frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandlerBody {
    /// Middle of the disc.
    pub center: Point,
    /// Radius of the disc, metres.
    pub radius_m: f64,
    /// What a beam meets within this distance of the middle is the handler, metres; none: nothing is.
    pub mask_radius_m: Option<f64>,
    /// Where the newest scan saw the handler, if it did.
    pub seen: Option<Seen>,
}

/// Where a scan saw the handler, robot frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The middle of their disc: they may stand there still.
    pub at: Point,
    /// Where it is by the next scan if they go on as they came from the scan before.
    pub next: Point,
    /// How far from the robot they walk by default, metres.
    pub by_default_m: f64,
}

impl HandlerBody {
    /// Whether a beam that ends there ends on the handler.
    #[must_use]
    pub fn masks(&self, end: Point) -> bool {
        let Some(mask_m) = self.mask_radius_m else { return false };
        self.mask_centers().any(|center| (end - center).norm_squared() <= mask_m * mask_m)
    }

    /// Middles of the discs within which a beam ends on the handler: where they are taken to be, and where the beams
    /// met them.
    pub(crate) fn mask_centers(&self) -> impl Iterator<Item = Point> {
        iter::once(self.center).chain(self.elsewhere())
    }

    /// Where they may be instead: a model pulls the estimate to where they should walk, and a person takes longer.
    #[must_use]
    pub fn elsewhere(&self) -> Option<Point> {
        self.seen.map(|seen| seen.at).filter(|at| self.is_apart(at))
    }

    fn is_apart(&self, at: &Point) -> bool {
        (at - self.center).norm_squared() > APART_M * APART_M
    }
}

/// The handler's estimate, in the robot frame.
#[derive(Debug, Clone)]
pub struct HandlerEstimate {
    model: InteractionModel,
    limits: HandlerLimits,
    /// At the beginning of the running step.
    start_robot_from_handler: Se2,
    /// The robot then, in the odometry frame.
    odom_from_start: Se2,
    robot_from_handler: Se2,
    /// The robot at the last prediction (odometry frame).
    odom_from_robot: Se2,
    /// The handler where the newest scan saw them, and the one before it (odometry frame).
    odom_from_seen: [Option<Point>; 2],
    /// By how much the radius is widened for what is not known, metres.
    widening_m: f64,
    absent_since_ns: Option<u64>,
    /// The handler has been missing for too long.
    lost: Option<Lost>,
}

impl HandlerEstimate {
    /// An estimate that knows nothing yet: the default offset, widened by the model's largest lag.
    #[must_use]
    pub fn new(model: impl Into<InteractionModel>, limits: HandlerLimits) -> Self {
        let model = model.into();
        let default = model.robot_from_default();
        let mut estimate = Self {
            model,
            limits,
            start_robot_from_handler: default,
            odom_from_start: Se2::identity(),
            robot_from_handler: default,
            odom_from_robot: Se2::identity(),
            odom_from_seen: [None; 2],
            widening_m: 0.0,
            absent_since_ns: None,
            lost: None,
        };
        estimate.widening_m = estimate.astray_m().min(HARNESS_M);
        estimate
    }

    fn default_place(&self) -> Point {
        place(&self.model.robot_from_default())
    }

    /// As far from there the estimate follows the handler, metres.
    fn stray_max_m(&self) -> f64 {
        self.astray_m() + STRAY_MAX_M
    }

    fn astray_m(&self) -> f64 {
        self.model.astray_m(self.limits.speed_max_mps)
    }

    /// After a gap, a restart or a new odometry frame: nothing is known any more. A handler who was lost still is.
    pub fn reset(&mut self, odom_from_robot: &Se2) {
        let lost = self.lost.map(Lost::anew);
        *self = Self { lost, ..Self::new(self.model.clone(), self.limits.clone()) };
        (self.odom_from_start, self.odom_from_robot) = (*odom_from_robot, *odom_from_robot);
    }

    /// The handler is to walk elsewhere, as `model` says. Until a person has stood there for a moment they are lost.
    pub fn take_place(&mut self, model: &InteractionModel) {
        if self.model == *model {
            return;
        }
        let estimate = Self::new(model.clone(), self.limits.clone());
        *self = Self {
            odom_from_start: self.odom_from_robot,
            odom_from_robot: self.odom_from_robot,
            lost: Some(Lost::awaited()),
            ..estimate
        };
    }

    /// The model by which it is predicted.
    #[must_use]
    pub fn model(&self) -> &InteractionModel {
        &self.model
    }

    /// Where the handler is now, robot frame.
    #[must_use]
    pub fn robot_from_handler(&self) -> &Se2 {
        &self.robot_from_handler
    }

    /// Radius that holds the handler for all that is known, metres.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.limits.radius_m + self.widening_m
    }

    /// The disc that holds the handler wherever the estimate would follow them, robot frame.
    #[must_use]
    pub fn everywhere(&self) -> Disc {
        Disc { center: self.default_place(), radius_m: self.limits.radius_m + self.stray_max_m() }
    }

    /// A decision begins: the step is made once per decision.
    pub fn begin_step(&mut self, odom_from_robot: &Se2) {
        self.start_robot_from_handler = self.robot_from_handler;
        self.odom_from_start = *odom_from_robot;
        self.widening_m *= self.model.remembered();
        if self.widening_m < 1e-3 {
            self.widening_m = 0.0;
        }
    }

    /// Where the handler is when the share `fraction` of the step has passed: along the motion that the robot really
    /// made, so that a robot that was stopped in the middle of an action does not lose its handler.
    pub fn predict(&mut self, odom_from_robot: &Se2, fraction: f64) {
        let moved = self.odom_from_start.inverse() * odom_from_robot;
        self.robot_from_handler = self.model.follow(&self.start_robot_from_handler, &moved, fraction);
        self.odom_from_robot = *odom_from_robot;
    }

    /// Where the handler will be after the further motion `now_from_then`, at the share `fraction` of the step.
    #[must_use]
    pub fn ahead(&self, odom_from_robot: &Se2, now_from_then: &Se2, fraction: f64) -> Se2 {
        let moved = self.odom_from_start.inverse() * odom_from_robot * now_from_then;
        self.model.follow(&self.start_robot_from_handler, &moved, fraction)
    }

    /// The handler as the shield has to reckon with them: a beam that ends within the handler's radius and three
    /// sigma ends on the handler; never wider, however little is known.
    #[must_use]
    pub fn body(&self, sigma_m: f64) -> HandlerBody {
        HandlerBody {
            center: place(&self.robot_from_handler),
            radius_m: self.radius_m(),
            mask_radius_m: Some(self.limits.radius_m + 3.0 * sigma_m),
            seen: self.seen(),
        }
    }

    fn seen(&self) -> Option<Seen> {
        let robot_from_odom = self.odom_from_robot.inverse();
        // What one scan shows may be a thing beside them, and a person does not leap.
        let [at, before] = self.odom_from_seen;
        let went = at? - before?;
        // The next verdict comes a little after the next scan.
        let next = at? + went * UNTIL_NEXT;
        let (at, next) = (robot_from_odom * at?, robot_from_odom * next);
        let by_default_m = self.default_place().coords.norm();
        (went.norm() <= WENT_MAX_M).then_some(Seen { at, next, by_default_m })
    }

    /// Takes in what the lidar sees there.
    pub fn correct(&mut self, beams: &Beams, now_ns: u64) -> Sighting {
        let center = place(&self.robot_from_handler);
        let seen = self.fit(beams, center).or_else(|| {
            let guess = self.nearest_within_widening(beams, center)?;
            self.fit(beams, guess)
        });
        let kept = seen.filter(|middle| (middle - self.default_place()).norm() <= self.stray_max_m());
        self.odom_from_seen = [kept.map(|middle| self.odom_from_robot * middle), self.odom_from_seen[0]];
        let sighting = if let Some(middle) = seen {
            // A passer-by does not move the estimate of a lost handler.
            if self.lost.is_none() {
                self.draw_towards(middle);
            }
            Sighting::Seen
        } else if self.is_passed(beams, center) {
            Sighting::Absent
        } else {
            Sighting::NotVisible
        };
        let places = [center, self.default_place()];
        let in_place = seen.filter(|middle| self.lost.is_some_and(|lost| lost.is_near_one(*middle, places)));
        self.look_for(sighting, in_place, now_ns);
        sighting
    }

    /// Decides whether the handler is lost, and whether they are back. `in_place` is a person who was seen in the
    /// handler's place (robot frame).
    fn look_for(&mut self, sighting: Sighting, in_place: Option<Point>, now_ns: u64) {
        let since_ns = self.absent_since_ns.filter(|_| sighting == Sighting::Absent);
        self.absent_since_ns = since_ns.or((sighting == Sighting::Absent).then_some(now_ns));
        if self.absent_since_ns.is_some_and(|since_ns| now_ns.saturating_sub(since_ns) >= self.limits.not_seen_ns) {
            self.lost.get_or_insert_default();
        }
        let at = in_place.map(|middle| self.odom_from_robot * middle);
        if self.lost.as_mut().is_some_and(|lost| lost.ends(at, now_ns)) {
            self.lost = None;
        }
    }

    /// The middle of the disc whose edge the hits about `guess` lie on: least squares, in which a hit counts the less
    /// the farther it is off that edge (Tukey's weights), so that a wall beside the handler is not taken for a part of
    /// them.
    fn fit(&self, beams: &Beams, guess: Point) -> Option<Point> {
        let (radius_m, noise_m) = (self.limits.seen_radius_m, 3.0 * beams.sigma_m());
        let cut_m = OFF_EDGE_M + noise_m;
        let mut center = guess;
        for round in 0..FITS {
            // At first the middle is known no better than the model predicts it.
            let off_m = cut_m * if round == 0 { 2.0 } else { 1.0 };
            let (mut pull, mut weight, mut hits) = (nalgebra::Vector2::zeros(), PRIOR_HITS, 0);
            for beam in beams.fan().towards(center, radius_m + off_m).into_iter().flatten() {
                let beam = &beams.beams()[beam];
                let out = beam.end - center;
                let distance_m = out.norm();
                let error_m = distance_m - radius_m;
                // Only the side that faces the lidar is seen.
                let is_front = out.dot(&beam.direction) <= 0.0;
                if beam.kind != BeamKind::Hit || !is_front || error_m.abs() >= off_m || distance_m < 1e-6 {
                    continue;
                }
                let share = (1.0 - (error_m / off_m).powi(2)).powi(2);
                pull += out * (error_m / distance_m * share);
                weight += share;
                hits += 1;
            }
            if hits < HITS_MIN {
                return None;
            }
            center += (pull + (guess - center) * PRIOR_HITS) * (STEP / weight);
        }
        Some(center)
    }

    /// Where the handler would be by the nearest hit within the widened radius: who holds the harness is nearer to the
    /// robot than the wall behind.
    fn nearest_within_widening(&self, beams: &Beams, center: Point) -> Option<Point> {
        let gate_m = self.radius_m() + 3.0 * beams.sigma_m();
        let hits = beams.beams().iter().filter(|b| b.kind == BeamKind::Hit && (b.end - center).norm() <= gate_m);
        let nearest = hits.min_by(|a, b| a.reading_m.total_cmp(&b.reading_m))?;
        Some(nearest.end + nearest.direction * self.limits.seen_radius_m)
    }

    fn draw_towards(&mut self, seen: Point) {
        let error = seen - place(&self.robot_from_handler);
        let step = (error * GAIN).cap_magnitude(CORRECTION_MAX_M);
        let moved = self.robot_from_handler.translation.vector + step;
        let default = self.default_place().coords;
        let bounded = default + (moved - default).cap_magnitude(self.stray_max_m());
        let correction = bounded - self.robot_from_handler.translation.vector;
        self.robot_from_handler.translation.vector = bounded;
        // The step goes on from where the handler must have been to be here now.
        self.start_robot_from_handler.translation.vector += correction;
        self.widening_m = 0.0;
    }

    /// Whether the beams that would have to end on the handler pass through.
    fn is_passed(&self, beams: &Beams, center: Point) -> bool {
        let to_center = center - beams.origin();
        let distance = to_center.norm();
        let inner_m = self.limits.radius_m / 2.0;
        if distance <= self.limits.radius_m {
            return false;
        }
        let (mut through, mut passing) = (0usize, 0usize);
        for beam in beams.beams() {
            let beside = beam.direction.perp(&to_center).abs();
            let passes = beam.reading_m > distance + self.radius_m();
            // A beam that met the floor before the handler is as good as an unknown one.
            let tells = beam.kind == BeamKind::Hit || beam.kind == BeamKind::Free && passes;
            if beam.direction.dot(&to_center) > 0.0 && beside <= inner_m && tells {
                through += 1;
                passing += usize::from(passes);
            }
        }
        through >= HITS_MIN && passing as f64 >= PASSING_SHARE * through as f64
    }

    /// Whether the handler has been missing for too long, and has not come back.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.lost.is_some()
    }
}

#[cfg(test)]
mod tests;
