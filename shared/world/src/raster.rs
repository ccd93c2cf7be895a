//! Flat convex faces to inverse depth, one image row at a time.
//!
//! Along a flat face the inverse of the depth is linear in column and row, so a row of a face is one sum and one
//! maximum for each pixel, whatever the camera's pitch. One row at a time stays in the fastest cache and needs no
//! image of its own.

use nalgebra::Point3;

/// Faces nearer than this plane are cut off at it, metres.
const NEAR_M: f64 = 0.02;
/// Neighbouring faces share the pixels on their common edge: no gaps, pixels.
const EDGE_PX: f64 = 1e-6;

/// A pinhole camera: pixel (column, row) looks along (1, (cx - column) / f, (cy - row) / f) in a frame with x along the
/// optical axis, y left, z up.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pinhole {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) focal_px: f64,
    pub(crate) cx_px: f64,
    pub(crate) cy_px: f64,
}

/// A face on its way to the image: inverse depth `base + by_column * column + by_row * row` between its edges.
#[derive(Debug, Clone)]
pub(crate) struct Face {
    base: f64,
    by_column: f64,
    by_row: f64,
    rows: (usize, usize),
    edges: [Edge; MAX_CORNERS],
    count: usize,
    steady: Steady,
}

/// The rows between two corners, in which two edges alone bound a face.
#[derive(Debug, Clone, Copy)]
struct Steady {
    from: f64,
    to: f64,
    edges: [Edge; 2],
}

/// An edge that is not along a row.
#[derive(Debug, Clone, Copy, Default)]
struct Edge {
    top: f64,
    bottom: f64,
    /// The column at the top, and how it changes from row to row.
    column: f64,
    by_row: f64,
}

/// The most corners that a face has here: a quad cut by the near plane. Larger outlines are cut into fans before.
pub(crate) const MAX_CORNERS: usize = 5;

impl Pinhole {
    /// Projects a convex polygon of three or four corners, camera frame; `None` where none of it is in the image.
    pub(crate) fn project(&self, polygon: &[Point3<f64>]) -> Option<Face> {
        let (corners, count) = self.cut_and_project(polygon);
        if count < 3 {
            return None;
        }
        let used = &corners[..count];
        let fold = |f: fn(f64, f64) -> f64, start, pick: fn(&(f64, f64)) -> f64| used.iter().map(pick).fold(start, f);
        let (left, right) = (fold(f64::min, f64::MAX, |c| c.0), fold(f64::max, f64::MIN, |c| c.0));
        let (top, bottom) = (fold(f64::min, f64::MAX, |c| c.1), fold(f64::max, f64::MIN, |c| c.1));
        let outside = right < 0.0 || bottom < 0.0 || left > self.width as f64 - 1.0 || top > self.height as f64 - 1.0;
        if outside {
            return None;
        }
        let normal = (polygon[1] - polygon[0]).cross(&(polygon[2] - polygon[0]));
        let offset = normal.dot(&polygon[0].coords);
        // Seen edge-on: nothing to fill.
        if offset.abs() <= 1e-12 * normal.norm() {
            return None;
        }
        let n = normal / offset;
        let (by_column, by_row) = (-n.y / self.focal_px, -n.z / self.focal_px);
        let base = n.x - by_column * self.cx_px - by_row * self.cy_px;
        let rows = (rounded_up(top - EDGE_PX), (bottom + EDGE_PX).min(self.height as f64 - 1.0) as usize);
        let (mut edges, mut steep) = ([Edge::default(); MAX_CORNERS], 0);
        for (i, &a) in used.iter().enumerate() {
            let b = used[(i + 1) % count];
            let ((column, top), (end, bottom)) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            // Both ends of one that is along a row are ends of its neighbours.
            if bottom - top > EDGE_PX {
                edges[steep] = Edge { top, bottom, column, by_row: (end - column) / (bottom - top) };
                steep += 1;
            }
        }
        let steady = Steady::of(used, &edges[..steep]);
        (rows.0 <= rows.1).then_some(Face { base, by_column, by_row, rows, edges, count: steep, steady })
    }

    /// Cuts a polygon at the near plane and gives the corners that are left as (column, row).
    fn cut_and_project(&self, polygon: &[Point3<f64>]) -> ([(f64, f64); MAX_CORNERS], usize) {
        let (mut corners, mut count) = ([(0.0, 0.0); MAX_CORNERS], 0);
        let mut push = |p: Point3<f64>| {
            if count < MAX_CORNERS {
                corners[count] = (self.cx_px - self.focal_px * p.y / p.x, self.cy_px - self.focal_px * p.z / p.x);
                count += 1;
            }
        };
        for (i, &a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            if a.x >= NEAR_M {
                push(a);
            }
            if (a.x >= NEAR_M) != (b.x >= NEAR_M) {
                push(a + (b - a) * ((NEAR_M - a.x) / (b.x - a.x)));
            }
        }
        (corners, count)
    }
}

impl Steady {
    /// Between the corners that are farthest apart of all that follow each other from the top down.
    fn of(corners: &[(f64, f64)], edges: &[Edge]) -> Self {
        let mut rows = [f64::NEG_INFINITY; MAX_CORNERS];
        rows.iter_mut().zip(corners).for_each(|(row, corner)| *row = corner.1);
        rows.sort_unstable_by(f64::total_cmp);
        let rows = &rows[MAX_CORNERS - corners.len()..];
        let none = Self { from: 0.0, to: 0.0, edges: [Edge::default(); 2] };
        let apart = rows.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        let Some(&[from, to]) = apart else { return none };
        let mut through = edges.iter().filter(|edge| edge.top <= from && edge.bottom >= to);
        match (through.next(), through.next(), through.next()) {
            (Some(one), Some(two), None) => Self { from: from + EDGE_PX, to: to - EDGE_PX, edges: [*one, *two] },
            _ => none,
        }
    }
}

impl Edge {
    /// Its column at a row between its ends.
    fn at(&self, row: f64) -> f64 {
        self.column + self.by_row * (row - self.top)
    }
}

impl Face {
    /// First and last row.
    pub(crate) fn rows(&self) -> (usize, usize) {
        self.rows
    }

    /// Whether it covers something of a row.
    pub(crate) fn is_in(&self, row: usize) -> bool {
        (self.rows.0..=self.rows.1).contains(&row)
    }

    /// Raises a row's inverse depths to this face's, where it covers them.
    pub(crate) fn fill(&self, row: usize, inverse: &mut [f32]) {
        self.each(row, inverse, |_, here, pixel| *pixel = if here > *pixel { here } else { *pixel });
    }

    /// Calls `f` with each pixel of a row that it covers: its column, its own inverse depth there, and the row's.
    pub(crate) fn each(&self, row: usize, inverse: &mut [f32], mut f: impl FnMut(usize, f32, &mut f32)) {
        let Some((left, right)) = self.span(row as f64) else { return };
        if right + EDGE_PX < 0.0 {
            return;
        }
        let from = rounded_up(left - EDGE_PX);
        let beyond = ((right + EDGE_PX) as u32 as usize + 1).min(inverse.len());
        if from >= beyond {
            return;
        }
        let start = (self.base + self.by_row * row as f64 + self.by_column * from as f64) as f32;
        let step = self.by_column as f32;
        for (i, pixel) in inverse[from..beyond].iter_mut().enumerate() {
            f(from + i, start + step * i as i32 as f32, pixel);
        }
    }

    /// The columns that the outline spans at a row.
    fn span(&self, row: f64) -> Option<(f64, f64)> {
        if self.steady.from < row && row < self.steady.to {
            let [one, two] = self.steady.edges.map(|edge| edge.at(row));
            return Some(if two < one { (two, one) } else { (one, two) });
        }
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for edge in &self.edges[..self.count] {
            if row < edge.top - EDGE_PX || row > edge.bottom + EDGE_PX {
                continue;
            }
            let column = edge.at(row.clamp(edge.top, edge.bottom));
            left = if column < left { column } else { left };
            right = if column > right { column } else { right };
        }
        (left <= right).then_some((left, right))
    }
}

/// The least whole number that is not less, from 0; a call of `ceil` costs more than all the rest of a short row, and a
/// cast to 64 bits twice one to 32.
pub(crate) fn rounded_up(value: f64) -> usize {
    let whole = value as u32;
    whole as usize + usize::from(f64::from(whole) < value)
}
