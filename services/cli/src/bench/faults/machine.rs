//! What the machine itself costs: how late a thread wakes up that runs before everything of ours. A stop cannot be
//! faster than that, and on a shared machine it tells a pause of the machine from one of the runtime.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};
use transport::{hurry_this_thread, monotonic_ns};

/// The thread sleeps for so long, again and again.
const SLEEP: Duration = Duration::from_millis(1);
/// A pause that is told: more than this late, nanoseconds.
const PAUSE_NS: u64 = 1_000_000;
/// Pauses that are kept; so many of them say all there is to say.
const KEPT: usize = 100_000;

/// The machine's pauses, for as long as this lives.
#[derive(Debug)]
pub struct Pauses {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    over: AtomicBool,
    /// The end of each on the monotonic clock and its length, nanoseconds.
    pauses: Mutex<Vec<(u64, u64)>>,
}

impl Shared {
    fn pauses(&self) -> MutexGuard<'_, Vec<(u64, u64)>> {
        self.pauses.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pauses {
    /// Watches from now on; none where nothing may run before everything else here.
    pub fn watch() -> Option<Self> {
        if !transport::may_hurry() {
            return None;
        }
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        std::thread::spawn(move || {
            hurry_this_thread();
            let mut slept_ns = monotonic_ns();
            while !theirs.over.load(Ordering::Relaxed) {
                std::thread::sleep(SLEEP);
                let now_ns = monotonic_ns();
                let late_ns = (now_ns - slept_ns).saturating_sub(SLEEP.as_nanos() as u64);
                slept_ns = now_ns;
                // The lock is taken for a pause alone: who runs before everything else waits for nobody meanwhile.
                if late_ns > PAUSE_NS {
                    let mut pauses = theirs.pauses();
                    if pauses.len() < KEPT {
                        pauses.push((now_ns, late_ns));
                    }
                }
            }
        });
        Some(Self { shared })
    }

    /// The longest pause that overlaps the time between two instants of the monotonic clock, milliseconds.
    pub fn longest_ms(&self, from_ns: u64, to_ns: u64) -> Option<f64> {
        let pauses = self.shared.pauses();
        let within = pauses.iter().filter(|(at_ns, late_ns)| *at_ns >= from_ns && at_ns - late_ns <= to_ns);
        within.map(|(_, late_ns)| *late_ns as f64 / 1e6).reduce(f64::max)
    }

    /// The figures.
    pub fn json(&self) -> Value {
        let max_ms = self.longest_ms(0, u64::MAX);
        json!({ "pauses_over_1_ms": self.shared.pauses().len(), "max_ms": max_ms })
    }
}

impl Drop for Pauses {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::{Pauses, Shared};
    use std::sync::Arc;

    #[test]
    fn a_pause_counts_for_what_it_overlaps() {
        let shared = Arc::new(Shared::default());
        shared.pauses().extend([(10_000_000, 4_000_000), (50_000_000, 2_000_000)]);
        let pauses = Pauses { shared };
        assert_eq!(pauses.longest_ms(7_000_000, 8_000_000), Some(4.0));
        assert_eq!(pauses.longest_ms(11_000_000, 47_000_000), None);
        assert_eq!(pauses.longest_ms(11_000_000, 49_000_000), Some(2.0));
        assert_eq!(pauses.json()["max_ms"], 4.0);
    }
}
