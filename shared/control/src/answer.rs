//! The answers, each with the request that it belongs to.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::policies::Policies;
use crate::request::Request;
use crate::status::Status;
use crate::why::Why;

/// What is asked for, where it is not refused.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Answer {
    /// How the run is.
    Status(Box<Status>),
    /// Why the robot stands, and stood.
    Why(Box<Why>),
    /// The policies.
    Policies(Box<Policies>),
    /// What was to be done is done, or under way.
    Done(Done),
}

/// What can be asked about a run without changing it: the type of the answer.
pub trait Query: DeserializeOwned {
    /// The request.
    const REQUEST: Request;
}

impl Query for Status {
    const REQUEST: Request = Request::Status {};
}

impl Query for Why {
    const REQUEST: Request = Request::Why {};
}

impl Query for Policies {
    const REQUEST: Request = Request::PolicyShow {};
}

/// The answer to every request that changes something.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Done {
    /// True: what is not done is a [`crate::Refusal`].
    pub ok: bool,
    /// When a fault was injected, on the machine's monotonic clock, nanoseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_ns: Option<u64>,
    /// The number of the swap that has begun.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub swap: Option<u64>,
    /// What was done in place of what was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl Default for Done {
    fn default() -> Self {
        Self { ok: true, at_ns: None, swap: None, note: None }
    }
}
