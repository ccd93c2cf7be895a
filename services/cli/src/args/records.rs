//! `up`, and what looks at the records of runs: `logs`, `bundle`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::WorldArgs;

/// Help of `guidedog logs`.
pub const LOGS_HELP: &str = "\
Examples:
  guidedog logs                    everything of the only live run, or of the newest one
  guidedog logs lidar              what all lives of the lidar's driver wrote
  guidedog logs supervisor -f      what happens: modes, stops, restarts, swaps, refusals
  guidedog logs --run demo         of a run that has ended";

/// Help of `guidedog bundle`.
pub const BUNDLE_HELP: &str = "\
Example:
  guidedog bundle --run demo -o incident.tar.gz";

/// `guidedog up`.
#[derive(Debug, Default, Args)]
pub struct UpArgs {
    /// Where.
    #[command(flatten)]
    pub world: WorldArgs,
    /// Form of the lines on standard error: one for each change of mode, restart, swap and refusal
    #[arg(long, value_enum, value_name = "FORM", default_value_t)]
    pub log: LogForm,
    /// Lines of this level and above
    #[arg(long, value_enum, value_name = "LEVEL", default_value_t)]
    pub log_level: LogLevel,
}

/// Form of a line of the journal.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum LogForm {
    /// For people; under systemd with a priority for its journal
    #[default]
    Plain,
    /// One JSON object a line
    Json,
}

/// Level of a line of the journal.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum LogLevel {
    /// The run failed
    Error,
    /// Faults, locks, failed swaps, refusals
    Warn,
    /// Also every other change of mode, restarts, swaps, requests and notes
    #[default]
    Info,
    /// Also every stop within a walk, and every start
    Debug,
}

/// `guidedog logs`.
#[derive(Debug, Args)]
pub struct LogsArgs {
    /// The service, or `supervisor` for the journal of the run; without it, all
    pub service: Option<String>,
    /// Go on with what is written, until the run ends
    #[arg(short, long)]
    pub follow: bool,
    /// Name of the run; without it, the only live one, else the newest
    #[arg(long, value_name = "NAME")]
    pub run: Option<String>,
}

/// `guidedog bundle`.
#[derive(Debug, Args)]
pub struct BundleArgs {
    /// The file to write (.tar.gz)
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Name of the run; without it, the only live one, else the newest
    #[arg(long, value_name = "NAME")]
    pub run: Option<String>,
}
