//! Sound of a microphone by ALSA's library: whatever name `arecord -L` lists, PulseAudio's and PipeWire's among them.

mod ffi;

use transport::monotonic_ns;

use crate::{Grab, Trouble};
use ffi::{Capture, Format, LIBRARY, Read};

/// So often there is sound to read, microseconds: a stop that is said waits no longer than that for its last piece.
const PERIOD_US: u32 = 20_000;
/// ALSA keeps so much sound for who is late, microseconds.
const ROOM_US: u32 = 500_000;
/// So long sound is waited for at a time, milliseconds.
const WAIT_MS: i32 = 80;
/// So many samples at most are taken at once: 0.3 s at 16 kHz.
const PIECE_SAMPLES: usize = 4800;

/// Some of the sound.
#[derive(Debug, Clone, PartialEq)]
pub struct Sound {
    /// In [-1, 1]; none where some were lost before what comes next.
    pub samples: Vec<f32>,
    /// When the last of them was taken in, nanoseconds of the monotonic clock.
    pub taken_ns: u64,
}

/// A microphone that is open.
#[derive(Debug)]
pub struct Microphone {
    capture: Capture,
    name: String,
    piece: Vec<i16>,
}

/// Whether the microphone can be opened; it is closed again at once.
///
/// # Errors
/// As [`Microphone::open`].
pub fn check(name: &str, rate_hz: u32) -> Result<String, Trouble> {
    Microphone::open(name, rate_hz).map(|_| format!("\"{name}\" can be opened"))
}

fn no_library(why: String) -> Trouble {
    Trouble::new(format!("{LIBRARY} cannot be opened: {why}"), "sudo apt-get install libasound2 libasound2-plugins")
}

impl Microphone {
    /// Opens the microphone of that name, at `rate_hz` and of one channel.
    ///
    /// # Errors
    /// Where there is none, it is busy, or it cannot be read at that rate; and what to do.
    pub fn open(name: &str, rate_hz: u32) -> Result<Self, Trouble> {
        ffi::check().map_err(no_library)?;
        let format = Format { rate_hz, period_us: PERIOD_US, room_us: ROOM_US };
        let capture = Capture::open(name, &format).map_err(|why| {
            let fix = "`arecord -L` lists the names for cue.voice.microphone; `fuser -v /dev/snd/*` says who has it; \
                       sudo usermod -aG audio $USER";
            Trouble::new(format!("the microphone \"{name}\" cannot be opened: {why}"), fix)
        })?;
        Ok(Self { capture, name: name.to_owned(), piece: vec![0; PIECE_SAMPLES] })
    }
}

impl Grab for Microphone {
    type Item = Sound;

    fn about(&self) -> String {
        format!("hears by the microphone \"{}\"", self.name)
    }

    fn grab(&mut self) -> Result<Option<Sound>, Trouble> {
        let lost = |why| Trouble::new(format!("the microphone \"{}\" is gone: {why}", self.name), "it is opened anew");
        let read = self.capture.read(&mut self.piece, WAIT_MS).map_err(lost)?;
        let samples = match read {
            Read::Nothing => return Ok(None),
            Read::Lost => Vec::new(),
            Read::Samples(count) => self.piece[..count].iter().map(|sample| f32::from(*sample) / 32768.0).collect(),
        };
        Ok(Some(Sound { samples, taken_ns: monotonic_ns() }))
    }
}
