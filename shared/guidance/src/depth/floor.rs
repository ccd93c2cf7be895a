//! Finds the floor in a depth frame. Gravity is the reference, and the frame may only trim it: a plane that is fitted
//! freely tips into the first hole.

use nalgebra::{Matrix3, Vector3};

/// Largest trim of the height of the floor under the robot, metres,
const OFF_MAX_M: f64 = 0.03;
/// and of its slope on either axis: two degrees.
const SLOPE_MAX: f64 = 0.035;
/// Error of the attitude, one standard deviation: metres, and half a degree.
const OFF_SIGMA_M: f64 = 0.015;
const SLOPE_SIGMA: f64 = 0.009;
/// Error of a floor point in a pixel, one standard deviation at 1 m, metres. It grows with the distance.
const PLACE_SIGMA_M: f64 = 0.01;
/// Points farther away are not used, metres.
const REACH_M: f64 = 3.0;
/// Points farther off the fitted floor are outliers, metres.
const OUTSIDE_M: f64 = 0.04;
const ROUNDS: usize = 3;

/// Height of the floor over the level one: an offset under the robot, and a slope ahead and to the left.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Floor {
    off_m: f64,
    ahead: f64,
    left: f64,
}

impl Floor {
    /// Fits the floor to points (robot frame: ahead, left, height over the level floor, metres), with the error of the
    /// attitude as prior. Returns none if most low points lie below the floor: obstacles there could pass for floor.
    pub(super) fn of(places: &[Vector3<f64>]) -> Option<Self> {
        let gate_m = |place: &&Vector3<f64>| OFF_MAX_M + SLOPE_MAX * place.xy().norm();
        let near = || places.iter().filter(|place| place.xy().norm() <= REACH_M);
        let on_floor = near().filter(|place| place.z.abs() <= gate_m(place)).count();
        let below = near().filter(|place| place.z < -gate_m(place)).count();
        if below > on_floor {
            return None;
        }
        let mut floor = Self::default();
        for round in 0..ROUNDS {
            let gate = |distance_m: f64| match round {
                0 => OFF_MAX_M + SLOPE_MAX * distance_m,
                _ => OUTSIDE_M,
            };
            floor = floor.fitted(places, gate);
        }
        Some(floor)
    }

    /// How high the floor is at a place, metres.
    pub(super) fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.off_m + self.ahead * x_m + self.left * y_m
    }

    fn fitted(&self, places: &[Vector3<f64>], gate_m: impl Fn(f64) -> f64) -> Self {
        let prior = Vector3::new(OFF_SIGMA_M, SLOPE_SIGMA, SLOPE_SIGMA).map(|sigma| sigma.powi(-2));
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
            off_m: solution.x.clamp(-OFF_MAX_M, OFF_MAX_M),
            ahead: solution.y.clamp(-SLOPE_MAX, SLOPE_MAX),
            left: solution.z.clamp(-SLOPE_MAX, SLOPE_MAX),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Floor, SLOPE_MAX};
    use nalgebra::Vector3;

    fn places(height_m: impl Fn(f64, f64) -> f64) -> Vec<Vector3<f64>> {
        let place = |i: usize| (0.6 + 0.05 * (i / 21) as f64, 0.1 * (i % 21) as f64 - 1.0);
        (0..21 * 40).map(place).map(|(x, y)| Vector3::new(x, y, height_m(x, y))).collect()
    }

    #[test]
    fn an_attitude_that_is_a_degree_off_is_found() {
        let floor = Floor::of(&places(|x, y| 0.01 + 0.017 * x - 0.009 * y)).expect("a floor");
        assert!((floor.height_m(2.0, 0.5) - (0.01 + 0.034 - 0.0045)).abs() < 2e-3, "{floor:?}");
    }

    #[test]
    fn a_hole_does_not_tip_it_and_a_box_does_not_lift_it() {
        let hole = Floor::of(&places(|x, _| if x > 1.7 { -0.3 } else { 0.0 })).expect("a floor");
        assert!(hole.height_m(1.4, 0.0).abs() < 0.003, "{hole:?}");
        let low = Floor::of(&places(|x, y| if x > 1.2 && y.abs() < 0.3 { 0.08 } else { 0.0 })).expect("a floor");
        assert!(low.height_m(1.2, 0.0).abs() < 0.015, "{low:?}");
    }

    #[test]
    fn it_never_slopes_further_than_an_attitude_is_off() {
        let ramp = Floor::of(&places(|x, _| 0.083 * x)).expect("a floor");
        assert!(ramp.ahead <= SLOPE_MAX && ramp.off_m.abs() <= 0.03, "{ramp:?}");
        assert_eq!(Floor::of(&[]), Some(Floor::default()));
    }

    #[test]
    fn where_the_floor_falls_away_there_is_none_that_hides_what_stands_on_it() {
        assert_eq!(Floor::of(&places(|x, _| -0.083 * x)), None, "a ramp of 1:12 down");
        assert_eq!(Floor::of(&places(|x, y| -0.1 * x + if x > 1.2 && y.abs() < 0.2 { 0.15 } else { 0.0 })), None);
    }
}
