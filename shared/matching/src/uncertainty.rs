//! How far off a pose may be: covariances of x (m), y (m) and yaw (rad), each in the frame of the robot itself, so that
//! a pose that is uncertain along the way stays so when the robot turns.

use guidance::se2::Se2;
use nalgebra::Matrix3;

/// A covariance of x, y and yaw in the robot frame.
pub type Covariance = Matrix3<f64>;

/// How leg odometry wanders: each standard deviation grows with the root of the way or of the turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LegNoise {
    /// Of the place, after 1 m, metres.
    pub place_m_per_sqrt_m: f64,
    /// Of the heading, after 1 m, radians.
    pub yaw_rad_per_sqrt_m: f64,
    /// Of the heading, after a turn of 1 rad, radians.
    pub yaw_rad_per_sqrt_rad: f64,
}

/// Legs slip sideways on the spot, metres after a turn of 1 rad.
const PLACE_M_PER_SQRT_RAD: f64 = 0.02;
/// A robot that stands can be pushed: one standard deviation from one scan to the next, metres and radians.
const STANDING: (f64, f64) = (0.002, 0.001);

impl LegNoise {
    /// What a motion from one scan to the next adds.
    #[must_use]
    pub fn of(&self, moved: &Se2) -> Covariance {
        let (way_m, turn_rad) = (moved.translation.vector.norm(), moved.rotation.angle().abs());
        let place = self.place_m_per_sqrt_m.powi(2) * way_m + PLACE_M_PER_SQRT_RAD.powi(2) * turn_rad;
        let yaw = self.yaw_rad_per_sqrt_m.powi(2) * way_m + self.yaw_rad_per_sqrt_rad.powi(2) * turn_rad;
        let (place, yaw) = (place + STANDING.0.powi(2), yaw + STANDING.1.powi(2));
        Covariance::from_diagonal(&[place, place, yaw].into())
    }
}

/// The covariance of a pose after a motion that is itself known exactly.
#[must_use]
pub fn carried(covariance: &Covariance, moved: &Se2) -> Covariance {
    let adjoint = adjoint(&moved.inverse());
    adjoint * covariance * adjoint.transpose()
}

/// Standard deviations of x, y (odometry frame, metres) and yaw (radians).
#[must_use]
pub fn sigma(covariance: &Covariance, odom_from_robot: &Se2) -> [f64; 3] {
    let mut turn = Matrix3::identity();
    turn.fixed_view_mut::<2, 2>(0, 0).copy_from(odom_from_robot.rotation.to_rotation_matrix().matrix());
    let turned = turn * covariance * turn.transpose();
    [0, 1, 2].map(|i| turned[(i, i)].max(0.0).sqrt())
}

/// What a small motion in frame B is in frame A, for `a_from_b`.
fn adjoint(a_from_b: &Se2) -> Matrix3<f64> {
    let (sin, cos) = a_from_b.rotation.angle().sin_cos();
    let at = a_from_b.translation.vector;
    Matrix3::new(cos, -sin, at.y, sin, cos, -at.x, 0.0, 0.0, 1.0)
}
