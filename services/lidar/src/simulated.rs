//! A lidar in the simulated world.

use messages::{LidarScan, WorldTruth};
use settings::Settings;
use transport::{FramePublisher, Io, Rhythm, Subscriber, TransportError};
use world::{LidarConfig, LidarSensor, Scene, World};

use crate::ScanSource;

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
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let world = world::scenario_of(settings).and_then(|s| s.load_world()).map_err(TransportError::service)?;
        let config = LidarConfig::from(&settings.lidar);
        let sensor = LidarSensor::new(config, settings.simulation.seed, io.identity().incarnation)
            .map_err(TransportError::service)?;
        Ok(Self {
            world,
            sensor,
            truths: io.quiet_subscriber()?,
            truth: None,
            rhythm: Rhythm::at_hz(settings.lidar.rate_hz.get()),
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

    fn poll(&mut self, io: &mut Io, scans: &mut FramePublisher<LidarScan>) -> Result<(), TransportError> {
        if let Some(truth) = self.truths.take_newest()? {
            self.truth = Some(truth);
        }
        let Some(number) = self.rhythm.due(io.now_ns()) else { return Ok(()) };
        // Without news from the world there is nothing to measure.
        let Some(truth) = self.truth.take() else { return Ok(()) };
        let mut loan = scans.loan(self.beams_max())?;
        *loan.meta_mut() = self.sensor.scan_header();
        self.sensor.scan(&Scene::from_truth(&self.world, &truth), number, loan.data_mut());
        scans.publish(truth.header.stamp_ns, loan).map(|_| ())
    }
}
