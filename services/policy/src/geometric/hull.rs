//! The hull that an action sweeps, as the shield judges it: the convex hull of robot and handler before and after.

use guidance::se2::Point;

/// Directions in which a hull is measured. Between two of them a disc of 0.3 m is cut by 0.1 mm.
const DIRECTIONS: usize = 96;

/// A disc: centre (some frame) and radius, metres.
pub type Disc = (Point, f64);

/// A convex hull of discs, as its support in fixed directions.
#[derive(Debug)]
pub struct Hull {
    support_m: [f64; DIRECTIONS],
}

fn direction(i: usize) -> (f64, f64) {
    let angle = i as f64 * std::f64::consts::TAU / DIRECTIONS as f64;
    (angle.cos(), angle.sin())
}

impl Hull {
    /// The hull of these discs.
    pub fn of(discs: &[Disc]) -> Self {
        let mut support_m = [f64::NEG_INFINITY; DIRECTIONS];
        for (i, support) in support_m.iter_mut().enumerate() {
            let (ux, uy) = direction(i);
            for (centre, radius_m) in discs {
                *support = support.max(centre.x * ux + centre.y * uy + radius_m);
            }
        }
        Self { support_m }
    }

    /// How far outside the hull a point lies, metres; negative inside. Never more than the true distance.
    pub fn outside_by_m(&self, place: Point) -> f64 {
        let mut outside = f64::NEG_INFINITY;
        for (i, support) in self.support_m.iter().enumerate() {
            let (ux, uy) = direction(i);
            outside = outside.max(place.x * ux + place.y * uy - support);
        }
        outside
    }
}

#[cfg(test)]
mod tests {
    use super::{Hull, Point};

    #[test]
    fn the_hull_of_two_discs_is_a_tapered_capsule() {
        let hull = Hull::of(&[(Point::new(0.0, 0.0), 0.3), (Point::new(-1.0, 0.0), 0.3)]);
        assert!((hull.outside_by_m(Point::new(-0.5, 0.5)) - 0.2).abs() < 1e-3);
        assert!((hull.outside_by_m(Point::new(1.0, 0.0)) - 0.7).abs() < 1e-3);
        assert!(hull.outside_by_m(Point::new(-0.5, 0.0)) < -0.29);
    }
}
