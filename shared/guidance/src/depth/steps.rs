//! Steps in the floor: where it lies lower or higher all at once, and goes on from there.
//!
//! The floor is measured in cells along the camera's axis, against gravity. A step is a difference of height between
//! the floor before a place and the floor behind it that no ramp explains, side by side in some columns of cells. An
//! error of the attitude tilts both sides alike.

use super::index_of;

/// Cells: along the camera's axis, and across it, metres.
const ROW_M: f64 = 0.05;
const COLUMN_M: f64 = 0.1;
const ROWS: usize = 48;
const COLUMNS: usize = 24;
/// The cells reach so far to either side, metres.
const HALF_M: f64 = COLUMNS as f64 * COLUMN_M / 2.0;
/// What lies further off the level floor is left to edges and obstacles, metres.
const HIGH_M: f32 = 0.35;
/// A cell of fewer points says nothing.
const POINTS_MIN: u16 = 2;
/// A cell whose points differ by more, one standard deviation, is no floor, metres.
const FLAT_M: f32 = 0.025;
/// The height of the floor on either side of a place is taken from at most this many cells.
const SIDE_ROWS: usize = 3;
/// They agree, give or take so much, metres.
const SIDE_M: f32 = 0.02;
/// A step is more than this off what a ramp of 1:8 comes to, metres.
const STEP_M: f64 = 0.016;
const SLOPE: f64 = 0.125;
/// Less than this off is no step, as a share of it.
const PLAIN_SHARE: f64 = 0.7;
/// A step hides no more of the floor behind it than this height does, metres.
const HIDING_M: f64 = 0.2;
/// Columns to either side that are asked, and how many of them have to show the same step.
const BESIDE: usize = 2;
const AGREEING: usize = 2;
/// The same step is at most so much higher or lower there, metres.
const SAME_M: f64 = 0.025;
/// A step may be found off by these along the camera's axis, metres.
const OFFS_M: [f64; 5] = [-0.2, -0.1, 0.0, 0.1, 0.2];
/// Rows of cells that these reach, either way.
const OFF_ROWS: usize = 5;
/// A step that is known explains the first floor in view where that lies so much off it, at most, metres,
const KNOWN_M: f64 = 0.03;
/// and the step is at most so far behind the robot's middle, metres, and so far to the side of that floor, metres.
const BEHIND_M: f64 = 0.6;
const ASIDE_M: f64 = 0.3;
/// The floor behind a known step is the first in this many rows of cells.
const BEHIND_ROWS: usize = 8;
/// A column that shows no step uses the step of the nearest column that does, at most this many columns away.
const TAKEN_OVER: usize = 3;

/// A step down that is measured this near to the limit counts as deeper, metres: a fall lies beyond. Of 134 steps, the
/// deepest place that was measured was up to 8 mm too high (`guidedog evaluate --tasks drops --policy geometric --noise
/// legged --episodes 1500 --seed 9`, a camera of 128x64). Beyond the limit up lies no fall.
const OFF_DOWN_M: f64 = 0.01;

/// How high a step may be that robot and handler take, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepMax {
    /// One that leads down.
    pub down_m: f64,
    /// One that leads up.
    pub up_m: f64,
}

impl StepMax {
    /// Whether a step may be taken that is measured to rise so much, metres; less than 0: it leads down.
    #[must_use]
    pub fn allows(&self, rise_m: f64) -> bool {
        if rise_m < 0.0 { -rise_m <= self.down_m - OFF_DOWN_M } else { rise_m <= self.up_m }
    }
}

/// A step: along the camera's axis, to the left of it, and by how much the floor rises there, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    pub along_m: f64,
    pub left_m: f64,
    pub rise_m: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    count: u16,
    sum_m: f32,
    squares_m2: f32,
}

impl Cell {
    /// How high its floor is, metres. None where it shows no floor, or not enough of it.
    fn height_m(&self) -> Option<f32> {
        let count = f32::from(self.count);
        let mean_m = self.sum_m / count;
        let is_flat = || self.squares_m2 / count - mean_m * mean_m <= FLAT_M * FLAT_M;
        (self.count >= POINTS_MIN && is_flat()).then_some(mean_m)
    }
}

/// What the floor does between a cell and the next one of its column.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Way {
    #[default]
    Unknown,
    /// It goes on.
    Plain,
    /// It rises by so much, metres; less than 0: it falls.
    Step(f64),
}

/// How the camera looks at the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// From the robot's middle to the camera, along its axis, metres.
    pub ahead_m: f64,
    /// Height of the camera over the floor, metres.
    pub height_m: f64,
    /// Distance between two sampled rows of pixels on the floor at 1 m, metres. It grows with the distance's square.
    pub apart_at_1_m: f64,
}

/// See the module. Reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Steps {
    cells: Vec<Cell>,
    ways: Vec<Way>,
    /// How much higher than the first floor the floor of a cell is, for the steps that can be taken before it, metres.
    levels_m: Vec<f32>,
    /// Whether the floor is as high in all cells of its column within [`OFF_ROWS`].
    is_even: Vec<bool>,
    steps: Vec<Step>,
    /// How much higher than under the robot the first floor of each column is, for steps that are known, metres.
    firsts_m: [f32; COLUMNS],
    /// The step of each column that is known, where the floor behind it lies as it says: its row, and its rise, metres.
    borne_out: [Option<(usize, f32)>; COLUMNS],
    /// No such step is in view, nor before what is in view.
    is_level: bool,
}

impl Steps {
    /// A new frame.
    pub fn begin(&mut self) {
        self.cells.clear();
        self.cells.resize(ROWS * COLUMNS, Cell::default());
        self.clear();
    }

    /// Nothing seen.
    pub fn clear(&mut self) {
        self.ways.clear();
        self.steps.clear();
        self.firsts_m = [0.0; COLUMNS];
        self.borne_out = [None; COLUMNS];
        self.is_level = true;
    }

    /// A point along the camera's axis, to the left of it, over the level floor, metres.
    pub fn take(&mut self, along_m: f64, left_m: f64, height_m: f64) {
        let height_m = height_m as f32;
        if height_m.abs() < HIGH_M
            && let Some(cell) = number(along_m, left_m)
        {
            let cell = &mut self.cells[cell];
            cell.count = cell.count.saturating_add(1);
            cell.sum_m += height_m;
            cell.squares_m2 += height_m * height_m;
        }
    }

    /// Finds the steps. Those that are known and can be taken may lie before all floor that is in view.
    pub fn find(&mut self, look: &Look, max: &StepMax, known: impl Iterator<Item = Step> + Clone) {
        self.ways.resize(ROWS * COLUMNS, Way::Unknown);
        for column in 0..COLUMNS {
            self.follow(column, look);
        }
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                self.steps.extend(self.agreed(row, column));
            }
        }
        for column in 0..COLUMNS {
            self.firsts_m[column] = self.first_m(column, look, known.clone()) as f32;
            self.borne_out[column] = self.bears_out(column, known.clone().filter(|step| max.allows(step.rise_m)));
        }
        let is_low = |step: &Step| max.allows(step.rise_m);
        self.is_level = !self.steps.iter().any(is_low)
            && self.firsts_m.iter().all(|first_m| *first_m == 0.0)
            && self.borne_out.iter().all(Option::is_none);
        if !self.is_level {
            self.level(max);
        }
    }

    /// The steps that some columns side by side show.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Whether floor is seen to go on there without a step.
    pub fn is_plain(&self, along_m: f64, left_m: f64) -> bool {
        number(along_m, left_m).and_then(|cell| self.ways.get(cell)) == Some(&Way::Plain)
    }

    /// Whether every floor in view lies as high as the first one, but for ramps and for what cannot be taken.
    pub fn is_level(&self) -> bool {
        self.is_level
    }

    /// How much higher than the first floor the floor is at a place where a height was measured, metres. A step may be
    /// a little nearer or farther than it was found.
    pub fn level_m(&self, along_m: f64, left_m: f64, height_m: f64) -> f64 {
        if self.is_level {
            return 0.0;
        }
        let here = nearest(along_m, left_m);
        let level_m = |cell: usize| self.levels_m.get(cell).map_or(0.0, |level_m| f64::from(*level_m));
        if self.is_even.get(here) == Some(&true) {
            return level_m(here);
        }
        let levels_m = OFFS_M.map(|off_m| level_m(nearest(along_m + off_m, left_m)));
        let off_m = |level_m: &f64| (height_m - level_m).abs();
        levels_m.into_iter().min_by(|a, b| off_m(a).total_cmp(&off_m(b))).unwrap_or(0.0)
    }

    /// How much higher than under the robot the first floor of a column is, metres, for a step that is known. While the
    /// robot walks over the step, its middle may be at any height between the two floors.
    fn first_m(&self, column: usize, look: &Look, known: impl Iterator<Item = Step>) -> f64 {
        let floor = (0..ROWS).find_map(|row| Some((row, self.cells[row * COLUMNS + column].height_m()?)));
        let Some((row, height_m)) = floor.map(|(row, height_m)| (row, f64::from(height_m))) else { return 0.0 };
        let explains = |step: &Step| {
            let is_before = (-look.ahead_m - BEHIND_M..middle_m(row) + ROW_M).contains(&step.along_m);
            let (low_m, high_m) = (step.rise_m.min(0.0) - KNOWN_M, step.rise_m.max(0.0) + KNOWN_M);
            is_before && (step.left_m - left_m(column)).abs() <= ASIDE_M && (low_m..high_m).contains(&height_m)
        };
        let is_raised = height_m.abs() > KNOWN_M && known.into_iter().any(|step| explains(&step));
        if is_raised { height_m } else { 0.0 }
    }

    /// The known step that a column shows: floor is in view before it, and the floor behind it lies as it says. Right
    /// before a step the frame shows too little of the floor before it to find the step anew.
    fn bears_out(&self, column: usize, known: impl Iterator<Item = Step>) -> Option<(usize, f32)> {
        let height_m = |row: usize| self.cells.get(row * COLUMNS + column).and_then(Cell::height_m);
        let (first_row, first_m) = (0..ROWS).find_map(|row| Some((row, height_m(row)?)))?;
        let aside_m = |step: &Step| (step.left_m - left_m(column)).abs();
        let is_in_view = |step: &Step| step.along_m > middle_m(first_row) && aside_m(step) <= ASIDE_M;
        let step = known.filter(is_in_view).min_by(|a, b| aside_m(a).total_cmp(&aside_m(b)))?;
        let row = (step.along_m / ROW_M).round() as usize;
        let behind_m = (row..ROWS.min(row + BEHIND_ROWS)).find_map(height_m)?;
        let is_as_known = |height_m: f32, known_m: f64| (f64::from(height_m) - known_m).abs() <= KNOWN_M;
        (is_as_known(first_m, 0.0) && is_as_known(behind_m, step.rise_m)).then_some((row, step.rise_m as f32))
    }

    /// Follows the floor of a column from the camera on.
    fn follow(&mut self, column: usize, look: &Look) {
        let mut floor = [(0_usize, 0.0_f32); ROWS];
        let mut count = 0;
        for row in 0..ROWS {
            if let Some(height_m) = self.cells[row * COLUMNS + column].height_m() {
                floor[count] = (row, height_m);
                count += 1;
            }
        }
        let floor = &floor[..count];
        for last in 0..count.saturating_sub(1) {
            // The cell between the two sides may hold some of both.
            let ways = [last + 1, last + 2].map(|first| Self::between(floor, last, first, look));
            let way = ways.into_iter().flatten().max_by(|a, b| a.excess_m.total_cmp(&b.excess_m));
            let Some(way) = way else { continue };
            let row = floor[last].0;
            if way.excess_m > STEP_M {
                // The step shows from the cells before it too: the sharpest of them is where it is.
                self.set(column, row, Way::Step(way.rise_m));
            } else if way.excess_m < PLAIN_SHARE * STEP_M {
                (row..floor[last + 1].0).for_each(|row| self.set(column, row, Way::Plain));
            }
        }
        self.sharpen(column);
    }

    fn set(&mut self, column: usize, row: usize, way: Way) {
        self.ways[row * COLUMNS + column] = way;
    }

    /// Of steps in neighbouring cells keeps the greatest.
    fn sharpen(&mut self, column: usize) {
        let rise_m = |ways: &[Way], row: usize| match ways.get(row * COLUMNS + column) {
            Some(Way::Step(rise_m)) => Some(*rise_m),
            _ => None,
        };
        let mut row = 0;
        while row < ROWS {
            let Some(_) = rise_m(&self.ways, row) else {
                row += 1;
                continue;
            };
            let end = (row..ROWS.min(row + SIDE_ROWS + 1)).rev().find(|row| rise_m(&self.ways, *row).is_some());
            let end = end.unwrap_or(row);
            let of = |row: &usize| rise_m(&self.ways, *row).map_or(0.0, f64::abs);
            let best = (row..=end).max_by(|a, b| of(a).total_cmp(&of(b))).unwrap_or(row);
            for other in (row..=end).filter(|other| *other != best) {
                if rise_m(&self.ways, other).is_some() {
                    self.ways[other * COLUMNS + column] = Way::Unknown;
                }
            }
            row = end + 1;
        }
    }

    /// What the floor does from one of a column's cells to a later one.
    fn between(floor: &[(usize, f32)], last: usize, first: usize, look: &Look) -> Option<Between> {
        let (last_row, _) = floor[last];
        let (first_row, _) = *floor.get(first)?;
        let before = floor[..=last].iter().rev().take_while(|(row, _)| last_row - row < SIDE_ROWS);
        let after = floor[first..].iter().take_while(|(row, _)| row - first_row < SIDE_ROWS);
        let (before, after) = (Side::of(before)?, Side::of(after)?);
        let (from_m, to_m) = (middle_m(last_row), middle_m(first_row));
        let rise_m = f64::from(after.height_m - before.height_m);
        let apart_m = look.apart_at_1_m * to_m * to_m + 2.0 * ROW_M;
        let hidden_m = (to_m - from_m - apart_m).max(0.0);
        // Only what lies lower hides floor, and no more than so much of it.
        let hides_m = if rise_m < 0.0 { HIDING_M.min(-2.0 * rise_m) * to_m / look.height_m } else { 0.0 };
        let is_seen = hidden_m <= hides_m;
        let ramp_m = SLOPE * (after.along_m - before.along_m - hidden_m).max(0.0);
        is_seen.then_some(Between { rise_m, excess_m: rise_m.abs() - ramp_m })
    }

    /// The step of a cell, where the columns beside it show it too.
    fn agreed(&self, row: usize, column: usize) -> Option<Step> {
        let Way::Step(rise_m) = self.ways[row * COLUMNS + column] else { return None };
        let beside = column.saturating_sub(BESIDE)..(column + BESIDE + 1).min(COLUMNS);
        let (mut sum_m, mut count) = (rise_m, 1_u8);
        for other in beside.filter(|other| *other != column) {
            let rows = 2 * other.abs_diff(column) + 1;
            let near = row.saturating_sub(rows)..(row + rows + 1).min(ROWS);
            let same = near.filter_map(|row| match self.ways[row * COLUMNS + other] {
                Way::Step(other_m) if (other_m - rise_m).abs() <= SAME_M => Some(other_m),
                _ => None,
            });
            if let Some(other_m) = same.min_by(|a, b| (a - rise_m).abs().total_cmp(&(b - rise_m).abs())) {
                (sum_m, count) = (sum_m + other_m, count + 1);
            }
        }
        let left_m = left_m(column);
        let along_m = middle_m(row) + ROW_M / 2.0;
        (usize::from(count) > AGREEING).then(|| Step { along_m, left_m, rise_m: sum_m / f64::from(count) })
    }

    /// How high the floor of each cell is for the steps before it that can be taken.
    fn level(&mut self, max: &StepMax) {
        self.levels_m.clear();
        self.levels_m.resize(ROWS * COLUMNS, 0.0);
        for column in 0..COLUMNS {
            let is_of = |step: &&Step, of: usize| {
                number(step.along_m - ROW_M / 2.0, step.left_m).is_some_and(|cell| cell % COLUMNS == of)
            };
            let has = |of: &usize| self.steps.iter().any(|step| is_of(&step, *of));
            // Where a known step lies before all that is in view, the columns beside it may still show it.
            let taken_over = if self.firsts_m[column] == 0.0 { TAKEN_OVER } else { 0 };
            let sides = (0..=taken_over).flat_map(|off| [column.checked_sub(off), Some(column + off)]).flatten();
            let of = sides.into_iter().find(has);
            let borne_out = self.borne_out[column].filter(|_| of.is_none());
            let mut level_m = self.firsts_m[column];
            for row in 0..ROWS {
                level_m += borne_out.filter(|(step_row, _)| *step_row == row).map_or(0.0, |(_, rise_m)| rise_m);
                self.levels_m[row * COLUMNS + column] = level_m;
                let here = self.steps.iter().filter(|step| of.is_some_and(|of| is_of(step, of)));
                let here = here.filter(|step| (step.along_m / ROW_M).round() as usize == row + 1);
                level_m += here.filter(|step| max.allows(step.rise_m)).map(|step| step.rise_m as f32).sum::<f32>();
            }
        }
        self.find_even();
    }

    /// Most cells are far from any step: their level is looked up once a pixel, not five times.
    fn find_even(&mut self) {
        self.is_even.clear();
        for row in 0..ROWS {
            let rows = row.saturating_sub(OFF_ROWS)..=(row + OFF_ROWS).min(ROWS - 1);
            for column in 0..COLUMNS {
                let level_m = |row: usize| self.levels_m[row * COLUMNS + column];
                self.is_even.push(rows.clone().all(|near| level_m(near) == level_m(row)));
            }
        }
    }
}

/// The floor on one side of a place.
#[derive(Debug, Clone, Copy)]
struct Side {
    along_m: f64,
    height_m: f32,
}

impl Side {
    fn of<'a>(cells: impl Iterator<Item = &'a (usize, f32)>) -> Option<Self> {
        let (mut along_m, mut sum_m, mut count) = (0.0, 0.0, 0_u8);
        let (mut low_m, mut high_m) = (f32::INFINITY, f32::NEG_INFINITY);
        for (row, height_m) in cells {
            (along_m, sum_m, count) = (along_m + middle_m(*row), sum_m + height_m, count + 1);
            (low_m, high_m) = (low_m.min(*height_m), high_m.max(*height_m));
        }
        let is_floor = count > 0 && high_m - low_m <= SIDE_M;
        is_floor.then(|| Self { along_m: along_m / f64::from(count), height_m: sum_m / f32::from(count) })
    }
}

/// What the floor does between two of its cells: its rise, and what no ramp explains of it, metres.
#[derive(Debug, Clone, Copy)]
struct Between {
    rise_m: f64,
    excess_m: f64,
}

fn number(along_m: f64, left_m: f64) -> Option<usize> {
    let (row, column) = (along_m / ROW_M, (left_m + HALF_M) / COLUMN_M);
    let inside = row >= 0.0 && row < ROWS as f64 && column >= 0.0 && column < COLUMNS as f64;
    inside.then(|| index_of(row) * COLUMNS + index_of(column))
}

/// The cell of a place, or the one nearest to it.
fn nearest(along_m: f64, left_m: f64) -> usize {
    let index = |metres: f64, side_m: f64, count: usize| index_of(metres / side_m).min(count - 1);
    index(along_m, ROW_M, ROWS) * COLUMNS + index(left_m + HALF_M, COLUMN_M, COLUMNS)
}

fn left_m(column: usize) -> f64 {
    (column as f64 + 0.5) * COLUMN_M - HALF_M
}

fn middle_m(row: usize) -> f64 {
    (row as f64 + 0.5) * ROW_M
}
