//! Frames from a program that knows the camera, over a Unix socket: ZED, OAK-D, and whatever else has a library of its
//! maker's. What it sends is in [`camera`].
//!
//! Pixels are read from the socket straight into shared memory: the kernel's own copy is the only one.

use std::io::ErrorKind;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use camera::{HEAD_BYTES, Head, Trust};
use messages::{DepthFrame, NS_PER_S, Pose3};
use rustix::io::Errno;
use settings::DepthSettings;
use transport::{FrameLoan, FramePublisher, FromChild, Io, TransportError, short_socket};
use zerocopy::IntoBytes;

use crate::FrameSource;

/// Of [`Io::watch`].
const TOKEN_LISTENER: u64 = 0;
const TOKEN_PROGRAM: u64 = 1;

/// A program that has sent nothing for so long gives way to another that knocks, nanoseconds.
const SILENT_NS: u64 = 2_000_000_000;
/// Of frames that come faster than so many times the configured rate some are left out: no camera does that.
const RATES_MAX: f64 = 4.0;

/// A socket at which one program at a time hands frames over.
pub struct FrameSocket {
    path: PathBuf,
    listener: UnixListener,
    program: Option<Program>,
    pixels_max: usize,
    robot_from_camera: Pose3,
    trust: Trust,
    /// Between two frames, nanoseconds.
    apart_ns: u64,
    published_ns: u64,
}

/// The program that is connected, and its frame as far as it has come.
struct Program {
    stream: UnixStream,
    head: [u8; HEAD_BYTES],
    /// Bytes of the head that have come.
    headed: usize,
    frame: Option<Begun>,
    /// When its last frame was taken, nanoseconds of the monotonic clock.
    last_ns: u64,
    /// When it last sent anything, run time, nanoseconds.
    heard_ns: u64,
}

struct Begun {
    head: Head,
    loan: FrameLoan<DepthFrame>,
    /// Bytes of the pixels that have come.
    filled: usize,
}

/// What has come of what a program sends.
enum Came {
    /// Nothing whole yet.
    Part,
    /// A head: pixels follow.
    Head(Head),
    /// The last pixel.
    Frame(Begun),
}

impl FrameSocket {
    /// Listens.
    ///
    /// # Errors
    /// Where another program listens there already, or there can be no socket; the reason names the path.
    pub fn open(settings: &DepthSettings, io: &Io) -> Result<Self, TransportError> {
        let path = PathBuf::from(settings.socket.path.clone());
        let listener = listen(&path).map_err(|why| {
            TransportError::Service(format!("no frames of depth can be taken at {}: {why}", path.display()))
        })?;
        io.watch(&listener, TOKEN_LISTENER)?;
        Ok(Self {
            path,
            listener,
            program: None,
            pixels_max: settings.width as usize * settings.height as usize,
            robot_from_camera: settings.robot_from_camera,
            trust: Trust::of_m(settings.range_m),
            apart_ns: (NS_PER_S as f64 / (RATES_MAX * settings.rate_hz.get())) as u64,
            published_ns: 0,
        })
    }

    /// Lets whoever knocks in, but one at a time: two cameras in one stream would be none.
    fn admit(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Ok((stream, _)) = self.listener.accept() {
            let silent = |program: &Program| io.now_ns().saturating_sub(program.heard_ns) > SILENT_NS;
            if is_ours(&stream) && self.program.as_ref().is_some_and(silent) {
                self.lose(io, "the program at the depth socket was silent, and gave way to another");
            }
            let text = if !is_ours(&stream) {
                "a program of another user connected to the depth socket and was sent away".to_owned()
            } else if self.program.is_some() {
                "a second program connected to the depth socket and was sent away".to_owned()
            } else {
                stream.set_nonblocking(true).map_err(TransportError::service)?;
                io.watch(&stream, TOKEN_PROGRAM)?;
                self.program = Some(Program::new(stream, io.now_ns()));
                format!("a program is connected to {}", self.path.display())
            };
            io.tell(&FromChild::Note { text });
        }
        Ok(())
    }

    fn lose(&mut self, io: &Io, why: &str) {
        if let Some(program) = self.program.take() {
            io.unwatch(&program.stream);
            io.tell(&FromChild::Note { text: why.to_owned() });
        }
    }
}

/// Whether it is of this user, or of root.
fn is_ours(stream: &UnixStream) -> bool {
    let us = rustix::process::geteuid();
    rustix::net::sockopt::socket_peercred(stream).is_ok_and(|peer| peer.uid == us || peer.uid.is_root())
}

/// Makes the socket. What a driver left there that has died is taken away; only this user may connect.
fn listen(path: &Path) -> Result<UnixListener, String> {
    if let Ok(there) = path.symlink_metadata() {
        if !there.file_type().is_socket() {
            return Err("there is something else of that name".to_owned());
        }
        match UnixStream::connect(short_socket(path)) {
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
            Ok(_) => return Err("another driver listens there".to_owned()),
            Err(error) => return Err(error.to_string()),
        }
        std::fs::remove_file(path).map_err(|error| error.to_string())?;
    }
    let listener = UnixListener::bind(short_socket(path)).map_err(|error| error.to_string())?;
    std::fs::set_permissions(path, PermissionsExt::from_mode(0o600)).map_err(|error| error.to_string())?;
    listener.set_nonblocking(true).map_err(|error| error.to_string())?;
    Ok(listener)
}

impl Program {
    fn new(stream: UnixStream, now_ns: u64) -> Self {
        Self { stream, head: [0; HEAD_BYTES], headed: 0, frame: None, last_ns: 0, heard_ns: now_ns }
    }

    /// Reads on. Nothing waits: what is not there yet comes with another waking.
    fn read(&mut self, now_ns: u64) -> Result<Came, String> {
        loop {
            let place = match &mut self.frame {
                Some(frame) => &mut frame.loan.data_mut().as_mut_bytes()[frame.filled..],
                None => &mut self.head[self.headed..],
            };
            let count = match rustix::io::read(&self.stream, place) {
                Ok(0) => return Err("the program at the depth socket has gone".to_owned()),
                Ok(count) => count,
                Err(Errno::AGAIN | Errno::INTR) => return Ok(Came::Part),
                Err(errno) => return Err(format!("the program at the depth socket is lost: {errno}")),
            };
            self.heard_ns = now_ns;
            if let Some(mut frame) = self.frame.take() {
                frame.filled += count;
                if frame.filled == 2 * frame.head.pixels() {
                    return Ok(Came::Frame(frame));
                }
                self.frame = Some(frame);
                continue;
            }
            self.headed += count;
            if self.headed == HEAD_BYTES {
                self.headed = 0;
                return Head::read(&self.head).map(Came::Head).map_err(|refused| refused.to_string());
            }
        }
    }

    /// Run time at which that frame was taken; none where it is not newer than the one before.
    fn stamp_ns(&mut self, head: &Head, io: &Io) -> Result<Option<u64>, String> {
        let run_ns = io.domain.clock.of_monotonic_ns(head.taken_ns);
        if run_ns > io.now_ns() {
            return Err("a frame's time is in the future: is it that of CLOCK_MONOTONIC?".to_owned());
        }
        // A camera's library may return the same frame twice. It is dropped, and the program stays connected.
        let is_new = head.taken_ns > self.last_ns;
        self.last_ns = self.last_ns.max(head.taken_ns);
        Ok(is_new.then_some(run_ns))
    }
}

impl FrameSource for FrameSocket {
    fn pixels_max(&self) -> usize {
        self.pixels_max
    }

    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    fn poll(&mut self, io: &mut Io, frames: &mut FramePublisher<DepthFrame>) -> Result<(), TransportError> {
        self.admit(io)?;
        while let Some(program) = &mut self.program {
            match program.read(io.now_ns()) {
                Ok(Came::Part) => break,
                Ok(Came::Head(head)) if head.pixels() > self.pixels_max => {
                    let [width, height] = [head.width, head.height];
                    let why = format!("a frame of {width} x {height} pixels is over depth.width x depth.height");
                    self.lose(io, &why);
                }
                Ok(Came::Head(head)) => {
                    let loan = frames.loan(head.pixels())?;
                    program.frame = Some(Begun { head, loan, filled: 0 });
                }
                Ok(Came::Frame(Begun { head, mut loan, .. })) => match program.stamp_ns(&head, io) {
                    Ok(None) => break,
                    Ok(_) if io.now_ns().saturating_sub(self.published_ns) < self.apart_ns => break,
                    Ok(Some(stamp_ns)) => {
                        self.published_ns = io.now_ns();
                        *loan.meta_mut() = head.depth_header(self.robot_from_camera);
                        self.trust.apply(loan.data_mut());
                        frames.publish(stamp_ns, loan)?;
                        // One at a waking: the loop has beats to give as well.
                        break;
                    }
                    Err(why) => self.lose(io, &why),
                },
                Err(why) => self.lose(io, &why),
            }
        }
        Ok(())
    }
}

impl Drop for FrameSocket {
    fn drop(&mut self) {
        // Left there it would be taken away by the next driver.
        let _ = std::fs::remove_file(&self.path);
    }
}
