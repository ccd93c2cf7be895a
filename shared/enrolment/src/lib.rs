//! Enrolment: a handler says each cue a few times, and the recogniser's dense layers are fitted to that voice, on the
//! robot's own computer.
//!
//! The clips are put into many scenes ([`scenes`]); of each scene the head's convolutions, which stay as they are, make
//! features; by these and by a rehearsal of the training data ([`Rehearsal`]) the dense layers are trained further
//! ([`Dense`]). Without the rehearsal the head forgets all other voices, and takes the handler's other words for cues.
//! `scripts/train/cues/enrol.py` is the same, and where it was tried. [`Takes`] cuts the clips out of a microphone's
//! sound. Pure, but for reading its files.

mod dense;
mod head;
mod rehearsal;
mod scenes;
mod takes;

use std::path::PathBuf;

use hearing::{
    Ears, FRAMES, FRAMES_A_STEP, Head, LABELS, LogMel, ModelFiles, Network, Networks, Recogniser, SpeechError, WINDOWS,
};
use messages::CueKind;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

pub use dense::{Dense, Features};
pub use head::HeadFile;
pub use rehearsal::Rehearsal;
pub use scenes::{HISS, SHIFTS, SILENCE, amid_silence, scenes};
pub use takes::{Rejected, Take, Takes};

/// Why there is no enrolment.
#[derive(Debug, thiserror::Error)]
pub enum EnrolError {
    /// The recogniser's own files.
    #[error(transparent)]
    Speech(#[from] SpeechError),
    /// A file is not what it has to be.
    #[error("{}: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// What a handler said once.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    /// The cue.
    pub cue: CueKind,
    /// Which of the cue's clips, from 0.
    pub take: usize,
    /// In [-1, 1], at [`hearing::RATE_HZ`].
    pub samples: Vec<f32>,
}

/// What enrolment came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Enrolled {
    /// The head for this handler; its path is still that of the head before.
    pub head: Head,
    /// What the head before hears in each clip, if anything.
    pub heard_before: Vec<Option<CueKind>>,
    /// Of all clips, how many the head before hears right.
    pub before: usize,
    /// How many are heard right by a head that was not trained on them: each take by one that the others trained.
    pub held_out: usize,
}

/// Fits the head to these clips. The same seed gives the same.
///
/// # Errors
/// Where a file of the recogniser's is missing, or not what it has to be.
pub fn enrol(files: &ModelFiles, rehearsal: &Rehearsal, clips: &[Clip], seed: u64) -> Result<Enrolled, EnrolError> {
    let file = HeadFile::parse(&Head::read(&files.manifest)?)?;
    rehearsal.fits(&file)?;
    let numbered: Vec<(u64, &Clip)> = (seed..).zip(clips).collect();
    let engines = || Engines::new(&file, files);
    let known = numbered.par_iter().map_init(engines, |engines, (seed, clip)| match engines {
        Ok(engines) => engines.features(clip, *seed),
        Err(error) => Err(EnrolError::Content { path: file.path(), what: error.to_string() }),
    });
    let known = known.collect::<Result<Vec<Features>, EnrolError>>()?;
    let trained = |left_out: Option<usize>| {
        let kept = clips.iter().zip(&known).filter(|(clip, _)| Some(clip.take) != left_out);
        let user = Features::joined(file.flat(), kept.map(|(_, features)| features));
        file.with(&file.dense().fitted(&user, rehearsal.features(), seed))
    };
    let takes = clips.iter().map(|clip| clip.take).max().map_or(0, |last| last + 1);
    let held_out = (0..takes).into_par_iter().map(|take| {
        let left_out: Vec<&Clip> = clips.iter().filter(|clip| clip.take == take).collect();
        heard(&trained(Some(take)), files, &left_out).map(|heard| right(&left_out, &heard))
    });
    let held_out = held_out.collect::<Result<Vec<usize>, EnrolError>>()?.into_iter().sum();
    let all: Vec<&Clip> = clips.iter().collect();
    let heard_before = heard(file.head(), files, &all)?;
    Ok(Enrolled { head: trained(None), before: right(&all, &heard_before), heard_before, held_out })
}

/// How many clips are heard as what they are.
fn right(clips: &[&Clip], heard: &[Option<CueKind>]) -> usize {
    clips.iter().zip(heard).filter(|(clip, heard)| **heard == Some(clip.cue)).count()
}

/// The networks whose numbers training needs.
struct Engines {
    networks: Networks,
    convolutions: Network,
    flat: usize,
}

impl Engines {
    fn new(file: &HeadFile, files: &ModelFiles) -> Result<Self, EnrolError> {
        let (path, onnx_runtime) = (file.path(), files.onnx_runtime.as_deref());
        Ok(Self {
            networks: Networks::new(file.head(), files)?,
            convolutions: Network::new(&path, &file.convolutions(), "head without its dense layers", onnx_runtime)?,
            flat: file.flat(),
        })
    }

    /// What the convolutions make of the windows of a clip's scenes.
    fn features(&mut self, clip: &Clip, seed: u64) -> Result<Features, EnrolError> {
        let label = LABELS.iter().position(|label| *label == clip.cue.name()).unwrap_or(LABELS.len() - 1);
        let mut features = Features::new(self.flat);
        for scene in scenes(&clip.samples, &mut ChaCha8Rng::seed_from_u64(seed)) {
            let mut frames = Vec::new();
            LogMel::default().push(&scene, |frame| frames.push(frame));
            let steps = frames.windows(FRAMES).step_by(FRAMES_A_STEP).take(WINDOWS + SHIFTS - 1);
            let embeddings = steps.map(|frames| self.networks.embed(frames)).collect::<Result<Vec<_>, _>>()?;
            for window in embeddings.windows(WINDOWS) {
                features.push(label, &self.convolutions.run(&head::FED, window.as_flattened())?);
            }
        }
        Ok(features)
    }
}

/// What a head hears first in each clip, as the robot would.
fn heard(head: &Head, files: &ModelFiles, clips: &[&Clip]) -> Result<Vec<Option<CueKind>>, EnrolError> {
    let mut recogniser = Recogniser::with(head, files)?;
    let mut heard = Vec::new();
    for clip in clips {
        recogniser.clear();
        let mut first = None;
        let sound = amid_silence(&clip.samples, &mut ChaCha8Rng::seed_from_u64(clip.take as u64));
        recogniser.push(&sound, Ears::Open, |step| first = first.or(step.heard))?;
        heard.push(first.map(|heard| heard.kind));
    }
    Ok(heard)
}
