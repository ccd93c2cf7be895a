//! The ways to command a robot. `locomotion` has a [`Link`]; `brake` has a [`BrakePath`] of its own, that shares
//! nothing with it.

mod null;
mod simulated;

use messages::Twist2;
use settings::LinkKind;
use transport::{Io, TransportError};

pub use null::{NullBrake, NullLink};
pub use simulated::{BRAKE_MESSAGE_LEN, BrakeMessage, SimulatedBrake, SimulatedLink};

/// A way to command a robot. No call blocks.
pub trait Link {
    /// Commands a velocity in the robot frame. The robot may keep it when nothing follows.
    ///
    /// # Errors
    /// Where the command cannot be handed to the robot.
    fn write(&mut self, velocity: Twist2) -> Result<(), TransportError>;

    /// The velocity that the robot reports, where it does; the newest.
    ///
    /// # Errors
    /// Where the robot's report cannot be read.
    fn measured(&mut self) -> Result<Option<Twist2>, TransportError>;
}

/// The brake's second way to the robot. No call blocks.
pub trait BrakePath {
    /// Commands zero, and that commands of locomotion's incarnations up to `fenced` are worth nothing.
    fn zero(&mut self, fenced: u32);
}

/// The link of that kind.
///
/// # Errors
/// Where it cannot be opened.
pub fn open_link(kind: LinkKind, io: &mut Io) -> Result<Box<dyn Link>, TransportError> {
    Ok(match kind {
        LinkKind::Simulated => Box::new(SimulatedLink::open(io)?),
        LinkKind::Null => Box::new(NullLink::default()),
    })
}

/// The brake's path of that kind.
///
/// # Errors
/// Where it cannot be opened.
pub fn open_brake_path(kind: LinkKind, io: &Io) -> Result<Box<dyn BrakePath>, TransportError> {
    Ok(match kind {
        LinkKind::Simulated => Box::new(SimulatedBrake::open(io)?),
        LinkKind::Null => Box::new(NullBrake),
    })
}
