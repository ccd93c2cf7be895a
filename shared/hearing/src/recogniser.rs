//! Samples in, cues out: what the robot hears with, and what is evaluated.

use std::collections::VecDeque;

use crate::levels::level_db;
use crate::mel::{HOP, LogMel, Mel, RATE_HZ};
use crate::model::{EMBEDDING, FRAMES, Head, Networks, SpeechError, WINDOWS};
use crate::rules::{CueRules, Heard};
use crate::signal::{Quality, Signal, Trouble};
use crate::{Manifest, ModelFiles, Probabilities};

/// Frames of a step.
pub const FRAMES_A_STEP: usize = 8;
/// Samples of a step.
pub const STEP_SAMPLES: usize = FRAMES_A_STEP * HOP;
/// From one step to the next, nanoseconds.
pub const STEP_NS: u64 = STEP_SAMPLES as u64 * messages::NS_PER_S / RATE_HZ as u64;

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

/// The whole way from samples to cues.
pub struct Recogniser {
    networks: Networks,
    manifest: Manifest,
    mel: LogMel,
    /// The newest frames, the oldest first.
    frames: VecDeque<Mel>,
    /// Of the frames since the last step.
    levels_db: Vec<f64>,
    /// The newest embeddings, the oldest first.
    embeddings: VecDeque<[f32; EMBEDDING]>,
    rules: CueRules,
    signal: Signal,
    taken: u64,
    made: Vec<Mel>,
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
            mel: LogMel::default(),
            frames: VecDeque::with_capacity(FRAMES + 1),
            levels_db: Vec::with_capacity(FRAMES_A_STEP),
            embeddings: VecDeque::with_capacity(WINDOWS + 1),
            rules: CueRules::new(manifest.rules),
            signal: Signal::default(),
            taken: 0,
            made: Vec::new(),
            manifest,
        })
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
        self.embeddings.len() == WINDOWS
    }

    /// Whether the robot stands by somebody's stop; see [`CueRules::stands`].
    pub fn stands(&mut self, is_stopped: bool) {
        self.rules.stands(is_stopped);
    }

    /// How far the sound of late stands out from what is always there, decibels.
    #[must_use]
    pub fn above_floor_db(&self) -> f64 {
        self.rules.levels().above_floor_db()
    }

    /// Begins anew: what comes next is not what came after the last sample.
    pub fn clear(&mut self) {
        self.mel.clear();
        self.frames.clear();
        self.levels_db.clear();
        self.embeddings.clear();
        self.rules = CueRules::new(self.manifest.rules);
        self.signal = Signal::default();
        self.taken = 0;
    }

    /// Samples taken, from the first one on.
    #[must_use]
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Takes samples in [-1, 1] at [`RATE_HZ`], and hands over the steps that they complete. Where they are `muted`,
    /// they count as silence, and nothing is heard in them: the robot itself speaks.
    ///
    /// # Errors
    /// Where a network cannot be run.
    pub fn push(&mut self, samples: &[f32], muted: bool, mut take: impl FnMut(Step)) -> Result<(), SpeechError> {
        if !muted {
            self.signal.take(samples);
        }
        for samples in samples.chunks(HOP) {
            let (mel, made) = (&mut self.mel, &mut self.made);
            made.clear();
            let samples = if muted { &[0.0; HOP][..samples.len()] } else { samples };
            mel.push(samples, |frame| made.push(frame));
            self.taken += samples.len() as u64;
            for i in 0..self.made.len() {
                if let Some(step) = self.frame(self.made[i], muted)? {
                    take(step);
                }
            }
        }
        Ok(())
    }

    fn frame(&mut self, frame: Mel, muted: bool) -> Result<Option<Step>, SpeechError> {
        self.frames.push_back(frame);
        self.levels_db.push(level_db(&frame));
        if self.frames.len() > FRAMES {
            self.frames.pop_front();
        }
        let is_step = self.frames.len() == FRAMES && self.levels_db.len() >= FRAMES_A_STEP;
        if !is_step {
            return Ok(None);
        }
        // Of the first step there are more: the embedding looks at 76 frames.
        let newest = self.levels_db.split_off(self.levels_db.len() - FRAMES_A_STEP);
        let levels_db: [f64; FRAMES_A_STEP] = std::array::from_fn(|i| newest[i]);
        self.levels_db.clear();
        if self.embeddings.len() == WINDOWS {
            self.embeddings.pop_front();
        }
        self.embeddings.push_back(self.networks.embed(self.frames.make_contiguous())?);
        if self.embeddings.len() < WINDOWS {
            return Ok(None);
        }
        // The levels of silence that nobody heard would make loud of everything after.
        if muted {
            return Ok(None);
        }
        let probabilities = self.networks.judge(self.embeddings.make_contiguous())?;
        let heard = self.rules.take(&probabilities, &levels_db);
        let above_floor_db = self.rules.levels().above_floor_db();
        Ok(Some(Step { end: self.taken, probabilities, heard, above_floor_db }))
    }
}
