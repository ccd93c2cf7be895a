//! What of a scan can be matched: points on surfaces, with the direction in which each surface looks.

use guidance::se2::{Point, Se2};
use guidance::{BeamKind, Beams, Disc};
use nalgebra::{Matrix2, Vector2};

/// Hits nearer to each other than this are one point, metres: walls count by their length, not by how near they are,
/// and a lidar of 1,440 beams costs little more than one of 360.
const SPACING_M: f64 = 0.05;
/// Neighbouring hits of one surface are at most so far apart, metres,
const GAP_M: f64 = 0.12;
/// or so many times as far as on a surface that is met squarely: a wall seen at 14 degrees still is one.
const GAP_SLANT: f64 = 4.0;
/// The line through a point is fitted to what lies this near on the same surface, metres.
const LINE_REACH_M: f64 = 0.4;
/// A line is one where its points lie off it by less than this share of their spread along it.
const LINE_FLATNESS: f64 = 0.15;
/// Fewer points tell of no line.
const LINE_POINTS: usize = 3;

/// A point on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourPoint {
    /// Where, metres.
    pub at: Point,
    /// Unit vector square to the surface, towards the lidar.
    pub normal: Vector2<f64>,
}

impl ContourPoint {
    /// The same in another frame.
    #[must_use]
    pub fn seen_from(&self, other_from_this: &Se2) -> Self {
        Self { at: other_from_this * self.at, normal: other_from_this.rotation * self.normal }
    }
}

/// The points of a scan, robot frame. Reused from scan to scan.
#[derive(Debug, Clone, Default)]
pub struct Contour {
    points: Vec<ContourPoint>,
    surface: Vec<Point>,
}

impl Contour {
    /// The points, counter-clockwise.
    #[must_use]
    pub fn points(&self) -> &[ContourPoint] {
        &self.points
    }

    /// Takes in a scan, but for what lies within `left_out` (robot frame).
    pub fn fill(&mut self, beams: &Beams, left_out: &[Disc]) {
        self.points.clear();
        self.surface.clear();
        let is_left_out = |at: Point| left_out.iter().any(|disc| (at - disc.center).norm() <= disc.radius_m);
        let origin = beams.origin();
        let (mut last, mut cell) = (None::<Point>, Cell::default());
        for beam in beams.beams() {
            if beam.kind != BeamKind::Hit || is_left_out(beam.end) {
                self.end_surface(&mut cell, origin);
                last = None;
                continue;
            }
            let gap_m = GAP_M.max(GAP_SLANT * beam.reading_m * beams.increment_rad());
            if last.is_some_and(|last| (beam.end - last).norm() > gap_m) {
                self.end_surface(&mut cell, origin);
            }
            if let Some(full) = cell.take(beam.end) {
                self.surface.push(full);
            }
            last = Some(beam.end);
        }
        self.end_surface(&mut cell, origin);
    }

    /// Fits a line about each point of the surface that ends here, and keeps those that lie on one.
    fn end_surface(&mut self, cell: &mut Cell, origin: Point) {
        self.surface.extend(cell.end());
        for (i, &at) in self.surface.iter().enumerate() {
            let is_near = |other: &&Point| (**other - at).norm_squared() <= LINE_REACH_M * LINE_REACH_M;
            let before = self.surface[..i].iter().rev().take_while(is_near).count();
            let after = self.surface[i..].iter().take_while(is_near).count();
            // Far away beams are wide apart: there the neighbours tell.
            let (from, to) = (i - before.max(1).min(i), (i + after.max(2)).min(self.surface.len()));
            if let Some(normal) = normal_of(&self.surface[from..to], origin) {
                self.points.push(ContourPoint { at, normal });
            }
        }
        self.surface.clear();
    }
}

/// Hits that become one point.
#[derive(Debug, Default)]
struct Cell {
    first: Option<Point>,
    sum: Vector2<f64>,
    count: usize,
}

impl Cell {
    /// The point of the hits before, where this one is too far from them.
    fn take(&mut self, hit: Point) -> Option<Point> {
        let is_near = self.first.is_some_and(|first| (hit - first).norm() < SPACING_M);
        let full = if is_near { None } else { self.end() };
        self.first.get_or_insert(hit);
        (self.sum, self.count) = (self.sum + hit.coords, self.count + 1);
        full
    }

    fn end(&mut self) -> Option<Point> {
        let full = (self.count > 0).then(|| Point::from(self.sum / self.count as f64));
        *self = Self::default();
        full
    }
}

/// Square to the line through these points, towards the lidar; `None` where they lie on none.
fn normal_of(points: &[Point], origin: Point) -> Option<Vector2<f64>> {
    if points.len() < LINE_POINTS {
        return None;
    }
    let mean = points.iter().fold(Vector2::zeros(), |sum, point| sum + point.coords) / points.len() as f64;
    let spread = points.iter().fold(Matrix2::zeros(), |sum, point| {
        let off = point.coords - mean;
        sum + off * off.transpose()
    });
    let eigen = spread.symmetric_eigen();
    let (across, along) = if eigen.eigenvalues[0] < eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
    let is_line = eigen.eigenvalues[across] < LINE_FLATNESS * LINE_FLATNESS * eigen.eigenvalues[along];
    let normal: Vector2<f64> = eigen.eigenvectors.column(across).into();
    let towards = if normal.dot(&(origin.coords - mean)) < 0.0 { -normal } else { normal };
    (is_line && towards.iter().all(|part| part.is_finite())).then_some(towards)
}
