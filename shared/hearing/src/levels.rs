//! How it sounds about a word: whether there is a voice, and whether the word stands alone. Pure.

use std::collections::VecDeque;

use crate::mel::{BANDS, Mel};

/// Frames of 10 ms that are remembered: longer than any word waits for its end, and than talk is remembered.
pub(crate) const MEMORY: usize = 640;
/// The bands of speech; below them is hum, above them hiss.
const SPEECH: std::ops::Range<usize> = 4..28;
const _: () = assert!(SPEECH.end <= BANDS);

/// What is loud beside what, and for how long: times in frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Isolation {
    /// So much quiet ends a sound.
    pub quiet: usize,
    /// A sound that is longer is running speech.
    pub segment_max: usize,
    /// What was loud longer ago than this is no part of it.
    pub reach: usize,
    /// Louder than what is always there by so much is sound, decibels,
    pub margin_db: f64,
    /// unless it is lower than the loudest of late by more than this, decibels.
    pub depth_db: f64,
    /// So much of the way down to a frame that is quieter the floor goes at once.
    pub floor_fall: f64,
    /// And up it goes by so much a frame, decibels.
    pub floor_rise_db: f64,
}

/// The level of a frame in the bands of speech, decibels.
#[must_use]
pub fn level_db(mel: &Mel) -> f64 {
    let sum: f64 = mel[SPEECH].iter().map(|level| f64::from(*level)).sum();
    (sum / SPEECH.len() as f64 - 2.0) * 10.0
}

/// How a sound about a word stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Around {
    /// Quiet before and after it, or nothing that is loud at all.
    Quiet,
    /// It goes on.
    Open,
    /// It is longer than a word.
    Running,
}

/// What a frame sounds like.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sound {
    /// See [`level_db`].
    pub level_db: f64,
    /// See [`crate::Periodicity`].
    pub periodicity: f32,
}

/// What is always there, and the frames of late.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    rules: Isolation,
    floor_db: Option<f64>,
    /// The newest last.
    sounds: VecDeque<Sound>,
}

impl Levels {
    /// Nothing was heard yet.
    #[must_use]
    pub fn new(rules: Isolation) -> Self {
        Self { rules, floor_db: None, sounds: VecDeque::with_capacity(MEMORY + 1) }
    }

    /// Takes a frame.
    pub fn take(&mut self, sound: Sound) {
        let level_db = sound.level_db;
        self.floor_db = Some(match self.floor_db {
            None => level_db,
            Some(floor_db) if level_db < floor_db => floor_db + self.rules.floor_fall * (level_db - floor_db),
            Some(floor_db) => level_db.min(floor_db + self.rules.floor_rise_db),
        });
        self.remember(sound);
    }

    /// Frames pass that are not listened to: they count as silence, and tell nothing of what is always there.
    pub fn pass(&mut self, frames: usize) {
        for _ in 0..frames {
            self.remember(Sound { level_db: f64::NEG_INFINITY, periodicity: 0.0 });
        }
    }

    fn remember(&mut self, sound: Sound) {
        self.sounds.push_back(sound);
        if self.sounds.len() > MEMORY {
            self.sounds.pop_front();
        }
    }

    /// The frames of late.
    fn late(&self) -> impl Iterator<Item = &Sound> {
        self.sounds.iter().rev().take(self.rules.reach)
    }

    fn peak_db(&self) -> f64 {
        self.late().map(|sound| sound.level_db).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Frames of late that are as periodic as this, or more.
    #[must_use]
    pub fn voiced(&self, periodicity: f64) -> usize {
        self.late().filter(|sound| f64::from(sound.periodicity) >= periodicity).count()
    }

    /// Frames within the last `frames`, but before those of late, that are as periodic as this, or more, and not more
    /// than `depth_db` below the loudest of late.
    #[must_use]
    pub fn talked(&self, frames: usize, periodicity: f64, depth_db: f64) -> usize {
        let least_db = self.peak_db() - depth_db;
        let before = self.sounds.iter().rev().take(frames).skip(self.rules.reach);
        before.filter(|sound| f64::from(sound.periodicity) >= periodicity && sound.level_db >= least_db).count()
    }

    /// What counts as loud beside a word that was said now, decibels.
    #[must_use]
    pub fn loud_db(&self) -> f64 {
        let floor_db = self.floor_db.unwrap_or(f64::NEG_INFINITY);
        (floor_db + self.rules.margin_db).max(self.peak_db() - self.rules.depth_db)
    }

    /// How far the loudest of late stands out from what is always there, decibels.
    #[must_use]
    pub fn above_floor_db(&self) -> f64 {
        self.floor_db.map_or(0.0, |floor_db| self.peak_db() - floor_db)
    }

    /// How the sound stands about a word that was said so many frames ago.
    #[must_use]
    pub fn around(&self, loud_db: f64, frames_ago: usize) -> Around {
        let newest_first = self.sounds.iter().rev().enumerate();
        let mut loud = newest_first.filter(|(_, sound)| sound.level_db > loud_db).map(|(age, _)| age);
        let Some(newest) = loud.next().filter(|age| *age < self.rules.reach + frames_ago) else { return Around::Quiet };
        let mut oldest = newest;
        for age in loud {
            if age - oldest > self.rules.quiet {
                break;
            }
            oldest = age;
        }
        match () {
            () if oldest - newest + 1 > self.rules.segment_max => Around::Running,
            () if newest >= self.rules.quiet => Around::Quiet,
            () => Around::Open,
        }
    }
}
