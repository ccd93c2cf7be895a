//! The last gate's section, and the robot's.

use std::net::{Ipv4Addr, SocketAddrV4};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use unitree::Profile;

use super::Settings;
use crate::devices::Reach;
use crate::emulated::{EmulatedPlaces, LinkEmulation};
use crate::units::{Millis, Positive};

/// The last DDS domain whose ports there are.
const DDS_DOMAIN_MAX: u16 = 232;

/// The way to the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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

/// What is known of a link.
#[derive(Debug)]
pub struct LinkRow {
    /// Its name in the configuration.
    pub name: &'static str,
    /// What a recording calls its robot.
    pub robot: fn(&Locomotion) -> &'static str,
    /// What is at its other end.
    pub far_end: FarEnd,
    /// By what the robot is reached.
    pub reach: for<'a> fn(&'a Locomotion) -> Reach<'a>,
    /// Checks its settings, also where it is not in use; the reason begins with the key.
    pub check: fn(&Locomotion) -> Result<(), String>,
    /// The robot that `--emulated` puts at its other end, where it has one.
    pub emulated: Option<LinkEmulation>,
}

/// What is at the other end of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FarEnd {
    /// Nothing that obeys: recorded frames move no robot, and may come more slowly.
    Nothing,
    /// The robot of the simulated world.
    SimulatedRobot,
    /// A robot that is there, or emulated. Locomotion and brake speak to it themselves.
    Robot,
    /// Such a robot on a DDS network. `bridge` and `backstop` speak to it in their place.
    DdsRobot(DdsRobot),
}

impl FarEnd {
    /// Whether it is a robot that is there, or emulated: one that tells where it is.
    #[must_use]
    pub fn is_device(self) -> bool {
        matches!(self, Self::Robot | Self::DdsRobot(_))
    }
}

/// A robot on a DDS network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DdsRobot {
    /// Unitree's Go2 or B2.
    Go2,
    /// Any that takes velocities of ROS 2.
    Ros2,
}

/// A robot that can be emulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotKind {
    /// Unitree's over UDP.
    Unitree,
    /// Unitree's Go2 or B2.
    Go2,
    /// A robot of ROS 2.
    Ros2,
}

impl LinkKind {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Simulated, Self::Unitree, Self::Go2, Self::Ros2, Self::Null];

    /// What is known of it.
    #[must_use]
    pub fn row(self) -> &'static LinkRow {
        match self {
            Self::Simulated => &SIMULATED,
            Self::Unitree => &UNITREE,
            Self::Go2 => &GO2,
            Self::Ros2 => &ROS2,
            Self::Null => &NULL,
        }
    }

    /// Whether it speaks DDS, by processes of its own.
    #[must_use]
    pub fn is_dds(self) -> bool {
        matches!(self.row().far_end, FarEnd::DdsRobot(_))
    }

    /// Whether it commands a robot that is there, or emulated: one that tells where it is.
    #[must_use]
    pub fn is_device(self) -> bool {
        self.row().far_end.is_device()
    }

    /// Whether anything obeys its commands.
    #[must_use]
    pub fn is_obeyed(self) -> bool {
        self.row().far_end != FarEnd::Nothing
    }

    /// The names of the links whose rows `which` takes.
    pub fn names(which: impl Fn(&LinkRow) -> bool) -> impl Iterator<Item = &'static str> {
        Self::ALL.into_iter().map(Self::row).filter(move |row| which(row)).map(|row| row.name)
    }
}

const SIMULATED: LinkRow = LinkRow {
    name: "simulated",
    robot: |_| "simulated",
    far_end: FarEnd::SimulatedRobot,
    reach: |_| Reach::Nothing,
    check: |_| Ok(()),
    emulated: None,
};

const UNITREE: LinkRow = LinkRow {
    name: "unitree",
    robot: |locomotion| locomotion.unitree.profile.name(),
    far_end: FarEnd::Robot,
    reach: |locomotion| Reach::Udp { device: locomotion.unitree.robot(), local: locomotion.unitree.local() },
    check: |_| Ok(()),
    emulated: Some(LinkEmulation {
        kind: RobotKind::Unitree,
        place: place_unitree,
        elsewhere: |settings| {
            let robot = settings.locomotion.unitree.robot?;
            (!robot.ip().is_loopback()).then_some("locomotion.unitree.robot")
        },
    }),
};

fn place_unitree(settings: &mut Settings, places: &EmulatedPlaces) {
    let link = &mut settings.locomotion.unitree;
    link.robot = Some(SocketAddrV4::new(places.robot, link.profile.robot().port()));
    link.local = Some(SocketAddrV4::new(places.robot, link.profile.local_port()));
}

const GO2: LinkRow = LinkRow {
    name: "go2",
    robot: |_| "go2",
    far_end: FarEnd::DdsRobot(DdsRobot::Go2),
    reach: |locomotion| Reach::Dds(&locomotion.dds),
    check: |locomotion| locomotion.dds.check(),
    emulated: Some(LinkEmulation { kind: RobotKind::Go2, place: place_dds, elsewhere: |_| None }),
};

const ROS2: LinkRow = LinkRow {
    name: "ros2",
    robot: |_| "ros2",
    far_end: FarEnd::DdsRobot(DdsRobot::Ros2),
    reach: |locomotion| Reach::Dds(&locomotion.dds),
    check: |locomotion| locomotion.dds.check().and_then(|()| locomotion.ros2.check()),
    emulated: Some(LinkEmulation { kind: RobotKind::Ros2, place: place_dds, elsewhere: |_| None }),
};

fn place_dds(settings: &mut Settings, places: &EmulatedPlaces) {
    settings.locomotion.dds = DdsSettings { domain: places.dds_domain, networks: vec![Ipv4Addr::LOCALHOST] };
}

const NULL: LinkRow = LinkRow {
    name: "null",
    robot: |_| "none",
    far_end: FarEnd::Nothing,
    reach: |_| Reach::Nothing,
    check: |_| Ok(()),
    emulated: None,
};

/// Largest velocities.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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

/// A DDS network.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DdsSettings {
    /// The domain.
    pub domain: u16,
    /// This machine's own addresses in the robot's network; every network, where none is told.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub networks: Vec<Ipv4Addr>,
}

impl DdsSettings {
    fn check(&self) -> Result<(), String> {
        if self.domain > DDS_DOMAIN_MAX {
            return Err(format!("locomotion.dds.domain is over {DDS_DOMAIN_MAX}: it has no ports"));
        }
        Ok(())
    }
}

/// Topics of a ROS 2 robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2Settings {
    /// Where it takes `geometry_msgs/Twist`.
    pub cmd_vel: String,
    /// Whether it takes `TwistStamped` instead.
    pub stamped: bool,
    /// Where it gives `nav_msgs/Odometry`.
    pub odom: String,
}

impl Ros2Settings {
    fn check(&self) -> Result<(), String> {
        for (key, topic) in [("cmd_vel", &self.cmd_vel), ("odom", &self.odom)] {
            let is_name = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            if !topic.strip_prefix('/').unwrap_or(topic).split('/').all(is_name) {
                return Err(format!("locomotion.ros2.{key} = {topic:?} is no topic of ROS 2"));
            }
        }
        Ok(())
    }
}

impl Default for Ros2Settings {
    fn default() -> Self {
        Self { cmd_vel: "/cmd_vel".to_owned(), stamped: false, odom: "/odom".to_owned() }
    }
}

/// A Unitree robot over UDP.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UnitreeSettings {
    /// Which robot, by which version of its protocol.
    #[schemars(with = "String")]
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
