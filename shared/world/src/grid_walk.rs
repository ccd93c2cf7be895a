//! The cells of a regular grid that a ray passes through, in order (Amanatides and Woo 1987). Borders are computed
//! from the cell's number, never summed up, so that the distance has no drift.

use guidance::se2::Point;
use nalgebra::Vector2;

/// One cell on the way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Visit {
    pub(crate) ix: usize,
    pub(crate) iy: usize,
    /// Way along the ray to where it enters and leaves the cell, in units of the direction's length.
    pub(crate) t_in: f64,
    pub(crate) t_out: f64,
    /// The border through which the ray came in: 0 = across x, 1 = across y.
    pub(crate) axis: usize,
}

/// Walks a ray through a grid of unit cells, from (0, 0) to `size`.
#[derive(Debug, Clone)]
pub(crate) struct GridWalk {
    origin: [f64; 2],
    inverse: [f64; 2],
    step: [i64; 2],
    cell: [i64; 2],
    size: [i64; 2],
    t: f64,
    t_max: f64,
    axis: usize,
}

impl GridWalk {
    /// The walk from `origin` along `direction`, both in cell units, as far as `t_max`; `None` where the ray misses the
    /// grid.
    pub(crate) fn new(origin: Point, direction: Vector2<f64>, size: (usize, usize), t_max: f64) -> Option<Self> {
        let (origin, size) = ([origin.x, origin.y], [size.0 as i64, size.1 as i64]);
        let inverse = [1.0 / direction.x, 1.0 / direction.y];
        let (mut t, mut end, mut axis) = (0.0_f64, t_max, 0);
        for k in 0..2 {
            if direction[k] == 0.0 {
                if origin[k] < 0.0 || origin[k] > size[k] as f64 {
                    return None;
                }
                continue;
            }
            let (a, b) = (-origin[k] * inverse[k], (size[k] as f64 - origin[k]) * inverse[k]);
            if a.min(b) > t {
                (t, axis) = (a.min(b), k);
            }
            end = end.min(a.max(b));
        }
        // A NaN anywhere ends here too.
        if !(t <= end && t.is_finite()) {
            return None;
        }
        let (mut cell, mut step) = ([0; 2], [0; 2]);
        for k in 0..2 {
            cell[k] = ((origin[k] + t * direction[k]).floor() as i64).clamp(0, size[k] - 1);
            step[k] = if direction[k] > 0.0 {
                1
            } else if direction[k] < 0.0 {
                -1
            } else {
                0
            };
        }
        Some(Self { origin, inverse, step, cell, size, t, t_max, axis })
    }

    /// Way to the next border across axis `k`.
    fn border(&self, k: usize) -> f64 {
        if self.step[k] == 0 {
            return f64::INFINITY;
        }
        let at = self.cell[k] + i64::from(self.step[k] > 0);
        ((at as f64 - self.origin[k]) * self.inverse[k]).max(self.t)
    }
}

impl Iterator for GridWalk {
    type Item = Visit;

    fn next(&mut self) -> Option<Visit> {
        let inside = (0..2).all(|k| (0..self.size[k]).contains(&self.cell[k]));
        if !inside || self.t > self.t_max {
            return None;
        }
        let (x, y) = (self.border(0), self.border(1));
        let k = usize::from(y < x);
        let t_out = x.min(y);
        let visit =
            Visit { ix: self.cell[0] as usize, iy: self.cell[1] as usize, t_in: self.t, t_out, axis: self.axis };
        self.cell[k] += self.step[k];
        (self.t, self.axis) = (t_out, k);
        if self.step[k] == 0 {
            self.t = f64::INFINITY;
        }
        Some(visit)
    }
}
