//! Doors that open during a walk, and shut again. A leaf stops for who stands in its way, and tries again.

use guidance::se2::Point;
use nalgebra::Vector2;

use crate::people::Agent;
use crate::prism::{Prism, SeenBy};
use crate::sweep::to_segment;

/// A leaf keeps this distance from robot, handler and people, metres. The team moves no farther than this in a
/// decision.
pub const HOLDS_OFF_M: f64 = 0.5;
/// The end of a leaf moves by at most this in one step, metres: it cannot jump over a person.
const STEP_M: f64 = 0.1;

/// When a door begins to open. It does so once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Opens {
    /// At this run time, seconds.
    At(f64),
    /// When the robot is so near to the hinge, metres: its front disc, in MuJoCo its middle.
    Near(f64),
}

/// A door that opens.
#[derive(Debug, Clone, PartialEq)]
pub struct Door {
    /// Where its hinge is, world frame.
    pub hinge: Point,
    /// Length and thickness of its leaf, metres.
    pub size_m: [f64; 2],
    /// Lower and upper edge of its leaf, metres.
    pub z: [f64; 2],
    /// The way from the hinge along the leaf where it is shut and where it is open (world frame), radians. It swings
    /// straight from one to the other.
    pub swing_rad: [f64; 2],
    /// How fast it swings, radians per second.
    pub speed_radps: f64,
    /// When it begins to open.
    pub opens: Opens,
    /// How long it stays open, seconds.
    pub stays_s: f64,
    /// Who sees it.
    pub seen_by: SeenBy,
}

/// What a door does.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Waits,
    Opens,
    /// Stays open until this run time, seconds.
    Stays(f64),
    Shuts,
    Rests,
}

/// A door at one moment.
#[derive(Debug, Clone)]
pub(crate) struct Leaf {
    pub(crate) door: Door,
    /// The way from the hinge along it (world frame), radians.
    pub(crate) at_rad: f64,
    phase: Phase,
}

impl Door {
    /// Its leaf at an angle (world frame), radians.
    #[must_use]
    pub fn leaf(&self, at_rad: f64) -> Prism {
        let middle = nalgebra::center(&self.hinge, &self.tip(at_rad));
        Prism::cuboid(middle, self.size_m, at_rad, self.z).seen_by(self.seen_by)
    }

    fn tip(&self, at_rad: f64) -> Point {
        self.hinge + Vector2::new(at_rad.cos(), at_rad.sin()) * self.size_m[0]
    }

    /// The distance between the leaf at an angle and an agent's disc, metres.
    fn room_m(&self, at_rad: f64, agent: &Agent) -> f64 {
        to_segment(agent.at, self.hinge, self.tip(at_rad)) - self.size_m[1] / 2.0 - agent.radius_m
    }
}

impl Leaf {
    /// A door that is shut.
    pub(crate) fn new(door: Door) -> Self {
        Self { at_rad: door.swing_rad[0], phase: Phase::Waits, door }
    }

    /// Swings for `dt_s` from a run time on; whether it has moved. The first of the agents is the robot.
    pub(crate) fn swing(&mut self, time_s: f64, dt_s: f64, agents: &[Agent]) -> bool {
        self.phase = match self.phase {
            Phase::Waits if self.is_due(time_s, agents) => Phase::Opens,
            Phase::Stays(until_s) if time_s >= until_s => Phase::Shuts,
            phase => phase,
        };
        let ([shut_rad, open_rad], before_rad) = (self.door.swing_rad, self.at_rad);
        let (to_rad, then) = match self.phase {
            Phase::Opens => (open_rad, Phase::Stays(time_s + dt_s + self.door.stays_s)),
            Phase::Shuts => (shut_rad, Phase::Rests),
            _ => return false,
        };
        if self.reaches(to_rad, dt_s, agents) {
            self.phase = then;
        }
        self.at_rad != before_rad
    }

    fn is_due(&self, time_s: f64, agents: &[Agent]) -> bool {
        match self.door.opens {
            Opens::At(at_s) => time_s >= at_s,
            Opens::Near(near_m) => agents.first().is_some_and(|robot| (robot.at - self.door.hinge).norm() <= near_m),
        }
    }

    /// Swings towards an angle until the time is over or an agent is in the way. Returns whether the leaf is there.
    fn reaches(&mut self, to_rad: f64, dt_s: f64, agents: &[Agent]) -> bool {
        let mut left_rad = self.door.speed_radps * dt_s;
        while left_rad > 0.0 && self.at_rad != to_rad {
            let step_rad = left_rad.min(STEP_M / self.door.size_m[0]);
            let way_rad = to_rad - self.at_rad;
            let next_rad = if way_rad.abs() <= step_rad { to_rad } else { self.at_rad + step_rad.copysign(way_rad) };
            let is_in_way = |agent: &Agent| {
                let room_m = self.door.room_m(next_rad, agent);
                room_m < HOLDS_OFF_M && room_m < self.door.room_m(self.at_rad, agent)
            };
            if agents.iter().any(is_in_way) {
                return false;
            }
            (self.at_rad, left_rad) = (next_rad, left_rad - step_rad);
        }
        self.at_rad == to_rad
    }
}
