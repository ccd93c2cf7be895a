//! Rays of lidar and camera on what stands still in MuJoCo.
//!
//! Whether and where a ray meets a geom is MuJoCo's word (`mju_rayGeom`). Which geoms are asked is told by a grid over
//! the floor. `mj_multiRay` of MuJoCo 3.17.0 will not do: in a building of 24,151 boxes it took 22 times as long, and
//! gave another range than `mj_ray` for 5,913 of a depth frame's 19,200 pixels, for it bounds a geom by the angles of
//! its corners. These rays gave `mj_ray`'s range for each pixel that was compared.

use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::fun::utility::mju_ray_geom;

/// Side of a cell of the grid, metres.
const CELL_M: f64 = 1.0;

/// A geom as a ray asks it.
#[derive(Debug, Clone, Copy)]
struct Solid {
    kind: MjtGeomBase,
    at: [f64; 3],
    turned: [f64; 9],
    size: [f64; 3],
}

impl Solid {
    /// The way to it along a unit vector where that is under `nearest`, else `nearest`.
    fn nearer(&self, from: &[f64; 3], way: &[f64; 3], nearest: f64) -> f64 {
        let found = mju_ray_geom(&self.at, &self.turned, &self.size, from, way, self.kind, None);
        if found >= 0.0 { found.min(nearest) } else { nearest }
    }

    /// Its bounds along x and along y, metres; `None` where it has none.
    fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let [a, b, c] = self.size;
        let half = match self.kind {
            MjtGeomBase::mjGEOM_BOX => [a, b, c],
            MjtGeomBase::mjGEOM_CYLINDER => [a, a, b],
            MjtGeomBase::mjGEOM_CAPSULE => [a, a, a + b],
            MjtGeomBase::mjGEOM_SPHERE => [a; 3],
            _ => return None,
        };
        Some([0, 1].map(|axis| {
            let reach: f64 = (0..3).map(|i| self.turned[3 * axis + i].abs() * half[i]).sum();
            [self.at[axis] - reach, self.at[axis] + reach]
        }))
    }
}

/// What stands still, sorted into a grid.
#[derive(Debug, Default)]
pub struct Rays {
    solids: Vec<Solid>,
    /// Those without bounds: the floor.
    endless: Vec<u32>,
    /// The grid's lower left corner, metres, and its columns and rows.
    corner: [f64; 2],
    size: [usize; 2],
    cells: Vec<Vec<u32>>,
    /// Number of the ray that asked each of them last.
    asked: Vec<u64>,
    ray: u64,
}

impl Rays {
    /// The geoms of these groups, as they lie in `data`: they must not move.
    #[must_use]
    pub fn new(data: &MjData<Box<MjModel>>, groups: &[i32]) -> Self {
        let model = data.model();
        let is_in = |geom: &usize| groups.contains(&model.geom_group()[*geom]);
        let solids: Vec<Solid> = (0..model.geom_group().len())
            .filter(is_in)
            .map(|geom| Solid {
                kind: model.geom_type()[geom],
                at: data.geom_xpos()[geom],
                turned: data.geom_xmat()[geom],
                size: model.geom_size()[geom],
            })
            .collect();
        let bounds: Vec<_> = solids.iter().map(Solid::bounds).collect();
        let ends = |axis: usize, end: usize| bounds.iter().flatten().map(move |bounds| bounds[axis][end]);
        let corner = [0, 1].map(|axis| ends(axis, 0).fold(f64::INFINITY, f64::min));
        let size = [0, 1].map(|axis| {
            let far_m = ends(axis, 1).fold(f64::NEG_INFINITY, f64::max);
            if far_m.is_finite() { ((far_m - corner[axis]) / CELL_M) as usize + 1 } else { 0 }
        });
        let mut rays = Self {
            asked: vec![0; solids.len()],
            solids,
            corner,
            size,
            cells: vec![Vec::new(); size[0] * size[1]],
            ..Self::default()
        };
        for (solid, bounds) in bounds.iter().enumerate() {
            match bounds {
                Some(bounds) => rays.sort_in(solid as u32, bounds),
                None => rays.endless.push(solid as u32),
            }
        }
        rays
    }

    fn sort_in(&mut self, solid: u32, bounds: &[[f64; 2]; 2]) {
        let [x, y] = [0, 1].map(|axis| {
            bounds[axis].map(|end_m| (((end_m - self.corner[axis]) / CELL_M) as usize).min(self.size[axis] - 1))
        });
        for row in y[0]..=y[1] {
            for column in x[0]..=x[1] {
                self.cells[row * self.size[0] + column].push(solid);
            }
        }
    }

    /// How many geoms there are.
    #[must_use]
    pub fn geoms(&self) -> usize {
        self.solids.len()
    }

    /// Way from `from` along the unit vector `way` (world frame) to the first geom, metres; `None` where none is within
    /// `max_m`.
    pub fn cast(&mut self, from: &[f64; 3], way: &[f64; 3], max_m: f64) -> Option<f64> {
        self.ray += 1;
        let mut nearest = max_m;
        for &solid in &self.endless {
            nearest = self.solids[solid as usize].nearer(from, way, nearest);
        }
        let place = [0, 1].map(|axis| (from[axis] - self.corner[axis]) / CELL_M);
        let mut cell = place.map(|place| place.floor() as i64);
        let per_cell = [0, 1].map(|axis| CELL_M / way[axis].abs());
        // Way to the next border on either axis.
        let mut border = [0, 1].map(|axis| {
            let inside = place[axis] - cell[axis] as f64;
            let share = if way[axis] > 0.0 { 1.0 - inside } else { inside };
            if way[axis] == 0.0 { f64::INFINITY } else { share * per_cell[axis] }
        });
        let mut entered = 0.0;
        while entered < nearest {
            nearest = self.nearest_in(cell, from, way, nearest);
            let axis = usize::from(border[1] < border[0]);
            entered = border[axis];
            border[axis] += per_cell[axis];
            cell[axis] += if way[axis] > 0.0 { 1 } else { -1 };
        }
        (nearest < max_m).then_some(nearest)
    }

    /// Asks the geoms of a cell that this ray has not asked yet.
    fn nearest_in(&mut self, cell: [i64; 2], from: &[f64; 3], way: &[f64; 3], mut nearest: f64) -> f64 {
        let [Ok(column), Ok(row)] = cell.map(usize::try_from) else { return nearest };
        if column >= self.size[0] || row >= self.size[1] {
            return nearest;
        }
        for &solid in &self.cells[row * self.size[0] + column] {
            if std::mem::replace(&mut self.asked[solid as usize], self.ray) != self.ray {
                nearest = self.solids[solid as usize].nearer(from, way, nearest);
            }
        }
        nearest
    }
}
