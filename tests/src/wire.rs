//! What two streams of a live run are like, message by message, as they come: also those that no reader would take.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use messages::{LidarScan, Odometry, ScanHeader, WorldTruth};
use transport::{Domain, FrameSubscriber, Io, RunDir, Service, Subscriber, TransportError, run_tool};

use crate::WATCHDOG;

/// Everything that came since it was last cleared.
#[derive(Debug, Default)]
pub struct Came {
    /// Poses, each with the run time at which it came, nanoseconds.
    pub poses: Vec<(u64, Odometry)>,
    /// Scans likewise, with their ranges.
    pub scans: Vec<(u64, ScanHeader, Vec<f32>)>,
    /// The newest truth.
    pub truth: WorldTruth,
}

/// Listens to a live run until it is told to stop.
#[derive(Debug)]
pub struct Wire {
    came: Arc<Mutex<Came>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), TransportError>>>,
}

impl Wire {
    /// Listens to the run in that directory, whose streams are well, from now on.
    #[must_use]
    pub fn on(dir: PathBuf) -> Self {
        let (came, stop) = (Arc::new(Mutex::new(Came::default())), Arc::new(AtomicBool::new(false)));
        let (log, over) = (Arc::clone(&came), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            let domain = Domain::open(RunDir::open(&dir), "wire")?;
            let open = |io: &mut Io| {
                let (poses, scans, truths) = (io.subscriber()?, io.frame_subscriber()?, io.subscriber()?);
                Ok(Listener { poses, scans, truths, came: log, stop: over, next_ns: 0 })
            };
            run_tool(domain, open).map(|_| ())
        });
        let wire = Self { came, stop, thread: Some(thread) };
        wire.wait("poses and scans come", |came| !came.poses.is_empty() && !came.scans.is_empty());
        wire
    }

    /// Forgets what came.
    pub fn clear(&self) {
        let mut came = self.came.lock().expect("the listener does not panic");
        came.poses.clear();
        came.scans.clear();
    }

    /// Waits until what came since it was last cleared is as wanted.
    pub fn wait(&self, what: &str, wanted: impl Fn(&Came) -> bool) {
        let since = Instant::now();
        while !wanted(&self.came.lock().expect("the listener does not panic")) {
            assert!(since.elapsed() < WATCHDOG, "never: {what}");
            assert!(self.thread.as_ref().is_some_and(|thread| !thread.is_finished()), "the listener ended: {what}");
            std::thread::sleep(Duration::from_millis(5));
        }
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
    poses: Subscriber<Odometry>,
    scans: FrameSubscriber<LidarScan>,
    truths: Subscriber<WorldTruth>,
    came: Arc<Mutex<Came>>,
    stop: Arc<AtomicBool>,
    next_ns: u64,
}

impl Service for Listener {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now_ns = io.now_ns();
        self.next_ns = now_ns + 20_000_000;
        let mut came = self.came.lock().expect("nobody panics with it");
        while let Some(pose) = self.poses.take_at_once()? {
            came.poses.push((now_ns, pose));
        }
        while let Some(scan) = self.scans.take()? {
            came.scans.push((now_ns, *scan.meta(), scan.data().to_vec()));
        }
        if let Some(truth) = self.truths.take_newest()? {
            came.truth = truth;
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
