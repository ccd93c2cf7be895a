//! Samples of WAV and FLAC files, whatever their rate and channels, as the recogniser takes them.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use hearing::{PcmError, PcmStream, RATE_HZ};
use rubato::audioadapter_buffers::owned::InterleavedOwned;
use rubato::{Fft, FixedSync, Resampler};

use crate::exit::Failure;

/// No file has more samples of a channel: three hours at [`RATE_HZ`]. And no more bytes, as the robot reads a WAV.
const SAMPLES_MAX: usize = 3 * 3600 * RATE_HZ as usize;
const BYTES_MAX: u64 = 2 * SAMPLES_MAX as u64 + (1 << 20);
const TOO_LONG: &str = "it is longer than three hours at 16 kHz, or as many samples at another rate";
/// Rates that are spoken at, Hz.
const RATES_HZ: std::ops::RangeInclusive<u32> = 4_000..=192_000;
const CHANNELS_MAX: usize = 16;
/// Frames that are resampled at once.
const CHUNK: usize = 1024;

/// The samples of a file in [-1, 1], at [`RATE_HZ`]: the mean of its channels, resampled where its rate is another.
///
/// # Errors
/// Where it cannot be read, or is no sound.
pub fn read(path: &Path) -> Result<Vec<f32>, Failure> {
    let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
    // Before it is opened: opening a pipe would wait for its writer, and a device has no end.
    if !path.metadata().map_err(|error| wrong(error.to_string()))?.is_file() {
        return Err(wrong("it is not a file".to_owned()));
    }
    let file = File::open(path).map_err(|error| wrong(error.to_string()))?;
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("flac")) {
        return flac(BufReader::new(file)).map_err(wrong);
    }
    let mut bytes = Vec::new();
    file.take(BYTES_MAX).read_to_end(&mut bytes).map_err(|error| wrong(error.to_string()))?;
    let (mut pcm, mut samples) = (PcmStream::of_file(path), Vec::new());
    let pushed = pcm.push(&bytes, &mut samples);
    drop(bytes);
    match pushed {
        Ok(()) => {
            let too_long = (samples.len() > SAMPLES_MAX).then_some(TOO_LONG);
            let none = samples.is_empty().then_some("no samples are in it");
            too_long.or(pcm.missing()).or(none).map_or(Ok(samples), |why| Err(wrong(why.to_owned())))
        }
        Err(PcmError::Format { .. }) => other_wav(path).map_err(wrong),
        Err(error) => Err(wrong(error.to_string())),
    }
}

fn other_wav(path: &Path) -> Result<Vec<f32>, String> {
    let remedy = format!("sox IN -r {RATE_HZ} -c 1 -b 16 OUT makes one that can be");
    let broken = |error: hound::Error| format!("this WAV file cannot be read ({error}): {remedy}");
    let mut reader = hound::WavReader::open(path).map_err(broken)?;
    let spec = reader.spec();
    let sound = Sound::new(usize::from(spec.channels), spec.sample_rate)?;
    match spec.sample_format {
        hound::SampleFormat::Float => sound.read(reader.samples::<f32>().map(|sample| sample.map_err(broken))),
        hound::SampleFormat::Int => {
            let full = (1_u64 << spec.bits_per_sample.clamp(1, 32).saturating_sub(1)) as f32;
            let samples = reader.samples::<i32>();
            sound.read(samples.map(|sample| sample.map(|sample| sample as f32 / full).map_err(broken)))
        }
    }
}

fn flac(file: impl Read) -> Result<Vec<f32>, String> {
    let broken = |error: claxon::Error| format!("it is no whole FLAC file: {error}");
    let mut reader = claxon::FlacReader::new(file).map_err(broken)?;
    let info = reader.streaminfo();
    let full = (1_u64 << (info.bits_per_sample - 1)) as f32;
    let sound = Sound::new(info.channels as usize, info.sample_rate)?;
    sound.read(reader.samples().map(|sample| sample.map(|sample| sample as f32 / full).map_err(broken)))
}

/// What a file says of itself.
#[derive(Debug, Clone, Copy)]
struct Sound {
    channels: usize,
    rate_hz: u32,
}

impl Sound {
    fn new(channels: usize, rate_hz: u32) -> Result<Self, String> {
        if RATES_HZ.contains(&rate_hz) && (1..=CHANNELS_MAX).contains(&channels) {
            return Ok(Self { channels, rate_hz });
        }
        Err(format!("{channels} channels at {rate_hz} Hz: this is no recorded speech"))
    }

    /// One channel at [`RATE_HZ`] of samples that come channel beside channel. A few bytes may stand for any number of
    /// them, so each is counted as it comes.
    fn read(self, samples: impl Iterator<Item = Result<f32, String>>) -> Result<Vec<f32>, String> {
        let (mut mixed, mut sum, mut of) = (Vec::new(), 0.0, 0);
        for sample in samples {
            sum += sample?;
            of += 1;
            if of == self.channels {
                mixed.push(sum / self.channels as f32);
                (sum, of) = (0.0, 0);
            }
            if mixed.len() > SAMPLES_MAX {
                return Err(TOO_LONG.to_owned());
            }
        }
        if mixed.is_empty() {
            return Err("no samples are in it".to_owned());
        }
        if !mixed.iter().all(|sample| sample.is_finite()) {
            return Err("a sample of it is no number".to_owned());
        }
        if self.rate_hz == RATE_HZ {
            return Ok(mixed);
        }
        let rate_hz = self.rate_hz;
        resampled(mixed, rate_hz).map_err(|error| format!("it cannot be resampled from {rate_hz} Hz: {error}"))
    }
}

fn resampled(samples: Vec<f32>, rate_hz: u32) -> Result<Vec<f32>, Box<dyn std::error::Error>> {
    let frames = samples.len();
    let mut resampler = Fft::<f32>::new(rate_hz as usize, RATE_HZ as usize, CHUNK, 1, FixedSync::Both)?;
    let made = resampler.process_all(&InterleavedOwned::new_from(samples, 1, frames)?, frames, None)?;
    let made = made.take_data();
    if made.len() > SAMPLES_MAX { Err(TOO_LONG.into()) } else { Ok(made) }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::{CHANNELS_MAX, Sound};

    fn converted(samples: &[f32], channels: usize, rate_hz: u32) -> Result<Vec<f32>, String> {
        Sound::new(channels, rate_hz)?.read(samples.iter().map(|sample| Ok(*sample)))
    }

    /// A tone of 1 kHz at a rate, the same on all channels.
    fn tone(rate_hz: u32, channels: usize) -> Vec<f32> {
        let sample = |i: u32| 0.5 * (TAU * 1000.0 * i as f32 / rate_hz as f32).sin();
        (0..rate_hz).flat_map(|i| vec![sample(i); channels]).collect()
    }

    #[test]
    fn a_tone_is_the_same_tone_from_any_rate_and_number_of_channels() {
        for (rate_hz, channels) in [(16_000, 2), (44_100, 2), (48_000, 1), (8_000, 1), (22_050, 1)] {
            let made = converted(&tone(rate_hz, channels), channels, rate_hz).expect("it is one");
            assert!(made.len().abs_diff(16_000) <= 1, "{rate_hz} Hz gives {} samples", made.len());
            // Of the tone itself, in phase and beside it: it may come up to half a sample later.
            let part =
                |of: fn(f32) -> f32| (1000..15_000).map(|i| made[i] * of(TAU * i as f32 / 16.0)).sum::<f32>() / 7000.0;
            let (sine, cosine) = (part(f32::sin), part(f32::cos));
            assert!((sine.hypot(cosine) - 0.5).abs() < 0.01, "{rate_hz} Hz, {channels} channels: {sine} {cosine}");
            assert!(cosine.atan2(sine).abs() < TAU / 32.0, "{rate_hz} Hz, {channels} channels: {sine} {cosine}");
        }
    }

    #[test]
    fn what_nobody_speaks_at_is_refused() {
        assert!(converted(&[0.0; 8], 0, 16_000).is_err() && converted(&[0.0; 64], CHANNELS_MAX + 1, 16_000).is_err());
        assert!(converted(&[f32::NAN; 8], 1, 16_000).is_err_and(|why| why.contains("no number")));
        assert!(converted(&[0.0; 8], 1, 1).is_err_and(|why| why.contains("1 Hz")));
        assert!(converted(&[], 1, 16_000).is_err_and(|why| why.contains("no samples")));
    }
}
