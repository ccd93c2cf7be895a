//! The last gate before the robot.
//!
//! Duties: obeys a fresh permit and nothing else; writes zero by itself, at its own rate, needing nothing else alive;
//! stands at once when a lifeline closes, a stop cue comes or the supervisor says so. It must never wait or
//! log on the way to zero, nor allocate but to read the supervisor's word, and never start motion by itself.

mod fall;
mod gate;
mod lines;

use std::os::fd::OwnedFd;
use std::rc::Rc;

use links::{Link, RobotReport, open_link};
use messages::{
    Cue, EmergencyStop, Health, Latency, LatencyHistogram, LocomotionState, Mode, Odometry, Permit, ServiceId,
    StopKind, StopReason, Twist2,
};
use settings::Settings;
use transport::{ChildArgs, Clock, FromChild, Io, Line, Publisher, Service, Subscriber, ToChild, TransportError};
use transport::{inherited_fd, monotonic_ns};

pub use gate::{Gate, GateLimits, Verdict};
use lines::Lines;

/// Without a supervisor: zero for at most this long, then the process ends.
const LOST_LIMIT_NS: u64 = 300_000_000;
/// A beat to the brake.
const BEAT: u8 = 1;

/// The service.
pub struct Locomotion {
    gate: Gate,
    lines: Lines,
    link: Box<dyn Link>,
    /// The other end is the brake's: beats go down it, and its closing tells the brake.
    brake: Option<Line>,
    modes: Subscriber<Mode>,
    cues: Subscriber<Cue>,
    permits: Subscriber<Permit>,
    estop: Subscriber<EmergencyStop>,
    odometry: Subscriber<Odometry>,
    states: Publisher<LocomotionState>,
    clock: Rc<Clock>,
    period_ns: u64,
    next_tick_ns: u64,
    applied: Twist2,
    limited_by: StopReason,
    robot: RobotReport,
    latency: LatencyHistogram,
    /// Set when the supervisor is gone: wall time by which the process ends.
    ends_by_ns: Option<u64>,
    written_ns: u64,
    judged_ns: u64,
    /// Stamp of a permit that no command has answered yet.
    unanswered_ns: Option<u64>,
}

impl Locomotion {
    /// Opens link and ports.
    ///
    /// # Errors
    /// Where one of them cannot be opened, or the settings of the run are not readable.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let mut link = open_link(&settings.locomotion, io)?;
        // Before anything else: whatever the life before commanded last, the robot stands.
        link.write(Twist2::ZERO, 0)?;
        Ok(Self {
            gate: Gate::new(GateLimits::of(&settings)),
            lines: Lines::default(),
            link,
            brake: inherited_fd(ChildArgs::BRAKE_FD).ok().map(Line::from_fd),
            modes: io.subscriber()?,
            cues: io.subscriber()?,
            permits: io.subscriber()?,
            estop: io.subscriber()?,
            odometry: io.subscriber()?,
            states: io.publisher()?,
            clock: Rc::clone(&io.domain.clock),
            period_ns: period_ns(&settings),
            next_tick_ns: 0,
            applied: Twist2::ZERO,
            limited_by: StopReason::of(StopKind::Boot),
            robot: RobotReport::default(),
            latency: LatencyHistogram { what: Latency::PermitToCommand, ..LatencyHistogram::default() },
            ends_by_ns: None,
            written_ns: 0,
            judged_ns: 0,
            unanswered_ns: None,
        })
    }

    /// Writes what the gate allows: at the tick, at a new permit, and at once where it is zero and was not.
    fn command(&mut self, io: &Io, new_permit: Option<Permit>) -> Result<(), TransportError> {
        let now = io.now_ns();
        let tick = now >= self.next_tick_ns;
        let verdict = self.gate.judge(now);
        self.judged_ns = now;
        self.limited_by = verdict.reason;
        if let Some(permit) = new_permit {
            self.unanswered_ns = Some(permit.header.stamp_ns);
        }
        let sudden = verdict.velocity.is_zero() && !verdict.planned;
        let velocity = if sudden {
            Twist2::ZERO
        } else {
            let since_s = now.saturating_sub(self.written_ns).min(self.period_ns) as f64 / 1e9;
            self.gate.ramp(self.applied, verdict.velocity, since_s)
        };
        let stops_now = velocity.is_zero() && !self.applied.is_zero();
        if tick || stops_now || (new_permit.is_some() && !sudden) {
            self.write(velocity)?;
            self.written_ns = now;
            if let Some(stamp) = self.unanswered_ns.take().filter(|_| !velocity.is_zero()) {
                self.latency.record(now.saturating_sub(stamp));
            }
        }
        self.gate.commanded(now, self.applied);
        if tick {
            self.next_tick_ns = (now / self.period_ns + 1) * self.period_ns;
        }
        if tick || stops_now {
            self.hear_robot(io)?;
            self.publish_state(now)?;
        }
        Ok(())
    }

    fn write(&mut self, velocity: Twist2) -> Result<(), TransportError> {
        // Nothing holds for longer than the permit that it is of.
        let now_ns = self.clock.now_ns();
        let for_ns = self.gate.expiry_ns().map_or(2 * self.period_ns, |expiry| expiry.saturating_sub(now_ns));
        self.link.write(velocity, for_ns)?;
        self.applied = velocity;
        Ok(())
    }

    /// What the robot says of itself; a stop by its hand remote stops it here as well.
    fn hear_robot(&mut self, io: &Io) -> Result<(), TransportError> {
        self.robot = self.link.report()?;
        if self.robot.remote_stop {
            self.gate.stopped_by_remote();
            if !self.applied.is_zero() {
                self.limited_by = StopReason::of(StopKind::RemoteStop);
                self.write(Twist2::ZERO)?;
            }
        }
        if let Some(text) = self.link.news() {
            io.tell(&FromChild::Note { text });
        }
        Ok(())
    }

    fn publish_state(&mut self, now: u64) -> Result<(), TransportError> {
        let own = self.robot.own_from_robot.map(|(pose, age_ns)| (pose, now.saturating_sub(age_ns)));
        let (own_from_robot, own_stamp_ns) = own.unwrap_or_default();
        let state = LocomotionState {
            applied: self.applied,
            limited_by: if self.applied.is_zero() { self.limited_by } else { StopReason::default() },
            measured: self.robot.velocity.unwrap_or_default(),
            measured_valid: self.robot.velocity.is_some(),
            own_from_robot,
            own_stamp_ns,
            own_roll_pitch_rad: self.robot.roll_pitch_rad,
            charge_percent: self.robot.charge_percent.map_or(0, |percent| u32::from(percent.max(1))),
            remote_stop: self.robot.remote_stop,
            permit_seq: self.gate.permit().map_or(0, |permit| permit.header.seq),
            decision: self.gate.permit().map_or(0, |permit| permit.decision),
            epoch: self.gate.epoch(),
            ..LocomotionState::default()
        };
        self.states.publish(now, state).map(|_| ())
    }

    fn stands(&self) -> bool {
        self.robot.velocity.is_some_and(|velocity| velocity.is_standing())
    }
}

fn period_ns(settings: &Settings) -> u64 {
    (1e9 / settings.locomotion.rate_hz.get()) as u64
}

impl Service for Locomotion {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        while let Some(mode) = self.modes.take()? {
            self.gate.take_mode(&mode);
            if self.robot.remote_stop && self.gate.may_forget_remote_stop() {
                self.robot.remote_stop = false;
                self.link.forget_remote_stop();
            }
        }
        while let Some(cue) = self.cues.take()? {
            self.gate.take_cue(&cue);
        }
        while let Some(stop) = self.estop.take()? {
            if self.gate.take_estop(&stop) && !self.applied.is_zero() {
                // Before anything else that waits.
                self.write(Twist2::ZERO)?;
            }
        }
        while let Some(odometry) = self.odometry.take()? {
            self.gate.take_odometry(&odometry);
        }
        let mut newest = None;
        while let Some(permit) = self.permits.take()? {
            self.gate.take_permit(&permit);
            newest = Some(permit);
        }
        self.command(io, newest)
    }

    fn next_timer_ns(&self) -> Option<u64> {
        // Not only the tick: a permit's expiry is a stop, and a stop is written at once.
        // One that has expired has been judged already.
        let expiry = self.gate.expiry_ns().filter(|expiry| *expiry >= self.judged_ns);
        Some(expiry.map_or(self.next_tick_ns, |expiry| self.next_tick_ns.min(expiry.saturating_add(1))))
    }

    fn on_control(&mut self, io: &mut Io, message: ToChild, fd: Option<OwnedFd>) -> Result<(), TransportError> {
        match (message, fd) {
            (ToChild::Lifeline { service, incarnation }, Some(fd)) => {
                let token = self.lines.arm(service, incarnation, Line::from_fd(fd), io)?;
                self.gate.line_armed(service, incarnation);
                // A process that died before its line came here has closed it already.
                self.on_fd(io, token)?;
                io.tell(&FromChild::Armed { service, incarnation });
            }
            (ToChild::Stop { epoch, reason }, _) => {
                self.gate.stop_by(reason, epoch);
                let now = io.now_ns();
                if self.gate.judge(now).velocity.is_zero() {
                    self.write(Twist2::ZERO)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        if let Some((service, incarnation)) = self.lines.closed(token, io) {
            let stops = self.gate.line_closed(service, incarnation);
            // In stepped time nothing is written between two steps: the next one begins with the stop.
            if stops && !self.applied.is_zero() && !io.domain.clock.is_stepped() {
                self.write(Twist2::ZERO)?;
            }
        }
        Ok(())
    }

    fn wants_wall_ticks(&self) -> bool {
        true
    }

    fn on_wall_tick(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        if let Some(brake) = &self.brake {
            // The brake wants a word from this very loop, which begins once this incarnation has itself written zero.
            brake.send_bytes(&[BEAT]);
        }
        if self.ends_by_ns.is_some() {
            self.write(Twist2::ZERO)?;
            self.robot = self.link.report()?;
        }
        Ok(())
    }

    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        // For good: no mode that is still on its way may let the robot move again.
        self.gate.stop_by(StopReason::service(StopKind::SupervisorLost, ServiceId::Supervisor, 0), u64::MAX);
        self.ends_by_ns = Some(monotonic_ns() + LOST_LIMIT_NS);
        // The stop must not depend on what else is in the queue.
        self.write(Twist2::ZERO).is_err()
    }

    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        self.gate.stop_by(StopReason::of(StopKind::ShuttingDown), u64::MAX);
        self.write(Twist2::ZERO)
    }

    fn is_done(&self) -> bool {
        self.ends_by_ns.is_some_and(|by| self.stands() || monotonic_ns() >= by)
    }

    fn fill_health(&self, health: &mut Health) {
        health.latencies[0] = self.latency;
    }
}
