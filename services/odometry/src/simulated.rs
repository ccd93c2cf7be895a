//! Odometry in the simulated world, with drift.

use messages::{Odometry, WorldTruth};
use settings::Settings;
use transport::{Io, Rhythm, Subscriber, TransportError};
use world::{OdometryConfig, OdometrySensor};

use crate::PoseSource;

/// Adds up the robot's true motion, with errors.
#[derive(Debug)]
pub struct SimulatedOdometry {
    sensor: OdometrySensor,
    truths: Subscriber<WorldTruth>,
    newest: Option<(u64, Odometry)>,
    rhythm: Rhythm,
}

impl SimulatedOdometry {
    /// Odometry of this incarnation.
    ///
    /// # Errors
    /// Where its settings are out of bounds or the topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let config = OdometryConfig::from(&settings.odometry);
        let sensor = OdometrySensor::new(config, settings.simulation.seed, io.identity().incarnation)
            .map_err(TransportError::service)?;
        let rhythm = Rhythm::at_hz(settings.odometry.rate_hz.get());
        Ok(Self { sensor, truths: io.quiet_subscriber()?, newest: None, rhythm })
    }
}

impl PoseSource for SimulatedOdometry {
    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.rhythm.next_ns())
    }

    fn poll(&mut self, io: &Io) -> Result<Option<(u64, Odometry)>, TransportError> {
        while let Some(truth) = self.truths.take()? {
            let reading = self.sensor.update(truth.header.seq, truth.world_from_robot, truth.robot_twist);
            let pose = Odometry {
                odom_from_robot: reading.odom_from_robot,
                twist: reading.twist,
                sigma: reading.sigma,
                attitude: self.sensor.attitude(truth.header.seq, &truth.attitude),
                ..Odometry::default()
            };
            self.newest = Some((truth.header.stamp_ns, pose));
        }
        Ok(self.rhythm.due(io.now_ns()).and_then(|_| self.newest.take()))
    }
}
