//! The recorded handler's wish, where the run is not where the recording is: a part of it, or another round, begins in
//! fault while the recorded run walks. Pure.

use messages::{Cue, Mode, ModeClass, NS_PER_S};

/// A cue that was not accepted is given again after this long.
const RETRY_NS: u64 = NS_PER_S;

/// Gives the cue that is in force in the recording as soon as the run is ready for one.
#[derive(Debug, Default)]
pub struct Prompter {
    in_force: Option<Cue>,
    given_at_ns: Option<u64>,
}

impl Prompter {
    /// The recorded mode goes on.
    pub fn recorded(&mut self, mode: &Mode) {
        self.in_force = (mode.class == ModeClass::Run && mode.cue.valid).then_some(mode.cue.cue);
    }

    /// A recorded cue was given.
    pub fn given(&mut self, now_ns: u64) {
        self.given_at_ns = Some(now_ns);
    }

    /// The cue to give, if any.
    pub fn due(&mut self, now: &Mode, now_ns: u64) -> Option<Cue> {
        let waits = self.given_at_ns.is_some_and(|at| now_ns < at + RETRY_NS);
        if waits || now.class != ModeClass::Fault || !now.ready_for_cue {
            return None;
        }
        let cue = self.in_force?;
        self.given(now_ns);
        Some(cue)
    }
}

#[cfg(test)]
mod tests {
    use super::Prompter;
    use messages::{Cue, CueInForce, CueKind, Mode, ModeClass};

    const MS: u64 = 1_000_000;

    #[test]
    fn the_cue_in_force_is_given_once_the_run_is_ready_and_not_where_it_was_not_in_force() {
        let mut prompter = Prompter::default();
        let mut ready = Mode { class: ModeClass::Fault, ready_for_cue: true, ..Mode::default() };
        assert_eq!(prompter.due(&ready, 0), None, "the recorded run stands too");
        let cue = CueInForce { valid: true, cue: Cue { kind: CueKind::Left, ..Cue::default() } };
        prompter.recorded(&Mode { class: ModeClass::Run, cue, ..Mode::default() });
        assert_eq!(prompter.due(&Mode::default(), 100 * MS), None, "it is not ready");
        assert_eq!(prompter.due(&ready, 200 * MS).map(|cue| cue.kind), Some(CueKind::Left));
        assert_eq!(prompter.due(&ready, 300 * MS), None, "it may not be in force yet");
        assert!(prompter.due(&ready, 1200 * MS).is_some());
        ready.class = ModeClass::Run;
        assert_eq!(prompter.due(&ready, 9000 * MS), None);
        ready.class = ModeClass::Lock;
        assert_eq!(prompter.due(&ready, 9000 * MS), None);
    }
}
