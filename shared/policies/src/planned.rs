//! A network proposes, and the planner judges.
//!
//! The planner is the geometric engine: it looks eight actions ahead with robot and handler, by the interaction
//! model, on the remembered map, and asks the shield of every first action. A network knows what mostly comes of an
//! action; the planner knows where this one leads to. docs/evaluation.md has what each does alone and what both do
//! together. Where the team makes no progress, or the network wants for long what the planner finds dearer, the planner
//! decides alone for some seconds. The network can be swapped; the planner is built in, and its time is bounded.

use std::collections::VecDeque;

use guidance::{ActionTable, InteractionModel, Se2};
use messages::{Formation, MAX_ACTIONS};
use settings::PlannerUse;

use crate::geometric::{self, GeometricEngine, Plan};
use crate::{Engine, EngineError, Probabilities, Situation, stand};

/// An action that costs so much more than the best one has its probability divided by e, metres.
const UNIT_M: f64 = 1.0 / 3.0;
/// What costs more is as good as left out, metres.
const COST_MAX_M: f64 = 12.0;
/// A network rules nothing out altogether.
const LEAST: f64 = 1e-6;
/// A team makes no progress where it comes less far than this in the last six decisions, metres, and turns by less,
/// radians.
const PROGRESS_M: f64 = 0.25;
const PROGRESS_RAD: f64 = 0.5;
const PROGRESS_DECISIONS: usize = 6;
/// Number of decisions that the planner then makes alone.
const TAKEN_OVER: usize = 12;
/// A network that chooses so much dearer than the planner would, metres, is overruled as well. What it chose at a
/// decision counts for this share of it at the next one.
const DEARER_M: f64 = 2.0;
const KEPT: f64 = 0.9;

/// See the module.
pub struct PlannedEngine {
    network: Box<dyn Engine>,
    planner: GeometricEngine,
    only_takes_over: bool,
    progress: Progress,
    odometry_incarnation: u32,
}

/// Whether a team makes progress.
#[derive(Debug, Default)]
struct Progress {
    /// Where the robot was at the last decisions (odometry frame).
    places: VecDeque<Se2>,
    /// By how much the last choices were dearer than the planner's, metres.
    dearer_m: f64,
    /// Number of decisions that are still the planner's alone.
    taken_over: usize,
}

impl Progress {
    /// Takes the robot's next pose, and says whether the planner decides alone there: the team made no progress a
    /// moment ago. A network and a planner that want different ways can turn a robot to and fro for ever.
    fn observe(&mut self, odom_from_robot: Se2) -> bool {
        self.taken_over = self.taken_over.saturating_sub(1);
        if self.places.len() == PROGRESS_DECISIONS
            && let Some(from) = self.places.pop_front()
        {
            let came = from.inverse() * odom_from_robot;
            if came.translation.vector.norm() < PROGRESS_M && came.rotation.angle().abs() < PROGRESS_RAD {
                self.taken_over = TAKEN_OVER;
            }
        }
        self.places.push_back(odom_from_robot);
        self.taken_over > 0
    }

    /// Takes what the team is going to do.
    fn chosen(&mut self, probabilities: &Probabilities, costs_m: &[f64; MAX_ACTIONS]) {
        let by_p = |a: &usize, b: &usize| probabilities[*a].total_cmp(&probabilities[*b]);
        let chosen = (0..MAX_ACTIONS).max_by(by_p).unwrap_or_default();
        // A network that stops may wait for something.
        let more_m = if chosen == ActionTable::STOP { 0.0 } else { costs_m[chosen] - least_m(costs_m) };
        self.dearer_m = KEPT * self.dearer_m + more_m.min(DEARER_M / 2.0);
        if self.dearer_m > DEARER_M {
            (self.taken_over, self.dearer_m) = (TAKEN_OVER, 0.0);
        }
    }
}

impl PlannedEngine {
    /// Of a network and a planner for the same table.
    #[must_use]
    pub fn new(network: Box<dyn Engine>, planner: GeometricEngine, planner_use: PlannerUse) -> Self {
        let only_takes_over = planner_use == PlannerUse::TakeOver;
        Self { network, planner, only_takes_over, progress: Progress::default(), odometry_incarnation: 0 }
    }
}

impl Engine for PlannedEngine {
    fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        // Both remember, so both look at every decision.
        let costs_m = self.planner.costs_m(&situation.into());
        let proposed = self.network.decide(situation)?;
        if situation.cue_is_new || self.odometry_incarnation != situation.odometry_incarnation {
            self.odometry_incarnation = situation.odometry_incarnation;
            self.progress = Progress::default();
        }
        let makes_none = self.progress.observe(situation.odom_from_robot);
        // No network was trained with a handler behind the robot.
        let is_taken_over = makes_none || situation.formation == Formation::Behind;
        if self.planner.asks_for().is_some() {
            return Ok(stand());
        }
        let Some(costs_m) = costs_m else {
            return Ok(match (situation.formation, self.planner.plan()) {
                (Formation::Behind, _) => stand(),
                // The network may see a way on. A robot that turns here goes back where it came from.
                (Formation::Beside, Plan::End) => self.planner.onward(&proposed),
                _ => proposed,
            });
        };
        let decided = if is_taken_over {
            geometric::probabilities(&costs_m)
        } else if self.only_takes_over {
            proposed
        } else {
            judged(&proposed, &costs_m)
        };
        self.progress.chosen(&decided, &costs_m);
        Ok(decided)
    }

    fn asks_for(&self) -> Option<Formation> {
        self.planner.asks_for()
    }

    fn walks_in_single_file(&self) -> bool {
        true
    }

    fn take_handler(&mut self, model: &InteractionModel) {
        self.planner.take_handler(model);
    }
}

fn least_m(costs_m: &[f64; MAX_ACTIONS]) -> f64 {
    costs_m.iter().copied().fold(f64::INFINITY, f64::min)
}

/// What is proposed, times what the planner makes of it.
fn judged(proposed: &Probabilities, costs_m: &[f64; MAX_ACTIONS]) -> Probabilities {
    let least_m = least_m(costs_m);
    let mut weights = [0.0; MAX_ACTIONS];
    for (weight, (p, cost_m)) in weights.iter_mut().zip(proposed.iter().zip(costs_m)) {
        if cost_m.is_finite() {
            let more_m = (cost_m - least_m).min(COST_MAX_M);
            *weight = f64::from(*p).max(LEAST) * (-more_m / UNIT_M).exp();
        }
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| (weight / sum) as f32)
}

#[cfg(test)]
mod tests {
    use super::{MAX_ACTIONS, PROGRESS_DECISIONS, Progress, Se2, TAKEN_OVER, judged};
    use nalgebra::Vector2;

    fn of<T: Copy>(none: T, first: &[T]) -> [T; MAX_ACTIONS] {
        std::array::from_fn(|i| first.get(i).copied().unwrap_or(none))
    }

    fn best(probabilities: &[f32]) -> usize {
        let all = probabilities.iter().enumerate();
        all.max_by(|a, b| a.1.total_cmp(b.1)).expect("some").0
    }

    #[test]
    fn the_network_decides_among_what_costs_alike_and_the_planner_elsewhere() {
        let proposed = of(0.0, &[0.05, 0.8, 0.1, 0.05]);
        let alike = judged(&proposed, &of(f64::INFINITY, &[1e3, 5.1, 5.0, 5.0]));
        assert_eq!(best(&alike), 1);
        let dear = judged(&proposed, &of(f64::INFINITY, &[1e3, 7.0, 5.0, 5.0]));
        assert_eq!(best(&dear), 2);
        for probabilities in [alike, dear] {
            assert!((probabilities.iter().sum::<f32>() - 1.0).abs() < 1e-5 && probabilities[4..] == [0.0; 12]);
        }
    }

    #[test]
    fn where_the_planner_finds_no_way_out_to_stop_is_best() {
        let proposed = of(0.0, &[0.0, 1.0, 0.0]);
        assert_eq!(best(&judged(&proposed, &of(f64::INFINITY, &[1e3, 1e4, 1e4]))), 0);
    }

    #[test]
    fn a_network_that_wants_what_is_a_little_dearer_for_long_is_overruled() {
        let taken_after = |more_m: f64| {
            let (mut progress, wants) = (Progress::default(), of(0.0, &[0.0, 1.0, 0.0]));
            let costs_m = of(f64::INFINITY, &[1e3, 5.0 + more_m, 5.0]);
            (0..60_u32).find(|i| {
                let is_taken = progress.observe(Se2::new(Vector2::new(0.25 * f64::from(*i), 0.0), 0.0));
                progress.chosen(&wants, &costs_m);
                is_taken
            })
        };
        assert!(taken_after(0.34).is_some_and(|decisions| (8..12).contains(&decisions)));
        assert_eq!(taken_after(1e3), Some(3));
        assert_eq!((taken_after(0.1), taken_after(0.0)), (None, None));
    }

    #[test]
    fn the_planner_decides_alone_where_the_team_turns_to_and_fro_and_not_for_ever() {
        let mut progress = Progress::default();
        let turned = |i: usize| Se2::new(Vector2::new(0.02 * (i % 2) as f64, 0.0), 0.17 * (i % 2) as f64);
        let taken: Vec<bool> = (0..=PROGRESS_DECISIONS).map(|i| progress.observe(turned(i))).collect();
        assert_eq!(taken.iter().position(|taken| *taken), Some(PROGRESS_DECISIONS));
        // Then it walks on.
        let walks = (1..100).map(|i| progress.observe(Se2::new(Vector2::new(0.2 * f64::from(i), 0.0), 0.0)));
        let taken = walks.take_while(|taken| *taken).count();
        assert!((TAKEN_OVER - 2..TAKEN_OVER + 2).contains(&taken), "{taken}");
    }
}
