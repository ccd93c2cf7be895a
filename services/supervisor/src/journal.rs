//! The journal of a run: what happened, as `tracing` events. They go into the record of the run and, of `guidedog up`,
//! to standard error.
//!
//! The supervisor hands each line to a thread that writes it, and waits for no disk or terminal. Where the thread does
//! not keep up, lines are dropped and counted. A journal of systemd is written to by standard error for the
//! same reason: `tracing-journald` would wait for journald in the supervisor's loop.

mod keeper;
mod output;

use control::{Request, SwapRecord, SwapState};
use messages::{CueAnswer, CueRefusal, ModeClass, ServiceId, StopKind, StopReason, TopicId, s_from_ns};
use tracing::{debug, info, warn};

use crate::machine::Machine;
use crate::report::brief;
use crate::stops::{Stop, StopLog};

pub use keeper::Keeper;
pub use output::LogTo;

/// What of the machine has been told.
#[derive(Debug, Default)]
pub struct Journal {
    mode: Option<(ModeClass, StopReason)>,
    /// How many stops.
    stops: usize,
    /// The stops that have not ended.
    open: Vec<usize>,
    /// The last swap.
    swap: Option<(u64, SwapState)>,
    /// Run time of the next sign of life.
    alive_ns: u64,
}

/// A sign of life is told so often: by the last one it is known when a killed supervisor ended.
const ALIVE_NS: u64 = 5_000_000_000;

impl Journal {
    /// Tells what has changed in the machine since the last call.
    pub fn observe(&mut self, machine: &Machine, run_ns: u64) {
        self.mode(machine, run_ns);
        self.stops(&machine.stops);
        self.swaps(machine.policies().last_records(), run_ns);
        if run_ns >= self.alive_ns {
            self.alive_ns = run_ns + ALIVE_NS;
            debug!(event = records::ALIVE, run_s = s_from_ns(run_ns), "alive");
        }
    }

    fn mode(&mut self, machine: &Machine, run_ns: u64) {
        let mode = machine.mode();
        if self.mode.replace((mode.class, mode.reason)) == Some((mode.class, mode.reason)) {
            return;
        }
        let (run_s, class, epoch, reason) = (s_from_ns(run_ns), mode.class.name(), mode.epoch, mode.reason.kind.name());
        match mode.class {
            ModeClass::Run => info!(event = "mode", run_s, class, epoch, "run"),
            _ if matches!(mode.reason.kind, StopKind::Arrived | StopKind::ShuttingDown | StopKind::Boot) => {
                info!(event = "mode", run_s, class, epoch, reason, "{class}: {}", mode.reason);
            }
            ModeClass::Fault | ModeClass::Lock => {
                warn!(event = "mode", run_s, class, epoch, reason, "{class}: {}", mode.reason);
            }
        }
    }

    fn stops(&mut self, log: &StopLog) {
        for number in self.stops..log.begun() {
            if let Some(stop) = log.get(number) {
                tell_begin(number, stop);
                self.open.push(number);
            }
        }
        self.stops = log.begun();
        self.open.retain(|&number| {
            let Some(stop) = log.get(number) else { return false };
            if let Some(ended_ns) = stop.ended_ns {
                let (run_s, lasted_s) = (s_from_ns(ended_ns), s_from_ns(stop.lasted_ns(ended_ns)));
                debug!(event = "stop_over", run_s, number, lasted_s, "stop over: {}", stop.reason);
            }
            stop.ended_ns.is_none()
        });
    }

    fn swaps(&mut self, records: &[SwapRecord], run_ns: u64) {
        let Some(record) = records.last() else { return };
        if self.swap.replace((record.number, record.state)) == Some((record.number, record.state)) {
            return;
        }
        let SwapRecord { number, state, candidate, .. } = record;
        let (run_s, number, state) = (s_from_ns(run_ns), *number, state.name());
        let why = record.why.as_ref().map_or_else(String::new, |why| format!(": {}", brief(why)));
        match record.state {
            SwapState::Failed => warn!(event = "swap", run_s, number, candidate, state, "swap {number} failed{why}"),
            _ => info!(event = "swap", run_s, number, candidate, state, "swap {number}: {state}{why}"),
        }
    }
}

fn tell_begin(number: usize, stop: &Stop) {
    let reason = &stop.reason;
    let service = (reason.service != ServiceId::None).then(|| reason.service.name());
    let stream = (reason.topic != TopicId::None).then(|| reason.topic.name());
    let (run_s, class, kind) = (s_from_ns(stop.at_ns), stop.class.name(), reason.kind.name());
    let why = reason.to_string();
    debug!(event = "stop", run_s, number, class, reason = kind, service, stream, why, "stop: {reason}");
}

/// Tells a note for the operator.
pub fn note(run_ns: u64, text: &str) {
    info!(event = "note", run_s = s_from_ns(run_ns), "{text}");
}

/// Tells that a life of a service starts; that it is not the first one is worth more.
pub fn started(run_ns: u64, service: ServiceId, incarnation: u32, pid: u32) {
    let (run_s, service) = (s_from_ns(run_ns), service.name());
    if incarnation > 1 {
        info!(event = "start", run_s, service, incarnation, pid, "{service} starts again: life {incarnation}");
    } else {
        debug!(event = "start", run_s, service, incarnation, pid, "{service} starts");
    }
}

/// Tells what the operator asked and, where it was refused, why.
pub fn asked(run_ns: u64, request: &Request, refusal: Option<&str>) {
    let mut asked = request.verb();
    if let Request::Cue { cue } = request {
        asked = format!("{asked} {}", cue.name());
    }
    let (run_s, request) = (s_from_ns(run_ns), asked);
    match refusal {
        None => info!(event = "request", run_s, request, "the operator asked: {request}"),
        Some(why) => warn!(event = "refusal", run_s, request, "refused {request}: {}", brief(why)),
    }
}

/// Tells that a cue was refused.
pub fn cue_refused(run_ns: u64, answer: &CueAnswer) {
    if answer.refusal != CueRefusal::None {
        let (run_s, cue, why) = (s_from_ns(run_ns), answer.kind.name(), answer.refusal.name());
        warn!(event = "refusal", run_s, cue, why, "refused cue {cue}: {why}");
    }
}

/// Tells where the run is recorded.
pub fn recording(run_ns: u64, path: &std::path::Path) {
    let path = path.display().to_string();
    info!(event = "recording", run_s = s_from_ns(run_ns), path, "recording to {}", brief(&path));
}

/// Tells how the run ended.
pub fn ended(report: &control::Report) {
    let run_s = report.duration_s;
    match &report.failure {
        Some(why) => tracing::error!(event = "end", run_s, "the run ended: {}", brief(why)),
        None if report.reached() => info!(event = "end", run_s, "the run ended: reached its goal"),
        None => info!(event = "end", run_s, "the run ended in order"),
    }
}
