//! The gate itself: pure, without clock and I/O. What it does not know to be allowed is zero.

use guidance::accord::{Accord, Response};
use messages::{
    Cue, EmergencyStop, Formation, Mode, ModeClass, Odometry, Outcome, Permit, ServiceId, StopClass, StopInput,
    StopKind, StopReason, TopicId, Twist2, UnsafeCause, age_ns,
};
use settings::{EstopSource, Settings};

use crate::fall::Fall;

/// What the gate holds a permit against.
#[derive(Debug, Clone, PartialEq)]
pub struct GateLimits {
    /// Longest time from a verdict to its expiry, nanoseconds.
    pub permit_life_ns: u64,
    /// Oldest mode, nanoseconds.
    pub mode_max_age_ns: u64,
    /// Oldest word of the emergency stop, nanoseconds; none where there is no such stop.
    pub estop_max_age_ns: Option<u64>,
    /// Oldest odometry, nanoseconds.
    pub odometry_max_age_ns: u64,
    /// Largest speed over ground, metres per second.
    pub speed_mps: f64,
    /// Largest turn, radians per second.
    pub turn_radps: f64,
    /// The velocity of each action of the run's table, by formation and index: no other is ever permitted.
    pub actions: [Vec<Twist2>; Formation::ALL.len()],
    /// Whether the robot whose odometry comes is the one that is commanded; a recorded one is not.
    pub obeyed: bool,
    /// How a healthy robot answers a command.
    pub response: Response,
    /// Largest planned change of each component of the speed, metres per second squared.
    pub acceleration_mps2: f64,
    /// Largest planned change of the turn, radians per second squared.
    pub acceleration_radps2: f64,
}

impl GateLimits {
    /// The limits of a configuration.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let limits = &settings.locomotion.limits;
        let (table, dt_s) = (settings.policy.actions.table(), settings.policy.dt.s());
        let velocities = |formation| {
            let table = table.slowed(settings.speed_in(formation));
            table.actions().iter().map(|action| action.velocity(dt_s)).collect()
        };
        Self {
            actions: Formation::ALL.map(velocities),
            obeyed: settings.locomotion.link.is_obeyed(),
            response: settings.robot.response.accord(),
            permit_life_ns: settings.locomotion.permit_life.ns(),
            mode_max_age_ns: settings.max_age_ns(TopicId::Mode),
            estop_max_age_ns: (settings.estop.source != EstopSource::Absent)
                .then(|| settings.max_age_ns(TopicId::Estop)),
            odometry_max_age_ns: settings.max_age_ns(TopicId::Odometry),
            speed_mps: limits.speed_mps.get(),
            turn_radps: limits.turn_radps.get(),
            acceleration_mps2: limits.acceleration_mps2.get(),
            acceleration_radps2: limits.acceleration_radps2.get(),
        }
    }
}

/// What the gate allows now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Velocity to head for.
    pub velocity: Twist2,
    /// Why it is zero.
    pub reason: StopReason,
    /// Whether a zero is the planned end of an action, and may be ramped.
    pub planned: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct LineState {
    service: ServiceId,
    incarnation: u32,
    open: bool,
}

/// Permit in, velocity out.
#[derive(Debug)]
pub struct Gate {
    limits: GateLimits,
    mode: Option<Mode>,
    permit: Option<Permit>,
    odometry: Option<(u64, u32)>,
    accord: Accord,
    fall: Fall,
    /// The emergency stop's last word, and its stamp.
    estop: (StopInput, u64),
    /// The place of the stop cue in force among the cues.
    stop_cue: Option<(u64, u32, u64)>,
    /// Motion needs an epoch greater than this.
    latched_epoch: Option<u64>,
    /// Why it is latched.
    latch_reason: StopReason,
    lines: Vec<LineState>,
    /// The epoch in which somebody stopped the robot by its hand remote.
    remote_stop_epoch: Option<u64>,
    /// Whether the run has been locked since.
    remote_stop_locked: bool,
    /// Set by the supervisor's own word or its loss; ends with a greater epoch.
    stopped_by: Option<StopReason>,
}

impl Gate {
    /// A gate that has heard nothing yet, and so stands.
    #[must_use]
    pub fn new(limits: GateLimits) -> Self {
        Self {
            accord: Accord::new(limits.response),
            limits,
            fall: Fall::default(),
            mode: None,
            permit: None,
            odometry: None,
            estop: (StopInput::Unknown, 0),
            stop_cue: None,
            latched_epoch: None,
            latch_reason: StopReason::of(StopKind::Boot),
            lines: Vec::new(),
            remote_stop_epoch: None,
            remote_stop_locked: false,
            stopped_by: None,
        }
    }

    /// The epoch in force.
    #[must_use]
    pub fn epoch(&self) -> u64 {
        self.mode.map_or(0, |mode| mode.epoch)
    }

    /// The last permit taken.
    #[must_use]
    pub fn permit(&self) -> Option<&Permit> {
        self.permit.as_ref()
    }

    /// Run time of the permit's expiry, while it lets the robot move.
    #[must_use]
    pub fn expiry_ns(&self) -> Option<u64> {
        self.permit.filter(|permit| permit.outcome == Outcome::Granted).map(|permit| permit.expiry_ns)
    }

    /// A mode has come. A gate that begins in the middle of a run does not trust the *run* that it finds: it may be the
    /// one in which its predecessor died.
    pub fn take_mode(&mut self, mode: &Mode) {
        if self.mode.is_none() && mode.class == ModeClass::Run {
            self.latch_at(mode.epoch, StopReason::of(StopKind::Boot));
        }
        if let Some(old) = self.mode {
            if !mode.may_follow(&old) {
                return;
            }
            // The epoch before was false: motion needs a greater one than this. A latch beyond the false one is of
            // another kind: for good.
            if mode.epoch < old.epoch && self.latched_epoch.is_none_or(|latched| latched <= old.epoch) {
                self.latched_epoch = Some(mode.epoch);
                self.latch_reason = StopReason::of(StopKind::ModeStale);
            }
        }
        self.mode = Some(*mode);
        // A policy that died is waited for only as long as it is the one named.
        let gone = |line: &LineState| line.service == ServiceId::Policy && !line.open;
        self.lines.retain(|line| !gone(line) || line.incarnation == mode.active_policy);
        if mode.class != ModeClass::Run {
            self.permit = None;
        }
        if mode.class == ModeClass::Run && self.latched_epoch.is_none_or(|latched| mode.epoch > latched) {
            self.latched_epoch = None;
            self.stopped_by = None;
        }
        if mode.cue.valid && self.stop_cue.is_some_and(|stop| mode.cue.cue.header.order() > stop) {
            self.stop_cue = None;
        }
    }

    /// A cue has come: only stop takes effect here, at once.
    pub fn take_cue(&mut self, cue: &Cue) {
        if !cue.kind.is_moving() {
            self.stop_cue = Some(cue.header.order());
        }
    }

    /// The emergency stop's word has come: whether it stops the robot, until the epoch is greater.
    pub fn take_estop(&mut self, stop: &EmergencyStop) -> bool {
        self.estop = (stop.input, stop.header.stamp_ns);
        let stops = stop.input.stops() && self.limits.estop_max_age_ns.is_some();
        if stops {
            self.latch_at(self.epoch(), StopReason::of(StopKind::EmergencyStop));
        }
        stops
    }

    /// That velocity is in force at the robot from now on.
    pub fn commanded(&mut self, now_ns: u64, velocity: Twist2) {
        self.accord.commanded(now_ns, velocity);
    }

    /// Odometry has come. One that contradicts what was commanded stops the robot until the epoch is greater: nobody
    /// knows which of the two lies. One that shows a fallen robot locks the run.
    pub fn take_odometry(&mut self, odometry: &Odometry) {
        let (fell, contradicts) = (self.fall.has_fallen(odometry), self.accord.contradicts(odometry));
        let stops = match (fell, contradicts) {
            (true, _) => Some(StopKind::RobotFell),
            (_, true) => Some(StopKind::OdometryContradicts),
            _ => None,
        };
        if let Some(kind) = stops.filter(|_| self.limits.obeyed)
            && let Some(mode) = self.mode.filter(|mode| mode.class == ModeClass::Run)
        {
            self.latch_at(mode.epoch, StopReason::service(kind, ServiceId::Odometry, odometry.header.incarnation));
        }
        self.odometry = Some((odometry.header.stamp_ns, odometry.header.incarnation));
    }

    /// A verdict has come; it replaces the one before, whatever it says.
    pub fn take_permit(&mut self, permit: &Permit) {
        if let Some(mode) = &self.mode
            && permit.header.incarnation == mode.active_shield
        {
            self.permit = Some(*permit);
        }
    }

    /// A lifeline is watched from now on.
    pub fn line_armed(&mut self, service: ServiceId, incarnation: u32) {
        // Two policies live side by side while one is swapped for the other.
        let beside = |line: &LineState| service == ServiceId::Policy && line.open && line.incarnation != incarnation;
        self.lines.retain(|line| line.service != service || line.incarnation > incarnation || beside(line));
        self.lines.push(LineState { service, incarnation, open: true });
    }

    /// A lifeline closed: whether that stops the robot. It then stands until the service is back and the epoch is
    /// greater; a policy that is not the active one stops nothing, but its permits are worth nothing from then on.
    pub fn line_closed(&mut self, service: ServiceId, incarnation: u32) -> bool {
        if service == ServiceId::Policy
            && self.mode.is_some_and(|mode| mode.active_policy != 0 && mode.active_policy != incarnation)
        {
            self.lines.retain(|line| line.service != service || line.incarnation != incarnation);
            return false;
        }
        for line in &mut self.lines {
            if line.service == service && line.incarnation == incarnation {
                line.open = false;
            }
        }
        if let Some(mode) = self.mode.filter(|mode| mode.class == ModeClass::Run) {
            self.latch_at(mode.epoch, StopReason::service(StopKind::LifelineClosed, service, incarnation));
        }
        self.permit = None;
        true
    }

    /// Stands until a run of the epoch that the stop began, or of a later one: for a reason that no topic brought.
    pub fn stop_by(&mut self, reason: StopReason, epoch: u64) {
        let over = self.mode.is_some_and(|mode| mode.class == ModeClass::Run && mode.epoch >= epoch);
        if over {
            // The word was overtaken: the operator has resumed since, and a cue was accepted.
            return;
        }
        self.stopped_by = Some(reason);
        self.permit = None;
        // The run that a cue begins after a fault has the fault's own epoch.
        self.latch_at(epoch.saturating_sub(1), reason);
    }

    /// Somebody has stopped the robot itself: it stands until that is resumed, in whatever mode.
    pub fn stopped_by_remote(&mut self) {
        let reason = StopReason::of(StopKind::RemoteStop);
        self.remote_stop_epoch.get_or_insert(self.epoch());
        self.latch_at(self.epoch(), reason);
    }

    /// Whether the operator has resumed since: the run was locked, is so no more, and its epoch is greater than that of
    /// the stop. A fault of another reason, whose epoch is greater as well, ends no stop. True once, after which the
    /// stop is over.
    pub fn may_forget_remote_stop(&mut self) -> bool {
        let (Some(mode), Some(since)) = (self.mode, self.remote_stop_epoch) else { return false };
        let is_lock = mode.class == ModeClass::Lock;
        self.remote_stop_locked |= is_lock;
        let over = self.remote_stop_locked && !is_lock && mode.epoch > since;
        if over {
            (self.remote_stop_epoch, self.remote_stop_locked) = (None, false);
        }
        over
    }

    fn latch_at(&mut self, epoch: u64, reason: StopReason) {
        debug_assert!(reason.kind.info().is_none_or(|stop| stop.class != StopClass::Hold), "{reason} ends by itself");
        if self.latched_epoch.is_none_or(|latched| epoch > latched) {
            self.latched_epoch = Some(epoch);
            self.latch_reason = reason;
        }
    }

    /// What is allowed at `now_ns` of run time.
    pub fn judge(&mut self, now_ns: u64) -> Verdict {
        match self.check(now_ns) {
            Ok(velocity) => Verdict { velocity, reason: StopReason::default(), planned: false },
            Err((reason, planned)) => {
                // The row of a reason says whether it ends by itself. A lifeline is latched as it closes: found closed
                // in a later run, it waits for the new one alone.
                let latches = reason.kind.is_latched() && reason.kind != StopKind::LifelineClosed;
                if let Some(mode) = self.mode.filter(|mode| latches && mode.class == ModeClass::Run) {
                    self.latch_at(mode.epoch, reason);
                }
                Verdict { velocity: Twist2::ZERO, reason, planned }
            }
        }
    }

    fn check(&self, now_ns: u64) -> Result<Twist2, (StopReason, bool)> {
        let sudden = |reason| Err((reason, false));
        if let Some(reason) = self.stopped_by {
            return sudden(reason);
        }
        let Some(mode) = self.mode else { return sudden(StopReason::of(StopKind::Boot)) };
        let age = age_ns(now_ns, mode.header.stamp_ns);
        if age > self.limits.mode_max_age_ns {
            return sudden(StopReason::stream(StopKind::ModeStale, TopicId::Mode, age, self.limits.mode_max_age_ns));
        }
        if mode.class != ModeClass::Run {
            return sudden(mode.reason);
        }
        if self.latched_epoch.is_some() {
            return sudden(self.latch_reason);
        }
        if let Some(line) = self.lines.iter().find(|line| !line.open) {
            return sudden(StopReason::service(StopKind::LifelineClosed, line.service, line.incarnation));
        }
        if let Some(reason) = self.estop_forbids(now_ns) {
            return sudden(reason);
        }
        if self.stop_cue.is_some() {
            return sudden(StopReason::of(StopKind::StopCue));
        }
        if !mode.cue.valid {
            return sudden(StopReason::of(StopKind::NoCue));
        }
        self.check_permit(now_ns, &mode)
    }

    /// Without a fresh word that it is released, nothing moves.
    fn estop_forbids(&self, now_ns: u64) -> Option<StopReason> {
        let limit_ns = self.limits.estop_max_age_ns?;
        let (input, stamp_ns) = self.estop;
        if input != StopInput::Released {
            return Some(StopReason { topic: TopicId::Estop, ..StopReason::of(StopKind::InputUnusable) });
        }
        let age = age_ns(now_ns, stamp_ns);
        (age > limit_ns).then(|| StopReason::stream(StopKind::InputUnusable, TopicId::Estop, age, limit_ns))
    }

    fn check_permit(&self, now_ns: u64, mode: &Mode) -> Result<Twist2, (StopReason, bool)> {
        let sudden = |kind| Err((StopReason::of(kind), false));
        let unusable = |topic| Err((StopReason { topic, ..StopReason::of(StopKind::InputUnusable) }, false));
        let stuck = |topic| Err((StopReason { topic, ..StopReason::of(StopKind::StreamStuck) }, false));
        let Some(permit) = self.permit else { return sudden(StopKind::NoPermit) };
        // The shield that gave it must be the one whose line is watched here.
        if !self.has_open_line(ServiceId::Shield, permit.header.incarnation) {
            return sudden(StopKind::NoPermit);
        }
        if permit.epoch != mode.epoch
            || !mode.allows_policy(permit.policy_incarnation)
            || !self.has_open_line(ServiceId::Policy, permit.policy_incarnation)
            || !self.has_open_line(ServiceId::Policy, mode.active_policy)
            || (permit.cue_incarnation, permit.cue_seq) != (mode.cue.cue.header.incarnation, mode.cue.cue.header.seq)
        {
            return sudden(StopKind::NoPermit);
        }
        match permit.outcome {
            Outcome::Granted => {}
            Outcome::ActionEnded => return unusable(TopicId::PolicyAction),
            Outcome::Stop => return Err((StopReason::of(StopKind::PolicyStop), true)),
            Outcome::Narrow => return Err((StopReason::of(StopKind::Narrow), true)),
            Outcome::Wide => return Err((StopReason::of(StopKind::Wide), true)),
            Outcome::StepsBack => return Err((StopReason::of(StopKind::StepBack), true)),
            // Where to stop is free it may be gentle.
            Outcome::AllUnsafe => return Err((unsafe_reason(&permit), permit.unsafe_mask & 1 == 0)),
            Outcome::RemainderUnsafe => return Err((unsafe_reason(&permit), false)),
            Outcome::HandlerNotSeen => return sudden(StopKind::HandlerNotSeen),
            Outcome::NoAction | Outcome::NotInRun | Outcome::CueMismatch => return sudden(StopKind::NoPermit),
            Outcome::InvalidScan | Outcome::StaleScan => return unusable(TopicId::LidarScan),
            Outcome::StaleOdometry => return unusable(TopicId::Odometry),
            Outcome::StaleDepth => return unusable(TopicId::DepthFrame),
            Outcome::StaleSecondScan => return unusable(TopicId::SecondScan),
            Outcome::StuckScan => return stuck(TopicId::LidarScan),
            Outcome::StuckDepth => return stuck(TopicId::DepthFrame),
            Outcome::ScanContradicts => {
                return Err((
                    StopReason { topic: TopicId::LidarScan, ..StopReason::of(StopKind::ScanContradicts) },
                    false,
                ));
            }
            Outcome::NoFloor => return sudden(StopKind::NoFloor),
            Outcome::CameraTilted => return sudden(StopKind::CameraTilted),
            Outcome::InvalidAction => return unusable(TopicId::PolicyAction),
        }
        if now_ns > permit.expiry_ns {
            let age = now_ns - permit.header.stamp_ns.min(now_ns);
            let limit = permit.expiry_ns.saturating_sub(permit.header.stamp_ns);
            return Err((StopReason::stream(StopKind::PermitExpired, TopicId::ShieldPermit, age, limit), false));
        }
        let velocity = permit.velocity;
        let lives_too_long = permit.expiry_ns > permit.header.stamp_ns.saturating_add(self.limits.permit_life_ns);
        if lives_too_long
            || permit.header.stamp_ns > now_ns
            || !velocity.is_finite()
            || velocity.speed_mps() > self.limits.speed_mps
            || velocity.wz_radps.abs() > self.limits.turn_radps
            || self.limits.actions[mode.formation as usize].get(permit.action as usize) != Some(&velocity)
        {
            return sudden(StopKind::PermitInvalid);
        }
        let (odometry_ns, odometry_incarnation) = self.odometry.unwrap_or((0, 0));
        let age = age_ns(now_ns, odometry_ns);
        if age > self.limits.odometry_max_age_ns || odometry_incarnation != permit.odometry_incarnation {
            let limit = self.limits.odometry_max_age_ns;
            return Err((StopReason::stream(StopKind::OdometryStale, TopicId::Odometry, age, limit), false));
        }
        Ok(velocity)
    }

    fn has_open_line(&self, service: ServiceId, incarnation: u32) -> bool {
        self.lines.iter().any(|line| line.open && line.service == service && line.incarnation == incarnation)
    }

    /// The velocity on the way from `from` to `to` after `dt_s` of planned change.
    #[must_use]
    pub fn ramp(&self, from: Twist2, to: Twist2, dt_s: f64) -> Twist2 {
        let linear = self.limits.acceleration_mps2 * dt_s;
        let turn = self.limits.acceleration_radps2 * dt_s;
        let towards = |from: f64, to: f64, most: f64| from + (to - from).clamp(-most, most);
        Twist2 {
            vx_mps: towards(from.vx_mps, to.vx_mps, linear),
            vy_mps: towards(from.vy_mps, to.vy_mps, linear),
            wz_radps: towards(from.wz_radps, to.wz_radps, turn),
        }
    }
}

/// Why a permit allows no motion that the shield forbade: where the floor is the cause, it is told where.
fn unsafe_reason(permit: &Permit) -> StopReason {
    let floor = |kind| {
        let at_m = [permit.place_x_m, permit.place_y_m];
        StopReason::floor(kind, at_m, permit.reading_m, permit.threshold_m).step(permit.step_m)
    };
    match (permit.unsafe_cause, permit.outcome) {
        (UnsafeCause::DropOff, _) => floor(StopKind::DropOff),
        (UnsafeCause::FloorUnseen, _) => floor(StopKind::FloorUnseen),
        (UnsafeCause::StepUp, _) => floor(StopKind::StepUp),
        (UnsafeCause::LowStepDown, _) => floor(StopKind::LowStepDown),
        (UnsafeCause::LowStepUp, _) => floor(StopKind::LowStepUp),
        (_, Outcome::AllUnsafe) => StopReason::of(StopKind::AllUnsafe),
        _ => StopReason::of(StopKind::RemainderUnsafe),
    }
}

#[cfg(test)]
mod tests;
