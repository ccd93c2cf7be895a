//! Every type that crosses a process border, with units and frames, and the topic table.
//!
//! SI units; names carry unit and frame (`range_max_m`, `yaw_rad`, `robot_from_lidar`). Frames are x forward, y left,
//! yaw counter-clockwise (ROS REP 103). Times are run time in nanoseconds. This crate has no logic, no I/O and no
//! clock; with the feature `ipc` its types can live in iceoryx2's shared memory.

mod clock;
mod estop;
pub mod fault;
mod guidance;
mod header;
mod health;
mod mode;
mod pose;
mod sensors;
mod service;
mod speech;
pub mod stops;
pub mod topic;
mod world;

pub use clock::{ClockAck, ClockKind, ClockStep, MAX_MEMBERS, Member, QUANTUM_NS};
pub use estop::{EmergencyStop, StopInput};
pub use fault::{Device, Fault, Injection, Target};
pub use guidance::{
    Cue, CueAnswer, CueHeard, CueKind, CueRefusal, CueRequest, CueSource, MAX_ACTIONS, NO_BEAM, Outcome, Permit,
    PermitCause, PolicyAction, UnsafeCause,
};
pub use header::{AHEAD_NS, Frame, Header, Message, age_ns};
pub use health::{
    Health, LATENCY_BUCKETS, Latency, LatencyHistogram, MAX_PORTS, Microphone, MicrophoneState, PortCounters, PortRole,
    ServiceState,
};
pub use mode::{CueInForce, LocomotionState, Mode, ModeClass, StopKind, StopReason};
pub use pose::{Pose2, Twist2};
pub use sensors::{DepthFrame, DepthHeader, LidarScan, MAX_BEAMS, Odometry, Pose3, ScanHeader};
pub use service::ServiceId;
pub use speech::{SpeechPhase, SpeechSaid, SpeechText, Urgency};
pub use topic::TopicId;
pub use world::{MAX_WALKERS, RobotCommand, Walker, WorldTruth};

/// Nanoseconds in a second, for conversions between run time and SI seconds.
pub const NS_PER_S: u64 = 1_000_000_000;

/// Seconds as a whole number of nanoseconds of run time; negative and non-finite values become 0.
#[must_use]
pub fn ns_from_s(seconds: f64) -> u64 {
    // A float-to-integer `as` saturates, and maps NaN to 0.
    (seconds * NS_PER_S as f64).round() as u64
}

/// Nanoseconds of run time as seconds.
#[must_use]
pub fn s_from_ns(ns: u64) -> f64 {
    ns as f64 / NS_PER_S as f64
}
