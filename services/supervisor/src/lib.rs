//! The supervisor: starts the services of a run, watches them, restarts what fails, and is the only one to say that the
//! robot may move.
//!
//! Duties: latches the stop first, then kills, cleans and restarts; accepts cues; answers the operator; at the end
//! stops the robot first and leaves nothing behind. It must never wait for a process, start motion by itself, or
//! judge others when it overslept. `machine` decides and `children` acts; this file is the thin shell between
//! them.

mod boot;
mod children;
mod ending;
mod faults;
mod freeze;
mod journal;
mod last_words;
pub mod machine;
mod operator;
pub mod plan;
mod planned;
mod recording;
pub mod report;
mod server;
mod step_watch;
pub mod stops;
mod systemd;
mod tone;

use std::collections::BTreeMap;

use control::{PolicySpec, RunFigures};
use messages::{
    ClockAck, Cue, CueAnswer, CueRequest, EmergencyStop, Health, LocomotionState, Member, Mode, Permit, PolicyAction,
    ServiceId, SpeechSaid, StopKind, WorldTruth,
};
use serde_json::Value;
use settings::{AttitudeSource, PhysicsKind};
use transport::{FromChild, Io, Janitor, Oversleep, Publisher, Received, RunDir, Service, Subscriber};
use transport::{ToChild, TransportError, monotonic_ns};

use children::Children;
use ending::Ending;
use faults::Faults;
use journal::Journal;
use last_words::last_words;
use machine::{Action, Event, Machine, Now};
use planned::PlannedRequests;
use report::Figures;
use server::ControlServer;
use step_watch::StepWatch;
use systemd::Systemd;
use tone::Tone;

pub use boot::{EXIT_BAD_SETTINGS, EXIT_RUN_FAILED, main};

/// The mode is published at every change and at least this often.
const MODE_PERIOD_NS: u64 = 50_000_000;
/// A cue, or a resume, is meant for so long.
const STILL_MEANT_NS: u64 = 1_000_000_000;
/// Beats are read and judged this often.
pub(crate) const TICK_NS: u64 = 20_000_000;
/// Logs of so many lives of a service are kept.
const LOGS_KEPT: u32 = 8;
/// A restart waits for the janitor at most this long, wall time.
const JANITOR_LIMIT_NS: u64 = 1_000_000_000;

const TOKEN_SIGNAL: u64 = 1;
const TOKEN_OWNER: u64 = 2;

/// The shell around the machine.
pub struct Supervisor {
    machine: Machine,
    children: Children,
    /// What moves the simulated world, where there is one.
    physics: PhysicsKind,
    /// Where the body's attitude comes from.
    attitude: AttitudeSource,
    /// Something watches the floor.
    watches_floor: bool,
    /// Why no spoken cue starts the robot, if so.
    no_start_by_voice: Option<String>,
    server: ControlServer,
    figures: Figures,
    journal: Journal,
    janitor: Janitor,
    /// Incarnations that wait for the janitor, and until which wall time.
    waiting: Vec<(ServiceId, u32, u64)>,
    ending: Ending,
    faults: Faults,
    planned: PlannedRequests,
    health: Vec<Subscriber<Health>>,
    cues: Subscriber<Cue>,
    estop: Subscriber<EmergencyStop>,
    locomotion: Subscriber<LocomotionState>,
    decisions: Subscriber<PolicyAction>,
    permits: Subscriber<Permit>,
    truth: Subscriber<WorldTruth>,
    modes: Publisher<Mode>,
    requests: Publisher<CueRequest>,
    answers: Publisher<CueAnswer>,
    said: Subscriber<SpeechSaid>,
    /// The sentence that the robot said last, and how far it is.
    last_said: Option<SpeechSaid>,
    tone: Tone,
    /// What services say that they run with.
    abouts: BTreeMap<(ServiceId, u32), Value>,
    last_truth: Option<WorldTruth>,
    last_locomotion: Option<LocomotionState>,
    next_tick_ns: u64,
    /// The wall tick has come: in real time beats are read and judged with it.
    ticks: bool,
    oversleep: Oversleep,
    mode_due_ns: u64,
    steps: StepWatch,
    /// Stepped time: who is killed once all others have done the step.
    condemned: Vec<Member>,
    /// Stepped time: what the members acknowledge.
    acks: Subscriber<ClockAck>,
    signals: std::os::fd::OwnedFd,
    systemd: Systemd,
    owner: Option<std::os::fd::OwnedFd>,
    /// Why the run ended, where it was not as planned.
    failure: Option<String>,
    /// Run time of the last wake-up.
    woken_ns: u64,
    /// Run time at which the run ended.
    ended_ns: u64,
}

impl Supervisor {
    fn now(io: &Io) -> Now {
        Now { run_ns: io.now_ns(), wall_ns: monotonic_ns() }
    }

    /// Does what the machine wants done, and tells the mode where it changed.
    fn act(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let mut published = Ok(());
        loop {
            let actions = self.machine.take_actions();
            if actions.is_empty() {
                break;
            }
            published = published.and(self.perform(actions, io));
        }
        self.spawn_waiting(io);
        let published = published.and(if io.domain.clock.is_stepped() { Ok(()) } else { self.publish_mode(io) });
        self.journal.observe(&self.machine, io.now_ns());
        published
    }

    fn perform(&mut self, actions: Vec<Action>, io: &mut Io) -> Result<(), TransportError> {
        // The stop is out before anything else is done about its cause; first over the line, which needs no shared
        // memory.
        for action in &actions {
            if let Action::StopLine { epoch, reason } = action
                && !io.domain.clock.is_stepped()
            {
                // In stepped time a stop takes effect in the next step, for everybody alike.
                self.children.tell(ServiceId::Locomotion, &ToChild::Stop { epoch: *epoch, reason: *reason });
            }
        }
        let mut published = if io.domain.clock.is_stepped() { Ok(()) } else { self.publish_mode(io) };
        for action in actions {
            match action {
                Action::StopLine { .. } => {}
                Action::Begin => self.children.tell(ServiceId::Replay, &ToChild::Begin),
                Action::Kill(service, life) => {
                    if self.never_starts(service, life, io) {
                        continue;
                    }
                    if io.domain.clock.is_stepped() {
                        // Nobody else is to see it end in the middle of a step.
                        self.condemned.push(Member { service, incarnation: life });
                    } else {
                        self.children.kill(service, life);
                    }
                }
                Action::Release(service, life) => {
                    if !self.never_starts(service, life, io) {
                        self.children.tell_life(service, life, &ToChild::Leave);
                    }
                }
                Action::Spawn(service, incarnation) => {
                    self.waiting.push((service, incarnation, monotonic_ns() + JANITOR_LIMIT_NS));
                }
                Action::Note(text) => self.figures.note(io.now_ns(), text),
                Action::Answer(answer) => {
                    journal::cue_refused(io.now_ns(), &answer);
                    published = published.and(self.answers.publish(io.now_ns(), answer).map(|_| ()));
                }
                Action::EndRun(why) => {
                    self.failure.get_or_insert(why);
                    self.begin_end(StopKind::ShuttingDown, io);
                }
            }
        }
        published
    }

    /// Starts what is to be started, once what earlier lives left is cleaned up: else their slots would be taken.
    fn spawn_waiting(&mut self, io: &Io) {
        if self.ending.has_begun() {
            // Whoever began now would not be told to leave.
            self.waiting.clear();
            return;
        }
        let (idle, now) = (self.janitor.is_idle(), monotonic_ns());
        for (service, incarnation, until_ns) in std::mem::take(&mut self.waiting) {
            if idle || now >= until_ns {
                self.spawn(service, incarnation, io);
            } else {
                self.waiting.push((service, incarnation, until_ns));
            }
        }
    }

    /// Whether that life still waited for its start, which then never comes.
    fn never_starts(&mut self, service: ServiceId, incarnation: u32, io: &Io) -> bool {
        let waited = self.waiting.len();
        self.waiting.retain(|(waits, life, _)| (*waits, *life) != (service, incarnation));
        let never = self.waiting.len() < waited;
        if never {
            let died = Event::Died(service, incarnation, "it was given up before its start".to_owned());
            self.machine.handle(died, Self::now(io));
        }
        never
    }

    fn spawn(&mut self, service: ServiceId, incarnation: u32, io: &Io) {
        let log = io.domain.dir.log(service, incarnation);
        // A service that dies again and again does not fill the disk; there may be no log that old.
        let _ = std::fs::remove_file(io.domain.dir.log(service, incarnation.saturating_sub(LOGS_KEPT)));
        let spec = match service {
            ServiceId::Policy => self.machine.policy_spec(incarnation).clone(),
            ServiceId::Simulator => {
                PolicySpec { exe: Some(self.children.executable(self.physics.program())), ..PolicySpec::default() }
            }
            _ => PolicySpec::default(),
        };
        let has_line = self.machine.has_line(service);
        match self.children.spawn((service, incarnation), has_line, &spec, &log, io) {
            Ok(pid) => {
                self.machine.started(service, incarnation, pid);
                journal::started(io.now_ns(), service, incarnation, pid);
                self.pass_faults_on(service, io);
            }
            Err(error) => {
                self.figures.note(io.now_ns(), error.to_string());
                let died = Event::Died(service, incarnation, error.to_string());
                self.machine.handle(died, Self::now(io));
            }
        }
    }

    fn publish_mode(&mut self, io: &Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        if self.machine.take_mode_changed() || now >= self.mode_due_ns {
            self.mode_due_ns = now + MODE_PERIOD_NS;
            self.modes.publish(now, *self.machine.mode())?;
        }
        Ok(())
    }

    fn read_beats(&mut self, io: &Io) -> Result<(), TransportError> {
        let now = Self::now(io);
        for beats in &mut self.health {
            while let Some(health) = beats.take()? {
                self.figures.beat(&health);
                self.machine.handle(Event::Beat(&health), now);
            }
        }
        self.figures.own_ports(now.run_ns, io.port_counters());
        Ok(())
    }

    fn read_topics(&mut self, io: &Io) -> Result<(), TransportError> {
        let now = Self::now(io);
        while let Some(stop) = self.estop.take()? {
            self.machine.handle(Event::Estop(&stop), now);
        }
        while let Some(action) = self.decisions.take()? {
            self.machine.handle(Event::Decision(&action), now);
        }
        while let Some(permit) = self.permits.take()? {
            self.machine.handle(Event::Permit(&permit), now);
        }
        while let Some(cue) = self.cues.take()? {
            self.machine.handle(Event::Cue(&cue), now);
        }
        while let Some(state) = self.locomotion.take()? {
            self.machine.handle(Event::Locomotion(&state), now);
            self.last_locomotion = Some(state);
        }
        if let Some(truth) = self.truth.take_newest()? {
            self.last_truth = Some(truth);
        }
        if let Some(said) = self.said.take_newest()? {
            self.last_said = Some(said);
        }
        Ok(())
    }

    fn read_child(&mut self, token: u64, io: &mut Io) -> Result<(), TransportError> {
        let now = Self::now(io);
        loop {
            let Some(child) = self.children.by_token(token) else { return Ok(()) };
            let (service, incarnation) = (child.service, child.incarnation);
            let Some(line) = &child.control else { break };
            match line.receive::<FromChild>() {
                Received::Nothing => break,
                Received::Closed => {
                    io.unwatch(line);
                    child.control = None;
                    let how = "its line closed";
                    // Once the robot may walk, no log is read before the stop is out.
                    let unsaid = || match self.machine.has_begun() {
                        true => how.to_owned(),
                        false => last_words(io, service, incarnation, how),
                    };
                    let why = child.failed.clone().unwrap_or_else(unsaid);
                    // Where no stop hangs on it, how it ended is worth waiting for.
                    if !child.left && self.machine.is_critical(service, incarnation) {
                        self.machine.handle(Event::Died(service, incarnation, why), now);
                        self.act(io)?;
                    }
                    if !self.children.incarnation(service, incarnation).is_some_and(|child| child.left) {
                        // A process that let its line go but lives on is none of ours any more.
                        self.children.kill(service, incarnation);
                    }
                    break;
                }
                Received::Message(message, _) => self.hear(service, incarnation, message, io)?,
            }
        }
        let reaped = self.children.reap(token, io);
        if let Some((child, _)) = &reaped {
            self.janitor.clean();
            let about = self.abouts.remove(&(child.service, child.incarnation));
            if (child.service, child.incarnation) == (ServiceId::Policy, self.machine.mode().active_policy) {
                self.figures.policy = about;
            }
        }
        if let Some((child, _)) = reaped.as_ref().filter(|(child, _)| child.left) {
            self.machine.handle(Event::Left(child.service, child.incarnation), now);
        }
        if let Some((child, status)) = reaped.filter(|(child, _)| !child.left) {
            let words = || last_words(io, child.service, child.incarnation, &status);
            let why = report::brief(&child.failed.unwrap_or_else(words));
            self.figures.note(io.now_ns(), format!("{} (incarnation {}): {why}", child.service, child.incarnation));
            self.machine.handle(Event::Died(child.service, child.incarnation, why), now);
            if child.service == ServiceId::Speak && !self.ending.has_begun() {
                self.sound_tone(io);
            }
        }
        self.act(io)
    }

    /// Lets the handler hear that the robot's voice is lost.
    fn sound_tone(&mut self, io: &Io) {
        if let Err(why) = self.tone.sound() {
            self.figures.note(io.now_ns(), format!("no tone: {why}"));
        }
    }

    fn hear(
        &mut self,
        service: ServiceId,
        incarnation: u32,
        message: FromChild,
        io: &mut Io,
    ) -> Result<(), TransportError> {
        let now = Self::now(io);
        match message {
            FromChild::Ready => self.machine.handle(Event::Ready(service, incarnation), now),
            FromChild::Armed { service: whose, incarnation: life } => {
                self.machine.handle(Event::Armed { service: whose, incarnation: life, by: incarnation }, now);
            }
            FromChild::BrakeEngaged { incarnation, gone } => {
                let what = if gone { "was gone" } else { "was silent" };
                self.figures.note(now.run_ns, format!("brake engaged: locomotion ({incarnation}) {what}"));
                self.machine.handle(Event::BrakeEngaged(incarnation), now);
            }
            FromChild::Failed { why } => {
                if let Some(child) = self.children.incarnation(service, incarnation) {
                    child.failed = Some(why);
                }
            }
            FromChild::Left => {
                if let Some(child) = self.children.incarnation(service, incarnation) {
                    child.left = true;
                }
                if !self.ending.has_begun() {
                    // Nobody waits for its last figures but the next beat that is read.
                    self.children.tell_life(service, incarnation, &ToChild::Exit);
                }
            }
            FromChild::About { about } => {
                self.abouts.insert((service, incarnation), about);
            }
            FromChild::Note { text } => self.figures.note(now.run_ns, format!("{service}: {text}")),
            FromChild::RunEnded { figures } => {
                let arrived = self.take_world(service, figures, now.run_ns);
                self.begin_end(if arrived { StopKind::Arrived } else { StopKind::ShuttingDown }, io);
            }
        }
        Ok(())
    }

    /// Takes what simulator or replay says at its end: whether the walk or the replay came to its own.
    fn take_world(&mut self, service: ServiceId, figures: Value, run_ns: u64) -> bool {
        match serde_json::from_value::<RunFigures>(figures) {
            Ok(figures) => {
                let reached = figures.reached;
                self.figures.world = Some(figures);
                reached
            }
            Err(error) => {
                self.figures.note(run_ns, format!("the {service}'s figures cannot be read: {error}"));
                false
            }
        }
    }

    /// Stepped time: what must find nobody in the middle of a step is done once all others have done it.
    fn do_between_steps(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let step = io.domain.clock.step();
        if !self.steps.not_done(step, self.machine.roster().1).all(|member| self.condemned.contains(member)) {
            return Ok(());
        }
        for member in std::mem::take(&mut self.condemned) {
            self.children.kill(member.service, member.incarnation);
        }
        self.machine.let_in(Self::now(io));
        self.act(io)?;
        if self.machine.holds_time(io.now_ns()) { Ok(()) } else { self.do_planned(io) }
    }

    /// Stepped time: who keeps time waiting for too long is hung.
    fn watch_steps(&mut self, io: &Io, now: Now) -> Result<(), TransportError> {
        if !io.domain.clock.is_stepped() || self.ending.has_begun() {
            return Ok(());
        }
        while let Some(ack) = self.acks.take_at_once()? {
            self.steps.take(&ack);
        }
        let (version, roster) = self.machine.roster();
        let waits_by_itself = version == 0 || self.machine.holds_time(now.run_ns) || self.planned.waits_for_death();
        if let Some(late) = self.steps.late(io.domain.clock.step(), roster, waits_by_itself, now.wall_ns) {
            self.machine.handle(Event::TimeStands(&late), now);
        }
        Ok(())
    }
}

impl Service for Supervisor {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        self.woken_ns = now;
        self.steps.begin(self.machine.roster().1);
        self.read_topics(io)?;
        let is_stepped = io.domain.clock.is_stepped();
        let is_due = if is_stepped { now >= self.next_tick_ns } else { std::mem::take(&mut self.ticks) };
        if is_due {
            self.read_beats(io)?;
            if let Some(slept_ns) = self.oversleep.slept_ns(now).filter(|_| !io.domain.clock.is_stepped()) {
                let ms = slept_ns / 1_000_000;
                self.figures.note(now, format!("supervisor_stalled: its loop slept for {ms} ms; counts start again"));
                self.machine.handle(Event::Overslept(slept_ns), Self::now(io));
            }
            self.next_tick_ns = now + TICK_NS;
            self.machine.tick_starts(Self::now(io));
            self.machine.tick_judge(Self::now(io));
        }
        self.act(io)?;
        if !io.domain.clock.is_stepped() {
            self.do_planned(io)?;
        }
        self.publish_mode(io)
    }

    fn next_timer_ns(&self) -> Option<u64> {
        // In real time the wall tick comes as often: two timers would wake the loop twice. In stepped time, steps wake
        // it.
        None
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        match token {
            TOKEN_SIGNAL => {
                drain(&self.signals);
                self.begin_end(StopKind::ShuttingDown, io);
                self.act(io)
            }
            TOKEN_OWNER => {
                if let Some(owner) = self.owner.take() {
                    io.unwatch(&owner);
                }
                self.failure.get_or_insert_with(|| "the command that started the run is gone".to_owned());
                self.begin_end(StopKind::ShuttingDown, io);
                self.act(io)
            }
            token if token >= ControlServer::TOKEN => self.serve_operator(token, io),
            token => self.read_child(token, io),
        }
    }

    fn wants_wall_ticks(&self) -> bool {
        true
    }

    fn on_wall_tick(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = Self::now(io);
        self.ticks = !io.domain.clock.is_stepped();
        self.watch_steps(io, now)?;
        self.systemd.tick(self.machine.has_begun(), self.ending.has_begun());
        self.machine.tick_starts(now);
        self.children.hand_out_lines();
        if let Some(why) = self.tone.tick() {
            self.figures.note(io.now_ns(), format!("no tone: {why}"));
        }
        self.end_faults(io);
        self.act(io)?;
        if io.domain.clock.is_stepped() {
            self.do_between_steps(io)?;
        }
        self.go_on_ending(io)
    }

    fn is_done(&self) -> bool {
        self.ending.is_done()
    }

    fn may_acknowledge(&self) -> bool {
        !self.machine.holds_time(self.woken_ns) && (self.ending.has_begun() || !self.planned.is_due(self.woken_ns))
    }

    fn roster(&self) -> Option<(u64, &[messages::Member])> {
        let (version, members) = self.machine.roster();
        (version > 0).then_some((version, members))
    }
}

fn drain(fd: &std::os::fd::OwnedFd) {
    let mut bytes = [0u8; 64];
    // What was written is only a wake-up.
    while rustix::io::read(fd, &mut bytes).is_ok_and(|n| n == bytes.len()) {}
}

/// The directory of a new run: made by who starts the run; else here, after sweeping what dead runs left.
fn new_run_dir(name: &str) -> Result<RunDir, TransportError> {
    if let Ok(lock) = transport::inherited_fd(transport::SupervisorArgs::LOCK_FD) {
        return RunDir::adopt(name, lock);
    }
    transport::sweep();
    RunDir::create(name)
}
