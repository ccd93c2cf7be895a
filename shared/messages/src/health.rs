//! What every service says of itself, from the loop that does its work.

use crate::{Header, Outcome, ServiceId, TopicId};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// The most ports of one service.
pub const MAX_PORTS: usize = 24;

/// Buckets of a [`LatencyHistogram`]: eight an octave from 1 us to 16 s.
pub const LATENCY_BUCKETS: usize = 192;

/// How far a service is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ServiceState/1"))]
#[repr(C)]
pub enum ServiceState {
    /// At work.
    #[default]
    Ready = 0,
    /// Letting go, by plan.
    Leaving,
}

/// Which end of a topic a port is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/PortRole/1"))]
#[repr(C)]
pub enum PortRole {
    /// Writes.
    #[default]
    Publisher = 0,
    /// Reads.
    Subscriber,
}

/// What one port of a service has done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/PortCounters/2"))]
#[repr(C)]
pub struct PortCounters {
    /// The topic.
    pub topic: TopicId,
    /// Which end.
    pub role: PortRole,
    /// For a health topic: whose.
    pub of: ServiceId,
    /// Messages published or taken.
    pub count: u64,
    /// Messages that a reader missed (gaps in seq), or that a writer could not send.
    pub lost: u64,
    /// What a reader found in shared memory that is no message of its topic, and dropped.
    pub invalid: u64,
    /// Seq of the last one.
    pub last_seq: u64,
    /// Stamp of the last one.
    pub last_stamp_ns: u64,
}

/// A latency that a service measures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Latency/1"))]
#[repr(C)]
pub enum Latency {
    /// Not used.
    #[default]
    None = 0,
    /// Depth published by the driver -> taken by a consumer.
    DepthToConsumer,
    /// Scan published by the driver -> verdict on it published.
    ScanToPermit,
    /// Permit published -> command at the link.
    PermitToCommand,
    /// Decision due -> action published.
    Decision,
    /// Stop (or hold) -> first sample of its reason handed to the output.
    StopToSpeech,
}

impl Latency {
    /// The name, as in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::DepthToConsumer => "depth_to_consumer",
            Self::ScanToPermit => "scan_to_permit",
            Self::PermitToCommand => "permit_to_command",
            Self::Decision => "decision",
            Self::StopToSpeech => "stop_to_speech",
        }
    }
}

/// A histogram with logarithmic buckets, eight an octave (width 9 %), so that lives of a service can be added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/LatencyHistogram/1"))]
#[repr(C)]
pub struct LatencyHistogram {
    /// What is measured.
    pub what: Latency,
    /// Largest value, nanoseconds; exact.
    pub max_ns: u64,
    /// How many values.
    pub n: u64,
    /// Values from `2^(i/8)` us to the next, the first and last open to their side.
    pub buckets: [u32; LATENCY_BUCKETS],
}

impl Default for LatencyHistogram {
    fn default() -> Self {
        Self { what: Latency::None, max_ns: 0, n: 0, buckets: [0; LATENCY_BUCKETS] }
    }
}

impl LatencyHistogram {
    /// Counts one value.
    pub fn record(&mut self, ns: u64) {
        let octaves = (ns.max(1) as f64 / 1000.0).log2();
        let bucket = ((octaves * 8.0).floor().max(0.0) as usize).min(LATENCY_BUCKETS - 1);
        self.buckets[bucket] = self.buckets[bucket].saturating_add(1);
        self.n = self.n.saturating_add(1);
        self.max_ns = self.max_ns.max(ns);
    }

    /// Adds what another life of the service counted.
    pub fn add(&mut self, other: &Self) {
        self.n = self.n.saturating_add(other.n);
        self.max_ns = self.max_ns.max(other.max_ns);
        for (mine, theirs) in self.buckets.iter_mut().zip(&other.buckets) {
            *mine = mine.saturating_add(*theirs);
        }
    }

    /// The value, microseconds, below which the share `q` in [0, 1] of the values lies; within 5 % (the middle of its
    /// bucket), never over the exact maximum. `None` without values.
    #[must_use]
    pub fn quantile_us(&self, q: f64) -> Option<f64> {
        if self.n == 0 {
            return None;
        }
        let rank = ((q * self.n as f64).ceil() as u64).clamp(1, self.n);
        let mut seen = 0;
        for (i, count) in self.buckets.iter().enumerate() {
            seen += u64::from(*count);
            if seen >= rank {
                let middle = 2f64.powf((i as f64 + 0.5) / 8.0);
                return Some(middle.min(self.max_ns as f64 / 1000.0));
            }
        }
        Some(self.max_ns as f64 / 1000.0)
    }
}

/// Whether a microphone, or what stands in its place, is heard.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/MicrophoneState/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum MicrophoneState {
    /// None is wanted, or what hearing needs is not there.
    #[default]
    None = 0,
    /// It is not open: absent, busy, or lost.
    Lost,
    /// Not enough was heard yet to tell words.
    WarmingUp,
    /// It is heard.
    Hearing,
    /// The robot itself speaks.
    Muted,
    /// It gives exact zeros.
    Dead,
    /// Much of what it gives is cut off.
    Clipping,
}

/// How a microphone does.
#[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Microphone/1"))]
#[repr(C)]
pub struct Microphone {
    /// Whether it is heard.
    pub state: MicrophoneState,
    /// How loud the last second was, decibels of full scale.
    pub level_dbfs: f32,
    /// How far the loudest of late stands out from what is always there, decibels.
    pub above_floor_db: f32,
    /// Share of the last second's samples that were cut off.
    pub clipped: f32,
}

/// A beat: published by the loop that waits and works, so that a stuck loop is silent.
#[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Health/5"))]
#[repr(C)]
pub struct Health {
    /// Stamp, seq, incarnation.
    pub header: Header,
    /// Whose.
    pub service: ServiceId,
    /// How far it is.
    pub state: ServiceState,
    /// Process id.
    pub pid: u32,
    /// Descriptors open.
    pub open_files: u32,
    /// Memory resident, bytes, shared memory included.
    pub resident_bytes: u64,
    /// Memory resident that no other process shares, bytes.
    pub private_bytes: u64,
    /// Decisions made (policy, shield).
    pub decisions: u64,
    /// Decisions that did not come in time (shield).
    pub missed_decisions: u64,
    /// Scans taken, and what became of them, by [`Outcome`] number (shield).
    pub outcomes: [u64; Outcome::ALL.len()],
    /// Input that was refused as unusable.
    pub invalid_inputs: u64,
    /// Messages that could not be kept: the queue to the file was full, or the file can take no more (recorder).
    pub not_recorded: u64,
    /// Poses further off than the robot can have walked (shield).
    pub pose_jumps: u64,
    /// Digest over all actions taken and permits given (shield).
    pub digest: [u8; 32],
    /// How many of `ports` are meant; each tells the last input or output by its seq.
    pub port_count: u32,
    /// Ports.
    pub ports: [PortCounters; MAX_PORTS],
    /// Latencies.
    pub latencies: [LatencyHistogram; 2],
    /// How the handler's voice is heard (cue).
    pub microphone: Microphone,
}

impl Health {
    /// The ports.
    #[must_use]
    pub fn ports(&self) -> &[PortCounters] {
        &self.ports[..(self.port_count as usize).min(MAX_PORTS)]
    }

    /// Adds what a later life of the service did, so that many lives take no more room than one. Counts stay at their
    /// greatest; the digests are joined bit by bit.
    pub fn absorb(&mut self, later: &Self) {
        self.decisions = self.decisions.saturating_add(later.decisions);
        self.missed_decisions = self.missed_decisions.saturating_add(later.missed_decisions);
        self.invalid_inputs = self.invalid_inputs.saturating_add(later.invalid_inputs);
        self.pose_jumps = self.pose_jumps.saturating_add(later.pose_jumps);
        self.outcomes.iter_mut().zip(later.outcomes).for_each(|(n, more)| *n = n.saturating_add(more));
        self.digest.iter_mut().zip(later.digest).for_each(|(byte, other)| *byte ^= other);
        self.latencies.iter_mut().zip(&later.latencies).for_each(|(mine, theirs)| mine.add(theirs));
        let count = (self.port_count as usize).min(MAX_PORTS);
        for port in &mut self.ports[..count] {
            let same = |other: &&PortCounters| (other.topic, other.role, other.of) == (port.topic, port.role, port.of);
            if let Some(other) = later.ports().iter().find(same) {
                port.count = port.count.saturating_add(other.count);
                port.lost = port.lost.saturating_add(other.lost);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Health, LatencyHistogram, PortCounters};
    use crate::TopicId;

    #[test]
    fn a_quantile_is_within_five_percent_of_the_value() {
        for value_us in [2.0_f64, 17.0, 480.0, 22_000.0] {
            let mut histogram = LatencyHistogram::default();
            for _ in 0..100 {
                histogram.record((value_us * 1000.0) as u64);
            }
            histogram.record(3_000_000_000);
            let p50 = histogram.quantile_us(0.5).expect("values were recorded");
            assert!((p50 / value_us - 1.0).abs() < 0.05, "{p50} for {value_us}");
            assert!(histogram.quantile_us(1.0).expect("values were recorded") <= 3_000_000.0);
        }
    }

    #[test]
    fn a_life_absorbs_those_after_it() {
        let port = PortCounters { topic: TopicId::Odometry, count: 5, ..PortCounters::default() };
        let mut life = Health { decisions: 2, port_count: 1, ..Health::default() };
        life.ports[0] = port;
        let mut later = Health { decisions: u64::MAX, port_count: 1, ..life };
        later.ports[0].count = 7;
        life.absorb(&later);
        assert_eq!((life.decisions, life.ports[0].count), (u64::MAX, 12));
    }

    #[test]
    fn lives_add_up() {
        let mut a = LatencyHistogram::default();
        let mut b = LatencyHistogram::default();
        a.record(5_000);
        b.record(9_000);
        a.add(&b);
        assert_eq!((a.n, a.max_ns), (2, 9_000));
    }
}
