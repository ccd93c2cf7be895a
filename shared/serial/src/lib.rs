//! A serial port at any speed, and the other end of one that is emulated.
//!
//! No call waits. Even a read that is not to wait, and a poll, may wait in a terminal for the kernel, which hands bytes
//! over by a thread without priority: for tens of milliseconds, and sometimes seconds, where a machine has far more to
//! do than it can. So a thread of the port's own reads, and hands over through a pipe. A port that is gone says so at
//! the next read or write, and is opened anew by whoever needs it.

mod pseudo;

use std::convert::Infallible;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{FlockOperation, Mode, OFlags};
use rustix::io::Errno;
use rustix::ioctl;
use rustix::pipe::PipeFlags;
use rustix::termios::{OptionalActions, QueueSelector};

pub use pseudo::PseudoTerminal;

/// Why a port cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SerialError {
    /// There is no such port.
    #[error("there is no {}: is the device plugged in, and is its name right?", path.display())]
    Missing {
        /// The port.
        path: PathBuf,
    },
    /// It may not be opened by this user.
    #[error(
        "{} may not be opened by this user: add the user to its group (sudo usermod -aG dialout $USER, then log in \
         again), or install config/udev/99-guidedog.rules",
        path.display()
    )]
    NotPermitted {
        /// The port.
        path: PathBuf,
    },
    /// Another program has it open.
    #[error("{} is used by another program: end it first (fuser -v {} names it)", path.display(), path.display())]
    Busy {
        /// The port.
        path: PathBuf,
    },
    /// It is no serial port.
    #[error("{} is no serial port", path.display())]
    NotSerial {
        /// What was opened.
        path: PathBuf,
    },
    /// It cannot be that fast, or that slow.
    #[error("{} cannot run at {baud} baud", path.display())]
    Speed {
        /// The port.
        path: PathBuf,
        /// Bits a second.
        baud: u32,
    },
    /// It was unplugged.
    #[error("{} is gone: it was unplugged", path.display())]
    Gone {
        /// The port.
        path: PathBuf,
    },
    /// Anything else.
    #[error("{} cannot be used: {source}", path.display())]
    System {
        /// The port.
        path: PathBuf,
        /// Why.
        source: Errno,
    },
}

/// An open port: eight bits, no parity, one stop bit, nothing translated.
#[derive(Debug)]
pub struct SerialPort {
    fd: Arc<OwnedFd>,
    path: PathBuf,
    /// What the thread has read; none only while this is dropped. Its closing ends the thread.
    bytes: Option<OwnedFd>,
    /// Closed by the thread's end.
    ended: Receiver<Infallible>,
}

/// So long the thread is waited for at the end: until then the port is not free for others.
const END_LIMIT: Duration = Duration::from_millis(500);
/// What is read at once, bytes.
const PIECE: usize = 4096;

/// `TIOCMBIS` and `TIOCMBIC`: set and clear lines of a modem.
const SET_LINES: ioctl::Opcode = 0x5416;
const CLEAR_LINES: ioctl::Opcode = 0x5417;
/// `TIOCM_DTR`: data terminal ready.
const DTR: i32 = 0x002;

impl SerialPort {
    /// Opens a port for this program alone.
    ///
    /// # Errors
    /// Where it is missing, not permitted, in use, no serial port, or not that fast.
    pub fn open(path: &Path, baud: u32) -> Result<Self, SerialError> {
        let owned = || path.to_owned();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|errno| match errno {
            Errno::NOENT | Errno::NODEV | Errno::NXIO => SerialError::Missing { path: owned() },
            Errno::ACCESS | Errno::PERM => SerialError::NotPermitted { path: owned() },
            Errno::BUSY => SerialError::Busy { path: owned() },
            source => SerialError::System { path: owned(), source },
        })?;
        rustix::fs::flock(&fd, FlockOperation::NonBlockingLockExclusive).map_err(|errno| match errno {
            Errno::WOULDBLOCK => SerialError::Busy { path: owned() },
            source => SerialError::System { path: owned(), source },
        })?;
        let system = |source| SerialError::System { path: owned(), source };
        let (bytes, hand_over) = rustix::pipe::pipe_with(PipeFlags::CLOEXEC).map_err(system)?;
        rustix::fs::fcntl_setfl(&bytes, OFlags::NONBLOCK).map_err(system)?;
        let (end, ended) = channel();
        let port = Self { fd: Arc::new(fd), path: owned(), bytes: Some(bytes), ended };
        if let Err(error) = port.set_up(baud) {
            // There is no thread to wait for.
            drop(end);
            return Err(error);
        }
        let line = Arc::clone(&port.fd);
        let reader = std::thread::Builder::new().name("serial".to_owned());
        reader.spawn(move || hand_over_bytes(&line, &hand_over, &end)).map_err(|_| system(Errno::NOMEM))?;
        Ok(port)
    }

    fn set_up(&self, baud: u32) -> Result<(), SerialError> {
        let no_port = |errno| match errno {
            Errno::NOTTY | Errno::INVAL => SerialError::NotSerial { path: self.path.clone() },
            other => self.failed(other),
        };
        let too_fast = |_| SerialError::Speed { path: self.path.clone(), baud };
        let mut attributes = rustix::termios::tcgetattr(&self.fd).map_err(no_port)?;
        attributes.make_raw();
        attributes.set_speed(baud).map_err(too_fast)?;
        rustix::termios::tcsetattr(&self.fd, OptionalActions::Now, &attributes).map_err(too_fast)?;
        let set = rustix::termios::tcgetattr(&self.fd).map_err(no_port)?.output_speed();
        // A divider need not hit the speed; three in a hundred are as much as a byte bears.
        if u64::from(set.abs_diff(baud)) * 100 > u64::from(baud) * 3 {
            return Err(too_fast(Errno::INVAL));
        }
        // What came before belongs to nobody. Others than root are kept out as well.
        let _ = rustix::termios::ioctl_tiocexcl(&self.fd);
        rustix::termios::tcflush(&self.fd, QueueSelector::IOFlush).map_err(no_port)
    }

    fn failed(&self, errno: Errno) -> SerialError {
        match errno {
            Errno::IO | Errno::NODEV | Errno::NXIO | Errno::PIPE => SerialError::Gone { path: self.path.clone() },
            source => SerialError::System { path: self.path.clone(), source },
        }
    }

    /// The port's path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Takes what has come; 0 where nothing has.
    ///
    /// # Errors
    /// Where the port is gone.
    pub fn read(&self, buffer: &mut [u8]) -> Result<usize, SerialError> {
        let Some(bytes) = &self.bytes else { return Ok(0) };
        match rustix::io::read(bytes, &mut *buffer) {
            // The end of a terminal is its unplugging, and the thread's.
            Ok(0) if !buffer.is_empty() => Err(SerialError::Gone { path: self.path.clone() }),
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(errno) => Err(self.failed(errno)),
        }
    }

    /// Sends what there is room for, and says how much that was.
    ///
    /// # Errors
    /// Where the port is gone.
    pub fn write(&self, bytes: &[u8]) -> Result<usize, SerialError> {
        match rustix::io::write(&self.fd, bytes) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(errno) => Err(self.failed(errno)),
        }
    }

    /// Sets or clears data terminal ready; says whether the port has that line, which a pseudo-terminal has not.
    pub fn set_dtr(&self, on: bool) -> bool {
        let done = if on {
            // SAFETY: this request takes a pointer to an int, which the setter holds.
            unsafe { ioctl::ioctl(&self.fd, ioctl::Setter::<SET_LINES, i32>::new(DTR)) }
        } else {
            // SAFETY: as above.
            unsafe { ioctl::ioctl(&self.fd, ioctl::Setter::<CLEAR_LINES, i32>::new(DTR)) }
        };
        done.is_ok()
    }
}

/// Readable when there is something to read.
impl AsFd for SerialPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.bytes.as_ref().map_or(self.fd.as_fd(), AsFd::as_fd)
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        self.bytes = None;
        // Nothing is ever sent.
        let _ = self.ended.recv_timeout(END_LIMIT);
    }
}

/// The thread: reads the line until it is gone, or nobody takes its bytes any more.
fn hand_over_bytes(line: &OwnedFd, hand_over: &OwnedFd, _end: &Sender<Infallible>) {
    let mut buffer = [0; PIECE];
    loop {
        // Of the pipe only its end is asked for, which is always told.
        let mut both = [PollFd::new(line, PollFlags::IN), PollFd::new(hand_over, PollFlags::empty())];
        match poll(&mut both, None) {
            Ok(_) if both[1].revents().contains(PollFlags::ERR) => return,
            Ok(_) | Err(Errno::INTR) => {}
            Err(_) => return,
        }
        let mut rest = match rustix::io::read(line, &mut buffer) {
            Err(Errno::AGAIN | Errno::INTR) => continue,
            Ok(count) if count > 0 => &buffer[..count],
            _ => return,
        };
        while !rest.is_empty() {
            match rustix::io::write(hand_over, rest) {
                Ok(count) => rest = &rest[count..],
                Err(Errno::INTR) => {}
                Err(_) => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::{PseudoTerminal, SerialError, SerialPort};

    /// Asks again until there is an answer.
    fn until<T>(mut asked: impl FnMut() -> Option<T>) -> T {
        let begun = Instant::now();
        loop {
            if let Some(found) = asked() {
                return found;
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "nothing came");
            std::thread::yield_now();
        }
    }

    #[test]
    fn what_is_sent_comes_at_any_speed_and_unplugging_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("port");
        for baud in [9600, 115_200, 256_000, 460_800, 1_000_000] {
            let terminal = PseudoTerminal::open(&path).expect("a pseudo-terminal");
            let port = SerialPort::open(&path, baud).expect("a port");
            assert_eq!(terminal.baud(), Some(baud));
            assert_eq!(port.write(b"\xa5\x50\n\r\x11").expect("room"), 5);
            let mut heard = [0; 16];
            let count = until(|| terminal.read(&mut heard).ok().filter(|count| *count > 0));
            assert_eq!(&heard[..count], b"\xa5\x50\n\r\x11", "nothing is translated");
            assert_eq!(terminal.write(&[0, 255, 3]).expect("room"), 3);
            let count = until(|| port.read(&mut heard).ok().filter(|count| *count > 0));
            assert_eq!(&heard[..count], [0, 255, 3]);
            assert_eq!(port.read(&mut heard).expect("no end"), 0);
            assert!(!port.set_dtr(true), "a pseudo-terminal has no such line");
            drop(terminal);
            let gone = until(|| port.read(&mut heard).err());
            assert!(matches!(gone, SerialError::Gone { .. }), "{gone}");
        }
    }

    #[test]
    fn what_cannot_be_opened_says_why() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("port");
        let text = |error: Result<SerialPort, SerialError>| error.expect_err("no port").to_string();
        assert!(text(SerialPort::open(&path, 115_200)).contains("is the device plugged in"));
        std::fs::write(&path, "a file").expect("written");
        assert!(text(SerialPort::open(&path, 115_200)).ends_with("is no serial port"));
        std::fs::remove_file(&path).expect("removed");
        let _terminal = PseudoTerminal::open(&path).expect("a pseudo-terminal");
        let first = SerialPort::open(&path, 115_200).expect("a port");
        assert!(text(SerialPort::open(&path, 115_200)).contains("used by another program"));
        drop(first);
        SerialPort::open(&path, 115_200).expect("free again");
    }
}
