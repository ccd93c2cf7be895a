//! What befalls a run.

use control::PolicySpec;
use guidedog_supervisor::machine::Event;
use messages::{CueKind, ModeClass, ServiceId};
use rand::RngExt;

use super::Simulation;
use super::links::ToSupervisor;
use super::processes::State;

impl Simulation {
    /// Perhaps something happens in this tick; first of all somebody wants to walk.
    pub(super) fn trouble(&mut self) {
        if self.machine.mode().ready_for_cue && self.rng.random_ratio(1, 40) {
            self.cue(CueKind::Forward);
        }
        if self.now_ms < 500 || !self.rng.random_ratio(1, 70) {
            return;
        }
        match self.rng.random_range(0..20) {
            0..=3 => self.somebody_dies(),
            4..=6 => self.somebody_hangs(),
            7 => self.somebody_is_ill(),
            8 => {
                self.asleep_until_ms = self.now_ms + self.rng.random_range(20..1200);
                self.note(format!("the supervisor sleeps until {}", self.asleep_until_ms));
            }
            9 => {
                self.world_still_until_ms = self.now_ms + self.rng.random_range(50..2000);
                self.note(format!("the world stands still until {}", self.world_still_until_ms));
            }
            10 => {
                self.network_bad_until_ms = self.now_ms + self.rng.random_range(100..1500);
                self.note(format!("messages are lost until {}", self.network_bad_until_ms));
            }
            11 => self.clock_steps(),
            12 => self.operator(ToSupervisor::Stop),
            13 | 14 => self.operator(ToSupervisor::Resume),
            15 => self.cue(CueKind::Stop),
            16 | 17 => self.swap(),
            18 => {
                let now = self.now();
                let outcome = self.machine.roll_back_policy(now);
                self.note(format!("the operator rolls back: {outcome:?}"));
                self.act();
            }
            _ => {
                let wanted = self.rng.random_bool(0.5);
                let recorder = ServiceId::Recorder;
                let event = if wanted { Event::Demand(recorder) } else { Event::Release(recorder) };
                self.machine.handle(event, self.now());
                self.act();
            }
        }
    }

    fn operator(&mut self, message: ToSupervisor) {
        self.note(format!("the operator: {message:?}"));
        self.checks.resumes += u64::from(matches!(message, ToSupervisor::Resume));
        self.to_supervisor.push(self.now_ms, message);
    }

    fn anybody(&mut self) -> Option<usize> {
        (!self.processes.is_empty()).then(|| self.rng.random_range(0..self.processes.len()))
    }

    fn somebody_dies(&mut self) {
        let Some(i) = self.anybody() else { return };
        let (service, life) = (self.processes[i].service, self.processes[i].life);
        if service != ServiceId::Simulator {
            self.kill(service, life, "somebody kills");
        }
    }

    /// SIGSTOP; sometimes SIGCONT a while later.
    fn somebody_hangs(&mut self) {
        let Some(i) = self.anybody() else { return };
        let until_ms = if self.rng.random_bool(0.4) { self.now_ms + self.rng.random_range(10..800) } else { u64::MAX };
        let process = &mut self.processes[i];
        if process.service == ServiceId::Simulator || process.state != State::Running {
            return;
        }
        process.state = State::Hung { since_ms: self.now_ms, until_ms };
        let (service, life) = (process.service, process.life);
        self.checks.hung(service, life, self.now_ms);
        self.note(format!("{service} {life} hangs"));
    }

    fn somebody_is_ill(&mut self) {
        let Some(i) = self.anybody() else { return };
        let illness = self.rng.random_range(0..3);
        let process = &mut self.processes[i];
        if process.service == ServiceId::Simulator {
            return;
        }
        match illness {
            0 => process.leaks = true,
            1 => process.every = 3,
            _ => process.stuck = true,
        }
        let text = format!("{} {} is ill ({illness})", process.service, process.life);
        self.note(text);
    }

    /// The machine was suspended: everybody's clock is further on at once.
    fn clock_steps(&mut self) {
        let by_ms = 20 * self.rng.random_range(3..150);
        self.note(format!("the clock steps by {by_ms} ms"));
        self.now_ms += by_ms;
        self.checks.clock_stepped(by_ms);
        for process in &mut self.processes {
            match &mut process.state {
                State::Starting { ready_ms, .. } => *ready_ms += by_ms,
                State::Hung { since_ms, until_ms } => {
                    *since_ms += by_ms;
                    *until_ms = until_ms.saturating_add(by_ms);
                }
                State::Running => {}
            }
        }
    }

    fn swap(&mut self) {
        // Another executable gives what is no probability.
        let exe = self.rng.random_bool(0.3).then(|| "spoiled".into());
        let now = self.now();
        let outcome = self.machine.swap_policy(PolicySpec { exe, model: None }, now);
        self.note(format!("a swap is asked for: {outcome:?}"));
        self.act();
    }

    /// The trouble is over: whoever was only slow goes on.
    pub(super) fn calm_down(&mut self) {
        self.note("the trouble is over".to_owned());
        (self.asleep_until_ms, self.world_still_until_ms, self.network_bad_until_ms) = (0, 0, 0);
    }

    /// The operator brings the run on its way.
    pub(super) fn help_along(&mut self) {
        if !self.now_ms.is_multiple_of(400) {
            return;
        }
        match self.machine.mode().class {
            ModeClass::Lock => self.operator(ToSupervisor::Resume),
            ModeClass::Fault | ModeClass::Run => self.cue(CueKind::Forward),
        }
    }
}
