//! One episode, decided by a policy.

use std::time::Instant;

use episodes::{Config, Episode, Report};
use guidance::se2::Point;
use guidance::shield::{choose, suppress};
use guidance::{ActionTable, Draw};
use messages::CueKind;
use policies::{Pilot, Situation};
use world::Site;

use crate::exit::Failure;

/// What became of an episode.
#[derive(Debug, Clone)]
pub struct Course {
    /// Its figures.
    pub report: Report,
    /// After its end stop was asked for, and the next decision stood.
    pub stopped: bool,
    /// From what is seen to what is decided, microseconds, for each decision.
    pub latency_us: Vec<f32>,
    /// Where it went, where that was wanted.
    pub trace: Option<Box<Trace>>,
}

/// Where an episode went.
#[derive(Debug, Clone)]
pub struct Trace {
    /// The world and its ways.
    pub site: Site,
    /// The way that was meant.
    pub line: Vec<Point>,
    /// Robot and handler at each decision.
    pub places: Vec<(Point, Point)>,
    /// Where motions were refused.
    pub collisions: Vec<Point>,
}

fn decide(episode: &Episode, pilot: &mut Pilot) -> Result<policies::Probabilities, Failure> {
    let awareness = episode.awareness();
    let evidence = awareness.evidence();
    let ((scan, ranges), (cue, start_from_robot, cue_is_new)) = (episode.scan(), episode.cue());
    let situation = Situation {
        scan,
        ranges,
        evidence,
        handler: awareness.handler().body(evidence.beams.sigma_m()),
        odom_from_robot: *episode.odom_from_robot(),
        odometry_incarnation: episode.incarnation(),
        start_from_robot,
        cue,
        cue_is_new,
    };
    pilot.decide(&situation).map_err(Failure::of_run)
}

/// Runs the episode of a seed.
///
/// # Errors
/// Where the policy cannot decide.
pub fn walk(
    episode: &mut Episode,
    pilot: &mut Pilot,
    config: &Config,
    seed: u64,
    beta: f64,
    draws: bool,
    traced: bool,
) -> Result<Course, Failure> {
    episode.begin(seed);
    let draw = if draws { Draw::Seeded(seed) } else { Draw::ArgMax };
    let count = config.table.len();
    let mut latency_us = Vec::with_capacity(config.decisions);
    let mut trace = traced.then(|| {
        let line = episode.task().line.corners().to_vec();
        Box::new(Trace { site: episode.site().clone(), line, places: Vec::new(), collisions: Vec::new() })
    });
    for decision in 0.. {
        let begun = Instant::now();
        let decided = decide(episode, pilot)?;
        latency_us.push(begun.elapsed().as_secs_f32() * 1e6);
        let probabilities: Vec<f64> = decided[..count].iter().map(|p| f64::from(*p)).collect();
        let suppressed = suppress(&probabilities, episode.unsafe_mask(), beta);
        let action = choose(&suppressed.probabilities[..count], draw, decision);
        let collisions = episode.report().collisions;
        let ended = episode.step(action).ended;
        if let Some(trace) = &mut trace {
            let team = episode.team();
            let place = |pose: guidance::Se2| Point::from(pose.translation.vector);
            trace.places.push((place(*team.world_from_robot()), place(team.world_from_handler())));
            if episode.report().collisions > collisions {
                trace.collisions.push(place(*team.world_from_robot()));
            }
        }
        if ended {
            break;
        }
    }
    let report = episode.report();
    episode.give(CueKind::Stop);
    let stopped = decide(episode, pilot)?[ActionTable::STOP] == 1.0;
    Ok(Course { report, stopped, latency_us, trace })
}
