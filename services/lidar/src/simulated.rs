//! A lidar in the simulated world.

use messages::{ServiceId, WorldTruth};
use settings::{LidarSettings, Settings};
use transport::{Io, Rhythm, Subscriber, TransportError};
use world::{LidarConfig, LidarSensor, Scene, World};

use crate::{ScanPort, ScanSource};

/// Looks at the world from where the robot truly is.
#[derive(Debug)]
pub struct SimulatedLidar {
    world: World,
    sensor: LidarSensor,
    truths: Subscriber<WorldTruth>,
    truth: Option<WorldTruth>,
    rhythm: Rhythm,
}

impl SimulatedLidar {
    /// Reads the run's world.
    ///
    /// # Errors
    /// Where world or topic cannot be opened.
    pub fn open(settings: &Settings, lidar: &LidarSettings, io: &mut Io) -> Result<Self, TransportError> {
        let world = world::scenario_of(settings).and_then(|s| s.load_world()).map_err(TransportError::service)?;
        let config = LidarConfig::from(lidar);
        // Two lidars do not have the same noise.
        let seed = settings.simulation.seed ^ u64::from(io.identity().service == ServiceId::SecondLidar) << 32;
        let sensor = LidarSensor::new(config, seed, io.identity().incarnation).map_err(TransportError::service)?;
        Ok(Self {
            world,
            sensor,
            truths: io.quiet_subscriber()?,
            truth: None,
            rhythm: Rhythm::at_hz(lidar.rate_hz.get()),
        })
    }
}

impl ScanSource for SimulatedLidar {
    fn beams_max(&self) -> usize {
        self.sensor.config().beams
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.rhythm.next_ns())
    }

    fn poll(&mut self, io: &mut Io, scans: &mut ScanPort) -> Result<(), TransportError> {
        if let Some(truth) = self.truths.take_newest()? {
            self.truth = Some(truth);
        }
        let Some(number) = self.rhythm.due(io.now_ns()) else { return Ok(()) };
        // Without news from the world there is nothing to measure.
        let Some(truth) = self.truth.take() else { return Ok(()) };
        let (beams, header) = (self.beams_max(), self.sensor.scan_header());
        let scene = Scene::from_truth(&mut self.world, &truth);
        scans.publish(truth.header.stamp_ns, beams, header, |ranges_m| {
            self.sensor.scan(&scene, number, ranges_m);
        })
    }
}
