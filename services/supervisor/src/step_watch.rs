//! Stepped time: who keeps it waiting. Pure.

use std::collections::BTreeMap;

use messages::{ClockAck, Member, QUANTUM_NS, ServiceId};
use transport::Oversleep;

/// The supervisor looks this often.
const PERIOD_NS: u64 = 50_000_000;

/// What was acknowledged so long ago, nobody asks for: members do every step.
const KEPT_STEPS: u64 = 1000;

/// What every member has acknowledged, and since when time stands.
#[derive(Debug)]
pub struct StepWatch {
    limit_ns: u64,
    acknowledged: BTreeMap<(ServiceId, u32), u64>,
    step: u64,
    /// Who was a member when the step was given.
    members: Vec<Member>,
    /// Wall time since which the step is the same.
    since_ns: u64,
    oversleep: Oversleep,
}

impl StepWatch {
    /// A watch that lets a step take `limit_ns` of wall time.
    #[must_use]
    pub fn new(limit_ns: u64, now_ns: u64) -> Self {
        Self {
            limit_ns,
            acknowledged: BTreeMap::new(),
            step: 0,
            members: Vec::new(),
            since_ns: now_ns,
            oversleep: Oversleep::new(PERIOD_NS),
        }
    }

    /// Takes an acknowledgement.
    pub fn take(&mut self, ack: &ClockAck) {
        let step = ack.header.stamp_ns / QUANTUM_NS;
        let last = self.acknowledged.entry((ack.member.service, ack.member.incarnation)).or_default();
        *last = step.max(*last);
    }

    /// The supervisor takes a step, which was given to this roster.
    pub fn begin(&mut self, roster: &[Member]) {
        self.members.clear();
        self.members.extend(roster.iter().filter(|m| m.service != ServiceId::Supervisor));
    }

    /// The members that have not done the step, once it takes too long; none of them: the master gives no next one,
    /// unless the supervisor itself holds time. What this very loop overslept does not count.
    pub fn late(&mut self, step: u64, roster: &[Member], held: bool, now_ns: u64) -> Option<Vec<Member>> {
        let slept_ns = self.oversleep.slept_ns(now_ns);
        let late: Vec<Member> = self.not_done(step, roster).copied().collect();
        if step != self.step {
            // The dead are members no longer.
            self.acknowledged.retain(|_, last| *last + KEPT_STEPS >= step);
        }
        if step != self.step || (held && late.is_empty()) {
            (self.step, self.since_ns) = (step, now_ns);
            return None;
        }
        self.since_ns += slept_ns.unwrap_or(0);
        if now_ns.saturating_sub(self.since_ns) <= self.limit_ns {
            return None;
        }
        self.since_ns = now_ns;
        Some(late)
    }

    /// Who still has the step to do: of those that it was given to, those that are members still.
    pub fn not_done<'a>(&'a self, step: u64, roster: &'a [Member]) -> impl Iterator<Item = &'a Member> {
        let done =
            move |m: &Member| self.acknowledged.get(&(m.service, m.incarnation)).is_some_and(|last| *last >= step);
        self.members.iter().filter(move |m| roster.contains(m) && !done(m))
    }
}

#[cfg(test)]
mod tests {
    use super::StepWatch;
    use messages::{ClockAck, Header, Member, QUANTUM_NS, ServiceId};

    const MS: u64 = 1_000_000;
    const LIDAR: Member = Member { service: ServiceId::Lidar, incarnation: 1 };
    const SHIELD: Member = Member { service: ServiceId::Shield, incarnation: 2 };
    const SUPERVISOR: Member = Member { service: ServiceId::Supervisor, incarnation: 1 };
    const ROSTER: [Member; 3] = [SUPERVISOR, LIDAR, SHIELD];

    fn ack(member: Member, step: u64) -> ClockAck {
        let header = Header { stamp_ns: step * QUANTUM_NS, ..Header::default() };
        ClockAck { header, member, ..ClockAck::default() }
    }

    /// What is found while step 7 lasts, looked at every 50 ms.
    fn found(watch: &mut StepWatch, held: bool) -> Vec<Vec<Member>> {
        watch.begin(&ROSTER);
        (0..30).filter_map(|i| watch.late(7, &ROSTER, held, i * 50 * MS)).collect()
    }

    #[test]
    fn who_has_not_done_the_step_is_late_and_nobody_else() {
        let mut watch = StepWatch::new(1000 * MS, 0);
        watch.take(&ack(LIDAR, 6));
        watch.take(&ack(SHIELD, 7));
        assert_eq!(found(&mut watch, false), [vec![LIDAR]]);
    }

    #[test]
    fn where_all_have_done_it_the_master_is_late() {
        let mut watch = StepWatch::new(1000 * MS, 0);
        watch.take(&ack(LIDAR, 7));
        watch.take(&ack(SHIELD, 7));
        assert_eq!(found(&mut watch, false), [vec![]]);
    }

    #[test]
    fn time_that_is_held_and_a_watch_that_slept_condemn_nobody() {
        let mut watch = StepWatch::new(1000 * MS, 0);
        watch.take(&ack(LIDAR, 7));
        watch.take(&ack(SHIELD, 7));
        assert!(found(&mut watch, true).is_empty());
        // Who hangs while time is held is late all the same; who joined meanwhile was not given the step.
        let mut watch = StepWatch::new(1000 * MS, 0);
        watch.begin(&ROSTER[..2]);
        let late: Vec<_> = (0..30).filter_map(|i| watch.late(7, &ROSTER, true, i * 50 * MS)).collect();
        assert_eq!(late, [vec![LIDAR]]);
        let mut watch = StepWatch::new(1000 * MS, 0);
        watch.begin(&ROSTER);
        assert_eq!(watch.late(7, &ROSTER, false, 0), None);
        assert_eq!(watch.late(7, &ROSTER, false, 5000 * MS), None);
        // One that sleeps now and then still finds out, by the time that it was awake.
        let mut awake = (0..30).map(|i| watch.late(7, &ROSTER, false, (5050 + 50 * i + 400 * (i / 10)) * MS));
        assert!(awake.any(|late| late.is_some()));
    }
}
