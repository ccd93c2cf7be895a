//! Planar poses and velocities, and how the body is held over them, as plain numbers. The mathematics on them is in
//! `guidance`.

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

mirrored! {
    /// How the robot's body (`base_link`) is held over the level frame on the floor below it (`base_footprint`, which
    /// is meant by *robot* everywhere else): rolled about the forward axis, then pitched about the left axis, both
    /// right-handed (ROS REP 103).
    #[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Attitude/1"))]
    #[repr(C)]
    pub struct Attitude {
        /// Run time of the measurement, nanoseconds; 0 where no source tells the attitude.
        pub stamp_ns: u64,
        /// Positive with the left side up, radians.
        pub roll_rad: f64,
        /// Positive with the nose down, radians.
        pub pitch_rad: f64,
        /// Height of the body's origin over the floor, metres.
        pub height_m: f64,
        /// The same while the robot stands: heights of sensors are told for it, metres.
        pub standing_m: f64,
    }
}

impl Attitude {
    /// An attitude beyond this is not usable, radians.
    pub const MAX_RAD: f64 = std::f64::consts::FRAC_PI_4;
    /// No robot's body is higher, metres.
    pub const HEIGHT_MAX_M: f64 = 3.0;

    /// That of a body whose height no source tells: it is taken to be that at which it stands.
    #[must_use]
    pub const fn at_height(stamp_ns: u64, roll_rad: f64, pitch_rad: f64, standing_m: f64) -> Self {
        Self { stamp_ns, roll_rad, pitch_rad, height_m: standing_m, standing_m }
    }

    /// Whether a source tells it.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.stamp_ns != 0
    }

    /// Whether its numbers are those of a robot on its legs.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        // What is no number is within nothing.
        self.roll_rad.abs() <= Self::MAX_RAD
            && self.pitch_rad.abs() <= Self::MAX_RAD
            && [self.height_m, self.standing_m].iter().all(|m| (0.0..=Self::HEIGHT_MAX_M).contains(m))
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

/// Roll, pitch and yaw of a unit quaternion (w, x, y, z), as those of [`Attitude`] and [`Pose2`], radians.
#[must_use]
pub fn roll_pitch_yaw_rad([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    let roll_rad = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch_rad = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw_rad = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    [roll_rad, pitch_rad, yaw_rad]
}

/// The unit quaternion (w, x, y, z) of roll, pitch and yaw, radians: the inverse of [`roll_pitch_yaw_rad`].
#[must_use]
pub fn quaternion(roll_pitch_yaw_rad: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = roll_pitch_yaw_rad.map(|angle_rad| (angle_rad / 2.0).sin_cos());
    [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy]
}

#[cfg(test)]
mod tests {
    use super::{Attitude, quaternion, roll_pitch_yaw_rad};

    #[test]
    fn a_quaternion_is_turned_about_each_axis_by_the_right_hand() {
        let (sin, cos) = 0.1_f64.sin_cos();
        for axis in 0..3 {
            let mut quaternion = [cos, 0.0, 0.0, 0.0];
            quaternion[axis + 1] = sin;
            let angles = roll_pitch_yaw_rad(quaternion);
            assert!((0..3).all(|i| (angles[i] - if i == axis { 0.2 } else { 0.0 }).abs() < 1e-12), "{angles:?}");
        }
    }

    #[test]
    fn angles_are_those_of_their_quaternion() {
        for angles in [[0.1, -0.2, 0.3], [-0.4, 0.7, -3.0], [0.0, 0.0, 1.5]] {
            let found = roll_pitch_yaw_rad(quaternion(angles));
            assert!((0..3).all(|i| (found[i] - angles[i]).abs() < 1e-12), "{found:?}");
        }
    }

    #[test]
    fn an_attitude_of_no_robot_on_its_legs_is_not_usable() {
        let well = Attitude { stamp_ns: 1, roll_rad: 0.1, pitch_rad: -0.1, height_m: 0.3, standing_m: 0.3 };
        assert!(well.is_known() && well.is_usable() && !Attitude::default().is_known());
        for wrong in [
            Attitude { roll_rad: f64::NAN, ..well },
            Attitude { pitch_rad: 0.8, ..well },
            Attitude { roll_rad: -0.8, ..well },
            Attitude { height_m: f64::INFINITY, ..well },
            Attitude { height_m: -0.1, ..well },
        ] {
            assert!(!wrong.is_usable(), "{wrong:?}");
        }
    }
}
