//! The channels of a recording: one for each recorded topic of the topic table.

use std::borrow::Cow;

use messages::json::{HeaderJson, Mirrored, Reading, Real};
use messages::{
    Attitude, Header, LidarScan, MAX_BEAMS, Odometry, Pose2, ScanHeader, SecondScan, SecondScanHeader, TopicId, Twist2,
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::json;

use crate::Record;
use crate::json::{Pose, Quaternion, Time, Vector3};
use crate::record::{Slice, kept};

/// MCAP's name for the encoding of JSON channels.
pub const JSON: &str = "json";

/// MCAP's name for the encoding of JSON schemas.
pub const JSON_SCHEMA: &str = "jsonschema";

/// How a type stands in a recording.
pub trait Recorded: Sized {
    /// Foxglove's name of the schema, or ours.
    const SCHEMA_NAME: &'static str;
    /// MCAP's name for the schema's encoding.
    const SCHEMA_ENCODING: &'static str = JSON_SCHEMA;
    /// MCAP's name for the messages' encoding.
    const ENCODING: &'static str = JSON;

    /// The schema.
    fn schema() -> Cow<'static, [u8]>;

    /// Writes the message behind `bytes`; the error says what cannot be recorded.
    fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), String>;

    /// Reads the message; the error says what is wrong with its bytes.
    fn decode(bytes: &[u8]) -> Result<Self, String>;
}

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

impl Channel {
    const fn of<T: Recorded + Into<Record>>(topic: TopicId) -> Self {
        Self {
            topic,
            schema_name: T::SCHEMA_NAME,
            schema_encoding: T::SCHEMA_ENCODING,
            schema: T::schema,
            encoding: T::ENCODING,
            decode: |bytes| T::decode(bytes).map(Into::into),
        }
    }
}

/// A message that stands field by field. One that viewers draw has an implementation of its own, below or in `image`.
macro_rules! recorded {
    (Mirrored $type:ident) => {
        impl Recorded for messages::$type {
            const SCHEMA_NAME: &'static str = concat!("guidedog.", stringify!($type));
            fn schema() -> Cow<'static, [u8]> {
                let mut schema = <Self as Mirrored>::schema();
                schema["title"] = json!(Self::SCHEMA_NAME);
                Cow::Owned(schema.to_string().into_bytes())
            }
            fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
                write_json(&self.to_json(), bytes)
            }
            fn decode(bytes: &[u8]) -> Result<Self, String> {
                read_json(bytes).map(Self::from_json)
            }
        }
    };
    (Viewed $type:ident) => {};
}

macro_rules! channels {
    ($($kind:ident $id:ident $type:ident in $part:ident as $form:ident;)+) => {
        $(recorded!($form $type);)+

        /// Every channel, in the order of the topic table.
        pub const CHANNELS: &[Channel] = &[$(Channel::of::<kept!($kind $type)>(TopicId::$id)),+];

        /// A record as its channel has it, written over `bytes`; the error says what cannot be recorded.
        pub fn encode(record: &Record, bytes: &mut Vec<u8>) -> Result<(), String> {
            bytes.clear();
            match record {
                $(Record::$id(message) => message.encode(bytes),)+
            }
        }
    };
}

messages::for_each_recorded_topic!(channels);

/// The channel of a topic.
pub fn channel_of(topic: TopicId) -> Option<&'static Channel> {
    CHANNELS.iter().find(|channel| channel.topic == topic)
}

fn file(text: &'static str) -> Cow<'static, [u8]> {
    Cow::Borrowed(text.as_bytes())
}

fn write_json(message: &impl Serialize, bytes: &mut Vec<u8>) -> Result<(), String> {
    serde_json::to_writer(bytes, message).map_err(|error| error.to_string())
}

fn read_json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    serde_json::from_slice(bytes).map_err(|error| error.to_string())
}

fn check_length(ranges: usize) -> Result<(), String> {
    if ranges > MAX_BEAMS { Err(format!("{ranges} ranges, over the most of {MAX_BEAMS}")) } else { Ok(()) }
}

impl Recorded for Slice<LidarScan> {
    const SCHEMA_NAME: &'static str = "foxglove.LaserScan";
    fn schema() -> Cow<'static, [u8]> {
        file(include_str!("../schemas/laser_scan.json"))
    }
    fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
        check_length(self.data.len())?;
        write_json(&ScanMessage::new(&self.header, &self.data), bytes)
    }
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let (header, data) = ScanMessage::read(bytes)?.taken_apart();
        Ok(Self { header, data })
    }
}

impl Recorded for Slice<SecondScan> {
    const SCHEMA_NAME: &'static str = "foxglove.LaserScan";
    fn schema() -> Cow<'static, [u8]> {
        file(include_str!("../schemas/laser_scan.json"))
    }
    fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
        check_length(self.data.len())?;
        let SecondScanHeader { header, scan, pitch_rad } = self.header;
        let mut message = ScanMessage::new(&ScanHeader { header, ..scan }, &self.data);
        message.guidedog.pitch_rad = Some(Real(pitch_rad));
        write_json(&message, bytes)
    }
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let message = ScanMessage::read(bytes)?;
        let pitch_rad = message.guidedog.pitch_rad.map_or(0.0, |pitch| pitch.0);
        let (scan, data) = message.taken_apart();
        let own = ScanHeader { header: Header::default(), ..scan };
        Ok(Self { header: SecondScanHeader { header: scan.header, scan: own, pitch_rad }, data })
    }
}

impl Recorded for Odometry {
    const SCHEMA_NAME: &'static str = "foxglove.FrameTransform";
    fn schema() -> Cow<'static, [u8]> {
        file(include_str!("../schemas/frame_transform.json"))
    }
    fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
        write_json(&OdometryMessage::new(self), bytes)
    }
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let OdometryMessage { guidedog: odometry, .. } = read_json(bytes)?;
        Ok(Self {
            header: Mirrored::from_json(odometry.header),
            odom_from_robot: Mirrored::from_json(odometry.odom_from_robot),
            twist: Mirrored::from_json(odometry.twist),
            sigma: Mirrored::from_json(odometry.sigma),
            attitude: odometry.attitude.map_or_else(Attitude::default, Mirrored::from_json),
        })
    }
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
    robot_from_lidar: <Pose2 as Mirrored>::Json,
    /// Recordings have it since a body may tilt.
    #[serde(default)]
    height_m: Real,
    /// Of the second lidar.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pitch_rad: Option<Real>,
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
                header: scan.header.to_json(),
                angle_min_rad: Real(scan.angle_min_rad),
                angle_increment_rad: Real(scan.angle_increment_rad),
                range_min_m: Real(scan.range_min_m),
                range_max_m: Real(scan.range_max_m),
                sigma_m: Real(scan.sigma_m),
                robot_from_lidar: scan.robot_from_lidar.to_json(),
                height_m: Real(scan.height_m),
                pitch_rad: None,
            },
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let message: Self = read_json(bytes)?;
        check_length(message.ranges.len())?;
        Ok(message)
    }

    /// What stood beside the ranges, and the ranges, metres.
    fn taken_apart(self) -> (ScanHeader, Vec<f32>) {
        let scan = self.guidedog;
        let header = ScanHeader {
            header: Mirrored::from_json(scan.header),
            angle_min_rad: scan.angle_min_rad.0,
            angle_increment_rad: scan.angle_increment_rad.0,
            range_min_m: scan.range_min_m.0,
            range_max_m: scan.range_max_m.0,
            sigma_m: scan.sigma_m.0,
            robot_from_lidar: Mirrored::from_json(scan.robot_from_lidar),
            height_m: scan.height_m.0,
        };
        (header, self.ranges.into_iter().map(|reading| reading.0).collect())
    }
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
    odom_from_robot: <Pose2 as Mirrored>::Json,
    twist: <Twist2 as Mirrored>::Json,
    sigma: [Real; 3],
    /// Recordings of level worlds, and old ones, have none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    attitude: Option<<Attitude as Mirrored>::Json>,
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
                header: odometry.header.to_json(),
                odom_from_robot: odometry.odom_from_robot.to_json(),
                twist: odometry.twist.to_json(),
                sigma: odometry.sigma.to_json(),
                attitude: odometry.attitude.is_known().then(|| odometry.attitude.to_json()),
            },
        }
    }
}
