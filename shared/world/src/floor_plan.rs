//! Real floor plans as places for tasks: corridors are found by where there is room, openings by where a way leads off.
//!
//! The middle of the free space is a network of ways (`ways`). A course is walked along it as a person would walk on
//! (`walk`). Where robot and handler can leave it is found a second time without that network (`aside`): where the two
//! disagree it is not clear what is meant, and no task is set. What stands and walks there is added, as to generated
//! worlds.

mod aside;
mod flood;
mod islands;
mod room;
mod thinning;
mod walk;
mod ways;

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;
use std::sync::Arc;

use guidance::TravelLine;
use guidance::se2::{Point, Se2};
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::generate::{GeneratorConfig, Kinds, furnish_course, populate_course, room_beside_m};
use crate::grid_map::GridMap;
use crate::site::{Course, DropKind, Mapped, Opening, Side, Site};
use crate::world::DEFAULT_CEILING_M;
use crate::{World, WorldError};
use aside::{Gap, Mouth};
use room::Room;
use walk::{Branch, End, Walk};
use ways::{Along, PAIR_M, Ways};

/// Of the floor within this of a person, metres, one sees a share: a corridor 2 m wide shows 0.36 of it, one of 3.4 m
/// 0.59, a hall nearly all. Where it is more than `OPEN` for longer than a junction, metres, it is not clear which way
/// is meant.
const SEEN_M: f64 = 3.5;
const SEEN_RAYS: usize = 48;
const OPEN: f64 = 0.55;
/// Where more of the rays leave the map, it is not known what is beside.
const OFF_MAP: f64 = 0.05;
const JUNCTION_M: f64 = 4.0;
/// Distance between the places of a course that are looked at, metres.
const STEP_M: f64 = 0.4;
/// A line is of use from this length on, and long enough at that, metres.
const LENGTH_M: [f64; 2] = [8.0, 34.0];
/// Length for which an opening's own way is followed, metres.
const BRANCH_M: f64 = 10.0;
/// Distance from a course's middle at which the way off begins, metres: nearer, it still turns.
const OFF_M: f64 = 0.8;
/// A narrower way is not clear: whether two go through side by side depends on centimetres that a map does not tell,
/// metres.
const CLEAR_M: f64 = 1.1;
/// A way to the side leads aside by half of this at the least, this far in, metres.
const DEEP_M: f64 = 2.0;
/// A gap in a wall is that of an opening so near to it, metres.
const SAME_M: f64 = 1.2;
/// What is free straight on is looked at in steps of so much, metres.
const FREE_STEP_M: f64 = 0.1;
/// A pose within this distance of the middle of a way is on it, metres; its direction is taken as far ahead as the
/// second length.
const NEAR_M: f64 = 1.5;
const AHEAD_M: f64 = 1.0;
/// Length of the way behind a pose that belongs to its course, metres.
const BEHIND_M: f64 = 6.0;
/// What stands in a corridor has room beside it up to so far from the corridor's middle, metres.
const ASIDE_M: f64 = 4.0;
/// Draws of a start until a course of use is found.
const TRIES: usize = 400;
/// Courses that are drawn, of which the longest is taken: it has more to ask for.
const DRAWN: usize = 3;

/// A floor plan with its ways.
#[derive(Debug, Clone)]
pub struct FloorPlan {
    /// Its file.
    place: Arc<str>,
    map: Arc<GridMap>,
    /// The map without what stands free in its rooms.
    walls: Arc<GridMap>,
    room: Arc<Room>,
    ways: Arc<Ways>,
    /// Cells of the ways, by stretch and place in it.
    starts: Arc<Vec<(usize, usize)>>,
}

impl FloorPlan {
    /// Reads a ROS map.
    ///
    /// # Errors
    /// Where it cannot be read, or has no room for robot and handler anywhere.
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        let file = path.display().to_string();
        let plan = Self { place: file.clone().into(), ..Self::new(GridMap::load(path)?) };
        match plan.site(&GeneratorConfig::default(), 0) {
            Some(_) => Ok(plan),
            None => Err(WorldError::NoWay { file, length_m: LENGTH_M[0] }),
        }
    }

    /// The plan of a map.
    #[must_use]
    pub fn new(map: GridMap) -> Self {
        let room = Room::new(&map);
        let ways = Ways::new(&map, &room);
        let stretches = ways.stretches.iter().enumerate().filter_map(|(i, stretch)| Some((i, stretch.as_ref()?)));
        let starts = stretches.flat_map(|(i, stretch)| (0..stretch.cells.len()).map(move |at| (i, at))).collect();
        let (place, room, ways) = ("a map".into(), Arc::new(room), Arc::new(ways));
        let walls = Arc::new(islands::without_furniture(&map));
        Self { place, map: Arc::new(map), walls, room, ways, starts: Arc::new(starts) }
    }

    /// The corridor of who stands there and walks on, where there is one.
    #[must_use]
    pub fn course_at(&self, world_from_robot: &Se2) -> Option<Course> {
        let (at, heading_rad) = (place(world_from_robot), world_from_robot.rotation.angle());
        let to_m = |cell: usize| (self.map.middle_of(cell) - at).norm();
        let cell_of = |(stretch, i): (usize, usize)| self.ways.stretch(stretch).cells[i];
        let near = self.starts.iter().copied().min_by(|a, b| to_m(cell_of(*a)).total_cmp(&to_m(cell_of(*b))))?;
        if to_m(cell_of(near)) > NEAR_M {
            return None;
        }
        let (stretch, i) = near;
        let last = self.ways.stretch(stretch).cells.len() - 1;
        let courses = [(true, i), (false, last - i)].into_iter().filter_map(|(is_forth, from)| {
            let course = self.course_through(Along { stretch, is_forth }, from)?;
            let way_m = course.line.foot(at).way_m;
            let off_rad = course.line.heading_error_rad(way_m + AHEAD_M, heading_rad).abs();
            Some((course, off_rad))
        });
        courses.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, off_rad)| *off_rad < FRAC_PI_2).map(|(course, _)| course)
    }

    /// The map.
    #[must_use]
    pub fn map(&self) -> &GridMap {
        &self.map
    }

    /// A corridor of the plan, with what stands and walks there; `None` where none is long enough.
    #[must_use]
    pub fn site(&self, config: &GeneratorConfig, seed: u64) -> Option<Site> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let course = self.course(&mut random)?;
        let world = || World::new(DEFAULT_CEILING_M, Vec::new()).with_shared_map(self.map.clone());
        let bare = world();
        let free = |way_m: f64| room_beside_m(&bare, &course, way_m, ASIDE_M);
        let things = furnish_course(config, &course, free, Kinds::Usual, &mut random);
        let furnished = world().with_prisms(things.iter().cloned());
        let people = populate_course(config, &course, &furnished, &mut random);
        Some(Site { place: self.place.clone(), world: furnished.with_people(people), course, drop: DropKind::None })
    }

    /// A corridor from somewhere on.
    fn course(&self, random: &mut ChaCha8Rng) -> Option<Course> {
        if self.starts.is_empty() {
            return None;
        }
        let draw = |_| {
            let (stretch, at) = self.starts[random.random_range(0..self.starts.len())];
            let is_forth = random.random_bool(0.5);
            let last = self.ways.stretch(stretch).cells.len() - 1;
            self.course_from(Along { stretch, is_forth }, if is_forth { at } else { last - at })
        };
        let drawn = (0..TRIES).filter_map(draw).take(DRAWN);
        drawn.max_by(|a, b| a.line.length_m().total_cmp(&b.line.length_m()))
    }

    /// The corridor of who walks on from there.
    fn course_from(&self, along: Along, from: usize) -> Option<Course> {
        self.course_of(&self.walk(along, from, LENGTH_M[1]))
    }

    /// The same, with some of the way that they came.
    fn course_through(&self, along: Along, from: usize) -> Option<Course> {
        let mut walk = self.walk(along, from, LENGTH_M[1]);
        let back = Along { is_forth: !along.is_forth, ..along };
        let mut came = self.walk(back, self.ways.stretch(along.stretch).cells.len() - 1 - from, BEHIND_M).cells;
        self.cut(&mut came, BEHIND_M);
        came.reverse();
        came.pop();
        walk.cells.splice(0..0, came);
        self.course_of(&walk)
    }

    fn course_of(&self, walk: &Walk) -> Option<Course> {
        let whole = self.line(walk)?;
        let reach_m = whole.length_m().min(LENGTH_M[1]);
        let line = whole.part(0.0, self.narrow_m(&whole, reach_m)).filter(|line| line.length_m() >= LENGTH_M[0])?;
        let mut rooms: Vec<f64> =
            (0..line.length_m() as usize).map(|way_m| self.room_m(place(&line.at(way_m as f64)))).collect();
        rooms.sort_by(f64::total_cmp);
        let width_m = 2.0 * rooms[rooms.len() / 2];
        let ends_there =
            line.length_m() > whole.length_m() - 0.1 && walk.end == End::Wall && !self.leads_on(&line, width_m);
        let openings = self.openings(&line, width_m, walk, ends_there);
        let mapped = Some(Mapped { has_end: ends_there, hall_m: None });
        let mut course = Course { mapped, ..Course::new(line, width_m, openings) };
        let corners: Vec<usize> =
            (0..course.openings.len()).filter(|i| course.is_corner(&course.openings[*i])).collect();
        for i in corners {
            let behind = self.behind_corner(&course.line, width_m, course.openings[i].way_m);
            course.openings[i].behind = behind.map(Arc::new);
        }
        Some(course)
    }

    /// How far a line is a corridor, metres: to where it is wider than one for longer than a junction.
    fn narrow_m(&self, line: &TravelLine, reach_m: f64) -> f64 {
        let looks = (reach_m / STEP_M) as usize;
        let is_wide: Vec<bool> = (0..=looks).map(|i| self.is_open(place(&line.at(STEP_M * i as f64)))).collect();
        let runs = is_wide.chunk_by(|a, b| a == b);
        let mut from = 0;
        for run in runs {
            let is_open = run[0] && STEP_M * run.len() as f64 > JUNCTION_M;
            if is_open {
                return STEP_M * from as f64;
            }
            from += run.len();
        }
        reach_m
    }

    /// Whether so much of the floor around could be seen, without furniture, that it is a hall or a room; or the map
    /// ends there.
    fn is_open(&self, at: Point) -> bool {
        let (mut seen, mut off_map) = (0.0, 0.0);
        for ray in 0..SEEN_RAYS {
            let angle_rad = TAU * ray as f64 / SEEN_RAYS as f64;
            let direction = Vector2::new(angle_rad.cos(), angle_rad.sin());
            let end_m = self.walls.cast(at, direction, SEEN_M);
            seen += (end_m.unwrap_or(SEEN_M) / SEEN_M).powi(2);
            let beyond = end_m.map(|end_m| at + direction * (end_m + self.map.resolution_m() / 2.0));
            off_map += if beyond.is_some_and(|beyond| self.map.number_at(beyond).is_none()) { 1.0 } else { 0.0 };
        }
        seen > OPEN * SEEN_RAYS as f64 || off_map > OFF_MAP * SEEN_RAYS as f64
    }

    fn room_m(&self, at: Point) -> f64 {
        self.room.at(&self.map, at)
    }

    /// How far a disc can go straight from a place, metres, at most `most_m`.
    fn goes_m(&self, from: Point, direction: Vector2<f64>, most_m: f64, room_m: f64) -> f64 {
        let free = |way_m: &f64| *way_m <= most_m && self.room_m(from + direction * *way_m) >= room_m;
        (0..).map(|i| FREE_STEP_M * f64::from(i)).take_while(free).last().unwrap_or(0.0)
    }

    /// What leads off a course: the branches of its walk, and every other place where it can be left, which is not
    /// clear.
    fn openings(&self, line: &TravelLine, width_m: f64, walk: &Walk, ends_there: bool) -> Vec<Opening> {
        let mut openings: Vec<Opening> =
            walk.branches.iter().filter_map(|branch| self.opening(line, width_m, branch)).collect();
        for gap in self.gaps(line, width_m) {
            let is_its_own = |opening: &Opening| {
                let reach_m = opening.width_m / 2.0 + SAME_M;
                opening.side == gap.side && gap.from_m > opening.way_m - reach_m && gap.to_m < opening.way_m + reach_m
            };
            if !openings.iter().any(is_its_own) {
                openings.extend(unclear(line, gap));
            }
        }
        if !ends_there {
            let [from_m, to_m] = [line.length_m(); 2];
            openings.extend(
                [Side::Left, Side::Right].into_iter().filter_map(|side| unclear(line, Gap { side, from_m, to_m })),
            );
        }
        openings.sort_by(|a, b| a.way_m.total_cmp(&b.way_m));
        openings
    }

    /// The opening into a branch of the walk.
    fn opening(&self, line: &TravelLine, width_m: f64, branch: &Branch) -> Option<Opening> {
        let side = if branch.turn_rad > 0.0 { Side::Left } else { Side::Right };
        let meets = self.map.middle_of(branch.cell);
        let foot = line.foot(meets);
        // It leads off beyond the part of the walk that is a corridor.
        if foot.left_m.abs() > width_m / 2.0 + SAME_M {
            return None;
        }
        let walk = self.walk(branch.along, 0, BRANCH_M);
        let off = self.line(&walk)?;
        let off = off.part(0.0, BRANCH_M)?;
        let mouth_m = 2.0 * self.narrowest_m(&walk.cells, [OFF_M.min(width_m / 2.0), width_m / 2.0 + DEEP_M]);
        let at = line.at(foot.way_m);
        let off = off.part(OFF_M.min(off.length_m() / 2.0), off.length_m())?;
        let places: Vec<Point> = std::iter::once(place(&at)).chain(off.corners().iter().copied()).collect();
        let way = TravelLine::new(&places)?;
        let is_clear = branch.is_aside() && mouth_m >= CLEAR_M && leads_aside(&at, side, width_m, &way);
        let behind = is_clear.then(|| self.behind(line, width_m, &Mouth { way_m: foot.way_m, width_m: mouth_m }, &way));
        let Some(behind) = behind.flatten().map(Arc::new) else {
            return unclear(line, Gap { side, from_m: foot.way_m, to_m: foot.way_m });
        };
        let behind = Some(behind);
        Some(Opening { way_m: foot.way_m, width_m: mouth_m, side, line: way, edge_m: None, behind })
    }
}

/// Whether the way off a course leads beyond its wall, and not along it.
fn leads_aside(at: &Se2, side: Side, width_m: f64, way: &TravelLine) -> bool {
    let there = at.inverse() * place(&way.at(width_m / 2.0 + DEEP_M));
    let aside_m = there.y * side.sign();
    aside_m > width_m / 2.0 + DEEP_M / 2.0 && there.x.abs() < aside_m
}

/// A place where a course can be left, and of which it is not clear whether it is meant.
fn unclear(line: &TravelLine, gap: Gap) -> Option<Opening> {
    Opening::unclear(line, f64::midpoint(gap.from_m, gap.to_m), gap.to_m - gap.from_m + 2.0 * PAIR_M, gap.side)
}

fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::FloorPlan;
    use super::ways::Along;
    use crate::World;
    use crate::generate::{GeneratorConfig, room_beside_m};
    use crate::grid_map::{Cell, GridMap};
    use crate::site::{Course, Side};
    use crate::world::DEFAULT_CEILING_M;
    use guidance::se2::Point;
    use messages::Pose2;

    /// A corridor 20 m long and 2 m wide, with a way of 1.6 m to the left (of who walks on along x) at 12 m.
    pub(crate) fn tee() -> GridMap {
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

    /// The longest course along the corridor of `tee`, in the direction of x.
    fn along_x(plan: &FloorPlan) -> Course {
        let numbers = (0..plan.ways.stretches.len()).filter(|i| plan.ways.stretches[*i].is_some());
        let alongs = numbers.flat_map(|stretch| [true, false].map(|is_forth| Along { stretch, is_forth }));
        let courses = alongs.filter_map(|along| plan.course_from(along, 0));
        let is_along_x = |course: &Course| {
            let corners = course.line.corners();
            corners[0].x < 2.5 && corners.iter().all(|corner| corner.x > 10.0 || corner.y < 3.0)
        };
        courses.filter(is_along_x).max_by(|a, b| a.line.length_m().total_cmp(&b.line.length_m())).expect("a course")
    }

    #[test]
    fn the_corridor_and_its_opening_are_found() {
        let course = along_x(&FloorPlan::new(tee()));
        let line = &course.line;
        assert!(line.length_m() > 17.0 && line.corners().iter().all(|p| (p.y - 2.0).abs() < 0.35), "{line:?}");
        assert_eq!(course.openings.len(), 1, "{:?}", course.openings);
        let opening = &course.openings[0];
        let at_x = line.at(opening.way_m).translation.x;
        assert!(opening.side == Side::Left && (at_x - 12.0).abs() < 0.3, "{at_x}");
        assert!((opening.width_m - 1.6).abs() < 0.3, "{}", opening.width_m);
        // To just before the wall at its end.
        assert!((opening.line.length_m() - 6.7).abs() < 0.4, "{}", opening.line.length_m());
        let behind = opening.behind.as_ref().expect("it is a way");
        let depth_m = |x: f64, y: f64| behind.depth_m(Point::new(x, y));
        assert!(depth_m(12.0, 2.0).is_none() && depth_m(15.0, 2.0).is_none());
        assert!((depth_m(12.3, 6.0).expect("inside") - 3.0).abs() < 0.4, "{:?}", depth_m(12.3, 6.0));
    }

    #[test]
    fn a_place_that_can_be_left_without_a_way_is_unclear() {
        let plan = FloorPlan::new(tee());
        let course = along_x(&plan);
        let gaps = plan.gaps(&course.line, course.width_m);
        assert_eq!(gaps.len(), 1, "{gaps:?}");
        let at_x = course.line.at(f64::midpoint(gaps[0].from_m, gaps[0].to_m)).translation.x;
        assert!(gaps[0].side == Side::Left && (at_x - 12.0).abs() < 0.4, "{gaps:?}");
    }

    /// A plan of 30 m by 10 m, of which these places are free (x and y, from and to, metres).
    fn plan_of(free: &[[f64; 4]]) -> FloorPlan {
        let (width, resolution_m) = (600, 0.05);
        let cells = (0..width * 200).map(|i| {
            let (x, y) = ((i % width) as f64 * resolution_m, (i / width) as f64 * resolution_m);
            let is_in = |[x0, x1, y0, y1]: &[f64; 4]| (*x0..*x1).contains(&x) && (*y0..*y1).contains(&y);
            if free.iter().any(is_in) { Cell::Free } else { Cell::Occupied }
        });
        FloorPlan::new(GridMap::new(width, resolution_m, Pose2::default(), cells.collect()))
    }

    #[test]
    fn behind_a_corner_all_is_inside_wherever_it_leads() {
        // The corridor turns to the left; behind the corner a door leads into a room on its right.
        let corridor = [1.0, 13.0, 1.0, 3.0];
        let plan = plan_of(&[corridor, [11.0, 13.0, 1.0, 9.0], [13.0, 14.0, 5.0, 7.0], [14.0, 20.0, 3.0, 9.0]]);
        let course = along_x(&plan);
        let corner = course.openings.iter().find(|opening| course.is_corner(opening)).expect("a corner");
        assert!(corner.side == Side::Left);
        let behind = corner.behind.as_ref().expect("what is behind it");
        let depth_m = |x: f64, y: f64| behind.depth_m(Point::new(x, y));
        assert!(depth_m(9.0, 2.0).is_none() && depth_m(12.0, 2.0).is_none(), "in the corridor before it");
        assert!((depth_m(12.0, 5.0).expect("inside") - 2.0).abs() < 0.4, "{:?}", depth_m(12.0, 5.0));
        assert!(depth_m(14.2, 6.0).is_some_and(|depth_m| depth_m > 3.0), "{:?}", depth_m(14.2, 6.0));
    }

    #[test]
    fn beside_a_doorway_there_is_as_much_room_as_at_its_jambs() {
        let plan = plan_of(&[[1.0, 25.0, 1.0, 3.0], [12.0, 12.8, 3.0, 8.0]]);
        let course = along_x(&plan);
        let world = World::new(DEFAULT_CEILING_M, Vec::new()).with_shared_map(plan.map.clone());
        let way_m = course.line.foot(Point::new(12.4, 2.0)).way_m;
        let [left_m, right_m] = room_beside_m(&world, &course, way_m, 4.0);
        assert!((left_m - 1.0).abs() < 0.15 && (right_m - 1.0).abs() < 0.15, "{left_m} {right_m}");
    }

    #[test]
    fn a_corridor_ends_where_a_hall_begins() {
        let plan = plan_of(&[[1.0, 14.0, 4.0, 6.0], [14.0, 29.0, 0.5, 9.5]]);
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
