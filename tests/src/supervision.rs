//! Supervision under a seeded simulator: the very machine, gate and watch of the services, over a world of processes
//! that start late, die, hang, leak and starve, and of messages that are late, lost or overtake each other.
//!
//! One seed is one course of events, the same on every machine. What must never be is looked for at every tick; once
//! the trouble is over, the machine must come to rest, and the robot must walk again by a cue.

mod checks;
mod links;
mod processes;
mod trouble;

use std::collections::{BTreeMap, VecDeque};

use guidedog_brake::Watch;
use guidedog_locomotion::{Gate, GateLimits};
use guidedog_supervisor::machine::{Action, Event, Machine, Now, Phase};
use guidedog_supervisor::plan::Plan;
use messages::{Cue, CueKind, Header, LocomotionState, Mode, ModeClass, Odometry, Permit, ServiceId, Twist2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use settings::Settings;
use transport::{ClockKind, Oversleep};

use checks::Checks;
use links::{Inbox, ToGate, ToSupervisor};
use processes::Process;

/// One tick of the simulation.
pub const TICK_MS: u64 = 5;
/// Trouble comes for this long; then the machine has to come to rest.
const TROUBLE_MS: u64 = 8_000;
/// And has this long for it: a start deadline, a back-off, a swap.
const REST_MS: u64 = 24_000;
const MS: u64 = 1_000_000;

/// How a seed went.
#[derive(Debug, Default, Clone)]
pub struct Course {
    /// Stops, swaps that came to their end, deaths, and ticks with the robot walking.
    pub counts: BTreeMap<&'static str, u64>,
}

/// The whole simulated run.
pub struct Simulation {
    rng: ChaCha8Rng,
    now_ms: u64,
    machine: Machine,
    oversleep: Oversleep,
    next_tick_ms: u64,
    /// The supervisor does not run until then.
    asleep_until_ms: u64,
    mode_due_ms: u64,
    processes: Vec<Process>,
    to_supervisor: Inbox<ToSupervisor>,
    to_gate: Inbox<ToGate>,
    to_shield: Inbox<Mode>,
    gate: Gate,
    gate_life: u32,
    gate_limits: GateLimits,
    watch: Watch,
    shield_mode: Option<Mode>,
    /// The velocity of the action that it always permits.
    forward: Twist2,
    /// The last decision of each policy, by its life.
    decisions: BTreeMap<u32, u64>,
    /// What the robot was last told, and by which life of locomotion; 0: the brake.
    robot: (bool, u32),
    /// The world tells nothing until then.
    world_still_until_ms: u64,
    /// Topics lose messages, and lines are slow, until then.
    network_bad_until_ms: u64,
    /// When the last message of each sender's line arrives.
    lines_busy_until_ms: BTreeMap<ServiceId, u64>,
    cue_seq: u64,
    seq: u64,
    checks: Checks,
    trace: VecDeque<String>,
    course: Course,
}

fn millis(text: &str) -> settings::Millis {
    settings::Millis::try_from(text.to_owned()).expect("a duration")
}

fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.policy.swap.decisions = 2;
    settings.policy.swap.probation = millis("1500ms");
    settings.supervision.ready_within = millis("3s");
    settings
}

/// Runs a seed: what happened.
///
/// # Errors
/// What went wrong, with the last events before it.
pub fn run(seed: u64) -> Result<Course, String> {
    let mut simulation = Simulation::new(seed);
    let outcome = simulation.run();
    outcome.map(|()| simulation.course.clone()).map_err(|what| {
        let trace: Vec<String> = simulation.trace.iter().cloned().collect();
        format!("seed {seed}, {} ms: {what}\n{}", simulation.now_ms, trace.join("\n"))
    })
}

impl Simulation {
    fn new(seed: u64) -> Self {
        let settings = settings();
        let gate_limits = GateLimits::of(&settings);
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            now_ms: 0,
            machine: Machine::new(Plan::of(&settings, ClockKind::Real)),
            oversleep: Oversleep::new(20 * MS),
            next_tick_ms: 0,
            asleep_until_ms: 0,
            mode_due_ms: 0,
            processes: Vec::new(),
            to_supervisor: Inbox::default(),
            to_gate: Inbox::default(),
            to_shield: Inbox::default(),
            gate: Gate::new(gate_limits.clone()),
            gate_life: 0,
            gate_limits,
            watch: Watch::new(settings.supervision.brake_limit.ns()),
            shield_mode: None,
            forward: settings.policy.actions.table().actions()[guidance::ActionTable::STOP + 1]
                .velocity(settings.policy.dt.s()),
            decisions: BTreeMap::new(),
            robot: (false, 0),
            world_still_until_ms: 0,
            network_bad_until_ms: 0,
            lines_busy_until_ms: BTreeMap::new(),
            cue_seq: 0,
            seq: 0,
            checks: Checks::default(),
            trace: VecDeque::new(),
            course: Course::default(),
        }
    }

    fn run(&mut self) -> Result<(), String> {
        while self.now_ms < TROUBLE_MS {
            self.trouble();
            self.tick()?;
        }
        self.calm_down();
        let until_ms = self.now_ms + REST_MS;
        while !self.walks_again() {
            if self.now_ms > until_ms {
                return Err(format!("it does not come to rest: {}", self.state_of_rest()));
            }
            self.help_along();
            self.tick()?;
        }
        Ok(())
    }

    fn now(&self) -> Now {
        Now { run_ns: self.now_ms * MS, wall_ns: (self.now_ms + 500_000) * MS }
    }

    fn note(&mut self, text: String) {
        if self.trace.len() >= 60 {
            self.trace.pop_front();
        }
        self.trace.push_back(format!("{:6} ms  {text}", self.now_ms));
    }

    fn count(&mut self, what: &'static str) {
        *self.course.counts.entry(what).or_default() += 1;
    }

    fn header(&mut self, incarnation: u32) -> Header {
        self.seq += 1;
        Header {
            stamp_ns: self.now_ms * MS,
            published_ns: self.now_ms * MS,
            seq: self.seq,
            incarnation,
            ..Header::default()
        }
    }

    /// One tick of everything.
    fn tick(&mut self) -> Result<(), String> {
        self.now_ms += TICK_MS;
        self.live();
        if self.now_ms >= self.asleep_until_ms {
            self.supervise()?;
        }
        self.shield();
        self.locomote();
        self.brake();
        self.check()
    }

    /// The supervisor's loop, as its shell runs it: drains before it judges.
    fn supervise(&mut self) -> Result<(), String> {
        let arrived = self.to_supervisor.due(self.now_ms);
        for message in arrived {
            let before = *self.machine.mode();
            let now = self.now();
            let is_cue = matches!(&message, ToSupervisor::Cue(cue) if cue.kind.is_moving());
            let is_resume = matches!(message, ToSupervisor::Resume);
            self.hear(message, now);
            self.checks.transition(&before, self.machine.mode(), is_cue, is_resume)?;
            self.act();
        }
        if self.now_ms >= self.next_tick_ms {
            let before = *self.machine.mode();
            if let Some(slept_ns) = self.oversleep.slept_ns(self.now_ms * MS) {
                self.machine.handle(Event::Overslept(slept_ns), self.now());
            }
            self.next_tick_ms = self.now_ms + 20;
            self.machine.tick_starts(self.now());
            self.machine.tick_judge(self.now());
            self.checks.transition(&before, self.machine.mode(), false, false)?;
        }
        self.act();
        if self.machine.take_mode_changed() || self.now_ms >= self.mode_due_ms {
            self.publish_mode();
        }
        Ok(())
    }

    fn hear(&mut self, message: ToSupervisor, now: Now) {
        match message {
            ToSupervisor::Ready(service, life) => self.machine.handle(Event::Ready(service, life), now),
            ToSupervisor::Armed { service, incarnation, by } => {
                self.machine.handle(Event::Armed { service, incarnation, by }, now);
            }
            ToSupervisor::Died(service, life) => {
                self.note(format!("hears that {service} {life} died"));
                self.machine.handle(Event::Died(service, life, "killed".to_owned()), now);
            }
            ToSupervisor::Left(service, life) => self.machine.handle(Event::Left(service, life), now),
            ToSupervisor::BrakeEngaged(life) => self.machine.handle(Event::BrakeEngaged(life), now),
            ToSupervisor::Beat(health) => self.machine.handle(Event::Beat(&health), now),
            ToSupervisor::Cue(cue) => self.machine.handle(Event::Cue(&cue), now),
            ToSupervisor::State(state) => self.machine.handle(Event::Locomotion(&state), now),
            ToSupervisor::Decision(action) => self.machine.handle(Event::Decision(&action), now),
            ToSupervisor::Permit(permit) => self.machine.handle(Event::Permit(&permit), now),
            ToSupervisor::Stop => self.machine.handle(Event::OperatorStop, now),
            ToSupervisor::Resume => self.machine.handle(Event::OperatorResume, now),
        }
    }

    /// Does what the machine wants, as the shell would: the stop before all else.
    fn act(&mut self) {
        loop {
            let actions = self.machine.take_actions();
            if actions.is_empty() {
                return;
            }
            for action in &actions {
                if let Action::StopLine { epoch, reason } = action {
                    self.note(format!("stops: {reason} (epoch {epoch})"));
                    self.count("stops");
                    self.line_to_gate(ToGate::Stop { epoch: *epoch, reason: *reason });
                }
            }
            self.publish_mode();
            for action in actions {
                match action {
                    Action::Spawn(service, life) => self.spawn(service, life),
                    Action::Kill(service, life) => self.kill(service, life, "the supervisor kills"),
                    Action::Release(service, life) => self.leave(service, life),
                    // Asked for over and over, it would hide all that matters.
                    Action::Note(text) if text.starts_with("cue") => {}
                    Action::Note(text) => self.note(text),
                    Action::EndRun(why) => self.note(format!("ends the run: {why}")),
                    Action::StopLine { .. } | Action::Begin | Action::Answer(_) => {}
                }
            }
        }
    }

    fn publish_mode(&mut self) {
        self.mode_due_ms = self.now_ms + 50;
        self.machine.take_mode_changed();
        let header = self.header(1);
        let mode = Mode { header, ..*self.machine.mode() };
        self.topic_to_gate(ToGate::Mode(Box::new(mode)));
        if !self.message_is_lost() {
            let due_ms = self.topic_due_ms();
            self.to_shield.push(due_ms, mode);
        }
    }

    /// Locomotion: the real gate, fed with what has come.
    fn locomote(&mut self) {
        let Some(life) = self.running(ServiceId::Locomotion) else { return };
        for message in self.to_gate.due(self.now_ms) {
            self.hear_at_gate(life, message);
        }
        let verdict = self.gate.judge(self.now_ms * MS);
        self.robot = (!verdict.velocity.is_zero(), life);
        self.checks.gate(&self.gate, &verdict, self.now_ms);
        if self.now_ms.is_multiple_of(20) {
            let state = LocomotionState {
                header: self.header(life),
                applied: verdict.velocity,
                limited_by: verdict.reason,
                epoch: self.gate.epoch(),
                ..LocomotionState::default()
            };
            self.topic_to_supervisor(ToSupervisor::State(Box::new(state)));
            self.watch.beat(self.now_ms * MS);
        }
    }

    fn hear_at_gate(&mut self, life: u32, message: ToGate) {
        match message {
            ToGate::Mode(mode) => self.gate.take_mode(&mode),
            ToGate::Stop { epoch, reason } => self.gate.stop_by(reason, epoch),
            ToGate::Permit(permit) => self.gate.take_permit(&permit),
            ToGate::StopCue(cue) => self.gate.take_cue(&cue),
            ToGate::Line(service, incarnation) => {
                self.gate.line_armed(service, incarnation);
                self.checks.armed(service, incarnation);
                let by = life;
                self.line_to_supervisor(service, ToSupervisor::Armed { service, incarnation, by });
            }
            ToGate::Closed(service, incarnation) => {
                let stops = self.gate.line_closed(service, incarnation);
                // One that has been swapped out may be gone before the gate has read who is named now.
                let stops = stops && self.machine.is_critical(service, incarnation);
                self.checks.closed(service, incarnation, stops.then(|| self.gate.epoch()));
            }
        }
    }

    /// The brake: the real watch, and its kill.
    fn brake(&mut self) {
        if self.running(ServiceId::Brake).is_none() || !self.now_ms.is_multiple_of(20) {
            return;
        }
        if let (Some(engagement), _) = self.watch.tick(self.now_ms * MS) {
            self.note(format!("the brake engages for locomotion {}", engagement.incarnation));
            self.kill(ServiceId::Locomotion, engagement.incarnation, "the brake kills");
            let life = engagement.incarnation;
            self.line_to_supervisor(ServiceId::Brake, ToSupervisor::BrakeEngaged(life));
        }
        if self.watch.is_engaged() {
            self.robot = (false, 0);
        }
    }

    /// A shield that judges nothing: it permits what the mode that it has read lets it.
    fn shield(&mut self) {
        for mode in self.to_shield.due(self.now_ms) {
            if self.shield_mode.is_none_or(|old| mode.epoch >= old.epoch) {
                self.shield_mode = Some(mode);
            }
        }
        let (Some(life), Some(mode)) = (self.running(ServiceId::Shield), self.shield_mode) else { return };
        if !self.now_ms.is_multiple_of(100) {
            return;
        }
        let now_decision = self.now_ms / 500;
        let fresh = |decision: Option<&u64>| decision.is_some_and(|n| n + 1 >= now_decision && *n <= now_decision);
        let lives = [mode.active_policy, mode.previous_policy];
        let Some(policy) = lives.into_iter().find(|life| *life != 0 && fresh(self.decisions.get(life))) else { return };
        let sees = self.running(ServiceId::Lidar).is_some() && self.now_ms >= self.world_still_until_ms;
        if mode.class != ModeClass::Run || !mode.cue.valid || !sees {
            return;
        }
        let mut permit = Permit {
            header: self.header(life),
            outcome: messages::Outcome::Granted,
            epoch: mode.epoch,
            decision: now_decision,
            policy_incarnation: policy,
            odometry_incarnation: self.life_of(ServiceId::Odometry),
            cue_incarnation: mode.cue.cue.header.incarnation,
            cue_seq: mode.cue.cue.header.seq,
            expiry_ns: (self.now_ms + 200) * MS,
            ..Permit::default()
        };
        let forward = guidance::ActionTable::STOP + 1;
        (permit.action, permit.velocity) = (forward as u32, self.forward);
        self.topic_to_gate(ToGate::Permit(Box::new(permit)));
        self.topic_to_supervisor(ToSupervisor::Permit(Box::new(permit)));
    }

    fn cue(&mut self, kind: CueKind) {
        let Some(life) = self.running(ServiceId::Cue) else { return };
        self.cue_seq += 1;
        let header = Header { seq: self.cue_seq, ..self.header(life) };
        let cue = Cue { header, kind, odometry_incarnation: 1, ..Cue::default() };
        if !kind.is_moving() {
            self.topic_to_gate(ToGate::StopCue(Box::new(cue)));
        }
        let due_ms = self.topic_due_ms();
        // The buffer of cues is deep: none is lost.
        self.to_supervisor.push(due_ms, ToSupervisor::Cue(Box::new(cue)));
    }

    /// The gate needs a pose of the frame that the permit is in.
    fn odometry(&mut self, life: u32) {
        let header = self.header(life);
        if self.now_ms >= self.world_still_until_ms && self.running(ServiceId::Locomotion).is_some() {
            self.gate.take_odometry(&Odometry { header, ..Odometry::default() });
        }
    }

    fn walks_again(&self) -> bool {
        let walks = self.robot.0 && self.machine.mode().class == ModeClass::Run;
        walks && self.all_wanted_are_up() && !self.swap_is_under_way()
    }

    fn swap_is_under_way(&self) -> bool {
        let last = self.machine.policies().records().last();
        last.is_some_and(|swap| !swap.state.is_over())
    }

    fn all_wanted_are_up(&self) -> bool {
        let mut wanted = self.machine.status(self.now_ms * MS).into_iter().filter(|s| s.phase != Phase::Off);
        wanted.all(|s| s.phase == Phase::Ready)
    }

    fn state_of_rest(&mut self) -> String {
        let verdict = self.gate.judge(self.now_ms * MS);
        let mode = self.machine.mode();
        let phases: Vec<String> = self
            .machine
            .status(self.now_ms * MS)
            .iter()
            .filter(|s| s.phase != Phase::Ready)
            .map(|s| format!("{} {:?}", s.service, s.phase))
            .collect();
        let swap = self.machine.policies().records().last().map_or("none", |swap| swap.state.name());
        let not_ready = self.machine.not_ready(self.now());
        format!(
            "{} ({}), swap {swap}, the gate says {}, {phases:?}, {not_ready:?}",
            mode.class.name(),
            mode.reason,
            verdict.reason
        )
    }
}
