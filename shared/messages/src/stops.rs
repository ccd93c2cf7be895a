//! The stops: one row for each, from which the type, its name, its class and its texts for an operator follow.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

use crate::json::named;

/// How a stop ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopClass {
    /// A stop within run. It ends by itself as soon as a permit comes.
    Hold,
    /// A stop within run that locomotion keeps until the epoch is greater. The supervisor makes a fault of it, which an
    /// accepted cue ends.
    Latched,
    /// A mode. An accepted cue ends it.
    Fault,
    /// A mode. `resume` ends it, and then a cue starts the robot.
    Lock,
}

impl StopClass {
    /// The name, as in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Latched => "latched",
            Self::Fault => "fault",
            Self::Lock => "lock",
        }
    }
}

/// One row of the table: a kind of stop as an operator reads of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StopInfo {
    /// Which.
    pub kind: StopKind,
    /// Its name, as in reports: snake case.
    pub name: &'static str,
    /// How it ends.
    pub class: StopClass,
    /// Whether the robot waits within run for it, with a cue in force. Without a cue there is nothing to wait for.
    pub holds_a_cue: bool,
    /// Whether locomotion keeps it until the epoch is greater, so that only a fault and a new cue let it go on.
    /// Locomotion keeps two modes in this way as well: it boots in one, and reads the emergency stop itself.
    pub latched_by_locomotion: bool,
    /// What happened.
    pub meaning: &'static str,
    /// What to do about it.
    pub advice: &'static str,
}

/// Declares the kinds of stop: `Kind = number, "name" { .. }` with the fields of [`StopInfo`], in the order in which an
/// operator reads them. The number is the one in shared memory: it never changes.
macro_rules! stops {
    ($(
        $kind:ident = $number:literal, $name:literal {
            class: $class:ident,
            holds_a_cue: $holds_a_cue:literal, latched_by_locomotion: $latched:literal,
            meaning: $meaning:literal,
            advice: $advice:expr $(,)?
        }
    )+) => {
        /// What kind of stop it is. Its row in [`STOPS`] says what happened and what to do.
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
        #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
        #[cfg_attr(feature = "ipc", type_name("guidedog/StopKind/1"))]
        #[repr(C)]
        pub enum StopKind {
            /// No stop.
            #[default]
            #[serde(rename = "none")]
            None = 0,
            $(#[doc = concat!(stringify!($class), ": ", $meaning, ".")]
            #[serde(rename = $name)]
            $kind = $number,)+
        }

        named!(StopKind);

        /// Every kind of stop.
        pub const STOPS: &[StopInfo] = &[$(StopInfo {
            kind: StopKind::$kind,
            name: $name,
            class: StopClass::$class,
            holds_a_cue: $holds_a_cue,
            latched_by_locomotion: $latched,
            meaning: $meaning,
            advice: $advice,
        },)+];
    };
}

impl StopKind {
    /// Its row; `None` for [`StopKind::None`].
    #[must_use]
    pub const fn info(self) -> Option<&'static StopInfo> {
        let mut row = 0;
        while row < STOPS.len() {
            if STOPS[row].kind as u32 == self as u32 {
                return Some(&STOPS[row]);
            }
            row += 1;
        }
        None
    }

    /// The name, as in reports: snake case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self.info() {
            Some(info) => info.name,
            None => "none",
        }
    }

    /// Whether the robot waits within run for it ([`StopInfo::holds_a_cue`]).
    #[must_use]
    pub const fn holds_a_cue(self) -> bool {
        match self.info() {
            Some(info) => info.holds_a_cue,
            None => false,
        }
    }

    /// Whether locomotion keeps it until the epoch is greater ([`StopInfo::latched_by_locomotion`]).
    #[must_use]
    pub const fn is_latched(self) -> bool {
        match self.info() {
            Some(info) => info.latched_by_locomotion,
            None => false,
        }
    }
}

const CUE: &str = "give a cue once the robot is ready";
const LOG: &str = "its log in the run directory says why; it is restarted: give a cue once the robot is ready";

stops! {
    Boot = 1, "boot" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: true,
        meaning: "the run has just begun",
        advice: CUE,
    }
    ServiceDied = 2, "service_died" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a process that motion needs is dead",
        advice: LOG,
    }
    ServiceHung = 3, "service_hung" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a process takes input and gives nothing back, or no longer takes part",
        advice: LOG,
    }
    BeatsMissed = 4, "beats_missed" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a process fell silent: stopped, stuck, or starved of the CPU",
        advice: LOG,
    }
    MemoryExhausted = 5, "memory_exhausted" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a process has more memory of its own than it may: it leaks",
        advice: LOG,
    }
    FilesExhausted = 6, "files_exhausted" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a process has more descriptors open than it may: it leaks them",
        advice: LOG,
    }
    StreamSlow = 7, "stream_slow" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a stream comes too seldom, though its process has all its input",
        advice: LOG,
    }
    StreamStale = 8, "stream_stale" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a stream is over twice its max age",
        advice: "look at its driver or device; then a cue",
    }
    SupervisorStalled = 9, "supervisor_stalled" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the supervisor itself did not run for too long",
        advice: "free the CPU; then a cue",
    }
    BrakeEngaged = 10, "brake_engaged" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "locomotion was gone or silent, and the brake stopped the robot",
        advice: LOG,
    }
    PoseJump = 11, "pose_jump" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the odometry pose jumped further than the robot can walk",
        advice: "look at odometry; then a cue",
    }
    Resumed = 12, "resumed" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the operator ended a lock",
        advice: CUE,
    }
    OperatorStop = 13, "operator_stop" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the operator's stop",
        advice: "guidedog resume, then a cue",
    }
    RestartBudgetSpent = 14, "restart_budget_spent" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "a service died too often",
        advice: "mend it, guidedog resume, then a cue",
    }
    ShuttingDown = 15, "shutting_down" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the run is ending",
        advice: "none",
    }
    NoCue = 16, "no_cue" {
        class: Hold,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "no cue is in force",
        advice: "give a cue",
    }
    StopCue = 17, "stop_cue" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the handler's stop cue",
        advice: "give a cue",
    }
    PolicyStop = 18, "policy_stop" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the policy chose to stand: the way has ended, or there is none",
        advice: "another cue",
    }
    NoPermit = 19, "no_permit" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the shield has given no permit for this run, cue and policy yet",
        advice: "wait",
    }
    PermitExpired = 20, "permit_expired" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "no permit came in time",
        advice: "ages and loads of shield and sensors: guidedog status",
    }
    PermitInvalid = 21, "permit_invalid" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "a permit that no shield of ours would give",
        advice: "report it: a process does not do as it should",
    }
    AllUnsafe = 22, "all_unsafe" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the shield leaves no action but stop: every motion would hit something",
        advice: "make way, or take robot and handler out by hand",
    }
    RemainderUnsafe = 23, "remainder_unsafe" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "something came into the way of the running action",
        advice: "wait",
    }
    HandlerNotSeen = 24, "handler_not_seen" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "nobody is where the handler should be",
        advice: "take the handle again",
    }
    StepBack = 45, "step_back" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the robot is about to step back, and tells the handler first",
        advice: "step back with it, and leave it room",
    }
    Narrow = 46, "narrow" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the way ahead is too narrow for robot and handler side by side",
        advice: "come behind the robot and say forward; if it does not speak, give another cue",
    }
    Wide = 47, "wide" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the handler walks behind the robot, and there is room beside it again",
        advice: "come beside the robot and say forward",
    }
    InputUnusable = 25, "input_unusable" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "a stream cannot be judged on: too old, or no measurement",
        advice: "look at its driver or device",
    }
    OdometryStale = 26, "odometry_stale" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "odometry is over its max age at locomotion",
        advice: "look at its driver or device",
    }
    ModeStale = 27, "mode_stale" {
        class: Latched,
        holds_a_cue: true, latched_by_locomotion: true,
        meaning: "nothing was heard of the supervisor for too long",
        advice: "free the CPU; then a cue",
    }
    LifelineClosed = 28, "lifeline_closed" {
        class: Latched,
        holds_a_cue: true, latched_by_locomotion: true,
        meaning: "a process that motion needs has just died",
        advice: CUE,
    }
    SupervisorLost = 29, "supervisor_lost" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the supervisor is gone, and the run ends",
        advice: "start another run",
    }
    StreamStuck = 30, "stream_stuck" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "a sensor sends the same again while the robot moves",
        advice: "look at its device",
    }
    ScanContradicts = 31, "scan_contradicts" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "a scan contradicts the last one wholesale",
        advice: "look at the lidar; where the robot was carried elsewhere, start another run",
    }
    OdometryContradicts = 32, "odometry_contradicts" {
        class: Latched,
        holds_a_cue: true, latched_by_locomotion: true,
        meaning: "odometry contradicts what the robot was commanded",
        advice: "look which is wrong: odometry, or a robot that is blocked or slips; then a cue",
    }
    RemoteStop = 33, "remote_stop" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "somebody stopped the robot by its hand remote",
        advice: "make it stand by the remote and let go of it; guidedog resume, then a cue",
    }
    BatteryLow = 34, "battery_low" {
        class: Fault,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the robot's battery is nearly empty: it may lie down where it is",
        advice: "charge it; where it has to go on, lower locomotion.charge_stop_percent",
    }
    EmergencyStop = 35, "emergency_stop" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: true,
        meaning: "the emergency stop was pressed, unplugged, or fell silent",
        advice: "look why; release it, or plug it in; guidedog resume, then a cue",
    }
    RobotFell = 37, "robot_fell" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: true,
        meaning: "the robot has fallen",
        advice: "look to the handler first; make the robot stand by its remote; guidedog resume, then a cue",
    }
    DropOff = 38, "drop_off" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the floor drops where the robot was to go: an edge, stairs or a hole",
        advice: "another cue, or lead robot and handler away by hand",
    }
    FloorUnseen = 39, "floor_unseen" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "robot or handler would come over floor that the camera has not seen",
        advice: "another cue, so that the robot looks there; or lead robot and handler on by hand",
    }
    NoFloor = 40, "no_floor" {
        class: Latched,
        holds_a_cue: true, latched_by_locomotion: true,
        meaning: "the camera shows no floor, though nothing stands before it",
        advice: "check that the camera is not aimed too high; a dark or shiny floor gives no depth; \
                 `guidedog doctor --config` says which floor it should see; then a cue",
    }
    StepUp = 41, "step_up" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "the floor rises where the robot was to go, by a step that is too high",
        advice: "another cue, or lead robot and handler on by hand; \
                 shield.floor.step_max_m says how high a step the robot takes",
    }
    LowStepDown = 42, "low_step_down" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "a low step leads down where the robot was to go, and it waits for the handler's word",
        advice: "the cue forward, given once the robot says so, takes the step; or another cue",
    }
    LowStepUp = 43, "low_step_up" {
        class: Hold,
        holds_a_cue: true, latched_by_locomotion: false,
        meaning: "a low step leads up where the robot was to go, and it waits for the handler's word",
        advice: "the cue forward, given once the robot says so, takes the step; or another cue",
    }
    CameraTilted = 44, "camera_tilted" {
        class: Latched,
        holds_a_cue: true, latched_by_locomotion: true,
        meaning: "the floor in view slopes: the camera is not held as configured, or the robot began on a slope",
        advice: "set the camera as depth.pose says, or depth.pose as it is mounted, and start again; begin a walk on \
                 level floor",
    }
    Arrived = 36, "arrived" {
        class: Lock,
        holds_a_cue: false, latched_by_locomotion: false,
        meaning: "the walk has come to its goal, and the run is ending",
        advice: "none",
    }
}

impl StopKind {
    /// Whether the floor is the cause, at a place that is told.
    #[must_use]
    pub fn is_floor(self) -> bool {
        matches!(self, Self::DropOff | Self::FloorUnseen | Self::StepUp | Self::LowStepDown | Self::LowStepUp)
    }
}

#[cfg(test)]
mod tests {
    use super::{STOPS, StopClass, StopKind};

    #[test]
    fn every_kind_of_stop_has_a_number_and_a_name_of_its_own_and_finds_its_row() {
        for info in STOPS {
            assert!((1..=STOPS.len()).contains(&(info.kind as usize)), "{}: numbers leave no gap", info.name);
            assert_eq!(info.kind.info(), Some(info));
            assert_eq!(STOPS.iter().filter(|other| other.name == info.name).count(), 1, "{}", info.name);
            assert!(!info.meaning.is_empty() && !info.advice.is_empty(), "{}", info.name);
        }
        assert_eq!((StopKind::None.info(), StopKind::None.name()), (None, "none"));
    }

    #[test]
    fn the_stops_that_hold_a_cue_and_those_that_locomotion_latches_are_these() {
        let names = |wanted: fn(StopKind) -> bool| {
            STOPS.iter().filter(|info| wanted(info.kind)).map(|info| info.name).collect::<Vec<_>>()
        };
        let holding = [
            "stop_cue",
            "policy_stop",
            "no_permit",
            "permit_expired",
            "permit_invalid",
            "all_unsafe",
            "remainder_unsafe",
            "handler_not_seen",
            "step_back",
            "narrow",
            "wide",
            "input_unusable",
            "odometry_stale",
            "mode_stale",
            "lifeline_closed",
            "stream_stuck",
            "scan_contradicts",
            "odometry_contradicts",
            "drop_off",
            "floor_unseen",
            "no_floor",
            "step_up",
            "low_step_down",
            "low_step_up",
            "camera_tilted",
        ];
        assert_eq!(names(StopKind::holds_a_cue), holding);
        let latched = [
            "boot",
            "mode_stale",
            "lifeline_closed",
            "odometry_contradicts",
            "emergency_stop",
            "robot_fell",
            "no_floor",
            "camera_tilted",
        ];
        assert_eq!(names(StopKind::is_latched), latched);
        assert!(!StopKind::None.holds_a_cue() && !StopKind::None.is_latched());
    }

    #[test]
    fn only_a_stop_within_run_holds_a_cue_and_locomotion_latches_all_of_the_class_and_no_hold() {
        for info in STOPS {
            let within_run = matches!(info.class, StopClass::Hold | StopClass::Latched);
            assert!(within_run || !info.holds_a_cue, "{}", info.name);
            assert!(info.latched_by_locomotion || info.class != StopClass::Latched, "{}", info.name);
            assert!(!info.latched_by_locomotion || info.class != StopClass::Hold, "{}", info.name);
        }
    }
}
