//! What the shield decides: pure, times come in with the inputs.

mod backing;
mod explain;
mod forming;
mod waiting;

use backing::Backing;
use explain::explain;
use forming::Place;
use guidance::contact;
use guidance::se2::pose2;
use guidance::shield::{choose, leaves_only_stop, masked_at_edge, most_wanted_motion, suppress};
use guidance::{
    ActionTable, Awareness, AwarenessConfig, Draw, FloorWatch, HarnessError, Judgement, Pose, Se2, Shield,
    ShieldConfig, TiltWatch,
};
use messages::{
    CueKind, DepthHeader, Formation, Health, Mode, ModeClass, NS_PER_S, Odometry, Outcome, Permit, PermitCause,
    PolicyAction, ScanHeader, SecondScanHeader, StopKind, TopicId, Twist2, age_ns, s_from_ns,
};
use settings::{Settings, Source};
use waiting::Waiting;

/// The policy before decides where the active one has not by this much after the decision was due.
const STANDBY_NS: u64 = NS_PER_S / 20;
/// A step is taken on a cue that comes after the robot has stood there for so long: the handler has been told of it. At
/// least this, and so long after the voice begins to tell of a stop.
const TOLD_MIN_NS: u64 = NS_PER_S;
const SAID_NS: u64 = NS_PER_S / 2;
/// What the core needs to know.
#[derive(Debug, Clone)]
pub struct CoreConfig {
    /// By formation.
    places: [Place; Formation::ALL.len()],
    action_table_id: u64,
    awareness: AwarenessConfig,
    shield: ShieldConfig,
    draw: Draw,
    dt_ns: u64,
    scan_period_ns: u64,
    mode_max_age_ns: u64,
    action_max_age_ns: u64,
    permit_life_ns: u64,
    absent_streams: u32,
    /// Of a wait for so long the handler has been told.
    told_ns: u64,
    /// Of a step back the handler has been told after so long. A robot that does not speak makes none.
    back_told_ns: u64,
    /// The camera watches the floor.
    watches_floor: bool,
}

impl CoreConfig {
    /// The configuration of a run.
    ///
    /// # Errors
    /// Where the handler's parameters are no handler's.
    pub fn of(settings: &Settings, table: ActionTable) -> Result<Self, HarnessError> {
        let [beside, behind] = Formation::ALL.map(|formation| Place::of(settings, &table, formation));
        let absent = if settings.depth.source == Source::Absent { 1 << TopicId::DepthFrame as u32 } else { 0 };
        Ok(Self {
            places: [beside?, behind?],
            action_table_id: table.id(),
            awareness: AwarenessConfig {
                second_max_age_ns: settings.lidar.second.is_some().then(|| settings.max_age_ns(TopicId::SecondScan)),
                ..settings.awareness_config()
            },
            shield: settings.shield_config(),
            draw: settings.shield.choice.seeded(settings.shield.seed),
            dt_ns: settings.policy.dt.ns(),
            scan_period_ns: (1e9 / settings.lidar.rate_hz.get()) as u64,
            mode_max_age_ns: settings.max_age_ns(TopicId::Mode),
            action_max_age_ns: settings.max_age_ns(TopicId::PolicyAction),
            permit_life_ns: settings.locomotion.permit_life.ns(),
            absent_streams: absent,
            told_ns: TOLD_MIN_NS.max(settings.speak.hold_after.ns().saturating_add(SAID_NS)),
            back_told_ns: settings.asked_after_ns().unwrap_or(u64::MAX),
            watches_floor: settings.watches_floor(),
        })
    }
}

/// A decision that was drawn.
#[derive(Debug, Clone, Copy)]
struct Running {
    action: PolicyAction,
    index: usize,
    velocity: Twist2,
    unsafe_mask: u32,
    /// What the draw came to: [`Outcome::Granted`], stop, all unsafe, or why there was none.
    drawn: Outcome,
    /// Of the action drawn; of the motion that the policy wanted most where only stop was left.
    judgement: Judgement,
    begin_ns: u64,
    odom_from_begin: Se2,
    end_ns: u64,
}

/// The shield's state.
#[derive(Debug)]
pub struct Core {
    config: CoreConfig,
    shield: Shield,
    awareness: Awareness,
    floor: FloorWatch,
    tilt: TiltWatch,
    jumps: u64,
    mode: Option<Mode>,
    running: Option<Running>,
    waiting: Option<Waiting>,
    backing: Backing,
    /// The last decisions of policies that `mode` did not name when they came: while one is swapped for another.
    standby: [Option<PolicyAction>; 2],
    last_decision: Option<u64>,
    judgements: Vec<Judgement>,
    decisions: u64,
    missed: u64,
    invalid_inputs: u64,
    outcomes: [u64; Outcome::ALL.len()],
}

impl Core {
    /// A core that has seen nothing.
    #[must_use]
    pub fn new(config: CoreConfig) -> Self {
        let beside = &config.places[Formation::Beside as usize];
        Self {
            shield: Shield::new(config.shield.clone()),
            awareness: Awareness::new(beside.model.clone(), config.awareness.clone()),
            floor: FloorWatch::default(),
            tilt: TiltWatch::default(),
            jumps: 0,
            mode: None,
            running: None,
            waiting: None,
            backing: Backing::default(),
            standby: [None; 2],
            last_decision: None,
            judgements: Vec::new(),
            decisions: 0,
            missed: 0,
            invalid_inputs: 0,
            outcomes: [0; Outcome::ALL.len()],
            config,
        }
    }

    /// The newest mode.
    pub fn take_mode(&mut self, mode: &Mode) {
        if self.mode.is_some_and(|old| !mode.may_follow(&old)) {
            return;
        }
        let is_fault = mode.class == ModeClass::Fault && mode.reason.kind == StopKind::OdometryContradicts;
        let is_new = self.mode.is_some_and(|old| old.epoch != mode.epoch);
        if is_fault
            && is_new
            && let Some(running) = self.running.filter(|running| running.drawn == Outcome::Granted)
            && self
                .awareness
                .odometry()
                .is_some_and(|odometry| contact::falls_short(&running.velocity, &odometry.twist))
        {
            // Whatever held the robot is met again where this action leads, whoever gives the next cue.
            let action = self.table().actions()[running.index].start_from_end();
            self.awareness.feel(&running.odom_from_begin, &action);
        }
        let was_told = |old: Mode| old.class != ModeClass::Run && old.reason.kind == StopKind::NoFloor;
        if mode.class == ModeClass::Run && self.mode.is_some_and(was_told) {
            // A new cue may try again.
            self.floor.begin_anew();
        }
        self.allow_step_by_cue(mode);
        self.take_formation(mode);
        self.mode = Some(*mode);
    }

    /// The newest pose. A new frame, and a pose further off than the robot can walk, void the handler's estimate.
    pub fn take_odometry(&mut self, odometry: &Odometry) {
        let pose = self.awareness.take_odometry(odometry);
        self.invalid_inputs += u64::from(matches!(pose, Pose::Unusable | Pose::Jump));
        self.jumps += u64::from(pose == Pose::Jump);
        if matches!(pose, Pose::First | Pose::Jump) {
            // Its place is one of another frame.
            self.waiting = None;
        }
    }

    /// The newest scan of the second lidar.
    pub fn take_second(&mut self, header: &SecondScanHeader, ranges_m: &[f32]) {
        self.awareness.take_second(header, ranges_m);
    }

    /// The newest depth frame.
    pub fn take_depth(&mut self, header: &DepthHeader, pixels_mm: &[u16]) {
        self.awareness.take_depth(header, pixels_mm);
        if self.config.watches_floor {
            let stamp_ns = header.header.stamp_ns;
            let view = self.awareness.evidence(stamp_ns).depth;
            self.floor.take(stamp_ns, view);
            self.tilt.take(stamp_ns, self.awareness.odom_from_robot(), view);
        }
    }

    /// A new scan: the verdict on the running action.
    pub fn on_scan(&mut self, now_ns: u64, header: &ScanHeader, ranges_m: &[f32]) -> Permit {
        let usable = self.awareness.take_scan(now_ns, self.step_share(now_ns), header, ranges_m);
        self.invalid_inputs += u64::from(!usable);
        self.draw_belatedly(now_ns);
        let permit = self.verdict(now_ns, PermitCause::Scan);
        self.outcomes[permit.outcome as usize] += 1;
        permit
    }

    /// How long it is to the next scan.
    fn scan_period_ns(&self) -> u64 {
        let usual_ns = self.config.scan_period_ns;
        let bounded = |period_ns: u64| period_ns.max(usual_ns / 2).min(self.config.awareness.scan_max_age_ns);
        self.awareness.scan_period_ns().map_or(usual_ns, bounded)
    }

    /// A decision: drawn once, and judged at once where it is the active policy's.
    pub fn on_action(&mut self, now_ns: u64, action: &PolicyAction) -> Option<Permit> {
        if self.last_decision.is_some_and(|last| action.decision <= last) {
            return None;
        }
        let active = self.mode.map_or(0, |mode| mode.active_policy);
        if action.header.incarnation != active {
            self.stand_by(action);
            return None;
        }
        Some(self.book(now_ns, action))
    }

    fn stand_by(&mut self, action: &PolicyAction) {
        let life = action.header.incarnation;
        let same = self.standby.iter().position(|held| held.is_some_and(|held| held.header.incarnation == life));
        self.standby[..=same.unwrap_or(1)].rotate_right(1);
        self.standby[0] = Some(*action);
    }

    /// Draws a decision of a policy that was not named when it came: where `mode` names it now, or where that of the
    /// active one does not come and this is of the one before.
    pub fn draw_standby(&mut self, now_ns: u64) -> Option<Permit> {
        let mode = self.mode?;
        for i in 0..self.standby.len() {
            let Some(held) = self.standby[i] else { continue };
            let is_new = self.last_decision.is_none_or(|last| held.decision > last);
            if !is_new || !self.is_of_now(now_ns, &held) {
                self.standby[i] = None;
                continue;
            }
            let is_late = now_ns >= self.standby_until_ns(&held);
            let life = held.header.incarnation;
            if life == mode.active_policy || (is_late && mode.allows_policy(life)) {
                self.standby[i] = None;
                return Some(self.book(now_ns, &held));
            }
        }
        None
    }

    /// The active policy's decision is waited for until then, run time, nanoseconds.
    fn standby_until_ns(&self, held: &PolicyAction) -> u64 {
        held.decision.saturating_mul(self.config.dt_ns).saturating_add(STANDBY_NS)
    }

    /// Run time at which [`Core::draw_standby`] may find something, nanoseconds.
    #[must_use]
    pub fn standby_due_ns(&self) -> Option<u64> {
        let previous = self.mode.filter(|mode| mode.previous_policy != 0)?.previous_policy;
        let held = self.standby.iter().flatten().find(|held| held.header.incarnation == previous)?;
        Some(self.standby_until_ns(held))
    }

    fn book(&mut self, now_ns: u64, action: &PolicyAction) -> Permit {
        if !self.is_of_now(now_ns, action) {
            self.invalid_inputs += 1;
            self.running = None;
            return Permit { outcome: Outcome::InvalidAction, ..self.blank(PermitCause::Decision) };
        }
        if let Some(last) = self.last_decision {
            self.missed += action.decision - last - 1;
        }
        self.last_decision = Some(action.decision);
        self.decisions += 1;
        self.come_to(now_ns);
        self.awareness.begin_step();
        self.running = Some(self.draw(now_ns, action));
        self.verdict(now_ns, PermitCause::Decision)
    }

    /// Whether a decision is of now: made for this period, or for one beside it. No other number is ever booked, so
    /// that a policy that counts wrong cannot block those that count right.
    fn is_of_now(&self, now_ns: u64, action: &PolicyAction) -> bool {
        action.decision.abs_diff(now_ns / self.config.dt_ns) <= 1
            && age_ns(now_ns, action.header.stamp_ns) <= self.config.action_max_age_ns
            // A decision is stamped when it is due.
            && action.header.stamp_ns.abs_diff(action.decision * self.config.dt_ns) < self.config.dt_ns / 2
    }

    fn draw(&mut self, now_ns: u64, action: &PolicyAction) -> Running {
        let mut running = Running {
            action: *action,
            index: ActionTable::STOP,
            velocity: Twist2::ZERO,
            unsafe_mask: 0,
            drawn: Outcome::InvalidAction,
            judgement: Judgement::default(),
            begin_ns: now_ns,
            odom_from_begin: *self.awareness.odom_from_robot(),
            end_ns: (action.decision + 1) * self.config.dt_ns,
        };
        let table = &self.config.places[self.formation() as usize].table;
        let count = table.len();
        if action.action_table_id != self.config.action_table_id
            || action.action_count as usize != count
            || !are_probabilities(&action.probabilities[..count])
        {
            self.invalid_inputs += 1;
            return running;
        }
        if let Some(why) = self.unusable(now_ns, action) {
            running.drawn = why;
            return running;
        }
        if let Some(asked) = self.asked(action) {
            // The next *forward* answers this question, and none about a step.
            self.waiting = None;
            running.drawn = asked;
            return running;
        }
        let (evidence, handler) = (self.awareness.evidence(now_ns), self.awareness.handler());
        running.unsafe_mask = self.shield.judge_actions(table, evidence, handler, &mut self.judgements);
        let probabilities: Vec<f64> = action.probabilities[..count].iter().map(|p| f64::from(*p)).collect();
        let mut wanted = choose(&probabilities, Draw::ArgMax, action.decision);
        if self.is_cued_forward() {
            // A policy that stands there wants to go on all the same.
            if let Some(waiting) = self.waiting.filter(|_| wanted == ActionTable::STOP) {
                wanted = waiting.action;
            }
            running.unsafe_mask = masked_at_edge(table, &self.judgements, running.unsafe_mask, wanted);
        }
        // Beta 0: on the robot an unsafe action is never drawn.
        let suppressed = suppress(&probabilities, running.unsafe_mask, 0.0);
        running.index = choose(&suppressed.probabilities[..count], self.config.draw, action.decision);
        // Where only stop is left, it is the shield that stops.
        let is_held = running.index == ActionTable::STOP && leaves_only_stop(running.unsafe_mask, table);
        running.drawn = if is_held {
            Outcome::AllUnsafe
        } else if running.index == ActionTable::STOP {
            Outcome::Stop
        } else {
            Outcome::Granted
        };
        let told = if is_held { most_wanted_motion(table, &probabilities, wanted) } else { running.index };
        running.judgement = self.judgements[told];
        let (is_back, gap_ns) = (table.actions()[running.index].leads_back(), self.wait_gap_ns());
        if self.backing.waits(now_ns, is_back, self.mode.as_ref(), self.config.back_told_ns, gap_ns) {
            (running.index, running.drawn) = (ActionTable::STOP, Outcome::StepsBack);
        }
        running.velocity = table.actions()[running.index].velocity(self.config.dt_ns as f64 / 1e9);
        self.wait_at_edge(now_ns, told, &running);
        running
    }

    /// Decisions that are farther apart do not make one wait, nanoseconds.
    fn wait_gap_ns(&self) -> u64 {
        self.config.dt_ns.saturating_mul(3) / 2
    }

    /// When the handler knows of a wait that began then and goes on.
    fn told_at_ns(&self, since_ns: Option<u64>) -> Option<u64> {
        since_ns.map(|since_ns| since_ns.saturating_add(self.config.told_ns))
    }

    fn is_cued_forward(&self) -> bool {
        self.mode.is_some_and(|mode| mode.cue.valid && mode.cue.cue.kind == CueKind::Forward)
    }

    /// A decision that could not be drawn for want of usable input is drawn on the first scan that has it.
    fn draw_belatedly(&mut self, now_ns: u64) {
        let waiting = self.running.filter(|r| !r.drawn.is_verdict() && r.drawn != Outcome::InvalidAction);
        if let Some(running) = waiting.filter(|r| now_ns < r.end_ns)
            && self.unusable(now_ns, &running.action).is_none()
        {
            self.running = Some(Running { begin_ns: running.begin_ns, ..self.draw(now_ns, &running.action) });
        }
    }

    /// Brings everything to the robot frame of now.
    fn come_to(&mut self, now_ns: u64) {
        self.awareness.come_to(now_ns, self.step_share(now_ns));
    }

    /// The share of the running step that has passed.
    fn step_share(&self, now_ns: u64) -> f64 {
        let begin_ns = self.running.map_or(now_ns, |running| running.begin_ns);
        now_ns.saturating_sub(begin_ns) as f64 / self.config.dt_ns as f64
    }

    fn verdict(&mut self, now_ns: u64, cause: PermitCause) -> Permit {
        let mut permit = self.blank(cause);
        permit.outcome = self.judge(now_ns, &mut permit);
        if permit.outcome != Outcome::StepsBack {
            // The handler is told of something else.
            self.backing = Backing::default();
        }
        self.awareness.permit(now_ns, permit.velocity);
        permit
    }

    fn judge(&mut self, now_ns: u64, permit: &mut Permit) -> Outcome {
        let why = match &self.running {
            Some(running) => self.unusable(now_ns, &running.action),
            None => self.awareness.unusable(now_ns),
        };
        if let Some(why) = why {
            return why;
        }
        let mode = match &self.mode {
            Some(mode) if mode.class == ModeClass::Run => mode,
            _ => return Outcome::NotInRun,
        };
        if age_ns(now_ns, mode.header.stamp_ns) > self.config.mode_max_age_ns {
            return Outcome::NotInRun;
        }
        if self.floor.sees_none() {
            return Outcome::NoFloor;
        }
        if self.tilt.is_tilted() {
            return Outcome::CameraTilted;
        }
        let Some(running) = self.running else { return Outcome::NoAction };
        let wanted = if mode.cue.valid { mode.cue.cue.header } else { messages::Header::default() };
        if (running.action.cue_incarnation, running.action.cue_seq) != (wanted.incarnation, wanted.seq) {
            return Outcome::CueMismatch;
        }
        if !mode.allows_policy(running.action.header.incarnation) {
            return Outcome::NoAction;
        }
        if now_ns >= running.end_ns + self.scan_period_ns() {
            return Outcome::ActionEnded;
        }
        match running.drawn {
            Outcome::Granted => match self.judge_remainder(now_ns, &running, permit) {
                Ok(()) => Outcome::Granted,
                Err(judgement) => {
                    self.running = Some(Running { drawn: Outcome::RemainderUnsafe, judgement, ..running });
                    Outcome::RemainderUnsafe
                }
            },
            other => {
                explain(&running.judgement, permit);
                other
            }
        }
    }

    /// What is left of the action and one scan period more; where only the rest itself is free, the permit ends with
    /// it. The judgement of a rest that is not free is an error, and ends the action: a robot that stops and goes on
    /// with each scan stumbles, and the handler walks into it.
    fn judge_remainder(&mut self, now_ns: u64, running: &Running, permit: &mut Permit) -> Result<(), Judgement> {
        let mut last = running.judgement;
        for end_ns in [running.end_ns + self.scan_period_ns(), running.end_ns] {
            if end_ns <= now_ns {
                break;
            }
            let left_s = s_from_ns(end_ns - now_ns);
            let (evidence, handler) = (self.awareness.evidence(now_ns), self.awareness.handler());
            let motion = Shield::remainder(handler, self.awareness.odom_from_robot(), running.velocity, left_s);
            let judgement = self.shield.judge(&motion, evidence, handler);
            explain(&judgement, permit);
            if judgement.safe {
                permit.velocity = running.velocity;
                permit.expiry_ns = self.expiry_ns(now_ns, end_ns);
                return Ok(());
            }
            last = judgement;
        }
        Err(last)
    }

    /// The earliest of stamp + max age of what was judged on, the end of the hull, and the permit's longest life.
    /// Odometry is held to its own age by locomotion, at every tick.
    fn expiry_ns(&self, now_ns: u64, hull_end_ns: u64) -> u64 {
        let AwarenessConfig { scan_max_age_ns, depth_max_age_ns, second_max_age_ns, .. } = self.config.awareness;
        let scan = self.awareness.scan().map_or(0, |scan| scan.stamp_ns.saturating_add(scan_max_age_ns));
        // A frame that was judged on, needed or not.
        let depth = self.awareness.fresh_depth(now_ns);
        let depth = depth.map_or(u64::MAX, |depth| depth.stamp_ns.saturating_add(depth_max_age_ns));
        let second = self.awareness.second_stamp_ns().zip(second_max_age_ns);
        let second = second.map_or(u64::MAX, |(stamp_ns, max_age_ns)| stamp_ns.saturating_add(max_age_ns));
        hull_end_ns.min(scan).min(depth).min(second).min(now_ns + self.config.permit_life_ns)
    }

    fn blank(&self, cause: PermitCause) -> Permit {
        let mode = self.mode.unwrap_or_default();
        let scan = self.awareness.scan().unwrap_or_default();
        let depth = self.awareness.depth().unwrap_or_default();
        let odometry = self.awareness.odometry().map(|odometry| odometry.header).unwrap_or_default();
        let mut permit = Permit {
            cause,
            absent_streams: self.config.absent_streams,
            epoch: mode.epoch,
            odometry_incarnation: odometry.incarnation,
            lidar_incarnation: scan.incarnation,
            scan_seq: scan.seq,
            scan_stamp_ns: scan.stamp_ns,
            depth_seq: depth.seq,
            depth_stamp_ns: depth.stamp_ns,
            odometry_seq: odometry.seq,
            odometry_stamp_ns: odometry.stamp_ns,
            robot_from_handler: pose2(self.awareness.handler().robot_from_handler()),
            ..Permit::default()
        };
        if let Some(running) = &self.running {
            permit.decision = running.action.decision;
            permit.action = running.index as u32;
            permit.unsafe_mask = running.unsafe_mask;
            permit.all_unsafe = running.drawn == Outcome::AllUnsafe;
            permit.action_end_ns = running.end_ns;
            permit.policy_incarnation = running.action.header.incarnation;
            permit.cue_incarnation = running.action.cue_incarnation;
            permit.cue_seq = running.action.cue_seq;
        }
        permit
    }

    /// Adds the shield's figures to its beat.
    pub fn fill_health(&self, health: &mut Health) {
        health.decisions = self.decisions;
        health.missed_decisions = self.missed;
        health.outcomes = self.outcomes;
        health.invalid_inputs = self.invalid_inputs + self.awareness.refused_frames();
        health.pose_jumps = self.jumps;
    }
}

/// Whether the numbers are probabilities that sum to 1.
fn are_probabilities(p: &[f32]) -> bool {
    p.iter().all(|p| p.is_finite() && (0.0..=1.0).contains(p)) && (p.iter().sum::<f32>() - 1.0).abs() < 1e-3
}

#[cfg(test)]
mod tests;
