//! The floor of a world with holes as others' physics and rays need it: in convex pieces, and where a ray meets it.

use guidance::se2::Point;
use nalgebra::Vector3;

use crate::floor::{Hole, contains, sides};
use crate::world::World;

/// Smaller pieces are left out, square metres.
const LEAST_M2: f64 = 1e-4;
/// A ray is asked what lies so far beyond a hole's side, metres.
const BEYOND_M: f64 = 1e-6;

/// What is left of a convex outline without the holes, in convex outlines. All are counter-clockwise.
#[must_use]
pub fn around(holes: &[Hole], outline: &[Point]) -> Vec<Vec<Point>> {
    let mut pieces = vec![outline.to_vec()];
    for hole in holes {
        pieces = pieces.iter().flat_map(|piece| without(piece, &hole.outline)).collect();
    }
    pieces
}

/// A convex outline without another: what lies beyond each of its sides, in turn.
fn without(piece: &[Point], hole: &[Point]) -> Vec<Vec<Point>> {
    let (mut rest, mut outside) = (piece.to_vec(), Vec::new());
    for (a, b) in sides(hole) {
        let beyond = clipped(&rest, b, a);
        rest = clipped(&rest, a, b);
        outside.extend(Some(beyond).filter(|beyond| area_m2(beyond) > LEAST_M2));
    }
    // None of it lies in the hole: it stays whole.
    if area_m2(&rest) > LEAST_M2 { outside } else { vec![piece.to_vec()] }
}

/// The part of a convex outline to the left of a line.
fn clipped(outline: &[Point], from: Point, to: Point) -> Vec<Point> {
    let left = |p: Point| (to - from).perp(&(p - from));
    let mut kept = Vec::with_capacity(outline.len() + 1);
    for (a, b) in sides(outline) {
        let (of_a, of_b) = (left(a), left(b));
        kept.extend(Some(a).filter(|_| of_a >= 0.0));
        if of_a * of_b < 0.0 {
            kept.push(a + (b - a) * (of_a / (of_a - of_b)));
        }
    }
    kept
}

fn area_m2(outline: &[Point]) -> f64 {
    let Some(first) = outline.first() else { return 0.0 };
    sides(outline).map(|(a, b)| (a - first).perp(&(b - first))).sum::<f64>() / 2.0
}

impl World {
    /// The way along a ray to the floor, or to the wall of a hole, in lengths of `way`; none where it meets neither.
    /// Ramps are not asked.
    #[must_use]
    pub fn ground_along(&self, from: &Vector3<f64>, way: &Vector3<f64>) -> Option<f64> {
        let over = |t: f64| Point::from((from + way * t).xy());
        let hole_at = |place: Point| self.holes().iter().find(|hole| contains(&hole.outline, place));
        let (mut t, mut hole) = if from.z < 0.0 {
            (0.0, hole_at(over(0.0))?)
        } else {
            let t = Some(-from.z / way.z).filter(|t| way.z < 0.0 && t.is_finite())?;
            let Some(hole) = hole_at(over(t)) else { return Some(t) };
            (t, hole)
        };
        // From hole to hole, as down a flight of stairs.
        for _ in 0..=self.holes().len() {
            let floor_t = (-hole.depth_m - from.z) / way.z;
            let ends = sides(&hole.outline).filter_map(|(a, b)| {
                let (along, out) = (b - a, (b - a).perp(&way.xy()));
                // It leaves over the sides that it comes nearer to from within.
                (out < 0.0).then(|| along.perp(&(a - Point::from(from.xy()))) / out)
            });
            let end_t = ends.fold(f64::INFINITY, f64::min).max(t);
            if way.z < 0.0 && floor_t <= end_t {
                return Some(floor_t.max(t));
            }
            if !end_t.is_finite() {
                return None;
            }
            let z_m = from.z + way.z * end_t;
            if z_m >= 0.0 {
                // It leaves the hole through its opening, upwards.
                return None;
            }
            let beyond = over(end_t) + way.xy().normalize() * BEYOND_M;
            match hole_at(beyond).filter(|next| -next.depth_m < z_m) {
                Some(next) => (t, hole) = (end_t, next),
                None => return Some(end_t),
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::{area_m2, around};
    use crate::floor::{Hole, contains, rectangle};
    use guidance::se2::Point;
    use messages::Pose2;

    #[test]
    fn the_floor_around_holes_is_all_of_it_but_the_holes() {
        let square = rectangle(Pose2::new(-5.0, 0.0, 0.0), 10.0, 10.0);
        let hole = |x: f64, y: f64, yaw: f64, size: [f64; 2]| Hole {
            outline: rectangle(Pose2::new(x, y, yaw), size[0], size[1]),
            depth_m: 1.0,
        };
        // One beside another, one askew, one that reaches beyond the square.
        let holes = [
            hole(0.0, 0.0, 0.0, [1.0, 2.0]),
            hole(1.0, 0.0, 0.0, [1.0, 2.0]),
            hole(-3.0, 2.0, 0.7, [1.5, 0.5]),
            hole(4.0, -4.0, 0.0, [3.0, 1.0]),
        ];
        let pieces = around(&holes, &square);
        let all_m2: f64 = pieces.iter().map(|piece| area_m2(piece)).sum();
        assert!((all_m2 - (100.0 - 2.0 - 2.0 - 0.75 - 1.0)).abs() < 1e-9, "{all_m2}");
        for i in 0..100 {
            for j in 0..100 {
                let place = Point::new(-4.951 + 0.1 * f64::from(i), -4.953 + 0.1 * f64::from(j));
                let is_hole = holes.iter().any(|hole| contains(&hole.outline, place));
                let on = pieces.iter().filter(|piece| contains(piece, place)).count();
                assert_eq!(on, usize::from(!is_hole), "{place}");
            }
        }
    }
}
