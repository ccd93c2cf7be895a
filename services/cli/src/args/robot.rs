//! `guidedog fit-robot`: its command line.

use std::path::PathBuf;

use clap::Args;

/// What `guidedog fit-robot --help` ends with.
pub const HELP: &str = "\
Examples:
  guidedog walk --scenario steps --policy steps --speed 0 --record steps.mcap      a simulated robot's steps
  guidedog up --config robot.toml --policy steps --record steps.mcap               a real robot's, once
  guidedog cue forward                                                             the handler says so
  guidedog fit-robot steps.mcap
  guidedog fit-robot steps.mcap again.mcap --output response.toml

The policy `steps` plays single motions, each with a stop after it: 2.5 m to every side have to be free, robot and
handler walk for six minutes. The intervals are of 95 %, by resampling the motions. What goes into the configuration is
rounded up. It is \"measured\" where a real robot was commanded, and \"simulated\" otherwise. docs/response.md says
more.";

/// `guidedog fit-robot`.
#[derive(Debug, Args)]
pub struct FitRobotArgs {
    /// Recordings of one robot that makes single motions (.mcap)
    #[arg(required = true, value_name = "RECORDING")]
    pub recordings: Vec<PathBuf>,
    /// Where to write [robot.response]; a file that is there is kept
    #[arg(short, long, value_name = "FILE.toml")]
    pub output: Option<PathBuf>,
}
