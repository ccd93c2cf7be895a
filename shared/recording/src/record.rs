//! One recorded message.

use messages::{
    Cue, CueAnswer, CueHeard, CueRequest, DepthHeader, EmergencyStop, Header, LocomotionState, Mode, Odometry, Permit,
    PolicyAction, ScanHeader, SpeechSaid, TopicId, WorldTruth,
};

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
    /// Of `depth/frame`.
    Depth {
        /// What stands beside the pixels.
        header: DepthHeader,
        /// Millimetres, 0 = none, row by row from the top left; `width * height` of them.
        pixels_mm: Vec<u16>,
    },
    /// Of `odometry`.
    Odometry(Odometry),
    /// Of `cue`.
    Cue(Cue),
    /// Of `cue/request`.
    CueRequest(CueRequest),
    /// Of `policy/action`.
    Action(Box<PolicyAction>),
    /// Of `shield/permit`.
    Permit(Box<Permit>),
    /// Of `mode`.
    Mode(Box<Mode>),
    /// Of `locomotion/state`.
    Locomotion(Box<LocomotionState>),
    /// Of `estop`.
    Estop(EmergencyStop),
    /// Of `cue/answer`.
    CueAnswer(Box<CueAnswer>),
    /// Of `cue/heard`.
    Heard(CueHeard),
    /// Of `speech/said`.
    Said(Box<SpeechSaid>),
    /// Of `world/truth`.
    Truth(Box<WorldTruth>),
}

/// What [`Record::order`] sorts by.
pub type Order = (u64, TopicId, u64);

impl Record {
    /// The topic that it was published on.
    #[must_use]
    pub const fn topic(&self) -> TopicId {
        match self {
            Self::Scan { .. } => TopicId::LidarScan,
            Self::Depth { .. } => TopicId::DepthFrame,
            Self::Odometry(_) => TopicId::Odometry,
            Self::Cue(_) => TopicId::Cue,
            Self::CueRequest(_) => TopicId::CueRequest,
            Self::Action(_) => TopicId::PolicyAction,
            Self::Permit(_) => TopicId::ShieldPermit,
            Self::Mode(_) => TopicId::Mode,
            Self::Locomotion(_) => TopicId::LocomotionState,
            Self::Estop(_) => TopicId::Estop,
            Self::CueAnswer(_) => TopicId::CueAnswer,
            Self::Heard(_) => TopicId::CueHeard,
            Self::Said(_) => TopicId::SpeechSaid,
            Self::Truth(_) => TopicId::WorldTruth,
        }
    }

    /// Stamp, seq, incarnation.
    #[must_use]
    pub const fn header(&self) -> &Header {
        match self {
            Self::Scan { header, .. } => &header.header,
            Self::Depth { header, .. } => &header.header,
            Self::Odometry(odometry) => &odometry.header,
            Self::Cue(cue) => &cue.header,
            Self::CueRequest(request) => &request.header,
            Self::Action(action) => &action.header,
            Self::Permit(permit) => &permit.header,
            Self::Mode(mode) => &mode.header,
            Self::Locomotion(state) => &state.header,
            Self::Estop(stop) => &stop.header,
            Self::CueAnswer(answer) => &answer.header,
            Self::Heard(heard) => &heard.header,
            Self::Said(said) => &said.header,
            Self::Truth(truth) => &truth.header,
        }
    }

    /// Run time of the measurement, nanoseconds.
    #[must_use]
    pub const fn stamp_ns(&self) -> u64 {
        self.header().stamp_ns
    }

    /// Run time at which it was published, nanoseconds; of an import, which does not know, that of the measurement.
    #[must_use]
    pub const fn time_ns(&self) -> u64 {
        let header = self.header();
        if header.published_ns > 0 { header.published_ns } else { header.stamp_ns }
    }

    /// Whether two records are the same to the byte, as they would be recorded; a NaN is a NaN.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        let bytes = |record: &Self| {
            let mut bytes = Vec::new();
            crate::channel::encode(record, &mut bytes).map(|()| bytes)
        };
        matches!((bytes(self), bytes(other)), (Ok(one), Ok(another)) if one == another)
    }

    /// What records are ordered by: time of publication, topic, seq.
    #[must_use]
    pub const fn order(&self) -> Order {
        (self.time_ns(), self.topic(), self.header().seq)
    }
}
