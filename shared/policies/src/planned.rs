//! A network proposes, and the planner judges.
//!
//! The planner is the geometric engine: it looks eight actions ahead with robot and handler, by the interaction
//! model, on the remembered map, and asks the shield of every first action. A network knows what mostly comes of an
//! action; the planner knows where this one leads to. docs/evaluation.md has what each does alone and what both do
//! together. The network can be swapped; the planner is built in, and its time is bounded.

use std::collections::VecDeque;

use guidance::Se2;
use messages::MAX_ACTIONS;
use settings::PlannerUse;

use crate::geometric::{self, GeometricEngine};
use crate::{Engine, EngineError, Probabilities, Situation};

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

/// See the module.
pub struct PlannedEngine {
    network: Box<dyn Engine>,
    planner: GeometricEngine,
    takes_over: bool,
    /// Where the robot was at the last decisions (odometry frame).
    places: VecDeque<Se2>,
    odometry_incarnation: u32,
    taken_over: usize,
}

impl PlannedEngine {
    /// Of a network and a planner for the same table.
    #[must_use]
    pub fn new(network: Box<dyn Engine>, planner: GeometricEngine, planner_use: PlannerUse) -> Self {
        let takes_over = planner_use == PlannerUse::TakeOver;
        Self { network, planner, takes_over, places: VecDeque::new(), odometry_incarnation: 0, taken_over: 0 }
    }

    /// Whether the planner decides alone, because the team makes no progress.
    fn is_taken_over(&mut self, situation: &Situation<'_>) -> bool {
        if situation.cue_is_new || self.odometry_incarnation != situation.odometry_incarnation {
            self.odometry_incarnation = situation.odometry_incarnation;
            self.places.clear();
            self.taken_over = 0;
        }
        self.taken_over = self.taken_over.saturating_sub(1);
        let here = situation.odom_from_robot;
        if self.places.len() == PROGRESS_DECISIONS
            && let Some(from) = self.places.pop_front()
        {
            let came = from.inverse() * here;
            if came.translation.vector.norm() < PROGRESS_M && came.rotation.angle().abs() < PROGRESS_RAD {
                self.taken_over = TAKEN_OVER;
            }
        }
        self.places.push_back(here);
        self.taken_over > 0
    }
}

impl Engine for PlannedEngine {
    fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        // Both remember, so both look at every decision.
        let costs_m = self.planner.costs_m(&situation.into());
        let proposed = self.network.decide(situation)?;
        let is_taken_over = self.is_taken_over(situation);
        Ok(match costs_m {
            // It sees no way: whether it has ended is the network's to say.
            None => proposed,
            Some(costs_m) if self.takes_over => {
                if is_taken_over {
                    geometric::probabilities(&costs_m)
                } else {
                    proposed
                }
            }
            Some(costs_m) => judged(&proposed, &costs_m),
        })
    }
}

/// What is proposed, times what the planner makes of it.
fn judged(proposed: &Probabilities, costs_m: &[f64; MAX_ACTIONS]) -> Probabilities {
    let least_m = costs_m.iter().copied().fold(f64::INFINITY, f64::min);
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
    use super::{MAX_ACTIONS, judged};

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
}
