//! What Unitree's robots and who commands them say to each other over UDP in high-level mode: pure, without a socket
//! and without a clock.
//!
//! After the layouts of Unitree's own libraries (`unitree_legged_sdk` 3.8.4 for the AlienGo, 3.3.1 for the AlienGo
//! before it, 3.8 for the Go1). Both ways of everything are here, because the emulated robot speaks the same language
//! as the link; what keeps them honest are bytes that the makers' libraries gave, and those libraries themselves.

mod command;
mod crc;
mod driver;
mod emulated;
mod profile;
mod remote;
mod state;

pub use command::{Command, Gait, Mode};
pub use driver::{DEAD_MAN_NS, Driver, STATE_MAX_AGE_NS};
pub use emulated::{EmulatedRobot, SILENT_NS, Silence};
pub use profile::Profile;
pub use remote::{Button, Remote};
pub use state::State;

/// Why bytes are no message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// It is shorter or longer than this profile's.
    #[error("{len} bytes, where {expected} were expected: another robot, or another profile?")]
    Length {
        /// Its length, bytes.
        len: usize,
        /// The profile's.
        expected: usize,
    },
    /// It does not begin as the profile's do.
    #[error("it does not begin as a message of this robot does")]
    Head,
    /// Its checksum is wrong.
    #[error("its checksum is wrong: it was damaged on its way")]
    Checksum,
    /// A number in it is not finite.
    #[error("a number in it is not finite")]
    NotFinite,
    /// Its quaternion is no rotation.
    #[error("its attitude is none: the quaternion's length is not one")]
    NoAttitude,
}

/// Bytes of a fixed layout, read and written by their offsets.
pub(crate) mod field {
    pub(crate) fn get_f32(bytes: &[u8], at: usize) -> f32 {
        f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
    }

    pub(crate) fn put_f32(bytes: &mut [u8], at: usize, value: f32) {
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }

    /// Several in a row.
    pub(crate) fn get_f32s<const N: usize>(bytes: &[u8], at: usize) -> [f32; N] {
        std::array::from_fn(|i| get_f32(bytes, at + 4 * i))
    }

    pub(crate) fn put_f32s(bytes: &mut [u8], at: usize, values: &[f32]) {
        values.iter().enumerate().for_each(|(i, value)| put_f32(bytes, at + 4 * i, *value));
    }
}
