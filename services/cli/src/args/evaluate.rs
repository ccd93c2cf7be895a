//! Arguments of `guidedog evaluate`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use settings::{Choice, PlannerUse, PolicyModel};

use super::ConfigArgs;
use super::policy::policy_model;

/// How many episodes of what, by whom.
#[derive(Debug, Clone, Args)]
pub struct EvaluateArgs {
    /// `guide` or `geometric`, which are built in, or a model file (`NAME.onnx`, `NAME.geometric`) with its manifest
    /// beside it
    #[arg(long, value_name = "guide|geometric|FILE", default_value = "guide", value_parser = policy_model())]
    pub policy: PolicyModel,
    /// `generated`; `buildings`, generated corridors whose walls are like those of real floors; or ROS maps
    /// (`MAP.yaml`), one or more
    #[arg(long, value_name = "generated|buildings|MAP.yaml", num_args = 1.., default_value = "generated")]
    pub worlds: Vec<PathBuf>,
    /// Episodes: one cue and a hundred decisions each
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub episodes: u32,
    /// How exact the sensors are
    #[arg(long, value_enum, default_value_t = NoiseArg::Noisy)]
    pub noise: NoiseArg,
    /// The shield's suppression factor: 0 never takes what it forbids, 1 is no shield
    #[arg(long, default_value_t = 0.0, value_name = "BETA")]
    pub beta_test: f64,
    /// How handlers follow
    #[arg(long, value_enum, default_value_t = HarnessArg::Delayed)]
    pub harness: HarnessArg,
    /// Who they are: the configuration's, or another one in each episode
    #[arg(long, value_enum, default_value_t = HandlersArg::Personal)]
    pub handlers: HandlersArg,
    /// What is asked
    #[arg(long, value_enum, default_value_t = TasksArg::Mixed)]
    pub tasks: TasksArg,
    /// Who walks about
    #[arg(long, value_enum, default_value_t = PeopleArg::Paths)]
    pub people: PeopleArg,
    /// Columns and rows of the camera
    #[arg(long, value_name = "WxH", default_value = "128x64", value_parser = pixels)]
    pub camera: [usize; 2],
    /// How an action is chosen among those that are left, in place of the configuration's
    #[arg(long, value_enum)]
    pub choice: Option<ChoiceArg>,
    /// What the built-in planner does with what a network proposes, in place of the configuration's
    #[arg(long, value_enum)]
    pub planner: Option<PlannerArg>,
    /// Worlds, handlers, noise and draws follow from it
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The same episodes without the shield as well, and the difference
    #[arg(long)]
    pub paired: bool,
    /// Write pictures (SVG) of the first twelve episodes, and of twelve that went wrong, into this folder
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
    /// Walk nothing: tell what the first N tasks ask for; with --pictures draw them, too (task-0.svg, ...)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    #[arg(conflicts_with_all = ["outcomes", "resume", "shard", "paired", "merge"])]
    pub explain: Option<u32>,
    /// Store each episode that fails as a file for --replay in this folder, with index.html (what fails most comes
    /// first, with pictures) and failures.json
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["shard", "merge", "explain"])]
    pub failures: Option<PathBuf>,
    /// Walk episodes again, and tell what changed: files of --failures, folders of them, or numbers of episodes. Other
    /// arguments replace those of a file
    #[arg(long, value_name = "FILE|FOLDER|NUMBER", num_args = 1..)]
    #[arg(conflicts_with_all = ["outcomes", "resume", "shard", "paired", "merge", "explain", "failures"])]
    pub replay: Vec<String>,
    /// Write what became of each episode into this file, a line of JSON for each
    #[arg(long, value_name = "FILE", conflicts_with = "paired")]
    pub outcomes: Option<PathBuf>,
    /// Go on with the file of --outcomes where an earlier evaluation left it
    #[arg(long, requires = "outcomes")]
    pub resume: bool,
    /// Of the episodes only part I of N, counted from 1: several machines share an evaluation
    #[arg(long, value_name = "I/N", value_parser = shard, requires = "outcomes", conflicts_with = "pictures")]
    pub shard: Option<[u32; 2]>,
    /// Run nothing: report the episodes in the --outcomes files of shards; with --outcomes write them into one file.
    /// Other arguments do not count
    #[arg(long, value_name = "FILE", num_args = 1..)]
    #[arg(conflicts_with_all = ["resume", "shard", "paired", "pictures"])]
    pub merge: Vec<PathBuf>,
    /// Number of threads; without it, one for each core. The figures are the same
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub workers: Option<u32>,
    /// Robot, lidar, odometry, handler and shield; of the camera its place and field of view.
    #[command(flatten)]
    pub config: ConfigArgs,
}

/// The size of an image, such as `640x480`.
fn pixels(text: &str) -> Result<[usize; 2], String> {
    let size = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    size.ok_or_else(|| format!("{text} is no size such as 640x480"))
}

/// A part, such as `2/4`.
fn shard(text: &str) -> Result<[u32; 2], String> {
    let part = text.split_once('/').and_then(|(part, of)| Some([part.parse().ok()?, of.parse().ok()?]));
    part.filter(|[part, of]| (1..=*of).contains(part)).ok_or_else(|| format!("{text} is no part such as 2/4"))
}

/// See [`episodes::Noise`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum NoiseArg {
    /// They measure what is
    Ideal,
    /// Gaussian lidar noise with drop-outs, Redwood depth noise at 1.0, drifting odometry
    Noisy,
    /// The same, and a robot that walks on legs as a Go2 does in MuJoCo: it lags, overruns, sways, tilts and slips
    Legged,
}

/// See [`episodes::Harness`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum HarnessArg {
    /// At a fixed offset
    Rigid,
    /// By the delayed harness
    Delayed,
}

/// See [`episodes::Handlers`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum HandlersArg {
    /// The configuration's, as the model says
    Nominal,
    /// With offset, alpha and sway of their own
    Personal,
}

/// What is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TasksArg {
    /// Forward, left, right, anywhere
    Mixed,
    /// Forward, by handlers who face up to 30 degrees off the travel line, in straight, empty corridors
    Orientation,
    /// Left and right, up to 5 m too early or too late
    Timing,
    /// Forward, left, right, in worlds whose floor ends: at stairs, holes, kerbs, beside a platform, behind a turn
    Drops,
}

/// See [`world::Crowd`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PeopleArg {
    /// One or two people on fixed paths, in a third of the worlds with room for them
    Paths,
    /// People of the social force model, in every world: they come towards the team or walk along with it, alone or in
    /// groups, stop in the way, overtake
    Social,
    /// Nobody
    None,
}

/// How an action is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ChoiceArg {
    /// The most probable one; where that is to stop, one by their probabilities
    Surest,
    /// One by their probabilities
    Draw,
    /// The most probable one
    ArgMax,
}

impl From<ChoiceArg> for Choice {
    fn from(given: ChoiceArg) -> Self {
        match given {
            ChoiceArg::Surest => Self::Surest,
            ChoiceArg::Draw => Self::Draw,
            ChoiceArg::ArgMax => Self::ArgMax,
        }
    }
}

/// See [`settings::PlannerUse`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlannerArg {
    /// Nothing: the network decides
    Off,
    /// It judges each action by where it leads, and decides alone for some seconds where robot and handler make no
    /// progress
    Judge,
    /// It only decides alone for some seconds where they make no progress
    TakeOver,
}

impl From<PlannerArg> for PlannerUse {
    fn from(given: PlannerArg) -> Self {
        match given {
            PlannerArg::Off => Self::Off,
            PlannerArg::Judge => Self::Judge,
            PlannerArg::TakeOver => Self::TakeOver,
        }
    }
}

/// Examples of `guidedog evaluate --help`.
pub const HELP: &str = "\
Examples:
  guidedog evaluate --policy guide --episodes 2000
  guidedog evaluate --policy geometric --worlds floor.yaml --noise ideal --json
  guidedog evaluate --policy guide --tasks timing --pictures pictures
  guidedog evaluate --worlds floor.yaml --explain 20 --pictures tasks
  guidedog evaluate --worlds buildings --policy geometric --noise legged
  guidedog evaluate --policy guide --planner off
  guidedog evaluate --policy geometric --tasks drops --noise legged --camera 640x480
  guidedog evaluate --people social --noise legged --episodes 200
  guidedog evaluate --tasks drops --episodes 100000 --shard 1/4 --outcomes part-1.jsonl --resume
  guidedog evaluate --merge part-1.jsonl part-2.jsonl part-3.jsonl part-4.jsonl --json
  guidedog evaluate --worlds floor.yaml --failures failures
  guidedog evaluate --replay failures
  guidedog evaluate --replay failures/episode-37.json --policy geometric --pictures pictures
  guidedog evaluate --worlds floor.yaml --replay 37

An episode is one cue and a hundred decisions; robot and handler have come along the corridor, and what the
robot saw on the last two metres is remembered. A motion in which robot or handler would touch something is
refused and counted as one collision; beside a robot that stands, a handler who has touched something does not
push on; who walks into them is counted as hit_by_others. Most people stop where robot or handler is within 1.2
m ahead of them, and turn round after 8 s; 15 % walk on until they touch. Intervals are of 95 %.
Success: forward, the handler is 10 m on along the corridor, or within 2 m of its end; left and right, the
handler is 2 m inside the opening asked for (in generated worlds within 20 degrees of its axis), or stands still
in the corridor where there is none within 15 m of way (in generated worlds, who gives the cue within 1 m of an
opening's farther edge may mean it or what comes next; where the corridor itself turns less than 4 m before an
opening to the same side, either is meant); stop, the robot does not move any more (on legs: half a
second later). An error of orientation is corrected where the handler's third metre of way leads within 10
degrees of the corridor; orientation_faced counts who faces so at its end. Judged where the corridor goes on for
5 m; who never comes so far has corrected nothing.
On maps a course goes round corners and over crossings, to where it ends or forks or a hall or room begins. A
side way is asked for from 1.15 m of width on; where one could leave the corridor and it is not clear whether
that is meant, as through a door of 0.8 to 1.1 m, no task is set. An episode has more decisions where its way is
long. --explain tells what each task asks for.
--people social: one or two parties in each world. A party is one person, a group of two or three, one who stops in the
way for 10 to 60 s (in corridors of 2.3 m or more), or one who overtakes at 1.3 to 1.6 m/s. 85 % walk round robot and
handler; the others take no notice of them until they touch. docs/people.md has the model.
--worlds buildings: rooms behind doorways, alcoves, openings from 0.7 m of width on, oblique and uneven walls, door
frames, doors across the corridor, pillars at corners, radiators, benches. Widths and counts lie within those of 11
real floors. In one corridor of twelve a door opens when the robot comes by, stays open for 3 to 8 s, and shuts; it
may block the way until then. One of sixteen widens into a hall of 4 to 9 m: forward leads across it to the corridor
behind it, and no other task is set there. A side way is asked for from 1.2 m of width on.
--tasks drops: one world in six has neither edge nor step, one in six has low steps. In the others the floor ends
across the corridor, in a branch, beside it, or in a hole with a way past it. Before a low step the robot waits, and
the handler says forward. low_steps_announced counts the steps that the robot took. Where a footprint leaves the
floor, robot or handler has fallen and the episode ends. stood_before_edge: the way goes over an edge, and at the
end the robot stands within 2 m of it. A stop for the floor is false where no edge is within 1 m, nor a low step
within 1.6 m; those at dark floor are counted separately. The figures beside an edge leave out episodes in which
robot or handler begins nearer to it than 0.15 m.
--failures: an episode fails where robot or handler touches something or falls, where the cue is not followed, where
the robot is stuck for 20 s, or moves after stop. Each failure has one class; docs/evaluation.md defines them. Whom a
person walked into is listed, and is not counted. The folder's failures of an earlier evaluation are replaced; files
of others are not. --pictures replaces its own first-N.svg and wrong-N.svg. --replay compares an episode with what is
stored: same, fixed, fails otherwise (the same class, other figures), other class. An equal program has to give the
same (exit code 7).
outcomes_sha256 is a digest of all outcomes without timings: equal on any number of cores and machines.";
