//! Real floor plans as places for tasks: corridors are found by where there is room, openings by where a side way is
//! free.
//!
//! A travel line is traced along the middle of the free space, as a person would walk on; what stands and walks there
//! is added, as to generated worlds.

use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

use guidance::TravelLine;
use guidance::se2::{Point, Se2, wrap_angle};
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::generate::{GeneratorConfig, furnish_course, populate_course};
use crate::grid_map::{Cell, GridMap};
use crate::site::{Course, DropKind, Opening, Side, Site};
use crate::world::DEFAULT_CEILING_M;
use crate::{World, WorldError};

/// The middle of a way has so much room about it, metres: robot and handler side by side.
const ROOM_M: f64 = 0.75;
/// More room is as good: in a hall nobody keeps to the middle, metres.
const ENOUGH_M: f64 = 1.5;
/// What is wider than this is no corridor, metres, unless it is for no longer than a junction: nobody can say which way
/// is meant.
const CORRIDOR_M: f64 = 4.0;
const JUNCTION_M: f64 = 4.0;
/// A line is traced in steps of so much, metres, looking ahead so far.
const STEP_M: f64 = 0.4;
const LOOK_M: f64 = 1.2;
/// Each step turns by at most so much, radians, in so many parts; turning costs so much room, metres for each radian.
const BEND_RAD: f64 = 0.6;
const BENDS: i32 = 6;
const BEND_COST_M: f64 = 0.35;
/// A line is of use from this length on, and long enough at that, metres.
const LENGTH_M: [f64; 2] = [8.0, 34.0];
/// Who can go so far to a side, beyond the corridor, with so much room has found an opening, metres; its middle is
/// followed straight on, for so much at most. How deep it must be to be asked for is the task's business.
const SIDE_M: f64 = 1.5;
const BRANCH_M: f64 = 10.0;
const SIDE_ROOM_M: f64 = 0.55;
/// What is wider is no opening, but an open space, metres.
const OPENING_M: [f64; 2] = [1.3, 4.0];
/// A way off that nobody could name leads on for no more than this, metres: no task is set where it would be next.
const UNCLEAR_M: f64 = 0.3;
/// A line that turns by so much, radians, within so much of way, metres, where straight on is free for so far, metres,
/// leaves the way straight on.
const OFF_RAD: f64 = 0.6;
const OFF_M: f64 = 2.0;
const STRAIGHT_M: f64 = 3.0;
/// A line whose end leads on for so far does not end at a wall, metres.
const BEYOND_M: f64 = 1.4;
/// What is free straight on has so much room, metres.
const STRAIGHT_ROOM_M: f64 = 0.3;
/// Free ways are looked at in steps of so much, metres.
const FREE_STEP_M: f64 = 0.2;
/// Draws of a start until a line of use is found.
const TRIES: usize = 400;

/// A floor plan with the room that there is at each cell.
#[derive(Debug, Clone)]
pub struct FloorPlan {
    map: Arc<GridMap>,
    /// Distance from a cell's middle to the nearest that is not free, metres.
    room_m: Vec<f32>,
    /// Cells with room for a way.
    roomy: Vec<(usize, usize)>,
}

impl FloorPlan {
    /// Reads a ROS map.
    ///
    /// # Errors
    /// Where it cannot be read, or has no room for robot and handler anywhere.
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        let plan = Self::new(GridMap::load(path)?);
        match plan.site(&GeneratorConfig::default(), 0) {
            Some(_) => Ok(plan),
            None => Err(WorldError::NoWay { file: path.display().to_string(), length_m: LENGTH_M[0] }),
        }
    }

    /// The plan of a map.
    #[must_use]
    pub fn new(map: GridMap) -> Self {
        let room_m = distances_m(&map);
        let (width, height) = map.size();
        let cells = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let roomy = cells.filter(|(column, row)| f64::from(room_m[row * width + column]) >= ROOM_M).collect();
        Self { map: Arc::new(map), room_m, roomy }
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &GridMap {
        &self.map
    }

    fn room_m(&self, at: Point) -> f64 {
        let (column, row) = self.map.cell_of(at);
        let (width, height) = self.map.size();
        let inside = (0..width as i64).contains(&column) && (0..height as i64).contains(&row);
        if inside { f64::from(self.room_m[row as usize * width + column as usize]) } else { 0.0 }
    }

    /// A corridor of the plan, with what stands and walks there; `None` where none is long enough.
    #[must_use]
    pub fn site(&self, config: &GeneratorConfig, seed: u64) -> Option<Site> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let course = self.course(&mut random)?;
        let world = || World::new(DEFAULT_CEILING_M, Vec::new()).with_shared_map(self.map.clone());
        let bare = world();
        let free = |way_m: f64| {
            let at = course.line.at(way_m);
            let place = Point::from(at.translation.vector);
            let to = |side: f64| {
                let direction = at.rotation * Vector2::new(0.0, side);
                bare.cast(place, direction, 1.0, 4.0).unwrap_or(4.0)
            };
            [to(1.0), to(-1.0)]
        };
        let things = furnish_course(config, &course, free, &mut random);
        let furnished = world().with_prisms(things.iter().cloned());
        let people = populate_course(config, &course, &furnished, &mut random);
        Some(Site { world: furnished.with_people(people), course, drop: DropKind::None })
    }

    /// A corridor from somewhere; a way through the open where there is no corridor.
    fn course(&self, random: &mut ChaCha8Rng) -> Option<Course> {
        self.course_with(CORRIDOR_M, random).or_else(|| self.course_with(f64::INFINITY, random))
    }

    fn course_with(&self, widest_m: f64, random: &mut ChaCha8Rng) -> Option<Course> {
        if self.roomy.is_empty() {
            return None;
        }
        for _ in 0..TRIES {
            let (column, row) = self.roomy[random.random_range(0..self.roomy.len())];
            let heading_rad = random.random_range(-PI..PI);
            let start = self.map.middle(column, row);
            let line = self.trace(start, heading_rad, widest_m).and_then(|line| self.plain(&line));
            let Some(line) = line.filter(|line| line.length_m() >= LENGTH_M[0]) else { continue };
            let mut rooms: Vec<f64> =
                (0..line.length_m() as usize).map(|way_m| self.room_m(place(&line.at(way_m as f64)))).collect();
            rooms.sort_by(f64::total_cmp);
            let width_m = 2.0 * rooms[rooms.len() / 2].min(ENOUGH_M);
            let openings = self.openings(&line, width_m);
            return Some(Course::new(line, width_m, openings));
        }
        None
    }

    /// The line of who walks on from there, keeping to the middle, until there is no way on or it is wider than
    /// `widest_m` for longer than a junction.
    fn trace(&self, start: Point, heading_rad: f64, widest_m: f64) -> Option<TravelLine> {
        let (mut at, mut heading_rad, mut places) = (start, heading_rad, vec![start]);
        let (mut way_m, mut open_m) = (0.0, 0.0);
        while way_m < LENGTH_M[1] {
            let ahead = |bend_rad: f64| {
                let direction = Vector2::new((heading_rad + bend_rad).cos(), (heading_rad + bend_rad).sin());
                let rooms = [0.5, 1.0].map(|share| self.room_m(at + direction * LOOK_M * share));
                let near_m = self.room_m(at + direction * STEP_M);
                (near_m, rooms[0].min(rooms[1]).min(near_m).min(ENOUGH_M) - BEND_COST_M * bend_rad.abs())
            };
            let bends = (-BENDS..=BENDS).map(|i| BEND_RAD * f64::from(i) / f64::from(BENDS));
            let best = bends.map(|bend_rad| (bend_rad, ahead(bend_rad))).max_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
            let (bend_rad, (near_m, worth)) = best;
            if near_m < ROOM_M - 0.1 || worth < 0.3 || open_m > JUNCTION_M {
                break;
            }
            heading_rad = wrap_angle(heading_rad + bend_rad);
            open_m = if self.is_wider(at, heading_rad, widest_m) { open_m + STEP_M } else { 0.0 };
            at += Vector2::new(heading_rad.cos(), heading_rad.sin()) * STEP_M;
            // Round in a circle: the way on is the way back.
            if way_m > 6.0 && places[..places.len() - 10].iter().any(|before: &Point| (before - at).norm() < 1.0) {
                break;
            }
            places.push(at);
            way_m += STEP_M;
        }
        TravelLine::new(&places)
    }

    /// The line as far as anybody would say that it is the way on: to where it turns off although straight on is free.
    fn plain(&self, line: &TravelLine) -> Option<TravelLine> {
        let turns_off = |way_m: &f64| {
            let at = line.at(*way_m);
            let turned_rad = line.heading_error_rad(way_m + OFF_M, at.rotation.angle()).abs();
            turned_rad > OFF_RAD && self.goes_on(&at, STRAIGHT_M)
        };
        let looks = (line.length_m() / STEP_M) as usize;
        let end_m = (0..looks).map(|i| STEP_M * i as f64).find(turns_off);
        line.part(0.0, end_m.unwrap_or(line.length_m()))
    }

    /// Whether it is wider there than so much, across that heading.
    fn is_wider(&self, at: Point, heading_rad: f64, widest_m: f64) -> bool {
        let across = Vector2::new(-heading_rad.sin(), heading_rad.cos());
        let free_m = |sign: f64| {
            let far_m = (1..).map(|i| 0.1 * f64::from(i));
            far_m.take_while(|m| *m <= widest_m && self.room_m(at + across * (sign * m)) > 0.05).last().unwrap_or(0.0)
        };
        free_m(1.0) + free_m(-1.0) > widest_m
    }

    /// How far a disc can go straight from a place, metres, at most `most_m`.
    fn goes_m(&self, from: Point, direction: Vector2<f64>, most_m: f64, room_m: f64) -> f64 {
        let free = |way_m: &f64| *way_m <= most_m && self.room_m(from + direction * *way_m) >= room_m;
        (0..).map(|i| FREE_STEP_M * f64::from(i)).take_while(free).last().unwrap_or(0.0)
    }

    /// Whether it is free straight on for so far, metres.
    fn goes_on(&self, from: &Se2, way_m: f64) -> bool {
        self.goes_m(place(from), from.rotation * Vector2::x(), way_m + FREE_STEP_M, STRAIGHT_ROOM_M) >= way_m
    }

    /// Where one can leave a line to the side.
    fn openings(&self, line: &TravelLine, width_m: f64) -> Vec<Opening> {
        let mut openings = Vec::new();
        for side in [Side::Left, Side::Right] {
            let reach_m = |way_m: f64| {
                let at = line.at(way_m);
                let aside = at.rotation * Vector2::new(0.0, side.sign());
                self.goes_m(place(&at), aside, width_m / 2.0 + BRANCH_M, SIDE_ROOM_M)
            };
            let leaves = |way_m: f64| reach_m(way_m) >= width_m / 2.0 + SIDE_M;
            let mut begun: Option<f64> = None;
            let mut way_m = 0.0;
            while way_m <= line.length_m() {
                match (leaves(way_m), begun) {
                    (true, None) => begun = Some(way_m),
                    (false, Some(from_m)) => {
                        let length_m = reach_m(f64::midpoint(from_m, way_m));
                        openings.extend(opening(line, side, [from_m, way_m], length_m));
                        begun = None;
                    }
                    _ => {}
                }
                way_m += 0.1;
            }
            openings.extend(begun.and_then(|from_m| opening(line, side, [from_m, line.length_m()], UNCLEAR_M)));
        }
        // What lies beyond, a hall or a bend that was not followed, may lead to either side.
        let end = line.at(line.length_m());
        if self.goes_on(&end, BEYOND_M) {
            let beyond = |side| opening(line, side, [line.length_m(); 2], UNCLEAR_M);
            openings.extend([Side::Left, Side::Right].into_iter().filter_map(beyond));
        }
        openings.sort_by(|a, b| a.way_m.total_cmp(&b.way_m));
        openings
    }
}

/// The opening that can be entered between two ways; its own way is so long, or next to nothing where nobody could
/// say what is meant by it: an open space, a gap, a way off where the line begins. Where the line itself bends there is
/// none beside it: that is a corner.
fn opening(line: &TravelLine, side: Side, [from_m, to_m]: [f64; 2], length_m: f64) -> Option<Opening> {
    let width_m = to_m - from_m + 2.0 * SIDE_ROOM_M;
    let way_m = f64::midpoint(from_m, to_m);
    let at = line.at(way_m);
    // Where the line itself bends there, nobody can say what is on and what is aside.
    let bend_rad = line.heading_error_rad((way_m - 1.5).max(0.0), at.rotation.angle()).abs();
    (bend_rad < 0.35).then_some(())?;
    let is_clear = from_m > 0.0 && (OPENING_M[0]..OPENING_M[1]).contains(&width_m);
    let length_m = if is_clear { length_m } else { UNCLEAR_M };
    let end = at * Point::new(0.0, side.sign() * length_m);
    Some(Opening { way_m, width_m, side, line: TravelLine::new(&[place(&at), end])?, edge_m: None })
}

fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}

/// The distance of each cell's middle from the nearest cell that is not free, metres: exact, by rows and then by
/// columns (Felzenszwalb and Huttenlocher 2012).
fn distances_m(map: &GridMap) -> Vec<f32> {
    let (width, height) = map.size();
    let far = (width + height) as f32;
    let blocked = |column: usize, row: usize| map.cell(column as i64, row as i64) != Cell::Free;
    let mut squares: Vec<f32> =
        (0..width * height).map(|i| if blocked(i % width, i / width) { 0.0 } else { far * far }).collect();
    let mut line = Vec::new();
    for row in 0..height {
        line.clear();
        line.extend_from_slice(&squares[row * width..(row + 1) * width]);
        squares[row * width..(row + 1) * width].copy_from_slice(&lower_envelope(&line));
    }
    for column in 0..width {
        line.clear();
        line.extend((0..height).map(|row| squares[row * width + column]));
        for (row, square) in lower_envelope(&line).into_iter().enumerate() {
            squares[row * width + column] = square;
        }
    }
    // From the middle of a cell to the nearer edge of the other.
    squares.iter().map(|square| ((square.sqrt() - 0.5).max(0.0) as f64 * map.resolution_m()) as f32).collect()
}

/// For each place the least of `costs[i] + (place - i)^2`.
fn lower_envelope(costs: &[f32]) -> Vec<f32> {
    let (mut roots, mut bounds) = (vec![0usize; costs.len()], vec![0.0f32; costs.len() + 1]);
    let mut last = 0;
    (bounds[0], bounds[1]) = (f32::NEG_INFINITY, f32::INFINITY);
    let value = |i: usize| costs[i] + (i * i) as f32;
    for i in 1..costs.len() {
        let meets = |root: usize| (value(i) - value(root)) / (2 * (i - root)) as f32;
        let mut at = meets(roots[last]);
        while at <= bounds[last] {
            last -= 1;
            at = meets(roots[last]);
        }
        last += 1;
        roots[last] = i;
        (bounds[last], bounds[last + 1]) = (at, f32::INFINITY);
    }
    let mut root = 0;
    (0..costs.len())
        .map(|place| {
            while bounds[root + 1] < place as f32 {
                root += 1;
            }
            let away = place as f32 - roots[root] as f32;
            away * away + costs[roots[root]]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{CORRIDOR_M, FloorPlan, distances_m};
    use crate::generate::GeneratorConfig;
    use crate::grid_map::{Cell, GridMap};
    use crate::site::Side;
    use guidance::se2::Point;
    use messages::Pose2;

    /// A corridor 20 m long and 2 m wide, with a way of 1.6 m to the left (of who walks on along x) at 12 m.
    fn tee() -> GridMap {
        let (width, height, resolution_m) = (440, 200, 0.05);
        let free = |x: f64, y: f64| {
            (1.0..21.0).contains(&x) && (1.0..3.0).contains(&y) || (11.2..12.8).contains(&x) && (1.0..9.0).contains(&y)
        };
        let at = |i: usize| ((i as f64 + 0.5) * resolution_m, ());
        let cells = (0..width * height).map(|i| {
            let (x, y) = (at(i % width).0, at(i / width).0);
            if free(x, y) { Cell::Free } else { Cell::Occupied }
        });
        GridMap::new(width, resolution_m, Pose2::default(), cells.collect())
    }

    #[test]
    fn distances_are_those_of_the_nearest_blocked_cell() {
        let map = tee();
        let found = distances_m(&map);
        for (column, row) in [(100, 40), (30, 22), (240, 100), (239, 61)] {
            let expected = map.clearance(map.middle(column, row), 5.0);
            let distance_m = f64::from(found[row * 440 + column]);
            assert!((distance_m - expected).abs() < 0.03, "{distance_m} {expected}");
        }
    }

    #[test]
    fn the_corridor_and_its_opening_are_found() {
        let plan = FloorPlan::new(tee());
        let line = plan.trace(Point::new(3.0, 2.0), 0.0, CORRIDOR_M).expect("a line");
        assert!(line.length_m() > 15.0 && line.corners().iter().all(|p| (p.y - 2.0).abs() < 0.2), "{line:?}");
        let openings = plan.openings(&line, 2.0);
        assert_eq!(openings.len(), 1, "{openings:?}");
        let opening = &openings[0];
        assert!(opening.side == Side::Left && (opening.way_m - 9.0).abs() < 0.2 && (opening.width_m - 1.6).abs() < 0.3);
        // As far as there is room: 0.55 m before the wall at its end.
        assert!((opening.line.length_m() - 6.4).abs() < 0.3, "{}", opening.line.length_m());
    }

    #[test]
    fn a_corridor_ends_where_a_hall_begins() {
        let (width, resolution_m) = (600, 0.05);
        let cells = (0..width * 200).map(|i| {
            let (x, y) = ((i % width) as f64 * resolution_m, (i / width) as f64 * resolution_m);
            let corridor = (1.0..14.0).contains(&x) && (4.0..6.0).contains(&y);
            let hall = (14.0..29.0).contains(&x) && (0.5..9.5).contains(&y);
            if corridor || hall { Cell::Free } else { Cell::Occupied }
        });
        let plan = FloorPlan::new(GridMap::new(width, resolution_m, Pose2::default(), cells.collect()));
        for seed in 0..8 {
            let course = plan.site(&GeneratorConfig::default(), seed).expect("a site").course;
            assert!(course.line.corners().iter().all(|corner| corner.x < 18.8), "{:?}", course.line);
        }
    }

    #[test]
    fn sites_are_the_same_for_the_same_seed() {
        let plan = FloorPlan::new(tee());
        let site = |seed| plan.site(&GeneratorConfig::default(), seed).expect("a site");
        assert_eq!(site(3).course, site(3).course);
        assert_ne!(site(3).course, site(4).course);
    }
}
