//! Sounds that are no words. Each is told from the others by how it goes: what is lost falls, what begins rises.

use std::f64::consts::TAU;

/// A third of full scale.
const LEVEL: f64 = 11_000.0;
/// No click at either end of a part: it fades over this share of it.
const FADE: f64 = 0.05;

/// Notes, one after another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    notes_hz: &'static [f64],
    note_s: f64,
}

impl Tone {
    /// The robot's voice is lost.
    pub const VOICE_LOST: Self = Self { notes_hz: &[880.0, 660.0, 440.0], note_s: 0.2 };
    /// The robot is about to walk, because somebody said so. Short: the cue's age counts meanwhile.
    pub const BEFORE_MOTION: Self = Self { notes_hz: &[660.0, 990.0], note_s: 0.1 };

    /// How long it takes, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.note_s * self.notes_hz.len() as f64
    }

    /// It as samples of one channel.
    #[must_use]
    pub fn samples(&self, rate_hz: u32) -> Vec<i16> {
        let (rate, count) = (f64::from(rate_hz), (f64::from(rate_hz) * self.note_s) as u32);
        let note = |hz: f64| {
            (0..count).map(move |i| {
                let edge = f64::from(i.min(count - i)) / (FADE * f64::from(count));
                ((TAU * hz * f64::from(i) / rate).sin() * LEVEL * edge.min(1.0)) as i16
            })
        };
        self.notes_hz.iter().flat_map(|hz| note(*hz)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Tone;

    #[test]
    fn a_tone_is_as_long_and_as_loud_as_it_says_and_has_no_click() {
        for tone in [Tone::VOICE_LOST, Tone::BEFORE_MOTION] {
            let samples = tone.samples(22_050);
            assert!((samples.len() as f64 / 22_050.0 - tone.duration_s()).abs() < 0.001);
            let peak = samples.iter().map(|sample| sample.unsigned_abs()).max();
            assert!(peak > Some(9_000) && peak < Some(11_001), "{peak:?}");
            assert!(samples[0].abs() < 100 && samples.last().is_some_and(|last| last.abs() < 500));
        }
    }
}
