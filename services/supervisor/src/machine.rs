//! What the supervisor decides: events and times in, actions out. No clock, no process, no I/O.

mod cues;
mod formation;
mod lives;
mod refused;
mod roster;
mod swap;
mod watched;

use messages::{
    Cue, CueAnswer, CueInForce, EmergencyStop, Health, LocomotionState, Member, Mode, ModeClass, Permit, PolicyAction,
    ServiceId, StopClass, StopInput, StopKind, StopReason, TopicId,
};

use crate::plan::{Limits, Plan, ServicePlan};
use crate::stops::StopLog;
use formation::Asking;
pub use refused::Refused;
pub use swap::{Policies, SwapLimits};
use watched::Watched;
pub use watched::{Phase, Role};

/// So many states of locomotion in a row tell of an empty battery, half a second of them: one that is garbled tells of
/// none.
const LOW_STATES: u32 = 25;

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
    /// Somebody wants a service that runs on demand.
    Demand(ServiceId),
    /// Nobody wants it any more.
    Release(ServiceId),
    /// A child has left by plan, asked to or of itself, and ended.
    Left(ServiceId, u32),
    /// Stepped time: members that did not do their step in time; where there are none, it is the master who gives none.
    TimeStands(&'a [Member]),
    /// The brake engaged for that incarnation of locomotion.
    BrakeEngaged(u32),
    /// A cue was recognised.
    Cue(&'a Cue),
    /// A policy decided, active or not.
    Decision(&'a PolicyAction),
    /// The shield's verdict.
    Permit(&'a Permit),
    /// The emergency stop's word.
    Estop(&'a EmergencyStop),
    /// What locomotion does.
    Locomotion(&'a LocomotionState),
    /// The operator's stop.
    OperatorStop,
    /// The operator resumes a locked run.
    OperatorResume,
    /// The run ends, for that reason.
    ShutDown(StopKind),
    /// The supervisor's own loop slept for so long, nanoseconds: longer than it may.
    Overslept(u64),
}

/// What is to be done about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Start that incarnation.
    Spawn(ServiceId, u32),
    /// End that incarnation: SIGKILL, never waited for.
    Kill(ServiceId, u32),
    /// Ask that incarnation to finish what it does and to leave.
    Release(ServiceId, u32),
    /// Tell locomotion over its line that the robot is to stand: before anything else.
    StopLine {
        /// The epoch of the stop.
        epoch: u64,
        /// Why.
        reason: StopReason,
    },
    /// Everything is up for the first time.
    Begin,
    /// Tell who gave a cue what became of it.
    Answer(CueAnswer),
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
    /// Which of two policies.
    pub role: Role,
    /// The input that it lacks, if any; it is not restarted for that.
    pub starved_of: Option<TopicId>,
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
    last_cue: (u64, u32, u64),
    grace_until_ns: u64,
    /// Run time of the last entry into fault or lock.
    stopped_at_ns: u64,
    stuck_states: u32,
    /// States of locomotion in a row that tell of a battery nearly empty.
    low_states: u32,
    /// The emergency stop's last word; where there is none, it is released.
    estop: StopInput,
    warned_of_charge: bool,
    ending: bool,
    begun: bool,
    policies: Policies,
    asking: Option<Asking>,
    /// Run time at which the cue in force was accepted.
    cue_accepted_ns: u64,
    /// What stopped the robot, and when.
    pub stops: StopLog,
}

impl Machine {
    /// A machine over the services of a plan, none of them started, in fault.
    #[must_use]
    pub fn new(plan: Plan) -> Self {
        let mut services: Vec<Watched> =
            plan.services.into_iter().map(|plan| Watched::new(plan, Role::Active)).collect();
        // Room for a candidate beside the policy in force.
        let policy = services.iter().find(|s| s.plan.service == ServiceId::Policy).map(|s| s.plan.clone());
        services.extend(policy.map(|plan| Watched::new(ServicePlan { on_demand: true, ..plan }, Role::Shadow)));
        let mut machine = Self {
            estop: if plan.limits.estop { StopInput::Unknown } else { StopInput::Released },
            limits: plan.limits,
            services,
            mode: Mode::default(),
            mode_changed: true,
            actions: Vec::new(),
            roster: Vec::new(),
            roster_version: 0,
            last_cue: (0, 0, 0),
            grace_until_ns: 0,
            stopped_at_ns: 0,
            stuck_states: 0,
            low_states: 0,
            warned_of_charge: false,
            ending: false,
            begun: false,
            policies: Policies::default(),
            asking: None,
            cue_accepted_ns: 0,
            stops: StopLog::default(),
        };
        machine.enter(StopReason::of(StopKind::Boot), Now { run_ns: 0, wall_ns: 0 });
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

    /// Every service as it is; the room for another policy only while there is one.
    #[must_use]
    pub fn status(&self, run_ns: u64) -> Vec<ServiceStatus> {
        let is_told = |s: &&Watched| s.role == Role::Active || s.phase != Phase::Off;
        let by_role = |role| self.services.iter().filter(is_told).filter(move |s| s.role == role);
        by_role(Role::Active)
            .chain(by_role(Role::Shadow))
            .map(|s| ServiceStatus {
                service: s.plan.service,
                pid: if matches!(s.phase, Phase::Off | Phase::Down { .. } | Phase::Spent) { 0 } else { s.pid },
                phase: s.phase,
                incarnation: s.incarnation,
                restarts: s.restarts,
                critical: s.is_critical(),
                role: s.role,
                starved_of: s.starved_of(run_ns),
            })
            .collect()
    }

    /// Something happened.
    pub fn handle(&mut self, event: Event<'_>, now: Now) {
        match event {
            Event::Ready(service, incarnation) => self.on_ready(service, incarnation, now),
            Event::Armed { service, incarnation, by } => self.on_armed(service, incarnation, by, now),
            Event::Died(service, incarnation, why) => self.on_died(service, incarnation, &why, now),
            Event::Demand(service) => self.on_demand(service, now),
            Event::Release(service) => self.on_release(service, now),
            Event::Left(service, incarnation) => self.on_left(service, incarnation, now),
            Event::Beat(health) => self.on_beat(health, now),
            Event::TimeStands(late) => self.on_time_stands(late, now),
            Event::BrakeEngaged(incarnation) => self.on_brake_engaged(incarnation, now),
            Event::Cue(cue) => self.on_cue(cue, now),
            Event::Decision(action) => self.on_decision(action, now),
            Event::Permit(permit) => self.on_permit(permit, now),
            Event::Estop(stop) => self.on_estop(stop.input, now),
            Event::Locomotion(state) => self.on_locomotion(state, now),
            Event::OperatorStop => {
                self.enter(StopReason::of(StopKind::OperatorStop), now);
            }
            Event::OperatorResume => self.on_resume(now),
            Event::ShutDown(why) => {
                self.ending = true;
                self.enter(StopReason::of(why), now);
            }
            Event::Overslept(slept_ns) => {
                let limit_ns = self.limits.mode_max_age_ns;
                if self.mode.class == ModeClass::Run && slept_ns > limit_ns {
                    // Locomotion that saw this run stands for good; one that has not must not begin it now.
                    let reason = StopReason::of(StopKind::SupervisorStalled);
                    self.enter(StopReason { age_ns: slept_ns, limit_ns, ..reason }, now);
                }
                // A judge that slept condemns nobody: everything is counted from its wake-up on.
                self.grace_until_ns = now.run_ns + self.limits.beat_ns;
                self.services.iter_mut().for_each(|s| s.count_from(now.run_ns));
            }
        }
        self.update_ready(now);
    }

    /// The brake stands in for locomotion. Where locomotion's end was seen first, that was the stop already.
    fn on_brake_engaged(&mut self, incarnation: u32, now: Now) {
        let Some(s) = self.find(ServiceId::Locomotion, incarnation) else { return };
        match s.phase {
            // The brake has killed it; its end is on the way.
            Phase::Ready => s.phase = Phase::Dying,
            Phase::Starting { .. } => {}
            _ => return,
        }
        let reason = StopReason::service(StopKind::BrakeEngaged, ServiceId::Locomotion, incarnation);
        self.enter(reason, now);
    }

    /// Wall time passed: starts what is due, condemns what did not get ready.
    pub fn tick_starts(&mut self, now: Now) {
        if self.ending {
            return;
        }
        for i in 0..self.services.len() {
            let stage = self.services[i].plan.stage;
            let is_there =
                |s: &Watched| matches!(s.phase, Phase::Ready | Phase::Off | Phase::Leaving { .. }) || s.waits_to_join();
            let below_ready = self.services.iter().all(|s| s.plan.stage >= stage || !s.plan.waited_for || is_there(s));
            let incarnation = self.next_incarnation(self.services[i].plan.service);
            let s = &mut self.services[i];
            match s.phase {
                Phase::Down { start_at_ns } if now.wall_ns >= start_at_ns && below_ready => {
                    s.begin_life(incarnation, now.wall_ns + self.limits.ready_ns);
                    let (service, role) = (s.plan.service, s.role);
                    self.actions.push(Action::Spawn(service, incarnation));
                    self.void_lines_of(service);
                    if role == Role::Shadow {
                        self.candidate_spawned(incarnation);
                    }
                }
                Phase::Starting { ready_by_ns } if now.wall_ns > ready_by_ns => {
                    let reason = StopReason::service(StopKind::ServiceHung, s.plan.service, s.incarnation);
                    self.actions.push(Action::Note(format!("{} was not ready in time", s.plan.service)));
                    self.condemn(reason, now);
                }
                Phase::Leaving { kill_at_ns, asked } if now.wall_ns > kill_at_ns => {
                    s.phase = Phase::Leaving { kill_at_ns: u64::MAX, asked };
                    let late = format!("{} ({}) did not leave in time", s.plan.service, s.incarnation);
                    self.actions.extend(asked.then_some(Action::Note(late)));
                    self.actions.push(Action::Kill(s.plan.service, s.incarnation));
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
                self.enter(reason, now);
            }
            self.tick_swap(now);
        }
        self.update_ready(now);
    }

    fn find(&mut self, service: ServiceId, incarnation: u32) -> Option<&mut Watched> {
        self.services.iter_mut().find(|s| s.plan.service == service && s.incarnation == incarnation)
    }

    fn on_beat(&mut self, health: &Health, now: Now) {
        let Some(s) = self.find(health.service, health.header.incarnation) else { return };
        if s.take_beat(health, now.run_ns) {
            let reason = StopReason { topic: TopicId::Odometry, ..StopReason::of(StopKind::PoseJump) };
            self.enter(reason, now);
        }
    }

    /// A stream that motion needs and that is older than `times` its max age, as its producer's beats tell.
    fn stale_stream(&self, now: Now, times: u64) -> Option<StopReason> {
        let needed = self.services.iter().filter(|s| s.phase == Phase::Ready && s.role == Role::Active);
        needed.into_iter().find_map(|s| s.stale_stream(now.run_ns, times, self.limits.beat_lag_ns))
    }

    fn on_locomotion(&mut self, state: &LocomotionState, now: Now) {
        self.stops.locomotion(&self.mode, state, now.run_ns);
        self.note_asking(state);
        self.judge_robot(state, now);
        // Locomotion latched itself in the epoch in force: only a greater one lets it go on.
        let latched = state.limited_by.kind.is_latched();
        let stuck = self.mode.class == ModeClass::Run && state.epoch == self.mode.epoch && latched;
        self.stuck_states = if stuck { self.stuck_states + 1 } else { 0 };
        if self.stuck_states >= 3 {
            self.stuck_states = 0;
            self.enter(state.limited_by, now);
        }
    }

    /// What the robot says of itself: that somebody stopped it by its hand remote, and its battery.
    fn judge_robot(&mut self, state: &LocomotionState, now: Now) {
        // A state of before the resume tells of the stop that was resumed.
        let stopped = state.remote_stop && state.epoch == self.mode.epoch;
        if stopped && self.mode.class != ModeClass::Lock {
            self.enter(StopReason::of(StopKind::RemoteStop), now);
        }
        let [warn, stop] = self.limits.charge_percent.map(u32::from);
        let low = (1..=stop).contains(&state.charge_percent);
        self.low_states = if low { self.low_states.saturating_add(1) } else { 0 };
        if self.battery_is_low() && self.mode.class == ModeClass::Run {
            self.enter(StopReason::of(StopKind::BatteryLow), now);
        }
        let warns = (1..=warn).contains(&state.charge_percent);
        if warns && !self.warned_of_charge {
            let text = format!("the robot's battery is at {} %; it stops at {stop} %", state.charge_percent);
            self.actions.push(Action::Note(text));
        }
        self.warned_of_charge |= warns;
    }

    fn on_estop(&mut self, input: StopInput, now: Now) {
        self.estop = input;
        if input.stops() && self.mode.class != ModeClass::Lock {
            self.enter(StopReason::of(StopKind::EmergencyStop), now);
        }
    }

    fn battery_is_low(&self) -> bool {
        self.low_states >= LOW_STATES
    }

    fn on_resume(&mut self, now: Now) {
        if self.mode.class != ModeClass::Lock || self.ending {
            self.actions.push(Action::Note("resume refused: the run is not locked".to_owned()));
            return;
        }
        if self.estop.stops() {
            let text = format!("resume refused: the emergency stop is {}", self.estop.name());
            self.actions.push(Action::Note(text));
            return;
        }
        for s in &mut self.services {
            s.deaths_ns.clear();
            // What nobody asks for any more is not begun again: the operator resumes a walk.
            if s.phase == Phase::Spent && !s.plan.on_demand {
                s.phase = Phase::Down { start_at_ns: now.wall_ns };
                s.joins_at_ns = now.run_ns + self.limits.restart_time_ns;
            }
        }
        self.mode.class = ModeClass::Fault;
        self.enter(StopReason::of(StopKind::Resumed), now);
    }

    /// Enters fault or lock, as the stop's row says: the epoch rises, the cue in force is void. A lock is not left by a
    /// fault.
    fn enter(&mut self, reason: StopReason, now: Now) {
        let is_lock = reason.kind.info().is_some_and(|stop| stop.class == StopClass::Lock);
        let class = if is_lock { ModeClass::Lock } else { ModeClass::Fault };
        self.stopped_at_ns = now.run_ns;
        if self.mode.class == ModeClass::Lock && class == ModeClass::Fault {
            self.mode.epoch += 1;
            self.mode_changed = true;
            return;
        }
        self.mode.class = class;
        self.mode.reason = reason;
        self.mode.epoch += 1;
        self.mode.cue = CueInForce::default();
        self.ask_no_more();
        self.mode.ready_for_cue = false;
        self.mode_changed = true;
        self.actions.push(Action::StopLine { epoch: self.mode.epoch, reason });
        self.stops.begin_mode_stop(class, reason, now.run_ns);
        self.stop_swap(&reason.to_string(), now);
    }

    /// Whether a service is at work.
    #[must_use]
    pub fn is_ready(&self, service: ServiceId) -> bool {
        self.services.iter().any(|s| s.plan.service == service && s.phase == Phase::Ready)
    }

    /// Whether motion needs that incarnation.
    #[must_use]
    pub fn is_critical(&self, service: ServiceId, incarnation: u32) -> bool {
        let mut lives = self.services.iter().filter(|s| s.plan.service == service && s.incarnation == incarnation);
        lives.any(Watched::is_critical)
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
        self.services.iter().filter(|s| s.role == Role::Active).flat_map(|s| s.stream_ages(run_ns)).collect()
    }
}

#[cfg(test)]
mod tests;
