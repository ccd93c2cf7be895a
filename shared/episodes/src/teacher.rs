//! A teacher: who knows the travel line, the world and the handler as they are, and looks a few actions ahead. What it
//! does is what a policy, which knows none of that, is first taught to do; it then learns on by its own reward.

use guidance::se2::{Point, Se2};
use guidance::{ActionTable, Interaction, TravelLine};
use world::{HandlerProfile, Team, World};

/// Actions looked ahead.
const DEPTH: usize = 3;
/// The handler walks to the right of the robot: the team's middle is so far to the right of it, metres.
pub(crate) const MIDDLE_M: f64 = 0.17;
/// Headings this near to the line's are as good, radians: half a turn of the table. Beyond it a radian costs as much as
/// so many metres of way.
const HEADING_FREE_RAD: f64 = 0.09;
const HEADING_COST_M: f64 = 1.0;
/// Where the line is straight, so far behind and ahead of the robot, metres, to so many radians,
const STRAIGHT_M: [f64; 2] = [1.5, 3.0];
const STRAIGHT_RAD: f64 = 0.1;
/// the first so many radians beyond those that are free cost so much more: a turn of the table, which is no way ahead,
/// must be worth it. In a corner this would only hold the robot.
const STRAIGHTEN_RAD: f64 = 0.1;
const STRAIGHTEN_COST_M: f64 = 2.5;
/// The line's direction is that of so far ahead of the robot, metres.
const AHEAD_M: f64 = 0.6;
/// Off the middle by so much is as good, metres; beyond it each metre costs so many of way.
const ASIDE_FREE_M: f64 = 0.15;
const ASIDE_COST: f64 = 0.25;
/// So much room is enough, metres; what is missing of it costs so many times as much of way.
const ROOM_M: f64 = 0.18;
const ROOM_COST: f64 = 0.8;
/// What is wrong after a step costs this share of what it costs at the end.
const EACH_STEP: f64 = 0.25;
/// An action that is no stop costs so much, metres of way.
const MOTION_COST_M: f64 = 0.012;
/// Less room than this is a touch, metres.
const TOUCH_M: f64 = 0.02;
/// Who touches something loses so much, metres of way.
const TOUCH_COST_M: f64 = 3.0;

/// See the module.
#[derive(Debug)]
pub struct Teacher<'a> {
    /// The world as it is.
    pub world: &'a World,
    /// Where everybody is.
    pub team: &'a Team,
    /// The way that is meant.
    pub line: &'a TravelLine,
    /// The actions.
    pub table: &'a ActionTable,
    /// Those that the shield forbids now, by bit.
    pub unsafe_mask: u32,
}

/// Robot and handler on the way.
#[derive(Debug, Clone, Copy)]
struct State {
    robot: Se2,
    robot_from_handler: Se2,
    /// How far along the line they are, metres.
    robot_m: f64,
    handler_m: f64,
}

impl Teacher<'_> {
    /// The best action; of equals the first.
    #[must_use]
    pub fn action(&self) -> usize {
        let mut best = ActionTable::STOP;
        let worths_m = self.worths_m();
        for (action, worth_m) in worths_m.iter().enumerate() {
            if *worth_m > worths_m[best] + 1e-9 {
                best = action;
            }
        }
        best
    }

    /// What each action is worth with the best that can follow it, metres of way; of forbidden ones less than nothing
    /// can be.
    #[must_use]
    pub fn worths_m(&self) -> Vec<f64> {
        let (robot, robot_from_handler) = (*self.team.world_from_robot(), *self.team.robot_from_handler());
        let foot_m = |pose: &Se2| self.line.foot(place(pose)).way_m;
        let now = State {
            robot,
            robot_from_handler,
            robot_m: foot_m(&robot),
            handler_m: foot_m(&(robot * robot_from_handler)),
        };
        let is_unsafe = |action: usize| self.unsafe_mask >> action & 1 == 1;
        let worth_m = |action: usize| {
            if is_unsafe(action) { f64::NEG_INFINITY } else { self.worth_m(&now, &now, action, DEPTH) }
        };
        (0..self.table.len()).map(worth_m).collect()
    }

    fn worth_m(&self, begin: &State, state: &State, action: usize, depth: usize) -> f64 {
        let profile: &HandlerProfile = self.team.handler();
        let motion = self.table.actions()[action].start_from_end();
        let robot = state.robot * motion;
        let robot_from_handler = profile.model.step(&state.robot_from_handler, &motion);
        let handler = robot * robot_from_handler;
        let near = |pose: &Se2, before_m: f64| self.line.foot_within(place(pose), before_m - 1.0, before_m + 1.0);
        let (robot_foot, handler_foot) = (near(&robot, state.robot_m), near(&handler, state.handler_m));
        let next = State { robot, robot_from_handler, robot_m: robot_foot.way_m, handler_m: handler_foot.way_m };
        if action != ActionTable::STOP && self.touches(&robot, &handler) {
            return -TOUCH_COST_M;
        }
        let aside_m = (robot_foot.left_m - MIDDLE_M).abs();
        let wrong_m = self.wrong_heading_m(&robot, next.robot_m)
            + ASIDE_COST * (aside_m - ASIDE_FREE_M).max(0.0)
            + ROOM_COST * self.missing_room_m(&robot, &handler);
        // What is put off costs as long as it lasts.
        let cost_m = EACH_STEP * wrong_m + if action == ActionTable::STOP { 0.0 } else { MOTION_COST_M };
        if depth > 1 {
            let following = (0..self.table.len()).map(|action| self.worth_m(begin, &next, action, depth - 1));
            return following.fold(f64::NEG_INFINITY, f64::max) - cost_m;
        }
        0.5 * (next.robot_m - begin.robot_m + next.handler_m - begin.handler_m) - cost_m - wrong_m
    }

    /// What the heading of a robot costs that is so far along the line.
    fn wrong_heading_m(&self, robot: &Se2, way_m: f64) -> f64 {
        let off_rad = self.line.heading_error_rad(way_m + AHEAD_M, robot.rotation.angle());
        let over_rad = (off_rad.abs() - HEADING_FREE_RAD).max(0.0);
        let ahead_rad = self.line.at(way_m + STRAIGHT_M[1]).rotation.angle();
        let is_straight = self.line.heading_error_rad(way_m - STRAIGHT_M[0], ahead_rad).abs() < STRAIGHT_RAD;
        let straighten_m = if is_straight { STRAIGHTEN_COST_M * over_rad.min(STRAIGHTEN_RAD) } else { 0.0 };
        HEADING_COST_M * over_rad + straighten_m
    }

    fn touches(&self, robot: &Se2, handler: &Se2) -> bool {
        self.team.room_m(self.world, robot, handler, 2.0 * TOUCH_M) < TOUCH_M
    }

    fn missing_room_m(&self, robot: &Se2, handler: &Se2) -> f64 {
        ROOM_M - self.team.room_m(self.world, robot, handler, ROOM_M)
    }
}

fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}
