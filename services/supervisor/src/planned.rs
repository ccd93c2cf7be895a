//! What the settings plan for given run times (`[[planned]]`): done as if an operator asked for it.
//!
//! In stepped time it happens in the step of its time, once everybody else has done that step: nobody is in the middle
//! of one, so that it finds every run alike. Time goes on once what was to die is dead.

use std::collections::VecDeque;
use std::path::PathBuf;

use control::Request;
use messages::{Fault, ServiceId, Target, s_from_ns};
use settings::{Ask, Settings};
use transport::{Io, TransportError};

use crate::{STILL_MEANT_NS, Supervisor};

/// What is still to be done.
#[derive(Debug, Default)]
pub struct PlannedRequests {
    /// By run time, nanoseconds.
    todo: VecDeque<(u64, Ask)>,
    /// Killed as planned, and not gone yet.
    dying: Option<(ServiceId, u32)>,
}

impl PlannedRequests {
    /// The settings' plan; what is planned for one moment happens in the order of the file.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let mut todo: Vec<(u64, Ask)> =
            settings.planned.iter().map(|planned| (planned.at.ns(), planned.ask.clone())).collect();
        todo.sort_by_key(|(at_ns, _)| *at_ns);
        Self { todo: todo.into(), dying: None }
    }

    /// Whether time has to wait: something is to be done now, or somebody has not died yet.
    #[must_use]
    pub fn is_due(&self, run_ns: u64) -> bool {
        self.dying.is_some() || self.todo.front().is_some_and(|(at_ns, _)| *at_ns <= run_ns)
    }

    /// Whether a death is waited for.
    #[must_use]
    pub fn waits_for_death(&self) -> bool {
        self.dying.is_some()
    }

    /// Nothing more of it happens: how much that was.
    pub fn give_up(&mut self) -> usize {
        std::mem::take(&mut self.todo).len()
    }

    fn next(&mut self, run_ns: u64) -> Option<(u64, Ask)> {
        if self.dying.is_some() || !self.is_due(run_ns) {
            return None;
        }
        self.todo.pop_front()
    }
}

/// The request that a plan stands for.
fn request(ask: Ask) -> Request {
    match ask {
        Ask::Cue { cue } => Request::Cue { cue },
        Ask::Stop {} => Request::Stop,
        Ask::Resume {} => Request::Resume {},
        Ask::PolicySwap { exe, model } => {
            Request::PolicySwap { exe: exe.map(Into::into), model: model.map(PathBuf::from) }
        }
        Ask::PolicyRollback {} => Request::PolicyRollback {},
        Ask::Inject { target, fault, lasts, seed } => {
            Request::Inject { target, fault, for_ms: lasts.map(|lasts| lasts.ns() / 1_000_000), seed }
        }
    }
}

impl Supervisor {
    /// Does what is planned for now.
    pub(crate) fn do_planned(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now_ns = io.now_ns();
        if let Some((service, incarnation)) = self.planned.dying
            && self.children.incarnation(service, incarnation).is_none()
        {
            self.planned.dying = None;
        }
        while let Some((at_ns, ask)) = self.planned.next(now_ns) {
            let name = serde_json::to_string(&ask).unwrap_or_default();
            let told = format!("planned for {:.2} s: {name}", s_from_ns(at_ns));
            if now_ns > at_ns + STILL_MEANT_NS && matches!(ask, Ask::Cue { .. } | Ask::Resume {}) {
                self.figures.note(now_ns, format!("{told}: not done, for the supervisor slept"));
                continue;
            }
            let victim = killed_by(&ask).filter(|_| io.domain.clock.is_stepped());
            let victim = victim.and_then(|service| Some((service, self.victim(service)?)));
            match self.answer(request(ask), io)? {
                Err(refusal) => self.figures.note(now_ns, format!("{told}: {refusal}")),
                Ok(_) => {
                    self.figures.note(now_ns, told);
                    self.planned.dying = victim;
                }
            }
            self.act(io)?;
        }
        Ok(())
    }
}

/// The service that a planned fault kills.
fn killed_by(ask: &Ask) -> Option<ServiceId> {
    let Ask::Inject { target, fault, .. } = ask else { return None };
    match messages::fault::parse(target, fault) {
        Ok((Target::Service(service), Some(Fault::Kill | Fault::ExitOnStart))) => Some(service),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::PlannedRequests;
    use settings::{Ask, Settings};

    #[test]
    fn what_is_planned_comes_in_its_order_and_holds_time_until_it_is_done() {
        let plan = r#"
            planned = [
                { at = "2s", ask = { verb = "resume" } },
                { at = "1s", ask = { verb = "stop" } },
                { at = "2s", ask = { verb = "policy_rollback" } },
            ]
        "#;
        let settings: Settings = toml::from_str(plan).expect("a plan");
        let mut planned = PlannedRequests::of(&settings);
        assert!(!planned.is_due(999_999_999) && planned.is_due(1_000_000_000));
        let done: Vec<Ask> = std::iter::from_fn(|| planned.next(3_000_000_000)).map(|(_, ask)| ask).collect();
        assert_eq!(done, [Ask::Stop {}, Ask::Resume {}, Ask::PolicyRollback {}]);
        assert!(!planned.is_due(u64::MAX));
        let mut planned = PlannedRequests::of(&settings);
        assert_eq!((planned.give_up(), planned.is_due(u64::MAX)), (3, false));
    }
}
