//! The master of stepped time: gives the next step when everybody has done the one before.

use messages::{ClockAck, Member, QUANTUM_NS};

use crate::monotonic_ns;

/// The master's book: who is a member, and who has not yet done the step.
#[derive(Default)]
pub(crate) struct Master {
    pub roster: Vec<Member>,
    roster_version: u64,
    waiting_for: Vec<Member>,
    step: u64,
    /// Wall time of the last step.
    stepped_at_ns: u64,
}

impl Master {
    /// Whether there is no roster yet, or somebody has not done the step.
    pub fn is_waiting(&self) -> bool {
        self.roster_version == 0 || !self.waiting_for.is_empty()
    }

    /// Wall time from which the next step may be given. A run that fell behind does not rush to catch up.
    pub fn may_step(&self, pace_ns: u64) -> u64 {
        self.stepped_at_ns + pace_ns
    }

    pub fn begin(&mut self, step: u64, pace_ns: u64) {
        let now = monotonic_ns();
        let due = self.stepped_at_ns + pace_ns;
        // Small lateness is made up for, so that `speed` is met on average; a long wait is not.
        self.stepped_at_ns = if now - due.min(now) < 5 * pace_ns { due } else { now };
        self.step = step;
        self.waiting_for.clone_from(&self.roster);
    }

    pub fn take(&mut self, ack: &ClockAck) {
        if ack.roster_version > self.roster_version {
            self.roster_version = ack.roster_version;
            self.roster = ack.roster().to_vec();
            self.waiting_for.retain(|member| ack.roster().contains(member));
        }
        if ack.header.stamp_ns == self.step * QUANTUM_NS {
            self.waiting_for.retain(|member| *member != ack.member);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Master;
    use messages::{ClockAck, Header, Member, QUANTUM_NS, ServiceId};

    fn member(service: ServiceId, incarnation: u32) -> Member {
        Member { service, incarnation }
    }

    fn roster(version: u64, members: &[Member]) -> ClockAck {
        let mut ack = ClockAck { roster_version: version, roster_count: members.len() as u32, ..ClockAck::default() };
        ack.roster[..members.len()].copy_from_slice(members);
        ack
    }

    #[test]
    fn time_waits_for_every_member_and_for_nobody_who_died() {
        let (lidar, shield) = (member(ServiceId::Lidar, 1), member(ServiceId::Shield, 1));
        let mut master = Master::default();
        assert!(master.is_waiting(), "there is no roster");
        master.take(&roster(1, &[lidar, shield]));
        assert!(!master.is_waiting());
        master.begin(1, 0);
        let done = |who| ClockAck {
            header: Header { stamp_ns: QUANTUM_NS, ..Header::default() },
            member: who,
            ..ClockAck::default()
        };
        master.take(&done(lidar));
        assert!(master.is_waiting(), "the shield has not done the step");
        master.take(&roster(2, &[lidar]));
        assert!(!master.is_waiting(), "the shield is dead");
        master.begin(2, 0);
        master.take(&done(lidar));
        assert!(master.is_waiting(), "an acknowledgement of an older step does not count");
    }
}
