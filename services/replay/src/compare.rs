//! What the run decides beside what was decided when it was recorded. Pure.

use std::collections::BTreeMap;

use control::{Compared, ComparedCount};
use messages::{Permit, PermitCause, PolicyAction, s_from_ns};
use recording::Record;
use serde_json::{Value, json};

/// What a verdict answers: a scan, or a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Question {
    Scan(u32, u64),
    Decision(u64),
}

/// Holds every action and permit of the run against the recorded one.
#[derive(Debug, Default)]
pub struct Compare {
    /// The recording's decisions before this run's first.
    decisions_before: u64,
    /// What has not met its counterpart: recorded, and of this run.
    permits: BTreeMap<Question, [Option<Permit>; 2]>,
    actions: BTreeMap<(u32, u64), [Option<PolicyAction>; 2]>,
    of_permits: ComparedCount,
    of_actions: ComparedCount,
    /// Verdicts that are another action or another outcome.
    decided_differently: u64,
    first_difference: Option<String>,
    /// Differences that have not been noted down yet.
    lines: Vec<Value>,
}

/// Recorded, or of this run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// As it was recorded.
    Recorded = 0,
    /// As it is now.
    Now = 1,
}

impl Compare {
    /// Compares a run whose first decision is that many after the recording's first.
    pub fn new(decisions_before: u64) -> Self {
        Self { decisions_before, ..Self::default() }
    }

    fn decision(&self, side: Side, decision: u64) -> u64 {
        decision.saturating_add(if side == Side::Now { self.decisions_before } else { 0 })
    }

    /// Takes a permit.
    pub fn permit(&mut self, side: Side, permit: &Permit) {
        self.of_permits.recorded += u64::from(side == Side::Recorded);
        let question = match permit.cause {
            PermitCause::Scan => Question::Scan(permit.lidar_incarnation, permit.scan_seq),
            PermitCause::Decision => Question::Decision(self.decision(side, permit.decision)),
        };
        let slot = self.permits.entry(question).or_default();
        slot[side as usize] = Some(*permit);
        if let [Some(then), Some(now)] = *slot {
            self.permits.remove(&question);
            self.hold_permits(&then, &now);
        }
    }

    fn hold_permits(&mut self, then: &Permit, now: &Permit) {
        if Record::from(*then).is_same(&Record::from(*now)) {
            self.of_permits.equal += 1;
            return;
        }
        self.of_permits.different += 1;
        // Another action is told once, by the decision that drew it.
        let drawn = then.cause == PermitCause::Decision && then.action != now.action;
        let differs = drawn || then.outcome != now.outcome;
        self.decided_differently += u64::from(differs);
        let what = if differs { "decides differently" } else { "differs in its numbers" };
        self.first_difference.get_or_insert_with(|| {
            let cause = if then.cause == PermitCause::Scan { "scan" } else { "decision" };
            format!("the permit at {} s for a {cause} {what}", s_from_ns(then.header.stamp_ns))
        });
        if differs {
            self.lines.push(json!({
                "cause": then.cause,
                "decision": then.decision,
                "scan_seq": then.scan_seq,
                "at_s": s_from_ns(then.header.stamp_ns),
                "step": then.header.step,
                "recorded": side_json(then),
                "replayed": side_json(now),
            }));
        }
    }

    /// Takes an action.
    pub fn action(&mut self, side: Side, action: &PolicyAction) {
        self.of_actions.recorded += u64::from(side == Side::Recorded);
        let question = (action.header.incarnation, self.decision(side, action.decision));
        let slot = self.actions.entry(question).or_default();
        slot[side as usize] = Some(*action);
        if let [Some(then), Some(now)] = *slot {
            self.actions.remove(&question);
            let equal = Record::from(then).is_same(&Record::from(now));
            self.of_actions.equal += u64::from(equal);
            self.of_actions.different += u64::from(!equal);
            if !equal {
                let first = || format!("action {} at {} s differs", then.decision, s_from_ns(then.header.stamp_ns));
                self.first_difference.get_or_insert_with(first);
            }
        }
    }

    /// The differences found since this was last asked.
    pub fn take_lines(&mut self) -> Vec<Value> {
        std::mem::take(&mut self.lines)
    }

    /// The figures, for the report. What has no counterpart in the end is different too; where the whole run is played
    /// to its end, it was decided differently.
    pub fn figures(&self, exact: bool, to_its_end: bool) -> Compared {
        let (mut permits, mut actions) = (self.of_permits, self.of_actions);
        for [then, now] in self.permits.values() {
            permits.different += u64::from(then.is_some());
            permits.additional += u64::from(now.is_some());
        }
        for [then, now] in self.actions.values() {
            actions.different += u64::from(then.is_some());
            actions.additional += u64::from(now.is_some());
        }
        let alone = self.permits.values().filter(|_| exact && to_its_end).count() as u64;
        Compared {
            exact,
            permits,
            actions,
            decided_differently: self.decided_differently + alone,
            first_difference: self.first_difference.clone(),
        }
    }
}

fn side_json(permit: &Permit) -> Value {
    json!({
        "action": permit.action,
        "outcome": permit.outcome,
        "unsafe_mask": permit.unsafe_mask,
        "margin_m": permit.margin_m,
        "unsafe_cause": permit.unsafe_cause,
    })
}

#[cfg(test)]
mod tests {
    use super::{Compare, Side};
    use control::ComparedCount;
    use messages::{Outcome, Permit, PermitCause, PolicyAction};

    fn permit(scan_seq: u64) -> Permit {
        Permit { scan_seq, lidar_incarnation: 1, outcome: Outcome::Granted, ..Permit::default() }
    }

    #[test]
    fn what_is_equal_to_the_byte_is_told_from_what_is_not() {
        let mut compare = Compare::new(0);
        for seq in 1..=4 {
            compare.permit(Side::Recorded, &permit(seq));
        }
        compare.permit(Side::Now, &permit(1));
        compare.permit(Side::Now, &Permit { margin_m: 1e-17, ..permit(2) });
        compare.permit(Side::Now, &Permit { outcome: Outcome::RemainderUnsafe, ..permit(3) });
        compare.permit(Side::Now, &permit(9));
        let figures = compare.figures(true, true);
        assert_eq!(figures.permits, ComparedCount { recorded: 4, equal: 1, different: 3, additional: 1 });
        // One outcome, and two that the other side has not.
        assert_eq!(figures.decided_differently, 3);
        let lines = compare.take_lines();
        assert_eq!((lines.len(), &lines[0]["replayed"]["outcome"]), (1, &"remainder_unsafe".into()));
    }

    #[test]
    fn decisions_are_matched_by_the_part_that_is_played() {
        let mut compare = Compare::new(40);
        let decision = |decision| Permit { cause: PermitCause::Decision, decision, ..permit(0) };
        compare.permit(Side::Recorded, &decision(42));
        compare.permit(Side::Now, &decision(2));
        compare.action(Side::Recorded, &PolicyAction { decision: 42, ..PolicyAction::default() });
        compare.action(Side::Now, &PolicyAction { decision: 2, ..PolicyAction::default() });
        let figures = compare.figures(false, false);
        assert_eq!((figures.permits.additional, figures.actions.additional), (0, 0));
        assert_eq!(figures.decided_differently, 0);
    }
}
