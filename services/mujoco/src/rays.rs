//! Rays of lidar and camera on what stands and walks around the robot.
//!
//! Whether and where a ray meets a geom is MuJoCo's word (`mju_rayGeom`). Which geoms are asked is told by a grid over
//! the floor. `mj_multiRay` of MuJoCo 3.17.0 will not do: in a building of 24,151 boxes it took 22 times as long, and
//! gave another range than `mj_ray` for 5,913 of a depth frame's 19,200 pixels (measured once), for it bounds a geom by
//! the angles of its corners. The tests compare these rays with `mj_ray`'s.

use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::fun::utility::mju_ray_geom;
use world::World;

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
    fn new(data: &MjData<Box<MjModel>>, geom: usize) -> Self {
        Self {
            kind: data.model().geom_type()[geom],
            at: data.geom_xpos()[geom],
            turned: data.geom_xmat()[geom],
            size: data.model().geom_size()[geom],
        }
    }

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
            // A little more, for a face may lie on a border of cells.
            let reach = 1e-6 + (0..3).map(|i| self.turned[3 * axis + i].abs() * half[i]).sum::<f64>();
            [self.at[axis] - reach, self.at[axis] + reach]
        }))
    }
}

fn is_known(kind: MjtGeomBase) -> bool {
    let known = [
        MjtGeomBase::mjGEOM_PLANE,
        MjtGeomBase::mjGEOM_BOX,
        MjtGeomBase::mjGEOM_CYLINDER,
        MjtGeomBase::mjGEOM_CAPSULE,
        MjtGeomBase::mjGEOM_SPHERE,
    ];
    known.contains(&kind)
}

/// What stands still, sorted into a grid, and what moves.
#[derive(Debug, Default)]
pub struct Rays {
    /// Number of each geom that moves, and how it lies.
    moving: Vec<(usize, Solid)>,
    solids: Vec<Solid>,
    /// Those without bounds: the floor.
    endless: Vec<u32>,
    /// The grid's lower left corner, metres, and its columns and rows.
    corner: [f64; 2],
    size: [usize; 2],
    cells: Vec<Vec<u32>>,
    /// The floor, where it has holes: no geom is one.
    ground: Option<World>,
    /// Number of the ray that asked each of them last.
    asked: Vec<u64>,
    ray: u64,
}

impl Rays {
    /// The geoms of these groups as they lie in `data`: what stands still, and what moves. A geom that stands still is
    /// one of MuJoCo's world body; a door's leaf of such a group moves; the robot's own are none, whatever their group.
    /// What is no plane, box, cylinder, capsule or sphere is left out: MuJoCo ends the process where it is asked for
    /// such a geom.
    #[must_use]
    pub fn new(data: &MjData<Box<MjModel>>, still: &[i32], moving: &[i32]) -> Self {
        let model = data.model();
        let of = |groups: &[i32]| -> Vec<usize> {
            let is_of =
                |geom: &usize| groups.contains(&model.geom_group()[*geom]) && is_known(model.geom_type()[*geom]);
            (0..model.geom_group().len()).filter(is_of).collect()
        };
        let body = |geom: &usize| model.geom_bodyid()[*geom] as usize;
        let is_placed = |geom: &usize| model.body_mocapid()[body(geom)] >= 0;
        let is_still = |geom: &usize| model.body_weldid()[body(geom)] == 0 && !is_placed(geom);
        let moving = of(moving).into_iter().chain(of(still).into_iter().filter(is_placed));
        let solids: Vec<Solid> = of(still).into_iter().filter(is_still).map(|geom| Solid::new(data, geom)).collect();
        let bounds: Vec<_> = solids.iter().map(Solid::bounds).collect();
        let ends = |axis: usize, end: usize| bounds.iter().flatten().map(move |bounds| bounds[axis][end]);
        let corner = [0, 1].map(|axis| ends(axis, 0).fold(f64::INFINITY, f64::min));
        let size = [0, 1].map(|axis| {
            let far_m = ends(axis, 1).fold(f64::NEG_INFINITY, f64::max);
            if far_m.is_finite() { ((far_m - corner[axis]) / CELL_M) as usize + 1 } else { 0 }
        });
        let mut rays = Self {
            moving: moving.map(|geom| (geom, Solid::new(data, geom))).collect(),
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

    /// The same rays over the floor of a world with holes, whose geoms are of no group that they ask.
    #[must_use]
    pub fn over(mut self, world: &World) -> Self {
        self.ground = (!world.holes().is_empty()).then(|| world.clone());
        self
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

    /// Sees where everything that moves is now.
    pub fn look(&mut self, data: &MjData<Box<MjModel>>) {
        for (geom, solid) in &mut self.moving {
            *solid = Solid::new(data, *geom);
        }
    }

    /// How many geoms stand still.
    #[must_use]
    pub fn geoms(&self) -> usize {
        self.solids.len()
    }

    /// Way from `from` along the unit vector `way` (world frame) to the first geom, metres; `None` where none is within
    /// `max_m`. All of them are finite.
    pub fn cast(&mut self, from: &[f64; 3], way: &[f64; 3], max_m: f64) -> Option<f64> {
        debug_assert!(from.iter().chain(way).all(|number| number.is_finite()) && max_m.is_finite());
        self.ray += 1;
        let ground = self.ground.as_ref().and_then(|world| world.ground_along(&(*from).into(), &(*way).into()));
        let mut nearest = ground.map_or(max_m, |way_m| way_m.min(max_m));
        for &solid in &self.endless {
            nearest = self.solids[solid as usize].nearer(from, way, nearest);
        }
        for (_, solid) in &self.moving {
            nearest = solid.nearer(from, way, nearest);
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
