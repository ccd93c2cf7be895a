//! `guidedog cue`; `guidedog evaluate-cues`: recorded speech through the very code that hears on the robot.

mod conditions;
mod decode;
mod enrol;
mod figures;
mod files;
mod pairs;

use std::path::{Path, PathBuf};

use hearing::{Ears, ModelFiles, RATE_HZ, Recogniser, SpeechError};
use messages::CueKind;
use rayon::prelude::*;
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use settings::VoiceSource;

use crate::args::cues::{CueVerb, EvaluateCuesArgs};
use crate::exit::Failure;
use crate::out::{self, say};
use crate::{operate, prepare};
use conditions::{Condition, Noises};
use figures::Counts;
pub use files::check_stream;
use files::{Recorded, What};

/// What came of one file under one condition.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The file.
    pub path: PathBuf,
    /// What was in it.
    pub what: What,
    /// What was heard: the cue, and when it was reported after the end of what was said, seconds.
    pub heard: Vec<(CueKind, f64)>,
    /// Of a cue that starts the robot: whether it is the first that is heard where the robot stands by a stop, too.
    pub from_standing: Option<bool>,
    /// How long it was, seconds.
    pub length_s: f64,
    /// CPU time that the recogniser took, seconds.
    pub taken_s: f64,
}

impl Outcome {
    /// Whether the robot does what was said: a cue is the first that is heard, and nothing else is a cue.
    pub fn is_right(&self) -> bool {
        match self.what.cue() {
            Some(cue) => self.heard.first().is_some_and(|(kind, _)| *kind == cue),
            None => self.heard.is_empty(),
        }
    }

    fn report(&self) -> Value {
        let heard = self.heard.iter().map(|(kind, after_s)| json!({ "cue": kind.name(), "after_s": after_s }));
        json!({
            "file": self.path, "word": self.what.word(), "right": self.is_right(),
            "heard": heard.collect::<Vec<Value>>(), "from_standing": self.from_standing,
        })
    }
}

/// `guidedog cue`.
///
/// # Errors
/// As [`operate::cue`] and [`enrol::enrol`].
pub fn cue(verb: &CueVerb, as_json: bool) -> Result<(), Failure> {
    match verb {
        CueVerb::Forward(run) => operate::cue(CueKind::Forward, run, as_json),
        CueVerb::Left(run) => operate::cue(CueKind::Left, run, as_json),
        CueVerb::Right(run) => operate::cue(CueKind::Right, run, as_json),
        CueVerb::Stop(run) => operate::cue(CueKind::Stop, run, as_json),
        CueVerb::Enrol(args) => enrol::enrol(args, as_json),
    }
}

/// `guidedog evaluate-cues`.
///
/// # Errors
/// Where a file or the model cannot be used.
pub fn evaluate(args: &EvaluateCuesArgs, as_json: bool) -> Result<(), Failure> {
    let model = model_files(args.config.as_deref())?;
    // What does not fit is told before anything is read.
    let manifest = Recogniser::load(&model).map_err(Failure::of_input)?.manifest().clone();
    let other = args.against.as_deref().map(|manifest| against(&model, manifest)).transpose()?;
    let found = files::find(&args.what)?;
    let noises = Noises::read(&args.noise)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.workers.map_or(0, |n| usize::from(n).min(found.recorded.len())))
        .build()
        .map_err(Failure::of_run)?;
    let mut reports = serde_json::Map::new();
    for condition in conditions::named(&args.conditions) {
        say(format!("{}: {} files", condition.name(), found.recorded.len()));
        let played = |model: &ModelFiles| pool.install(|| play(&found.recorded, model, condition, &noises, args.seed));
        let outcomes = played(&model)?;
        let mut report = Counts::of(&outcomes).report();
        if let Some((other, _)) = &other {
            report["against"] = pairs::report(&outcomes, &played(other)?);
        }
        report["clips"] = outcomes.iter().map(Outcome::report).collect();
        reports.insert(condition.name().to_owned(), report);
    }
    let left_out = found.left_out.iter().map(|(path, why)| json!({ "file": path, "why": why }));
    let report = json!({
        "model": { "path": model.manifest, "sha256": manifest.sha256, "embedding_sha256": manifest.embedding_sha256 },
        "against": other.map(|(other, sha256)| json!({ "path": other.manifest, "sha256": sha256 })),
        "engine": model.onnx_runtime.as_ref().map_or_else(|| "tract".to_owned(), |path| path.display().to_string()),
        "files": found.recorded.len(),
        "left_out": left_out.collect::<Vec<Value>>(),
        "seed": args.seed,
        "conditions": reports,
    });
    out::tell(as_json, &report, || vec![figures::text(&report)])
}

/// The other model, and its digest: its embedding lies beside it, or is the same.
fn against(model: &ModelFiles, manifest: &Path) -> Result<(ModelFiles, String), Failure> {
    let manifest = prepare::absolute(manifest)?;
    let beside = manifest.with_file_name("embedding.onnx");
    let embedding = if beside.is_file() { beside } else { model.embedding.clone() };
    let other = ModelFiles { manifest, embedding, ..model.clone() };
    let sha256 = Recogniser::load(&other).map_err(Failure::of_input)?.manifest().sha256.clone();
    Ok((other, sha256))
}

/// Where the configuration has them, or where they lie by default.
pub fn model_files(config: Option<&Path>) -> Result<ModelFiles, Failure> {
    let mut settings = prepare::load(settings::Profile::Walk, config)?;
    // The files are looked for only where somebody listens.
    settings.cue.voice.source = VoiceSource::Microphone;
    let settings = prepare::with_speech_files(settings)?;
    let voice = settings.cue.voice;
    Ok(ModelFiles {
        manifest: voice.model.map(PathBuf::from).unwrap_or_default(),
        embedding: voice.embedding.map(PathBuf::from).unwrap_or_default(),
        onnx_runtime: settings.policy.onnx_runtime.map(Into::into),
    })
}

/// The manifest of the head that is shipped.
pub fn shipped_manifest() -> Result<PathBuf, Failure> {
    prepare::find_speech_file("cues.toml")
}

/// Every file, each worker with a recogniser of its own.
fn play(
    recorded: &[Recorded],
    model: &ModelFiles,
    condition: Condition,
    noises: &Noises,
    seed: u64,
) -> Result<Vec<Outcome>, Failure> {
    let recogniser = || Recogniser::load(model);
    let one = |recogniser: &mut Result<Recogniser, SpeechError>, (number, recorded): (usize, &Recorded)| {
        let recogniser = recogniser.as_mut().map_err(|error| Failure::run(error.to_string()))?;
        let samples = recorded.read()?;
        let (end, heard) = condition.apply(&samples, noises, seed.wrapping_add(number as u64));
        listen(recogniser, recorded, &heard, end).map_err(Failure::of_run)
    };
    recorded.par_iter().enumerate().map_init(recogniser, |recogniser, item| one(recogniser, (item.0, item.1))).collect()
}

/// CPU time of this thread, seconds: what others do beside it is none of its cost.
fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

/// Plays one stretch of sound.
fn listen(
    recogniser: &mut Recogniser,
    recorded: &Recorded,
    samples: &[f32],
    word_end: usize,
) -> Result<Outcome, SpeechError> {
    recogniser.clear();
    let (mut heard, begun_s) = (Vec::new(), cpu_s());
    recogniser.push(samples, Ears::Open, |step| {
        if let Some(cue) = step.heard {
            heard.push((cue.kind, (step.end as f64 - word_end as f64) / f64::from(RATE_HZ)));
        }
    })?;
    let (length_s, taken_s) = (samples.len() as f64 / f64::from(RATE_HZ), cpu_s() - begun_s);
    let is_start = recorded.what.cue() == Some(CueKind::Forward);
    let from_standing = if is_start { Some(starts(recogniser, samples)?) } else { None };
    let (path, what) = (recorded.path.clone(), recorded.what.clone());
    Ok(Outcome { path, what, heard, from_standing, length_s, taken_s })
}

/// Whether this sound would start a robot that stands by a stop.
fn starts(recogniser: &mut Recogniser, samples: &[f32]) -> Result<bool, SpeechError> {
    recogniser.clear();
    recogniser.stands(true);
    let mut first = None;
    recogniser.push(samples, Ears::Open, |step| first = first.or(step.heard))?;
    Ok(first.is_some_and(|heard| heard.kind == CueKind::Forward))
}
