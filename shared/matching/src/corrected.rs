//! A stream of odometry, corrected: pose for pose, at the stamps of the legs.

use guidance::PoseTrack;
use guidance::se2::{Se2, pose2, se2};
use messages::{NS_PER_S, Odometry, ScanHeader, s_from_ns};
use nalgebra::{UnitComplex, Vector2};

use crate::matcher::{Health, Matcher, MatcherConfig, Refusal};
use crate::uncertainty::{carried, sigma};

/// How corrections come into the stream.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectedConfig {
    /// How scans are matched.
    pub matcher: MatcherConfig,
    /// The published pose is moved towards the matched one by at most so much, metres per second,
    pub feed_mps: f64,
    /// and turned by at most so much, radians per second.
    pub feed_radps: f64,
}

/// Without a scan for so long poses go on by the legs, and a scan of before is too old to be matched, nanoseconds.
const NO_SCAN_NS: u64 = NS_PER_S / 2;

/// Where the matcher is: at a stamp, with the legs' pose then.
#[derive(Debug, Clone, Copy)]
struct Matched {
    stamp_ns: u64,
    leg_from_robot: Se2,
}

/// Leg odometry in, corrected odometry out; scans in between.
#[derive(Debug, Clone)]
pub struct Corrected {
    config: CorrectedConfig,
    legs: PoseTrack,
    newest: Option<(u64, Se2)>,
    matcher: Matcher,
    matched: Option<Matched>,
    /// As far as it is fed in.
    odom_from_leg: Se2,
    waiting: Option<(ScanHeader, Vec<f32>)>,
}

impl Corrected {
    /// Corrects from the first pose on, which is the same in both frames.
    #[must_use]
    pub fn new(config: CorrectedConfig) -> Self {
        let matcher = Matcher::new(config.matcher.clone(), Se2::identity());
        Self {
            config,
            legs: PoseTrack::default(),
            newest: None,
            matcher,
            matched: None,
            odom_from_leg: Se2::identity(),
            waiting: None,
        }
    }

    /// How the matching goes.
    #[must_use]
    pub fn health(&self) -> &Health {
        self.matcher.health()
    }

    /// Where the robot was at the last scan that was matched, or would have been: the correction at its full size.
    #[must_use]
    pub fn matched(&self) -> &Se2 {
        self.matcher.odom_from_robot()
    }

    /// How far the published pose still is from the matched one: metres, radians.
    #[must_use]
    pub fn pending(&self) -> (f64, f64) {
        let pending = self.newest.map_or(Se2::identity(), |(_, leg_from_robot)| self.off(&leg_from_robot));
        (pending.translation.vector.norm(), pending.rotation.angle().abs())
    }

    /// The corrected pose for a pose of the legs, at the same stamp. One that is no pose, or not newer, is left as it
    /// is.
    pub fn take_odometry(&mut self, leg: &Odometry) -> Odometry {
        let (stamp_ns, is_pose) = (leg.header.stamp_ns, leg.odom_from_robot.is_finite() && leg.twist.is_finite());
        if !is_pose || self.newest.is_some_and(|(newest_ns, _)| stamp_ns <= newest_ns) {
            return *leg;
        }
        self.legs.push(leg);
        let leg_from_robot = se2(leg.odom_from_robot);
        let dt_s = self.newest.map_or(0.0, |(newest_ns, _)| s_from_ns(stamp_ns - newest_ns));
        self.newest = Some((stamp_ns, leg_from_robot));
        let matched = *self.matched.get_or_insert_with(|| {
            self.matcher = Matcher::new(self.config.matcher.clone(), leg_from_robot);
            Matched { stamp_ns, leg_from_robot }
        });
        if stamp_ns - matched.stamp_ns > NO_SCAN_NS {
            self.advance(stamp_ns, &leg_from_robot);
        }
        self.feed(&leg_from_robot, dt_s);
        let odom_from_robot = self.odom_from_leg * leg_from_robot;
        Odometry { odom_from_robot: pose2(&odom_from_robot), sigma: self.sigma(&leg_from_robot), ..*leg }
    }

    /// Takes a scan, which is matched by [`Corrected::work`] once the legs have told where the robot was.
    pub fn take_scan(&mut self, header: &ScanHeader, ranges_m: &[f32]) {
        self.waiting = Some((*header, ranges_m.to_vec()));
    }

    /// Matches the scan that waits, where it can be matched by now.
    ///
    /// # Errors
    /// Where the scan corrects nothing.
    pub fn work(&mut self) -> Result<(), Refusal> {
        let (Some(matched), Some((newest_ns, _))) = (self.matched, self.newest) else { return Ok(()) };
        let is_due = |(header, _): &mut (ScanHeader, _)| header.header.stamp_ns <= newest_ns;
        let Some((header, ranges_m)) = self.waiting.take_if(is_due) else { return Ok(()) };
        let stamp_ns = header.header.stamp_ns;
        let Some(leg_from_robot) = self.legs.at(stamp_ns).filter(|_| stamp_ns >= matched.stamp_ns) else {
            return Ok(());
        };
        self.advance(stamp_ns, &leg_from_robot);
        self.matcher.take_scan(&header, &ranges_m)
    }

    fn advance(&mut self, stamp_ns: u64, leg_from_robot: &Se2) {
        let Some(matched) = self.matched.replace(Matched { stamp_ns, leg_from_robot: *leg_from_robot }) else { return };
        self.matcher.advance(&(matched.leg_from_robot.inverse() * leg_from_robot));
    }

    /// Where the matched pose is, seen from the published one.
    fn off(&self, leg_from_robot: &Se2) -> Se2 {
        let Some(matched) = self.matched else { return Se2::identity() };
        let since = matched.leg_from_robot.inverse() * leg_from_robot;
        (self.odom_from_leg * leg_from_robot).inverse() * self.matcher.odom_from_robot() * since
    }

    /// Moves the published pose towards the matched one, as far as `dt_s` allows.
    fn feed(&mut self, leg_from_robot: &Se2, dt_s: f64) {
        let off = self.off(leg_from_robot);
        let (way_m, turn_rad) = (self.config.feed_mps * dt_s, self.config.feed_radps * dt_s);
        let way: Vector2<f64> = off.translation.vector.cap_magnitude(way_m);
        let turn = UnitComplex::new(off.rotation.angle().clamp(-turn_rad, turn_rad));
        let fed = Se2::from_parts(way.into(), turn);
        // Normalised, so that rounding does not pile up over hours.
        self.odom_from_leg = se2(pose2(&(self.odom_from_leg * leg_from_robot * fed * leg_from_robot.inverse())));
    }

    /// Of the published pose: what is known of the matched one, and how far it is from that.
    fn sigma(&self, leg_from_robot: &Se2) -> [f64; 3] {
        let Some(matched) = self.matched else { return [0.0; 3] };
        let since = matched.leg_from_robot.inverse() * leg_from_robot;
        let covariance = carried(self.matcher.covariance(), &since) + self.config.matcher.legs.of(&since);
        let odom_from_robot = self.odom_from_leg * leg_from_robot;
        let [x, y, yaw] = sigma(&covariance, &odom_from_robot);
        let off = self.off(leg_from_robot);
        let pending = odom_from_robot.rotation * off.translation.vector;
        [x.hypot(pending.x), y.hypot(pending.y), yaw.hypot(off.rotation.angle())]
    }
}
