//! What the supervisor decides: events and times in, actions out. No clock, no process, no I/O.

use std::collections::VecDeque;

use messages::{
    Cue, CueInForce, Health, LocomotionState, Member, Mode, ModeClass, PortRole, ServiceId, StopKind, StopReason,
    TopicId,
};

use crate::plan::{Limits, Plan, ServicePlan};
use crate::stops::StopLog;

/// The two times that count.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// Run time, nanoseconds: stamps, ages.
    pub run_ns: u64,
    /// Wall time (monotonic), nanoseconds: start deadlines, back-off.
    pub wall_ns: u64,
}

/// What happened.
#[derive(Debug)]
pub enum Event<'a> {
    /// A child says that it is ready.
    Ready(ServiceId, u32),
    /// A child's lifeline is watched by locomotion.
    Armed(ServiceId, u32),
    /// A child is gone.
    Died(ServiceId, u32, String),
    /// A child's beat.
    Beat(&'a Health),
    /// A member did not do its step in time.
    StepNotDone(ServiceId, u32),
    /// The brake engaged for that incarnation of locomotion.
    BrakeEngaged(u32),
    /// A cue was recognised.
    Cue(&'a Cue),
    /// What locomotion does.
    Locomotion(&'a LocomotionState),
    /// The operator's stop.
    OperatorStop,
    /// The operator resumes a locked run.
    OperatorResume,
    /// The run ends.
    ShutDown,
    /// The supervisor's own loop overslept.
    Overslept,
}

/// What is to be done about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Start that incarnation.
    Spawn(ServiceId, u32),
    /// End that incarnation: SIGKILL, never waited for.
    Kill(ServiceId, u32),
    /// Tell locomotion over its line that the robot is to stand.
    StopLine,
    /// Everything is up for the first time.
    Begin,
    /// Tell the operator.
    Note(String),
    /// The run cannot go on.
    EndRun(String),
}

/// How far a service is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Not running; to be started at that wall time.
    Down {
        /// Wall time, nanoseconds.
        start_at_ns: u64,
    },
    /// Started; must be ready by that wall time.
    Starting {
        /// Wall time, nanoseconds.
        ready_by_ns: u64,
    },
    /// At work.
    Ready,
    /// Condemned; its end has not been seen yet.
    Dying,
    /// Stays down: its restart budget is spent.
    Spent,
}

/// A stream of a service, as its beats tell.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    out_count: u64,
    out_stamp_ns: u64,
    /// Run time when `out_count` last grew, and the input count then.
    changed_at_ns: u64,
    in_then: u64,
}

#[derive(Debug)]
struct Watched {
    plan: ServicePlan,
    phase: Phase,
    incarnation: u32,
    pid: u32,
    armed: bool,
    /// Stepped time: a member of the roster.
    joined: bool,
    /// Stepped time: joins at this run time.
    joins_at_ns: u64,
    last_beat_ns: u64,
    progress: Vec<Progress>,
    restarts: u32,
    /// Wall times of the last deaths, for the budget.
    deaths_ns: VecDeque<u64>,
}

/// A service as reported.
#[derive(Debug, Clone)]
pub struct ServiceStatus {
    /// Which.
    pub service: ServiceId,
    /// Process id; 0 while there is none.
    pub pid: u32,
    /// How far.
    pub phase: Phase,
    /// Which life.
    pub incarnation: u32,
    /// Restarts so far.
    pub restarts: u32,
    /// Whether motion needs it.
    pub critical: bool,
}

/// Watches over all services and decides the mode.
#[derive(Debug)]
pub struct Machine {
    limits: Limits,
    services: Vec<Watched>,
    mode: Mode,
    mode_changed: bool,
    actions: Vec<Action>,
    roster: Vec<Member>,
    roster_version: u64,
    last_cue: (u32, u64),
    grace_until_ns: u64,
    stuck_states: u32,
    ending: bool,
    begun: bool,
    /// What stopped the robot, and when.
    pub stops: StopLog,
}

impl Machine {
    /// A machine over the services of a plan, none of them started, in fault.
    #[must_use]
    pub fn new(plan: Plan) -> Self {
        let services = plan.services.into_iter().map(Watched::new).collect();
        let mut machine = Self {
            limits: plan.limits,
            services,
            mode: Mode::default(),
            mode_changed: true,
            actions: Vec::new(),
            roster: Vec::new(),
            roster_version: 0,
            last_cue: (0, 0),
            grace_until_ns: 0,
            stuck_states: 0,
            ending: false,
            begun: false,
            stops: StopLog::default(),
        };
        machine.enter(ModeClass::Fault, StopReason::of(StopKind::Boot), 0);
        machine
    }

    /// Takes what is to be done.
    pub fn take_actions(&mut self) -> Vec<Action> {
        std::mem::take(&mut self.actions)
    }

    /// The mode, header apart.
    #[must_use]
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// Whether the mode changed since this was last asked.
    pub fn take_mode_changed(&mut self) -> bool {
        std::mem::take(&mut self.mode_changed)
    }

    /// Members of stepped time, and the version of the list; 0 while the run has not begun.
    #[must_use]
    pub fn roster(&self) -> (u64, &[Member]) {
        (self.roster_version, &self.roster)
    }

    /// Stepped time: whether time waits for a service that has to join now.
    #[must_use]
    pub fn holds_time(&self, run_ns: u64) -> bool {
        !self.ending
            && self.services.iter().any(|s| {
                !s.joined && run_ns >= s.joins_at_ns && !matches!(s.phase, Phase::Spent) && self.roster_version > 0
            })
    }

    /// Every service as it is.
    #[must_use]
    pub fn status(&self) -> Vec<ServiceStatus> {
        self.services
            .iter()
            .map(|s| ServiceStatus {
                service: s.plan.service,
                pid: if matches!(s.phase, Phase::Down { .. } | Phase::Spent) { 0 } else { s.pid },
                phase: s.phase,
                incarnation: s.incarnation,
                restarts: s.restarts,
                critical: s.plan.critical,
            })
            .collect()
    }

    /// Something happened.
    pub fn handle(&mut self, event: Event<'_>, now: Now) {
        match event {
            Event::Ready(service, incarnation) => self.on_ready(service, incarnation, now),
            Event::Armed(service, incarnation) => {
                if let Some(s) = self.find(service, incarnation) {
                    s.armed = true;
                }
                self.update_roster(now);
            }
            Event::Died(service, incarnation, why) => self.on_died(service, incarnation, &why, now),
            Event::Beat(health) => self.on_beat(health, now),
            Event::StepNotDone(service, incarnation) => {
                self.condemn(StopReason::service(StopKind::ServiceHung, service, incarnation), now);
            }
            Event::BrakeEngaged(incarnation) => {
                let reason = StopReason::service(StopKind::BrakeEngaged, ServiceId::Locomotion, incarnation);
                self.enter(ModeClass::Fault, reason, now.run_ns);
                if let Some(s) = self.find(ServiceId::Locomotion, incarnation)
                    && s.phase == Phase::Ready
                {
                    // The brake has killed it; its end is on the way.
                    s.phase = Phase::Dying;
                }
            }
            Event::Cue(cue) => self.on_cue(cue, now),
            Event::Locomotion(state) => self.on_locomotion(state, now),
            Event::OperatorStop => {
                self.actions.push(Action::StopLine);
                self.enter(ModeClass::Lock, StopReason::of(StopKind::OperatorStop), now.run_ns);
            }
            Event::OperatorResume => self.on_resume(now),
            Event::ShutDown => {
                self.ending = true;
                self.actions.push(Action::StopLine);
                self.enter(ModeClass::Lock, StopReason::of(StopKind::ShuttingDown), now.run_ns);
            }
            Event::Overslept => self.grace_until_ns = now.run_ns + self.limits.beat_ns,
        }
        self.update_ready(now);
    }

    /// Wall time passed: starts what is due, condemns what did not get ready.
    pub fn tick_starts(&mut self, now: Now) {
        if self.ending {
            return;
        }
        for i in 0..self.services.len() {
            let stage = self.services[i].plan.stage;
            let below_ready = self.services.iter().all(|s| s.plan.stage >= stage || s.phase == Phase::Ready);
            let s = &mut self.services[i];
            match s.phase {
                Phase::Down { start_at_ns } if now.wall_ns >= start_at_ns && below_ready => {
                    s.incarnation += 1;
                    // The simulator has no line to locomotion; locomotion's own goes to the brake.
                    s.armed = matches!(s.plan.service, ServiceId::Simulator | ServiceId::Locomotion);
                    s.joined = false;
                    s.progress.iter_mut().for_each(|p| *p = Progress::default());
                    s.phase = Phase::Starting { ready_by_ns: now.wall_ns + self.limits.ready_ns };
                    self.actions.push(Action::Spawn(s.plan.service, s.incarnation));
                }
                Phase::Starting { ready_by_ns } if now.wall_ns > ready_by_ns => {
                    let reason = StopReason::service(StopKind::ServiceHung, s.plan.service, s.incarnation);
                    self.actions.push(Action::Note(format!("{} was not ready in time", s.plan.service)));
                    self.condemn(reason, now);
                }
                _ => {}
            }
        }
        self.update_roster(now);
    }

    /// Run time passed: judges beats and streams.
    pub fn tick_judge(&mut self, now: Now) {
        self.update_roster(now);
        if now.run_ns >= self.grace_until_ns && !self.ending {
            for i in 0..self.services.len() {
                if let Some(reason) = self.judge(&self.services[i], now) {
                    self.condemn(reason, now);
                }
            }
            if self.mode.class == ModeClass::Run
                && let Some(reason) = self.stale_stream(now, 2)
            {
                self.enter(ModeClass::Fault, reason, now.run_ns);
            }
        }
        self.update_ready(now);
    }

    fn find(&mut self, service: ServiceId, incarnation: u32) -> Option<&mut Watched> {
        self.services.iter_mut().find(|s| s.plan.service == service && s.incarnation == incarnation)
    }

    fn on_ready(&mut self, service: ServiceId, incarnation: u32, now: Now) {
        if let Some(s) = self.find(service, incarnation)
            && matches!(s.phase, Phase::Starting { .. })
        {
            s.phase = Phase::Ready;
            s.last_beat_ns = now.run_ns;
            for progress in &mut s.progress {
                progress.changed_at_ns = now.run_ns;
            }
            match service {
                ServiceId::Policy => self.mode.active_policy = incarnation,
                ServiceId::Shield => self.mode.active_shield = incarnation,
                _ => {}
            }
            self.mode_changed = true;
        }
        self.update_roster(now);
    }

    fn on_died(&mut self, service: ServiceId, incarnation: u32, why: &str, now: Now) {
        let ending = self.ending;
        let limits = self.limits.clone();
        let Some(s) = self.find(service, incarnation) else { return };
        if ending || matches!(s.phase, Phase::Down { .. } | Phase::Spent) {
            return;
        }
        let condemned = s.phase == Phase::Dying;
        let (critical, restartable) = (s.plan.critical, s.plan.restartable);
        s.joined = false;
        s.deaths_ns.push_back(now.wall_ns);
        while s.deaths_ns.front().is_some_and(|at| now.wall_ns - at > limits.budget_window_ns) {
            s.deaths_ns.pop_front();
        }
        let deaths = s.deaths_ns.len() as u32;
        let spent = deaths > limits.restart_budget;
        let pause = limits.back_off_ns.saturating_mul(1 << (deaths - 1).min(16)).min(limits.back_off_max_ns);
        s.phase = if spent { Phase::Spent } else { Phase::Down { start_at_ns: now.wall_ns + pause } };
        s.joins_at_ns = now.run_ns + limits.restart_time_ns;
        s.restarts += u32::from(!spent);
        if !restartable {
            self.actions.push(Action::EndRun(format!("{service} died: {why}")));
        }
        let reason = StopReason::service(StopKind::ServiceDied, service, incarnation);
        if spent && critical {
            let reason = StopReason::service(StopKind::RestartBudgetSpent, service, incarnation);
            self.enter(ModeClass::Lock, reason, now.run_ns);
        } else if critical && !condemned {
            self.enter(ModeClass::Fault, reason, now.run_ns);
        }
        self.update_roster(now);
    }

    /// A fault of a process ends its incarnation: the stop first, then the kill.
    fn condemn(&mut self, reason: StopReason, now: Now) {
        let Some(s) = self.find(reason.service, reason.incarnation) else { return };
        if !matches!(s.phase, Phase::Ready | Phase::Starting { .. }) {
            return;
        }
        s.phase = Phase::Dying;
        s.joined = false;
        let critical = s.plan.critical;
        if critical {
            self.enter(ModeClass::Fault, reason, now.run_ns);
        }
        self.actions.push(Action::Kill(reason.service, reason.incarnation));
        self.actions.push(Action::Note(reason.to_string()));
        self.update_roster(now);
    }

    fn on_beat(&mut self, health: &Health, now: Now) {
        let Some(s) = self.find(health.service, health.header.incarnation) else { return };
        s.last_beat_ns = s.last_beat_ns.max(health.header.stamp_ns);
        for (rule, progress) in s.plan.streams.iter().zip(&mut s.progress) {
            let port = |topic, role| health.ports().iter().find(|port| port.topic == topic && port.role == role);
            let input = rule.input.and_then(|topic| port(topic, PortRole::Subscriber)).map_or(0, |port| port.count);
            let Some(out) = port(rule.output, PortRole::Publisher) else { continue };
            progress.out_stamp_ns = out.last_stamp_ns;
            if out.count != progress.out_count {
                *progress = Progress { out_count: out.count, changed_at_ns: now.run_ns, in_then: input, ..*progress };
            } else if input < progress.in_then + rule.inputs_per_output {
                // No input, no output: starved, which is nobody's fault here.
                progress.changed_at_ns = now.run_ns;
            }
        }
    }

    fn judge(&self, s: &Watched, now: Now) -> Option<StopReason> {
        if s.phase != Phase::Ready || (self.limits.stepped && !s.joined) {
            return None;
        }
        let age = now.run_ns.saturating_sub(s.last_beat_ns);
        if age > s.plan.beat_limit_ns {
            let mut reason = StopReason::service(StopKind::BeatsMissed, s.plan.service, s.incarnation);
            (reason.age_ns, reason.limit_ns) = (age, s.plan.beat_limit_ns);
            return Some(reason);
        }
        s.plan.streams.iter().zip(&s.progress).find_map(|(rule, progress)| {
            let silent = now.run_ns.saturating_sub(progress.changed_at_ns);
            (rule.input.is_some() && silent > rule.hang_ns).then(|| StopReason {
                age_ns: silent,
                limit_ns: rule.hang_ns,
                topic: rule.output,
                ..StopReason::service(StopKind::ServiceHung, s.plan.service, s.incarnation)
            })
        })
    }

    /// A stream that motion needs and that is older than `times` its max age, as its producer's beats tell.
    fn stale_stream(&self, now: Now, times: u64) -> Option<StopReason> {
        self.services.iter().filter(|s| s.phase == Phase::Ready).find_map(|s| {
            s.plan.streams.iter().zip(&s.progress).find_map(|(rule, progress)| {
                let limit = rule.max_age_ns? * times;
                let age = match progress.out_count {
                    0 => limit + self.limits.beat_lag_ns + 1,
                    _ => now.run_ns.saturating_sub(progress.out_stamp_ns),
                };
                // A beat brings the stamp up to two beat periods late.
                (age > limit + self.limits.beat_lag_ns)
                    .then(|| StopReason::stream(StopKind::StreamStale, rule.output, age, limit))
            })
        })
    }

    fn on_cue(&mut self, cue: &Cue, now: Now) {
        let id = (cue.header.incarnation, cue.header.seq);
        if id <= self.last_cue {
            return;
        }
        self.last_cue = id;
        if !cue.kind.is_moving() {
            // Locomotion took it already; here it ends the cue in force.
            self.mode.cue = CueInForce::default();
            self.mode_changed = true;
            return;
        }
        if let Err(why) = self.may_accept(cue, now) {
            self.actions.push(Action::Note(format!("cue \"{}\" refused: {why}", cue.kind.name())));
            return;
        }
        if self.mode.class == ModeClass::Fault {
            self.mode.class = ModeClass::Run;
            self.mode.reason = StopReason::default();
            self.stops.end_mode_stop(now.run_ns);
        }
        self.mode.cue = CueInForce { valid: true, cue: *cue };
        self.mode_changed = true;
    }

    fn may_accept(&self, cue: &Cue, now: Now) -> Result<(), String> {
        let age = now.run_ns.saturating_sub(cue.header.stamp_ns);
        if age > self.limits.cue_max_age_ns {
            return Err(format!(
                "it is {} ms old, limit {} ms",
                age / 1_000_000,
                self.limits.cue_max_age_ns / 1_000_000
            ));
        }
        match self.mode.class {
            ModeClass::Lock => Err(format!("the run is locked: {}", self.mode.reason)),
            ModeClass::Fault => match self.not_ready(now) {
                Some(why) => Err(format!("not ready: {why}")),
                None => Ok(()),
            },
            ModeClass::Run => Ok(()),
        }
    }

    /// Why a cue would not be accepted in fault, if so.
    #[must_use]
    pub fn not_ready(&self, now: Now) -> Option<String> {
        let stepped = self.limits.stepped;
        for s in self.services.iter().filter(|s| s.plan.critical) {
            if s.phase != Phase::Ready || (stepped && !s.joined) {
                return Some(format!("{} is not up", s.plan.service));
            }
            if !s.armed {
                return Some(format!("the line of {} is not armed", s.plan.service));
            }
            if now.run_ns.saturating_sub(s.last_beat_ns) > s.plan.beat_limit_ns {
                return Some(format!("{} is silent", s.plan.service));
            }
        }
        self.stale_stream(now, 1).map(|reason| reason.to_string())
    }

    fn update_ready(&mut self, now: Now) {
        let ready = self.mode.class != ModeClass::Lock && self.not_ready(now).is_none();
        if ready != self.mode.ready_for_cue {
            self.mode.ready_for_cue = ready;
            self.mode_changed = true;
        }
    }

    fn on_locomotion(&mut self, state: &LocomotionState, now: Now) {
        self.stops.locomotion(&self.mode, state, now.run_ns);
        // Locomotion latched itself in the epoch in force: only a greater one lets it go on.
        let latched = matches!(state.limited_by.kind, StopKind::ModeStale | StopKind::LifelineClosed | StopKind::Boot);
        let stuck = self.mode.class == ModeClass::Run && state.epoch == self.mode.epoch && latched;
        self.stuck_states = if stuck { self.stuck_states + 1 } else { 0 };
        if self.stuck_states >= 3 {
            self.stuck_states = 0;
            self.enter(ModeClass::Fault, state.limited_by, now.run_ns);
        }
    }

    fn on_resume(&mut self, now: Now) {
        if self.mode.class != ModeClass::Lock || self.ending {
            self.actions.push(Action::Note("resume refused: the run is not locked".to_owned()));
            return;
        }
        for s in &mut self.services {
            s.deaths_ns.clear();
            if s.phase == Phase::Spent {
                s.phase = Phase::Down { start_at_ns: now.wall_ns };
                s.joins_at_ns = now.run_ns + self.limits.restart_time_ns;
            }
        }
        self.mode.class = ModeClass::Fault;
        self.enter(ModeClass::Fault, StopReason::of(StopKind::Resumed), now.run_ns);
    }

    /// Enters fault or lock: the epoch rises, the cue in force is void. A lock is not left by a fault.
    fn enter(&mut self, class: ModeClass, reason: StopReason, run_ns: u64) {
        if self.mode.class == ModeClass::Lock && class == ModeClass::Fault {
            self.mode.epoch += 1;
            self.mode_changed = true;
            return;
        }
        self.mode.class = class;
        self.mode.reason = reason;
        self.mode.epoch += 1;
        self.mode.cue = CueInForce::default();
        self.mode.ready_for_cue = false;
        self.mode_changed = true;
        self.stops.begin_mode_stop(class, reason, run_ns);
    }

    /// Stepped time: who takes part from the next step on.
    fn update_roster(&mut self, now: Now) {
        let all_up = self.services.iter().all(|s| s.phase == Phase::Ready && s.armed);
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
                s.last_beat_ns = now.run_ns;
                for progress in &mut s.progress {
                    progress.changed_at_ns = now.run_ns;
                }
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

    /// Stepped time: the member whose beats are the oldest, which is the one that time waits for.
    #[must_use]
    pub fn latest_beater(&self) -> Option<(ServiceId, u32)> {
        self.services
            .iter()
            .filter(|s| s.phase == Phase::Ready && s.joined)
            .min_by_key(|s| s.last_beat_ns)
            .map(|s| (s.plan.service, s.incarnation))
    }

    /// A child was started.
    pub fn started(&mut self, service: ServiceId, incarnation: u32, pid: u32) {
        if let Some(s) = self.find(service, incarnation) {
            s.pid = pid;
        }
    }

    /// Name and age of the stream that is furthest over its max age, for the operator.
    #[must_use]
    pub fn topic_ages(&self, run_ns: u64) -> Vec<(TopicId, u64)> {
        let mut ages = Vec::new();
        for s in &self.services {
            for (rule, progress) in s.plan.streams.iter().zip(&s.progress) {
                ages.push((rule.output, run_ns.saturating_sub(progress.out_stamp_ns)));
            }
        }
        ages
    }
}

impl Watched {
    fn new(plan: ServicePlan) -> Self {
        let progress = vec![Progress::default(); plan.streams.len()];
        Self {
            plan,
            phase: Phase::Down { start_at_ns: 0 },
            incarnation: 0,
            pid: 0,
            armed: false,
            joined: false,
            joins_at_ns: 0,
            last_beat_ns: 0,
            progress,
            restarts: 0,
            deaths_ns: VecDeque::new(),
        }
    }
}

#[cfg(test)]
mod tests;
