//! `guidedog bench`: its command line.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use settings::{LinkKind, Millis};

use super::values::duration;

/// `guidedog bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// What to measure.
    #[command(subcommand)]
    pub what: Bench,
}

/// What can be measured.
#[derive(Debug, Clone, Subcommand)]
pub enum Bench {
    /// One-way latency between processes with a blocking wake-up, beside a plain iceoryx2 program of the same QoS
    Transport {
        /// How long, seconds
        #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(4..=3600))]
        seconds: u32,
    },
    /// The shield beside the paper's pseudo-code, one core
    Shield {
        /// Measurements of each row; the pseudo-code is measured once in twenty
        #[arg(long, default_value_t = 4000, value_name = "N", value_parser = clap::value_parser!(u32).range(20..))]
        times: u32,
    },
    /// Decoding of lidar samples, of every packing, beside the fastest line, one core
    Decoders {
        /// Measurements of each row
        #[arg(long, default_value_t = 15, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
        times: u32,
    },
    /// What the shield makes of one depth frame, and how its floor tells the attitude, one core
    Depth {
        /// Measurements of each row
        #[arg(long, default_value_t = 99, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
        times: u32,
    },
    /// How evenly the link to a robot sends, with and without real-time priority, quiet and busy
    Link {
        /// Each of the four measurements lasts so long
        #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
        seconds: u32,
    },
    /// Decisions of simulated episodes a second, all cores: what training and evaluation are made of
    World {
        /// Measurements of each row
        #[arg(long, default_value_t = 15, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
        times: u32,
    },
    /// The odometry of recorded CARMEN logs, raw and corrected by their scans: errors side by side
    #[command(after_help = ODOMETRY_HELP)]
    Odometry {
        /// Logs (plain, .gz, .bz2)
        #[arg(required = true, value_name = "LOG")]
        logs: Vec<PathBuf>,
        /// Hand-checked relations of the logs' scans, a line each: t1 t2 x y z roll pitch yaw
        #[arg(long, value_name = "FILE")]
        relations: Option<PathBuf>,
    },
    /// Replays of one recording in stepped time: whether all actions and permits are equal, and how long one takes
    Replay {
        /// The recording (.mcap)
        recording: PathBuf,
        /// How many replays
        #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=100_000))]
        repeat: u32,
        /// Configuration file, laid over the recorded settings
        #[arg(long, value_name = "FILE")]
        config: Option<PathBuf>,
    },
    /// Every fault of every service and stream against the matrix (config/faults.toml), at random moments of a walk
    #[command(after_help = FAULTS_EXAMPLES)]
    Faults(FaultsArgs),
    /// What a thousand deaths leave behind, and how often a robot stops for no reason
    Soak(SoakArgs),
    /// Another policy again and again for a walking robot: decisions missed, stops, and how long a swap takes
    Swaps {
        /// How many swaps
        #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
        count: u32,
    },
    /// CPU and memory of the whole stack standing still, by service
    Idle {
        /// How long, seconds
        #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(2..=3600))]
        seconds: u32,
    },
}

const ODOMETRY_HELP: &str = "\
raw        the robot's own odometry
ours       the pose of each scan, as the matcher has it
published  what the service would have said at that scan's stamp: before it is matched, corrections fed in slowly

The times of a relation are those at which two scans were sent (ipc_time), within 1 ms; its error is how far the second
scan's pose, seen from the first's, is from the checked one. Without relations: how far the walls that are seen are from
the same walls seen 5 to 20 m of way before.";

const FAULTS_EXAMPLES: &str = "\
Examples:
  guidedog bench faults --cells 'lidar/scan:*'          every fault of one stream
  guidedog bench faults --cells '*:kill' --repeat 286   2,000 deaths of small services
  guidedog bench faults --repeat 20 --budget-s 3600 --json

Ends with exit code 1 where a cell that was tried is not as the matrix wants it.";

/// `guidedog bench faults`.
#[derive(Debug, Clone, Args)]
pub struct FaultsArgs {
    /// Which cells, as TARGET:FAULT with `*` for anything, several with commas between; without it, all but the host's
    #[arg(long, value_name = "PATTERN")]
    pub cells: Option<String>,
    /// Trials of each cell
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub repeat: u32,
    /// No trial begins after so many seconds
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(1..))]
    pub budget_s: Option<u64>,
    /// Limits count so many times, for machines that are shared
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = slack)]
    pub slack: f64,
    /// The robot is emulated, and the real link commands it: all cells in runs of that kind
    #[arg(long, value_name = "LINK", value_parser = robot_link)]
    pub robot: Option<LinkKind>,
    /// Seed of the moments at which faults come
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// `guidedog bench soak`.
#[derive(Debug, Clone, Args)]
pub struct SoakArgs {
    /// Kills of random services under load; 0 = none
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub kills: u32,
    /// Kills before those that count: what a service maps and keeps grows with its first lives
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub warm_up: u32,
    /// Also simulated walks without a fault, for so much run time, such as 1h
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub quiet: Option<Millis>,
}

fn robot_link(text: &str) -> Result<LinkKind, String> {
    let mut emulated = LinkKind::ALL.into_iter().filter(|link| link.row().emulated.is_some());
    emulated.find(|link| link.row().name == text).ok_or_else(|| {
        let names = LinkKind::names(|link| link.emulated.is_some()).map(str::to_owned);
        format!("it is {}", settings::either(&names.collect::<Vec<_>>()))
    })
}

fn slack(text: &str) -> Result<f64, String> {
    let factor = text.parse::<f64>().ok().filter(|factor| (1.0..=1000.0).contains(factor));
    factor.ok_or_else(|| "a factor is 1 to 1000".to_owned())
}

/// Which program of `bench transport`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Program {
    /// Over guidedog's transport.
    Ours,
    /// Over iceoryx2 alone.
    Plain,
}

/// The other end of `bench transport`.
#[derive(Debug, Args)]
pub struct ReceiverArgs {
    /// Which program.
    pub program: Program,
    /// The bench's run directory.
    pub dir: PathBuf,
}
