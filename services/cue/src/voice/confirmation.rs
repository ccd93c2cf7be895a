//! The tone before a spoken cue that would start the robot: the cue is given once its tone was heard, and only then.
//! Who was misheard hears it, and has until its end to say stop or to let go. Pure.

use messages::{NS_PER_S, SpeechPhase, SpeechSaid, Urgency};

use super::Said;

/// A tone that has not begun by then is not heard, nanoseconds: a player starts in a tenth of it.
const BEGINS_WITHIN_NS: u64 = NS_PER_S * 3 / 10;
/// Nor one that has not ended so long after its length: its player hangs, or the voice that would tell so is gone. A
/// player that opens a device takes less; whoever is later than this is too late for the cue to be accepted.
const ENDS_WITHIN_NS: u64 = NS_PER_S * 6 / 10;
/// A player that ends before so much of the tone can have been heard has not played it, percent.
const HEARD_PERCENT: u64 = 80;

/// A cue that waits for its tone.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    said: Said,
    /// Run time at which it is given, where its tone was heard, or else given up, nanoseconds.
    by_ns: u64,
    heard: bool,
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
        self.waiting = Some(Waiting { said, by_ns: now_ns + BEGINS_WITHIN_NS, heard: false });
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
        let least_ns = voice.first_sample_ns.saturating_add(voice.duration_ns / 100 * HEARD_PERCENT);
        let end_ns = voice.first_sample_ns.saturating_add(voice.duration_ns);
        (waiting.heard, waiting.by_ns) = match voice.phase {
            SpeechPhase::Begun => (false, end_ns.saturating_add(ENDS_WITHIN_NS)),
            SpeechPhase::Ended if voice.header.stamp_ns >= least_ns => (true, end_ns),
            SpeechPhase::Ended | SpeechPhase::Cut | SpeechPhase::Unheard => (false, 0),
        };
    }

    /// What is due of it.
    pub fn due(&mut self, now_ns: u64) -> Option<Confirmed> {
        let waiting = self.waiting.take_if(|waiting| now_ns >= waiting.by_ns)?;
        Some(if waiting.heard { Confirmed::Given(waiting.said) } else { Confirmed::Unheard(waiting.said) })
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
    use messages::{CueKind, Header, SpeechPhase, SpeechSaid, Urgency};

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
        let stamp_ns = if phase == SpeechPhase::Begun { first_sample_ns } else { 1_500 * MS };
        let header = Header { stamp_ns, ..Header::default() };
        let urgency = Urgency::Tone;
        SpeechSaid { header, phase, urgency, about_ns, first_sample_ns, duration_ns, ..SpeechSaid::default() }
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
        assert_eq!(confirmation.due(1_700 * MS), None, "it has not ended");
        confirmation.hear(&tone(SpeechPhase::Ended));
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
        let mut confirmation = asked();
        confirmation.hear(&tone(SpeechPhase::Begun));
        let (first_sample_ns, early) = (1_310 * MS, Header { stamp_ns: 1_330 * MS, ..Header::default() });
        confirmation.hear(&SpeechSaid { header: early, first_sample_ns, ..tone(SpeechPhase::Ended) });
        assert_eq!(confirmation.due(1_400 * MS), Some(Confirmed::Unheard(SAID)), "nobody can have heard it");
        let mut confirmation = asked();
        confirmation.hear(&tone(SpeechPhase::Begun));
        assert_eq!(confirmation.due(2_109 * MS), None);
        assert_eq!(confirmation.due(2_110 * MS), Some(Confirmed::Unheard(SAID)), "the voice is gone");
    }

    #[test]
    fn what_comes_meanwhile_ends_it() {
        let mut confirmation = asked();
        confirmation.hear(&tone(SpeechPhase::Begun));
        confirmation.hear(&tone(SpeechPhase::Ended));
        confirmation.forget();
        assert_eq!(confirmation.due(u64::MAX), None);
    }
}
