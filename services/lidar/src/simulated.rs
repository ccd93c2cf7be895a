//! A lidar in the simulated world.

use messages::{LidarScan, WorldTruth};
use settings::Settings;
use transport::{FramePublisher, Io, Subscriber, TransportError};
use world::{LidarConfig, LidarSensor, Scene, World};

use crate::ScanSource;

/// Looks at the world from where the robot truly is.
#[derive(Debug)]
pub struct SimulatedLidar {
    world: World,
    sensor: LidarSensor,
    truths: Subscriber<WorldTruth>,
    truth: Option<WorldTruth>,
    period_ns: u64,
    /// Scans are due at whole periods of run time, so that a restarted driver keeps the rhythm.
    next_ns: u64,
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
        let period_ns = (1e9 / settings.lidar.rate_hz.get()) as u64;
        Ok(Self { world, sensor, truths: io.quiet_subscriber()?, truth: None, period_ns, next_ns: 0 })
    }
}

impl ScanSource for SimulatedLidar {
    fn beams_max(&self) -> usize {
        self.sensor.config().beams
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn poll(&mut self, now_ns: u64, scans: &mut FramePublisher<LidarScan>) -> Result<(), TransportError> {
        if let Some(truth) = self.truths.take_newest()? {
            self.truth = Some(truth);
        }
        if now_ns < self.next_ns {
            return Ok(());
        }
        self.next_ns = (now_ns / self.period_ns + 1) * self.period_ns;
        // Without news from the world there is nothing to measure.
        let Some(truth) = self.truth.take() else { return Ok(()) };
        let mut loan = scans.loan(self.beams_max())?;
        *loan.meta_mut() = self.sensor.scan_header();
        let frame = now_ns / self.period_ns;
        self.sensor.scan(&Scene::from_truth(&self.world, &truth), frame, loan.data_mut());
        scans.publish(truth.header.stamp_ns, loan).map(|_| ())
    }
}
