//! The shield's section.

use guidance::{Draw, Footing, MemoryConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::units::{Millis, Positive, Share};

/// How an action is chosen among the safe ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// The most probable one; where that is to stop, one by their probabilities.
    Surest,
    /// One by their probabilities.
    Draw,
    /// The most probable one. Where that is to stop, the robot stands until what it sees changes.
    ArgMax,
}

impl Choice {
    /// How the shield draws with a seed.
    #[must_use]
    pub const fn seeded(self, seed: u64) -> Draw {
        match self {
            Self::Surest => Draw::Surest(seed),
            Self::Draw => Draw::Seeded(seed),
            Self::ArgMax => Draw::ArgMax,
        }
    }
}

/// The action shield.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ShieldSettings {
    /// How an action is chosen among the safe ones.
    pub choice: Choice,
    /// Seed of the drawing.
    pub seed: u64,
    /// Added to both radii, metres.
    pub margin_m: f64,
    /// Width of a run of unknown beams from which it is unsafe, metres.
    pub unknown_gap_m: Positive,
    /// Whether points inside the present hull are judged by the escape rule.
    pub escape: bool,
    /// Whether the hull of a motion ends where the handler comes to rest after it, and not where the motion ends.
    pub until_rest: bool,
    /// Largest unseen part of the hull, square metres; none: reported only.
    pub unseen_limit_m2: Option<f64>,
    /// What it remembers.
    pub memory: MemorySettings,
    /// Where the floor ends.
    pub floor: FloorSettings,
}

/// How far the shield keeps from an edge of the floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FloorSettings {
    /// Between the hull and an edge that the robot goes towards, metres.
    pub edge_ahead_m: f64,
    /// Between the hull and an edge beside its way, metres.
    pub edge_beside_m: f64,
    /// Whether robot and handler tread only on floor that the camera has seen. Without a camera, or a memory, they
    /// tread on any.
    pub watched: bool,
    /// How high a step may be that robot and handler take, once the handler says so; see [`guidance::StepMax::allows`].
    pub step_max_m: StepMaxSettings,
}

/// How high a step may be, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table { down, up }, metres")]
pub struct StepMaxSettings {
    /// One that leads down.
    pub down: f64,
    /// One that leads up.
    pub up: f64,
}

impl Default for StepMaxSettings {
    fn default() -> Self {
        Self { down: 0.12, up: 0.06 }
    }
}

impl Default for FloorSettings {
    fn default() -> Self {
        Self { edge_ahead_m: 0.35, edge_beside_m: 0.2, watched: true, step_max_m: StepMaxSettings::default() }
    }
}

/// The shield's obstacle memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MemorySettings {
    /// Off: one scan and one frame decide alone, as in the paper.
    pub on: bool,
    /// Obstacles that cannot be seen any more are kept for so long; longer while the robot stands.
    pub kept: Millis,
    /// What the camera alone saw, and from near by, below the lidar's plane or above it, is kept for so long.
    pub kept_off_plane: Millis,
    /// What a scan saw free counts for unknown beams for so long.
    pub free: Millis,
    /// By how much a remembered place is off: metres for each metre walked, and for each radian turned and metre away.
    pub drift: Share,
}

impl Default for MemorySettings {
    fn default() -> Self {
        Self {
            on: true,
            kept: Millis::of_ms(10_000),
            kept_off_plane: Millis::of_ms(60_000),
            free: Millis::of_ms(500),
            drift: Share::of(0.03),
        }
    }
}

impl MemorySettings {
    /// As the shield wants it, on or off; with the room that the robot stands on where floor is remembered.
    #[must_use]
    pub fn config(&self, footing: Option<Footing>) -> MemoryConfig {
        MemoryConfig {
            kept_ns: self.kept.ns(),
            kept_off_plane_ns: self.kept_off_plane.ns(),
            free_ns: self.free.ns(),
            drift: self.drift.get(),
            footing,
        }
    }
}

impl Default for ShieldSettings {
    fn default() -> Self {
        Self {
            choice: Choice::Surest,
            seed: 1,
            margin_m: 0.04,
            unknown_gap_m: Positive::of(0.10),
            escape: true,
            until_rest: false,
            unseen_limit_m2: None,
            memory: MemorySettings::default(),
            floor: FloorSettings::default(),
        }
    }
}
