//! Somebody who speaks: near-silence, and what is said into it, into whatever takes samples.

use std::collections::VecDeque;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use control::Status;

use crate::spoken::{RATE_HZ, spoken, spoken_by};
use crate::{Live, WATCHDOG, until};

/// 20 ms.
const PIECE: usize = RATE_HZ as usize / 50;
/// Nobody says it again before.
const AGAIN: Duration = Duration::from_secs(4);

/// Speaks for as long as it lives.
#[derive(Debug)]
pub struct Mouth {
    said: Arc<Mutex<VecDeque<i16>>>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Mouth {
    /// One whose samples go there, as they would come from a microphone. It is silent where nobody takes them any more.
    #[must_use]
    pub fn into(mut to: impl Write + Send + 'static) -> Self {
        let (said, over) = (Arc::new(Mutex::new(VecDeque::new())), Arc::new(AtomicBool::new(false)));
        let (queue, end) = (Arc::clone(&said), Arc::clone(&over));
        let thread = std::thread::spawn(move || {
            let (begun, mut sent, mut state) = (Instant::now(), 0_u32, 1_u32);
            while !end.load(Ordering::Relaxed) {
                let mut piece = Vec::with_capacity(2 * PIECE);
                for _ in 0..PIECE {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let hiss = (state >> 28) as i16 - 8;
                    let sample: i16 = queue.lock().expect("nobody panics with it").pop_front().unwrap_or(0);
                    piece.extend(sample.saturating_add(hiss).to_le_bytes());
                }
                if to.write_all(&piece).and_then(|()| to.flush()).is_err() {
                    return;
                }
                sent += 1;
                std::thread::sleep((Duration::from_millis(20) * sent).saturating_sub(begun.elapsed()));
            }
        });
        Self { said, over, thread: Some(thread) }
    }

    /// Says nothing for so long, seconds.
    pub fn wait(&self, s: f64) {
        let silence = std::iter::repeat_n(0, (s * f64::from(RATE_HZ)) as usize);
        self.said.lock().expect("nobody panics with it").extend(silence);
    }

    /// Waits until all of it was said, and heard.
    pub fn wait_until_said(&self) {
        until("all is said", || self.said.lock().expect("nobody panics with it").is_empty());
        std::thread::sleep(Duration::from_secs(1));
    }

    /// Says a word as one of espeak-ng's voices does.
    pub fn say_by(&self, voice: &str, word: &str) {
        self.said.lock().expect("nobody panics with it").extend(spoken_by(voice, "150", word));
    }

    /// Says a word.
    pub fn say(&self, word: &str) {
        self.said.lock().expect("nobody panics with it").extend(spoken(word));
    }

    /// Says a word until it is in force: on a busy machine a fault may come between. The status in which it is.
    pub fn say_until(&self, run: &mut Live<'_>, word: &str, wanted: impl Fn(&Status) -> bool) -> Status {
        let (begun, mut said) = (Instant::now(), None::<Instant>);
        loop {
            let status = run.status();
            if wanted(&status) {
                return status;
            }
            if said.is_none_or(|at| at.elapsed() > AGAIN) {
                self.say(word);
                said = Some(Instant::now());
            }
            assert!(begun.elapsed() < WATCHDOG, "\"{word}\" was never heard: {status:#?}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Mouth {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
