//! Looks a few actions ahead with robot and handler together, and says what each first action is worth.

use super::field::CostToGo;
use super::grid::Window;
use super::team::{Team, half_way};
use guidance::se2::{Point, wrap_angle};
use guidance::{ActionTable, Memory, Se2};
use nalgebra::Vector2;

/// Actions looked ahead: four seconds; two metres, or one in single file at half the speed.
const DEPTH: usize = 8;
/// Ways kept for each first action at each depth.
const WIDTH: usize = 10;
/// How far ahead on the way the robot looks to where it should face, metres.
const LOOK_M: f64 = 1.0;
/// Heading errors below this are left alone: half a turn action, radians.
const HEADING_FREE_RAD: f64 = 0.09;
/// Price of a radian of heading error for one action, metres. An error of one turn action over the whole depth costs as
/// much as the forward step that the turn displaces.
const HEADING_PRICE: f64 = 0.4;
/// Price of a radian of heading error at the end, metres.
const END_HEADING_PRICE: f64 = 0.3;
/// Room below this is paid for, metres.
const ROOM_M: f64 = 0.3;
/// Price of one action without any room to spare, metres.
const ROOM_PRICE: f64 = 0.15;
/// Price of taking back what the last action did, metres.
const REVERSAL_PRICE: f64 = 0.12;
/// Price of a step back, metres: the handler is told first, and backs up.
const BACK_PRICE: f64 = 1.0;
/// Price of each action that could not be made because no way was left, metres.
const DEAD_END_PRICE: f64 = 0.8;
/// Cost where there is no way to the goal, metres.
const NO_WAY_M: f64 = 60.0;
/// Robot and handler do not tread on so much of their discs' rim, metres: the shield's margin, and half a cell of
/// floor.
const RIM_M: f64 = 0.1;
/// A motion that goes farther to the side than this leads aside, metres.
const ASIDE_M: f64 = 0.05;

/// What the look ahead needs to know.
pub struct Scene<'a> {
    /// The surroundings.
    pub window: &'a Window,
    /// Cost to the goal.
    pub cost: &'a CostToGo,
    /// Where to face where the cost says nothing, radians, odometry frame.
    pub facing_rad: f64,
    /// Robot and handler.
    pub team: &'a Team,
    /// The motions to choose from.
    pub table: &'a ActionTable,
    /// Room to be kept, metres.
    pub reserve_m: f64,
    /// What the robot last did, in its frame before.
    pub last_motion: Se2,
    /// How unwelcome it is to take that back: 1, more where the robot has been going to and fro.
    pub unrest: f64,
    /// The share of its speed at which the robot walks.
    pub speed: f64,
    /// Where floor was seen, if that is known.
    pub floor: Option<SeenFloor<'a>>,
}

/// Floor that was seen.
#[derive(Clone, Copy)]
pub struct SeenFloor<'a> {
    /// Remembers it.
    pub memory: &'a Memory,
    /// From the scene's frame into the memory's.
    pub robot_from_odom: Se2,
}

impl SeenFloor<'_> {
    /// Whether discs that go in a direction (unit vector, scene's frame) come to stand on seen floor.
    fn carries(&self, discs: &[(Point, f64); 2], direction: Vector2<f64>) -> bool {
        discs.iter().all(|(center, radius_m)| {
            let rim = center + direction * (radius_m - RIM_M);
            self.memory.carries(self.robot_from_odom * rim)
        })
    }
}

#[derive(Clone, Copy)]
struct Way {
    robot: Se2,
    robot_from_handler: Se2,
    room_m: f64,
    spent_m: f64,
    total_m: f64,
}

impl Scene<'_> {
    /// For each action, the cost of the best way that begins with it, metres; `None` where it leaves no room, and for
    /// stop.
    pub fn worth(&self, robot: &Se2, robot_from_handler: &Se2) -> Vec<Option<f64>> {
        let room_m = self.team.room_m(self.window, &self.team.discs(robot, robot_from_handler));
        let start = Way { robot: *robot, robot_from_handler: *robot_from_handler, room_m, spent_m: 0.0, total_m: 0.0 };
        let motions: Vec<Se2> = self.table.actions().iter().map(guidance::Action::start_from_end).collect();
        // A step back is planned as the first action alone.
        let is_onward = |action: &&guidance::Action| !action.leads_back();
        let onward = self.table.actions()[1..].iter().filter(is_onward).map(guidance::Action::start_from_end);
        let onward: Vec<Se2> = onward.collect();
        (0..motions.len())
            .map(|first| {
                if first == ActionTable::STOP {
                    return None;
                }
                let mut way = self.step(&start, &motions[first])?;
                let back_m = if self.table.actions()[first].leads_back() { BACK_PRICE } else { 0.0 };
                let price_m = self.reversal_m(&motions[first]) + back_m;
                way.spent_m += price_m;
                way.total_m += price_m;
                Some(self.best_from(way, &onward))
            })
            .collect()
    }

    /// The way from the middle of the team to the goal, metres.
    pub fn cost_m(&self, robot: &Se2) -> f64 {
        self.cost.at(self.window, self.team.middle(robot)).unwrap_or(NO_WAY_M)
    }

    fn best_from(&self, first: Way, onward: &[Se2]) -> f64 {
        let mut ways = vec![first];
        let mut best_dead_m = f64::INFINITY;
        for depth in 1..DEPTH {
            let mut next: Vec<Way> = Vec::with_capacity(ways.len() * onward.len());
            for way in &ways {
                next.extend(onward.iter().filter_map(|motion| self.step(way, motion)));
            }
            let left = (DEPTH - depth) as f64;
            let ended = ways.iter().map(|way| way.total_m).fold(f64::INFINITY, f64::min);
            best_dead_m = best_dead_m.min(ended + left * DEAD_END_PRICE);
            if next.is_empty() {
                return best_dead_m;
            }
            next.sort_by(|a, b| a.total_m.total_cmp(&b.total_m));
            ways = thinned(next);
        }
        ways.iter().map(|way| way.total_m).fold(best_dead_m, f64::min)
    }

    fn step(&self, way: &Way, motion: &Se2) -> Option<Way> {
        let robot = way.robot * motion;
        let robot_from_handler = self.team.follow(motion, &way.robot_from_handler);
        let before = self.team.discs(&way.robot, &way.robot_from_handler);
        let after = self.team.discs(&robot, &robot_from_handler);
        if !self.is_over_floor(way, motion, &after) {
            return None;
        }
        let room_m = self.team.room_m(self.window, &after);
        let swept_m = room_m.min(self.team.room_m(self.window, &half_way(&before, &after)));
        // Where there is too little room already, it must not get less.
        if swept_m < self.reserve_m && swept_m < way.room_m - 1e-3 || room_m < self.reserve_m && room_m < way.room_m {
            return None;
        }
        let middle = self.team.middle(&robot);
        let cost_m = self.cost_m(&robot);
        let heading = self.heading_error(&robot, middle);
        let tight = ((ROOM_M - swept_m) / ROOM_M).clamp(0.0, 1.5);
        let spent_m = way.spent_m
            + HEADING_PRICE * (heading - HEADING_FREE_RAD).max(0.0)
            + ROOM_PRICE * tight * tight
            + effort_m(motion);
        Some(Way {
            robot,
            robot_from_handler,
            room_m,
            spent_m,
            total_m: spent_m + cost_m + END_HEADING_PRICE * heading,
        })
    }

    /// The camera looks ahead. The shield forbids a motion aside over floor that was not seen. A plan that counts on
    /// one turns the robot to and fro.
    fn is_over_floor(&self, way: &Way, motion: &Se2, after: &[(Point, f64); 2]) -> bool {
        let is_aside = motion.translation.y.abs() > ASIDE_M * self.speed;
        let direction = way.robot.rotation * motion.translation.vector;
        self.floor.is_none_or(|floor| !is_aside || floor.carries(after, direction.normalize()))
    }

    fn heading_error(&self, robot: &Se2, middle: Point) -> f64 {
        let way = self.cost.downhill(self.window, middle, LOOK_M) - middle;
        let wanted = if way.norm() > 0.35 { way.y.atan2(way.x) } else { self.facing_rad };
        wrap_angle(wanted - robot.rotation.angle()).abs()
    }

    fn reversal_m(&self, motion: &Se2) -> f64 {
        let back = self.last_motion * motion;
        let last = self.last_motion.translation.vector.norm() + self.last_motion.rotation.angle().abs();
        let left = back.translation.vector.norm() + back.rotation.angle().abs();
        if last > 0.08 * self.speed && left < 0.5 * last { REVERSAL_PRICE * self.unrest } else { 0.0 }
    }
}

/// What the motion asks of the handler beyond walking, metres.
fn effort_m(motion: &Se2) -> f64 {
    0.15 * motion.translation.y.abs() + 0.06 * motion.rotation.angle().abs()
}

/// The best ways, sorted, of those that end in the same place only the first.
fn thinned(sorted: Vec<Way>) -> Vec<Way> {
    let mut kept: Vec<Way> = Vec::with_capacity(WIDTH);
    for way in sorted {
        let same = |other: &Way| {
            (other.robot.translation.vector - way.robot.translation.vector).norm() < 0.04
                && wrap_angle(other.robot.rotation.angle() - way.robot.rotation.angle()).abs() < 0.05
        };
        if !kept.iter().any(same) {
            kept.push(way);
            if kept.len() == WIDTH {
                break;
            }
        }
    }
    kept
}
