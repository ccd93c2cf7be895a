//! How a robot answers a command, identified from recordings of single motions with stops between them: the figures of
//! `[robot.response]`, and what else tells of a legged robot's gait. Pure, and the same for the same input.
//!
//! [`steps`] finds the motions, `dynamics` fits a first-order lag with a delay to them, `motion` tells the overrun and
//! the sway, and the errors of way and heading are those of [`guidance::accord`], as locomotion judges them.

mod dynamics;
mod figure;
mod motion;
pub mod steps;

use std::collections::{BTreeMap, VecDeque};

use guidance::accord::{self, Accord, GAP_NS};
use guidance::se2::wrap_angle;
use messages::{Odometry, Pose2, Twist2, s_from_ns};
use serde::Serialize;

pub use dynamics::AxisResponse;
pub use figure::Figure;
pub use motion::{Excursion, Overrun, Sway};
use steps::{Step, StepKind};

/// The least number of motions of a kind.
const STEPS_MIN: usize = 3;
/// A healthy robot does this share of what is commanded, in the middle of all motions of a kind,
const OBEYED: std::ops::RangeInclusive<f64> = 0.5..=1.6;
/// and this in each of them.
const EACH_OBEYED: std::ops::RangeInclusive<f64> = 0.25..=2.5;
/// The written errors of way and heading are the largest that were seen times this: other floors, other loads and
/// longer walks have larger ones.
const OFF_RESERVE: f64 = 1.25;
/// The same of overruns.
const OVERRUN_RESERVE: f64 = 1.1;
/// No error is written that is smaller than these, metres and radians: odometry itself is that wrong.
const OFF_MIN: (f64, f64) = (0.05, 0.10);
/// What the configuration takes at most: lag in seconds, errors and overruns in metres and radians.
const LAG_MAX_S: f64 = 0.5;
const LAG_STEP_MS: u64 = 50;
const LAG_STEPS: u64 = 10;
/// Errors that are larger by this share of what is allowed are hardly larger.
const LAG_SLACK: f64 = 0.05;
const OFF_MAX: (f64, f64) = (0.25, 0.60);
const OVERRUN_MAX: f64 = 0.5;

/// A recording, as far as it tells of the response.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    /// What errors call it.
    pub name: String,
    /// The velocity in force at the robot from each time on, nanoseconds; times rise.
    pub commands: Vec<(u64, Twist2)>,
    /// What odometry told; stamps rise.
    pub odometry: Vec<Odometry>,
}

/// Why a response cannot be identified. Always the recording is at fault.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// It has none of what is needed.
    #[error("{drive} has no {what}")]
    Lacks {
        /// The recording.
        drive: String,
        /// What it lacks.
        what: &'static str,
    },
    /// Something is missing in between.
    #[error("{drive} has a gap of {gap_ms} ms in its {what} at {at_s:.2} s")]
    Gap {
        /// The recording.
        drive: String,
        /// Of what.
        what: &'static str,
        /// Where, seconds of run time.
        at_s: f64,
        /// How long, milliseconds.
        gap_ms: u64,
    },
    /// Odometry began anew in between.
    #[error("odometry began anew at {at_s:.2} s of {drive}")]
    OtherFrame {
        /// The recording.
        drive: String,
        /// Where, seconds of run time.
        at_s: f64,
    },
    /// Odometry is no number, or shows a fallen robot.
    #[error("odometry at {at_s:.2} s of {drive} cannot be used")]
    Unusable {
        /// The recording.
        drive: String,
        /// Where, seconds of run time.
        at_s: f64,
    },
    /// Motions are missing.
    #[error("too few motions: {0}")]
    Missing(String),
    /// The robot is not one that obeys, or its odometry lies.
    #[error("the robot did not do what was commanded: {0}")]
    Disobeyed(String),
}

/// What was identified.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Identified {
    /// How many motions there are of each kind, by its name.
    pub motions: BTreeMap<&'static str, usize>,
    /// Delay and time constant: forward, sideways, turn.
    pub axes: BTreeMap<&'static str, AxisResponse>,
    /// How far it goes on after a command of zero, by kind.
    pub overrun: BTreeMap<&'static str, Overrun>,
    /// How the body sways while it walks; by kind.
    pub gait: BTreeMap<&'static str, Sway>,
    /// How the body sways while it stands.
    pub standing: Option<Sway>,
    /// The largest error of its way in each motion and the stop after it, metres ([`accord::Response::way_off_m`]),
    pub way_off_m: Figure,
    /// and of its heading, radians.
    pub turn_off_rad: Figure,
    /// What to write into the configuration.
    pub profile: Profile,
}

/// The numbers of `[robot.response]`, rounded up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Profile {
    /// Milliseconds.
    pub lag_ms: u64,
    /// Metres.
    pub way_off_m: f64,
    /// Radians.
    pub turn_off_rad: f64,
    /// Along the body and across it, metres.
    pub overrun_m: [f64; 2],
    /// Radians.
    pub overrun_rad: f64,
}

/// A recording with its motions, and its poses with yaws that go on over half a turn.
struct Course<'a> {
    drive: &'a Drive,
    track: accord::Track,
    steps: Vec<Step>,
}

/// Identifies the response of one robot from all recordings of it.
///
/// # Errors
/// Where a recording has gaps, motions are missing, or the robot did not obey; the reason says which.
pub fn identify(drives: &[Drive]) -> Result<Identified, ResponseError> {
    let courses: Vec<Course<'_>> = drives.iter().map(Course::of).collect::<Result<_, _>>()?;
    let motions = enough(&courses)?;
    obeyed(&courses)?;
    let axes = dynamics::axes(&courses);
    if let Some((name, axis)) = axes.iter().find(|(_, axis)| axis.delay_s.value >= LAG_MAX_S) {
        let delay_s = axis.delay_s.value;
        return Err(ResponseError::Disobeyed(format!("{name}: for {delay_s:.2} s nothing happens, or longer")));
    }
    let (lag_ms, (way_off, turn_off)) = best_lag(&courses);
    let overrun = motion::overruns(&courses);
    let profile = Profile::of(lag_ms, (way_off, turn_off), &overrun)?;
    Ok(Identified {
        motions,
        axes,
        gait: motion::gaits(&courses),
        standing: motion::standing(&courses),
        overrun,
        way_off_m: way_off,
        turn_off_rad: turn_off,
        profile,
    })
}

impl<'a> Course<'a> {
    fn of(drive: &'a Drive) -> Result<Self, ResponseError> {
        let lacks = |what| ResponseError::Lacks { drive: drive.name.clone(), what };
        if drive.odometry.is_empty() {
            return Err(lacks("odometry"));
        }
        if drive.commands.is_empty() {
            return Err(lacks("commands (locomotion/state)"));
        }
        let steps = steps::find(&drive.commands);
        let course = Self { drive, track: track(&drive.odometry), steps };
        course.check()?;
        Ok(course)
    }

    /// From half a second before the first motion to the end of the last stop there is no gap.
    fn check(&self) -> Result<(), ResponseError> {
        let (Some(first), Some(last)) = (self.steps.first(), self.steps.last()) else { return Ok(()) };
        let drive = || self.drive.name.clone();
        let during = first.begin_ns.saturating_sub(steps::BEFORE_NS)..=last.end_ns;
        let odometry: Vec<&Odometry> =
            self.drive.odometry.iter().filter(|odometry| during.contains(&odometry.header.stamp_ns)).collect();
        let stamps: Vec<u64> = odometry.iter().map(|odometry| odometry.header.stamp_ns).collect();
        let told = self.drive.commands.iter().map(|(at_ns, _)| *at_ns).filter(|at_ns| during.contains(at_ns)).collect();
        for (what, times) in [("odometry", stamps), ("commands", told)] {
            let ends = [*during.start(), *during.end()];
            let all: Vec<u64> = ends[..1].iter().chain(&times).chain(&ends[1..]).copied().collect();
            if let Some(gap) = all.windows(2).find(|pair| pair[1].saturating_sub(pair[0]) > GAP_NS) {
                let gap_ms = (gap[1] - gap[0]) / 1_000_000;
                return Err(ResponseError::Gap { drive: drive(), what, at_s: s_from_ns(gap[0]), gap_ms });
            }
        }
        for odometry in &odometry {
            let at_s = s_from_ns(odometry.header.stamp_ns);
            if !odometry.is_usable() {
                return Err(ResponseError::Unusable { drive: drive(), at_s });
            }
        }
        for pair in odometry.windows(2) {
            if pair[0].header.incarnation != pair[1].header.incarnation {
                let at_s = s_from_ns(pair[1].header.stamp_ns);
                return Err(ResponseError::OtherFrame { drive: drive(), at_s });
            }
        }
        Ok(())
    }

    /// What was commanded from one time to another, each component added up by itself: metres, metres, radians.
    fn commanded(&self, from_ns: u64, to_ns: u64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let next = self.drive.commands.iter().skip(1).map(|(at_ns, _)| *at_ns).chain([u64::MAX]);
        for ((at_ns, velocity), next_ns) in self.drive.commands.iter().zip(next) {
            let (begin_ns, end_ns) = ((*at_ns).max(from_ns), next_ns.min(to_ns));
            if begin_ns < end_ns {
                let s = s_from_ns(end_ns - begin_ns);
                for (sum, v) in sum.iter_mut().zip([velocity.vx_mps, velocity.vy_mps, velocity.wz_radps]) {
                    *sum += v * s;
                }
            }
        }
        sum
    }
}

/// Poses with yaws that go on over half a turn.
fn track(odometry: &[Odometry]) -> accord::Track {
    let mut track = VecDeque::with_capacity(odometry.len());
    let mut yaw_rad = None;
    for told in odometry {
        let pose = told.odom_from_robot;
        let now_rad = yaw_rad.map_or(pose.yaw_rad, |last_rad| last_rad + wrap_angle(pose.yaw_rad - last_rad));
        yaw_rad = Some(now_rad);
        track.push_back((told.header.stamp_ns, Pose2 { yaw_rad: now_rad, ..pose }));
    }
    track
}

/// How many motions there are of each kind.
fn enough(courses: &[Course<'_>]) -> Result<BTreeMap<&'static str, usize>, ResponseError> {
    let count = |kind| courses.iter().flat_map(|course| &course.steps).filter(|step| step.kind == kind).count();
    let missing: Vec<String> = StepKind::ALL
        .into_iter()
        .filter_map(|kind| match count(kind) {
            0 => Some(format!("no {kind} of {}", steps::NEEDED)),
            found if found < STEPS_MIN => Some(format!("{found} of {STEPS_MIN} times a {kind} of {}", steps::NEEDED)),
            _ => None,
        })
        .collect();
    if missing.is_empty() {
        return Ok(StepKind::ALL.into_iter().map(|kind| (kind.name(), count(kind))).collect());
    }
    Err(ResponseError::Missing(missing.join("; ")))
}

/// Whether every kind of motion came about.
fn obeyed(courses: &[Course<'_>]) -> Result<(), ResponseError> {
    for kind in StepKind::ALL {
        let mut shares: Vec<f64> = Vec::new();
        for course in courses {
            for step in course.steps.iter().filter(|step| step.kind == kind) {
                let Some(seen) = accord::motion(&course.track, step.begin_ns, step.zero_ns + steps::STOP_NS) else {
                    continue;
                };
                let told = course.commanded(step.begin_ns, step.zero_ns);
                let (along, square) = (0..3).fold((0.0, 0.0), |(a, b), i| {
                    if kind.axes()[i] { (a + seen[i] * told[i], b + told[i] * told[i]) } else { (a, b) }
                });
                shares.push(along / square);
            }
        }
        shares.sort_by(f64::total_cmp);
        let middle = shares.get(shares.len() / 2).copied().unwrap_or(f64::NAN);
        let ends = [shares.first(), shares.last()];
        let worst = ends.into_iter().flatten().find(|share| !EACH_OBEYED.contains(share));
        if let Some(share) = (!OBEYED.contains(&middle)).then_some(&middle).or(worst) {
            return Err(ResponseError::Disobeyed(format!("a {kind} came to {share:.2} of what was commanded")));
        }
    }
    Ok(())
}

/// The least lag, milliseconds, with which the errors are hardly larger than with any other, and the errors.
fn best_lag(courses: &[Course<'_>]) -> (u64, (Figure, Figure)) {
    let worst = |(ways_m, turns_rad): &(Vec<f64>, Vec<f64>)| {
        let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        most(ways_m) / OFF_MAX.0 + most(turns_rad) / OFF_MAX.1
    };
    let lags_ms = (1..=LAG_STEPS).map(|i| i * LAG_STEP_MS);
    let all: Vec<_> = lags_ms.map(|lag_ms| (lag_ms, offs(courses, lag_ms))).collect();
    let least = all.iter().map(|(_, offs)| worst(offs)).fold(f64::INFINITY, f64::min);
    let best = all.into_iter().find(|(_, offs)| worst(offs) <= least + LAG_SLACK);
    let (lag_ms, (ways_m, turns_rad)) = best.unwrap_or_default();
    (lag_ms, (Figure::mean(&ways_m), Figure::mean(&turns_rad)))
}

/// The errors of way and heading that locomotion would see with that lag: of each motion the largest, metres and
/// radians.
fn offs(courses: &[Course<'_>], lag_ms: u64) -> (Vec<f64>, Vec<f64>) {
    let (mut ways_m, mut turns_rad) = (Vec::new(), Vec::new());
    for course in courses {
        let response = accord::Response { lag_ns: lag_ms * 1_000_000, way_off_m: 0.0, turn_off_rad: 0.0 };
        let mut accord = Accord::new(response);
        let mut worst = vec![(0.0_f64, 0.0_f64); course.steps.len()];
        let (mut commands, mut velocity) = (course.drive.commands.iter().peekable(), Twist2::ZERO);
        for odometry in &course.drive.odometry {
            let stamp_ns = odometry.header.stamp_ns;
            while let Some((at_ns, next)) = commands.next_if(|(at_ns, _)| *at_ns <= stamp_ns) {
                velocity = *next;
                accord.commanded(*at_ns, velocity);
            }
            accord.commanded(stamp_ns, velocity);
            let Some((way_m, turn_rad)) = accord.off(odometry) else { continue };
            if let Some(i) = course.steps.iter().position(|step| (step.begin_ns..step.end_ns).contains(&stamp_ns)) {
                worst[i] = (worst[i].0.max(way_m), worst[i].1.max(turn_rad));
            }
        }
        ways_m.extend(worst.iter().map(|(way_m, _)| *way_m));
        turns_rad.extend(worst.iter().map(|(_, turn_rad)| *turn_rad));
    }
    (ways_m, turns_rad)
}

/// Rounded up to hundredths; what is a hundredth already, but for the last bit, stays.
fn up(value: f64) -> f64 {
    (value * 100.0 - 1e-6).ceil() / 100.0
}

impl Profile {
    fn of(
        lag_ms: u64,
        (way, turn): (Figure, Figure),
        overrun: &BTreeMap<&'static str, Overrun>,
    ) -> Result<Self, ResponseError> {
        let off = |what: &str, figure: Figure, least: f64, most: f64| {
            if figure.max > most {
                let found = figure.max;
                return Err(ResponseError::Disobeyed(format!("{what} was {found:.2} off, and {most} is the most")));
            }
            Ok(up((figure.max * OFF_RESERVE).max(least)).min(most))
        };
        // Where the handler pushes it on, that is way as well.
        let all = || overrun.values().map(|overrun| &overrun.farthest);
        let largest = |of: fn(&Excursion) -> &Figure| all().map(|it| of(it).max).fold(0.0, f64::max);
        let over = |what: &str, found: f64| {
            if found > OVERRUN_MAX {
                return Err(ResponseError::Disobeyed(format!(
                    "{what} it went on by {found:.2}, and {OVERRUN_MAX} is the most"
                )));
            }
            Ok(up(found * OVERRUN_RESERVE).min(OVERRUN_MAX))
        };
        Ok(Self {
            lag_ms,
            way_off_m: off("its way in half a second, metres,", way, OFF_MIN.0, OFF_MAX.0)?,
            turn_off_rad: off("its heading in half a second, radians,", turn, OFF_MIN.1, OFF_MAX.1)?,
            overrun_m: [
                over("ahead, metres,", largest(|it| &it.along_m))?,
                over("to the side, metres,", largest(|it| &it.across_m))?,
            ],
            overrun_rad: over("in a turn, radians,", largest(|it| &it.turn_rad))?,
        })
    }
}

#[cfg(test)]
mod tests;
