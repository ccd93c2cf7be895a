//! Cue, action, permit: the way from the handler's wish to a motion that is allowed.

use crate::json::{mirrored, named};
use crate::{Formation, Header, Pose2, StopReason, Twist2};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// The most actions that an action table may have.
pub const MAX_ACTIONS: usize = 16;

/// What the handler asks for (Kim et al. 2023, section 3).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/CueKind/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum CueKind {
    /// Stand still.
    #[default]
    Stop = 0,
    /// Along the corridor.
    Forward,
    /// Into the next opening on the left.
    Left,
    /// Into the next opening on the right.
    Right,
}

named!(CueKind);

impl CueKind {
    /// The name, as on the command line and in route files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Forward => "forward",
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    /// The kind of that name, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Stop, Self::Forward, Self::Left, Self::Right].into_iter().find(|kind| kind.name() == name)
    }

    /// Whether the cue asks for motion.
    #[must_use]
    pub fn is_moving(self) -> bool {
        self != Self::Stop
    }
}

/// Where a cue came from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/CueSource/2"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum CueSource {
    /// `guidedog cue`, through the supervisor.
    #[default]
    Operator = 0,
    /// A route file.
    Script,
    /// The scripted handler, giving the cue in force again after a fault.
    ScriptAgain,
    /// The robot turned more than half-way into the branch: forward follows a done left or right.
    TurnDone,
    /// The handler's voice.
    Voice,
}

named!(CueSource);

mirrored! {
    /// A cue as recognised. The supervisor alone accepts it.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Cue/2"))]
    #[repr(C)]
    pub struct Cue {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// What is asked for.
        pub kind: CueKind,
        /// Where it came from.
        pub source: CueSource,
        /// In [0, 1]; of a voice the head's score.
        pub confidence: f32,
        /// Of a voice: how far it stood out from what is always there, decibels.
        pub signal_db: f32 = default,
        /// Of a voice: share of samples that were cut off in the last second.
        pub clipped: f32 = default,
        /// The cue's start frame in the odometry frame: its origin is the robot's place, its x axis the travel
        /// direction.
        pub odom_from_start: Pose2,
        /// The odometry incarnation in whose frame `odom_from_start` is.
        pub odometry_incarnation: u32,
        /// For an operator's cue the seq of the request that it answers, for one that goes on from a done turn the seq
        /// of that turn's cue; otherwise 0.
        pub request_seq: u64,
    }
}

impl Cue {
    /// Whether its numbers are numbers, so that it can be followed.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        // The first life of odometry is 1: a cue that names none was given before there was a place to give it from.
        let has_start = self.odometry_incarnation > 0 || !self.kind.is_moving();
        has_start && self.odom_from_start.is_finite() && (0.0..=1.0).contains(&self.confidence)
    }
}

mirrored! {
    /// An operator's cue on its way to the cue service.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/CueRequest/1"))]
    #[repr(C)]
    pub struct CueRequest {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// What is asked for.
        pub kind: CueKind,
    }
}

/// Why a cue was refused.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/CueRefusal/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum CueRefusal {
    /// It was not: it is accepted.
    #[default]
    None = 0,
    /// It is older than a cue may be.
    TooOld,
    /// Its start frame or its confidence is none.
    Unusable,
    /// The turn that it goes on from is no longer in force.
    TurnOver,
    /// It was given before the stop that it would end.
    BeforeStop,
    /// The run is locked.
    Locked,
    /// A service that motion needs is not up.
    ServiceNotUp,
    /// The line of a service that motion needs is not watched yet.
    LineNotArmed,
    /// A service that motion needs is silent.
    ServiceSilent,
    /// A stream that motion needs is too old.
    StreamStale,
    /// The emergency stop is not released.
    EmergencyStop,
    /// The robot's battery is nearly empty.
    BatteryLow,
}

named!(CueRefusal);

impl CueRefusal {
    /// Every reason to refuse, in the order of its number.
    pub const ALL: [Self; 11] = [
        Self::TooOld,
        Self::Unusable,
        Self::TurnOver,
        Self::BeforeStop,
        Self::Locked,
        Self::ServiceNotUp,
        Self::LineNotArmed,
        Self::ServiceSilent,
        Self::StreamStale,
        Self::EmergencyStop,
        Self::BatteryLow,
    ];

    /// The name, as in reports and language files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::TooOld => "too_old",
            Self::Unusable => "unusable",
            Self::TurnOver => "turn_over",
            Self::BeforeStop => "before_stop",
            Self::Locked => "locked",
            Self::ServiceNotUp => "service_not_up",
            Self::LineNotArmed => "line_not_armed",
            Self::ServiceSilent => "service_silent",
            Self::StreamStale => "stream_stale",
            Self::EmergencyStop => "emergency_stop",
            Self::BatteryLow => "battery_low",
        }
    }
}

mirrored! {
    /// The supervisor's answer to a cue: accepted or refused, and why.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/CueAnswer/1"))]
    #[repr(C)]
    pub struct CueAnswer {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// What was asked for.
        pub kind: CueKind,
        /// Where it came from.
        pub source: CueSource,
        /// The cue's incarnation and seq; 0 where an operator's cue was refused before it became one.
        pub cue_incarnation: u32,
        /// See `cue_incarnation`.
        pub cue_seq: u64,
        /// Why it was refused; [`CueRefusal::None`]: it is accepted.
        pub refusal: CueRefusal,
        /// The service or stream that is lacking, or the stop that locks the run.
        pub reason: StopReason,
    }
}

mirrored! {
    /// A cue that the recogniser has heard and does not give before a tone was heard: *forward*, where the robot stands
    /// by a stop. The stamp is when it was said.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/CueHeard/1"))]
    #[repr(C)]
    pub struct CueHeard {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// Which cue.
        pub kind: CueKind,
        /// The recogniser's score.
        pub confidence: f32,
    }
}

mirrored! {
    /// Decision `n` of a policy.
    #[derive(Debug, Clone, Copy, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/PolicyAction/2"))]
    #[repr(C)]
    pub struct PolicyAction {
        /// Stamp (of the decision, `n dt`), seq, incarnation.
        pub header: Header,
        /// Number of the decision: it was due at `n dt`.
        pub decision: u64,
        /// Digest of the action table that the probabilities are over.
        pub action_table_id: u64,
        /// How many of `probabilities` are meant.
        pub action_count: u32,
        /// Probability of each action, in the order of the table; they sum to 1.
        pub probabilities: [f32; MAX_ACTIONS],
        /// The cue that the decision is for: incarnation and seq, 0 where none is in force.
        pub cue_incarnation: u32,
        /// See `cue_incarnation`.
        pub cue_seq: u64,
        /// Where the policy wants the handler to walk. Another formation than the one in force stops the robot, and
        /// the handler is asked for it.
        pub formation: Formation = default,
        /// Stamp and seq of the scan used; 0 where none was.
        pub scan_stamp_ns: u64,
        /// See `scan_stamp_ns`.
        pub scan_seq: u64,
        /// Stamp and seq of the depth frame used; 0 where none was.
        pub depth_stamp_ns: u64,
        /// See `depth_stamp_ns`.
        pub depth_seq: u64,
        /// Stamp and seq of the odometry used; 0 where none was.
        pub odometry_stamp_ns: u64,
        /// See `odometry_stamp_ns`.
        pub odometry_seq: u64,
    }
}

impl Default for PolicyAction {
    fn default() -> Self {
        Self {
            header: Header::default(),
            decision: 0,
            action_table_id: 0,
            action_count: 0,
            probabilities: [0.0; MAX_ACTIONS],
            cue_incarnation: 0,
            cue_seq: 0,
            formation: Formation::Beside,
            scan_stamp_ns: 0,
            scan_seq: 0,
            depth_stamp_ns: 0,
            depth_seq: 0,
            odometry_stamp_ns: 0,
            odometry_seq: 0,
        }
    }
}

/// What the shield found. Only [`Outcome::Granted`] lets the robot move.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Outcome/4"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Refused: there is no decision to judge yet, or it is too old.
    #[default]
    NoAction = 0,
    /// Judged and free: a permit.
    Granted,
    /// Judged: the action drawn is stop, which needs no permit.
    Stop,
    /// Judged: the shield leaves no action but stop (hold). The cause is that of the motion that the policy wanted
    /// most.
    AllUnsafe,
    /// Judged: the running action is no longer free (hold until the next decision).
    RemainderUnsafe,
    /// Refused: nobody is where the handler should be.
    HandlerNotSeen,
    /// Refused: the mode is not *run*, or is too old.
    NotInRun,
    /// Refused: the decision is for a cue that is no longer, or not yet, in force.
    CueMismatch,
    /// Refused: the scan is not usable (wrong count, NaN only, absurd geometry).
    InvalidScan,
    /// Refused: the scan is over its max age.
    StaleScan,
    /// Refused: odometry is missing, over its max age, or jumped.
    StaleOdometry,
    /// Refused: depth is needed and missing, over its max age, or of the wrong size.
    StaleDepth,
    /// Refused: the decision's table or probabilities are not usable.
    InvalidAction,
    /// Judged: the action ran to its end and the next decision has not come.
    ActionEnded,
    /// Refused: scans are the same bytes again and again while odometry says that the robot moves.
    StuckScan,
    /// Refused: depth frames likewise, where depth is needed.
    StuckDepth,
    /// Refused: the scan contradicts the last one that was judged on, wholesale.
    ScanContradicts,
    /// Refused: the camera shows no floor, though nothing stands before it.
    NoFloor,
    /// Refused: the camera is tilted against its configured mount, or the robot began on a slope.
    CameraTilted,
    /// Refused: the second lidar's scan is missing, over its max age, or not usable.
    StaleSecondScan,
    /// Judged: the action drawn is a step back, which waits until the handler has been told (hold).
    StepsBack,
    /// Judged: the passage ahead is too narrow for robot and handler side by side. The handler is asked to come behind
    /// (hold).
    Narrow,
    /// Judged: the handler walks behind, and there is room for them beside the robot again. They are asked to come
    /// there (hold).
    Wide,
}

named!(Outcome);

impl Outcome {
    /// Whether the scan was judged (a verdict) rather than refused.
    #[must_use]
    pub const fn is_verdict(self) -> bool {
        matches!(
            self,
            Self::Granted
                | Self::Stop
                | Self::AllUnsafe
                | Self::RemainderUnsafe
                | Self::ActionEnded
                | Self::StepsBack
                | Self::Narrow
                | Self::Wide
        )
    }

    /// Every outcome, in the order of its number.
    pub const ALL: [Self; 23] = [
        Self::NoAction,
        Self::Granted,
        Self::Stop,
        Self::AllUnsafe,
        Self::RemainderUnsafe,
        Self::HandlerNotSeen,
        Self::NotInRun,
        Self::CueMismatch,
        Self::InvalidScan,
        Self::StaleScan,
        Self::StaleOdometry,
        Self::StaleDepth,
        Self::InvalidAction,
        Self::ActionEnded,
        Self::StuckScan,
        Self::StuckDepth,
        Self::ScanContradicts,
        Self::NoFloor,
        Self::CameraTilted,
        Self::StaleSecondScan,
        Self::StepsBack,
        Self::Narrow,
        Self::Wide,
    ];

    /// The name, as in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoAction => "no_action",
            Self::Granted => "granted",
            Self::Stop => "stop",
            Self::AllUnsafe => "all_unsafe",
            Self::RemainderUnsafe => "remainder_unsafe",
            Self::HandlerNotSeen => "handler_not_seen",
            Self::NotInRun => "not_in_run",
            Self::CueMismatch => "cue_mismatch",
            Self::InvalidScan => "invalid_scan",
            Self::StaleScan => "stale_scan",
            Self::StaleOdometry => "stale_odometry",
            Self::StaleDepth => "stale_depth",
            Self::InvalidAction => "invalid_action",
            Self::ActionEnded => "action_ended",
            Self::StuckScan => "stuck_scan",
            Self::StuckDepth => "stuck_depth",
            Self::ScanContradicts => "scan_contradicts",
            Self::NoFloor => "no_floor",
            Self::CameraTilted => "camera_tilted",
            Self::StaleSecondScan => "stale_second_scan",
            Self::StepsBack => "steps_back",
            Self::Narrow => "narrow",
            Self::Wide => "wide",
        }
    }
}

/// Why the shield published.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/PermitCause/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum PermitCause {
    /// A new scan: the running action is judged again.
    #[default]
    Scan = 0,
    /// A new decision: drawn and judged on the newest scan.
    Decision,
}

named!(PermitCause);

/// What made a motion unsafe.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/UnsafeCause/3"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum UnsafeCause {
    /// Nothing did.
    #[default]
    None = 0,
    /// A beam ends in the hull.
    Beam,
    /// A point that the camera sees lies in the hull.
    Point,
    /// A point that is remembered and cannot be seen now lies in the hull.
    Memory,
    /// A run of unknown beams is too wide.
    Unknown,
    /// Too much of the hull is seen by nothing.
    Unseen,
    /// It leads to where a motion did not get before: something is there that no sensor tells of.
    Contact,
    /// The floor drops within what is kept from an edge.
    DropOff,
    /// It leads over floor that was never seen.
    FloorUnseen,
    /// The floor rises by a step that is too high.
    StepUp,
    /// The floor falls by a step that the handler may have taken, within what is kept from an edge.
    LowStepDown,
    /// The same, where it rises.
    LowStepUp,
    /// A point that the second lidar sees lies in the hull.
    Second,
    /// It leads back, and the handler stands too near or was not seen.
    Handler,
}

named!(UnsafeCause);

impl UnsafeCause {
    /// Whether the robot waits there for the handler's word.
    #[must_use]
    pub fn is_low_step(self) -> bool {
        matches!(self, Self::LowStepDown | Self::LowStepUp)
    }

    /// Whether the floor ends there, or goes on at another height.
    #[must_use]
    pub fn is_edge(self) -> bool {
        matches!(self, Self::DropOff | Self::StepUp) || self.is_low_step()
    }

    /// Whether the floor forbids it.
    #[must_use]
    pub fn is_floor(self) -> bool {
        self.is_edge() || self == Self::FloorUnseen
    }
}

/// No beam: what a verdict names where it judged none.
pub const NO_BEAM: u32 = u32::MAX;

mirrored! {
    /// The shield's verdict, and the permit where `outcome` is [`Outcome::Granted`].
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Permit/4"))]
    #[repr(C)]
    pub struct Permit {
        /// Stamp (run time of the verdict), seq, incarnation.
        pub header: Header,
        /// What was found.
        pub outcome: Outcome,
        /// What the verdict answers.
        pub cause: PermitCause,
        /// Whether the shield left no action but stop.
        pub all_unsafe: bool,
        /// Streams that the run declares absent: bit `TopicId as u8`.
        pub absent_streams: u32,
        /// The decision judged.
        pub decision: u64,
        /// Index of the action in the table.
        pub action: u32,
        /// Bit *i*: action *i* was unsafe when the decision was drawn, or the robot waits before an edge.
        pub unsafe_mask: u32,
        /// Velocity allowed, robot frame.
        pub velocity: Twist2,
        /// Run time at which the action is due to end.
        pub action_end_ns: u64,
        /// Run time after which the permit is worth nothing.
        pub expiry_ns: u64,
        /// The mode epoch that the shield read.
        pub epoch: u64,
        /// The policy incarnation whose decision was drawn.
        pub policy_incarnation: u32,
        /// The odometry incarnation used.
        pub odometry_incarnation: u32,
        /// The lidar incarnation used.
        pub lidar_incarnation: u32,
        /// The cue that the decision was for.
        pub cue_incarnation: u32,
        /// The cue that the decision was for.
        pub cue_seq: u64,
        /// Part of the swept hull that no beam sees, square metres.
        pub unseen_area_m2: f64,
        /// Smallest reading minus threshold over the judged beams, metres; negative means unsafe. Where every action is
        /// unsafe, this and what follows is of the most probable one.
        pub margin_m: f64,
        /// The beam with that margin, by the lidar's own number, or [`NO_BEAM`].
        pub beam: u32,
        /// Why the motion is unsafe.
        pub unsafe_cause: UnsafeCause,
        /// The beam's reading, metres. Of a point, an edge or floor: its distance to the hull; less than 0 in it.
        pub reading_m: f64,
        /// The beam's threshold: from the lidar to where it leaves the hull, metres. Of an edge: the distance kept.
        pub threshold_m: f64,
        /// Where the point, the edge or the floor is that makes the motion unsafe, robot frame, metres; 0 for a beam.
        pub place_x_m: f64 = default,
        /// See `place_x_m`.
        pub place_y_m: f64 = default,
        /// How much the floor rises there by a step, away from the robot, metres; less than 0: it falls. 0 where the
        /// cause is no step.
        pub step_m: f64 = default,
        /// The motion leads over floor that was not seen and is assumed.
        pub assumes_floor: bool = default,
        /// Seq and stamp of the scan judged.
        pub scan_seq: u64,
        /// See `scan_seq`.
        pub scan_stamp_ns: u64,
        /// Seq and stamp of the depth frame used; 0 where none was.
        pub depth_seq: u64,
        /// See `depth_seq`.
        pub depth_stamp_ns: u64,
        /// Seq and stamp of the odometry used.
        pub odometry_seq: u64,
        /// See `odometry_seq`.
        pub odometry_stamp_ns: u64,
        /// The shield's estimate of the handler, robot frame.
        pub robot_from_handler: Pose2,
    }
}
