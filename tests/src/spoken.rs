//! A synthetic voice, at the recogniser's rate.

use std::path::Path;
use std::process::Command;

/// Samples a second.
pub const RATE_HZ: u32 = 16_000;

/// Whether the voice is there.
#[must_use]
pub fn can_hear() -> bool {
    let voice = Command::new("espeak-ng").arg("--version").output().is_ok();
    test_data::has(voice, "espeak-ng is missing: scripts/test installs it")
}

/// A word as espeak-ng says it.
#[must_use]
pub fn spoken(word: &str) -> Vec<i16> {
    spoken_by("en-us", "150", word)
}

/// A word as one of espeak-ng's voices says it, at so many words a minute.
#[must_use]
pub fn spoken_by(voice: &str, words_a_minute: &str, word: &str) -> Vec<i16> {
    let words = ["-v", voice, "-s", words_a_minute, "--stdout", word];
    let wav = Command::new("espeak-ng").args(words).output().expect("it speaks").stdout;
    let rate_hz = f64::from(u32::from_le_bytes(std::array::from_fn(|i| wav[24 + i])));
    let samples: Vec<f64> =
        wav[44..].chunks_exact(2).map(|bytes| f64::from(i16::from_le_bytes([bytes[0], bytes[1]]))).collect();
    let step = rate_hz / f64::from(RATE_HZ);
    let count = ((samples.len() - 1) as f64 / step) as usize;
    let at = |i: usize| {
        let from = i as f64 * step;
        let (first, share) = (from as usize, from.fract());
        (samples[first] * (1.0 - share) + samples[first + 1] * share) as i16
    };
    (0..count).map(at).collect()
}

/// Writes a WAV file, and the folders that it lies in.
pub fn write_wav(path: &Path, samples: &[i16]) {
    std::fs::create_dir_all(path.parent().expect("it lies in a folder")).expect("made");
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: RATE_HZ,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut writer = hound::WavWriter::create(path, spec).expect("it can be written");
    samples.iter().for_each(|sample| writer.write_sample(*sample).expect("it can be written"));
    writer.finalize().expect("it can be written");
}
