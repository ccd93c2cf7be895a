//! Lives of services: from the start of a process over its readiness to its end, and the next one.

use messages::{ServiceId, StopKind, StopReason};

use super::watched::{Phase, Role, Watched};
use super::{Action, Machine, Now};

/// A service that is no longer wanted has so long to leave, wall time: a recorder ends its file.
pub(super) const LEAVE_LIMIT_NS: u64 = 5_000_000_000;

/// The service that watches a service's line.
fn watcher_of(service: ServiceId) -> ServiceId {
    service.spec().and_then(|spec| spec.watched_by).unwrap_or(ServiceId::Locomotion)
}

impl Machine {
    /// A service says that it is ready. In stepped time it is up when it joins: when its word comes is wall time's
    /// business.
    pub(super) fn on_ready(&mut self, service: ServiceId, incarnation: u32, now: Now) {
        let joins_later = self.limits.stepped && self.roster_version > 0;
        if let Some(s) = self.find(service, incarnation)
            && matches!(s.phase, Phase::Starting { .. })
        {
            if joins_later {
                s.said_ready = true;
                s.phase = Phase::Starting { ready_by_ns: u64::MAX };
            } else {
                self.comes_up(service, incarnation, now);
            }
        }
        self.update_roster(now);
    }

    /// It is at work from now on.
    pub(super) fn comes_up(&mut self, service: ServiceId, incarnation: u32, now: Now) {
        let Some(s) = self.find(service, incarnation) else { return };
        s.phase = Phase::Ready;
        s.count_from(now.run_ns);
        let role = s.role;
        match service {
            ServiceId::Policy if role == Role::Shadow => self.candidate_ready(now),
            ServiceId::Policy => self.mode.active_policy = incarnation,
            ServiceId::Shield => self.mode.active_shield = incarnation,
            _ => {}
        }
        self.mode_changed = true;
    }

    pub(super) fn on_armed(&mut self, service: ServiceId, incarnation: u32, by: u32, now: Now) {
        let watcher = watcher_of(service);
        let current = self.services.iter().any(|s| s.plan.service == watcher && s.incarnation == by);
        if let Some(s) = self.find(service, incarnation).filter(|_| current) {
            s.armed = true;
        }
        self.update_roster(now);
    }

    /// A new life watches nobody's line yet.
    pub(super) fn void_lines_of(&mut self, watcher: ServiceId) {
        for s in &mut self.services {
            s.armed &= !s.plan.has_line || watcher_of(s.plan.service) != watcher;
        }
    }

    pub(super) fn on_died(&mut self, service: ServiceId, incarnation: u32, why: &str, now: Now) {
        let ending = self.ending;
        let limits = self.limits.clone();
        let Some(s) = self.find(service, incarnation) else { return };
        if ending || matches!(s.phase, Phase::Off | Phase::Down { .. } | Phase::Spent) {
            return;
        }
        if matches!(s.phase, Phase::Leaving { .. }) {
            (s.phase, s.joined) = (Phase::Off, false);
            return self.update_roster(now);
        }
        let condemned = s.phase == Phase::Dying;
        let (critical, restartable, waited_for) = (s.is_critical(), s.plan.restartable, s.plan.waited_for);
        if service == ServiceId::Policy && self.policy_died(incarnation, critical && !condemned, why, now) {
            return;
        }
        let begun = self.roster_version > 0;
        let Some(s) = self.find(service, incarnation) else { return };
        // In stepped time: no fault, for it took no part yet, and the next life keeps its time to join.
        let took_no_part = begun && s.joins_at_ns != 0;
        s.joined = false;
        // However fast stepped time goes, the budget is that of run time.
        let died_ns = match limits.stepped {
            true if took_no_part => s.joins_at_ns,
            true => now.run_ns,
            false => now.wall_ns,
        };
        s.deaths_ns.push_back(died_ns);
        while s.deaths_ns.front().is_some_and(|at| died_ns.saturating_sub(*at) > limits.budget_window_ns) {
            s.deaths_ns.pop_front();
        }
        let deaths = s.deaths_ns.len() as u32;
        let spent = deaths > limits.restart_budget;
        let pause = limits.back_off_ns.saturating_mul(1 << (deaths - 1).min(16)).min(limits.back_off_max_ns);
        s.phase = if spent { Phase::Spent } else { Phase::Down { start_at_ns: now.wall_ns + pause } };
        if !took_no_part {
            s.joins_at_ns = now.run_ns + limits.restart_time_ns;
        }
        s.restarts += u32::from(!spent);
        if !restartable {
            self.actions.push(Action::EndRun(format!("{service} died: {why}")));
        } else if spent && !waited_for {
            self.actions.push(Action::Note(format!("{service} died too often and stays down until resume: {why}")));
        } else if spent && !self.begun {
            // A run that never began has nobody to wait for.
            self.actions.push(Action::EndRun(format!("{service} could not be started: {why}")));
        }
        let reason = StopReason::service(StopKind::ServiceDied, service, incarnation);
        if spent && critical {
            let reason = StopReason::service(StopKind::RestartBudgetSpent, service, incarnation);
            self.enter(reason, now);
        } else if critical && !condemned && !took_no_part {
            self.enter(reason, now);
        }
        self.update_roster(now);
    }

    /// The death of a policy: whether there is nothing to restart, as another one is there or nobody needs it.
    pub(super) fn policy_died(&mut self, incarnation: u32, is_fault: bool, why: &str, now: Now) -> bool {
        let swaps_business = self.policy_lost(incarnation, true, why, now);
        let Some(s) = self.find(ServiceId::Policy, incarnation).filter(|s| s.role == Role::Shadow) else {
            return false;
        };
        (s.phase, s.joined) = (Phase::Off, false);
        if is_fault && !swaps_business {
            self.enter(StopReason::service(StopKind::ServiceDied, ServiceId::Policy, incarnation), now);
        }
        self.update_roster(now);
        true
    }

    pub(super) fn on_demand(&mut self, service: ServiceId, now: Now) {
        let joins_at_ns = now.run_ns + self.limits.restart_time_ns;
        if let Some(s) = self.services.iter_mut().find(|s| s.plan.service == service && s.phase == Phase::Off) {
            s.deaths_ns.clear();
            (s.phase, s.joins_at_ns) = (Phase::Down { start_at_ns: now.wall_ns }, joins_at_ns);
        }
    }

    pub(super) fn on_release(&mut self, service: ServiceId, now: Now) {
        let Some(s) = self.services.iter_mut().find(|s| s.plan.service == service && s.plan.on_demand) else { return };
        match s.phase {
            Phase::Down { .. } | Phase::Spent => s.phase = Phase::Off,
            Phase::Starting { .. } | Phase::Ready => {
                s.phase = Phase::Leaving { kill_at_ns: now.wall_ns + LEAVE_LIMIT_NS, asked: true };
                s.joined = false;
                self.actions.push(Action::Release(service, s.incarnation));
            }
            // Its end is on the way, and is the last of it.
            Phase::Dying => s.phase = Phase::Leaving { kill_at_ns: u64::MAX, asked: false },
            Phase::Off | Phase::Leaving { .. } => {}
        }
        self.update_roster(now);
    }

    pub(super) fn on_left(&mut self, service: ServiceId, incarnation: u32, now: Now) {
        let leaves = |s: &&mut Watched| s.plan.on_demand || matches!(s.phase, Phase::Leaving { .. });
        if let Some(s) = self.find(service, incarnation).filter(leaves) {
            s.joined = false;
            s.phase = Phase::Off;
        }
        self.update_roster(now);
    }

    /// A fault of a process ends its incarnation: the stop first, then the kill.
    pub(super) fn condemn(&mut self, reason: StopReason, now: Now) {
        let Some(s) = self.find(reason.service, reason.incarnation) else { return };
        if !matches!(s.phase, Phase::Ready | Phase::Starting { .. }) {
            return;
        }
        let (critical, restartable) = (s.is_critical(), s.plan.restartable);
        let is_policy = s.plan.service == ServiceId::Policy;
        if is_policy && self.policy_lost(reason.incarnation, false, &reason.to_string(), now) {
            return;
        }
        let Some(s) = self.find(reason.service, reason.incarnation) else { return };
        s.phase = Phase::Dying;
        if critical {
            self.enter(reason, now);
        }
        if !restartable {
            self.actions.push(Action::EndRun(reason.to_string()));
        }
        self.actions.push(Action::Kill(reason.service, reason.incarnation));
        self.actions.push(Action::Note(reason.to_string()));
        self.update_roster(now);
    }

    /// Two policies count their lives together.
    pub(super) fn next_incarnation(&self, service: ServiceId) -> u32 {
        1 + self.services.iter().filter(|s| s.plan.service == service).map(|s| s.incarnation).max().unwrap_or(0)
    }
}
