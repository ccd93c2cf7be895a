//! Why a cue is refused, or would be.

use messages::{CueRefusal, ServiceId, StopInput, StopKind, StopReason};

/// Why a cue is refused, or would be, with evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused {
    /// Why.
    pub refusal: CueRefusal,
    /// The service or stream that is lacking, the age that is too great, or the stop that locks the run.
    pub reason: StopReason,
    /// What is known of the emergency stop.
    estop: StopInput,
}

impl Refused {
    pub(super) fn new(refusal: CueRefusal, reason: StopReason) -> Self {
        Self { refusal, reason, estop: StopInput::Released }
    }

    pub(super) fn of(refusal: CueRefusal) -> Self {
        Self::new(refusal, StopReason::default())
    }

    pub(super) fn service(refusal: CueRefusal, service: ServiceId, incarnation: u32) -> Self {
        Self::new(refusal, StopReason::service(StopKind::None, service, incarnation))
    }

    pub(super) fn estop(estop: StopInput) -> Self {
        Self { estop, ..Self::of(CueRefusal::EmergencyStop) }
    }

    /// Whether the run is not ready for any cue, rather than that this one cannot be taken.
    #[must_use]
    pub fn is_not_ready(&self) -> bool {
        !matches!(
            self.refusal,
            CueRefusal::None
                | CueRefusal::TooOld
                | CueRefusal::Unusable
                | CueRefusal::TurnOver
                | CueRefusal::BeforeStop
                | CueRefusal::Locked
        )
    }
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (reason, ms) = (&self.reason, |ns: u64| ns / 1_000_000);
        match self.refusal {
            CueRefusal::None => f.write_str("it is not"),
            CueRefusal::TooOld => write!(f, "it is {} ms old, limit {} ms", ms(reason.age_ns), ms(reason.limit_ns)),
            CueRefusal::Unusable => f.write_str("its start frame or its confidence is none"),
            CueRefusal::TurnOver => f.write_str("the turn that it goes on from is no longer in force"),
            CueRefusal::BeforeStop => f.write_str("it was given before the stop"),
            CueRefusal::Locked => write!(f, "the run is locked: {reason}"),
            CueRefusal::ServiceNotUp => write!(f, "{} is not up", reason.service),
            CueRefusal::LineNotArmed => write!(f, "the line of {} is not armed", reason.service),
            CueRefusal::ServiceSilent => write!(f, "{} is silent", reason.service),
            CueRefusal::StreamStale => write!(f, "{reason}"),
            CueRefusal::EmergencyStop => write!(f, "the emergency stop is {}", self.estop.name()),
            CueRefusal::BatteryLow => f.write_str(StopKind::BatteryLow.name()),
        }
    }
}
