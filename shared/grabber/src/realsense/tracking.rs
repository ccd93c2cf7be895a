//! Poses of the tracking camera T265.

use settings::Librealsense;

use super::ffi::{Stream, Streaming};
use super::{Kind, WAIT_MS, start, taken_ns};
use crate::{Grab, Trouble};

/// From one pose that is handed over to the next, nanoseconds: it gives 200 a second, which nobody needs.
const PERIOD_NS: u64 = 9_000_000;

/// A pose of the camera by its own axes: x right, y up, z backward; the frame begins where the camera did, level.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tracked {
    /// When it was, nanoseconds of the monotonic clock.
    pub taken_ns: u64,
    /// Place, metres.
    pub place_m: [f32; 3],
    /// Rotation, a unit quaternion: x, y, z, w.
    pub rotation: [f32; 4],
    /// Velocity in that frame, metres per second.
    pub velocity_mps: [f32; 3],
    /// Angular velocity in that frame, radians per second.
    pub turn_radps: [f32; 3],
    /// How sure it is: 0 (it is lost) to 3.
    pub confidence: u32,
}

/// A T265, or a file in its place.
#[derive(Debug)]
pub struct TrackingCamera {
    streaming: Streaming,
    is_file: bool,
    handed_ns: u64,
}

impl TrackingCamera {
    /// Starts it.
    ///
    /// # Errors
    /// Where there is no library, no such camera or file, or no poses in it; why, and what to do.
    pub fn open(wanted: &Librealsense) -> Result<Self, Trouble> {
        let fix = format!("is it plugged in, and free? It needs {}", Kind::Tracking.library());
        let streaming = start(Kind::Tracking, Stream::Pose, wanted, &fix)?;
        Ok(Self { streaming, is_file: wanted.file.is_some(), handed_ns: 0 })
    }
}

impl Grab for TrackingCamera {
    type Item = Tracked;

    fn about(&self) -> String {
        let [name, serial] = &self.streaming.about;
        format!("{name}, serial number {serial}")
    }

    fn grab(&mut self) -> Result<Option<Tracked>, Trouble> {
        let lost = |why| Trouble::new(format!("RealSense: {why}"), "it is opened anew");
        let Some((pose, taken_ms)) = self.streaming.next_pose(WAIT_MS).map_err(lost)? else { return Ok(None) };
        let taken_ns = taken_ns(taken_ms, self.is_file);
        if taken_ns < self.handed_ns + PERIOD_NS {
            return Ok(None);
        }
        self.handed_ns = taken_ns;
        Ok(Some(Tracked {
            taken_ns,
            place_m: pose.place_m,
            rotation: pose.rotation,
            velocity_mps: pose.velocity_mps,
            turn_radps: pose.turn_radps,
            confidence: pose.confidence,
        }))
    }
}
