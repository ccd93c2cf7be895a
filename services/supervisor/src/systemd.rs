//! What systemd is told, where it started the run: that it is up, that it lives, that it ends.
//!
//! A thread of its own tells it: where nobody reads there, the supervisor does not wait.

use std::sync::mpsc::{SyncSender, sync_channel};

use sd_notify::NotifyState;
use transport::monotonic_ns;

/// Words that may wait to be told.
const ROOM: usize = 4;

/// A word to systemd.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Word {
    /// Everything has been up once.
    Ready,
    /// The supervisor's loop turns.
    Alive,
    /// The run ends.
    Stopping,
}

/// See the module.
#[derive(Debug, Default)]
pub struct Systemd {
    /// None where systemd did not start the run.
    words: Option<SyncSender<Word>>,
    /// From one sign of life to the next, nanoseconds; none where it wants none.
    period_ns: Option<u64>,
    next_ns: u64,
    ready: bool,
    stopping: bool,
}

impl Systemd {
    /// As the environment says.
    #[must_use]
    pub fn of_environment() -> Self {
        if std::env::var_os("NOTIFY_SOCKET").is_none() {
            return Self::default();
        }
        let (words, told) = sync_channel::<Word>(ROOM);
        let teller = std::thread::Builder::new().name("systemd".to_owned()).spawn(move || {
            for word in told {
                let state = match word {
                    Word::Ready => NotifyState::Ready,
                    Word::Alive => NotifyState::Watchdog,
                    Word::Stopping => NotifyState::Stopping,
                };
                // Where it does not listen, its own watchdog notices.
                let _ = sd_notify::notify(&[state]);
            }
        });
        // Half the time that it waits, as its manual wants.
        let period_ns = sd_notify::watchdog_enabled().map(|limit| limit.as_nanos() as u64 / 2);
        Self { words: teller.is_ok().then_some(words), period_ns, ..Self::default() }
    }

    /// Tells what is new, and that the loop turns.
    pub fn tick(&mut self, is_up: bool, ends: bool) {
        if is_up && !self.ready {
            self.ready = self.tell(Word::Ready);
        }
        if ends && !self.stopping {
            self.stopping = self.tell(Word::Stopping);
        }
        let now_ns = monotonic_ns();
        if let Some(period_ns) = self.period_ns.filter(|_| now_ns >= self.next_ns) {
            self.next_ns = now_ns + period_ns;
            self.tell(Word::Alive);
        }
    }

    /// Whether it will be told.
    fn tell(&self, word: Word) -> bool {
        self.words.as_ref().is_some_and(|words| words.try_send(word).is_ok())
    }
}
