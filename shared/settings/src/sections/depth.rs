//! The depth camera's section.

use std::path::PathBuf;

use messages::Pose3;
use serde::{Deserialize, Serialize};

use super::Source;
use crate::units::Positive;

/// What a depth camera's frames come through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthDevice {
    /// A socket, at which a program that knows the camera hands them over.
    Socket,
}

/// The depth camera and its driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthSettings {
    /// Where frames come from.
    pub source: Source,
    /// Which device, where they come from one.
    pub device: DepthDevice,
    /// Columns, at most 1280; a device may give fewer.
    pub width: u32,
    /// Rows, at most 720.
    pub height: u32,
    /// Frames a second.
    pub rate_hz: Positive,
    /// Horizontal field of view, degrees.
    pub field_of_view_deg: Positive,
    /// Nearest and farthest depth that the camera gives, and is believed at, metres.
    pub range_m: [f64; 2],
    /// Noise of the simulated camera: the intensity of a Redwood-type model, 0 to 10; 1 is that of the paper.
    pub redwood: f64,
    /// Where the camera is on the robot.
    pub robot_from_camera: Pose3,
    /// Whether motion needs it.
    pub needed: bool,
    /// The frame socket, where that is the device.
    pub socket: DepthSocket,
}

impl Default for DepthSettings {
    fn default() -> Self {
        Self {
            source: Source::Simulated,
            device: DepthDevice::Socket,
            width: 640,
            height: 480,
            rate_hz: Positive::of(15.0),
            field_of_view_deg: Positive::of(90.0),
            range_m: [0.3, 10.0],
            redwood: 0.0,
            robot_from_camera: Pose3 { x_m: 0.25, y_m: 0.0, z_m: 0.45, yaw_rad: 0.0, pitch_rad: 0.0 },
            needed: true,
            socket: DepthSocket::default(),
        }
    }
}

/// The frame socket.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthSocket {
    /// Its path.
    pub path: PathBuf,
}

impl Default for DepthSocket {
    fn default() -> Self {
        Self { path: PathBuf::from("/run/guidedog/depth.sock") }
    }
}
