//! Planar poses and velocities as plain numbers. The mathematics on them is in `guidance`.

use crate::json::mirrored;
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::FromBytes;

mirrored! {
    /// A planar pose: where frame B is in frame A, for a value named `a_from_b`.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, FromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Pose2/1"))]
    #[serde(deny_unknown_fields)]
    #[repr(C)]
    pub struct Pose2 {
        /// Forward, metres.
        pub x_m: f64,
        /// Left, metres.
        pub y_m: f64,
        /// Counter-clockwise, radians, in (-pi, pi].
        pub yaw_rad: f64,
    }
}

mirrored! {
    /// A planar velocity in the body frame.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, FromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Twist2/1"))]
    #[repr(C)]
    pub struct Twist2 {
        /// Forward, metres per second.
        pub vx_mps: f64,
        /// To the left, metres per second.
        pub vy_mps: f64,
        /// Counter-clockwise, radians per second.
        pub wz_radps: f64,
    }
}

impl Pose2 {
    /// A pose from its three numbers: metres, metres, radians.
    #[must_use]
    pub const fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { x_m, y_m, yaw_rad }
    }

    /// Whether all three numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.yaw_rad.is_finite()
    }
}

impl Twist2 {
    /// No motion.
    pub const ZERO: Self = Self { vx_mps: 0.0, vy_mps: 0.0, wz_radps: 0.0 };

    /// Whether all three numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.vx_mps.is_finite() && self.vy_mps.is_finite() && self.wz_radps.is_finite()
    }

    /// Whether every component is exactly zero.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        *self == Self::ZERO
    }

    /// Whether a robot that moves so stands, for all that can be measured: under 1 cm/s and 0.01 rad/s.
    #[must_use]
    pub fn is_standing(&self) -> bool {
        self.speed_mps() < 0.01 && self.wz_radps.abs() < 0.01
    }

    /// Speed over ground, metres per second.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        self.vx_mps.hypot(self.vy_mps)
    }
}
