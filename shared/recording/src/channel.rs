//! The channels of a recording: one row for each topic that can be recorded.

use std::borrow::Cow;

use messages::{
    Cue, CueAnswer, CueHeard, CueRequest, EmergencyStop, LocomotionState, MAX_BEAMS, Mode, Odometry, Permit,
    PolicyAction, Pose2, ScanHeader, SpeechSaid, TopicId, Twist2, WorldTruth,
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::json;

use crate::json::{HeaderJson, Pose, Quaternion, Reading, Real, Time, Vector3};
use crate::mirror::{Mirrored, PoseJson, TwistJson};
use crate::{Record, image};

/// MCAP's name for the encoding of JSON channels.
pub const JSON: &str = "json";

/// MCAP's name for the encoding of JSON schemas.
pub const JSON_SCHEMA: &str = "jsonschema";

/// MCAP's name for the encoding of protobuf channels and schemas.
const PROTOBUF: &str = "protobuf";

/// How one topic is recorded.
#[derive(Debug)]
pub struct Channel {
    /// Which topic; its name is the channel's.
    pub topic: TopicId,
    /// Foxglove's name of the schema, or ours.
    pub schema_name: &'static str,
    /// MCAP's name for the schema's encoding.
    pub schema_encoding: &'static str,
    /// The schema.
    pub schema: fn() -> Cow<'static, [u8]>,
    /// MCAP's name for the messages' encoding.
    pub encoding: &'static str,
    /// From a message's bytes.
    pub decode: fn(&[u8]) -> Result<Record, String>,
}

/// A channel of our own JSON.
const fn own(
    topic: TopicId,
    schema_name: &'static str,
    schema: fn() -> Cow<'static, [u8]>,
    decode: fn(&[u8]) -> Result<Record, String>,
) -> Channel {
    Channel { topic, schema_name, schema_encoding: JSON_SCHEMA, schema, encoding: JSON, decode }
}

/// Every channel.
pub const CHANNELS: [Channel; 14] = [
    own(TopicId::LidarScan, "foxglove.LaserScan", || file(include_str!("../schemas/laser_scan.json")), decode_scan),
    own(
        TopicId::Odometry,
        "foxglove.FrameTransform",
        || file(include_str!("../schemas/frame_transform.json")),
        decode_odometry,
    ),
    own(TopicId::Cue, "guidedog.Cue", schema::<Cue>, |json| back(json).map(Record::Cue)),
    own(TopicId::CueRequest, "guidedog.CueRequest", schema::<CueRequest>, |json| back(json).map(Record::CueRequest)),
    own(TopicId::PolicyAction, "guidedog.PolicyAction", schema::<PolicyAction>, |json| {
        back(json).map(|action| Record::Action(Box::new(action)))
    }),
    own(TopicId::ShieldPermit, "guidedog.Permit", schema::<Permit>, |json| {
        back(json).map(|permit| Record::Permit(Box::new(permit)))
    }),
    own(TopicId::Mode, "guidedog.Mode", schema::<Mode>, |json| back(json).map(|mode| Record::Mode(Box::new(mode)))),
    own(TopicId::LocomotionState, "guidedog.LocomotionState", schema::<LocomotionState>, |json| {
        back(json).map(|state| Record::Locomotion(Box::new(state)))
    }),
    own(TopicId::Estop, "guidedog.EmergencyStop", schema::<EmergencyStop>, |json| back(json).map(Record::Estop)),
    own(TopicId::CueAnswer, "guidedog.CueAnswer", schema::<CueAnswer>, |json| {
        back(json).map(|answer| Record::CueAnswer(Box::new(answer)))
    }),
    own(TopicId::CueHeard, "guidedog.CueHeard", schema::<CueHeard>, |json| back(json).map(Record::Heard)),
    own(TopicId::SpeechSaid, "guidedog.SpeechSaid", schema::<SpeechSaid>, |json| {
        back(json).map(|said| Record::Said(Box::new(said)))
    }),
    own(TopicId::WorldTruth, "guidedog.WorldTruth", schema::<WorldTruth>, |json| {
        back(json).map(|truth| Record::Truth(Box::new(truth)))
    }),
    Channel {
        topic: TopicId::DepthFrame,
        schema_name: "foxglove.RawImage",
        schema_encoding: PROTOBUF,
        schema: || Cow::Owned(image::schema()),
        encoding: PROTOBUF,
        decode: image::decode,
    },
];

/// The channel of a topic.
pub fn channel_of(topic: TopicId) -> Option<&'static Channel> {
    CHANNELS.iter().find(|channel| channel.topic == topic)
}

fn file(text: &'static str) -> Cow<'static, [u8]> {
    Cow::Borrowed(text.as_bytes())
}

fn schema<M: Mirrored>() -> Cow<'static, [u8]> {
    let mut schema = M::schema();
    let name = std::any::type_name::<M>().rsplit("::").next().unwrap_or_default();
    schema["title"] = json!(format!("guidedog.{name}"));
    Cow::Owned(schema.to_string().into_bytes())
}

fn back<M: Mirrored>(json: &[u8]) -> Result<M, String>
where
    M::Json: DeserializeOwned,
{
    serde_json::from_slice(json).map(M::back).map_err(|error| error.to_string())
}

/// A record as its channel has it, written over `bytes`; the error says what cannot be recorded.
pub fn encode(record: &Record, bytes: &mut Vec<u8>) -> Result<(), String> {
    bytes.clear();
    let written = match record {
        Record::Scan { ranges_m, .. } if ranges_m.len() > MAX_BEAMS => {
            return Err(format!("{} ranges, over the most of {MAX_BEAMS}", ranges_m.len()));
        }
        Record::Depth { header, pixels_mm } => return image::encode(header, pixels_mm, bytes),
        Record::Scan { header, ranges_m } => serde_json::to_writer(bytes, &ScanMessage::new(header, ranges_m)),
        Record::Odometry(odometry) => serde_json::to_writer(bytes, &OdometryMessage::new(odometry)),
        Record::Cue(cue) => serde_json::to_writer(bytes, &cue.mirror()),
        Record::CueRequest(request) => serde_json::to_writer(bytes, &request.mirror()),
        Record::Action(action) => serde_json::to_writer(bytes, &action.mirror()),
        Record::Permit(permit) => serde_json::to_writer(bytes, &permit.mirror()),
        Record::Mode(mode) => serde_json::to_writer(bytes, &mode.mirror()),
        Record::Locomotion(state) => serde_json::to_writer(bytes, &state.mirror()),
        Record::Estop(stop) => serde_json::to_writer(bytes, &stop.mirror()),
        Record::CueAnswer(answer) => serde_json::to_writer(bytes, &answer.mirror()),
        Record::Heard(heard) => serde_json::to_writer(bytes, &heard.mirror()),
        Record::Said(said) => serde_json::to_writer(bytes, &said.mirror()),
        Record::Truth(truth) => serde_json::to_writer(bytes, &truth.mirror()),
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
                robot_from_lidar: scan.robot_from_lidar.mirror(),
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
            robot_from_lidar: Pose2::back(scan.robot_from_lidar),
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
                odom_from_robot: odometry.odom_from_robot.mirror(),
                twist: odometry.twist.mirror(),
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
        odom_from_robot: Pose2::back(odometry.odom_from_robot),
        twist: Twist2::back(odometry.twist),
        sigma: odometry.sigma.map(|sigma| sigma.0),
    }))
}
