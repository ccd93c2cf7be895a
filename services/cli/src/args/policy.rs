//! `guidedog policy`: its command line.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, Subcommand};
use settings::PolicyModel;

use super::RunArg;

/// What `guidedog policy --help` ends with.
pub const HELP: &str = "\
Examples:
  guidedog policy swap --model careful.geometric    with its manifest careful.toml beside it
  guidedog policy swap --model guide                the learnt policy that is built in
  guidedog policy swap --exe ./my-policy            another executable in place of guidedog-policy
  guidedog policy rollback                          the policy before
  guidedog policy show

The new policy runs in shadow until its decisions are good, then it is named, and stays on probation with the one
before at hand. The walk goes on all the while. Where it fails, the one before goes on and the reason is told.";

/// A model's name, or its file; its path is told in reports and configurations, which are UTF-8.
pub fn policy_model() -> impl TypedValueParser<Value = PolicyModel> {
    PathBufValueParser::new().try_map(|path| match path.to_str() {
        Some(_) => Ok(PolicyModel::from(path)),
        None => Err("the path is not UTF-8"),
    })
}

/// `guidedog policy`.
#[derive(Debug, Args)]
pub struct PolicyArgs {
    /// What to do.
    #[command(subcommand)]
    pub what: PolicyVerb,
}

/// What `guidedog policy` does.
#[derive(Debug, Subcommand)]
pub enum PolicyVerb {
    /// Swap another policy in, and wait until a permit carries its decision
    Swap(SwapArgs),
    /// Go back to the policy before
    Rollback(PolicyRunArgs),
    /// Which policy is in force, and the last swaps
    Show(RunArg),
}

/// `guidedog policy swap`.
#[derive(Debug, Args)]
#[group(id = "candidate", required = true, multiple = true, args = ["model", "exe"])]
pub struct SwapArgs {
    /// `guide` or `geometric`, which are built in, or a model file with its manifest beside it
    #[arg(long, value_name = "guide|geometric|FILE", value_parser = policy_model())]
    pub model: Option<PolicyModel>,
    /// The executable to start in place of guidedog-policy
    #[arg(long, value_name = "FILE")]
    pub exe: Option<PathBuf>,
    /// Which run, and whether to wait.
    #[command(flatten)]
    pub run: PolicyRunArgs,
}

/// Which run, and whether to wait.
#[derive(Debug, Args)]
pub struct PolicyRunArgs {
    /// Wait for the end of the probation as well
    #[arg(long)]
    pub settle: bool,
    /// Which run.
    #[command(flatten)]
    pub run: RunArg,
}
