//! What an operator asks, and the answers.

use control::{
    Answer, Done, LocomotionStatus, Policies, PolicyLife, PolicySpec, Refusal, Request, Right, Status, Why, WorldStatus,
};
use messages::{
    CueAnswer, CueKind, CueRequest, LocomotionState, ModeClass, ServiceId, StopKind, WorldTruth, s_from_ns,
};
use settings::{AttitudeSource, PolicyModel};
use transport::{Io, TransportError};

use crate::machine::Event;
use crate::{STILL_MEANT_NS, Supervisor, journal, report};

/// So many stops an answer tells of, the newest.
const STOPS_TOLD: usize = 20;

impl Supervisor {
    pub(crate) fn serve_operator(&mut self, token: u64, io: &mut Io) -> Result<(), TransportError> {
        let mut requests = self.server.requests(token, io);
        // A stop waits for no answer, and nothing that came with it undoes it.
        requests.sort_by_key(|(_, request)| *request != Request::Stop);
        let stops = requests.first().is_some_and(|(_, request)| *request == Request::Stop);
        // What waited for a supervisor that slept was meant for another moment.
        let slept = !io.domain.clock.is_stepped() && io.now_ns() > self.next_tick_ns + STILL_MEANT_NS;
        for (client, request) in requests {
            if request == Request::Stop {
                self.end_plan(io);
            }
            let asked = (request.needs() != Right::Read).then(|| request.clone());
            let answer = match request {
                Request::Resume {} | Request::Cue { .. } if stops => Err(Refusal::Overtaken),
                Request::Resume {} | Request::Cue { .. } if slept => Err(Refusal::Slept),
                request => self.answer(request, io)?,
            };
            self.act(io)?;
            if let Some(asked) = asked {
                journal::asked(io.now_ns(), &asked, answer.as_ref().err().map(ToString::to_string).as_deref());
            }
            match answer {
                Ok(answer) => self.server.answer(client, &answer, io),
                Err(refusal) => self.server.answer(client, &refusal, io),
            }
        }
        Ok(())
    }

    /// A person's stop is not undone by what was planned before it.
    fn end_plan(&mut self, io: &Io) {
        let given_up = self.planned.give_up();
        if given_up > 0 {
            self.figures
                .note(io.now_ns(), format!("the operator stopped: {given_up} of what was planned are given up"));
        }
    }

    /// Does what is asked: the answer.
    pub(crate) fn answer(&mut self, request: Request, io: &mut Io) -> Result<Result<Answer, Refusal>, TransportError> {
        let now = Self::now(io);
        let done = || Answer::Done(Done::default());
        Ok(match request {
            Request::Status {} => Ok(Answer::Status(Box::new(self.status(io)))),
            Request::Why {} => Ok(Answer::Why(Box::new(self.why(io)))),
            Request::Cue { cue } => self.operator_cue(cue, io)?.map(Answer::Done),
            Request::Stop => {
                self.machine.handle(Event::OperatorStop, now);
                Ok(done())
            }
            Request::Resume {} => {
                let locked = self.machine.mode().class == ModeClass::Lock;
                self.machine.handle(Event::OperatorResume, now);
                if locked { Ok(done()) } else { Err(Refusal::NotLocked) }
            }
            Request::Record { path } => self.record(path, io).map(|()| done()),
            Request::RecordStop {} => self.end_recording(io).map(|()| done()),
            Request::PolicySwap { exe, model } => {
                let spec = checked(PolicySpec { exe, model });
                swap_answer(spec.and_then(|spec| self.machine.swap_policy(spec, now)))
            }
            Request::PolicyRollback {} => swap_answer(self.machine.roll_back_policy(now)),
            Request::PolicyShow {} => Ok(Answer::Policies(Box::new(self.show_policies()))),
            Request::Inject { target, fault, for_ms, seed } => {
                let injected = self.inject(&target, &fault, for_ms, seed.unwrap_or(1), io);
                injected
                    .map(|at_ns| Answer::Done(Done { at_ns: Some(at_ns), ..Done::default() }))
                    .map_err(Refusal::Fault)
            }
            Request::Quit {} => {
                self.begin_end(StopKind::ShuttingDown, io);
                Ok(done())
            }
        })
    }

    /// Hands the operator's cue to the cue service; a refusal that is certain already is told at once.
    fn operator_cue(&mut self, kind: CueKind, io: &Io) -> Result<Result<Done, Refusal>, TransportError> {
        let mode = *self.machine.mode();
        if !kind.is_moving() && !self.machine.is_ready(ServiceId::Cue) {
            // Nobody is there to pass it on: the robot stands all the same, and stays.
            self.machine.handle(Event::OperatorStop, Self::now(io));
            let note = Some("the cue service is down: stopped and locked".to_owned());
            return Ok(Ok(Done { note, ..Done::default() }));
        }
        let refused = match mode.class {
            ModeClass::Lock | ModeClass::Fault if kind.is_moving() => self.machine.not_ready(Self::now(io)),
            _ => None,
        };
        if let Some(why) = refused {
            // It is what the handler would have said, and the robot answers.
            let (refusal, reason) = (why.refusal, why.reason);
            self.answers.publish(io.now_ns(), CueAnswer { kind, refusal, reason, ..CueAnswer::default() })?;
            return Ok(Err(Refusal::Cue(why.to_string())));
        }
        self.requests.publish(io.now_ns(), CueRequest { kind, ..CueRequest::default() })?;
        Ok(Ok(Done::default()))
    }

    fn status(&self, io: &Io) -> Status {
        let now = io.now_ns();
        let ages = self.machine.topic_ages(now).into_iter();
        Status {
            run: io.domain.info.name.clone(),
            supervisor_pid: std::process::id(),
            now_s: s_from_ns(now),
            mode: report::mode_status(self.machine.mode()),
            services: report::service_statuses(&self.machine.status(now)),
            stream_age_ms: ages.map(|(topic, age_ns)| (topic.name().to_owned(), age_ns as f64 / 1e6)).collect(),
            published: self.figures.published(),
            world: self.last_truth.as_ref().map(world_status),
            attitude: (self.attitude != AttitudeSource::Told).then(|| self.attitude.name().to_owned()),
            floor: (!self.watches_floor).then(|| "not_watched".to_owned()),
            no_start_by_voice: self.no_start_by_voice.clone(),
            locomotion: self.last_locomotion.as_ref().map(locomotion_status),
            said: self.last_said.as_ref().map(report::said_status),
            microphone: self.figures.microphone().map(report::microphone_status),
            invalid_messages: self.figures.invalid_messages(),
            notes: self.figures.last_notes(),
        }
    }

    fn why(&self, io: &Io) -> Why {
        let now = io.now_ns();
        Why {
            run: io.domain.info.name.clone(),
            mode: report::mode_status(self.machine.mode()),
            stands_because: self.last_locomotion.map(|state| state.limited_by.to_string()),
            not_ready_because: self.machine.not_ready(Self::now(io)).map(|why| why.to_string()),
            stops: self
                .machine
                .stops
                .stops()
                .iter()
                .rev()
                .take(STOPS_TOLD)
                .map(|stop| report::stop(stop, now))
                .collect(),
            notes: self.figures.last_notes(),
        }
    }

    fn show_policies(&self) -> Policies {
        let policies = self.machine.policies();
        let life = |incarnation: u32| {
            let runs = self.abouts.get(&(ServiceId::Policy, incarnation)).cloned();
            PolicyLife { incarnation, runs }
        };
        let mode = self.machine.mode();
        Policies {
            active: life(mode.active_policy),
            previous: (mode.previous_policy != 0).then(|| life(mode.previous_policy)),
            in_force: policies.spec().clone(),
            swaps: policies.last_records().to_vec(),
        }
    }
}

fn world_status(truth: &WorldTruth) -> WorldStatus {
    let (robot, handler) = (truth.world_from_robot, truth.world_from_handler);
    let walkers = truth.walkers.iter().take(truth.walker_count as usize);
    WorldStatus {
        robot: [robot.x_m, robot.y_m, robot.yaw_rad],
        handler: [handler.x_m, handler.y_m],
        walkers: walkers.map(|walker| [walker.x_m, walker.y_m]).collect(),
        distance_m: truth.distance_m,
        collisions: report::collisions(truth),
        falls: report::falls(truth),
    }
}

fn locomotion_status(state: &LocomotionState) -> LocomotionStatus {
    LocomotionStatus {
        velocity: [state.applied.vx_mps, state.applied.vy_mps, state.applied.wz_radps],
        limited_by: state.limited_by.kind.name().to_owned(),
        decision: state.decision,
    }
}

/// An operator's wish, once it says what can be started.
///
/// # Errors
/// Where it names nothing, or a path that would be looked for from wherever the supervisor works.
fn checked(spec: PolicySpec) -> Result<PolicySpec, String> {
    if spec.exe.is_none() && spec.model.is_none() {
        return Err("neither an executable nor a model is named".to_owned());
    }
    let model = spec.model.clone().map(PolicyModel::from);
    if model == Some(PolicyModel::Steps) {
        return Err("the policy steps guides no one: a run begins with it, or never has it".to_owned());
    }
    let paths = [spec.exe.as_deref(), model.as_ref().and_then(PolicyModel::file)];
    if let Some(path) = paths.into_iter().flatten().find(|path| !path.is_absolute()) {
        return Err(format!("{}: the path is not absolute", path.display()));
    }
    Ok(spec)
}

fn swap_answer(outcome: Result<u64, String>) -> Result<Answer, Refusal> {
    let begun = |number| Answer::Done(Done { swap: Some(number), ..Done::default() });
    outcome.map(begun).map_err(Refusal::Swap)
}
