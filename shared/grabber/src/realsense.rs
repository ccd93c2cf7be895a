//! Depth frames and poses of RealSense cameras by their maker's library, or of a file that it has recorded.
//!
//! Lens and unit are the library's word for each frame. A frame stays in the library's buffer until it is written to
//! shared memory; whether it was copied before is the library's affair.

mod ffi;
mod tracking;

use std::path::Path;

use camera::{Head, Raw};
use settings::{DepthSettings, Librealsense};
use transport::{monotonic_ns, unix_time_s};

use crate::{Frame, Grab, Trouble};
use ffi::{Rs2, Shot, Stream, Streaming, Wanted};

pub use tracking::{Tracked, TrackingCamera};

/// So long a frame is waited for at a time, milliseconds.
const WAIT_MS: u32 = 100;

/// A camera, or a file in its place.
#[derive(Debug)]
pub struct RealsenseCamera {
    streaming: Streaming,
    /// A file's frames are as old as the file.
    is_file: bool,
}

/// What of librealsense is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A depth camera.
    Depth,
    /// The tracking camera T265, which its maker's library knows no more since 2.54.
    Tracking,
}

impl Kind {
    /// Where its settings stand.
    fn key(self) -> &'static str {
        match self {
            Self::Depth => "depth.realsense",
            Self::Tracking => "odometry.t265",
        }
    }

    fn library(self) -> &'static str {
        match self {
            Self::Depth => "librealsense 2.43 or newer (apt: librealsense2)",
            Self::Tracking => "librealsense 2.43 to 2.53, which knows the T265",
        }
    }

    fn is_it(self, name: &str) -> bool {
        name.contains("T265") == (self == Self::Tracking)
    }
}

/// Looks what is plugged in, and starts nothing: what was found, in words.
///
/// # Errors
/// Where there is no library, no such camera or no such file.
pub fn check(kind: Kind, wanted: &Librealsense) -> Result<String, Trouble> {
    let rs2 = library(kind, wanted)?;
    if let Some(file) = &wanted.file {
        return check_file(kind, file).map(|()| format!("{} is there", file.display()));
    }
    let fix = "plug it in, into USB 3; the maker's udev rules let other users than root have it";
    let cameras = rs2.cameras().map_err(|why| Trouble::new(format!("cameras cannot be looked for: {why}"), fix))?;
    let is_it = |[name, serial]: &&[String; 2]| {
        kind.is_it(name) && wanted.serial.as_ref().is_none_or(|wanted| wanted == serial)
    };
    match cameras.iter().find(is_it) {
        Some([name, serial]) => Ok(format!("{name}, serial number {serial}; it was not started")),
        None => {
            let found = format!("no such camera among those plugged in ({})", cameras.len());
            Err(Trouble::new(found, format!("{fix}; it needs {}", kind.library())))
        }
    }
}

fn check_file(kind: Kind, file: &Path) -> Result<(), Trouble> {
    let found =
        || Trouble::new(format!("{} is no file", file.display()), format!("{}.file names a recorded one", kind.key()));
    if file.is_file() { Ok(()) } else { Err(found()) }
}

fn library(kind: Kind, wanted: &Librealsense) -> Result<&'static Rs2, Trouble> {
    let library = wanted.library.as_deref();
    Rs2::get(library).map_err(|why| {
        let found = format!("{} cannot be opened: {why}", ffi::place(library).display());
        Trouble::new(found, format!("install {}, or name it: {}.library", kind.library(), kind.key()))
    })
}

/// Starts it: what streams.
fn start(kind: Kind, stream: Stream, wanted: &Librealsense, fix: &str) -> Result<Streaming, Trouble> {
    let rs2 = library(kind, wanted)?;
    let which = match &wanted.file {
        Some(file) => {
            check_file(kind, file)?;
            Wanted::File(file)
        }
        None => Wanted::Live(wanted.serial.as_deref()),
    };
    Streaming::start(rs2, stream, which).map_err(|why| Trouble::new(format!("RealSense: {why}"), fix))
}

/// When something was taken, nanoseconds of the monotonic clock: as the library tells it in this machine's time of
/// day; where it tells none, or plays a file, when it came. Never in the future.
fn taken_ns(taken_ms: Option<f64>, is_file: bool) -> u64 {
    let (now_ns, now_ms) = (monotonic_ns(), unix_time_s() * 1e3);
    let age_ms = taken_ms.filter(|_| !is_file).map_or(0.0, |taken_ms| (now_ms - taken_ms).max(0.0));
    now_ns.saturating_sub((age_ms * 1e6) as u64)
}

impl RealsenseCamera {
    /// Starts it.
    ///
    /// # Errors
    /// Where there is no library, no such camera or file, or no such stream; why, and what to do.
    pub fn open(depth: &DepthSettings) -> Result<Self, Trouble> {
        let wanted = &depth.realsense;
        let size = match wanted.file {
            Some(_) => [0; 3],
            None => [depth.width, depth.height, depth.rate_hz.get().round() as u32],
        };
        let fix = "is it plugged in, free, and does it have depth.width, depth.height and depth.rate_hz?";
        let streaming = start(Kind::Depth, Stream::Depth(size), wanted, fix)?;
        Ok(Self { streaming, is_file: wanted.file.is_some() })
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
        let Some(shot) = self.streaming.next_depth(WAIT_MS).map_err(lost)? else { return Ok(None) };
        let lens = shot.lens;
        if lens.coefficients.iter().any(|coefficient| *coefficient != 0.0) {
            return Err(Trouble::new("the lens of its depth is not rectified", "this camera cannot be used"));
        }
        let [width, height] = lens.size.map(|size| u32::try_from(size).unwrap_or(0));
        let taken_ns = taken_ns(shot.taken_ms, self.is_file);
        let head = Head { taken_ns, width, height, focal_px: lens.focal_px, axis_px: lens.axis_px };
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
