//! Tells a ramp from a kerb: the floor in cells, each no further above or below its neighbour than a ramp leads.
//!
//! Cells lie along the camera's axis. A cell's height is a robust one of its low points. The floor spreads from the
//! feet outward. A step between two cells ends it, up or down.

use crate::depth::index_of;

/// Side of a cell, metres.
pub(crate) const CELL_M: f64 = 0.2;
/// Cells along the camera's axis, and across it.
const ROWS: usize = 30;
const COLUMNS: usize = 30;
/// Points are sorted by height: a bin of 2 cm, over or below the level floor.
const BINS: usize = 64;
const BIN_M: f64 = 0.02;
/// A cell's height is that of its lowest point but this share: the foot of a box counts, a pixel below the floor not.
const LOW_SHARE: f64 = 0.2;
/// A cell of fewer points says nothing.
const POINTS_MIN: u16 = 2;
/// The steepest ramp, 1:8. A ramp for wheelchairs is 1:12.
const SLOPE_MAX: f64 = 0.125;
/// Error of a cell's height against its neighbour's, metres, and per metre of distance.
const STEP_M: f64 = 0.01;
const STEP_PER_M: f64 = 0.005;
/// Between the feet and the first floor in view a ramp of 1:12 may begin or end: its height there, and the error of the
/// attitude. Up it stays below a kerb of 10 cm.
const BLIND_SLOPE: f64 = 0.0833;
const BLIND_M: f64 = 0.01;
const BLIND_UP_M: f64 = 0.075;
const BLIND_DOWN_M: f64 = 0.095;
/// Floor that was seen to go on from the feet before may lie lower by so much more: a ramp down, or a step that was
/// taken, that has come out of view, metres. It is at most so much lower in all, and lies within this distance of the
/// camera: seen from farther off, a drop may have looked like floor.
const SEEN_DOWN_M: f64 = 0.06;
const SEEN_DOWN_MAX_M: f64 = 0.125;
const SEEN_WITHIN_M: f64 = 1.2;
/// It was seen at the middle of a cell and so far to each side of it, metres.
const SEEN_ASIDE_M: f64 = 0.1;
/// Farther to the side than this the first floor in view is level, metres: there the error of the attitude could lower
/// a kerb further. Else it has to go on from the floor beside it.
const BLIND_SIDE_M: f64 = 0.7;
const BLIND_LEVEL_M: f64 = 0.045;
/// A ramp that the robot stands on goes on as it began: how far it may be off, metres.
const CARRIED_M: f64 = 0.025;
/// Rows over which its slope is measured.
const CARRIED_ROWS: usize = 4;
/// A floor that is no further off the trimmed plane is that plane, metres, and per metre of distance.
const FLAT_M: f64 = 0.01;
const FLAT_PER_M: f64 = 0.005;
/// Where a cell shows no floor, this many cells to either side tell how high it is.
const BESIDE: usize = 2;

/// What a cell of the floor shows. Heights are over the level floor under the robot, metres.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum FloorCell {
    /// No point of it is in view.
    #[default]
    Unseen,
    /// Floor that goes on from the feet without a step.
    Floor(f64),
    /// It is seen, and a step or a gap in the view lies before it: a thing, a kerb, a lower level.
    Apart(f64),
}

impl FloorCell {
    fn height_m(self) -> Option<f64> {
        match self {
            Self::Unseen => None,
            Self::Floor(height_m) | Self::Apart(height_m) => Some(height_m),
        }
    }

    fn floor_m(self) -> Option<f64> {
        if let Self::Floor(height_m) = self { Some(height_m) } else { None }
    }
}

/// How the camera looks at the floor.
#[derive(Clone, Copy)]
pub(crate) struct Look<'a> {
    /// From the robot's middle to the camera, along its axis, metres.
    pub(crate) ahead_m: f64,
    /// Distance between two sampled rows of pixels on the floor, at 1 m, metres. It grows with the distance's square.
    pub(crate) apart_at_1_m: f64,
    /// Whether floor was seen before at a place along the axis and to the left, metres.
    pub(crate) was_floor: &'a dyn Fn(f64, f64) -> bool,
}

impl Look<'_> {
    /// Whether floor of a height that lies below the feet was seen before, at a place and all about it.
    fn saw_lower_floor(&self, height_m: f64, (along_m, left_m): (f64, f64)) -> bool {
        let lowest_m = (BLIND_SLOPE * (along_m + self.ahead_m) + SEEN_DOWN_M).min(SEEN_DOWN_MAX_M);
        let about = [(0.0, 0.0), (SEEN_ASIDE_M, 0.0), (-SEEN_ASIDE_M, 0.0), (0.0, SEEN_ASIDE_M), (0.0, -SEEN_ASIDE_M)];
        along_m <= SEEN_WITHIN_M
            && (-lowest_m..=0.0).contains(&height_m)
            && about.iter().all(|(ahead_m, aside_m)| (self.was_floor)(along_m + ahead_m, left_m + aside_m))
    }
}

/// The floor in cells. Reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cells {
    bins: Vec<[u8; BINS]>,
    /// Points of each cell.
    counts: Vec<u16>,
    cells: Vec<FloorCell>,
    /// Height of the floor of each cell over the trimmed plane: of its own, or of the one before it, metres.
    over_m: Vec<f64>,
    /// All of them are 0: no pixel need ask.
    is_flat: bool,
}

impl Cells {
    /// Nothing seen.
    pub(crate) fn clear(&mut self) {
        self.cells.clear();
    }

    /// A new frame.
    pub(crate) fn begin(&mut self) {
        self.bins.resize(ROWS * COLUMNS, [0; BINS]);
        self.bins.fill([0; BINS]);
        self.counts.clear();
        self.counts.resize(ROWS * COLUMNS, 0);
        self.cells.clear();
        self.cells.resize(ROWS * COLUMNS, FloorCell::Unseen);
        self.over_m.resize(ROWS * COLUMNS, 0.0);
    }

    /// A point along the camera's axis, to the left of it, over the level floor, metres.
    pub(crate) fn take(&mut self, along_m: f64, left_m: f64, height_m: f64) {
        let bin = height_m / BIN_M + (BINS / 2) as f64;
        if bin < BINS as f64
            && let Some(cell) = number(along_m, left_m)
        {
            let count = &mut self.bins[cell][index_of(bin)];
            if *count < u8::MAX {
                *count += 1;
                self.counts[cell] += 1;
            }
        }
    }

    /// Spreads the floor. `plane_m` is the height of the trimmed plane at a place along the axis and to the left.
    pub(crate) fn spread(&mut self, look: &Look<'_>, plane_m: impl Fn(f64, f64) -> f64) {
        for ((cell, bins), count) in self.cells.iter_mut().zip(&self.bins).zip(&self.counts) {
            if *count >= POINTS_MIN {
                *cell = FloorCell::Apart(low_m(bins, *count));
            }
        }
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                self.join_outward(row, column, look, &plane_m);
            }
            for column in 1..COLUMNS {
                self.join(row, column, row, column - 1, &plane_m);
            }
            for column in (1..COLUMNS).rev() {
                self.join(row, column - 1, row, column, &plane_m);
            }
        }
        self.fill(&plane_m);
        self.is_flat = self.over_m.iter().all(|over_m| *over_m == 0.0);
    }

    /// Height of the floor at a place over the trimmed plane, metres.
    pub(crate) fn over_m(&self, along_m: f64, left_m: f64) -> f64 {
        if self.is_flat {
            return 0.0;
        }
        let index = |metres: f64, count: usize| index_of(metres / CELL_M).min(count - 1);
        let (row, column) = (index(along_m, ROWS), index(left_m + HALF_M, COLUMNS));
        self.over_m.get(row * COLUMNS + column).copied().unwrap_or(0.0)
    }

    /// The cell at a place.
    pub(crate) fn at(&self, along_m: f64, left_m: f64) -> FloorCell {
        number(along_m, left_m).and_then(|cell| self.cells.get(cell)).copied().unwrap_or_default()
    }

    fn cell(&self, row: usize, column: usize) -> FloorCell {
        self.cells[row * COLUMNS + column]
    }

    /// Makes a cell floor that goes on from another one.
    fn join(&mut self, row: usize, column: usize, of_row: usize, of_column: usize, plane_m: &impl Fn(f64, f64) -> f64) {
        let FloorCell::Apart(height_m) = self.cell(row, column) else { return };
        let Some(floor_m) = self.cell(of_row, of_column).floor_m() else { return };
        let (to, from) = (middle(row, column), middle(of_row, of_column));
        let step_m = (height_m - plane_m(to.0, to.1)) - (floor_m - plane_m(from.0, from.1));
        let way_m = (to.0 - from.0).hypot(to.1 - from.1);
        if step_m.abs() <= SLOPE_MAX * way_m + STEP_M + STEP_PER_M * to.0 {
            self.cells[row * COLUMNS + column] = FloorCell::Floor(height_m);
        }
    }

    /// Makes a cell floor that goes on from the one before it, seen from the camera, or from the feet, as far as
    /// they or memory tell.
    fn join_outward(&mut self, row: usize, column: usize, look: &Look<'_>, plane_m: &impl Fn(f64, f64) -> f64) {
        let FloorCell::Apart(height_m) = self.cell(row, column) else { return };
        let (along_m, left_m) = middle(row, column);
        let seen =
            (1..=row).map(|rows| inward(row, column, rows)).find(|(r, c)| self.cell(*r, *c) != FloorCell::Unseen);
        let slope = || self.slope_outward(row, column).unwrap_or(0.0);
        let begins = || {
            begins(height_m, along_m + look.ahead_m, left_m, slope())
                || look.saw_lower_floor(height_m, (along_m, left_m))
        };
        if seen.is_none() && begins() {
            self.cells[row * COLUMNS + column] = FloorCell::Floor(height_m);
        }
        let Some((of_row, of_column)) = seen else { return };
        let apart_m = 1.5 * look.apart_at_1_m * along_m * along_m + 2.0 * CELL_M;
        if (row - of_row) as f64 * CELL_M <= apart_m {
            self.join(row, column, of_row, of_column, plane_m);
        }
        if row > 0 {
            self.join(row, column, row - 1, column.saturating_sub(1), plane_m);
            self.join(row, column, row - 1, (column + 1).min(COLUMNS - 1), plane_m);
        }
    }

    /// How the floor rises from a cell on, away from the camera.
    fn slope_outward(&self, row: usize, column: usize) -> Option<f64> {
        let from_m = self.cell(row, column).height_m()?;
        let outward = |rows: &usize| {
            let to_m = self.cells.get((row + rows) * COLUMNS + column).copied().and_then(FloorCell::height_m)?;
            Some((to_m - from_m) / (*rows as f64 * CELL_M))
        };
        (2..=CARRIED_ROWS).rev().find_map(|rows| outward(&rows))
    }

    /// Where a cell is no floor, one beside it tells where its floor would be, or else the one before it.
    fn fill(&mut self, plane_m: &impl Fn(f64, f64) -> f64) {
        for row in 0..ROWS {
            let mut own_m = [None; COLUMNS];
            own_m.iter_mut().enumerate().for_each(|(column, own_m)| *own_m = self.own_m(row, column, plane_m));
            for column in 0..COLUMNS {
                let beside = || {
                    let near = &own_m[column.saturating_sub(BESIDE)..COLUMNS.min(column + BESIDE + 1)];
                    near.iter().flatten().copied().reduce(f64::min)
                };
                let before = || {
                    let (of_row, of_column) = inward(row, column, 1);
                    self.over_m[of_row * COLUMNS + of_column]
                };
                let over_m = own_m[column].or_else(beside);
                self.over_m[row * COLUMNS + column] = match over_m {
                    Some(over_m) => over_m,
                    None if row == 0 => 0.0,
                    None => before(),
                };
            }
        }
    }

    /// How far the floor of a cell is over the trimmed plane, metres.
    fn own_m(&self, row: usize, column: usize, plane_m: &impl Fn(f64, f64) -> f64) -> Option<f64> {
        let over = |column: usize| {
            let (along_m, left_m) = middle(row, column);
            self.cell(row, column).floor_m().map(|floor_m| floor_m - plane_m(along_m, left_m))
        };
        let (own_m, flat_m) = (over(column)?, FLAT_M + FLAT_PER_M * row as f64 * CELL_M);
        if own_m <= 0.0 {
            return Some((own_m + flat_m).min(0.0));
        }
        // A ramp is wide: what rises above the floor beside it is a thing.
        let sides = [column.saturating_sub(1), (column + 1).min(COLUMNS - 1)];
        let least_m = sides.into_iter().filter_map(over).fold(own_m, f64::min);
        Some((least_m - flat_m).max(0.0))
    }
}

/// Reach to either side, metres.
const HALF_M: f64 = COLUMNS as f64 / 2.0 * CELL_M;

fn number(along_m: f64, left_m: f64) -> Option<usize> {
    let (row, column) = (along_m / CELL_M, (left_m + HALF_M) / CELL_M);
    let inside = row >= 0.0 && row < ROWS as f64 && column >= 0.0 && column < COLUMNS as f64;
    inside.then(|| index_of(row) * COLUMNS + index_of(column))
}

fn middle(row: usize, column: usize) -> (f64, f64) {
    ((row as f64 + 0.5) * CELL_M, (column as f64 + 0.5) * CELL_M - HALF_M)
}

/// The cell a number of rows nearer to the camera on the line to it.
fn inward(row: usize, column: usize, rows: usize) -> (usize, usize) {
    let (along_m, left_m) = middle(row, column);
    let nearer_m = along_m - rows as f64 * CELL_M;
    (row - rows, (((left_m * nearer_m / along_m + HALF_M) / CELL_M) as usize).min(COLUMNS - 1))
}

/// Whether floor of a height and of a slope away from the robot may be the first in view, at a place.
fn begins(height_m: f64, ahead_m: f64, left_m: f64, slope: f64) -> bool {
    let distance_m = ahead_m.hypot(left_m);
    let carried_m = if slope.abs() <= SLOPE_MAX { slope * distance_m } else { 0.0 };
    let most_m = match () {
        () if left_m.abs() > BLIND_SIDE_M => BLIND_LEVEL_M,
        () if height_m > 0.0 => BLIND_UP_M,
        () => BLIND_DOWN_M,
    };
    height_m.abs() <= (BLIND_SLOPE * distance_m + BLIND_M).min(most_m)
        || (height_m * carried_m > 0.0 && height_m.abs() <= carried_m.abs() + CARRIED_M)
}

/// Height below which a share of the points lies, metres.
fn low_m(bins: &[u8; BINS], count: u16) -> f64 {
    let wanted = f64::from(count) * LOW_SHARE;
    let mut below = 0.0;
    for (bin, count) in bins.iter().enumerate().filter(|(_, count)| **count > 0) {
        let count = f64::from(*count);
        if below + count >= wanted {
            return (bin as f64 - (BINS / 2) as f64 + (wanted - below) / count) * BIN_M;
        }
        below += count;
    }
    BINS as f64 / 2.0 * BIN_M
}
