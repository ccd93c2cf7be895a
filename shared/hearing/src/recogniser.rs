//! Samples in, cues out: what the robot hears with, and what is evaluated.

use std::collections::VecDeque;

use crate::levels::{Sound, level_db};
use crate::mel::{BANDS, HOP, LogMel, Mel, RATE_HZ};
use crate::model::{EMBEDDING, Embedder, FRAMES, FRAMES_AN_EMBEDDING, Head, Networks, SpeechError, WINDOWS};
use crate::periodicity::Periodicity;
use crate::rules::{CueRules, Heard};
use crate::signal::{Quality, Signal, Trouble};
use crate::{Manifest, ModelFiles, Probabilities};

/// Lanes of embeddings: each has one in 80 ms, they take turns.
const LANES: usize = 4;
/// Frames of a step.
pub const FRAMES_A_STEP: usize = FRAMES_AN_EMBEDDING / LANES;
/// Samples of a step.
const STEP_SAMPLES: usize = FRAMES_A_STEP * HOP;
/// From one step to the next, nanoseconds.
pub const STEP_NS: u64 = STEP_SAMPLES as u64 * messages::NS_PER_S / RATE_HZ as u64;

/// Steps that the head can still see of something: those of its embeddings, and those of the first one's frames.
const ASIDE_STEPS: usize = (WINDOWS * FRAMES_AN_EMBEDDING + FRAMES).div_ceil(FRAMES_A_STEP);

/// What a step came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Samples taken until its end, from the first one on.
    pub end: u64,
    /// How probable each word is.
    pub probabilities: Probabilities,
    /// A cue.
    pub heard: Option<Heard>,
    /// How far the sound stands out from what is always there, decibels.
    pub above_floor_db: f64,
}

/// What is listened for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ears {
    /// Every cue.
    Open,
    /// *stop* alone: the key to speak is not held.
    OnlyStop,
    /// *stop* alone, in whatever sounds: the robot itself speaks as it walks.
    ForStop,
    /// Nothing: the robot itself speaks, and stands.
    Shut,
}

/// One embedding in 80 ms, and what the head makes of eight.
#[derive(Clone)]
struct Lane {
    embedder: Embedder,
    /// The newest embeddings, the oldest first.
    embeddings: VecDeque<[f32; EMBEDDING]>,
}

impl Lane {
    fn new() -> Self {
        Self { embedder: Embedder::default(), embeddings: VecDeque::with_capacity(WINDOWS) }
    }

    /// Takes the newest frames. The embedding counts where all that it is of was heard.
    fn push(
        &mut self,
        frames: &[Mel],
        is_whole: bool,
        networks: &mut Networks,
    ) -> Result<Option<Probabilities>, SpeechError> {
        let embedding = self.embedder.push(frames, networks)?;
        if !is_whole {
            return Ok(None);
        }
        if self.embeddings.len() == WINDOWS {
            self.embeddings.pop_front();
        }
        self.embeddings.push_back(embedding);
        if self.embeddings.len() < WINDOWS {
            return Ok(None);
        }
        networks.judge(self.embeddings.make_contiguous()).map(Some)
    }
}

/// From samples to how probable each word is.
#[derive(Clone)]
struct Path {
    mel: LogMel,
    periodicity: Periodicity,
    /// The newest frames, the oldest first; silence before the first.
    frames: VecDeque<Mel>,
    /// What each of the newest frames sounds like.
    sounds: [Sound; FRAMES_A_STEP],
    lanes: [Lane; LANES],
    /// Frames so far.
    count: usize,
}

impl Path {
    fn new() -> Self {
        Self {
            mel: LogMel::default(),
            periodicity: Periodicity::default(),
            frames: VecDeque::from([[0.0; BANDS]; FRAMES_AN_EMBEDDING]),
            sounds: [Sound::default(); FRAMES_A_STEP],
            lanes: std::array::from_fn(|_| Lane::new()),
            count: 0,
        }
    }

    /// Takes samples of at most a frame's hop: the step that they complete, if they do and enough was heard.
    fn push(
        &mut self,
        samples: &[f32],
        networks: &mut Networks,
    ) -> Result<Option<(Probabilities, [Sound; FRAMES_A_STEP])>, SpeechError> {
        let mut made = (None, None);
        self.mel.push(samples, |frame| made.0 = Some(frame));
        self.periodicity.push(samples, |periodicity| made.1 = Some(periodicity));
        let (Some(frame), Some(periodicity)) = made else { return Ok(None) };
        self.frames.pop_front();
        self.frames.push_back(frame);
        self.sounds.rotate_left(1);
        self.sounds[FRAMES_A_STEP - 1] = Sound { level_db: level_db(&frame), periodicity };
        self.count += 1;
        if !self.count.is_multiple_of(FRAMES_A_STEP) {
            return Ok(None);
        }
        // Lane 0 has its first embedding with the first frames that make one.
        let turn = (self.count + FRAMES_AN_EMBEDDING - FRAMES % FRAMES_AN_EMBEDDING) / FRAMES_A_STEP;
        let is_whole = self.count >= FRAMES;
        let judged = self.lanes[turn % LANES].push(self.frames.make_contiguous(), is_whole, networks)?;
        Ok(judged.map(|probabilities| (probabilities, self.sounds)))
    }

    /// Whether enough was heard to tell words.
    fn is_warm(&self) -> bool {
        self.lanes[0].embeddings.len() == WINDOWS
    }
}

/// The whole way from samples to cues.
pub struct Recogniser {
    networks: Networks,
    manifest: Manifest,
    path: Path,
    /// What sounds while the robot speaks, where that is silence in the other; and the steps that it is kept for after.
    aside: Option<(Path, usize)>,
    rules: CueRules,
    wants_go: bool,
    signal: Signal,
    taken: u64,
}

impl Recogniser {
    /// Loads what is needed, verifies it, and runs it once.
    ///
    /// # Errors
    /// Where a file is missing, not what its digest says, or of another shape.
    pub fn load(files: &ModelFiles) -> Result<Self, SpeechError> {
        Self::with(&Head::read(&files.manifest)?, files)
    }

    /// As [`Recogniser::load`], with a head that is at hand.
    ///
    /// # Errors
    /// Likewise.
    pub fn with(head: &Head, files: &ModelFiles) -> Result<Self, SpeechError> {
        let manifest = head.manifest.clone();
        Ok(Self {
            networks: Networks::new(head, files)?,
            path: Path::new(),
            aside: None,
            rules: CueRules::new(manifest.rules, false),
            wants_go: false,
            signal: Signal::default(),
            taken: 0,
            manifest,
        })
    }

    /// The same, by which directions count only after *go*; see [`CueRules::new`].
    #[must_use]
    pub fn wanting_go(mut self, wants_go: bool) -> Self {
        self.wants_go = wants_go;
        self.clear();
        self
    }

    /// What stands beside the head.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// How good the sound was in the last whole second.
    #[must_use]
    pub fn quality(&self) -> Quality {
        self.signal.quality()
    }

    /// What is wrong with the source, if anything.
    #[must_use]
    pub fn trouble(&self) -> Option<Trouble> {
        self.signal.trouble()
    }

    /// Whether enough was heard to tell words.
    #[must_use]
    pub fn is_warm(&self) -> bool {
        self.path.is_warm()
    }

    /// Whether the robot stands by somebody's stop; see [`CueRules::stands`].
    pub fn stands(&mut self, is_stopped: bool) {
        self.rules.stands(is_stopped);
    }

    /// What was heard and not given yet is over.
    pub fn forget(&mut self) {
        self.rules.forget();
    }

    /// How far the sound of late stands out from what is always there, decibels.
    #[must_use]
    pub fn above_floor_db(&self) -> f64 {
        self.rules.levels().above_floor_db()
    }

    /// Begins anew: what comes next is not what came after the last sample.
    pub fn clear(&mut self) {
        (self.path, self.aside) = (Path::new(), None);
        self.rules = CueRules::new(self.manifest.rules, self.wants_go);
        self.signal = Signal::default();
        self.taken = 0;
    }

    /// Samples taken, from the first one on.
    #[must_use]
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Takes samples in [-1, 1] at [`RATE_HZ`], and hands over the steps that they complete. Where the
    /// robot itself speaks, they are silence for all but a stop, then and later.
    ///
    /// # Errors
    /// Where a network cannot be run.
    pub fn push(&mut self, samples: &[f32], ears: Ears, mut take: impl FnMut(Step)) -> Result<(), SpeechError> {
        let is_clear = matches!(ears, Ears::Open | Ears::OnlyStop);
        if is_clear {
            self.signal.take(samples);
        }
        self.turn_aside(ears);
        for samples in samples.chunks(HOP) {
            self.taken += samples.len() as u64;
            let silence = &[0.0; HOP][..samples.len()];
            let heard = if is_clear { samples } else { silence };
            let step = self.path.push(heard, &mut self.networks)?;
            let aside = match &mut self.aside {
                Some((path, _)) => path.push(samples, &mut self.networks)?,
                None => None,
            };
            if let Some((probabilities, sounds)) = step {
                // The levels of silence that nobody heard would make loud of everything after.
                let heard = match ears {
                    Ears::Open => self.rules.take(&probabilities, &sounds),
                    Ears::OnlyStop => self.rules.take_only_stop(&probabilities, &sounds),
                    Ears::ForStop | Ears::Shut => {
                        self.rules.pass();
                        None
                    }
                };
                let stop = aside.and_then(|(probabilities, _)| self.rules.take_stop(&probabilities));
                self.let_go_of_aside(ears);
                let above_floor_db = self.rules.levels().above_floor_db();
                take(Step { end: self.taken, probabilities, heard: stop.or(heard), above_floor_db });
            }
        }
        Ok(())
    }

    /// Where the robot begins to speak, the sound goes a way of its own from there on.
    fn turn_aside(&mut self, ears: Ears) {
        match ears {
            Ears::ForStop => {
                // It goes on as the other.
                self.aside.get_or_insert_with(|| (self.path.clone(), 0)).1 = ASIDE_STEPS;
            }
            Ears::Shut => self.aside = None,
            Ears::Open | Ears::OnlyStop => {}
        }
    }

    /// A word may have begun while the robot still spoke: it is listened to until it is out of sight.
    fn let_go_of_aside(&mut self, ears: Ears) {
        let is_clear = matches!(ears, Ears::Open | Ears::OnlyStop);
        if let Some((_, left)) = self.aside.as_mut().filter(|_| is_clear) {
            *left = left.saturating_sub(1);
        }
        self.aside = self.aside.take_if(|(_, left)| *left > 0);
    }
}
