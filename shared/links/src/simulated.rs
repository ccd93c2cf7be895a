//! The simulated robot: `world/command` for locomotion, a datagram socket of its own for the brake.

use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;

use messages::{RobotCommand, ServiceId, Twist2, WorldTruth};
use transport::{Io, Publisher, Subscriber, TransportError};

use crate::{BrakePath, Link, RobotReport};

/// Commands the simulated robot over shared memory.
#[derive(Debug)]
pub struct SimulatedLink {
    commands: Publisher<RobotCommand>,
    truth: Subscriber<WorldTruth>,
    clock: std::rc::Rc<transport::Clock>,
    measured: Option<Twist2>,
}

impl SimulatedLink {
    /// Opens the link.
    ///
    /// # Errors
    /// Where its topics cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        Ok(Self {
            commands: io.publisher()?,
            truth: io.quiet_subscriber()?,
            clock: std::rc::Rc::clone(&io.domain.clock),
            measured: None,
        })
    }
}

impl Link for SimulatedLink {
    fn write(&mut self, velocity: Twist2, _for_ns: u64) -> Result<(), TransportError> {
        let command = RobotCommand { source: ServiceId::Locomotion, velocity, ..RobotCommand::default() };
        self.commands.publish(self.clock.now_ns(), command).map(|_| ())
    }

    fn report(&mut self) -> Result<RobotReport, TransportError> {
        if let Some(truth) = self.truth.take_newest()? {
            self.measured = Some(truth.robot_twist);
        }
        Ok(RobotReport { velocity: self.measured, ..RobotReport::default() })
    }
}

/// Length of a [`BrakeMessage`] on the wire.
pub const BRAKE_MESSAGE_LEN: usize = 8;

/// What the brake tells the simulated robot: stand, and obey no locomotion up to that incarnation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrakeMessage {
    /// The last incarnation of locomotion that is fenced.
    pub fenced: u32,
}

impl BrakeMessage {
    const MAGIC: [u8; 4] = *b"GDB0";

    /// The message on the wire.
    #[must_use]
    pub fn encode(self) -> [u8; BRAKE_MESSAGE_LEN] {
        let mut bytes = [0; BRAKE_MESSAGE_LEN];
        bytes[..4].copy_from_slice(&Self::MAGIC);
        bytes[4..].copy_from_slice(&self.fenced.to_le_bytes());
        bytes
    }

    /// The message, if the bytes are one.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let (magic, fenced) = bytes.split_first_chunk::<4>()?;
        (*magic == Self::MAGIC).then_some(())?;
        Some(Self { fenced: u32::from_le_bytes(fenced.try_into().ok()?) })
    }
}

/// Stops the simulated robot over a socket that has nothing to do with shared memory.
#[derive(Debug)]
pub struct SimulatedBrake {
    socket: UnixDatagram,
    robot: PathBuf,
}

impl SimulatedBrake {
    /// Opens the path.
    ///
    /// # Errors
    /// Where no socket can be had.
    pub fn open(io: &Io) -> Result<Self, TransportError> {
        let socket = UnixDatagram::unbound().map_err(TransportError::service)?;
        socket.set_nonblocking(true).map_err(TransportError::service)?;
        Ok(Self { socket, robot: io.domain.dir.robot_socket() })
    }
}

impl BrakePath for SimulatedBrake {
    fn zero(&mut self, fenced: u32) {
        // Sent again 20 ms later: there is nothing better to do where the robot does not listen.
        let _ = self.socket.send_to(&BrakeMessage { fenced }.encode(), &self.robot);
    }
}

#[cfg(test)]
mod tests {
    use super::BrakeMessage;

    #[test]
    fn only_a_brake_message_is_one() {
        let message = BrakeMessage { fenced: 7 };
        assert_eq!(BrakeMessage::decode(&message.encode()), Some(message));
        assert_eq!(BrakeMessage::decode(b"GDB0"), None);
        assert_eq!(BrakeMessage::decode(b"XXXX\x01\0\0\0"), None);
    }
}
