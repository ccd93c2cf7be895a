//! Channels for people only: what viewers show and nobody reads back.

use messages::NS_PER_S;
use serde_json::{Value, json};

/// A channel for viewers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Viewer {
    /// `foxglove.Log`: what stops the robot, and its cues.
    Log,
    /// `foxglove.SceneUpdate`: robot, handler and hull.
    Scene,
}

impl Viewer {
    /// Every channel for viewers.
    pub const ALL: [Self; 2] = [Self::Log, Self::Scene];

    /// The channel's topic.
    #[must_use]
    pub const fn topic(self) -> &'static str {
        match self {
            Self::Log => "log",
            Self::Scene => "scene",
        }
    }

    pub(crate) const fn schema(self) -> (&'static str, &'static str) {
        match self {
            Self::Log => ("foxglove.Log", include_str!("../schemas/log.json")),
            Self::Scene => ("foxglove.SceneUpdate", include_str!("../schemas/scene_update.json")),
        }
    }
}

/// How grave a line of the log is, by Foxglove's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// All is well.
    Info = 2,
    /// The robot waits.
    Warning = 3,
    /// The robot was stopped.
    Error = 4,
}

/// Foxglove's time.
#[must_use]
pub fn time_json(time_ns: u64) -> Value {
    json!({ "sec": time_ns / NS_PER_S, "nsec": time_ns % NS_PER_S })
}

/// A line of the log.
#[must_use]
pub fn log_json(time_ns: u64, level: Level, name: &str, message: &str) -> Value {
    let timestamp = time_json(time_ns);
    json!({ "timestamp": timestamp, "level": level as u8, "message": message, "name": name, "file": "", "line": 0 })
}
