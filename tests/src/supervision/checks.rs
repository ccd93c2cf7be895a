//! What must never be, whatever happens.

use std::collections::BTreeMap;

use guidedog_locomotion::Gate;
use messages::{Mode, ModeClass, ServiceId};

use super::processes::Process;
use super::{Simulation, TICK_MS};

/// A dead process's line closes at once; a tick, and a mode that is on its way.
const DEATH_MS: u64 = 60;
/// Silence is seen at 120 ms, by a judge that may itself have slept for up to the mode's age.
const HANG_MS: u64 = 450;
/// Without a word of the supervisor the gate stands: the mode's age, and its way.
const STOP_MS: u64 = 250;
/// Locomotion itself: the brake's limit, its period, and its own oversleeping.
const BRAKE_MS: u64 = 250;

/// What is kept book of.
#[derive(Debug, Default)]
pub struct Checks {
    /// Lines that closed at the gate and stopped it, with the epoch then.
    closed: BTreeMap<(ServiceId, u32), u64>,
    /// When processes of the present lives died or fell silent.
    lost_ms: BTreeMap<ServiceId, (u32, u64, bool)>,
    starts: BTreeMap<ServiceId, u64>,
    /// Resumes asked for: each restores the budgets.
    pub resumes: u64,
    stopped_ms: Option<u64>,
    /// When the brake was last away.
    brake_away_ms: u64,
    wrong: Option<String>,
}

impl Checks {
    fn never(&mut self, what: String) {
        self.wrong.get_or_insert(what);
    }

    /// Each class is left only as it may be.
    pub fn transition(&mut self, before: &Mode, after: &Mode, by_cue: bool, by_resume: bool) -> Result<(), String> {
        let (from, to) = (before.class, after.class);
        if after.epoch < before.epoch {
            return Err(format!("the epoch fell from {} to {}", before.epoch, after.epoch));
        }
        if from == ModeClass::Lock && to != ModeClass::Lock && !by_resume {
            return Err("a lock was left without resume".to_owned());
        }
        if from == ModeClass::Lock && to == ModeClass::Run {
            return Err("a lock became run".to_owned());
        }
        if from != ModeClass::Run && to == ModeClass::Run && !(by_cue && after.cue.valid && before.ready_for_cue) {
            return Err(format!("run by itself, from {}", from.name()));
        }
        if from == ModeClass::Run && to != ModeClass::Run && (after.epoch == before.epoch || after.cue.valid) {
            return Err("a stop in the same epoch, or with a cue in force".to_owned());
        }
        if to != ModeClass::Run && after.cue.valid {
            return Err("a cue in force without run".to_owned());
        }
        Ok(())
    }

    /// A process is started.
    pub fn spawned(&mut self, service: ServiceId, processes: &[Process]) {
        let others = processes.iter().filter(|p| p.service == service).count();
        let most = if service == ServiceId::Policy { 1 } else { 0 };
        if others > most {
            self.never(format!("{service} is started while {others} of it are alive"));
        }
        let starts = self.starts.entry(service).or_default();
        *starts += 1;
        // The budget of ten a minute is longer than a course; a swap is a start that no death caused.
        if service != ServiceId::Policy && *starts > 11 * (self.resumes + 1) {
            self.never(format!("{service} was started {} times", self.starts[&service]));
        }
    }

    /// A process has ended.
    pub fn ended(&mut self, service: ServiceId, life: u32, now_ms: u64) {
        let lost = self.lost_ms.entry(service).or_insert((life, now_ms, true));
        if lost.0 <= life {
            *lost = (life, now_ms, true);
        }
    }

    /// A process was stopped.
    pub fn hung(&mut self, service: ServiceId, life: u32, now_ms: u64) {
        self.lost_ms.insert(service, (life, now_ms, false));
    }

    /// A process that was stopped runs again.
    pub fn resumed(&mut self, service: ServiceId, life: u32) {
        if self.lost_ms.get(&service).is_some_and(|lost| lost.0 == life && !lost.2) {
            self.lost_ms.remove(&service);
        }
    }

    /// Everybody's clock is further on, and nobody was alone in standing still.
    pub fn clock_stepped(&mut self, by_ms: u64) {
        self.lost_ms.values_mut().for_each(|lost| lost.1 += by_ms);
        self.stopped_ms = self.stopped_ms.map(|at| at + by_ms);
    }

    /// A line is watched at the gate.
    pub fn armed(&mut self, service: ServiceId, life: u32) {
        self.closed.retain(|(whose, old), _| *whose != service || *old >= life);
    }

    /// A line closed at the gate; the epoch there, where that stopped it.
    pub fn closed(&mut self, service: ServiceId, life: u32, epoch: Option<u64>) {
        if let Some(epoch) = epoch {
            self.closed.insert((service, life), epoch);
        }
    }

    /// The gate is another one.
    pub fn gate_gone(&mut self) {
        self.closed.clear();
    }

    /// What the gate allows.
    pub fn gate(&mut self, gate: &Gate, verdict: &guidedog_locomotion::Verdict, now_ms: u64) {
        if verdict.velocity.is_zero() {
            return;
        }
        if let Some(((service, life), _)) = self.closed.iter().find(|(_, epoch)| gate.epoch() <= **epoch) {
            self.never(format!("moves at {now_ms} ms in the epoch in which the line of {service} {life} closed"));
        }
        let fenced = gate.permit().filter(|permit| {
            let closed = |service, life| self.closed.contains_key(&(service, life));
            closed(ServiceId::Shield, permit.header.incarnation) || closed(ServiceId::Policy, permit.policy_incarnation)
        });
        if let Some(permit) = fenced {
            self.never(format!(
                "a permit of shield {} for policy {} is honoured, and one of them is dead",
                permit.header.incarnation, permit.policy_incarnation
            ));
        }
    }
}

impl Simulation {
    /// What must hold at every tick.
    pub(super) fn check(&mut self) -> Result<(), String> {
        let is_stopped = self.machine.mode().class != ModeClass::Run;
        let stopped_ms = is_stopped.then(|| self.checks.stopped_ms.unwrap_or(self.now_ms));
        self.checks.stopped_ms = stopped_ms;
        if let Some(wrong) = self.checks.wrong.take() {
            return Err(wrong);
        }
        if self.running(ServiceId::Brake).is_none() {
            self.checks.brake_away_ms = self.now_ms;
        }
        if !self.robot.0 {
            return Ok(());
        }
        self.count("ticks walking");
        let locomotion_is_well = self.running(ServiceId::Locomotion) == Some(self.robot.1);
        if !locomotion_is_well {
            let lost = self.checks.lost_ms.get(&ServiceId::Locomotion).map_or(self.now_ms, |lost| lost.1);
            // Without locomotion and brake nobody is left to stop the robot: it keeps its last command until one is
            // back.
            let for_ms = self.now_ms.saturating_sub(lost.max(self.checks.brake_away_ms));
            let fine = for_ms <= BRAKE_MS + TICK_MS;
            return if fine { Ok(()) } else { Err(format!("walks {for_ms} ms after locomotion was lost")) };
        }
        let late = stopped_ms.map_or(0, |at| self.now_ms - at);
        if late > STOP_MS {
            return Err(format!("walks {late} ms after the stop"));
        }
        self.check_lost()
    }

    /// Nobody that motion needs has been lost for long.
    fn check_lost(&self) -> Result<(), String> {
        for (service, (life, at_ms, dead)) in &self.checks.lost_ms {
            let is_present = self.life_of(*service) <= *life;
            let critical = self.machine.is_critical(*service, *life);
            let by_ms = if *dead { DEATH_MS } else { HANG_MS };
            let for_ms = self.now_ms.saturating_sub(*at_ms);
            if critical && is_present && for_ms > by_ms {
                let how = if *dead { "died" } else { "fell silent" };
                return Err(format!("walks {for_ms} ms after {service} {life} {how}"));
            }
        }
        Ok(())
    }
}
