//! The topic table: who may talk to whom, how deep, and why. Every process opens its ports from here, so that two
//! processes cannot disagree about a topic.
//!
//! A row is all that a topic needs beside its type: the pools, the topics that the supervisor creates, what the
//! recorder takes, the files of a recording and docs/topics.md follow from it.

mod spec;

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::ServiceId;
use crate::ServiceId::{
    Cue, Depth, Emulator, Estop, Lidar, Locomotion, Odometry, Policy, Recorder, Replay, SecondLidar, Shield, Simulator,
    Speak, Supervisor,
};
use crate::json::named;
use crate::service::{ClockRole, SERVICES};
use zerocopy::TryFromBytes;

pub use spec::{AgeLimit, DEAD_SLOTS, Payload, TopicSpec};

const EVERY_SERVICE: &[ServiceId] = &ServiceId::ALL;

/// The services that take part in stepped time.
const MEMBERS: &[ServiceId] = &{
    let mut members = [ServiceId::None; member_count()];
    let (mut row, mut member) = (0, 0);
    while row < SERVICES.len() {
        if !matches!(SERVICES[row].clock, ClockRole::Outside) {
            members[member] = SERVICES[row].id;
            member += 1;
        }
        row += 1;
    }
    members
};

const fn member_count() -> usize {
    let (mut row, mut count) = (0, 0);
    while row < SERVICES.len() {
        count += !matches!(SERVICES[row].clock, ClockRole::Outside) as usize;
        row += 1;
    }
    count
}

/// What a row says of the type that the topic carries.
macro_rules! payload {
    (message $type:ident) => {
        Payload::Message { bytes: size_of::<crate::$type>() }
    };
    (frame $type:ident $header:ident) => {
        Payload::Frame {
            header_bytes: size_of::<crate::$header>(),
            element_bytes: size_of::<<crate::$type as crate::Frame>::Element>(),
            elements_max: <crate::$type as crate::Frame>::LEN_MAX,
        }
    };
}

/// The type of a row becomes a message of its topic; a frame's header does.
macro_rules! on_topic {
    ($id:ident message $type:ident $({ $count:ident <= $max:ident })?) => {
        impl crate::Message for crate::$type {
            const TOPIC: TopicId = TopicId::$id;
            $(fn counts_fit(&self) -> bool { self.$count as usize <= crate::$max })?
            fn header(&self) -> &crate::Header { &self.header }
            fn header_mut(&mut self) -> &mut crate::Header { &mut self.header }
        }
    };
    ($id:ident frame $type:ident $header:ident) => {
        on_topic! { $id message $header }
    };
}

/// Whether faults can be injected into the topic of a row by its name.
macro_rules! injectable_by_name {
    (name) => {
        true
    };
    ($(service)?) => {
        false
    };
}

/// Declares the topics in the order in which they are recorded:
///
/// `Id = number, message Type [count <= MAX], recorded in Part as Form, injectable by name { .. }`, or
/// `frame Marker Header` in the place of `message Type`.
///
/// The number is the one in shared memory: it never changes. `[count <= MAX]` names the field that counts, and its
/// limit: readers drop a message that is over it. What follows `recorded in` is the file of a recording that has the
/// topic, and whether it stands there field by field (`Mirrored`) or in a form of its own that viewers draw (`Viewed`);
/// without it, the topic is not recorded. `injectable by name` lets faults be injected into the topic by its name, and
/// `injectable by service` into one service's topic (`health/shield`); without it, the topic takes no faults.
///
/// The first argument is a `$`, for the macro that it defines.
macro_rules! topics {
    (($d:tt) $(
        $(#[doc = $doc:literal])+
        $id:ident = $number:literal, $kind:ident $type:ident $($header:ident)? $([$count:ident <= $max:ident])?
        $(, recorded in $part:ident as $form:ident)? $(, injectable by $by:ident)?
        { $($field:ident: $value:expr),+ $(,)? }
    )+) => {
        /// A topic of the table.
        #[derive(
            Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, TryFromBytes,
        )]
        #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
        #[cfg_attr(feature = "ipc", type_name("guidedog/TopicId/1"))]
        #[repr(C)]
        #[serde(rename_all = "snake_case")]
        pub enum TopicId {
            /// No topic: where a message has none to name.
            #[default]
            None = 0,
            $($(#[doc = $doc])+ $id = $number,)+
        }

        named!(TopicId);

        /// The table. `Recorder` among the subscribers is the tap: its slot is counted in, so that recording changes
        /// nothing.
        pub const TOPICS: &[TopicSpec] = &[$(TopicSpec {
            id: TopicId::$id,
            doc: concat!($($doc),+),
            type_name: stringify!($type),
            payload: payload!($kind $type $($header)?),
            recorded: { const PARTS: &[&str] = &[$(stringify!($part))?]; !PARTS.is_empty() },
            injectable: injectable_by_name!($($by)?),
            $($field: $value),+
        }),+];

        $(on_topic! { $id $kind $type $($header)? $({ $count <= $max })? })+

        /// Calls a macro with every topic, in the order of the table: `message Id Type;`, or `frame Id Marker;`.
        #[macro_export]
        macro_rules! for_each_topic {
            ($d callback:ident) => { $d callback! { $($kind $id $type;)+ } };
        }

        /// Calls a macro with every recorded topic, in the order of the table, and the file that has it:
        /// `message Id Type in Part as Form;`, or `frame Id Marker in Part as Form;`.
        #[macro_export]
        macro_rules! for_each_recorded_topic {
            ($d callback:ident) => { $d callback! { $($($kind $id $type in $part as $form;)?)+ } };
        }

        /// Calls a macro with every topic that faults can be injected into, in the order of the table:
        /// `message Id Type by name;`, or `frame Id Marker by name;`, or `by service` where each service has its own.
        #[macro_export]
        macro_rules! for_each_injectable_topic {
            ($d callback:ident) => { $d callback! { $($($kind $id $type by $by;)?)+ } };
        }
    };
}

topics! {
    ($)
    /// One turn of the lidar: ranges in metres.
    LidarScan = 1, frame LidarScan ScanHeader, recorded in Small as Viewed, injectable by name {
        name: "lidar/scan",
        publishers: &[Lidar, Replay],
        live_publishers: 1,
        subscribers: &[Odometry, Policy, Shield, Recorder],
        buffer: 2,
        borrowed: 3,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "scan", default_ms: 200, most_ms: 300 },
        why: "the newest scan and, in stepped time, the one of the step before; one held while the next is looked at",
    }
    /// One turn of the second lidar: ranges in metres.
    SecondScan = 21, frame SecondScan SecondScanHeader, recorded in Small as Viewed, injectable by name {
        name: "lidar/second",
        publishers: &[SecondLidar, Replay],
        live_publishers: 1,
        subscribers: &[Shield, Recorder],
        buffer: 2,
        borrowed: 3,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "second_scan", default_ms: 250, most_ms: 300 },
        why: "as lidar/scan; a permit that the first lidar's scan renews rests on a scan that may be a period older",
    }
    /// One image of the depth camera: millimetres.
    DepthFrame = 2, frame DepthFrame DepthHeader, recorded in Depth as Viewed, injectable by name {
        name: "depth/frame",
        publishers: &[Depth, Replay],
        live_publishers: 1,
        subscribers: &[Odometry, Policy, Shield, Recorder],
        buffer: 2,
        borrowed: 3,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "depth", default_ms: 200, most_ms: 300 },
        why: "as lidar/scan; megabytes a frame, so no deeper",
    }
    /// Pose and velocity of the robot in the odometry frame.
    Odometry = 3, message Odometry, recorded in Small as Viewed, injectable by name {
        name: "odometry",
        publishers: &[Odometry, Replay],
        live_publishers: 1,
        subscribers: &[Lidar, SecondLidar, Policy, Shield, Locomotion, Cue, Speak, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "odometry", default_ms: 100, most_ms: 150 },
        why: "up to 100 Hz: one a step, of two steps, and room for a reader that is late by 60 ms",
    }
    /// A cue as recognised. The supervisor alone accepts it.
    Cue = 4, message Cue, recorded in Small as Mirrored, injectable by name {
        name: "cue",
        publishers: &[Cue, Replay],
        live_publishers: 1,
        subscribers: &[Policy, Shield, Locomotion, Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "cue", default_ms: 1000, most_ms: 5000 },
        why: "events that must not be lost, a stop among them",
    }
    /// An operator's cue on its way to the cue service.
    CueRequest = 5, message CueRequest, recorded in Small as Mirrored, injectable by name {
        name: "cue/request",
        publishers: &[Supervisor],
        live_publishers: 1,
        subscribers: &[Cue, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "events that must not be lost",
    }
    /// One decision of a policy: how probable each action is.
    PolicyAction = 6, message PolicyAction [action_count <= MAX_ACTIONS], recorded in Small as Mirrored,
    injectable by name {
        name: "policy/action",
        publishers: &[Policy],
        live_publishers: 2,
        subscribers: &[Shield, Supervisor, Replay, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Decision,
        why: "one a decision from the active policy and from a shadow",
    }
    /// The shield's verdict on a scan or a decision, and the permit.
    ShieldPermit = 7, message Permit, recorded in Small as Mirrored, injectable by name {
        name: "shield/permit",
        publishers: &[Shield],
        live_publishers: 1,
        subscribers: &[Locomotion, Supervisor, Replay, Speak, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Expiry,
        why: "a scan and a decision may each give one in the same step, of two steps; only the newest counts",
    }
    /// Run, fault or lock, and why; the cue and the policy in force.
    Mode = 8, message Mode, recorded in Small as Mirrored, injectable by name {
        name: "mode",
        publishers: &[Supervisor],
        live_publishers: 1,
        subscribers: &[
            Lidar, SecondLidar, Depth, Odometry, Cue, Policy, Shield, Locomotion, Simulator, Replay, Speak, Recorder,
        ],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "mode", default_ms: 200, most_ms: 300 },
        why: "only the newest counts; at most one a step, and as much again for a reader that is late",
    }
    /// The velocity that is applied, and what limits it.
    LocomotionState = 9, message LocomotionState, recorded in Small as Mirrored, injectable by name {
        name: "locomotion/state",
        publishers: &[Locomotion],
        live_publishers: 1,
        subscribers: &[Supervisor, Odometry, Speak, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: false,
        max_age: AgeLimit::Unlimited,
        why: "50 Hz, read when the supervisor wakes for something else, at the latest every 50 ms",
    }
    /// Whether the emergency stop lets the robot move.
    Estop = 15, message EmergencyStop, recorded in Small as Mirrored {
        name: "estop",
        publishers: &[Estop],
        live_publishers: 1,
        subscribers: &[Locomotion, Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Configured { key: "estop", default_ms: 100, most_ms: 150 },
        why: "a press and a release may come at once, and neither may be lost; 50 Hz besides",
    }
    /// Whether a cue was accepted, and why not.
    CueAnswer = 16, message CueAnswer, recorded in Small as Mirrored {
        name: "cue/answer",
        publishers: &[Supervisor],
        live_publishers: 1,
        subscribers: &[Speak, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "events that must not be lost",
    }
    /// A cue that was heard and waits for the tone before motion.
    CueHeard = 18, message CueHeard, recorded in Small as Mirrored {
        name: "cue/heard",
        publishers: &[Cue],
        live_publishers: 1,
        subscribers: &[Speak, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "events; only the newest waits for its tone",
    }
    /// A sentence that the robot says: its beginning and its end.
    SpeechSaid = 17, message SpeechSaid, recorded in Small as Mirrored {
        name: "speech/said",
        publishers: &[Speak],
        live_publishers: 1,
        subscribers: &[Cue, Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "events that must not be lost: a sentence that is cut and the next one come at once",
    }
    /// The true state of the simulated world.
    WorldTruth = 11, message WorldTruth [walker_count <= MAX_WALKERS], recorded in Small as Mirrored {
        name: "world/truth",
        publishers: &[Simulator],
        live_publishers: 1,
        subscribers: &[Lidar, SecondLidar, Depth, Odometry, Emulator, Cue, Locomotion, Supervisor, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "one a step of 10 ms, of two steps, and as much again for a reader that is late",
    }
    /// The velocity that the simulated robot is commanded.
    WorldCommand = 12, message RobotCommand {
        name: "world/command",
        publishers: &[Locomotion, Emulator],
        live_publishers: 2,
        subscribers: &[Simulator, Recorder],
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "the newest command counts",
    }
    /// One turn of the lidar in a world whose simulator casts the rays: ranges in metres.
    WorldScan = 19, frame WorldScan WorldScanHeader {
        name: "world/scan",
        publishers: &[Simulator],
        live_publishers: 1,
        subscribers: &[Lidar, Emulator],
        buffer: 2,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "the driver or the emulated lidar copies the newest one at once",
    }
    /// One image of the depth camera in a world whose simulator casts the rays: millimetres.
    WorldFrame = 20, frame WorldFrame WorldFrameHeader {
        name: "world/frame",
        publishers: &[Simulator],
        live_publishers: 1,
        subscribers: &[Depth, Emulator],
        buffer: 2,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "as world/scan",
    }
    /// The beat of a service, with its counters.
    Health = 10, message Health [port_count <= MAX_PORTS], injectable by service {
        name: "health",
        publishers: EVERY_SERVICE,
        live_publishers: 2,
        subscribers: &[Supervisor, Recorder],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: false,
        max_age: AgeLimit::Beat,
        why: "50 Hz, drained at 50 Hz: two on the way, and four times that for a supervisor that overslept",
    }
    /// The next step of stepped time.
    ClockStep = 13, message ClockStep [member_count <= MAX_MEMBERS] {
        name: "clock/step",
        publishers: &[Simulator, Replay],
        live_publishers: 1,
        subscribers: MEMBERS,
        buffer: 4,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "the next step comes only when all members took this one; a starting process may be steps behind",
    }
    /// A member has done its step.
    ClockAck = 14, message ClockAck [roster_count <= MAX_MEMBERS] {
        name: "clock/ack",
        publishers: MEMBERS,
        live_publishers: MEMBERS.len() + 1,
        subscribers: &[Simulator, Replay, Supervisor],
        buffer: 8,
        borrowed: 2,
        loans: 2,
        wakes: true,
        max_age: AgeLimit::Unlimited,
        why: "one a step and member, and rosters between",
    }
}

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

    /// The services that have a topic of their own of this name; [`ServiceId::None`] alone where all share one.
    #[must_use]
    pub const fn owners(self) -> &'static [ServiceId] {
        if matches!(self, Self::Health) { EVERY_SERVICE } else { &[ServiceId::None] }
    }
}

impl core::fmt::Display for TopicId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::{AgeLimit, TOPICS, TopicId};
    use crate::ServiceId;

    #[test]
    fn every_topic_has_a_number_and_a_name_of_its_own_and_a_reason() {
        for spec in TOPICS {
            assert!((1..=TOPICS.len()).contains(&(spec.id as usize)), "{}: numbers leave no gap", spec.name);
            assert_eq!(TOPICS.iter().filter(|other| other.name == spec.name).count(), 1, "{}", spec.name);
            assert!(!spec.why.is_empty() && spec.buffer >= 2 && !spec.publishers.is_empty(), "{}", spec.name);
        }
        assert_eq!(TopicId::LidarScan.name(), "lidar/scan");
        assert!(TopicId::None.spec().is_none());
    }

    #[test]
    fn every_topic_has_room_for_its_publishers_and_names_each_service_once() {
        for spec in TOPICS {
            assert!(spec.live_publishers > 0 && spec.borrowed > 0 && spec.loans > 0, "{}", spec.name);
            for services in [spec.publishers, spec.subscribers] {
                let named = |service| services.iter().filter(|other| **other == service).count();
                assert!(services.iter().all(|service| *service != ServiceId::None), "{}", spec.name);
                assert!(services.iter().all(|service| named(*service) == 1), "{}: a service twice", spec.name);
            }
        }
    }

    #[test]
    fn the_tap_has_a_slot_on_what_is_recorded() {
        for spec in TOPICS.iter().filter(|spec| spec.recorded) {
            assert!(spec.subscribers.contains(&ServiceId::Recorder), "{}", spec.name);
        }
    }

    #[test]
    fn a_configured_age_has_a_default() {
        for spec in TOPICS {
            if let AgeLimit::Configured { default_ms, most_ms, .. } = spec.max_age {
                assert!((1..=most_ms).contains(&default_ms), "{}", spec.name);
            }
        }
    }
}
