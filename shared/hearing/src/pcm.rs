//! A stream of sound as it comes over a pipe or lies in a file: raw samples, or a WAV file from its first byte on.
//! Pure.
//!
//! Samples are 16 bits, little endian, 16,000 a second, of one channel: `arecord -t raw -f S16_LE -r 16000 -c 1` sends
//! that. Nothing is resampled: who records at another rate is told what to do.

use std::path::Path;

use crate::mel::RATE_HZ;

/// Of a chunk: its name and its length.
const CHUNK_HEAD: usize = 8;
/// `RIFF`, a length, `WAVE`.
const FILE_HEAD: usize = 12;
/// What is needed of the chunk `fmt `, and where its format stands in an extension.
const FORMAT: usize = 16;
const FORMAT_EXTENDED: usize = 26;
/// Where the extension has the format code.
const SUB_FORMAT: usize = 24;
/// Chunks before the samples are no longer than this, bytes: a cover picture may be among them.
const CHUNK_MAX: u32 = 16 << 20;
/// The format code of plain samples, and of those whose format stands in the chunk's extension.
const PLAIN: u16 = 1;
const EXTENDED: u16 = 0xfffe;

/// Why a stream is no sound for us.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PcmError {
    /// It is another format, rate, or number of channels.
    #[error(
        "{channels} channels of {bits} bits at {rate_hz} Hz (format {format}): 1 channel of 16 bits at {RATE_HZ} Hz is \
         wanted (sox IN -r {RATE_HZ} -c 1 -b 16 OUT)"
    )]
    Format {
        /// The format code; 1 is plain samples.
        format: u16,
        /// How many.
        channels: u16,
        /// Samples a second.
        rate_hz: u32,
        /// Of a sample.
        bits: u16,
    },
    /// It begins like a WAV file and does not go on like one.
    #[error("it is no whole WAV file: {0}")]
    Broken(&'static str),
}

/// Where in the stream it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    /// Nothing came yet; whether it has to be a WAV file.
    Start { wav: bool },
    /// Between chunks; whether the format is known.
    Chunk { format_known: bool },
    /// In a chunk that tells nothing: bytes left.
    Skip { left: u32, format_known: bool },
    /// Among the samples: bytes left, where it is known.
    Samples { left: Option<u64> },
    /// After the samples: another WAV file may follow.
    End,
    /// What follows them is none.
    Over,
}

/// Reads a stream.
#[derive(Debug, Clone)]
pub struct PcmStream {
    at: At,
    waiting: Vec<u8>,
}

impl Default for PcmStream {
    fn default() -> Self {
        Self { at: At::Start { wav: false }, waiting: Vec::new() }
    }
}

impl PcmStream {
    /// Of a file: one that is called like a WAV file has to be one.
    #[must_use]
    pub fn of_file(path: &Path) -> Self {
        let wav = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("wav"));
        Self { at: At::Start { wav }, ..Self::default() }
    }

    /// Takes bytes, and adds the samples in them, in [-1, 1].
    ///
    /// # Errors
    /// Where it is no such sound.
    pub fn push(&mut self, bytes: &[u8], samples: &mut Vec<f32>) -> Result<(), PcmError> {
        self.waiting.extend_from_slice(bytes);
        let mut from = 0;
        while let Some(taken) = self.step(from, samples)? {
            from += taken;
        }
        self.waiting.drain(..from);
        Ok(())
    }

    /// Whether nothing came yet.
    #[must_use]
    pub fn is_new(&self) -> bool {
        matches!(self.at, At::Start { .. }) && self.waiting.is_empty()
    }

    /// Whether something came behind a WAV file that is none: it is not heard.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.at == At::Over
    }

    /// What is missing at the end of the stream, if anything: of a WAV file that was cut off.
    #[must_use]
    pub fn missing(&self) -> Option<&'static str> {
        match self.at {
            At::Start { .. } if self.waiting.is_empty() => Some("it is empty"),
            At::Start { wav: true } => Some("it is no WAV file"),
            At::Chunk { .. } | At::Skip { .. } => Some("no samples came"),
            At::Samples { left: Some(left) } if left > 0 => Some("it was cut off"),
            _ => None,
        }
    }

    /// Takes one thing from the bytes; how long it was, or `None` where more have to come.
    fn step(&mut self, from: usize, samples: &mut Vec<f32>) -> Result<Option<usize>, PcmError> {
        let bytes = &self.waiting[from..];
        let number = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        match self.at {
            At::Start { wav } if bytes.len() >= FILE_HEAD => {
                let is_wav = begins_wav(bytes);
                if wav && !is_wav {
                    return Err(PcmError::Broken("it does not begin like one"));
                }
                self.at = if is_wav { At::Chunk { format_known: false } } else { At::Samples { left: None } };
                Ok(Some(if is_wav { FILE_HEAD } else { 0 }))
            }
            At::Chunk { format_known } if bytes.len() >= CHUNK_HEAD => {
                let len = number(4);
                if bytes.starts_with(b"data") {
                    if !format_known {
                        return Err(PcmError::Broken("samples before their format"));
                    }
                    // Who writes to a pipe does not know how long it will be.
                    let left = (len != 0 && len < u32::MAX / 2).then_some(u64::from(len));
                    self.at = At::Samples { left };
                    return Ok(Some(CHUNK_HEAD));
                }
                if len > CHUNK_MAX {
                    return Err(PcmError::Broken("a chunk of over 16 MiB before the samples"));
                }
                if !bytes.starts_with(b"fmt ") {
                    self.at = At::Skip { left: len + len % 2, format_known };
                    return Ok(Some(CHUNK_HEAD));
                }
                if (len as usize) < FORMAT {
                    return Err(PcmError::Broken("a format that is too short"));
                }
                let known = FORMAT_EXTENDED.min(len as usize);
                let Some(format) = bytes.get(CHUNK_HEAD..CHUNK_HEAD + known) else { return Ok(None) };
                check(format)?;
                self.at = At::Skip { left: len + len % 2 - known as u32, format_known: true };
                Ok(Some(CHUNK_HEAD + known))
            }
            At::Skip { left: 0, format_known } => {
                self.at = At::Chunk { format_known };
                Ok(Some(0))
            }
            At::Skip { left, format_known } if !bytes.is_empty() => {
                let taken = bytes.len().min(left as usize);
                self.at = At::Skip { left: left - taken as u32, format_known };
                Ok(Some(taken))
            }
            At::Samples { left: Some(0 | 1) } => {
                self.at = At::End;
                Ok(Some(0))
            }
            At::Samples { left } if bytes.len() >= 2 => {
                let most = left.map_or(bytes.len(), |left| bytes.len().min(left.try_into().unwrap_or(usize::MAX)));
                let taken = most / 2 * 2;
                samples.extend(bytes[..taken].chunks_exact(2).map(sample));
                self.at = At::Samples { left: left.map(|left| left - taken as u64) };
                Ok(Some(taken))
            }
            At::End if bytes.len() >= FILE_HEAD => {
                let is_wav = begins_wav(bytes);
                self.at = if is_wav { At::Chunk { format_known: false } } else { At::Over };
                Ok(Some(if is_wav { FILE_HEAD } else { 0 }))
            }
            At::Over if !bytes.is_empty() => Ok(Some(bytes.len())),
            _ => Ok(None),
        }
    }
}

/// Whether a WAV file's head is there, whose length is known.
fn begins_wav(bytes: &[u8]) -> bool {
    bytes.starts_with(b"RIFF") && bytes[8..].starts_with(b"WAVE")
}

fn sample(bytes: &[u8]) -> f32 {
    f32::from(i16::from_le_bytes([bytes[0], bytes[1]])) / 32768.0
}

fn check(chunk: &[u8]) -> Result<(), PcmError> {
    let short = |at: usize| u16::from_le_bytes([chunk[at], chunk[at + 1]]);
    let rate_hz = u32::from(short(4)) | u32::from(short(6)) << 16;
    let (format, channels, bits) = (short(0), short(2), short(14));
    let format = if format == EXTENDED && chunk.len() >= FORMAT_EXTENDED { short(SUB_FORMAT) } else { format };
    if format == PLAIN && channels == 1 && bits == 16 && rate_hz == RATE_HZ {
        return Ok(());
    }
    Err(PcmError::Format { format, channels, rate_hz, bits })
}

#[cfg(test)]
mod tests {
    use super::{PcmError, PcmStream};

    fn wav(channels: u16, rate_hz: u32, data_len: u32, samples: &[i16]) -> Vec<u8> {
        let mut bytes = b"RIFF\0\0\0\0WAVELIST\x03\0\0\0abc\0fmt \x12\0\0\0\x01\0".to_vec();
        bytes.extend(channels.to_le_bytes());
        bytes.extend(rate_hz.to_le_bytes());
        bytes.extend([0; 6]);
        bytes.extend(16_u16.to_le_bytes());
        bytes.extend([0, 0]);
        bytes.extend(b"data");
        bytes.extend(data_len.to_le_bytes());
        bytes.extend(samples.iter().flat_map(|sample| sample.to_le_bytes()));
        bytes
    }

    fn read(bytes: &[u8], piece: usize) -> Result<(Vec<f32>, Option<&'static str>), PcmError> {
        let (mut stream, mut samples) = (PcmStream::default(), Vec::new());
        bytes.chunks(piece).try_for_each(|bytes| stream.push(bytes, &mut samples))?;
        Ok((samples, stream.missing()))
    }

    const SAMPLES: [i16; 8] = [0, 16384, -32768, 1, 2, 3, 4, 5];

    #[test]
    fn samples_are_read_in_pieces_of_any_size_raw_or_from_wav() {
        let expected: Vec<f32> = SAMPLES.iter().map(|sample| f32::from(*sample) / 32768.0).collect();
        let raw: Vec<u8> = SAMPLES.iter().flat_map(|sample| sample.to_le_bytes()).collect();
        let mut file = wav(1, 16_000, 16, &SAMPLES);
        file.extend(b"LIST\x04\0\0\0more");
        for piece in [1, 3, 7, 1000] {
            assert_eq!(read(&raw, piece), Ok((expected.clone(), None)));
            assert_eq!(read(&file, piece), Ok((expected.clone(), None)));
            // Written to a pipe: nobody knew how long it would be.
            assert_eq!(read(&wav(1, 16_000, u32::MAX, &SAMPLES), piece), Ok((expected.clone(), None)));
        }
    }

    #[test]
    fn a_wav_behind_another_is_heard_and_what_is_none_is_told() {
        let two = [wav(1, 16_000, 16, &SAMPLES), wav(1, 16_000, 16, &SAMPLES)].concat();
        for piece in [1, 5, 1000] {
            assert_eq!(read(&two, piece).map(|(samples, _)| samples.len()), Ok(2 * SAMPLES.len()));
        }
        let (mut stream, mut samples) = (PcmStream::default(), Vec::new());
        assert_eq!(stream.push(&wav(1, 16_000, 16, &SAMPLES), &mut samples), Ok(()));
        assert!(!stream.is_over(), "nothing follows");
        assert_eq!(stream.push(b"twelve bytes", &mut samples), Ok(()));
        assert!(stream.is_over() && samples.len() == SAMPLES.len());
    }

    #[test]
    fn a_file_that_is_called_wav_is_one() {
        let pushed = |name: &str, bytes: &[u8]| {
            let (mut stream, mut samples) = (PcmStream::of_file(name.as_ref()), Vec::new());
            stream.push(bytes, &mut samples).map(|()| (samples.len(), stream.missing()))
        };
        assert_eq!(pushed("a.raw", b"not a wav at all"), Ok((8, None)));
        assert_eq!(pushed("a.WAV", b"not a wav at all"), Err(PcmError::Broken("it does not begin like one")));
        assert_eq!(pushed("a.wav", b"short"), Ok((0, Some("it is no WAV file"))));
    }

    #[test]
    fn what_was_cut_off_is_told_with_what_there_was() {
        assert_eq!(read(&wav(1, 16_000, 900, &SAMPLES), 5).map(|(_, missing)| missing), Ok(Some("it was cut off")));
        assert_eq!(read(&wav(1, 16_000, 900, &SAMPLES)[..40], 5), Ok((Vec::new(), Some("no samples came"))));
        assert_eq!(read(&[], 5), Ok((Vec::new(), Some("it is empty"))));
    }

    #[test]
    fn a_format_in_an_extension_is_looked_at() {
        let extended = |sub_format: u8| {
            let mut bytes = b"RIFF\0\0\0\0WAVEfmt \x28\0\0\0\xfe\xff\x01\0\x80\x3e\0\0\0\0\0\0\x02\0\x10\0".to_vec();
            bytes.extend([22, 0, 16, 0, 4, 0, 0, 0, sub_format, 0]);
            bytes.extend([0; 14]);
            bytes.extend(b"data\x04\0\0\0\0\x40\0\x80");
            read(&bytes, 7).map(|(samples, _)| samples)
        };
        assert_eq!(extended(1), Ok(vec![0.5, -1.0]));
        let mu_law = extended(7).expect_err("mu-law").to_string();
        assert!(mu_law.contains("(format 7)"), "{mu_law}");
    }

    #[test]
    fn another_format_is_told_with_the_way_to_make_it_ours() {
        let error = read(&wav(2, 44_100, 16, &SAMPLES), 9).expect_err("stereo");
        assert_eq!(
            error.to_string(),
            "2 channels of 16 bits at 44100 Hz (format 1): 1 channel of 16 bits at 16000 Hz is wanted (sox IN -r 16000 \
             -c 1 -b 16 OUT)"
        );
        let error = read(b"RIFF\0\0\0\0WAVEdata\x10\0\0\0", 9).expect_err("no format");
        assert_eq!(error, PcmError::Broken("samples before their format"));
    }
}
