//! Walking people. Most walk their path at a constant speed, and stop for robot and handler. Others walk along their
//! path by the social force model ([`social`]): they walk round people, robot, handler and walls.

pub mod social;
mod stroll;
mod way;

use guidance::se2::Point;
use messages::Walker;

use crate::World;
use social::Mover;
use stroll::Strolls;
use way::Way;

/// A person who yields stops while robot or handler is ahead and nearer than this, metres, centre to centre.
pub const YIELD_M: f64 = 1.2;
/// A person who has waited this long turns round, if the path leads back, and so does not wait for ever.
pub const PATIENCE_S: f64 = 8.0;

/// What a person does at the end of the path.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Walk {
    /// Turns round.
    #[default]
    BackAndForth,
    /// Goes on to the path's first point.
    Loop,
    /// Stands still there.
    Once,
}

/// How a person walks along the path.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Moves {
    /// On the path itself, at a constant speed.
    #[default]
    Path,
    /// By the social force model, towards the path's end.
    Social(Manner),
}

/// What a person of the social force model does besides.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Manner {
    /// People of the same number walk together.
    pub group: Option<u32>,
    /// Stops in the way, in the order of the path.
    pub pauses: Vec<Pause>,
}

/// A stop on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pause {
    /// Where, along the path from its start, metres. It counts once, on the first way past.
    pub way_m: f64,
    /// For how long, seconds.
    pub for_s: f64,
}

/// A person who walks.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// The way walked, world frame; one point for a person who stands.
    pub path: Vec<Point>,
    /// Speed, metres per second.
    pub speed_mps: f64,
    /// Radius of the body, metres.
    pub radius_m: f64,
    /// What happens at the end of the path.
    pub walk: Walk,
    /// Whether they stop where robot or handler is within [`YIELD_M`] ahead, or walk round them in the social force
    /// model; others walk on until they touch.
    pub yields: bool,
    /// Run time at which they set out, seconds.
    pub start_s: f64,
    /// How they walk.
    pub moves: Moves,
}

/// Where one of them is.
#[derive(Debug, Clone)]
struct State {
    person: Person,
    path: Way,
    /// Way from the path's start, metres, and whether it grows.
    at_m: f64,
    onward: bool,
    waited_s: f64,
}

/// All walking people of a world, at one moment.
#[derive(Debug, Clone)]
pub struct People {
    states: Vec<State>,
    /// Those of them who walk by the social force model.
    strolls: Strolls,
}

/// Robot or handler, as people and doors see them; or a person, as doors do.
#[derive(Debug, Clone, Copy)]
pub struct Agent {
    /// Place, world frame.
    pub at: Point,
    /// Radius of the body, metres.
    pub radius_m: f64,
}

impl From<&Walker> for Agent {
    fn from(walker: &Walker) -> Self {
        Self { at: Point::new(walker.x_m, walker.y_m), radius_m: walker.radius_m }
    }
}

impl People {
    /// These people at the start of their paths.
    #[must_use]
    pub fn new(people: &[Person]) -> Self {
        Self { states: people.iter().map(State::new).collect(), strolls: Strolls::new(people) }
    }

    /// The discs that they are.
    pub fn walkers(&self) -> impl Iterator<Item = Walker> + '_ {
        self.states.iter().enumerate().map(|(number, state)| {
            let at = self.strolls.place(number).unwrap_or_else(|| state.path.place(state.at_m));
            Walker { x_m: at.x, y_m: at.y, radius_m: state.person.radius_m }
        })
    }

    /// How many they are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.states.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.states.is_empty()
    }

    /// All people walk for `dt_s` in their world. A person who would step into an agent is held, and
    /// `touched(person, agent)` is called once for the two. Agents keep their order from step to step.
    pub fn step(
        &mut self,
        world: &World,
        time_s: f64,
        dt_s: f64,
        agents: &[Agent],
        mut touched: impl FnMut(usize, usize),
    ) {
        let mut on_paths = Vec::new();
        for (number, state) in self.states.iter_mut().enumerate() {
            if matches!(state.person.moves, Moves::Social(_)) {
                continue;
            }
            let from = state.path.place(state.at_m);
            state.step(time_s, dt_s, agents, |agent| touched(number, agent));
            if !self.strolls.is_empty() {
                let at = state.path.place(state.at_m);
                on_paths.push(Mover { at, velocity: (at - from) / dt_s, radius_m: state.person.radius_m });
            }
        }
        self.strolls.step(world, (time_s, dt_s), agents, &on_paths, touched);
    }
}

impl State {
    fn new(person: &Person) -> Self {
        Self { person: person.clone(), path: Way::of(person), at_m: 0.0, onward: true, waited_s: 0.0 }
    }

    /// Way along the path and direction after going `step_m` on.
    fn after(&self, step_m: f64) -> (f64, bool) {
        let to = if self.onward { self.at_m + step_m } else { self.at_m - step_m };
        match self.person.walk {
            Walk::Loop => (to.rem_euclid(self.path.length_m), self.onward),
            Walk::Once => (to.min(self.path.length_m), self.onward),
            Walk::BackAndForth if to > self.path.length_m => ((2.0 * self.path.length_m - to).max(0.0), false),
            Walk::BackAndForth if to < 0.0 => ((-to).min(self.path.length_m), true),
            Walk::BackAndForth => (to, self.onward),
        }
    }

    fn step(&mut self, time_s: f64, dt_s: f64, agents: &[Agent], mut touched: impl FnMut(usize)) {
        if self.path.length_m <= 0.0 || time_s < self.person.start_s {
            return;
        }
        let (from, (way_m, onward)) = (self.path.place(self.at_m), self.after(self.person.speed_mps * dt_s));
        let to = self.path.place(way_m);
        let mut held = false;
        for (number, agent) in agents.iter().enumerate() {
            let (before, after) = ((agent.at - from).norm(), (agent.at - to).norm());
            let ahead = (agent.at - from).dot(&(to - from)) > 0.0;
            if after < agent.radius_m + self.person.radius_m && after < before {
                touched(number);
                held = true;
            }
            held |= self.person.yields && ahead && before < YIELD_M;
        }
        if !held {
            (self.at_m, self.onward, self.waited_s) = (way_m, onward, 0.0);
            return;
        }
        self.waited_s += dt_s;
        if self.waited_s >= PATIENCE_S && self.person.walk != Walk::Once {
            (self.onward, self.waited_s) = (!self.onward, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Agent, Moves, People, Person, Walk};
    use crate::World;
    use guidance::se2::Point;

    fn walker(walk: Walk, yields: bool) -> People {
        let path = vec![Point::new(0.0, 0.0), Point::new(3.0, 0.0)];
        let moves = Moves::Path;
        People::new(&[Person { path, speed_mps: 1.0, radius_m: 0.25, walk, yields, start_s: 0.0, moves }])
    }

    fn x_after(people: &mut People, seconds: f64, agents: &[Agent]) -> (f64, usize) {
        let (world, mut touches) = (World::new(2.6, Vec::new()), 0);
        for tick in 0..(seconds * 100.0) as usize {
            people.step(&world, tick as f64 * 0.01, 0.01, agents, |_, _| touches += 1);
        }
        (people.walkers().next().unwrap().x_m, touches)
    }

    #[test]
    fn paths_end_as_they_say() {
        for (walk, x) in [(Walk::BackAndForth, 2.0), (Walk::Loop, 2.0), (Walk::Once, 3.0)] {
            let (reached, _) = x_after(&mut walker(walk, true), 4.0, &[]);
            assert!((reached - x).abs() < 1e-9, "{walk:?}: {reached}");
        }
    }

    #[test]
    fn who_yields_stops_before_and_who_does_not_stops_at_the_touch() {
        let agent = [Agent { at: Point::new(2.5, 0.0), radius_m: 0.3 }];
        let (x, touches) = x_after(&mut walker(Walk::Once, true), 5.0, &agent);
        assert!((x - 1.3).abs() < 0.02 && touches == 0);
        let (x, touches) = x_after(&mut walker(Walk::Once, false), 5.0, &agent);
        assert!((x - 1.95).abs() < 0.02 && touches > 100, "{x} {touches}");
        let (x, _) = x_after(&mut walker(Walk::BackAndForth, true), 9.7, &agent);
        assert!(x < 1.0, "patience ends: {x}");
    }
}
