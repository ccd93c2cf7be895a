//! The shielding zone: the convex hull of discs (Kim et al. 2023, alg. 1 lines 6-7), exactly.
//!
//! The boundary of the hull consists of arcs of the discs and of outer tangents of two discs. Every arc and every such
//! tangent, on the boundary or not, lies within the hull; so the last of them that a ray meets is where it leaves.

use nalgebra::Vector2;

use crate::boundary::not_held;
use crate::se2::Point;

/// A disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Centre, metres.
    pub center: Point,
    /// Radius, metres.
    pub radius_m: f64,
}

/// An outer tangent of two discs: both tangent points and the outward normal.
#[derive(Debug, Clone, Copy)]
struct Tangent {
    from: Point,
    along: Vector2<f64>,
    normal: Vector2<f64>,
    /// One of its two discs. None reaches farther along the normal.
    disc: usize,
}

/// A few discs. They need no memory of their own.
#[derive(Debug, Clone, Copy)]
pub struct Discs {
    discs: [Disc; Self::MAX],
    count: usize,
}

impl Discs {
    /// The most that there are: a robot of two and a handler, now, carried on, at the end, walking on and at rest.
    pub const MAX: usize = 16;

    /// No disc yet.
    #[must_use]
    pub fn none() -> Self {
        Self { discs: [Disc { center: Point::origin(), radius_m: 0.0 }; Self::MAX], count: 0 }
    }

    /// One more. Past [`Self::MAX`] there is no room.
    pub fn push(&mut self, disc: Disc) {
        debug_assert!(self.count < Self::MAX);
        if let Some(slot) = self.discs.get_mut(self.count) {
            *slot = disc;
            self.count += 1;
        }
    }
}

impl std::ops::Deref for Discs {
    type Target = [Disc];
    fn deref(&self) -> &[Disc] {
        &self.discs[..self.count]
    }
}

impl<const N: usize> From<[Disc; N]> for Discs {
    fn from(discs: [Disc; N]) -> Self {
        let mut all = Self::none();
        discs.into_iter().for_each(|disc| all.push(disc));
        all
    }
}

/// In these directions it is known how far a hull reaches: unit vectors, give or take rounding.
const AROUND: [Vector2<f64>; 8] = {
    const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [
        Vector2::new(1.0, 0.0),
        Vector2::new(HALF, HALF),
        Vector2::new(0.0, 1.0),
        Vector2::new(-HALF, HALF),
        Vector2::new(-1.0, 0.0),
        Vector2::new(-HALF, -HALF),
        Vector2::new(0.0, -1.0),
        Vector2::new(HALF, -HALF),
    ]
};
/// What is farther by this than asked for is farther whatever rounding says, metres.
const FARTHER_M: f64 = 1e-9;
/// A tangent over which a disc reaches by more than this lies within the hull, metres.
const OVER_M: f64 = 1e-9;

/// The convex hull of discs: robot and handler, now and at the end.
#[derive(Debug, Clone)]
pub struct Hull {
    discs: Discs,
    /// Those on the boundary.
    tangents: Vec<Tangent>,
    /// How far it reaches in each of the directions [`AROUND`], metres.
    reach_m: [f64; AROUND.len()],
}

impl Default for Hull {
    /// The hull of no disc.
    fn default() -> Self {
        Self { discs: Discs::none(), tangents: Vec::new(), reach_m: [f64::NEG_INFINITY; AROUND.len()] }
    }
}

impl Hull {
    /// The hull of no disc, with room for as many as there can be.
    pub(crate) fn with_room() -> Self {
        Self { tangents: Vec::with_capacity(Discs::MAX * (Discs::MAX - 1)), ..Self::default() }
    }

    /// The hull of these discs.
    #[must_use]
    pub fn new(discs: impl Into<Discs>) -> Self {
        let mut hull = Self::default();
        hull.take(discs.into());
        hull
    }

    /// Becomes the hull of other discs. A shield makes room for the greatest hull at its start: this allocates nothing.
    /// What lies within the hull is left out: a disc that another holds, and a tangent over which a disc reaches.
    pub fn take(&mut self, discs: Discs) {
        self.discs = Discs::none();
        let counts = not_held(&discs);
        discs.iter().zip(counts).filter(|(_, counts)| *counts).for_each(|(disc, _)| self.discs.push(*disc));
        let discs = &self.discs;
        self.reach_m = AROUND.map(|u| discs.iter().map(|disc| disc.reach_m(u)).fold(f64::NEG_INFINITY, f64::max));
        self.tangents.clear();
        for (i, a) in discs.iter().enumerate() {
            for b in &discs[i + 1..] {
                let both = [1.0, -1.0].into_iter().filter_map(|side| tangent(a, b, side));
                let is_outer = |(tangent, reach_m): &(Tangent, f64)| {
                    !discs.iter().any(|disc| disc.reach_m(tangent.normal) > reach_m + OVER_M)
                };
                self.tangents.extend(both.filter(is_outer).map(|(tangent, _)| Tangent { disc: i, ..tangent }));
            }
        }
    }

    /// Distance from `origin` to where the ray along the unit vector `direction` leaves the hull for good; 0 where it
    /// never meets it (Kim et al. 2023, alg. 1 line 7).
    #[must_use]
    pub fn threshold_m(&self, origin: Point, direction: Vector2<f64>) -> f64 {
        self.crossing_m(origin, direction).map_or(0.0, |(_, leaves_m)| leaves_m)
    }

    /// Distances from `origin` to where the ray enters the hull (0 or less from within) and where it leaves it; none
    /// where it never meets it. The first and the last arc or tangent that it meets.
    #[must_use]
    pub fn crossing_m(&self, origin: Point, direction: Vector2<f64>) -> Option<(f64, f64)> {
        let arcs = self.discs.iter().filter_map(|disc| crosses_disc(disc, origin, direction));
        let tangents = self.tangents.iter().filter_map(|tangent| tangent.meets(origin, direction));
        let all = arcs.chain(tangents.map(|t| (t, t)));
        let widest = |(a, b): (f64, f64), (c, d): (f64, f64)| (a.min(c), b.max(d));
        all.reduce(widest).filter(|(_, leaves_m)| *leaves_m > 0.0)
    }

    /// Distance of a point to the boundary, metres; negative inside.
    #[must_use]
    pub fn signed_distance_m(&self, point: Point) -> f64 {
        self.nearer_m(point, f64::INFINITY).unwrap_or(f64::INFINITY)
    }

    /// The signed distance of a point where it is less than `limit_m`: most points are farther, which shows sooner.
    #[must_use]
    pub fn nearer_m(&self, point: Point, limit_m: f64) -> Option<f64> {
        if self.is_beyond(point, limit_m) {
            return None;
        }
        // The distance is the greatest over all directions u of the smallest over all discs of u.(p - c) - r. It is
        // reached where u points from a centre to the point, or is normal to a tangent.
        let from_centers = self.discs.iter().enumerate();
        let from_centers = from_centers.filter_map(|(i, disc)| Some(((point - disc.center).try_normalize(1e-12)?, i)));
        let normals = self.tangents.iter().map(|tangent| (tangent.normal, tangent.disc));
        let mut greatest_m = f64::NEG_INFINITY;
        for (u, first) in from_centers.chain(normals) {
            let away_m = |disc: &Disc| u.dot(&(point - disc.center)) - disc.radius_m;
            // Where another direction leaves more, this one does not count: it shows soonest at the disc that reaches
            // farthest.
            let mut smallest_m = f64::INFINITY.min(away_m(&self.discs[first]));
            for disc in self.discs.iter() {
                if smallest_m <= greatest_m {
                    break;
                }
                smallest_m = smallest_m.min(away_m(disc));
            }
            greatest_m = greatest_m.max(smallest_m);
            if greatest_m >= limit_m {
                return None;
            }
        }
        Some(greatest_m)
    }

    /// Whether it shows at once that a point is not nearer: it lies beyond what the hull reaches in some direction.
    fn is_beyond(&self, point: Point, limit_m: f64) -> bool {
        let is_beyond = |(u, reach_m): (&Vector2<f64>, &f64)| u.dot(&point.coords) - reach_m >= limit_m + FARTHER_M;
        // Of no disc nothing is known.
        !self.discs.is_empty() && AROUND.iter().zip(&self.reach_m).any(is_beyond)
    }

    /// Whether a point is strictly inside.
    #[must_use]
    pub fn contains(&self, point: Point) -> bool {
        self.nearer_m(point, 0.0).is_some()
    }
}

impl Disc {
    /// How far it reaches along a unit vector, from the origin, metres.
    fn reach_m(&self, u: Vector2<f64>) -> f64 {
        u.dot(&self.center.coords) + self.radius_m
    }
}

/// The outer tangent of two discs on one side, and how far it lies along its normal, metres; none where one disc holds
/// the other.
fn tangent(a: &Disc, b: &Disc, side: f64) -> Option<(Tangent, f64)> {
    let between = b.center - a.center;
    let distance = between.norm();
    if distance <= (a.radius_m - b.radius_m).abs() || distance < 1e-12 {
        return None;
    }
    let u = between / distance;
    let cos = (a.radius_m - b.radius_m) / distance;
    let normal = u * cos + Vector2::new(-u.y, u.x) * (side * (1.0 - cos * cos).sqrt());
    let from = a.center + normal * a.radius_m;
    let tangent = Tangent { from, along: b.center + normal * b.radius_m - from, normal, disc: 0 };
    Some((tangent, a.reach_m(normal)))
}

impl Tangent {
    /// Distance along the line to where it crosses the tangent between its two points.
    fn meets(&self, origin: Point, direction: Vector2<f64>) -> Option<f64> {
        let denominator = direction.perp(&self.along);
        if denominator.abs() < 1e-15 {
            // Parallel: the ray then leaves through an arc.
            return None;
        }
        let to_from = self.from - origin;
        let t = to_from.perp(&self.along) / denominator;
        let share = to_from.perp(&direction) / denominator;
        (0.0..=1.0).contains(&share).then_some(t)
    }
}

/// Distances along the line to where it enters a disc and leaves it.
fn crosses_disc(disc: &Disc, origin: Point, direction: Vector2<f64>) -> Option<(f64, f64)> {
    let to_center = disc.center - origin;
    let along = to_center.dot(&direction);
    let root = along * along - (to_center.norm_squared() - disc.radius_m * disc.radius_m);
    if root < 0.0 {
        return None;
    }
    Some((along - root.sqrt(), along + root.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::{Disc, Hull};
    use crate::se2::Point;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn disc(x: f64, y: f64, radius_m: f64) -> Disc {
        Disc { center: Point::new(x, y), radius_m }
    }

    /// The independent truth: parry's convex hull of the discs, finely sampled.
    fn sampled(discs: &[Disc; 4]) -> Vec<Point> {
        let points: Vec<_> = discs
            .iter()
            .flat_map(|d| {
                (0..720).map(move |i| {
                    let a = f64::from(i).to_radians() / 2.0;
                    parry2d_f64::math::Vector::new(d.center.x + d.radius_m * a.cos(), d.center.y + d.radius_m * a.sin())
                })
            })
            .collect();
        parry2d_f64::transformation::convex_hull(&points).iter().map(|p| Point::new(p.x, p.y)).collect()
    }

    fn polygon_contains(polygon: &[Point], p: Point) -> bool {
        (0..polygon.len()).all(|i| {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            (b - a).perp(&(p - a)) >= 0.0
        })
    }

    fn any_disc() -> impl Strategy<Value = Disc> {
        (-1.5..1.5f64, -1.5..1.5f64, 0.05..0.5f64).prop_map(|(x, y, r)| disc(x, y, r))
    }

    proptest! {
        #![proptest_config(crate::testing::cases())]

        #[test]
        fn inside_and_outside_are_as_in_the_sampled_hull(
            a in any_disc(), b in any_disc(), c in any_disc(), d in any_disc(), x in -2.5..2.5f64, y in -2.5..2.5f64,
        ) {
            let discs = [a, b, c, d];
            let (hull, point) = (Hull::new(discs), Point::new(x, y));
            let distance = hull.signed_distance_m(point);
            // The sampled hull lies within the true one, by at most r (1 - cos(0.25 deg)), under 10 um.
            if distance.abs() > 1e-4 {
                let inside = polygon_contains(&sampled(&discs), point);
                prop_assert_eq!((inside, hull.contains(point)), (distance < 0.0, inside), "distance {}", distance);
            }
        }

        #[test]
        fn what_is_nearer_than_a_limit_has_the_distance_of_all_directions(
            a in any_disc(), b in any_disc(), c in any_disc(), d in any_disc(),
            x in -2.5..2.5f64, y in -2.5..2.5f64, limit in -0.5..1.5f64,
        ) {
            let (hull, point) = (Hull::new([a, b, c, d]), Point::new(x, y));
            let gap = |u: Vector2<f64>| {
                let gaps = hull.discs.iter().map(|disc| u.dot(&(point - disc.center)) - disc.radius_m);
                gaps.fold(f64::INFINITY, f64::min)
            };
            let from_centers = hull.discs.iter().filter_map(|disc| (point - disc.center).try_normalize(1e-12));
            let normals = hull.tangents.iter().map(|tangent| tangent.normal);
            let distance = from_centers.chain(normals).map(gap).fold(f64::NEG_INFINITY, f64::max);
            prop_assert_eq!(hull.signed_distance_m(point), distance);
            // What lies within the hull adds nothing.
            let all = [a, b, c, d];
            let tangents = (0..4).flat_map(|i| (0..4).flat_map(move |j| [1.0, -1.0].map(|side| (i, j, side))));
            let normals = tangents.filter_map(|(i, j, side)| Some(super::tangent(&all[i], &all[j], side)?.0.normal));
            let from_centers = all.iter().filter_map(|disc| (point - disc.center).try_normalize(1e-12));
            let gap_to_all = |u: Vector2<f64>| {
                all.iter().map(|disc| u.dot(&(point - disc.center)) - disc.radius_m).fold(f64::INFINITY, f64::min)
            };
            let by_all = from_centers.chain(normals).map(gap_to_all).fold(f64::NEG_INFINITY, f64::max);
            prop_assert!((distance - by_all).abs() < 1e-8, "{} by all {}", distance, by_all);
            prop_assert_eq!(hull.nearer_m(point, limit), Some(distance).filter(|distance| *distance < limit));
            prop_assert_eq!(hull.nearer_m(Point::new(x, f64::NAN), limit), None);
        }

        #[test]
        fn the_threshold_is_where_a_marched_ray_leaves(
            a in any_disc(), b in any_disc(), c in any_disc(), d in any_disc(),
            x in -3.0..3.0f64, y in -3.0..3.0f64, angle in 0.0..std::f64::consts::TAU,
        ) {
            let (hull, origin) = (Hull::new([a, b, c, d]), Point::new(x, y));
            let direction = Vector2::new(angle.cos(), angle.sin());
            let threshold = hull.threshold_m(origin, direction);
            let step = 0.002;
            let last = (0..4000).rev().map(|i| f64::from(i) * step).find(|t| hull.contains(origin + direction * *t));
            match last {
                Some(t) => prop_assert!((threshold - t).abs() < 2.0 * step, "{} marched {}", threshold, t),
                // A ray that only grazes may be missed by the march.
                None => prop_assert!(threshold == 0.0
                    || hull.signed_distance_m(origin + direction * (threshold - step)) > -0.01),
            }
        }

        #[test]
        fn turning_everything_changes_nothing(
            a in any_disc(), b in any_disc(), c in any_disc(), d in any_disc(),
            turn in -3.0..3.0f64, angle in 0.0..6.0f64,
        ) {
            let rotation = nalgebra::Rotation2::new(turn);
            let turned = [a, b, c, d].map(|disc| Disc { center: rotation * disc.center, ..disc });
            let direction = Vector2::new(angle.cos(), angle.sin());
            let before = Hull::new([a, b, c, d]).threshold_m(Point::origin(), direction);
            let after = Hull::new(turned).threshold_m(Point::origin(), rotation * direction);
            prop_assert!((before - after).abs() < 1e-9);
        }
    }

    #[test]
    fn a_ray_that_misses_has_threshold_zero_and_one_from_outside_leaves_at_the_far_side() {
        let hull = Hull::new([disc(0.0, 0.0, 0.3), disc(1.0, 0.0, 0.3), disc(0.0, 0.0, 0.3), disc(1.0, 0.0, 0.3)]);
        assert_eq!(hull.threshold_m(Point::new(-2.0, 1.0), Vector2::x()), 0.0);
        assert!((hull.threshold_m(Point::new(-2.0, 0.0), Vector2::x()) - 3.3).abs() < 1e-12);
        assert!((hull.threshold_m(Point::new(0.5, -2.0), Vector2::y()) - 2.3).abs() < 1e-12);
    }
}
