//! The class of a failure.

use guidance::se2::Point;
use world::{Course, Opening};

use super::watch::Seen;
use super::{Asked, Class, Failure, Thing, apart_m};
use crate::score::Report;
use crate::task::{Goal, INSIDE_M, Task};

/// A robot is stuck when it comes no farther than this, metres,
const STUCK_M: f64 = 0.25;
/// for this number of decisions: 10 s. Where it arrives later, it takes [`LONG`], 20 s.
const STUCK: usize = 20;
const LONG: usize = 40;
/// The handler has turned into an opening at this depth, metres.
const ENTERED_M: f64 = 1.0;
/// The handler has passed an opening at this distance beyond its far edge, metres.
const PASSED_M: f64 = 1.0;
/// The handler has left the corridor at this distance outside, metres.
const OUTSIDE_M: f64 = 0.5;
/// The handler has turned back where the walk ends this far behind its start, metres.
const BACK_M: f64 = 1.5;
/// A person, a jamb, an obstacle or an edge at this distance may be what holds the pair, metres.
const PERSON_M: f64 = 1.5;
const JAMB_M: f64 = 0.8;
const OBSTACLE_M: f64 = 0.5;
const EDGE_M: f64 = 1.0;

/// All that a class is told from.
pub(super) struct Case<'a> {
    pub task: &'a Task,
    pub course: &'a Course,
    /// The handler, when the cue was given.
    pub start: Point,
    pub report: &'a Report,
    pub stopped: bool,
    /// A decision each.
    pub seen: &'a [Seen],
}

impl Case<'_> {
    pub fn failure(&self) -> Option<Failure> {
        let last = self.seen.len().checked_sub(1)?;
        let (class, thing, at) = self
            .fell(last)
            .or_else(|| self.touched())
            .or_else(|| {
                let found = if self.report.success { self.stuck(LONG) } else { Some(self.not_followed(last)) };
                found.map(|(class, at)| (class, None, at))
            })
            .or_else(|| (!self.stopped).then_some((Class::DidNotStop, None, last)))
            .or_else(|| (self.report.hit_by_others > 0).then_some((Class::HitByPerson, None, last)))?;
        let seen = &self.seen[at];
        Some(Failure {
            asked: Asked::of(self.task),
            class,
            thing,
            decision: at as u32 + 1,
            walked_m: seen.walked_m,
            at_m: [seen.robot.x, seen.robot.y],
        })
    }

    fn fell(&self, last: usize) -> Option<(Class, Option<Thing>, usize)> {
        let floor = &self.report.floor;
        let class = if floor.robot_fell { Class::RobotFell } else { Class::HandlerFell };
        (floor.robot_fell || floor.handler_fell).then_some((class, None, last))
    }

    fn touched(&self) -> Option<(Class, Option<Thing>, usize)> {
        let classes = [Class::RobotTouched, Class::HandlerTouched];
        let of = |(at, seen): (usize, &Seen)| {
            let touched = classes.into_iter().zip(seen.touched);
            touched.into_iter().find_map(|(class, thing)| Some((class, Some(thing?), at)))
        };
        self.seen.iter().enumerate().find_map(of)
    }

    fn not_followed(&self, last: usize) -> (Class, usize) {
        let end = match &self.task.goal {
            Goal::BeforeEdge if self.stands(last) => Some(Class::StoodFarFromEdge),
            Goal::BeforeEdge => Some(Class::OutOfTime),
            Goal::Stand(_) => None,
            Goal::Along(_) | Goal::Into(_) => return self.not_arrived(last),
        };
        if let Some(class) = end {
            return (class, last);
        }
        if let Some(at) = self.wrong_opening() {
            return (Class::WrongOpening, at);
        }
        (if self.is_outside(self.seen[last].handler) { Class::LeftCorridor } else { Class::WalkedOn }, last)
    }

    /// The pair should come somewhere.
    fn not_arrived(&self, last: usize) -> (Class, usize) {
        let deepest_m = self.seen.iter().map(|seen| self.depth_m(seen.handler)).fold(f64::NEG_INFINITY, f64::max);
        if deepest_m < ENTERED_M {
            if let Some(at) = self.wrong_opening() {
                return (Class::WrongOpening, at);
            }
            if let Some(at) = self.passed_opening() {
                return (Class::PassedOpening, at);
            }
            let end = self.seen[last].handler;
            if self.is_outside(end) {
                return (Class::LeftCorridor, last);
            }
            if self.way_m(end) <= self.way_m(self.start) - BACK_M {
                return (Class::TurnedBack, last);
            }
        }
        if let Some(stuck) = self.stuck(STUCK) {
            return stuck;
        }
        (if deepest_m >= INSIDE_M { Class::InsideAskew } else { Class::OutOfTime }, last)
    }

    /// The openings that the cue means.
    fn meant(&self) -> &[Opening] {
        match &self.task.goal {
            Goal::Into(openings) | Goal::Stand(openings) => openings,
            Goal::Along(_) | Goal::BeforeEdge => &[],
        }
    }

    /// How deep a place is inside an opening that the cue means, metres; less than 0 outside.
    fn depth_m(&self, at: Point) -> f64 {
        self.meant().iter().filter_map(|opening| self.inside_m(opening, at)).fold(f64::NEG_INFINITY, f64::max)
    }

    fn inside_m(&self, opening: &Opening, at: Point) -> Option<f64> {
        if let Some(behind) = &opening.behind {
            return behind.depth_m(at);
        }
        let foot = opening.line.foot(at);
        (foot.left_m.abs() < opening.width_m / 2.0).then_some(foot.way_m - self.task.width_m / 2.0)
    }

    /// The decision in which the handler had come into an opening that is not meant. A corner of the corridor itself
    /// does not count.
    fn wrong_opening(&self) -> Option<usize> {
        let others = || self.course.openings.iter().filter(|other| !self.meant().contains(other));
        let is_wrong = |at: Point| {
            self.is_outside(at)
                && others().any(|other| self.inside_m(other, at).is_some_and(|inside_m| inside_m >= ENTERED_M))
        };
        self.seen.iter().position(|seen| is_wrong(seen.handler))
    }

    fn passed_opening(&self) -> Option<usize> {
        let far_m = self.meant().iter().map(Opening::far_edge_m).reduce(f64::max)?;
        self.seen.iter().position(|seen| self.way_m(seen.handler) > far_m + PASSED_M && !self.is_outside(seen.handler))
    }

    /// How far a place is along the corridor, metres.
    fn way_m(&self, at: Point) -> f64 {
        self.course.line.foot(at).way_m
    }

    fn is_outside(&self, at: Point) -> bool {
        let foot = self.course.line.at(self.way_m(at));
        apart_m(at, Point::from(foot.translation.vector)) > self.course.width_m / 2.0 + OUTSIDE_M
    }

    fn stands(&self, last: usize) -> bool {
        let from = self.seen[(last + 1).saturating_sub(STUCK / 2)].robot;
        apart_m(from, self.seen[last].robot) < STUCK_M
    }

    /// The longest time in which the robot got no farther, before they had arrived, where it has `least` decisions.
    fn stuck(&self, least: usize) -> Option<(Class, usize)> {
        if !matches!(self.task.goal, Goal::Along(_) | Goal::Into(_)) {
            return None;
        }
        let walked = self.seen.iter().position(|seen| seen.arrived).map_or(self.seen, |arrived| &self.seen[..arrived]);
        let length = |from: usize| {
            walked[from..].iter().take_while(|seen| apart_m(seen.robot, walked[from].robot) < STUCK_M).count()
        };
        let (from, length) = (0..walked.len()).map(|from| (from, length(from))).rev().max_by_key(|(_, n)| *n)?;
        (length >= least).then(|| (self.why_stuck(&walked[from..from + length]), from + length / 2))
    }

    fn why_stuck(&self, stuck: &[Seen]) -> Class {
        let moved = stuck.iter().filter(|seen| seen.moved).count();
        if 2 * moved > stuck.len() {
            return Class::StuckTurning;
        }
        let sum = |of: fn(&Seen) -> u32| stuck.iter().map(of).sum::<u32>();
        let policy = sum(|seen| seen.held.policy);
        let floor = sum(|seen| seen.held.floor);
        let sensed = sum(|seen| seen.held.lidar + seen.held.camera + seen.held.memory + seen.held.contact);
        let most = policy.max(floor).max(sensed);
        if 2 * (policy + floor + sensed) as usize <= stuck.len() - moved {
            return Class::StoodByRule;
        }
        if most == policy {
            return Class::StoodByPolicy;
        }
        let least = |of: fn(&Seen) -> f64| stuck.iter().map(of).fold(f64::INFINITY, f64::min);
        if most == floor {
            let at_edge = least(|seen| seen.edge_m) <= EDGE_M;
            return if at_edge { Class::StuckAtEdge } else { Class::StuckAtNothing };
        }
        if least(|seen| seen.person_m) <= PERSON_M {
            return Class::StuckAtPerson;
        }
        let jambs: Vec<Point> = self.course.openings.iter().flat_map(|opening| self.jambs(opening)).collect();
        let is_at_jamb = |at: Point| jambs.iter().any(|jamb| apart_m(at, *jamb) <= JAMB_M);
        if stuck.iter().any(|seen| is_at_jamb(seen.robot) || is_at_jamb(seen.handler)) {
            return Class::StuckAtJamb;
        }
        if least(|seen| seen.room_m) <= OBSTACLE_M { Class::StuckAtObstacle } else { Class::StuckAtNothing }
    }

    /// The two sides of an opening, in the wall of the corridor.
    fn jambs(&self, opening: &Opening) -> [Point; 2] {
        let mouth = opening.line.at(self.course.width_m / 2.0);
        [0.5, -0.5].map(|side| mouth * Point::new(0.0, side * opening.width_m))
    }
}
