//! The action table: data, not code (Kim et al. 2023, section 5.1). The shipped tables are files in `config/actions`.

use std::sync::LazyLock;

use messages::{MAX_ACTIONS, Pose2, Twist2};
use serde::{Deserialize, Serialize};

use crate::se2::{Se2, log, se2};

/// No action leads farther back, metres: nothing looks there, and the handler has to back up.
pub const BACK_MAX_M: f64 = 0.2;

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

    /// Whether the robot goes ahead with it.
    #[must_use]
    pub fn leads_ahead(&self) -> bool {
        self.velocity(1.0).vx_mps > 0.0
    }

    /// Whether the robot goes back with it.
    #[must_use]
    pub fn leads_back(&self) -> bool {
        self.velocity(1.0).vx_mps < 0.0
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
    /// A step back is at most [`BACK_MAX_M`] long.
    #[error("action \"{0}\" leads back by more than {BACK_MAX_M} m")]
    Back(String),
    /// A motion is not finite, or two actions share a name.
    #[error("action \"{0}\" is not finite or stands twice")]
    Action(String),
    /// The text is no table: not TOML, or a key is unknown, missing or wrong.
    #[error("{0}")]
    Text(String),
    /// Names or motions are not those that the id was computed from.
    #[error("the table says id = \"{stated}\", and its actions have \"{found}\"")]
    Id {
        /// What the table says.
        stated: String,
        /// What its actions have.
        found: String,
    },
}

/// A table as its file has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    id: String,
    actions: Vec<Action>,
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
            if action.motion.x_m < -BACK_MAX_M {
                return Err(ActionTableError::Back(action.name.clone()));
            }
        }
        Ok(Self { actions })
    }

    /// The table that the text of a file holds.
    ///
    /// # Errors
    /// As [`ActionTable::new`], and where the text is no table or its id is not that of its actions.
    pub fn parse(text: &str) -> Result<Self, ActionTableError> {
        let file: File = toml::from_str(text).map_err(|error| ActionTableError::Text(error.to_string()))?;
        let table = Self::new(file.actions)?;
        let found = format!("{:#018x}", table.id());
        if file.id == found { Ok(table) } else { Err(ActionTableError::Id { stated: file.id, found }) }
    }

    /// The eight actions that the paper names: `config/actions/eight.toml`.
    #[must_use]
    pub fn eight() -> Self {
        static TABLE: LazyLock<ActionTable> =
            LazyLock::new(|| ActionTable::shipped(include_str!("../../../config/actions/eight.toml")));
        TABLE.clone()
    }

    /// The eight and a step back: `config/actions/nine.toml`.
    #[must_use]
    pub fn nine() -> Self {
        static TABLE: LazyLock<ActionTable> =
            LazyLock::new(|| ActionTable::shipped(include_str!("../../../config/actions/nine.toml")));
        TABLE.clone()
    }

    /// The eight and two of our own: `config/actions/ten.toml`.
    #[must_use]
    pub fn ten() -> Self {
        static TABLE: LazyLock<ActionTable> =
            LazyLock::new(|| ActionTable::shipped(include_str!("../../../config/actions/ten.toml")));
        TABLE.clone()
    }

    /// Arcs of 0.2 s for a robot that walks alone: `config/actions/solo.toml`.
    #[must_use]
    pub fn solo() -> Self {
        static TABLE: LazyLock<ActionTable> =
            LazyLock::new(|| ActionTable::shipped(include_str!("../../../config/actions/solo.toml")));
        TABLE.clone()
    }

    /// Built in, so that a robot needs no file beside its programs, and a test has read it.
    fn shipped(text: &str) -> Self {
        Self::parse(text).expect("a shipped table is right")
    }

    /// The same actions, made at that share of their speed: in one decision each leads that share as far.
    #[must_use]
    pub fn slowed(&self, share: f64) -> Self {
        let slowed = |Action { name, motion: Pose2 { x_m, y_m, yaw_rad } }: &Action| Action {
            name: name.clone(),
            motion: Pose2::new(x_m * share, y_m * share, yaw_rad * share),
        };
        Self { actions: self.actions.iter().map(slowed).collect() }
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

    /// Whether the table begins with all actions of another one.
    #[must_use]
    pub fn begins_with(&self, other: &Self) -> bool {
        self.actions.starts_with(&other.actions)
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

    /// Policies, permits and recordings hold these ids: a table that changes is another table.
    #[test]
    fn the_shipped_tables_are_what_they_always_were() {
        let (eight, ten) = (ActionTable::eight(), ActionTable::ten());
        assert_eq!((eight.len(), eight.id()), (8, 0x8d82_49fa_0fb7_2e14));
        assert_eq!((ten.len(), ten.id()), (10, 0xccfd_c40c_3c75_ff4b));
        let nine = ActionTable::nine();
        assert_eq!((nine.len(), nine.id()), (9, 0x4b90_c66c_a1b1_e168));
        let solo = ActionTable::solo();
        assert_eq!((solo.len(), solo.id()), (15, 0x56bfe313ba1bb690));
        assert!(ten.begins_with(&eight) && nine.begins_with(&eight) && !ten.begins_with(&nine));
        let back: Vec<&str> = nine.actions().iter().filter(|a| a.leads_back()).map(|a| a.name.as_str()).collect();
        assert_eq!(back, ["step_back"]);
        // The files hold these in decimals, to the bit.
        let (turn_rad, diagonal_m) = (10f64.to_radians(), 0.25 * std::f64::consts::FRAC_1_SQRT_2);
        let motion = |name: &str| ten.actions()[ten.index_of(name).expect(name)].motion;
        assert_eq!(motion("turn_right"), Pose2::new(0.0, 0.0, -turn_rad));
        assert_eq!(motion("diagonal_left"), Pose2::new(diagonal_m, diagonal_m, 0.0));
        assert_eq!(motion("arc_left"), Pose2::new(0.25, 0.0, turn_rad));
        assert!((eight.actions()[1].velocity(0.5).vx_mps - 0.5).abs() < 1e-12);
    }

    #[test]
    fn slowed_actions_are_the_same_at_a_share_of_their_speed() {
        let table = ActionTable::ten();
        assert_eq!(table.slowed(1.0), table);
        for (action, slowed) in table.actions().iter().zip(table.slowed(0.5).actions()) {
            let (fast, slow) = (action.velocity(0.5), slowed.velocity(0.5));
            let off = [fast.vx_mps / 2.0 - slow.vx_mps, fast.wz_radps / 2.0 - slow.wz_radps];
            assert!(action.name == slowed.name && off.iter().all(|off| off.abs() < 1e-3), "{slowed:?}");
        }
    }

    #[test]
    fn a_file_whose_actions_are_not_those_of_its_id_is_refused() {
        let text = include_str!("../../../config/actions/eight.toml");
        for (edited, why) in [
            (text.replace("x_m = 0.25", "x_m = 0.26"), "the table says id = \"0x8d8249fa0fb72e14\", and"),
            (text.replace("sidestep_left", "sidestep"), "the table says id"),
            (text.replace("0x8d82", "0x8D82"), "and its actions have \"0x8d8249fa0fb72e14\""),
            (text.replace("id = ", "digest = "), "unknown field `digest`"),
            (text.replace("\"stop\"", "\"stand\""), "the first action must be \"stop\""),
            (text.replace("x_m = 0.25", "x_m = -0.25"), "action \"forward\" leads back by more than 0.2 m"),
            ("id = \"\"\nactions = []".to_owned(), "1 to 16 actions, not 0"),
        ] {
            let error = ActionTable::parse(&edited).expect_err(why).to_string();
            assert!(error.contains(why), "{error}");
        }
    }

    #[test]
    fn a_table_without_stop_is_refused() {
        let forward = Action { name: "forward".into(), motion: Pose2::new(0.25, 0.0, 0.0) };
        assert_eq!(ActionTable::new(vec![forward]), Err(ActionTableError::NoStop("forward".into())));
    }
}
