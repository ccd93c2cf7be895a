//! What stopped the robot, why, when and for how long.

use messages::{LocomotionState, Mode, ModeClass, StopReason};

/// The most stops kept; more than that are counted only.
const MAX_STOPS: usize = 1000;

/// One stop.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// "hold", "fault" or "lock".
    pub class: &'static str,
    /// Why.
    pub reason: StopReason,
    /// Run time of its beginning.
    pub at_ns: u64,
    /// Run time of its end; none while it lasts.
    pub ended_ns: Option<u64>,
}

/// All stops of a run.
#[derive(Debug, Default)]
pub struct StopLog {
    stops: Vec<Stop>,
    /// Stops that found no room.
    pub not_kept: u64,
    mode_stop: Option<usize>,
    hold: Option<usize>,
    frozen_since_ns: Option<u64>,
    /// Longest time at a stand while a moving cue was in force in run.
    pub longest_freeze_ns: u64,
}

impl StopLog {
    /// The stops, the oldest first.
    #[must_use]
    pub fn stops(&self) -> &[Stop] {
        &self.stops
    }

    fn begin(&mut self, class: &'static str, reason: StopReason, at_ns: u64) -> Option<usize> {
        if self.stops.len() >= MAX_STOPS {
            self.not_kept += 1;
            return None;
        }
        self.stops.push(Stop { class, reason, at_ns, ended_ns: None });
        Some(self.stops.len() - 1)
    }

    fn end(&mut self, index: Option<usize>, now_ns: u64) {
        if let Some(stop) = index.and_then(|i| self.stops.get_mut(i)) {
            stop.ended_ns = Some(now_ns);
        }
    }

    /// Fault or lock begins; one that lasts gives way to it.
    pub fn begin_mode_stop(&mut self, class: ModeClass, reason: StopReason, now_ns: u64) {
        self.end_mode_stop(now_ns);
        let hold = self.hold.take();
        self.end(hold, now_ns);
        self.mode_stop = self.begin(class.name(), reason, now_ns);
    }

    /// Fault or lock ends.
    pub fn end_mode_stop(&mut self, now_ns: u64) {
        let stop = self.mode_stop.take();
        self.end(stop, now_ns);
    }

    /// What locomotion does, for holds and freezes.
    pub fn locomotion(&mut self, mode: &Mode, state: &LocomotionState, now_ns: u64) {
        let asked = mode.class == ModeClass::Run && mode.cue.valid;
        let stands = asked && state.applied.is_zero() && state.epoch == mode.epoch;
        let kind = state.limited_by.kind;
        let same = self.hold.and_then(|i| self.stops.get(i)).is_some_and(|stop| stop.reason.kind == kind);
        if !stands || !same {
            let hold = self.hold.take();
            self.end(hold, now_ns);
        }
        // A state that was on its way when run began still tells of the stop before.
        if stands && self.hold.is_none() && kind.is_hold() {
            self.hold = self.begin("hold", state.limited_by, now_ns);
        }
        if stands {
            let since = *self.frozen_since_ns.get_or_insert(now_ns);
            self.longest_freeze_ns = self.longest_freeze_ns.max(now_ns - since);
        } else {
            self.frozen_since_ns = None;
        }
    }
}
