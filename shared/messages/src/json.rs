//! Messages as JSON, as recordings hold them: every type has a mirror whose numbers come back to the bit, and tells its
//! JSON schema.
//!
//! JSON has neither NaN nor infinities: NaN is written as `null`, and an infinity as the greatest number of its sign.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Value, json};

use crate::{Header, SpeechText};

/// A type and its mirror in JSON.
pub trait Mirrored: Copy {
    /// The mirror.
    type Json;
    /// The mirror of this value.
    fn to_json(self) -> Self::Json;
    /// The value of a mirror.
    fn from_json(json: Self::Json) -> Self;
    /// JSON schema of the mirror.
    fn schema() -> Value;
}

/// Makes a number type that keeps NaN and the infinities, which JSON lacks.
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

        impl Mirrored for $float {
            type Json = $name;
            fn to_json(self) -> $name {
                $name(self)
            }
            fn from_json(json: $name) -> Self {
                json.0
            }
            fn schema() -> Value {
                json!({ "type": ["number", "null"] })
            }
        }
    };
}

number!(Real, f64, "An `f64` in JSON.");
number!(Reading, f32, "An `f32` in JSON, in the shortest form that reads back to the same `f32`.");

/// Types that are their own mirror.
macro_rules! plain {
    ($schema:tt: $($name:ty),+) => {$(
        impl $crate::json::Mirrored for $name {
            type Json = Self;
            fn to_json(self) -> Self {
                self
            }
            fn from_json(json: Self) -> Self {
                json
            }
            fn schema() -> ::serde_json::Value {
                ::serde_json::json!($schema)
            }
        }
    )+};
}
pub(crate) use plain;

plain!({ "type": "integer", "minimum": 0 }: u8, u16, u32, u64);
plain!({ "type": "integer" }: i8, i16, i32, i64);
plain!({ "type": "boolean" }: bool);

/// An enum that stands in JSON by the names of its variants. It stands below the enum.
macro_rules! named {
    ($name:ident) => {
        $crate::json::plain!({ "type": "string" }: $name);
    };
}
pub(crate) use named;

impl Mirrored for SpeechText {
    type Json = String;
    fn to_json(self) -> String {
        self.as_str().to_owned()
    }
    fn from_json(json: String) -> Self {
        json.as_str().into()
    }
    fn schema() -> Value {
        json!({ "type": "string" })
    }
}

impl<T: Mirrored, const N: usize> Mirrored for [T; N] {
    type Json = [T::Json; N];
    fn to_json(self) -> Self::Json {
        self.map(T::to_json)
    }
    fn from_json(json: Self::Json) -> Self {
        json.map(T::from_json)
    }
    fn schema() -> Value {
        json!({ "type": "array", "items": T::schema(), "minItems": N, "maxItems": N })
    }
}

/// [`Header`] in JSON.
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

impl Mirrored for Header {
    type Json = HeaderJson;
    fn to_json(self) -> HeaderJson {
        let Self { stamp_ns, seq, step, published_ns, incarnation, .. } = self;
        HeaderJson { stamp_ns, seq, step, published_ns, incarnation }
    }
    fn from_json(json: HeaderJson) -> Self {
        let HeaderJson { stamp_ns, seq, step, published_ns, incarnation } = json;
        Self { stamp_ns, seq, step, published_ns, incarnation, ..Self::default() }
    }
    fn schema() -> Value {
        let members = ["stamp_ns", "seq", "step", "published_ns", "incarnation"];
        object(members.map(|member| (member, u64::schema())))
    }
}

/// The schema of a struct with these members.
pub(crate) fn object<const N: usize>(members: [(&str, Value); N]) -> Value {
    let required: Vec<&str> = members.iter().map(|(name, _)| *name).collect();
    let properties: Value = members.iter().map(|(name, schema)| ((*name).to_owned(), schema.clone())).collect();
    json!({ "type": "object", "properties": properties, "required": required })
}

/// Declares a struct together with its mirror in JSON, so that a field is named once.
/// `field: Type = default` is a field that older recordings lack: its mirror reads back as the default.
macro_rules! mirrored {
    ($(
        $(#[$meta:meta])*
        pub struct $name:ident { $($(#[$field_meta:meta])* pub $field:ident: $type:ty $(= $default:ident)?),+ $(,)? }
    )+) => {$(
        $(#[$meta])*
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)+ }

        const _: () = {
            use $crate::json::{Mirrored, object};

            #[derive(Debug, Clone, ::serde::Serialize, ::serde::Deserialize)]
            pub struct Json { $($(#[serde($default)])? $field: <$type as Mirrored>::Json,)+ }

            impl Default for Json {
                fn default() -> Self {
                    $name::default().to_json()
                }
            }

            impl Mirrored for $name {
                type Json = Json;
                fn to_json(self) -> Json {
                    Json { $($field: self.$field.to_json(),)+ }
                }
                fn from_json(json: Json) -> Self {
                    Self { $($field: <$type as Mirrored>::from_json(json.$field),)+ }
                }
                fn schema() -> ::serde_json::Value {
                    object([$((stringify!($field), <$type as Mirrored>::schema()),)+])
                }
            }
        };
    )+};
}
pub(crate) use mirrored;
