//! The topic table: who may talk to whom, how deep, and why. Every process opens its ports from here, so that two
//! processes cannot disagree about a topic.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::ServiceId;
use crate::ServiceId::{
    Brake, Cue, Depth, Emulator, Estop, Lidar, Locomotion, Odometry, Policy, Recorder, Replay, Shield, Simulator,
    Speak, Supervisor,
};
use zerocopy::TryFromBytes;

/// A topic of the table.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/TopicId/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum TopicId {
    /// No topic: where a message has none to name.
    #[default]
    None = 0,
    /// `lidar/scan`
    LidarScan,
    /// `depth/frame`
    DepthFrame,
    /// `odometry`
    Odometry,
    /// `cue`
    Cue,
    /// `cue/request`
    CueRequest,
    /// `policy/action`
    PolicyAction,
    /// `shield/permit`
    ShieldPermit,
    /// `mode`
    Mode,
    /// `locomotion/state`
    LocomotionState,
    /// `health/<service>`
    Health,
    /// `world/truth`
    WorldTruth,
    /// `world/command`
    WorldCommand,
    /// `clock/step`
    ClockStep,
    /// `clock/ack`
    ClockAck,
    /// `estop`
    Estop,
    /// `cue/answer`
    CueAnswer,
    /// `speech/said`
    SpeechSaid,
    /// `cue/heard`
    CueHeard,
}

/// How a topic is laid out in shared memory.
#[derive(Debug, Clone, Copy)]
pub struct TopicSpec {
    /// Which topic.
    pub id: TopicId,
    /// Its name; a health topic's is followed by `/<service>`.
    pub name: &'static str,
    /// Services that may write. One is *the* writer at a time, told by its incarnation.
    pub publishers: &'static [ServiceId],
    /// Services that may read.
    pub subscribers: &'static [ServiceId],
    /// Messages that wait for a reader; the oldest gives way.
    pub buffer: usize,
    /// Messages that a reader may hold at once.
    pub borrowed: usize,
    /// Messages that a writer may be filling at once.
    pub loans: usize,
    /// Whether a message wakes its readers.
    pub wakes: bool,
    /// The reason for these numbers.
    pub why: &'static str,
}

/// Dead writers and readers keep their slot until they are cleaned up; a crash loop must not use up the room first.
pub const DEAD_SLOTS: usize = 2;

impl TopicSpec {
    /// Writers that may be alive at once in one run, and room for dead ones: drivers and replay exclude each other, a
    /// policy has one shadow, and everything else has one writer.
    #[must_use]
    pub fn max_publishers(&self) -> usize {
        let live = match self.id {
            TopicId::ClockAck => self.publishers.len() + 1,
            TopicId::PolicyAction | TopicId::Health | TopicId::WorldCommand => 2,
            _ => 1,
        };
        live + DEAD_SLOTS
    }

    /// Readers that may be alive at once, and room for dead ones.
    #[must_use]
    pub fn max_subscribers(&self) -> usize {
        let policies = usize::from(self.subscribers.contains(&Policy));
        self.subscribers.len() + policies + DEAD_SLOTS
    }

    /// Messages of the pool of one writer: all that readers may hold or have waiting, and the loans.
    #[must_use]
    pub fn pool_len(&self) -> usize {
        self.max_subscribers() * (self.buffer + self.borrowed) + self.loans
    }
}

const EVERYBODY: &[ServiceId] = &ServiceId::ALL;
const MEMBERS: &[ServiceId] =
    &[Supervisor, Lidar, Depth, Odometry, Cue, Policy, Shield, Locomotion, Brake, Recorder, Simulator, Replay];

/// The table. `Recorder` among the subscribers is the tap: its slot is counted in, so that recording changes nothing.
pub const TOPICS: [TopicSpec; 18] = [
    TopicSpec {
        id: TopicId::LidarScan,
        name: "lidar/scan",
        publishers: &[Lidar, Replay],
        subscribers: &[Odometry, Policy, Shield, Recorder],
        buffer: 2,
        borrowed: 3,
        loans: 2,
        wakes: true,
        why: "the newest scan and, in stepped time, the one of the step before; one held while the next is looked at",
    },
    TopicSpec {
        id: TopicId::DepthFrame,
        name: "depth/frame",
        publishers: &[Depth, Replay],
        subscribers: &[Policy, Shield, Recorder],
        buffer: 2,
        borrowed: 3,
        loans: 2,
        wakes: true,
        why: "as lidar/scan; megabytes a frame, so no deeper",
    },
    TopicSpec {
        id: TopicId::Odometry,
        name: "odometry",
        publishers: &[Odometry, Replay],
        subscribers: &[Lidar, Policy, Shield, Locomotion, Cue, Speak, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "up to 100 Hz: one a step, of two steps, and room for a reader that is late by 60 ms",
    },
    TopicSpec {
        id: TopicId::Cue,
        name: "cue",
        publishers: &[Cue, Replay],
        subscribers: &[Policy, Shield, Locomotion, Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "events that must not be lost, a stop among them",
    },
    TopicSpec {
        id: TopicId::CueRequest,
        name: "cue/request",
        publishers: &[Supervisor],
        subscribers: &[Cue, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "events that must not be lost",
    },
    TopicSpec {
        id: TopicId::PolicyAction,
        name: "policy/action",
        publishers: &[Policy],
        subscribers: &[Shield, Supervisor, Replay, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "one a decision from the active policy and from a shadow",
    },
    TopicSpec {
        id: TopicId::ShieldPermit,
        name: "shield/permit",
        publishers: &[Shield],
        subscribers: &[Locomotion, Supervisor, Replay, Speak, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "a scan and a decision may each give one in the same step, of two steps; only the newest counts",
    },
    TopicSpec {
        id: TopicId::Mode,
        name: "mode",
        publishers: &[Supervisor],
        subscribers: &[Lidar, Depth, Odometry, Cue, Policy, Shield, Locomotion, Simulator, Replay, Speak, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "only the newest counts; at most one a step, and as much again for a reader that is late",
    },
    TopicSpec {
        id: TopicId::LocomotionState,
        name: "locomotion/state",
        publishers: &[Locomotion],
        subscribers: &[Supervisor, Odometry, Speak, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: false,
        why: "50 Hz, read when the supervisor wakes for something else, at the latest every 50 ms",
    },
    TopicSpec {
        id: TopicId::Health,
        name: "health",
        publishers: EVERYBODY,
        subscribers: &[Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: false,
        why: "50 Hz, drained at 50 Hz: two on the way, and four times that for a supervisor that overslept",
    },
    TopicSpec {
        id: TopicId::WorldTruth,
        name: "world/truth",
        publishers: &[Simulator],
        subscribers: &[Lidar, Depth, Odometry, Emulator, Cue, Locomotion, Supervisor, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "one a step of 10 ms, of two steps, and as much again for a reader that is late",
    },
    TopicSpec {
        id: TopicId::WorldCommand,
        name: "world/command",
        publishers: &[Locomotion, Emulator],
        subscribers: &[Simulator, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "the newest command counts",
    },
    TopicSpec {
        id: TopicId::ClockStep,
        name: "clock/step",
        publishers: &[Simulator, Replay],
        subscribers: MEMBERS,
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "the next step comes only when all members took this one; a starting process may be steps behind",
    },
    TopicSpec {
        id: TopicId::ClockAck,
        name: "clock/ack",
        publishers: MEMBERS,
        subscribers: &[Simulator, Replay, Supervisor],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "one a step and member, and rosters between",
    },
    TopicSpec {
        id: TopicId::Estop,
        name: "estop",
        publishers: &[Estop],
        subscribers: &[Locomotion, Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "a press and a release may come at once, and neither may be lost; 50 Hz besides",
    },
    TopicSpec {
        id: TopicId::CueAnswer,
        name: "cue/answer",
        publishers: &[Supervisor],
        subscribers: &[Speak, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "events that must not be lost",
    },
    TopicSpec {
        id: TopicId::SpeechSaid,
        name: "speech/said",
        publishers: &[Speak],
        subscribers: &[Cue, Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "events that must not be lost: a sentence that is cut and the next one come at once",
    },
    TopicSpec {
        id: TopicId::CueHeard,
        name: "cue/heard",
        publishers: &[Cue],
        subscribers: &[Speak, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        why: "events; only the newest waits for its tone",
    },
];

impl TopicId {
    /// The topic's row of the table; `None` for [`TopicId::None`].
    #[must_use]
    pub fn spec(self) -> Option<&'static TopicSpec> {
        TOPICS.iter().find(|spec| spec.id == self)
    }

    /// The topic's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.spec().map_or("none", |spec| spec.name)
    }
}

impl core::fmt::Display for TopicId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::{TOPICS, TopicId};

    #[test]
    fn every_topic_has_one_row_and_a_reason() {
        for (i, spec) in TOPICS.iter().enumerate() {
            assert_eq!(spec.id as usize, i + 1, "{} stands where its number says", spec.name);
            assert!(!spec.why.is_empty() && spec.buffer >= 2, "{}", spec.name);
        }
        assert_eq!(TopicId::LidarScan.name(), "lidar/scan");
        assert!(TopicId::None.spec().is_none());
    }
}
