//! The depth camera's section.

use camera::Head;
use messages::{DepthHeader, Pose3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Source;
use crate::devices::{DeviceRow, Reach};
use crate::path::ConfigPath;
use crate::units::{Millis, Positive};

/// What a depth camera's frames come through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthDevice {
    /// A socket, at which a program that knows the camera hands them over.
    Socket,
    /// A GStreamer pipeline.
    Gstreamer,
    /// Intel's library, librealsense.
    Realsense,
}

impl DepthDevice {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Socket, Self::Gstreamer, Self::Realsense];

    /// What is known of it.
    #[must_use]
    pub fn row(self) -> &'static DeviceRow<DepthSettings> {
        match self {
            Self::Socket => &SOCKET,
            Self::Gstreamer => &GSTREAMER,
            Self::Realsense => &REALSENSE,
        }
    }
}

const SOCKET: DeviceRow<DepthSettings> = DeviceRow {
    name: "socket",
    doctor_name: "depth socket",
    reach: |depth| Reach::FrameSocket(&depth.socket.path),
    check: |_| Ok(()),
    emulated: Some(|settings, places| settings.depth.socket.path = places.camera_socket.clone().into()),
};

const GSTREAMER: DeviceRow<DepthSettings> = DeviceRow {
    name: "gstreamer",
    doctor_name: "depth camera",
    reach: |depth| Reach::Gstreamer(depth),
    check: DepthSettings::check_gstreamer,
    emulated: None,
};

const REALSENSE: DeviceRow<DepthSettings> = DeviceRow {
    name: "realsense",
    doctor_name: "depth camera",
    reach: |depth| Reach::DepthCamera(&depth.realsense),
    check: |_| Ok(()),
    emulated: None,
};

/// The depth camera and its driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DepthSettings {
    /// Where frames come from.
    pub source: Source,
    /// Which device, where they come from one.
    pub device: DepthDevice,
    /// Columns, at most 1280: what is asked of the device; a socket or a recorded file may give fewer.
    pub width: u32,
    /// Rows, at most 720.
    pub height: u32,
    /// Frames a second; what is asked of a RealSense.
    pub rate_hz: Positive,
    /// Horizontal field of view, degrees.
    pub field_of_view_deg: Positive,
    /// Nearest and farthest depth that the camera gives, and is believed at, metres.
    pub range_m: [f64; 2],
    /// Noise of the simulated camera: the intensity of a Redwood-type model, 0 to 10; 1 is that of the paper.
    pub redwood: f64,
    /// Where the camera is on the robot.
    #[schemars(with = "crate::schema::Pose3")]
    pub robot_from_camera: Pose3,
    /// Whether motion needs it.
    pub needed: bool,
    /// The frame socket, where that is the device.
    pub socket: DepthSocket,
    /// The pipeline, where that is the device.
    pub gstreamer: DepthGstreamer,
    /// The RealSense camera, where that is the device.
    pub realsense: Librealsense,
    /// The lens, for a device that does not tell it: frames of a GStreamer pipeline have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<DepthIntrinsics>,
}

impl Default for DepthSettings {
    fn default() -> Self {
        Self {
            source: Source::Simulated,
            device: DepthDevice::Socket,
            width: 640,
            height: 480,
            rate_hz: Positive::of(15.0),
            field_of_view_deg: Positive::of(90.0),
            range_m: [0.3, 10.0],
            redwood: 0.0,
            robot_from_camera: Pose3 { x_m: 0.25, y_m: 0.0, z_m: 0.45, yaw_rad: 0.0, pitch_rad: 0.0 },
            needed: true,
            socket: DepthSocket::default(),
            gstreamer: DepthGstreamer::default(),
            realsense: Librealsense::default(),
            intrinsics: None,
        }
    }
}

impl DepthSettings {
    /// What stands beside a frame's pixels, by the configuration: the lens where it is known, or else one of that field
    /// of view whose axis is in the middle.
    #[must_use]
    pub fn header(&self) -> DepthHeader {
        let [width, height] = [self.width, self.height].map(f64::from);
        let focal_px = 0.5 * width / (0.5 * self.field_of_view_deg.get().to_radians()).tan();
        let middle = |pixels: f64| (pixels - 1.0) / 2.0;
        let lens = self.intrinsics.map(|lens| [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px].map(f64::from));
        let [fx_px, fy_px, cx_px, cy_px] = lens.unwrap_or([focal_px, focal_px, middle(width), middle(height)]);
        DepthHeader {
            width: self.width,
            height: self.height,
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            robot_from_camera: self.robot_from_camera,
            ..DepthHeader::default()
        }
    }

    /// Nothing but the configuration tells what a pipeline's frames are.
    fn check_gstreamer(&self) -> Result<(), String> {
        if (self.source, self.device) != (Source::Device, DepthDevice::Gstreamer) {
            return Ok(());
        }
        if self.gstreamer.pipeline.trim().is_empty() {
            return Err("depth.gstreamer.pipeline is not given, and depth.device is \"gstreamer\"".to_owned());
        }
        if self.intrinsics.is_none() {
            let why = "a pipeline's frames do not tell their lens";
            return Err(format!("depth.intrinsics (fx_px, fy_px, cx_px, cy_px) is not given, and {why}"));
        }
        Ok(())
    }
}

/// The frame socket.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DepthSocket {
    /// Its path.
    pub path: ConfigPath,
}

impl Default for DepthSocket {
    fn default() -> Self {
        Self { path: ConfigPath::from("/run/guidedog/depth.sock") }
    }
}

/// A GStreamer pipeline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DepthGstreamer {
    /// As `gst-launch-1.0` takes it, without its sink: it has to give `video/x-raw,format=GRAY16_LE`.
    pub pipeline: String,
    /// What 1 stands for in a pixel, metres.
    pub unit_m: Positive,
    /// What lies between the light and the time that the pipeline gives a frame, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latency: Option<Millis>,
}

impl Default for DepthGstreamer {
    fn default() -> Self {
        Self { pipeline: String::new(), unit_m: Positive::of(0.001), latency: None }
    }
}

/// A RealSense camera, by its maker's library librealsense.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Librealsense {
    /// The library; where none is told, the loader looks for `librealsense2.so`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub library: Option<ConfigPath>,
    /// The camera's serial number; where none is told, the first that is found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// A file that the library has recorded, in a camera's place; it is played again and again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<ConfigPath>,
}

/// A lens, for frames of `depth.width` x `depth.height`; without distortion, as depth frames are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DepthIntrinsics {
    /// Focal length along the columns, pixels.
    pub fx_px: f32,
    /// Focal length along the rows, pixels.
    pub fy_px: f32,
    /// Column of the optical axis, pixels.
    pub cx_px: f32,
    /// Row of the optical axis, pixels.
    pub cy_px: f32,
}

impl DepthIntrinsics {
    /// What stands before the pixels of a frame that is seen through it; when that was taken is left open.
    #[must_use]
    pub fn head(&self, depth: &DepthSettings) -> Head {
        Head {
            taken_ns: 0,
            width: depth.width,
            height: depth.height,
            focal_px: [self.fx_px, self.fy_px],
            axis_px: [self.cx_px, self.cy_px],
        }
    }
}
