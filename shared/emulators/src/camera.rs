//! A depth camera at the driver's socket, as a program with a maker's library would be.

use std::collections::VecDeque;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

use camera::Head;
use messages::fault::DELAY_NS;
use messages::{DepthHeader, Fault};
use world::{ConfigError, DepthConfig, DepthSensor, Scene};
use zerocopy::IntoBytes;

/// Whoever does not read for so long is left.
const PATIENCE: Duration = Duration::from_millis(500);

/// A camera that hands its frames over at a path, as soon as somebody listens there.
#[derive(Debug)]
pub struct EmulatedCamera {
    path: PathBuf,
    sensor: DepthSensor,
    stream: Option<UnixStream>,
    fault: Option<Fault>,
    pixels_mm: Vec<u16>,
    /// Frames on their way, each with the time at which it comes out, nanoseconds of the monotonic clock.
    on_way: VecDeque<(u64, Vec<u8>)>,
}

impl EmulatedCamera {
    /// A camera whose noise is drawn by `seed`.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds.
    pub fn new(path: PathBuf, config: DepthConfig, seed: u64) -> Result<Self, ConfigError> {
        let sensor = DepthSensor::new(config, seed, 1)?;
        let pixels_mm = vec![0; sensor.pixels()];
        Ok(Self { path, sensor, stream: None, fault: None, pixels_mm, on_way: VecDeque::new() })
    }

    /// From now on that goes wrong with it.
    pub fn suffer(&mut self, fault: Option<Fault>) {
        if fault == Some(Fault::Unplugged) {
            self.stream = None;
        }
        if fault != Some(Fault::Delayed) {
            self.on_way.clear();
        }
        self.fault = fault;
    }

    /// Takes a frame at `taken_ns` of the monotonic clock; `number` numbers them: each has noise of its own.
    pub fn take(&mut self, scene: &Scene<'_>, number: u64, taken_ns: u64) {
        let mut pixels_mm = std::mem::take(&mut self.pixels_mm);
        self.sensor.render(scene, number, &mut pixels_mm);
        self.take_seen(&self.sensor.depth_header(), &pixels_mm, taken_ns);
        self.pixels_mm = pixels_mm;
    }

    /// Takes a frame that was seen through that lens at `taken_ns` of the monotonic clock: depths in millimetres, noise
    /// included, row by row.
    pub fn take_seen(&mut self, lens: &DepthHeader, pixels_mm: &[u16], taken_ns: u64) {
        if matches!(self.fault, Some(Fault::Unplugged | Fault::Silent)) {
            return;
        }
        let head = Head {
            taken_ns,
            width: lens.width,
            height: lens.height,
            focal_px: [lens.fx_px as f32, lens.fy_px as f32],
            axis_px: [lens.cx_px as f32, lens.cy_px as f32],
        };
        let delay_ns = if self.fault == Some(Fault::Delayed) { DELAY_NS } else { 0 };
        self.on_way.push_back((taken_ns + delay_ns, [&head.bytes()[..], pixels_mm.as_bytes()].concat()));
    }

    /// Sends what is due. Where nobody listens, it is lost.
    pub fn serve(&mut self, monotonic_ns: u64) {
        while self.on_way.front().is_some_and(|(out_ns, _)| *out_ns <= monotonic_ns) {
            let Some((_, frame)) = self.on_way.pop_front() else { return };
            if self.stream.is_none() {
                self.stream = UnixStream::connect(&self.path).ok();
            }
            let Some(stream) = &mut self.stream else { continue };
            let sent = stream.set_write_timeout(Some(PATIENCE)).and_then(|()| stream.write_all(&frame));
            if sent.is_err() {
                self.stream = None;
            }
        }
    }
}
