//! Depth frames as the depth driver's frame socket takes them: how any program that knows a camera (the maker's own
//! library, a script) hands its frames over. Pure.
//!
//! The driver listens at a Unix stream socket (`depth.socket.path`), and one program at a time is connected. A frame is
//! a head of 40 bytes and then its pixels, everything in the machine's own byte order:
//!
//! | bytes | what |
//! |---|---|
//! | 0..8 | `GDDEPTH1` |
//! | 8..16 | u64: when it was taken, nanoseconds of `CLOCK_MONOTONIC` |
//! | 16..20 | u32: columns, to 1280 |
//! | 20..24 | u32: rows, to 720 |
//! | 24..40 | f32 four times: focal lengths along columns and rows, column and row of the optical axis, pixels |
//! | 40.. | u16 for each pixel, row by row from the top: depth along the optical axis, millimetres; 0 = none |
//!
//! Nothing is answered. Who sends what is no frame is cut off, and may connect again.
//!
//! What the driver takes from a camera's library itself has the same head, and its pixels are [`Raw`].

mod raw;

use messages::{DepthHeader, Pose3};

pub use raw::Raw;

/// What every frame begins with.
const MAGIC: [u8; 8] = *b"GDDEPTH1";
/// Bytes before the pixels.
pub const HEAD_BYTES: usize = 40;
/// The most columns and rows of a frame.
const SIZE_MAX: [u32; 2] = [1280, 720];
/// No lens has a longer focal length, pixels.
const FOCAL_MAX_PX: f32 = 100_000.0;

/// Why bytes are no frame.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refused {
    /// It begins otherwise.
    #[error("what comes is no depth frame: it does not begin with GDDEPTH1")]
    NoFrame,
    /// It has no pixels, or too many.
    #[error("a frame of {width} x {height} pixels: 1 x 1 to 1280 x 720 are taken")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Its pixels are not all there.
    #[error("a frame of {width} x {height} pixels does not have {bytes} bytes")]
    Bytes {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Of its pixels.
        bytes: usize,
    },
    /// Its lens is none.
    #[error("a frame with focal lengths {fx_px}, {fy_px} and optical axis {cx_px}, {cy_px} px: no camera is like that")]
    Lens {
        /// Focal length along the columns.
        fx_px: f32,
        /// Focal length along the rows.
        fy_px: f32,
        /// Column of the optical axis.
        cx_px: f32,
        /// Row of the optical axis.
        cy_px: f32,
    },
}

/// What stands before the pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    /// When it was taken, nanoseconds of the machine's monotonic clock.
    pub taken_ns: u64,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal lengths along columns and rows, pixels.
    pub focal_px: [f32; 2],
    /// Column and row of the optical axis, pixels.
    pub axis_px: [f32; 2],
}

impl Head {
    /// Reads it.
    ///
    /// # Errors
    /// Where it is none, or that of a frame that no camera takes.
    pub fn read(bytes: &[u8; HEAD_BYTES]) -> Result<Self, Refused> {
        let four = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        let mut eight = [0; 8];
        eight.copy_from_slice(&bytes[..8]);
        if eight != MAGIC {
            return Err(Refused::NoFrame);
        }
        eight.copy_from_slice(&bytes[8..16]);
        let head = Self {
            taken_ns: u64::from_ne_bytes(eight),
            width: u32::from_ne_bytes(four(16)),
            height: u32::from_ne_bytes(four(20)),
            focal_px: [24, 28].map(|at| f32::from_ne_bytes(four(at))),
            axis_px: [32, 36].map(|at| f32::from_ne_bytes(four(at))),
        };
        head.check().map(|()| head)
    }

    /// Writes it.
    #[must_use]
    pub fn bytes(&self) -> [u8; HEAD_BYTES] {
        let mut bytes = [0; HEAD_BYTES];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..16].copy_from_slice(&self.taken_ns.to_ne_bytes());
        let words = [self.width, self.height].map(u32::to_ne_bytes).into_iter();
        let lens = self.focal_px.into_iter().chain(self.axis_px).map(f32::to_ne_bytes);
        for (place, word) in bytes[16..].chunks_exact_mut(4).zip(words.chain(lens)) {
            place.copy_from_slice(&word);
        }
        bytes
    }

    /// How many there are: to 921,600.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// What stands beside the pixels in shared memory; the header is left for the publisher.
    #[must_use]
    pub fn depth_header(&self, robot_from_camera: Pose3) -> DepthHeader {
        DepthHeader {
            width: self.width,
            height: self.height,
            fx_px: self.focal_px[0].into(),
            fy_px: self.focal_px[1].into(),
            cx_px: self.axis_px[0].into(),
            cy_px: self.axis_px[1].into(),
            robot_from_camera,
            ..DepthHeader::default()
        }
    }

    /// Whether a camera takes such frames.
    ///
    /// # Errors
    /// Where none does.
    pub fn check(&self) -> Result<(), Refused> {
        let Self { width, height, focal_px: [fx_px, fy_px], axis_px: [cx_px, cy_px], .. } = *self;
        if !(1..=SIZE_MAX[0]).contains(&width) || !(1..=SIZE_MAX[1]).contains(&height) {
            return Err(Refused::Size { width, height });
        }
        let is_focal = |focal_px: f32| (1.0..=FOCAL_MAX_PX).contains(&focal_px);
        // A part that was cut out of a picture may lie beside the axis, but not anywhere.
        let is_near = |axis_px: f32, size: u32| axis_px.abs() <= 4.0 * size as f32;
        if is_focal(fx_px) && is_focal(fy_px) && is_near(cx_px, width) && is_near(cy_px, height) {
            return Ok(());
        }
        Err(Refused::Lens { fx_px, fy_px, cx_px, cy_px })
    }
}

/// Between which depths a camera is believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trust {
    /// Nearer is no reading, millimetres.
    pub near_mm: u16,
    /// Farther is no reading, millimetres.
    pub far_mm: u16,
}

impl Trust {
    /// Between these, metres.
    #[must_use]
    pub fn of_m([near_m, far_m]: [f64; 2]) -> Self {
        // Rounded to where less is believed; what is no u16 saturates.
        Self { near_mm: (near_m * 1000.0).ceil() as u16, far_mm: (far_m * 1000.0).floor() as u16 }
    }

    /// Makes everything else no reading.
    pub fn apply(self, pixels_mm: &mut [u16]) {
        for pixel_mm in pixels_mm {
            *pixel_mm = self.of_mm(*pixel_mm);
        }
    }

    /// The same of one.
    pub(crate) fn of_mm(self, pixel_mm: u16) -> u16 {
        if (self.near_mm..=self.far_mm).contains(&pixel_mm) { pixel_mm } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::{HEAD_BYTES, Head, Refused, Trust};

    fn head() -> Head {
        Head { taken_ns: 7, width: 640, height: 480, focal_px: [380.0, 381.0], axis_px: [319.5, 239.5] }
    }

    #[test]
    fn a_head_comes_back_as_it_was() {
        assert_eq!(Head::read(&head().bytes()), Ok(head()));
        assert_eq!(head().pixels(), 307_200);
        let beside = head().depth_header(messages::Pose3::default());
        assert_eq!((beside.width, beside.fy_px, beside.cx_px), (640, 381.0, 319.5));
    }

    #[test]
    fn what_is_no_frame_is_refused_and_named() {
        assert_eq!(Head::read(&[b'G'; HEAD_BYTES]), Err(Refused::NoFrame));
        let wide = Head { width: 1281, ..head() };
        assert_eq!(Head::read(&wide.bytes()), Err(Refused::Size { width: 1281, height: 480 }));
        for wrong in [
            Head { height: 0, ..head() },
            Head { width: u32::MAX, height: u32::MAX, ..head() },
            Head { focal_px: [f32::NAN, 380.0], ..head() },
            Head { focal_px: [380.0, 0.0], ..head() },
            Head { axis_px: [6400.0, 240.0], ..head() },
            Head { axis_px: [320.0, f32::INFINITY], ..head() },
        ] {
            assert!(Head::read(&wrong.bytes()).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_camera_is_believed_within_its_range() {
        let mut pixels_mm = [0, 299, 300, 4321, 10_000, 10_001, u16::MAX];
        Trust::of_m([0.3, 10.0]).apply(&mut pixels_mm);
        assert_eq!(pixels_mm, [0, 0, 300, 4321, 10_000, 0, 0]);
    }
}
