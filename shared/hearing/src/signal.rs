//! Whether what comes is sound at all: how loud it is, whether it is cut off, whether the microphone is dead. Pure.

use crate::mel::RATE_HZ;

/// A sample this near to full scale was cut off.
const CLIPPED: f32 = 0.999;
/// Exact zeros for so long are no silence, samples: a microphone hears at least itself.
const DEAD_SAMPLES: u64 = RATE_HZ as u64;
/// So large a share of cut-off samples in a second spoils it.
const CLIPPED_SHARE: f64 = 0.01;

/// What is wrong with the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// Nothing but exact zeros: muted, unplugged behind its card, or the wrong input.
    Dead,
    /// Much of it is cut off: too loud for the microphone's gain.
    Clipping,
}

impl Trouble {
    /// All there are.
    pub const ALL: [Self; 2] = [Self::Dead, Self::Clipping];

    /// For the operator: what it is, and what to do.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Dead => "the microphone gives exact zeros: is it muted (alsamixer), or the wrong one?",
            Self::Clipping => "the microphone cuts off what is loud: turn its gain down (alsamixer)",
        }
    }
}

/// How good a second of sound was.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quality {
    /// Root mean square, decibels of full scale.
    pub level_dbfs: f32,
    /// Share of samples that were cut off.
    pub clipped: f32,
}

/// Looks at samples as they come.
#[derive(Debug, Clone, Default)]
pub struct Signal {
    zeros: u64,
    sum: f64,
    clipped: u64,
    count: u64,
    last: Quality,
}

impl Signal {
    /// Takes samples.
    pub fn take(&mut self, samples: &[f32]) {
        for sample in samples {
            self.zeros = if *sample == 0.0 { self.zeros + 1 } else { 0 };
            self.sum += f64::from(*sample) * f64::from(*sample);
            self.clipped += u64::from(sample.abs() >= CLIPPED);
            self.count += 1;
            if self.count == u64::from(RATE_HZ) {
                self.last = self.so_far();
                (self.sum, self.clipped, self.count) = (0.0, 0, 0);
            }
        }
    }

    fn so_far(&self) -> Quality {
        let count = self.count.max(1) as f64;
        let level_dbfs = (10.0 * (self.sum / count).max(1e-12).log10()) as f32;
        Quality { level_dbfs, clipped: (self.clipped as f64 / count) as f32 }
    }

    /// Of the last whole second.
    #[must_use]
    pub fn quality(&self) -> Quality {
        self.last
    }

    /// What is wrong with the source, if anything.
    #[must_use]
    pub fn trouble(&self) -> Option<Trouble> {
        if self.zeros >= DEAD_SAMPLES {
            return Some(Trouble::Dead);
        }
        (f64::from(self.last.clipped) > CLIPPED_SHARE).then_some(Trouble::Clipping)
    }
}

#[cfg(test)]
mod tests {
    use super::{Quality, Signal, Trouble};

    #[test]
    fn exact_zeros_are_a_dead_microphone_and_the_faintest_noise_is_not() {
        let mut signal = Signal::default();
        signal.take(&[0.0; 15_999]);
        assert_eq!(signal.trouble(), None);
        signal.take(&[0.0]);
        assert_eq!(signal.trouble(), Some(Trouble::Dead));
        signal.take(&[1.0 / 32768.0]);
        assert_eq!(signal.trouble(), None);
    }

    #[test]
    fn levels_are_of_the_last_whole_second_and_clipping_is_told() {
        let mut signal = Signal::default();
        assert_eq!(signal.quality(), Quality::default());
        signal.take(&[0.1; 16_000]);
        assert!((signal.quality().level_dbfs + 20.0).abs() < 0.01);
        assert_eq!((signal.quality().clipped, signal.trouble()), (0.0, None));
        (0..16_000).for_each(|i| signal.take(&[if i % 50 == 0 { 1.0 } else { 0.2 }]));
        assert_eq!(signal.trouble(), Some(Trouble::Clipping));
    }
}
