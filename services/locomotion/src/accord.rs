//! Whether the robot moves as it is commanded, as far as odometry tells: pure, times come in. An odometry that is
//! frozen, or takes a radius for a diameter, has fresh stamps and no age check sees it; a robot that does not obey
//! is no better.

use std::collections::VecDeque;

use messages::{Odometry, Pose2, Twist2, s_from_ns};

/// What was commanded and what was seen are compared over so long: a decision.
const WINDOW_NS: u64 = 500_000_000;
/// A robot answers a command within this, its odometry's own age included.
const LAGS_NS: [u64; 3] = [0, 75_000_000, 150_000_000];
/// A way may be off by this much, metres: a hand's breadth in half a second,
const WAY_M: f64 = 0.05;
/// a turn by this much, radians,
const TURN_RAD: f64 = 0.10;
/// and either by this share of it: slip, and a scale that is a little wrong.
const SHARE: f64 = 0.2;
/// Poses further apart than this tell of no window between them.
const GAP_NS: u64 = 100_000_000;
/// No robot walks so far, metres,
const REACH_M: f64 = 1e6;
/// or turns so often, radians.
const REACH_RAD: f64 = 1e3;
/// The most that is kept: a window, the lag and odometry's age, at 100 Hz of poses and three times as many wakes.
const KEPT: usize = 256;

type Track = VecDeque<(u64, Pose2)>;

/// The last commands, added up to where they would have brought the robot, and where odometry says it came.
#[derive(Debug, Default)]
pub struct Accord {
    commanded: Track,
    velocity: Twist2,
    seen: Track,
    incarnation: u32,
}

fn keep(track: &mut Track, at_ns: u64, pose: Pose2) {
    if track.len() == KEPT {
        track.pop_front();
    }
    track.push_back((at_ns, pose));
}

/// Where `velocity` brings a robot from `pose`.
fn moved(pose: Pose2, velocity: Twist2, dt_s: f64) -> Pose2 {
    let yaw_rad = pose.yaw_rad + velocity.wz_radps * dt_s;
    let (sin, cos) = f64::midpoint(pose.yaw_rad, yaw_rad).sin_cos();
    Pose2 {
        x_m: pose.x_m + (velocity.vx_mps * cos - velocity.vy_mps * sin) * dt_s,
        y_m: pose.y_m + (velocity.vx_mps * sin + velocity.vy_mps * cos) * dt_s,
        yaw_rad,
    }
}

/// The pose of a track at a time, on the straight way from the one before to the one after; `None` outside of it.
fn pose_at(track: &Track, at_ns: u64) -> Option<Pose2> {
    let next = track.partition_point(|(stamp_ns, _)| *stamp_ns < at_ns);
    let (after_ns, after) = *track.get(next)?;
    let Some((before_ns, before)) = next.checked_sub(1).and_then(|i| track.get(i)).copied() else {
        return (after_ns == at_ns).then_some(after);
    };
    let share = (at_ns - before_ns) as f64 / (after_ns - before_ns).max(1) as f64;
    let between = |from: f64, to: f64| from + (to - from) * share;
    Some(Pose2 {
        x_m: between(before.x_m, after.x_m),
        y_m: between(before.y_m, after.y_m),
        yaw_rad: between(before.yaw_rad, after.yaw_rad),
    })
}

/// Way, metres, and turn, radians, of a track from one time to another.
fn motion(track: &Track, from_ns: u64, to_ns: u64) -> Option<(f64, f64)> {
    let (from, to) = (pose_at(track, from_ns)?, pose_at(track, to_ns)?);
    Some(((to.x_m - from.x_m).hypot(to.y_m - from.y_m), (to.yaw_rad - from.yaw_rad).abs()))
}

impl Accord {
    /// That velocity is in force at the robot from now on.
    pub fn commanded(&mut self, now_ns: u64, velocity: Twist2) {
        let pose = match self.commanded.back() {
            Some((last_ns, pose)) if now_ns > *last_ns => moved(*pose, self.velocity, s_from_ns(now_ns - last_ns)),
            Some((_, pose)) => *pose,
            None => Pose2::default(),
        };
        if self.commanded.back().is_none_or(|(last_ns, _)| now_ns > *last_ns) {
            keep(&mut self.commanded, now_ns, pose);
        }
        self.velocity = velocity;
    }

    /// A pose has come: whether it contradicts what was commanded. One that no robot can have does, and nothing is
    /// held against it afterwards.
    pub fn contradicts(&mut self, odometry: &Odometry) -> bool {
        if !is_believable(&odometry.odom_from_robot) {
            self.seen.clear();
            return true;
        }
        let (stamp_ns, incarnation) = (odometry.header.stamp_ns, odometry.header.incarnation);
        let last_ns = self.seen.back().map(|(last_ns, _)| *last_ns);
        if last_ns.is_some_and(|last_ns| stamp_ns <= last_ns) && incarnation == self.incarnation {
            return false;
        }
        if incarnation != self.incarnation || last_ns.is_some_and(|last_ns| stamp_ns > last_ns + GAP_NS) {
            self.seen.clear();
            self.incarnation = incarnation;
        }
        // A turn that crosses over from pi to -pi goes on.
        let yaw_rad = self.seen.back().map_or(odometry.odom_from_robot.yaw_rad, |(_, last)| {
            last.yaw_rad + wrapped(odometry.odom_from_robot.yaw_rad - last.yaw_rad)
        });
        keep(&mut self.seen, stamp_ns, Pose2 { yaw_rad, ..odometry.odom_from_robot });
        self.judge(stamp_ns).unwrap_or(false)
    }

    /// `None` while less than a window is known.
    fn judge(&self, stamp_ns: u64) -> Option<bool> {
        let from_ns = stamp_ns.checked_sub(WINDOW_NS)?;
        let (way_m, turn_rad) = motion(&self.seen, from_ns, stamp_ns)?;
        let mut ways = (f64::INFINITY, 0.0_f64);
        let mut turns = ways;
        for lag_ns in LAGS_NS {
            let (way, turn) = motion(&self.commanded, from_ns.checked_sub(lag_ns)?, stamp_ns - lag_ns)?;
            ways = (ways.0.min(way), ways.1.max(way));
            turns = (turns.0.min(turn), turns.1.max(turn));
        }
        let within = |value: f64, (least, most): (f64, f64), off: f64| {
            ((1.0 - SHARE) * least - off..=(1.0 + SHARE) * most + off).contains(&value)
        };
        // What is no number is within nothing.
        Some(!(within(way_m, ways, WAY_M) && within(turn_rad, turns, TURN_RAD)))
    }
}

/// Whether a pose is one: finite, and within the reach of any robot.
fn is_believable(pose: &Pose2) -> bool {
    pose.is_finite() && pose.x_m.abs() < REACH_M && pose.y_m.abs() < REACH_M && pose.yaw_rad.abs() < REACH_RAD
}

/// An angle between two yaws, in (-pi, pi].
fn wrapped(rad: f64) -> f64 {
    let turned = rad.rem_euclid(std::f64::consts::TAU);
    if turned > std::f64::consts::PI { turned - std::f64::consts::TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use super::Accord;
    use messages::{Header, Odometry, Pose2, Twist2};

    const MS: u64 = 1_000_000;
    const FORWARD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 };

    /// Commands at 50 Hz what `command` says and shows, 20 ms late, the poses that `pose` makes of the true one: when
    /// they contradict each other, milliseconds.
    fn first(command: impl Fn(u64) -> Twist2, pose: impl Fn(u64, Pose2) -> Pose2) -> Option<u64> {
        let (mut accord, mut truth) = (Accord::default(), Pose2::default());
        let mut velocity = Twist2::ZERO;
        for ms in (0..4000).step_by(20) {
            // The robot follows with a lag of its own.
            truth = super::moved(truth, velocity, 0.02);
            velocity = command(ms);
            accord.commanded(ms * MS, velocity);
            let header = Header { stamp_ns: ms.saturating_sub(20) * MS, incarnation: 1, ..Header::default() };
            if accord.contradicts(&Odometry { header, odom_from_robot: pose(ms, truth), ..Odometry::default() }) {
                return Some(ms);
            }
        }
        None
    }

    #[test]
    fn a_robot_that_follows_contradicts_nothing() {
        let starts_and_stops = |ms: u64| if (ms / 700).is_multiple_of(2) { FORWARD } else { Twist2::ZERO };
        assert_eq!(first(starts_and_stops, |_, truth| truth), None);
        let turns = |ms: u64| Twist2 { wz_radps: if (ms / 500).is_multiple_of(2) { 0.35 } else { -0.35 }, ..FORWARD };
        assert_eq!(first(turns, |_, truth| truth), None);
        let sidesteps =
            |ms: u64| Twist2 { vy_mps: if (ms / 500).is_multiple_of(2) { 0.3 } else { -0.3 }, ..Twist2::ZERO };
        assert_eq!(first(sidesteps, |_, truth| truth), None);
        let slips = |_: u64, truth: Pose2| Pose2 { x_m: truth.x_m * 0.9, ..truth };
        assert_eq!(first(|_| FORWARD, slips), None);
        let over = |_: u64, truth: Pose2| Pose2 { yaw_rad: super::wrapped(truth.yaw_rad + 3.0), ..truth };
        assert_eq!(first(|_| Twist2 { wz_radps: 0.35, ..Twist2::ZERO }, over), None);
    }

    #[test]
    fn a_frozen_a_doubled_and_a_runaway_odometry_are_seen_within_a_window() {
        let frozen = |ms: u64, truth: Pose2| if ms < 2000 { truth } else { Pose2::new(1.0, 0.0, 0.0) };
        let seen = first(|_| FORWARD, frozen).expect("it is frozen");
        assert!((2000..=2300).contains(&seen), "{seen}");
        let doubled = |truth: Pose2| Pose2 { x_m: truth.x_m + (truth.x_m - 1.0).max(0.0), ..truth };
        let seen = first(|_| FORWARD, |ms, truth| if ms < 2000 { truth } else { doubled(truth) });
        assert!(seen.is_some_and(|seen| seen <= 2320), "{seen:?}");
        let runs_away = |ms: u64, truth: Pose2| Pose2 { x_m: 0.0005 * ms.saturating_sub(2000) as f64, ..truth };
        let seen = first(|_| Twist2::ZERO, runs_away);
        assert!(seen.is_some_and(|seen| seen <= 2200), "{seen:?}");
        assert!(first(|_| FORWARD, |_, truth| Pose2 { x_m: f64::NAN, ..truth }).is_some());
    }

    #[test]
    fn a_gap_and_a_new_frame_begin_anew() {
        let mut accord = Accord::default();
        let pose = |ms: u64, x_m: f64, incarnation: u32| Odometry {
            header: Header { stamp_ns: ms * MS, incarnation, ..Header::default() },
            odom_from_robot: Pose2::new(x_m, 0.0, 0.0),
            ..Odometry::default()
        };
        for ms in (0..2000).step_by(20) {
            accord.commanded(ms * MS, Twist2::ZERO);
            assert!(!accord.contradicts(&pose(ms, 0.0, 1)));
        }
        assert!(!accord.contradicts(&pose(2150, 9.0, 1)), "nobody knows what was in between");
        assert!(!accord.contradicts(&pose(2170, 0.0, 2)), "another frame");
    }

    #[test]
    fn garbage_contradicts_and_is_forgotten() {
        let mut accord = Accord::default();
        let odometry = |ms: u64, yaw_rad: f64| Odometry {
            header: Header { stamp_ns: ms * MS, seq: ms, incarnation: 1, ..Header::default() },
            odom_from_robot: Pose2 { yaw_rad, ..Pose2::default() },
            ..Odometry::default()
        };
        for yaw_rad in [f64::NAN, f64::INFINITY, 1e300] {
            accord.commanded(1000 * MS, Twist2::ZERO);
            assert!(accord.contradicts(&odometry(1000, yaw_rad)), "{yaw_rad}");
        }
        for ms in (1020..3000).step_by(20) {
            accord.commanded(ms * MS, Twist2::ZERO);
            assert!(!accord.contradicts(&odometry(ms, 0.1)), "{ms} ms");
        }
    }
}
