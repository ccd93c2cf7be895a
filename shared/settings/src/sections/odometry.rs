//! The odometry driver's section.

use guidance::Disc;
use matching::{CorrectedConfig, LegNoise, MatcherConfig};
use messages::Pose3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Librealsense, Source};
use crate::devices::{DeviceRow, Reach};
use crate::units::Positive;

/// Which device gives poses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OdometryDevice {
    /// The robot itself, over its link.
    #[default]
    Robot,
    /// Intel's tracking camera T265, by librealsense.
    T265,
}

impl OdometryDevice {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Robot, Self::T265];

    /// What is known of it.
    #[must_use]
    pub fn row(self) -> &'static DeviceRow<OdometrySettings> {
        match self {
            Self::Robot => &ROBOT,
            Self::T265 => &T265,
        }
    }
}

/// Its link is a device by itself, with a place of its own.
const ROBOT: DeviceRow<OdometrySettings> = DeviceRow {
    name: "robot",
    doctor_name: "odometry",
    reach: |_| Reach::Nothing,
    check: |_| Ok(()),
    emulated: Some(|_, _| ()),
};

const T265: DeviceRow<OdometrySettings> = DeviceRow {
    name: "t265",
    doctor_name: "tracking camera",
    reach: |odometry| Reach::TrackingCamera(&odometry.t265),
    check: |_| Ok(()),
    emulated: None,
};

/// How roll, pitch and height of the body are known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum AttitudeSource {
    /// The source of the poses tells them.
    #[default]
    Told,
    /// The odometry driver finds them in depth images.
    Depth,
}

impl AttitudeSource {
    /// Its name in the settings.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Told => "told",
            Self::Depth => "depth",
        }
    }
}

/// The odometry driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OdometrySettings {
    /// Where poses come from.
    pub source: Source,
    /// Which device, where they come from one.
    pub device: OdometryDevice,
    /// Poses a second, at most 100 in this version.
    pub rate_hz: Positive,
    /// Where the body's attitude comes from.
    pub attitude: AttitudeSource,
    /// Drift of the simulated odometry: one standard deviation of its scale, drawn once for each incarnation.
    pub scale_sigma: f64,
    /// Drift of the simulated odometry: one standard deviation of the yaw after 1 m, radians.
    pub yaw_walk_rad_per_sqrt_m: f64,
    /// Lasting error of the simulated roll and pitch, drawn up to this for each incarnation, degrees.
    pub attitude_bias_deg: f64,
    /// Error of each of their readings: one standard deviation, degrees.
    pub attitude_sigma_deg: f64,
    /// Its correction by lidar scans.
    pub matching: MatchingSettings,
    /// The tracking camera.
    pub t265: Librealsense,
    /// Where the tracking camera is on the robot, and how it looks.
    #[schemars(with = "crate::schema::Pose3")]
    pub robot_from_camera: Pose3,
}

impl Default for OdometrySettings {
    fn default() -> Self {
        Self {
            source: Source::Simulated,
            device: OdometryDevice::Robot,
            rate_hz: Positive::of(50.0),
            attitude: AttitudeSource::Told,
            scale_sigma: 0.01,
            yaw_walk_rad_per_sqrt_m: 0.01,
            attitude_bias_deg: 0.0,
            attitude_sigma_deg: 0.0,
            matching: MatchingSettings::default(),
            t265: Librealsense::default(),
            robot_from_camera: Pose3::default(),
        }
    }
}

/// Odometry corrected by lidar scan matching.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MatchingSettings {
    /// Whether it is; without it, where the robot's own odometry is read.
    pub on: Option<bool>,
    /// How far off the source's odometry may be after 1 m, one standard deviation: of the place, metres,
    pub place_sigma_m: Positive,
    /// of the heading, radians,
    pub yaw_sigma_rad: Positive,
    /// and of the heading after a turn of 1 rad, radians. All grow with the root of way and turn.
    pub turn_sigma_rad: Positive,
    /// Corrections come into the pose at most so fast, metres per second,
    pub feed_mps: Positive,
    /// and radians per second.
    pub feed_radps: Positive,
}

impl Default for MatchingSettings {
    fn default() -> Self {
        Self {
            on: None,
            place_sigma_m: Positive::of(0.15),
            yaw_sigma_rad: Positive::of(0.1),
            turn_sigma_rad: Positive::of(0.4),
            feed_mps: Positive::of(0.05),
            feed_radps: Positive::of(0.1),
        }
    }
}

impl MatchingSettings {
    /// As the matcher has it; `left_out` is what moves with the robot.
    #[must_use]
    pub fn config(&self, left_out: Vec<Disc>) -> CorrectedConfig {
        let legs = LegNoise {
            place_m_per_sqrt_m: self.place_sigma_m.get(),
            yaw_rad_per_sqrt_m: self.yaw_sigma_rad.get(),
            yaw_rad_per_sqrt_rad: self.turn_sigma_rad.get(),
        };
        let matcher = MatcherConfig { legs, left_out };
        CorrectedConfig { matcher, feed_mps: self.feed_mps.get(), feed_radps: self.feed_radps.get() }
    }
}
