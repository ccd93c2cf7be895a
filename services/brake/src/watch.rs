//! When the brake engages and when it lets go: pure, times come in.

use transport::Oversleep;

/// The brake looks this often.
const PERIOD_NS: u64 = 20_000_000;

/// The brake has to act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Engagement {
    /// The incarnation of locomotion that is fenced from now on.
    pub incarnation: u32,
    /// Whether its line closed, rather than fell silent.
    pub gone: bool,
}

/// Watches one incarnation of locomotion at a time.
#[derive(Debug)]
pub struct Watch {
    limit_ns: u64,
    incarnation: u32,
    /// Its line is open: its closing engages at once, beats or not.
    watching: bool,
    /// Silence is counted from its first beat on: a process that still starts is the supervisor's to judge.
    last_beat_ns: Option<u64>,
    oversleep: Oversleep,
    /// The last incarnation that the brake engaged for; zero is commanded until a newer one has written zero itself.
    engaged_for: Option<u32>,
    fenced: u32,
    /// Locomotion leaves by plan.
    released: bool,
}

impl Watch {
    /// A watch over nobody yet.
    #[must_use]
    pub fn new(limit_ns: u64) -> Self {
        Self {
            limit_ns,
            incarnation: 0,
            watching: false,
            last_beat_ns: None,
            oversleep: Oversleep::new(PERIOD_NS),
            // Whoever was there before may have died with the robot walking: zero until somebody has written zero.
            engaged_for: Some(0),
            fenced: 0,
            released: false,
        }
    }

    /// Watches a new incarnation from now on. An engagement goes on until that one has written zero.
    pub fn rearm(&mut self, incarnation: u32) {
        self.incarnation = incarnation;
        self.watching = !self.released;
        self.last_beat_ns = None;
    }

    /// A beat has come: locomotion beats only once it has itself written zero.
    pub fn beat(&mut self, now_ns: u64) {
        if !self.watching {
            return;
        }
        self.last_beat_ns = Some(now_ns);
        if self.engaged_for.is_some_and(|engaged| self.incarnation > engaged) {
            self.engaged_for = None;
        }
    }

    /// The line closed.
    pub fn closed(&mut self) -> Option<Engagement> {
        self.watching.then(|| self.engage(true))
    }

    /// Time passed: what to do, and whether this very loop overslept and starts its count again.
    pub fn tick(&mut self, now_ns: u64) -> (Option<Engagement>, bool) {
        let overslept = self.oversleep.slept_ns(now_ns).is_some();
        let Some(last) = self.last_beat_ns else { return (None, false) };
        if overslept {
            self.last_beat_ns = Some(now_ns);
            return (None, true);
        }
        if now_ns.saturating_sub(last) > self.limit_ns {
            return (Some(self.engage(false)), false);
        }
        (None, false)
    }

    fn engage(&mut self, gone: bool) -> Engagement {
        (self.watching, self.last_beat_ns) = (false, None);
        self.engaged_for = Some(self.incarnation);
        self.fenced = self.fenced.max(self.incarnation);
        Engagement { incarnation: self.incarnation, gone }
    }

    /// Locomotion leaves by plan: nothing to watch.
    pub fn release(&mut self) {
        (self.watching, self.last_beat_ns) = (false, None);
        self.released = true;
    }

    /// Whether zero has to be commanded now.
    #[must_use]
    pub fn is_engaged(&self) -> bool {
        self.engaged_for.is_some()
    }

    /// The last incarnation that is fenced.
    #[must_use]
    pub fn fenced(&self) -> u32 {
        self.fenced
    }
}

#[cfg(test)]
mod tests {
    use super::{Engagement, Watch};

    const MS: u64 = 1_000_000;

    fn watching() -> Watch {
        let mut watch = Watch::new(100 * MS);
        watch.rearm(1);
        watch.beat(0);
        watch
    }

    #[test]
    fn silence_engages_once_and_a_new_life_releases() {
        let mut watch = watching();
        for t in (0..=100).step_by(20) {
            assert_eq!(watch.tick(t * MS), (None, false));
        }
        assert_eq!(watch.tick(120 * MS), (Some(Engagement { incarnation: 1, gone: false }), false));
        assert_eq!(watch.tick(140 * MS), (None, false));
        assert!(watch.is_engaged());
        watch.beat(150 * MS);
        assert!(watch.is_engaged(), "the fenced incarnation cannot release the brake");
        watch.rearm(2);
        assert!(watch.is_engaged(), "the new one has not written zero");
        watch.beat(180 * MS);
        assert!(!watch.is_engaged());
        assert_eq!(watch.fenced(), 1);
    }

    #[test]
    fn a_new_brake_commands_zero_until_a_locomotion_has() {
        let mut watch = Watch::new(100 * MS);
        assert!(watch.is_engaged() && watch.fenced() == 0);
        watch.rearm(1);
        watch.beat(MS);
        assert!(!watch.is_engaged());
    }

    #[test]
    fn a_locomotion_that_starts_slowly_is_not_killed_but_its_death_is_seen() {
        let mut watch = Watch::new(100 * MS);
        watch.rearm(1);
        for t in (0..2000).step_by(20) {
            assert_eq!(watch.tick(t * MS), (None, false));
        }
        assert!(watch.is_engaged(), "zero is commanded all the while");
        assert_eq!(watch.closed(), Some(Engagement { incarnation: 1, gone: true }));
        assert_eq!(watch.closed(), None, "it dies once");
    }

    #[test]
    fn a_closed_line_engages_at_once() {
        assert_eq!(watching().closed(), Some(Engagement { incarnation: 1, gone: true }));
    }

    #[test]
    fn a_brake_that_overslept_condemns_nobody() {
        let mut watch = watching();
        watch.tick(0);
        assert_eq!(watch.tick(300 * MS), (None, true));
        assert_eq!(watch.tick(320 * MS), (None, false));
    }

    #[test]
    fn a_planned_leave_engages_nothing() {
        let mut watch = watching();
        watch.release();
        watch.beat(10 * MS);
        assert_eq!(watch.closed(), None);
        assert_eq!(watch.tick(500 * MS), (None, false));
    }
}
