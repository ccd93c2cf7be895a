//! From a pose of the camera in space to one of the robot on the floor: pure.

use grabber::realsense::Tracked;
use messages::{Pose2, Pose3, Twist2};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// How far the quaternion's length may be off 1.
const UNIT_WITHIN: f64 = 0.01;
/// Of the robot's ahead, what lies in the floor's plane; less, and it has no heading.
const LEVEL_MIN: f64 = 0.5;

/// The camera's axes (x right, y up, z backward) told by ours (x forward, y left, z up).
fn ours(theirs: [f32; 3]) -> Vector3<f64> {
    let [x, y, z] = theirs.map(f64::from);
    Vector3::new(-z, -x, y)
}

/// Where the robot is, how it moves, and how its body is held: as [`messages::Attitude`] has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planar {
    pub pose: Pose2,
    pub twist: Twist2,
    pub roll_rad: f64,
    pub pitch_rad: f64,
}

/// Where the robot is, in the frame that begins where the camera did; and how it moves, robot frame. None where the
/// camera tells no numbers, or the robot would stand on its head.
pub fn planar(tracked: &Tracked, robot_from_camera: Pose3) -> Option<Planar> {
    let [x, y, z, w] = tracked.rotation;
    let turned = Quaternion::from_parts(f64::from(w), ours([x, y, z]));
    let (place, velocity) = (ours(tracked.place_m), ours(tracked.velocity_mps));
    let turn = ours(tracked.turn_radps);
    let finite = [place, velocity, turn].iter().all(|vector| vector.iter().all(|number| number.is_finite()));
    let is_rotation = (turned.norm() - 1.0).abs() < UNIT_WITHIN;
    if !finite || !is_rotation {
        return None;
    }
    let odom_from_camera = UnitQuaternion::from_quaternion(turned);
    let mounted = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), robot_from_camera.yaw_rad)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), robot_from_camera.pitch_rad);
    let odom_from_robot = odom_from_camera * mounted.inverse();
    let ahead = odom_from_robot * Vector3::x();
    if ahead.xy().norm() < LEVEL_MIN {
        return None;
    }
    let arm = odom_from_robot * Vector3::new(robot_from_camera.x_m, robot_from_camera.y_m, robot_from_camera.z_m);
    let (at, moves) = (place - arm, velocity - turn.cross(&arm));
    let yaw_rad = ahead.y.atan2(ahead.x);
    let (sin, cos) = yaw_rad.sin_cos();
    let (vx_mps, vy_mps) = (cos * moves.x + sin * moves.y, cos * moves.y - sin * moves.x);
    let twist = Twist2 { vx_mps, vy_mps, wz_radps: turn.z };
    let (roll_rad, pitch_rad, _) = odom_from_robot.euler_angles();
    Some(Planar { pose: Pose2::new(at.x, at.y, yaw_rad), twist, roll_rad, pitch_rad })
}

#[cfg(test)]
mod tests {
    use super::{Planar, planar};
    use grabber::realsense::Tracked;
    use messages::Pose3;
    use nalgebra::{UnitQuaternion, Vector3};

    /// The camera's own numbers, where it is moved from its beginning in our axes, its axes turned likewise.
    fn tracked(place: [f64; 3], turned: UnitQuaternion<f64>, velocity: [f64; 3], wz_radps: f64) -> Tracked {
        let theirs = |[x, y, z]: [f64; 3]| [-y, z, -x].map(|number| number as f32);
        let [x, y, z] = theirs([turned.i, turned.j, turned.k]);
        Tracked {
            place_m: theirs(place),
            rotation: [x, y, z, turned.w as f32],
            velocity_mps: theirs(velocity),
            turn_radps: theirs([0.0, 0.0, wz_radps]),
            confidence: 3,
            ..Tracked::default()
        }
    }

    fn about_z(angle_rad: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
    }

    fn near(found: Option<Planar>, pose: [f64; 3], twist: [f64; 3]) {
        let Planar { pose: at, twist: moves, .. } = found.expect("it is a pose");
        let found = [at.x_m, at.y_m, at.yaw_rad, moves.vx_mps, moves.vy_mps, moves.wz_radps];
        let wanted = [pose, twist].concat();
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}, not {wanted:?}");
    }

    #[test]
    fn the_robot_is_where_its_camera_says_less_the_mount() {
        let level = UnitQuaternion::identity();
        // 2 m ahead, 1 m to the left, a quarter turn to the left, walking on along the camera's new ahead.
        let seen = tracked([2.0, 1.0, 0.0], about_z(std::f64::consts::FRAC_PI_2), [0.0, 0.5, 0.0], 0.0);
        near(planar(&seen, Pose3::default()), [2.0, 1.0, std::f64::consts::FRAC_PI_2], [0.5, 0.0, 0.0]);
        // Mounted 0.3 m before the robot's middle: a turn about it moves the camera sideways, and not the robot.
        let mount = Pose3 { x_m: 0.3, ..Pose3::default() };
        near(planar(&tracked([0.3, 0.0, 0.0], level, [0.0, 0.3, 0.0], 1.0), mount), [0.0; 3], [0.0, 0.0, 1.0]);
        // Looking 30 degrees down and backwards: neither is the robot's.
        let mount = Pose3 { yaw_rad: 3.0, pitch_rad: 0.5, z_m: 0.4, ..Pose3::default() };
        let down = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.5);
        near(planar(&tracked([0.0; 3], down, [0.0; 3], 0.0), mount), [0.0, 0.0, -3.0], [0.0; 3]);
    }

    #[test]
    fn a_body_that_leans_is_told_whatever_the_mount() {
        let mount = Pose3 { yaw_rad: 3.0, pitch_rad: 0.5, z_m: 0.4, ..Pose3::default() };
        let mounted = about_z(3.0) * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.5);
        let body = about_z(0.7) * UnitQuaternion::from_euler_angles(0.10, -0.05, 0.0);
        // What the camera tells is since its beginning, when the body stood level.
        let found = planar(&tracked([0.0; 3], body * mounted, [0.0; 3], 0.0), mount).expect("it is a pose");
        let off = [found.roll_rad - 0.10, found.pitch_rad + 0.05, found.pose.yaw_rad - 0.7];
        assert!(off.iter().all(|off| off.abs() < 1e-6), "{found:?}");
    }

    #[test]
    fn no_numbers_and_a_camera_that_hangs_by_its_cable_are_no_pose() {
        let mut seen = tracked([0.0; 3], UnitQuaternion::identity(), [0.0; 3], 0.0);
        seen.place_m[1] = f32::NAN;
        assert_eq!(planar(&seen, Pose3::default()), None);
        assert_eq!(planar(&Tracked { rotation: [0.0; 4], ..Tracked::default() }, Pose3::default()), None);
        let hangs = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.5);
        assert_eq!(planar(&tracked([0.0; 3], hangs, [0.0; 3], 0.0), Pose3::default()), None);
    }
}
