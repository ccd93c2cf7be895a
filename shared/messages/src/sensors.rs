//! What the drivers publish.

use crate::json::mirrored;
use crate::{Attitude, Frame, Header, Pose2, Twist2};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::FromBytes;

/// The most beams that a scan may have; sizes the lidar pool.
pub const MAX_BEAMS: usize = 4096;

/// Marker of the topic `lidar/scan`: `f32` ranges in metres, in the order of their angles.
///
/// A reading at or over `range_max_m`, or infinite, hit nothing. NaN, a negative reading or one under `range_min_m` is
/// unknown, and unknown is never taken as free.
#[derive(Debug, Clone, Copy)]
pub struct LidarScan;

impl Frame for LidarScan {
    type Element = f32;
    type Meta = ScanHeader;
    const LEN_MAX: Option<usize> = Some(MAX_BEAMS);
    fn fits(_: &ScanHeader, len: usize) -> bool {
        len <= MAX_BEAMS
    }
}

/// Stands beside the ranges of a scan. `header.stamp_ns` is the time of the last beam.
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ScanHeader/2"))]
#[repr(C)]
pub struct ScanHeader {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Angle of the first beam in the lidar frame, radians.
    pub angle_min_rad: f64,
    /// Angle from one beam to the next, radians; positive is counter-clockwise.
    pub angle_increment_rad: f64,
    /// Readings under it are unknown, metres.
    pub range_min_m: f64,
    /// Readings at or over it hit nothing, metres.
    pub range_max_m: f64,
    /// One standard deviation of a reading, metres.
    pub sigma_m: f64,
    /// Where the lidar is on the robot.
    pub robot_from_lidar: Pose2,
    /// Height of its plane above the floor while the body stands level, metres; 0 if not known.
    pub height_m: f64,
}

/// Marker of the topic `lidar/second`: `f32` ranges in metres of the second lidar, as those of [`LidarScan`].
#[derive(Debug, Clone, Copy)]
pub struct SecondScan;

impl Frame for SecondScan {
    type Element = f32;
    type Meta = SecondScanHeader;
    const LEN_MAX: Option<usize> = Some(MAX_BEAMS);
    fn fits(_: &SecondScanHeader, len: usize) -> bool {
        len <= MAX_BEAMS
    }
}

/// Stands beside the ranges of a scan of the second lidar.
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/SecondScanHeader/1"))]
#[repr(C)]
pub struct SecondScanHeader {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// What stands beside the ranges of any lidar; its own header means nothing.
    pub scan: ScanHeader,
    /// How far its x axis looks down, radians. Its beams turn in the plane of its x and y axes.
    pub pitch_rad: f64,
}

/// Marker of the topic `depth/frame`: `u16` depth along the optical axis in millimetres, 0 = none (16UC1), row by row
/// from the top left.
#[derive(Debug, Clone, Copy)]
pub struct DepthFrame;

impl Frame for DepthFrame {
    type Element = u16;
    type Meta = DepthHeader;
    const LEN_MAX: Option<usize> = None;
    fn fits(meta: &DepthHeader, len: usize) -> bool {
        u64::from(meta.width) * u64::from(meta.height) == len as u64
    }
}

mirrored! {
    /// Where a camera is on the robot: x forward, y left, z up from the floor; the optical axis is turned by `yaw_rad`
    /// and then tilted down by `pitch_rad`.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, FromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Pose3/1"))]
    #[serde(deny_unknown_fields)]
    #[repr(C)]
    pub struct Pose3 {
        /// Forward, metres.
        pub x_m: f64,
        /// Left, metres.
        pub y_m: f64,
        /// Above the floor, metres.
        pub z_m: f64,
        /// Counter-clockwise, radians.
        pub yaw_rad: f64,
        /// Down, radians.
        pub pitch_rad: f64,
    }
}

/// Stands beside the pixels of a depth frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/DepthHeader/1"))]
#[repr(C)]
pub struct DepthHeader {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along the columns, pixels.
    pub fx_px: f64,
    /// Focal length along the rows, pixels.
    pub fy_px: f64,
    /// Column of the optical axis.
    pub cx_px: f64,
    /// Row of the optical axis.
    pub cy_px: f64,
    /// Where the camera is on the robot.
    pub robot_from_camera: Pose3,
}

/// Where the robot believes it is. The incarnation names the odometry frame: a new one voids everything held in the
/// old.
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Odometry/2"))]
#[repr(C)]
pub struct Odometry {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Pose of the robot in the odometry frame.
    pub odom_from_robot: Pose2,
    /// Velocity in the robot frame.
    pub twist: Twist2,
    /// Standard deviations of x (m), y (m) and yaw (rad) gained since the frame began.
    pub sigma: [f64; 3],
    /// How the robot's body is held.
    pub attitude: Attitude,
}

impl Odometry {
    /// Whether its numbers are those of a robot on its legs.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        let stands = !self.attitude.is_known() || self.attitude.is_usable();
        self.odom_from_robot.is_finite() && self.twist.is_finite() && stands
    }
}
