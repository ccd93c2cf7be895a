//! The tone that tells a handler that the robot's voice is lost: played by a program of others, which nobody waits for.

use transport::{Helper, monotonic_ns};

/// Whoever plays it for longer hangs, wall time.
const LIMIT_NS: u64 = 3_000_000_000;
const RATE_HZ: u32 = 16_000;

/// The tone, and who plays it now.
#[derive(Debug)]
pub struct Tone {
    /// The command that plays a WAV from its standard input, if there is one.
    words: Option<Vec<String>>,
    /// Until when it has to be done, wall time.
    now: Option<(Helper, u64)>,
}

impl Tone {
    /// A tone by that command; none: silence.
    pub fn new(words: Option<&[String]>) -> Self {
        Self { words: words.map(<[String]>::to_vec), now: None }
    }

    /// Lets it be heard, where it is not just being heard.
    ///
    /// # Errors
    /// Where its player cannot be started.
    pub fn sound(&mut self) -> Result<(), String> {
        let Some(words) = self.words.as_ref().filter(|_| self.now.is_none()) else { return Ok(()) };
        self.now = Some((Helper::start(words, &wav(), false)?, monotonic_ns() + LIMIT_NS));
        Ok(())
    }

    /// Time passes: why it was not heard, where it was not.
    pub fn tick(&mut self) -> Option<String> {
        let (helper, by_ns) = self.now.as_mut()?;
        match helper.ended() {
            None => {
                if monotonic_ns() > *by_ns {
                    helper.kill();
                }
                return None;
            }
            Some(status) if status.success() => self.now = None,
            Some(_) => {
                let why = helper.failure();
                self.now = None;
                return Some(why);
            }
        }
        None
    }
}

/// The tone as a WAV of 16 bits, mono.
fn wav() -> Vec<u8> {
    let data: Vec<u8> = speech::Tone::VOICE_LOST.samples(RATE_HZ).into_iter().flat_map(i16::to_le_bytes).collect();
    let length = data.len() as u32;
    let mut wav = Vec::with_capacity(data.len() + 44);
    wav.extend(b"RIFF");
    wav.extend((36 + length).to_le_bytes());
    wav.extend(b"WAVEfmt ");
    wav.extend(16u32.to_le_bytes());
    // PCM, one channel.
    wav.extend([1, 0, 1, 0]);
    wav.extend(RATE_HZ.to_le_bytes());
    wav.extend((RATE_HZ * 2).to_le_bytes());
    // Two bytes a frame, 16 bits a sample.
    wav.extend([2, 0, 16, 0]);
    wav.extend(b"data");
    wav.extend(length.to_le_bytes());
    wav.extend(data);
    wav
}

#[cfg(test)]
mod tests {
    use super::Tone;
    use std::time::{Duration, Instant};

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|word| (*word).to_owned()).collect()
    }

    fn told(tone: &mut Tone) -> Option<String> {
        let since = Instant::now();
        while tone.now.is_some() {
            if let Some(why) = tone.tick() {
                return Some(why);
            }
            assert!(since.elapsed() < Duration::from_secs(60), "it ends");
            std::thread::sleep(Duration::from_millis(2));
        }
        None
    }

    #[test]
    fn its_player_is_given_a_wav_of_as_long_as_it_says() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("tone.wav");
        let mut tone = Tone::new(Some(&words(&["sh", "-c", &format!("cat > {}", path.display())])));
        tone.sound().expect("it starts");
        tone.sound().expect("it is being heard already");
        assert_eq!(told(&mut tone), None);
        let wav = std::fs::read(&path).expect("it was played");
        let says = u32::from_le_bytes([wav[40], wav[41], wav[42], wav[43]]);
        assert_eq!((&wav[..4], says as usize), (&b"RIFF"[..], wav.len() - 44));
        assert_eq!(says, 16_000 * 2 * 6 / 10);
    }

    #[test]
    fn a_player_that_fails_or_is_not_there_is_told() {
        let mut tone = Tone::new(Some(&words(&["sh", "-c", "echo no card >&2; exit 1"])));
        tone.sound().expect("it starts");
        assert_eq!(told(&mut tone).as_deref(), Some("sh: exit status: 1: no card"));
        assert!(Tone::new(Some(&words(&["no-such-player"]))).sound().is_err());
        assert_eq!(Tone::new(None).sound(), Ok(()), "nobody wants one");
    }
}
