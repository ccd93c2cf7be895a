//! A word that would start the robot, said twice: in place of the tone. Pure.

use messages::{CueKind, NS_PER_S};

use super::Said;

/// The second comes within this after the first, nanoseconds.
const WITHIN_NS: u64 = 2 * NS_PER_S;

/// The first of two, if one was said.
#[derive(Debug, Clone, Copy, Default)]
pub struct Repeated {
    first: Option<(CueKind, u64)>,
}

impl Repeated {
    /// Takes a word that would start the robot: whether it is the second of two of the same.
    pub fn take(&mut self, said: &Said) -> bool {
        let first = self.first.replace((said.kind, said.stamp_ns));
        let is_second =
            first.is_some_and(|(kind, at_ns)| kind == said.kind && said.stamp_ns.saturating_sub(at_ns) <= WITHIN_NS);
        if is_second {
            self.first = None;
        }
        is_second
    }

    /// Something else came meanwhile.
    pub fn forget(&mut self) {
        self.first = None;
    }
}

#[cfg(test)]
mod tests {
    use super::Repeated;
    use crate::voice::Said;
    use messages::{CueKind, NS_PER_S};

    fn said(kind: CueKind, at_s: u64) -> Said {
        Said { kind, score: 0.9, stamp_ns: at_s * NS_PER_S, signal_db: 30.0, clipped: 0.0, after_stop: true }
    }

    #[test]
    fn the_same_word_within_two_seconds_counts_and_nothing_else() {
        let mut repeated = Repeated::default();
        let mut take = |kind, at_s| repeated.take(&said(kind, at_s));
        assert!(!take(CueKind::Forward, 10) && take(CueKind::Forward, 12), "twice");
        assert!(!take(CueKind::Forward, 13), "the third is a first one again");
        assert!(!take(CueKind::Forward, 16), "too late, and a first one");
        assert!(!take(CueKind::Left, 17) && take(CueKind::Left, 18), "another word");
        repeated.take(&said(CueKind::Forward, 20));
        repeated.forget();
        assert!(!repeated.take(&said(CueKind::Forward, 21)), "a stop came meanwhile");
    }
}
