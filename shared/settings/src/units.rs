//! Values that are right by construction: a wrong one is refused where it stands in the file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A finite number over zero.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "f64", into = "f64")]
pub struct Positive(f64);

/// A number in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "f64", into = "f64")]
pub struct Share(f64);

/// A duration, written as "200ms" or "1.5s"; over zero and at most an hour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
pub struct Millis {
    ns: u64,
}

impl Positive {
    /// The number.
    #[must_use]
    pub const fn get(self) -> f64 {
        self.0
    }

    /// For defaults, whose value is known to be right.
    pub(crate) const fn of(value: f64) -> Self {
        Self(value)
    }
}

impl TryFrom<f64> for Positive {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        if value.is_finite() && value > 0.0 {
            Ok(Self(value))
        } else {
            Err(format!("{value} is not over 0 and finite"))
        }
    }
}

impl From<Positive> for f64 {
    fn from(value: Positive) -> Self {
        value.0
    }
}

impl Share {
    /// The number.
    #[must_use]
    pub const fn get(self) -> f64 {
        self.0
    }

    /// For defaults, whose value is known to be right.
    pub(crate) const fn of(value: f64) -> Self {
        Self(value)
    }
}

impl TryFrom<f64> for Share {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        if (0.0..=1.0).contains(&value) { Ok(Self(value)) } else { Err(format!("{value} is not in 0..1")) }
    }
}

impl From<Share> for f64 {
    fn from(value: Share) -> Self {
        value.0
    }
}

impl Millis {
    /// Nanoseconds.
    #[must_use]
    pub const fn ns(self) -> u64 {
        self.ns
    }

    /// This and another one after it.
    ///
    /// # Errors
    /// Where they are over an hour together.
    pub fn plus(self, other: Self) -> Result<Self, String> {
        let ns = self.ns + other.ns;
        if ns > 3_600_000_000_000 { Err("over an hour in all".to_owned()) } else { Ok(Self { ns }) }
    }

    /// Seconds.
    #[must_use]
    pub fn s(self) -> f64 {
        self.ns as f64 / 1e9
    }

    /// For defaults.
    pub(crate) const fn of_ms(ms: u64) -> Self {
        Self { ns: ms * 1_000_000 }
    }
}

impl TryFrom<String> for Millis {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let duration = humantime::parse_duration(&text)
            .map_err(|error| format!("\"{text}\" is not a duration such as \"200ms\": {error}"))?;
        if duration.is_zero() || duration.as_secs() > 3600 {
            return Err(format!("\"{text}\" is not over 0 and at most an hour: a limit cannot be turned off"));
        }
        u64::try_from(duration.as_nanos()).map(|ns| Self { ns }).map_err(|_| format!("\"{text}\" is too long"))
    }
}

impl From<Millis> for String {
    fn from(value: Millis) -> Self {
        humantime::format_duration(std::time::Duration::from_nanos(value.ns)).to_string()
    }
}
