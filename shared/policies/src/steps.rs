//! A policy that guides no one: it plays a fixed course of single motions, each followed by a stop, in an empty room.
//! A recording of it tells how the robot answers a command (`guidedog fit-robot`). The shield judges its actions like
//! those of any policy; one that it forbids is left out, and the course goes on.

use guidance::ActionTable;
use messages::{CueKind, MAX_ACTIONS};

use crate::{Engine, EngineError, Probabilities, Situation, stand};

/// How long a motion lasts, seconds.
const MOTION_S: f64 = 2.0;
/// The last turn of a round: with 10 degrees in half a second it is a right angle, so that four rounds end where they
/// began, seconds.
const CORNER_S: f64 = 4.5;
/// How long the robot stands after each motion, seconds: a legged robot needs up to 2.8 s until it stands still.
const STOP_S: f64 = 3.0;
/// The motions of a round.
const ROUND: [(&str, f64); 8] = [
    ("forward", MOTION_S),
    ("sidestep_left", MOTION_S),
    ("sidestep_right", MOTION_S),
    ("turn_left", MOTION_S),
    ("turn_right", MOTION_S),
    ("diagonal_left", MOTION_S),
    ("diagonal_right", MOTION_S),
    ("turn_left", CORNER_S),
];
/// Two squares. Each motion is then made eight times.
const ROUNDS: usize = 8;

/// The course, begun anew by every new cue of forward.
#[derive(Debug)]
pub struct StepsEngine {
    /// An action for each decision.
    course: Vec<usize>,
    next: usize,
}

impl StepsEngine {
    /// The course for that table and decision period, seconds. A motion that the table does not have is a stop.
    #[must_use]
    pub fn new(table: &ActionTable, dt_s: f64) -> Self {
        let decisions = |s: f64| (s / dt_s).round().max(1.0) as usize;
        let mut round = Vec::new();
        for (name, s) in ROUND {
            let action = table.index_of(name).unwrap_or(ActionTable::STOP);
            round.extend(std::iter::repeat_n(action, decisions(s)));
            round.extend(std::iter::repeat_n(ActionTable::STOP, decisions(STOP_S)));
        }
        let mut course = vec![ActionTable::STOP; decisions(STOP_S)];
        for _ in 0..ROUNDS {
            course.extend(&round);
        }
        Self { course, next: 0 }
    }

    /// How long the course takes, in decisions.
    #[must_use]
    pub fn decisions(&self) -> usize {
        self.course.len()
    }
}

impl Engine for StepsEngine {
    fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        if situation.cue != CueKind::Forward {
            return Ok(stand());
        }
        if situation.cue_is_new {
            self.next = 0;
        }
        let Some(action) = self.course.get(self.next) else { return Ok(stand()) };
        self.next += 1;
        let mut probabilities = [0.0; MAX_ACTIONS];
        probabilities[*action] = 1.0;
        Ok(probabilities)
    }
}

#[cfg(test)]
mod tests {
    use super::{ROUND, ROUNDS, StepsEngine};
    use guidance::ActionTable;
    use guidance::se2::{Se2, pose2};

    #[test]
    fn a_course_has_every_motion_with_a_stop_after_it_and_ends_where_it_began() {
        for (table, dt_s) in [(ActionTable::eight(), 0.5), (ActionTable::ten(), 0.25)] {
            let engine = StepsEngine::new(&table, dt_s);
            let motions: Vec<usize> = engine.course.chunk_by(|a, b| a == b).map(|run| run[0]).collect();
            assert_eq!(motions.len(), 2 * ROUND.len() * ROUNDS + 1);
            for (i, action) in motions.iter().enumerate() {
                assert_eq!(*action == ActionTable::STOP, i % 2 == 0, "motions and stops take turns");
            }
            for action in table.actions().iter().filter(|action| !action.name.starts_with("arc_")).skip(1) {
                let index = table.index_of(&action.name).expect("it is in the table");
                assert!(motions.iter().filter(|motion| **motion == index).count() >= ROUNDS, "{}", action.name);
            }
        }
        let table = ActionTable::eight();
        let engine = StepsEngine::new(&table, 0.5);
        let (mut pose, mut farthest_m) = (Se2::identity(), 0.0_f64);
        for action in &engine.course {
            pose *= table.actions()[*action].start_from_end();
            farthest_m = farthest_m.max(pose.translation.vector.amax());
        }
        let end = pose2(&pose);
        assert!(end.x_m.hypot(end.y_m) < 1e-6 && end.yaw_rad.abs() < 1e-6, "{end:?}");
        assert!(farthest_m < 3.0, "it needs little room: {farthest_m} m");
    }
}
