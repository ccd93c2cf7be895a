//! Stepped time: the master's steps and the members' acknowledgements.

use crate::{Header, ServiceId};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// One step of stepped time, nanoseconds.
pub const QUANTUM_NS: u64 = 10_000_000;

/// How run time passes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum ClockKind {
    /// Run time is the monotonic clock since the run's start.
    #[default]
    Real,
    /// Run time is virtual: a master gives it out in steps of 10 ms, at most `speed` times faster than real; 0 is as
    /// fast as the members follow.
    Stepped {
        /// Times faster than real; 0 = unlimited.
        speed: f64,
    },
}

/// The most members of a stepped run.
pub const MAX_MEMBERS: usize = 16;

/// One process incarnation that takes part in every step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Member/1"))]
#[repr(C)]
pub struct Member {
    /// Which service.
    pub service: ServiceId,
    /// Which life of it.
    pub incarnation: u32,
}

/// Step `header.step` at run time `header.stamp_ns`, for its members.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ClockStep/1"))]
#[repr(C)]
pub struct ClockStep {
    /// `step` is the number, `stamp_ns` the run time.
    pub header: Header,
    /// How many of `members` are meant.
    pub member_count: u32,
    /// Who takes the step, the master excepted.
    pub members: [Member; MAX_MEMBERS],
}

impl ClockStep {
    /// The members.
    #[must_use]
    pub fn members(&self) -> &[Member] {
        &self.members[..(self.member_count as usize).min(MAX_MEMBERS)]
    }
}

/// A member has done step `header.step`. From the supervisor it also carries the members of the next step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ClockAck/1"))]
#[repr(C)]
pub struct ClockAck {
    /// `step` is the number of the step done; 0 for a roster that acknowledges nothing.
    pub header: Header,
    /// Who.
    pub member: Member,
    /// Counts the supervisor's rosters; 0 where `roster` means nothing. The highest is in force.
    pub roster_version: u64,
    /// How many of `roster` are meant.
    pub roster_count: u32,
    /// The members from the next step on.
    pub roster: [Member; MAX_MEMBERS],
}

impl ClockAck {
    /// The members from the next step on.
    #[must_use]
    pub fn roster(&self) -> &[Member] {
        &self.roster[..(self.roster_count as usize).min(MAX_MEMBERS)]
    }
}
