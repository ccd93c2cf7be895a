//! Stepped time: who takes part in it, and who keeps it waiting.

use messages::{Member, ServiceId, StopKind, StopReason};

use super::watched::{Phase, Role, Watched};
use super::{Action, Machine, Now};

impl Machine {
    /// Members of stepped time, and the version of the list; 0 while the run has not begun.
    #[must_use]
    pub fn roster(&self) -> (u64, &[Member]) {
        (self.roster_version, &self.roster)
    }

    /// Stepped time: whether time waits: for a service that has to join now, for a condemned one to be dead, or for a
    /// policy that was swapped out to be gone. How long that takes is wall time's business, and changes nothing in the
    /// run.
    #[must_use]
    pub fn holds_time(&self, run_ns: u64) -> bool {
        let waits = |s: &Watched| {
            let joins = !s.joined && run_ns >= s.joins_at_ns && s.is_wanted();
            let leaves = s.role == Role::Shadow && matches!(s.phase, Phase::Leaving { .. });
            joins || leaves || s.phase == Phase::Dying
        };
        !self.ending && self.limits.stepped && self.roster_version > 0 && self.services.iter().any(waits)
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

    /// Stepped time: lets in whose time has come. Only while time waits, so that it is the same step in every run.
    pub fn let_in(&mut self, now: Now) {
        let due = |s: &&Watched| s.waits_to_join() && s.armed && now.run_ns >= s.joins_at_ns;
        let due: Vec<_> = self.services.iter().filter(due).map(|s| (s.plan.service, s.incarnation)).collect();
        for &(service, incarnation) in &due {
            self.comes_up(service, incarnation, now);
        }
        for s in self.services.iter_mut().filter(|s| due.contains(&(s.plan.service, s.incarnation))) {
            (s.joined, s.joins_at_ns) = (true, 0);
        }
        self.update_roster(now);
        self.update_ready(now);
    }

    /// Stepped time: who takes part from the next step on. A condemned member does until it is dead: time waits for
    /// that.
    pub(super) fn update_roster(&mut self, now: Now) {
        let all_up = self
            .services
            .iter()
            .filter(|s| s.is_wanted() && s.plan.waited_for)
            .all(|s| s.phase == Phase::Ready && s.armed);
        if all_up && !self.begun {
            self.begun = true;
            self.actions.push(Action::Begin);
        }
        if !self.limits.stepped {
            return;
        }
        if self.roster_version == 0 {
            if !all_up {
                return;
            }
            for s in self.services.iter_mut().filter(|s| s.phase == Phase::Ready) {
                (s.joined, s.joins_at_ns) = (true, 0);
                s.count_from(now.run_ns);
            }
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
