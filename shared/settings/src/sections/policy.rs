//! The policy's section.

use std::path::PathBuf;

use guidance::ActionTable;
use serde::{Deserialize, Serialize};

use crate::units::Millis;

/// Which policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PolicyEngine {
    /// Follows the travel line from lidar and depth by geometry.
    Geometric,
}

/// Which action table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionTableName {
    /// The eight actions that the paper names.
    Eight,
    /// The eight and two arcs of our own.
    Ten,
}

impl ActionTableName {
    /// The table of that name.
    #[must_use]
    pub fn table(self) -> ActionTable {
        match self {
            Self::Eight => ActionTable::eight(),
            Self::Ten => ActionTable::ten(),
        }
    }
}

/// The policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicySettings {
    /// Which policy.
    pub engine: PolicyEngine,
    /// Which actions.
    pub actions: ActionTableName,
    /// Decision period.
    pub dt: Millis,
    /// The model to load, with its manifest beside it; none: the engine as it is built.
    pub model: Option<PathBuf>,
    /// ONNX Runtime's library, which then runs learnt models; none: tract, which is built in.
    pub onnx_runtime: Option<PathBuf>,
    /// What another policy has to show to be swapped in.
    pub swap: SwapSettings,
}

impl Default for PolicySettings {
    fn default() -> Self {
        Self {
            engine: PolicyEngine::Geometric,
            actions: ActionTableName::Eight,
            dt: Millis::of_ms(500),
            model: None,
            onnx_runtime: None,
            swap: SwapSettings::default(),
        }
    }
}

/// What a policy has to show to be swapped in for another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SwapSettings {
    /// Good decisions in a row, in shadow.
    pub decisions: u32,
    /// Longest time from when a decision is due to its publication.
    pub latency: Millis,
    /// How long the policy before stays at hand.
    pub probation: Millis,
}

impl Default for SwapSettings {
    fn default() -> Self {
        Self { decisions: 4, latency: Millis::of_ms(100), probation: Millis::of_ms(3000) }
    }
}
