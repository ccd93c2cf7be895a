//! Side by side, or in single file: where the way ends for the team as it walks, and goes on for the other formation.

use guidance::se2::Point;
use guidance::{Interaction, InteractionModel, Se2};
use messages::{CueKind, Formation};

use super::GeometricEngine;
use super::grid::Window;
use super::route::Seen;
use super::team::Team;

/// The way goes on so much farther in single file, metres.
const FARTHER_M: f64 = 1.0;
/// Number of decisions that find it so before the engine asks: two seconds. Without a voice the team tries for ten
/// seconds before it stands. As many decisions, or four, that find it otherwise end the question.
const SURE: u32 = 4;
const SURE_SILENT: u32 = 20;
/// Beside the robot there is room again where the team has come so far in single file, and so far ahead, metres.
const CAME_M: f64 = 1.0;
const AHEAD_M: f64 = 2.0;
/// The handler comes from behind to the side through so many places.
const PLACES: usize = 4;

/// What the engine makes of the formation in force.
#[derive(Debug, Clone, Copy, Default)]
pub struct Forming {
    formation: Formation,
    /// Number of decisions that found another formation better, less those that did not.
    found: u32,
    asks: bool,
    /// Where the formation began (odometry frame).
    began: Option<Point>,
}

impl Forming {
    /// The formation that is asked for, if another one than that in force.
    pub fn asks_for(&self) -> Option<Formation> {
        self.asks.then_some(match self.formation {
            Formation::Beside => Formation::Behind,
            Formation::Behind => Formation::Beside,
        })
    }

    /// Asks for nothing.
    pub fn rest(&mut self) {
        (self.found, self.asks) = (0, false);
    }

    /// What a decision finds. A question that `lasts` stands until the handler answers it by a cue.
    fn find(&mut self, other_is_better: bool, speaks: bool, lasts: bool) {
        let sure = if speaks { SURE } else { SURE_SILENT };
        self.found = match other_is_better {
            true => (self.found + 1).min(sure),
            false => self.found.saturating_sub(sure / SURE),
        };
        self.asks = self.found == sure || self.asks && (lasts || self.found > 0);
    }

    /// Places of another odometry frame mean nothing in this one.
    pub fn lose_place(&mut self) {
        self.began = None;
        self.rest();
    }
}

impl GeometricEngine {
    /// The formation that the engine asks for, if another one than that in force.
    #[must_use]
    pub fn asks_for(&self) -> Option<Formation> {
        self.forming.asks_for()
    }

    pub(super) fn take_formation(&mut self, formation: Formation) {
        if self.forming.formation == formation {
            return;
        }
        (self.team, self.table) = match (&self.config.behind, formation) {
            (Some(model), Formation::Behind) => {
                (Team::behind(&self.config, model), self.table_beside.slowed(self.config.behind_speed))
            }
            _ => (Team::beside(&self.config), self.table_beside.clone()),
        };
        if let Some(shield) = &mut self.shield {
            shield.take_place(self.team.model());
        }
        self.robot_from_handler = self.team.robot_from_handler();
        self.forming = Forming { formation, ..Forming::default() };
    }

    /// Another handler, who follows by that model beside the robot.
    pub fn take_handler(&mut self, model: &InteractionModel) {
        self.config.model = model.clone();
        if self.forming.formation == Formation::Beside {
            self.team = Team::beside(&self.config);
            self.robot_from_handler = self.team.robot_from_handler();
            self.shield.iter_mut().for_each(|shield| shield.take_place(model));
        }
    }

    /// Whether a team that is held side by side would get on in single file, under the cue *forward*: its way goes on
    /// much farther, or the team gets nowhere in a place that is too narrow for it.
    pub(super) fn consider_single_file(&mut self, window: &mut Window, is_held: bool) {
        if self.forming.formation != Formation::Beside {
            return;
        }
        let Some(model) = self.config.behind.as_ref().filter(|_| self.cue == CueKind::Forward) else { return };
        let (beside_fits_m, file_fits_m) = (window.fits_m, Team::behind(&self.config, model).width().fits_m);
        // The robot may face off the way, so that a wall is behind it. Once asked, the handler is there.
        let has_room_behind = self.forming.asks || self.has_room_behind(window, &model.robot_from_default());
        let is_jammed =
            self.gets_nowhere() && window.clearance_at(self.team.middle(&self.odom_from_robot)) < beside_fits_m;
        // Once asked, the team no longer tries.
        let is_narrow = has_room_behind && (is_held || is_jammed || self.forming.asks) && {
            let beside_m = if is_jammed { 0.0 } else { self.ahead_m(window, beside_fits_m) };
            self.ahead_m(window, file_fits_m) > beside_m + FARTHER_M
        };
        self.forming.find(is_narrow, self.config.speaks, false);
    }

    /// Whether there is room for the handler from behind the robot to their place there.
    fn has_room_behind(&self, window: &Window, robot_from_behind: &Se2) -> bool {
        let to = robot_from_behind.translation.vector;
        let from_m = self.config.robot_radius_m + self.config.handler_radius_m;
        let first = (from_m / to.norm()).min(1.0);
        (0..=PLACES).all(|place| {
            let share = first + (1.0 - first) * place as f64 / PLACES as f64;
            let at = self.odom_from_robot * Point::from(to * share);
            window.clearance_at(at) >= self.config.handler_radius_m
        })
    }

    /// The share of its speed at which the robot walks in the formation in force.
    pub(super) fn speed(&self) -> f64 {
        match self.forming.formation {
            Formation::Beside => 1.0,
            Formation::Behind => self.config.behind_speed,
        }
    }

    /// How far the way goes on for a team that fits where there is so much clearance, metres.
    fn ahead_m(&mut self, window: &mut Window, fits_m: f64) -> f64 {
        let fitted_m = std::mem::replace(&mut window.fits_m, fits_m);
        let seen = Seen { window, odom_from_robot: &self.odom_from_robot, trail: &self.trail };
        let ahead_m = self.route.as_mut().map_or(0.0, |route| route.ahead_m(&seen));
        window.fits_m = fitted_m;
        ahead_m
    }

    /// Whether a team in single file has room for the handler beside the robot again, and ahead. Where its way has
    /// ended, beside the robot is enough.
    pub(super) fn consider_room_beside(&mut self, window: &mut Window, has_ended: bool) {
        let robot = self.odom_from_robot;
        let here = Point::from(robot.translation.vector);
        if self.forming.formation != Formation::Behind || self.cue != CueKind::Forward {
            return;
        }
        let came_m = (here - *self.forming.began.get_or_insert(here)).norm();
        let beside = Team::beside(&self.config);
        let is_wide = came_m > CAME_M
            && self.handler_gets_beside(window, &beside)
            && (has_ended || self.ahead_m(window, beside.width().fits_m) > AHEAD_M);
        // A handler who comes beside the robot takes that room.
        self.forming.find(is_wide, self.config.speaks, self.config.speaks);
    }

    fn handler_gets_beside(&self, window: &Window, beside: &Team) -> bool {
        let (from, to) = (self.team.model().robot_from_default(), beside.model().robot_from_default());
        (0..=PLACES).all(|place| {
            let share = place as f64 / PLACES as f64;
            let way = from.translation.vector.lerp(&to.translation.vector, share);
            let discs = beside.discs(&self.odom_from_robot, &Se2::new(way, 0.0));
            beside.room_m(window, &discs) > self.config.reserve_m
        })
    }
}
