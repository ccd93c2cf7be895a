//! What ROS 2 calls a robot's base: `geometry_msgs/Twist` to it, `nav_msgs/Odometry` from it.

use messages::Twist2;
use serde::{Deserialize, Serialize};

use crate::{Posture, RobotState};

/// Type of a velocity.
pub const TWIST: &str = "geometry_msgs::msg::dds_::Twist_";
/// Type of a velocity with a stamp.
pub const TWIST_STAMPED: &str = "geometry_msgs::msg::dds_::TwistStamped_";
/// Type of odometry.
pub const ODOMETRY: &str = "nav_msgs::msg::dds_::Odometry_";

/// The DDS topic of a ROS 2 topic.
#[must_use]
pub fn dds_topic(name: &str) -> String {
    format!("rt/{}", name.trim_start_matches('/'))
}

/// `builtin_interfaces/Time`, `std_msgs/Header`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Seconds and nanoseconds since 1970.
    pub stamp: (i32, u32),
    /// The frame.
    pub frame_id: String,
}

/// `geometry_msgs/Twist`: linear x, y, z and angular x, y, z; m/s and rad/s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// m/s: forward, left, up.
    pub linear: [f64; 3],
    /// rad/s about forward, left, up.
    pub angular: [f64; 3],
}

impl From<Twist2> for Twist {
    fn from(velocity: Twist2) -> Self {
        Self { linear: [velocity.vx_mps, velocity.vy_mps, 0.0], angular: [0.0, 0.0, velocity.wz_radps] }
    }
}

impl From<Twist> for Twist2 {
    fn from(twist: Twist) -> Self {
        Self { vx_mps: twist.linear[0], vy_mps: twist.linear[1], wz_radps: twist.angular[2] }
    }
}

/// `geometry_msgs/TwistStamped`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TwistStamped {
    /// When, and in which frame.
    pub header: Header,
    /// The velocity.
    pub twist: Twist,
}

/// `nav_msgs/Odometry`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// When, and in which frame the pose is.
    pub header: Header,
    /// The frame of the velocity: the robot's.
    pub child_frame_id: String,
    /// Metres: x, y, z.
    pub position: [f64; 3],
    /// Attitude: x, y, z, w.
    pub orientation: [f64; 4],
    /// Of the pose.
    pub pose_covariance: [[f64; 6]; 6],
    /// In the robot's frame.
    pub twist: Twist,
    /// Of the velocity.
    pub twist_covariance: [[f64; 6]; 6],
}

impl Odometry {
    /// What it says of where the robot is and goes; nothing, where its numbers are none.
    #[must_use]
    pub fn state(&self) -> Option<RobotState> {
        let ([x_m, y_m, _], [x, y, z, w]) = (self.position, self.orientation);
        RobotState::checked(self.twist.into(), [x_m, y_m], [w, x, y, z], Posture::Ready)
    }
}
