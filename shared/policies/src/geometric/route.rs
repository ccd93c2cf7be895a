//! Which way the cue means here: along the corridor, round its bend, into an opening, or nowhere.

use super::field::reachable;
use super::grid::{CELL_M, Window};
use super::openings::{Opening, Profile, Side};
use super::trail::Trail;
use super::travel::TravelLine;
use guidance::Se2;
use guidance::se2::{Point, wrap_angle};
use messages::CueKind;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// How far ahead the goal may lie, metres.
const GOAL_M: f64 = 7.0;
/// Way ahead under which the corridor may be about to bend or end, metres.
const NEAR_END_M: f64 = 2.5;
/// The corridor goes on round a bend where an opening ends within this of its end, metres.
const AT_END_M: f64 = 1.0;
/// Number of decisions that find a bend before the team takes it: a person who crosses is not the corridor's end.
const BEND_SURE: u32 = 4;
/// And where the cue asks for the other side.
const BEND_SURE_ASIDE: u32 = 8;
/// Way ahead under which the corridor is at its end, metres.
const END_M: f64 = 0.4;
/// Way ahead over which an end was none after all, metres.
const NOT_END_M: f64 = 0.9;
/// An opening is turned into once it begins within this, metres: farther ones may have nearer ones before them.
const COMMIT_M: f64 = 2.0;
/// A cue may come this late: the opening's end and middle behind the place of the cue, metres.
const LATE_END_M: f64 = 0.5;
const LATE_MIDDLE_M: f64 = 1.6;
/// How far beyond the wall the goal in an opening begins and ends, metres. With the team's clearance it is at
/// least 1.3 m deep.
const INTO_M: (f64, f64) = (0.8, 3.0);
/// An opening may lead away at a slant: its goal widens by this much each metre beyond the wall.
const SLANT: f64 = 0.5;
/// The longest way that the team goes back, metres; on the way into an opening it may be longer.
const BEHIND_M: f64 = 1.8;
const TURN_BEHIND_M: f64 = 3.0;
/// A wall that was not seen yet is taken to be so far away, metres.
const UNSEEN_WALL_M: f64 = 1.0;
/// Where the travel line itself is open so far ahead, metres, no planned way tells another direction of travel: it
/// leads round something, or through an open space beside the corridor.
const STRAIGHT_M: f64 = 4.0;
/// What a metre beside the travel line costs in metres ahead: where the line bends off, and where it is open.
const ASIDE: f64 = 0.3;
const ASIDE_OF_OPEN_LINE: f64 = 1.0;
/// The line is open as far as anything ahead where it lacks no more than this, metres.
const AS_FAR_M: f64 = 1.0;
/// Half the width of what counts as the line itself, metres.
const STRAIGHT_HALF_M: f64 = 0.3;
/// Decisions without a way after which a chosen opening is given up.
const LOST_COUNT: u32 = 6;

/// What the engine is doing, for reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Plan {
    /// No cue, or stop.
    #[default]
    Stand,
    /// No usable scan or pose: standing.
    Blind,
    /// Along the corridor.
    Follow,
    /// Into the opening that the cue asked for.
    Turn,
    /// Round the corridor's only way on.
    Bend,
    /// Standing: the corridor ends or is blocked, and there is no opening of the side asked for.
    End,
    /// Standing: the corridor ends and there is more than one way on; the handler must choose.
    Junction,
}

/// The plan with its goal: cells of the window with the cost there. No cells: stand.
#[derive(Debug)]
pub struct Goal {
    /// What is being done.
    pub plan: Plan,
    /// Cells and costs, metres.
    pub seeds: Vec<(usize, f64)>,
    /// Where to face at the goal, radians, odometry frame.
    pub facing_rad: f64,
}

/// An opening chosen.
#[derive(Debug, Clone, Copy)]
struct Branch {
    /// On the travel line in the opening's middle, x into it.
    odom_from_branch: Se2,
    wall_m: f64,
    half_width_m: f64,
    plan: Plan,
    lost: u32,
}

impl Branch {
    /// Whether the team faces into it.
    fn is_ahead(&self, odom_from_robot: &Se2) -> bool {
        let off_rad = self.odom_from_branch.rotation.angle() - odom_from_robot.rotation.angle();
        wrap_angle(off_rad).abs() < FRAC_PI_4
    }

    /// Whether the team has turned into it.
    fn is_round(&self, odom_from_robot: &Se2) -> bool {
        self.is_ahead(odom_from_robot) && self.is_entered(odom_from_robot)
    }

    /// A team that faces a bend has entered it. An opening that it turned into is entered between its walls.
    fn is_entered(&self, odom_from_robot: &Se2) -> bool {
        let robot = self.odom_from_branch.inverse() * Point::from(odom_from_robot.translation.vector);
        self.plan != Plan::Turn || robot.x > self.wall_m
    }
}

/// What is remembered of the way from decision to decision.
#[derive(Debug)]
pub struct Route {
    line: TravelLine,
    branch: Option<Branch>,
    /// How far the walls are to the left and to the right, metres, as last seen.
    wall_m: [Option<f64>; 2],
    ended: bool,
    /// How far the way went straight on ahead at the last decision, metres.
    straight_m: f64,
    /// An opening of the side asked for was found: the way behind a turn is the next cue's.
    turned: bool,
    /// Number of decisions that found a bend to that side.
    bends: (u32, Side),
    /// Where the way led at the last decision, radians, odometry frame.
    pub way_rad: Option<f64>,
}

/// What a decision goes by.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// What is known of the surroundings.
    pub window: &'a Window,
    /// Where the robot is.
    pub odom_from_robot: &'a Se2,
    /// Where it came from.
    pub trail: &'a Trail,
}

/// What is seen from the robot at one decision.
struct View<'a> {
    window: &'a Window,
    robot: &'a Se2,
    odom_from_line: Se2,
    reached: Vec<bool>,
    profiles: [Profile; 2],
    /// Way ahead along the travel line, metres.
    ahead_m: f64,
}

impl Route {
    /// A route that begins with a cue given in that direction (odometry frame).
    pub fn new(yaw_rad: f64) -> Self {
        let line = TravelLine::new(yaw_rad);
        Self {
            line,
            branch: None,
            wall_m: [None; 2],
            ended: false,
            straight_m: 0.0,
            turned: false,
            bends: (0, Side::Left),
            way_rad: None,
        }
    }

    /// Whether an opening was chosen that leads in that direction (odometry frame): half-way round, a turn counts as
    /// done, and the way goes on into the opening.
    #[must_use]
    pub fn turns_to(&self, yaw_rad: f64) -> bool {
        let turn = self.branch.filter(|branch| branch.plan == Plan::Turn);
        turn.is_some_and(|branch| wrap_angle(branch.odom_from_branch.rotation.angle() - yaw_rad).abs() < FRAC_PI_4)
    }

    /// Where to go now. `cue_place` is where the robot was when the cue was given (odometry frame), `hits` are those of
    /// the scan, in the order of its beams (robot frame).
    pub fn goal(&mut self, seen: &Seen, hits: &[Option<Point>], cue: CueKind, cue_place: Point) -> Goal {
        if self.branch.is_none() {
            let way_rad = self.way_rad.filter(|_| self.straight_m < STRAIGHT_M);
            self.line.follow(seen.odom_from_robot, hits, way_rad);
        } else {
            self.line.leave();
        }
        let view = self.view(seen);
        self.take_walls(&view);
        self.straight_m = view.straight_m();
        let had_branch = self.branch.is_some();
        let goal = match cue {
            CueKind::Stop => None,
            CueKind::Forward => self.bend(&view, None),
            CueKind::Left => self.turn_or_bend(&view, Side::Left, cue_place),
            CueKind::Right => self.turn_or_bend(&view, Side::Right, cue_place),
        };
        goal.unwrap_or_else(|| {
            // Behind a bend the travel line is another one.
            let is_round = had_branch && self.branch.is_none();
            let view = if is_round { self.view(seen) } else { view };
            self.along(&view, cue)
        })
    }

    fn wall_m(&self, side: Side) -> f64 {
        self.wall_m[side as usize].unwrap_or(UNSEEN_WALL_M)
    }

    /// How far the way goes on ahead from the robot, along the travel line, metres.
    pub fn ahead_m(&self, seen: &Seen) -> f64 {
        self.view(seen).ahead_m
    }

    fn view<'a>(&self, seen: &Seen<'a>) -> View<'a> {
        let Seen { window, odom_from_robot: robot, trail } = *seen;
        let odom_from_line = Se2::new(robot.translation.vector, self.line.yaw_rad);
        let line_from_odom = odom_from_line.inverse();
        let behind_m = if self.branch.is_some() { TURN_BEHIND_M } else { BEHIND_M };
        let back = trail.behind(behind_m);
        let is_ahead = |place: Point| (line_from_odom * place).x > -behind_m && !back.contains(place);
        let reached = reachable(window, Point::from(robot.translation.vector), is_ahead);
        let profiles = [Side::Left, Side::Right].map(|side| Profile::look(window, &odom_from_line, side));
        let ahead_m = forward_cells(window, &reached, &odom_from_line).map(|(_, at)| at.x).fold(0.0, f64::max);
        View { window, robot, odom_from_line, reached, profiles, ahead_m }
    }

    fn take_walls(&mut self, view: &View) {
        for (wall_m, profile) in self.wall_m.iter_mut().zip(&view.profiles) {
            *wall_m = profile.wall_m(*wall_m).or(*wall_m);
        }
    }

    /// Along the corridor as far as it is seen; stands at its end.
    fn along(&mut self, view: &View, cue: CueKind) -> Goal {
        let end_m = if self.ended { NOT_END_M } else { END_M };
        self.ended = view.ahead_m < end_m;
        let facing_rad = self.line.yaw_rad;
        if self.ended {
            let ways = [Side::Left, Side::Right].map(|side| self.opening_at_end(view, side, NEAR_END_M).is_some());
            let plan = if cue == CueKind::Forward && ways == [true; 2] { Plan::Junction } else { Plan::End };
            return Goal { plan, seeds: Vec::new(), facing_rad };
        }
        // Where the line is open as far as anything, what lies beside it is not ahead: it may be another room, behind
        // the corridor's wall.
        let is_open = self.straight_m >= STRAIGHT_M.max(view.ahead_m - AS_FAR_M);
        let aside = if is_open { ASIDE_OF_OPEN_LINE } else { ASIDE };
        let score = |at: Point| at.x - aside * at.y.abs();
        let cells = || forward_cells(view.window, &view.reached, &view.odom_from_line);
        let best = cells().map(|(_, at)| score(at)).fold(f64::NEG_INFINITY, f64::max);
        let seeds = cells().map(|(cell, at)| (cell, best - score(at))).filter(|(_, cost)| *cost < 0.6).collect();
        Goal { plan: Plan::Follow, seeds, facing_rad }
    }

    /// Turns into the next opening of that side. Where there is none, the team goes round the corridor's bend to the
    /// other side: the opening may come behind it.
    fn turn_or_bend(&mut self, view: &View, side: Side, cue_place: Point) -> Option<Goal> {
        let bend = self.branch.filter(|branch| branch.plan == Plan::Bend);
        if bend.is_some_and(|bend| bend.is_round(view.robot)) {
            return self.bend(view, None);
        }
        // On the way to a bend the opening may still be found: a person who stood in it may have left.
        if bend.is_some() {
            self.branch = None;
        }
        let turn = self.turn(view, side, cue_place);
        if turn.is_some() {
            self.turned = true;
            return turn;
        }
        self.branch = self.branch.or(bend);
        if self.turned { None } else { self.bend(view, Some(side.other())) }
    }

    /// Round the only way on, where the corridor is about to end with one, on that side alone where one is named.
    fn bend(&mut self, view: &View, only: Option<Side>) -> Option<Goal> {
        if let Some(branch) = self.branch {
            let goal = if branch.is_round(view.robot) { None } else { self.seek_branch(view) };
            if goal.is_none() && (branch.is_ahead(view.robot) || self.branch.is_none()) {
                *self = Self::new(branch.odom_from_branch.rotation.angle());
            }
            return goal;
        }
        // A turn was asked for: the wall of its side has to be seen, as a person may stand in an opening there.
        let is_at_end = only.is_none() && view.ahead_m < END_M;
        let seen = self.bend_ahead(view).filter(|(side, _)| {
            only.is_none_or(|only| only == *side) && (is_at_end || self.is_shut(view, side.other()))
        });
        self.bends = match &seen {
            Some((side, _)) if self.bends.1 == *side => (self.bends.0 + 1, *side),
            Some((side, _)) => (1, *side),
            None => (0, self.bends.1),
        };
        let sure = if only.is_some() { BEND_SURE_ASIDE } else { BEND_SURE };
        let (side, opening) = seen.filter(|_| self.bends.0 >= sure)?;
        self.branch = Some(branch(view, side, &opening, Plan::Bend));
        self.seek_branch(view)
    }

    /// The opening that is the corridor's only way on, where the corridor is about to end.
    fn bend_ahead(&self, view: &View) -> Option<(Side, Opening)> {
        if view.ahead_m >= NEAR_END_M {
            return None;
        }
        let find = |slack_m| [Side::Left, Side::Right].map(|side| self.opening_at_end(view, side, slack_m));
        match (find(AT_END_M), find(NEAR_END_M)) {
            ([Some(opening), None], [_, None]) => Some((Side::Left, opening)),
            ([None, Some(opening)], [None, _]) => Some((Side::Right, opening)),
            _ => None,
        }
    }

    /// Whether a wall is seen on that side as far as the corridor goes on.
    fn is_shut(&self, view: &View, side: Side) -> bool {
        view.profiles[side as usize].closed(-0.3, view.ahead_m + view.window.fits_m, self.wall_m(side))
    }

    /// Into the next opening of that side, once it is near.
    fn turn(&mut self, view: &View, side: Side, cue_place: Point) -> Option<Goal> {
        let since_cue_m = -(view.odom_from_line.inverse() * cue_place).x;
        let openings = view.profiles[side as usize].openings(self.wall_m(side));
        let not_passed = |opening: &Opening| {
            opening.end_m + since_cue_m > -LATE_END_M && opening.middle_m() + since_cue_m > -LATE_MIDDLE_M
        };
        let far = |opening: &Opening| {
            let middle_m = opening.middle_m();
            if middle_m >= 0.0 { middle_m } else { 1.0 - 2.0 * middle_m }
        };
        let nearest = openings
            .into_iter()
            .filter(|opening| not_passed(opening) && opening.begin_m < COMMIT_M && view.reaches(side, opening))
            .min_by(|a, b| far(a).total_cmp(&far(b)));
        if let Some(opening) = nearest {
            let found = branch(view, side, &opening, Plan::Turn);
            let gap =
                |old: &Branch| (old.odom_from_branch.inverse() * found.odom_from_branch).translation.vector.norm();
            // What has been chosen is only looked at more closely, not given up for another one.
            if self.branch.as_ref().is_none_or(|old| gap(old) < 1.0) {
                self.branch = Some(found);
            }
        }
        self.seek_branch(view)
    }

    fn seek_branch(&mut self, view: &View) -> Option<Goal> {
        let branch = self.branch.as_mut()?;
        let far_m = branch.wall_m + INTO_M.1;
        let seeds: Vec<_> = view.inside(branch).map(|(cell, deep_m)| (cell, far_m - deep_m)).collect();
        branch.lost = if seeds.is_empty() { branch.lost + 1 } else { 0 };
        let goal = Goal { plan: branch.plan, seeds, facing_rad: branch.odom_from_branch.rotation.angle() };
        if branch.lost > LOST_COUNT {
            // What was no opening after all tells nothing of the next cue.
            self.turned &= branch.is_entered(view.robot);
            self.branch = None;
        }
        (!goal.seeds.is_empty()).then_some(goal)
    }

    /// The opening of that side that ends within `slack_m` of the corridor's end, if there is one that the team can get
    /// into.
    fn opening_at_end(&self, view: &View, side: Side, slack_m: f64) -> Option<Opening> {
        let end_m = view.ahead_m + view.window.fits_m;
        let at_end = |opening: &Opening| {
            opening.end_m > end_m - slack_m && opening.begin_m < COMMIT_M && opening.middle_m() > -1.0
        };
        let openings = view.profiles[side as usize].openings(self.wall_m(side));
        openings.into_iter().rev().find(|opening| at_end(opening) && view.reaches(side, opening))
    }
}

impl View<'_> {
    /// How far the team can go on straight ahead along the line, metres.
    fn straight_m(&self) -> f64 {
        let mut is_open = [false; (GOAL_M / CELL_M) as usize];
        let ahead = forward_cells(self.window, &self.reached, &self.odom_from_line);
        for (_, at) in ahead.filter(|(_, at)| at.y.abs() < STRAIGHT_HALF_M) {
            is_open[((at.x / CELL_M) as usize).min(is_open.len() - 1)] = true;
        }
        // Cells lie at a slant to the line: one step without a middle is no gap.
        let gap = is_open.windows(2).position(|pair| pair == [false; 2]);
        gap.unwrap_or(is_open.len()) as f64 * CELL_M
    }

    /// Whether the team can get into the opening, and it is deep enough to be one.
    fn reaches(&self, side: Side, opening: &Opening) -> bool {
        let branch = branch(self, side, opening, Plan::Turn);
        let deep_m = self.inside(&branch).map(|(_, deep_m)| deep_m).fold(0.0, f64::max);
        deep_m > opening.wall_m + INTO_M.0 + 0.2
    }

    /// The reached cells that lie in the opening, with how far across the line they are, metres.
    fn inside(&self, branch: &Branch) -> impl Iterator<Item = (usize, f64)> {
        let branch_from_odom = branch.odom_from_branch.inverse();
        let (near_m, far_m) = (branch.wall_m + INTO_M.0, branch.wall_m + INTO_M.1);
        let (wall_m, half_m) = (branch.wall_m, branch.half_width_m);
        self.reached.iter().enumerate().filter(|(_, reached)| **reached).filter_map(move |(cell, _)| {
            let at = branch_from_odom * self.window.centre(cell);
            let across_m = half_m + SLANT * (at.x - wall_m).max(0.0);
            ((near_m..far_m).contains(&at.x) && at.y.abs() < across_m).then_some((cell, at.x))
        })
    }
}

fn branch(view: &View, side: Side, opening: &Opening, plan: Plan) -> Branch {
    let line_from_branch = Se2::new(nalgebra::Vector2::new(opening.middle_m(), 0.0), side.sign() * FRAC_PI_2);
    Branch {
        odom_from_branch: view.odom_from_line * line_from_branch,
        wall_m: opening.wall_m,
        half_width_m: (opening.end_m - opening.begin_m) / 2.0,
        plan,
        lost: 0,
    }
}

/// The reached cells ahead, within about 50 degrees of the travel line, with their place on it.
fn forward_cells(window: &Window, reached: &[bool], odom_from_line: &Se2) -> impl Iterator<Item = (usize, Point)> {
    let line_from_odom = odom_from_line.inverse();
    reached.iter().enumerate().filter(|(_, reached)| **reached).filter_map(move |(cell, _)| {
        let at = line_from_odom * window.centre(cell);
        (at.x > 0.0 && at.x < GOAL_M && at.y.abs() < 0.3 + 1.2 * at.x).then_some((cell, at))
    })
}
