//! Lines: socket pairs between processes, and sockets in the run directory at which one is made. The kernel closes a
//! dead process's end, and the other end wakes at once.

use std::os::fd::{AsFd, BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::path::Path;

use messages::{Injection, ServiceId, StopReason};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer, SendAncillaryMessage,
    SendFlags, SocketAddrUnix, SocketFlags, SocketType, accept_with, recvmsg, sendmsg, socket_with, socketpair,
    sockopt,
};
use serde::{Deserialize, Serialize};

use crate::TransportError;

/// Longest message on a line.
const MAX_MESSAGE: usize = 4096;

/// One end of a socket pair that keeps message borders. Never blocks; closed on exec.
#[derive(Debug)]
pub struct Line(OwnedFd);

/// What a line had to give.
#[derive(Debug)]
pub enum Received<T> {
    /// Nothing now.
    Nothing,
    /// The other end is gone, and with it every process that held it.
    Closed,
    /// A message, and a descriptor where one came with it.
    Message(T, Option<OwnedFd>),
}

/// From the supervisor to a child, on the child's control line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "to")]
pub enum ToChild {
    /// Finish, publish the last figures, say `Left`.
    Leave,
    /// The figures are taken: exit.
    Exit,
    /// Every service is up for the first time: the recording may begin (replay).
    Begin,
    /// The robot is to stand, whatever `mode` says, until the epoch is greater (locomotion).
    Stop {
        /// The epoch of the stop.
        epoch: u64,
        /// Why.
        reason: StopReason,
    },
    /// A lifeline of a critical service comes with this (locomotion).
    Lifeline {
        /// Whose.
        service: ServiceId,
        /// Which life of it.
        incarnation: u32,
    },
    /// The line from the locomotion incarnation to watch comes with this (brake).
    Watch {
        /// Which life of locomotion.
        incarnation: u32,
        /// Its process id; the brake opens a pidfd of its own.
        pid: u32,
    },
    /// A fault is injected into this process, or mended; refused in a run without faults.
    Inject {
        /// Which.
        injection: Injection,
    },
}

/// From a child to the supervisor, on the child's control line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "from")]
pub enum FromChild {
    /// All ports are open, memory is prefaulted, devices answer.
    Ready,
    /// The work is done and the last figures are published.
    Left,
    /// The service cannot go on, and why.
    Failed {
        /// Why, in words that name file, line or topic.
        why: String,
    },
    /// What the service runs with, for the operator: a policy's engine, model and digest.
    About {
        /// As JSON.
        about: serde_json::Value,
    },
    /// Something to tell the operator.
    Note {
        /// What.
        text: String,
    },
    /// A lifeline is armed: watched by locomotion; locomotion's own by the brake.
    Armed {
        /// Whose.
        service: ServiceId,
        /// Which life of it.
        incarnation: u32,
    },
    /// The brake stopped the robot because locomotion was gone or silent.
    BrakeEngaged {
        /// Which life of locomotion.
        incarnation: u32,
        /// Whether it was gone (line closed) rather than silent.
        gone: bool,
    },
    /// The run has come to its end (simulator, replay).
    RunEnded {
        /// Figures for the report, as JSON.
        figures: serde_json::Value,
    },
}

/// What is beside the text of a message, bytes.
const BESIDE_TEXT: usize = 128;
/// So much of a text fits whatever is in it, bytes: each may take six as JSON.
const MAX_TEXT: usize = (MAX_MESSAGE - BESIDE_TEXT) / 6 - 4;

impl FromChild {
    /// The message with its text, if it has one, cut to what a line takes: most of a reason is better than none of it.
    #[must_use]
    pub fn bounded(self) -> Self {
        match self {
            Self::Failed { why } => Self::Failed { why: cut(why) },
            Self::Note { text } => Self::Note { text: cut(text) },
            other => other,
        }
    }
}

fn cut(mut text: String) -> String {
    let fits = serde_json::to_string(&text).is_ok_and(|json| json.len() + BESIDE_TEXT <= MAX_MESSAGE);
    if !fits {
        let end = (0..=MAX_TEXT).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
        text.truncate(end);
        text.push_str(" ...");
    }
    text
}

impl Line {
    /// Two ends.
    ///
    /// # Errors
    /// Where the kernel has no descriptors left.
    pub fn pair() -> Result<(Self, Self), TransportError> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let (a, b) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)
            .map_err(TransportError::system("socketpair"))?;
        Ok((Self(a), Self(b)))
    }

    /// The line to whoever listens there; none where nobody does, or is busy. Never waits.
    #[must_use]
    pub fn connect(path: &Path) -> Option<Self> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).ok()?;
        rustix::net::connect(&socket, &SocketAddrUnix::new(path).ok()?).ok()?;
        Some(Self(socket))
    }

    /// The end that a descriptor is.
    #[must_use]
    pub fn from_fd(fd: OwnedFd) -> Self {
        Self(fd)
    }

    /// The descriptor.
    #[must_use]
    pub fn into_fd(self) -> OwnedFd {
        self.0
    }

    /// Sends bytes; `false` where the other end is gone or does not read.
    pub fn send_bytes(&self, bytes: &[u8]) -> bool {
        rustix::net::send(&self.0, bytes, SendFlags::NOSIGNAL | SendFlags::DONTWAIT).is_ok()
    }

    /// Sends a message, with a descriptor where one is given; `false` where the other end is gone or does not read, or
    /// the message is too long: whoever puts text into one cuts it with [`FromChild::bounded`].
    pub fn send<T: Serialize>(&self, message: &T, fd: Option<BorrowedFd<'_>>) -> bool {
        let Ok(bytes) = serde_json::to_vec(message) else { return false };
        if bytes.len() > MAX_MESSAGE {
            return false;
        }
        let mut space = [std::mem::MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut ancillary = SendAncillaryBuffer::new(&mut space);
        let fds: Vec<BorrowedFd<'_>> = fd.into_iter().collect();
        if !fds.is_empty() && !ancillary.push(SendAncillaryMessage::ScmRights(&fds)) {
            return false;
        }
        let slices = [std::io::IoSlice::new(&bytes)];
        sendmsg(&self.0, &slices, &mut ancillary, SendFlags::NOSIGNAL | SendFlags::DONTWAIT).is_ok()
    }

    /// Whether the other end is still held by somebody. What waits in the line is left there.
    #[must_use]
    pub fn is_open(&self) -> bool {
        let peeked = rustix::net::recv(&self.0, &mut [0u8; 1], RecvFlags::DONTWAIT | RecvFlags::PEEK);
        matches!(peeked, Ok((n, _)) if n > 0) || peeked.is_err_and(|errno| errno == Errno::AGAIN)
    }

    /// Receives bytes into `buffer` without blocking: the length of the message.
    pub fn receive_bytes(&self, buffer: &mut [u8]) -> Received<usize> {
        loop {
            return match rustix::net::recv(&self.0, &mut *buffer, RecvFlags::DONTWAIT) {
                Ok((0, _)) => Received::Closed,
                Ok((n, _)) => Received::Message(n, None),
                Err(Errno::AGAIN) => Received::Nothing,
                Err(Errno::INTR) => continue,
                Err(_) => Received::Closed,
            };
        }
    }

    /// Receives a message without blocking. What is not a message of that type is skipped: the other end is of the same
    /// build, so it cannot be sent by mistake.
    pub fn receive<T: for<'a> Deserialize<'a>>(&self) -> Received<T> {
        loop {
            let mut bytes = [0u8; MAX_MESSAGE];
            let mut space = [std::mem::MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
            let mut ancillary = RecvAncillaryBuffer::new(&mut space);
            let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
            let mut slices = [std::io::IoSliceMut::new(&mut bytes)];
            let received = match recvmsg(&self.0, &mut slices, &mut ancillary, flags) {
                Ok(received) => received,
                Err(Errno::AGAIN) => return Received::Nothing,
                Err(Errno::INTR) => continue,
                Err(_) => return Received::Closed,
            };
            if received.bytes == 0 {
                return Received::Closed;
            }
            let fd = ancillary.drain().find_map(|message| match message {
                RecvAncillaryMessage::ScmRights(mut fds) => fds.next(),
                _ => None,
            });
            if let Ok(message) = serde_json::from_slice(&bytes[..received.bytes]) {
                return Received::Message(message, fd);
            }
        }
    }
}

/// Where lines are made: a socket in the run directory.
#[derive(Debug)]
pub struct LineListener(OwnedFd);

impl LineListener {
    /// So many may wait to be let in.
    const BACKLOG: i32 = 8;

    /// Listens; what a process that died has left there is taken away.
    ///
    /// # Errors
    /// Where there can be no socket.
    pub fn open(path: &Path) -> Result<Self, TransportError> {
        let _ = std::fs::remove_file(path);
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let opened = || {
            let socket = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
            rustix::net::bind(&socket, &SocketAddrUnix::new(path)?)?;
            rustix::net::listen(&socket, Self::BACKLOG)?;
            Ok(Self(socket))
        };
        opened().map_err(|errno: Errno| {
            TransportError::Service(format!("nobody can be listened to at {}: {errno}", path.display()))
        })
    }

    /// The next one that knocks, if it is of this user, or of root.
    #[must_use]
    pub fn accept(&self) -> Option<Line> {
        let us = rustix::process::geteuid();
        let is_ours =
            |fd: &OwnedFd| sockopt::socket_peercred(fd).is_ok_and(|peer| peer.uid == us || peer.uid.is_root());
        loop {
            let knocked = accept_with(&self.0, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK).ok()?;
            if is_ours(&knocked) {
                return Some(Line(knocked));
            }
        }
    }
}

impl AsFd for LineListener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

impl AsFd for Line {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Takes over a descriptor that the supervisor left open for this process and named in the environment variable.
///
/// # Errors
/// Where the variable is missing or names no open descriptor: the service was not started by the supervisor.
pub fn inherited_fd(variable: &str) -> Result<OwnedFd, TransportError> {
    let missing = || TransportError::Arguments(format!("{variable} is not set: the supervisor starts this program"));
    let raw: RawFd = std::env::var(variable).map_err(|_| missing())?.parse().map_err(|_| missing())?;
    if raw < 3 {
        return Err(missing());
    }
    // SAFETY: the supervisor opened it for this process alone, and nothing else here takes it over: each variable is
    // read once, before any other descriptor is opened. fcntl below refuses one that is not open.
    let fd = unsafe { OwnedFd::from_raw_fd(raw) };
    rustix::io::fcntl_setfd(&fd, rustix::io::FdFlags::CLOEXEC).map_err(TransportError::system("fcntl"))?;
    Ok(fd)
}

#[cfg(test)]
mod tests {
    use super::{FromChild, Line, LineListener, Received, ToChild};
    use std::os::fd::AsFd;

    #[test]
    fn a_reason_that_is_too_long_is_cut_and_not_lost() {
        let (a, b) = Line::pair().expect("descriptors are left");
        for long in ["x".repeat(100_000), "\u{1}".repeat(5_000), "\u{20ac}".repeat(5_000)] {
            assert!(a.send(&FromChild::Failed { why: long.clone() }.bounded(), None));
            let Received::Message(FromChild::Failed { why }, None) = b.receive() else { panic!("it arrives") };
            let cut = why.strip_suffix(" ...").expect("it says that it was cut");
            assert!(cut.len() > 600 && long.starts_with(cut));
        }
        let short = FromChild::Note { text: "x".repeat(3_900) };
        assert_eq!(short.clone().bounded(), short);
    }

    #[test]
    fn a_line_is_made_in_the_run_directory_and_its_end_closes() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("x.sock");
        assert!(Line::connect(&path).is_none(), "nobody listens");
        drop(LineListener::open(&path).expect("listens"));
        assert!(Line::connect(&path).is_none(), "who listened is dead");
        let listener = LineListener::open(&path).expect("in the place of the dead one");
        assert!(listener.accept().is_none());
        let near = Line::connect(&path).expect("a line");
        let far = listener.accept().expect("the other end");
        assert!(near.send_bytes(b"x") && matches!(far.receive_bytes(&mut [0; 8]), Received::Message(1, None)));
        drop(far);
        assert!(!near.is_open());
    }

    #[test]
    fn a_descriptor_travels_and_its_end_closes() {
        let (a, b) = Line::pair().expect("descriptors are left");
        let (far, near) = Line::pair().expect("descriptors are left");
        assert!(a.send(&ToChild::Watch { incarnation: 3, pid: 7 }, Some(far.as_fd())));
        drop(far);
        let Received::Message(ToChild::Watch { incarnation: 3, pid: 7 }, Some(fd)) = b.receive() else {
            panic!("message and descriptor arrive together");
        };
        assert!(matches!(near.receive_bytes(&mut [0; 8]), Received::Nothing));
        assert!(near.is_open());
        drop(fd);
        assert!(!near.is_open());
        assert!(matches!(near.receive_bytes(&mut [0; 8]), Received::Closed));
        assert!(matches!(b.receive::<ToChild>(), Received::Nothing));
    }
}
