//! Why the robot stands, and stood: the answer to `why`.

use serde::{Deserialize, Serialize};

use crate::status::{ModeStatus, Note};

/// Why the robot stands, and stood.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Why {
    /// The run's name.
    pub run: String,
    /// Whether the robot may move, and why not.
    pub mode: ModeStatus,
    /// Why locomotion commands zero, "none" while it does not; nothing before its first word.
    pub stands_because: Option<String>,
    /// Why a cue would not be taken; nothing where one would.
    pub not_ready_because: Option<String>,
    /// The newest stops, the newest of them first.
    pub stops: Vec<Stop>,
    /// The newest notes for the operator, the oldest of them first.
    pub notes: Vec<Note>,
}

/// One stop.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// "hold", "latched", "fault" or "lock".
    pub class: String,
    /// The name of its kind.
    pub reason: String,
    /// Its kind with evidence.
    pub why: String,
    /// The service at fault.
    pub service: Option<String>,
    /// The topic at fault.
    pub stream: Option<String>,
    /// Run time of its beginning, seconds.
    pub at_s: f64,
    /// How long it lasted, or has by now, seconds.
    pub lasted_s: f64,
    /// Whether it is over.
    pub ended: bool,
}
