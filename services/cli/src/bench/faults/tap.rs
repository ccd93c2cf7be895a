//! What reaches the simulated robot, and what the services say of themselves, as it happens.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use messages::{Health, LocomotionState, Mode, RobotCommand, ServiceId, StopKind, WorldTruth};
use transport::{Domain, Io, RunDir, Service, Subscriber, TransportError, run_tool};

use crate::exit::Failure;

/// The listener looks at least this often, run time.
const LOOK_NS: u64 = 20_000_000;
/// So much is kept: minutes of it.
const KEPT: usize = 100_000;

/// A command at the link.
#[derive(Debug, Clone, Copy)]
pub struct Command {
    /// When it was published, monotonic clock.
    pub at_ns: u64,
    /// Whether it is zero.
    pub zero: bool,
}

/// What the world was like.
#[derive(Debug, Clone, Copy)]
pub struct Truth {
    /// When, monotonic clock.
    pub at_ns: u64,
    /// Since when the robot has had the command in force, where that is zero; monotonic clock.
    pub zero_since_ns: Option<u64>,
    /// Whether the robot stands.
    pub stands: bool,
    /// Way walked, metres.
    pub distance_m: f64,
    /// Collisions of robot and handler so far.
    pub collisions: u32,
    /// How far along the corridor, metres.
    pub x_m: f64,
}

/// Everything seen.
#[derive(Debug, Default)]
pub struct Seen {
    /// Commands since the last [`Tap::forget`].
    pub commands: Vec<Command>,
    /// Truths since then.
    pub truths: Vec<Truth>,
    /// Epochs and readiness since then, each with its time on the monotonic clock.
    pub modes: Vec<(u64, Mode)>,
    /// Why the robot stood since then.
    pub reasons: Vec<StopKind>,
    /// The process of each service, as its newest beat says.
    pub pids: BTreeMap<ServiceId, u32>,
    /// The newest mode.
    pub mode: Option<Mode>,
    /// The newest truth.
    pub truth: Option<Truth>,
    /// The newest command.
    pub command: Option<Command>,
}

/// Listens to a live run.
#[derive(Debug)]
pub struct Tap {
    seen: Arc<Mutex<Seen>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), TransportError>>>,
}

impl Tap {
    /// Listens to the run in that directory from now on.
    pub fn on(dir: &Path) -> Self {
        let (seen, stop) = (Arc::new(Mutex::new(Seen::default())), Arc::new(AtomicBool::new(false)));
        let (log, over, dir) = (Arc::clone(&seen), Arc::clone(&stop), dir.to_owned());
        let thread = std::thread::spawn(move || {
            let domain = Domain::open(RunDir::open(&dir), "bench")?;
            run_tool(domain, |io| Listener::open(io, log, over)).map(|_| ())
        });
        Self { seen, stop, thread: Some(thread) }
    }

    /// What was seen so far.
    pub fn seen(&self) -> MutexGuard<'_, Seen> {
        // Whoever panicked with it had only read it.
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets what was, for a new trial.
    pub fn forget(&self) {
        let mut seen = self.seen();
        seen.commands.clear();
        seen.truths.clear();
        seen.modes.clear();
        seen.reasons.clear();
    }

    /// Listens no longer.
    ///
    /// # Errors
    /// Where the run could not be listened to.
    pub fn stop(mut self) -> Result<(), Failure> {
        self.stop.store(true, Ordering::Relaxed);
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Err(error))) => Err(Failure::run(format!("the run could not be listened to: {error}"))),
            Some(Err(_)) => Err(Failure::run("the listener failed")),
            _ => Ok(()),
        }
    }
}

struct Listener {
    commands: Subscriber<RobotCommand>,
    truths: Subscriber<WorldTruth>,
    modes: Subscriber<Mode>,
    states: Subscriber<LocomotionState>,
    beats: Vec<Subscriber<Health>>,
    seen: Arc<Mutex<Seen>>,
    stop: Arc<AtomicBool>,
    started_ns: u64,
    next_ns: u64,
}

impl Listener {
    fn open(io: &mut Io, seen: Arc<Mutex<Seen>>, stop: Arc<AtomicBool>) -> Result<Self, TransportError> {
        let others = ServiceId::ALL.into_iter().filter(|service| *service != ServiceId::Supervisor);
        Ok(Self {
            commands: io.subscriber()?,
            truths: io.subscriber()?,
            modes: io.subscriber()?,
            states: io.quiet_subscriber()?,
            beats: others.map(|service| io.health_of(service)).collect::<Result<_, _>>()?,
            seen,
            stop,
            started_ns: io.domain.info.started_monotonic_ns,
            next_ns: 0,
        })
    }

    fn truth(&self, truth: &WorldTruth) -> Truth {
        let zero = truth.command.is_zero();
        Truth {
            at_ns: self.started_ns + truth.header.published_ns,
            zero_since_ns: zero.then_some(self.started_ns + truth.command_since_ns),
            stands: truth.robot_twist.is_standing(),
            distance_m: truth.distance_m,
            collisions: truth.robot_collisions + truth.handler_collisions,
            x_m: truth.world_from_robot.x_m,
        }
    }
}

impl Service for Listener {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.next_ns = io.now_ns() + LOOK_NS;
        let seen = Arc::clone(&self.seen);
        let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(command) = self.commands.take()? {
            let at_ns = self.started_ns + command.header.published_ns;
            seen.command = Some(Command { at_ns, zero: command.velocity.is_zero() });
            let command = seen.command;
            seen.commands.extend(command);
        }
        while let Some(truth) = self.truths.take()? {
            seen.truth = Some(self.truth(&truth));
            let truth = seen.truth;
            seen.truths.extend(truth);
        }
        while let Some(mode) = self.modes.take()? {
            seen.mode = Some(mode);
            seen.modes.push((self.started_ns + mode.header.published_ns, mode));
        }
        while let Some(state) = self.states.take()? {
            if state.applied.is_zero() && !seen.reasons.contains(&state.limited_by.kind) {
                seen.reasons.push(state.limited_by.kind);
            }
        }
        for beats in &mut self.beats {
            if let Some(health) = beats.take_newest()? {
                seen.pids.insert(health.service, health.pid);
            }
        }
        if seen.truths.len() > KEPT {
            seen.truths.clear();
            seen.commands.clear();
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn is_done(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
