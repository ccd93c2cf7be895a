//! The configuration: what every run takes of it, and `config`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use settings::{Operator, Profile};

/// Help of `guidedog config`.
pub const HELP: &str = "\
Examples:
  guidedog config show --config robot.toml --set lidar.rate_hz=8    every value, and where it comes from
  guidedog config schema > guidedog.schema.json                     for an editor: #:schema ./guidedog.schema.json";

/// What the operator lays over the defaults.
#[derive(Debug, Clone, Default, Args)]
pub struct ConfigArgs {
    /// Configuration file, laid over the defaults; its relative paths start at its own folder
    #[arg(long = "config", value_name = "FILE")]
    pub file: Option<PathBuf>,
    /// A single value over those of the file, such as lidar.rate_hz=8; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl ConfigArgs {
    /// That, for the settings.
    pub fn operator(&self) -> Operator {
        Operator { file: self.file.clone(), set: self.set.clone() }
    }

    /// Whether there is any.
    pub fn is_given(&self) -> bool {
        self.file.is_some() || !self.set.is_empty()
    }
}

/// `guidedog config`.
#[derive(Debug, Args)]
pub struct ConfigCommand {
    /// What to do.
    #[command(subcommand)]
    pub verb: ConfigVerb,
}

/// What can be done with the configuration.
#[derive(Debug, Subcommand)]
pub enum ConfigVerb {
    /// Print the whole configuration with the file and line of each value
    Show {
        /// What the operator lays over the defaults.
        #[command(flatten)]
        config: ConfigArgs,
        /// The defaults that it is laid over; without it, those for the physics that it names
        #[arg(long, value_enum, value_name = "NAME")]
        profile: Option<ProfileName>,
    },
    /// Print a JSON schema of the configuration file, for editors
    Schema,
}

/// A set of defaults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProfileName {
    /// A simulated walk
    Walk,
    /// The same with a Go2 on legs (`--noise legged`)
    Go2,
    /// The same in MuJoCo (`--physics mujoco`)
    Mujoco,
    /// Recorded laser logs
    Carmen,
}

impl From<ProfileName> for Profile {
    fn from(name: ProfileName) -> Self {
        match name {
            ProfileName::Walk => Self::Walk,
            ProfileName::Go2 => Self::Go2,
            ProfileName::Mujoco => Self::Mujoco,
            ProfileName::Carmen => Self::Carmen,
        }
    }
}
