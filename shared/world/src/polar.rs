//! A lidar's scan as a polar image: each face touches only the beams that it spans.
//!
//! Along a straight face the inverse of the range is linear in the beam's direction, so that a face costs one sum and
//! one maximum for each of its beams.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use guidance::se2::{Point, about_bearing_rad};
use nalgebra::Vector2;

use crate::raster::rounded_up;

/// Neighbouring faces share the beam on their common edge: no beam slips through. In beams.
const EDGE: f64 = 1e-9;
/// About how exact two bearings are together, radians.
const BEARING_RAD: f64 = 4e-5;

/// The beams of a lidar in its own frame, and for each the inverse of the range to the nearest thing so far.
#[derive(Debug, Clone)]
pub(crate) struct PolarImage {
    /// Unit vectors, mirrored where the lidar turns clockwise: they turn counter-clockwise always.
    x: Vec<f64>,
    y: Vec<f64>,
    inverse: Vec<f64>,
    first_rad: f64,
    increment_rad: f64,
    mirrored: bool,
    farthest: f64,
}

/// The beams that a face spans, and the inverse of its range by their directions.
struct Spanned {
    runs: [Range<usize>; 2],
    by: [f64; 2],
}

/// Raises inverse ranges to those of a face.
fn raise(inverse: &mut [f64], x: &[f64], y: &[f64], [by_x, by_y]: [f64; 2]) {
    for ((inverse, x), y) in inverse.iter_mut().zip(x).zip(y) {
        let here = by_x * x + by_y * y;
        *inverse = if here > *inverse { here } else { *inverse };
    }
}

impl PolarImage {
    /// The image of a lidar with these beams that sees as far as `range_max_m`.
    pub(crate) fn new(beams: usize, angle_min_rad: f64, angle_increment_rad: f64, range_max_m: f64) -> Self {
        let mirrored = angle_increment_rad < 0.0;
        let first_rad = if mirrored { -angle_min_rad } else { angle_min_rad };
        // Beams of one and the same direction are taken apart by next to nothing.
        let increment_rad = angle_increment_rad.abs().max(1e-12);
        let angle = |beam: usize| first_rad + increment_rad * beam as f64;
        Self {
            x: (0..beams).map(|beam| angle(beam).cos()).collect(),
            y: (0..beams).map(|beam| angle(beam).sin()).collect(),
            inverse: vec![0.0; beams],
            first_rad,
            increment_rad,
            mirrored,
            farthest: range_max_m.recip(),
        }
    }

    /// Nothing within range.
    pub(crate) fn clear(&mut self) {
        self.inverse.fill(0.0);
    }

    /// The direction of a beam, lidar frame.
    pub(crate) fn direction(&self, beam: usize) -> Vector2<f64> {
        Vector2::new(self.x[beam], if self.mirrored { -self.y[beam] } else { self.y[beam] })
    }

    /// The range of a beam, metres; `None` where nothing was hit.
    pub(crate) fn range_m(&self, beam: usize) -> Option<f64> {
        let inverse = self.inverse[beam];
        (inverse >= self.farthest).then(|| inverse.recip())
    }

    /// Something at that range in the way of a beam.
    pub(crate) fn put(&mut self, beam: usize, range_m: f64) {
        self.inverse[beam] = self.inverse[beam].max(range_m.recip());
    }

    fn mirror(&self, point: Point) -> Point {
        if self.mirrored { Point::new(point.x, -point.y) } else { point }
    }

    /// The beams within an angle counter-clockwise from `from_rad`: two runs, as it may go over the end.
    fn span(&self, from_rad: f64, turn_rad: f64) -> [Range<usize>; 2] {
        let count = self.inverse.len();
        let begin = (from_rad - self.first_rad).rem_euclid(TAU) / self.increment_rad;
        let end = begin + turn_rad / self.increment_rad;
        let whole = TAU / self.increment_rad;
        let run = |begin: f64, end: f64| {
            let (first, last) = (rounded_up(begin - EDGE), end + EDGE);
            let beyond = if last < 0.0 { 0 } else { (last as u32 as usize + 1).min(count) };
            first.min(beyond)..beyond
        };
        [run(begin, end), run(begin - whole, end - whole)]
    }

    /// The beams of a run that pass between two points, from `a` counter-clockwise to `b`.
    fn between(&self, run: Range<usize>, a: Point, b: Point) -> Range<usize> {
        let hair = EDGE * self.increment_rad;
        let after = |beam: usize| a.x * self.y[beam] - a.y * self.x[beam] >= -hair * (a.x.abs() + a.y.abs());
        let before = |beam: usize| self.x[beam] * b.y - self.y[beam] * b.x >= -hair * (b.x.abs() + b.y.abs());
        let inside = |beam: &usize| after(*beam) && before(*beam);
        match run.clone().find(inside) {
            Some(first) => first..run.rev().find(inside).map_or(first, |last| last + 1),
            None => 0..0,
        }
    }

    /// A straight face between two points of the lidar frame, seen from both sides.
    pub(crate) fn draw_face(&mut self, a: Point, b: Point) {
        let Some(Spanned { runs, by }) = self.spanned(a, b) else { return };
        for run in runs.into_iter().filter(|run| !run.is_empty()) {
            raise(&mut self.inverse[run.clone()], &self.x[run.clone()], &self.y[run], by);
        }
    }

    /// The same of a face that some beams pass over or under: `meets` tells of a beam, and of the inverse of its range
    /// to the face, whether it ends there.
    pub(crate) fn draw_face_where(&mut self, a: Point, b: Point, meets: impl Fn(usize, f64) -> bool) {
        let Some(Spanned { runs, by: [by_x, by_y] }) = self.spanned(a, b) else { return };
        for run in runs {
            let (first, x, y) = (run.start, &self.x[run.clone()], &self.y[run.clone()]);
            for (i, ((inverse, x), y)) in self.inverse[run].iter_mut().zip(x).zip(y).enumerate() {
                let here = by_x * x + by_y * y;
                *inverse = if here > *inverse && meets(first + i, here) { here } else { *inverse };
            }
        }
    }

    /// What a face spans; none where it is seen edge-on.
    fn spanned(&self, a: Point, b: Point) -> Option<Spanned> {
        let (a, b) = (self.mirror(a), self.mirror(b));
        let cross = a.coords.perp(&b.coords);
        let ((a, b), cross) = if cross >= 0.0 { ((a, b), cross) } else { ((b, a), -cross) };
        if cross < 1e-12 {
            return None;
        }
        let (from_rad, to_rad) = (about_bearing_rad(a.coords), about_bearing_rad(b.coords));
        let turn_rad = (to_rad - from_rad).rem_euclid(TAU);
        // The bearings are about right; which beam is the first and which the last is told exactly.
        let slack_rad = self.increment_rad + BEARING_RAD;
        let turn_rad = if turn_rad > PI + BEARING_RAD { 0.0 } else { turn_rad };
        let runs = self.span(from_rad - slack_rad, turn_rad + 2.0 * slack_rad).map(|run| self.between(run, a, b));
        Some(Spanned { runs, by: [(b.y - a.y) / cross, (a.x - b.x) / cross] })
    }

    /// A disc about a point of the lidar frame; from inside it everything is touched.
    pub(crate) fn draw_disc(&mut self, center: Point, radius_m: f64) {
        let center = self.mirror(center);
        let distance_m = center.coords.norm();
        if distance_m <= radius_m {
            self.inverse.fill(f64::INFINITY);
            return;
        }
        let half_rad = (radius_m / distance_m).asin();
        let beyond = distance_m * distance_m - radius_m * radius_m;
        for beam in self.span(center.y.atan2(center.x) - half_rad, 2.0 * half_rad).into_iter().flatten() {
            let along = center.x * self.x[beam] + center.y * self.y[beam];
            let root = along * along - beyond;
            if root >= 0.0 {
                self.inverse[beam] = self.inverse[beam].max((along - root.sqrt()).recip());
            }
        }
    }
}
