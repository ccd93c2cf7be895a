//! Stops the robot when locomotion itself is gone, hung or silent. It has no other duty, and needs no shared memory for
//! it: locomotion's beats come down a line, the kill goes through a pidfd, and zero takes a path of its own.

mod watch;

use std::os::fd::OwnedFd;

use links::{BrakePath, open_brake_path};
use messages::ServiceId;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use transport::{FromChild, Io, Line, Received, Service, ToChild, TransportError, monotonic_ns};

pub use watch::{Engagement, Watch};

/// Without a supervisor: zero for this long, then the process ends, after locomotion has.
const LOST_LIMIT_NS: u64 = 500_000_000;
/// In stepped time, time itself may wait for a step: locomotion then beats from its wait loop all the same, but a
/// loaded machine is given more time.
const STEPPED_FACTOR: u64 = 20;

/// The service.
pub struct Brake {
    path: Box<dyn BrakePath>,
    watch: Watch,
    line: Option<Line>,
    pidfd: Option<OwnedFd>,
    ends_by_ns: Option<u64>,
    token: u64,
}

impl Brake {
    /// Opens the second path to the robot.
    ///
    /// # Errors
    /// Where it cannot be opened, or the settings of the run are not readable.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let factor = if io.domain.clock.is_stepped() { STEPPED_FACTOR } else { 1 };
        Ok(Self {
            path: open_brake_path(&settings.locomotion, io)?,
            watch: Watch::new(settings.supervision.brake_limit.ns() * factor),
            line: None,
            pidfd: None,
            ends_by_ns: None,
            token: 0,
        })
    }

    fn read_beats(&mut self, io: &Io) {
        let Some(line) = &self.line else { return };
        let now = monotonic_ns();
        loop {
            match line.receive_bytes(&mut [0u8; 8]) {
                Received::Message(..) => self.watch.beat(now),
                Received::Nothing => return,
                Received::Closed => break,
            }
        }
        io.unwatch(line);
        self.line = None;
        let engagement = self.watch.closed();
        self.engage(io, engagement);
    }

    fn engage(&mut self, io: &Io, engagement: Option<Engagement>) {
        let Some(engagement) = engagement else { return };
        // First the kill: a stopped process dies without running another instruction, so that no command of its can
        // come after ours.
        if let Some(pidfd) = &self.pidfd {
            // It may be dead already; that is what was wanted.
            let _ = pidfd_send_signal(pidfd, Signal::KILL);
        }
        self.path.zero(engagement.incarnation);
        if self.ends_by_ns.is_none() {
            io.tell(&FromChild::BrakeEngaged { incarnation: engagement.incarnation, gone: engagement.gone });
        }
    }

    fn rearm(&mut self, io: &Io, incarnation: u32, pid: u32, fd: OwnedFd) -> Result<(), TransportError> {
        if let Some(old) = self.line.take() {
            io.unwatch(&old);
        }
        let pid = i32::try_from(pid).ok().and_then(Pid::from_raw);
        self.pidfd = pid.and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok());
        let line = Line::from_fd(fd);
        self.token += 1;
        io.watch(&line, self.token)?;
        self.watch.rearm(incarnation);
        io.tell(&FromChild::Armed { service: ServiceId::Locomotion, incarnation });
        if !line.is_open() {
            // It died before its number was looked up, so that the number may be another's by now.
            self.pidfd = None;
        }
        self.line = Some(line);
        self.read_beats(io);
        Ok(())
    }
}

impl Service for Brake {
    fn on_wake(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    fn on_control(&mut self, io: &mut Io, message: ToChild, fd: Option<OwnedFd>) -> Result<(), TransportError> {
        if let (ToChild::Watch { incarnation, pid }, Some(fd)) = (message, fd) {
            self.rearm(io, incarnation, pid, fd)?;
        }
        Ok(())
    }

    fn on_fd(&mut self, io: &mut Io, _token: u64) -> Result<(), TransportError> {
        self.read_beats(io);
        Ok(())
    }

    fn wants_wall_ticks(&self) -> bool {
        true
    }

    fn on_wall_tick(&mut self, io: &mut Io) -> Result<(), TransportError> {
        // Drain before judging: beats that wait in the line are beats.
        self.read_beats(io);
        self.path.keep();
        let (engagement, stalled) = self.watch.tick(monotonic_ns());
        if stalled {
            io.tell(&FromChild::Note { text: "brake overslept: its counts start again".to_owned() });
        }
        self.engage(io, engagement);
        if self.watch.is_engaged() || self.ends_by_ns.is_some() {
            self.path.zero(self.watch.fenced());
        }
        Ok(())
    }

    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        self.ends_by_ns = Some(monotonic_ns() + LOST_LIMIT_NS);
        self.path.zero(self.watch.fenced());
        false
    }

    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        self.watch.release();
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.ends_by_ns.is_some_and(|by| monotonic_ns() >= by)
    }
}
