//! Frames of a camera whose library this process opens itself.
//!
//! The library is spoken to by a thread of its own; the wait loop writes each frame from the library's buffer straight
//! into shared memory: the only copy, and the pass that makes millimetres and takes out what is not trusted.

use camera::Trust;
use grabber::{Camera, Frame, Grabbed, Grabber, Trouble};
use messages::{DepthFrame, Pose3};
use settings::DepthSettings;
use transport::{FramePublisher, FromChild, Io, TransportError};

use crate::FrameSource;

/// Of [`Io::watch`].
const TOKEN_GRABBER: u64 = 0;

/// A camera by its library.
pub struct GrabbedFrames {
    grabber: Grabber<Box<dyn Frame>>,
    pixels_max: usize,
    robot_from_camera: Pose3,
    trust: Trust,
    /// Stamp of the last frame, nanoseconds of run time.
    last_ns: u64,
    /// The last thing told, which is not told again.
    told: String,
}

impl GrabbedFrames {
    /// Starts the thread, which opens the camera. One that is not there is no reason to end: without frames nothing
    /// moves, and the operator is told what is missing.
    ///
    /// # Errors
    /// Where there can be no thread.
    pub fn open(
        depth: &DepthSettings,
        io: &Io,
        open: impl FnMut() -> Result<Camera, Trouble> + Send + 'static,
    ) -> Result<Self, TransportError> {
        let grabber = Grabber::start(open).map_err(TransportError::service)?;
        io.watch(&grabber, TOKEN_GRABBER)?;
        Ok(Self {
            grabber,
            pixels_max: depth.width as usize * depth.height as usize,
            robot_from_camera: depth.robot_from_camera,
            trust: Trust::of_m(depth.range_m),
            last_ns: 0,
            told: String::new(),
        })
    }

    fn tell(&mut self, io: &Io, text: String) {
        if self.told != text {
            io.tell(&FromChild::Note { text: text.clone() });
            self.told = text;
        }
    }

    fn publish(
        &mut self,
        frame: &dyn Frame,
        io: &Io,
        frames: &mut FramePublisher<DepthFrame>,
    ) -> Result<(), TransportError> {
        let head = frame.head();
        let stamp_ns = io.domain.clock.of_monotonic_ns(head.taken_ns);
        if head.pixels() > self.pixels_max {
            let [width, height] = [head.width, head.height];
            let text = format!("a frame of {width} x {height} pixels is over depth.width x depth.height");
            self.tell(io, text);
            return Ok(());
        }
        if stamp_ns <= self.last_ns {
            self.tell(io, "a frame's time is not after that of the frame before: it is left out".to_owned());
            return Ok(());
        }
        let mut loan = frames.loan(head.pixels())?;
        *loan.meta_mut() = head.depth_header(self.robot_from_camera);
        if let Err(refused) = frame.raw().write_mm(&head, self.trust, loan.data_mut()) {
            self.tell(io, refused.to_string());
            return Ok(());
        }
        self.last_ns = stamp_ns;
        frames.publish(stamp_ns, loan).map(|_| ())
    }
}

impl FrameSource for GrabbedFrames {
    fn pixels_max(&self) -> usize {
        self.pixels_max
    }

    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    fn poll(&mut self, io: &mut Io, frames: &mut FramePublisher<DepthFrame>) -> Result<(), TransportError> {
        while let Some(grabbed) = self.grabber.take() {
            match grabbed {
                Grabbed::Opened(about) => self.tell(io, about),
                Grabbed::Item(frame) => self.publish(&*frame, io, frames)?,
                Grabbed::Lost(trouble) => self.tell(io, format!("no depth frames: {trouble}")),
            }
        }
        if self.grabber.is_stuck() {
            // Only a new process is rid of it.
            return Err(TransportError::Service("the camera's library hangs".to_owned()));
        }
        Ok(())
    }
}
