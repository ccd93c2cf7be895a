//! The faces of a world in a uniform grid, so that a ray or a disc meets only those near it.

use guidance::se2::Point;
use nalgebra::Vector2;

use crate::grid_walk::GridWalk;
use crate::prism::Prism;

/// Cells along the longer side at most: 262,144 cells, 1 MB.
const MAX_CELLS: f64 = 512.0;
/// No cell is smaller, metres: about the length of the faces of a furnished room.
const MIN_CELL_M: f64 = 1.0;

/// One vertical face.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Side {
    pub(crate) a: Point,
    pub(crate) b: Point,
    /// Index of its prism.
    pub(crate) prism: u32,
}

/// All faces, and by cell the numbers of those that touch it (`items[starts[cell]..starts[cell + 1]]`).
#[derive(Debug, Clone, Default)]
pub(crate) struct SideIndex {
    sides: Vec<Side>,
    corner: Point,
    cell_m: f64,
    size: (usize, usize),
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl SideIndex {
    pub(crate) fn new(prisms: &[Prism]) -> Self {
        let faces = prisms.iter().zip(0u32..).flat_map(|(prism, id)| prism.sides().map(move |(a, b)| (a, b, id)));
        let sides: Vec<Side> = faces.map(|(a, b, prism)| Side { a, b, prism }).collect();
        if sides.is_empty() {
            return Self::default();
        }
        let (mut min, mut max) = (sides[0].a, sides[0].a);
        for p in sides.iter().flat_map(|side| [side.a, side.b]) {
            (min, max) = (min.inf(&p), max.sup(&p));
        }
        let extent = max - min;
        let cell_m = (extent.x.max(extent.y) / MAX_CELLS).max(MIN_CELL_M);
        let count = |length: f64| (length / cell_m) as usize + 1;
        let mut index =
            Self { sides, corner: min, cell_m, size: (count(extent.x), count(extent.y)), ..Self::default() };
        index.fill();
        index
    }

    /// All faces, prism by prism.
    pub(crate) fn sides(&self) -> &[Side] {
        &self.sides
    }

    /// Counts, then places: two passes over the same cells.
    fn fill(&mut self) {
        let mut starts = vec![0u32; self.size.0 * self.size.1 + 1];
        for side in &self.sides {
            self.touched(side, |cell| starts[cell + 1] += 1);
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut next = starts.clone();
        let mut items = vec![0; starts.last().copied().unwrap_or(0) as usize];
        for (side, number) in self.sides.iter().zip(0u32..) {
            self.touched(side, |cell| {
                items[next[cell] as usize] = number;
                next[cell] += 1;
            });
        }
        (self.starts, self.items) = (starts, items);
    }

    /// Calls `f` with every cell that a face touches: those of its bounding box that its line passes through.
    fn touched(&self, side: &Side, mut f: impl FnMut(usize)) {
        let (min, max) = (side.a.inf(&side.b), side.a.sup(&side.b));
        let normal = Vector2::new(side.a.y - side.b.y, side.b.x - side.a.x);
        // A hair more than half a cell's diagonal, as seen along the normal.
        let reach = 0.5 * self.cell_m * (normal.x.abs() + normal.y.abs()) + 1e-9;
        self.cells(min, max, |ix, iy| {
            let middle = Vector2::new(ix as f64 + 0.5, iy as f64 + 0.5) * self.cell_m;
            if normal.dot(&(self.corner + middle - side.a)).abs() <= reach {
                f(iy * self.size.0 + ix);
            }
        });
    }

    /// Calls `f` with the cells that a box meets.
    fn cells(&self, min: Point, max: Point, mut f: impl FnMut(usize, usize)) {
        // A hair wider, so that what lies on a border is in both cells.
        let cell = |value: f64, count: usize| (value.floor().max(0.0) as usize).min(count - 1);
        let low = (min - self.corner) / self.cell_m - Vector2::repeat(1e-9);
        let high = (max - self.corner) / self.cell_m + Vector2::repeat(1e-9);
        if high.x < 0.0 || high.y < 0.0 || low.x > self.size.0 as f64 || low.y > self.size.1 as f64 {
            return;
        }
        for iy in cell(low.y, self.size.1)..=cell(high.y, self.size.1) {
            for ix in cell(low.x, self.size.0)..=cell(high.x, self.size.0) {
                f(ix, iy);
            }
        }
    }

    /// The faces of one cell.
    fn in_cell(&self, ix: usize, iy: usize) -> impl Iterator<Item = &Side> {
        let cell = iy * self.size.0 + ix;
        let items = &self.items[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        items.iter().map(|&number| &self.sides[number as usize])
    }

    /// Calls `f` with every face that may be in a box, some of them more than once.
    pub(crate) fn near(&self, min: Point, max: Point, mut f: impl FnMut(&Side)) {
        if self.sides.is_empty() {
            return;
        }
        self.cells(min, max, |ix, iy| self.in_cell(ix, iy).for_each(&mut f));
    }

    /// Way from `origin` along the unit vector `direction` to the first face of a prism that `wanted` accepts, metres;
    /// `None` where there is none within `max_m`.
    pub(crate) fn cast(
        &self,
        origin: Point,
        direction: Vector2<f64>,
        max_m: f64,
        wanted: impl Fn(u32) -> bool,
    ) -> Option<f64> {
        if self.sides.is_empty() {
            return None;
        }
        let start = Point::from((origin - self.corner) / self.cell_m);
        let mut best = f64::INFINITY;
        for visit in GridWalk::new(start, direction, self.size, max_m / self.cell_m)? {
            if best <= visit.t_in * self.cell_m {
                break;
            }
            for side in self.in_cell(visit.ix, visit.iy) {
                if let Some(t) = ray_meets(origin, direction, side).filter(|&t| t < best)
                    && wanted(side.prism)
                {
                    best = t;
                }
            }
        }
        (best <= max_m).then_some(best)
    }
}

/// Way along a ray to a face, metres.
pub(crate) fn ray_meets(origin: Point, direction: Vector2<f64>, side: &Side) -> Option<f64> {
    let (along, to_a) = (side.b - side.a, side.a - origin);
    let cross = direction.perp(&along);
    if cross == 0.0 {
        return None;
    }
    let t = to_a.perp(&along) / cross;
    let u = to_a.perp(&direction) / cross;
    // A hair beyond the ends, so that no ray slips through a corner.
    (t >= 0.0 && (-1e-12..=1.0 + 1e-12).contains(&u)).then_some(t)
}
