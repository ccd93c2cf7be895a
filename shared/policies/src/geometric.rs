//! The geometric policy: follows the travel line with robot and handler, without any learning.
//!
//! At each decision it keeps a memory of what lidar and camera have seen, finds which way the cue means there
//! (`route`), spreads the cost to that goal over the floor (`field`), and looks a few actions ahead with robot and
//! delayed handler together (`rollout`). Same input, same output: no clock, no randomness, no I/O.

mod backed;
pub(crate) mod beams;
pub(crate) mod field;
mod formation;
pub(crate) mod grid;
mod openings;
mod rollout;
mod route;
mod team;
mod trail;
mod travel;

pub use route::Plan;

use backed::Backed;
use beams::Beams;
use field::CostToGo;
use formation::Forming;
use grid::{Memory, Window};
use guidance::se2::{Point, pose2, wrap_angle};
use guidance::{
    ActionTable, DelayedHarness, Evidence, HandlerBody, HarnessError, Interaction, InteractionModel, Judgement, Motion,
    Se2, Shield, ShieldConfig,
};
use messages::{CueKind, Formation, MAX_ACTIONS, Pose2, ScanHeader, UnsafeCause};
use rollout::{Scene, SeenFloor};
use route::{Route, Seen};
use settings::Settings;
use std::collections::VecDeque;
use team::Team;
use trail::Trail;

/// Share of the probability that goes to the actions that are not the best.
const REST_SHARE: f64 = 0.05;
/// Obstacles farther than this cannot touch the team in one action, metres.
const NEAR_M: f64 = 2.0;
/// No robot walks so far, metres.
const POSE_MAX_M: f64 = 1e6;
/// Costs that no way to a goal has, metres: to stop, what leaves no room, and what leads over floor that was not seen.
const STOP_M: f64 = 1e3;
const UNSAFE_M: f64 = 1e4;
const UNSEEN_M: f64 = 1e5;
/// An action costs so much where its hull leaves no room between the shield's margin and the nearest beam, metres. The
/// cost falls to nothing where it leaves so much room, metres: handler and legs sway by centimetres.
const TIGHT_M: [f64; 2] = [0.2, 0.05];
/// A way out of a wedge costs so much less than to stop, metres; and takes away no more room than this, metres.
const WAY_OUT_M: f64 = 100.0;
const SAME_ROOM_M: f64 = 0.005;
/// A team that is so near to the goal is at it, metres.
const AT_GOAL_M: f64 = 1.0;
/// Motions looked back at for going to and fro: five seconds.
const HISTORY: usize = 10;
/// Beside and behind are places so far apart at least, metres: the shield takes a handler within 0.25 m for there.
const PLACES_APART_M: f64 = 0.5;
/// A cue that begins so far off the heading with which the robot came leads elsewhere: back, for example, radians.
const BACK_RAD: f64 = 2.1;
/// An action leads on that brings the robot so far ahead, metres. Others keep this share of their probability.
const ONWARD_M: f64 = 0.1;
const ASIDE_SHARE: f32 = 1e-3;
/// A team that came less far in that time gets nowhere, metres.
const NOWHERE_M: f64 = 0.3;
/// How unwelcome it is to take back the last motion once the team goes to and fro.
const UNREST_MAX: f64 = 16.0;

/// What the engine knows of the team.
#[derive(Debug, Clone, PartialEq)]
pub struct GeometricConfig {
    /// Decision period, seconds.
    pub dt_s: f64,
    /// Radius of the robot's disc, metres.
    pub robot_radius_m: f64,
    /// Radius of the handler's disc, metres.
    pub handler_radius_m: f64,
    /// How the handler follows beside the robot.
    pub model: InteractionModel,
    /// How they follow behind it, in single file; none: no passage is too narrow to be told.
    pub behind: Option<InteractionModel>,
    /// The share of its speed at which the robot makes its motions in single file.
    pub behind_speed: f64,
    /// Beams that end this near to the predicted handler are taken to end on the handler, metres.
    pub handler_mask_m: f64,
    /// What was seen is remembered for so long, seconds.
    pub memory_s: f64,
    /// What only the camera saw, but often, is remembered for so long, seconds: glass, for example.
    pub memory_often_s: f64,
    /// Room that is kept beyond what the shield demands, metres; two sigma of the lidar come on top.
    pub reserve_m: f64,
    /// Whether the robot speaks. It says so before it steps back, and asks the handler to walk elsewhere.
    pub speaks: bool,
    /// How the shield judges; none: the engine does not ask it.
    pub shield: Option<ShieldConfig>,
}

impl Default for GeometricConfig {
    fn default() -> Self {
        Self {
            dt_s: 0.5,
            robot_radius_m: 0.30,
            handler_radius_m: 0.25,
            model: DelayedHarness::default().into(),
            behind: None,
            behind_speed: 1.0,
            handler_mask_m: 0.40,
            memory_s: 10.0,
            memory_often_s: 60.0,
            reserve_m: 0.04,
            speaks: false,
            shield: None,
        }
    }
}

impl GeometricConfig {
    /// The team of a run.
    ///
    /// # Errors
    /// Where the handler's parameters are no handler's.
    pub fn of(settings: &Settings) -> Result<Self, HarnessError> {
        let [beside, behind] = Formation::ALL.map(|place| settings.interaction_in(place));
        let (beside, behind) = (beside?, behind?);
        let [there, here] = [&beside, &behind].map(|model| model.robot_from_default().translation.vector);
        // A handler behind the robot has to be seen there, told from one beside it, and have room. At a rod they walk
        // behind it already.
        let sees_behind = settings.lidar.field_of_view_deg.get() >= 360.0;
        let has_room = here.norm() >= settings.robot.radius_m.get() + settings.handler.radius_m.get();
        let walks_in_single_file = sees_behind && has_room && (there - here).norm() >= PLACES_APART_M;
        Ok(Self {
            dt_s: settings.policy.dt.s(),
            robot_radius_m: settings.robot.radius_m.get() + settings.shield.margin_m,
            handler_radius_m: settings.handler.radius_m.get() + settings.shield.margin_m,
            model: beside,
            behind: walks_in_single_file.then_some(behind),
            behind_speed: settings.speed_in(Formation::Behind),
            speaks: settings.speak.on,
            shield: Some(settings.shield_config()),
            ..Self::default()
        })
    }
}

/// What one decision is made from.
#[derive(Debug, Clone, Copy)]
pub struct Observation<'a> {
    /// Stands beside the ranges.
    pub scan: &'a ScanHeader,
    /// The lidar's readings, metres; see [`messages::LidarScan`].
    pub ranges: &'a [f32],
    /// Obstacles that the camera saw, robot frame, metres; empty where there is no camera. Where `shield` has a frame
    /// of the camera, they are that frame's.
    pub obstacles: &'a [Point],
    /// What the shield judges on, if there is one: it tells where the floor ends, and where it was not seen.
    pub shield: Option<(Evidence<'a>, HandlerBody)>,
    /// Where the handler is taken to be, robot frame; none: the engine's own model tells.
    pub handler: Option<Point>,
    /// The robot in the odometry frame, when the scan was taken.
    pub odom_from_robot: Pose2,
    /// Which life of the odometry that frame belongs to; another one voids the memory.
    pub odometry_incarnation: u32,
    /// The robot in the cue's start frame: x is the direction of travel when the cue was given.
    pub start_from_robot: Pose2,
    /// The cue in force; stop where there is none.
    pub cue: CueKind,
    /// Whether the cue in force is another one than at the last decision.
    pub cue_is_new: bool,
    /// Where the handler walks.
    pub formation: Formation,
}

/// The geometric policy. Call [`decide`](Self::decide) once in each decision period.
#[derive(Debug)]
pub struct GeometricEngine {
    config: GeometricConfig,
    /// The actions as they are made beside the handler, and as they are made in the formation in force.
    table_beside: ActionTable,
    table: ActionTable,
    team: Team,
    forming: Forming,
    memory: Memory,
    odometry_incarnation: Option<u32>,
    odom_from_robot: Se2,
    robot_from_handler: Se2,
    last_motion: Se2,
    history: VecDeque<Se2>,
    trail: Trail,
    unrest: f64,
    backed: Backed,
    route: Option<Route>,
    cue: CueKind,
    plan: Plan,
    shield: Option<Shield>,
    judgements: Vec<Judgement>,
}

impl GeometricEngine {
    /// An engine for that team and that action table.
    #[must_use]
    pub fn new(config: GeometricConfig, table: ActionTable) -> Self {
        let team = Team::beside(&config);
        let shield = config.shield.clone().map(Shield::new);
        let decisions = |time_s: f64| (time_s / config.dt_s).clamp(1.0, 1000.0) as u64;
        let memory = Memory::new(decisions(config.memory_s));
        let memory = memory.with_camera_kept(decisions(config.memory_s), decisions(config.memory_often_s));
        Self {
            robot_from_handler: team.robot_from_handler(),
            team,
            forming: Forming::default(),
            memory,
            config,
            table_beside: table.clone(),
            table,
            odometry_incarnation: None,
            odom_from_robot: Se2::identity(),
            last_motion: Se2::identity(),
            history: VecDeque::new(),
            trail: Trail::default(),
            unrest: 1.0,
            backed: Backed::default(),
            route: None,
            cue: CueKind::Stop,
            plan: Plan::Stand,
            shield,
            judgements: Vec::new(),
        }
    }

    /// Probabilities over the action table: nearly all on the best action, a little on the others in order of merit.
    /// One-hot on stop where there is no cue, nothing is seen, or the way has ended ([`plan`](Self::plan) says which).
    pub fn decide(&mut self, observation: &Observation) -> [f32; MAX_ACTIONS] {
        match self.costs_m(observation).filter(|_| self.asks_for().is_none()) {
            Some(costs_m) => probabilities(&costs_m),
            None => one_hot_stop(),
        }
    }

    /// What the last decision was about.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.plan
    }

    /// Where the engine takes the handler to be, robot frame.
    #[must_use]
    pub fn robot_from_handler(&self) -> Pose2 {
        pose2(&self.robot_from_handler)
    }

    /// Of the probabilities that are proposed those that lead on ahead, or turn to the side that the cue asks for, and
    /// leave some room. Nearly all of the others goes to stop: where the shield forbids to stand, what is left tells
    /// the way out.
    pub(crate) fn onward(&self, proposed: &[f32; MAX_ACTIONS]) -> [f32; MAX_ACTIONS] {
        let mut onward = [0.0; MAX_ACTIONS];
        let side = guidance::cue::target_yaw_rad(self.cue);
        for (i, action) in self.table.actions().iter().enumerate() {
            let motion = action.start_from_end();
            let leads_on = motion.translation.x > ONWARD_M || side * motion.rotation.angle() > 0.0;
            let is_tight = self.judgements.get(i).is_some_and(|judged| tight_m(judged) > 0.0);
            if i != ActionTable::STOP {
                onward[i] = proposed[i] * if leads_on && !is_tight { 1.0 } else { ASIDE_SHARE };
            }
        }
        onward[ActionTable::STOP] = (1.0 - onward.iter().sum::<f32>()).max(0.0);
        onward
    }

    /// The cost of each action, metres: to the goal, by the best way that begins with it. An action without such a way
    /// costs more than to stop, and what the shield forbids costs more than that; a wedged team's way out costs less.
    /// Infinite for an action that does not exist. `None`: stand.
    pub fn costs_m(&mut self, observation: &Observation) -> Option<[f64; MAX_ACTIONS]> {
        self.plan = Plan::Blind;
        if observation.cue_is_new {
            self.forming.rest();
        }
        if !believable(&observation.odom_from_robot) || !believable(&observation.start_from_robot) {
            return None;
        }
        self.take_formation(observation.formation);
        self.take_pose(observation);
        let handler = Point::from(self.robot_from_handler.translation.vector);
        let beams = Beams::read(observation.scan, observation.ranges, handler, self.config.handler_mask_m)?;
        let (depth, remembered) =
            observation.shield.map_or((None, None), |(evidence, _)| (evidence.depth, evidence.memory));
        self.memory.update(&self.odom_from_robot, &beams, observation.obstacles, depth, Some(handler));
        if let Some(remembered) = remembered {
            let edges = remembered.edges().iter().map(|edge| edge.place);
            self.memory.block(&self.odom_from_robot, edges.chain(remembered.beyond_edges()));
        }
        self.take_cue(observation);
        if self.cue == CueKind::Stop {
            self.forming.rest();
            self.plan = Plan::Stand;
            return None;
        }
        let odom_from_robot = self.odom_from_robot;
        let place = Point::from(odom_from_robot.translation.vector);
        let hidden = remembered.map_or(&[][..], guidance::Memory::hidden);
        let hidden = hidden.iter().map(|hidden| odom_from_robot * hidden.place);
        let mut window = self.memory.window(place, self.team.width().fits_m, hidden);
        let odom_from_start = odom_from_robot * guidance::se2::se2(observation.start_from_robot).inverse();
        self.ask_shield(observation);
        let route = self.route.get_or_insert_with(|| Route::new(odom_from_start.rotation.angle()));
        let cue_place = Point::from(odom_from_start.translation.vector);
        let seen = Seen { window: &window, odom_from_robot: &odom_from_robot, trail: &self.trail };
        let goal = route.goal(&seen, &beams.hits, self.cue, cue_place);
        self.plan = goal.plan;
        if goal.seeds.is_empty() {
            self.consider_room_beside(&mut window, true);
            self.consider_single_file(&mut window, true);
            return None;
        }
        let cost = CostToGo::spread(&window, &goal.seeds, place);
        let way = cost.downhill(&window, place, 3.0) - place;
        route.way_rad = (goal.plan == Plan::Follow && way.norm() > 1.5).then(|| way.y.atan2(way.x));
        self.consider_room_beside(&mut window, false);
        let mut costs = self.weigh(&window, &cost, goal.facing_rad, &beams, remembered);
        // What leads over floor that was not seen comes last: another action looks there first.
        for (cost, judged) in costs.iter_mut().zip(&self.judgements) {
            *cost += if judged.cause == UnsafeCause::FloorUnseen { UNSEEN_M } else { tight_m(judged) };
        }
        let is_held = costs.iter().all(|cost_m| *cost_m >= costs[ActionTable::STOP]);
        self.consider_single_file(&mut window, is_held);
        Some(costs)
    }

    /// Asks the shield of each action. Without a shield there are no judgements.
    fn ask_shield(&mut self, observation: &Observation) {
        self.judgements.clear();
        let Some((shield, (evidence, body))) = self.shield.as_mut().zip(observation.shield) else { return };
        let (team, robot_from_handler) = (&self.team, &self.robot_from_handler);
        let motions = self.table.actions().iter().map(|action| {
            let motion = action.start_from_end();
            Motion::new(motion, motion * team.follow(&motion, robot_from_handler))
        });
        shield.judge_motions(motions, evidence, body, &mut self.judgements);
    }

    /// Moves the handler and the history along with the robot's pose.
    fn take_pose(&mut self, observation: &Observation) {
        let odom_from_robot = guidance::se2::se2(observation.odom_from_robot);
        if self.odometry_incarnation == Some(observation.odometry_incarnation) {
            self.last_motion = self.odom_from_robot.inverse() * odom_from_robot;
            self.robot_from_handler = self.team.follow(&self.last_motion, &self.robot_from_handler);
        } else {
            self.odometry_incarnation = Some(observation.odometry_incarnation);
            self.memory.clear();
            self.history.clear();
            self.trail.clear();
            self.route = None;
            self.last_motion = Se2::identity();
            self.robot_from_handler = self.team.robot_from_handler();
            self.unrest = 1.0;
            self.backed = Backed::default();
            self.forming.lose_place();
        }
        if let Some(handler) = observation.handler {
            self.robot_from_handler.translation.vector = handler.coords;
        }
        self.odom_from_robot = odom_from_robot;
        self.backed.take(&odom_from_robot, &self.last_motion, self.speed());
        self.trail.take(&odom_from_robot);
        self.history.push_back(odom_from_robot);
        if self.history.len() > HISTORY {
            self.history.pop_front();
        }
        self.unrest =
            if self.to_and_fro() { (self.unrest * 2.0).min(UNREST_MAX) } else { (self.unrest / 2.0).max(1.0) };
    }

    fn take_cue(&mut self, observation: &Observation) {
        if observation.cue_is_new || observation.cue != self.cue {
            let start_rad =
                (self.odom_from_robot * guidance::se2::se2(observation.start_from_robot).inverse()).rotation.angle();
            let was_turn = matches!(self.cue, CueKind::Left | CueKind::Right);
            let goes_on = was_turn && observation.cue == CueKind::Forward;
            self.route = self.route.take().filter(|route| goes_on && route.turns_to(start_rad));
            if self.trail.heading_rad().is_some_and(|came_rad| wrap_angle(start_rad - came_rad).abs() > BACK_RAD) {
                self.trail.clear();
            }
            self.history.clear();
        }
        self.cue = observation.cue;
    }

    /// Whether the team is where it was some seconds ago.
    fn gets_nowhere(&self) -> bool {
        let (Some(first), Some(last)) = (self.history.front(), self.history.back()) else { return false };
        self.history.len() == HISTORY && (first.inverse() * last).translation.vector.norm() < NOWHERE_M
    }

    /// Whether the team has moved for some seconds and got nowhere.
    fn to_and_fro(&self) -> bool {
        let (Some(first), Some(last)) = (self.history.front(), self.history.back()) else { return false };
        if self.history.len() < HISTORY {
            return false;
        }
        let size = |motion: Se2| motion.translation.vector.norm() + 0.8 * motion.rotation.angle().abs();
        let walked: f64 =
            self.history.iter().zip(self.history.iter().skip(1)).map(|(a, b)| size(a.inverse() * b)).sum();
        walked > 0.6 * self.speed() && size(first.inverse() * last) < 0.3 * walked
    }

    /// The cost of each action: by the look ahead where it leaves room, behind all of those where it does not. Where
    /// no action that leaves the room that is wished for gets the team on, the look ahead is content with what the
    /// shield demands. Where there is no way even then, what does not take room away is better than to stop.
    fn weigh(
        &self,
        window: &Window,
        cost: &CostToGo,
        facing_rad: f64,
        beams: &Beams,
        memory: Option<&guidance::Memory>,
    ) -> [f64; MAX_ACTIONS] {
        let robot_from_odom = self.odom_from_robot.inverse();
        let floor = memory.map(|memory| SeenFloor { memory, robot_from_odom });
        let scene_with = |reserve_m: f64| Scene {
            window,
            cost,
            facing_rad,
            team: &self.team,
            table: &self.table,
            reserve_m,
            last_motion: self.last_motion,
            unrest: self.unrest,
            speed: self.speed(),
            floor,
        };
        let worth_with = |reserve_m| scene_with(reserve_m).worth(&self.odom_from_robot, &self.robot_from_handler);
        let margins_m = self.margins_m(window);
        // Before an edge or a step the robot waits, and the handler is told. That only happens where the policy wants
        // to go on. Without a shield, the obstacles that are known decide.
        let leads_back = |action: usize| self.table.actions()[action].leads_back();
        let is_forbidden = |action: usize| {
            let forbids = |judged: &Judgement| !judged.safe && (leads_back(action) || !judged.cause.is_edge());
            self.judgements.get(action).map_or(margins_m[action] <= 0.0, forbids)
        };
        let has_way = |worth: &[Option<f64>]| {
            let mut ways = worth.iter().enumerate().filter(|(_, worth)| worth.is_some());
            ways.any(|(action, _)| !is_forbidden(action) && !leads_back(action))
        };
        let wished = worth_with(self.config.reserve_m + 2.0 * beams.sigma_m);
        let here_m = scene_with(0.0).cost_m(&self.odom_from_robot);
        let gets_on = |worth: &[Option<f64>]| {
            let gets_on = |action: usize, cost_m: f64| cost_m < here_m && !is_forbidden(action) && !leads_back(action);
            let mut ways = worth.iter().enumerate();
            // Shortly before the goal nothing gets it on.
            here_m < AT_GOAL_M || ways.any(|(action, worth)| worth.is_some_and(|cost_m| gets_on(action, cost_m)))
        };
        let worth = if has_way(&wished) && gets_on(&wished) { wished } else { cheaper(wished, worth_with(0.0)) };
        let is_wedged = !has_way(&worth);
        let may_back = self.config.speaks && !gets_on(&worth) && self.backed.may_step();
        let mut costs = [f64::INFINITY; MAX_ACTIONS];
        for (action, worth) in worth.into_iter().enumerate() {
            costs[action] = match worth {
                _ if action == ActionTable::STOP => STOP_M,
                _ if is_forbidden(action) => UNSAFE_M - margins_m[action],
                _ if leads_back(action) && !may_back => 2.0 * STOP_M,
                Some(cost_m) => cost_m,
                None if is_wedged => self.way_out(window, action),
                // The roomier, the sooner.
                None => 2.0 * STOP_M - margins_m[action],
            };
        }
        costs
    }

    /// The cost of an action of a team that is wedged: less than to stop where it takes no room away, and the less, the
    /// more room it makes.
    fn way_out(&self, window: &Window, action: usize) -> f64 {
        let (robot, handler) = (&self.odom_from_robot, &self.robot_from_handler);
        let motion = self.table.actions()[action].start_from_end();
        let room_m = |robot: &Se2, handler: &Se2| self.team.room_m(window, &self.team.discs(robot, handler));
        let (before_m, after_m) =
            (room_m(robot, handler), room_m(&(robot * motion), &self.team.follow(&motion, handler)));
        if after_m > before_m - SAME_ROOM_M { STOP_M - WAY_OUT_M - after_m } else { 2.0 * STOP_M - after_m }
    }

    /// For each action, the room that the shield would find, metres: from its hull to the nearest obstacle known.
    fn margins_m(&self, window: &Window) -> Vec<f64> {
        let robot_from_odom = self.odom_from_robot.inverse();
        let near: Vec<Point> =
            window.hits.iter().map(|hit| robot_from_odom * hit).filter(|hit| hit.coords.norm() < NEAR_M).collect();
        let before = self.team.discs(&Se2::identity(), &self.robot_from_handler);
        let margin_m = |action: &guidance::Action| {
            let motion = action.start_from_end();
            let after = self.team.discs(&motion, &self.team.follow(&motion, &self.robot_from_handler));
            let hull = Team::hull(&before, &after);
            near.iter().fold(NEAR_M, |least_m, hit| hull.nearer_m(*hit, least_m).unwrap_or(least_m))
        };
        self.table.actions().iter().map(margin_m).collect()
    }
}

/// Probabilities of costs: nearly all for the least cost; the rest halves from rank to rank. Sums to 1.
pub(crate) fn probabilities(costs: &[f64; MAX_ACTIONS]) -> [f32; MAX_ACTIONS] {
    let mut ranked: Vec<usize> = (0..MAX_ACTIONS).filter(|action| costs[*action].is_finite()).collect();
    ranked.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]));
    let mut shares = [0.0_f32; MAX_ACTIONS];
    let mut left = REST_SHARE;
    for action in ranked.iter().skip(1) {
        left /= 2.0;
        shares[*action] = left as f32;
    }
    if let Some(best) = ranked.first() {
        shares[*best] = 1.0 - shares.iter().sum::<f32>();
    }
    shares
}

/// For each action, the less of two costs.
fn cheaper(one: Vec<Option<f64>>, other: Vec<Option<f64>>) -> Vec<Option<f64>> {
    let less = |(one, other): (Option<f64>, Option<f64>)| one.into_iter().chain(other).reduce(f64::min);
    one.into_iter().zip(other).map(less).collect()
}

/// Whether the pose is finite and within the reach of any robot.
fn believable(pose: &Pose2) -> bool {
    pose.is_finite() && pose.x_m.abs() < POSE_MAX_M && pose.y_m.abs() < POSE_MAX_M
}

fn one_hot_stop() -> [f32; MAX_ACTIONS] {
    let mut shares = [0.0; MAX_ACTIONS];
    shares[ActionTable::STOP] = 1.0;
    shares
}

/// What an action costs that the shield allows and that leaves little beside its margin, metres.
fn tight_m(judged: &guidance::Judgement) -> f64 {
    let [most_m, within_m] = TIGHT_M;
    if judged.safe { most_m * (1.0 - judged.margin_m / within_m).clamp(0.0, 1.0) } else { 0.0 }
}
