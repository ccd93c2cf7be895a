//! The metrics of SocNavBench by their names and definitions (`metrics/metrics_sim_utils.py`,
//! `metrics/cost_functions.py`), on a trajectory of 0.05 s steps, its simulator's.
//!
//! `time_to_collision` takes robot and people of the same step; the original takes the robot's velocity of the step
//! before. Steps without a pedestrian, or at which none comes nearer, do not count; the original has the value of the
//! step before there, or -1. `closest_pedestrian_distance` begins with the first pedestrian, the original with 0.
//! `personal_space_cost` is named there and has no definition.

use guidance::se2::Point;
use nalgebra::Vector2;
use serde::Serialize;

use crate::Passage;
use crate::walk::{End, TICK_S, Trace, place};

/// Ticks of a step, and its length, seconds.
const TICKS: usize = 2;
const DT_S: f64 = TICKS as f64 * TICK_S;

/// What became of an episode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metrics {
    /// The robot came to the goal in time and touched nothing that stands.
    pub success: bool,
    /// `Success`, `Timeout` or `Obstacle Collision`.
    pub termination_cause: &'static str,
    /// Time taken, seconds.
    pub total_sim_time_taken: f64,
    /// Time that it had, seconds.
    pub sim_time_budget: f64,
    /// Mean and greatest speed, m/s.
    pub robot_speed: [f64; 2],
    /// Sum of the squared speeds of all steps, m^2/s^2.
    pub robot_motion_energy: f64,
    /// Mean and greatest size of the acceleration, m/s^2.
    pub robot_acceleration: [f64; 2],
    /// Mean and greatest size of the jerk, m/s^3.
    pub robot_jerk: [f64; 2],
    /// Length of the way, metres.
    pub path_length: f64,
    /// Length of the way to the distance from start to goal.
    pub path_length_ratio: f64,
    /// Distance to the goal at the end to that at the start.
    pub goal_traversal_ratio: f64,
    /// Mean angle between the way to the goal and the robot's place vector, radians: as the original computes it.
    pub path_irregularity: f64,
    /// Least and mean distance from the robot's middle to the nearest pedestrian, metres; none without a pedestrian.
    pub closest_pedestrian_distance: Option<[f64; 2]>,
    /// Least and mean time to a collision with a pedestrian over the steps that have one, seconds.
    pub time_to_collision: Option<[f64; 2]>,
    /// Touches with people into which robot or handler moved.
    pub pedestrian_collisions: usize,
    /// Touches by people who walked into robot or handler: recorded people do not react.
    pub hit_by_others: usize,
}

/// The metrics of a passage. `robot_radius_m` is the robot's.
#[must_use]
pub fn of(passage: &Passage, trace: &Trace, robot_radius_m: f64) -> Metrics {
    let ways: Vec<Point> = trace.robot.iter().step_by(TICKS).map(place).collect();
    let start = ways[0];
    let last = trace.robot.last().map_or(start, place);
    let success = trace.end == End::Goal;
    let velocities = differences(&ways.iter().map(|place| place.coords).collect::<Vec<_>>());
    let accelerations = differences(&velocities);
    let jerks = differences(&accelerations);
    let path_length: f64 = ways.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    let closest = closest_m(passage, &ways);
    let times = times_to_collision_s(passage, &ways, &velocities, robot_radius_m);
    let by_them = trace.met.iter().filter(|met| met.by_them).count();
    let displacement_m = (passage.goal - start).norm();
    Metrics {
        success,
        termination_cause: match trace.end {
            End::Goal => "Success",
            End::TimeOut => "Timeout",
            End::Collision(_) => "Obstacle Collision",
        },
        total_sim_time_taken: trace.time_s(),
        sim_time_budget: passage.time_max_s,
        robot_speed: mean_and_most(&velocities),
        robot_motion_energy: velocities.iter().map(Vector2::norm_squared).sum(),
        robot_acceleration: mean_and_most(&accelerations),
        robot_jerk: mean_and_most(&jerks),
        path_length,
        path_length_ratio: (path_length + 1e-5) / displacement_m,
        goal_traversal_ratio: (passage.goal - last).norm() / displacement_m,
        path_irregularity: irregularity_rad(&ways, if success { ways[ways.len() - 1] } else { passage.goal }),
        closest_pedestrian_distance: least_and_mean(&closest),
        time_to_collision: least_and_mean(&times),
        pedestrian_collisions: trace.met.len() - by_them,
        hit_by_others: by_them,
    }
}

/// From one step to the next, for a second.
fn differences(of: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    of.windows(2).map(|pair| (pair[1] - pair[0]) / DT_S).collect()
}

fn mean_and_most(of: &[Vector2<f64>]) -> [f64; 2] {
    let sizes = || of.iter().map(Vector2::norm);
    [sizes().sum::<f64>() / of.len().max(1) as f64, sizes().fold(0.0, f64::max)]
}

fn least_and_mean(of: &[f64]) -> Option<[f64; 2]> {
    let least = of.iter().copied().reduce(f64::min)?;
    Some([least, of.iter().sum::<f64>() / of.len() as f64])
}

/// `path_irregularity`.
fn irregularity_rad(ways: &[Point], goal: Point) -> f64 {
    let angle = |at: &Point| {
        let to = goal - at;
        let cos = to.dot(&at.coords) / (to.norm() * at.coords.norm() + 1e-10);
        cos.clamp(-1.0, 1.0).acos()
    };
    ways.iter().map(angle).sum::<f64>() / ways.len() as f64
}

/// The distance to the nearest pedestrian at each step, from the first one that has any; later steps without
/// pedestrians repeat the last distance.
fn closest_m(passage: &Passage, ways: &[Point]) -> Vec<f64> {
    let mut last = None;
    let at_step = |(step, robot): (usize, &Point)| {
        let apart = passage.crowd.at(step as f64 * DT_S).map(|(_, at)| (at - robot).norm());
        last = apart.reduce(f64::min).or(last);
        last
    };
    ways.iter().enumerate().filter_map(at_step).collect()
}

/// The least time after which robot and a pedestrian would meet at each step at which they come nearer.
fn times_to_collision_s(
    passage: &Passage,
    ways: &[Point],
    velocities: &[Vector2<f64>],
    robot_radius_m: f64,
) -> Vec<f64> {
    let at_step = |(step, velocity): (usize, &Vector2<f64>)| {
        let (then_s, now_s) = (step as f64 * DT_S, (step + 1) as f64 * DT_S);
        let robot = ways[step + 1];
        let time_s = |(person, at): (usize, Point)| {
            // A pedestrian who appears now stands for a step.
            let before = passage.crowd.people[person].at(then_s).unwrap_or(at);
            let to = robot - at;
            let closing_mps = ((at - before) / DT_S - velocity).dot(&to) / to.norm();
            let time_s = (to.norm() - robot_radius_m) / closing_mps;
            (time_s > 0.0).then_some(time_s)
        };
        passage.crowd.at(now_s).filter_map(time_s).reduce(f64::min)
    };
    velocities.iter().enumerate().filter_map(at_step).collect()
}

#[cfg(test)]
mod tests {
    use super::of;
    use crate::walk::{End, Met, Passage, TICK_S, Trace, start};
    use crate::{Crowd, Recorded};
    use guidance::se2::Point;
    use world::World;

    /// Four seconds at 1 m/s from (1, 0) to (5, 0); a pedestrian comes the other way, 1 m beside.
    fn walked() -> (Passage, Trace) {
        let places = vec![(0.0, Point::new(9.0, 1.0)), (10.0, Point::new(-1.0, 1.0))];
        let passage = Passage {
            world: World::new(10.0, Vec::new()),
            crowd: Crowd { people: vec![Recorded { name: "1".into(), places }], radius_m: 0.2 },
            world_from_start: start(1.0, 0.0, 0.0),
            goal: Point::new(5.2, 0.0),
            goal_m: 0.3,
            begins_m: 0.0,
            time_max_s: 60.0,
            is_localised: true,
        };
        let robot = (0..=160).map(|tick| start(1.0 + f64::from(tick) * TICK_S, 0.0, 0.0)).collect();
        let met = vec![Met { time_s: 1.0, person: 0, by_them: true }, Met { time_s: 3.0, person: 0, by_them: false }];
        let trace = Trace { end: End::Goal, began_s: 0.0, robot, handler: vec![], met, all_unsafe: 0, decisions: 20 };
        (passage, trace)
    }

    #[test]
    fn a_straight_walk_has_the_metrics_that_are_computed_by_hand() {
        let (passage, trace) = walked();
        let metrics = of(&passage, &trace, 0.24);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} {b}");
        assert!(metrics.success && metrics.termination_cause == "Success");
        near(metrics.total_sim_time_taken, 4.0);
        near(metrics.path_length, 4.0);
        near(metrics.path_length_ratio, 4.00001 / 4.2);
        near(metrics.goal_traversal_ratio, 0.2 / 4.2);
        near(metrics.robot_speed[0], 1.0);
        near(metrics.robot_motion_energy, 80.0);
        near(metrics.robot_acceleration[1], 0.0);
        // Along the x axis the way to the goal and the place have the same direction; at the goal it has none.
        // The small number that the original adds to the product of the lengths turns it by 1e-5.
        assert!((metrics.path_irregularity - std::f64::consts::FRAC_PI_2 / 81.0).abs() < 1e-4);
        // They pass each other after 4 s, 1 m apart.
        let [least_m, _] = metrics.closest_pedestrian_distance.expect("a pedestrian");
        near(least_m, 1.0);
        assert!(metrics.time_to_collision.expect("they come nearer")[0] > 0.0);
        assert_eq!((metrics.pedestrian_collisions, metrics.hit_by_others), (1, 1));
    }

    #[test]
    fn a_walk_without_pedestrians_has_no_distance_to_them() {
        let (mut passage, mut trace) = walked();
        (passage.crowd, trace.end) = (Crowd::default(), End::TimeOut);
        let metrics = of(&passage, &trace, 0.24);
        assert_eq!((metrics.closest_pedestrian_distance, metrics.time_to_collision), (None, None));
        assert_eq!((metrics.success, metrics.termination_cause), (false, "Timeout"));
    }
}
