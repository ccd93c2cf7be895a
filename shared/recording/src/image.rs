//! A depth frame as `foxglove.RawImage` (protobuf): its pixels stay the bytes that they are.
//!
//! What the schema has no room for is a field of its own behind the schema's, which viewers pass over.

use std::borrow::Cow;

use messages::json::{HeaderJson, Mirrored, Real};
use messages::{DepthFrame, DepthHeader, Pose3};
use prost::Message as _;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};
use serde::{Deserialize, Serialize};

use crate::channel::Recorded;
use crate::record::Slice;

/// MCAP's name for the encoding of protobuf channels and schemas.
const PROTOBUF: &str = "protobuf";

/// 16 bits a pixel, millimetres.
const ENCODING: &str = "16UC1";
/// No camera has more pixels: 1280 x 720.
const PIXELS_MAX: usize = 1280 * 720;
/// Number of our own field, far behind the schema's.
const OWN_FIELD: i32 = 1000;

#[derive(Clone, PartialEq, prost::Message)]
struct Timestamp {
    #[prost(int64, tag = "1")]
    seconds: i64,
    #[prost(int32, tag = "2")]
    nanos: i32,
}

#[derive(Clone, PartialEq, prost::Message)]
struct RawImage {
    #[prost(message, optional, tag = "1")]
    timestamp: Option<Timestamp>,
    #[prost(fixed32, tag = "2")]
    width: u32,
    #[prost(fixed32, tag = "3")]
    height: u32,
    #[prost(string, tag = "4")]
    encoding: String,
    #[prost(fixed32, tag = "5")]
    step: u32,
    #[prost(bytes = "vec", tag = "6")]
    data: Vec<u8>,
    #[prost(string, tag = "7")]
    frame_id: String,
    /// JSON: [`DepthJson`].
    #[prost(string, tag = "1000")]
    guidedog: String,
}

#[derive(Serialize, Deserialize)]
struct DepthJson {
    #[serde(flatten)]
    header: HeaderJson,
    fx_px: Real,
    fy_px: Real,
    cx_px: Real,
    cy_px: Real,
    robot_from_camera: <Pose3 as Mirrored>::Json,
}

impl Recorded for Slice<DepthFrame> {
    const SCHEMA_NAME: &'static str = "foxglove.RawImage";
    const SCHEMA_ENCODING: &'static str = PROTOBUF;
    const ENCODING: &'static str = PROTOBUF;
    fn schema() -> Cow<'static, [u8]> {
        Cow::Owned(schema())
    }
    fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), String> {
        encode(&self.header, &self.data, bytes)
    }
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        decode(bytes)
    }
}

/// The schema: protobuf's own description of `foxglove.RawImage`, with our field.
fn schema() -> Vec<u8> {
    let field = |name: &str, number: i32, kind: Type, of: Option<&str>| FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional.into()),
        r#type: Some(kind.into()),
        type_name: of.map(str::to_owned),
        json_name: Some(name.to_owned()),
        ..FieldDescriptorProto::default()
    };
    let file = |name: &str, package: &str, dependency: Vec<String>, message: &str, fields| FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        dependency,
        message_type: vec![DescriptorProto {
            name: Some(message.to_owned()),
            field: fields,
            ..DescriptorProto::default()
        }],
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    let timestamp = "google/protobuf/timestamp.proto";
    let time = vec![field("seconds", 1, Type::Int64, None), field("nanos", 2, Type::Int32, None)];
    let image = vec![
        field("timestamp", 1, Type::Message, Some(".google.protobuf.Timestamp")),
        field("frame_id", 7, Type::String, None),
        field("width", 2, Type::Fixed32, None),
        field("height", 3, Type::Fixed32, None),
        field("encoding", 4, Type::String, None),
        field("step", 5, Type::Fixed32, None),
        field("data", 6, Type::Bytes, None),
        field("guidedog", OWN_FIELD, Type::String, None),
    ];
    let files = vec![
        file(timestamp, "google.protobuf", Vec::new(), "Timestamp", time),
        file("foxglove/RawImage.proto", "foxglove", vec![timestamp.to_owned()], "RawImage", image),
    ];
    FileDescriptorSet { file: files }.encode_to_vec()
}

/// A frame as protobuf, appended to `bytes`; the error says what cannot be recorded.
fn encode(header: &DepthHeader, pixels_mm: &[u16], bytes: &mut Vec<u8>) -> Result<(), String> {
    check_size(header, pixels_mm.len())?;
    let own = DepthJson {
        header: header.header.to_json(),
        fx_px: Real(header.fx_px),
        fy_px: Real(header.fy_px),
        cx_px: Real(header.cx_px),
        cy_px: Real(header.cy_px),
        robot_from_camera: header.robot_from_camera.to_json(),
    };
    // Protobuf's numbers and 16UC1's are little-endian, as every machine that this runs on.
    let stamp_ns = header.header.stamp_ns;
    let image = RawImage {
        timestamp: Some(Timestamp {
            seconds: i64::try_from(stamp_ns / messages::NS_PER_S).unwrap_or(i64::MAX),
            nanos: (stamp_ns % messages::NS_PER_S) as i32,
        }),
        width: header.width,
        height: header.height,
        encoding: ENCODING.to_owned(),
        step: header.width * 2,
        data: zerocopy::IntoBytes::as_bytes(pixels_mm).to_vec(),
        frame_id: "camera".to_owned(),
        guidedog: serde_json::to_string(&own).map_err(|error| error.to_string())?,
    };
    image.encode(bytes).map_err(|error| error.to_string())
}

/// A frame from protobuf.
fn decode(bytes: &[u8]) -> Result<Slice<DepthFrame>, String> {
    let image = RawImage::decode(bytes).map_err(|error| error.to_string())?;
    if image.encoding != ENCODING {
        return Err(format!("its pixels are {:?}, not {ENCODING}", image.encoding));
    }
    let own: DepthJson = serde_json::from_str(&image.guidedog).map_err(|error| error.to_string())?;
    let header = DepthHeader {
        header: Mirrored::from_json(own.header),
        width: image.width,
        height: image.height,
        fx_px: own.fx_px.0,
        fy_px: own.fy_px.0,
        cx_px: own.cx_px.0,
        cy_px: own.cy_px.0,
        robot_from_camera: Pose3::from_json(own.robot_from_camera),
    };
    check_size(&header, image.data.len() / 2)?;
    let pixels_mm = image.data.chunks_exact(2).map(|pixel| u16::from_le_bytes([pixel[0], pixel[1]])).collect();
    Ok(Slice { header, data: pixels_mm })
}

fn check_size(header: &DepthHeader, pixels: usize) -> Result<(), String> {
    let said = u64::from(header.width) * u64::from(header.height);
    if said != pixels as u64 || pixels > PIXELS_MAX {
        return Err(format!(
            "{pixels} pixels in a frame of {} x {}, of which {PIXELS_MAX} are the most",
            header.width, header.height
        ));
    }
    Ok(())
}
