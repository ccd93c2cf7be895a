//! One task: a place, a heading, a cue, and when it has been done.

use guidance::TravelLine;
use guidance::cue::TURN_REACH_M;
use guidance::se2::{Point, Se2, wrap_angle};
use messages::CueKind;
use rand::{Rng, RngExt};
use world::{Course, Opening, Side};

use crate::config::Config;
use crate::teacher::MIDDLE_M;

/// *Forward* is done when the handler is so far on along the corridor, metres,
pub const ON_M: f64 = 10.0;
/// or this near to its end: the robot is ahead of the handler, and stands before the wall.
pub const END_M: f64 = 2.0;
/// *Left* and *right* are done when the handler is so far inside the opening, metres,
pub const INSIDE_M: f64 = 2.0;
/// and faces its axis as well as this, radians.
pub const AXIS_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// Who stands moves by less than this, metres,
pub const STILL_M: f64 = 0.3;
/// in so many decisions.
pub const STILL_DECISIONS: usize = 10;
/// A turn cue can mean the opening beside the pair, or the next one: the robot is less than this before the farther
/// edge, metres, and the handler has not passed it.
const BESIDE_M: f64 = 1.0;
/// An opening within this distance after a corner to the same side may be meant as well, metres.
const AFTER_CORNER_M: f64 = 4.0;
/// A pair within this distance of an opening on a map may be beside it, metres.
const PASSED_M: f64 = 0.4;
/// A cue to turn is due so far before the opening's middle, metres.
const DUE_M: f64 = 1.5;
/// Who has crossed a hall is so far in the corridor behind it, metres.
const BEHIND_HALL_M: f64 = 1.0;
/// The longest way of a decision, metres; and how many times longer a way takes with pauses.
const DECISION_M: f64 = 0.25;
const PAUSES: f64 = 2.0;
/// Who is inside has so much way before them, metres: the robot is there, and the wall at the end.
const BEFORE_M: f64 = 1.6;

/// Where an edge crosses the way, the share [`NEAR`] of the cues to go on is given at most this far before it, metres.
const TO_EDGE_M: f64 = 8.0;
/// The handler stays at least this far from an edge across the way, metres: the robot is ahead of them.
const BEFORE_EDGE_M: f64 = 2.0;

/// Cues are given so far from the corridor's beginning and its end at least, metres: where both have room.
const ENDS_M: [f64; 2] = [1.3, 1.5];
/// So many of the cues to turn are given near an opening to that side: so far past its middle to so far before, metres.
const NEAR: f64 = 0.75;
const NEAR_M: [f64; 2] = [-2.0, 12.0];
/// So many of the cues to go on are given where the corridor goes on as far as is asked.
const WITH_WAY: f64 = 0.7;
/// Half of the width that robot and handler need side by side, metres.
const HALF_WIDTH_M: f64 = 0.65;

/// When a task has been done.
#[derive(Debug, Clone, PartialEq)]
pub enum Goal {
    /// The handler has come so far along the line, metres.
    Along(f64),
    /// The handler is inside one of the openings.
    Into(Vec<Opening>),
    /// The handler stands still in the corridor; or is inside one of these, beside which they gave the cue.
    Stand(Vec<Opening>),
    /// The robot stands before the edge at which the floor of the way ends.
    BeforeEdge,
}

/// See the module.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// What is asked for.
    pub cue: CueKind,
    /// The robot then.
    pub world_from_robot: Se2,
    /// The way that the cue means.
    pub line: TravelLine,
    /// When it has been done.
    pub goal: Goal,
    /// Width of the corridor, metres.
    pub width_m: f64,
}

impl Task {
    /// A task in a course: a cue, given by somebody who errs as [`Config::orientation_max_rad`] and
    /// [`Config::timing_max_m`] say, and who stands there beside the robot. `None` where there is no room for one.
    pub fn draw(
        course: &Course,
        cue: CueKind,
        config: &Config,
        robot_from_handler: &Se2,
        random: &mut impl Rng,
    ) -> Option<Self> {
        let length_m = course.edge_m.map_or(course.line.length_m(), |edge_m| edge_m - BEFORE_EDGE_M);
        let [begin_m, before_end_m] = ENDS_M;
        let side = side_of(cue);
        let mut way_m = random.random_range(begin_m..(length_m - END_M).max(begin_m + 0.1));
        let openings: Vec<&Opening> = course.openings.iter().filter(|opening| Some(opening.side) == side).collect();
        if let Some(timing_m) = config.timing_max_m.filter(|_| side.is_some()) {
            let opening = openings.get(random.random_range(0..openings.len().max(1)))?;
            way_m = opening.way_m - DUE_M - random.random_range(-timing_m..=timing_m);
        } else if !openings.is_empty() && random.random_bool(NEAR) {
            let to_edge = openings.iter().find(|opening| opening.edge_m.is_some());
            let opening = to_edge.unwrap_or(&openings[random.random_range(0..openings.len())]);
            way_m = opening.way_m - random.random_range(NEAR_M[0]..NEAR_M[1]);
        } else if cue == CueKind::Forward && course.edge_m.is_some() && random.random_bool(NEAR) {
            way_m = length_m - random.random_range(0.0..TO_EDGE_M);
        } else if cue == CueKind::Forward && random.random_bool(WITH_WAY) {
            way_m = random.random_range(begin_m..(length_m - ON_M).max(begin_m + 0.5));
        }
        if !(begin_m..length_m - before_end_m).contains(&way_m) {
            return None;
        }
        let at = course.line.at(way_m);
        let aside_m = (course.width_m / 2.0 - HALF_WIDTH_M).max(0.05);
        let left_m = random.random_range(-aside_m..aside_m) + MIDDLE_M;
        let yaw_rad = at.rotation.angle() + random.random_range(-1.0..1.0) * config.orientation_max_rad;
        let robot = at * Point::new(0.0, left_m);
        Self::at(course, cue, Se2::new(robot.coords, wrap_angle(yaw_rad)), robot_from_handler)
    }

    /// The task of a handler who gives that cue there. `None` where the cue is not clear: the next opening is a niche,
    /// the pair is in a hall, an edge comes behind an opening beside the pair, or the pair is beside an opening of a
    /// floor plan.
    #[must_use]
    pub fn at(course: &Course, cue: CueKind, world_from_robot: Se2, robot_from_handler: &Se2) -> Option<Self> {
        let way_m = |pose: Se2| course.line.foot(Point::from(pose.translation.vector)).way_m;
        let (way_m, handler_way_m) = (way_m(world_from_robot), way_m(world_from_robot * robot_from_handler));
        let task =
            |line: TravelLine, goal: Goal| Some(Self { cue, world_from_robot, line, goal, width_m: course.width_m });
        let Some(side) = side_of(cue) else {
            if cue == CueKind::Forward && (!has_way_on(course, handler_way_m) || has_hall(course, [way_m; 2])) {
                return None;
            }
            let to_m = beyond_hall_m(course, (handler_way_m + ON_M).min(course.line.length_m() - END_M));
            return if cue == CueKind::Stop {
                task(course.line.clone(), Goal::Stand(Vec::new()))
            } else if course.edge_m.is_some_and(|edge_m| to_m > edge_m - BEFORE_EDGE_M) {
                task(course.line.clone(), Goal::BeforeEdge)
            } else {
                task(course.line.clone(), Goal::Along(to_m))
            };
        };
        if course.mapped.is_some()
            && course.openings.iter().any(|o| o.side == side && is_beside(o, handler_way_m, way_m))
        {
            return None;
        }
        let from_m = handler_way_m.min(way_m);
        let first = course.next(side, from_m, way_m - from_m + TURN_REACH_M);
        let beside = first.filter(|first| first.far_edge_m() - way_m < BESIDE_M);
        let meant = match beside {
            Some(beside) => course.next(side, beside.far_edge_m(), TURN_REACH_M),
            None => first,
        };
        let Some(meant) = meant else {
            let end_m = (way_m + TURN_REACH_M).min(course.line.length_m());
            if has_hall(course, [way_m, end_m]) {
                return None;
            }
            return task(course.line.part(0.0, end_m)?, Goal::Stand(beside.into_iter().cloned().collect()));
        };
        if meant.edge_m.is_some() {
            if beside.is_some() {
                return None;
            }
            return task(course.line_into(meant)?, Goal::BeforeEdge);
        }
        let is_deep = |opening: &Opening| opening.line.length_m() >= course.width_m / 2.0 + INSIDE_M + BEFORE_M;
        if !is_deep(meant) {
            return None;
        }
        // Shortly before an opening, the corridor itself turns to that side: either may be meant.
        let is_soon = |next: &&Opening| {
            let is_near = next.way_m > meant.way_m && next.way_m < meant.way_m + AFTER_CORNER_M;
            next.side == side && is_near && next.edge_m.is_none() && is_deep(next)
        };
        let soon = course.openings.iter().find(is_soon).filter(|_| course.is_corner(meant));
        let allowed = [Some(meant), beside, soon].into_iter().flatten().cloned().collect();
        task(course.line_into(meant)?, Goal::Into(allowed))
    }

    /// Decisions that are time enough for the way, pauses included.
    #[must_use]
    pub fn decisions(&self) -> usize {
        if self.cue == CueKind::Stop {
            return STILL_DECISIONS;
        }
        let from_m = self.line.foot(Point::from(self.world_from_robot.translation.vector)).way_m;
        let to_m = match &self.goal {
            Goal::Along(to_m) => *to_m,
            Goal::Into(openings) => {
                let farthest_m = openings.iter().map(|opening| opening.way_m).fold(0.0, f64::max);
                farthest_m + self.width_m / 2.0 + INSIDE_M + BEFORE_M
            }
            Goal::Stand(_) | Goal::BeforeEdge => self.line.length_m(),
        };
        let steps = (to_m - from_m).clamp(0.0, TURN_REACH_M + ON_M) / DECISION_M;
        (PAUSES * steps) as usize + STILL_DECISIONS
    }

    /// Whether a handler who is there, at that way along the line, has arrived; who stands has not, nor who is to.
    #[must_use]
    pub fn is_done(&self, world_from_handler: &Se2, way_m: f64) -> bool {
        let place = Point::from(world_from_handler.translation.vector);
        match &self.goal {
            Goal::Along(to_m) => way_m >= *to_m,
            Goal::BeforeEdge => false,
            Goal::Into(openings) | Goal::Stand(openings) => openings.iter().any(|opening| {
                if let Some(behind) = &opening.behind {
                    return behind.depth_m(place).is_some_and(|depth_m| depth_m >= INSIDE_M);
                }
                let foot = opening.line.foot(place);
                let off_axis_rad = opening.line.heading_error_rad(foot.way_m, world_from_handler.rotation.angle());
                foot.way_m >= self.width_m / 2.0 + INSIDE_M
                    && foot.left_m.abs() < opening.width_m / 2.0
                    && off_axis_rad.abs() <= AXIS_RAD
            }),
        }
    }
}

/// Whether a corridor goes on as far as *forward* asks, or ends before: on a map it may fork, or lead into the open.
fn has_way_on(course: &Course, handler_way_m: f64) -> bool {
    course.mapped.is_none_or(|mapped| mapped.has_end) || handler_way_m + ON_M <= course.line.length_m() - END_M
}

/// Where *forward* leads: who is sent across a hall has arrived in the corridor behind it.
fn beyond_hall_m(course: &Course, to_m: f64) -> f64 {
    match course.mapped.and_then(|mapped| mapped.hall_m) {
        Some([from_m, far_m]) if (from_m..far_m + BEHIND_HALL_M).contains(&to_m) => far_m + BEHIND_HALL_M,
        _ => to_m,
    }
}

/// Whether there is some of a hall between two places along the corridor, metres: there it is not clear which way is
/// meant, nor whether there is one to the side.
fn has_hall(course: &Course, [from_m, to_m]: [f64; 2]) -> bool {
    let hall_m = course.mapped.and_then(|mapped| mapped.hall_m);
    hall_m.is_some_and(|[begins_m, ends_m]| begins_m <= to_m && from_m < ends_m)
}

/// Whether robot or handler are beside an opening: it is not clear whether they mean it, or have passed it.
fn is_beside(opening: &Opening, handler_way_m: f64, way_m: f64) -> bool {
    let [from_m, to_m] = [handler_way_m - PASSED_M, way_m + PASSED_M];
    opening.far_edge_m() > from_m && opening.way_m - opening.width_m / 2.0 < to_m
}

fn side_of(cue: CueKind) -> Option<Side> {
    match cue {
        CueKind::Left => Some(Side::Left),
        CueKind::Right => Some(Side::Right),
        CueKind::Stop | CueKind::Forward => None,
    }
}
