//! Where the robot came from. The way back is no way on.

use std::collections::VecDeque;

use guidance::Se2;
use guidance::se2::Point;

/// Distance between two places that are kept, metres.
const STEP_M: f64 = 0.25;
/// Length of the way that is kept, metres.
const KEPT_M: f64 = 6.0;
/// Floor within this distance of the way back belongs to it, metres.
const BESIDE_M: f64 = 1.5;

/// The last places of the robot, the newest last, with its heading there (odometry frame, radians). A robot that comes
/// back to a place has not come from where it was in between.
#[derive(Debug, Default)]
pub struct Trail {
    places: VecDeque<(Point, f64)>,
}

impl Trail {
    /// Takes the robot's next pose.
    pub fn take(&mut self, odom_from_robot: &Se2) {
        let here = Point::from(odom_from_robot.translation.vector);
        match self.places.iter().position(|(place, _)| (place - here).norm() < STEP_M) {
            Some(again) => self.places.truncate(again + 1),
            None => self.places.push_back((here, odom_from_robot.rotation.angle())),
        }
        while self.way_m() > KEPT_M {
            self.places.pop_front();
        }
    }

    /// Forgets everything: a new odometry frame, or a cue in another direction.
    pub fn clear(&mut self) {
        self.places.clear();
    }

    fn way_m(&self) -> f64 {
        self.places.iter().zip(self.places.iter().skip(1)).map(|((a, _), (b, _))| (b - a).norm()).sum()
    }

    /// The robot's heading when it came here, radians; none: it has come nowhere.
    pub fn heading_rad(&self) -> Option<f64> {
        self.places.back().map(|(_, heading_rad)| *heading_rad)
    }

    /// The way back, beyond the last `near_m` metres of it.
    pub fn behind(&self, near_m: f64) -> Behind {
        let (mut near, mut far, mut way_m) = (Vec::new(), Vec::new(), 0.0);
        let mut last = None;
        for (place, _) in self.places.iter().rev() {
            way_m += last.map_or(0.0, |last: &Point| (place - last).norm());
            last = Some(place);
            if way_m <= near_m { near.push(*place) } else { far.push(*place) }
        }
        Behind { near, far }
    }
}

/// A way back in two parts.
#[derive(Debug)]
pub struct Behind {
    near: Vec<Point>,
    far: Vec<Point>,
}

impl Behind {
    /// Whether a place belongs to the farther part.
    pub fn contains(&self, place: Point) -> bool {
        let nearest_m2 =
            |places: &[Point]| places.iter().map(|other| (place - other).norm_squared()).fold(f64::INFINITY, f64::min);
        let far_m2 = nearest_m2(&self.far);
        far_m2 < BESIDE_M * BESIDE_M && far_m2 < nearest_m2(&self.near)
    }
}

#[cfg(test)]
mod tests {
    use super::{Point, Se2, Trail};
    use nalgebra::Vector2;
    use std::f64::consts::PI;

    fn walked(places: impl IntoIterator<Item = (f64, f64)>) -> Trail {
        let mut trail = Trail::default();
        places.into_iter().for_each(|(x, y)| trail.take(&Se2::new(Vector2::new(x, y), 0.0)));
        trail
    }

    #[test]
    fn the_corridor_that_the_robot_came_along_is_behind_it_also_round_a_bend() {
        let ahead = (0..16).map(|i| (0.25 * f64::from(i), 0.0));
        let aside = (1..8).map(|i| (3.75, -0.25 * f64::from(i)));
        let behind = walked(ahead.chain(aside)).behind(1.8);
        assert!(behind.contains(Point::new(1.0, 0.9)) && behind.contains(Point::new(0.0, -0.9)));
        assert!(!behind.contains(Point::new(3.7, -1.0)), "it stands there");
        assert!(!behind.contains(Point::new(3.7, -4.0)), "ahead");
        assert!(!behind.contains(Point::new(1.0, 2.0)), "beside the corridor");
    }

    #[test]
    fn a_robot_that_came_back_did_not_come_from_where_it_was() {
        let there = (0..12).map(|i| (0.25 * f64::from(i), 0.0));
        let back = (4..11).rev().map(|i| (0.25 * f64::from(i), 0.05));
        let trail = walked(there.chain(back));
        assert!(trail.behind(0.5).contains(Point::new(0.0, 0.0)));
        assert!(!trail.behind(0.5).contains(Point::new(2.5, 0.0)));
        assert_eq!(trail.heading_rad(), Some(0.0));
    }

    #[test]
    fn six_metres_of_the_way_are_kept_and_the_heading_is_that_on_arrival() {
        let mut trail = walked((0..100).map(|i| (0.24 * f64::from(i), 0.0)));
        assert!((5.0..=6.0).contains(&trail.way_m()), "{}", trail.way_m());
        // A robot that turns on the spot has come as before.
        trail.take(&Se2::new(Vector2::new(0.24 * 99.0, 0.0), PI));
        assert_eq!(trail.heading_rad(), Some(0.0));
    }
}
