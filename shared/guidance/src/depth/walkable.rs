//! Where a depth frame shows floor, and where it does not.

use messages::DepthHeader;

use super::column::Column;
use super::{Beside, DepthView, EDGE_REACH_M, left_of, up_of};
use crate::se2::Point;

/// At least this many columns must look at the first floor.
const LEVEL_MIN: usize = 3;
/// At most one in this many of them may show it not level.
const LEVEL_OF: usize = 10;
/// A column with an obstacle nearer than this is not asked about floor, metres.
const OPEN_M: f64 = 1.5;
/// At least one column in this many must be open, or the frame says nothing.
const OPEN_OF: usize = 4;
/// An open column shows floor where it sees some within this distance, metres.
const FLOOR_M: f64 = 3.0;
/// The frame shows floor where at least one open column in this many does.
const SHOWN_OF: usize = 10;

/// The floor on which a camera of a level body finds edges: ahead of the robot's middle, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorInView {
    /// From here,
    pub from_m: f64,
    /// to here.
    pub to_m: f64,
}

impl FloorInView {
    /// Of a camera whose depths are in a range, metres. None where it sees no floor.
    #[must_use]
    pub fn of(header: &DepthHeader, range_m: [f64; 2]) -> Option<Self> {
        let mount = header.robot_from_camera;
        let (sin, cos) = mount.pitch_rad.sin_cos();
        // Depth at which a row meets the floor, and how far along it leads.
        let meets = |v: usize| {
            let up = up_of(header, v);
            let (along, rise) = (cos + up * sin, up * cos - sin);
            let depth_m = -mount.z_m / rise;
            (rise < 0.0 && along > 0.0 && depth_m >= range_m[0] && depth_m <= range_m[1]).then_some(depth_m * along)
        };
        let looks_ahead = mount.yaw_rad.abs().tan() < left_of(header, 0) && mount.yaw_rad.cos() > 0.0;
        let along_m = || (0..header.height as usize).filter_map(meets).filter(|along_m| *along_m <= EDGE_REACH_M);
        let ahead_m = |along_m: f64| mount.x_m + along_m * mount.yaw_rad.cos();
        let (from_m, to_m) = (along_m().fold(f64::INFINITY, f64::min), along_m().fold(0.0, f64::max));
        (looks_ahead && from_m < to_m).then(|| Self { from_m: ahead_m(from_m), to_m: ahead_m(to_m) })
    }
}

impl Beside<'_> {
    /// Whether one of the columns sees floor there.
    pub(crate) fn shows_floor(&self) -> bool {
        self.columns.iter().any(|column| column.sees_floor(self.along, 0.0))
    }

    /// Whether all of them see an edge before it.
    pub(crate) fn is_beyond_edge(&self) -> bool {
        let is_beyond = |column: &Column| column.edge_m < self.along && self.along < column.near_m;
        self.columns.iter().all(is_beyond)
    }
}

impl DepthView {
    /// Whether the camera sees floor at a point (robot frame), and beyond it as far as two rows of pixels are apart.
    #[must_use]
    pub fn sees_floor(&self, point: Point) -> bool {
        self.beside(point).is_some_and(|Beside { columns, along }| {
            let beyond_m = self.apart_at_1_m * along * along;
            columns.iter().all(|column| column.sees_floor(along, beyond_m))
        })
    }

    /// Whether the camera sees floor at a point (robot frame), in one of the columns beside it.
    #[must_use]
    pub fn shows_floor(&self, point: Point) -> bool {
        self.beside(point).is_some_and(|beside| beside.shows_floor())
    }

    /// Whether the camera sees an edge before a point (robot frame).
    #[must_use]
    pub fn is_beyond_edge(&self, point: Point) -> bool {
        self.beside(point).is_some_and(|beside| beside.is_beyond_edge())
    }

    /// Whether the camera shows any floor. None where what stands before it may hide all of it.
    #[must_use]
    pub fn shows_any_floor(&self) -> Option<bool> {
        // The floor before an edge may lie below the image.
        let is_open = |column: &&Column| column.near_m > OPEN_M && !column.edge_m.is_finite();
        let open = || self.columns[self.whole.clone()].iter().filter(is_open);
        let (all, shown) = (open().count(), open().filter(|column| column.sees_floor_within(FLOOR_M)).count());
        (all > 0 && all * OPEN_OF >= self.whole.len()).then_some(shown * SHOWN_OF >= all)
    }

    /// How far ahead of the robot the camera sees the first floor between two places to its left, metres. None where it
    /// does not go on, level, from the floor on which the robot stands.
    #[must_use]
    pub fn level_floor_from_m(&self, right_m: f64, left_m: f64) -> Option<f64> {
        let columns = &self.columns[self.whole.clone()];
        // A column that shows no floor would show it about where the others do.
        let firsts = columns.iter().map(Column::first_floor_m).filter(|first_m| first_m.is_finite());
        let far_m = firsts.fold(0.0_f64, f64::max);
        let (mut from_m, mut level, mut all) = (0.0_f64, 0, 0);
        for column in columns {
            let first_m = column.first_floor_m().min(far_m);
            let at = self.now_from_stamped * self.place(first_m, column.left * first_m);
            if (right_m..=left_m).contains(&at.y) {
                all += 1;
                let is_level = column.is_level_from_first(self.height_m);
                level += usize::from(is_level);
                from_m = from_m.max(if is_level { at.x } else { 0.0 });
            }
        }
        (all >= LEVEL_MIN && level * LEVEL_OF >= all * (LEVEL_OF - 1)).then_some(from_m)
    }
}
