//! Finds the floor in a depth frame. Gravity is the reference, and the frame may only trim it: a plane that is fitted
//! freely tips into the first hole. What goes on from it at the slope of a ramp is floor too, cell by cell.

mod cells;

use nalgebra::{Matrix3, Vector2, Vector3};

pub use cells::FloorCell;
pub(super) use cells::{Cells, Look};

/// Largest trim of the height of the floor under the robot, metres,
const OFF_MAX_M: f64 = 0.03;
/// and of its slope on either axis: two degrees.
const SLOPE_MAX: f64 = 0.035;
/// A source's attitude is off by half a degree.
const TRIM: Prior = Prior { off_sigma_m: 0.015, slope_sigma: 0.009, off_max_m: OFF_MAX_M, slope_max: SLOPE_MAX };
/// Error of a floor point in a pixel, one standard deviation at 1 m, metres. It grows with the distance.
const PLACE_SIGMA_M: f64 = 0.01;
/// Points farther away are not used, metres.
pub(super) const REACH_M: f64 = 3.0;
/// Points farther off the fitted floor are outliers, metres.
const OUTSIDE_M: f64 = 0.04;
const ROUNDS: usize = 3;
/// What is known of the floor before it is looked at: one standard deviation of its height under the robot, metres, and
/// of its slope on either axis, and the most of each.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    pub(super) off_sigma_m: f64,
    pub(super) slope_sigma: f64,
    pub(super) off_max_m: f64,
    pub(super) slope_max: f64,
}

/// Height of the floor over the level one: an offset under the robot, and a slope ahead and to the left.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Plane {
    off_m: f64,
    ahead: f64,
    left: f64,
}

impl Plane {
    /// Fits the floor to points (robot frame: ahead, left, height over the level floor, metres), with the error of the
    /// attitude as prior.
    pub(super) fn of(places: &[Vector3<f64>]) -> Self {
        let mut plane = Self::default();
        for round in 0..ROUNDS {
            let gate = |distance_m: f64| if round == 0 { gate_m(distance_m) } else { OUTSIDE_M };
            plane = plane.fitted(places, gate, &TRIM);
        }
        plane
    }

    /// One that leads through the robot's place, with a slope ahead and to the left.
    pub(super) fn sloped(ahead: f64, left: f64) -> Self {
        Self { off_m: 0.0, ahead, left }
    }

    /// Its slope ahead and to the left.
    pub(super) fn slope(&self) -> Vector2<f64> {
        Vector2::new(self.ahead, self.left)
    }

    /// How high the floor is at a place, metres.
    pub(super) fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.off_m + self.ahead * x_m + self.left * y_m
    }

    /// The plane through the places that lie within a gate of this one, at their distance from the robot.
    pub(super) fn fitted(&self, places: &[Vector3<f64>], gate_m: impl Fn(f64) -> f64, known: &Prior) -> Self {
        let sigmas = Vector3::new(known.off_sigma_m, known.slope_sigma, known.slope_sigma);
        let prior = sigmas.map(|sigma| sigma.powi(-2));
        let (mut normal, mut right) = (Matrix3::from_diagonal(&prior), Vector3::zeros());
        for place in places {
            let distance_m = place.xy().norm();
            if distance_m > REACH_M || (place.z - self.height_m(place.x, place.y)).abs() > gate_m(distance_m) {
                continue;
            }
            let weight = (PLACE_SIGMA_M * distance_m.max(0.5)).powi(-2);
            let row = Vector3::new(1.0, place.x, place.y);
            normal += row * row.transpose() * weight;
            right += row * (place.z * weight);
        }
        // The prior makes it regular.
        let Some(solution) = normal.cholesky().map(|factor| factor.solve(&right)) else { return *self };
        Self {
            off_m: solution.x.clamp(-known.off_max_m, known.off_max_m),
            ahead: solution.y.clamp(-known.slope_max, known.slope_max),
            left: solution.z.clamp(-known.slope_max, known.slope_max),
        }
    }
}

/// How far the level floor may be off at a distance, metres.
fn gate_m(distance_m: f64) -> f64 {
    OFF_MAX_M + SLOPE_MAX * distance_m
}

#[cfg(test)]
mod tests {
    use super::{Plane, SLOPE_MAX};
    use nalgebra::Vector3;

    fn places(height_m: impl Fn(f64, f64) -> f64) -> Vec<Vector3<f64>> {
        let place = |i: usize| (0.6 + 0.05 * (i / 21) as f64, 0.1 * (i % 21) as f64 - 1.0);
        (0..21 * 40).map(place).map(|(x, y)| Vector3::new(x, y, height_m(x, y))).collect()
    }

    #[test]
    fn an_attitude_that_is_a_degree_off_is_found() {
        let floor = Plane::of(&places(|x, y| 0.01 + 0.017 * x - 0.009 * y));
        assert!((floor.height_m(2.0, 0.5) - (0.01 + 0.034 - 0.0045)).abs() < 2e-3, "{floor:?}");
    }

    #[test]
    fn a_hole_does_not_tip_it_and_a_box_does_not_lift_it() {
        let hole = Plane::of(&places(|x, _| if x > 1.7 { -0.3 } else { 0.0 }));
        assert!(hole.height_m(1.4, 0.0).abs() < 0.003, "{hole:?}");
        let low = Plane::of(&places(|x, y| if x > 1.2 && y.abs() < 0.3 { 0.08 } else { 0.0 }));
        assert!(low.height_m(1.2, 0.0).abs() < 0.015, "{low:?}");
    }

    #[test]
    fn it_never_slopes_further_than_an_attitude_is_off() {
        let ramp = Plane::of(&places(|x, _| 0.083 * x));
        assert!(ramp.ahead <= SLOPE_MAX && ramp.off_m.abs() <= 0.03, "{ramp:?}");
        assert_eq!(Plane::of(&[]), Plane::default());
    }
}
