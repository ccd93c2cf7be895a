//! Whether the robot moves as it is commanded, and as its own velocity says, as far as odometry tells: pure, times come
//! in. An odometry that is frozen, or takes a radius for a diameter, has fresh stamps and no age check sees it; a robot
//! that does not obey is no better.

use std::collections::VecDeque;

use messages::{NS_PER_S, Odometry, Pose2, Twist2, s_from_ns};

/// Motions are compared over this window: one decision,
const WINDOW_NS: u64 = NS_PER_S / 2;
/// and over longer windows, each with a factor on the tolerance. Sway is bounded; a false odometry drifts on.
const WINDOWS: [(u64, f64); 3] = [(WINDOW_NS, 1.0), (NS_PER_S, 1.4), (2 * NS_PER_S, 1.75)];
/// A robot may answer a command after any of these, up to its own lag.
const LAG_STEP_NS: u64 = NS_PER_S / 40;
/// Slip, and a scale that is a little wrong: a way or a turn may be off by this share of it.
const SHARE: f64 = 0.2;
/// Tolerance between the poses and the velocities of one odometry in a window, metres and radians,
const OWN_WAY_M: f64 = 0.05;
const OWN_TURN_RAD: f64 = 0.10;
/// and as a share of the motion.
const OWN_SHARE: f64 = 0.25;
/// Poses further apart than this tell of no window between them, nanoseconds.
pub const GAP_NS: u64 = 100_000_000;
/// No robot walks so far, metres,
const REACH_M: f64 = 1e6;
/// or turns so often, radians.
const REACH_RAD: f64 = 1e3;
/// or moves so fast, metres and radians per second.
const REACH_PER_S: f64 = 100.0;
/// The most that is kept: the longest window, the lag and odometry's age, at 100 Hz of poses and three times as many
/// wakes.
const KEPT: usize = 1024;

/// How a healthy robot answers a command, `[robot.response]` of the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// It answers within this, its odometry's own age included, nanoseconds.
    pub lag_ns: u64,
    /// In half a second it is off by at most this, metres, whichever way,
    pub way_off_m: f64,
    /// and by this, radians.
    pub turn_off_rad: f64,
}

/// Poses by their stamps, nanoseconds, the oldest first. Yaws go on over half a turn.
pub type Track = VecDeque<(u64, Pose2)>;

/// The last commands, added up to where they would have brought the robot, and where odometry says it came, by its
/// poses and by its velocities.
#[derive(Debug)]
pub struct Accord {
    response: Response,
    commanded: Track,
    velocity: Twist2,
    seen: Track,
    /// The velocities that odometry tells, added up.
    told: Track,
    told_velocity: Twist2,
    incarnation: u32,
}

/// Takes a track on to a time with a velocity.
fn go_on(track: &mut Track, now_ns: u64, velocity: Twist2) {
    match track.back().copied() {
        None => keep(track, now_ns, Pose2::default()),
        Some((last_ns, pose)) if now_ns > last_ns => {
            keep(track, now_ns, moved(pose, velocity, s_from_ns(now_ns - last_ns)));
        }
        Some(_) => {}
    }
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

/// Motion of a track from one time to another, in the robot's frame at the first: ahead and to the left, metres, and
/// the turn, radians. `None` where it does not reach over both times.
#[must_use]
pub fn motion(track: &Track, from_ns: u64, to_ns: u64) -> Option<[f64; 3]> {
    let (from, to) = (pose_at(track, from_ns)?, pose_at(track, to_ns)?);
    let (sin, cos) = from.yaw_rad.sin_cos();
    let (dx_m, dy_m) = (to.x_m - from.x_m, to.y_m - from.y_m);
    Some([cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m, to.yaw_rad - from.yaw_rad])
}

/// What became of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Taken {
    New,
    /// It is no newer than the last one.
    Old,
    /// No robot can have it.
    Unbelievable,
}

/// Between which motions one must lie.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    least: [f64; 3],
    most: [f64; 3],
}

impl Bounds {
    fn of(motion: [f64; 3]) -> Self {
        Self { least: motion, most: motion }
    }

    fn or(self, motion: [f64; 3]) -> Self {
        Self {
            least: std::array::from_fn(|i| self.least[i].min(motion[i])),
            most: std::array::from_fn(|i| self.most[i].max(motion[i])),
        }
    }

    /// How far a motion may be beyond them: a tolerance, metres and radians, and a share of the motion.
    fn tolerance(&self, (way_m, turn_rad): (f64, f64), share: f64) -> [f64; 3] {
        let greatest = |i: usize| self.least[i].abs().max(self.most[i].abs());
        let way_m = way_m + share * greatest(0).hypot(greatest(1));
        [way_m, way_m, turn_rad + share * greatest(2)]
    }

    /// Whether a motion lies between them, within a tolerance and a share of the motion. NaN never does.
    fn hold(&self, motion: [f64; 3], tolerance: (f64, f64), share: f64) -> bool {
        let off = self.tolerance(tolerance, share);
        (0..3).all(|i| (self.least[i] - off[i]..=self.most[i] + off[i]).contains(&motion[i]))
    }

    /// The tolerance with which they would just hold a motion, metres and radians; not finite where none would.
    fn least_tolerance(&self, motion: [f64; 3], share: f64) -> (f64, f64) {
        let off = self.tolerance((0.0, 0.0), share);
        let beyond: [f64; 3] = std::array::from_fn(|i| {
            let beyond = (self.least[i] - motion[i]).max(motion[i] - self.most[i]) - off[i];
            // A maximum would pass over what is no number.
            if beyond.is_finite() { beyond.max(0.0) } else { f64::INFINITY }
        });
        (beyond[0].max(beyond[1]), beyond[2])
    }
}

impl Accord {
    /// For a robot that answers so.
    #[must_use]
    pub fn new(response: Response) -> Self {
        Self {
            response,
            // A stop does not wait for memory.
            commanded: Track::with_capacity(KEPT),
            velocity: Twist2::ZERO,
            seen: Track::with_capacity(KEPT),
            told: Track::with_capacity(KEPT),
            told_velocity: Twist2::ZERO,
            incarnation: 0,
        }
    }

    /// That velocity is in force at the robot from now on.
    pub fn commanded(&mut self, now_ns: u64, velocity: Twist2) {
        go_on(&mut self.commanded, now_ns, self.velocity);
        self.velocity = velocity;
    }

    /// A pose has come: whether it contradicts what was commanded. One that no robot can have does, and nothing is
    /// held against it afterwards.
    pub fn contradicts(&mut self, odometry: &Odometry) -> bool {
        let stamp_ns = odometry.header.stamp_ns;
        match self.take(odometry) {
            Taken::New => {}
            Taken::Old => return false,
            Taken::Unbelievable => return true,
        }
        let Response { way_off_m, turn_off_rad, .. } = self.response;
        let disobeys = WINDOWS.into_iter().any(|(window_ns, off)| {
            let held = self.bounds(stamp_ns, window_ns);
            held.is_some_and(|(bounds, seen)| !bounds.hold(seen, (off * way_off_m, off * turn_off_rad), SHARE))
        });
        disobeys || self.is_one(stamp_ns) == Some(false)
    }

    /// A pose has come: the least [`Response::way_off_m`], metres, and [`Response::turn_off_rad`], radians, with which
    /// it would not contradict what was commanded, over every window. `None` while less than a window is known. Not
    /// finite for a pose that no robot can have.
    pub fn off(&mut self, odometry: &Odometry) -> Option<(f64, f64)> {
        let stamp_ns = odometry.header.stamp_ns;
        match self.take(odometry) {
            Taken::New => {}
            Taken::Old => return None,
            Taken::Unbelievable => return Some((f64::INFINITY, f64::INFINITY)),
        }
        let offs = WINDOWS.into_iter().filter_map(|(window_ns, off)| {
            let (bounds, seen) = self.bounds(stamp_ns, window_ns)?;
            let (way_m, turn_rad) = bounds.least_tolerance(seen, SHARE);
            Some((way_m / off, turn_rad / off))
        });
        offs.reduce(|a, b| (a.0.max(b.0), a.1.max(b.1)))
    }

    /// Keeps a pose.
    fn take(&mut self, odometry: &Odometry) -> Taken {
        if !is_believable(odometry) {
            self.forget_seen();
            return Taken::Unbelievable;
        }
        let (stamp_ns, incarnation) = (odometry.header.stamp_ns, odometry.header.incarnation);
        let last_ns = self.seen.back().map(|(last_ns, _)| *last_ns);
        if last_ns.is_some_and(|last_ns| stamp_ns <= last_ns) && incarnation == self.incarnation {
            return Taken::Old;
        }
        if incarnation != self.incarnation || last_ns.is_some_and(|last_ns| stamp_ns > last_ns + GAP_NS) {
            self.forget_seen();
            self.incarnation = incarnation;
        }
        // A turn that crosses over from pi to -pi goes on.
        let yaw_rad = self.seen.back().map_or(odometry.odom_from_robot.yaw_rad, |(_, last)| {
            last.yaw_rad + wrapped(odometry.odom_from_robot.yaw_rad - last.yaw_rad)
        });
        keep(&mut self.seen, stamp_ns, Pose2 { yaw_rad, ..odometry.odom_from_robot });
        // On the way from the last pose it moved as the two velocities say.
        go_on(&mut self.told, stamp_ns, halfway(self.told_velocity, odometry.twist));
        self.told_velocity = odometry.twist;
        Taken::New
    }

    fn forget_seen(&mut self) {
        self.seen.clear();
        self.told.clear();
        self.told_velocity = Twist2::ZERO;
    }

    /// Between which motions it was commanded in a window, and the motion that was seen; `None` while less is known.
    fn bounds(&self, stamp_ns: u64, window_ns: u64) -> Option<(Bounds, [f64; 3])> {
        let from_ns = stamp_ns.checked_sub(window_ns)?;
        let seen = motion(&self.seen, from_ns, stamp_ns)?;
        let lag_ns = self.response.lag_ns;
        let mut lags_ns = (0..).map(|i| i * LAG_STEP_NS).take_while(|lag| *lag < lag_ns).chain([lag_ns]);
        let lagged = |lag_ns: u64| motion(&self.commanded, from_ns.checked_sub(lag_ns)?, stamp_ns - lag_ns);
        let first = Bounds::of(lagged(lags_ns.next()?)?);
        let bounds = lags_ns.try_fold(first, |bounds, lag_ns| Some(bounds.or(lagged(lag_ns)?)))?;
        Some((bounds, seen))
    }

    /// Whether its poses agree with its velocities. This finds a freeze or a drift in one of them, however the legs
    /// move. It is skipped for a source that sends only zeros as velocities.
    fn is_one(&self, stamp_ns: u64) -> Option<bool> {
        let from_ns = stamp_ns.checked_sub(WINDOW_NS)?;
        let (seen, told) = (motion(&self.seen, from_ns, stamp_ns)?, motion(&self.told, from_ns, stamp_ns)?);
        let tells_none = told == [0.0; 3] && self.told_velocity.is_zero();
        Some(tells_none || Bounds::of(told).hold(seen, (OWN_WAY_M, OWN_TURN_RAD), OWN_SHARE))
    }
}

fn halfway(a: Twist2, b: Twist2) -> Twist2 {
    Twist2 {
        vx_mps: f64::midpoint(a.vx_mps, b.vx_mps),
        vy_mps: f64::midpoint(a.vy_mps, b.vy_mps),
        wz_radps: f64::midpoint(a.wz_radps, b.wz_radps),
    }
}

/// Whether a pose and a velocity are some: finite, and within the reach of any robot.
fn is_believable(odometry: &Odometry) -> bool {
    let (pose, twist) = (&odometry.odom_from_robot, &odometry.twist);
    let numbers = [twist.vx_mps, twist.vy_mps, twist.wz_radps];
    // What is no number is under nothing.
    numbers.iter().all(|number| number.abs() < REACH_PER_S)
        && pose.is_finite()
        && pose.x_m.abs() < REACH_M
        && pose.y_m.abs() < REACH_M
        && pose.yaw_rad.abs() < REACH_RAD
}

/// An angle between two yaws, in (-pi, pi].
fn wrapped(rad: f64) -> f64 {
    let turned = rad.rem_euclid(std::f64::consts::TAU);
    if turned > std::f64::consts::PI { turned - std::f64::consts::TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use super::{Accord, Response};
    use messages::{Header, Odometry, Pose2, Twist2};

    const MS: u64 = 1_000_000;
    const RESPONSE: Response = Response { lag_ns: 150 * MS, way_off_m: 0.05, turn_off_rad: 0.10 };
    const FORWARD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 };

    /// Commands at 50 Hz what `command` says and shows, 20 ms late, the poses that `pose` makes of the true one: when
    /// they contradict each other, milliseconds.
    fn first(command: impl Fn(u64) -> Twist2, pose: impl Fn(u64, Pose2) -> Pose2) -> Option<u64> {
        let (mut accord, mut truth) = (Accord::new(RESPONSE), Pose2::default());
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

    /// The least tolerance of a course is the least with which nothing in it contradicts.
    #[test]
    fn the_least_tolerance_is_where_a_contradiction_begins() {
        let course = |each: &mut dyn FnMut(u64, Twist2, &Odometry)| {
            let (mut truth, mut velocity) = (Pose2::default(), Twist2::ZERO);
            for ms in (0..6000_u64).step_by(20) {
                truth = super::moved(truth, velocity, 0.02);
                velocity = if (ms / 1500).is_multiple_of(2) { FORWARD } else { Twist2::ZERO };
                // It goes half as far again as it is told, and turns a little.
                let pose = Pose2::new(1.5 * truth.x_m, 0.0, 0.1 * truth.x_m);
                let header = Header { stamp_ns: ms * MS, incarnation: 1, ..Header::default() };
                let twist = Twist2 { vx_mps: 1.5 * velocity.vx_mps, wz_radps: 0.1 * velocity.vx_mps, ..velocity };
                each(ms, velocity, &Odometry { header, odom_from_robot: pose, twist, ..Odometry::default() });
            }
        };
        let (mut accord, mut off) =
            (Accord::new(Response { way_off_m: 1.0, turn_off_rad: 1.0, ..RESPONSE }), (0.0, 0.0));
        course(&mut |ms, velocity, odometry| {
            accord.commanded(ms * MS, velocity);
            if let Some(found) = accord.off(odometry) {
                off = (found.0.max(off.0), found.1.max(off.1));
            }
        });
        assert!(off.0 > 0.05 && off.1 > 0.02, "{off:?}");
        for (way_off_m, turn_off_rad, contradicts) in [
            (off.0 + 1e-6, off.1 + 1e-6, false),
            (off.0 - 1e-6, off.1 + 1e-6, true),
            (off.0 + 1e-6, off.1 - 1e-6, true),
        ] {
            let mut accord = Accord::new(Response { way_off_m, turn_off_rad, ..RESPONSE });
            let mut found = false;
            course(&mut |ms, velocity, odometry| {
                accord.commanded(ms * MS, velocity);
                found |= accord.contradicts(odometry);
            });
            assert_eq!(found, contradicts, "{way_off_m} m, {turn_off_rad} rad");
        }
        let garbage = Odometry { odom_from_robot: Pose2::new(f64::NAN, 0.0, 0.0), ..Odometry::default() };
        assert!(Accord::new(RESPONSE).off(&garbage).is_some_and(|(way_m, _)| way_m.is_infinite()));
    }

    #[test]
    fn a_gap_and_a_new_frame_begin_anew() {
        let mut accord = Accord::new(RESPONSE);
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
        let mut accord = Accord::new(RESPONSE);
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

    /// As [`first`], of a robot on legs, whose odometry tells velocities.
    fn first_on_legs(pose: impl Fn(u64, Pose2) -> Pose2, twist: impl Fn(u64, Twist2) -> Twist2) -> Option<u64> {
        // Those of config/profiles/go2.toml.
        let legs = Response { lag_ns: 300 * MS, way_off_m: 0.20, turn_off_rad: 0.45 };
        let (mut accord, mut truth) = (Accord::new(legs), Pose2::default());
        for ms in (0..6000).step_by(20) {
            let command = Twist2 { wz_radps: if (ms / 1500) % 2 == 0 { 0.35 } else { -0.35 }, ..FORWARD };
            // It sways, and overshoots.
            let sway = (ms as f64 * 0.02).sin();
            let moves = Twist2 {
                vx_mps: command.vx_mps + 0.15 * sway,
                vy_mps: 0.2 * sway,
                wz_radps: 1.3 * command.wz_radps + 0.3 * sway,
            };
            truth = super::moved(truth, moves, 0.02);
            accord.commanded(ms * MS, command);
            let header = Header { stamp_ns: ms * MS, incarnation: 1, ..Header::default() };
            let (odom_from_robot, twist) = (pose(ms, truth), twist(ms, moves));
            if accord.contradicts(&Odometry { header, odom_from_robot, twist, ..Odometry::default() }) {
                return Some(ms);
            }
        }
        None
    }

    #[test]
    fn legs_that_sway_are_not_accused_and_an_odometry_that_lies_is_found_within_half_a_second() {
        assert_eq!(first_on_legs(|_, truth| truth, |_, moves| moves), None);
        assert_eq!(first_on_legs(|_, truth| truth, |_, _| Twist2::ZERO), None, "it tells no velocities");
        let from = |ms: u64| ms.saturating_sub(3000) as f64 / 1000.0;
        let drifts = |ms: u64, truth: Pose2| Pose2 { y_m: truth.y_m + 0.3 * from(ms), ..truth };
        let turns = |ms: u64, truth: Pose2| Pose2 {
            yaw_rad: super::wrapped(truth.yaw_rad + 30_f64.to_radians() * from(ms)),
            ..truth
        };
        for seen in [first_on_legs(drifts, |_, moves| moves), first_on_legs(turns, |_, moves| moves)] {
            assert!(seen.is_some_and(|seen| (3000..=3500).contains(&seen)), "{seen:?}");
        }
    }

    #[test]
    fn a_heading_that_is_frozen_or_mirrored_is_found_within_a_second() {
        // At 3000 ms it has turned to the left, and back: it looks ahead, give or take its sway.
        let frozen_rad = std::cell::Cell::new(0.0);
        let frozen = |ms: u64, truth: Pose2| {
            if ms < 3000 {
                frozen_rad.set(truth.yaw_rad);
            }
            Pose2 { yaw_rad: frozen_rad.get(), ..truth }
        };
        let mirrored = |ms: u64, truth: Pose2| {
            let yaw_rad = 2.0 * frozen_rad.get() - truth.yaw_rad;
            if ms < 3000 { truth } else { Pose2 { yaw_rad: super::wrapped(yaw_rad), ..truth } }
        };
        for seen in [first_on_legs(frozen, |_, moves| moves), first_on_legs(mirrored, |_, moves| moves)] {
            assert!(seen.is_some_and(|seen| (3000..=4000).contains(&seen)), "{seen:?}");
        }
    }

    #[test]
    fn an_odometry_whose_velocities_lie_with_its_poses_is_found_by_the_commands_alone() {
        let stands = Pose2::default();
        let frozen = first_on_legs(|ms, truth| if ms < 1000 { truth } else { stands }, |_, _| Twist2::ZERO);
        assert!(frozen.is_some_and(|seen| seen <= 3000), "{frozen:?}");
        let held = std::cell::Cell::new(stands);
        let frozen_where_it_was = first_on_legs(
            |ms, truth| {
                if ms < 3000 {
                    held.set(truth);
                }
                held.get()
            },
            |ms, moves| if ms < 3000 { moves } else { Twist2::ZERO },
        );
        assert!(frozen_where_it_was.is_some_and(|seen| (3000..=5000).contains(&seen)), "{frozen_where_it_was:?}");
    }

    #[test]
    fn a_velocity_that_is_none_is_forgotten_with_its_pose() {
        let mut accord = Accord::new(RESPONSE);
        let odometry = |ms: u64, vx_mps: f64| Odometry {
            header: Header { stamp_ns: ms * MS, seq: ms, incarnation: 1, ..Header::default() },
            twist: Twist2 { vx_mps, ..Twist2::ZERO },
            ..Odometry::default()
        };
        for vx_mps in [f64::NAN, f64::NEG_INFINITY, 1e300] {
            accord.commanded(1000 * MS, Twist2::ZERO);
            assert!(accord.contradicts(&odometry(1000, vx_mps)), "{vx_mps}");
        }
        for ms in (1020..4000).step_by(20) {
            accord.commanded(ms * MS, Twist2::ZERO);
            assert!(!accord.contradicts(&odometry(ms, 0.0)), "{ms} ms");
        }
    }
}
