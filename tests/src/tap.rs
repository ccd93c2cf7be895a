//! What reaches the simulated robot, as it happens.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use messages::{RobotCommand, WorldTruth};
use transport::{Domain, Io, RunDir, Service, Subscriber, TransportError, monotonic_ns, run_tool};

/// One thing seen.
#[derive(Debug, Clone, Copy)]
pub enum Seen {
    /// A command at the link, and whether it is zero.
    Command {
        /// Whether it is zero.
        zero: bool,
    },
    /// The true speed of the robot, metres and radians per second added up.
    Speed(f64),
}

/// Listens to a live run until it is told to stop.
#[derive(Debug)]
pub struct Tap {
    seen: Arc<Mutex<Vec<(u64, Seen)>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), TransportError>>>,
}

impl Tap {
    /// Listens to the run in that directory from now on.
    #[must_use]
    pub fn on(dir: PathBuf) -> Self {
        let (seen, stop) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
        let (log, over) = (Arc::clone(&seen), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            let domain = Domain::open(RunDir::open(&dir), "tap")?;
            let open = |io: &mut Io| {
                Ok(Listener { commands: io.subscriber()?, truths: io.subscriber()?, seen: log, stop: over, next_ns: 0 })
            };
            run_tool(domain, open).map(|_| ())
        });
        Self { seen, stop, thread: Some(thread) }
    }

    /// Everything seen since a time on the monotonic clock, with the time at which it was seen, nanoseconds.
    #[must_use]
    pub fn since(&self, from_ns: u64) -> Vec<(u64, Seen)> {
        let seen = self.seen.lock().expect("the listener does not panic");
        seen.iter().filter(|(at_ns, _)| *at_ns >= from_ns).copied().collect()
    }

    /// Listens no longer.
    pub fn stop(mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().expect("the listener does not panic").expect("the run could be listened to");
        }
    }
}

struct Listener {
    commands: Subscriber<RobotCommand>,
    truths: Subscriber<WorldTruth>,
    seen: Arc<Mutex<Vec<(u64, Seen)>>>,
    stop: Arc<AtomicBool>,
    next_ns: u64,
}

impl Service for Listener {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.next_ns = io.now_ns() + 20_000_000;
        let at_ns = monotonic_ns();
        let mut seen = self.seen.lock().expect("nobody panics with it");
        while let Some(command) = self.commands.take()? {
            seen.push((at_ns, Seen::Command { zero: command.velocity.is_zero() }));
        }
        while let Some(truth) = self.truths.take()? {
            seen.push((at_ns, Seen::Speed(truth.robot_twist.speed_mps() + truth.robot_twist.wz_radps.abs())));
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
