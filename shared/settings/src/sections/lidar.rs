//! The lidar's section.

use messages::Pose2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Settings, Source};
use crate::devices::{DeviceRow, Reach, check_baud, is_default};
use crate::emulated::EmulatedPlaces;
use crate::path::ConfigPath;
use crate::units::{Positive, Share};

/// Which lidar gives scans.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LidarDevice {
    /// An RPLIDAR at a serial line.
    #[default]
    Rplidar,
}

impl LidarDevice {
    /// All of them.
    pub const ALL: [Self; 1] = [Self::Rplidar];

    /// What is known of it.
    #[must_use]
    pub fn row(self) -> &'static DeviceRow<LidarSettings> {
        match self {
            Self::Rplidar => &RPLIDAR,
        }
    }
}

const RPLIDAR: DeviceRow<LidarSettings> = DeviceRow {
    name: "rplidar",
    doctor_name: "lidar",
    reach: |lidar| Reach::SerialPort { path: &lidar.rplidar.port, baud: lidar.rplidar.baud },
    check: |lidar| lidar.rplidar.check(),
    emulated: Some(place_rplidar),
};

fn place_rplidar(settings: &mut Settings, places: &EmulatedPlaces) {
    let lidar = &mut settings.lidar.rplidar;
    lidar.port = places.lidar_port.clone().into();
    lidar.baud.get_or_insert(settings.simulation.emulated.rplidar.baud());
}

/// The lidar and its driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LidarSettings {
    /// Where scans come from.
    pub source: Source,
    /// Which device, where they come from one.
    #[serde(skip_serializing_if = "is_default")]
    pub device: LidarDevice,
    /// Beams of a scan.
    pub beams: u32,
    /// Field of view, degrees, centred on the lidar's x axis.
    pub field_of_view_deg: Positive,
    /// Scans a second; a real robot needs 8 or more.
    pub rate_hz: Positive,
    /// Readings under it are unknown, metres.
    pub range_min_m: Positive,
    /// Readings at or over it hit nothing, metres.
    pub range_max_m: Positive,
    /// One standard deviation of a reading, metres.
    pub sigma_m: f64,
    /// Share of beams that give nothing.
    pub drop_out: Share,
    /// Height of the lidar's plane above the floor, metres.
    pub height_m: Positive,
    /// Where the lidar is on the robot.
    #[schemars(with = "crate::schema::Pose2")]
    pub robot_from_lidar: Pose2,
    /// How far the plane of a second lidar looks down, degrees. The first one's is level.
    #[serde(skip_serializing_if = "is_default")]
    pub pitch_deg: f64,
    /// The RPLIDAR, where that is the device.
    pub rplidar: RplidarSettings,
    /// A second lidar, which looks where the first does not: back, down, or near the floor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second: Option<Box<LidarSettings>>,
}

impl Default for LidarSettings {
    fn default() -> Self {
        Self {
            source: Source::Simulated,
            device: LidarDevice::Rplidar,
            beams: 360,
            field_of_view_deg: Positive::of(360.0),
            rate_hz: Positive::of(10.0),
            range_min_m: Positive::of(0.15),
            range_max_m: Positive::of(12.0),
            sigma_m: 0.025,
            drop_out: Share::of(0.005),
            height_m: Positive::of(0.35),
            robot_from_lidar: Pose2::new(0.0, 0.0, 0.0),
            pitch_deg: 0.0,
            rplidar: RplidarSettings::default(),
            second: None,
        }
    }
}

/// An RPLIDAR at a serial line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RplidarSettings {
    /// Its port.
    pub port: ConfigPath,
    /// Bits a second; where none is told, the speeds of all series are tried in turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Its scan mode, by its maker's name; where none is told, the one that the lidar advises.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<String>,
    /// Turns a minute, of those whose motor obeys such a wish.
    pub motor_rpm: u16,
}

impl Default for RplidarSettings {
    fn default() -> Self {
        Self { port: ConfigPath::from("/dev/rplidar"), baud: None, mode: None, motor_rpm: 600 }
    }
}

/// Turns a minute: under 8 a second permits run out between two scans, and none of these lidars turns faster.
const MOTOR_RPMS: std::ops::RangeInclusive<u16> = 480..=1_200;

impl RplidarSettings {
    fn check(&self) -> Result<(), String> {
        self.baud.map_or(Ok(()), |baud| check_baud("lidar.rplidar.baud", baud))?;
        if !MOTOR_RPMS.contains(&self.motor_rpm) {
            let (from, to, rpm) = (MOTOR_RPMS.start(), MOTOR_RPMS.end(), self.motor_rpm);
            return Err(format!("lidar.rplidar.motor_rpm = {rpm} is not in {from}..{to}"));
        }
        if self.mode.as_ref().is_some_and(|mode| mode.trim().is_empty()) {
            return Err("lidar.rplidar.mode is empty: leave it out for the mode that the lidar advises".to_owned());
        }
        Ok(())
    }
}
