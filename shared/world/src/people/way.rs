//! The way of a person: a polyline, closed where it is walked as a loop.

use guidance::se2::Point;

use super::{Person, Walk};

#[derive(Debug, Clone)]
pub(super) struct Way {
    corners: Vec<Point>,
    pub(super) length_m: f64,
    is_loop: bool,
}

impl Way {
    pub(super) fn of(person: &Person) -> Self {
        let is_loop = person.walk == Walk::Loop;
        let mut corners = person.path.clone();
        if is_loop {
            corners.extend(person.path.first());
        }
        let length_m = corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        Self { corners, length_m, is_loop }
    }

    /// The place `way_m` along it.
    pub(super) fn place(&self, way_m: f64) -> Point {
        let mut left = way_m;
        for pair in self.corners.windows(2) {
            let side = pair[1] - pair[0];
            let length = side.norm();
            if left <= length && length > 0.0 {
                return pair[0] + side * (left / length);
            }
            left -= length;
        }
        self.corners.last().copied().unwrap_or_default()
    }

    /// The way that is so much farther on, metres: round a loop, and no farther than the ends of another one.
    pub(super) fn after(&self, way_m: f64, step_m: f64) -> f64 {
        let to_m = way_m + step_m;
        match self.is_loop && self.length_m > 0.0 {
            true => to_m.rem_euclid(self.length_m),
            false => to_m.clamp(0.0, self.length_m),
        }
    }

    /// The way to the place that is nearest to `at`, metres, no farther than this back and on from the way so far.
    pub(super) fn foot(&self, at: Point, way_m: f64, [back_m, on_m]: [f64; 2]) -> f64 {
        let mut from_m = 0.0;
        let on_side = |pair: &[Point]| {
            let side = pair[1] - pair[0];
            let length_m = side.norm();
            let foot_m =
                from_m + if length_m > 0.0 { ((at - pair[0]).dot(&side) / length_m).clamp(0.0, length_m) } else { 0.0 };
            from_m += length_m;
            let mut step_m = foot_m - way_m;
            if self.is_loop {
                step_m -= (step_m / self.length_m).round() * self.length_m;
            }
            self.after(way_m, step_m.clamp(-back_m, on_m))
        };
        let to_m = |way_m: &f64| (self.place(*way_m) - at).norm_squared();
        let feet = self.corners.windows(2).map(on_side);
        feet.min_by(|a, b| to_m(a).total_cmp(&to_m(b))).unwrap_or(way_m)
    }
}
