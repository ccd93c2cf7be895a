//! How periodic sound is: a voice is, a clatter or rushing water is not. Pure.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use crate::mel::{FRAME, HOP};

/// Of what the band-pass lets through every so manyth sample is looked at.
const DECIMATION: usize = 4;
/// So many of these are held against those before them, 40 ms.
const PERIODS: usize = 160;
/// By so many apart: pitches from 500 down to 69 Hz.
const LAGS: RangeInclusive<usize> = 8..=58;
const SPAN: usize = PERIODS + *LAGS.end();
/// Silence has no period.
const ENERGY_MIN: f64 = 1e-12;

/// A second-order section of a filter.
#[derive(Debug, Clone, Copy)]
struct Section {
    /// Of what goes in, the newest first; of what came out, without its first, which is 1.
    b: [f64; 3],
    a: [f64; 2],
    state: [f64; 2],
}

impl Section {
    const fn new(b: [f64; 3], a: [f64; 2]) -> Self {
        Self { b, a, state: [0.0; 2] }
    }

    /// Direct form II, transposed.
    fn filter(&mut self, x: f64) -> f64 {
        let (b, a, state) = (&self.b, &self.a, &mut self.state);
        let y = b[0] * x + state[0];
        *state = [b[1] * x - a[0] * y + state[1], b[2] * x - a[1] * y];
        y
    }
}

/// A band-pass of 80 to 900 Hz, Butterworth: where a voice's pitch and its first harmonics are.
const BAND_PASS: [Section; 2] = [
    Section::new([0.021_000_375, 0.042_000_751, 0.021_000_375], [-1.573_444_971, 0.662_020_574]),
    Section::new([1.0, -2.0, 1.0], [-1.956_966_607, 0.958_092_054]),
];

/// Tells of each frame of [`crate::LogMel`] how periodic the sound is, from samples as they come.
#[derive(Debug, Clone)]
pub struct Periodicity {
    band_pass: [Section; 2],
    /// Samples until the next is looked at, and of these until the next frame is whole.
    skipped: usize,
    missing: usize,
    /// What the band-pass let through, the newest last.
    low: VecDeque<f64>,
}

impl Default for Periodicity {
    fn default() -> Self {
        Self {
            band_pass: BAND_PASS,
            skipped: DECIMATION,
            missing: FRAME / DECIMATION,
            low: std::iter::repeat_n(0.0, SPAN).collect(),
        }
    }
}

impl Periodicity {
    /// Takes samples in [-1, 1], and hands over the periodicity, in [-1, 1], of each frame that they complete: the
    /// correlation of the last 40 ms or so with what they were a period before, by whichever period it is highest.
    pub fn push(&mut self, samples: &[f32], mut take: impl FnMut(f32)) {
        for sample in samples {
            let passed = self.band_pass.iter_mut().fold(f64::from(*sample), |x, section| section.filter(x));
            self.skipped -= 1;
            if self.skipped > 0 {
                continue;
            }
            self.skipped = DECIMATION;
            self.low.pop_front();
            self.low.push_back(passed);
            self.missing -= 1;
            if self.missing == 0 {
                self.missing = HOP / DECIMATION;
                take(self.newest() as f32);
            }
        }
    }

    fn newest(&mut self) -> f64 {
        let low: &[f64] = self.low.make_contiguous();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let first = &low[..PERIODS];
        let energy = dot(first, first);
        let alike = LAGS.map(|lag| {
            let later = &low[lag..lag + PERIODS];
            dot(first, later) / (energy * dot(later, later) + ENERGY_MIN).sqrt()
        });
        alike.fold(-1.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::Periodicity;
    use crate::mel::{LogMel, RATE_HZ};

    fn of(samples: &[f32], piece: usize) -> Vec<f32> {
        let (mut periodicity, mut found) = (Periodicity::default(), Vec::new());
        samples.chunks(piece).for_each(|samples| periodicity.push(samples, |p| found.push(p)));
        found
    }

    #[test]
    fn a_voice_s_buzz_is_periodic_and_a_hiss_is_not() {
        for hz in [75.0, 100.0, 150.0, 250.0, 450.0] {
            let buzz = |n: usize| (1..=6).map(|k| (TAU * k as f32 * hz * n as f32 / RATE_HZ as f32).sin()).sum::<f32>();
            let found = of(&(0..8000).map(|n| 0.1 * buzz(n)).collect::<Vec<_>>(), 160);
            assert!(found[8..].iter().all(|p| *p > 0.9), "{hz} Hz: {found:?}");
        }
        let mut state = 1_u32;
        let hiss = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state as f32 / 2.0_f32.powi(31) - 1.0
        };
        let found = of(&std::iter::repeat_with(hiss).take(8000).collect::<Vec<_>>(), 160);
        assert!(found[8..].iter().all(|p| *p < 0.7), "{found:?}");
        assert!(of(&[0.0; 8000], 160).iter().all(|p| *p == 0.0));
    }

    #[test]
    fn there_is_one_for_each_frame_however_the_samples_come() {
        for count in [0, 511, 512, 671, 672, 4001] {
            let samples: Vec<f32> = (0..count).map(|n| (n as f32 * 0.1).sin()).collect();
            let mut frames = 0;
            LogMel::default().push(&samples, |_| frames += 1);
            assert_eq!(of(&samples, 160).len(), frames);
            assert_eq!(of(&samples, 160), of(&samples, 77));
        }
    }
}
