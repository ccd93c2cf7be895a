//! The policy's section.

use std::path::{Path, PathBuf};

use guidance::ActionTable;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::path::{ConfigPath, name_or_file};
use crate::units::Millis;

/// Which model decides, as configuration and command line name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(into = "PathBuf")]
pub enum PolicyModel {
    /// `guide`: the learnt policy that is built in.
    Guide,
    /// `geometric`: the engine that follows the travel line by geometry, as it is built.
    Geometric,
    /// `steps`: a fixed course of single motions in an empty room, from whose recording `guidedog fit-robot` tells how
    /// the robot answers a command. It guides no one.
    Steps,
    /// A model file, its manifest beside it.
    File(ConfigPath),
}

const GUIDE: &str = "guide";
const GEOMETRIC: &str = "geometric";
const STEPS: &str = "steps";

impl From<PathBuf> for PolicyModel {
    fn from(path: PathBuf) -> Self {
        path.to_str().and_then(Self::named).unwrap_or_else(|| Self::File(path.into()))
    }
}

impl<'de> Deserialize<'de> for PolicyModel {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        name_or_file(deserializer, Self::named, Self::File)
    }
}

impl From<PolicyModel> for PathBuf {
    fn from(model: PolicyModel) -> Self {
        match model {
            PolicyModel::Guide => GUIDE.into(),
            PolicyModel::Geometric => GEOMETRIC.into(),
            PolicyModel::Steps => STEPS.into(),
            PolicyModel::File(path) => path.into(),
        }
    }
}

impl PolicyModel {
    /// The built-in one of that name.
    fn named(name: &str) -> Option<Self> {
        match name {
            GUIDE => Some(Self::Guide),
            GEOMETRIC => Some(Self::Geometric),
            STEPS => Some(Self::Steps),
            _ => None,
        }
    }

    /// The file, where it is one.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::File(path) => Some(path),
            Self::Guide | Self::Geometric | Self::Steps => None,
        }
    }

    /// See [`PolicyModel::file`].
    pub fn file_mut(&mut self) -> Option<&mut ConfigPath> {
        match self {
            Self::File(path) => Some(path),
            Self::Guide | Self::Geometric | Self::Steps => None,
        }
    }
}

/// Which action table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionTableName {
    /// The eight actions that the paper names.
    Eight,
    /// The eight and a step back.
    Nine,
    /// The eight and two arcs of our own.
    Ten,
}

impl ActionTableName {
    /// The table of that name.
    #[must_use]
    pub fn table(self) -> ActionTable {
        match self {
            Self::Eight => ActionTable::eight(),
            Self::Nine => ActionTable::nine(),
            Self::Ten => ActionTable::ten(),
        }
    }
}

/// What the built-in planner does with what a network proposes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlannerUse {
    /// Nothing: the network decides.
    Off,
    /// It judges each action by where it leads, and decides alone for some seconds where robot and handler make no
    /// progress.
    Judge,
    /// It only decides alone for some seconds where they make no progress.
    TakeOver,
}

/// The policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PolicySettings {
    /// What decides.
    pub model: PolicyModel,
    /// What the built-in planner does with what a network proposes.
    pub planner: PlannerUse,
    /// Which actions.
    pub actions: ActionTableName,
    /// Decision period.
    pub dt: Millis,
    /// ONNX Runtime's library, which then runs learnt models; none: tract, which is built in.
    pub onnx_runtime: Option<ConfigPath>,
    /// What another policy has to show to be swapped in.
    pub swap: SwapSettings,
}

impl Default for PolicySettings {
    fn default() -> Self {
        Self {
            model: PolicyModel::Guide,
            planner: PlannerUse::Judge,
            actions: ActionTableName::Nine,
            dt: Millis::of_ms(500),
            onnx_runtime: None,
            swap: SwapSettings::default(),
        }
    }
}

/// What a policy has to show to be swapped in for another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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

#[cfg(test)]
mod tests {
    use super::{PolicyModel, PolicySettings};

    #[test]
    fn a_model_is_a_name_or_a_file() {
        for (word, model) in [
            ("guide", PolicyModel::Guide),
            ("geometric", PolicyModel::Geometric),
            ("steps", PolicyModel::Steps),
            ("models/guide.onnx", PolicyModel::File("models/guide.onnx".into())),
        ] {
            let read: PolicySettings = toml::from_str(&format!("model = \"{word}\"")).expect("a model");
            assert_eq!(read.model, model);
            assert_eq!(toml::from_str::<PolicySettings>(&toml::to_string(&read).expect("written")), Ok(read));
        }
    }
}
