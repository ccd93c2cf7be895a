//! Run, fault or lock, why, and what the robot does about it.

use crate::header::message;
use crate::{Cue, Header, Pose2, ServiceId, TopicId, Twist2};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// The class of the mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ModeClass/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum ModeClass {
    /// Stopped by a fault; ends by an accepted cue.
    #[default]
    Fault = 0,
    /// Motion is possible with a permit.
    Run,
    /// Stopped by the operator, an emergency stop or a spent restart budget; ends by `resume`.
    Lock,
}

impl ModeClass {
    /// The name, as in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::Run => "run",
            Self::Lock => "lock",
        }
    }
}

/// What kind of stop it is. Each is documented with who is at fault and what to do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/StopKind/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum StopKind {
    /// No stop.
    #[default]
    None = 0,
    /// Fault: the run has just begun, and nothing starts motion but an accepted cue.
    Boot,
    /// Fault: a critical process is dead. The supervisor restarts it.
    ServiceDied,
    /// Fault: a critical process takes input and gives nothing back, or no longer takes part. It is restarted.
    ServiceHung,
    /// Fault: a critical process missed its beats. It is restarted.
    BeatsMissed,
    /// Fault: a critical process has more memory of its own than it may: it leaks. It is restarted.
    MemoryExhausted,
    /// Fault: a critical process has more descriptors open than it may: it leaks them. It is restarted.
    FilesExhausted,
    /// Fault: a process gives a stream more seldom than motion needs it, though it has all its input. It is restarted.
    StreamSlow,
    /// Fault: a stream is over twice its max age.
    StreamStale,
    /// Fault: the supervisor's own loop slept for longer than `mode` may be old; what happened meanwhile is not known.
    SupervisorStalled,
    /// Fault: the brake engaged because locomotion was gone or silent.
    BrakeEngaged,
    /// Fault: the odometry pose jumped further than the robot can walk; cue frame and handler's estimate are void.
    PoseJump,
    /// Fault: the operator resumed a locked run; the next accepted cue starts motion.
    Resumed,
    /// Lock: the operator's stop.
    OperatorStop,
    /// Lock: a service spent its restart budget.
    RestartBudgetSpent,
    /// Lock: the run is ending.
    ShuttingDown,
    /// Hold: no cue is in force.
    NoCue,
    /// Hold: the handler's stop cue.
    StopCue,
    /// Hold: the policy chose to stand.
    PolicyStop,
    /// Hold: no permit has come.
    NoPermit,
    /// Hold: the last permit expired.
    PermitExpired,
    /// Hold: the permit is not finite, out of bounds, or lives longer than it may.
    PermitInvalid,
    /// Hold: every action is unsafe.
    AllUnsafe,
    /// Hold: the rest of the running action is not free.
    RemainderUnsafe,
    /// Hold: nobody is where the handler should be.
    HandlerNotSeen,
    /// Hold: the shield refused for lack of usable input.
    InputUnusable,
    /// Hold: odometry is over its max age at locomotion.
    OdometryStale,
    /// Hold: mode is over its max age at locomotion; motion needs a greater epoch.
    ModeStale,
    /// Hold: a lifeline closed; motion needs a greater epoch.
    LifelineClosed,
    /// Fault: the supervisor is gone; the robot stops and the run ends.
    SupervisorLost,
    /// Hold: a sensor sends the same bytes again and again while odometry says that the robot moves. Its driver or the
    /// device is at fault: restart it.
    StreamStuck,
    /// Hold: a scan contradicts the last one that was judged on, wholesale. The lidar measures wrongly, or the robot
    /// was carried elsewhere: look at the lidar, or start another run.
    ScanContradicts,
    /// Hold, until the epoch is greater: odometry contradicts what the robot was commanded. Odometry is frozen or out
    /// of scale, or the robot does not obey (blocked, slipping, pushed): look which, and give a new cue.
    OdometryContradicts,
    /// Lock: somebody stopped the robot itself, by its hand remote. Whoever holds the remote has the robot.
    RemoteStop,
    /// Fault: the robot's battery is nearly empty, and it may lie down where it is.
    BatteryLow,
    /// Lock: the emergency stop was pressed, unplugged, or fell silent.
    EmergencyStop,
    /// Lock: the walk has come to its goal, and the run is ending.
    Arrived,
}

impl StopKind {
    /// Whether it is a hold: a stop within run, that ends by itself.
    #[must_use]
    pub const fn is_hold(self) -> bool {
        matches!(
            self,
            Self::StopCue
                | Self::PolicyStop
                | Self::NoPermit
                | Self::PermitExpired
                | Self::PermitInvalid
                | Self::AllUnsafe
                | Self::RemainderUnsafe
                | Self::HandlerNotSeen
                | Self::InputUnusable
                | Self::OdometryStale
                | Self::ModeStale
                | Self::LifelineClosed
                | Self::StreamStuck
                | Self::ScanContradicts
                | Self::OdometryContradicts
        )
    }

    /// Whether locomotion holds until the epoch is greater, so that only a fault and a new cue let it go on.
    #[must_use]
    pub const fn is_latched(self) -> bool {
        matches!(
            self,
            Self::ModeStale | Self::LifelineClosed | Self::Boot | Self::OdometryContradicts | Self::EmergencyStop
        )
    }

    /// The name, as in reports: snake case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Boot => "boot",
            Self::ServiceDied => "service_died",
            Self::ServiceHung => "service_hung",
            Self::BeatsMissed => "beats_missed",
            Self::MemoryExhausted => "memory_exhausted",
            Self::FilesExhausted => "files_exhausted",
            Self::StreamSlow => "stream_slow",
            Self::StreamStale => "stream_stale",
            Self::SupervisorStalled => "supervisor_stalled",
            Self::BrakeEngaged => "brake_engaged",
            Self::PoseJump => "pose_jump",
            Self::Resumed => "resumed",
            Self::OperatorStop => "operator_stop",
            Self::RestartBudgetSpent => "restart_budget_spent",
            Self::ShuttingDown => "shutting_down",
            Self::NoCue => "no_cue",
            Self::StopCue => "stop_cue",
            Self::PolicyStop => "policy_stop",
            Self::NoPermit => "no_permit",
            Self::PermitExpired => "permit_expired",
            Self::PermitInvalid => "permit_invalid",
            Self::AllUnsafe => "all_unsafe",
            Self::RemainderUnsafe => "remainder_unsafe",
            Self::HandlerNotSeen => "handler_not_seen",
            Self::InputUnusable => "input_unusable",
            Self::OdometryStale => "odometry_stale",
            Self::ModeStale => "mode_stale",
            Self::LifelineClosed => "lifeline_closed",
            Self::SupervisorLost => "supervisor_lost",
            Self::StreamStuck => "stream_stuck",
            Self::ScanContradicts => "scan_contradicts",
            Self::OdometryContradicts => "odometry_contradicts",
            Self::RemoteStop => "remote_stop",
            Self::BatteryLow => "battery_low",
            Self::EmergencyStop => "emergency_stop",
            Self::Arrived => "arrived",
        }
    }
}

/// Why the robot stands, with evidence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/StopReason/1"))]
#[repr(C)]
pub struct StopReason {
    /// What kind of stop.
    pub kind: StopKind,
    /// The service it is about, if any.
    pub service: ServiceId,
    /// The stream it is about, if any.
    pub topic: TopicId,
    /// The incarnation it is about; 0 where none is.
    pub incarnation: u32,
    /// Age that was seen (for a slow stream: from one message to the next), nanoseconds; 0 where none applies, the
    /// greatest where there is no usable stamp.
    pub age_ns: u64,
    /// Limit that it broke, nanoseconds; 0 where none applies.
    pub limit_ns: u64,
    /// What it had of what it exhausted: bytes, or descriptors; 0 where none applies.
    pub used: u64,
    /// Limit that this broke.
    pub used_limit: u64,
}

impl StopReason {
    /// A reason that needs no evidence beside its kind.
    #[must_use]
    pub const fn of(kind: StopKind) -> Self {
        let (service, topic) = (ServiceId::None, TopicId::None);
        Self { kind, service, topic, incarnation: 0, age_ns: 0, limit_ns: 0, used: 0, used_limit: 0 }
    }

    /// A reason about one service incarnation.
    #[must_use]
    pub const fn service(kind: StopKind, service: ServiceId, incarnation: u32) -> Self {
        Self { service, incarnation, ..Self::of(kind) }
    }

    /// A reason about a stream that is too old.
    #[must_use]
    pub const fn stream(kind: StopKind, topic: TopicId, age_ns: u64, limit_ns: u64) -> Self {
        Self { topic, age_ns, limit_ns, ..Self::of(kind) }
    }
}

impl core::fmt::Display for StopReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.kind.name())?;
        if self.service != ServiceId::None {
            write!(f, ": {}", self.service)?;
            if self.incarnation > 0 {
                write!(f, " (incarnation {})", self.incarnation)?;
            }
        }
        if self.topic != TopicId::None {
            write!(f, ": {}", self.topic)?;
        }
        let limit_ms = self.limit_ns / 1_000_000;
        match (self.kind, self.age_ns) {
            _ if self.limit_ns == 0 => {}
            (_, u64::MAX) => write!(f, ", nothing with a usable stamp, limit {limit_ms} ms")?,
            (StopKind::StreamSlow, apart) => write!(f, ", {} ms apart, limit {limit_ms} ms", apart / 1_000_000)?,
            (_, age_ns) => write!(f, ", {} ms old, limit {limit_ms} ms", age_ns / 1_000_000)?,
        }
        match (self.kind, self.used >> 20, self.used_limit >> 20) {
            _ if self.used_limit == 0 => Ok(()),
            (StopKind::MemoryExhausted, mib, limit) => write!(f, ", {mib} MiB of its own, limit {limit} MiB"),
            _ => write!(f, ", {}, limit {}", self.used, self.used_limit),
        }
    }
}

/// The cue in force, as accepted by the supervisor.
#[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/CueInForce/1"))]
#[repr(C)]
pub struct CueInForce {
    /// Whether there is one; the rest means nothing otherwise.
    pub valid: bool,
    /// The cue as it came, header included: (incarnation, seq) name it.
    pub cue: Cue,
}

/// The supervisor's word on whether motion is possible.
#[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Mode/1"))]
#[repr(C)]
pub struct Mode {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Run, fault or lock.
    pub class: ModeClass,
    /// Whether a moving cue would be accepted now.
    pub ready_for_cue: bool,
    /// The policy incarnation whose decisions the shield draws from.
    pub active_policy: u32,
    /// While a swapped policy is on probation, the one before it: its decision is drawn where the active one's does not
    /// come, and its running action goes on. 0: none.
    pub previous_policy: u32,
    /// The shield incarnation on the armed line: locomotion obeys no other.
    pub active_shield: u32,
    /// Raised at every entry into fault or lock, and at no other time.
    pub epoch: u64,
    /// Why the class is what it is.
    pub reason: StopReason,
    /// The moving cue in force.
    pub cue: CueInForce,
}

impl Mode {
    /// Whether the decisions of that incarnation may be drawn.
    #[must_use]
    pub const fn allows_policy(&self, incarnation: u32) -> bool {
        incarnation != 0 && (incarnation == self.active_policy || incarnation == self.previous_policy)
    }

    /// Whether it may follow `old`. An epoch rises by one at a time: one that leaps is no supervisor's. Of one that
    /// falls the one before was never true, for the supervisor only counts up.
    #[must_use]
    pub const fn may_follow(&self, old: &Self) -> bool {
        if self.epoch < old.epoch { self.header.seq > old.header.seq } else { self.epoch - old.epoch <= EPOCHS_AT_ONCE }
    }
}

/// Stops that a reader may have slept through.
const EPOCHS_AT_ONCE: u64 = 100;

/// What locomotion does.
#[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/LocomotionState/2"))]
#[repr(C)]
pub struct LocomotionState {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Velocity last written to the link.
    pub applied: Twist2,
    /// Why it is zero; [`StopKind::None`] while it is not.
    pub limited_by: StopReason,
    /// Velocity that the link reports, where it does.
    pub measured: Twist2,
    /// Whether `measured` means something.
    pub measured_valid: bool,
    /// Seq of the permit obeyed last.
    pub permit_seq: u64,
    /// Decision of the permit obeyed last.
    pub decision: u64,
    /// The epoch in force at locomotion.
    pub epoch: u64,
    /// Where the robot itself believes to be, in a frame of its own.
    pub own_from_robot: Pose2,
    /// Run time at which the robot told so, nanoseconds; 0 where it tells nothing, or nothing lately.
    pub own_stamp_ns: u64,
    /// Charge of its battery, percent; 0 where it does not tell (one that is empty counts as 1).
    pub charge_percent: u32,
    /// Whether somebody has stopped the robot by its hand remote, and nobody has resumed since.
    pub remote_stop: bool,
}

message!(Mode => Mode, LocomotionState => LocomotionState);
