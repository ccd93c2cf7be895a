//! Relations: how a robot at one time stood to itself at another, checked by hand (Kümmerle et al., *On measuring the
//! accuracy of SLAM algorithms*, Autonomous Robots 27, 2009). One a line: `t1 t2 x y z roll pitch yaw`, seconds of the
//! log's own clock, metres, radians.

use std::path::Path;

use guidance::se2::{Se2, se2};
use messages::Pose2;
use serde::Serialize;

use super::{Place, Which};
use crate::exit::Failure;

/// A relation is of the scans that were sent at its two times; stamps are told to the microsecond.
const SAME_S: f64 = 0.001;
/// Relations over a shorter time are of odometry's own kind; those over a longer one join what a robot came back to.
pub const NEAR_S: f64 = 10.0;

/// Where the robot was at one time, seen from where it was at another.
#[derive(Debug, Clone, Copy)]
pub struct Relation {
    times_s: [f64; 2],
    first_from_second: Se2,
}

/// Reads a file of relations.
pub fn read(path: &Path) -> Result<Vec<Relation>, Failure> {
    let failed = |error| Failure::input(format!("failed to read {}: {error}", path.display()));
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty() && !line.starts_with('#'));
    let relations: Result<Vec<_>, Failure> = lines.map(|(line, number)| parse(path, line, number)).collect();
    relations.and_then(|relations| match relations.is_empty() {
        true => Err(Failure::input(format!("{} holds no relation", path.display()))),
        false => Ok(relations),
    })
}

fn parse(path: &Path, line: &str, number: usize) -> Result<Relation, Failure> {
    let numbers: Option<Vec<f64>> =
        line.split_ascii_whitespace().map(|word| word.parse().ok().filter(|number: &f64| number.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[t1, t2, x_m, y_m, _, _, _, yaw_rad]) => {
            Ok(Relation { times_s: [t1, t2], first_from_second: se2(Pose2::new(x_m, y_m, yaw_rad)) })
        }
        _ => Err(Failure::input(format!("{} line {number} is not t1 t2 x y z roll pitch yaw", path.display()))),
    }
}

/// Errors over relations, metres or degrees.
#[derive(Debug, Clone, Serialize)]
pub struct Spread {
    /// Mean of the absolute errors, and one standard deviation of them,
    pub mean: f64,
    /// as Kümmerle et al. tell it,
    pub deviation: f64,
    /// with the mean of the squared errors.
    pub mean_square: f64,
    /// Its root.
    pub rms: f64,
    /// Half of them are not over it.
    pub median: f64,
    /// All but a twentieth of them are not over it.
    pub p95: f64,
}

impl Spread {
    fn of(mut errors: Vec<f64>) -> Option<Self> {
        errors.sort_by(f64::total_cmp);
        let (n, rank) = (errors.len() as f64, |q: f64| ((q * errors.len() as f64).ceil() as usize).max(1) - 1);
        let (median, p95) = (*errors.get(rank(0.5))?, *errors.get(rank(0.95))?);
        let mean = errors.iter().sum::<f64>() / n;
        let mean_square = errors.iter().map(|error| error * error).sum::<f64>() / n;
        let deviation = (mean_square - mean * mean).max(0.0).sqrt();
        Some(Self { mean, deviation, mean_square, rms: mean_square.sqrt(), median, p95 })
    }
}

/// Errors of one odometry.
#[derive(Debug, Clone, Serialize)]
pub struct Errors {
    /// Of the place.
    pub translation_m: Spread,
    /// Of the heading.
    pub rotation_deg: Spread,
}

/// Raw odometry beside ours.
#[derive(Debug, Serialize)]
pub struct Compared {
    /// Relations that have both of their scans.
    pub n: usize,
    /// Of the robot's own odometry.
    pub raw: Errors,
    /// Of the corrected.
    pub ours: Errors,
    /// Of the corrected, as it goes out.
    pub published: Errors,
}

/// What the relations say of a log.
#[derive(Debug, Serialize)]
pub struct Judged {
    /// Relations one of whose times is no scan's.
    pub unmatched: usize,
    /// All others.
    pub all: Compared,
    /// Those over at most [`NEAR_S`].
    pub near: Option<Compared>,
}

/// Holds the places of a log against the relations; `None` where most of them are of another log.
pub fn judge(relations: &[Relation], places: &[Place]) -> Option<Judged> {
    let mut by_time: Vec<&Place> = places.iter().collect();
    by_time.sort_by(|a, b| a.sent_s.total_cmp(&b.sent_s));
    let place_at = |time_s: f64| {
        let after = by_time.partition_point(|place| place.sent_s < time_s - SAME_S);
        by_time.get(after).copied().filter(|place| place.sent_s <= time_s + SAME_S)
    };
    let matched: Vec<(&Relation, [&Place; 2])> = relations
        .iter()
        .filter_map(|relation| Some((relation, [place_at(relation.times_s[0])?, place_at(relation.times_s[1])?])))
        .collect();
    if 2 * matched.len() < relations.len() {
        return None;
    }
    let is_near = |relation: &Relation| (relation.times_s[1] - relation.times_s[0]).abs() <= NEAR_S;
    let near: Vec<_> = matched.iter().copied().filter(|(relation, _)| is_near(relation)).collect();
    let unmatched = relations.len() - matched.len();
    Some(Judged { unmatched, all: compare(&matched)?, near: compare(&near) })
}

fn compare(matched: &[(&Relation, [&Place; 2])]) -> Option<Compared> {
    let errors = |which: Which| {
        let off = |(relation, [first, second]): &(&Relation, [&Place; 2])| {
            let found = first.pose(which).inverse() * second.pose(which);
            relation.first_from_second.inverse() * found
        };
        let offs: Vec<Se2> = matched.iter().map(off).collect();
        let translation_m = Spread::of(offs.iter().map(|off| off.translation.vector.norm()).collect())?;
        let rotation_deg = Spread::of(offs.iter().map(|off| off.rotation.angle().abs().to_degrees()).collect())?;
        Some(Errors { translation_m, rotation_deg })
    };
    let (raw, ours, published) = (errors(Which::Raw)?, errors(Which::Ours)?, errors(Which::Published)?);
    Some(Compared { n: matched.len(), raw, ours, published })
}
