//! What is done to a recording before it is heard: noise, a room, a raised voice. The same seed gives the same.

use std::f32::consts::TAU;
use std::path::PathBuf;

use enrolment::{SILENCE, amid_silence};
use hearing::{RATE_HZ, mean_square, peak, speech_power, word_end};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use realfft::RealFftPlanner;

use super::decode;
use crate::args::cues::ConditionName;
use crate::exit::Failure;

/// What is less is silence: -90 dB of full scale.
const POWER_MIN: f32 = 1e-9;
/// A raised voice is higher by so much, brighter by so many decibels an octave, and clipped at this share of its peak.
const SHOUT: (f32, f32, f32) = (1.15, 5.0, 1.0 / 3.0);
/// A room: the time in which echoes fall by 60 dB, and the sound's own share of the energy.
const ROOM: (f32, f32) = (0.5, 0.4);

/// One of the conditions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition {
    /// As recorded.
    Clean,
    /// With noise, the speech by so many decibels louder.
    Noise(u8),
    /// As if shouted.
    Shout,
    /// In a room.
    Reverb,
}

/// Those of these names.
pub fn named(names: &[ConditionName]) -> Vec<Condition> {
    let all = [
        (ConditionName::Clean, Condition::Clean),
        (ConditionName::Noise20, Condition::Noise(20)),
        (ConditionName::Noise10, Condition::Noise(10)),
        (ConditionName::Noise5, Condition::Noise(5)),
        (ConditionName::Noise0, Condition::Noise(0)),
        (ConditionName::Shout, Condition::Shout),
        (ConditionName::Reverb, Condition::Reverb),
    ];
    let is_meant = |name: &ConditionName| names.contains(&ConditionName::All) || names.contains(name);
    all.into_iter().filter(|(name, _)| is_meant(name)).map(|(_, condition)| condition).collect()
}

/// Noise to hear through.
#[derive(Debug, Clone)]
pub struct Noises(Vec<Vec<f32>>);

impl Noises {
    /// Reads the files; without any it is pink noise.
    ///
    /// # Errors
    /// Where one cannot be read.
    pub fn read(paths: &[PathBuf]) -> Result<Self, Failure> {
        let read = |path: &PathBuf| {
            let noise = decode::read(path)?;
            if mean_square(&noise) < POWER_MIN {
                return Err(Failure::input(format!("{}: there is no noise in it", path.display())));
            }
            Ok(noise)
        };
        paths.iter().map(read).collect::<Result<Vec<_>, _>>().map(Self)
    }

    /// So much of one of them, of mean power 1.
    fn piece(&self, len: usize, dice: &mut ChaCha8Rng) -> Vec<f32> {
        let piece: Vec<f32> = if self.0.is_empty() {
            pink(len, dice)
        } else {
            let noise = &self.0[dice.random_range(0..self.0.len())];
            let from = dice.random_range(0..noise.len());
            noise.iter().cycle().skip(from).take(len).copied().collect()
        };
        let scale = mean_square(&piece).max(1e-12).sqrt().recip();
        piece.into_iter().map(|sample| sample * scale).collect()
    }
}

impl Condition {
    /// As on the command line, and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Noise(20) => "noise20",
            Self::Noise(10) => "noise10",
            Self::Noise(5) => "noise5",
            Self::Noise(_) => "noise0",
            Self::Shout => "shout",
            Self::Reverb => "reverb",
        }
    }

    /// What is heard of a recording, near-silence before and after it, and the sample at which what was said ends.
    pub fn apply(self, samples: &[f32], noises: &Noises, seed: u64) -> (usize, Vec<f32>) {
        let mut dice = ChaCha8Rng::seed_from_u64(seed);
        let end = SILENCE + word_end(samples);
        let mut heard = amid_silence(samples, &mut dice);
        match self {
            Self::Clean => (end, heard),
            Self::Noise(snr_db) => {
                let scale = (speech_power(samples) / 10_f32.powf(f32::from(snr_db) / 10.0)).sqrt();
                let noise = noises.piece(heard.len(), &mut dice);
                heard.iter_mut().zip(noise).for_each(|(sample, noise)| *sample += scale * noise);
                let peak = peak(&heard).max(1.0);
                heard.iter_mut().for_each(|sample| *sample /= peak);
                (end, heard)
            }
            Self::Shout => ((end as f32 / SHOUT.0) as usize, shouted(&heard)),
            Self::Reverb => (end, reverberant(&heard, &mut dice)),
        }
    }
}

fn normal(dice: &mut ChaCha8Rng) -> f32 {
    StandardNormal.sample(dice)
}

/// Pink noise by Kellet's filter, over white noise.
fn pink(len: usize, dice: &mut ChaCha8Rng) -> Vec<f32> {
    const POLES: [(f32, f32); 3] = [(0.997_65, 0.099_046), (0.963, 0.296_516_4), (0.57, 1.052_691_3)];
    let mut state = [0.0_f32; 3];
    (0..len)
        .map(|_| {
            let white = normal(dice);
            for (state, (pole, gain)) in state.iter_mut().zip(POLES) {
                *state = pole * *state + gain * white;
            }
            state.iter().sum::<f32>() + 0.1848 * white
        })
        .collect()
}

/// Played faster, so higher; brighter by a first-order shelf; clipped.
fn shouted(samples: &[f32]) -> Vec<f32> {
    let (faster, bright_db, clip) = SHOUT;
    let mut made = hearing::faster(samples, faster);
    // Two octaves above a corner at 700 Hz are raised, those below are left.
    let pole = 1.0 - (-TAU * 700.0 / RATE_HZ as f32).exp();
    let gain = 10_f32.powf(2.0 * bright_db / 20.0) - 1.0;
    let mut low = 0.0;
    for sample in &mut made {
        low += pole * (*sample - low);
        *sample += gain * (*sample - low);
    }
    let limit = peak(&made).max(1e-9) * clip;
    made.iter_mut().for_each(|sample| *sample = sample.clamp(-limit, limit) / limit * 0.9);
    made
}

/// Noise that falls by 60 dB in the room's time, as the room's echoes.
fn reverberant(samples: &[f32], dice: &mut ChaCha8Rng) -> Vec<f32> {
    let (rt60_s, direct) = ROOM;
    let len = (rt60_s * RATE_HZ as f32) as usize;
    let silent = RATE_HZ as usize / 200;
    let fall = |i: usize| 10_f32.powf(-3.0 * i as f32 / len as f32);
    let mut tail: Vec<f32> = (0..len).map(|i| if i < silent { 0.0 } else { normal(dice) * fall(i) }).collect();
    let energy: f32 = tail.iter().map(|sample| sample * sample).sum();
    let scale = ((1.0 - direct) / direct / energy).sqrt();
    tail.iter_mut().for_each(|sample| *sample *= scale);
    tail[0] = 1.0;
    let mut made = convolved(samples, &tail);
    let scale = peak(samples) / peak(&made).max(1e-9);
    made.iter_mut().for_each(|sample| *sample *= scale);
    made
}

/// The sound with each sample followed by the tail, as long as the sound: by overlapping blocks in the spectrum.
fn convolved(samples: &[f32], tail: &[f32]) -> Vec<f32> {
    let size = (2 * tail.len()).next_power_of_two();
    let block = size - tail.len() + 1;
    let mut planner = RealFftPlanner::<f32>::new();
    let (forward, inverse) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
    let spectrum_of = |samples: &[f32]| {
        let (mut padded, mut spectrum) = (vec![0.0; size], forward.make_output_vec());
        padded[..samples.len()].copy_from_slice(samples);
        let done = forward.process(&mut padded, &mut spectrum);
        debug_assert!(done.is_ok(), "the lengths are the transform's own");
        spectrum
    };
    let tail_spectrum = spectrum_of(tail);
    let mut made = vec![0.0; samples.len() + size];
    for (number, piece) in samples.chunks(block).enumerate() {
        let mut spectrum = spectrum_of(piece);
        spectrum.iter_mut().zip(&tail_spectrum).for_each(|(bin, tail)| *bin *= tail);
        let mut sound = inverse.make_output_vec();
        let done = inverse.process(&mut spectrum, &mut sound);
        debug_assert!(done.is_ok(), "it is the spectrum of real numbers");
        for (made, sample) in made[number * block..].iter_mut().zip(&sound) {
            *made += sample / size as f32;
        }
    }
    made.truncate(samples.len());
    made
}

#[cfg(test)]
mod tests {
    use super::{Condition, Noises, SILENCE, convolved, mean_square, word_end};
    use enrolment::HISS;

    /// Half a second of a tone between stretches of faint noise.
    fn word() -> Vec<f32> {
        let faint = |i: usize| 1e-4 * ((i * 7919 % 101) as f32 / 50.0 - 1.0);
        (0..16_000)
            .map(|i| faint(i) + if (4000..12_000).contains(&i) { 0.3 * (i as f32 * 0.3).sin() } else { 0.0 })
            .collect()
    }

    #[test]
    fn a_word_ends_where_it_ends() {
        assert!(word_end(&word()).abs_diff(12_000) <= 320, "{}", word_end(&word()));
        assert_eq!(word_end(&[]), 0);
    }

    #[test]
    fn noise_is_as_loud_as_it_is_to_be() {
        let (_, clean) = Condition::Clean.apply(&word(), &Noises(Vec::new()), 1);
        let (end, noisy) = Condition::Noise(10).apply(&word(), &Noises(Vec::new()), 1);
        assert!(end.abs_diff(SILENCE + 12_000) <= 320);
        // Half of the blocks hold the tone, whose power is 0.045.
        let added = mean_square(&noisy[..SILENCE]);
        assert!((added / 0.0045 - 1.0).abs() < 0.5, "{added}");
        assert!(mean_square(&clean[..SILENCE]) < 2.0 * HISS * HISS);
        assert_eq!(noisy, Condition::Noise(10).apply(&word(), &Noises(Vec::new()), 1).1);
    }

    #[test]
    fn a_convolution_in_blocks_is_one_of_the_whole() {
        let samples: Vec<f32> = (0..5000).map(|i| (i as f32 * 0.7).sin()).collect();
        let tail: Vec<f32> = (0..300).map(|i| (-(i as f32) / 40.0).exp()).collect();
        let made = convolved(&samples, &tail);
        for at in [0, 1, 299, 800, 4999] {
            let expected: f32 = tail.iter().enumerate().take(at + 1).map(|(i, weight)| weight * samples[at - i]).sum();
            assert!((made[at] - expected).abs() < 1e-3, "{at}: {} {expected}", made[at]);
        }
    }
}
