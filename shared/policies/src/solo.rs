//! A planner for a robot that walks alone to a goal which it is told. It guides no one: public yardsticks of navigation
//! ask for it.
//!
//! It keeps the same memory of scans as the geometric policy, spreads the way to the goal over it, and looks a few
//! actions ahead. Plans are made of the places where the robot would come to rest: a robot that is carried on by what
//! it moved before ends each action there (`guidance::Reach`). Same input, same output.

use guidance::se2::{Point, wrap_angle};
use guidance::{ActionTable, Reach, Se2};
use messages::{MAX_ACTIONS, ScanHeader, Twist2};

use crate::Probabilities;
use crate::geometric::beams::Beams;
use crate::geometric::field::CostToGo;
use crate::geometric::grid::{Known, Memory, SIDE, Window};
use crate::geometric::probabilities;

/// Actions looked ahead.
const DEPTH: usize = 8;
/// Ways kept for each first action at each depth.
const WIDTH: usize = 12;
/// What was seen is remembered for so long, seconds.
const MEMORY_S: f64 = 10.0;
/// What the camera alone saw is remembered for so long, seconds: no beam of the lidar shows that it is gone.
const CAMERA_S: f64 = 1.0;
/// Obstacles that the camera alone sees farther away than this may be noise, metres.
const CAMERA_M: f64 = 3.0;
/// The way to the goal is asked for so far ahead of the robot's middle: a plan ends with the robot facing its way.
const AHEAD_M: f64 = 0.35;
/// A plan ends where the robot comes so near to the goal, metres; within this of it, its facing does not matter.
const AT_GOAL_M: f64 = 0.2;
const CLOSE_M: f64 = 1.0;
/// Room below this is paid for, metres, and what a second without any room to spare costs, seconds.
const ROOM_M: f64 = 0.15;
const ROOM_PRICE: f64 = 0.8;
/// Price of turning the other way than the last action did, seconds.
const REVERSAL_PRICE: f64 = 0.1;
/// Price of going back or standing for an action, seconds.
const BACK_PRICE: f64 = 1.0;
/// Each action that could not be made because no way was left, seconds.
const DEAD_END_PRICE: f64 = 1.0;
/// Cost where there is no way to the goal, metres.
const NO_WAY_M: f64 = 60.0;
/// The way to the goal gets dearer within this of an obstacle, metres.
const NEAR_M: f64 = 0.4;
/// Cells of the map may be off by so much, metres.
const CELL_OFF_M: f64 = 0.05;
/// A metre of unknown floor costs so many of free floor.
const UNKNOWN_PRICE: f64 = 1.3;
/// Costs of standing, and of what the shield forbids, seconds.
const STOP_S: f64 = 1e3;
const UNSAFE_S: f64 = 1e4;
/// Where no action has a way, one that the shield allows costs so much less than to stop, seconds.
const WAY_OUT_S: f64 = 100.0;

/// What the planner knows of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct SoloConfig {
    /// Decision period, seconds.
    pub dt_s: f64,
    /// Radius of the body's discs with the shield's margin, metres.
    pub radius_m: f64,
    /// Shape, and how far it is carried on.
    pub reach: Reach,
}

/// What one decision is made from.
#[derive(Debug, Clone, Copy)]
pub struct SoloSituation<'a> {
    /// Stands beside the ranges.
    pub scan: &'a ScanHeader,
    /// The lidar's readings, metres.
    pub ranges: &'a [f32],
    /// Obstacles that the camera saw, robot frame, metres.
    pub obstacles: &'a [Point],
    /// The robot in the odometry frame.
    pub odom_from_robot: Se2,
    /// How it moves, as it was commanded.
    pub moves: Twist2,
    /// The goal in the odometry frame.
    pub goal: Point,
    /// Bit *i* is set where the shield forbids action *i*.
    pub unsafe_mask: u32,
}

/// The planner. Call [`decide`](Self::decide) once in each decision period.
#[derive(Debug)]
pub struct SoloEngine {
    config: SoloConfig,
    table: ActionTable,
    motions: Vec<Se2>,
    speed_max_mps: f64,
    memory: Memory,
    last: usize,
}

/// A way that was looked at.
#[derive(Debug, Clone, Copy)]
struct Way {
    robot: Se2,
    room_m: f64,
    spent_s: f64,
    total_s: f64,
    is_there: bool,
}

/// What the look ahead needs to know.
struct Scene<'a> {
    engine: &'a SoloEngine,
    window: &'a Window,
    cost: &'a CostToGo,
    goal: Point,
    reserve_m: f64,
}

impl SoloEngine {
    /// A planner for that robot and that action table.
    #[must_use]
    pub fn new(config: SoloConfig, table: ActionTable) -> Self {
        let motions = table.actions().iter().map(guidance::Action::start_from_end).collect();
        let decisions = |time_s: f64| (time_s / config.dt_s) as u64;
        let speeds = table.actions().iter().map(|action| action.velocity(config.dt_s).vx_mps);
        Self {
            speed_max_mps: speeds.fold(1e-3, f64::max),
            memory: Memory::new(decisions(MEMORY_S)).with_camera_kept(decisions(CAMERA_S), decisions(CAMERA_S)),
            config,
            table,
            motions,
            last: ActionTable::STOP,
        }
    }

    /// Forgets everything: another walk begins.
    pub fn clear(&mut self) {
        self.memory.clear();
        self.last = ActionTable::STOP;
    }

    /// Probabilities over the action table: nearly all on the best action that the shield leaves. Certain to stand
    /// where nothing is seen.
    pub fn decide(&mut self, situation: &SoloSituation<'_>) -> Probabilities {
        let Some(beams) = Beams::read_but(situation.scan, situation.ranges, |_| false) else { return crate::stand() };
        let near: Vec<Point> =
            situation.obstacles.iter().copied().filter(|place| place.coords.norm() < CAMERA_M).collect();
        self.memory.update(&situation.odom_from_robot, &beams, &near, None, None);
        let place = Point::from(situation.odom_from_robot.translation.vector);
        let window = self.memory.window(place, self.config.radius_m, []);
        let cost = CostToGo::spread_by(&window, &seeds(&window, situation.goal), place, |window, cell| {
            self.price(window, cell)
        });
        // Where the robot would rest if it stopped now.
        let rests = situation.odom_from_robot * self.config.reach.carries_to(&situation.moves);
        let worth = |reserve_m: f64| {
            let scene = Scene { engine: self, window: &window, cost: &cost, goal: situation.goal, reserve_m };
            scene.worth(&rests, situation.unsafe_mask)
        };
        let wished = worth(2.0 * beams.sigma_m);
        let worth = if wished.iter().any(Option::is_some) { wished } else { worth(0.0) };
        let mut costs = [f64::INFINITY; MAX_ACTIONS];
        for (action, worth) in worth.iter().enumerate() {
            costs[action] = match worth {
                _ if action == ActionTable::STOP => STOP_S,
                _ if situation.unsafe_mask >> action & 1 == 1 => UNSAFE_S,
                Some(cost_s) => *cost_s,
                None => STOP_S - WAY_OUT_S - self.room_m(&window, &(rests * self.motions[action])),
            };
        }
        let best = (0..self.table.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b]));
        self.last = best.unwrap_or(ActionTable::STOP);
        probabilities(&costs)
    }

    /// What a metre through a cell costs, metres.
    fn price(&self, window: &Window, cell: usize) -> f64 {
        let room_m = window.clearance_m[cell] - self.config.radius_m;
        if room_m < -CELL_OFF_M || window.known[cell] == Known::Occupied {
            return f64::INFINITY;
        }
        let near = ((NEAR_M - room_m) / NEAR_M).clamp(0.0, 1.0);
        let unknown = if window.known[cell] == Known::Unknown { UNKNOWN_PRICE } else { 1.0 };
        unknown * (1.0 + 2.0 * near * near + if room_m < 0.0 { 5.0 } else { 0.0 })
    }

    /// From the body to the nearest obstacle, metres; negative where it is inside.
    fn room_m(&self, window: &Window, robot: &Se2) -> f64 {
        let nose_m = self.config.reach.nose_m;
        let places = [nose_m, -nose_m].map(|ahead_m| window.clearance_at(robot * Point::new(ahead_m, 0.0)));
        places[0].min(places[1]) - self.config.radius_m
    }

    fn turns(&self, action: usize) -> f64 {
        self.motions[action].rotation.angle()
    }
}

impl Scene<'_> {
    /// For each action, the time to the goal by the best way that begins with it, seconds; none where it leaves no
    /// room, is forbidden, or stands.
    fn worth(&self, rests: &Se2, unsafe_mask: u32) -> Vec<Option<f64>> {
        let room_m = self.engine.room_m(self.window, rests);
        let start = Way { robot: *rests, room_m, spent_s: 0.0, total_s: 0.0, is_there: false };
        let first = |action: usize| {
            let is_open = action != ActionTable::STOP && unsafe_mask >> action & 1 == 0;
            let mut way = is_open.then(|| self.step(&start, action)).flatten()?;
            let turned_back = self.engine.turns(self.engine.last) * self.engine.turns(action) < 0.0;
            let price_s = if turned_back { REVERSAL_PRICE } else { 0.0 };
            (way.spent_s, way.total_s) = (way.spent_s + price_s, way.total_s + price_s);
            Some(self.best_from(way))
        };
        (0..self.engine.table.len()).map(first).collect()
    }

    fn best_from(&self, first: Way) -> f64 {
        if first.is_there {
            return first.total_s;
        }
        let mut ways = vec![first];
        let mut best_s = f64::INFINITY;
        let dt_s = self.engine.config.dt_s;
        for depth in 1..DEPTH {
            let actions = 1..self.engine.table.len();
            let mut next: Vec<Way> =
                ways.iter().flat_map(|way| actions.clone().filter_map(|action| self.step(way, action))).collect();
            let ended_s = ways.iter().map(|way| way.total_s).fold(f64::INFINITY, f64::min);
            best_s = best_s.min(ended_s + (DEPTH - depth) as f64 * (DEAD_END_PRICE + dt_s));
            best_s = next.iter().filter(|way| way.is_there).map(|way| way.total_s).fold(best_s, f64::min);
            next.retain(|way| !way.is_there);
            if next.is_empty() {
                return best_s;
            }
            next.sort_by(|a, b| a.total_s.total_cmp(&b.total_s));
            ways = thinned(&next);
        }
        ways.iter().map(|way| way.total_s).fold(best_s, f64::min)
    }

    fn step(&self, way: &Way, action: usize) -> Option<Way> {
        let engine = self.engine;
        let motion = &engine.motions[action];
        let robot = way.robot * motion;
        let half = guidance::se2::exp(engine.table.actions()[action].velocity(1.0), 0.5);
        let room_m = engine.room_m(self.window, &robot);
        let swept_m = room_m.min(engine.room_m(self.window, &(way.robot * half)));
        // Where there is too little room already, it must not get less.
        if swept_m < self.reserve_m && swept_m < way.room_m - 1e-3 {
            return None;
        }
        let dt_s = engine.config.dt_s;
        let tight = ((ROOM_M - swept_m) / ROOM_M).clamp(0.0, 1.5);
        let back_s = if motion.translation.x < 0.0 { BACK_PRICE } else { 0.0 };
        let spent_s = way.spent_s + dt_s * (1.0 + ROOM_PRICE * tight * tight) + back_s;
        let place = Point::from(robot.translation.vector);
        let left_m = (self.goal - place).norm();
        let is_there = left_m < AT_GOAL_M;
        let to_go_m = if is_there { 0.0 } else { self.to_go_m(&robot, if left_m < CLOSE_M { 0.0 } else { AHEAD_M }) };
        Some(Way { robot, room_m, spent_s, total_s: spent_s + to_go_m / engine.speed_max_mps, is_there })
    }

    /// The way from so far ahead of the robot, and not less than from where it is.
    fn to_go_m(&self, robot: &Se2, ahead_m: f64) -> f64 {
        let from_m = |place: Point| self.cost.at(self.window, place).unwrap_or(NO_WAY_M);
        let here_m = from_m(Point::from(robot.translation.vector));
        from_m(robot * Point::new(ahead_m, 0.0)).max(here_m - ahead_m)
    }
}

/// The goal's cell; where the goal is outside the window, all cells at its rim, each with the way from there.
fn seeds(window: &Window, goal: Point) -> Vec<(usize, f64)> {
    if let Some(cell) = window.cell_at(goal) {
        return vec![(cell, 0.0)];
    }
    let is_rim = |cell: &usize| {
        let (i, j) = (cell % SIDE, cell / SIDE);
        i == 0 || j == 0 || i == SIDE - 1 || j == SIDE - 1
    };
    (0..SIDE * SIDE).filter(is_rim).map(|cell| (cell, (window.centre(cell) - goal).norm())).collect()
}

/// The best ways, sorted; of those that end in the same place only the first.
fn thinned(sorted: &[Way]) -> Vec<Way> {
    let mut kept: Vec<Way> = Vec::with_capacity(WIDTH);
    for way in sorted {
        let same = |other: &Way| {
            (other.robot.translation.vector - way.robot.translation.vector).norm() < 0.05
                && wrap_angle(other.robot.rotation.angle() - way.robot.rotation.angle()).abs() < 0.1
        };
        if !kept.iter().any(same) {
            kept.push(*way);
            if kept.len() == WIDTH {
                break;
            }
        }
    }
    kept
}
