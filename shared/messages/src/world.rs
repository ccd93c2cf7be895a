//! What passes between the simulated world and the drivers and links that stand in it.

use crate::json::mirrored;
use crate::{Header, Pose2, ServiceId, Twist2};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, TryFromBytes};

/// The most walking people in a world.
pub const MAX_WALKERS: usize = 16;

mirrored! {
    /// A walking person: a disc.
    #[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Walker/1"))]
    #[repr(C)]
    pub struct Walker {
        /// Place in the world, metres.
        pub x_m: f64,
        /// Place in the world, metres.
        pub y_m: f64,
        /// Radius, metres.
        pub radius_m: f64,
    }
}

mirrored! {
    /// The true state of the simulated world.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/WorldTruth/3"))]
    #[repr(C)]
    pub struct WorldTruth {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// The robot in the world.
        pub world_from_robot: Pose2,
        /// The robot's velocity, robot frame.
        pub robot_twist: Twist2,
        /// Velocity in force at the robot, whoever commanded it.
        pub command: Twist2,
        /// Run time since which it has been.
        pub command_since_ns: u64,
        /// The handler in the world.
        pub world_from_handler: Pose2,
        /// Way walked by the robot, metres.
        pub distance_m: f64,
        /// Collisions that the robot ran into so far.
        pub robot_collisions: u32,
        /// Collisions that the handler was led into so far.
        pub handler_collisions: u32,
        /// Times that robot or handler were walked into by somebody while standing or walking free.
        pub hit_by_others: u32,
        /// How many of `walkers` are meant.
        pub walker_count: u32,
        /// Walking people.
        pub walkers: [Walker; MAX_WALKERS],
    }
}

/// A velocity commanded to the simulated robot, which keeps the last one when the line goes quiet.
#[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/RobotCommand/1"))]
#[repr(C)]
pub struct RobotCommand {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Who commands.
    pub source: ServiceId,
    /// Robot frame.
    pub velocity: Twist2,
}
