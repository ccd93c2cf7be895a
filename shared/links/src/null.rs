//! No robot: for replayed frames. It holds the last command, as a real robot may.

use messages::Twist2;
use transport::TransportError;

use crate::{BrakePath, Link, RobotReport};

/// Takes commands and does nothing; reports the last one as the robot's velocity.
#[derive(Debug, Default)]
pub struct NullLink {
    last: Twist2,
}

impl Link for NullLink {
    fn write(&mut self, velocity: Twist2, _for_ns: u64) -> Result<(), TransportError> {
        self.last = velocity;
        Ok(())
    }

    fn report(&mut self) -> Result<RobotReport, TransportError> {
        Ok(RobotReport { velocity: Some(self.last), ..RobotReport::default() })
    }
}

/// There is nothing to brake.
#[derive(Debug)]
pub struct NullBrake;

impl BrakePath for NullBrake {
    fn zero(&mut self, _fenced: u32) {}
}
