//! The lidar's section.

use messages::Pose2;
use serde::{Deserialize, Serialize};

use super::Source;
use crate::path::ConfigPath;
use crate::units::{Positive, Share};

/// The lidar and its driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarSettings {
    /// Where scans come from.
    pub source: Source,
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
    pub robot_from_lidar: Pose2,
    /// The RPLIDAR, where scans come from a device.
    pub rplidar: RplidarSettings,
}

impl Default for LidarSettings {
    fn default() -> Self {
        Self {
            source: Source::Simulated,
            beams: 360,
            field_of_view_deg: Positive::of(360.0),
            rate_hz: Positive::of(10.0),
            range_min_m: Positive::of(0.15),
            range_max_m: Positive::of(12.0),
            sigma_m: 0.025,
            drop_out: Share::of(0.005),
            height_m: Positive::of(0.35),
            robot_from_lidar: Pose2::new(0.0, 0.0, 0.0),
            rplidar: RplidarSettings::default(),
        }
    }
}

/// An RPLIDAR at a serial line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
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
