//! Distances to convex things, and how far a moving disc may go before it touches one.

use guidance::se2::Point;
use nalgebra::Vector2;

/// Halvings of the way; a tick's way of 1 cm is known to 1e-14 m after them.
const HALVINGS: usize = 40;

/// Distance from a point to a segment, metres.
pub(crate) fn to_segment(p: Point, a: Point, b: Point) -> f64 {
    let along = b - a;
    let length2 = along.norm_squared();
    let t = if length2 > 0.0 { ((p - a).dot(&along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + along * t)).norm()
}

/// Distance between two segments, metres.
pub(crate) fn ways_apart(from: Point, to: Point, a: Point, b: Point) -> f64 {
    let (way, along) = (to - from, b - a);
    let sides = |of: Point, run: Vector2<f64>, p: Point, q: Point| run.perp(&(p - of)) * run.perp(&(q - of)) < 0.0;
    if sides(from, way, a, b) && sides(a, along, from, to) {
        return 0.0;
    }
    let ends = to_segment(from, a, b).min(to_segment(to, a, b));
    ends.min(to_segment(a, from, to)).min(to_segment(b, from, to))
}

/// Distance from a point to an axis-aligned box, metres; 0 inside.
pub(crate) fn to_box(p: Point, min: Point, max: Point) -> f64 {
    let dx = (min.x - p.x).max(p.x - max.x).max(0.0);
    let dy = (min.y - p.y).max(p.y - max.y).max(0.0);
    dx.hypot(dy)
}

/// The share of the way, in [0, 1], that can be gone before `distance` (to a convex thing) falls under `limit`; `None`
/// where all of it can. What is already nearer than the limit blocks every way that leads closer, and no other.
pub(crate) fn free_share(from: Point, to: Point, limit: f64, distance: impl Fn(Point) -> f64) -> Option<f64> {
    if !is_blocked(from, to, limit, &distance) {
        return None;
    }
    if distance(from) < limit {
        return Some(0.0);
    }
    let at = |share: f64| distance(from + (to - from) * share);
    let low = nearest_share(at);
    let nearest = if at(1.0) <= at(low) { 1.0 } else { low };
    let (mut free, mut blocked) = (0.0, nearest);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (free + blocked);
        if at(middle) >= limit { free = middle } else { blocked = middle }
    }
    Some(free)
}

/// Whether [`free_share`] is less than all of the way, which is known far sooner.
pub(crate) fn is_blocked(from: Point, to: Point, limit: f64, distance: impl Fn(Point) -> f64) -> bool {
    let (start, way) = (distance(from), to - from);
    if start - way.norm() >= limit {
        return false;
    }
    if start < limit {
        return distance(to) < start - 1e-9;
    }
    let at = |share: f64| distance(from + way * share);
    // What cannot be told, NaN, is blocked.
    let is_free = at(1.0) >= limit && at(nearest_share(at)) >= limit;
    !is_free
}

/// About where on the way the distance is least. To a convex thing it is convex along a line.
fn nearest_share(at: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let third = (high - low) / 3.0;
        if at(low + third) <= at(high - third) { high -= third } else { low += third }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::{free_share, is_blocked, to_box, to_segment, ways_apart};
    use guidance::se2::Point;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn distances_are_to_the_nearest_point() {
        let p = |x, y| Point::new(x, y);
        assert_eq!(to_segment(p(0.0, 2.0), p(-1.0, 0.0), p(1.0, 0.0)), 2.0);
        assert_eq!(to_segment(p(4.0, 4.0), p(-1.0, 0.0), p(1.0, 0.0)), 5.0);
        assert_eq!(ways_apart(p(0.0, 0.0), p(2.0, 0.0), p(1.0, -1.0), p(1.0, 1.0)), 0.0, "they cross");
        assert_eq!(ways_apart(p(0.0, 0.0), p(2.0, 0.0), p(1.0, 0.5), p(1.0, 1.0)), 0.5);
        assert_eq!(ways_apart(p(0.0, 0.0), p(0.0, 0.0), p(3.0, 4.0), p(9.0, 4.0)), 5.0, "no way");
        assert_eq!(to_box(p(4.0, 5.0), p(0.0, 0.0), p(1.0, 1.0)), 5.0);
        assert_eq!(to_box(p(0.5, 0.5), p(0.0, 0.0), p(1.0, 1.0)), 0.0);
    }

    #[test]
    fn a_way_is_blocked_where_not_all_of_it_is_free() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut blocked = 0;
        for _ in 0..2000 {
            let [from, to, a, b] =
                [(); 4].map(|()| Point::new(random.random_range(0.0..2.0), random.random_range(0.0..2.0)));
            let distance = |p: Point| to_segment(p, a, b);
            let nearest_m =
                (0..=1000).map(|i| distance(from + (to - from) * (f64::from(i) / 1000.0))).fold(9.0, f64::min);
            let is_blocked = is_blocked(from, to, 0.25, distance);
            assert_eq!(is_blocked, free_share(from, to, 0.25, distance).is_some());
            // From within, ways that lead out are free.
            if distance(from) >= 0.25 && (nearest_m - 0.25).abs() > 0.003 {
                assert_eq!(is_blocked, nearest_m < 0.25, "{from} {to} {a} {b}");
                blocked += u32::from(is_blocked);
            }
        }
        assert!((200..1800).contains(&blocked), "{blocked}");
    }

    #[test]
    fn a_disc_stops_at_its_radius_and_may_leave_again() {
        let wall = |p: Point| to_segment(p, Point::new(1.0, -1.0), Point::new(1.0, 1.0));
        let share = free_share(Point::origin(), Point::new(2.0, 0.0), 0.25, wall).unwrap();
        assert!((share - 0.375).abs() < 1e-9);
        assert_eq!(free_share(Point::origin(), Point::new(0.7, 0.0), 0.25, wall), None);
        let inside = Point::new(0.9, 0.0);
        assert_eq!(free_share(inside, Point::new(0.8, 0.0), 0.25, wall), None, "leaving is free");
        assert_eq!(free_share(inside, Point::new(0.95, 0.0), 0.25, wall), Some(0.0));
    }
}
