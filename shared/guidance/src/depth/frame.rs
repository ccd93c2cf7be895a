//! A depth frame, its lens and its pixels.

use messages::DepthHeader;

/// Rays that hardly lead ahead are skipped: their column is not defined.
pub(super) const AHEAD_MIN: f64 = 0.05;
/// A camera lower than this is counted as so high, metres: the spacing of rows on the floor has a bound.
const CAMERA_MIN_M: f64 = 0.1;
/// About this many columns are looked at, but every row: a bar across the way is thin in height.
const COLUMNS: usize = 160;
/// A pixel is an obstacle where the next one to the right or below is about as near; one alone is noise.
const AGREE_M: f64 = 0.10;
/// The same, as a share of the depth.
const AGREE_SHARE: f64 = 0.03;
/// In about this many rows floor is looked for.
const CELL_ROWS: usize = 120;

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

pub(super) fn check(header: &DepthHeader, pixels: usize) -> Result<(), DepthError> {
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

/// How far two rows of pixels of a camera of that height are apart on the floor at 1 m, metres.
pub(super) fn apart_at_1_m(header: &DepthHeader, camera_m: f64) -> f64 {
    1.0 / (header.fy_px * camera_m.max(CAMERA_MIN_M))
}

/// Step between the rows in which floor is looked for, pixels.
pub(super) fn cell_rows(header: &DepthHeader) -> usize {
    (header.height as usize / CELL_ROWS).max(1)
}

/// Step between the sampled columns, pixels.
pub(super) fn stride(header: &DepthHeader) -> usize {
    (header.width as usize / COLUMNS).max(1)
}

/// Tangent of the angle to the left of the camera's axis.
pub(super) fn left_of(header: &DepthHeader, u: usize) -> f64 {
    -(u as f64 - header.cx_px) / header.fx_px
}

/// Tangent of the angle above it.
pub(super) fn up_of(header: &DepthHeader, v: usize) -> f64 {
    -(v as f64 - header.cy_px) / header.fy_px
}

/// What all pixels of a row have in common: a depth of 1 m is so far along the floor, and so much higher than the
/// camera.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub along: f64,
    pub rise: f64,
    /// Tangent of its rays' elevation; those that hardly lead ahead have none.
    pub elevation: f64,
}

impl Row {
    /// A row of a camera with such a sine and cosine of its pitch: tilted down, its axis loses height with distance.
    pub fn of(header: &DepthHeader, v: usize, (sin, cos): (f64, f64)) -> Self {
        let up = up_of(header, v);
        let (along, rise) = (cos + up * sin, up * cos - sin);
        Self { along, rise, elevation: if along > AHEAD_MIN { rise / along } else { f64::NEG_INFINITY } }
    }
}

/// Two depths that differ by less are about the same, metres.
pub(super) fn near_m(depth_m: f64) -> f64 {
    AGREE_M + AGREE_SHARE * depth_m
}

/// Whether the next pixel to the right or below is about as near.
pub(super) fn agrees(pixels_mm: &[u16], width: usize, at: usize) -> bool {
    let depth_m = f64::from(pixels_mm[at]) / 1000.0;
    let near_m = near_m(depth_m);
    let is_near = |mm: &u16| (f64::from(*mm) / 1000.0 - depth_m).abs() <= near_m;
    let right = pixels_mm.get(at + 1).filter(|_| !(at + 1).is_multiple_of(width));
    right.is_some_and(is_near) || pixels_mm.get(at + width).is_some_and(is_near)
}
