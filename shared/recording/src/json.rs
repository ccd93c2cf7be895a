//! The pieces of Foxglove's schemas that the channels' JSON is made of.

use messages::json::Real;
use messages::{NS_PER_S, Pose2};
use serde::Serialize;

/// Foxglove's time.
#[derive(Debug, Default, Serialize)]
pub struct Time {
    sec: u64,
    nsec: u64,
}

impl Time {
    /// From run time, nanoseconds.
    pub const fn from_ns(ns: u64) -> Self {
        Self { sec: ns / NS_PER_S, nsec: ns % NS_PER_S }
    }
}

/// Foxglove's vector, metres.
#[derive(Debug, Default, Serialize)]
pub struct Vector3 {
    x: Real,
    y: Real,
    z: Real,
}

/// Foxglove's rotation.
#[derive(Debug, Default, Serialize)]
pub struct Quaternion {
    x: Real,
    y: Real,
    z: Real,
    w: Real,
}

/// Foxglove's pose.
#[derive(Debug, Default, Serialize)]
pub struct Pose {
    position: Vector3,
    orientation: Quaternion,
}

impl From<Pose2> for Vector3 {
    fn from(pose: Pose2) -> Self {
        Self { x: Real(pose.x_m), y: Real(pose.y_m), z: Real(0.0) }
    }
}

impl From<Pose2> for Quaternion {
    fn from(pose: Pose2) -> Self {
        let half_rad = 0.5 * pose.yaw_rad;
        Self { x: Real(0.0), y: Real(0.0), z: Real(half_rad.sin()), w: Real(half_rad.cos()) }
    }
}

impl From<Pose2> for Pose {
    fn from(pose: Pose2) -> Self {
        Self { position: pose.into(), orientation: pose.into() }
    }
}
