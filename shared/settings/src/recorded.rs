//! The sections about recordings: what is recorded, and what is played back.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::path::ConfigPath;
use crate::units::Millis;

/// Where cues come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CueOrigin {
    /// The run's own handler: a script, or the operator.
    #[default]
    Own,
    /// Published by `replay` in the recogniser's place.
    Replayed,
}

/// The recording, where the run replays one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Replay {
    /// The recording.
    pub recording: Option<ConfigPath>,
    /// What was recorded before this time of it is left out.
    pub from: Option<Millis>,
    /// What was recorded from this time of it on is left out.
    pub to: Option<Millis>,
    /// How many times it is played; 0 = until the run is ended.
    pub times: u32,
    /// Where it is noted what the run decides differently, JSON lines.
    pub differences: Option<ConfigPath>,
}

impl Default for Replay {
    fn default() -> Self {
        Self { recording: None, from: None, to: None, times: 1, differences: None }
    }
}

/// What is recorded of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RecordSettings {
    /// The recording (`NAME.mcap`) of the whole run, from its first step on; none: only when an operator asks for one.
    pub path: Option<ConfigPath>,
    /// Whether depth frames are recorded, beside the rest in `NAME.depth.mcap`.
    pub depth: bool,
}

/// What a run leaves behind in the state folder: its settings, its logs, what happened, and how it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunRecordSettings {
    /// Number of runs that are kept, the newest; 0: none.
    pub keep_runs: u32,
    /// MiB that are kept in all; older runs make room when a new one starts. The newest stays in any case.
    pub keep_mib: u32,
}

impl Default for RunRecordSettings {
    fn default() -> Self {
        Self { keep_runs: 20, keep_mib: 512 }
    }
}

impl Default for RecordSettings {
    fn default() -> Self {
        Self { path: None, depth: true }
    }
}
