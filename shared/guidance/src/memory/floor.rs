//! Floor that was seen, in the odometry frame. What was never seen is not floor, but for what is assumed of it.

use super::Odometer;
use crate::depth::DepthView;
use crate::hull::Disc;
use crate::se2::{Point, Se2};

/// Side of a cell, metres.
pub const CELL_M: f64 = 0.1;
/// Cells along one side of what is remembered. They repeat beyond.
const SIDE: i32 = 96;
/// No cell is farther from the origin.
const PLACE_MAX: f64 = 1e8;
/// Floor is looked for so far from the camera, metres: farther off, rows of pixels are too far apart.
const REACH_M: f64 = 3.0;
/// Floor is let go when the robot has walked so far since it was last seen, metres,
const KEPT_M: f64 = 3.0;
/// or so long after it was last seen, nanoseconds, where the robot has walked as far as this since, metres, and it is
/// farther from the robot than this, metres: who goes slowly, and stands now and then, loses no floor under the pair.
const KEPT_NS: u64 = 10_000_000_000;
const WALKED_MIN_M: f64 = 1.0;
const PAIR_M: f64 = 1.5;
/// The strip between the pair and the first floor that is seen is assumed for so much way from the start, metres. Then
/// it is let go where the pair is no longer near.
const FIRST_M: f64 = 1.0;
/// A robot that turned by less still stands at its start, radians.
const BEGUN_RAD: f64 = 0.1;
/// Rounding error of the middle of a cell, at most, metres.
const ROUNDING_M: f64 = 1e-6;
/// Floor is kept so far about the robot where its place is lost, metres.
pub(super) const ANCHORED_M: f64 = 1.5;

/// What is known of the floor at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Floor {
    /// It was seen, or robot or handler stood on it when the way began.
    Seen,
    /// Robot or handler stood on it. It was never seen.
    Trodden,
    /// It lies between the pair at its start and the first floor that was seen.
    Assumed,
    /// It was never seen, or too long ago.
    Unseen,
    /// The camera saw an edge before it.
    Beyond,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    key: (i32, i32),
    floor: Floor,
    seen_ns: u64,
    seen_at: Odometer,
}

impl Cell {
    const UNSEEN: Self = Self { key: (i32::MAX, i32::MAX), floor: Floor::Unseen, seen_ns: 0, seen_at: Odometer::ZERO };

    fn is_over(&self, here: &Here<'_>) -> bool {
        let walked_m = here.at.walked_m - self.seen_at.walked_m;
        let is_late = here.now_ns.saturating_sub(self.seen_ns) > KEPT_NS;
        let is_old = || is_late && walked_m > WALKED_MIN_M && !here.is_near(self.key);
        // What lies beyond an edge stays there until floor is seen.
        self.floor != Floor::Beyond && (walked_m > KEPT_M || is_old())
    }
}

/// Where the robot is, and how far it has come.
#[derive(Debug, Clone, Copy)]
pub(super) struct Here<'a> {
    pub now_ns: u64,
    pub at: Odometer,
    pub odom_from_robot: &'a Se2,
}

impl Here<'_> {
    /// Whether a cell is as near as robot and handler are to each other, and their next step.
    fn is_near(&self, key: (i32, i32)) -> bool {
        let here = Point::from(self.odom_from_robot.translation.vector);
        (middle_of(key) - here).norm_squared() <= PAIR_M * PAIR_M
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct FloorMap {
    cells: Vec<Cell>,
    /// Room for another map, while a place is lost.
    spare: Vec<Cell>,
    /// The frame that was looked at last.
    frame: u64,
    /// Some floor is known to lie beyond an edge.
    has_beyond: bool,
    /// Some floor is assumed.
    has_assumed: bool,
    /// How far the robot had come when it was first placed in this odometry frame.
    began: Odometer,
}

impl FloorMap {
    pub fn new() -> Self {
        let cells = vec![Cell::UNSEEN; (SIDE * SIDE) as usize];
        Self { spare: cells.clone(), cells, frame: 0, has_beyond: false, has_assumed: false, began: Odometer::ZERO }
    }

    /// Takes in where robot and handler are (discs in the robot frame), the first of which surely stand there, and what
    /// a frame of the camera shows.
    pub fn update(&mut self, here: &Here<'_>, bodies: &[Disc], standing: usize, view: Option<&DepthView>) {
        for body in bodies.iter().take(standing) {
            let first = self.walked_m(here) < CELL_M && here.at.turned_rad - self.began.turned_rad < BEGUN_RAD;
            self.each(here, body.center, body.radius_m, |_, old| match old {
                Floor::Beyond => None,
                Floor::Seen => Some(Floor::Seen),
                _ if first => Some(Floor::Seen),
                _ => Some(Floor::Trodden),
            });
        }
        self.let_go_of_assumed(here);
        let Some(view) = view.filter(|view| view.number() != self.frame) else { return };
        self.frame = view.number();
        if self.is_first_way(here)
            && let Some(strip) = Strip::before(bodies, view)
        {
            self.has_assumed = true;
            let assumed = |place: Point, old: Floor| old == Floor::Unseen && strip.contains(place);
            self.each(here, strip.middle(), strip.reach_m(), |place, old| {
                assumed(place, old).then_some(Floor::Assumed)
            });
        }
        self.look(here, view);
    }

    /// The handler comes behind: what was assumed under the pair is not lost before they have passed. A pair that comes
    /// back does not find it again.
    fn let_go_of_assumed(&mut self, here: &Here<'_>) {
        if !self.has_assumed || self.is_first_way(here) {
            return;
        }
        self.has_assumed = false;
        for cell in self.cells.iter_mut().filter(|cell| cell.floor == Floor::Assumed) {
            if here.is_near(cell.key) {
                self.has_assumed = true;
            } else {
                *cell = Cell::UNSEEN;
            }
        }
    }

    /// Takes in what a frame shows of each cell in view.
    fn look(&mut self, here: &Here<'_>, view: &DepthView) {
        let (middle, robot_from_odom) = (here.odom_from_robot * view.camera(), here.odom_from_robot.inverse());
        let ahead = here.odom_from_robot * view.ahead();
        for (key, at) in cells_about(middle, REACH_M) {
            // Most of them are out of view, and half of them behind the camera, which shows sooner.
            if (at - middle).dot(&ahead) < -ROUNDING_M {
                continue;
            }
            let Some(beside) = view.beside(robot_from_odom * at) else { continue };
            let floor = if beside.shows_floor() {
                Floor::Seen
            } else if beside.is_beyond_edge() && self.known(key, here).is_none_or(|cell| cell.floor != Floor::Seen) {
                self.has_beyond = true;
                Floor::Beyond
            } else {
                continue;
            };
            self.cells[slot_of(key)] = Cell { key, floor, seen_ns: here.now_ns, seen_at: here.at };
        }
    }

    /// Whether floor within a radius of a place (odometry frame) was seen, or goes on from there, level.
    pub fn is_near(&self, at: Point, radius_m: f64, here: &Here<'_>, drift: f64) -> bool {
        let counts = |key| matches!(self.floor(key, here, drift), Floor::Seen | Floor::Assumed);
        cells_about(at, radius_m).any(|(key, _)| counts(key))
    }

    /// Calls `f` with each place about another one (robot frame) and what is known of it. What `f` tells is of now.
    fn each(&mut self, here: &Here<'_>, about: Point, radius_m: f64, mut f: impl FnMut(Point, Floor) -> Option<Floor>) {
        let (middle, robot_from_odom) = (here.odom_from_robot * about, here.odom_from_robot.inverse());
        for (key, at) in cells_about(middle, radius_m) {
            let old = self.known(key, here).map_or(Floor::Unseen, |cell| cell.floor);
            if let Some(floor) = f(robot_from_odom * at, old) {
                self.cells[slot_of(key)] = Cell { key, floor, seen_ns: here.now_ns, seen_at: here.at };
            }
        }
    }

    fn known(&self, key: (i32, i32), here: &Here<'_>) -> Option<&Cell> {
        let cell = &self.cells[slot_of(key)];
        (cell.key == key && !cell.is_over(here)).then_some(cell)
    }

    /// The way since the robot was placed in this odometry frame, metres.
    fn walked_m(&self, here: &Here<'_>) -> f64 {
        here.at.walked_m - self.began.walked_m
    }

    fn is_first_way(&self, here: &Here<'_>) -> bool {
        self.walked_m(here) < FIRST_M
    }

    /// What is known of the floor of a cell. Odometry's drift since it was seen takes its rim away.
    pub fn floor(&self, key: (i32, i32), here: &Here<'_>, drift: f64) -> Floor {
        let unseen = || if self.is_beside_edge(key, here) { Floor::Beyond } else { Floor::Unseen };
        let Some(cell) = self.known(key, here) else { return unseen() };
        match cell.floor {
            Floor::Seen | Floor::Trodden => {
                let middle = middle_of(key);
                let distance_m = (middle - Point::from(here.odom_from_robot.translation.vector)).norm();
                let off_m = here.at.error_m(&cell.seen_at, drift, distance_m);
                let is_trodden = |other| {
                    let other = self.known(other, here);
                    other.is_some_and(|other| matches!(other.floor, Floor::Seen | Floor::Trodden))
                };
                // The four cells beside it at least, whatever rounding says of their middles.
                let rim_m = off_m.max(CELL_M) + ROUNDING_M;
                let (i, j) = key;
                let mut beside = [(i, j - 1), (i - 1, j), (i + 1, j), (i, j + 1)].into_iter();
                let inner = off_m <= CELL_M / 2.0
                    || beside.all(is_trodden)
                        && (off_m <= CELL_M || cells_about(middle, rim_m).all(|(key, _)| is_trodden(key)));
                if inner { cell.floor } else { unseen() }
            }
            other => other,
        }
    }

    /// Whether some floor may lie beyond an edge.
    pub fn has_beyond(&self) -> bool {
        self.has_beyond
    }

    /// Whether floor beyond an edge is beside a cell.
    fn is_beside_edge(&self, (i, j): (i32, i32), here: &Here<'_>) -> bool {
        let is_beyond = |key| self.known(key, here).is_some_and(|cell| cell.floor == Floor::Beyond);
        self.has_beyond && (-1..=1).any(|up| (-1..=1).any(|aside| is_beyond((i + aside, j + up))))
    }

    /// The odometry frame is another one. What was seen close to the robot stays where it is about the robot, less so
    /// much at its rim, metres; what lies beyond edges stays, and as much more.
    pub fn anchor(&mut self, before: &Here<'_>, odom_from_robot: &Se2, off_m: f64, drift: f64) {
        std::mem::swap(&mut self.cells, &mut self.spare);
        self.cells.fill(Cell::UNSEEN);
        (self.has_beyond, self.has_assumed) = (false, false);
        let old = Self { cells: std::mem::take(&mut self.spare), spare: Vec::new(), ..*self };
        let is_beyond = |key| {
            let cell = old.known(key, before);
            cell.filter(|cell| cell.floor == Floor::Beyond)
        };
        let now = Point::from(odom_from_robot.translation.vector);
        let then_from_now = before.odom_from_robot * odom_from_robot.inverse();
        for (key, middle) in cells_about(now, ANCHORED_M) {
            let then = then_from_now * middle;
            let floor = old.floor(cell_of(then), before, drift);
            let is_kept = match floor {
                Floor::Seen => cells_about(then, off_m).all(|(key, _)| old.floor(key, before, drift) == Floor::Seen),
                other => other == Floor::Trodden,
            };
            // It is as old as it was.
            let kept = old.known(cell_of(then), before).filter(|_| is_kept);
            let lost = || cells_about(then, off_m.max(CELL_M)).find_map(|(key, _)| is_beyond(key));
            if let Some(cell) = kept.or_else(lost) {
                self.cells[slot_of(key)] = Cell { key, ..*cell };
                self.has_beyond |= cell.floor == Floor::Beyond;
            }
        }
        self.spare = old.cells;
    }
}

/// The strip ahead of the pair up to the first floor that the camera sees (robot frame).
#[derive(Debug, Clone, Copy)]
struct Strip {
    from: Point,
    to: Point,
}

impl Strip {
    /// None where that floor does not go on from the plane on which they stand.
    fn before(bodies: &[Disc], view: &DepthView) -> Option<Self> {
        let first = bodies.first()?.center;
        let (mut from, mut to) = (first, first);
        for Disc { center, radius_m } in bodies {
            let aside_m = radius_m + CELL_M;
            from = Point::new(from.x.min(center.x), from.y.min(center.y - aside_m));
            to = Point::new(to.x.max(center.x), to.y.max(center.y + aside_m));
        }
        let to_m = view.level_floor_from_m(from.y, to.y)?;
        Some(Self { from, to: Point::new(to_m.max(to.x), to.y) })
    }

    fn contains(&self, place: Point) -> bool {
        (self.from.x..=self.to.x).contains(&place.x) && (self.from.y..=self.to.y).contains(&place.y)
    }

    fn middle(&self) -> Point {
        nalgebra::center(&self.from, &self.to)
    }

    fn reach_m(&self) -> f64 {
        (self.to - self.from).norm() / 2.0
    }
}

/// Cells whose middles are so near to a place, and their middles (odometry frame).
pub(super) fn cells_about(at: Point, radius_m: f64) -> impl Iterator<Item = ((i32, i32), Point)> {
    let reach = nalgebra::Vector2::repeat(radius_m);
    let (low, high) = (cell_of(at - reach), cell_of(at + reach));
    let all = (low.1..=high.1).flat_map(move |j| (low.0..=high.0).map(move |i| ((i, j), middle_of((i, j)))));
    all.filter(move |(_, middle)| (middle - at).norm_squared() <= radius_m * radius_m)
}

/// The cell of a place (odometry frame).
pub(super) fn cell_of(at: Point) -> (i32, i32) {
    let number = |m: f64| (m / CELL_M).floor().clamp(-PLACE_MAX, PLACE_MAX) as i32;
    (number(at.x), number(at.y))
}

fn middle_of((i, j): (i32, i32)) -> Point {
    Point::new((f64::from(i) + 0.5) * CELL_M, (f64::from(j) + 0.5) * CELL_M)
}

fn slot_of((i, j): (i32, i32)) -> usize {
    (j.rem_euclid(SIDE) * SIDE + i.rem_euclid(SIDE)) as usize
}
