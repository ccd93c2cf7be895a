//! A lidar in a simulated world whose simulator casts the rays.

use messages::{LidarScan, WorldScan};
use settings::Settings;
use transport::{FramePublisher, FrameSubscriber, Io, TransportError};
use world::LidarConfig;

use crate::ScanSource;

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

    fn poll(&mut self, _io: &mut Io, scans: &mut FramePublisher<LidarScan>) -> Result<(), TransportError> {
        while let Some(cast) = self.cast.take()? {
            let (meta, data) = (cast.meta(), cast.data());
            let mut loan = scans.loan(data.len())?;
            *loan.meta_mut() = meta.scan;
            loan.data_mut().copy_from_slice(data);
            scans.publish(meta.header.stamp_ns, loan)?;
        }
        Ok(())
    }
}
