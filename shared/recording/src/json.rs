//! The pieces that the channels' JSON is made of.

use messages::{Header, NS_PER_S, Pose2};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Makes a number type that keeps NaN and the infinities, which JSON lacks, in the way that the crate's page tells.
macro_rules! number {
    ($name:ident, $float:ty, $doc:literal) => {
        #[doc = $doc]
        #[derive(Debug, Clone, Copy, Default, PartialEq)]
        pub struct $name(pub $float);

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                if self.0.is_nan() {
                    None::<$float>.serialize(serializer)
                } else {
                    self.0.clamp(<$float>::MIN, <$float>::MAX).serialize(serializer)
                }
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                Ok(Self(match Option::<$float>::deserialize(deserializer)? {
                    None => <$float>::NAN,
                    Some(<$float>::MAX) => <$float>::INFINITY,
                    Some(<$float>::MIN) => <$float>::NEG_INFINITY,
                    Some(number) => number,
                }))
            }
        }
    };
}

number!(Real, f64, "A number of a header.");
number!(Reading, f32, "One range of a scan, metres; written in the shortest form that reads back to the same `f32`.");

/// Foxglove's time.
#[derive(Debug, Default, Serialize)]
pub struct Time {
    sec: u64,
    nsec: u64,
}

impl Time {
    /// From run time, nanoseconds.
    pub const fn from_ns(ns: u64) -> Self {
        Self { sec: ns / NS_PER_S, nsec: ns % NS_PER_S }
    }
}

/// Foxglove's vector, metres.
#[derive(Debug, Default, Serialize)]
pub struct Vector3 {
    x: Real,
    y: Real,
    z: Real,
}

/// Foxglove's rotation.
#[derive(Debug, Default, Serialize)]
pub struct Quaternion {
    x: Real,
    y: Real,
    z: Real,
    w: Real,
}

/// Foxglove's pose.
#[derive(Debug, Default, Serialize)]
pub struct Pose {
    position: Vector3,
    orientation: Quaternion,
}

impl From<Pose2> for Vector3 {
    fn from(pose: Pose2) -> Self {
        Self { x: Real(pose.x_m), y: Real(pose.y_m), z: Real(0.0) }
    }
}

impl From<Pose2> for Quaternion {
    fn from(pose: Pose2) -> Self {
        let half_rad = 0.5 * pose.yaw_rad;
        Self { x: Real(0.0), y: Real(0.0), z: Real(half_rad.sin()), w: Real(half_rad.cos()) }
    }
}

impl From<Pose2> for Pose {
    fn from(pose: Pose2) -> Self {
        Self { position: pose.into(), orientation: pose.into() }
    }
}

/// [`Header`] as members of `guidedog`.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct HeaderJson {
    stamp_ns: u64,
    seq: u64,
    step: u64,
    /// Imports have none.
    #[serde(default)]
    published_ns: u64,
    incarnation: u32,
}

impl From<Header> for HeaderJson {
    fn from(h: Header) -> Self {
        Self {
            stamp_ns: h.stamp_ns,
            seq: h.seq,
            step: h.step,
            published_ns: h.published_ns,
            incarnation: h.incarnation,
        }
    }
}

impl From<HeaderJson> for Header {
    fn from(h: HeaderJson) -> Self {
        Self {
            stamp_ns: h.stamp_ns,
            seq: h.seq,
            step: h.step,
            published_ns: h.published_ns,
            incarnation: h.incarnation,
            ..Self::default()
        }
    }
}
