//! The policies of a run: the answer to `policy show`.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The policies of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Policies {
    /// The one that decides.
    pub active: PolicyLife,
    /// The one before, which decides on until the new one does, and may come back.
    pub previous: Option<PolicyLife>,
    /// What is in force; a candidate is not until its probation is over.
    pub in_force: PolicySpec,
    /// The last swaps, the oldest of them first; the last one may be under way.
    pub swaps: Vec<SwapRecord>,
}

impl Policies {
    /// The swap of that number, if it is remembered.
    #[must_use]
    pub fn swap(&self, number: u64) -> Option<&SwapRecord> {
        self.swaps.iter().rev().find(|swap| swap.number == number)
    }
}

/// A life of the policy.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PolicyLife {
    /// Which.
    pub incarnation: u32,
    /// What it says that it runs. A policy may be another's executable, which says what it likes: see
    /// [`PolicyLife::says`].
    pub runs: Option<Value>,
}

impl PolicyLife {
    /// What it says of itself under that name, if it is a text. Policies of this project give `engine`, `model`,
    /// `sha256` and `not_trained_with`.
    #[must_use]
    pub fn says(&self, name: &str) -> Option<&str> {
        self.runs.as_ref()?.get(name)?.as_str().filter(|text| !text.is_empty())
    }
}

/// Which policy: the executable and the model that it loads. Both none: as configured.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicySpec {
    /// Another executable in place of `guidedog-policy`.
    pub exe: Option<PathBuf>,
    /// The model: the name of one that is built in, or a file.
    pub model: Option<PathBuf>,
}

/// How a swap went, or goes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SwapRecord {
    /// Counts the swaps of the run, from 1.
    pub number: u64,
    /// How far it is.
    pub state: SwapState,
    /// The candidate's incarnation; 0 where it was not started yet.
    pub candidate: u32,
    /// The incarnation that was active before.
    pub previous: u32,
    /// What was swapped in.
    pub spec: PolicySpec,
    /// Why it failed, or what the operator should know.
    pub why: Option<String>,
}

/// How far a swap is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SwapState {
    /// The candidate starts, loads and verifies its model.
    Starting,
    /// It decides in shadow.
    Shadow,
    /// It is named; no permit has carried its decision yet.
    Activating,
    /// It decides, and the way back is open.
    Probation,
    /// The operator went back; its last action ends.
    Returning,
    /// Decided; the policy that is not named any more has not ended yet.
    Ending,
    /// The candidate is in force.
    Done,
    /// The policy before is in force, as the operator wished.
    RolledBack,
    /// The policy before goes on.
    Failed,
    /// Read from the wire: a state that a later supervisor knows. Whether the swap is over is not known either.
    #[serde(other)]
    Unknown,
}

impl SwapState {
    /// The name, as in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Shadow => "shadow",
            Self::Activating => "activating",
            Self::Probation => "probation",
            Self::Returning => "returning",
            Self::Ending => "ending",
            Self::Done => "done",
            Self::RolledBack => "rolled_back",
            Self::Failed => "failed",
            Self::Unknown => "unknown",
        }
    }

    /// Whether nothing more comes of it.
    #[must_use]
    pub const fn is_over(self) -> bool {
        matches!(self, Self::Done | Self::RolledBack | Self::Failed)
    }
}

impl fmt::Display for SwapState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
