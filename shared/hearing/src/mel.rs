//! Log-mel frames: 32 bands, one frame each 10 ms.
//!
//! After the features of Google's speech embedding, but with a fixed floor, where the original takes 80 dB below the
//! loudest of whatever is handed to it at once: a stream has no such thing.

use std::f64::consts::TAU;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};

/// Samples a second.
pub const RATE_HZ: u32 = 16_000;
/// Samples from one frame to the next.
pub const HOP: usize = 160;
/// Bands of a frame.
pub const BANDS: usize = 32;
/// Samples of a frame, of which the window takes the middle ones.
pub const FRAME: usize = 512;
const WINDOW: usize = 400;
const BINS: usize = FRAME / 2 + 1;
/// The bands' edges lie evenly between these on Slaney's mel scale, Hz.
const EDGES_HZ: (f64, f64) = (60.0, 3800.0);
/// No level is taken to be lower: of the logarithm's argument, and in decibels.
const POWER_MIN: f32 = 1e-10;
const FLOOR_DB: f32 = -85.7;

/// Levels of one frame by band, as the embedding takes them: decibels / 10 + 2.
pub type Mel = [f32; BANDS];

/// Slaney's scale: linear below 1 kHz, logarithmic above.
fn mel_of_hz(hz: f64) -> f64 {
    if hz < 1000.0 { hz * 3.0 / 200.0 } else { 15.0 + 27.0 * (hz / 1000.0).ln() / 6.4_f64.ln() }
}

fn hz_of_mel(mel: f64) -> f64 {
    if mel < 15.0 { mel * 200.0 / 3.0 } else { 1000.0 * ((mel - 15.0) * 6.4_f64.ln() / 27.0).exp() }
}

/// A band: a triangle over some of the spectrum's bins, of area 1 over Hz.
#[derive(Debug, Clone)]
struct Band {
    first: usize,
    weights: Vec<f32>,
}

impl Band {
    fn new(number: usize) -> Self {
        let (low, high) = (mel_of_hz(EDGES_HZ.0), mel_of_hz(EDGES_HZ.1));
        let edge = |i: usize| hz_of_mel(low + (high - low) * i as f64 / (BANDS + 1) as f64);
        let [below, peak, above] = [0, 1, 2].map(|i| edge(number + i));
        let weight = |bin: usize| {
            let hz = bin as f64 * f64::from(RATE_HZ) / FRAME as f64;
            ((hz - below) / (peak - below)).min((above - hz) / (above - peak)).max(0.0) * 2.0 / (above - below)
        };
        let first = (0..BINS).find(|bin| weight(*bin) > 0.0).unwrap_or(0);
        let weights = (first..BINS).map(weight).take_while(|weight| *weight > 0.0).map(|weight| weight as f32);
        Self { first, weights: weights.collect() }
    }

    fn of(&self, power: &[f32]) -> f32 {
        self.weights.iter().zip(&power[self.first..]).map(|(weight, power)| weight * power).sum()
    }
}

/// Makes frames of samples as they come.
#[derive(Clone)]
pub struct LogMel {
    window: Vec<f32>,
    bands: Vec<Band>,
    fft: Arc<dyn RealToComplex<f32>>,
    scratch: Vec<Complex<f32>>,
    /// Samples from the next frame's first on.
    waiting: Vec<f32>,
    windowed: Vec<f32>,
    spectrum: Vec<Complex<f32>>,
    power: Vec<f32>,
}

impl Default for LogMel {
    fn default() -> Self {
        let fft = RealFftPlanner::new().plan_fft_forward(FRAME);
        let mut window = vec![0.0; FRAME];
        let middle = (FRAME - WINDOW) / 2..(FRAME + WINDOW) / 2;
        for (n, weight) in window[middle].iter_mut().enumerate() {
            *weight = (0.5 - 0.5 * (TAU * n as f64 / WINDOW as f64).cos()) as f32;
        }
        Self {
            window,
            bands: (0..BANDS).map(Band::new).collect(),
            scratch: fft.make_scratch_vec(),
            spectrum: fft.make_output_vec(),
            fft,
            waiting: Vec::with_capacity(2 * FRAME),
            windowed: vec![0.0; FRAME],
            power: vec![0.0; BINS],
        }
    }
}

impl LogMel {
    /// Takes samples in [-1, 1], and hands over the frames that they complete.
    pub fn push(&mut self, samples: &[f32], mut take: impl FnMut(Mel)) {
        for samples in samples.chunks(FRAME) {
            self.waiting.extend_from_slice(samples);
            while self.waiting.len() >= FRAME {
                take(self.frame());
                self.waiting.drain(..HOP);
            }
        }
    }

    fn frame(&mut self) -> Mel {
        for ((windowed, sample), weight) in self.windowed.iter_mut().zip(&self.waiting).zip(&self.window) {
            *windowed = sample * weight;
        }
        let done = self.fft.process_with_scratch(&mut self.windowed, &mut self.spectrum, &mut self.scratch);
        debug_assert!(done.is_ok(), "the lengths are the transform's own");
        for (power, bin) in self.power.iter_mut().zip(&self.spectrum) {
            *power = bin.norm_sqr();
        }
        let mut mel = [0.0; BANDS];
        for (level, band) in mel.iter_mut().zip(&self.bands) {
            *level = (10.0 * band.of(&self.power).max(POWER_MIN).log10()).max(FLOOR_DB) / 10.0 + 2.0;
        }
        mel
    }

    /// The next sample is the first.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::{BANDS, HOP, LogMel, Mel, RATE_HZ, hz_of_mel, mel_of_hz};
    use std::f64::consts::TAU;

    fn frames(samples: &[f32], piece: usize) -> Vec<Mel> {
        let (mut mel, mut frames) = (LogMel::default(), Vec::new());
        samples.chunks(piece).for_each(|samples| mel.push(samples, |frame| frames.push(frame)));
        frames
    }

    fn tone(hz: f64) -> Vec<f32> {
        (0..4000).map(|i| (0.1 * (TAU * hz * f64::from(i) / f64::from(RATE_HZ)).sin()) as f32).collect()
    }

    #[test]
    fn a_tone_is_in_its_band_however_its_samples_come() {
        let samples = tone(1000.0);
        let whole = frames(&samples, samples.len());
        assert_eq!(whole.len(), (samples.len() - 512) / HOP + 1);
        assert_eq!(whole, frames(&samples, 7));
        let loudest = (0..BANDS).max_by(|a, b| whole[3][*a].total_cmp(&whole[3][*b])).expect("bands");
        let step = (mel_of_hz(3800.0) - mel_of_hz(60.0)) / 33.0;
        let peak_hz = hz_of_mel(mel_of_hz(60.0) + step * (loudest + 1) as f64);
        assert!((peak_hz - 1000.0).abs() < 60.0, "{peak_hz} Hz");
    }

    #[test]
    fn silence_is_at_the_floor() {
        assert!(frames(&[0.0; 2000], 2000).iter().flatten().all(|level| (*level - (2.0 - 8.57)).abs() < 1e-6));
    }
}
