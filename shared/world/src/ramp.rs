//! Ramps and plateaus: the floor that is not level.

use guidance::se2::{Point, se2};
use messages::Pose2;

/// A straight ramp, or a plateau where nothing rises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Middle of its foot, and the way up (world frame).
    pub foot: Pose2,
    /// Height of its foot over the floor, metres.
    pub from_m: f64,
    /// How far it leads over the floor, metres.
    pub length_m: f64,
    /// Width across, metres.
    pub width_m: f64,
    /// How much higher its end is than its foot, metres.
    pub rise_m: f64,
}

impl Ramp {
    /// Height of its surface over the floor at a place; `None` beside it.
    #[must_use]
    pub fn height_m(&self, at: Point) -> Option<f64> {
        let on = se2(self.foot).inverse() * at;
        let is_on = (0.0..=self.length_m).contains(&on.x) && on.y.abs() <= self.width_m / 2.0;
        is_on.then(|| self.from_m + self.rise_m * on.x / self.length_m)
    }
}

/// Height of the floor at a place, metres: of the highest ramp there.
#[must_use]
pub fn floor_m(ramps: &[Ramp], at: Point) -> f64 {
    ramps.iter().filter_map(|ramp| ramp.height_m(at)).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::{Ramp, floor_m};
    use guidance::se2::Point;
    use messages::Pose2;

    #[test]
    fn it_rises_from_its_foot_to_its_end_and_not_beside_it() {
        let foot = Pose2::new(2.0, 1.0, std::f64::consts::FRAC_PI_2);
        let ramp = Ramp { foot, from_m: 0.1, length_m: 3.0, width_m: 2.0, rise_m: 0.25 };
        let middle_m = ramp.height_m(Point::new(2.5, 2.5)).expect("on it");
        assert!((middle_m - 0.225).abs() < 1e-12, "{middle_m}");
        for beside in [(2.5, 0.9), (2.5, 4.1), (3.1, 2.5), (0.9, 2.5)] {
            assert_eq!(ramp.height_m(Point::new(beside.0, beside.1)), None, "{beside:?}");
        }
        let plateau = Ramp { from_m: 0.15, rise_m: 0.0, ..ramp };
        assert!((floor_m(&[plateau, ramp], Point::new(2.5, 2.5)) - 0.225).abs() < 1e-12, "the higher one");
        assert_eq!(floor_m(&[plateau, ramp], Point::new(2.5, 0.9)), 0.0);
    }
}
