//! What a depth frame adds to the lidar: obstacles that its plane misses, as points, and what is seen free.

use messages::DepthHeader;
use nalgebra::Vector2;

use crate::se2::Point;

/// What is lower is floor or can be walked over, metres.
const FLOOR_M: f64 = 0.08;
/// What is higher is over everybody's head, metres.
const HEAD_M: f64 = 1.90;
/// Only every so many columns and rows are looked at.
const STRIDE: usize = 4;
/// So many pixels of a column must agree that something is there: a single one is noise.
const MIN_PIXELS: u32 = 2;

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
    /// Focal length or mounting pose is not usable.
    #[error("the depth frame's {0} is not usable")]
    Geometry(&'static str),
}

/// One column: nearest obstacle and how far it sees.
#[derive(Debug, Clone, Copy, Default)]
struct Column {
    /// Tangent of the angle to the left of the camera's axis.
    left: f64,
    /// Along the camera's axis, metres: nothing between head and floor is nearer.
    free_m: f64,
}

/// A depth frame as the shield sees it. Reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct DepthView {
    points: Vec<Point>,
    columns: Vec<Column>,
    camera: Point,
    forward: Vector2<f64>,
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
        for u in (0..width).step_by(STRIDE) {
            let left = -(u as f64 - header.cx_px) / fx;
            self.look_at_column(header, pixels_mm, u, left);
        }
        Ok(())
    }

    fn look_at_column(&mut self, header: &DepthHeader, pixels_mm: &[u16], u: usize, left: f64) {
        let (sin, cos) = header.robot_from_camera.pitch_rad.sin_cos();
        let (mut near, mut second, mut seen, mut far) = (f64::INFINITY, f64::INFINITY, 0u32, 0.0f64);
        let mut near_depth = 0.0;
        for v in (0..header.height as usize).step_by(STRIDE) {
            let mm = pixels_mm[v * header.width as usize + u];
            if mm == 0 {
                continue;
            }
            seen += 1;
            let depth = f64::from(mm) / 1000.0;
            let up = -(v as f64 - header.cy_px) / header.fy_px * depth;
            // The camera is tilted down: its axis loses height with distance.
            let along = depth * cos + up * sin;
            let height = header.robot_from_camera.z_m - depth * sin + up * cos;
            far = far.max(along);
            if !(FLOOR_M..=HEAD_M).contains(&height) {
                continue;
            }
            if along < near {
                (second, near, near_depth) = (near, along, depth);
            } else if along < second {
                second = along;
            }
        }
        // One pixel alone is noise; the second nearest must be about as near.
        let obstacle = if second - near < 0.3 || MIN_PIXELS < 2 { near } else { second };
        if obstacle.is_finite() && near_depth > 0.0 {
            // A pixel's offset to the side goes with its depth, which a tilt makes different from the way along.
            let side = left * near_depth * (obstacle / near);
            self.points.push(self.place(obstacle, side));
        }
        let free_m = if obstacle.is_finite() { obstacle } else { far };
        self.columns.push(Column { left, free_m: if seen >= 8 { free_m } else { 0.0 } });
    }

    fn place(&self, along: f64, left: f64) -> Point {
        self.camera + self.forward * along + Vector2::new(-self.forward.y, self.forward.x) * left
    }

    /// Nothing seen.
    pub fn clear(&mut self) {
        self.points.clear();
        self.columns.clear();
    }

    /// The nearest obstacle of each column between floor and head, robot frame.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Whether the camera sees that nothing is at a point, nor on the way to it.
    #[must_use]
    pub fn sees_free(&self, point: Point) -> bool {
        let to = point - self.camera;
        let along = to.dot(&self.forward);
        if along <= 0.0 || self.columns.is_empty() {
            return false;
        }
        let left = to.dot(&Vector2::new(-self.forward.y, self.forward.x)) / along;
        // Columns go from left to right.
        let i = self.columns.partition_point(|column| column.left > left);
        let inside = i > 0 && i < self.columns.len();
        inside && self.columns[i - 1].free_m > along && self.columns[i].free_m > along
    }
}

#[cfg(test)]
mod tests {
    use super::{DepthError, DepthView};
    use crate::se2::Point;
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
        assert_eq!(view.points().len(), 16);
        assert!(view.points().iter().all(|p| (p.x - 2.25).abs() < 1e-9));
        assert!(view.sees_free(Point::new(1.5, 0.2)) && !view.sees_free(Point::new(2.4, 0.2)));
        assert!(!view.sees_free(Point::new(-1.0, 0.0)), "behind the camera nothing is seen");
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

    #[test]
    fn a_frame_of_the_wrong_size_is_refused() {
        let mut view = DepthView::default();
        assert!(matches!(view.fill(&header(), &[1; 100]), Err(DepthError::Size { pixels: 100, .. })));
        assert!(view.points().is_empty());
    }
}
