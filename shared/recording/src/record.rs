//! One recorded message.

use messages::{Header, Odometry, ScanHeader, TopicId};

/// One recorded message, of one topic.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// Of `lidar/scan`.
    Scan {
        /// What stands beside the ranges.
        header: ScanHeader,
        /// Metres, in the order of their angles; at most [`messages::MAX_BEAMS`]. At or over `range_max_m` nothing was
        /// hit; NaN, negative or under `range_min_m` is unknown.
        ranges_m: Vec<f32>,
    },
    /// Of `odometry`.
    Odometry(Odometry),
}

impl Record {
    /// The topic that it was published on.
    #[must_use]
    pub const fn topic(&self) -> TopicId {
        match self {
            Self::Scan { .. } => TopicId::LidarScan,
            Self::Odometry(_) => TopicId::Odometry,
        }
    }

    /// Stamp, seq, incarnation.
    #[must_use]
    pub const fn header(&self) -> &Header {
        match self {
            Self::Scan { header, .. } => &header.header,
            Self::Odometry(odometry) => &odometry.header,
        }
    }

    /// Run time of the measurement, nanoseconds.
    #[must_use]
    pub const fn stamp_ns(&self) -> u64 {
        self.header().stamp_ns
    }

    /// What records are ordered by: stamp, topic, seq.
    #[must_use]
    pub const fn order(&self) -> (u64, TopicId, u64) {
        let header = self.header();
        (header.stamp_ns, self.topic(), header.seq)
    }
}
