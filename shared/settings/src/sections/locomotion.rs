//! The last gate's section, and the robot's.

use std::net::{Ipv4Addr, SocketAddrV4};

use serde::{Deserialize, Serialize};
use unitree::Profile;

use crate::units::{Millis, Positive};

/// The way to the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LinkKind {
    /// The simulated robot; it keeps the last command when the line goes quiet.
    Simulated,
    /// A Unitree robot over UDP.
    Unitree,
    /// Unitree's Go2 or B2, over DDS.
    Go2,
    /// Any robot that takes velocities of ROS 2.
    Ros2,
    /// Nothing: for replayed frames.
    Null,
}

/// Largest velocities.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Over ground, metres per second.
    pub speed_mps: Positive,
    /// Turning, radians per second.
    pub turn_radps: Positive,
    /// Planned changes of speed, metres per second squared.
    pub acceleration_mps2: Positive,
    /// Planned changes of turning, radians per second squared.
    pub acceleration_radps2: Positive,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            speed_mps: Positive::of(0.8),
            turn_radps: Positive::of(1.2),
            acceleration_mps2: Positive::of(4.0),
            acceleration_radps2: Positive::of(12.0),
        }
    }
}

/// The last gate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Locomotion {
    /// The way to the robot.
    pub link: LinkKind,
    /// Commands a second.
    pub rate_hz: Positive,
    /// Longest time from a verdict to its expiry.
    pub permit_life: Millis,
    /// Bounds.
    pub limits: Limits,
    /// At this charge of the robot's battery, where it tells it, the operator is warned; percent.
    pub charge_warn_percent: u8,
    /// At this charge the robot stops while it still stands, percent.
    pub charge_stop_percent: u8,
    /// The robot, where the link is Unitree's.
    pub unitree: UnitreeSettings,
    /// The network, where the link is DDS.
    pub dds: DdsSettings,
    /// The robot's topics, where the link is ROS 2.
    pub ros2: Ros2Settings,
}

impl LinkKind {
    /// Whether it speaks DDS, by processes of its own.
    #[must_use]
    pub fn is_dds(self) -> bool {
        matches!(self, Self::Go2 | Self::Ros2)
    }

    /// Whether it commands a robot that is there, or emulated: one that tells where it is.
    #[must_use]
    pub fn is_device(self) -> bool {
        self == Self::Unitree || self.is_dds()
    }
}

/// A DDS network.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DdsSettings {
    /// The domain.
    pub domain: u16,
    /// This machine's own addresses in the robot's network; every network, where none is told.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub networks: Vec<Ipv4Addr>,
}

/// Topics of a ROS 2 robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2Settings {
    /// Where it takes `geometry_msgs/Twist`.
    pub cmd_vel: String,
    /// Whether it takes `TwistStamped` instead.
    pub stamped: bool,
    /// Where it gives `nav_msgs/Odometry`.
    pub odom: String,
}

impl Default for Ros2Settings {
    fn default() -> Self {
        Self { cmd_vel: "/cmd_vel".to_owned(), stamped: false, odom: "/odom".to_owned() }
    }
}

/// A Unitree robot over UDP.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UnitreeSettings {
    /// Which robot, by which version of its protocol.
    pub profile: Profile,
    /// Where it listens; where nothing is told, as it leaves the factory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<SocketAddrV4>,
    /// Where its states are heard; where nothing is told, every address and the port of the maker's own library.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub local: Option<SocketAddrV4>,
}

impl UnitreeSettings {
    /// Where the robot listens.
    #[must_use]
    pub fn robot(&self) -> SocketAddrV4 {
        self.robot.unwrap_or_else(|| self.profile.robot())
    }

    /// Where its states are heard.
    #[must_use]
    pub fn local(&self) -> SocketAddrV4 {
        self.local.unwrap_or_else(|| SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, self.profile.local_port()))
    }
}

impl Default for UnitreeSettings {
    fn default() -> Self {
        Self { profile: Profile::AlienGo384, robot: None, local: None }
    }
}

impl Default for Locomotion {
    fn default() -> Self {
        Self {
            link: LinkKind::Simulated,
            rate_hz: Positive::of(50.0),
            permit_life: Millis::of_ms(200),
            limits: Limits::default(),
            charge_warn_percent: 20,
            charge_stop_percent: 8,
            unitree: UnitreeSettings::default(),
            dds: DdsSettings::default(),
            ros2: Ros2Settings::default(),
        }
    }
}
