//! The lidar driver: scans from a source, straight into shared memory.

mod cast;
mod deskew;
mod rplidar;
mod simulated;

use messages::LidarScan;
use settings::{LidarDevice, PhysicsKind, Settings, Source};
use transport::{FramePublisher, Io, Service, TransportError};

pub use cast::CastLidar;
pub use rplidar::RplidarSource;
pub use simulated::SimulatedLidar;

/// Where scans come from: the simulated world, or a device.
pub trait ScanSource {
    /// The most beams that a scan may have.
    fn beams_max(&self) -> usize;

    /// Run time at which the source wants to be asked, nanoseconds.
    fn next_timer_ns(&self) -> Option<u64>;

    /// Publishes the scans that are complete, each written in place and stamped with its last beam.
    ///
    /// # Errors
    /// Where the source is broken for good.
    fn poll(&mut self, io: &mut Io, scans: &mut FramePublisher<LidarScan>) -> Result<(), TransportError>;

    /// Leaves the device as it is to be found.
    fn leave(&mut self) {}
}

/// The service.
pub struct LidarDriver {
    source: Box<dyn ScanSource>,
    scans: FramePublisher<LidarScan>,
}

impl LidarDriver {
    /// Opens the source that the settings name.
    ///
    /// # Errors
    /// Where source or port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let source: Box<dyn ScanSource> = match settings.lidar.source {
            Source::Simulated => match settings.simulation.physics {
                PhysicsKind::Flat => Box::new(SimulatedLidar::open(&settings, io)?),
                PhysicsKind::Mujoco => Box::new(CastLidar::open(&settings, io)?),
            },
            Source::Device => device(&settings, io)?,
            Source::Replayed | Source::Absent => {
                return Err(TransportError::Service("lidar.source names no source for this driver".to_owned()));
            }
        };
        let scans = io.frame_publisher(source.beams_max())?;
        Ok(Self { source, scans })
    }
}

fn device(settings: &Settings, io: &mut Io) -> Result<Box<dyn ScanSource>, TransportError> {
    Ok(match settings.lidar.device {
        LidarDevice::Rplidar => Box::new(RplidarSource::open(&settings.lidar, io)?),
    })
}

impl Service for LidarDriver {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.source.poll(io, &mut self.scans)
    }

    fn next_timer_ns(&self) -> Option<u64> {
        self.source.next_timer_ns()
    }

    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        self.source.leave();
        Ok(())
    }
}
