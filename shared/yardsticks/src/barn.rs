//! BARN, the benchmark for autonomous robot navigation (Perille et al. 2020), as its challenge scores it
//! (`Daffan/the-barn-challenge`, `run.py`): a field of cylinders, a goal 10 m ahead, and the time in relation to that
//! of a reference path.

use std::path::{Path, PathBuf};

use guidance::se2::Point;
use world::{World, sdf};

use crate::walk::{self, End, Passage, Trace};
use crate::{Crowd, YardstickError, file, npy};

/// Where the robot starts, world frame: metres and radians (`INIT_POSITION`).
pub const START: [f64; 3] = [-2.25, 3.0, 1.57];
/// The goal from there, world frame, metres (`GOAL_POSITION`).
pub const GOAL_M: [f64; 2] = [0.0, 10.0];
/// A robot that is so near to the goal is there, metres.
const REACHED_M: f64 = 1.0;
/// Time begins when the robot has come so far, metres, and ends after so long, seconds.
const BEGINS_M: f64 = 0.1;
const TIME_MAX_S: f64 = 100.0;
/// The speed of the reference path, m/s.
const OPTIMAL_MPS: f64 = 2.0;
/// Times count within these multiples of the optimal time.
const CLIP: [f64; 2] = [2.0, 8.0];
/// A reference path is told in cells of the cylinders' diameter.
const RADIUS_M: f64 = 0.075;
/// No cell is farther from the first one: the fields of BARN have 30 by 66.
const CELL_MAX: f64 = 10_000.0;

/// A world with its reference path.
#[derive(Debug, Clone)]
pub struct Task {
    /// Its number.
    pub number: u32,
    /// What stands in it.
    pub world: World,
    /// Length of the reference path, from start to goal, divided by 2 m/s, seconds.
    pub optimal_s: f64,
}

/// What a passage is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// The robot came to the goal in time and touched nothing.
    pub success: bool,
    /// It touched something.
    pub collided: bool,
    /// Its time was over.
    pub timed_out: bool,
    /// From its first 0.1 m to the end, seconds.
    pub actual_s: f64,
    /// See [`Task::optimal_s`].
    pub optimal_s: f64,
    /// success * optimal / clip(actual, 2 optimal, 8 optimal): 0, or 0.125 to 0.5.
    pub score: f64,
}

impl Task {
    /// Reads a world (`world_N.world`, packed as `.xz` or not) and its reference path (`path_N.npy` beside it).
    ///
    /// # Errors
    /// Where a file is missing or cannot be used.
    pub fn load(path: &Path) -> Result<Self, YardstickError> {
        let name = path.display().to_string();
        let Some(number) = number_of(path) else {
            return Err(YardstickError::content(&name, "a file world_N.world or world_N.world.xz is wanted"));
        };
        let world = sdf::parse(&name, &file::text(path)?)?;
        let reference = path_beside(path, number);
        let reference_name = reference.display().to_string();
        let cells = npy::rows::<2>(&reference_name, &file::bytes(&reference)?)?;
        let refuse = |what: String| Err(YardstickError::content(&reference_name, what));
        if cells.is_empty() {
            return refuse("a path without a cell".to_owned());
        }
        if let Some(row) = cells.iter().position(|cell| cell.iter().any(|number| number.abs() > CELL_MAX)) {
            return refuse(format!("row {row} is a cell over {CELL_MAX} from the first"));
        }
        Ok(Self { number, world, optimal_s: optimal_s(&cells) })
    }

    /// From start to goal.
    #[must_use]
    pub fn passage(&self) -> Passage {
        Passage {
            world: self.world.clone(),
            crowd: Crowd::default(),
            world_from_start: walk::start(START[0], START[1], START[2]),
            goal: Point::new(START[0] + GOAL_M[0], START[1] + GOAL_M[1]),
            goal_m: REACHED_M,
            begins_m: BEGINS_M,
            time_max_s: TIME_MAX_S,
            is_localised: false,
        }
    }

    /// What a passage of this task is worth.
    #[must_use]
    pub fn score(&self, trace: &Trace) -> Score {
        score(trace.end, trace.time_s(), self.optimal_s)
    }
}

/// The worlds of a folder, or a file itself, by their numbers.
///
/// # Errors
/// Where a folder cannot be read or has none, or two worlds have the same number.
pub fn worlds(paths: &[PathBuf]) -> Result<Vec<PathBuf>, YardstickError> {
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let failed = |source| YardstickError::Read { file: path.display().to_string(), source };
        let entries = std::fs::read_dir(path).map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
        let before = all.len();
        all.extend(entries.into_iter().map(|entry| entry.path()).filter(|path| number_of(path).is_some()));
        if all.len() == before {
            return Err(YardstickError::content(&path.display().to_string(), "no world_N.world in it"));
        }
    }
    all.sort_by_key(|path| (number_of(path), path.clone()));
    // Reports and pictures name a world by its number.
    let is_same = |pair: &&[PathBuf]| number_of(&pair[0]).is_some() && number_of(&pair[0]) == number_of(&pair[1]);
    match all.windows(2).find(is_same) {
        Some(pair) => {
            let what = format!("the same world as {}", pair[0].display());
            Err(YardstickError::content(&pair[1].display().to_string(), what))
        }
        None => Ok(all),
    }
}

/// `nav_metric` of `run.py`.
fn score(end: End, actual_s: f64, optimal_s: f64) -> Score {
    let success = end == End::Goal;
    let clipped_s = actual_s.clamp(CLIP[0] * optimal_s, CLIP[1] * optimal_s);
    Score {
        success,
        collided: matches!(end, End::Collision(_)),
        timed_out: end == End::TimeOut,
        actual_s,
        optimal_s,
        score: if success { optimal_s / clipped_s } else { 0.0 },
    }
}

/// `path_coord_to_gazebo_coord` of `run.py`: a cell of a reference path in the world, metres.
fn in_world([x, y]: [f64; 2]) -> Point {
    let cell_m = 2.0 * RADIUS_M;
    Point::new(x * cell_m - RADIUS_M - 30.0 * cell_m, y * cell_m + RADIUS_M + 5.0)
}

/// The time of the way from the start along the cells to the goal.
fn optimal_s(cells: &[[f64; 2]]) -> f64 {
    let start = Point::new(START[0], START[1]);
    let goal = start + nalgebra::Vector2::from(GOAL_M);
    let corners: Vec<Point> = std::iter::once(start).chain(cells.iter().copied().map(in_world)).chain([goal]).collect();
    corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>() / OPTIMAL_MPS
}

/// N of `world_N.world` or `world_N.world.xz`.
fn number_of(path: &Path) -> Option<u32> {
    let name = path.file_name()?.to_str()?;
    let name = name.strip_suffix(".xz").unwrap_or(name);
    name.strip_prefix("world_")?.strip_suffix(".world")?.parse().ok()
}

/// The reference path: beside the world, packed or not.
fn path_beside(world: &Path, number: u32) -> PathBuf {
    let plain = world.with_file_name(format!("path_{number}.npy"));
    let packed = world.with_file_name(format!("path_{number}.npy.xz"));
    if !plain.exists() && packed.exists() { packed } else { plain }
}

#[cfg(test)]
mod tests {
    use super::{End, number_of, optimal_s, score};
    use crate::Touch;
    use std::path::Path;

    #[test]
    fn the_score_is_that_of_the_organisers_script() {
        // Optimal time 5 s: full marks up to 10 s, an eighth from 40 s on.
        for (actual_s, wanted) in [(4.0, 0.5), (10.0, 0.5), (12.5, 0.4), (20.0, 0.25), (40.0, 0.125), (99.0, 0.125)] {
            let score = score(End::Goal, actual_s, 5.0);
            assert!((score.score - wanted).abs() < 1e-12 && score.success, "{score:?}");
        }
        for end in [End::Collision(Touch::Robot), End::TimeOut] {
            let score = score(end, 12.5, 5.0);
            assert_eq!((score.score, score.success), (0.0, false));
            assert_eq!((score.collided, score.timed_out), (end != End::TimeOut, end == End::TimeOut));
        }
    }

    #[test]
    fn the_optimal_time_is_that_of_the_way_over_the_cells_from_start_to_goal() {
        // Cell (15, 0) is at (-2.325, 5.075), cell (15, 29) 29 * 0.15 m on.
        let straight = optimal_s(&[[15.0, 0.0], [15.0, 29.0]]);
        let ends_m = 0.075f64.hypot(2.075) + 0.075f64.hypot(13.0 - 5.075 - 29.0 * 0.15);
        assert!((straight - (29.0 * 0.15 + ends_m) / 2.0).abs() < 1e-12, "{straight}");
        assert!((optimal_s(&[]) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_world_is_known_by_its_number() {
        let number = |name| number_of(Path::new(name));
        assert_eq!([number("a/world_105.world.xz"), number("world_0.world")], [Some(105), Some(0)]);
        assert_eq!([number("world_x.world"), number("path_5.npy"), number("world_5.sdf")], [None; 3]);
    }
}
