//! What an operator asks, and the answers.

use control::{Refusal, Request};
use messages::{CueAnswer, CueKind, CueRequest, ModeClass, ServiceId, StopKind, s_from_ns};
use serde_json::{Value, json};
use settings::PolicyModel;
use transport::{Io, TransportError};

use crate::machine::{Event, PolicySpec};
use crate::{STILL_MEANT_NS, Supervisor, report};

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
            let answer = match request {
                Request::Resume | Request::Cue { .. } if stops => Err(Refusal::Overtaken),
                Request::Resume | Request::Cue { .. } if slept => Err(Refusal::Slept),
                request => self.answer(request, io)?,
            };
            self.act(io)?;
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
    pub(crate) fn answer(&mut self, request: Request, io: &mut Io) -> Result<Result<Value, Refusal>, TransportError> {
        let now = Self::now(io);
        let done = || json!({ "ok": true });
        Ok(match request {
            Request::Status => Ok(self.status(io)),
            Request::Why => Ok(self.why(io)),
            Request::Cue { cue } => self.operator_cue(cue, io)?,
            Request::Stop => {
                self.machine.handle(Event::OperatorStop, now);
                Ok(done())
            }
            Request::Resume => {
                let locked = self.machine.mode().class == ModeClass::Lock;
                self.machine.handle(Event::OperatorResume, now);
                if locked { Ok(done()) } else { Err(Refusal::NotLocked) }
            }
            Request::Record { path } => self.record(path, io).map(|()| done()),
            Request::RecordStop => self.end_recording(io).map(|()| done()),
            Request::PolicySwap { exe, model } => {
                let spec = PolicySpec { exe, model: model.map(PolicyModel::from) }.checked();
                swap_answer(spec.and_then(|spec| self.machine.swap_policy(spec, now)))
            }
            Request::PolicyRollback => swap_answer(self.machine.roll_back_policy(now)),
            Request::PolicyShow => Ok(self.show_policy()),
            Request::Inject { target, fault, for_ms, seed } => {
                let injected = self.inject(&target, &fault, for_ms, seed.unwrap_or(1), io);
                injected.map(|at_ns| json!({ "ok": true, "at_ns": at_ns })).map_err(Refusal::Fault)
            }
            Request::Quit => {
                self.begin_end(StopKind::ShuttingDown, io);
                Ok(done())
            }
        })
    }

    /// Hands the operator's cue to the cue service; a refusal that is certain already is told at once.
    fn operator_cue(&mut self, kind: CueKind, io: &Io) -> Result<Result<Value, Refusal>, TransportError> {
        let mode = *self.machine.mode();
        if !kind.is_moving() && !self.machine.is_ready(ServiceId::Cue) {
            // Nobody is there to pass it on: the robot stands all the same, and stays.
            self.machine.handle(Event::OperatorStop, Self::now(io));
            return Ok(Ok(json!({ "ok": true, "note": "the cue service is down: stopped and locked" })));
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
        Ok(Ok(json!({ "ok": true })))
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
                "collisions": report::collisions_json(&t),
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
            "published": self.figures.published(),
            "world": truth,
            "locomotion": locomotion,
            "said": self.last_said.as_ref().map(report::said_json),
            "microphone": self.figures.microphone().map(report::microphone_json),
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
            "not_ready_because": self.machine.not_ready(Self::now(io)).map(|why| why.to_string()),
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
}

fn swap_answer(outcome: Result<u64, String>) -> Result<Value, Refusal> {
    outcome.map(|number| json!({ "ok": true, "swap": number })).map_err(Refusal::Swap)
}
