//! Which robot, by which version of its protocol: where it is, and where in its messages everything lies.

use std::net::{Ipv4Addr, SocketAddrV4};

use serde::{Deserialize, Serialize};

/// A robot and the version of its protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "&'static str")]
pub enum Profile {
    /// AlienGo, sport mode 1.0.20 and later.
    AlienGo384,
    /// AlienGo before that.
    AlienGo331,
    /// Go1.
    Go138,
}

impl From<Profile> for &'static str {
    fn from(profile: Profile) -> Self {
        profile.name()
    }
}

impl TryFrom<String> for Profile {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|profile| profile.name() == name)
            .ok_or_else(|| format!("there is no robot {name}; known: {}", Self::ALL.map(Self::name).join(", ")))
    }
}

/// Offsets in a command, bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CommandLayout {
    pub(crate) len: usize,
    pub(crate) level_flag: usize,
    pub(crate) mode: usize,
    pub(crate) gait: usize,
    pub(crate) foot_raise: usize,
    pub(crate) body_height: usize,
    pub(crate) velocity: usize,
    pub(crate) yaw_speed: usize,
}

/// Offsets in a state, bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StateLayout {
    pub(crate) len: usize,
    pub(crate) mode: usize,
    pub(crate) quaternion: usize,
    pub(crate) position: usize,
    pub(crate) velocity: usize,
    pub(crate) yaw_speed: usize,
    /// Charge, percent, where it is told.
    pub(crate) charge: Option<usize>,
    pub(crate) remote: usize,
}

impl Profile {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::AlienGo384, Self::AlienGo331, Self::Go138];

    /// Its name in a configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::AlienGo384 => "aliengo-3.8.4",
            Self::AlienGo331 => "aliengo-3.3.1",
            Self::Go138 => "go1-3.8",
        }
    }

    /// Where the robot listens, as it leaves the factory.
    #[must_use]
    pub fn robot(self) -> SocketAddrV4 {
        match self {
            Self::AlienGo384 => SocketAddrV4::new(Ipv4Addr::new(192, 168, 123, 220), 8082),
            Self::AlienGo331 => SocketAddrV4::new(Ipv4Addr::new(192, 168, 123, 10), 8007),
            Self::Go138 => SocketAddrV4::new(Ipv4Addr::new(192, 168, 123, 161), 8082),
        }
    }

    /// The port from which the maker's own library speaks to it.
    #[must_use]
    pub fn local_port(self) -> u16 {
        match self {
            Self::AlienGo384 => 8081,
            Self::AlienGo331 => 8080,
            Self::Go138 => 8090,
        }
    }

    /// What every message begins with, and the level flag of a high-level command behind it.
    pub(crate) fn head(self) -> (&'static [u8], u8) {
        match self {
            Self::AlienGo384 | Self::AlienGo331 => (&[], 0x00),
            Self::Go138 => (&[0xfe, 0xef], 0xee),
        }
    }

    pub(crate) fn command(self) -> CommandLayout {
        match self {
            Self::AlienGo384 | Self::AlienGo331 => CommandLayout {
                len: 113,
                level_flag: 0,
                mode: 10,
                gait: 11,
                foot_raise: 13,
                body_height: 17,
                velocity: 41,
                yaw_speed: 49,
            },
            Self::Go138 => CommandLayout {
                len: 129,
                level_flag: 2,
                mode: 22,
                gait: 23,
                foot_raise: 25,
                body_height: 29,
                velocity: 53,
                yaw_speed: 61,
            },
        }
    }

    pub(crate) fn state(self) -> StateLayout {
        match self {
            Self::AlienGo384 => StateLayout {
                len: 244,
                mode: 10,
                quaternion: 11,
                position: 64,
                velocity: 76,
                yaw_speed: 88,
                charge: None,
                remote: 196,
            },
            Self::AlienGo331 => StateLayout {
                len: 265,
                mode: 10,
                quaternion: 15,
                position: 73,
                velocity: 89,
                yaw_speed: 101,
                charge: None,
                remote: 217,
            },
            Self::Go138 => StateLayout {
                len: 1087,
                mode: 885,
                quaternion: 22,
                position: 895,
                velocity: 911,
                yaw_speed: 923,
                charge: Some(838),
                remote: 1039,
            },
        }
    }

    /// Bytes of a command.
    #[must_use]
    pub fn command_len(self) -> usize {
        self.command().len
    }

    /// Bytes of a state.
    #[must_use]
    pub fn state_len(self) -> usize {
        self.state().len
    }
}
