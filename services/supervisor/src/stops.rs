//! What stopped the robot, why, when and for how long.

use std::collections::{BTreeMap, VecDeque};

use crate::freeze::Freeze;
use messages::{LocomotionState, Mode, ModeClass, StopClass, StopReason};

/// So many stops are kept, the newest; of those before them only their time is.
const MAX_STOPS: usize = 1000;

/// One stop.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// Hold or latched within run, fault or lock as a mode.
    pub class: StopClass,
    /// Why.
    pub reason: StopReason,
    /// Run time of its beginning.
    pub at_ns: u64,
    /// Run time of its end; none while it lasts.
    pub ended_ns: Option<u64>,
}

impl Stop {
    /// How long it lasted, or has by now, nanoseconds.
    #[must_use]
    pub fn lasted_ns(&self, now_ns: u64) -> u64 {
        self.ended_ns.unwrap_or(now_ns).saturating_sub(self.at_ns)
    }
}

/// All stops of a run.
#[derive(Debug, Default)]
pub struct StopLog {
    stops: VecDeque<Stop>,
    /// Stops that had to make room.
    pub not_kept: u64,
    /// How long they lasted, by the name of their kind, nanoseconds.
    gone_ns: BTreeMap<&'static str, u64>,
    mode_stop: Option<usize>,
    hold: Option<usize>,
    /// How long the robot got nowhere.
    pub freeze: Freeze,
}

impl StopLog {
    /// The newest stops, the oldest of them first.
    #[must_use]
    pub fn stops(&self) -> &VecDeque<Stop> {
        &self.stops
    }

    /// How long the robot stood, by the name of the kind of stop, nanoseconds.
    #[must_use]
    pub fn lasted_ns(&self, now_ns: u64) -> BTreeMap<&'static str, u64> {
        let mut sums = self.gone_ns.clone();
        for stop in &self.stops {
            *sums.entry(stop.reason.kind.name()).or_default() += stop.lasted_ns(now_ns);
        }
        sums
    }

    fn begin(&mut self, class: StopClass, reason: StopReason, at_ns: u64) -> Option<usize> {
        if self.stops.len() >= MAX_STOPS
            && let Some(oldest) = self.stops.pop_front()
        {
            self.not_kept += 1;
            *self.gone_ns.entry(oldest.reason.kind.name()).or_default() += oldest.lasted_ns(at_ns);
        }
        self.stops.push_back(Stop { class, reason, at_ns, ended_ns: None });
        Some(self.not_kept as usize + self.stops.len() - 1)
    }

    /// How many stops have begun.
    #[must_use]
    pub fn begun(&self) -> usize {
        self.not_kept as usize + self.stops.len()
    }

    /// The stop of that number, counted from the run's beginning, if it is kept.
    #[must_use]
    pub fn get(&self, number: usize) -> Option<&Stop> {
        self.stops.get(number.checked_sub(self.not_kept as usize)?)
    }

    fn end(&mut self, number: Option<usize>, now_ns: u64) {
        let kept = number.and_then(|number| number.checked_sub(self.not_kept as usize));
        if let Some(stop) = kept.and_then(|i| self.stops.get_mut(i)) {
            stop.ended_ns = Some(now_ns);
        }
    }

    /// Fault or lock begins; one that lasts gives way to it.
    pub fn begin_mode_stop(&mut self, class: ModeClass, reason: StopReason, now_ns: u64) {
        self.end_mode_stop(now_ns);
        let hold = self.hold.take();
        self.end(hold, now_ns);
        let class = if class == ModeClass::Lock { StopClass::Lock } else { StopClass::Fault };
        self.mode_stop = self.begin(class, reason, now_ns);
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
        let same = self.hold.and_then(|number| self.get(number)).is_some_and(|stop| stop.reason.kind == kind);
        if !stands || !same {
            let hold = self.hold.take();
            self.end(hold, now_ns);
        }
        // A state that was on its way when run began still tells of the stop before.
        if stands
            && self.hold.is_none()
            && let Some(stop) = kind.info().filter(|stop| stop.holds_a_cue)
        {
            self.hold = self.begin(stop.class, state.limited_by, now_ns);
        }
        self.freeze.take(mode, state, now_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::{MAX_STOPS, StopLog};
    use messages::{ModeClass, StopKind, StopReason};

    #[test]
    fn the_newest_stops_are_kept_and_the_time_of_all() {
        let mut log = StopLog::default();
        for i in 0..MAX_STOPS as u64 + 50 {
            log.begin_mode_stop(ModeClass::Fault, StopReason::of(StopKind::ServiceDied), 10 * i);
            log.end_mode_stop(10 * i + 4);
        }
        assert_eq!((log.stops().len(), log.not_kept), (MAX_STOPS, 50));
        let last = log.stops().back().map(|stop| (stop.at_ns, stop.ended_ns));
        assert_eq!(last, Some((10 * (MAX_STOPS as u64 + 49), Some(10 * (MAX_STOPS as u64 + 49) + 4))));
        assert_eq!(log.lasted_ns(1 << 40)["service_died"], 4 * (MAX_STOPS as u64 + 50));
    }
}
