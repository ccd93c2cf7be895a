//! A robot on DDS: locomotion's voice there, and the brake's.
//!
//! Two processes, each with a participant of its own on the robot's network. The *bridge* says what locomotion wishes,
//! for as long as each wish holds and both locomotion and the backstop are there. The *backstop* says stop, and
//! nothing else: when the brake asks for it, when the brake is gone, and when the bridge is, whoever of them died. A
//! new one of either begins with a stop.

mod backstop;
mod bridge;
mod peers;
mod voice;

pub use backstop::Backstop;
pub use bridge::Bridge;

/// Without a supervisor they end after this long, nanoseconds: after locomotion and the brake have.
const LOST_LIMIT_NS: u64 = 600_000_000;
/// Between two looks at the network, nanoseconds.
const LOOK_NS: u64 = 5_000_000;
