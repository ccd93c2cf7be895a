//! Run time: real, or stepped by a master.

use std::cell::Cell;

use messages::{ClockKind, Header};
use rustix::time::{ClockId, clock_gettime};

/// What is stamped further ahead than this is no message; less is for the consumer to judge by the stamp's age.
const FUTURE_NS: u64 = 1_000_000_000;

/// The monotonic clock of this machine, nanoseconds.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    // The monotonic clock counts from boot: neither part is ever negative.
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// The time of day, seconds since 1970: for what a recording says about itself, and nothing else.
#[must_use]
pub fn unix_time_s() -> f64 {
    let now = clock_gettime(ClockId::Realtime);
    now.tv_sec as f64 + now.tv_nsec as f64 / 1e9
}

/// The clock of one process.
#[derive(Debug)]
pub struct Clock {
    kind: ClockKind,
    started_ns: u64,
    step: Cell<u64>,
    /// The first step that this process took.
    first_step: Cell<u64>,
    stepped_now_ns: Cell<u64>,
}

impl Clock {
    /// A clock of the run that started at `started_ns` of the monotonic clock.
    #[must_use]
    pub fn new(kind: ClockKind, started_ns: u64) -> Self {
        Self { kind, started_ns, step: Cell::new(0), first_step: Cell::new(0), stepped_now_ns: Cell::new(0) }
    }

    /// Run time, nanoseconds.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        match self.kind {
            ClockKind::Real => self.of_monotonic_ns(monotonic_ns()),
            ClockKind::Stepped { .. } => self.stepped_now_ns.get(),
        }
    }

    /// Run time at that moment of this machine's monotonic clock, nanoseconds; 0 before the run began. For devices, and
    /// they keep real time.
    #[must_use]
    pub fn of_monotonic_ns(&self, monotonic_ns: u64) -> u64 {
        monotonic_ns.saturating_sub(self.started_ns)
    }

    /// The step being taken; 0 in real time and before the first step.
    #[must_use]
    pub fn step(&self) -> u64 {
        self.step.get()
    }

    /// Whether run time is stepped.
    #[must_use]
    pub fn is_stepped(&self) -> bool {
        matches!(self.kind, ClockKind::Stepped { .. })
    }

    /// How run time passes.
    #[must_use]
    pub fn kind(&self) -> ClockKind {
        self.kind
    }

    /// Whether a message published in `step` may be seen now: in stepped time only in a later step.
    #[must_use]
    pub(crate) fn may_see(&self, step: u64) -> bool {
        !self.is_stepped() || step < self.step.get()
    }

    /// Whether a message was published in a step before this process joined. Which of those it could still see would
    /// hang on how long its start took.
    #[must_use]
    pub(crate) fn is_before_joining(&self, step: u64) -> bool {
        self.is_stepped() && self.first_step.get() > 1 && step < self.first_step.get()
    }

    /// Whether a message may say this of its time. Nobody is more than a step ahead of a member, for the next one waits
    /// for its acknowledgement; and a stamp from far in the future would outlast every later one where only what is
    /// newer is taken. Who is no member yet cannot tell.
    #[must_use]
    pub(crate) fn may_come(&self, header: &Header) -> bool {
        if self.is_stepped() && self.step.get() == 0 {
            return true;
        }
        let step_is_near = !self.is_stepped() || header.step <= self.step.get().saturating_add(1);
        step_is_near && header.stamp_ns <= self.now_ns().saturating_add(FUTURE_NS)
    }

    /// Enters a step.
    pub(crate) fn enter(&self, step: u64, now_ns: u64) {
        if self.step.get() == 0 {
            self.first_step.set(step);
        }
        self.step.set(step);
        self.stepped_now_ns.set(now_ns);
    }
}
