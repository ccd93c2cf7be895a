//! Delay and time constant: a first-order lag with a delay, fitted to where the robot went. Places are fitted, since a
//! legged robot's velocity swings with its gait.

use std::collections::BTreeMap;

use guidance::accord;
use messages::s_from_ns;
use serde::Serialize;

use super::figure::{FITS, Figure, resamples};
use super::steps::{BEFORE_NS, STOP_NS, Step, StepKind};
use super::{Course, Drive};

/// Step of the model, of the delay, and of the time constant, nanoseconds.
const MODEL_NS: u64 = 5_000_000;
const TIME_CONSTANT_NS: u64 = 10_000_000;
/// The longest delay, and the longest time constant, in steps of theirs: 0.5 s.
const DELAYS: usize = 101;
const TIME_CONSTANTS: usize = 51;
const AXES: [(&str, [StepKind; 2]); 3] = [
    ("forward", [StepKind::Forward, StepKind::Forward]),
    ("sideways", [StepKind::SidestepLeft, StepKind::SidestepRight]),
    ("turn", [StepKind::TurnLeft, StepKind::TurnRight]),
];

/// How one axis answers: after the delay, its velocity comes to `gain` times the commanded one with the time constant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AxisResponse {
    /// Nothing happens before, seconds.
    pub delay_s: Figure,
    /// Of the first-order lag, seconds.
    pub time_constant_s: Figure,
    /// Both together: so far is it behind as it moves on, seconds.
    pub answer_s: Figure,
    /// Its velocity over the commanded one.
    pub gain: Figure,
    /// Root mean square of what the model leaves, metres or radians.
    pub rest_rms: f64,
}

/// Sums over one motion, for one delay and time constant: of the model's place squared, of model times place.
type Sums = (f64, f64);

/// One motion.
struct Sample {
    /// By time constant, then by delay.
    sums: Vec<Sums>,
    /// Sum of the places squared.
    square: f64,
    count: usize,
}

/// Forward, sideways and turn.
pub(super) fn axes(courses: &[Course<'_>]) -> BTreeMap<&'static str, AxisResponse> {
    let mut axes = BTreeMap::new();
    for (axis, (name, kinds)) in AXES.into_iter().enumerate() {
        let mut samples = Vec::new();
        for course in courses {
            let steps = course.steps.iter().filter(|step| kinds.contains(&step.kind));
            samples.extend(steps.filter_map(|step| Sample::of(course, step, axis)));
        }
        axes.insert(name, fit(&samples));
    }
    axes
}

fn fit(samples: &[Sample]) -> AxisResponse {
    let all: Vec<usize> = (0..samples.len()).collect();
    let (delay_s, time_constant_s, gain, cost) = best(samples, &all);
    let count: usize = samples.iter().map(|sample| sample.count).sum();
    let mut found: [Vec<f64>; 4] = Default::default();
    for indices in resamples(samples.len(), FITS) {
        let (delay_s, time_constant_s, gain, _) = best(samples, &indices);
        let values = [delay_s, time_constant_s, delay_s + time_constant_s, gain];
        found.iter_mut().zip(values).for_each(|(all, value)| all.push(value));
    }
    let [delays, time_constants, answers, gains] = found;
    let figure = |value, found| Figure::fitted(value, found, samples.len());
    AxisResponse {
        delay_s: figure(delay_s, delays),
        time_constant_s: figure(time_constant_s, time_constants),
        answer_s: figure(delay_s + time_constant_s, answers),
        gain: figure(gain, gains),
        rest_rms: (cost.max(0.0) / count.max(1) as f64).sqrt(),
    }
}

/// Delay and time constant, seconds, gain, and sum of squares that is left.
fn best(samples: &[Sample], indices: &[usize]) -> (f64, f64, f64, f64) {
    let square: f64 = indices.iter().map(|i| samples[*i].square).sum();
    let mut found = (0, 0.0, f64::INFINITY);
    for place in 0..TIME_CONSTANTS * DELAYS {
        let (model, both) =
            indices.iter().map(|i| samples[*i].sums[place]).fold((0.0, 0.0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        let gain = if model > 0.0 { both / model } else { 0.0 };
        let left = square - gain * both;
        if left < found.2 {
            found = (place, gain, left);
        }
    }
    let (place, gain, left) = found;
    let delay_s = s_from_ns((place % DELAYS) as u64 * MODEL_NS);
    (delay_s, s_from_ns((place / DELAYS) as u64 * TIME_CONSTANT_NS), gain, left)
}

impl Sample {
    /// `axis`: 0 ahead, 1 to the left, 2 the turn.
    fn of(course: &Course<'_>, step: &Step, axis: usize) -> Option<Self> {
        let from_ns = step.begin_ns - BEFORE_NS.min(step.begin_ns);
        let to_ns = step.zero_ns + STOP_NS;
        let stamps = course.track.iter().map(|(stamp_ns, _)| *stamp_ns).filter(|at| (from_ns..=to_ns).contains(at));
        let first_ns = stamps.clone().next()?;
        // Model steps from the window's begin, and the place there.
        let seen: Vec<(f64, f64)> = stamps
            .filter_map(|stamp_ns| {
                let place = accord::motion(&course.track, first_ns, stamp_ns)?[axis];
                Some(((stamp_ns - from_ns) as f64 / MODEL_NS as f64, place))
            })
            .collect();
        let commanded = commanded(course.drive, from_ns, to_ns, axis);
        let sums = (0..TIME_CONSTANTS).flat_map(|i| {
            let model = lagged(&commanded, i as u64 * TIME_CONSTANT_NS);
            let seen = &seen;
            (0..DELAYS).map(move |delay| sums(&model, delay, seen)).collect::<Vec<_>>()
        });
        let sums = sums.collect();
        Some(Self { sums, square: seen.iter().map(|(_, place)| place * place).sum(), count: seen.len() })
    }
}

/// The velocity in force at each step of the model.
fn commanded(drive: &Drive, from_ns: u64, to_ns: u64, axis: usize) -> Vec<f64> {
    let mut next = drive.commands.iter().peekable();
    let mut velocity = 0.0;
    (0..=(to_ns - from_ns) / MODEL_NS)
        .map(|i| {
            while let Some((_, twist)) = next.next_if(|(at_ns, _)| *at_ns <= from_ns + i * MODEL_NS) {
                velocity = [twist.vx_mps, twist.vy_mps, twist.wz_radps][axis];
            }
            velocity
        })
        .collect()
}

/// Places of a first-order lag without delay, one for each step of the model and one more.
fn lagged(commanded: &[f64], time_constant_ns: u64) -> Vec<f64> {
    let (dt_s, keep) = match time_constant_ns {
        0 => (s_from_ns(MODEL_NS), 0.0),
        ns => (s_from_ns(MODEL_NS), (-(MODEL_NS as f64) / ns as f64).exp()),
    };
    let (mut velocity, mut place) = (0.0, 0.0);
    let places = commanded.iter().map(|wanted| {
        velocity = wanted + (velocity - wanted) * keep;
        place += velocity * dt_s;
        place
    });
    std::iter::once(0.0).chain(places).collect()
}

fn sums(model: &[f64], delay: usize, seen: &[(f64, f64)]) -> Sums {
    let mut sums = (0.0, 0.0);
    for (at, place) in seen {
        let at = at - delay as f64;
        if at <= 0.0 {
            continue;
        }
        let (before, share) = (at.floor() as usize, at.fract());
        let (Some(a), Some(b)) = (model.get(before), model.get(before + 1)) else { continue };
        let predicted = a + (b - a) * share;
        sums.0 += predicted * predicted;
        sums.1 += predicted * place;
    }
    sums
}
