//! The depth driver: frames from a source, straight into shared memory.

mod cast;
mod grabbed;
mod simulated;
mod socket;

use grabber::gstreamer::GstCamera;
use grabber::realsense::RealsenseCamera;
use grabber::{Camera, Trouble};
use messages::DepthFrame;
use settings::{DepthDevice, PhysicsKind, Settings, Source};
use transport::{FramePublisher, Io, Service, TransportError};

pub use cast::CastDepth;
pub use grabbed::GrabbedFrames;
pub use simulated::SimulatedDepth;
pub use socket::FrameSocket;

/// Where frames come from: the simulated world, or a device.
pub trait FrameSource {
    /// The most pixels that a frame may have.
    fn pixels_max(&self) -> usize;

    /// Run time at which the source wants to be asked, nanoseconds.
    fn next_timer_ns(&self) -> Option<u64>;

    /// Publishes the frames that are complete, each written in place.
    ///
    /// # Errors
    /// Where the source is broken for good.
    fn poll(&mut self, io: &mut Io, frames: &mut FramePublisher<DepthFrame>) -> Result<(), TransportError>;
}

/// The service.
pub struct DepthDriver {
    source: Box<dyn FrameSource>,
    frames: FramePublisher<DepthFrame>,
}

impl DepthDriver {
    /// Opens the source that the settings name.
    ///
    /// # Errors
    /// Where source or port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let source: Box<dyn FrameSource> = match settings.depth.source {
            Source::Simulated => match settings.simulation.physics {
                PhysicsKind::Flat => Box::new(SimulatedDepth::open(&settings, io)?),
                PhysicsKind::Mujoco => Box::new(CastDepth::open(&settings, io)?),
            },
            Source::Device => device(&settings, io)?,
            Source::Replayed | Source::Absent => {
                return Err(TransportError::Service("depth.source names no source for this driver".to_owned()));
            }
        };
        let frames = io.frame_publisher(source.pixels_max())?;
        Ok(Self { source, frames })
    }
}

fn device(settings: &Settings, io: &Io) -> Result<Box<dyn FrameSource>, TransportError> {
    let (depth, theirs, live_only) = (&settings.depth, settings.depth.clone(), settings.commands_robot());
    Ok(match depth.device {
        DepthDevice::Socket => Box::new(FrameSocket::open(depth, io)?),
        DepthDevice::Gstreamer => {
            let open = move || -> Result<Camera, Trouble> { Ok(Box::new(GstCamera::open(&theirs, live_only)?)) };
            Box::new(GrabbedFrames::open(depth, io, open)?)
        }
        DepthDevice::Realsense => {
            let open = move || -> Result<Camera, Trouble> { Ok(Box::new(RealsenseCamera::open(&theirs)?)) };
            Box::new(GrabbedFrames::open(depth, io, open)?)
        }
    })
}

impl Service for DepthDriver {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.source.poll(io, &mut self.frames)
    }

    fn next_timer_ns(&self) -> Option<u64> {
        self.source.next_timer_ns()
    }
}
