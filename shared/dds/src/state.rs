//! What a robot says of itself, whatever its language.

use messages::{Pose2, Twist2, roll_pitch_yaw_rad};

/// Whether it can walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Posture {
    /// It stands or walks.
    #[default]
    Ready,
    /// It stands with its joints locked, and has to be told to balance first.
    Locked,
    /// It lies, or is limp: only whoever holds its remote makes it stand up.
    Down,
}

/// Where a robot is and goes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RobotState {
    /// Its velocity, robot frame.
    pub velocity: Twist2,
    /// Where it believes to be, in a frame of its own.
    pub own_from_robot: Pose2,
    /// How its body is held, about the forward and about the left axis, radians.
    pub roll_pitch_rad: [f64; 2],
    /// Whether it can walk.
    pub posture: Posture,
}

/// How far from one the length of an attitude's quaternion may be.
const UNIT_TOLERANCE: f64 = 0.02;

impl RobotState {
    /// A state of these numbers; nothing where one is not finite or the attitude (w, x, y, z) is no rotation.
    #[must_use]
    pub fn checked(velocity: Twist2, place_m: [f64; 2], quaternion: [f64; 4], posture: Posture) -> Option<Self> {
        let [w, x, y, z] = quaternion;
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let [roll_rad, pitch_rad, yaw_rad] = roll_pitch_yaw_rad(quaternion);
        let own_from_robot = Pose2::new(place_m[0], place_m[1], yaw_rad);
        let sound = velocity.is_finite() && own_from_robot.is_finite() && (length - 1.0).abs() <= UNIT_TOLERANCE;
        sound.then_some(Self { velocity, own_from_robot, roll_pitch_rad: [roll_rad, pitch_rad], posture })
    }
}
