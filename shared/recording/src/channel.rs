//! The channels of a recording: one row for each topic that can be recorded.

use messages::{MAX_BEAMS, Odometry, ScanHeader, TopicId};
use serde::{Deserialize, Serialize};

use crate::Record;
use crate::json::{HeaderJson, Pose, PoseJson, Quaternion, Reading, Real, Time, TwistJson, Vector3};

/// MCAP's name for the encoding of every channel.
pub const MESSAGE_ENCODING: &str = "json";

/// MCAP's name for the encoding of every schema.
pub const SCHEMA_ENCODING: &str = "jsonschema";

/// How one topic is recorded.
#[derive(Debug)]
pub struct Channel {
    /// Which topic; its name is the channel's.
    pub topic: TopicId,
    /// Foxglove's name of the schema.
    pub schema_name: &'static str,
    /// The schema.
    pub schema: &'static str,
    /// From a message's JSON.
    pub decode: fn(&[u8]) -> Result<Record, String>,
}

/// Every channel.
pub const CHANNELS: [Channel; 2] = [
    Channel {
        topic: TopicId::LidarScan,
        schema_name: "foxglove.LaserScan",
        schema: include_str!("../schemas/laser_scan.json"),
        decode: decode_scan,
    },
    Channel {
        topic: TopicId::Odometry,
        schema_name: "foxglove.FrameTransform",
        schema: include_str!("../schemas/frame_transform.json"),
        decode: decode_odometry,
    },
];

/// A record as its channel's JSON, written over `json`; the error says what cannot be recorded.
pub fn encode(record: &Record, json: &mut Vec<u8>) -> Result<(), String> {
    json.clear();
    let written = match record {
        Record::Scan { ranges_m, .. } if ranges_m.len() > MAX_BEAMS => {
            return Err(format!("{} ranges, over the most of {MAX_BEAMS}", ranges_m.len()));
        }
        Record::Scan { header, ranges_m } => serde_json::to_writer(json, &ScanMessage::new(header, ranges_m)),
        Record::Odometry(odometry) => serde_json::to_writer(json, &OdometryMessage::new(odometry)),
    };
    written.map_err(|error| error.to_string())
}

/// The members that viewers read follow from `ranges` and `guidedog`, so they are written and never read back.
#[derive(Serialize, Deserialize)]
struct ScanMessage {
    #[serde(skip_deserializing)]
    timestamp: Time,
    #[serde(skip_deserializing)]
    frame_id: &'static str,
    #[serde(skip_deserializing)]
    pose: Pose,
    #[serde(skip_deserializing)]
    start_angle: Real,
    #[serde(skip_deserializing)]
    end_angle: Real,
    ranges: Vec<Reading>,
    #[serde(skip_deserializing)]
    intensities: [f32; 0],
    guidedog: ScanJson,
}

#[derive(Serialize, Deserialize)]
struct ScanJson {
    #[serde(flatten)]
    header: HeaderJson,
    angle_min_rad: Real,
    angle_increment_rad: Real,
    range_min_m: Real,
    range_max_m: Real,
    sigma_m: Real,
    robot_from_lidar: PoseJson,
}

impl ScanMessage {
    fn new(scan: &ScanHeader, ranges_m: &[f32]) -> Self {
        let span_rad = scan.angle_increment_rad * ranges_m.len().saturating_sub(1) as f64;
        Self {
            timestamp: Time::from_ns(scan.header.stamp_ns),
            frame_id: "robot",
            pose: scan.robot_from_lidar.into(),
            start_angle: Real(scan.angle_min_rad),
            end_angle: Real(scan.angle_min_rad + span_rad),
            ranges: ranges_m.iter().copied().map(Reading).collect(),
            intensities: [],
            guidedog: ScanJson {
                header: scan.header.into(),
                angle_min_rad: Real(scan.angle_min_rad),
                angle_increment_rad: Real(scan.angle_increment_rad),
                range_min_m: Real(scan.range_min_m),
                range_max_m: Real(scan.range_max_m),
                sigma_m: Real(scan.sigma_m),
                robot_from_lidar: scan.robot_from_lidar.into(),
            },
        }
    }
}

fn decode_scan(json: &[u8]) -> Result<Record, String> {
    let message: ScanMessage = serde_json::from_slice(json).map_err(|error| error.to_string())?;
    if message.ranges.len() > MAX_BEAMS {
        return Err(format!("{} ranges, over the most of {MAX_BEAMS}", message.ranges.len()));
    }
    let scan = message.guidedog;
    Ok(Record::Scan {
        header: ScanHeader {
            header: scan.header.into(),
            angle_min_rad: scan.angle_min_rad.0,
            angle_increment_rad: scan.angle_increment_rad.0,
            range_min_m: scan.range_min_m.0,
            range_max_m: scan.range_max_m.0,
            sigma_m: scan.sigma_m.0,
            robot_from_lidar: scan.robot_from_lidar.into(),
        },
        ranges_m: message.ranges.into_iter().map(|reading| reading.0).collect(),
    })
}

/// As [`ScanMessage`]: only `guidedog` is read back.
#[derive(Serialize, Deserialize)]
struct OdometryMessage {
    #[serde(skip_deserializing)]
    timestamp: Time,
    #[serde(skip_deserializing)]
    parent_frame_id: &'static str,
    #[serde(skip_deserializing)]
    child_frame_id: &'static str,
    #[serde(skip_deserializing)]
    translation: Vector3,
    #[serde(skip_deserializing)]
    rotation: Quaternion,
    guidedog: OdometryJson,
}

#[derive(Serialize, Deserialize)]
struct OdometryJson {
    #[serde(flatten)]
    header: HeaderJson,
    odom_from_robot: PoseJson,
    twist: TwistJson,
    sigma: [Real; 3],
}

impl OdometryMessage {
    fn new(odometry: &Odometry) -> Self {
        Self {
            timestamp: Time::from_ns(odometry.header.stamp_ns),
            parent_frame_id: "odom",
            child_frame_id: "robot",
            translation: odometry.odom_from_robot.into(),
            rotation: odometry.odom_from_robot.into(),
            guidedog: OdometryJson {
                header: odometry.header.into(),
                odom_from_robot: odometry.odom_from_robot.into(),
                twist: odometry.twist.into(),
                sigma: odometry.sigma.map(Real),
            },
        }
    }
}

fn decode_odometry(json: &[u8]) -> Result<Record, String> {
    let message: OdometryMessage = serde_json::from_slice(json).map_err(|error| error.to_string())?;
    let odometry = message.guidedog;
    Ok(Record::Odometry(Odometry {
        header: odometry.header.into(),
        odom_from_robot: odometry.odom_from_robot.into(),
        twist: odometry.twist.into(),
        sigma: odometry.sigma.map(|sigma| sigma.0),
    }))
}
