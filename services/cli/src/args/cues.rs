//! The command lines of `guidedog cue` and `guidedog evaluate-cues`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::RunArg;

pub const HELP: &str = "\
Examples:
  guidedog evaluate-cues clips/                           a folder a word: clips/stop/a.wav, clips/dog/b.wav
  guidedog evaluate-cues clips/ speech/ --json            and long streams, in which nobody gives a cue
  guidedog evaluate-cues test.txt --conditions all --noise rain.wav --noise dishes.wav
  guidedog evaluate-cues clips/ --against anna/head.toml  another model on the same clips, pair by pair

A folder's files are named by their folder: forward, go, left, right and stop are cues, any other name is another word.
Files of over 5 s, and those of folders whose name begins with \"noise\" or \"silence\", are streams without a cue. A
list has a file a line, and its word behind a tab or blanks (none: a stream; # begins a remark); paths start at its
folder. Files are WAV or FLAC; what is not 16 kHz with one channel is mixed and resampled. A file of a folder that
cannot be read is left out and told. Each is heard with 1.3 s of near-silence before and behind, sample by sample as on
the robot. A cue is recalled where it is the first that is heard; another word is falsely accepted where anything is
heard. --json has the outcome of every clip.";

/// What is done to what is heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ConditionName {
    /// Nothing.
    Clean,
    /// Noise, 20 dB under the speech.
    Noise20,
    /// 10 dB.
    Noise10,
    /// 5 dB.
    Noise5,
    /// As loud as the speech.
    Noise0,
    /// As if shouted: higher, brighter, clipped.
    Shout,
    /// In a room that rings for half a second.
    Reverb,
    /// All of them, one after another.
    All,
}

/// What is evaluated, and on what.
#[derive(Debug, Args)]
pub struct EvaluateCuesArgs {
    /// Folders, lists, or files
    #[arg(required = true, value_name = "DIR|LIST|FILE")]
    pub what: Vec<PathBuf>,
    /// What is done to what is heard; once for each
    #[arg(long, value_enum, default_values = ["clean"], value_delimiter = ',')]
    pub conditions: Vec<ConditionName>,
    /// Noise to hear through, in place of pink noise; once for each file
    #[arg(long, value_name = "FILE")]
    pub noise: Vec<PathBuf>,
    /// Seed of what is drawn
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Cores to use; all if not told
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub workers: Option<u16>,
    /// The manifest of another model, to be compared with clip by clip
    #[arg(long, value_name = "MANIFEST")]
    pub against: Option<PathBuf>,
    /// Model, embedding and engine as this configuration has them
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// `guidedog cue`.
#[derive(Debug, Args)]
pub struct CueArgs {
    /// What to do.
    #[command(subcommand)]
    pub verb: CueVerb,
}

/// What to do about cues.
#[derive(Debug, Subcommand)]
pub enum CueVerb {
    /// Walk on
    Forward(RunArg),
    /// Turn left at the next opening
    Left(RunArg),
    /// Turn right at the next opening
    Right(RunArg),
    /// Stand
    Stop(RunArg),
    /// Fit the recogniser to a handler's voice: each cue is said five times, five other words twice
    #[command(after_help = ENROL_HELP)]
    Enrol(EnrolArgs),
}

const ENROL_HELP: &str = "\
Examples:
  guidedog cue enrol -o anna                       asks for 35 words by the microphone of the configuration
  guidedog cue enrol -o anna --from clips/         clips that are there: clips/left/1.wav, clips/lift/1.wav, ...
  guidedog cue enrol -o anna --undo                back to what was before

The folder anna then holds head.toml and head.onnx, which the configuration names ([cue.voice] model), and the clips.
Words are asked for in writing, and aloud by the commands of [speak]. Who breaks off goes on with the same command.
What got better and what worse is told: each of your clips is judged by a head that it did not train, other voices by a
rehearsal set. Where more is lost than won, nothing is changed. What is enrolled is in force from the next run on.";

/// `guidedog cue enrol`.
#[derive(Debug, Args)]
pub struct EnrolArgs {
    /// The handler's folder
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
    /// Clips that are there, in place of a microphone: folders forward, left, right, stop, go, and of other words
    #[arg(long, value_name = "FOLDER")]
    pub from: Option<PathBuf>,
    /// Go back to what was in force before; once more, and it is undone
    #[arg(long, conflicts_with_all = ["from", "base", "config"])]
    pub undo: bool,
    /// Do not ask aloud
    #[arg(long)]
    pub quiet: bool,
    /// The manifest of the head to begin with, with rehearsal.bin beside it; the shipped one if not told
    #[arg(long, value_name = "FILE")]
    pub base: Option<PathBuf>,
    /// Microphone, voice, embedding and engine as this configuration has them
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}
