//! What a depth frame adds to the lidar: obstacles that its plane misses, as points, and what is seen free.

mod before;
mod column;
mod floor;
mod frame;
mod slopes;
mod stance;
mod stepped;
mod steps;
mod walkable;

use std::ops::Range;

use messages::DepthHeader;
use multiversion::multiversion;
use nalgebra::{Point3, Rotation3, Vector2, Vector3};

use crate::se2::{Point, Se2};
use crate::tilt::Tilt;
use column::{Column, Eye, Pixel};
use floor::{Cells, Look, Plane};
use frame::{AHEAD_MIN, Row, agrees, apart_at_1_m, cell_rows, check, left_of, near_m, stride, up_of};
use steps::Steps;

pub use floor::FloorCell;
pub use frame::DepthError;
pub use slopes::Slopes;
pub use stance::Stance;
pub use stepped::FloorStep;
pub use steps::StepMax;
pub use walkable::FloorInView;

/// What is lower is floor or can be walked over, metres.
const FLOOR_M: f64 = 0.08;
/// The same for a body that sways: a height at the camera, metres, and an increase per metre of distance. The error of
/// the attitude grows with the distance.
const SWAYING_FLOOR_M: f64 = 0.05;
const SWAYING_FLOOR_PER_M: f64 = 0.015;
/// Edges farther away are not told: a row of pixels is too wide there, metres.
const EDGE_REACH_M: f64 = 3.0;
/// Upper bound on columns, for any attitude of a real camera.
const COLUMNS_MAX: f64 = 4096.0;
/// One in this many rows, and of the sampled columns, is used to trim the floor.
const FLOOR_OF: usize = 4;
/// One in this many of the sampled columns is used to find its slope.
const CELLS_OF: usize = 2;
/// Of so many pixels at least one must say something, or the camera is covered.
const KNOWN_OF: usize = 20;

/// Rounding of the tangent of a column's angle.
const EDGE: f64 = 1e-9;

fn place(camera: Point, forward: Vector2<f64>, along: f64, left: f64) -> Point {
    camera + forward * along + Vector2::new(-forward.y, forward.x) * left
}

/// Image axis, image left and image up of a camera on a body that sways: along its axis over the floor, to the left of
/// it, and up.
#[derive(Debug, Clone, Copy)]
struct Axes {
    ahead: Vector3<f64>,
    left: Vector3<f64>,
    up: Vector3<f64>,
}

impl Axes {
    /// Where a metre of depth leads at a pixel: along, left, up.
    fn ray(&self, left: f64, up: f64) -> Vector3<f64> {
        self.ahead + self.left * left + self.up * up
    }
}

/// The rays of one row of pixels: along, left and up for a metre of depth, each apart, so that the compiler works on
/// several side by side.
#[derive(Debug, Clone, Default)]
struct Rays {
    /// Tangent of the angle to the left of the camera's axis.
    left: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    /// 1 over x.
    per_ahead: Vec<f64>,
    /// The column in whose direction a ray leads over the floor.
    column: Vec<f64>,
}

impl Rays {
    /// For the columns of a frame that are looked at.
    fn laid_out(mut self, header: &DepthHeader) -> Self {
        let (width, stride) = (header.width as usize, stride(header));
        let (first, step) = (left_of(header, 0), left_of(header, stride) - left_of(header, 0));
        self.left.clear();
        self.left.extend((0..width.div_ceil(stride)).map(|i| first + step * i as f64));
        let count = self.left.len();
        for numbers in [&mut self.x, &mut self.y, &mut self.z, &mut self.per_ahead, &mut self.column] {
            numbers.resize(count, 0.0);
        }
        self
    }
}

/// For a row whose middle ray is `row`. The first column's tangent is `leftmost`, and for each 1 of it there are
/// `per_column` columns.
#[multiversion(targets("x86_64+avx2"))]
fn fill_rays(rays: &mut Rays, row: Vector3<f64>, aside: Vector3<f64>, [leftmost, per_column]: [f64; 2]) {
    let count = rays.left.len();
    let (x, y, z) = (&mut rays.x[..count], &mut rays.y[..count], &mut rays.z[..count]);
    let (per_ahead, columns) = (&mut rays.per_ahead[..count], &mut rays.column[..count]);
    for (i, left) in rays.left.iter().enumerate() {
        (x[i], y[i], z[i]) = (row.x + aside.x * left, row.y + aside.y * left, row.z + aside.z * left);
        per_ahead[i] = x[i].recip();
        columns[i] = (leftmost - y[i] * per_ahead[i]) * per_column;
    }
}

/// The number of a cell or column; 0 for what is less. A cast to 64 bits would cost twice as much.
fn index_of(value: f64) -> usize {
    value as u32 as usize
}

/// A depth frame as the shield sees it. Reused from frame to frame.
#[derive(Debug, Clone)]
pub struct DepthView {
    /// How high a step is that can be taken. None: steps are not looked for.
    step_max: Option<StepMax>,
    /// Low steps that are known (robot frame of the next frame's stamp).
    known: Vec<FloorStep>,
    /// Steps, in the robot frame of now.
    steps: Vec<FloorStep>,
    /// Obstacles in the robot frame of the frame's stamp.
    stamped: Vec<Point>,
    /// The same in the robot frame of now.
    points: Vec<Point>,
    /// How high over the camera each is, metres.
    rises_m: Vec<f64>,
    /// The last floor before a drop, in the robot frame of the frame's stamp, and of now.
    stamped_edges: Vec<Point>,
    edges: Vec<Point>,
    /// Distance between two rows of pixels on the floor at 1 m, metres. It grows with the distance's square.
    apart_at_1_m: f64,
    /// Height of the camera over the floor, metres.
    height_m: f64,
    /// Room for the rays of a row, and for the rows.
    rays: Rays,
    rows: Vec<Row>,
    columns: Vec<Column>,
    /// The columns that every row of the image reaches. The others show obstacles, but cannot show that space is free.
    whole: Range<usize>,
    /// Places that may be floor: ahead, left, height, metres.
    low: Vec<Vector3<f64>>,
    cells: Cells,
    stepped: Steps,
    camera: Point,
    forward: Vector2<f64>,
    /// The robot of the frame's stamp, in the robot frame of now, and the way back.
    now_from_stamped: Se2,
    stamped_from_now: Se2,
    /// Frames taken in so far.
    number: u64,
}

/// The columns to either side of a point, and how far along the camera's axis it is, metres.
#[derive(Clone, Copy)]
pub(crate) struct Beside<'a> {
    columns: &'a [Column],
    along: f64,
}

impl Default for DepthView {
    fn default() -> Self {
        Self {
            step_max: None,
            known: Vec::new(),
            steps: Vec::new(),
            stamped: Vec::new(),
            points: Vec::new(),
            rises_m: Vec::new(),
            stamped_edges: Vec::new(),
            edges: Vec::new(),
            apart_at_1_m: 0.0,
            height_m: 0.0,
            rays: Rays::default(),
            rows: Vec::new(),
            columns: Vec::new(),
            whole: 0..0,
            low: Vec::new(),
            cells: Cells::default(),
            stepped: Steps::default(),
            camera: Point::origin(),
            forward: Vector2::x(),
            now_from_stamped: Se2::identity(),
            stamped_from_now: Se2::identity(),
            number: 0,
        }
    }
}

impl DepthView {
    /// Takes in a frame of a camera on a body that is level.
    ///
    /// # Errors
    /// Where the frame cannot be used; the view is then empty.
    pub fn fill(&mut self, header: &DepthHeader, pixels_mm: &[u16]) -> Result<(), DepthError> {
        self.fill_tilted(header, pixels_mm, None)
    }

    /// Takes in a frame of a camera on a body that was held so at the frame's stamp; level without a tilt.
    ///
    /// # Errors
    /// As [`Self::fill`].
    pub fn fill_tilted(
        &mut self,
        header: &DepthHeader,
        pixels_mm: &[u16],
        tilt: Option<&Tilt>,
    ) -> Result<(), DepthError> {
        self.fill_remembering(header, pixels_mm, tilt, |_| false)
    }

    /// The same, where `was_floor` tells whether floor was seen before at a place (robot frame of the frame's stamp).
    /// The floor at the feet is below the image, and so is the ramp or the step that leads to the first floor in view.
    ///
    /// # Errors
    /// As [`Self::fill`].
    pub fn fill_remembering(
        &mut self,
        header: &DepthHeader,
        pixels_mm: &[u16],
        tilt: Option<&Tilt>,
        was_floor: impl Fn(Point) -> bool,
    ) -> Result<(), DepthError> {
        self.clear();
        self.number += 1;
        check(header, pixels_mm.len())?;
        match tilt {
            None => self.look_level(header, pixels_mm),
            Some(tilt) => self.look_tilted(header, pixels_mm, tilt, &was_floor)?,
        }
        let looked_at = (header.width as usize).div_ceil(stride(header)) * header.height as usize;
        let known: usize = self.columns.iter().map(|column| column.known as usize).sum();
        if known * KNOWN_OF < looked_at {
            self.clear();
            return Err(DepthError::Blind { known, looked_at });
        }
        for i in 0..self.columns.len() {
            self.columns[i].end();
            let Column { near_m, near_left_m, near_rise_m, .. } = self.columns[i];
            if near_m.is_finite() {
                self.stamped.push(self.place(near_m, near_left_m));
                self.rises_m.push(near_rise_m);
            }
        }
        self.find_edges();
        self.place_steps();
        self.points.clone_from(&self.stamped);
        self.edges.clone_from(&self.stamped_edges);
        Ok(())
    }

    /// A camera of that height over the floor.
    fn eye(&mut self, header: &DepthHeader, height_m: f64) -> Eye {
        (self.apart_at_1_m, self.height_m) = (apart_at_1_m(header, height_m), height_m);
        Eye { height_m, apart_at_1_m: self.apart_at_1_m }
    }

    fn look_level(&mut self, header: &DepthHeader, pixels_mm: &[u16]) {
        let mount = header.robot_from_camera;
        self.camera = Point::new(mount.x_m, mount.y_m);
        self.forward = Vector2::new(mount.yaw_rad.cos(), mount.yaw_rad.sin());
        let (width, stride) = (header.width as usize, stride(header));
        self.columns.extend((0..width).step_by(stride).map(|u| Column::new(left_of(header, u))));
        self.whole = 0..self.columns.len();
        let (sin, cos) = mount.pitch_rad.sin_cos();
        let eye = self.eye(header, mount.z_m);
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        rows.extend((0..header.height as usize).map(|v| Row::of(header, v, (sin, cos))));
        // Column by column: what is known of one stays at hand.
        for (column, u) in self.columns.iter_mut().zip((0..width).step_by(stride)) {
            for (v, row) in rows.iter().enumerate() {
                let pixel_mm = pixels_mm[v * width + u];
                if pixel_mm == 0 {
                    column.take_unknown(header.fy_px);
                    continue;
                }
                column.top = column.top.max(row.elevation);
                let depth_m = f64::from(pixel_mm) / 1000.0;
                let height_m = mount.z_m + depth_m * row.rise;
                let pixel = Pixel {
                    along_m: depth_m * row.along,
                    left_m: column.left * depth_m,
                    rise_m: depth_m * row.rise,
                    height_m,
                    floor_m: FLOOR_M,
                    over_lowest_m: height_m,
                    drop_m: FLOOR_M + depth_m * row.along / header.fy_px,
                    level_m: 0.0,
                };
                column.take(&pixel, &eye, || agrees(pixels_mm, width, v * width + u));
            }
        }
        self.rows = rows;
    }

    /// A pixel's column is the one in whose direction its ray leads over the floor.
    fn look_tilted(
        &mut self,
        header: &DepthHeader,
        pixels_mm: &[u16],
        tilt: &Tilt,
        was_floor: &dyn Fn(Point) -> bool,
    ) -> Result<(), DepthError> {
        let mount = header.robot_from_camera;
        let camera = tilt.place(Point3::new(mount.x_m, mount.y_m, mount.z_m));
        let mounted = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
        let in_robot = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| tilt.direction(mounted * axis));
        self.camera = camera.xy();
        self.forward = in_robot[0].xy().normalize();
        let in_view =
            |axis: Vector3<f64>| Vector3::new(axis.xy().dot(&self.forward), self.forward.perp(&axis.xy()), axis.z);
        let axes = Axes { ahead: in_view(in_robot[0]), left: in_view(in_robot[1]), up: in_view(in_robot[2]) };
        self.lay_out(header, &axes)?;
        self.gather(header, pixels_mm, &axes, camera);
        let plane = self.find_floor(header, camera, was_floor);
        let (width, stride) = (header.width as usize, stride(header));
        let (per_column, per_pixel) = (header.fx_px / stride as f64, header.fy_px.recip());
        let eye = self.eye(header, camera.z);
        let leftmost = self.columns.first().map_or(0.0, |column| column.left);
        let mut rays = std::mem::take(&mut self.rays).laid_out(header);
        for (v, row_mm) in pixels_mm.chunks_exact(width).enumerate() {
            fill_rays(&mut rays, axes.ray(0.0, up_of(header, v)), axes.left, [leftmost, per_column]);
            let mut next = None;
            for (i, u) in (0..width).step_by(stride).enumerate() {
                let number = index_of(rays.column[i] + 0.5);
                if rays.x[i] <= AHEAD_MIN || number >= self.columns.len() {
                    continue;
                }
                // Where the rays of a row are farther apart than the columns, one shows the column before it as well.
                let left_out = next.replace(number + 1).filter(|next| next + 1 == number);
                let columns = &mut self.columns[left_out.unwrap_or(number)..=number];
                if row_mm[u] == 0 {
                    columns.iter_mut().for_each(|column| column.take_unknown(header.fy_px));
                    continue;
                }
                let seen = Vector3::new(rays.x[i], rays.y[i], rays.z[i]) * (f64::from(row_mm[u]) / 1000.0);
                let place = place(self.camera, self.forward, seen.x, seen.y);
                let over_plane_m = camera.z + seen.z - plane.height_m(place.x, place.y);
                let level_m = self.stepped.level_m(seen.x, seen.y, over_plane_m);
                let ramp_m = self.cells.over_m(seen.x, seen.y);
                // The cells may have taken a low step for a ramp.
                let is_stepped =
                    !self.stepped.is_level() && (over_plane_m - level_m).abs() < (over_plane_m - ramp_m).abs();
                let floor_over_plane_m = if is_stepped { level_m } else { ramp_m };
                let pixel = Pixel {
                    along_m: seen.x,
                    left_m: seen.y,
                    rise_m: seen.z,
                    height_m: over_plane_m - floor_over_plane_m,
                    floor_m: SWAYING_FLOOR_M + SWAYING_FLOOR_PER_M * seen.x,
                    // What stands in a cell may lift it: its floor is no drop for that.
                    over_lowest_m: over_plane_m - floor_over_plane_m.min(level_m.max(0.0)),
                    level_m,
                    drop_m: SWAYING_FLOOR_M + (SWAYING_FLOOR_PER_M + per_pixel) * seen.x,
                };
                for column in columns {
                    column.top = column.top.max(rays.z[i] * rays.per_ahead[i]);
                    column.take(&pixel, &eye, || agrees(pixels_mm, width, v * width + u));
                }
            }
        }
        self.rays = rays;
        Ok(())
    }

    /// Columns for all directions that the image reaches: as far apart as those that are looked at.
    fn lay_out(&mut self, header: &DepthHeader, axes: &Axes) -> Result<(), DepthError> {
        let (right_px, bottom_px) = (header.width as usize - 1, header.height as usize - 1);
        let tangent = |u: usize, v: usize| {
            let ray = axes.ray(left_of(header, u), up_of(header, v));
            ray.y / ray.x.max(AHEAD_MIN)
        };
        let (left, right) =
            ([tangent(0, 0), tangent(0, bottom_px)], [tangent(right_px, 0), tangent(right_px, bottom_px)]);
        let (leftmost, rightmost) = (left[0].max(left[1]), right[0].min(right[1]));
        let spacing = stride(header) as f64 / header.fx_px;
        let count = ((leftmost - rightmost).max(0.0) / spacing).round();
        if count > COLUMNS_MAX {
            self.clear();
            return Err(DepthError::Geometry("focal length"));
        }
        let count = count as usize + 1;
        self.columns.extend((0..count).map(|i| Column::new(leftmost - i as f64 * spacing)));
        let reached = |column: &Column| column.left <= left[0].min(left[1]) && column.left >= right[0].max(right[1]);
        let first = self.columns.iter().position(reached).unwrap_or(0);
        let behind = self.columns.iter().rposition(reached).map_or(0, |last| last + 1);
        self.whole = first..behind.max(first);
        Ok(())
    }

    /// Gathers what may be floor.
    fn gather(&mut self, header: &DepthHeader, pixels_mm: &[u16], axes: &Axes, camera: Point3<f64>) {
        // Steps are looked for in each of the columns.
        let (width, is_stepped) = (header.width as usize, self.step_max.is_some());
        let (step, cells_of) =
            if is_stepped { (stride(header), FLOOR_OF / CELLS_OF) } else { (FLOOR_OF / CELLS_OF * stride(header), 1) };
        let rows = cell_rows(header);
        self.cells.begin();
        self.stepped.begin();
        for v in (0..header.height as usize).step_by(rows) {
            let (is_trimming, up) = (v % FLOOR_OF < rows, up_of(header, v));
            if [0, width - 1].into_iter().all(|u| axes.ray(left_of(header, u), up).z >= 0.0) {
                // What lies higher than the camera is no floor.
                continue;
            }
            for (number, u) in (0..width).step_by(step).enumerate().filter(|(_, u)| pixels_mm[v * width + u] != 0) {
                let seen = axes.ray(left_of(header, u), up) * (f64::from(pixels_mm[v * width + u]) / 1000.0);
                if is_stepped {
                    self.stepped.take(seen.x, seen.y, camera.z + seen.z);
                }
                if !number.is_multiple_of(cells_of) {
                    continue;
                }
                self.cells.take(seen.x, seen.y, camera.z + seen.z);
                if is_trimming && number.is_multiple_of(cells_of * CELLS_OF) {
                    let place = place(self.camera, self.forward, seen.x, seen.y);
                    self.low.push(Vector3::new(place.x, place.y, camera.z + seen.z));
                }
            }
        }
    }

    /// The trimmed plane; the cells tell what is over it.
    fn find_floor(&mut self, header: &DepthHeader, camera: Point3<f64>, was_floor: &dyn Fn(Point) -> bool) -> Plane {
        let apart_at_1_m = cell_rows(header) as f64 * apart_at_1_m(header, camera.z);
        self.find_steps(apart_at_1_m, camera.z);
        let (eye, forward) = (self.camera, self.forward);
        let plane = Plane::of(&self.low);
        let was_floor = |along: f64, left: f64| was_floor(place(eye, forward, along, left));
        let look = Look { ahead_m: eye.coords.dot(&forward), apart_at_1_m, was_floor: &was_floor };
        self.cells.spread(&look, |along, left| {
            let at = place(eye, forward, along, left);
            plane.height_m(at.x, at.y)
        });
        plane
    }

    /// An edge counts where a column beside it shows it too: one alone is noise.
    fn find_edges(&mut self) {
        for i in 0..self.columns.len() {
            let Column { edge_m, edge_left_m, .. } = self.columns[i];
            let near_m = near_m(edge_m);
            let beside = &self.columns[i.saturating_sub(1)..self.columns.len().min(i + 2)];
            let agreeing = beside.iter().filter(|other| (other.edge_m - edge_m).abs() <= near_m).count();
            if edge_m < EDGE_REACH_M && agreeing > 1 {
                self.stamped_edges.push(self.place(edge_m, edge_left_m));
            }
        }
    }

    /// From now on seen from where the robot is now: `now_from_stamped` is the robot of the frame's stamp in the robot
    /// frame of now.
    pub fn move_to(&mut self, now_from_stamped: &Se2) {
        (self.now_from_stamped, self.stamped_from_now) = (*now_from_stamped, now_from_stamped.inverse());
        self.points.clear();
        self.points.extend(self.stamped.iter().map(|point| now_from_stamped * point));
        self.edges.clear();
        self.edges.extend(self.stamped_edges.iter().map(|edge| now_from_stamped * edge));
        self.place_steps();
    }

    fn place(&self, along: f64, left: f64) -> Point {
        place(self.camera, self.forward, along, left)
    }

    /// Nothing seen.
    pub fn clear(&mut self) {
        self.stamped.clear();
        self.points.clear();
        self.rises_m.clear();
        self.stamped_edges.clear();
        self.edges.clear();
        self.columns.clear();
        self.low.clear();
        self.cells.clear();
        self.stepped.clear();
        self.steps.clear();
        self.whole = 0..0;
        (self.now_from_stamped, self.stamped_from_now) = (Se2::identity(), Se2::identity().inverse());
    }

    /// Number of the frame that was taken in last, counted from 1.
    #[must_use]
    pub fn number(&self) -> u64 {
        self.number
    }

    /// The nearest obstacle of each column between floor and head, robot frame.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// How high over the camera each of [`Self::points`] is, metres.
    #[must_use]
    pub fn rises_m(&self) -> &[f64] {
        &self.rises_m
    }

    /// The last floor before a drop, in each column that shows one, robot frame.
    #[must_use]
    pub fn edges(&self) -> &[Point] {
        &self.edges
    }

    /// Where the camera is (robot frame).
    #[must_use]
    pub fn camera(&self) -> Point {
        self.now_from_stamped * self.camera
    }

    /// The direction of its axis as seen from above (robot frame).
    #[must_use]
    pub fn ahead(&self) -> Vector2<f64> {
        self.now_from_stamped * self.forward
    }

    /// Whether the camera sees that nothing is at a point, nor on the way to it, at the heights that are in view there.
    #[must_use]
    pub fn sees_free(&self, point: Point) -> bool {
        self.beside(point).is_some_and(|Beside { columns, along }| columns.iter().all(|column| column.free_m > along))
    }

    /// The same from the floor up to a height over the camera, metres: near the robot the floor is below the image, and
    /// what hangs above it; either may still be there.
    #[must_use]
    pub fn sees_free_up_to(&self, point: Point, rise_m: f64) -> bool {
        let Some(Beside { columns, along }) = self.beside(point) else { return false };
        // The camera sways, and stood higher or lower when it saw what may hang there.
        let up_to_m = rise_m + SWAYING_FLOOR_M + SWAYING_FLOOR_PER_M * along;
        let is_free =
            |column: &Column| column.free_m > along && column.floor_m <= along && column.top * along >= up_to_m;
        // Floor that rises may be the kerb that was seen there.
        let left_m = self.forward.perp(&(self.stamped_from_now * point - self.camera));
        columns.iter().all(is_free) && self.cells.over_m(along, left_m) <= 0.0
    }

    /// What the cell of floor at a point (robot frame) shows. A frame of a body whose attitude is not known has none.
    #[must_use]
    pub fn floor_at(&self, point: Point) -> FloorCell {
        let to = self.stamped_from_now * point - self.camera;
        self.cells.at(to.dot(&self.forward), self.forward.perp(&to))
    }

    /// What is to either side of a point; none where it is outside the field of view.
    pub(crate) fn beside(&self, point: Point) -> Option<Beside<'_>> {
        let to = self.stamped_from_now * point - self.camera;
        let along = to.dot(&self.forward);
        let columns = &self.columns[self.whole.clone()];
        if along <= 0.0 || columns.len() < 2 {
            return None;
        }
        let left = to.dot(&Vector2::new(-self.forward.y, self.forward.x)) / along;
        // Columns go from left to right; what the outermost saw lies on the edge of the view and may be off by
        // rounding.
        let (first, last) = (columns[0].left, columns[columns.len() - 1].left);
        if left > first + EDGE || left < last - EDGE {
            return None;
        }
        // They are equally far apart: the first that is no more to the left is this one, give or take rounding.
        let mut i = (((first - left) / (first - columns[1].left)) as usize).min(columns.len());
        while i > 0 && columns[i - 1].left <= left {
            i -= 1;
        }
        while i < columns.len() && columns[i].left > left {
            i += 1;
        }
        let i = i.clamp(1, columns.len() - 1);
        Some(Beside { columns: &columns[i - 1..=i], along })
    }
}

#[cfg(test)]
mod edge_tests;
#[cfg(test)]
pub(crate) mod ramp_tests;
#[cfg(test)]
pub(crate) mod tests;
