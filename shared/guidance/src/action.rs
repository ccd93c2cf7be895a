//! The action table: data, not code (Kim et al. 2023, section 5.1).

use messages::{MAX_ACTIONS, Pose2, Twist2};
use serde::{Deserialize, Serialize};

use crate::se2::{Se2, log, se2};

/// One discrete action: a motion in the robot's frame at its start, made in one decision period at constant velocity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// The name, unique in its table.
    pub name: String,
    /// Where the robot is at the end, in its frame at the start.
    pub motion: Pose2,
}

impl Action {
    /// Where the robot is at the end, in its frame at the start.
    #[must_use]
    pub fn start_from_end(&self) -> Se2 {
        se2(self.motion)
    }

    /// The constant body velocity that makes the motion in `dt_s`.
    #[must_use]
    pub fn velocity(&self, dt_s: f64) -> Twist2 {
        log(&self.start_from_end(), dt_s)
    }
}

/// What is wrong with an action table.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ActionTableError {
    /// Too few or too many actions.
    #[error("an action table has 1 to {MAX_ACTIONS} actions, not {0}")]
    Count(usize),
    /// The first action must be the one that stands still.
    #[error("the first action must be \"stop\" with no motion, not \"{0}\"")]
    NoStop(String),
    /// A motion is not finite, or two actions share a name.
    #[error("action \"{0}\" is not finite or stands twice")]
    Action(String),
}

/// Actions in a fixed order; the first is stop.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionTable {
    actions: Vec<Action>,
}

impl ActionTable {
    /// Index of the action that stands still.
    pub const STOP: usize = 0;

    /// A table of these actions.
    ///
    /// # Errors
    /// Where there are none or over [`MAX_ACTIONS`], the first is not stop, or one is not finite or named twice.
    pub fn new(actions: Vec<Action>) -> Result<Self, ActionTableError> {
        if actions.is_empty() || actions.len() > MAX_ACTIONS {
            return Err(ActionTableError::Count(actions.len()));
        }
        if actions[0].name != "stop" || actions[0].motion != Pose2::default() {
            return Err(ActionTableError::NoStop(actions[0].name.clone()));
        }
        for (i, action) in actions.iter().enumerate() {
            if !action.motion.is_finite() || actions[..i].iter().any(|other| other.name == action.name) {
                return Err(ActionTableError::Action(action.name.clone()));
            }
        }
        Ok(Self { actions })
    }

    /// The eight actions that the paper names: stop, forward 0.25 m, turns of 10 degrees, sidesteps of 0.15 m, diagonal
    /// steps of 0.25 m at 45 degrees.
    #[must_use]
    pub fn eight() -> Self {
        let turn = 10f64.to_radians();
        let diagonal = 0.25 * std::f64::consts::FRAC_1_SQRT_2;
        let named = [
            ("stop", Pose2::default()),
            ("forward", Pose2::new(0.25, 0.0, 0.0)),
            ("turn_left", Pose2::new(0.0, 0.0, turn)),
            ("turn_right", Pose2::new(0.0, 0.0, -turn)),
            ("sidestep_left", Pose2::new(0.0, 0.15, 0.0)),
            ("sidestep_right", Pose2::new(0.0, -0.15, 0.0)),
            ("diagonal_left", Pose2::new(diagonal, diagonal, 0.0)),
            ("diagonal_right", Pose2::new(diagonal, -diagonal, 0.0)),
        ];
        let actions = named.into_iter().map(|(name, motion)| Action { name: name.to_owned(), motion }).collect();
        Self { actions }
    }

    /// The eight and two of our own: arcs of 0.25 m that turn by 10 degrees.
    #[must_use]
    pub fn ten() -> Self {
        let mut table = Self::eight();
        for (name, turn_deg) in [("arc_left", 10.0_f64), ("arc_right", -10.0)] {
            table.actions.push(Action { name: name.to_owned(), motion: Pose2::new(0.25, 0.0, turn_deg.to_radians()) });
        }
        table
    }

    /// The actions, stop first.
    #[must_use]
    pub fn actions(&self) -> &[Action] {
        &self.actions
    }

    /// How many actions there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.actions.len()
    }

    /// Never: a table has at least stop.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// Index of the action of that name.
    #[must_use]
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.actions.iter().position(|action| action.name == name)
    }

    /// A digest (FNV-1a, 64 bits) of names and motions, so that two processes notice when they mean different tables.
    #[must_use]
    pub fn id(&self) -> u64 {
        let mut digest = 0xcbf2_9ce4_8422_2325_u64;
        let mut eat = |bytes: &[u8]| {
            for byte in bytes {
                digest = (digest ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        };
        for action in &self.actions {
            eat(action.name.as_bytes());
            for number in [action.motion.x_m, action.motion.y_m, action.motion.yaw_rad] {
                eat(&number.to_le_bytes());
            }
        }
        digest
    }
}

#[cfg(test)]
mod tests {
    use super::{Action, ActionTable, ActionTableError};
    use messages::Pose2;

    #[test]
    fn the_tables_are_what_the_paper_names_and_ours() {
        assert_eq!(ActionTable::eight().len(), 8);
        assert_eq!(ActionTable::ten().len(), 10);
        assert_ne!(ActionTable::eight().id(), ActionTable::ten().id());
        let table = ActionTable::eight();
        let forward = &table.actions()[1];
        assert!((forward.velocity(0.5).vx_mps - 0.5).abs() < 1e-12);
        assert!(ActionTable::new(ActionTable::ten().actions().to_vec()).is_ok());
    }

    #[test]
    fn a_table_without_stop_is_refused() {
        let forward = Action { name: "forward".into(), motion: Pose2::new(0.25, 0.0, 0.0) };
        assert_eq!(ActionTable::new(vec![forward]), Err(ActionTableError::NoStop("forward".into())));
    }
}
