//! Where the robot was a moment ago, so that what was measured then is judged from where the robot is now.

use std::collections::VecDeque;

use messages::{Attitude, NS_PER_S, Odometry, s_from_ns};

use crate::se2::{Se2, exp, log, se2};
use crate::tilt::{Tilt, between};

/// Poses are kept for this long: longer than any input may be old.
const KEPT_NS: u64 = 2 * NS_PER_S;
/// The robot is taken to move on with its last velocity for at most this long, seconds.
const AHEAD_MAX_S: f64 = 0.2;

/// An attitude is extrapolated by at most this, from two that are at least this far apart.
const SWAY_NS: u64 = NS_PER_S / 50;
/// The attitude is unknown this long after the last one, and between two that are farther apart.
const HELD_MAX_NS: u64 = NS_PER_S / 10;
/// The most attitudes that are kept: at 500 Hz.
const ATTITUDES_MAX: usize = 1024;

/// A pose may be off by this much beyond what the robot can walk, metres.
const JUMP_M: f64 = 0.30;
/// And its yaw by this much, radians.
const JUMP_RAD: f64 = 0.60;
/// Lower bounds of both limits: a robot may be carried this fast, m/s and rad/s.
const CARRIED: (f64, f64) = (2.0, 2.5);

/// How fast a robot can walk and turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    speed_mps: f64,
    turn_radps: f64,
}

impl Pace {
    /// That of a robot that is commanded no more than this.
    #[must_use]
    pub fn of_limits(speed_mps: f64, turn_radps: f64) -> Self {
        Self { speed_mps: speed_mps.max(CARRIED.0), turn_radps: turn_radps.max(CARRIED.1) }
    }

    /// Whether the second pose is out of reach from the first: a jump, which voids everything placed before it.
    #[must_use]
    pub fn is_exceeded(&self, from: &Odometry, to: &Odometry) -> bool {
        let dt_s = s_from_ns(to.header.stamp_ns.saturating_sub(from.header.stamp_ns));
        let moved = se2(from.odom_from_robot).inverse() * se2(to.odom_from_robot);
        moved.translation.vector.norm() > self.speed_mps * dt_s + JUMP_M
            || moved.rotation.angle().abs() > self.turn_radps * dt_s + JUMP_RAD
    }
}

/// How a body is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Held {
    /// Level, for all that is known.
    Level,
    /// As a source tells.
    Tilted(Tilt),
}

impl Held {
    /// The tilt, where a source tells it.
    #[must_use]
    pub fn tilt(&self) -> Option<&Tilt> {
        match self {
            Self::Level => None,
            Self::Tilted(tilt) => Some(tilt),
        }
    }
}

/// The last poses of one odometry frame, the oldest first.
#[derive(Debug, Clone, Default)]
pub struct PoseTrack {
    poses: VecDeque<(u64, Se2)>,
    /// How the body was held, where a source tells it.
    attitudes: VecDeque<Attitude>,
    /// Whether a source tells any.
    tells_attitude: bool,
    newest: Option<Odometry>,
}

impl PoseTrack {
    /// Forgets everything: a new frame, or a jump within one.
    pub fn clear(&mut self) {
        self.poses.clear();
        self.attitudes.clear();
        self.tells_attitude = false;
        self.newest = None;
    }

    /// Takes a pose. One that is not newer than the last is not taken.
    pub fn push(&mut self, odometry: &Odometry) {
        let stamp_ns = odometry.header.stamp_ns;
        if self.newest.is_some_and(|newest| stamp_ns <= newest.header.stamp_ns) {
            return;
        }
        self.poses.push_back((stamp_ns, se2(odometry.odom_from_robot)));
        self.newest = Some(*odometry);
        while self.poses.front().is_some_and(|(at_ns, _)| at_ns.saturating_add(KEPT_NS) < stamp_ns) {
            self.poses.pop_front();
        }
        self.push_attitude(odometry.attitude, stamp_ns);
    }

    /// Takes an attitude whose stamp is close to the pose's. Any other only shows that a source exists.
    fn push_attitude(&mut self, attitude: Attitude, pose_ns: u64) {
        self.tells_attitude |= attitude.is_known();
        while self.attitudes.front().is_some_and(|at| at.stamp_ns.saturating_add(KEPT_NS) < pose_ns) {
            self.attitudes.pop_front();
        }
        let is_of_now =
            attitude.is_known() && attitude.is_usable() && attitude.stamp_ns.abs_diff(pose_ns) <= HELD_MAX_NS;
        let is_newer = self.attitudes.back().is_none_or(|last| attitude.stamp_ns > last.stamp_ns);
        if is_of_now && is_newer && self.attitudes.len() < ATTITUDES_MAX {
            self.attitudes.push_back(attitude);
        }
    }

    /// Whether a source tells attitudes, and the one at that time or after it has still to come.
    #[must_use]
    pub fn awaits_attitude(&self, time_ns: u64) -> bool {
        self.tells_attitude && self.attitudes.back().is_none_or(|newest| newest.stamp_ns < time_ns)
    }

    /// How the body was held at a time: level where no source tells it, `None` where one does, but not of that time.
    #[must_use]
    pub fn held_at(&self, time_ns: u64) -> Option<Held> {
        if !self.tells_attitude {
            return Some(Held::Level);
        }
        let newest = self.attitudes.back()?;
        let tilted = |attitude: &Attitude| Tilt::of(attitude).filter(|_| attitude.is_usable()).map(Held::Tilted);
        if time_ns >= newest.stamp_ns {
            let ahead_ns = time_ns - newest.stamp_ns;
            return tilted(&self.swaying_on(newest, ahead_ns)).filter(|_| ahead_ns <= HELD_MAX_NS);
        }
        let next = self.attitudes.partition_point(|at| at.stamp_ns <= time_ns);
        let (before, after) = (self.attitudes.get(next.checked_sub(1)?)?, self.attitudes.get(next)?);
        let apart_ns = after.stamp_ns - before.stamp_ns;
        let share = (time_ns - before.stamp_ns) as f64 / apart_ns as f64;
        tilted(&between(before, after, share)).filter(|_| apart_ns <= HELD_MAX_NS)
    }

    /// Extrapolates the newest attitude. Two attitudes that came at nearly the same time give no usable rate.
    fn swaying_on(&self, newest: &Attitude, ahead_ns: u64) -> Attitude {
        let is_enough = |before: &&Attitude| newest.stamp_ns - before.stamp_ns >= SWAY_NS;
        let Some(before) = self.attitudes.iter().rev().find(is_enough) else { return *newest };
        let apart_ns = newest.stamp_ns - before.stamp_ns;
        if apart_ns > HELD_MAX_NS {
            return *newest;
        }
        between(before, newest, 1.0 + ahead_ns.min(SWAY_NS) as f64 / apart_ns as f64)
    }

    /// `odom_from_robot` at a time: between two poses on the way from one to the other, after the last one on with its
    /// velocity. `None` before the first one.
    #[must_use]
    pub fn at(&self, time_ns: u64) -> Option<Se2> {
        let newest = self.newest.as_ref()?;
        if time_ns >= newest.header.stamp_ns {
            let ahead_s = s_from_ns(time_ns - newest.header.stamp_ns).min(AHEAD_MAX_S);
            return Some(se2(newest.odom_from_robot) * exp(newest.twist, ahead_s));
        }
        let next = self.poses.partition_point(|(at_ns, _)| *at_ns <= time_ns);
        let (before_ns, before) = *self.poses.get(next.checked_sub(1)?)?;
        let (after_ns, after) = *self.poses.get(next)?;
        let share = (time_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
        Some(before * exp(log(&(before.inverse() * after), 1.0), share))
    }
}

#[cfg(test)]
mod tests {
    use super::{Held, PoseTrack};
    use crate::se2::pose2;
    use messages::{Attitude, Header, Odometry, Pose2, Twist2};

    const MS: u64 = 1_000_000;

    fn track() -> PoseTrack {
        let mut track = PoseTrack::default();
        for i in 0..5u64 {
            track.push(&Odometry {
                header: Header { stamp_ns: (1000 + 20 * i) * MS, ..Header::default() },
                odom_from_robot: Pose2::new(0.01 * i as f64, 0.0, 0.1 * i as f64),
                twist: Twist2 { vx_mps: 0.5, ..Twist2::ZERO },
                ..Odometry::default()
            });
        }
        track
    }

    #[test]
    fn between_two_poses_the_robot_is_on_the_way() {
        let at = pose2(&track().at(1050 * MS).expect("known"));
        assert!((at.x_m - 0.025).abs() < 1e-3 && (at.yaw_rad - 0.25).abs() < 1e-9);
    }

    #[test]
    fn after_the_last_pose_it_goes_on_and_before_the_first_nothing_is_known() {
        let at = pose2(&track().at(1100 * MS).expect("known"));
        let ahead = ((at.x_m - 0.04).powi(2) + at.y_m.powi(2)).sqrt();
        assert!((ahead - 0.01).abs() < 1e-9, "20 ms at 0.5 m/s");
        assert!(track().at(999 * MS).is_none());
        assert!(PoseTrack::default().at(0).is_none());
    }

    #[test]
    fn a_pose_that_is_not_newer_is_not_taken() {
        let mut track = track();
        let old = Odometry { odom_from_robot: Pose2::new(9.0, 0.0, 0.0), ..Odometry::default() };
        track.push(&old);
        assert!(track.at(1080 * MS).is_some_and(|pose| pose.translation.x < 1.0));
    }

    #[test]
    fn an_attitude_is_that_of_the_time_or_none() {
        let mut track = PoseTrack::default();
        assert_eq!(track.held_at(0), Some(Held::Level), "no source tells any");
        for i in 0..5u64 {
            let stamp_ns = (1000 + 20 * i) * MS;
            let attitude = Attitude { stamp_ns, pitch_rad: 0.01 * i as f64, ..Attitude::default() };
            let header = Header { stamp_ns, ..Header::default() };
            track.push(&Odometry { header, attitude, ..Odometry::default() });
        }
        let pitch_rad = |ms: u64| match track.held_at(ms * MS) {
            Some(Held::Tilted(tilt)) => Some(-tilt.direction(nalgebra::Vector3::x()).z.asin()),
            Some(Held::Level) => Some(f64::NAN),
            None => None,
        };
        assert!(!track.awaits_attitude(1080 * MS) && track.awaits_attitude(1081 * MS));
        assert!(!PoseTrack::default().awaits_attitude(0), "none will come");
        assert!((pitch_rad(1050).expect("between two") - 0.025).abs() < 1e-9);
        assert!((pitch_rad(1100).expect("just after the last") - 0.05).abs() < 1e-9, "it sways on");
        assert_eq!((pitch_rad(1200), pitch_rad(900)), (None, None), "of another time");
    }

    #[test]
    fn an_attitude_of_another_time_or_of_no_robot_is_not_taken_and_the_body_is_not_level_for_it() {
        let at = |pose_ms: u64, attitude: Attitude| Odometry {
            header: Header { stamp_ns: pose_ms * MS, ..Header::default() },
            attitude,
            ..Odometry::default()
        };
        let attitude = |ms: u64| Attitude { stamp_ns: ms * MS, ..Attitude::default() };
        for wrong in [attitude(3_600_000), attitude(500), Attitude { roll_rad: 2.0, ..attitude(1000) }] {
            let mut track = PoseTrack::default();
            track.push(&at(1000, wrong));
            assert_eq!(track.held_at(1000 * MS), None, "{wrong:?}");
            track.push(&at(1020, attitude(1020)));
            assert!(track.held_at(1020 * MS).is_some_and(|held| held.tilt().is_some()), "the next one counts");
            // A source that tells no attitude any more has not made the body level.
            (1..20).for_each(|i| track.push(&at(1020 + 20 * i, Attitude::default())));
            assert_eq!(track.held_at(1400 * MS), None);
        }
        let mut track = PoseTrack::default();
        // Two that came at once, a hundredth of a radian apart, are no sway.
        track.push(&at(1000, attitude(1000)));
        track.push(&at(1001, Attitude { pitch_rad: 0.01, ..attitude(1001) }));
        let held = track.held_at(1025 * MS).expect("just after the last");
        let down = held.tilt().map(|tilt| -tilt.direction(nalgebra::Vector3::x()).z);
        assert!(down.is_some_and(|down| (down - 0.01).abs() < 1e-6), "{down:?}");
    }
}
