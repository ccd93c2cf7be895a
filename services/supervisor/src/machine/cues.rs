//! Cues: which are accepted, and whether one would be.

use messages::{Cue, CueAnswer, CueInForce, CueKind, CueRefusal, CueSource, ModeClass, StopInput, StopReason, age_ns};

use super::watched::Phase;
use super::{Action, Machine, Now, Refused};

impl Machine {
    pub(super) fn on_cue(&mut self, cue: &Cue, now: Now) {
        // A stop counts whenever it comes: whatever was accepted meanwhile, somebody wants the robot to stand.
        if cue.kind.is_moving() && cue.header.order() <= self.last_cue {
            // The same once more is no news to anybody.
            if cue.header.order() < self.last_cue {
                self.answer(cue, Some(&Refused::of(CueRefusal::TooOld)));
            }
            return;
        }
        // One from the future is refused below, and makes none of the present old.
        if age_ns(now.run_ns, cue.header.stamp_ns) < u64::MAX {
            self.last_cue = self.last_cue.max(cue.header.order());
        }
        if !cue.kind.is_moving() {
            // Locomotion took it already; here it ends the cue in force.
            self.mode.cue = CueInForce::default();
            self.ask_no_more();
            self.mode_changed = true;
            self.answer(cue, None);
            return;
        }
        if let Err(why) = self.may_accept(cue, now) {
            let not_ready = if why.is_not_ready() { "not ready: " } else { "" };
            self.actions.push(Action::Note(format!("cue \"{}\" refused: {not_ready}{why}", cue.kind.name())));
            self.answer(cue, Some(&why));
            return;
        }
        if self.mode.class == ModeClass::Fault {
            self.mode.class = ModeClass::Run;
            self.mode.reason = StopReason::default();
            self.stops.end_mode_stop(now.run_ns);
        }
        self.agree_on_formation(cue);
        self.cue_accepted_ns = now.run_ns;
        self.mode.cue = CueInForce { valid: true, cue: *cue };
        self.mode_changed = true;
        self.answer(cue, None);
    }

    /// Tells whoever gave a cue what became of it.
    fn answer(&mut self, cue: &Cue, refused: Option<&Refused>) {
        self.actions.push(Action::Answer(CueAnswer {
            kind: cue.kind,
            source: cue.source,
            cue_incarnation: cue.header.incarnation,
            cue_seq: cue.header.seq,
            refusal: refused.map_or(CueRefusal::None, |why| why.refusal),
            reason: refused.map_or(StopReason::default(), |why| why.reason),
            ..CueAnswer::default()
        }));
    }

    pub(super) fn may_accept(&self, cue: &Cue, now: Now) -> Result<(), Refused> {
        let (age_ns, limit_ns) = (age_ns(now.run_ns, cue.header.stamp_ns), self.limits.cue_max_age_ns);
        if age_ns > limit_ns {
            return Err(Refused::new(CueRefusal::TooOld, StopReason { age_ns, limit_ns, ..StopReason::default() }));
        }
        if !cue.is_usable() {
            return Err(Refused::of(CueRefusal::Unusable));
        }
        if cue.source == CueSource::TurnDone && !self.continues(cue) {
            return Err(Refused::of(CueRefusal::TurnOver));
        }
        match self.mode.class {
            ModeClass::Lock => Err(Refused::new(CueRefusal::Locked, self.mode.reason)),
            ModeClass::Fault => match self.not_ready(now) {
                Some(why) => Err(why),
                None if cue.header.stamp_ns <= self.stopped_at_ns => Err(Refused::of(CueRefusal::BeforeStop)),
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

    /// Why no cue would be accepted now, if so.
    #[must_use]
    pub fn not_ready(&self, now: Now) -> Option<Refused> {
        let stepped = self.limits.stepped;
        if self.mode.class == ModeClass::Lock {
            return Some(Refused::new(CueRefusal::Locked, self.mode.reason));
        }
        if self.estop != StopInput::Released {
            return Some(Refused::estop(self.estop));
        }
        if self.battery_is_low() {
            return Some(Refused::of(CueRefusal::BatteryLow));
        }
        for s in self.services.iter().filter(|s| s.is_critical()) {
            let refused = |refusal| Some(Refused::service(refusal, s.plan.service, s.incarnation));
            if s.phase != Phase::Ready || (stepped && !s.joined) {
                return refused(CueRefusal::ServiceNotUp);
            }
            if !s.armed {
                return refused(CueRefusal::LineNotArmed);
            }
            if !s.beats_on_time(now.run_ns) {
                return refused(CueRefusal::ServiceSilent);
            }
        }
        self.stale_stream(now, 1).map(|reason| Refused::new(CueRefusal::StreamStale, reason))
    }

    pub(super) fn update_ready(&mut self, now: Now) {
        let ready = self.mode.class != ModeClass::Lock && self.not_ready(now).is_none();
        if ready != self.mode.ready_for_cue {
            self.mode.ready_for_cue = ready;
            self.mode_changed = true;
        }
    }
}
