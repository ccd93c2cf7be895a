//! A floor plan of square cells, as ROS map_server has it.

use guidance::se2::{Point, Se2, se2};
use messages::Pose2;
use nalgebra::Vector2;

use crate::grid_walk::{GridWalk, Visit};
use crate::sweep::{free_share, to_box};

/// What a map says about a cell. Only [`Cell::Free`] lets robot, handler or rays pass: unknown is not free, and what is
/// off the map is unknown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Cell {
    /// Nobody has seen it.
    #[default]
    Unknown = 0,
    /// Nothing stands there.
    Free,
    /// A wall or a thing.
    Occupied,
}

/// Cells of a floor plan; what is not free reaches from floor to ceiling.
#[derive(Debug, Clone)]
pub struct GridMap {
    size: (usize, usize),
    resolution_m: f64,
    map_from_world: Se2,
    world_from_map: Se2,
    cells: Vec<Cell>,
}

/// A straight run of cell borders, in the world frame.
pub(crate) type Face = (Point, Point);

impl GridMap {
    /// A map of `width` times `cells.len() / width` cells, row by row from the lower left, `world_from_map` the pose of
    /// its lower left corner. Cells beyond the last whole row are left out.
    #[must_use]
    pub fn new(width: usize, resolution_m: f64, world_from_map: Pose2, cells: Vec<Cell>) -> Self {
        let world_from_map = se2(world_from_map);
        let size = (width, cells.len().checked_div(width).unwrap_or(0));
        Self { size, resolution_m, map_from_world: world_from_map.inverse(), world_from_map, cells }
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Length of a cell's side, metres.
    #[must_use]
    pub fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The cell in a column and a row counted from the lower left; unknown off the map.
    #[must_use]
    pub fn cell(&self, column: i64, row: i64) -> Cell {
        let inside = (0..self.size.0 as i64).contains(&column) && (0..self.size.1 as i64).contains(&row);
        if inside { self.cells[row as usize * self.size.0 + column as usize] } else { Cell::Unknown }
    }

    /// The cell at a place in the world; unknown off the map.
    #[must_use]
    pub fn at(&self, world: Point) -> Cell {
        let (column, row) = self.cell_of(world);
        self.cell(column, row)
    }

    /// Column and row at a place in the world, on the map or off it.
    #[must_use]
    pub fn cell_of(&self, world: Point) -> (i64, i64) {
        let p = self.to_cells(world);
        (p.x.floor() as i64, p.y.floor() as i64)
    }

    /// The middle of a cell, in the world frame.
    #[must_use]
    pub fn middle(&self, column: usize, row: usize) -> Point {
        self.place_of(column as f64 + 0.5, row as f64 + 0.5)
    }

    /// The same map, with these cells free, by number.
    pub(crate) fn with_free(&self, cells: &[usize]) -> Self {
        let mut map = self.clone();
        cells.iter().for_each(|cell| map.cells[*cell] = Cell::Free);
        map
    }

    /// The number of the cell at a place in the world, row by row from the lower left; none off the map.
    pub(crate) fn number_at(&self, world: Point) -> Option<usize> {
        let (column, row) = self.cell_of(world);
        let (width, height) = self.size;
        let inside = (0..width as i64).contains(&column) && (0..height as i64).contains(&row);
        inside.then(|| row as usize * width + column as usize)
    }

    /// The middle of the cell of that number, in the world frame.
    pub(crate) fn middle_of(&self, number: usize) -> Point {
        self.middle(number % self.size.0, number / self.size.0)
    }

    /// How many cells are of a kind.
    #[must_use]
    pub fn count(&self, kind: Cell) -> usize {
        self.cells.iter().filter(|&&cell| cell == kind).count()
    }

    fn to_cells(&self, world: Point) -> Point {
        self.map_from_world * world / self.resolution_m
    }

    /// A place in the world, by columns and rows from the lower left corner, in parts of cells.
    #[must_use]
    pub fn place_of(&self, x_cells: f64, y_cells: f64) -> Point {
        self.world_from_map * Point::new(x_cells * self.resolution_m, y_cells * self.resolution_m)
    }

    /// The first blocked cell on a ray: the way to it in metres and the visit; no visit where the ray leaves the map
    /// free. `None` where everything within `max_m` is free.
    fn first_blocked(&self, origin: Point, direction: Vector2<f64>, max_m: f64) -> Option<(f64, Option<Visit>)> {
        let (start, turned) = (self.to_cells(origin), self.map_from_world.rotation * direction);
        if self.cell(start.x.floor() as i64, start.y.floor() as i64) != Cell::Free {
            return Some((0.0, None));
        }
        let mut end = 0.0;
        for visit in GridWalk::new(start, turned, self.size, max_m / self.resolution_m)? {
            if self.cells[visit.iy * self.size.0 + visit.ix] != Cell::Free {
                let way_m = visit.t_in * self.resolution_m;
                return (way_m <= max_m).then_some((way_m, Some(visit)));
            }
            end = visit.t_out * self.resolution_m;
        }
        (end < max_m).then_some((end, None))
    }

    /// Way from `origin` along the unit vector `direction` to the first cell that is not free, or to the edge of the
    /// map, metres; `None` where that is over `max_m`. 0 where the origin is not free itself.
    #[must_use]
    pub fn cast(&self, origin: Point, direction: Vector2<f64>, max_m: f64) -> Option<f64> {
        self.first_blocked(origin, direction, max_m).map(|(way_m, _)| way_m)
    }

    /// Distance from a place to the nearest cell that is not free, metres, at most `up_to_m`.
    #[must_use]
    pub fn clearance(&self, world: Point, up_to_m: f64) -> f64 {
        let (p, reach) = (self.to_cells(world), Vector2::repeat(up_to_m / self.resolution_m));
        let mut nearest = up_to_m;
        self.blocked_in(p - reach, p + reach, |min, max| {
            nearest = nearest.min(to_box(p, min, max) * self.resolution_m);
        });
        nearest
    }

    /// The share of a way that a disc can go; see [`crate::World::free_share`].
    pub(crate) fn free_share(&self, from: Point, to: Point, radius_m: f64) -> Option<f64> {
        let (from, to) = (self.to_cells(from), self.to_cells(to));
        let (radius, mut share) = (radius_m / self.resolution_m, None::<f64>);
        let reach = Vector2::repeat(radius);
        self.blocked_in(from.inf(&to) - reach, from.sup(&to) + reach, |min, max| {
            if let Some(found) = free_share(from, to, radius, |p| to_box(p, min, max)) {
                share = Some(share.map_or(found, |share| share.min(found)));
            }
        });
        share
    }

    /// Calls `f` with the corners (cell units) of every cell in a box that is not free.
    fn blocked_in(&self, min: Point, max: Point, mut f: impl FnMut(Point, Point)) {
        for row in min.y.floor() as i64..=max.y.floor() as i64 {
            for column in min.x.floor() as i64..=max.x.floor() as i64 {
                if self.cell(column, row) != Cell::Free {
                    let corner = Point::new(column as f64, row as f64);
                    f(corner, corner + Vector2::repeat(1.0));
                }
            }
        }
    }

    /// The cell borders that rays from `origin` end on, neighbours joined into runs: `rays` rays over `span_rad` from
    /// `from_rad` (world frame) on. The edge of the map is not among them.
    pub(crate) fn visible_faces(
        &self,
        origin: Point,
        (from_rad, span_rad, rays): (f64, f64, usize),
        max_m: f64,
    ) -> Vec<Face> {
        // (axis, number of the border, place along it), sorted so that runs are neighbours.
        let mut borders = Vec::with_capacity(rays);
        let start = self.to_cells(origin);
        for i in 0..=rays {
            let angle = from_rad + span_rad * i as f64 / rays as f64;
            let direction = Vector2::new(angle.cos(), angle.sin());
            let Some((_, Some(visit))) = self.first_blocked(origin, direction, max_m) else { continue };
            let border = match visit.axis {
                0 => (0, visit.ix + usize::from(start.x > visit.ix as f64), visit.iy),
                _ => (1, visit.iy + usize::from(start.y > visit.iy as f64), visit.ix),
            };
            if borders.last() != Some(&border) {
                borders.push(border);
            }
        }
        borders.sort_unstable();
        borders.dedup();
        let mut faces = Vec::new();
        for run in borders.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1) && a.2 + 1 == b.2) {
            let (axis, at, from) = run[0];
            let (at, from, to) = (at as f64, from as f64, (from + run.len()) as f64);
            faces.push(match axis {
                0 => (self.place_of(at, from), self.place_of(at, to)),
                _ => (self.place_of(from, at), self.place_of(to, at)),
            });
        }
        faces
    }
}
