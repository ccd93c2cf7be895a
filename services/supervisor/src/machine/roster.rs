//! Stepped time: who takes part in it, and who keeps it waiting.

use messages::{Member, ServiceId, StopKind, StopReason};

use super::watched::Phase;
use super::{Action, Machine, Now};

impl Machine {
    /// Members of stepped time, and the version of the list; 0 while the run has not begun.
    #[must_use]
    pub fn roster(&self) -> (u64, &[Member]) {
        (self.roster_version, &self.roster)
    }

    /// Stepped time: whether time waits for a service that has to join now.
    #[must_use]
    pub fn holds_time(&self, run_ns: u64) -> bool {
        !self.ending
            && self
                .services
                .iter()
                .any(|s| !s.joined && run_ns >= s.joins_at_ns && s.is_wanted() && self.roster_version > 0)
    }

    /// Only who keeps time waiting is at fault; where nobody does, the master does not give the next step.
    pub(super) fn on_time_stands(&mut self, late: &[Member], now: Now) {
        let guilty: Vec<(ServiceId, u32)> = self
            .services
            .iter()
            .filter(|s| match late {
                [] => s.plan.clock_master,
                late => late.contains(&Member { service: s.plan.service, incarnation: s.incarnation }),
            })
            .map(|s| (s.plan.service, s.incarnation))
            .collect();
        for (service, incarnation) in guilty {
            self.condemn(StopReason::service(StopKind::ServiceHung, service, incarnation), now);
        }
    }

    /// Stepped time: who takes part from the next step on.
    pub(super) fn update_roster(&mut self, now: Now) {
        let all_up = self.services.iter().filter(|s| s.is_wanted()).all(|s| s.phase == Phase::Ready && s.armed);
        if all_up && !self.begun {
            self.begun = true;
            self.actions.push(Action::Begin);
        }
        if !self.limits.stepped {
            return;
        }
        let begun = self.roster_version > 0;
        for s in &mut self.services {
            let joins = s.phase == Phase::Ready && s.armed && if begun { now.run_ns >= s.joins_at_ns } else { all_up };
            if joins && !s.joined {
                s.joined = true;
                s.count_from(now.run_ns);
            }
        }
        if !begun && !all_up {
            return;
        }
        let mut roster = vec![Member { service: ServiceId::Supervisor, incarnation: 1 }];
        roster.extend(
            self.services
                .iter()
                .filter(|s| s.joined && !s.plan.clock_master)
                .map(|s| Member { service: s.plan.service, incarnation: s.incarnation }),
        );
        if roster != self.roster {
            self.roster = roster;
            self.roster_version += 1;
        }
    }
}
