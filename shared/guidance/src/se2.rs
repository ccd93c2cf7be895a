//! Planar rigid motions. `a_from_b` takes coordinates in frame B to frame A; `a_from_b * b_from_c` is `a_from_c`.

use messages::{Pose2, Twist2};
use nalgebra::{Isometry2, Point2, Vector2};

/// A planar rigid motion: where frame B is in frame A.
pub type Se2 = Isometry2<f64>;
/// A point in some frame, metres.
pub type Point = Point2<f64>;

/// The motion of a pose given as numbers.
#[must_use]
pub fn se2(pose: Pose2) -> Se2 {
    Se2::new(Vector2::new(pose.x_m, pose.y_m), pose.yaw_rad)
}

/// The numbers of a motion; yaw in (-pi, pi].
#[must_use]
pub fn pose2(a_from_b: &Se2) -> Pose2 {
    Pose2::new(a_from_b.translation.x, a_from_b.translation.y, a_from_b.rotation.angle())
}

/// The angle brought into (-pi, pi], radians.
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let wrapped = angle_rad.rem_euclid(std::f64::consts::TAU);
    if wrapped > std::f64::consts::PI { wrapped - std::f64::consts::TAU } else { wrapped }
}

/// The direction of a vector to 2e-5 rad, radians: a fourth of the time of `atan2`, for who only asks which beam or
/// sector it is in (Hastings 1955, sheet 11).
#[must_use]
#[inline(always)]
pub fn about_bearing_rad(vector: Vector2<f64>) -> f64 {
    let (x, y) = (vector.x.abs(), vector.y.abs());
    let ratio = x.min(y) / x.max(y).max(f64::MIN_POSITIVE);
    let square = ratio * ratio;
    let odd = 0.020_835_1;
    let sum = (((odd * square - 0.085_133) * square + 0.180_141) * square - 0.330_299_5) * square + 0.999_866;
    let octant = sum * ratio;
    let quadrant = if y > x { std::f64::consts::FRAC_PI_2 - octant } else { octant };
    let half = if vector.x < 0.0 { std::f64::consts::PI - quadrant } else { quadrant };
    if vector.y < 0.0 { -half } else { half }
}

/// Where a body is after moving for `dt_s` at a constant body velocity (the exponential map of SE(2)).
#[must_use]
pub fn exp(twist: Twist2, dt_s: f64) -> Se2 {
    let (dx, dy, turn) = (twist.vx_mps * dt_s, twist.vy_mps * dt_s, twist.wz_radps * dt_s);
    // sin(t)/t and (1-cos(t))/t by their series where the division would lose digits.
    let (a, b) = if turn.abs() < 1e-6 {
        (1.0 - turn * turn / 6.0, turn / 2.0)
    } else {
        (turn.sin() / turn, (1.0 - turn.cos()) / turn)
    };
    Se2::new(Vector2::new(a * dx - b * dy, b * dx + a * dy), turn)
}

/// The constant body velocity that makes the motion in `dt_s` (the logarithm of SE(2)); turns are taken on the short
/// arc.
#[must_use]
pub fn log(a_from_b: &Se2, dt_s: f64) -> Twist2 {
    let turn = a_from_b.rotation.angle();
    let half = turn / 2.0;
    let cot = if half.abs() < 1e-6 { 1.0 - half * half / 3.0 } else { half / half.tan() };
    let (x, y) = (a_from_b.translation.x, a_from_b.translation.y);
    Twist2 { vx_mps: (cot * x + half * y) / dt_s, vy_mps: (cot * y - half * x) / dt_s, wz_radps: turn / dt_s }
}

#[cfg(test)]
mod tests {
    use super::{about_bearing_rad, exp, log, pose2, se2, wrap_angle};
    use messages::{Pose2, Twist2};
    use nalgebra::Vector2;
    use std::f64::consts::PI;

    #[test]
    fn a_bearing_is_known_to_a_fiftieth_of_a_milliradian() {
        for i in -31_416..31_416 {
            let bearing = f64::from(i) * 1e-4;
            let about = about_bearing_rad(Vector2::new(bearing.cos(), bearing.sin()) * 3.0);
            assert!(wrap_angle(about - bearing).abs() < 2e-5, "{bearing}: {about}");
        }
        assert_eq!(about_bearing_rad(Vector2::zeros()), 0.0);
    }

    #[test]
    fn log_undoes_exp() {
        for (vx, vy, wz) in [(0.5, 0.0, 0.0), (0.5, -0.2, 0.35), (0.0, 0.3, -2.0), (0.5, 0.0, 1e-9)] {
            let twist = Twist2 { vx_mps: vx, vy_mps: vy, wz_radps: wz };
            let back = log(&exp(twist, 0.5), 0.5);
            assert!((back.vx_mps - vx).abs() < 1e-9 && (back.vy_mps - vy).abs() < 1e-9, "{back:?}");
            assert!((back.wz_radps - wz).abs() < 1e-9);
        }
    }

    #[test]
    fn a_pose_survives_the_way_there_and_back() {
        let pose = Pose2::new(1.0, -2.0, 3.0);
        let back = pose2(&(se2(pose) * se2(pose).inverse() * se2(pose)));
        assert!((back.x_m - 1.0).abs() < 1e-12 && (back.yaw_rad - 3.0).abs() < 1e-12);
        assert!((wrap_angle(3.0 * PI) - PI).abs() < 1e-12 && wrap_angle(-0.5) == -0.5);
    }
}
