//! Depth frames of a RealSense camera by its maker's library, or of a file that it has recorded.
//!
//! Lens and unit are the library's word for each frame. A frame stays in the library's buffer until it is written to
//! shared memory; whether it was copied before is the library's affair.

mod ffi;

use std::path::Path;

use camera::{Head, Raw};
use settings::{DepthRealsense, DepthSettings};
use transport::{monotonic_ns, unix_time_s};

use crate::{Frame, Grab, Trouble};
use ffi::{Rs2, Shot, Streaming, Wanted};

/// So long a frame is waited for at a time, milliseconds.
const WAIT_MS: u32 = 100;

/// A camera, or a file in its place.
#[derive(Debug)]
pub struct RealsenseCamera {
    streaming: Streaming,
    /// A file's frames are as old as the file.
    is_file: bool,
}

/// Looks what is plugged in, and starts nothing: what was found, in words.
///
/// # Errors
/// Where there is no library, no such camera or no such file.
pub fn check(depth: &DepthSettings) -> Result<String, Trouble> {
    let (wanted, rs2) = (&depth.realsense, library(&depth.realsense)?);
    if let Some(file) = &wanted.file {
        return check_file(file).map(|()| format!("{} is there", file.display()));
    }
    let fix = "plug it in, into USB 3; the maker's udev rules let other users than root have it";
    let cameras = rs2.cameras().map_err(|why| Trouble::new(format!("cameras cannot be looked for: {why}"), fix))?;
    let is_it = |[_, serial]: &&[String; 2]| wanted.serial.as_ref().is_none_or(|wanted| wanted == serial);
    match cameras.iter().find(is_it) {
        Some([name, serial]) => Ok(format!("{name}, serial number {serial}; it was not started")),
        None => Err(Trouble::new(format!("no such camera among those plugged in ({})", cameras.len()), fix)),
    }
}

fn check_file(file: &Path) -> Result<(), Trouble> {
    let found = || Trouble::new(format!("{} is no file", file.display()), "depth.realsense.file names a recorded one");
    if file.is_file() { Ok(()) } else { Err(found()) }
}

fn library(wanted: &DepthRealsense) -> Result<&'static Rs2, Trouble> {
    let library = wanted.library.as_deref();
    Rs2::get(library).map_err(|why| {
        let found = format!("{} cannot be opened: {why}", ffi::place(library).display());
        Trouble::new(
            found,
            "install librealsense 2.43 or newer (apt: librealsense2), or name it: depth.realsense.library",
        )
    })
}

impl RealsenseCamera {
    /// Starts it.
    ///
    /// # Errors
    /// Where there is no library, no such camera or file, or no such stream; why, and what to do.
    pub fn open(depth: &DepthSettings) -> Result<Self, Trouble> {
        let (wanted, rs2) = (&depth.realsense, library(&depth.realsense)?);
        let stream = match &wanted.file {
            Some(file) => {
                check_file(file)?;
                Wanted::File(file)
            }
            None => {
                Wanted::Live([depth.width, depth.height, depth.rate_hz.get().round() as u32], wanted.serial.as_deref())
            }
        };
        let streaming = Streaming::start(rs2, stream).map_err(|why| {
            let fix = "is it plugged in, free, and does it have depth.width, depth.height and depth.rate_hz?";
            Trouble::new(format!("RealSense: {why}"), fix)
        })?;
        Ok(Self { streaming, is_file: wanted.file.is_some() })
    }

    /// When it was taken, nanoseconds of the monotonic clock: as the library tells it in this machine's time of day;
    /// where it tells none, or plays a file, when it came. Never in the future.
    fn taken_ns(&self, shot: &Shot) -> u64 {
        let (now_ns, now_ms) = (monotonic_ns(), unix_time_s() * 1e3);
        let age_ms = shot.taken_ms.filter(|_| !self.is_file).map_or(0.0, |taken_ms| (now_ms - taken_ms).max(0.0));
        now_ns.saturating_sub((age_ms * 1e6) as u64)
    }
}

impl Grab for RealsenseCamera {
    type Item = Box<dyn Frame>;

    fn about(&self) -> String {
        let [name, serial] = &self.streaming.about;
        format!("{name}, serial number {serial}")
    }

    fn grab(&mut self) -> Result<Option<Self::Item>, Trouble> {
        let lost = |why| Trouble::new(format!("RealSense: {why}"), "it is opened anew");
        let Some(shot) = self.streaming.next(WAIT_MS).map_err(lost)? else { return Ok(None) };
        let lens = shot.lens;
        if lens.coefficients.iter().any(|coefficient| *coefficient != 0.0) {
            return Err(Trouble::new("the lens of its depth is not rectified", "this camera cannot be used"));
        }
        let [width, height] = lens.size.map(|size| u32::try_from(size).unwrap_or(0));
        let head =
            Head { taken_ns: self.taken_ns(&shot), width, height, focal_px: lens.focal_px, axis_px: lens.axis_px };
        head.check().map_err(|refused| lost(refused.to_string()))?;
        if !(1e-5..=0.01).contains(&shot.unit_m) {
            return Err(lost(format!("a unit of {} m is none", shot.unit_m)));
        }
        Ok(Some(Box::new(RealsenseFrame { shot, head })))
    }
}

/// A frame in the library's buffer.
struct RealsenseFrame {
    shot: Shot,
    head: Head,
}

impl Frame for RealsenseFrame {
    fn head(&self) -> Head {
        self.head
    }

    fn raw(&self) -> Raw<'_> {
        Raw { bytes: self.shot.bytes(), row_bytes: self.shot.row_bytes, unit_mm: self.shot.unit_m * 1000.0 }
    }
}
