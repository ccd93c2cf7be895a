//! What became of an episode.

use std::collections::VecDeque;

use guidance::se2::{Point, Se2};
use messages::{CueKind, UnsafeCause};
use serde::{Deserialize, Serialize};
use world::{DropKind, Stepped, Team, World};

use crate::task::{END_M, Goal, STILL_DECISIONS, STILL_M, Task};

/// Counted while it lasts.
#[derive(Debug, Clone)]
pub struct Score {
    world_from_start: Se2,
    way_m: f64,
    last_places: VecDeque<Point>,
    last: Point,
    /// Where the handler came into the third metre of way.
    third_metre: Option<Point>,
    /// Decisions in a row in which the handler did not move.
    frozen: u32,
    /// The handler faced off the travel line when they gave the cue, and has the room to show that it is put right.
    errs: bool,
    /// The handler is in the corridor, not in what leads off it.
    in_corridor: bool,
    /// Height of the floor under the robot, and where a low step was announced last.
    floor_m: f64,
    announced: Option<Point>,
    report: Report,
}

/// What became of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What was asked for.
    pub cue: CueKind,
    /// Whether the cue was followed, as [`Task`] defines it.
    pub success: bool,
    /// The task was to stand: there was nothing to turn into.
    pub to_stand: bool,
    /// Decisions made.
    pub decisions: u32,
    /// Motions in which the robot would have touched something; those of the handler.
    pub robot_collisions: u32,
    /// See [`Report::robot_collisions`].
    pub handler_collisions: u32,
    /// Motions with either.
    pub collisions: u32,
    /// People who walked into robot or handler.
    pub hit_by_others: u32,
    /// The farthest that the handler was from where the cue was given, metres.
    pub distance_m: f64,
    /// The way that the handler walked, metres.
    pub walked_m: f64,
    /// Decisions in which every action was unsafe.
    pub all_unsafe: u32,
    /// Decisions whose action was one that the shield forbade.
    pub unsafe_taken: u32,
    /// Decisions in which the robot stood under a cue that moves it, by what held it.
    #[serde(default)]
    pub held: Held,
    /// What became of the floor under them.
    pub floor: FloorReport,
    /// The sum of rewards.
    pub reward: f64,
    /// Longest run of decisions in which the handler did not move, before they had arrived.
    pub longest_freeze: u32,
    /// The third metre led the handler within 10 degrees of the travel line; none: they faced so from the start, or the
    /// corridor ends before.
    pub corrected: Option<bool>,
    /// At its end the handler faced within 10 degrees of the travel line; none likewise.
    pub faces_line: Option<bool>,
}

/// Decisions in which the robot stood, by what held it: the policy, or what the shield saw.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Held {
    /// The policy stood although more was allowed.
    pub policy: u32,
    /// A beam of the lidar, what its beams do not show, or where they show the handler.
    pub lidar: u32,
    /// A point that the camera sees.
    pub camera: u32,
    /// A point that is remembered.
    pub memory: u32,
    /// A place where a motion did not get before.
    pub contact: u32,
    /// An edge, a step, or floor that was not seen.
    pub floor: u32,
}

/// What became of robot and handler where the floor ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FloorReport {
    /// How the edge lies.
    pub kind: DropKind,
    /// The task was to stand before an edge: the way goes over it.
    pub before_edge: bool,
    /// The robot's footprint left the floor.
    pub robot_fell: bool,
    /// The handler's did.
    pub handler_fell: bool,
    /// Smallest distance of the robot's body, and of the handler's, to an edge, metres. None in a world without edges.
    pub to_edge_m: Option<[f64; 2]>,
    /// How far the robot's body is from the nearest edge now, metres.
    pub now_m: Option<f64>,
    /// How far robot and handler were from the edge when the cue was given, metres.
    pub begun_m: Option<[f64; 2]>,
    /// Times that the robot stopped for an edge where none was near.
    pub false_stops: u32,
    /// Those of them that were on floor of which a camera sees little.
    pub dark_stops: u32,
    /// Times that it stopped for floor that was never seen, where no edge was near.
    pub unseen_stops: u32,
    /// Low steps that were announced before they were taken; that were taken unannounced; and announced where none is.
    pub steps: StepCounts,
}

/// What became of low steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StepCounts {
    /// Announced before they were taken.
    pub announced: u32,
    /// Walked over without a word.
    pub unannounced: u32,
    /// Announced where there was none.
    pub false_announcements: u32,
}

impl FloorReport {
    fn begin(task: &Task, kind: DropKind, to_edge_m: [f64; 2]) -> Self {
        let to_edge_m = Some(to_edge_m).filter(|to_edge_m| to_edge_m[0].is_finite());
        Self {
            kind,
            before_edge: task.goal == Goal::BeforeEdge,
            robot_fell: false,
            handler_fell: false,
            to_edge_m,
            now_m: None,
            begun_m: to_edge_m,
            false_stops: 0,
            dark_stops: 0,
            unseen_stops: 0,
            steps: StepCounts::default(),
        }
    }
}

/// A low step is announced so far from where it is at the most, metres,
const STEP_OFF_M: f64 = 0.4;
/// and the robot steps over it so far from there at the most, metres.
const ANNOUNCED_M: f64 = 1.2;
/// Floor that lies lower or higher by this is another floor, metres. What is more is a fall.
const LEVEL_M: std::ops::RangeInclusive<f64> = 0.03..=0.13;
/// A robot stands before an edge where it is as near to it, metres.
const AT_EDGE_M: f64 = 2.0;
/// Who moves by less in a decision stands, metres.
const FROZEN_M: f64 = 0.02;
/// Who has corrected an error of orientation walks as near to the travel line, radians,
const CORRECTED_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// in this part of the way, metres.
const CORRECTED_M: [f64; 2] = [2.0, 3.0];

impl Score {
    /// At the beginning.
    #[must_use]
    pub fn begin(task: &Task, kind: DropKind, team: &Team, world: &World) -> Self {
        let world_from_handler = &team.world_from_handler();
        let place = Point::from(world_from_handler.translation.vector);
        let report = Report {
            cue: task.cue,
            success: false,
            to_stand: matches!(task.goal, Goal::Stand(_)),
            decisions: 0,
            robot_collisions: 0,
            handler_collisions: 0,
            collisions: 0,
            hit_by_others: 0,
            distance_m: 0.0,
            walked_m: 0.0,
            all_unsafe: 0,
            unsafe_taken: 0,
            held: Held::default(),
            floor: FloorReport::begin(task, kind, team.to_edge_m(world)),
            reward: 0.0,
            longest_freeze: 0,
            corrected: None,
            faces_line: None,
        };
        let way_m = task.line.foot(place).way_m;
        let off_rad = task.line.heading_error_rad(way_m, world_from_handler.rotation.angle());
        let has_room = way_m + CORRECTED_M[1] <= task.line.length_m() - END_M;
        Self {
            third_metre: None,
            frozen: 0,
            in_corridor: true,
            floor_m: world.floor_m(Point::from(team.world_from_robot().translation.vector)),
            announced: None,
            errs: off_rad.abs() > CORRECTED_RAD && task.cue == CueKind::Forward && has_room,
            world_from_start: *world_from_handler,
            way_m,
            last_places: VecDeque::from([place]),
            last: place,
            report,
        }
    }

    /// One decision has been carried out.
    pub fn step(&mut self, task: &Task, world_from_handler: &Se2, stepped: Stepped) {
        let report = &mut self.report;
        report.decisions += 1;
        report.robot_collisions += u32::from(stepped.robot_hit);
        report.handler_collisions += u32::from(stepped.handler_hit);
        report.collisions += u32::from(stepped.collided());
        report.hit_by_others += stepped.hit_by_others;
        let place = Point::from(world_from_handler.translation.vector);
        report.walked_m += (place - self.last).norm();
        self.frozen = if (place - self.last).norm() < FROZEN_M { self.frozen + 1 } else { 0 };
        // Who has arrived may stand.
        if !(report.success || report.to_stand || report.floor.before_edge) {
            report.longest_freeze = report.longest_freeze.max(self.frozen);
        }
        self.last = place;
        let start = Point::from(self.world_from_start.translation.vector);
        report.distance_m = report.distance_m.max((place - start).norm());
        let foot = task.line.foot_within(place, self.way_m - 1.0, self.way_m + 1.0);
        self.way_m = foot.way_m;
        self.in_corridor = foot.left_m.abs() <= task.width_m / 2.0;
        let begun_m = task.line.foot(start).way_m;
        let on_m = self.way_m - begun_m;
        if on_m >= CORRECTED_M[0] {
            let walked = place - *self.third_metre.get_or_insert(place);
            if on_m >= CORRECTED_M[1] && report.corrected.is_none() && self.errs {
                let middle_m = begun_m + f64::midpoint(CORRECTED_M[0], CORRECTED_M[1]);
                let is_along =
                    |way_m: f64, yaw_rad: f64| task.line.heading_error_rad(way_m, yaw_rad).abs() <= CORRECTED_RAD;
                report.corrected = Some(is_along(middle_m, walked.y.atan2(walked.x)));
                report.faces_line = Some(is_along(self.way_m, world_from_handler.rotation.angle()));
            }
        }
        report.success |= task.is_done(world_from_handler, self.way_m);
        self.last_places.push_back(place);
        if self.last_places.len() > STILL_DECISIONS + 1 {
            self.last_places.pop_front();
        }
    }

    /// A low step at a place (world frame) is announced to the handler.
    pub fn announced(&mut self, place: Point, world: &World) {
        if world.to_low_step_m(place) > STEP_OFF_M {
            self.report.floor.steps.false_announcements += 1;
        } else {
            self.announced = Some(place);
        }
    }

    /// Where robot and handler are now.
    pub fn stands(&mut self, team: &Team, world: &World) {
        let at = Point::from(team.world_from_robot().translation.vector);
        let before_m = std::mem::replace(&mut self.floor_m, world.floor_m(at));
        if LEVEL_M.contains(&(self.floor_m - before_m).abs()) {
            // Each step is announced anew.
            let was_announced = self.announced.take().is_some_and(|place| (place - at).norm() <= ANNOUNCED_M);
            let steps = &mut self.report.floor.steps;
            *(if was_announced { &mut steps.announced } else { &mut steps.unannounced }) += 1;
        }
        let (floor, falls) = (&mut self.report.floor, team.falls());
        (floor.robot_fell, floor.handler_fell) = (falls.robot() > 0, falls.handler() > 0);
        floor.now_m = floor.to_edge_m.map(|_| team.to_edge_m(world)[0]);
        for (least_m, now_m) in floor.to_edge_m.iter_mut().flatten().zip(team.to_edge_m(world)) {
            *least_m = least_m.min(now_m);
        }
    }

    /// The robot stopped for the floor where no edge is near; beside floor of which a camera sees little.
    pub fn stopped_for_nothing(&mut self, why: UnsafeCause, is_dark: bool) {
        let floor = &mut self.report.floor;
        if why == UnsafeCause::FloorUnseen {
            floor.unseen_stops += 1;
        } else {
            floor.false_stops += 1;
            floor.dark_stops += u32::from(is_dark);
        }
    }

    /// What the shield said of a decision, and whether the action was taken all the same.
    pub fn judged(&mut self, all_unsafe: bool, unsafe_taken: bool) {
        self.report.all_unsafe += u32::from(all_unsafe);
        self.report.unsafe_taken += u32::from(unsafe_taken);
    }

    /// The robot stands under a cue that moves it, held by that; none: by the policy.
    pub fn held(&mut self, by: UnsafeCause) {
        let held = &mut self.report.held;
        *match by {
            UnsafeCause::None => &mut held.policy,
            UnsafeCause::Beam | UnsafeCause::Unknown | UnsafeCause::Unseen | UnsafeCause::Handler => &mut held.lidar,
            UnsafeCause::Point | UnsafeCause::Second => &mut held.camera,
            UnsafeCause::Memory => &mut held.memory,
            UnsafeCause::Contact => &mut held.contact,
            UnsafeCause::DropOff
            | UnsafeCause::FloorUnseen
            | UnsafeCause::StepUp
            | UnsafeCause::LowStepDown
            | UnsafeCause::LowStepUp => &mut held.floor,
        } += 1;
    }

    /// What a decision was rewarded with.
    pub fn rewarded(&mut self, reward: f64) {
        self.report.reward += reward;
    }

    /// How much of what was asked for is done: the cue is followed, and an error of orientation put right.
    #[must_use]
    pub fn followed(&self) -> f64 {
        let report = self.report();
        f64::from(u8::from(report.success)) + f64::from(u8::from(report.corrected == Some(true)))
    }

    /// What became of it, so far.
    #[must_use]
    pub fn report(&self) -> Report {
        let mut report = self.report;
        let moved_m = self.last_places.iter().map(|place| (place - self.last).norm()).fold(0.0, f64::max);
        let stands = self.last_places.len() > STILL_DECISIONS && moved_m < STILL_M;
        if report.to_stand {
            report.success |= stands && self.in_corridor;
        }
        let FloorReport { before_edge, robot_fell, handler_fell, now_m, .. } = report.floor;
        if before_edge {
            report.success = stands && now_m.is_some_and(|now_m| now_m <= AT_EDGE_M);
        }
        report.success &= !(robot_fell || handler_fell);
        // Who never came so far has not put it right.
        let never_came = self.errs.then_some(false);
        report.corrected = report.corrected.or(never_came);
        report.faces_line = report.faces_line.or(never_came);
        report
    }
}
