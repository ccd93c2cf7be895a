//! A step back waits until the handler has been told of it, and each one anew.

use messages::age_ns;

/// Since when the robot is about to step back.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Backing {
    /// The first decision and the last one without a break that found it so, run time, nanoseconds.
    about_ns: Option<(u64, u64)>,
}

impl Backing {
    /// A decision for a step back or another action: whether it has to wait. The handler was told of what has lasted
    /// for `told_ns`; decisions farther apart than `gap_ns` are a break.
    pub fn waits(&mut self, now_ns: u64, is_back: bool, told_ns: u64, gap_ns: u64) -> bool {
        let before = self.about_ns.take().filter(|(_, last_ns)| age_ns(now_ns, *last_ns) <= gap_ns);
        let since_ns = before.map_or(now_ns, |(since_ns, _)| since_ns);
        let waits = is_back && now_ns < since_ns.saturating_add(told_ns);
        self.about_ns = waits.then_some((since_ns, now_ns));
        waits
    }
}
