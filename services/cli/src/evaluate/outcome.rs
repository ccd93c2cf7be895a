//! One episode, decided by a policy.

use std::time::Instant;

use episodes::{Config, Episode, Failure as Failed, Report, Watch};
use guidance::se2::Point;
use guidance::shield::{choose, suppress};
use guidance::{ActionTable, Draw};
use messages::{CueKind, Formation};
use policies::{Pilot, Situation};
use settings::Choice;
use world::Site;

use crate::exit::Failure;

/// Metres and radians; poses are normalised, and may be off by rounding.
const STILL: f64 = 1e-9;
/// The same on legs.
const STILL_ON_LEGS: f64 = 0.02;

/// What became of an episode.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Its figures.
    pub report: Report,
    /// After its end stop was asked for: stop was all that the pilot left, and the robot did not move any more; on legs
    /// from the decision after it on.
    pub stopped: bool,
    /// Why it failed, where it did.
    pub failed: Option<Failed>,
    /// From what is seen to what is decided, microseconds, for each decision.
    pub latency_us: Vec<f32>,
    /// Where it went, where that was wanted.
    pub trace: Option<Box<Trace>>,
}

impl Outcome {
    /// What an equal program gives again.
    pub fn told(&self) -> (Report, bool, Option<Failed>) {
        (self.report, self.stopped, self.failed)
    }
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

fn situation(episode: &Episode) -> Situation<'_> {
    let ((scan, ranges), (cue, start_from_robot, cue_is_new)) = (episode.scan(), episode.cue());
    Situation {
        scan,
        ranges,
        evidence: episode.evidence(),
        handler: episode.body(),
        odom_from_robot: *episode.odom_from_robot(),
        odometry_incarnation: episode.incarnation(),
        start_from_robot,
        cue,
        cue_is_new,
        // Episodes have no voice that asks for another.
        formation: Formation::Beside,
    }
}

fn decide(episode: &Episode, pilot: &mut Pilot) -> Result<policies::Probabilities, Failure> {
    pilot.decide(&situation(episode)).map_err(Failure::of_run)
}

/// How an episode is walked.
#[derive(Debug, Clone, Copy)]
pub struct Way {
    /// The shield's suppression factor.
    pub beta: f64,
    /// How an action is chosen among those that are left.
    pub choice: Choice,
    /// Where it goes is kept.
    pub traced: bool,
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
    way: Way,
) -> Result<Outcome, Failure> {
    episode.begin(seed);
    pilot.take_handler(episode.handler_model());
    let draw = way.choice.seeded(seed);
    let count = config.table.len();
    let chosen = |episode: &Episode, probabilities: policies::Probabilities, decision: u64| {
        let probabilities: Vec<f64> = probabilities[..count].iter().map(|p| f64::from(*p)).collect();
        let wanted = choose(&probabilities, Draw::ArgMax, decision);
        let suppressed = suppress(&probabilities, episode.mask_for(wanted), way.beta);
        (wanted, choose(&suppressed.probabilities[..count], draw, decision))
    };
    let mut latency_us = Vec::with_capacity(config.decisions);
    let mut trace = way.traced.then(|| {
        let line = episode.task().line.corners().to_vec();
        Box::new(Trace { site: episode.site().clone(), line, places: Vec::new(), collisions: Vec::new() })
    });
    let (mut watch, start) = (Watch::begin(episode), episode.team().world_from_handler());
    for decision in 0.. {
        let begun = Instant::now();
        let decided = decide(episode, pilot)?;
        latency_us.push(begun.elapsed().as_secs_f32() * 1e6);
        let (wanted, action) = chosen(episode, decided, decision);
        episode.wants(wanted, action);
        let collisions = episode.report().collisions;
        let ended = episode.step(action).ended;
        watch.step(episode, config, action != ActionTable::STOP);
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
    let decided = decide(episode, pilot)?;
    let leaves_stop = decided[..count].iter().enumerate().all(|(action, p)| action == ActionTable::STOP || *p == 0.0);
    let (_, action) = chosen(episode, decided, u64::from(report.decisions));
    // A robot on legs overruns in the decision in which it is to stop, and sways after it.
    let still = if episode.team().attitude().is_known() {
        episode.step(action);
        STILL_ON_LEGS
    } else {
        STILL
    };
    let there = *episode.team().world_from_robot();
    episode.step(action);
    let moved = there.inverse() * episode.team().world_from_robot();
    let stood = moved.translation.vector.norm() < still && moved.rotation.angle().abs() < still;
    let stopped = leaves_stop && stood;
    let failed = watch.failure(episode, &start, &report, stopped);
    Ok(Outcome { report, stopped, failed, latency_us, trace })
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use episodes::{Config, Episode};
    use policies::{Engine, Expected, LearntEngine, Model, ModelKind};
    use settings::{PolicyModel, Settings};

    use super::situation;

    #[test]
    fn the_network_is_fed_with_what_it_was_trained_on() {
        let expected = Expected::of(&Settings::default());
        let model = Model::named(&PolicyModel::Guide, &expected).expect("a model").expect("the learnt one");
        let ModelKind::Learnt { bytes } = &model.kind else { panic!("{model:?}") };
        let mut engine = LearntEngine::load(Path::new("guide.onnx"), bytes, &model.manifest, None).expect("a network");
        let config = Config { frames: model.manifest.frames, ..Config::default() };
        let mut episode = Episode::new(Arc::new(config)).expect("sensors");
        for seed in 0..3 {
            episode.begin(seed);
            for decision in 0..20 {
                engine.decide(&situation(&episode)).expect("probabilities");
                assert!(engine.observation() == episode.observation(), "seed {seed}, decision {decision}");
                episode.step([1, 1, 2, 1, 1, 3, 6][decision % 7]);
            }
        }
    }
}
