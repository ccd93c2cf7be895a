//! The wayfinding task as a Markov decision process (Kim et al. 2023, section 3), seen from the handler.
//!
//! * State: depth image, lidar readings and the robot's pose in the cue's start frame (section 3): what `policy/action`
//!   is decided from.
//! * Actions: [`crate::ActionTable`] (section 5.1).
//! * Transition: the robot's motion and an [`crate::Interaction`] model (section 4).
//! * Reward: [`Reward`] (eq. 1).
//! * Initial states: a place, a heading and a cue, with the handler's errors in both (section 3 and figure 8): drawn by
//!   `episodes::Task`, or told of a scripted walk ([`HandlerErrors`]).

use messages::CueKind;

use crate::cue::target_yaw_rad;
use crate::interaction::place;
use crate::se2::{Se2, wrap_angle};
use crate::travel_line::TravelLine;

/// One cue, from where the handler was when they gave it.
#[derive(Debug, Clone, PartialEq)]
pub struct CueStart {
    /// What was asked for.
    pub cue: CueKind,
    /// The handler then: the start frame.
    pub world_from_start: Se2,
}

impl CueStart {
    /// Straight-line distance of the handler from the cue's start, metres: `d_t` of eq. 1. The way walked could never
    /// fall, so that stepping backward would cost nothing.
    #[must_use]
    pub fn travel_m(&self, world_from_handler: &Se2) -> f64 {
        (place(world_from_handler) - place(&self.world_from_start)).norm()
    }

    /// The handler's heading less the target's, on the short arc, radians: `theta_t - theta_bar` of eq. 1.
    #[must_use]
    pub fn heading_error_rad(&self, world_from_handler: &Se2) -> f64 {
        let turned = world_from_handler.rotation.angle() - self.world_from_start.rotation.angle();
        wrap_angle(turned - target_yaw_rad(self.cue))
    }
}

/// How the second term of eq. 1 is read: its Delta is not defined in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delta {
    /// The change of the error over the step, like the first term: shaping, whose sum telescopes.
    Difference,
    /// The time step: a penalty for as long as the error lasts.
    Level,
}

/// The weights of eq. 1.
#[derive(Debug, Clone, PartialEq)]
pub struct RewardConfig {
    /// `a`, reward for a radian.
    pub heading_weight: f64,
    /// `b`, radians: errors up to it cost nothing.
    pub heading_margin_rad: f64,
    /// `c^collide`, reward for a step with a collision of robot or handler.
    pub collision_penalty: f64,
    /// `lambda`, reward for a step.
    pub time_penalty: f64,
    /// Reward for a step in which the robot was not told to stand: with it, who has arrived stands still. Ours; 0 in
    /// the paper.
    pub motion_penalty: f64,
    /// How Delta is read.
    pub delta: Delta,
    /// Time of a step, seconds; only [`Delta::Level`] needs it.
    pub dt_s: f64,
}

impl Default for RewardConfig {
    fn default() -> Self {
        Self {
            heading_weight: 0.5,
            heading_margin_rad: 0.2,
            collision_penalty: 0.3,
            time_penalty: 0.01,
            motion_penalty: 0.0,
            delta: Delta::Difference,
            dt_s: 0.5,
        }
    }
}

/// The terms of eq. 1 for one step; the reward is their sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// `d_t - d_{t-1}`, metres.
    pub progress: f64,
    /// `- a Delta max(|theta_bar - theta_t| - b, 0)`.
    pub heading: f64,
    /// `- c^collide`.
    pub collision: f64,
    /// `- lambda`, and what motion costs.
    pub time: f64,
}

impl Terms {
    /// The reward.
    #[must_use]
    pub fn sum(&self) -> f64 {
        self.progress + self.heading + self.collision + self.time
    }
}

/// What `d_t` and the target orientation of eq. 1 are measured by. The paper says neither.
#[derive(Debug, Clone, PartialEq)]
pub enum Measure {
    /// From the cue's start: the straight-line distance from it, and the cue's fixed target.
    Start(CueStart),
    /// Along the travel line that the cue means: the way along it, and its direction there. What a turn into the wrong
    /// opening gains is nothing.
    Line(TravelLine),
}

/// How far along its line a handler can have come in one step, metres.
const STEP_MAX_M: f64 = 1.0;

impl Measure {
    /// Where the handler has got to, metres, and the error of their heading, radians; they were at `before_m`.
    fn of(&self, before_m: f64, world_from_handler: &Se2) -> (f64, f64) {
        match self {
            Self::Start(start) => (start.travel_m(world_from_handler), start.heading_error_rad(world_from_handler)),
            Self::Line(line) => {
                let at = place(world_from_handler);
                let foot = line.foot_within(at, before_m - STEP_MAX_M, before_m + STEP_MAX_M);
                (foot.way_m, line.heading_error_rad(foot.way_m, world_from_handler.rotation.angle()))
            }
        }
    }
}

/// The reward of an episode, step by step (Kim et al. 2023, eq. 1).
#[derive(Debug, Clone, PartialEq)]
pub struct Reward {
    config: RewardConfig,
    measure: Measure,
    travel_m: f64,
    error_rad: f64,
}

impl Reward {
    /// At the beginning of an episode, the handler being there.
    #[must_use]
    pub fn begin(config: RewardConfig, measure: Measure, world_from_handler: &Se2) -> Self {
        let mut reward = Self { config, measure, travel_m: 0.0, error_rad: 0.0 };
        if let Measure::Line(line) = &reward.measure {
            reward.travel_m = line.foot(place(world_from_handler)).way_m;
        }
        (reward.travel_m, reward.error_rad) = reward.measured(world_from_handler);
        reward
    }

    fn measured(&self, world_from_handler: &Se2) -> (f64, f64) {
        let (travel_m, error_rad) = self.measure.of(self.travel_m, world_from_handler);
        (travel_m, (error_rad.abs() - self.config.heading_margin_rad).max(0.0))
    }

    /// How far the handler has got, metres: `d_t`.
    #[must_use]
    pub fn travel_m(&self) -> f64 {
        self.travel_m
    }

    /// The step that brought the handler there; `moved` where the robot was told to move.
    pub fn step(&mut self, world_from_handler: &Se2, moved: bool, collided: bool) -> Terms {
        let (before_m, before_rad) = (self.travel_m, self.error_rad);
        (self.travel_m, self.error_rad) = self.measured(world_from_handler);
        let error = match self.config.delta {
            Delta::Difference => self.error_rad - before_rad,
            Delta::Level => self.error_rad * self.config.dt_s,
        };
        Terms {
            progress: self.travel_m - before_m,
            heading: -self.config.heading_weight * error,
            collision: if collided { -self.config.collision_penalty } else { 0.0 },
            time: -self.config.time_penalty - if moved { self.config.motion_penalty } else { 0.0 },
        }
    }
}

/// The errors that handlers make when they give a cue (Kim et al. 2023, section 3 and figure 8).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct HandlerErrors {
    /// Facing off the travel line, radians to the left.
    pub orientation_rad: f64,
    /// The cue comes so much too late (negative: too early), metres of way.
    pub timing_m: f64,
}

impl HandlerErrors {
    /// The start with the handler's error in orientation.
    #[must_use]
    pub fn start(&self, world_from_start: &Se2) -> Se2 {
        Se2::new(
            world_from_start.translation.vector,
            wrap_angle(world_from_start.rotation.angle() + self.orientation_rad),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::{CueStart, Delta, HandlerErrors, Measure, Reward, RewardConfig};
    use crate::se2::{Point, Se2, se2};
    use crate::travel_line::TravelLine;
    use messages::{CueKind, Pose2};
    use std::f64::consts::FRAC_PI_2;

    fn at(x_m: f64, y_m: f64, yaw_rad: f64) -> Se2 {
        se2(Pose2::new(x_m, y_m, yaw_rad))
    }

    fn start(cue: CueKind) -> CueStart {
        CueStart { cue, world_from_start: at(1.0, 2.0, FRAC_PI_2) }
    }

    fn reward(delta: Delta, cue: CueKind) -> Reward {
        let config = RewardConfig { delta, motion_penalty: 0.002, ..RewardConfig::default() };
        Reward::begin(config, Measure::Start(start(cue)), &at(1.0, 2.0, FRAC_PI_2))
    }

    #[test]
    fn going_on_along_the_cue_is_progress_and_stepping_back_costs_it() {
        let mut reward = reward(Delta::Difference, CueKind::Forward);
        let on = reward.step(&at(1.0, 2.25, FRAC_PI_2), true, false);
        assert!((on.progress - 0.25).abs() < 1e-12 && on.heading == 0.0);
        assert!((on.sum() - 0.238).abs() < 1e-12);
        assert!((reward.step(&at(1.0, 2.1, FRAC_PI_2), true, false).progress + 0.15).abs() < 1e-12);
    }

    #[test]
    fn a_turn_is_rewarded_once_as_a_difference_and_asked_for_all_the_time_as_a_level() {
        // The target is 90 degrees to the left: at the start the error is 90 degrees less the margin.
        let error = FRAC_PI_2 - 0.2;
        let mut shaped = reward(Delta::Difference, CueKind::Left);
        assert_eq!(shaped.step(&at(1.0, 2.0, FRAC_PI_2), true, false).heading, 0.0);
        let turned = shaped.step(&at(1.0, 2.0, 2.0 * FRAC_PI_2), true, false).heading;
        assert!((turned - 0.5 * error).abs() < 1e-12);
        let mut level = reward(Delta::Level, CueKind::Left);
        let standing = level.step(&at(1.0, 2.0, FRAC_PI_2), true, false).heading;
        assert!((standing + 0.5 * 0.5 * error).abs() < 1e-12);
        assert_eq!(level.step(&at(1.0, 2.0, 2.0 * FRAC_PI_2), true, false).heading, 0.0);
    }

    #[test]
    fn the_error_is_taken_on_the_short_arc() {
        let right = CueStart { cue: CueKind::Right, world_from_start: at(0.0, 0.0, -3.0) };
        // The target is -3.0 - 1.57 = -4.57, which is 1.71.
        assert!(right.heading_error_rad(&at(0.0, 0.0, 1.75)).abs() < 0.05);
    }

    #[test]
    fn a_collision_and_every_step_cost() {
        let mut reward = reward(Delta::Difference, CueKind::Forward);
        let terms = reward.step(&at(1.0, 2.0, FRAC_PI_2), false, true);
        assert!((terms.sum() + 0.31).abs() < 1e-12);
        assert!((reward.step(&at(1.0, 2.0, FRAC_PI_2), true, false).sum() + 0.012).abs() < 1e-12);
    }

    #[test]
    fn along_the_travel_line_a_turn_into_the_wrong_opening_gains_nothing() {
        let line =
            TravelLine::new(&[Point::new(0.0, 0.0), Point::new(3.0, 0.0), Point::new(3.0, 5.0)]).expect("a line");
        let start = at(2.5, 0.0, 0.0);
        let walk = |end: Se2| {
            let mut reward = Reward::begin(RewardConfig::default(), Measure::Line(line.clone()), &start);
            reward.step(&end, true, false)
        };
        let (asked, wrong) = (walk(at(3.0, 0.4, FRAC_PI_2)), walk(at(3.0, -0.4, -FRAC_PI_2)));
        assert!((asked.progress - 0.9).abs() < 1e-9 && asked.heading == 0.0);
        assert!((wrong.progress - 0.5).abs() < 1e-9 && wrong.heading < -0.5);
    }

    #[test]
    fn errors_turn_the_start() {
        let errors = HandlerErrors { orientation_rad: 0.3, timing_m: 0.0 };
        let start = errors.start(&at(1.0, 2.0, 3.0));
        assert!((start.rotation.angle() - (3.3 - std::f64::consts::TAU)).abs() < 1e-12);
    }
}
