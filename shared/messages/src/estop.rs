//! The emergency stop's word.

use crate::Header;
use crate::json::{mirrored, named};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// What is known of the emergency stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/StopInput/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum StopInput {
    /// Nothing yet: nothing moves.
    #[default]
    Unknown = 0,
    /// It lets the robot move.
    Released,
    /// Somebody stops the robot; or, with a dead man's switch, nobody holds it.
    Pressed,
    /// It is unplugged or silent, which stops the robot as well.
    Lost,
}

named!(StopInput);

impl StopInput {
    /// Whether it has to be reset by the operator before anything moves again.
    #[must_use]
    pub const fn stops(self) -> bool {
        matches!(self, Self::Pressed | Self::Lost)
    }

    /// The name, as in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Released => "released",
            Self::Pressed => "pressed",
            Self::Lost => "lost",
        }
    }
}

mirrored! {
    /// Whether the emergency stop lets the robot move: something that has to keep arriving.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/EmergencyStop/1"))]
    #[repr(C)]
    pub struct EmergencyStop {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// What is known of it.
        pub input: StopInput,
    }
}
