//! Why an episode failed: one class for each failure, out of what happened. docs/evaluation.md lists the classes.

mod classify;
mod watch;

use guidance::se2::Point;
use serde::{Deserialize, Serialize};

pub use watch::Watch;

use crate::task::{Goal, Task};

/// What was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Asked {
    /// To go on along the corridor.
    Forward,
    /// To turn into an opening.
    Turn,
    /// To stand, as there is nothing to turn into.
    Stand,
    /// To stop before an edge of the floor, which lies across the way.
    Edge,
}

/// What went wrong. The first class that fits counts, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The robot's footprint left the floor.
    RobotFell,
    /// The handler's did.
    HandlerFell,
    /// A motion was refused in which the robot would have touched something. The first one counts.
    RobotTouched,
    /// The same of the handler.
    HandlerTouched,
    /// The handler came 1 m into an opening that the cue does not mean.
    WrongOpening,
    /// The handler came 1 m past the far edge of the opening that the cue means, along the corridor.
    PassedOpening,
    /// At the end the handler is more than half a metre outside the corridor, and in no opening.
    LeftCorridor,
    /// At the end the handler is 1.5 m or more behind where they gave the cue.
    TurnedBack,
    /// The task was to stand, and the handler still walks at the end.
    WalkedOn,
    /// The robot stands, and the edge before which it should stand is more than 2 m away.
    StoodFarFromEdge,
    /// For 10 s the robot turned to and fro and came no farther than 0.25 m.
    StuckTurning,
    /// It stood for 10 s: the policy chose to, although the shield allowed more.
    StoodByPolicy,
    /// It stood for 10 s because of the floor, and an edge is within 1 m.
    StuckAtEdge,
    /// It stood for 10 s because of what the sensors see, and a person is within 1.5 m of robot or handler.
    StuckAtPerson,
    /// The same, and robot or handler is within 0.8 m of the side of an opening.
    StuckAtJamb,
    /// The same, and something stands within half a metre of robot or handler.
    StuckAtObstacle,
    /// The shield held the robot for 10 s, and no edge, person, jamb or obstacle is near.
    StuckAtNothing,
    /// It stood for 10 s because the way of a turn was used up, or no measurement could be used.
    StoodByRule,
    /// The handler is as deep inside the opening as is asked, and faces more than 20 degrees off its axis.
    InsideAskew,
    /// The time was over, and no other class fits.
    OutOfTime,
    /// The cue was followed, and the robot still moved after *stop*.
    DidNotStop,
    /// All went well, but a person walked into robot or handler. This is not counted as a failure of the guide.
    HitByPerson,
}

/// What robot or handler would have touched: the nearest thing to them as the motion was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Thing {
    /// A wall, or what is not free on a map.
    Wall,
    /// Glass, which the lidar does not see.
    Glass,
    /// Something that ends below the lidar's plane.
    Low,
    /// Something that begins above the lidar's plane.
    Overhead,
    /// Something else that stands there.
    Obstacle,
    /// A walking person.
    Person,
}

/// Why an episode failed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// What was asked.
    pub asked: Asked,
    /// What went wrong.
    pub class: Class,
    /// What was touched, where that is the class.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thing: Option<Thing>,
    /// At which decision, counted from 1.
    pub decision: u32,
    /// How far the handler had walked then, metres.
    pub walked_m: f64,
    /// Where the robot was then (world frame), metres.
    pub at_m: [f64; 2],
}

impl Asked {
    /// What this task asks for.
    #[must_use]
    pub fn of(task: &Task) -> Self {
        match task.goal {
            Goal::Along(_) => Self::Forward,
            Goal::Into(_) => Self::Turn,
            Goal::Stand(_) => Self::Stand,
            Goal::BeforeEdge => Self::Edge,
        }
    }

    /// A word or two for people.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Forward => "forward",
            Self::Turn => "turn",
            Self::Stand => "stand",
            Self::Edge => "stop before an edge",
        }
    }
}

impl Class {
    /// Every class, in the order in which they are looked for.
    pub const ALL: [Self; 22] = [
        Self::RobotFell,
        Self::HandlerFell,
        Self::RobotTouched,
        Self::HandlerTouched,
        Self::WrongOpening,
        Self::PassedOpening,
        Self::LeftCorridor,
        Self::TurnedBack,
        Self::WalkedOn,
        Self::StoodFarFromEdge,
        Self::StuckTurning,
        Self::StoodByPolicy,
        Self::StuckAtEdge,
        Self::StuckAtPerson,
        Self::StuckAtJamb,
        Self::StuckAtObstacle,
        Self::StuckAtNothing,
        Self::StoodByRule,
        Self::InsideAskew,
        Self::OutOfTime,
        Self::DidNotStop,
        Self::HitByPerson,
    ];

    /// Whether the guide failed. A person who walks into the pair is not its failure.
    #[must_use]
    pub fn is_ours(self) -> bool {
        self != Self::HitByPerson
    }

    /// Few words for people.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::RobotFell => "the robot fell",
            Self::HandlerFell => "the handler fell",
            Self::RobotTouched => "the robot touched",
            Self::HandlerTouched => "the handler touched",
            Self::WrongOpening => "turned into the wrong opening",
            Self::PassedOpening => "passed the opening",
            Self::LeftCorridor => "left the corridor",
            Self::TurnedBack => "turned back",
            Self::WalkedOn => "walked where it should stand",
            Self::StoodFarFromEdge => "stood far from the edge",
            Self::StuckTurning => "stuck, turning to and fro",
            Self::StoodByPolicy => "stood where it should walk",
            Self::StuckAtEdge => "stuck before an edge",
            Self::StuckAtPerson => "stuck near a person",
            Self::StuckAtJamb => "stuck beside a jamb",
            Self::StuckAtObstacle => "stuck at an obstacle",
            Self::StuckAtNothing => "stuck in the open",
            Self::StoodByRule => "stood by a rule",
            Self::InsideAskew => "inside the opening, but askew",
            Self::OutOfTime => "ran out of time",
            Self::DidNotStop => "did not stop",
            Self::HitByPerson => "hit by a person",
        }
    }

    /// One sentence for people: when an episode is of this class.
    #[must_use]
    pub fn explanation(self) -> &'static str {
        match self {
            Self::RobotFell => "The robot's footprint left the floor.",
            Self::HandlerFell => "The handler's footprint left the floor.",
            Self::RobotTouched => "The robot would have touched something, so the motion was refused.",
            Self::HandlerTouched => "The handler would have touched something, so the motion was refused.",
            Self::WrongOpening => "The handler came 1 m into an opening that the cue does not mean.",
            Self::PassedOpening => "The handler walked past the opening, and came 1 m beyond its far edge.",
            Self::LeftCorridor => "At the end the handler is outside the corridor, and in no opening.",
            Self::TurnedBack => "At the end the handler is 1.5 m or more behind the place of the cue.",
            Self::WalkedOn => "There was nothing to turn into, and the handler still walks at the end.",
            Self::StoodFarFromEdge => "The robot stands more than 2 m from the edge that it should find.",
            Self::StuckTurning => "For 10 s the robot turned to and fro and came no farther than 0.25 m.",
            Self::StoodByPolicy => "For 10 s the policy stood, although the shield allowed it to move.",
            Self::StuckAtEdge => "For 10 s the shield held the robot because of the floor. An edge is within 1 m.",
            Self::StuckAtPerson => "For 10 s the shield held the robot. A person is within 1.5 m.",
            Self::StuckAtJamb => "For 10 s the shield held the robot. The side of an opening is within 0.8 m.",
            Self::StuckAtObstacle => "For 10 s the shield held the robot. Something stands within 0.5 m.",
            Self::StuckAtNothing => {
                "For 10 s the shield held the robot, though no edge, person, jamb or obstacle was near."
            }
            Self::StoodByRule => {
                "For 10 s the robot stood because the way of a turn was used up, or no measurement could be used."
            }
            Self::InsideAskew => "The handler is inside the opening, and faces over 20 degrees off its axis.",
            Self::OutOfTime => "The time was over before the handler arrived. Nothing else went wrong.",
            Self::DidNotStop => "The cue was followed, but the robot still moved after stop.",
            Self::HitByPerson => "A person walked into robot or handler. Nothing else went wrong.",
        }
    }
}

impl Thing {
    /// The thing for people, with its article.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Wall => "a wall",
            Self::Glass => "glass",
            Self::Low => "something low",
            Self::Overhead => "something above the lidar's plane",
            Self::Obstacle => "an obstacle",
            Self::Person => "a person",
        }
    }
}

impl Failure {
    /// The class and what was touched, for people.
    #[must_use]
    pub fn words(&self) -> String {
        self.thing.map_or_else(|| self.class.words().to_owned(), |thing| touched(self.class, thing))
    }

    /// A sentence for people: what happened, when and where.
    #[must_use]
    pub fn happened(&self) -> String {
        let [x_m, y_m] = self.at_m;
        let (what, decision, walked_m) = (self.words(), self.decision, self.walked_m);
        format!("{what}: decision {decision}, after {walked_m:.1} m, the robot at ({x_m:.1}, {y_m:.1}) m")
    }
}

/// The class of a touch with what was touched.
fn touched(class: Class, thing: Thing) -> String {
    format!("{} {}", class.words(), thing.words())
}

/// How far apart two places are, metres.
fn apart_m(a: Point, b: Point) -> f64 {
    (a - b).norm()
}

#[cfg(test)]
mod tests;
