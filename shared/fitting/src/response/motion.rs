//! What a robot does beside what it is told: how far it goes on after a zero, and how its body sways.

use std::collections::BTreeMap;

use guidance::accord;
use messages::{NS_PER_S, s_from_ns};
use serde::Serialize;

use super::Course;
use super::figure::Figure;
use super::steps::{STOP_NS, Step, StepKind};

/// By then a robot walks evenly after it began, and stands after a zero, nanoseconds.
const EVEN_NS: u64 = NS_PER_S * 4 / 5;
/// A robot stands that has moved by less in this time: nanoseconds, metres, radians.
const STOOD_NS: u64 = NS_PER_S / 5;
const STOOD_M: f64 = 0.015;
const STOOD_RAD: f64 = 0.05;
/// Sway over a shorter time says nothing, nanoseconds.
const SWAY_NS: u64 = NS_PER_S / 2;

/// How far a robot goes on after a command of zero, whichever way. What was still commanded on the way to zero is not
/// counted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Overrun {
    /// Until it stands for the first time.
    #[serde(flatten)]
    pub until_standing: Excursion,
    /// The farthest in 1.5 s: a handler who comes to stand later, or the harness, may move it once more.
    pub farthest: Excursion,
}

/// How far a robot went in a stop: the farthest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Excursion {
    /// Along the body's axis, metres.
    pub along_m: Figure,
    /// Across it, metres.
    pub across_m: Figure,
    /// Of its heading, radians.
    pub turn_rad: Figure,
}

/// How a body sways about an even motion. The figures are standard deviations, and `max` is the largest excursion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sway {
    /// Along the body's axis, metres.
    pub along_m: Figure,
    /// Across it, metres.
    pub across_m: Figure,
    /// Of its heading, radians.
    pub turn_rad: Figure,
    /// About the forward axis, radians; none where no source tells it.
    pub roll_rad: Option<Figure>,
    /// About the left axis, radians.
    pub pitch_rad: Option<Figure>,
}

pub(super) fn overruns(courses: &[Course<'_>]) -> BTreeMap<&'static str, Overrun> {
    let of_kind = |kind: StepKind| {
        let steps: Vec<(&Course<'_>, &Step)> = all(courses).filter(|(_, step)| step.kind == kind).collect();
        let excursion = |until: fn(&Course<'_>, &Step) -> u64| {
            let mut found: [Vec<f64>; 3] = Default::default();
            for (course, step) in &steps {
                let most = overrun(course, step, until(course, step));
                found.iter_mut().zip(most).for_each(|(all, value)| all.push(value));
            }
            let [along_m, across_m, turn_rad] = found.map(|values| Figure::mean(&values));
            Excursion { along_m, across_m, turn_rad }
        };
        let farthest = excursion(|_, step| step.zero_ns + STOP_NS);
        (kind.name(), Overrun { until_standing: excursion(stands_ns), farthest })
    };
    StepKind::ALL.into_iter().map(of_kind).collect()
}

fn all<'a>(courses: &'a [Course<'a>]) -> impl Iterator<Item = (&'a Course<'a>, &'a Step)> {
    courses.iter().flat_map(|course| course.steps.iter().map(move |step| (course, step)))
}

/// When it stands for the first time after a zero, nanoseconds: it has hardly moved for a moment.
fn stands_ns(course: &Course<'_>, step: &Step) -> u64 {
    let until_ns = step.zero_ns + STOP_NS;
    let stands = |stamp_ns: u64| {
        let before_ns = stamp_ns.checked_sub(STOOD_NS).filter(|before_ns| *before_ns >= step.zero_ns)?;
        let [along_m, across_m, turn_rad] = accord::motion(&course.track, before_ns, stamp_ns)?;
        Some(along_m.hypot(across_m) < STOOD_M && turn_rad.abs() < STOOD_RAD)
    };
    let mut stamps = during(course, step.zero_ns, until_ns).map(|(stamp_ns, _)| *stamp_ns);
    stamps.find(|stamp_ns| stands(*stamp_ns) == Some(true)).unwrap_or(until_ns)
}

/// The farthest from where the command began to end until a time: metres, metres, radians.
fn overrun(course: &Course<'_>, step: &Step, until_ns: u64) -> [f64; 3] {
    let ramp = course.commanded(step.ends_ns, step.zero_ns);
    let mut most = [0.0_f64; 3];
    for (stamp_ns, _) in during(course, step.ends_ns, until_ns) {
        let Some(motion) = accord::motion(&course.track, step.ends_ns, *stamp_ns) else { continue };
        for i in 0..3 {
            let way = motion[i] * ramp[i].signum();
            most[i] = most[i].max(way - ramp[i].abs()).max(-way);
        }
    }
    most
}

fn during<'a>(course: &'a Course<'_>, from_ns: u64, to_ns: u64) -> impl Iterator<Item = &'a (u64, messages::Pose2)> {
    course.track.iter().filter(move |(stamp_ns, _)| (from_ns..=to_ns).contains(stamp_ns))
}

/// Of the even part of each motion.
pub(super) fn gaits(courses: &[Course<'_>]) -> BTreeMap<&'static str, Sway> {
    let of_kind = |kind: StepKind| {
        let steps = all(courses).filter(|(_, step)| step.kind == kind);
        let windows = steps.map(|(course, step)| (course, step.begin_ns + EVEN_NS, step.ends_ns));
        Some((kind.name(), sway(windows, true)?))
    };
    StepKind::ALL.into_iter().filter_map(of_kind).collect()
}

/// Of the end of each stop.
pub(super) fn standing(courses: &[Course<'_>]) -> Option<Sway> {
    sway(all(courses).map(|(course, step)| (course, step.zero_ns + STOP_NS, step.end_ns)), false)
}

fn sway<'a>(windows: impl Iterator<Item = (&'a Course<'a>, u64, u64)>, even: bool) -> Option<Sway> {
    // Along, across, turn, roll, pitch: a standard deviation and the largest excursion for each window.
    let mut found: [Vec<(f64, f64)>; 5] = Default::default();
    for (course, from_ns, to_ns) in windows.filter(|(_, from_ns, to_ns)| to_ns.saturating_sub(*from_ns) >= SWAY_NS) {
        let mut motions: [Vec<(f64, f64)>; 3] = Default::default();
        let first_ns = during(course, from_ns, to_ns).next().map_or(from_ns, |(stamp_ns, _)| *stamp_ns);
        for (stamp_ns, _) in during(course, from_ns, to_ns) {
            let Some(motion) = accord::motion(&course.track, first_ns, *stamp_ns) else { continue };
            let at_s = s_from_ns(stamp_ns - first_ns);
            motions.iter_mut().zip(motion).for_each(|(all, value)| all.push((at_s, value)));
        }
        found.iter_mut().zip(&motions).for_each(|(all, values)| all.extend(spread(values, even)));
        let told = course.drive.odometry.iter().filter(|it| (from_ns..=to_ns).contains(&it.header.stamp_ns));
        let known = told.filter(|it| it.attitude.is_known()).map(|it| &it.attitude);
        let [rolls, pitches]: [Vec<(f64, f64)>; 2] = [
            known.clone().map(|attitude| (0.0, attitude.roll_rad)).collect(),
            known.map(|attitude| (0.0, attitude.pitch_rad)).collect(),
        ];
        found[3].extend(spread(&rolls, false));
        found[4].extend(spread(&pitches, false));
    }
    let figure = |values: &[(f64, f64)]| {
        let deviations: Vec<f64> = values.iter().map(|(deviation, _)| *deviation).collect();
        let max = values.iter().map(|(_, largest)| *largest).fold(0.0, f64::max);
        (!values.is_empty()).then(|| Figure { max, ..Figure::mean(&deviations) })
    };
    let [along, across, turn, roll_rad, pitch_rad] = found.map(|values| figure(&values));
    Some(Sway { along_m: along?, across_m: across?, turn_rad: turn?, roll_rad, pitch_rad })
}

/// Standard deviation and largest excursion of values by their times, seconds, about their mean, or about an even
/// motion.
fn spread(values: &[(f64, f64)], even: bool) -> Option<(f64, f64)> {
    let n = values.len() as f64;
    if values.len() < 3 {
        return None;
    }
    let mean = |of: fn(&(f64, f64)) -> f64| values.iter().map(of).sum::<f64>() / n;
    let (at_s, middle) = (mean(|(at_s, _)| *at_s), mean(|(_, value)| *value));
    let (square, both) = values.iter().fold((0.0, 0.0), |(square, both), (t, value)| {
        (square + (t - at_s).powi(2), both + (t - at_s) * (value - middle))
    });
    let slope = if even && square > 0.0 { both / square } else { 0.0 };
    let rests = values.iter().map(|(t, value)| value - middle - slope * (t - at_s));
    let (variance, largest) = rests.fold((0.0, 0.0_f64), |(sum, most), rest| (sum + rest * rest, most.max(rest.abs())));
    Some(((variance / n).sqrt(), largest))
}
