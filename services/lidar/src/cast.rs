//! A lidar in a simulated world whose simulator casts the rays.

use messages::WorldScan;
use settings::Settings;
use transport::{FrameSubscriber, Io, TransportError};
use world::LidarConfig;

use crate::{ScanPort, ScanSource};

/// Publishes the simulator's scans.
#[derive(Debug)]
pub struct CastLidar {
    beams: usize,
    cast: FrameSubscriber<WorldScan>,
}

impl CastLidar {
    /// Listens to the simulator.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let beams = LidarConfig::from(&settings.lidar).beams;
        Ok(Self { beams, cast: io.frame_subscriber()? })
    }
}

impl ScanSource for CastLidar {
    fn beams_max(&self) -> usize {
        self.beams
    }

    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    fn poll(&mut self, _io: &mut Io, scans: &mut ScanPort) -> Result<(), TransportError> {
        while let Some(cast) = self.cast.take()? {
            let (meta, data) = (cast.meta(), cast.data());
            scans.publish(meta.header.stamp_ns, data.len(), meta.scan, |ranges_m| ranges_m.copy_from_slice(data))?;
        }
        Ok(())
    }
}
