//! Enrolment: a handler says each cue a few times, and some other words, and the recogniser's dense layers are fitted
//! to that voice, on the robot's own computer.
//!
//! The clips are put into many scenes ([`scenes`]); of each scene the head's convolutions, which stay as they are, make
//! features; by these and by a rehearsal of the training data ([`Rehearsal`]) the dense layers are trained further
//! ([`Dense`]). Without the rehearsal the head forgets all other voices, and takes the handler's other words for cues.
//! [`Takes`] cuts the clips out of a microphone's sound. Pure, but for reading its files.

mod dense;
mod head;
mod rehearsal;
mod scenes;
mod takes;

use std::path::PathBuf;

use hearing::{Ears, Head, LABELS, LogMel, ModelFiles, Network, Networks, Recogniser, SpeechError, WINDOWS, cue_of};
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
    /// The word: one of the cues', or another, which is to be none.
    pub word: String,
    /// Which of the word's clips, from 0.
    pub take: usize,
    /// In [-1, 1], at [`hearing::RATE_HZ`].
    pub samples: Vec<f32>,
}

impl Clip {
    /// The cue that it is.
    #[must_use]
    pub fn cue(&self) -> Option<CueKind> {
        cue_of(&self.word)
    }

    fn label(&self) -> usize {
        LABELS.iter().position(|label| *label == self.word).unwrap_or(LABELS.len() - 1)
    }
}

/// A clip that is judged is played so often, each time from 5 ms later on: a word at the border of a rule is heard in
/// some of them.
pub const PLAYS: usize = 4;
/// Samples from one to the next.
const PLAY_SAMPLES: usize = 80;

/// How many recordings a head takes for what they are, or for what they are not, before it was fitted and after.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Change {
    /// By the head before.
    pub before: usize,
    /// By the fitted one: of the handler's clips each by a head that it has not trained.
    pub after: usize,
    /// How many there are; each of the handler's clips is played [`PLAYS`] times.
    pub of: usize,
}

impl Change {
    /// By how much the share has grown; 0 where there are none.
    #[must_use]
    pub fn growth(self) -> f64 {
        (self.after as f64 - self.before as f64) / self.of.max(1) as f64
    }
}

/// How cues and other words were heard, before and after.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Changes {
    /// Cues that are heard as what they are.
    pub cues: Change,
    /// *stop* among them.
    pub stop: Change,
    /// Other words that are taken for a cue.
    pub others: Change,
}

/// What enrolment came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Enrolled {
    /// The head for this handler; its path is still that of the head before.
    pub head: Head,
    /// What the head before hears in each clip, if anything.
    pub heard_before: Vec<Option<CueKind>>,
    /// Of the handler's clips.
    pub own: Changes,
    /// Of the rehearsal's windows: other voices.
    pub rehearsed: Changes,
}

/// So much of other voices' *stop* may be lost: a window of a hundred.
const STOP_LOSS_MAX: f64 = 0.01;

impl Enrolled {
    /// Whether as much is won as is lost: cues that are heard, less other words that are taken for cues, the handler's
    /// and other voices', as shares. Where the handler's *stop* is heard less often, or other voices' by more than a
    /// hundredth, nothing makes up for it.
    #[must_use]
    pub fn is_worth_it(&self) -> bool {
        let of = |changes: Changes| changes.cues.growth() - changes.others.growth();
        let keeps_stop = self.own.stop.growth() >= 0.0 && self.rehearsed.stop.growth() >= -STOP_LOSS_MAX;
        keeps_stop && of(self.own) + of(self.rehearsed) >= 0.0
    }
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
    let fitted = |left_out: Option<usize>| {
        let kept = clips.iter().zip(&known).filter(|(clip, _)| Some(clip.take) != left_out);
        let user = Features::joined(file.flat(), kept.map(|(_, features)| features));
        file.dense().fitted(&user, rehearsal.features(), seed)
    };
    let takes = clips.iter().map(|clip| clip.take).max().map_or(0, |last| last + 1);
    let held_out = (0..takes).into_par_iter().map(|take| {
        let left_out: Vec<&Clip> = clips.iter().filter(|clip| clip.take == take).collect();
        heard(&file.with(&fitted(Some(take))), files, &left_out).map(|heard| counted(&left_out, &heard))
    });
    let held_out = held_out.collect::<Result<Vec<Heard>, EnrolError>>()?.into_iter().fold(Heard::default(), Heard::and);
    let all: Vec<&Clip> = clips.iter().collect();
    let heard_before = heard(file.head(), files, &all)?;
    let (dense, before) = (fitted(None), counted(&all, &heard_before));
    let heard_before = heard_before.into_iter().next().unwrap_or_default();
    let rehearsed = rehearsal.changes(file.dense(), &dense, &file.head().manifest.rules);
    Ok(Enrolled { head: file.with(&dense), own: before.to(held_out), heard_before, rehearsed })
}

/// Cues that were heard right, *stop* among them, and other words that were taken for a cue; and of how many.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Heard {
    cues: (usize, usize),
    stop: (usize, usize),
    others: (usize, usize),
}

impl Heard {
    fn and(self, other: Self) -> Self {
        let sum = |a: (usize, usize), b: (usize, usize)| (a.0 + b.0, a.1 + b.1);
        Self {
            cues: sum(self.cues, other.cues),
            stop: sum(self.stop, other.stop),
            others: sum(self.others, other.others),
        }
    }

    fn to(self, after: Self) -> Changes {
        let change =
            |before: (usize, usize), after: (usize, usize)| Change { before: before.0, after: after.0, of: before.1 };
        Changes {
            cues: change(self.cues, after.cues),
            stop: change(self.stop, after.stop),
            others: change(self.others, after.others),
        }
    }
}

fn counted(clips: &[&Clip], plays: &[Vec<Option<CueKind>>]) -> Heard {
    let mut counted = Heard::default();
    for (clip, heard) in plays.iter().flat_map(|heard| clips.iter().zip(heard)) {
        let one = |is_counted: bool| (usize::from(is_counted), 1);
        let found = match clip.cue() {
            Some(cue) => {
                let right = one(*heard == Some(cue));
                let stop = if cue == CueKind::Stop { right } else { (0, 0) };
                Heard { cues: right, stop, others: (0, 0) }
            }
            None => Heard { others: one(heard.is_some()), ..Heard::default() },
        };
        counted = counted.and(found);
    }
    counted
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
        let mut features = Features::new(self.flat);
        for scene in scenes(&clip.samples, &mut ChaCha8Rng::seed_from_u64(seed)) {
            let mut frames = Vec::new();
            LogMel::default().push(&scene, |frame| frames.push(frame));
            let embeddings = self.networks.embed(&frames)?;
            for window in embeddings.windows(WINDOWS).take(SHIFTS) {
                features.push(clip.label(), &self.convolutions.run(&head::FED, window.as_flattened())?);
            }
        }
        Ok(features)
    }
}

/// What a head hears first in each clip, as the robot would: in each of the plays.
fn heard(head: &Head, files: &ModelFiles, clips: &[&Clip]) -> Result<Vec<Vec<Option<CueKind>>>, EnrolError> {
    let mut recogniser = Recogniser::with(head, files)?;
    let mut play = |clip: &Clip, number: usize| {
        recogniser.clear();
        let mut first = None;
        let sound = amid_silence(&clip.samples, &mut ChaCha8Rng::seed_from_u64(clip.take as u64));
        recogniser.push(&sound[number * PLAY_SAMPLES..], Ears::Open, |step| first = first.or(step.heard))?;
        Ok(first.map(|heard| heard.kind))
    };
    (0..PLAYS).map(|number| clips.iter().map(|clip| play(clip, number)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::{Change, Changes, Clip, Enrolled, Heard, counted};
    use hearing::Head;
    use messages::CueKind;

    fn change(before: usize, after: usize, of: usize) -> Change {
        Change { before, after, of }
    }

    fn enrolled(own: Changes, rehearsed: Changes) -> Enrolled {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/cues");
        let head = Head::read(&folder.join("cues.toml")).expect("it is shipped");
        Enrolled { head, heard_before: Vec::new(), own, rehearsed }
    }

    #[test]
    fn what_loses_more_than_it_wins_or_any_stop_is_not_worth_it() {
        let rehearsed = Changes { stop: change(100, 99, 100), ..Changes::default() };
        let own = |cues: usize, stop: usize, others: usize| Changes {
            cues: change(12, cues, 20),
            stop: change(5, stop, 5),
            others: change(1, others, 10),
        };
        assert!(enrolled(own(12, 5, 1), rehearsed).is_worth_it(), "as before");
        assert!(enrolled(own(14, 5, 2), rehearsed).is_worth_it(), "a tenth of cues for a tenth of others");
        assert!(!enrolled(own(14, 5, 3), rehearsed).is_worth_it());
        assert!(!enrolled(own(20, 4, 0), rehearsed).is_worth_it(), "a stop is lost");
        let lost = Changes { stop: change(100, 98, 100), ..Changes::default() };
        assert!(!enrolled(own(20, 5, 0), lost).is_worth_it(), "other voices' stop is lost");
    }

    #[test]
    fn clips_are_counted_as_what_they_are() {
        let clip = |word: &str| Clip { word: word.to_owned(), take: 0, samples: Vec::new() };
        let clips = [clip("stop"), clip("go"), clip("left"), clip("lift"), clip("no")];
        let heard = [Some(CueKind::Stop), Some(CueKind::Forward), None, Some(CueKind::Left), None];
        let plays = [heard.to_vec(), heard.map(|_| None).to_vec()];
        let Heard { cues, stop, others } = counted(&clips.iter().collect::<Vec<_>>(), &plays);
        assert_eq!((cues, stop, others), ((2, 6), (1, 2), (1, 4)));
    }
}
