//! The wait loop of every service: one thread, one epoll, woken by inputs, timers, the clock and the supervisor's line.
//!
//! Beats are published from this very loop, so a service that is stuck in its work is silent.

use std::cell::RefCell;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::PathBuf;
use std::process::ExitCode;
use std::rc::Rc;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::*;
use messages::{
    ClockAck, ClockStep, Frame, Health, MAX_MEMBERS, Member, Message, PortRole, QUANTUM_NS, ServiceId, ServiceState,
    TopicId,
};
use rustix::event::{Timespec, epoll};

use crate::domain::{Domain, spec_of};
use crate::line::{FromChild, Line, Received, ToChild, inherited_fd};
use crate::port::{FramePublisher, FrameSubscriber, Publisher, Shared, Subscriber, listener};
use crate::run_dir::RunDir;
use crate::{ClockKind, TransportError, monotonic_ns};

/// Exit code of a service that was started with wrong arguments, or by hand.
pub const EXIT_BAD_ARGUMENTS: u8 = 2;
/// Exit code of a service that could not go on; it told the supervisor why.
pub const EXIT_FAILED: u8 = 1;

/// Beats of critical services: 50 Hz.
const BEAT_CRITICAL_NS: u64 = 20_000_000;
/// Beats of the others: 10 Hz.
const BEAT_NS: u64 = 100_000_000;
/// Wall ticks, for who asked for them.
const WALL_TICK_NS: u64 = 20_000_000;
/// How long a service that has left waits for the supervisor to take its last figures.
const LEAVE_LIMIT_NS: u64 = 2_000_000_000;

const TOKEN_CONTROL: u64 = 0;
const TOKEN_CLOCK: u64 = 1;
const TOKEN_TOPIC: u64 = 2;
const TOKEN_OWN: u64 = 1 << 32;

/// Which service a process is, and which life of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Which service.
    pub service: ServiceId,
    /// Which life of it, from 1.
    pub incarnation: u32,
}

/// What the supervisor passes to a child.
#[derive(Debug)]
pub struct ChildArgs {
    /// The run directory.
    pub run: PathBuf,
    /// Which life this is.
    pub incarnation: u32,
}

impl ChildArgs {
    /// Environment variable that names the descriptor of the control line.
    pub const CONTROL_FD: &'static str = "GUIDEDOG_CONTROL_FD";
    /// Environment variable that names the descriptor of the lifeline.
    pub const LIFELINE_FD: &'static str = "GUIDEDOG_LIFELINE_FD";
    /// Environment variable that names the descriptor of locomotion's line to the brake.
    pub const BRAKE_FD: &'static str = "GUIDEDOG_BRAKE_FD";

    /// Reads `--run DIR --incarnation N`.
    ///
    /// # Errors
    /// Where an argument is missing or unknown.
    pub fn parse(mut args: impl Iterator<Item = String>) -> Result<Self, TransportError> {
        let wrong = |what: &str| TransportError::Arguments(format!("{what}; the supervisor starts this program"));
        let (mut run, mut incarnation) = (None, None);
        while let Some(arg) = args.next() {
            let value = args.next().ok_or_else(|| wrong(&format!("{arg} needs a value")));
            match arg.as_str() {
                "--run" => run = Some(PathBuf::from(value?)),
                "--incarnation" => incarnation = Some(value?.parse().map_err(|_| wrong("--incarnation is no number"))?),
                _ => return Err(wrong(&format!("unknown argument {arg}"))),
            }
        }
        Ok(Self {
            run: run.ok_or_else(|| wrong("--run is missing"))?,
            incarnation: incarnation.ok_or_else(|| wrong("--incarnation is missing"))?,
        })
    }
}

/// A service: woken by its loop, never waiting by itself.
pub trait Service {
    /// Called whenever an input may have come or a timer is due: takes what there is, does the work, publishes.
    ///
    /// # Errors
    /// Where the service cannot go on; its process then ends, and the supervisor hears why.
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError>;

    /// Run time at which the service wants to be woken, if any.
    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    /// A message on the control line that is not the loop's own business.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_control(&mut self, _io: &mut Io, _message: ToChild, _fd: Option<OwnedFd>) -> Result<(), TransportError> {
        Ok(())
    }

    /// A descriptor given to [`Io::watch`] has something to read, or its other end is gone.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_fd(&mut self, _io: &mut Io, _token: u64) -> Result<(), TransportError> {
        Ok(())
    }

    /// Called every 20 ms of wall time, in stepped time too, where [`Service::wants_wall_ticks`].
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_wall_tick(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    /// Whether [`Service::on_wall_tick`] is to be called.
    fn wants_wall_ticks(&self) -> bool {
        false
    }

    /// The supervisor is gone. `true`: the process ends at once; `false`: the service ends by [`Service::is_done`].
    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        true
    }

    /// The supervisor wants the service to leave: finish what must be finished.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    /// Whether the process may end.
    fn is_done(&self) -> bool {
        false
    }

    /// Adds the service's own figures to its beat.
    fn fill_health(&self, _health: &mut Health) {}

    /// Whether this service gives out the steps of stepped time.
    fn is_clock_master(&self) -> bool {
        false
    }

    /// Whether the run has come to its end: no further step is given.
    fn time_is_over(&self) -> bool {
        false
    }

    /// Time is over, and everybody has done the last step.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_time_over(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    /// Whether the step may be acknowledged; the supervisor holds time while a restarted service joins.
    fn may_acknowledge(&self) -> bool {
        true
    }

    /// The members from the next step on, with a version that grows; only the supervisor has one.
    fn roster(&self) -> Option<(u64, &[Member])> {
        None
    }
}

/// What a service has to do with the world: its ports, its clock, its lines.
pub struct Io {
    /// The run.
    pub domain: Domain,
    shared: Rc<Shared>,
    epoll: OwnedFd,
    listeners: Vec<Listener<ipc::Service>>,
    control: Option<Line>,
    /// Held open for as long as the process lives: its closing is the process's death notice.
    _lifeline: Option<OwnedFd>,
    wall_pace_ns: u64,
}

impl std::fmt::Debug for Io {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Io").field("identity", &self.shared.identity).finish_non_exhaustive()
    }
}

fn watch_fd(epoll_fd: &OwnedFd, fd: impl AsFd, token: u64) -> Result<(), TransportError> {
    epoll::add(epoll_fd, fd, epoll::EventData::new_u64(token), epoll::EventFlags::IN)
        .map_err(TransportError::system("epoll_ctl"))
}

impl Io {
    fn new(
        domain: Domain,
        identity: Identity,
        control: Option<Line>,
        lifeline: Option<OwnedFd>,
    ) -> Result<Self, TransportError> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(TransportError::system("epoll_create"))?;
        if let Some(line) = &control {
            watch_fd(&epoll, line, TOKEN_CONTROL)?;
        }
        let shared =
            Rc::new(Shared { identity, clock: Rc::clone(&domain.clock), counters: RefCell::new(Vec::new()) });
        Ok(Self { domain, shared, epoll, listeners: Vec::new(), control, _lifeline: lifeline, wall_pace_ns: 0 })
    }

    /// Which service this is, and which life of it.
    #[must_use]
    pub fn identity(&self) -> Identity {
        self.shared.identity
    }

    /// Run time, nanoseconds.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.domain.clock.now_ns()
    }

    /// A writer of a topic with messages of fixed size.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn publisher<M: Message + ZeroCopySend>(&mut self) -> Result<Publisher<M>, TransportError> {
        let of = if M::TOPIC == TopicId::Health { self.shared.identity.service } else { ServiceId::None };
        Publisher::open(&self.domain, &self.shared, of)
    }

    /// A reader of a topic with messages of fixed size; a message wakes the service where the topic wakes.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn subscriber<M: Message + ZeroCopySend>(&mut self) -> Result<Subscriber<M>, TransportError> {
        let subscriber = Subscriber::open(&self.domain, &self.shared, ServiceId::None)?;
        self.listen(M::TOPIC)?;
        Ok(subscriber)
    }

    /// A reader of one service's beats.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn health_of(&mut self, service: ServiceId) -> Result<Subscriber<Health>, TransportError> {
        Subscriber::open(&self.domain, &self.shared, service)
    }

    /// A writer of frames of at most `max_len` elements, its whole pool prefaulted.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn frame_publisher<F: Frame>(&mut self, max_len: usize) -> Result<FramePublisher<F>, TransportError>
    where
        F::Element: ZeroCopySend,
        F::Meta: ZeroCopySend,
    {
        let publisher = FramePublisher::open(&self.domain, &self.shared, max_len)?;
        prefault(&self.domain.info.prefix);
        Ok(publisher)
    }

    /// A reader of frames.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn frame_subscriber<F: Frame>(&mut self) -> Result<FrameSubscriber<F>, TransportError>
    where
        F::Element: ZeroCopySend,
        F::Meta: ZeroCopySend,
    {
        let subscriber = FrameSubscriber::open(&self.domain, &self.shared)?;
        self.listen(F::Meta::TOPIC)?;
        Ok(subscriber)
    }

    fn listen(&mut self, topic: TopicId) -> Result<(), TransportError> {
        let is_clock = matches!(topic, TopicId::ClockStep | TopicId::ClockAck);
        if !spec_of(topic)?.wakes || (self.domain.clock.is_stepped() && !is_clock) {
            return Ok(());
        }
        let listener = listener(&self.domain, topic)?;
        let token = if is_clock { TOKEN_CLOCK } else { TOKEN_TOPIC };
        // SAFETY: the listener is kept in `self.listeners` for as long as the epoll lives, so the descriptor stays open.
        let fd = unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) };
        watch_fd(&self.epoll, fd, token)?;
        self.listeners.push(listener);
        Ok(())
    }

    /// Wakes the service through [`Service::on_fd`] when `fd` has something to read, or its other end is gone.
    ///
    /// # Errors
    /// Where the kernel refuses.
    pub fn watch(&self, fd: impl AsFd, token: u64) -> Result<(), TransportError> {
        watch_fd(&self.epoll, fd, TOKEN_OWN + token)
    }

    /// No longer wakes for `fd`.
    pub fn unwatch(&self, fd: impl AsFd) {
        // A descriptor that was not watched needs no unwatching.
        let _ = epoll::delete(&self.epoll, fd);
    }

    /// Tells the supervisor something; `false` where it is gone.
    pub fn tell(&self, message: &FromChild) -> bool {
        self.control.as_ref().is_some_and(|line| line.send(message, None))
    }

    fn drain_listeners(&self) {
        for listener in &self.listeners {
            // An event says only "look"; what it was about is read from the topics.
            let _ = listener.try_wait(|_| {});
        }
    }

    fn wait(&self, timeout_ns: Option<u64>, tokens: &mut Vec<u64>) -> Result<(), TransportError> {
        let timeout = timeout_ns.map(|ns| Timespec {
            tv_sec: (ns / 1_000_000_000) as i64,
            tv_nsec: (ns % 1_000_000_000) as _,
        });
        let blank = epoll::Event { flags: epoll::EventFlags::empty(), data: epoll::EventData::new_u64(0) };
        let mut events = [blank; 32];
        tokens.clear();
        match epoll::wait(&self.epoll, &mut events, timeout.as_ref()) {
            Ok(n) => tokens.extend(events[..n].iter().map(|event| event.data.u64())),
            Err(rustix::io::Errno::INTR) => {}
            Err(errno) => return Err(TransportError::System { call: "epoll_wait", errno }),
        }
        Ok(())
    }
}

/// Touches the whole of every pool that this process has made, so that no frame pays for first touches.
fn prefault(prefix: &str) {
    let Ok(maps) = std::fs::read_to_string("/proc/self/maps") else { return };
    for line in maps.lines().filter(|line| line.contains(prefix) && line.contains(".data") && line.contains(" rw-s ")) {
        let Some((range, _)) = line.split_once(' ') else { continue };
        let Some((from, to)) = range.split_once('-') else { continue };
        let (Ok(from), Ok(to)) = (usize::from_str_radix(from, 16), usize::from_str_radix(to, 16)) else { continue };
        // SAFETY: populating changes no byte of the mapping. Where the kernel is too old (5.14) it refuses, and the
        // first frames pay instead.
        let _ = unsafe {
            rustix::mm::madvise(
                std::ptr::with_exposed_provenance_mut(from),
                to - from,
                rustix::mm::Advice::LinuxPopulateWrite,
            )
        };
    }
}

/// The whole `main` of a service: parses the arguments, opens the run, builds the service, runs it.
pub fn service_main<S: Service>(
    service: ServiceId,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> ExitCode {
    let args = match ChildArgs::parse(std::env::args().skip(1)) {
        Ok(args) => args,
        Err(error) => {
            eprintln!("guidedog-{service}: {error}");
            return ExitCode::from(EXIT_BAD_ARGUMENTS);
        }
    };
    match run_child(service, &args, build) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("guidedog-{service}: {error}");
            ExitCode::from(if matches!(error, TransportError::Arguments(_)) { EXIT_BAD_ARGUMENTS } else { EXIT_FAILED })
        }
    }
}

fn run_child<S: Service>(
    service: ServiceId,
    args: &ChildArgs,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> Result<(), TransportError> {
    let control = Line::from_fd(inherited_fd(ChildArgs::CONTROL_FD)?);
    let lifeline = inherited_fd(ChildArgs::LIFELINE_FD).ok();
    let identity = Identity { service, incarnation: args.incarnation };
    let name = format!("{service}.{}", args.incarnation);
    let mut io = match Domain::open(RunDir::open(&args.run), &name) {
        Ok(domain) => Io::new(domain, identity, Some(control), lifeline)?,
        Err(error) => {
            control.send(&FromChild::Failed { why: error.to_string() }, None);
            return Err(error);
        }
    };
    let outcome = build(&mut io).and_then(|mut service| run(&mut io, &mut service));
    if let Err(error) = &outcome {
        io.tell(&FromChild::Failed { why: error.to_string() });
    }
    outcome
}

/// Runs the supervisor in the domain that it has made.
///
/// # Errors
/// As [`run`].
pub fn run_supervisor<S: Service>(
    domain: Domain,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> Result<S, TransportError> {
    let identity = Identity { service: ServiceId::Supervisor, incarnation: 1 };
    let mut io = Io::new(domain, identity, None, None)?;
    let mut service = build(&mut io)?;
    run(&mut io, &mut service)?;
    Ok(service)
}

/// Runs a service until it has left or is done.
///
/// # Errors
/// Where the service fails, or the transport does.
pub fn run<S: Service>(io: &mut Io, service: &mut S) -> Result<(), TransportError> {
    let mut wait_loop = WaitLoop::open(io, service)?;
    io.tell(&FromChild::Ready);
    if io.domain.clock.is_stepped() { wait_loop.run_stepped(io, service) } else { wait_loop.run_real(io, service) }
}

/// How the loop goes on after the lines were served.
#[derive(PartialEq)]
enum Flow {
    On,
    End,
}

struct WaitLoop {
    health: Publisher<Health>,
    beat_ns: u64,
    next_beat_ns: u64,
    next_wall_tick_ns: u64,
    state: ServiceState,
    leave_by_ns: Option<u64>,
    tokens: Vec<u64>,
    steps: Option<Subscriber<ClockStep>>,
    step_out: Option<Publisher<ClockStep>>,
    acks: Option<Subscriber<ClockAck>>,
    ack_out: Option<Publisher<ClockAck>>,
    /// The step taken but not yet acknowledged.
    unacknowledged: bool,
    roster_sent: u64,
    told_time_over: bool,
}

impl WaitLoop {
    fn open<S: Service>(io: &mut Io, service: &S) -> Result<Self, TransportError> {
        let stepped = io.domain.clock.is_stepped();
        let master = stepped && service.is_clock_master();
        let critical = io.identity().service != ServiceId::Recorder;
        Ok(Self {
            health: io.publisher()?,
            beat_ns: if critical { BEAT_CRITICAL_NS } else { BEAT_NS },
            next_beat_ns: 0,
            next_wall_tick_ns: 0,
            state: ServiceState::Ready,
            leave_by_ns: None,
            tokens: Vec::with_capacity(32),
            steps: if stepped && !master { Some(io.subscriber()?) } else { None },
            step_out: if master { Some(io.publisher()?) } else { None },
            acks: if master { Some(io.subscriber()?) } else { None },
            ack_out: if stepped && !master { Some(io.publisher()?) } else { None },
            unacknowledged: false,
            roster_sent: 0,
            told_time_over: false,
        })
    }

    fn run_real<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        loop {
            let now = io.now_ns();
            let due = [service.next_timer_ns(), Some(self.next_beat_ns)].into_iter().flatten().min();
            let mut timeout = due.map(|due| due.saturating_sub(now));
            if service.wants_wall_ticks() {
                timeout = earlier(timeout, self.next_wall_tick_ns.saturating_sub(monotonic_ns()));
            }
            io.wait(timeout, &mut self.tokens)?;
            io.drain_listeners();
            if self.serve_lines(io, service)? == Flow::End {
                return Ok(());
            }
            service.on_wake(io)?;
            self.beat(io, service)?;
            self.tell_time_over(io, service)?;
            if service.is_done() {
                return Ok(());
            }
        }
    }

    fn tell_time_over<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        if service.time_is_over() && !self.told_time_over {
            self.told_time_over = true;
            service.on_time_over(io)?;
        }
        Ok(())
    }

    fn run_stepped<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        if service.is_clock_master() {
            return self.run_master(io, service);
        }
        loop {
            let timeout = if service.wants_wall_ticks() || self.leave_by_ns.is_some() {
                Some(self.next_wall_tick_ns.saturating_sub(monotonic_ns()).min(WALL_TICK_NS))
            } else {
                None
            };
            io.wait(timeout, &mut self.tokens)?;
            io.drain_listeners();
            if self.serve_lines(io, service)? == Flow::End || service.is_done() {
                return Ok(());
            }
            self.take_steps(io, service)?;
            self.acknowledge(io, service)?;
        }
    }

    fn take_steps<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        let me = Member { service: io.identity().service, incarnation: io.identity().incarnation };
        while let Some(step) = self.steps.as_mut().map_or(Ok(None), Subscriber::receive)? {
            if !step.members().contains(&me) || step.header.step <= io.domain.clock.step() {
                continue;
            }
            io.domain.clock.enter(step.header.step, step.header.stamp_ns);
            service.on_wake(io)?;
            self.beat(io, service)?;
            self.unacknowledged = true;
        }
        Ok(())
    }

    /// Acknowledges the step, or tells a new roster while the step is held.
    fn acknowledge<S: Service>(&mut self, io: &Io, service: &S) -> Result<(), TransportError> {
        let may = self.unacknowledged && service.may_acknowledge();
        let roster = service.roster();
        let news = roster.is_some_and(|(version, _)| version > self.roster_sent);
        let Some(out) = self.ack_out.as_mut().filter(|_| may || news) else { return Ok(()) };
        let identity = io.identity();
        let mut ack = ClockAck {
            member: Member { service: identity.service, incarnation: identity.incarnation },
            ..ClockAck::default()
        };
        if let Some((version, members)) = roster {
            ack.roster_version = version;
            ack.roster_count = members.len().min(MAX_MEMBERS) as u32;
            for (slot, member) in ack.roster.iter_mut().zip(members) {
                *slot = *member;
            }
            self.roster_sent = version;
        }
        // A roster alone acknowledges nothing: its stamp is 0. Steps are numbered from 1, at 10 ms and later.
        out.publish(if may { io.now_ns() } else { 0 }, ack)?;
        self.unacknowledged &= !may;
        Ok(())
    }

    /// Gives out steps to the members of the newest roster, one when all have done the one before.
    fn run_master<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<(), TransportError> {
        let ClockKind::Stepped { speed } = io.domain.clock.kind() else { return Ok(()) };
        io.wall_pace_ns = if speed > 0.0 { (QUANTUM_NS as f64 / speed) as u64 } else { 0 };
        let mut master = Master::default();
        loop {
            let ready = master.may_step(io.wall_pace_ns);
            let idle = master.is_waiting() || self.told_time_over;
            let timeout = if idle { None } else { Some(ready.saturating_sub(monotonic_ns())) };
            if timeout != Some(0) {
                io.wait(timeout.or(Some(WALL_TICK_NS * 5)), &mut self.tokens)?;
                io.drain_listeners();
            } else {
                self.tokens.clear();
                self.tokens.push(TOKEN_CONTROL);
            }
            if self.serve_lines(io, service)? == Flow::End || service.is_done() {
                return Ok(());
            }
            while let Some(ack) = self.acks.as_mut().map_or(Ok(None), Subscriber::receive)? {
                master.take(&ack);
            }
            if master.is_waiting() || monotonic_ns() < master.may_step(io.wall_pace_ns) {
                continue;
            }
            if service.time_is_over() {
                self.tell_time_over(io, service)?;
            } else {
                self.give_step(io, service, &mut master)?;
            }
        }
    }

    fn give_step<S: Service>(
        &mut self,
        io: &mut Io,
        service: &mut S,
        master: &mut Master,
    ) -> Result<(), TransportError> {
        let step = io.domain.clock.step() + 1;
        io.domain.clock.enter(step, step * QUANTUM_NS);
        master.begin(step, io.wall_pace_ns);
        let mut message = ClockStep { member_count: master.roster.len() as u32, ..ClockStep::default() };
        for (slot, member) in message.members.iter_mut().zip(&master.roster) {
            *slot = *member;
        }
        if let Some(out) = self.step_out.as_mut() {
            out.publish(step * QUANTUM_NS, message)?;
        }
        service.on_wake(io)?;
        self.beat(io, service)
    }

    /// Serves the control line and the service's own descriptors, and the wall tick.
    fn serve_lines<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<Flow, TransportError> {
        let tokens = std::mem::take(&mut self.tokens);
        for token in &tokens {
            if *token >= TOKEN_OWN {
                service.on_fd(io, token - TOKEN_OWN)?;
            } else if *token == TOKEN_CONTROL && self.serve_control(io, service)? == Flow::End {
                return Ok(Flow::End);
            }
        }
        self.tokens = tokens;
        let now = monotonic_ns();
        if self.leave_by_ns.is_some_and(|by| now > by) {
            return Ok(Flow::End);
        }
        if now >= self.next_wall_tick_ns {
            self.next_wall_tick_ns = now + WALL_TICK_NS;
            if service.wants_wall_ticks() {
                service.on_wall_tick(io)?;
            }
        }
        Ok(Flow::On)
    }

    fn serve_control<S: Service>(&mut self, io: &mut Io, service: &mut S) -> Result<Flow, TransportError> {
        loop {
            let received = io.control.as_ref().map_or(Received::Nothing, Line::receive::<ToChild>);
            match received {
                Received::Nothing => return Ok(Flow::On),
                Received::Closed => {
                    if let Some(line) = io.control.take() {
                        io.unwatch(&line);
                    }
                    return Ok(if service.on_supervisor_lost(io) { Flow::End } else { Flow::On });
                }
                Received::Message(ToChild::Leave, _) => {
                    service.on_leave(io)?;
                    self.state = ServiceState::Leaving;
                    self.next_beat_ns = 0;
                    self.beat(io, service)?;
                    self.leave_by_ns = Some(monotonic_ns() + LEAVE_LIMIT_NS);
                    io.tell(&FromChild::Left);
                }
                Received::Message(ToChild::Exit, _) => return Ok(Flow::End),
                Received::Message(message, fd) => service.on_control(io, message, fd)?,
            }
        }
    }

    /// Publishes the beat when it is due.
    fn beat<S: Service>(&mut self, io: &Io, service: &S) -> Result<(), TransportError> {
        let now = io.now_ns();
        if now < self.next_beat_ns {
            return Ok(());
        }
        self.next_beat_ns = now + self.beat_ns;
        let identity = io.identity();
        let mut health = Health {
            service: identity.service,
            state: self.state,
            pid: std::process::id(),
            ..Health::default()
        };
        let counters = io.shared.counters.borrow();
        health.port_count = counters.len() as u32;
        for (slot, port) in health.ports.iter_mut().zip(counters.iter()) {
            *slot = *port;
            match port.role {
                PortRole::Subscriber => health.input_seq += port.count,
                PortRole::Publisher if port.topic != TopicId::Health => health.output_seq += port.count,
                PortRole::Publisher => {}
            }
        }
        drop(counters);
        service.fill_health(&mut health);
        self.health.publish(now, health).map(|_| ())
    }
}

fn earlier(a: Option<u64>, b: u64) -> Option<u64> {
    Some(a.map_or(b, |a| a.min(b)))
}

/// The master's book: who is a member, and who has not yet done the step.
#[derive(Default)]
struct Master {
    roster: Vec<Member>,
    roster_version: u64,
    waiting_for: Vec<Member>,
    step: u64,
    /// Wall time of the last step.
    stepped_at_ns: u64,
}

impl Master {
    /// Whether there is no roster yet, or somebody has not done the step.
    fn is_waiting(&self) -> bool {
        self.roster_version == 0 || !self.waiting_for.is_empty()
    }

    /// Wall time from which the next step may be given. A run that fell behind does not rush to catch up.
    fn may_step(&self, pace_ns: u64) -> u64 {
        self.stepped_at_ns + pace_ns
    }

    fn begin(&mut self, step: u64, pace_ns: u64) {
        let now = monotonic_ns();
        let due = self.stepped_at_ns + pace_ns;
        // Small lateness is made up for, so that `speed` is met on average; a long wait is not.
        self.stepped_at_ns = if now - due.min(now) < 5 * pace_ns { due } else { now };
        self.step = step;
        self.waiting_for.clone_from(&self.roster);
    }

    fn take(&mut self, ack: &ClockAck) {
        if ack.roster_version > self.roster_version {
            self.roster_version = ack.roster_version;
            self.roster = ack.roster().to_vec();
            self.waiting_for.retain(|member| ack.roster().contains(member));
        }
        if ack.header.stamp_ns == self.step * QUANTUM_NS {
            self.waiting_for.retain(|member| *member != ack.member);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Master;
    use messages::{ClockAck, Header, Member, QUANTUM_NS, ServiceId};

    fn member(service: ServiceId, incarnation: u32) -> Member {
        Member { service, incarnation }
    }

    fn roster(version: u64, members: &[Member]) -> ClockAck {
        let mut ack = ClockAck { roster_version: version, roster_count: members.len() as u32, ..ClockAck::default() };
        ack.roster[..members.len()].copy_from_slice(members);
        ack
    }

    #[test]
    fn time_waits_for_every_member_and_for_nobody_who_died() {
        let (lidar, shield) = (member(ServiceId::Lidar, 1), member(ServiceId::Shield, 1));
        let mut master = Master::default();
        assert!(master.is_waiting(), "there is no roster");
        master.take(&roster(1, &[lidar, shield]));
        assert!(!master.is_waiting());
        master.begin(1, 0);
        let done = |who| ClockAck {
            header: Header { stamp_ns: QUANTUM_NS, ..Header::default() },
            member: who,
            ..ClockAck::default()
        };
        master.take(&done(lidar));
        assert!(master.is_waiting(), "the shield has not done the step");
        master.take(&roster(2, &[lidar]));
        assert!(!master.is_waiting(), "the shield is dead");
        master.begin(2, 0);
        master.take(&done(lidar));
        assert!(master.is_waiting(), "an acknowledgement of an older step does not count");
    }
}
