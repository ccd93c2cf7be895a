//! The scripted handler: gives the cues of a route, and the one in force again after a fault. Pure.

use messages::{CueKind, CueSource, Mode, ModeClass, Pose2, s_from_ns};
use serde::{Deserialize, Serialize};
use world::{CueSequence, Route};

/// The scripted handler collects themself for this long after the robot is ready again.
const AGAIN_AFTER_NS: u64 = 2_000_000_000;
/// A cue that was not accepted is given again after this long.
const RETRY_NS: u64 = 1_000_000_000;
/// A handler who is asked to walk elsewhere is there after this long, and says "forward".
const IN_PLACE_NS: u64 = 3_000_000_000;
/// The script looks at the clock this often.
const LOOK_NS: u64 = 50_000_000;

/// What the scripted handler sees.
#[derive(Debug)]
pub struct Situation<'a> {
    /// Run time.
    pub now_ns: u64,
    /// Where the robot is in the world; the handler knows where they are.
    pub world_from_robot: Pose2,
    /// The newest mode.
    pub mode: Option<&'a Mode>,
    /// Whether odometry has come: a cue has a start frame.
    pub pose_known: bool,
}

/// What a handler remembers, whatever becomes of the process that speaks for them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Memory {
    /// Cues of the route that were given.
    pub given: usize,
    /// The cue that the handler wants in force.
    pub wanted: Option<CueKind>,
}

/// A handler by script.
#[derive(Debug, Default)]
pub struct Script {
    route: Option<CueSequence>,
    forward_when_ready: bool,
    /// The cue that the handler wants in force.
    wanted: Option<CueKind>,
    ready_since_ns: Option<u64>,
    /// The epoch that `ready_since_ns` is of.
    epoch: u64,
    given_at_ns: Option<u64>,
    /// Since when the handler is asked to walk elsewhere.
    asked_since_ns: Option<u64>,
    next_look_ns: u64,
}

impl Script {
    /// A handler who says nothing.
    #[must_use]
    pub fn silent() -> Self {
        Self::default()
    }

    /// A handler who gives the cues of a route.
    #[must_use]
    pub fn of(route: &Route) -> Self {
        Self { route: Some(CueSequence::new(route)), ..Self::default() }
    }

    /// A handler who says "forward" as soon as the robot is ready, and again after every fault.
    #[must_use]
    pub fn forward_when_ready() -> Self {
        Self { forward_when_ready: true, ..Self::default() }
    }

    /// The operator speaks for the handler: after "stop" nothing is wanted again, whatever the mode.
    pub fn heard(&mut self, kind: CueKind) {
        if !kind.is_moving() {
            self.wanted = Some(kind);
        }
    }

    /// What the handler remembers.
    #[must_use]
    pub fn memory(&self) -> Memory {
        Memory { given: self.route.as_ref().map_or(0, CueSequence::given), wanted: self.wanted }
    }

    /// The handler goes on from what they remember.
    pub fn recall(&mut self, memory: Memory) {
        self.wanted = memory.wanted;
        if let Some(route) = &mut self.route {
            route.skip(memory.given);
        }
    }

    /// Run time of the next look, for who says anything at all.
    #[must_use]
    pub fn next_timer_ns(&self) -> Option<u64> {
        (self.route.is_some() || self.forward_when_ready).then_some(self.next_look_ns)
    }

    /// The cue to give now, if any.
    pub fn due(&mut self, now: &Situation<'_>) -> Option<(CueKind, CueSource)> {
        // Where nobody speaks for the handler, every cue is the operator's to give: again as well.
        if now.now_ns < self.next_look_ns || (self.route.is_none() && !self.forward_when_ready) {
            return None;
        }
        self.next_look_ns = (now.now_ns / LOOK_NS + 1) * LOOK_NS;
        let mode = now.mode?;
        if !now.pose_known {
            return None;
        }
        self.follow(mode, now.now_ns);
        let ready = mode.class == ModeClass::Run || mode.ready_for_cue;
        // A service may be back between two looks: every new epoch, and every run, begins the wait again.
        if mode.class == ModeClass::Run || mode.epoch != self.epoch {
            self.ready_since_ns = None;
            self.epoch = mode.epoch;
        }
        self.ready_since_ns = if ready { self.ready_since_ns.or(Some(now.now_ns)) } else { None };
        if !ready || self.given_at_ns.is_some_and(|at| now.now_ns < at + RETRY_NS) {
            return None;
        }
        let due = self.next(mode, now)?;
        self.given_at_ns = Some(now.now_ns);
        Some(due)
    }

    /// What is in force in run is what is wanted again after a fault, whoever said it: a done turn goes on as
    /// forward, and after anybody's "stop" nothing is. A cue that was given a moment ago may not be in force yet.
    fn follow(&mut self, mode: &Mode, now_ns: u64) {
        if mode.class != ModeClass::Run {
            return;
        }
        if mode.cue.valid {
            self.wanted = Some(mode.cue.cue.kind);
        } else if self.given_at_ns.is_none_or(|at| now_ns >= at + RETRY_NS) {
            self.wanted = self.wanted.and(Some(CueKind::Stop));
        }
    }

    fn next(&mut self, mode: &Mode, now: &Situation<'_>) -> Option<(CueKind, CueSource)> {
        if self.forward_when_ready && self.wanted.is_none() {
            self.wanted = Some(CueKind::Forward);
            return Some((CueKind::Forward, CueSource::Script));
        }
        if let Some(kind) = self.route.as_mut().and_then(|route| route.due(s_from_ns(now.now_ns), now.world_from_robot))
        {
            self.wanted = Some(kind);
            return Some((kind, CueSource::Script));
        }
        let is_asked = mode.class == ModeClass::Run && mode.cue.valid && mode.formation_asked != mode.formation;
        self.asked_since_ns = if is_asked { self.asked_since_ns.or(Some(now.now_ns)) } else { None };
        if self.asked_since_ns.is_some_and(|since_ns| now.now_ns >= since_ns + IN_PLACE_NS) {
            return Some((CueKind::Forward, CueSource::Script));
        }
        let wanted = self.wanted.filter(|kind| kind.is_moving())?;
        if mode.class == ModeClass::Run {
            return None;
        }
        // After a fault the handler waits for a moment before saying it again.
        let since = self.ready_since_ns?;
        (now.now_ns >= since + AGAIN_AFTER_NS).then_some((wanted, CueSource::ScriptAgain))
    }
}

#[cfg(test)]
mod tests {
    use super::{Script, Situation};
    use messages::{Cue, CueInForce, CueKind, CueSource, Formation, Mode, ModeClass, Pose2};

    const MS: u64 = 1_000_000;

    fn at(now_ms: u64, mode: &Mode) -> Situation<'_> {
        Situation { now_ns: now_ms * MS, world_from_robot: Pose2::default(), mode: Some(mode), pose_known: true }
    }

    fn fault(ready: bool) -> Mode {
        Mode { class: ModeClass::Fault, ready_for_cue: ready, ..Mode::default() }
    }

    #[test]
    fn the_cue_in_force_is_given_again_two_seconds_after_ready() {
        let mut script = Script::forward_when_ready();
        assert_eq!(script.due(&at(100, &fault(false))), None);
        assert_eq!(script.due(&at(200, &fault(true))), Some((CueKind::Forward, CueSource::Script)));
        let run = running(CueKind::Forward, 0);
        assert_eq!(script.due(&at(5000, &run)), None);
        assert_eq!(script.due(&at(6000, &fault(false))), None);
        assert_eq!(script.due(&at(7000, &fault(true))), None);
        assert_eq!(script.due(&at(8900, &fault(true))), None);
        assert_eq!(script.due(&at(9000, &fault(true))), Some((CueKind::Forward, CueSource::ScriptAgain)));
    }

    #[test]
    fn a_fault_between_two_looks_is_waited_for_all_the_same() {
        let mut script = Script::forward_when_ready();
        script.due(&at(200, &Mode { epoch: 1, ..fault(true) }));
        let run = running(CueKind::Forward, 1);
        assert_eq!(script.due(&at(5000, &run)), None);
        let again = Mode { epoch: 2, ..fault(true) };
        assert_eq!(script.due(&at(5050, &again)), None);
        assert_eq!(script.due(&at(7000, &again)), None);
        assert_eq!(script.due(&at(7050, &again)), Some((CueKind::Forward, CueSource::ScriptAgain)));
    }

    fn running(kind: CueKind, epoch: u64) -> Mode {
        let cue = CueInForce { valid: true, cue: Cue { kind, ..Cue::default() } };
        Mode { class: ModeClass::Run, ready_for_cue: true, epoch, cue, ..Mode::default() }
    }

    #[test]
    fn after_anybodys_stop_nothing_is_given_again() {
        let mut script = Script::forward_when_ready();
        script.due(&at(200, &fault(true)));
        assert_eq!(script.due(&at(5000, &running(CueKind::Forward, 1))), None);
        let stopped = Mode { class: ModeClass::Run, ready_for_cue: true, epoch: 1, ..Mode::default() };
        assert_eq!(script.due(&at(6000, &stopped)), None);
        for t in (7000..20_000).step_by(50) {
            assert_eq!(script.due(&at(t, &Mode { epoch: 2, ..fault(true) })), None, "{t}");
        }
    }

    #[test]
    fn a_stop_said_in_a_fault_is_not_forgotten() {
        let mut script = Script::forward_when_ready();
        script.due(&at(200, &fault(true)));
        script.due(&at(5000, &running(CueKind::Forward, 1)));
        script.due(&at(6000, &Mode { epoch: 2, ..fault(false) }));
        script.heard(CueKind::Stop);
        for t in (7000..20_000).step_by(50) {
            assert_eq!(script.due(&at(t, &Mode { epoch: 2, ..fault(true) })), None, "{t}");
        }
    }

    #[test]
    fn after_a_done_turn_forward_is_what_is_given_again() {
        let mut script = Script { wanted: Some(CueKind::Left), ..Script::forward_when_ready() };
        // A turn that is done goes on as forward.
        let cue = Cue { kind: CueKind::Forward, source: CueSource::TurnDone, ..Cue::default() };
        let run = Mode { class: ModeClass::Run, cue: CueInForce { valid: true, cue }, ..Mode::default() };
        script.due(&at(1000, &run));
        script.due(&at(2000, &fault(true)));
        assert_eq!(script.due(&at(4000, &fault(true))), Some((CueKind::Forward, CueSource::ScriptAgain)));
    }

    #[test]
    fn a_handler_who_is_asked_to_come_behind_says_forward_from_there() {
        let mut script = Script::forward_when_ready();
        script.due(&at(200, &fault(true)));
        let asked = Mode { formation_asked: Formation::Behind, ..running(CueKind::Forward, 1) };
        assert_eq!(script.due(&at(5000, &asked)), None);
        assert_eq!(script.due(&at(7950, &asked)), None);
        assert_eq!(script.due(&at(8000, &asked)), Some((CueKind::Forward, CueSource::Script)));
        let agreed = Mode { formation: Formation::Behind, ..asked };
        assert_eq!(script.due(&at(12_000, &agreed)), None);
    }

    #[test]
    fn who_is_silent_gives_no_cue_again() {
        let mut script = Script::silent();
        script.due(&at(1000, &running(CueKind::Forward, 1)));
        for t in (2000..20_000).step_by(50) {
            assert_eq!(script.due(&at(t, &Mode { epoch: 2, ..fault(true) })), None, "{t}");
        }
    }
}
