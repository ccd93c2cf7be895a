//! Sound from a file or a pipe, in a microphone's place.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use grabber::microphone::Sound;
use grabber::{Grab, Trouble};
use hearing::{PcmStream, RATE_HZ};
use messages::NS_PER_S;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use transport::monotonic_ns;

/// A piece of a file comes as often as a microphone's does, nanoseconds.
const PIECE_NS: u64 = 80_000_000;
const PIECE_BYTES: usize = 2 * (RATE_HZ as usize) * 80 / 1000;
/// What has piled up in a pipe is read so many times faster than it was spoken.
const CATCH_UP: u64 = 4;
/// So long is waited for a pipe's next bytes.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 80_000_000 };

/// An open file or pipe.
#[derive(Debug)]
pub struct Stream {
    file: File,
    path: PathBuf,
    pcm: PcmStream,
    bytes: Vec<u8>,
    /// A file is whole, and ends for good.
    is_file: bool,
    /// Something was taken from it already.
    is_on: bool,
    /// Nothing is taken from it before, monotonic clock, nanoseconds.
    due_ns: u64,
}

impl Stream {
    /// Opens a file or a pipe; a pipe has no writer yet, perhaps. A file goes on where it would be had it been heard
    /// from `begun_ns` of the monotonic clock on: who died hears no word twice.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn open(path: &Path, begun_ns: u64) -> Result<Self, Trouble> {
        let failed = |what: String| Trouble::new(format!("{}: {what}", path.display()), "cue.voice.stream names it");
        let mut options = OpenOptions::new();
        // Whoever opens a pipe without a writer would wait for one.
        let options = options.read(true).custom_flags(OFlags::NONBLOCK.bits().cast_signed());
        let file = options.open(path).map_err(|error| failed(error.to_string()))?;
        let kind = file.metadata().map_err(|error| failed(error.to_string()))?.file_type();
        if !(kind.is_file() || kind.is_fifo()) {
            return Err(failed("it is neither a file nor a pipe".to_owned()));
        }
        let is_file = kind.is_file();
        let pcm = if is_file { PcmStream::of_file(path) } else { PcmStream::default() };
        let (path, bytes, due_ns) = (path.to_owned(), vec![0; PIECE_BYTES], if is_file { begun_ns } else { 0 });
        Ok(Self { file, path, pcm, bytes, is_file, is_on: false, due_ns })
    }

    /// What was due already of a file that is only just begun is not heard.
    fn skip(&mut self) -> Result<(), Trouble> {
        while !self.is_on && self.is_file && self.due_ns + PIECE_NS < monotonic_ns() {
            self.next()?;
        }
        self.is_on = true;
        Ok(())
    }

    fn trouble(&self, why: &str) -> Trouble {
        let then = if self.is_file { "no voice is heard from there any more" } else { "it is opened anew" };
        Trouble::new(format!("{}: {why}", self.path.display()), then)
    }

    /// The samples of the next piece, which may be none; `None` where none has come.
    fn next(&mut self) -> Result<Option<Vec<f32>>, Trouble> {
        let count = match self.file.read(&mut self.bytes) {
            // A pipe that nobody has written to yet reads as ended.
            Ok(0) if !self.is_file && self.pcm.is_new() => {
                sleep_until(monotonic_ns() + PIECE_NS);
                return Ok(None);
            }
            Ok(0) => return Err(self.trouble(self.pcm.missing().unwrap_or("it has ended"))),
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
            Err(error) => return Err(self.trouble(&error.to_string())),
        };
        // Who writes faster than anybody speaks is not let to keep this computer busy.
        self.due_ns = if self.is_file { self.due_ns + PIECE_NS } else { monotonic_ns() + PIECE_NS / CATCH_UP };
        let mut samples = Vec::with_capacity(count / 2);
        self.pcm.push(&self.bytes[..count], &mut samples).map_err(|error| self.trouble(&error.to_string()))?;
        if self.pcm.is_over() && !self.is_file {
            return Err(self.trouble("what came behind a WAV file is none"));
        }
        Ok(Some(samples))
    }
}

/// In this thread, which is the source's own.
fn sleep_until(at_ns: u64) {
    let at = Timespec { tv_sec: (at_ns / NS_PER_S) as i64, tv_nsec: (at_ns % NS_PER_S) as i64 };
    // Who is woken early comes early.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &at);
}

impl Grab for Stream {
    type Item = Sound;

    fn about(&self) -> String {
        format!("hears what comes from {}", self.path.display())
    }

    fn grab(&mut self) -> Result<Option<Sound>, Trouble> {
        self.skip()?;
        sleep_until(self.due_ns);
        if !self.is_file && poll(&mut [PollFd::new(&self.file, PollFlags::IN)], Some(&WAIT)) == Ok(0) {
            return Ok(None);
        }
        // A header has none, and none would mean that some were lost.
        let samples = self.next()?.filter(|samples| !samples.is_empty());
        Ok(samples.map(|samples| Sound { samples, taken_ns: monotonic_ns() }))
    }

    /// Who speaks into a pipe may be silent for as long as he likes.
    fn silent_limit_ns(&self) -> Option<u64> {
        None
    }

    fn ends_for_good(&self) -> bool {
        self.is_file
    }
}

#[cfg(test)]
mod tests {
    use super::Stream;
    use grabber::Grab;
    use transport::monotonic_ns;

    #[test]
    fn a_file_goes_on_where_it_would_be_by_now() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("said.raw");
        // Each sample says at which millisecond it stands; three seconds.
        let samples: Vec<u8> = (0..48_000_i32).flat_map(|n| ((n / 16) as i16).to_le_bytes()).collect();
        std::fs::write(&path, samples).expect("written");
        let first_ms = |ago_ms: u64| {
            let begun_ns = monotonic_ns() - ago_ms * 1_000_000;
            let mut stream = Stream::open(&path, begun_ns).expect("it is there");
            let sound = stream.grab()?.expect("a file always gives something");
            Ok::<_, grabber::Trouble>((f64::from(sound.samples[0]) * 32_768.0).round())
        };
        assert_eq!(first_ms(0), Ok(0.0));
        // A busy machine takes its time.
        assert!(first_ms(1000).is_ok_and(|ms| (880.0..2900.0).contains(&ms)));
        assert!(first_ms(4000).is_err_and(|trouble| trouble.found.contains("it has ended")));
    }
}
