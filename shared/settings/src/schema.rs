//! The JSON schema of the configuration file, for editors.
//!
//! Types that read themselves have their form here, and so have those of crates that know nothing of schemas.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::Value;

use crate::path::ConfigPath;
use crate::sections::{PolicyModel, Settings, SpokenLanguage};

/// The schema of the configuration file.
#[must_use]
pub fn schema() -> Value {
    schemars::schema_for!(Settings).to_value()
}

/// Has types written as a text.
macro_rules! is_text {
    ($($type:ty: $name:literal, $what:literal;)+) => {$(
        impl JsonSchema for $type {
            fn schema_name() -> Cow<'static, str> {
                $name.into()
            }

            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ "type": "string", "description": $what })
            }
        }
    )+};
}

is_text! {
    ConfigPath: "Path", "A path. A relative one starts at the folder of this file.";
    PolicyModel: "PolicyModel", "The name of a policy that is built in (guide, geometric, steps), or a file.";
    SpokenLanguage: "SpokenLanguage", "The name of a language that is built in, or a file.";
}

/// A pose in the plane, as it stands in the file.
#[derive(JsonSchema)]
#[expect(dead_code, reason = "only its schema is used")]
pub(crate) struct Pose2 {
    /// Forward, metres.
    x_m: f64,
    /// Left, metres.
    y_m: f64,
    /// Counter-clockwise, radians.
    yaw_rad: f64,
}

/// A pose in space, as it stands in the file.
#[derive(JsonSchema)]
#[expect(dead_code, reason = "only its schema is used")]
pub(crate) struct Pose3 {
    /// Forward, metres.
    x_m: f64,
    /// Left, metres.
    y_m: f64,
    /// Above the floor, metres.
    z_m: f64,
    /// Counter-clockwise, radians.
    yaw_rad: f64,
    /// Down, radians.
    pitch_rad: f64,
}
