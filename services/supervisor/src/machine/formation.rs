//! Where the handler walks: they are asked for another place, and agree by the cue *forward*.

use messages::{Cue, CueKind, CueSource, Formation, LocomotionState, ModeClass, StopKind};

use super::Machine;

/// The robot stands, and the handler is to walk elsewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Asking {
    formation: Formation,
    /// The robot asks for it. Otherwise a handler who walked behind is seen there no longer.
    is_asked: bool,
    /// Run time of the first state that asked, nanoseconds.
    since_ns: u64,
}

impl Asking {
    /// What a stop that began then means for a handler who walks there.
    fn by(kind: StopKind, formation: Formation, since_ns: u64) -> Option<Self> {
        let to = |formation, is_asked| Some(Self { formation, is_asked, since_ns });
        match (kind, formation) {
            (StopKind::Narrow, _) => to(Formation::Behind, true),
            (StopKind::Wide, _) => to(Formation::Beside, true),
            (StopKind::HandlerNotSeen, Formation::Behind) => to(Formation::Beside, false),
            _ => None,
        }
    }
}

impl Machine {
    /// Notes whether the robot asks for a formation. It goes on asking until it moves: between two permits the reason
    /// may be another for a moment. The handler knows of it only where the robot speaks, and some time after it began.
    pub(super) fn note_asking(&mut self, state: &LocomotionState) {
        if self.mode.class != ModeClass::Run || state.epoch != self.mode.epoch || !state.applied.is_zero() {
            self.ask_no_more();
            return;
        }
        let stamp_ns = state.header.stamp_ns;
        let asked = Asking::by(state.limited_by.kind, self.mode.formation, stamp_ns);
        let is_same = |asked: &Asking, asking: Asking| Asking { since_ns: stamp_ns, ..asking } == *asked;
        if let Some(asked) = asked.filter(|asked| self.asking.is_none_or(|asking| !is_same(asked, asking))) {
            self.asking = Some(asked);
        }
        let question = self.asking.filter(|asking| asking.is_asked);
        let Some((asking, after_ns)) = question.zip(self.limits.asked_after_ns) else { return };
        if stamp_ns >= asking.since_ns.saturating_add(after_ns) && self.mode.formation_asked != asking.formation {
            self.mode.formation_asked = asking.formation;
            self.mode_changed = true;
        }
    }

    /// Nothing is asked of the handler.
    pub(super) fn ask_no_more(&mut self) {
        self.asking = None;
        if self.mode.formation_asked != self.mode.formation {
            self.mode.formation_asked = self.mode.formation;
            self.mode_changed = true;
        }
    }

    /// A moving cue was accepted. A *forward* of the handler's own agrees to what was asked before they gave it; any
    /// other cue ends the question.
    pub(super) fn agree_on_formation(&mut self, cue: &Cue) {
        let is_own = cue.kind == CueKind::Forward && cue.source != CueSource::TurnDone;
        let knows = |asking: &Asking, after_ns: u64| cue.header.stamp_ns >= asking.since_ns.saturating_add(after_ns);
        let asked = self.asking.filter(|asking| self.limits.asked_after_ns.is_some_and(|ns| knows(asking, ns)));
        if let Some(asking) = asked.filter(|_| is_own) {
            self.mode.formation = asking.formation;
        }
        self.ask_no_more();
    }
}
