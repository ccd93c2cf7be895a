//! What passes between the simulated world and the drivers and links that stand in it.

use crate::json::mirrored;
use crate::{Attitude, DepthHeader, Frame, Header, MAX_BEAMS, Pose2, ScanHeader, ServiceId, Twist2};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, TryFromBytes};

/// The most walking people in a world.
pub const MAX_WALKERS: usize = 16;
/// The most doors of a world that open.
pub const MAX_DOORS: usize = 8;

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
    #[cfg_attr(feature = "ipc", type_name("guidedog/WorldTruth/6"))]
    #[repr(C)]
    pub struct WorldTruth {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// The robot in the world.
        pub world_from_robot: Pose2,
        /// The robot's velocity, robot frame.
        pub robot_twist: Twist2,
        /// How the robot's body is held.
        pub attitude: Attitude = default,
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
        /// Times that the robot's footprint left the floor so far.
        pub robot_falls: u32 = default,
        /// Times that the handler's did.
        pub handler_falls: u32 = default,
        /// Times that robot or handler were walked into by somebody while standing or walking free.
        pub hit_by_others: u32,
        /// How many of `walkers` are meant.
        pub walker_count: u32,
        /// Walking people.
        pub walkers: [Walker; MAX_WALKERS],
        /// How the world's doors are turned, in its order (world frame), radians.
        pub doors_rad: [f64; MAX_DOORS] = default,
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

/// Marker of the topic `world/scan`: what the lidar driver publishes of a world whose simulator casts the rays itself.
#[derive(Debug, Clone, Copy)]
pub struct WorldScan;

impl Frame for WorldScan {
    type Element = f32;
    type Meta = WorldScanHeader;
    const LEN_MAX: Option<usize> = Some(MAX_BEAMS);
    fn fits(_: &WorldScanHeader, len: usize) -> bool {
        len <= MAX_BEAMS
    }
}

/// Stands beside the ranges of a scan of the world.
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/WorldScanHeader/1"))]
#[repr(C)]
pub struct WorldScanHeader {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// What the driver publishes beside the ranges; its own header means nothing.
    pub scan: ScanHeader,
}

/// Marker of the topic `world/frame`: what the depth driver publishes of a world whose simulator casts the rays itself.
#[derive(Debug, Clone, Copy)]
pub struct WorldFrame;

impl Frame for WorldFrame {
    type Element = u16;
    type Meta = WorldFrameHeader;
    const LEN_MAX: Option<usize> = None;
    fn fits(meta: &WorldFrameHeader, len: usize) -> bool {
        crate::DepthFrame::fits(&meta.depth, len)
    }
}

/// Stands beside the pixels of a depth frame of the world.
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/WorldFrameHeader/1"))]
#[repr(C)]
pub struct WorldFrameHeader {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// What the driver publishes beside the pixels; its own header means nothing.
    pub depth: DepthHeader,
}
