//! The command line.

mod bench;
mod config;
pub mod cues;
mod emulate;
pub mod evaluate;
pub mod floor;
mod policy;
mod records;
mod robot;
mod values;
pub mod yardstick;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use messages::Pose2;
use settings::{Millis, PhysicsKind, PolicyModel, SimulatedNoise};

use crate::exit::{ENVIRONMENT_HELP, EXIT_CODES_HELP};
use values::{duration, field_of_view, noise, physics, run_name, speed, start, times};

pub use bench::{Bench, BenchArgs, FaultsArgs, Program, ReceiverArgs, SoakArgs};
pub use config::{ConfigArgs, ConfigCommand, ConfigVerb};
pub use emulate::{DdsArgs, Device, EmulateArgs};
pub use policy::{PolicyArgs, PolicyRunArgs, PolicyVerb, SwapArgs};
pub use records::{BundleArgs, LogsArgs, UpArgs};
pub use robot::FitRobotArgs;

/// Runs and operates the guide robot's stack of processes.
#[derive(Debug, Parser)]
#[command(name = "guidedog", version, after_help = main_help(), max_term_width = 100)]
pub struct Cli {
    /// One JSON object on stdout and nothing else there, on failure too: {"error": "..."}
    #[arg(long, global = true)]
    pub json: bool,
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

fn main_help() -> String {
    format!("{EXIT_CODES_HELP}\n\n{ENVIRONMENT_HELP}")
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Start the stack and leave it to the operator; becomes the supervisor
    #[command(after_help = UP_EXAMPLES)]
    Up(UpArgs),
    /// A simulated guided walk of the whole stack, with a summary at its end
    #[command(after_help = WALK_EXAMPLES)]
    Walk(WalkArgs),
    /// Mode, services and streams of a live run, or the record of an ended one
    Status(RunArg),
    /// Why the robot stands, and the last stops with their evidence; of an ended run also why it ended
    Why(WhyArgs),
    /// Show the configuration with the origin of each value, or its schema
    #[command(after_help = config::HELP)]
    Config(ConfigCommand),
    /// Live runs and ended ones, the newest first
    Runs,
    /// The journal of a run and the logs of its services
    #[command(after_help = records::LOGS_HELP)]
    Logs(LogsArgs),
    /// Pack everything about a run into one file: record, last minute of its recording, doctor, versions
    #[command(after_help = records::BUNDLE_HELP)]
    Bundle(BundleArgs),
    /// Give a cue, as the handler would, or fit the recogniser to a handler's voice
    #[command(after_help = "Examples:\n  guidedog cue left\n  guidedog cue enrol -o anna")]
    Cue(cues::CueArgs),
    /// Stop the robot and lock the run until `guidedog resume`
    Stop(StopArgs),
    /// End a lock; the robot still waits for a cue
    Resume(RunArg),
    /// Swap the policy of a live run for another, go back, or show which is in force
    #[command(after_help = policy::HELP)]
    Policy(PolicyArgs),
    /// Break something in a run that was started with --faults, to see what comes of it
    #[command(after_help = inject_help())]
    Inject(InjectArgs),
    /// Check what a run needs of this machine, and say how to mend what is missing
    Doctor(DoctorArgs),
    /// Record a live run until Ctrl-C, or for so long
    #[command(after_help = "Example:\n  guidedog record -o walk.mcap --duration 30s")]
    Record(RecordArgs),
    /// Look into a recording, check it, or make a whole one of one that is torn
    Recording(RecordingArgs),
    /// Import other people's logs into recordings
    Import(ImportArgs),
    /// Run recorded frames through policy, shield and locomotion, in the drivers' place
    #[command(after_help = REPLAY_EXAMPLES)]
    Replay(ReplayArgs),
    /// Fit interaction models to recorded walks of handlers, and set them beside the paper's
    #[command(after_help = FIT_HELP)]
    Fit(FitArgs),
    /// Identify how a robot answers commands (delay, overrun, sway) from recordings of single motions
    #[command(name = "fit-robot", after_help = robot::HELP)]
    FitRobot(FitRobotArgs),
    /// Run episodes of the wayfinding task with a policy, and tell how it fares
    #[command(after_help = evaluate::HELP)]
    Evaluate(evaluate::EvaluateArgs),
    /// Walk public benchmarks of robot navigation, and tell their own scores
    Yardstick(yardstick::YardstickArgs),
    /// Play recorded speech to the cue recogniser, and tell what it hears and what it mishears
    #[command(name = "evaluate-cues", after_help = cues::HELP)]
    EvaluateCues(cues::EvaluateCuesArgs),
    /// A device that is not there, as a process of its own, for whatever would speak to the real one
    #[command(after_help = emulate::HELP)]
    Emulate(EmulateArgs),
    /// Ask the shield itself: one case a line on standard input, one answer a line on standard output
    #[command(after_help = SHIELD_HELP)]
    Shield(ShieldArgs),
    /// What the shield makes of the floor in one depth frame: where it is, and where it drops
    #[command(after_help = floor::HELP)]
    Floor(floor::FloorArgs),
    /// Measure
    Bench(BenchArgs),
    /// The other end of `bench transport`
    #[command(hide = true)]
    BenchReceiver(ReceiverArgs),
}

const FIT_HELP: &str = "\
Examples:
  guidedog fit --synthesize                                  nine simulated handlers, all models, the table
  guidedog fit --synthesize --output walks.csv --svg walk.svg
  guidedog fit walks.csv --model delayed --per-subject --json

Columns: subject,trajectory,repetition,t_s,robot_x_m,robot_y_m,robot_yaw_rad,human_x_m,human_y_m,human_yaw_rad; times
rising, gaps at most 0.25 s. The last walk of each trajectory validates, the others fit. Subjects named sim-... are
simulated.";

const SHIELD_HELP: &str = r#"
A case (paper mode: no escape rule, no memory), on one line:
  {"id": 1, "scan": {"angle_min_rad": -3.14, "angle_increment_rad": 0.0175, "range_min_m": 0.15, "range_max_m": 12,
   "ranges_m": [1.5, "inf", null, ...]}, "robot_from_lidar": [x, y, yaw], "robot_from_handler": [x, y, yaw],
   "interaction": {"model": "delayed", "alpha": 0.4, "dt_s": 0.5, "offset": [x, y, yaw]},
   "actions": [{"name": "stop", "motion": [dx, dy, dyaw], "dt_s": 0.5}, ...], "robot_radius_m": 0.3,
   "handler_radius_m": 0.25, "handler_mask_margin_m": 0.03, "probabilities": [...], "beta": 0.5, "unknown_gap_m": 0.1}
Also {"model": "rigid", "offset": [..]} and {"model": "rod", "grip": [x, y], "length_m": 0.8}. A mask margin of null
masks nothing; unknown_gap_m may be left out. A reading at or over range_max_m or "inf" hit nothing, however far; null
or under range_min_m is unknown. All frames are the robot's present one, the answer's "next_handler" included. A margin
is null where no judged beam hit anything."#;

const UP_EXAMPLES: &str = "\
Examples:
  guidedog up                                  the built-in corridor, no scripted handler: cues are yours
  guidedog up --scenario left-at-tee           with the scenario's own cues, goal and time limit
  guidedog up --map floor.yaml --start 1,2,0   a ROS map_server map";

const WALK_EXAMPLES: &str = "\
Examples:
  guidedog walk                                          the built-in corridor, in real time
  guidedog walk --scenario left-at-tee --speed 10        at most 10 times faster than real
  guidedog walk --scenario curve --speed 0 --json        as fast as it goes; the report on stdout
  guidedog walk --map floor.yaml --start 3,1.5,90deg --cues route.toml

A walk ends at its goal or its time limit. Where neither route nor configuration sets a limit it is 600 s of run
time, or 120 s where there is no goal: such a walk is well (exit code 0) when it lasts that long without a collision.";

const REPLAY_EXAMPLES: &str = "\
Examples:
  guidedog import carmen fr079.clf.bz2 -o fr079.mcap
  guidedog replay fr079.mcap --duration 60s
  guidedog walk --speed 0 --record walk.mcap
  guidedog replay walk.mcap --speed 0 --json                          the very permits that were recorded
  guidedog replay walk.mcap --speed 0 --against --config wider.toml   what other settings would have decided
  guidedog replay walk.mcap --streams depth --speed 0                 recorded depth into a simulated walk

A recording brings the settings of its run along; --config lies over them. In stepped time (--speed) a replay gives the
same bytes every time; that of a stepped run which was recorded whole gives the actions and permits of that run, and the
report's `compared` says so. What an operator's stop did is not in the streams, and is not replayed.";

/// Which run.
#[derive(Debug, Args)]
pub struct RunArg {
    /// Name of the run; without it, the only live one
    #[arg(long, value_name = "NAME")]
    pub run: Option<String>,
}

/// `guidedog stop`.
#[derive(Debug, Args)]
pub struct StopArgs {
    /// Name of the run; without it, every run that is alive
    #[arg(long, value_name = "NAME", conflicts_with = "all")]
    pub run: Option<String>,
    /// Every run that is alive; one report for all of them
    #[arg(long)]
    pub all: bool,
}

/// `guidedog why`.
#[derive(Debug, Args)]
pub struct WhyArgs {
    /// List every reason that there is, with what to do about it
    #[arg(long, conflicts_with = "run")]
    pub reasons: bool,
    /// Which run.
    #[command(flatten)]
    pub run: RunArg,
}

/// `guidedog inject`.
#[derive(Debug, Args)]
pub struct InjectArgs {
    /// A stream, a service or `host`
    pub target: String,
    /// Which fault; `none` mends the target
    pub fault: String,
    /// How long, such as 2s; without it, until `none`
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    pub lasts: Option<Millis>,
    /// Seed of what is random about it
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Which run.
    #[command(flatten)]
    pub run: RunArg,
}

const INJECT_EXAMPLES: &str = "\
Examples:
  guidedog inject lidar/scan off --for 2s
  guidedog inject policy kill
  guidedog inject odometry none";

/// The table of faults as `guidedog inject --help` tells it.
fn inject_help() -> String {
    let names = |topics: &[messages::TopicId]| topics.iter().map(|topic| topic.name()).collect::<Vec<_>>().join(", ");
    let streams = names(&messages::fault::streams().collect::<Vec<_>>());
    let mut help = format!("Streams: {streams}, health/SERVICE\n");
    help += "Processes: a service's name, or service/NAME where a stream is called so too\nFaults:\n";
    for row in messages::fault::FAULTS {
        help += &format!("  {:14} {}\n", row.name, row.what);
    }
    help + INJECT_EXAMPLES
}

/// How run time passes and what the run is called.
#[derive(Debug, Default, Args)]
pub struct PaceArgs {
    /// The configuration.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Stepped time, at most K times faster than real; 0 = as fast as it goes; absent = real time
    #[arg(long, value_name = "K", allow_negative_numbers = true, value_parser = speed)]
    pub speed: Option<f64>,
    /// Name of the run
    #[arg(long, value_name = "RUN", value_parser = run_name)]
    pub name: Option<String>,
    /// Record the whole run, from its first step on (.mcap; depth frames in .depth.mcap beside it)
    #[arg(long, value_name = "RECORDING")]
    pub record: Option<PathBuf>,
    /// Let `guidedog inject` break things in the run
    #[arg(long)]
    pub faults: bool,
}

/// Where the robot walks.
#[derive(Debug, Default, Args)]
pub struct WorldArgs {
    /// A scenario's name (config/scenarios/NAME.toml) or file
    #[arg(long, value_name = "NAME|FILE", conflicts_with_all = ["map", "start"])]
    pub scenario: Option<String>,
    /// A ROS map_server map (.yaml) or a world file (.toml) in place of a scenario
    #[arg(long, value_name = "YAML", requires = "start")]
    pub map: Option<PathBuf>,
    /// Start in the map: metres, metres, radians (or 90deg)
    #[arg(long, value_name = "x,y,yaw", requires = "map", allow_hyphen_values = true, value_parser = start)]
    pub start: Option<Pose2>,
    /// What moves robot and handler: the project's own flat world, or a legged robot in MuJoCo
    #[arg(long, value_name = "flat|mujoco", value_parser = physics)]
    pub physics: Option<PhysicsKind>,
    /// The robot of the flat world: it obeys exactly, or walks on legs as a Go2 does in MuJoCo, and so lags, overruns,
    /// sways and tilts
    #[arg(long, value_name = "noisy|legged", value_parser = noise)]
    pub noise: Option<SimulatedNoise>,
    /// A route file: cues, and a goal and a time limit if it has them, in place of the scenario's
    #[arg(long, value_name = "FILE")]
    pub cues: Option<PathBuf>,
    /// What decides, in place of the configuration's
    #[arg(long, value_name = "guide|geometric|steps|FILE", value_parser = policy::policy_model())]
    pub policy: Option<PolicyModel>,
    /// Cues are spoken, and heard by the microphone, a WAV file or a pipe; the robot answers; real time only
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "")]
    #[arg(conflicts_with_all = ["speed", "cues"])]
    pub voice: Option<OsString>,
    /// Real drivers and a real link, to devices emulated in the simulated world of either physics; real time only
    #[arg(long, conflicts_with = "speed")]
    pub emulated: bool,
    /// Pace and name.
    #[command(flatten)]
    pub pace: PaceArgs,
}

/// `guidedog walk`.
#[derive(Debug, Default, Args)]
pub struct WalkArgs {
    /// Where.
    #[command(flatten)]
    pub world: WorldArgs,
    /// Seed of everything random in world, sensors and shield
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// The handler errs: faces off the travel line at the start, degrees to the left
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub orientation_error: Option<f64>,
    /// The handler errs: gives the cues of places too late, metres of way; negative is too early
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub timing_error: Option<f64>,
    /// The walk ends after this much run time, such as 120s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub time_limit: Option<Millis>,
}

/// `guidedog doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// The configuration whose depth frames are to fit, and whose devices are looked at
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Also run the sensors for so long, such as 5s, nobody giving cues, and hold their rates against the configuration
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub rates: Option<Millis>,
}

/// `guidedog import`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// Which format.
    #[command(subcommand)]
    pub format: ImportFormat,
}

/// What can be imported.
#[derive(Debug, Subcommand)]
pub enum ImportFormat {
    /// A CARMEN log (.clf, also .bz2 or .gz), as in the Radish repository
    #[command(after_help = "Example:\n  guidedog import carmen fr079.clf.bz2 -o fr079.mcap")]
    Carmen {
        /// The log
        log: PathBuf,
        /// The recording to write (.mcap)
        #[arg(short, long, value_name = "RECORDING")]
        output: PathBuf,
        /// Replace a recording that is there
        #[arg(long)]
        force: bool,
        /// Take a truncated log as far as it goes
        #[arg(long)]
        allow_truncated: bool,
    },
    /// What an RPLIDAR sent on its serial line in standard scan mode, byte for byte
    #[command(after_help = "Example:\n  guidedog import rplidar frame_*.bin -o room.mcap")]
    Rplidar {
        /// What the lidar sees past its own mount, half to either side of straight ahead, degrees
        #[arg(long, value_name = "DEG", default_value_t = 360.0, value_parser = field_of_view)]
        field_of_view: f64,
        /// The captures, in their order
        #[arg(required = true, value_name = "CAPTURE")]
        captures: Vec<PathBuf>,
        /// The recording to write (.mcap)
        #[arg(short, long, value_name = "RECORDING")]
        output: PathBuf,
        /// Replace a recording that is there
        #[arg(long)]
        force: bool,
    },
}

/// `guidedog record`.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// The recording to write (.mcap; depth frames in .depth.mcap beside it)
    #[arg(short, long, value_name = "RECORDING", required_unless_present = "stop")]
    pub output: Option<PathBuf>,
    /// End it after so long, such as 30s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub duration: Option<Millis>,
    /// End the recording that another `record` began, which may have been killed
    #[arg(long, conflicts_with_all = ["output", "duration"])]
    pub stop: bool,
    /// Which run.
    #[command(flatten)]
    pub run: RunArg,
}

/// `guidedog recording`.
#[derive(Debug, Args)]
pub struct RecordingArgs {
    /// What to do.
    #[command(subcommand)]
    pub what: RecordingVerb,
}

/// What can be done with a recording.
#[derive(Debug, Subcommand)]
pub enum RecordingVerb {
    /// What it says about itself
    Info {
        /// The recording (.mcap)
        recording: PathBuf,
    },
    /// Read every record; exit code 2, with the byte, where one is damaged or missing
    Check {
        /// The recording (.mcap)
        recording: PathBuf,
    },
    /// Write a whole copy of one whose recorder was killed or whose disk was full, and say what is lost
    Recover {
        /// The torn recording (.mcap)
        recording: PathBuf,
        /// The whole one to write; NAME.recovered.mcap where this is left out
        #[arg(short, long, value_name = "RECORDING")]
        output: Option<PathBuf>,
    },
}

/// `guidedog replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// The recording (.mcap)
    pub recording: PathBuf,
    /// Only these of its streams (scan, odometry, depth, cue); the other drivers run as they are configured
    #[arg(long, value_name = "STREAM,...", value_delimiter = ',', value_enum)]
    pub streams: Vec<Stream>,
    /// Leave out what was recorded before, such as 10s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub from: Option<Millis>,
    /// Leave out what was recorded from then on, such as 60s
    #[arg(long, value_name = "TIME", value_parser = duration, conflicts_with = "duration")]
    pub to: Option<Millis>,
    /// Only so much of it, such as 60s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub duration: Option<Millis>,
    /// Play it N times; without N until Ctrl-C
    #[arg(long = "loop", value_name = "N", num_args = 0..=1, default_missing_value = "0", value_parser = times)]
    pub times: Option<u32>,
    /// Show where the policy and the shield that are configured now decide differently; exit code 7 if they do
    #[arg(long, conflicts_with_all = ["streams", "times"])]
    pub against: bool,
    /// Pace and name.
    #[command(flatten)]
    pub pace: PaceArgs,
}

/// A stream of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Stream {
    /// `lidar/scan`
    Scan,
    /// `odometry`
    Odometry,
    /// `depth/frame`
    Depth,
    /// `cue`
    Cue,
}

/// `guidedog fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// Recorded walks
    #[arg(value_name = "DATA.csv", required_unless_present = "synthesize", conflicts_with = "synthesize")]
    pub data: Option<PathBuf>,
    /// Nine simulated handlers on the paper's five trajectories, three walks each, in place of a file
    #[arg(long)]
    pub synthesize: bool,
    /// Seed of the simulated handlers
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Where to keep the simulated walks
    #[arg(short, long, value_name = "FILE", requires = "synthesize")]
    pub output: Option<PathBuf>,
    /// One model; without it the table of all
    #[arg(long, value_enum)]
    pub model: Option<FitModel>,
    /// One fit for each subject (the default)
    #[arg(long, requires = "model", conflicts_with = "pooled")]
    pub per_subject: bool,
    /// One fit for all subjects together
    #[arg(long, requires = "model")]
    pub pooled: bool,
    /// Step of the model: the decision period
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = duration)]
    pub dt: Millis,
    /// Where to draw the first subject's last walk, with the rigid and the delayed harness
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
}

/// Which interaction model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FitModel {
    /// A fixed offset.
    Rigid,
    /// A rod that turns about the robot's grip.
    Rod,
    /// The delayed harness.
    Delayed,
}

/// `guidedog shield`.
#[derive(Debug, Args)]
pub struct ShieldArgs {
    /// Cases on standard input, answers on standard output, one a line
    #[arg(long, required_unless_present = "recording", conflicts_with = "recording")]
    pub jsonl: bool,
    /// Also every beam's threshold for every action
    #[arg(long, requires = "jsonl")]
    pub thresholds: bool,
    /// How often it would have been in the way of a recorded robot
    #[arg(long, value_name = "RECORDING")]
    pub recording: Option<PathBuf>,
    /// The configuration that says how large robot and handler are
    #[arg(long, value_name = "FILE", requires = "recording")]
    pub config: Option<PathBuf>,
}

#[cfg(test)]
mod tests {
    use super::{Cli, Verb};
    use clap::{CommandFactory, Parser};

    fn parse(line: &str) -> Result<Cli, clap::Error> {
        Cli::try_parse_from(line.split_whitespace())
    }

    #[test]
    fn the_definition_holds() {
        Cli::command().debug_assert();
    }

    #[test]
    fn usage_errors_end_with_the_code_of_bad_input() {
        for line in [
            "guidedog",
            "guidedog fly",
            "guidedog walk --speed -1",
            "guidedog walk --speed nan",
            "guidedog walk --map m.yaml",
            "guidedog walk --start 1,2,3",
            "guidedog walk --scenario a --map m.yaml --start 0,0,0",
            "guidedog walk --name ../x",
            "guidedog walk --time-limit 0s",
            "guidedog walk --time-limit 5",
            "guidedog cue up",
            "guidedog import carmen a.clf",
            "guidedog bench transport --seconds 0",
        ] {
            assert_eq!(parse(line).expect_err(line).exit_code(), i32::from(crate::exit::EXIT_BAD_INPUT), "{line}");
        }
    }

    #[test]
    fn json_may_stand_anywhere() {
        for line in ["guidedog --json status", "guidedog status --json", "guidedog bench idle --json"] {
            assert!(parse(line).expect(line).json, "{line}");
        }
    }

    #[test]
    fn a_start_may_be_negative_and_in_degrees() {
        let cli = parse("guidedog walk --map m.yaml --start -3,-1.5,-90deg").expect("it is right");
        let Verb::Walk(walk) = cli.verb else { panic!("it is a walk") };
        let pose = walk.world.start.expect("it was given");
        assert_eq!((pose.x_m, pose.y_m), (-3.0, -1.5));
        assert!((pose.yaw_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}
