//! A step back waits until the handler has been told of it, and each one anew.

use messages::{Mode, age_ns};

/// A wait counts for one cue, by its incarnation and seq, in one epoch.
type Asked = (u32, u64, u64);

/// Since when the robot is about to step back.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Backing {
    about: Option<About>,
}

#[derive(Debug, Clone, Copy)]
struct About {
    asked: Asked,
    /// The first decision and the last one without a break that found it so, run time, nanoseconds.
    since_ns: u64,
    last_ns: u64,
}

impl Backing {
    /// A decision for a step back or another action: whether it has to wait. The handler was told of what has lasted
    /// for `told_ns` with the same cue in force; decisions farther apart than `gap_ns` are a break.
    pub fn waits(&mut self, now_ns: u64, is_back: bool, mode: Option<&Mode>, told_ns: u64, gap_ns: u64) -> bool {
        let before = self.about.take();
        if !is_back {
            return false;
        }
        // Without a cue in force the voice says nothing of it.
        let Some(mode) = mode.filter(|mode| mode.cue.valid) else { return true };
        let header = mode.cue.cue.header;
        let asked = (header.incarnation, header.seq, mode.epoch);
        let goes_on = |about: &About| about.asked == asked && age_ns(now_ns, about.last_ns) <= gap_ns;
        let since_ns = before.filter(goes_on).map_or(now_ns, |about| about.since_ns);
        let waits = now_ns < since_ns.saturating_add(told_ns);
        self.about = waits.then_some(About { asked, since_ns, last_ns: now_ns });
        waits
    }
}
