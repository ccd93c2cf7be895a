//! The thread that speaks to a device's library (a camera's, a microphone's), and what it hands over.

use std::convert::Infallible;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TryRecvError, channel, sync_channel};
use std::time::Duration;

use rustix::event::{EventfdFlags, eventfd};
use transport::monotonic_ns;

use crate::Trouble;

/// What waits at most to be taken: whoever takes it is no slower than any device.
const WAITING_MAX: usize = 2;
/// A device that is silent for so long is opened anew, nanoseconds.
const SILENT_NS: u64 = 5_000_000_000;
/// A library that does not come back for so long will not, nanoseconds: GStreamer's first look at its plugins takes
/// several seconds on a small computer.
const STUCK_NS: u64 = 30_000_000_000;
/// First pause before a device is opened anew; it doubles with every failure in a row.
const BACK_OFF: Duration = Duration::from_millis(200);
/// The longest.
const BACK_OFF_MAX: Duration = Duration::from_secs(2);
/// So long the thread is waited for at the end: it looks up between two frames.
const END_LIMIT: Duration = Duration::from_millis(500);

/// What is open and gives one thing after another.
pub trait Grab {
    /// What it gives.
    type Item: Send + 'static;

    /// What was opened, for the operator.
    fn about(&self) -> String;

    /// The next one, where it comes within a tenth of a second or so.
    ///
    /// # Errors
    /// Where nothing more will come: it is to be opened anew.
    fn grab(&mut self) -> Result<Option<Self::Item>, Trouble>;

    /// Where it is silent for so long it is to be opened anew, nanoseconds; nothing where it may be silent.
    fn silent_limit_ns(&self) -> Option<u64> {
        Some(SILENT_NS)
    }

    /// Whether it is not opened anew once nothing more comes.
    fn ends_for_good(&self) -> bool {
        false
    }
}

impl<T: Send + 'static> Grab for Box<dyn Grab<Item = T>> {
    type Item = T;

    fn about(&self) -> String {
        (**self).about()
    }

    fn grab(&mut self) -> Result<Option<T>, Trouble> {
        (**self).grab()
    }

    fn silent_limit_ns(&self) -> Option<u64> {
        (**self).silent_limit_ns()
    }

    fn ends_for_good(&self) -> bool {
        (**self).ends_for_good()
    }
}

/// What the thread hands over.
#[derive(Debug, PartialEq, Eq)]
pub enum Grabbed<T> {
    /// It is open: what it is.
    Opened(String),
    /// What came.
    Item(T),
    /// It is lost, or could not be opened; it is tried again, but for what ends for good.
    Lost(Trouble),
}

/// A thread that opens, grabs, and opens anew for as long as this lives. Its descriptor is readable when there is
/// something to take.
#[derive(Debug)]
pub struct Grabber<T> {
    /// None only while this is dropped.
    grabbed: Option<Receiver<Grabbed<T>>>,
    wake: Arc<OwnedFd>,
    /// When the thread last was not in the library, nanoseconds.
    alive_ns: Arc<AtomicU64>,
    /// Closed to end the thread.
    on: Option<Sender<Infallible>>,
    /// Closed by the thread's end.
    ended: Receiver<Infallible>,
}

impl<T: Send + 'static> Grabber<T> {
    /// Starts the thread, in which everything of the library happens.
    ///
    /// # Errors
    /// Where there can be no thread.
    pub fn start<G: Grab<Item = T>>(
        open: impl FnMut() -> Result<G, Trouble> + Send + 'static,
    ) -> std::io::Result<Self> {
        let wake = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let alive_ns = Arc::new(AtomicU64::new(monotonic_ns()));
        let (post, grabbed) = sync_channel(WAITING_MAX);
        let (on, over) = channel();
        let (end, ended) = channel::<Infallible>();
        let work = Work { post, wake: Arc::clone(&wake), alive_ns: Arc::clone(&alive_ns), over, _end: end };
        std::thread::Builder::new().name("grabber".to_owned()).spawn(move || work.run(open))?;
        Ok(Self { grabbed: Some(grabbed), wake, alive_ns, on: Some(on), ended })
    }

    /// What was handed over, in its order.
    #[must_use]
    pub fn take(&self) -> Option<Grabbed<T>> {
        // What is posted after this wakes again.
        let _ = rustix::io::read(&*self.wake, &mut [0; 8]);
        self.grabbed.as_ref()?.try_recv().ok()
    }
}

impl<T> Grabber<T> {
    /// Whether the library hangs, and nothing more will come of this thread.
    #[must_use]
    pub fn is_stuck(&self) -> bool {
        let has_ended = self.ended.try_recv() == Err(TryRecvError::Disconnected);
        !has_ended && monotonic_ns().saturating_sub(self.alive_ns.load(Ordering::Relaxed)) > STUCK_NS
    }
}

impl<T> AsFd for Grabber<T> {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }
}

impl<T> Drop for Grabber<T> {
    fn drop(&mut self) {
        (self.on, self.grabbed) = (None, None);
        // Nothing is ever sent. A library that hangs is left to the process's end.
        let _ = self.ended.recv_timeout(END_LIMIT);
    }
}

/// The thread's own.
struct Work<T> {
    post: SyncSender<Grabbed<T>>,
    wake: Arc<OwnedFd>,
    alive_ns: Arc<AtomicU64>,
    over: Receiver<Infallible>,
    _end: Sender<Infallible>,
}

impl<T: Send + 'static> Work<T> {
    fn run<G: Grab<Item = T>>(self, mut open: impl FnMut() -> Result<G, Trouble>) {
        let mut back_off = BACK_OFF;
        while !self.is_over() {
            self.lives();
            let trouble = match open() {
                Ok(mut source) => {
                    self.hand_over(Grabbed::Opened(source.about()));
                    let (came, trouble) = self.grab_all(&mut source);
                    if let Some(trouble) = trouble.as_ref().filter(|_| source.ends_for_good()) {
                        return self.hand_over(Grabbed::Lost(trouble.clone()));
                    }
                    back_off = if came { BACK_OFF } else { back_off };
                    trouble
                }
                Err(trouble) => Some(trouble),
            };
            self.lives();
            let Some(trouble) = trouble else { return };
            self.hand_over(Grabbed::Lost(trouble));
            if self.over.recv_timeout(back_off) != Err(RecvTimeoutError::Timeout) {
                return;
            }
            back_off = (2 * back_off).min(BACK_OFF_MAX);
        }
    }

    /// Whether anything came, and why nothing more does; nothing where this is over.
    fn grab_all<G: Grab<Item = T>>(&self, source: &mut G) -> (bool, Option<Trouble>) {
        let (mut came, mut last_ns) = (false, monotonic_ns());
        while !self.is_over() {
            self.lives();
            match source.grab() {
                Ok(Some(item)) => {
                    self.hand_over(Grabbed::Item(item));
                    (came, last_ns) = (true, monotonic_ns());
                }
                Ok(None) => {
                    let Some(limit_ns) = source.silent_limit_ns() else { continue };
                    if monotonic_ns() - last_ns > limit_ns {
                        let found = format!("nothing came for {} s", limit_ns / 1_000_000_000);
                        return (came, Some(Trouble::new(found, "it is opened anew; is it plugged in?")));
                    }
                }
                Err(trouble) => return (came, Some(trouble)),
            }
        }
        (came, None)
    }

    fn lives(&self) {
        self.alive_ns.store(monotonic_ns(), Ordering::Relaxed);
    }

    fn is_over(&self) -> bool {
        self.over.try_recv() == Err(TryRecvError::Disconnected)
    }

    fn hand_over(&self, what: Grabbed<T>) {
        // Where nobody takes it any more, this is over.
        if self.post.send(what).is_ok() {
            let _ = rustix::io::write(&*self.wake, &1_u64.to_ne_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Grab, Grabbed, Grabber, STUCK_NS};
    use crate::Trouble;
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use std::sync::atomic::Ordering;
    use std::sync::mpsc::{Receiver, channel};

    /// Counts so far, and then is lost.
    struct Counts(u32, u32);

    impl Grab for Counts {
        type Item = u32;

        fn about(&self) -> String {
            "counts".to_owned()
        }

        fn grab(&mut self) -> Result<Option<u32>, Trouble> {
            self.0 += 1;
            if self.0 > self.1 { Err(Trouble::new("counted", "count again")) } else { Ok(Some(self.0)) }
        }
    }

    /// The next thing, once the descriptor says that there is one.
    fn next(grabber: &Grabber<u32>) -> Grabbed<u32> {
        loop {
            if let Some(grabbed) = grabber.take() {
                return grabbed;
            }
            let watchdog = Timespec { tv_sec: 60, tv_nsec: 0 };
            let woken = poll(&mut [PollFd::new(grabber, PollFlags::IN)], Some(&watchdog)).expect("it can be polled");
            assert!(woken == 1, "nothing came");
        }
    }

    #[test]
    fn what_is_lost_is_opened_anew() {
        let mut opened = 0;
        let grabber = Grabber::start(move || {
            opened += 1;
            if opened == 2 { Err(Trouble::new("not there", "wait")) } else { Ok(Counts(0, 3)) }
        });
        let grabber = grabber.expect("threads are left");
        let whole = || {
            assert_eq!(next(&grabber), Grabbed::Opened("counts".to_owned()));
            assert_eq!([1, 2, 3].map(|_| next(&grabber)), [1, 2, 3].map(Grabbed::Item));
            assert_eq!(next(&grabber), Grabbed::Lost(Trouble::new("counted", "count again")));
        };
        whole();
        assert_eq!(next(&grabber), Grabbed::Lost(Trouble::new("not there", "wait")));
        whole();
        assert!(!grabber.is_stuck());
    }

    /// Waits until it is told to go on.
    struct Waits(Receiver<()>);

    impl Grab for Waits {
        type Item = u32;

        fn about(&self) -> String {
            "waits".to_owned()
        }

        fn grab(&mut self) -> Result<Option<u32>, Trouble> {
            self.0.recv().map(|()| Some(7)).map_err(|_| Trouble::new("told no more", ""))
        }
    }

    #[test]
    fn a_library_that_hangs_does_not_keep_the_end_waiting() {
        let (tell, told) = channel();
        let mut told = Some(told);
        let open = move || told.take().map(Waits).ok_or_else(|| Trouble::new("only once", ""));
        let grabber = Grabber::start(open).expect("threads are left");
        assert_eq!(next(&grabber), Grabbed::Opened("waits".to_owned()));
        assert!(!grabber.is_stuck(), "it may still come back");
        grabber.alive_ns.fetch_sub(STUCK_NS, Ordering::Relaxed);
        assert!(grabber.is_stuck());
        // It is dropped while the thread waits for what comes only after.
        drop(grabber);
        drop(tell);
    }
}
