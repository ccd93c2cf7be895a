//! Cuts single words out of a microphone's sound. Pure.

use hearing::{FRAME, HOP, LogMel, level_db};

/// Sound stands out from what is always there by so much, decibels.
const MARGIN_DB: f64 = 10.0;
/// Its loudest by so much, or it was too far away.
const PEAK_DB: f64 = 18.0;
/// What is always there falls by this share of the way to a frame that is quieter, and rises by so much a frame.
const FLOOR_FALL: f64 = 0.2;
const FLOOR_RISE_DB: f64 = 0.02;
/// Frames of 10 ms by which it is known.
const FLOOR_FRAMES: u64 = 50;
/// So many quiet frames end a word: within one it is never quiet for so long.
const QUIET_FRAMES: u64 = 35;
/// A sound of fewer is a click, one of more no single word.
const CLICK_FRAMES: u64 = 8;
const WORD_FRAMES: u64 = 150;
/// What is kept before and after the word, frames.
const AROUND_FRAMES: u64 = 25;
/// A sample this near to full scale was cut off, and so large a share of them spoils a clip.
const CLIPPED: f32 = 0.999;
const CLIPPED_SHARE: f64 = 0.005;

/// Why a sound is no clip to train with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Rejected {
    /// It went on for too long.
    #[error("that was more than one word")]
    Long,
    /// It hardly stands out.
    #[error("that was too quiet: come closer to the microphone")]
    Faint,
    /// It was cut off.
    #[error("that was too loud for the microphone: speak lower, or turn its gain down (alsamixer)")]
    Clipped,
}

/// A word with some quiet around it, in [-1, 1], or why there is none.
pub type Take = Result<Vec<f32>, Rejected>;

/// A sound that stands out, in frames: its first, its last loud one, and its loudest level.
#[derive(Debug, Clone, Copy)]
struct Sound {
    begin: u64,
    last: u64,
    peak_db: f64,
}

/// Listens for words.
pub struct Takes {
    mel: LogMel,
    frames: u64,
    floor_db: f64,
    sound: Option<Sound>,
    samples: Vec<f32>,
    /// Samples before the first that is kept.
    dropped: u64,
}

impl Default for Takes {
    fn default() -> Self {
        let mel = LogMel::default();
        Self { mel, frames: 0, floor_db: f64::INFINITY, sound: None, samples: Vec::new(), dropped: 0 }
    }
}

impl Takes {
    /// Takes samples in [-1, 1]; a word, once it has ended.
    pub fn push(&mut self, samples: &[f32]) -> Option<Take> {
        self.samples.extend_from_slice(samples);
        let mut levels_db = Vec::new();
        self.mel.push(samples, |frame| levels_db.push(level_db(&frame)));
        let mut take = None;
        for level_db in levels_db {
            take = take.or(self.frame(level_db));
        }
        if self.sound.is_none() {
            let kept = self.samples.len().min(AROUND_FRAMES as usize * HOP + 2 * FRAME);
            let drop = self.samples.len() - kept;
            self.samples.drain(..drop);
            self.dropped += drop as u64;
        }
        take
    }

    /// What was heard until now belongs to no word; how loud it is when nobody speaks stays known.
    pub fn forget(&mut self) {
        self.mel.clear();
        self.samples.clear();
        self.dropped = self.frames * HOP as u64;
        self.sound = None;
    }

    fn frame(&mut self, level_db: f64) -> Option<Take> {
        let frame = self.frames;
        self.frames += 1;
        self.floor_db = if level_db < self.floor_db {
            let from_db = if self.floor_db.is_finite() { self.floor_db } else { level_db };
            from_db + FLOOR_FALL * (level_db - from_db)
        } else {
            level_db.min(self.floor_db + FLOOR_RISE_DB)
        };
        if frame < FLOOR_FRAMES {
            return None;
        }
        if level_db > self.floor_db + MARGIN_DB {
            let sound = self.sound.get_or_insert(Sound { begin: frame, last: frame, peak_db: level_db });
            (sound.last, sound.peak_db) = (frame, sound.peak_db.max(level_db));
        }
        let sound = self.sound.filter(|sound| frame - sound.last >= QUIET_FRAMES)?;
        self.sound = None;
        let length = sound.last - sound.begin + 1;
        (length >= CLICK_FRAMES).then(|| self.cut(&sound, length))
    }

    fn cut(&self, sound: &Sound, length: u64) -> Take {
        if length > WORD_FRAMES {
            return Err(Rejected::Long);
        }
        if sound.peak_db < self.floor_db + PEAK_DB {
            return Err(Rejected::Faint);
        }
        let sample = |frame: u64| ((frame * HOP as u64).saturating_sub(self.dropped) as usize).min(self.samples.len());
        let from = sample(sound.begin.saturating_sub(AROUND_FRAMES));
        let to = (sample(sound.last + AROUND_FRAMES) + FRAME).min(self.samples.len());
        let clip = self.samples[from..to].to_vec();
        let clipped = clip.iter().filter(|sample| sample.abs() >= CLIPPED).count();
        if clipped as f64 > CLIPPED_SHARE * clip.len() as f64 { Err(Rejected::Clipped) } else { Ok(clip) }
    }
}

#[cfg(test)]
mod tests {
    use super::{Rejected, Take, Takes};

    /// Near-silence with sounds in it: from and to, seconds, and how loud.
    fn takes(length_s: f64, sounds: &[(f64, f64, f32)], piece: usize) -> Vec<Take> {
        let mut state = 1_u32;
        let samples: Vec<f32> = (0..(length_s * 16_000.0) as usize)
            .map(|i| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let (at_s, hiss) = (i as f64 / 16_000.0, (state >> 8) as f32 / (1 << 24) as f32 - 0.5);
                let loud = sounds.iter().find(|(from, to, _)| (*from..*to).contains(&at_s)).map_or(0.0, |s| s.2);
                ((1e-3 + loud) * hiss).clamp(-1.0, 1.0)
            })
            .collect();
        let mut takes = Takes::default();
        samples.chunks(piece).filter_map(|samples| takes.push(samples)).collect()
    }

    #[test]
    fn words_are_cut_out_with_some_quiet_around_them() {
        // The second is one word with a gap, as before a plosive.
        let sounds = [(1.0, 1.4, 0.3), (3.0, 3.2, 0.1), (3.35, 3.5, 0.05)];
        for piece in [160, 1280, 4801] {
            let found = takes(5.0, &sounds, piece);
            let lengths: Vec<f64> =
                found.iter().map(|take| take.as_ref().expect("a word").len() as f64 / 16_000.0).collect();
            assert_eq!(lengths.len(), 2, "{piece}: {lengths:?}");
            assert!((lengths[0] - 0.92).abs() < 0.06 && (lengths[1] - 1.02).abs() < 0.06, "{piece}: {lengths:?}");
        }
    }

    #[test]
    fn what_is_no_clip_is_told() {
        assert_eq!(takes(4.0, &[(1.0, 3.0, 0.3)], 1280), [Err(Rejected::Long)]);
        assert_eq!(takes(3.0, &[(1.0, 1.5, 3.0)], 1280), [Err(Rejected::Clipped)]);
        assert_eq!(takes(3.0, &[(1.0, 1.5, 4e-3)], 1280), [Err(Rejected::Faint)]);
        assert_eq!(takes(3.0, &[(1.0, 1.04, 0.3)], 1280), [], "a click");
        assert_eq!(takes(3.0, &[], 1280), []);
    }
}
