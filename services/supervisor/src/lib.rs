//! The supervisor: starts the services of a run, watches them, restarts what fails, and is the only one to say that the
//! robot may move.
//!
//! Duties: latches the stop first, then kills, cleans and restarts; accepts cues; answers the operator; at the end
//! stops the robot first and leaves nothing behind. It must never wait for a process, start motion by itself, or
//! judge others when it overslept. `machine` decides and `children` acts; this file is the thin shell between
//! them.

mod boot;
mod children;
pub mod control;
mod ending;
mod faults;
mod last_words;
pub mod machine;
pub mod plan;
mod recording;
pub mod report;
mod step_watch;
pub mod stops;

use std::collections::BTreeMap;

use messages::{
    ClockAck, Cue, CueKind, CueRequest, Health, LocomotionState, Mode, ModeClass, Permit, PolicyAction, ServiceId,
    WorldTruth, s_from_ns,
};
use serde_json::{Value, json};
use transport::{FromChild, Io, Janitor, Oversleep, Publisher, Received, RunDir, Service, Subscriber};
use transport::{ToChild, TransportError, monotonic_ns};

use children::Children;
use control::{ControlServer, Request};
use ending::Ending;
use faults::Faults;
use last_words::last_words;
use machine::{Action, Event, Machine, Now, PolicySpec};
use report::Figures;
use step_watch::StepWatch;

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
    control: ControlServer,
    figures: Figures,
    janitor: Janitor,
    /// Incarnations that wait for the janitor, and until which wall time.
    waiting: Vec<(ServiceId, u32, u64)>,
    ending: Ending,
    faults: Faults,
    health: Vec<Subscriber<Health>>,
    cues: Subscriber<Cue>,
    locomotion: Subscriber<LocomotionState>,
    decisions: Subscriber<PolicyAction>,
    permits: Subscriber<Permit>,
    truth: Subscriber<WorldTruth>,
    modes: Publisher<Mode>,
    requests: Publisher<CueRequest>,
    /// What services say that they run with.
    abouts: BTreeMap<(ServiceId, u32), Value>,
    last_truth: Option<WorldTruth>,
    last_locomotion: Option<LocomotionState>,
    next_tick_ns: u64,
    oversleep: Oversleep,
    mode_due_ns: u64,
    steps: StepWatch,
    /// Stepped time: what the members acknowledge.
    acks: Subscriber<ClockAck>,
    signals: std::os::fd::OwnedFd,
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
        published.and(if io.domain.clock.is_stepped() { Ok(()) } else { self.publish_mode(io) })
    }

    fn perform(&mut self, actions: Vec<Action>, io: &mut Io) -> Result<(), TransportError> {
        // The stop is out before anything else is done about its cause; first over the line, which needs no shared
        // memory.
        for action in &actions {
            if let Action::StopLine { epoch, reason } = action
                && (!io.domain.clock.is_stepped() || reason.kind.is_operators())
            {
                // In stepped time a fault takes effect in the next step, for everybody alike.
                self.children.tell(ServiceId::Locomotion, &ToChild::Stop { epoch: *epoch, reason: *reason });
            }
        }
        let published = if io.domain.clock.is_stepped() { Ok(()) } else { self.publish_mode(io) };
        for action in actions {
            match action {
                Action::StopLine { .. } => {}
                Action::Begin => self.children.tell(ServiceId::Replay, &ToChild::Begin),
                Action::Kill(service, life) => {
                    if !self.never_starts(service, life, io) {
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
                Action::EndRun(why) => {
                    self.failure.get_or_insert(why);
                    self.begin_end(io);
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
            _ => PolicySpec::default(),
        };
        let has_line = self.machine.has_line(service);
        match self.children.spawn((service, incarnation), has_line, &spec, &log, io) {
            Ok(pid) => {
                self.machine.started(service, incarnation, pid);
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

    fn read_topics(&mut self, io: &Io) -> Result<(), TransportError> {
        let now = Self::now(io);
        for beats in &mut self.health {
            while let Some(health) = beats.take()? {
                self.figures.beat(&health);
                self.machine.handle(Event::Beat(&health), now);
            }
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
            self.abouts.remove(&(child.service, child.incarnation));
        }
        if let Some((child, _)) = reaped.as_ref().filter(|(child, _)| child.left) {
            self.machine.handle(Event::Left(child.service, child.incarnation), now);
        }
        if let Some((child, status)) = reaped.filter(|(child, _)| !child.left) {
            let words = || last_words(io, child.service, child.incarnation, &status);
            let why = report::brief(&child.failed.unwrap_or_else(words));
            self.figures.note(io.now_ns(), format!("{} (incarnation {}): {why}", child.service, child.incarnation));
            self.machine.handle(Event::Died(child.service, child.incarnation, why), now);
        }
        self.act(io)
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
                self.figures.world = Some(figures);
                self.begin_end(io);
            }
        }
        Ok(())
    }

    fn serve_operator(&mut self, token: u64, io: &mut Io) -> Result<(), TransportError> {
        let mut requests = self.control.requests(token, io);
        // A stop waits for no answer, and nothing that came with it undoes it.
        requests.sort_by_key(|(_, request)| *request != Request::Stop);
        let stops = requests.first().is_some_and(|(_, request)| *request == Request::Stop);
        // What waited for a supervisor that slept was meant for another moment.
        let slept = !io.domain.clock.is_stepped() && io.now_ns() > self.next_tick_ns + STILL_MEANT_NS;
        for (client, request) in requests {
            let answer = match request {
                Request::Resume | Request::Cue { .. } if stops => json!({ "error": "overtaken by a stop" }),
                Request::Resume | Request::Cue { .. } if slept => {
                    json!({ "error": "the supervisor slept; say it again" })
                }
                request => self.answer(request, io)?,
            };
            self.act(io)?;
            self.control.answer(client, &answer, io);
        }
        Ok(())
    }

    fn answer(&mut self, request: Request, io: &mut Io) -> Result<Value, TransportError> {
        let now = Self::now(io);
        Ok(match request {
            Request::Status => self.status(io),
            Request::Why => self.why(io),
            Request::Cue { cue } => self.operator_cue(cue, io)?,
            Request::Stop => {
                self.machine.handle(Event::OperatorStop, now);
                json!({ "ok": true })
            }
            Request::Resume => {
                let locked = self.machine.mode().class == ModeClass::Lock;
                self.machine.handle(Event::OperatorResume, now);
                if locked { json!({ "ok": true }) } else { json!({ "error": "the run is not locked" }) }
            }
            Request::Record { path } => self.record(path, io),
            Request::RecordStop => self.end_recording(io),
            Request::PolicySwap { exe, model } => {
                swap_answer(PolicySpec { exe, model }.checked().and_then(|spec| self.machine.swap_policy(spec, now)))
            }
            Request::PolicyRollback => swap_answer(self.machine.roll_back_policy(now)),
            Request::PolicyShow => self.show_policy(),
            Request::Inject { target, fault, for_ms, seed } => {
                self.inject(&target, &fault, for_ms, seed.unwrap_or(1), io)
            }
            Request::Quit => {
                self.begin_end(io);
                json!({ "ok": true })
            }
        })
    }

    /// Hands the operator's cue to the cue service; a refusal that is certain already is told at once.
    fn operator_cue(&mut self, kind: CueKind, io: &Io) -> Result<Value, TransportError> {
        let mode = *self.machine.mode();
        if !kind.is_moving() && !self.machine.is_ready(ServiceId::Cue) {
            // Nobody is there to pass it on: the robot stands all the same, and stays.
            self.machine.handle(Event::OperatorStop, Self::now(io));
            return Ok(json!({ "ok": true, "note": "the cue service is down: stopped and locked" }));
        }
        let refused = match mode.class {
            ModeClass::Lock if kind.is_moving() => Some(format!("the run is locked: {}", mode.reason)),
            ModeClass::Fault if kind.is_moving() => self.machine.not_ready(Self::now(io)),
            _ => None,
        };
        if let Some(why) = refused {
            return Ok(json!({ "error": format!("cue refused: {why}") }));
        }
        self.requests.publish(io.now_ns(), CueRequest { kind, ..CueRequest::default() })?;
        Ok(json!({ "ok": true }))
    }

    fn status(&self, io: &Io) -> Value {
        let now = io.now_ns();
        let truth = self.last_truth.map(|t| {
            let walkers: Vec<[f64; 2]> =
                t.walkers.iter().take(t.walker_count as usize).map(|walker| [walker.x_m, walker.y_m]).collect();
            json!({
                "robot": [t.world_from_robot.x_m, t.world_from_robot.y_m, t.world_from_robot.yaw_rad],
                "handler": [t.world_from_handler.x_m, t.world_from_handler.y_m],
                "walkers": walkers,
                "distance_m": t.distance_m,
                "collisions": collisions_json(&t),
            })
        });
        let locomotion = self.last_locomotion.map(|l| {
            json!({
                "velocity": [l.applied.vx_mps, l.applied.vy_mps, l.applied.wz_radps],
                "limited_by": l.limited_by.kind.name(),
                "decision": l.decision,
            })
        });
        let ages: serde_json::Map<String, Value> = self
            .machine
            .topic_ages(now)
            .into_iter()
            .map(|(topic, age)| (topic.name().to_owned(), json!(age as f64 / 1e6)))
            .collect();
        json!({
            "run": io.domain.info.name,
            "supervisor_pid": std::process::id(),
            "now_s": s_from_ns(now),
            "mode": report::mode_json(self.machine.mode()),
            "services": report::services_json(&self.machine.status(now)),
            "stream_age_ms": ages,
            "world": truth,
            "locomotion": locomotion,
            "invalid_messages": self.figures.invalid_messages(),
            "notes": self.figures.last_notes_json(),
        })
    }

    fn why(&self, io: &Io) -> Value {
        let now = io.now_ns();
        let stops: Vec<Value> =
            self.machine.stops.stops().iter().rev().take(20).map(|stop| report::stop_json(stop, now)).collect();
        let doing = self.last_locomotion.map(|state| state.limited_by.to_string());
        json!({
            "run": io.domain.info.name,
            "mode": report::mode_json(self.machine.mode()),
            "stands_because": doing,
            "not_ready_because": self.machine.not_ready(Self::now(io)),
            "stops": stops,
            "notes": self.figures.last_notes_json(),
        })
    }

    fn show_policy(&self) -> Value {
        let policies = self.machine.policies();
        let life = |incarnation: u32| {
            let about = self.abouts.get(&(ServiceId::Policy, incarnation));
            json!({ "incarnation": incarnation, "runs": about })
        };
        let mode = self.machine.mode();
        json!({
            "active": life(mode.active_policy),
            "previous": (mode.previous_policy != 0).then(|| life(mode.previous_policy)),
            "in_force": policies.spec(),
            "swaps": policies.last_records(),
        })
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
        let waits_by_itself = version == 0 || self.machine.holds_time(now.run_ns);
        if let Some(late) = self.steps.late(io.domain.clock.step(), roster, waits_by_itself, now.wall_ns) {
            self.machine.handle(Event::TimeStands(&late), now);
        }
        Ok(())
    }
}

fn swap_answer(outcome: Result<u64, String>) -> Value {
    match outcome {
        Ok(number) => json!({ "ok": true, "swap": number }),
        Err(why) => json!({ "error": format!("refused: {why}") }),
    }
}

/// Collisions as reported.
#[must_use]
pub fn collisions_json(truth: &WorldTruth) -> Value {
    json!({
        "robot": truth.robot_collisions, "handler": truth.handler_collisions, "hit_by_others": truth.hit_by_others,
    })
}

impl Service for Supervisor {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = io.now_ns();
        self.woken_ns = now;
        self.read_topics(io)?;
        self.figures.own_ports(now, io.port_counters());
        if now >= self.next_tick_ns {
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
        self.publish_mode(io)
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_tick_ns)
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        match token {
            TOKEN_SIGNAL => {
                drain(&self.signals);
                self.begin_end(io);
                self.act(io)
            }
            TOKEN_OWNER => {
                if let Some(owner) = self.owner.take() {
                    io.unwatch(&owner);
                }
                self.failure.get_or_insert_with(|| "the command that started the run is gone".to_owned());
                self.begin_end(io);
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
        self.watch_steps(io, now)?;
        self.machine.tick_starts(now);
        self.children.hand_out_lines();
        self.end_faults(io);
        self.act(io)?;
        self.go_on_ending(io)
    }

    fn is_done(&self) -> bool {
        self.ending.is_done()
    }

    fn may_acknowledge(&self) -> bool {
        !self.machine.holds_time(self.woken_ns)
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
