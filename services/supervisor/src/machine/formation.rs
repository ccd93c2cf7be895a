//! Where the handler walks: they are asked for another place, and agree by the cue *forward*.

use messages::{Cue, CueKind, CueSource, Formation, LocomotionState, Mode, ModeClass, NS_PER_S, StopKind};

use super::Machine;

/// Another reason that shows for no longer is no break in a question: between two permits there may be one.
const BREAK_NS: u64 = NS_PER_S / 5;
/// A state of locomotion so shortly after a cue may be of before it.
const IN_FLIGHT_NS: u64 = NS_PER_S / 10;
/// A handler who is not found behind the robot for so long may say *forward* from beside it.
const NOT_FOUND_NS: u64 = 10 * NS_PER_S;

/// The robot stands, and the handler is to walk elsewhere.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asking {
    formation: Formation,
    /// The robot asks for it. Otherwise a handler who walked behind is seen there no longer.
    is_asked: bool,
    /// Run time of the first state and of the last one that say so, nanoseconds.
    since_ns: u64,
    last_ns: u64,
}

impl Asking {
    /// What a stop means for a handler who walks there: where they are to walk, and whether they are asked to.
    fn by(kind: StopKind, formation: Formation) -> Option<(Formation, bool)> {
        match (kind, formation) {
            (StopKind::Narrow, _) => Some((Formation::Behind, true)),
            (StopKind::Wide, _) => Some((Formation::Beside, true)),
            (StopKind::HandlerNotSeen, Formation::Behind) => Some((Formation::Beside, false)),
            _ => None,
        }
    }

    /// Run time from which on the handler knows of it, nanoseconds.
    fn known_at_ns(&self, asked_after_ns: u64) -> u64 {
        let after_ns = if self.is_asked { asked_after_ns } else { NOT_FOUND_NS };
        self.since_ns.saturating_add(after_ns)
    }
}

impl Machine {
    /// Notes whether the robot asks for a formation. The handler knows of it only where the robot speaks, and some time
    /// after it began. A break begins that time anew, as the voice says it anew.
    pub(super) fn note_asking(&mut self, state: &LocomotionState) {
        let Mode { class, epoch, cue, formation, .. } = self.mode;
        let is_asked_forward = class == ModeClass::Run && cue.valid && cue.cue.kind == CueKind::Forward;
        if !is_asked_forward || state.epoch != epoch || !state.applied.is_zero() {
            self.ask_no_more();
            return;
        }
        let stamp_ns = state.header.stamp_ns;
        if stamp_ns < self.cue_accepted_ns.saturating_add(IN_FLIGHT_NS) {
            return;
        }
        let goes_on = |asking: &Asking| stamp_ns.saturating_sub(asking.last_ns) <= BREAK_NS;
        let before = self.asking.filter(goes_on);
        let Some((formation, is_asked)) = Asking::by(state.limited_by.kind, formation) else {
            if before.is_none() {
                self.ask_no_more();
            }
            return;
        };
        let same = before.filter(|asking| (asking.formation, asking.is_asked) == (formation, is_asked));
        let since_ns = same.map_or(stamp_ns, |asking| asking.since_ns);
        if same.is_none() {
            self.ask_no_more();
        }
        let asking = Asking { formation, is_asked, since_ns, last_ns: stamp_ns };
        self.asking = Some(asking);
        let is_known = self.limits.asked_after_ns.is_some_and(|after_ns| stamp_ns >= asking.known_at_ns(after_ns));
        if is_asked && is_known && self.mode.formation_asked != formation {
            self.mode.formation_asked = formation;
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
        let is_known = |asking: &Asking, after_ns: u64| cue.header.stamp_ns >= asking.known_at_ns(after_ns);
        let asked = self.asking.filter(|asking| self.limits.asked_after_ns.is_some_and(|ns| is_known(asking, ns)));
        if let Some(asking) = asked.filter(|_| is_own) {
            self.mode.formation = asking.formation;
        }
        self.ask_no_more();
    }
}
