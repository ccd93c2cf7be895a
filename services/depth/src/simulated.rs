//! A depth camera in the simulated world, rendered straight into shared memory.

use messages::{DepthFrame, WorldTruth};
use settings::Settings;
use transport::{FramePublisher, Io, Rhythm, Subscriber, TransportError};
use world::{DepthConfig, DepthSensor, Scene, World};

use crate::FrameSource;

/// Looks at the world from where the robot truly is.
#[derive(Debug)]
pub struct SimulatedDepth {
    world: World,
    sensor: DepthSensor,
    truths: Subscriber<WorldTruth>,
    truth: Option<WorldTruth>,
    rhythm: Rhythm,
}

impl SimulatedDepth {
    /// Reads the run's world.
    ///
    /// # Errors
    /// Where world or topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let world = world::scenario_of(settings).and_then(|s| s.load_world()).map_err(TransportError::service)?;
        let config = DepthConfig::from(&settings.depth);
        let sensor = DepthSensor::new(config, settings.simulation.seed, io.identity().incarnation)
            .map_err(TransportError::service)?;
        Ok(Self {
            world,
            sensor,
            truths: io.quiet_subscriber()?,
            truth: None,
            rhythm: Rhythm::at_hz(settings.depth.rate_hz.get()),
        })
    }
}

impl FrameSource for SimulatedDepth {
    fn pixels_max(&self) -> usize {
        self.sensor.pixels()
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.rhythm.next_ns())
    }

    fn poll(&mut self, io: &mut Io, frames: &mut FramePublisher<DepthFrame>) -> Result<(), TransportError> {
        if let Some(truth) = self.truths.take_newest()? {
            self.truth = Some(truth);
        }
        let Some(number) = self.rhythm.due(io.now_ns()) else { return Ok(()) };
        // Without news from the world there is nothing to measure.
        let Some(truth) = self.truth.take() else { return Ok(()) };
        let mut loan = frames.loan(self.pixels_max())?;
        *loan.meta_mut() = self.sensor.depth_header();
        self.sensor.render(&Scene::from_truth(&mut self.world, &truth), number, loan.data_mut());
        frames.publish(truth.header.stamp_ns, loan).map(|_| ())
    }
}
