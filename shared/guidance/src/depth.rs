//! What a depth frame adds to the lidar: obstacles that its plane misses, as points, and what is seen free.

mod floor;

use std::ops::Range;

use messages::DepthHeader;
use nalgebra::{Point3, Rotation3, Vector2, Vector3};

use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2};
use crate::tilt::Tilt;
use floor::Floor;

/// What is lower is floor or can be walked over, metres.
const FLOOR_M: f64 = 0.08;
/// The same where the body sways, metres at the camera and metres more per metre of way: what attitude and trim are off
/// grows with the distance.
const SWAYING_FLOOR_M: f64 = 0.05;
const SWAYING_FLOOR_PER_M: f64 = 0.015;
/// Rays that hardly lead ahead tell of no column.
const AHEAD_MIN: f64 = 0.05;
/// No camera has so many columns that are looked at, however it is turned.
const COLUMNS_MAX: f64 = 4096.0;
/// Of so many rows and looked-at columns one tells where the floor is.
const FLOOR_OF: usize = 4;
/// What is higher is over everybody's head, metres.
const HEAD_M: f64 = 1.90;
/// About so many columns are looked at, but every row: a bar across the way is thin in height.
const COLUMNS: usize = 160;
/// A pixel is an obstacle where the next one to the right or below is about as near; one alone is noise.
const AGREE_M: f64 = 0.10;
/// The same, as a share of the depth.
const AGREE_SHARE: f64 = 0.03;
/// Of so many pixels at least one must say something, or the camera is covered.
const KNOWN_OF: usize = 20;
/// Pixels that say nothing hide something that is higher than this, metres.
const HIDDEN_M: f64 = 0.05;

/// A camera that sees nothing stands before something where at least so many beams end in its view,
const BEFORE_BEAMS: usize = 8;
/// and all but one in so many end nearer to it than it can see,
const BEFORE_OF: usize = 20;
/// give or take so much, metres.
const BEFORE_M: f64 = 0.05;

/// Rounding of the tangent of a column's angle.
const EDGE: f64 = 1e-9;

/// A depth frame cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DepthError {
    /// The frame has another number of pixels than its header says.
    #[error("a depth frame of {pixels} pixels, where its header says {width}x{height}")]
    Size {
        /// Pixels in the frame.
        pixels: usize,
        /// Columns by the header.
        width: u32,
        /// Rows by the header.
        height: u32,
    },
    /// Next to no pixel says anything: something covers the camera.
    #[error("only {known} of {looked_at} pixels say anything")]
    Blind {
        /// Pixels that say something.
        known: usize,
        /// Pixels looked at.
        looked_at: usize,
    },
    /// Most of what is low lies below the floor that there should be: the attitude is wrong, or the floor falls away.
    #[error("the floor is not where the attitude says")]
    NoFloor,
    /// Focal length or mounting pose is not usable.
    #[error("the depth frame's {0} is not usable")]
    Geometry(&'static str),
}

fn check(header: &DepthHeader, pixels: usize) -> Result<(), DepthError> {
    let (width, height) = (header.width as usize, header.height as usize);
    if pixels == 0 || width.checked_mul(height) != Some(pixels) {
        return Err(DepthError::Size { pixels, width: header.width, height: header.height });
    }
    if ![header.fx_px, header.fy_px].iter().all(|focal| focal.is_finite() && *focal > 0.0) {
        return Err(DepthError::Geometry("focal length"));
    }
    let mount = header.robot_from_camera;
    let numbers = [mount.x_m, mount.y_m, mount.z_m, mount.yaw_rad, mount.pitch_rad, header.cx_px, header.cy_px];
    if numbers.iter().all(|number| number.is_finite()) { Ok(()) } else { Err(DepthError::Geometry("mounting pose")) }
}

/// Every so manyth column is looked at.
fn stride(header: &DepthHeader) -> usize {
    (header.width as usize / COLUMNS).max(1)
}

/// Tangent of the angle to the left of the camera's axis.
fn left_of(header: &DepthHeader, u: usize) -> f64 {
    -(u as f64 - header.cx_px) / header.fx_px
}

/// Tangent of the angle above it.
fn up_of(header: &DepthHeader, v: usize) -> f64 {
    -(v as f64 - header.cy_px) / header.fy_px
}

/// Whether the next pixel to the right or below is about as near.
fn agrees(pixels_mm: &[u16], width: usize, at: usize) -> bool {
    let depth_m = f64::from(pixels_mm[at]) / 1000.0;
    let near_m = AGREE_M + AGREE_SHARE * depth_m;
    let is_near = |mm: &u16| (f64::from(*mm) / 1000.0 - depth_m).abs() <= near_m;
    let right = pixels_mm.get(at + 1).filter(|_| !(at + 1).is_multiple_of(width));
    right.is_some_and(is_near) || pixels_mm.get(at + width).is_some_and(is_near)
}

fn place(camera: Point, forward: Vector2<f64>, along: f64, left: f64) -> Point {
    camera + forward * along + Vector2::new(-forward.y, forward.x) * left
}

/// One column of the image.
#[derive(Debug, Clone, Copy)]
struct Column {
    /// Tangent of the angle to the left of the camera's axis.
    left: f64,
    /// The nearest obstacle: along the camera's axis over the floor, and to the left of it, metres.
    near_m: f64,
    near_left_m: f64,
    /// Nothing between floor and head is nearer, as far as the image reaches up, metres.
    free_m: f64,
    /// How far its rays reach within the band between floor and head, metres.
    far_m: f64,
    /// From here on its rays reach down to the floor, metres.
    floor_m: f64,
    /// Pixels in a row, up to here, that say nothing.
    unknown: u32,
    /// Pixels that say something.
    known: u32,
}

impl Column {
    fn new(left: f64) -> Self {
        let none = f64::INFINITY;
        Self { left, near_m: none, near_left_m: none, free_m: none, far_m: 0.0, floor_m: none, unknown: 0, known: 0 }
    }

    /// A pixel that says nothing. A run of them hides what is higher than [`HIDDEN_M`] from where it is so wide on.
    fn take_unknown(&mut self, fy_px: f64) {
        self.unknown += 1;
        self.free_m = self.free_m.min(HIDDEN_M * fy_px / f64::from(self.unknown));
    }

    /// A pixel that says something; `agrees` tells whether its neighbours are about as near.
    fn take(&mut self, pixel: &Pixel, camera_m: f64, agrees: impl FnOnce() -> bool) {
        (self.unknown, self.known) = (0, self.known + 1);
        let Pixel { along_m, left_m, height_m, floor_m } = *pixel;
        if !(floor_m..=HEAD_M).contains(&height_m) {
            // The ray left the band before it ended.
            let edge_m = if height_m < floor_m { floor_m } else { HEAD_M };
            let share = ((edge_m - camera_m) / (height_m - camera_m)).clamp(0.0, 1.0);
            self.far_m = self.far_m.max(along_m * share);
            if height_m < floor_m {
                self.floor_m = self.floor_m.min(along_m * share);
            }
            return;
        }
        self.far_m = self.far_m.max(along_m);
        if along_m >= self.near_m {
            return;
        }
        self.free_m = self.free_m.min(along_m);
        if agrees() {
            (self.near_m, self.near_left_m) = (along_m, left_m);
        }
    }

    fn end(&mut self) {
        self.free_m = self.free_m.min(self.near_m).min(self.far_m);
    }
}

/// What all pixels of a row have in common: a depth of 1 m is so far along the floor, and so much higher than the
/// camera.
#[derive(Debug, Clone, Copy)]
struct Row {
    along: f64,
    rise: f64,
}

/// What a pixel sees: how far along the camera's axis over the floor and to the left of it, how high over the floor,
/// and up to which height that is floor, metres.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    along_m: f64,
    left_m: f64,
    height_m: f64,
    floor_m: f64,
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

/// A depth frame as the shield sees it. Reused from frame to frame.
#[derive(Debug, Clone)]
pub struct DepthView {
    /// Obstacles in the robot frame of the frame's stamp.
    stamped: Vec<Point>,
    /// The same in the robot frame of now.
    points: Vec<Point>,
    columns: Vec<Column>,
    /// The columns that every row of the image reaches: the others say what stands there, but not that nothing does.
    whole: Range<usize>,
    /// Places that may be floor: ahead, left, height, metres.
    low: Vec<Vector3<f64>>,
    camera: Point,
    forward: Vector2<f64>,
    /// The robot of the frame's stamp, in the robot frame of now.
    now_from_stamped: Se2,
}

impl Default for DepthView {
    fn default() -> Self {
        Self {
            stamped: Vec::new(),
            points: Vec::new(),
            columns: Vec::new(),
            whole: 0..0,
            low: Vec::new(),
            camera: Point::origin(),
            forward: Vector2::x(),
            now_from_stamped: Se2::identity(),
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
        self.clear();
        check(header, pixels_mm.len())?;
        match tilt {
            None => self.look_level(header, pixels_mm),
            Some(tilt) => self.look_tilted(header, pixels_mm, tilt)?,
        }
        let looked_at = (header.width as usize).div_ceil(stride(header)) * header.height as usize;
        let known: usize = self.columns.iter().map(|column| column.known as usize).sum();
        if known * KNOWN_OF < looked_at {
            self.clear();
            return Err(DepthError::Blind { known, looked_at });
        }
        for i in 0..self.columns.len() {
            self.columns[i].end();
            let Column { near_m, near_left_m, .. } = self.columns[i];
            if near_m.is_finite() {
                self.stamped.push(self.place(near_m, near_left_m));
            }
        }
        self.points.clone_from(&self.stamped);
        Ok(())
    }

    fn look_level(&mut self, header: &DepthHeader, pixels_mm: &[u16]) {
        let mount = header.robot_from_camera;
        self.camera = Point::new(mount.x_m, mount.y_m);
        self.forward = Vector2::new(mount.yaw_rad.cos(), mount.yaw_rad.sin());
        let (width, stride) = (header.width as usize, stride(header));
        self.columns.extend((0..width).step_by(stride).map(|u| Column::new(left_of(header, u))));
        self.whole = 0..self.columns.len();
        let (sin, cos) = mount.pitch_rad.sin_cos();
        for (v, row_mm) in pixels_mm.chunks_exact(width).enumerate() {
            // The camera is tilted down: its axis loses height with distance.
            let up = up_of(header, v);
            let row = Row { along: cos + up * sin, rise: up * cos - sin };
            for (column, u) in self.columns.iter_mut().zip((0..width).step_by(stride)) {
                if row_mm[u] == 0 {
                    column.take_unknown(header.fy_px);
                    continue;
                }
                let depth_m = f64::from(row_mm[u]) / 1000.0;
                let pixel = Pixel {
                    along_m: depth_m * row.along,
                    left_m: column.left * depth_m,
                    height_m: mount.z_m + depth_m * row.rise,
                    floor_m: FLOOR_M,
                };
                column.take(&pixel, mount.z_m, || agrees(pixels_mm, width, v * width + u));
            }
        }
    }

    /// A pixel's column is the one in whose direction its ray leads over the floor.
    fn look_tilted(&mut self, header: &DepthHeader, pixels_mm: &[u16], tilt: &Tilt) -> Result<(), DepthError> {
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
        let floor = self.find_floor(header, pixels_mm, &axes, camera.z)?;
        let (width, stride, spacing) = (header.width as usize, stride(header), stride(header) as f64 / header.fx_px);
        let leftmost = self.columns.first().map_or(0.0, |column| column.left);
        for (v, row_mm) in pixels_mm.chunks_exact(width).enumerate() {
            let up = up_of(header, v);
            for u in (0..width).step_by(stride) {
                let ray = axes.ray(left_of(header, u), up);
                let number = ((leftmost - ray.y / ray.x) / spacing + 0.5) as usize;
                let Some(column) = self.columns.get_mut(number).filter(|_| ray.x > AHEAD_MIN) else { continue };
                if row_mm[u] == 0 {
                    column.take_unknown(header.fy_px);
                    continue;
                }
                let seen = ray * (f64::from(row_mm[u]) / 1000.0);
                let place = place(self.camera, self.forward, seen.x, seen.y);
                let pixel = Pixel {
                    along_m: seen.x,
                    left_m: seen.y,
                    height_m: camera.z + seen.z - floor.height_m(place.x, place.y),
                    floor_m: SWAYING_FLOOR_M + SWAYING_FLOOR_PER_M * seen.x,
                };
                column.take(&pixel, camera.z, || agrees(pixels_mm, width, v * width + u));
            }
        }
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

    fn find_floor(
        &mut self,
        header: &DepthHeader,
        pixels_mm: &[u16],
        axes: &Axes,
        camera_m: f64,
    ) -> Result<Floor, DepthError> {
        let (width, step) = (header.width as usize, FLOOR_OF * stride(header));
        self.low.clear();
        for v in (0..header.height as usize).step_by(FLOOR_OF) {
            for u in (0..width).step_by(step).filter(|u| pixels_mm[v * width + u] != 0) {
                let ray = axes.ray(left_of(header, u), up_of(header, v));
                let seen = ray * (f64::from(pixels_mm[v * width + u]) / 1000.0);
                let place = place(self.camera, self.forward, seen.x, seen.y);
                self.low.push(Vector3::new(place.x, place.y, camera_m + seen.z));
            }
        }
        Floor::of(&self.low).ok_or_else(|| {
            self.clear();
            DepthError::NoFloor
        })
    }

    /// From now on seen from where the robot is now: `now_from_stamped` is the robot of the frame's stamp in the robot
    /// frame of now.
    pub fn move_to(&mut self, now_from_stamped: &Se2) {
        self.now_from_stamped = *now_from_stamped;
        self.points.clear();
        self.points.extend(self.stamped.iter().map(|point| now_from_stamped * point));
    }

    fn place(&self, along: f64, left: f64) -> Point {
        place(self.camera, self.forward, along, left)
    }

    /// Whether the lidar tells why the camera of that header sees nothing: what stands before it is nearer than
    /// `nearest_m`, the least depth that it can see. Beams and camera are seen from where the robot is.
    #[must_use]
    pub fn stands_before_something(header: &DepthHeader, nearest_m: f64, beams: &Beams) -> bool {
        let mount = header.robot_from_camera;
        let forward = Vector2::new(mount.yaw_rad.cos(), mount.yaw_rad.sin());
        let left = Vector2::new(-forward.y, forward.x);
        let half_width = f64::from(header.width) / 2.0 / header.fx_px;
        let (mut near, mut all) = (0, 0);
        for beam in beams.beams().iter().filter(|beam| beam.kind != BeamKind::Unknown) {
            let to = beam.end - Point::new(mount.x_m, mount.y_m);
            let along_m = to.dot(&forward);
            if along_m > 0.0 && to.dot(&left).abs() <= half_width * along_m {
                all += 1;
                near += usize::from(beam.kind == BeamKind::Hit && along_m <= nearest_m + BEFORE_M);
            }
        }
        near >= BEFORE_BEAMS && (all - near) * BEFORE_OF <= all
    }

    /// Nothing seen.
    pub fn clear(&mut self) {
        self.stamped.clear();
        self.points.clear();
        self.columns.clear();
        self.whole = 0..0;
        self.now_from_stamped = Se2::identity();
    }

    /// The nearest obstacle of each column between floor and head, robot frame.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Whether the camera sees that nothing is at a point, nor on the way to it, at the heights that are in view there.
    #[must_use]
    pub fn sees_free(&self, point: Point) -> bool {
        self.beside(point).is_some_and(|(columns, along)| columns.iter().all(|column| column.free_m > along))
    }

    /// The same down to the floor: near the robot the floor is below the image, and what is low may still be there.
    #[must_use]
    pub fn sees_bare_floor(&self, point: Point) -> bool {
        let bare = |column: &Column, along: f64| column.free_m > along && column.floor_m <= along;
        self.beside(point).is_some_and(|(columns, along)| columns.iter().all(|column| bare(column, along)))
    }

    /// The columns to either side of a point, and how far along the camera's axis it is, metres; none where it is
    /// outside the field of view.
    fn beside(&self, point: Point) -> Option<(&[Column], f64)> {
        let to = self.now_from_stamped.inverse() * point - self.camera;
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
        let i = columns.partition_point(|column| column.left > left).clamp(1, columns.len() - 1);
        Some((&columns[i - 1..=i], along))
    }
}

#[cfg(test)]
mod tests {
    use super::{DepthError, DepthView};
    use crate::scan::Beams;
    use crate::se2::{Point, Se2};
    use crate::tilt::Tilt;
    use messages::{Attitude, DepthHeader, Pose3};
    use nalgebra::{Point3, Rotation3, Vector3};

    fn header() -> DepthHeader {
        DepthHeader {
            width: 64,
            height: 48,
            fx_px: 32.0,
            fy_px: 32.0,
            cx_px: 31.5,
            cy_px: 23.5,
            robot_from_camera: Pose3 { x_m: 0.25, z_m: 0.45, ..Pose3::default() },
            ..DepthHeader::default()
        }
    }

    #[test]
    fn a_wall_ahead_is_a_row_of_points() {
        let mut view = DepthView::default();
        view.fill(&header(), &vec![2000; 64 * 48]).expect("usable");
        assert_eq!(view.points().len(), 64);
        assert!(view.points().iter().all(|p| (p.x - 2.25).abs() < 1e-9));
        assert!(view.sees_free(Point::new(1.5, 0.2)) && !view.sees_free(Point::new(2.4, 0.2)));
        assert!(!view.sees_free(Point::new(-1.0, 0.0)), "behind the camera nothing is seen");
    }

    #[test]
    fn the_lidar_tells_of_what_stands_right_before_the_camera() {
        let beams = |wall_m: f64| {
            let header = crate::scan::tests::header();
            let angle = |i: usize| header.angle_min_rad + i as f64 * header.angle_increment_rad;
            let mut beams = Beams::default();
            let to_wall = |i: usize| if angle(i).cos() > 0.1 { wall_m / angle(i).cos() } else { f64::INFINITY };
            beams.fill_with(&header, 360, to_wall).expect("usable");
            beams
        };
        let before = |wall_m: f64| DepthView::stands_before_something(&header(), 0.3, &beams(wall_m));
        assert!(before(0.45) && before(0.55));
        assert!(!before(0.65) && !before(5.0), "that far the camera sees: something covers it");
    }

    #[test]
    fn the_floor_is_no_obstacle() {
        let mut pixels = vec![0u16; 64 * 48];
        for v in 25..48 {
            // Where the ray of row v meets the floor.
            let depth = 0.45 * 32.0 / (v as f64 - 23.5);
            if depth < 10.0 {
                pixels[v * 64..(v + 1) * 64].fill((depth * 1000.0) as u16);
            }
        }
        let mut view = DepthView::default();
        view.fill(&header(), &pixels).expect("usable");
        assert!(view.points().is_empty());
    }

    /// The floor as far as a ray reaches it within 10 m, and nothing above.
    fn floor() -> Vec<u16> {
        let mut pixels = vec![0u16; 64 * 48];
        for v in 0..48 {
            let depth = 0.45 * 32.0 / (v as f64 - 23.5);
            let seen = v > 23 && depth < 10.0;
            // The upper half sees a wall 9 m away.
            pixels[v * 64..(v + 1) * 64].fill(if seen { (depth * 1000.0) as u16 } else { 9000 });
        }
        pixels
    }

    #[test]
    fn near_the_camera_the_floor_is_below_the_image() {
        let mut pixels = floor();
        pixels[..24 * 64].fill(9000);
        let mut view = DepthView::default();
        view.fill(&header(), &pixels).expect("usable");
        let (near, far) = (Point::new(0.6, 0.0), Point::new(1.6, 0.0));
        assert!(view.sees_free(near) && !view.sees_bare_floor(near));
        assert!(view.sees_bare_floor(far));
    }

    #[test]
    fn a_thin_bar_across_the_way_is_seen() {
        for row in 0..48 {
            let mut pixels = floor();
            let height = 0.45 - (f64::from(row) - 23.5) / 32.0 * 1.0;
            pixels[row as usize * 64..(row as usize + 1) * 64].fill(1000);
            let mut view = DepthView::default();
            view.fill(&header(), &pixels).expect("usable");
            let seen = view.points().iter().filter(|p| (p.x - 1.25).abs() < 1e-6).count();
            // The last pixel of a row has no neighbour.
            assert_eq!(seen >= 63, (0.08..=1.90).contains(&height), "row {row}, {height} m high: {seen}");
        }
    }

    #[test]
    fn one_pixel_alone_is_no_obstacle_but_is_not_free_either() {
        let mut pixels = floor();
        pixels[20 * 64 + 32] = 1000;
        let mut view = DepthView::default();
        view.fill(&header(), &pixels).expect("usable");
        assert!(view.points().iter().all(|p| p.x > 5.0));
        let ahead = |x: f64| Point::new(0.25 + x, -0.01 * x);
        assert!(view.sees_free(ahead(0.9)) && !view.sees_free(ahead(1.1)));
    }

    #[test]
    fn what_no_pixel_says_anything_about_is_not_free() {
        let mut view = DepthView::default();
        let mut pixels = floor();
        view.fill(&header(), &pixels).expect("usable");
        let ahead = Point::new(3.0, 0.0);
        assert!(view.sees_free(ahead));
        // A black thing on the floor returns nothing: rows 10 to 40 of the middle.
        for v in 10..40 {
            pixels[v * 64 + 24..v * 64 + 40].fill(0);
        }
        view.fill(&header(), &pixels).expect("usable");
        assert!(!view.sees_free(ahead));
        let covered = view.fill(&header(), &vec![0; 64 * 48]);
        assert!(matches!(covered, Err(DepthError::Blind { known: 0, .. })));
        assert!(!view.sees_free(Point::new(0.5, 0.0)) && view.points().is_empty());
    }

    #[test]
    fn a_robot_that_moved_on_is_nearer_to_what_it_saw() {
        let mut view = DepthView::default();
        view.fill(&header(), &vec![2000; 64 * 48]).expect("usable");
        view.move_to(&Se2::translation(-0.5, 0.0));
        assert!(view.points().iter().all(|p| (p.x - 1.75).abs() < 1e-9));
        assert!(view.sees_free(Point::new(1.5, 0.1)) && !view.sees_free(Point::new(1.9, 0.1)));
    }

    fn held(roll_deg: f64, pitch_deg: f64) -> Tilt {
        let [roll_rad, pitch_rad] = [roll_deg, pitch_deg].map(f64::to_radians);
        Tilt::of(&Attitude { stamp_ns: 1, roll_rad, pitch_rad, height_m: 0.28, standing_m: 0.30 }).expect("known")
    }

    /// What the camera of `header` sees of a floor, of a wall at x = 5 and of a block between two places, when the body
    /// is held so.
    fn seen(header: &DepthHeader, tilt: &Tilt, block: Option<[[f64; 3]; 2]>) -> Vec<u16> {
        let mount = header.robot_from_camera;
        let eye = tilt.place(Point3::new(mount.x_m, mount.y_m, mount.z_m));
        let mounted = Rotation3::from_euler_angles(0.0, mount.pitch_rad, mount.yaw_rad);
        let depth_at = |i: usize| {
            let (v, u) = (i / header.width as usize, i % header.width as usize);
            let ray = tilt.direction(mounted * Vector3::new(1.0, super::left_of(header, u), super::up_of(header, v)));
            let floor_m = if ray.z < 0.0 { -eye.z / ray.z } else { f64::INFINITY };
            let wall_m = if ray.x > 0.0 { (5.0 - eye.x) / ray.x } else { f64::INFINITY };
            let block_m = block.map_or(f64::INFINITY, |[low, high]| {
                let sides = [0, 1, 2].map(|axis| {
                    let ends = [low[axis], high[axis]].map(|end| (end - eye[axis]) / ray[axis]);
                    [ends[0].min(ends[1]), ends[0].max(ends[1])]
                });
                let enters = sides.iter().map(|side| side[0]).fold(0.0, f64::max);
                let leaves = sides.iter().map(|side| side[1]).fold(f64::INFINITY, f64::min);
                if enters < leaves { enters } else { f64::INFINITY }
            });
            floor_m.min(wall_m).min(block_m)
        };
        let mm = |i: usize| Some(depth_at(i)).filter(|m| *m < 10.0).map_or(0, |m| (m * 1000.0).round() as u16);
        (0..(header.width * header.height) as usize).map(mm).collect()
    }

    fn camera_160() -> DepthHeader {
        DepthHeader { width: 160, height: 120, fx_px: 80.0, fy_px: 80.0, cx_px: 79.5, cy_px: 59.5, ..header() }
    }

    #[test]
    fn a_bare_floor_is_none_however_the_body_is_held_and_a_low_block_stands_where_it_stands() {
        let (header, mut view) = (camera_160(), DepthView::default());
        let block = [[1.2, -0.1, 0.0], [1.4, 0.1, 0.12]];
        for (roll_deg, pitch_deg) in [(0.0, 0.0), (6.0, 0.0), (-6.0, 8.0), (12.0, -5.0), (-12.0, 12.0)] {
            let tilt = held(roll_deg, pitch_deg);
            view.fill_tilted(&header, &seen(&header, &tilt, None), Some(&tilt)).expect("usable");
            let near = view.points().iter().filter(|p| p.x < 4.8).count();
            assert_eq!(near, 0, "{roll_deg} {pitch_deg}: {:?}", view.points());
            assert!(view.sees_bare_floor(Point::new(2.0, 0.2)) && view.sees_free(Point::new(4.5, 0.0)));
            view.fill_tilted(&header, &seen(&header, &tilt, Some(block)), Some(&tilt)).expect("usable");
            let on_block = |p: &&Point| (1.15..1.45).contains(&p.x) && p.y.abs() < 0.13;
            let found = view.points().iter().filter(on_block).count();
            assert!(found >= 8, "{roll_deg} {pitch_deg}: {found}");
            assert!(!view.sees_free(Point::new(1.5, 0.0)) && view.sees_free(Point::new(1.5, 0.5)));
        }
    }

    #[test]
    fn an_attitude_that_is_half_a_degree_off_makes_no_obstacle_of_the_floor() {
        let (header, mut view) = (camera_160(), DepthView::default());
        for (roll_off_deg, pitch_off_deg) in [(0.5, 0.5), (-0.9, 0.9), (0.9, -0.9)] {
            let (truth, told) = (held(4.0, 3.0), held(4.0 + roll_off_deg, 3.0 + pitch_off_deg));
            view.fill_tilted(&header, &seen(&header, &truth, None), Some(&told)).expect("usable");
            assert!(view.points().iter().all(|p| p.x > 3.0), "{:?}", view.points());
        }
    }

    #[test]
    fn what_some_rows_of_a_rolled_image_do_not_reach_is_not_seen_free() {
        let (header, tilt, mut view) = (camera_160(), held(12.0, 0.0), DepthView::default());
        view.fill_tilted(&header, &seen(&header, &tilt, None), Some(&tilt)).expect("usable");
        let at = |bearing: f64| Point::new(0.25 + 2.0, 2.0 * bearing);
        assert!(view.sees_free(at(0.0)) && !view.sees_free(at(0.97)) && !view.sees_free(at(-0.97)));
    }

    #[test]
    fn a_frame_of_the_wrong_size_is_refused() {
        let mut view = DepthView::default();
        assert!(matches!(view.fill(&header(), &[1; 100]), Err(DepthError::Size { pixels: 100, .. })));
        assert!(view.points().is_empty());
    }
}
