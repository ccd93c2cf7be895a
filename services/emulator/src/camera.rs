//! The emulated camera's own thread: a frame takes several milliseconds, for which neither lidar nor robot waits.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use emulators::EmulatedCamera;
use messages::{DepthHeader, Fault, WorldTruth};
use transport::{Rhythm, TransportError, monotonic_ns};
use world::{Scene, World};

/// The thread looks up at least so often: frames may be on their way.
const LOOK_UP: Duration = Duration::from_millis(10);

/// What the camera sees.
#[derive(Debug)]
pub enum Seen {
    /// The flat world, of which it takes a frame where it is time to.
    Truth(Box<WorldTruth>),
    /// A frame that was cast for it.
    Frame {
        /// The camera's lens.
        lens: DepthHeader,
        /// Depths, row by row, millimetres.
        pixels_mm: Vec<u16>,
        /// Run time at which it was taken, nanoseconds.
        stamp_ns: u64,
    },
}

/// What the camera is to know.
#[derive(Debug, Default)]
struct News {
    seen: Option<Seen>,
    fault: Option<Fault>,
    over: bool,
}

/// A camera that takes frames until it is dropped.
#[derive(Debug)]
pub struct CameraThread(Arc<(Mutex<News>, Condvar)>);

impl CameraThread {
    /// Begins. Where the camera sees truths of a flat world, `world` is that one. `started_ns` is when the run began,
    /// on the monotonic clock.
    ///
    /// # Errors
    /// Where there can be no thread.
    pub fn begin(
        mut camera: EmulatedCamera,
        mut world: Option<World>,
        rate_hz: f64,
        started_ns: u64,
    ) -> Result<Self, TransportError> {
        let shared = Arc::new((Mutex::new(News::default()), Condvar::new()));
        let thread = Self(Arc::clone(&shared));
        let mut rhythm = Rhythm::at_hz(rate_hz);
        let work = move || {
            let (news, changed) = &*shared;
            loop {
                let waiting = changed.wait_timeout(lock(news), LOOK_UP);
                let (mut guard, _) = waiting.unwrap_or_else(PoisonError::into_inner);
                let (seen, fault, over) = (guard.seen.take(), guard.fault, guard.over);
                drop(guard);
                if over {
                    return;
                }
                camera.suffer(fault);
                match (seen, &mut world) {
                    (Some(Seen::Truth(truth)), Some(world)) => {
                        if let Some(number) = rhythm.due(truth.header.stamp_ns) {
                            camera.take(&Scene::from_truth(world, &truth), number, started_ns + truth.header.stamp_ns);
                        }
                    }
                    (Some(Seen::Frame { lens, pixels_mm, stamp_ns }), _) => {
                        camera.take_seen(&lens, &pixels_mm, started_ns + stamp_ns);
                    }
                    _ => {}
                }
                camera.serve(monotonic_ns());
            }
        };
        std::thread::Builder::new().name("camera".to_owned()).spawn(work).map_err(TransportError::service)?;
        Ok(thread)
    }

    /// The world has gone on. What it has not come to before is left out.
    pub fn see(&self, seen: Seen) {
        lock(&self.0.0).seen = Some(seen);
        self.0.1.notify_one();
    }

    /// That goes wrong with it now.
    pub fn suffer(&self, fault: Option<Fault>) {
        lock(&self.0.0).fault = fault;
    }
}

impl Drop for CameraThread {
    fn drop(&mut self) {
        lock(&self.0.0).over = true;
        self.0.1.notify_one();
    }
}

fn lock(news: &Mutex<News>) -> MutexGuard<'_, News> {
    news.lock().unwrap_or_else(PoisonError::into_inner)
}
