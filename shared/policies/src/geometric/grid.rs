//! What is known of the surroundings: a rolling memory of scans and depth points, and the window that a decision reads.

use super::beams::Beams;
use guidance::se2::Point;
use guidance::{DepthView, Se2};

/// Side of a cell, metres.
pub const CELL_M: f64 = 0.1;
/// Cells along one side of the window (16 m).
pub const SIDE: usize = 160;
/// Clearances are known up to this, metres.
pub const CLEARANCE_MAX_M: f64 = 1.0;
/// A beam frees what it passes by this and two sigma, metres: a hit a little before the next beam's end stays.
const PASS_M: f64 = 0.12;
/// Round the robot and the handler the floor is free: they stand on it, metres.
const STANDING_M: f64 = 0.25;
/// What the camera sees is there if it saw it in one of this many updates before as well: a single frame may be noise.
const GLIMPSED: u64 = 3;
/// What it saw in this number of updates is no noise.
const OFTEN: u64 = 4;
/// What it saw there is gone once it has seen past it in this number of updates, and not seen it in between: from afar,
/// what it sees at the rim of things lies beside them. Through glass it sees now and then.
const SEEN_PAST: u64 = 3;

/// What is known of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Known {
    /// Never seen, or too long ago.
    #[default]
    Unknown,
    /// A beam passed.
    Free,
    /// Something stands there.
    Occupied,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    key: (i32, i32),
    known: Known,
    hit: Point,
    seen: u64,
    /// Seen by the camera alone: the lidar looks over or under it and cannot free it.
    camera_only: bool,
    /// The update at which the camera saw something there; 0: none.
    glimpsed: u64,
    /// Number of updates in which the camera saw something there since the cell was last known to be free.
    glimpses: u64,
    /// Up to how high over the camera it saw something there, metres; 0 where nothing else is known.
    rise_m: f64,
    /// Number of updates in which it has seen past that since.
    seen_past: u64,
}

/// The rolling memory, in the odometry frame.
#[derive(Debug)]
pub struct Memory {
    cells: Vec<Cell>,
    now: u64,
    kept: u64,
    camera_kept: u64,
    often_kept: u64,
}

fn key_of(place: Point) -> (i32, i32) {
    ((place.x / CELL_M).floor() as i32, (place.y / CELL_M).floor() as i32)
}

fn centre_of(key: (i32, i32)) -> Point {
    Point::new((f64::from(key.0) + 0.5) * CELL_M, (f64::from(key.1) + 0.5) * CELL_M)
}

fn slot_of(key: (i32, i32)) -> usize {
    let side = SIDE as i32;
    key.1.rem_euclid(side) as usize * SIDE + key.0.rem_euclid(side) as usize
}

fn first_key(centre: Point) -> (i32, i32) {
    let (i, j) = key_of(centre);
    let half = SIDE as i32 / 2;
    (i - half, j - half)
}

impl Memory {
    /// Nothing known; what is seen is kept for that many updates.
    pub fn new(kept: u64) -> Self {
        Self { cells: vec![Cell::default(); SIDE * SIDE], now: 0, kept, camera_kept: kept, often_kept: kept }
    }

    /// The same, with the number of updates for which things are kept that the camera alone saw: seldom, and often.
    pub fn with_camera_kept(self, camera_kept: u64, often_kept: u64) -> Self {
        Self { camera_kept, often_kept, ..self }
    }

    /// Number of updates that what is in a cell is kept for.
    fn kept(&self, cell: &Cell) -> u64 {
        match cell.camera_only {
            true if cell.glimpses >= OFTEN => self.often_kept,
            true => self.camera_kept,
            false => self.kept,
        }
    }

    /// Forgets everything: a new odometry frame.
    pub fn clear(&mut self) {
        self.cells.fill(Cell::default());
    }

    /// Takes in one scan and the camera's obstacle points (robot frame); where the handler is, if there is one. `depth`
    /// is the frame of these points, if it is known: it tells how high they are, and where there is nothing any more.
    pub fn update(
        &mut self,
        odom_from_robot: &Se2,
        beams: &Beams,
        obstacles: &[Point],
        depth: Option<&DepthView>,
        handler: Option<Point>,
    ) {
        self.now += 1;
        self.free_what_beams_pass(odom_from_robot, beams, handler);
        for hit in beams.hits.iter().flatten() {
            self.occupy(odom_from_robot * hit, false);
        }
        let rises_m = depth.map_or(&[][..], DepthView::rises_m).iter().map(Some).chain(std::iter::repeat(None));
        for (place, rise_m) in obstacles.iter().zip(rises_m) {
            let at = odom_from_robot * place;
            if place.coords.norm() < SIDE as f64 * CELL_M / 2.0 && !self.lidar_sees_it(at) {
                self.glimpse(at, rise_m.copied().unwrap_or(f64::INFINITY));
            }
        }
        if let Some(depth) = depth {
            self.free_what_the_camera_sees_past(&odom_from_robot.inverse(), depth);
        }
    }

    /// Takes in where the floor ends (robot frame). Neither beam nor camera tells that it goes on.
    pub fn block(&mut self, odom_from_robot: &Se2, places: impl Iterator<Item = Point>) {
        for place in places {
            let at = odom_from_robot * place;
            self.occupy(at, true);
            self.rise_to(at, f64::INFINITY);
        }
    }

    fn free_what_beams_pass(&mut self, odom_from_robot: &Se2, beams: &Beams, handler: Option<Point>) {
        let robot_from_odom = odom_from_robot.inverse();
        let first = first_key(Point::from(odom_from_robot.translation.vector));
        let pass_m = PASS_M + 2.0 * beams.sigma_m;
        for slot in 0..SIDE * SIDE {
            let key = (first.0 + (slot % SIDE) as i32, first.1 + (slot / SIDE) as i32);
            let kept = self.kept(&self.cells[slot_of(key)]);
            let cell = &mut self.cells[slot_of(key)];
            if cell.key != key {
                *cell = Cell { key, ..Cell::default() };
            } else if self.now > cell.seen + kept {
                *cell = Cell { key, glimpsed: cell.glimpsed, ..Cell::default() };
            }
            let occupied = cell.known == Known::Occupied;
            let place = robot_from_odom * if occupied { cell.hit } else { centre_of(key) };
            let is_at = |body: Point| (place - body).norm() < STANDING_M;
            let stood_on = is_at(Point::origin()) || handler.is_some_and(is_at);
            let free = if occupied {
                !cell.camera_only && beams.passed_by_m(place) > pass_m
            } else {
                stood_on || beams.passed_by_m(place) > 0.0
            };
            if free {
                *cell = Cell { key, known: Known::Free, seen: self.now, glimpsed: cell.glimpsed, ..Cell::default() };
            }
        }
    }

    fn free_what_the_camera_sees_past(&mut self, robot_from_odom: &Se2, depth: &DepthView) {
        let now = self.now;
        for cell in self.cells.iter_mut().filter(|cell| cell.known == Known::Occupied && cell.camera_only) {
            if cell.seen == now || !depth.sees_free_up_to(robot_from_odom * cell.hit, cell.rise_m) {
                continue;
            }
            cell.seen_past += 1;
            if cell.seen_past >= SEEN_PAST {
                *cell = Cell { key: cell.key, known: Known::Free, seen: now, ..Cell::default() };
            }
        }
    }

    fn occupy(&mut self, at: Point, camera_only: bool) {
        let key = key_of(at);
        let cell = &mut self.cells[slot_of(key)];
        if cell.key == key {
            *cell = Cell { known: Known::Occupied, hit: at, seen: self.now, camera_only, seen_past: 0, ..*cell };
        }
    }

    fn glimpse(&mut self, at: Point, rise_m: f64) {
        let recent = self.now.saturating_sub(GLIMPSED)..self.now;
        let is_known = |cell: &Cell| cell.known == Known::Occupied && cell.camera_only;
        if self.is_about(at, |cell| is_known(cell) || cell.glimpsed > 0 && recent.contains(&cell.glimpsed)) {
            self.occupy(at, true);
        }
        let key = key_of(at);
        let cell = &mut self.cells[slot_of(key)];
        if cell.key == key && cell.glimpsed != self.now {
            (cell.glimpsed, cell.glimpses) = (self.now, cell.glimpses + 1);
        }
        self.rise_to(at, rise_m);
    }

    /// What is there reaches at least so high over the camera, metres.
    fn rise_to(&mut self, at: Point, rise_m: f64) {
        let key = key_of(at);
        let cell = &mut self.cells[slot_of(key)];
        if cell.key == key {
            cell.rise_m = cell.rise_m.max(rise_m);
        }
    }

    fn lidar_sees_it(&self, at: Point) -> bool {
        self.is_about(at, |cell| cell.known == Known::Occupied && cell.seen == self.now && !cell.camera_only)
    }

    /// Whether that holds of a place's cell or one beside it.
    fn is_about(&self, at: Point, holds: impl Fn(&Cell) -> bool) -> bool {
        let (i, j) = key_of(at);
        (-1..=1).flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj))).any(|key| {
            let cell = &self.cells[slot_of(key)];
            cell.key == key && holds(cell)
        })
    }

    /// The surroundings of a place (odometry frame), with the clearance of every cell, for a team that fits where it
    /// has so much of it, metres. What else is known to stand there (odometry frame) is added to it.
    pub fn window(&self, centre: Point, fits_m: f64, others: impl IntoIterator<Item = Point>) -> Window {
        let (first, known) = (first_key(centre), vec![Known::Unknown; SIDE * SIDE]);
        let mut window = Window { first, known, clearance_m: Vec::new(), hits: Vec::new(), fits_m };
        for slot in 0..SIDE * SIDE {
            let key = (first.0 + (slot % SIDE) as i32, first.1 + (slot / SIDE) as i32);
            let cell = &self.cells[slot_of(key)];
            if cell.key != key || self.now > cell.seen + self.kept(cell) {
                continue;
            }
            window.known[slot] = cell.known;
            if cell.known == Known::Occupied {
                window.hits.push(cell.hit);
            }
        }
        for other in others {
            if let Some(cell) = window.cell_at(other) {
                window.known[cell] = Known::Occupied;
                window.hits.push(other);
            }
        }
        window.measure_clearance();
        window
    }
}

/// The surroundings that one decision reads, odometry frame. Cells are numbered row by row, x first.
#[derive(Debug)]
pub struct Window {
    first: (i32, i32),
    /// What is known of each cell.
    pub known: Vec<Known>,
    /// From each cell's centre to the nearest obstacle, metres, at most [`CLEARANCE_MAX_M`].
    pub clearance_m: Vec<f64>,
    /// Obstacle points, odometry frame.
    pub hits: Vec<Point>,
    /// The middle of the team fits where a cell has so much clearance, metres.
    pub fits_m: f64,
}

impl Window {
    fn measure_clearance(&mut self) {
        let reach = (CLEARANCE_MAX_M / CELL_M) as i32 + 1;
        let mut clearance_m2 = vec![CLEARANCE_MAX_M * CLEARANCE_MAX_M; SIDE * SIDE];
        for hit in &self.hits {
            let (i, j) = key_of(*hit);
            let columns = (i - reach).max(self.first.0)..=(i + reach).min(self.first.0 + SIDE as i32 - 1);
            for key_j in (j - reach).max(self.first.1)..=(j + reach).min(self.first.1 + SIDE as i32 - 1) {
                let row = (key_j - self.first.1) as usize * SIDE;
                for key_i in columns.clone() {
                    let nearest_m2 = &mut clearance_m2[row + (key_i - self.first.0) as usize];
                    *nearest_m2 = nearest_m2.min((centre_of((key_i, key_j)) - hit).norm_squared());
                }
            }
        }
        self.clearance_m = clearance_m2.into_iter().map(f64::sqrt).collect();
    }

    /// The cell that holds the place.
    pub fn cell_at(&self, place: Point) -> Option<usize> {
        let (i, j) = key_of(place);
        let (i, j) = (i.checked_sub(self.first.0)?, j.checked_sub(self.first.1)?);
        let inside = (0..SIDE as i32).contains(&i) && (0..SIDE as i32).contains(&j);
        inside.then(|| j as usize * SIDE + i as usize)
    }

    /// The middle of a cell.
    pub fn centre(&self, cell: usize) -> Point {
        centre_of((self.first.0 + (cell % SIDE) as i32, self.first.1 + (cell / SIDE) as i32))
    }

    /// What is known at the place.
    pub fn known_at(&self, place: Point) -> Known {
        self.cell_at(place).map_or(Known::Unknown, |cell| self.known[cell])
    }

    /// From the place to the nearest obstacle, metres, interpolated; 0 outside the window.
    pub fn clearance_at(&self, place: Point) -> f64 {
        self.interpolate(&self.clearance_m, place).unwrap_or(0.0)
    }

    /// A value of the cells at the place, bilinear over the finite ones of the four cells round it.
    pub fn interpolate(&self, values: &[f64], place: Point) -> Option<f64> {
        let x = place.x / CELL_M - f64::from(self.first.0) - 0.5;
        let y = place.y / CELL_M - f64::from(self.first.1) - 0.5;
        let limit = (SIDE - 1) as f64;
        if !(x >= 0.0 && y >= 0.0 && x < limit && y < limit) {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f64, y - j as f64);
        let corner = j * SIDE + i;
        let parts = [
            (corner, (1.0 - u) * (1.0 - v)),
            (corner + 1, u * (1.0 - v)),
            (corner + SIDE, (1.0 - u) * v),
            (corner + SIDE + 1, u * v),
        ];
        let (mut sum, mut weights) = (0.0, 0.0);
        for (cell, weight) in parts {
            if values[cell].is_finite() {
                sum += weight * values[cell];
                weights += weight;
            }
        }
        (weights > 1e-9).then(|| sum / weights)
    }

    /// The cells that share a side with this one.
    pub fn neighbours(cell: usize) -> impl Iterator<Item = usize> {
        let (i, j) = (cell % SIDE, cell / SIDE);
        let west = (i > 0).then(|| cell - 1);
        let east = (i + 1 < SIDE).then_some(cell + 1);
        let south = (j > 0).then(|| cell - SIDE);
        let north = (j + 1 < SIDE).then_some(cell + SIDE);
        [west, east, south, north].into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::{Beams, CELL_M, Known, Memory, SEEN_PAST};
    use guidance::se2::{Point, Se2};
    use guidance::{DepthView, Tilt};
    use messages::{Attitude, Pose2, Pose3, ScanHeader};
    use world::{DepthConfig, DepthSensor, Prism, Scene, World};

    /// What the camera sees of a room with a wall 4 m ahead. A box lower than the lidar's plane stands 2 m ahead, or
    /// nothing.
    fn view(has_box: bool) -> DepthView {
        let robot_from_camera = Pose3 { x_m: 0.28, z_m: 0.40, ..Pose3::default() };
        let config = DepthConfig { width: 128, height: 64, redwood: 0.0, robot_from_camera, ..DepthConfig::default() };
        let mut camera = DepthSensor::new(config, 1, 1).expect("a camera");
        let tilt = Tilt::of(&Attitude::at_height(1, 0.0, 0.0, 0.30)).expect("level");
        let low = Prism::cuboid(Point::new(2.0, 0.0), [0.3, 0.3], 0.0, [0.0, 0.2]);
        let wall = Prism::wall(vec![Point::new(4.0, -4.0), Point::new(4.0, 4.0)], [0.0, 2.6]);
        let world = World::new(2.6, if has_box { vec![wall, low] } else { vec![wall] });
        let scene = Scene::without_people(&world, Pose2::default(), Some(tilt));
        let (mut view, mut pixels_mm) = (DepthView::default(), vec![0; camera.pixels()]);
        camera.render(&scene, 1, &mut pixels_mm);
        view.fill_tilted(&camera.depth_header(), &pixels_mm, Some(&tilt)).expect("a frame");
        view
    }

    /// A lidar that sees nothing.
    fn beams() -> Beams {
        let header = ScanHeader { angle_increment_rad: 0.1, range_max_m: 10.0, ..ScanHeader::default() };
        Beams::read(&header, &[f32::INFINITY; 62], Point::new(-0.75, -0.35), 0.4).expect("a scan")
    }

    fn updated(memory: &mut Memory, view: &DepthView, count: u64) {
        for _ in 0..count {
            memory.update(&Se2::identity(), &beams(), view.points(), Some(view), None);
        }
    }

    fn is_occupied(memory: &Memory, at: Point) -> bool {
        let window = memory.window(Point::origin(), 0.4, []);
        window.hits.iter().any(|hit| (hit - at).norm() < CELL_M)
    }

    #[test]
    fn what_the_camera_saw_is_gone_once_it_has_seen_past_it_some_times() {
        let (there, gone) = (view(true), view(false));
        let edge = there.points().iter().copied().min_by(|a, b| a.y.abs().total_cmp(&b.y.abs())).expect("the box");
        assert!((edge.x - 1.85).abs() < 0.1, "{edge}");
        let mut memory = Memory::new(1000).with_camera_kept(1000, 1000);
        updated(&mut memory, &there, 10);
        updated(&mut memory, &gone, SEEN_PAST - 1);
        assert!(is_occupied(&memory, edge), "through glass it sees now and then");
        updated(&mut memory, &there, 1);
        updated(&mut memory, &gone, SEEN_PAST - 1);
        assert!(is_occupied(&memory, edge), "it was seen again");
        updated(&mut memory, &gone, 1);
        assert!(!is_occupied(&memory, edge));
        assert_eq!(memory.window(Point::origin(), 0.4, []).known_at(edge), Known::Free);
    }

    #[test]
    fn where_the_floor_ends_no_camera_sees_past_it() {
        let (gone, edge) = (view(false), Point::new(1.85, 0.0));
        let mut memory = Memory::new(1000).with_camera_kept(1000, 1000);
        updated(&mut memory, &gone, 1);
        memory.block(&Se2::identity(), [edge].into_iter());
        updated(&mut memory, &gone, 10);
        assert!(is_occupied(&memory, edge));
    }
}
