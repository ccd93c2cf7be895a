//! The services by name.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// A service: one process, one executable (`guidedog-<name>`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ServiceId/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum ServiceId {
    /// No service: where a message has none to name.
    #[default]
    None = 0,
    /// Starts, watches, restarts, stops.
    Supervisor,
    /// Lidar driver.
    Lidar,
    /// Depth camera driver.
    Depth,
    /// Odometry driver.
    Odometry,
    /// Cue recogniser.
    Cue,
    /// Observation to action.
    Policy,
    /// Action to permit.
    Shield,
    /// Permit to robot: the last gate.
    Locomotion,
    /// Stops the robot when locomotion is gone.
    Brake,
    /// The physical world in place of the real one.
    Simulator,
    /// Recorded frames out.
    Recorder,
    /// Recorded frames in, in the drivers' place.
    Replay,
    /// Devices that are not there, in the simulated world.
    Emulator,
    /// The emergency stop input.
    Estop,
    /// Locomotion's voice on a robot's DDS network.
    Bridge,
    /// The brake's voice there, and the one that speaks where the bridge is gone.
    Backstop,
    /// Tells the handler aloud what the robot does, and why it stands.
    Speak,
}

impl ServiceId {
    /// Every service, in the order of start: what stops the robot comes first.
    pub const ALL: [Self; 17] = [
        Self::Supervisor,
        Self::Locomotion,
        Self::Brake,
        Self::Bridge,
        Self::Backstop,
        Self::Simulator,
        Self::Emulator,
        Self::Replay,
        Self::Estop,
        Self::Odometry,
        Self::Lidar,
        Self::Depth,
        Self::Cue,
        Self::Policy,
        Self::Shield,
        Self::Speak,
        Self::Recorder,
    ];

    /// The name, as in topic names, configuration keys and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Supervisor => "supervisor",
            Self::Lidar => "lidar",
            Self::Depth => "depth",
            Self::Odometry => "odometry",
            Self::Cue => "cue",
            Self::Policy => "policy",
            Self::Shield => "shield",
            Self::Locomotion => "locomotion",
            Self::Brake => "brake",
            Self::Simulator => "simulator",
            Self::Recorder => "recorder",
            Self::Replay => "replay",
            Self::Emulator => "emulator",
            Self::Estop => "estop",
            Self::Bridge => "bridge",
            Self::Backstop => "backstop",
            Self::Speak => "speak",
        }
    }

    /// Whether the service is what stops the robot: it outlives the supervisor by as much as the stop takes, and hears
    /// of its end by SIGHUP.
    #[must_use]
    pub const fn stops_robot(self) -> bool {
        matches!(self, Self::Locomotion | Self::Brake | Self::Bridge | Self::Backstop)
    }

    /// The service as a list of one, as the topic table has its publishers; nobody for [`ServiceId::None`].
    #[must_use]
    pub fn alone(self) -> &'static [Self] {
        Self::ALL.iter().position(|service| *service == self).map_or(&[], |i| &Self::ALL[i..=i])
    }

    /// The service of that name, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|service| service.name() == name)
    }
}

impl core::fmt::Display for ServiceId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}
