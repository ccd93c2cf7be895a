//! What a depth frame adds to the lidar: obstacles that its plane misses, as points, and what is seen free.

use messages::DepthHeader;
use nalgebra::Vector2;

use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2};

/// What is lower is floor or can be walked over, metres.
const FLOOR_M: f64 = 0.08;
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
    /// Focal length or mounting pose is not usable.
    #[error("the depth frame's {0} is not usable")]
    Geometry(&'static str),
}

/// One column of the image.
#[derive(Debug, Clone, Copy)]
struct Column {
    /// Tangent of the angle to the left of the camera's axis.
    left: f64,
    /// The nearest obstacle: along the camera's axis over the floor, and its depth, metres.
    near_m: f64,
    near_depth_m: f64,
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
        Self { left, near_m: none, near_depth_m: none, free_m: none, far_m: 0.0, floor_m: none, unknown: 0, known: 0 }
    }

    /// A pixel that says nothing. A run of them hides what is higher than [`HIDDEN_M`] from where it is so wide on.
    fn take_unknown(&mut self, fy_px: f64) {
        self.unknown += 1;
        self.free_m = self.free_m.min(HIDDEN_M * fy_px / f64::from(self.unknown));
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

/// A depth frame as the shield sees it. Reused from frame to frame.
#[derive(Debug, Clone)]
pub struct DepthView {
    /// Obstacles in the robot frame of the frame's stamp.
    stamped: Vec<Point>,
    /// The same in the robot frame of now.
    points: Vec<Point>,
    columns: Vec<Column>,
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
            camera: Point::origin(),
            forward: Vector2::x(),
            now_from_stamped: Se2::identity(),
        }
    }
}

impl DepthView {
    /// Takes in a frame.
    ///
    /// # Errors
    /// Where the frame cannot be used; the view is then empty.
    pub fn fill(&mut self, header: &DepthHeader, pixels_mm: &[u16]) -> Result<(), DepthError> {
        self.clear();
        let (width, height) = (header.width as usize, header.height as usize);
        if pixels_mm.is_empty() || width.checked_mul(height) != Some(pixels_mm.len()) {
            return Err(DepthError::Size { pixels: pixels_mm.len(), width: header.width, height: header.height });
        }
        let (fx, fy) = (header.fx_px, header.fy_px);
        if !(fx.is_finite() && fy.is_finite() && fx > 0.0 && fy > 0.0) {
            return Err(DepthError::Geometry("focal length"));
        }
        let mount = header.robot_from_camera;
        if ![mount.x_m, mount.y_m, mount.z_m, mount.yaw_rad, mount.pitch_rad, header.cx_px, header.cy_px]
            .iter()
            .all(|v| v.is_finite())
        {
            return Err(DepthError::Geometry("mounting pose"));
        }
        self.camera = Point::new(mount.x_m, mount.y_m);
        self.forward = Vector2::new(mount.yaw_rad.cos(), mount.yaw_rad.sin());
        let left_of = |u: usize| -(u as f64 - header.cx_px) / fx;
        let stride = (width / COLUMNS).max(1);
        self.columns.extend((0..width).step_by(stride).map(|u| Column::new(left_of(u))));
        let (sin, cos) = mount.pitch_rad.sin_cos();
        for v in 0..height {
            // The camera is tilted down: its axis loses height with distance.
            let up = -(v as f64 - header.cy_px) / fy;
            let row = Row { along: cos + up * sin, rise: up * cos - sin };
            let below = pixels_mm.get((v + 1) * width..(v + 2) * width).unwrap_or_default();
            self.look_at_row(row, mount.z_m, fy, &pixels_mm[v * width..(v + 1) * width], below);
        }
        let looked_at = self.columns.len() * height;
        let known: usize = self.columns.iter().map(|column| column.known as usize).sum();
        if known * KNOWN_OF < looked_at {
            self.clear();
            return Err(DepthError::Blind { known, looked_at });
        }
        for i in 0..self.columns.len() {
            self.columns[i].end();
            let Column { left, near_m, near_depth_m, .. } = self.columns[i];
            if near_m.is_finite() {
                self.stamped.push(self.place(near_m, left * near_depth_m));
            }
        }
        self.points.clone_from(&self.stamped);
        Ok(())
    }

    fn look_at_row(&mut self, row: Row, camera_m: f64, fy_px: f64, pixels_mm: &[u16], below_mm: &[u16]) {
        let stride = (pixels_mm.len() / COLUMNS).max(1);
        for (column, u) in self.columns.iter_mut().zip((0..pixels_mm.len()).step_by(stride)) {
            if pixels_mm[u] == 0 {
                column.take_unknown(fy_px);
                continue;
            }
            (column.unknown, column.known) = (0, column.known + 1);
            let depth_m = f64::from(pixels_mm[u]) / 1000.0;
            let (along_m, height_m) = (depth_m * row.along, camera_m + depth_m * row.rise);
            if !(FLOOR_M..=HEAD_M).contains(&height_m) {
                // The ray left the band before it ended.
                let edge_m = if height_m < FLOOR_M { FLOOR_M } else { HEAD_M };
                let share = ((edge_m - camera_m) / (height_m - camera_m)).clamp(0.0, 1.0);
                column.far_m = column.far_m.max(along_m * share);
                if height_m < FLOOR_M {
                    column.floor_m = column.floor_m.min(along_m * share);
                }
                continue;
            }
            column.far_m = column.far_m.max(along_m);
            if along_m >= column.near_m {
                continue;
            }
            column.free_m = column.free_m.min(along_m);
            let near = AGREE_M + AGREE_SHARE * depth_m;
            let agrees = |mm: Option<&u16>| mm.is_some_and(|mm| (f64::from(*mm) / 1000.0 - depth_m).abs() <= near);
            if agrees(pixels_mm.get(u + 1)) || agrees(below_mm.get(u)) {
                (column.near_m, column.near_depth_m) = (along_m, depth_m);
            }
        }
    }

    /// From now on seen from where the robot is now: `now_from_stamped` is the robot of the frame's stamp in the robot
    /// frame of now.
    pub fn move_to(&mut self, now_from_stamped: &Se2) {
        self.now_from_stamped = *now_from_stamped;
        self.points.clear();
        self.points.extend(self.stamped.iter().map(|point| now_from_stamped * point));
    }

    fn place(&self, along: f64, left: f64) -> Point {
        self.camera + self.forward * along + Vector2::new(-self.forward.y, self.forward.x) * left
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
        if along <= 0.0 || self.columns.len() < 2 {
            return None;
        }
        let left = to.dot(&Vector2::new(-self.forward.y, self.forward.x)) / along;
        // Columns go from left to right; what the outermost saw lies on the edge of the view and may be off by
        // rounding.
        let (first, last) = (self.columns[0].left, self.columns[self.columns.len() - 1].left);
        if left > first + EDGE || left < last - EDGE {
            return None;
        }
        let i = self.columns.partition_point(|column| column.left > left).clamp(1, self.columns.len() - 1);
        Some((&self.columns[i - 1..=i], along))
    }
}

#[cfg(test)]
mod tests {
    use super::{DepthError, DepthView};
    use crate::scan::Beams;
    use crate::se2::{Point, Se2};
    use messages::{DepthHeader, Pose3};

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

    #[test]
    fn a_frame_of_the_wrong_size_is_refused() {
        let mut view = DepthView::default();
        assert!(matches!(view.fill(&header(), &[1; 100]), Err(DepthError::Size { pixels: 100, .. })));
        assert!(view.points().is_empty());
    }
}
