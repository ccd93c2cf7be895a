//! The robot waits before an edge or a low step until the handler says *forward*.

use guidance::Judgement;
use guidance::se2::Point;
use messages::{Cue, CueInForce, CueKind, Mode, ModeClass, Outcome, age_ns};

use super::{Core, Running};

/// Steps are one step up to this distance, metres. So far away from one the robot waits there no longer.
const SAME_STEP_M: f64 = 0.5;
const LEFT_M: f64 = 1.5;

/// The robot waits before an edge or a low step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Waiting {
    /// Since then without a break; none: it is on its way.
    pub since_ns: Option<u64>,
    /// The last decision that found it waiting.
    pub last_ns: u64,
    /// From then on the handler knew of it; none: not yet.
    pub told_at_ns: Option<u64>,
    /// The cue in force.
    pub cue: CueInForce,
    /// The action that leads over it, and its place (odometry frame).
    pub action: usize,
    pub place: Point,
    pub is_low_step: bool,
}

impl Core {
    /// The cue forward, given anew before a low step, allows the step. Any other cue, none, a fault and a lock allow no
    /// step.
    pub(super) fn allow_step_by_cue(&mut self, mode: &Mode) {
        let CueInForce { valid, cue } = mode.cue;
        let is_forward = mode.class == ModeClass::Run && valid && cue.kind == CueKind::Forward;
        if !is_forward {
            // A stop leaves no cue in force.
            self.awareness.allow_no_step();
        }
        let is_new = |waiting: &Waiting| {
            let Cue { header, kind, .. } = waiting.cue.cue;
            (header.incarnation, header.seq, kind) != (cue.header.incarnation, cue.header.seq, cue.kind)
        };
        let Some(waiting) = self.waiting.filter(is_new) else { return };
        self.waiting = None;
        let goes_on_until_ns = waiting.last_ns.saturating_add(self.wait_gap_ns());
        let told_now = self.told_at_ns(waiting.since_ns).filter(|told_at_ns| *told_at_ns <= goes_on_until_ns);
        let told_at_ns = waiting.told_at_ns.or(told_now);
        let was_told = told_at_ns.is_some_and(|told_at_ns| cue.header.stamp_ns >= told_at_ns);
        if waiting.is_low_step && was_told && is_forward {
            self.awareness.allow_step(waiting.place);
        }
    }

    pub(super) fn wait_at_edge(&mut self, now_ns: u64, action: usize, running: &Running) {
        if running.drawn == Outcome::Granted
            && let Some(waiting) = &mut self.waiting
        {
            waiting.since_ns = None;
        }
        let here = Point::from(self.awareness.odom_from_robot().translation.vector);
        self.waiting = self.waiting.filter(|waiting| (waiting.place - here).norm() <= LEFT_M);
        let Judgement { cause, place, .. } = running.judgement;
        // The handler is asked about edges ahead alone: *forward* does not allow a step to the side.
        let leads_ahead = self.table().actions()[action].leads_ahead();
        let Some(place) = place.filter(|_| cause.is_edge() && leads_ahead) else {
            if let Some(waiting) = &mut self.waiting {
                // The handler is told of something else meanwhile.
                waiting.since_ns = None;
            }
            return;
        };
        if running.drawn == Outcome::AllUnsafe && self.is_cued_forward() {
            let cue = self.mode.map_or_else(CueInForce::default, |mode| mode.cue);
            let place = self.awareness.odom_from_robot() * place;
            let is_low_step = cause.is_low_step();
            let is_same =
                |before: &Waiting| before.is_low_step == is_low_step && (before.place - place).norm() <= SAME_STEP_M;
            let before = self.waiting.filter(is_same);
            let cue = before.map_or(cue, |before| before.cue);
            let goes_on = |before: &Waiting| age_ns(now_ns, before.last_ns) <= self.wait_gap_ns();
            let since_ns = before.filter(goes_on).and_then(|before| before.since_ns).or(Some(now_ns));
            let now_told = || self.told_at_ns(since_ns).filter(|told_at_ns| *told_at_ns <= now_ns);
            let told_at_ns = before.and_then(|before| before.told_at_ns).or_else(now_told);
            self.waiting = Some(Waiting { since_ns, last_ns: now_ns, told_at_ns, cue, action, place, is_low_step });
        }
    }
}
