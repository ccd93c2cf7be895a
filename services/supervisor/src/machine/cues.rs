//! Cues: which are accepted, and whether one would be.

use messages::{Cue, CueInForce, CueKind, CueSource, ModeClass, StopInput, StopKind, StopReason, age_ns};

use super::watched::Phase;
use super::{Action, Machine, Now};

impl Machine {
    pub(super) fn on_cue(&mut self, cue: &Cue, now: Now) {
        if cue.header.order() <= self.last_cue {
            return;
        }
        // One from the future is refused below, and makes none of the present old.
        if age_ns(now.run_ns, cue.header.stamp_ns) < u64::MAX {
            self.last_cue = cue.header.order();
        }
        if !cue.kind.is_moving() {
            // Locomotion took it already; here it ends the cue in force.
            self.mode.cue = CueInForce::default();
            self.mode_changed = true;
            return;
        }
        if let Err(why) = self.may_accept(cue, now) {
            self.actions.push(Action::Note(format!("cue \"{}\" refused: {why}", cue.kind.name())));
            return;
        }
        if self.mode.class == ModeClass::Fault {
            self.mode.class = ModeClass::Run;
            self.mode.reason = StopReason::default();
            self.stops.end_mode_stop(now.run_ns);
        }
        self.mode.cue = CueInForce { valid: true, cue: *cue };
        self.mode_changed = true;
    }

    pub(super) fn may_accept(&self, cue: &Cue, now: Now) -> Result<(), String> {
        let age = age_ns(now.run_ns, cue.header.stamp_ns);
        if age > self.limits.cue_max_age_ns {
            return Err(format!(
                "it is {} ms old, limit {} ms",
                age / 1_000_000,
                self.limits.cue_max_age_ns / 1_000_000
            ));
        }
        if !cue.is_usable() {
            return Err("its start frame or its confidence is none".to_owned());
        }
        if cue.source == CueSource::TurnDone && !self.continues(cue) {
            return Err("the turn that it goes on from is no longer in force".to_owned());
        }
        match self.mode.class {
            ModeClass::Lock => Err(format!("the run is locked: {}", self.mode.reason)),
            ModeClass::Fault => match self.not_ready(now) {
                Some(why) => Err(format!("not ready: {why}")),
                None if cue.header.stamp_ns <= self.stopped_at_ns => Err("it was given before the stop".to_owned()),
                None => Ok(()),
            },
            ModeClass::Run => Ok(()),
        }
    }

    /// Whether a cue that no handler gave goes on from the very turn in force.
    pub(super) fn continues(&self, cue: &Cue) -> bool {
        let turn = &self.mode.cue.cue;
        let is_turn = matches!(turn.kind, CueKind::Left | CueKind::Right);
        self.mode.class == ModeClass::Run && self.mode.cue.valid && is_turn && turn.header.seq == cue.request_seq
    }

    /// Why a cue would not be accepted in fault, if so.
    #[must_use]
    pub fn not_ready(&self, now: Now) -> Option<String> {
        let stepped = self.limits.stepped;
        if self.mode.class == ModeClass::Lock {
            return Some(format!("the run is locked: {}", self.mode.reason));
        }
        if self.estop != StopInput::Released {
            return Some(format!("the emergency stop is {}", self.estop.name()));
        }
        if self.battery_is_low() {
            return Some(StopReason::of(StopKind::BatteryLow).to_string());
        }
        for s in self.services.iter().filter(|s| s.is_critical()) {
            if s.phase != Phase::Ready || (stepped && !s.joined) {
                return Some(format!("{} is not up", s.plan.service));
            }
            if !s.armed {
                return Some(format!("the line of {} is not armed", s.plan.service));
            }
            if !s.beats_on_time(now.run_ns) {
                return Some(format!("{} is silent", s.plan.service));
            }
        }
        self.stale_stream(now, 1).map(|reason| reason.to_string())
    }

    pub(super) fn update_ready(&mut self, now: Now) {
        let ready = self.mode.class != ModeClass::Lock && self.not_ready(now).is_none();
        if ready != self.mode.ready_for_cue {
            self.mode.ready_for_cue = ready;
            self.mode_changed = true;
        }
    }
}
