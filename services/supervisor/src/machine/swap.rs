//! Hot swap of the policy: a candidate runs in shadow beside the active one, is named by `mode` once its decisions are
//! good, and is on probation until it has shown that it can do without the one before.
//!
//! A planned swap misses no decision and stops nothing. Whatever fails before a permit carries the candidate's
//! decision leaves the active policy as it was. What dies on probation is a fault like any other: one stop, and back.

use control::{PolicySpec, SwapRecord, SwapState};
use messages::{ModeClass, Permit, PolicyAction, ServiceId};

use super::watched::{Phase, Role, Watched};
use super::{Action, Machine, Now};

/// So many swaps are remembered, the newest.
const MAX_RECORDS: usize = 200;
/// Whoever is no longer named is killed this much later, wall time: locomotion then knows that its line stops nobody.
const KILL_AFTER_NS: u64 = 60_000_000;

/// What a candidate has to show.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SwapLimits {
    /// Good decisions in a row, in shadow.
    pub decisions: u32,
    /// From the time at which a decision is due to its publication, nanoseconds.
    pub latency_ns: u64,
    /// From its first permit on, nanoseconds of run time.
    pub probation_ns: u64,
    /// Decision period, nanoseconds.
    pub dt_ns: u64,
    /// The run's action table.
    pub action_table_id: u64,
    /// And its length.
    pub action_count: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Starts, loads and verifies its model.
    Starting,
    /// Decides in shadow: its last decision, how many were good, and when the last one came (run time).
    Shadow { last: u64, good: u32, heard_ns: u64 },
    /// Named at that run time; no permit has carried its decision yet.
    Activating { named_ns: u64 },
    /// The way back is open until then (run time).
    Probation { until_ns: u64 },
    /// The operator went back; the candidate's last action ends by then (run time).
    Returning { until_ns: u64 },
    /// Decided; whoever is not named any more has not ended yet. What it then comes to.
    Ending { to: SwapState },
}

impl Stage {
    const fn state(self) -> SwapState {
        match self {
            Self::Starting => SwapState::Starting,
            Self::Shadow { .. } => SwapState::Shadow,
            Self::Activating { .. } => SwapState::Activating,
            Self::Probation { .. } => SwapState::Probation,
            Self::Returning { .. } => SwapState::Returning,
            Self::Ending { .. } => SwapState::Ending,
        }
    }
}

/// The policies of a run: which is in force, and the swap under way.
#[derive(Debug, Default)]
pub struct Policies {
    /// In force, bar a candidate on probation.
    spec: PolicySpec,
    /// In force before that.
    before: Option<PolicySpec>,
    stage: Option<Stage>,
    records: Vec<SwapRecord>,
    count: u64,
}

impl Policies {
    /// The policy in force; a candidate is not until its probation is over.
    #[must_use]
    pub fn spec(&self) -> &PolicySpec {
        &self.spec
    }

    /// The last swaps, the oldest of them first; the last one may be under way.
    #[must_use]
    pub fn records(&self) -> &[SwapRecord] {
        &self.records
    }

    /// The newest of them: so many that an answer holds them.
    #[must_use]
    pub fn last_records(&self) -> &[SwapRecord] {
        const LAST: usize = 12;
        &self.records[self.records.len().saturating_sub(LAST)..]
    }

    fn swap(&self) -> Option<(Stage, &SwapRecord)> {
        Some((self.stage?, self.records.last()?))
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = Some(stage);
        if let Some(record) = self.records.last_mut() {
            record.state = stage.state();
        }
    }

    fn end(&mut self, to: SwapState, why: Option<String>) {
        self.enter(Stage::Ending { to });
        if let Some(record) = self.records.last_mut() {
            record.why = why;
        }
    }
}

impl Machine {
    /// The policies of the run.
    #[must_use]
    pub fn policies(&self) -> &Policies {
        &self.policies
    }

    /// What an incarnation of the policy is to be started with.
    #[must_use]
    pub fn policy_spec(&self, incarnation: u32) -> &PolicySpec {
        match self.policies.swap() {
            Some((_, record)) if record.candidate == incarnation => &record.spec,
            _ => &self.policies.spec,
        }
    }

    /// Begins a swap: its number.
    ///
    /// # Errors
    /// Where a swap is under way or the run is stopped: the policy in force goes on.
    pub fn swap_policy(&mut self, spec: PolicySpec, now: Now) -> Result<u64, String> {
        if let Some((stage, record)) = self.policies.swap() {
            return Err(format!("swap {} is under way ({})", record.number, stage.state()));
        }
        if self.mode.class != ModeClass::Run {
            return Err(format!("the run is stopped: {}", self.mode.reason));
        }
        let joins_at_ns = now.run_ns + self.limits.restart_time_ns;
        let Some(shadow) = self.policy_slot(Role::Shadow) else { return Err("the run has no policy".to_owned()) };
        (shadow.phase, shadow.joins_at_ns) = (Phase::Down { start_at_ns: now.wall_ns }, joins_at_ns);
        let previous = self.mode.active_policy;
        let policies = &mut self.policies;
        policies.count += 1;
        let (number, state) = (policies.count, Stage::Starting.state());
        policies.stage = Some(Stage::Starting);
        if policies.records.len() >= MAX_RECORDS {
            policies.records.remove(0);
        }
        policies.records.push(SwapRecord { number, state, candidate: 0, previous, spec, why: None });
        Ok(number)
    }

    /// Back to the policy before: at once where a swap is not over, else by a swap: its number.
    ///
    /// # Errors
    /// As [`Machine::swap_policy`], and where there is none to go back to.
    pub fn roll_back_policy(&mut self, now: Now) -> Result<u64, String> {
        let Some((stage, record)) = self.policies.swap() else {
            let before = self.policies.before.clone().ok_or("there is no policy to go back to")?;
            return self.swap_policy(before, now);
        };
        let number = record.number;
        match stage {
            Stage::Starting | Stage::Shadow { .. } | Stage::Activating { .. } => {
                self.fail_swap("rolled back by the operator", now);
            }
            Stage::Probation { .. } => {
                let candidate = record.candidate;
                self.exchange_policies();
                // Its running action goes on to its end.
                self.mode.previous_policy = candidate;
                self.policies.enter(Stage::Returning { until_ns: now.run_ns + 3 * self.limits.swap.dt_ns });
            }
            Stage::Returning { .. } | Stage::Ending { .. } => {
                return Err(format!("swap {number} is not over yet ({})", stage.state()));
            }
        }
        Ok(number)
    }

    fn policy_slot(&mut self, role: Role) -> Option<&mut Watched> {
        self.services.iter_mut().find(|s| s.plan.service == ServiceId::Policy && s.role == role)
    }

    /// The candidate begins its life.
    pub(super) fn candidate_spawned(&mut self, incarnation: u32) {
        if let (Some(Stage::Starting), Some(record)) = (self.policies.stage, self.policies.records.last_mut()) {
            record.candidate = incarnation;
        }
    }

    /// The candidate has loaded and verified its model.
    pub(super) fn candidate_ready(&mut self, now: Now) {
        if self.policies.stage == Some(Stage::Starting) {
            self.policies.enter(Stage::Shadow { last: 0, good: 0, heard_ns: now.run_ns });
        }
    }

    /// A decision, of whomever.
    pub(super) fn on_decision(&mut self, action: &PolicyAction, now: Now) {
        let Some((Stage::Shadow { last, good, .. }, record)) = self.policies.swap() else { return };
        if action.header.incarnation != record.candidate {
            return;
        }
        if let Some(flaw) = flaw_of(action, last, &self.limits.swap) {
            return self.fail_swap(&flaw, now);
        }
        self.policies.enter(Stage::Shadow { last: action.decision, good: good + 1, heard_ns: now.run_ns });
        self.try_activate(now);
    }

    /// Names the candidate once it has shown enough: its line is watched, and its beats tell of its decisions as well.
    fn try_activate(&mut self, now: Now) {
        let Some((Stage::Shadow { good, .. }, _)) = self.policies.swap() else { return };
        let lag_ns = self.limits.beat_lag_ns;
        let is_well = |s: &mut Watched| {
            s.armed
                && s.phase == Phase::Ready
                && s.beats_on_time(now.run_ns)
                && s.stale_stream(now.run_ns, 1, lag_ns).is_none()
        };
        if good >= self.limits.swap.decisions && self.policy_slot(Role::Shadow).is_some_and(is_well) {
            self.exchange_policies();
            self.policies.enter(Stage::Activating { named_ns: now.run_ns });
        }
    }

    /// A verdict: whose decision it carries.
    pub(super) fn on_permit(&mut self, permit: &Permit, now: Now) {
        let Some((stage, record)) = self.policies.swap() else { return };
        let due_ns = permit.decision.saturating_mul(self.limits.swap.dt_ns);
        match stage {
            Stage::Activating { .. } if permit.policy_incarnation == record.candidate => {
                self.policies.enter(Stage::Probation { until_ns: now.run_ns + self.limits.swap.probation_ns });
            }
            Stage::Activating { named_ns } if permit.policy_incarnation == record.previous && due_ns > named_ns => {
                self.fail_swap(&format!("gave no decision {} once it was named", permit.decision), now);
            }
            Stage::Probation { .. } if permit.policy_incarnation == record.previous => {
                self.fail_swap(&format!("gave no decision {} on probation", permit.decision), now);
            }
            _ => {}
        }
    }

    /// Run time passed.
    pub(super) fn tick_swap(&mut self, now: Now) {
        let Some((stage, _)) = self.policies.swap() else { return };
        let dt_ns = self.limits.swap.dt_ns;
        match stage {
            Stage::Shadow { heard_ns, .. } if now.run_ns > heard_ns + 2 * dt_ns + self.limits.swap.latency_ns => {
                let ms = (now.run_ns - heard_ns) / 1_000_000;
                self.fail_swap(&format!("gave no decision for {ms} ms in shadow"), now);
            }
            Stage::Shadow { .. } => self.try_activate(now),
            Stage::Activating { named_ns } if now.run_ns > named_ns + 4 * dt_ns => {
                self.fail_swap("was named, and no permit carried a decision of its", now);
            }
            Stage::Probation { until_ns } if now.run_ns >= until_ns => self.end_swap(SwapState::Done, None, now),
            Stage::Returning { until_ns } if now.run_ns >= until_ns => {
                self.end_swap(SwapState::RolledBack, Some("rolled back by the operator".to_owned()), now);
            }
            Stage::Ending { to } if self.policy_slot(Role::Shadow).is_none_or(|s| s.phase == Phase::Off) => {
                self.policies.stage = None;
                self.policies.records.last_mut().into_iter().for_each(|record| record.state = to);
            }
            _ => {}
        }
    }

    /// Names the other policy.
    fn exchange_policies(&mut self) {
        for s in self.services.iter_mut().filter(|s| s.plan.service == ServiceId::Policy) {
            s.role = if s.role == Role::Active { Role::Shadow } else { Role::Active };
        }
        let active = self.policy_slot(Role::Active).map_or(0, |s| s.incarnation);
        self.mode.previous_policy = self.mode.active_policy;
        self.mode.active_policy = active;
        self.mode_changed = true;
    }

    /// The policy that is not named any more leaves, and the swap is over.
    fn end_swap(&mut self, state: SwapState, why: Option<String>, now: Now) {
        self.mode.previous_policy = 0;
        self.mode_changed = true;
        if state == SwapState::Done
            && let Some(spec) = self.policies.records.last().map(|record| record.spec.clone())
        {
            self.policies.before = Some(std::mem::replace(&mut self.policies.spec, spec));
        }
        self.policies.end(state, why);
        let leave_by_ns = now.wall_ns + super::lives::LEAVE_LIMIT_NS;
        let left = self.policy_slot(Role::Shadow).filter(|s| matches!(s.phase, Phase::Ready | Phase::Starting { .. }));
        let left = left.map(|s| {
            (s.phase, s.joined) = (Phase::Leaving { kill_at_ns: leave_by_ns, asked: true }, false);
            s.incarnation
        });
        self.actions.extend(left.map(|incarnation| Action::Release(ServiceId::Policy, incarnation)));
        self.update_roster(now);
    }

    /// The policy before goes on, without a stop; the operator is told why.
    pub(super) fn fail_swap(&mut self, why: &str, now: Now) {
        let Some((stage, record)) = self.policies.swap() else { return };
        let told = format!("policy swap {} failed ({}): {why}", record.number, stage.state());
        if matches!(stage, Stage::Activating { .. } | Stage::Probation { .. }) {
            if self.policy_slot(Role::Shadow).is_none_or(|s| s.phase != Phase::Ready) {
                // Nobody is there to go back to: what is named stays, and is restarted as any other.
                return self.end_swap(SwapState::Done, Some(format!("{why}; there is no way back")), now);
            }
            self.exchange_policies();
        }
        self.mode.previous_policy = 0;
        self.policies.end(SwapState::Failed, Some(why.to_owned()));
        self.actions.push(Action::Note(told));
        if let Some(s) = self.policy_slot(Role::Shadow) {
            s.joined = false;
            match s.phase {
                Phase::Ready | Phase::Starting { .. } => {
                    s.phase = Phase::Leaving { kill_at_ns: now.wall_ns + KILL_AFTER_NS, asked: false };
                }
                Phase::Down { .. } => s.phase = Phase::Off,
                Phase::Off | Phase::Dying | Phase::Leaving { .. } | Phase::Spent => {}
            }
        }
        self.update_roster(now);
    }

    /// A stop begins: a candidate that is not on probation yet is given up.
    pub(super) fn stop_swap(&mut self, why: &str, now: Now) {
        if let Some(Stage::Starting | Stage::Shadow { .. } | Stage::Activating { .. }) = self.policies.stage {
            self.fail_swap(&format!("the run stopped: {why}"), now);
        }
    }

    fn kill_shadow(&mut self, now: Now) {
        if let Some(s) = self.policy_slot(Role::Shadow)
            && let Phase::Leaving { kill_at_ns, .. } = &mut s.phase
        {
            *kill_at_ns = now.wall_ns + KILL_AFTER_NS;
        }
    }

    /// A policy has died, or is condemned alive: whether that is the swap's business alone, and no fault.
    pub(super) fn policy_lost(&mut self, incarnation: u32, dead: bool, why: &str, now: Now) -> bool {
        let Some((stage, record)) = self.policies.swap() else { return false };
        let (candidate, previous) = (record.candidate, record.previous);
        match stage {
            Stage::Starting | Stage::Shadow { .. } if incarnation == candidate => {
                self.fail_swap(why, now);
                true
            }
            Stage::Activating { .. } | Stage::Probation { .. } if incarnation == candidate && dead => {
                // The end of a line that `mode` names has stopped the robot already.
                self.fail_swap(&format!("{why}; one stop, and the policy before is back"), now);
                false
            }
            Stage::Activating { .. } | Stage::Probation { .. } if incarnation == candidate => {
                // The decisions of the policy before are there: nothing need stop.
                self.fail_swap(why, now);
                true
            }
            Stage::Activating { .. } | Stage::Probation { .. } if incarnation == previous => {
                let told = format!("the policy before ({incarnation}) is gone: {why}; there is no way back");
                self.actions.push(Action::Note(told.clone()));
                self.end_swap(SwapState::Done, Some(told), now);
                // One that hangs does not hear that it may leave.
                self.kill_shadow(now);
                true
            }
            Stage::Returning { .. } => {
                self.end_swap(SwapState::RolledBack, Some(format!("rolled back; meanwhile {incarnation}: {why}")), now);
                self.kill_shadow(now);
                incarnation == candidate
            }
            _ => false,
        }
    }
}

/// What is wrong with a decision of a candidate, if anything.
fn flaw_of(action: &PolicyAction, last: u64, limits: &SwapLimits) -> Option<String> {
    let n = action.decision;
    if action.action_table_id != limits.action_table_id || action.action_count != limits.action_count {
        let (count, wanted) = (action.action_count, limits.action_count);
        return Some(format!("decides over another action table ({count} actions) than the run's ({wanted})"));
    }
    let probabilities = action.probabilities.iter().take(action.action_count as usize);
    if !probabilities.clone().all(|p| p.is_finite() && (0.0..=1.0).contains(p)) {
        return Some(format!("decision {n}: its output is no probability: {:?}", probabilities.collect::<Vec<_>>()));
    }
    let sum: f32 = probabilities.sum();
    if (sum - 1.0).abs() > 1e-3 {
        return Some(format!("decision {n}: its probabilities sum to {sum}"));
    }
    if action.header.stamp_ns != n.saturating_mul(limits.dt_ns) {
        return Some(format!("decision {n} is stamped {} ns", action.header.stamp_ns));
    }
    if last != 0 && n != last + 1 {
        return Some(format!("gave decision {n} after {last}"));
    }
    let latency_ns = action.header.published_ns.saturating_sub(action.header.stamp_ns);
    if latency_ns > limits.latency_ns {
        let (ms, limit) = (latency_ns / 1_000_000, limits.latency_ns / 1_000_000);
        return Some(format!("too slow: decision {n} took {ms} ms, limit {limit} ms"));
    }
    None
}
