//! The tone before a spoken cue that would start the robot: the cue is given once its tone was heard, and only then.
//! Who was misheard hears it, and has until its end to say stop or to let go. Pure.

use messages::{NS_PER_S, SpeechPhase, SpeechSaid, Urgency};

use super::Said;

/// A tone that has not begun by then is not heard, nanoseconds: a player starts in a tenth of it.
const BEGINS_WITHIN_NS: u64 = NS_PER_S * 3 / 10;

/// A cue that waits for its tone.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    said: Said,
    /// Run time at which it is given up, or given where the tone has begun, nanoseconds.
    by_ns: u64,
    begun: bool,
}

/// The cue that waits for its tone, if any does.
#[derive(Debug, Clone, Copy, Default)]
pub struct Confirmation {
    waiting: Option<Waiting>,
}

/// What became of a cue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Confirmed {
    /// Its tone was heard: it is given.
    Given(Said),
    /// There was none: it is not given.
    Unheard(Said),
}

impl Confirmation {
    /// A cue was said that needs its tone; one that waited is forgotten.
    pub fn ask(&mut self, said: Said, now_ns: u64) {
        self.waiting = Some(Waiting { said, by_ns: now_ns + BEGINS_WITHIN_NS, begun: false });
    }

    /// Something else came meanwhile.
    pub fn forget(&mut self) {
        self.waiting = None;
    }

    /// The robot's voice has told how far it is.
    pub fn hear(&mut self, voice: &SpeechSaid) {
        let Some(waiting) = &mut self.waiting else { return };
        if voice.urgency != Urgency::Tone || voice.about_ns != waiting.said.stamp_ns {
            return;
        }
        match voice.phase {
            SpeechPhase::Begun => {
                waiting.begun = true;
                waiting.by_ns = voice.first_sample_ns.saturating_add(voice.duration_ns);
            }
            // A player that ended early says so late: what counts is how long the tone takes.
            SpeechPhase::Ended => {}
            SpeechPhase::Cut | SpeechPhase::Unheard => (waiting.begun, waiting.by_ns) = (false, 0),
        }
    }

    /// What is due of it.
    pub fn due(&mut self, now_ns: u64) -> Option<Confirmed> {
        let waiting = self.waiting.take_if(|waiting| now_ns >= waiting.by_ns)?;
        Some(if waiting.begun { Confirmed::Given(waiting.said) } else { Confirmed::Unheard(waiting.said) })
    }

    /// Run time at which something is due, if anything waits.
    pub fn next_ns(&self) -> Option<u64> {
        self.waiting.map(|waiting| waiting.by_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::{Confirmation, Confirmed};
    use crate::voice::Said;
    use messages::{CueKind, SpeechPhase, SpeechSaid, Urgency};

    const MS: u64 = 1_000_000;
    const SAID: Said = Said {
        kind: CueKind::Forward,
        score: 0.95,
        stamp_ns: 1_000 * MS,
        signal_db: 30.0,
        clipped: 0.0,
        after_stop: true,
    };

    fn tone(phase: SpeechPhase) -> SpeechSaid {
        let (about_ns, first_sample_ns, duration_ns) = (SAID.stamp_ns, 1_310 * MS, 200 * MS);
        SpeechSaid { phase, urgency: Urgency::Tone, about_ns, first_sample_ns, duration_ns, ..SpeechSaid::default() }
    }

    fn asked() -> Confirmation {
        let mut confirmation = Confirmation::default();
        assert_eq!((confirmation.next_ns(), confirmation.due(u64::MAX)), (None, None));
        confirmation.ask(SAID, 1_300 * MS);
        confirmation
    }

    #[test]
    fn it_is_given_once_its_tone_was_heard_and_once() {
        let mut confirmation = asked();
        confirmation.hear(&tone(SpeechPhase::Begun));
        assert_eq!((confirmation.next_ns(), confirmation.due(1_509 * MS)), (Some(1_510 * MS), None));
        assert_eq!(confirmation.due(1_510 * MS), Some(Confirmed::Given(SAID)));
        assert_eq!(confirmation.due(u64::MAX), None);
    }

    #[test]
    fn without_its_tone_it_is_not_given() {
        let mut confirmation = asked();
        confirmation.hear(&SpeechSaid { urgency: Urgency::News, ..tone(SpeechPhase::Begun) });
        confirmation.hear(&SpeechSaid { about_ns: 1, ..tone(SpeechPhase::Begun) });
        assert_eq!(confirmation.due(1_599 * MS), None, "these are not its own");
        assert_eq!(confirmation.due(1_600 * MS), Some(Confirmed::Unheard(SAID)), "nobody answers");
        for phase in [SpeechPhase::Cut, SpeechPhase::Unheard] {
            let mut confirmation = asked();
            confirmation.hear(&tone(SpeechPhase::Begun));
            confirmation.hear(&tone(phase));
            assert_eq!(confirmation.due(1_400 * MS), Some(Confirmed::Unheard(SAID)), "{phase:?}");
        }
    }

    #[test]
    fn what_comes_meanwhile_ends_it() {
        let mut confirmation = asked();
        confirmation.hear(&tone(SpeechPhase::Begun));
        confirmation.forget();
        assert_eq!(confirmation.due(u64::MAX), None);
    }
}
