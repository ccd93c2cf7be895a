//! A judge that slept condemns nobody: who watches others must know when its own loop did not run.

/// So much longer than it meant to may a loop have slept, nanoseconds, before it has no right to judge others.
const LIMIT_NS: u64 = 50_000_000;

/// Notices that a loop overslept.
#[derive(Debug, Clone)]
pub struct Oversleep {
    period_ns: u64,
    last_ns: Option<u64>,
}

impl Oversleep {
    /// For a loop that means to wake up every `period_ns`.
    #[must_use]
    pub const fn new(period_ns: u64) -> Self {
        Self { period_ns, last_ns: None }
    }

    /// The loop is awake: for how long it slept, where that is too long, nanoseconds.
    pub fn slept_ns(&mut self, now_ns: u64) -> Option<u64> {
        let slept_ns = now_ns.saturating_sub(self.last_ns.replace(now_ns)?);
        (slept_ns > self.period_ns + LIMIT_NS).then_some(slept_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::Oversleep;

    const MS: u64 = 1_000_000;

    #[test]
    fn only_a_long_sleep_is_told() {
        let mut oversleep = Oversleep::new(20 * MS);
        assert_eq!(oversleep.slept_ns(5000 * MS), None, "it has just begun");
        assert_eq!(oversleep.slept_ns(5070 * MS), None);
        assert_eq!(oversleep.slept_ns(5141 * MS), Some(71 * MS));
    }
}
