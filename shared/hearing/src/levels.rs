//! How loud it is, and whether a word that is said stands alone: by the levels before and after it. Pure.

use std::collections::VecDeque;

use crate::mel::{BANDS, Mel};

/// Frames of 10 ms that are remembered: longer than any word waits for its end.
const MEMORY: usize = 256;
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

/// What is always there, and the levels of late.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    rules: Isolation,
    floor_db: Option<f64>,
    /// The newest last.
    levels_db: VecDeque<f64>,
}

impl Levels {
    /// Nothing was heard yet.
    #[must_use]
    pub fn new(rules: Isolation) -> Self {
        Self { rules, floor_db: None, levels_db: VecDeque::with_capacity(MEMORY + 1) }
    }

    /// Takes a frame.
    pub fn take(&mut self, level_db: f64) {
        self.floor_db = Some(match self.floor_db {
            None => level_db,
            Some(floor_db) if level_db < floor_db => floor_db + self.rules.floor_fall * (level_db - floor_db),
            Some(floor_db) => level_db.min(floor_db + self.rules.floor_rise_db),
        });
        self.levels_db.push_back(level_db);
        if self.levels_db.len() > MEMORY {
            self.levels_db.pop_front();
        }
    }

    fn peak_db(&self) -> f64 {
        self.levels_db.iter().rev().take(self.rules.reach).copied().fold(f64::NEG_INFINITY, f64::max)
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
        let newest_first = self.levels_db.iter().rev().enumerate();
        let mut loud = newest_first.filter(|(_, level_db)| **level_db > loud_db).map(|(age, _)| age);
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
