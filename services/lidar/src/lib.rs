//! The lidar driver: scans from a source, straight into shared memory.

mod cast;
mod deskew;
mod port;
mod rplidar;
mod simulated;

use settings::{LidarDevice, LidarSettings, PhysicsKind, Settings, Source};
use transport::{Io, Service, TransportError};

pub use cast::CastLidar;
pub use port::ScanPort;
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
    fn poll(&mut self, io: &mut Io, scans: &mut ScanPort) -> Result<(), TransportError>;

    /// Leaves the device as it is to be found.
    fn leave(&mut self) {}
}

/// The service.
pub struct LidarDriver {
    source: Box<dyn ScanSource>,
    scans: ScanPort,
}

impl LidarDriver {
    /// Opens the source that the settings name.
    ///
    /// # Errors
    /// Where source or port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = load(io)?;
        let source = match (settings.lidar.source, settings.simulation.physics) {
            (Source::Simulated, PhysicsKind::Mujoco) => Box::new(CastLidar::open(&settings, io)?),
            _ => source(&settings, &settings.lidar, "lidar", io)?,
        };
        let scans = ScanPort::first(io, source.beams_max())?;
        Ok(Self { source, scans })
    }

    /// Opens the source of the second lidar.
    ///
    /// # Errors
    /// As [`Self::open`], or where there is no second lidar.
    pub fn open_second(io: &mut Io) -> Result<Self, TransportError> {
        let settings = load(io)?;
        let none = || TransportError::service("there is no [lidar.second]");
        let second = settings.lidar.second.as_deref().ok_or_else(none)?;
        let source = source(&settings, second, "lidar.second", io)?;
        let scans = ScanPort::second(io, source.beams_max(), second.pitch_deg.to_radians())?;
        Ok(Self { source, scans })
    }
}

fn load(io: &Io) -> Result<Settings, TransportError> {
    settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)
}

fn source(
    settings: &Settings,
    lidar: &LidarSettings,
    key: &str,
    io: &mut Io,
) -> Result<Box<dyn ScanSource>, TransportError> {
    Ok(match lidar.source {
        Source::Simulated => Box::new(SimulatedLidar::open(settings, lidar, io)?),
        Source::Device => match lidar.device {
            LidarDevice::Rplidar => Box::new(RplidarSource::open(lidar, io)?),
        },
        Source::Replayed | Source::Absent => {
            return Err(TransportError::Service(format!("{key}.source names no source for this driver")));
        }
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
