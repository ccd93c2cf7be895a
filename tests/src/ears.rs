//! What the robot says in a live run, as it is published.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use messages::{SpeechPhase, SpeechSaid};
use transport::{Domain, Io, RunDir, Service, Subscriber, TransportError, run_tool};

use crate::until_or;

/// Listens to a live run until it is told to stop, or the run ends.
#[derive(Debug)]
pub struct Ears {
    said: Arc<Mutex<Vec<SpeechSaid>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), TransportError>>>,
}

impl Ears {
    /// Listens to the run in that directory from now on.
    #[must_use]
    pub fn on(dir: PathBuf) -> Self {
        let (said, stop) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
        let (log, over) = (Arc::clone(&said), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            let domain = Domain::open(RunDir::open(&dir), "ears")?;
            run_tool(domain, |io: &mut Io| Ok(Listener { port: io.subscriber()?, said: log, stop: over, next_ns: 0 }))
                .map(|_| ())
        });
        Self { said, stop, thread: Some(thread) }
    }

    /// Everything that was published.
    #[must_use]
    pub fn said(&self) -> Vec<SpeechSaid> {
        self.said.lock().expect("the listener does not panic").clone()
    }

    /// The sentences that were begun, or were not heard at all, in their order.
    #[must_use]
    pub fn texts(&self) -> Vec<String> {
        let begun = |said: &SpeechSaid| said.phase == SpeechPhase::Begun || said.first_sample_ns == 0;
        self.said().into_iter().filter(begun).map(|said| said.text.as_str().to_owned()).collect()
    }

    /// Waits until that sentence was begun so many times.
    pub fn wait(&self, text: &str, times: usize) {
        let count = || self.texts().iter().filter(|said| *said == text).count();
        until_or(|| format!("{times} times: {text} Heard: {:?}", self.texts()), || count() >= times);
    }

    /// Listens no longer: everything that was published.
    #[must_use]
    pub fn stop(mut self) -> Vec<SpeechSaid> {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().expect("the listener does not panic").expect("the run could be listened to");
        }
        self.said()
    }
}

struct Listener {
    port: Subscriber<SpeechSaid>,
    said: Arc<Mutex<Vec<SpeechSaid>>>,
    stop: Arc<AtomicBool>,
    next_ns: u64,
}

impl Service for Listener {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.next_ns = io.now_ns() + 20_000_000;
        while let Some(said) = self.port.take()? {
            self.said.lock().expect("nobody panics with it").push(said);
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
