//! Sound in memory: from the voice's WAV, to a player's.

use std::io::Cursor;
use std::time::Duration;

use hound::{SampleFormat, WavReader, WavSpec, WavWriter};
use speech::Tone;

/// What is quieter is silence: half a percent of full scale.
const SILENCE: u16 = 164;
/// So much of the silence before and after is left, seconds.
const MARGIN_S: f64 = 0.02;
/// Sample rates that a voice may have, hertz.
const RATES_HZ: std::ops::RangeInclusive<u32> = 8_000..=48_000;

/// A sentence as sound: samples of 16 bits, channels interleaved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Clip {
    rate_hz: u32,
    channels: u16,
    samples: Vec<i16>,
}

impl Clip {
    /// The sound in a WAV, without the silence around it. One that was written to a pipe does not know its length, and
    /// is taken as far as it goes.
    ///
    /// # Errors
    /// Where it is no WAV that can be played, or silent.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        if bytes.is_empty() {
            return Err("it gives nothing on its standard output".to_owned());
        }
        let mut reader =
            WavReader::new(Cursor::new(bytes)).map_err(|error| format!("what it gives is no WAV: {error}"))?;
        let WavSpec { channels, sample_rate, bits_per_sample, sample_format } = reader.spec();
        if !(1..=2).contains(&channels) || !RATES_HZ.contains(&sample_rate) {
            return Err(format!("it gives {channels} channels of {sample_rate} Hz, which nobody plays"));
        }
        let mut samples: Vec<i16> = match sample_format {
            SampleFormat::Float => {
                let scaled = |sample: f32| (sample * f32::from(i16::MAX)) as i16;
                reader.samples::<f32>().map_while(Result::ok).map(scaled).collect()
            }
            SampleFormat::Int => {
                let shift = i32::from(bits_per_sample) - 16;
                let scaled = |sample: i32| if shift >= 0 { sample >> shift } else { sample << -shift };
                reader.samples::<i32>().map_while(Result::ok).map(|sample| scaled(sample) as i16).collect()
            }
        };
        samples.truncate(samples.len() - samples.len() % usize::from(channels));
        let clip = Self { rate_hz: sample_rate, channels, samples };
        clip.trimmed().ok_or_else(|| "what it gives is silence".to_owned())
    }

    /// A tone, at this rate and of one channel.
    pub fn tone(tone: &Tone, rate_hz: u32) -> Self {
        Self { rate_hz, channels: 1, samples: tone.samples(rate_hz) }
    }

    fn trimmed(mut self) -> Option<Self> {
        let is_heard = |sample: &i16| sample.unsigned_abs() > SILENCE;
        let (first, last) = (self.samples.iter().position(is_heard)?, self.samples.iter().rposition(is_heard)?);
        let channels = usize::from(self.channels);
        let margin = (f64::from(self.rate_hz) * MARGIN_S) as usize * channels;
        let end = (last + 1 + margin).next_multiple_of(channels).min(self.samples.len());
        let begin = first.saturating_sub(margin) / channels * channels;
        self.samples.truncate(end);
        self.samples.drain(..begin);
        Some(self)
    }

    /// Silence of that length, as a pause between two sentences.
    pub fn pause(&self, length: Duration) -> Vec<i16> {
        vec![0; (f64::from(self.rate_hz) * length.as_secs_f64()) as usize * usize::from(self.channels)]
    }

    /// How long it takes, nanoseconds.
    pub fn duration_ns(&self) -> u64 {
        let frames = self.samples.len() as u64 / u64::from(self.channels);
        frames * 1_000_000_000 / u64::from(self.rate_hz)
    }

    /// The samples up to that time, nanoseconds.
    pub fn until(&self, at_ns: u64) -> &[i16] {
        let frames = at_ns.saturating_mul(u64::from(self.rate_hz)) / 1_000_000_000;
        let end = usize::try_from(frames).unwrap_or(usize::MAX).saturating_mul(usize::from(self.channels));
        &self.samples[..end.min(self.samples.len())]
    }

    /// What a WAV of it is.
    pub fn spec(&self) -> WavSpec {
        let sample_format = SampleFormat::Int;
        WavSpec { channels: self.channels, sample_rate: self.rate_hz, bits_per_sample: 16, sample_format }
    }

    /// It as a WAV.
    ///
    /// # Errors
    /// Where it is longer than a WAV can be.
    pub fn wav(&self) -> Result<Vec<u8>, String> {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = WavWriter::new(&mut bytes, self.spec()).map_err(|error| error.to_string())?;
        for sample in &self.samples {
            writer.write_sample(*sample).map_err(|error| error.to_string())?;
        }
        writer.finalize().map_err(|error| error.to_string())?;
        Ok(bytes.into_inner())
    }

    /// Memory that it takes, bytes.
    pub fn bytes(&self) -> usize {
        self.samples.len() * size_of::<i16>()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::Clip;
    use hound::{SampleFormat, WavSpec, WavWriter};
    use std::io::Cursor;

    /// A tone of 440 Hz for so long, with so much silence before and after, milliseconds.
    pub(crate) fn tone(ms: usize, silence_ms: usize) -> Clip {
        let rate_hz = 16_000;
        let wave = |i: usize| ((i as f64 * 440.0 * std::f64::consts::TAU / 16_000.0).cos() * 8000.0) as i16;
        let silence = vec![0; silence_ms * 16];
        let samples = [silence.clone(), (0..ms * 16).map(wave).collect(), silence].concat();
        Clip { rate_hz, channels: 1, samples }
    }

    #[test]
    fn a_wav_comes_back_without_the_silence_around_it() {
        let clip = Clip::parse(&tone(500, 300).wav().expect("short")).expect("a tone");
        let ms = clip.duration_ns() / 1_000_000;
        assert!((535..=541).contains(&ms), "{ms}");
        assert_eq!(clip.until(100_000_000).len(), 1600);
        assert_eq!(clip.until(u64::MAX).len() * 2, clip.bytes());
    }

    #[test]
    fn one_out_of_a_pipe_does_not_know_its_length() {
        let mut bytes = tone(500, 0).wav().expect("short");
        // As espeak-ng writes it.
        bytes[4..8].copy_from_slice(&0x7fff_f024_u32.to_le_bytes());
        bytes[40..44].copy_from_slice(&0x7fff_f000_u32.to_le_bytes());
        assert_eq!(Clip::parse(&bytes).expect("a tone").duration_ns(), 500_000_000);
    }

    #[test]
    fn other_formats_are_taken_too() {
        for (bits_per_sample, sample_format) in
            [(24, SampleFormat::Int), (8, SampleFormat::Int), (32, SampleFormat::Float)]
        {
            let spec = WavSpec { channels: 2, sample_rate: 48_000, bits_per_sample, sample_format };
            let mut bytes = Cursor::new(Vec::new());
            let mut writer = WavWriter::new(&mut bytes, spec).expect("a format that there is");
            for i in 0..9600 {
                let level = if i % 96 < 48 { 0.5 } else { -0.5 };
                match sample_format {
                    SampleFormat::Float => writer.write_sample(level as f32).expect("written"),
                    SampleFormat::Int => {
                        let full = f64::from(1 << (bits_per_sample - 1));
                        writer.write_sample((level * full) as i32).expect("written");
                    }
                }
            }
            writer.finalize().expect("written");
            let clip = Clip::parse(&bytes.into_inner()).expect("it can be played");
            assert_eq!(clip.duration_ns(), 100_000_000, "{bits_per_sample}");
            assert!(clip.samples.iter().all(|sample| (16_000..=16_500).contains(&sample.unsigned_abs())));
        }
    }

    #[test]
    fn what_is_no_speech_is_refused_with_the_reason() {
        let silent = Clip { samples: vec![0; 16_000], ..tone(0, 0) };
        let fast = Clip { rate_hz: 192_000, ..tone(10, 0) };
        for (bytes, what) in [
            (Vec::new(), "gives nothing"),
            (b"hello".to_vec(), "no WAV"),
            (silent.wav().expect("short"), "silence"),
            (fast.wav().expect("short"), "192000 Hz"),
            (silent.wav().expect("short")[..30].to_vec(), "no WAV"),
        ] {
            assert!(Clip::parse(&bytes).expect_err(what).contains(what));
        }
    }
}
