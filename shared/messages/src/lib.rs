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
pub mod json;
mod mode;
mod pose;
mod sensors;
mod service;
mod speech;
pub mod stops;
pub mod topic;
mod world;

pub use clock::*;
pub use estop::*;
pub use fault::{Device, Fault, Injection, Target};
pub use guidance::*;
pub use header::*;
pub use health::*;
pub use mode::*;
pub use pose::*;
pub use sensors::*;
pub use service::*;
pub use speech::*;
pub use stops::{StopClass, StopKind};
pub use topic::TopicId;
pub use world::*;

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
