//! What a service that stops the robot has more than the others: the processor before them, and early word of the
//! supervisor's death.

use messages::{Priority, ServiceId};
use nix::libc;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};

use crate::TransportError;

/// Real-time priorities, above whatever is not real-time and below the kernel's own threads. The brake is last to act
/// and first to run; the simulated robot is a machine of its own, which waits for no process of this one.
const NETWORK_PRIORITY: libc::c_int = 19;
const GATE_PRIORITY: libc::c_int = 20;
const BRAKE_PRIORITY: libc::c_int = 21;
/// The simulated robot, and a thread that talks to a real one at a fixed rate. That takes microseconds of a tick; were
/// it late, a brake that runs would have nothing to talk against.
const ROBOT_PRIORITY: libc::c_int = 22;
/// Whoever measures what the machine itself costs waits for none of them.
const WATCH_PRIORITY: libc::c_int = 23;

/// Gives this process the priority that the table of services names, where the machine lets it: what stops the robot
/// then does so in time on a processor that is kept busy, by whatever else dies as well.
pub(crate) fn hurry(service: ServiceId) {
    let sched_priority = match service.spec().map_or(Priority::Ordinary, |spec| spec.priority) {
        Priority::Ordinary => return,
        Priority::Gate => GATE_PRIORITY,
        Priority::Brake => BRAKE_PRIORITY,
        Priority::Robot => ROBOT_PRIORITY,
    };
    let priority = libc::sched_param { sched_priority };
    // SAFETY: the structure outlives the call, which reads it only. Without the right to it, nothing changes: `guidedog
    // doctor` tells.
    let _ = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &raw const priority) };
}

/// Lets the calling thread, which talks to a robot, run before everything but what measures: whether it may.
pub fn hurry_robot_thread() -> bool {
    hurry_at(ROBOT_PRIORITY)
}

/// Lets the calling thread, and those that it begins, run before what is not real-time: threads of a network, whose
/// work others decide on, so that whoever stops the robot comes first. Whether it may.
pub fn hurry_network_thread() -> bool {
    hurry_at(NETWORK_PRIORITY)
}

/// Lets the calling thread, which measures, run before everything of ours, for as long as it lives: whether it may.
pub fn hurry_this_thread() -> bool {
    hurry_at(WATCH_PRIORITY)
}

fn hurry_at(sched_priority: libc::c_int) -> bool {
    let priority = libc::sched_param { sched_priority };
    // SAFETY: as in `hurry`.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const priority) == 0 }
}

/// Whether a service started from here may run before what is not real-time.
#[must_use]
pub fn may_hurry() -> bool {
    // Only the thread is changed, and it ends here.
    std::thread::spawn(hurry_this_thread).join().unwrap_or(false)
}

/// A descriptor that becomes readable at SIGHUP, which the supervisor's death sends to who stops the robot.
pub(crate) fn hangup() -> Result<SignalFd, TransportError> {
    let mut signals = SigSet::empty();
    signals.add(Signal::SIGHUP);
    let blocked = signals.thread_block();
    let opened = blocked.and_then(|()| SignalFd::with_flags(&signals, SfdFlags::SFD_CLOEXEC | SfdFlags::SFD_NONBLOCK));
    opened.map_err(|errno| TransportError::service(format!("signalfd: {errno}")))
}
