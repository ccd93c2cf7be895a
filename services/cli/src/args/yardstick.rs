//! Arguments of `guidedog yardstick`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use settings::PolicyModel;

use super::policy::policy_model;

/// Which yardstick.
#[derive(Debug, Clone, Args)]
pub struct YardstickArgs {
    /// Which.
    #[command(subcommand)]
    pub which: Yardstick,
}

/// The yardsticks.
#[derive(Debug, Clone, Subcommand)]
pub enum Yardstick {
    /// Worlds of the BARN challenge, with the score of its organisers
    #[command(after_help = BARN_HELP)]
    Barn(BarnArgs),
    /// Episodes of SocNavBench among recorded pedestrians, with its metrics
    #[command(after_help = SOCNAVBENCH_HELP)]
    Socnavbench(SocnavbenchArgs),
}

/// `guidedog yardstick barn`.
#[derive(Debug, Clone, Args)]
pub struct BarnArgs {
    /// Worlds (`world_N.world` or `world_N.world.xz`, each with `path_N.npy` beside it), or folders of them
    #[arg(required = true, value_name = "FOLDER|FILE")]
    pub worlds: Vec<PathBuf>,
    /// How.
    #[command(flatten)]
    pub how: HowArgs,
}

/// `guidedog yardstick socnavbench`.
#[derive(Debug, Clone, Args)]
pub struct SocnavbenchArgs {
    /// The episodes: SocNavBench's `episode_params_val.ini`
    #[arg(value_name = "FILE")]
    pub episodes: PathBuf,
    /// How the tracks are to be read: its `dataset_params.ini`; without it, the one beside the episodes
    #[arg(long, value_name = "FILE")]
    pub datasets: Option<PathBuf>,
    /// Folder of the tracks (`eth.csv`, `hotel.csv`, ..., packed as `.xz` or not); without it, that of the episodes
    #[arg(long, value_name = "FOLDER")]
    pub tracks: Option<PathBuf>,
    /// Only these episodes, by their names in the file
    #[arg(long, value_name = "NAME", num_args = 1..)]
    pub only: Vec<String>,
    /// How.
    #[command(flatten)]
    pub how: HowArgs,
}

/// What all yardsticks have in common.
#[derive(Debug, Clone, Args)]
pub struct HowArgs {
    /// Who walks
    #[arg(long, value_enum, default_value_t = BodyArg::Robot)]
    pub body: BodyArg,
    /// How exact the sensors are
    #[arg(long, value_enum, default_value_t = YardstickNoise::Legged)]
    pub noise: YardstickNoise,
    /// What decides for the pair: `guide` or `geometric`, or a model file. The robot alone has a planner of its own
    #[arg(long, value_name = "guide|geometric|FILE", default_value = "geometric", value_parser = policy_model())]
    pub policy: PolicyModel,
    /// The action table of the robot alone, for decisions of 0.2 s; without it, `config/actions/solo.toml`
    #[arg(long, value_name = "FILE")]
    pub actions: Option<PathBuf>,
    /// Walks through each world or episode, each with other noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeats: u32,
    /// Noise follows from it
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write a picture (SVG) of each walk into this folder
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
    /// Write what became of each walk into this file, a line of JSON for each
    #[arg(long, value_name = "FILE")]
    pub outcomes: Option<PathBuf>,
    /// Number of threads; without it, one for each core. The figures are the same
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub workers: Option<u32>,
    /// Robot, sensors, handler and shield, laid over the profile of a Go2
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// How exact the sensors are. Exact sensors are left out: in the open all their depth frames are equal, and a camera
/// that repeats its frame stops the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum YardstickNoise {
    /// Gaussian lidar noise with drop-outs, Redwood depth noise at 1.0, drifting odometry
    Noisy,
    /// The same, and a robot that walks on legs as a Go2 does in MuJoCo: it lags, overruns, sways, tilts and slips
    Legged,
}

/// Who walks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BodyArg {
    /// The robot alone, which knows where the goal is
    Robot,
    /// The robot with a handler at its harness, who says forward and faces the goal
    Pair,
}

const BARN_HELP: &str = "\
Examples:
  guidedog yardstick barn worlds/BARN
  guidedog yardstick barn world_105.world.xz --body pair --pictures pictures
  guidedog yardstick barn worlds/BARN --repeats 10 --json

The robot starts at (-2.25, 3), faces up, and is at the goal within 1 m of (-2.25, 13). A touch ends the walk, and so do
100 s. Time counts from the first 0.1 m on. The optimal time is the length of the reference path, from start to goal,
divided by 2 m/s. Score: optimal time / (time, but at least 2 and at most 8 optimal times), 0 without success.
The shield judges every action of either body.";

const SOCNAVBENCH_HELP: &str = "\
Examples:
  guidedog yardstick socnavbench episode_params_val.ini
  guidedog yardstick socnavbench episode_params_val.ini --only t_eth_dense_against --body pair --pictures pictures

People walk where they were recorded, and do not react. A touch with them does not end an episode: pedestrian_collisions
counts those into which robot or handler moved, hit_by_others the others. The maps of SocNavBench are not read: nothing
but people is in the way. Episodes whose tracks are not in the folder are listed, and not walked.";
