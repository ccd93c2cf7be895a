//! What is known of the surroundings when something is judged: the newest scan and depth frame, what was seen before,
//! where the robot is, how it moves, and where the handler is. The shield, the policy and episodes know it by this one
//! sequence of steps, so that training and evaluation judge by what judges on the robot.

mod moving;
mod plausible;
mod surroundings;

use messages::{DepthHeader, Header, NS_PER_S, Odometry, Outcome, ScanHeader, SecondScanHeader, Twist2, age_ns};

use crate::contact::comes_about;
use crate::handler::{Company, HandlerBody, HandlerEstimate, HandlerLimits, Nobody};
use crate::interaction::InteractionModel;
use crate::memory::MemoryConfig;
use crate::se2::{Point, Se2, se2};
use crate::shield::Evidence;
use crate::track::{Pace, PoseTrack};
use moving::Moving;
use surroundings::Surroundings;

/// After a jump the poses must go on without one for this long.
const JUMP_HOLD_NS: u64 = NS_PER_S / 2;

/// A robot that was placed so shortly before has not been carried away, nanoseconds.
const ANCHORED_NS: u64 = 10 * NS_PER_S;

/// What measurements are held to.
#[derive(Debug, Clone, PartialEq)]
pub struct AwarenessConfig {
    /// What is known of the handler's body.
    pub limits: HandlerLimits,
    /// What is remembered; none: one scan and one frame decide alone.
    pub memory: Option<MemoryConfig>,
    /// How fast the robot can be: a pose that is farther off is a jump.
    pub pace: Pace,
    /// Without a scan for longer, the handler's estimate is worth nothing, nanoseconds.
    pub scan_gap_ns: u64,
    /// The oldest scan that is judged on, nanoseconds.
    pub scan_max_age_ns: u64,
    /// The oldest depth frame that is judged on, nanoseconds.
    pub depth_max_age_ns: u64,
    /// The oldest scan of the second lidar that is judged on, nanoseconds. None: there is no second lidar.
    pub second_max_age_ns: Option<u64>,
    /// The oldest pose that is judged on, nanoseconds.
    pub odometry_max_age_ns: u64,
    /// The least depth that the camera sees, metres.
    pub depth_min_m: f64,
    /// Whether nothing is judged without a depth frame.
    pub depth_needed: bool,
}

/// What a pose was in relation to the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pose {
    /// No pose at all: it was not taken.
    Unusable,
    /// The first one of an odometry frame: nothing that was placed before has a place in it.
    First,
    /// Farther off than the robot can walk: nothing that was placed before holds any more.
    Jump,
    /// On the way from the one before.
    Next,
}

/// See the module. `H` is who walks with the robot: a handler, or [`Nobody`].
#[derive(Debug, Clone)]
pub struct Awareness<H = HandlerEstimate> {
    config: AwarenessConfig,
    surroundings: Surroundings,
    handler: H,
    odometry: Option<Odometry>,
    track: PoseTrack,
    /// Where the robot is now.
    odom_from_robot: Se2,
    jumped_at_ns: Option<u64>,
    scan_period_ns: Option<u64>,
    moving: Moving,
}

impl Awareness {
    /// Nothing is known yet; the handler follows by that model.
    #[must_use]
    pub fn new(model: InteractionModel, config: AwarenessConfig) -> Self {
        Self::with(HandlerEstimate::new(model, config.limits.clone()), config)
    }

    /// The handler walks where `model` says from now on. They count as lost until they are seen there.
    pub fn take_place(&mut self, model: &InteractionModel) {
        self.handler.take_place(model);
    }

    /// Where the handler is taken to be.
    #[must_use]
    pub fn handler(&self) -> &HandlerEstimate {
        &self.handler
    }

    /// The room that the handler takes.
    #[must_use]
    pub fn body(&self) -> HandlerBody {
        self.handler.body(self.surroundings.beams().sigma_m())
    }
}

impl Awareness<Nobody> {
    /// Nothing is known yet; the robot walks without a handler.
    #[must_use]
    pub fn alone(config: AwarenessConfig) -> Self {
        Self::with(Nobody, config)
    }
}

impl<H: Company> Awareness<H> {
    fn with(handler: H, config: AwarenessConfig) -> Self {
        Self {
            surroundings: Surroundings::new(config.memory.clone(), config.depth_max_age_ns, config.depth_min_m),
            handler,
            odometry: None,
            track: PoseTrack::default(),
            odom_from_robot: Se2::identity(),
            jumped_at_ns: None,
            scan_period_ns: None,
            moving: Moving::default(),
            config,
        }
    }

    /// The newest pose. The first of a frame, and a jump, void the handler's estimate and what is remembered.
    pub fn take_odometry(&mut self, odometry: &Odometry) -> Pose {
        if !odometry.is_usable() {
            return Pose::Unusable;
        }
        let pose = match &self.odometry {
            Some(old) if old.header.incarnation == odometry.header.incarnation => {
                if self.config.pace.is_exceeded(old, odometry) { Pose::Jump } else { Pose::Next }
            }
            _ => Pose::First,
        };
        self.odom_from_robot = se2(odometry.odom_from_robot);
        if pose == Pose::Jump {
            self.jumped_at_ns = Some(odometry.header.stamp_ns);
        }
        if pose != Pose::Next {
            self.track.clear();
            self.handler.reset(&self.odom_from_robot);
            let was_placed = |old: &Odometry| age_ns(odometry.header.stamp_ns, old.header.stamp_ns) <= ANCHORED_NS;
            let is_near = self.odometry.as_ref().is_some_and(was_placed);
            self.surroundings.lose_place(Some(&self.odom_from_robot).filter(|_| is_near));
        }
        self.odometry = Some(*odometry);
        self.track.push(odometry);
        self.surroundings.look_late(odometry.header.stamp_ns, &self.track);
        pose
    }

    /// The newest depth frame. Where a source tells attitudes it waits for the one after its stamp, 50 ms at most. One
    /// that cannot be used says nothing.
    pub fn take_depth(&mut self, header: &DepthHeader, pixels_mm: &[u16]) {
        self.surroundings.take_depth(header, pixels_mm, &self.track);
    }

    /// The newest scan of the second lidar. One that cannot be used says nothing.
    pub fn take_second(&mut self, header: &SecondScanHeader, ranges_m: &[f32]) {
        let body = self.handler.room(self.surroundings.beams().sigma_m());
        self.surroundings.take_second(header, ranges_m, &self.track, body.as_ref());
    }

    /// The newest depth frame waits no longer.
    pub fn look_at_once(&mut self) {
        self.surroundings.look_at_once(&self.track);
    }

    /// Depth frames so far that could not be used.
    #[must_use]
    pub fn refused_frames(&self) -> u64 {
        self.surroundings.refused_frames()
    }

    /// The newest scan: whether it can be used. A share of the running step has passed; where the scan is fresh and
    /// plausible it corrects the handler's estimate and is remembered.
    pub fn take_scan(&mut self, now_ns: u64, step_share: f64, header: &ScanHeader, ranges_m: &[f32]) -> bool {
        if let Some(last) = self.scan() {
            let period_ns = header.header.stamp_ns.saturating_sub(last.stamp_ns);
            if period_ns > self.config.scan_gap_ns || header.header.incarnation != last.incarnation {
                self.handler.reset(&self.odom_from_robot);
            } else {
                self.scan_period_ns = Some(period_ns);
            }
        }
        let is_usable = self.surroundings.take_scan(header, ranges_m, &self.track);
        self.come_to(now_ns, step_share);
        let is_fresh = age_ns(now_ns, header.header.stamp_ns) <= self.config.scan_max_age_ns;
        let is_plausible = self.surroundings.implausible_scan().is_none();
        if is_fresh && is_plausible && self.surroundings.usable_scan().is_some() {
            self.handler.look(self.surroundings.beams(), now_ns);
            let body = self.handler.room(self.surroundings.beams().sigma_m());
            self.surroundings.remember(now_ns, header.header.stamp_ns, &self.odom_from_robot, body.as_ref());
        }
        is_usable
    }

    /// Brings everything to the robot frame of now: scan and frame were taken a while ago, and the robot has moved on.
    /// A share of the running step has passed.
    pub fn come_to(&mut self, now_ns: u64, step_share: f64) {
        if let Some(now) = self.track.at(now_ns) {
            self.odom_from_robot = now;
        }
        self.surroundings.look_late(now_ns, &self.track);
        self.surroundings.move_to(now_ns, &self.odom_from_robot, &self.track);
        self.handler.predict(&self.odom_from_robot, step_share);
    }

    /// A decision begins.
    pub fn begin_step(&mut self) {
        self.handler.begin_step(&self.odom_from_robot);
    }

    /// Robot and handler stand at rest here: nothing carries them on, and the handler is at the default place.
    pub fn rest(&mut self) {
        self.moving = Moving::default();
        self.handler.rest(&self.odom_from_robot);
    }

    /// From now on the robot may move so (robot frame).
    pub fn permit(&mut self, now_ns: u64, velocity: Twist2) {
        self.moving.permit(now_ns, velocity);
    }

    /// The robot was to move by `begin_from_end` from where it was, and did not get there.
    pub fn feel(&mut self, odom_from_begin: &Se2, begin_from_end: &Se2) {
        self.surroundings.feel(odom_from_begin, begin_from_end);
    }

    /// The handler allows the low step at a place (odometry frame).
    pub fn allow_step(&mut self, place: Point) {
        self.surroundings.allow_step(place);
    }

    /// The handler allows no low step any more.
    pub fn allow_no_step(&mut self) {
        self.surroundings.allow_no_step();
    }

    /// The robot was to move by `begin_from_end` from where it was; where it is now shows whether it did.
    pub fn moved(&mut self, odom_from_begin: &Se2, begin_from_end: &Se2) {
        if !comes_about(begin_from_end, &(odom_from_begin.inverse() * self.odom_from_robot)) {
            self.feel(odom_from_begin, begin_from_end);
        }
    }

    /// Why nothing can be judged now, if so.
    #[must_use]
    pub fn unusable(&self, now_ns: u64) -> Option<Outcome> {
        if self.surroundings.attitude_is_missing() {
            return Some(Outcome::StaleOdometry);
        }
        let Some(scan) = self.surroundings.usable_scan() else { return Some(Outcome::InvalidScan) };
        if age_ns(now_ns, scan.stamp_ns) > self.config.scan_max_age_ns {
            return Some(Outcome::StaleScan);
        }
        let Some(odometry) = &self.odometry else { return Some(Outcome::StaleOdometry) };
        let has_jumped = self.jumped_at_ns.is_some_and(|at_ns| odometry.header.stamp_ns < at_ns + JUMP_HOLD_NS);
        if age_ns(now_ns, odometry.header.stamp_ns) > self.config.odometry_max_age_ns || has_jumped {
            return Some(Outcome::StaleOdometry);
        }
        if let Some(why) = self.surroundings.implausible_scan() {
            return Some(why);
        }
        let is_fresh = |max_age_ns| {
            let second = self.surroundings.second();
            second.is_some_and(|second| age_ns(now_ns, second.stamp_ns) <= max_age_ns)
        };
        if self.config.second_max_age_ns.is_some_and(|max_age_ns| !is_fresh(max_age_ns)) {
            return Some(Outcome::StaleSecondScan);
        }
        if self.config.depth_needed && !self.surroundings.depth_is_fresh(now_ns) {
            let is_stuck = self.surroundings.depth_is_stuck();
            return Some(if is_stuck { Outcome::StuckDepth } else { Outcome::StaleDepth });
        }
        self.handler.is_lost().then_some(Outcome::HandlerNotSeen)
    }

    /// The stamp of the second lidar's newest scan, nanoseconds, where it may be judged on.
    #[must_use]
    pub fn second_stamp_ns(&self) -> Option<u64> {
        self.surroundings.second().map(|header| header.stamp_ns)
    }

    /// What is judged on now.
    #[must_use]
    pub fn evidence(&self, now_ns: u64) -> Evidence<'_> {
        self.surroundings.evidence(now_ns, self.moves(now_ns))
    }

    /// How the robot moves, by its permits or by its odometry: on each axis whichever is faster. A robot may be slow to
    /// stop, or be pushed.
    fn moves(&self, now_ns: u64) -> Twist2 {
        let permitted = self.moving.at(now_ns);
        let told = self.odometry.map_or(Twist2::ZERO, |odometry| odometry.twist);
        let faster = |a: f64, b: f64| if b.abs() > a.abs() { b } else { a };
        Twist2 {
            vx_mps: faster(permitted.vx_mps, told.vx_mps),
            vy_mps: faster(permitted.vy_mps, told.vy_mps),
            wz_radps: faster(permitted.wz_radps, told.wz_radps),
        }
    }

    /// The newest pose.
    #[must_use]
    pub fn odometry(&self) -> Option<&Odometry> {
        self.odometry.as_ref()
    }

    /// Where the robot is now.
    #[must_use]
    pub fn odom_from_robot(&self) -> &Se2 {
        &self.odom_from_robot
    }

    /// The newest scan's header, usable or not.
    #[must_use]
    pub fn scan(&self) -> Option<Header> {
        self.surroundings.scan()
    }

    /// The time between the last two scans without a gap between them, nanoseconds.
    #[must_use]
    pub fn scan_period_ns(&self) -> Option<u64> {
        self.scan_period_ns
    }

    /// The newest scan's header, where it can be used and is fresh.
    #[must_use]
    pub fn fresh_scan(&self, now_ns: u64) -> Option<Header> {
        let is_fresh = |scan: &Header| age_ns(now_ns, scan.stamp_ns) <= self.config.scan_max_age_ns;
        self.surroundings.usable_scan().filter(is_fresh)
    }

    /// The newest depth frame's header, usable or not.
    #[must_use]
    pub fn depth(&self) -> Option<Header> {
        self.surroundings.depth()
    }

    /// The newest depth frame's header, where it is judged on.
    #[must_use]
    pub fn fresh_depth(&self, now_ns: u64) -> Option<Header> {
        self.depth().filter(|_| self.surroundings.depth_is_fresh(now_ns))
    }

    /// The ranges of the newest scan as a lidar over the level floor would have told them, metres; those that it told
    /// where the body was level.
    #[must_use]
    pub fn level_ranges_m<'a>(&'a self, told_m: &'a [f32]) -> &'a [f32] {
        self.surroundings.level_ranges_m().unwrap_or(told_m)
    }
}
