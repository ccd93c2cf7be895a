//! What the supervisor decides: events and times in, actions out. No clock, no process, no I/O.

mod watched;

use messages::{
    Cue, CueInForce, CueKind, CueSource, Health, LocomotionState, Member, Mode, ModeClass, ServiceId, StopKind,
    StopReason, TopicId, age_ns,
};

use crate::plan::{Limits, Plan};
use crate::stops::StopLog;
pub use watched::Phase;
use watched::Watched;

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
    /// That incarnation of locomotion watches a child's lifeline; the brake that of locomotion.
    Armed {
        /// Whose line.
        service: ServiceId,
        /// Which life of it.
        incarnation: u32,
        /// Which life of locomotion, or of the brake, watches it.
        by: u32,
    },
    /// A child is gone.
    Died(ServiceId, u32, String),
    /// A child's beat.
    Beat(&'a Health),
    /// Stepped time: members that did not do their step in time; where there are none, it is the master who gives none.
    TimeStands(&'a [Member]),
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
    /// Tell locomotion over its line that the robot is to stand: before anything else.
    StopLine {
        /// The epoch of the stop.
        epoch: u64,
        /// Why.
        reason: StopReason,
    },
    /// Everything is up for the first time.
    Begin,
    /// Tell the operator.
    Note(String),
    /// The run cannot go on.
    EndRun(String),
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
    /// Run time of the last entry into fault or lock.
    stopped_at_ns: u64,
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
            stopped_at_ns: 0,
            stuck_states: 0,
            ending: false,
            begun: false,
            stops: StopLog::default(),
        };
        machine.enter(ModeClass::Fault, StopReason::of(StopKind::Boot), 0);
        // There is nobody to be told yet.
        machine.actions.clear();
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
            Event::Armed { service, incarnation, by } => self.on_armed(service, incarnation, by, now),
            Event::Died(service, incarnation, why) => self.on_died(service, incarnation, &why, now),
            Event::Beat(health) => self.on_beat(health, now),
            Event::TimeStands(late) => self.on_time_stands(late, now),
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
                self.enter(ModeClass::Lock, StopReason::of(StopKind::OperatorStop), now.run_ns);
            }
            Event::OperatorResume => self.on_resume(now),
            Event::ShutDown => {
                self.ending = true;
                self.enter(ModeClass::Lock, StopReason::of(StopKind::ShuttingDown), now.run_ns);
            }
            Event::Overslept => {
                // A judge that slept condemns nobody: everything is counted from its wake-up on.
                self.grace_until_ns = now.run_ns + self.limits.beat_ns;
                self.services.iter_mut().for_each(|s| s.count_from(now.run_ns));
            }
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
                    s.begin_life(now.wall_ns + self.limits.ready_ns);
                    let (service, incarnation) = (s.plan.service, s.incarnation);
                    self.actions.push(Action::Spawn(service, incarnation));
                    self.void_lines_of(service);
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
                let s = &self.services[i];
                let judged = s.phase == Phase::Ready && (s.joined || !self.limits.stepped);
                if let Some(reason) = judged.then(|| s.judge(now.run_ns)).flatten() {
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
            s.count_from(now.run_ns);
            match service {
                ServiceId::Policy => self.mode.active_policy = incarnation,
                ServiceId::Shield => self.mode.active_shield = incarnation,
                _ => {}
            }
            self.mode_changed = true;
        }
        self.update_roster(now);
    }

    fn on_armed(&mut self, service: ServiceId, incarnation: u32, by: u32, now: Now) {
        let watcher = watcher_of(service);
        let current = self.services.iter().any(|s| s.plan.service == watcher && s.incarnation == by);
        if let Some(s) = self.find(service, incarnation).filter(|_| current) {
            s.armed = true;
        }
        self.update_roster(now);
    }

    /// A new life watches nobody's line yet.
    fn void_lines_of(&mut self, watcher: ServiceId) {
        for s in &mut self.services {
            s.armed &= !s.plan.has_line || watcher_of(s.plan.service) != watcher;
        }
    }

    /// Only who keeps time waiting is at fault; where nobody does, the master does not give the next step.
    fn on_time_stands(&mut self, late: &[Member], now: Now) {
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

    fn on_beat(&mut self, health: &Health, now: Now) {
        let Some(s) = self.find(health.service, health.header.incarnation) else { return };
        if s.take_beat(health, now.run_ns) {
            let reason = StopReason { topic: TopicId::Odometry, ..StopReason::of(StopKind::PoseJump) };
            self.enter(ModeClass::Fault, reason, now.run_ns);
        }
    }

    /// A stream that motion needs and that is older than `times` its max age, as its producer's beats tell.
    fn stale_stream(&self, now: Now, times: u64) -> Option<StopReason> {
        let ready = self.services.iter().filter(|s| s.phase == Phase::Ready);
        ready.into_iter().find_map(|s| s.stale_stream(now.run_ns, times, self.limits.beat_lag_ns))
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
        } else if spent && !self.begun {
            // A run that never began has nobody to wait for.
            self.actions.push(Action::EndRun(format!("{service} could not be started: {why}")));
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
        let (critical, restartable) = (s.plan.critical, s.plan.restartable);
        if critical {
            self.enter(ModeClass::Fault, reason, now.run_ns);
        }
        if !restartable {
            self.actions.push(Action::EndRun(reason.to_string()));
        }
        self.actions.push(Action::Kill(reason.service, reason.incarnation));
        self.actions.push(Action::Note(reason.to_string()));
        self.update_roster(now);
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
        let age = age_ns(now.run_ns, cue.header.stamp_ns);
        if age > self.limits.cue_max_age_ns {
            return Err(format!(
                "it is {} ms old, limit {} ms",
                age / 1_000_000,
                self.limits.cue_max_age_ns / 1_000_000
            ));
        }
        if !cue.is_usable() {
            return Err("its start frame or its confidence is none".to_owned());
        }
        if cue.source == CueSource::TurnDone && !self.continues(cue) {
            return Err("the turn that it goes on from is no longer in force".to_owned());
        }
        match self.mode.class {
            ModeClass::Lock => Err(format!("the run is locked: {}", self.mode.reason)),
            ModeClass::Fault => match self.not_ready(now) {
                Some(why) => Err(format!("not ready: {why}")),
                None if cue.header.stamp_ns <= self.stopped_at_ns => Err("it was given before the stop".to_owned()),
                None => Ok(()),
            },
            ModeClass::Run => Ok(()),
        }
    }

    /// Whether a cue that no handler gave goes on from the very turn in force.
    fn continues(&self, cue: &Cue) -> bool {
        let turn = &self.mode.cue.cue;
        let is_turn = matches!(turn.kind, CueKind::Left | CueKind::Right);
        self.mode.class == ModeClass::Run && self.mode.cue.valid && is_turn && turn.header.seq == cue.request_seq
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
            if s.silence(now.run_ns).is_some() {
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
        let latched = state.limited_by.kind.is_latched();
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
        self.stopped_at_ns = run_ns;
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
        self.actions.push(Action::StopLine { epoch: self.mode.epoch, reason });
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

    /// Whether a service is at work.
    #[must_use]
    pub fn is_ready(&self, service: ServiceId) -> bool {
        self.services.iter().any(|s| s.plan.service == service && s.phase == Phase::Ready)
    }

    /// Whether everything has been up once.
    #[must_use]
    pub fn has_begun(&self) -> bool {
        self.begun
    }

    /// Whether a service has a lifeline.
    #[must_use]
    pub fn has_line(&self, service: ServiceId) -> bool {
        self.services.iter().any(|s| s.plan.service == service && s.plan.has_line)
    }

    /// A child was started.
    pub fn started(&mut self, service: ServiceId, incarnation: u32, pid: u32) {
        if let Some(s) = self.find(service, incarnation) {
            s.pid = pid;
        }
    }

    /// Every stream and its age, nanoseconds, for the operator.
    #[must_use]
    pub fn topic_ages(&self, run_ns: u64) -> Vec<(TopicId, u64)> {
        self.services.iter().flat_map(|s| s.stream_ages(run_ns)).collect()
    }
}

/// Who watches a service's line.
fn watcher_of(service: ServiceId) -> ServiceId {
    if service == ServiceId::Locomotion { ServiceId::Brake } else { ServiceId::Locomotion }
}

#[cfg(test)]
mod tests;
