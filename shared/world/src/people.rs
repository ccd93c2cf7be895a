//! Walking people: they walk their path at a constant speed, and most of them stop for robot and handler.

use guidance::se2::Point;
use messages::Walker;

/// Who yields stops while robot or handler is nearer than this and ahead, metres, centre to centre.
pub const YIELD_M: f64 = 1.2;
/// Who has waited this long turns round, if the path has a way back, so that nobody waits for ever.
pub const PATIENCE_S: f64 = 8.0;

/// What somebody does at the end of the path.
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

/// Somebody who walks.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// The way walked, world frame; one point for somebody who stands.
    pub path: Vec<Point>,
    /// Speed, metres per second.
    pub speed_mps: f64,
    /// Radius of the body, metres.
    pub radius_m: f64,
    /// What happens at the end of the path.
    pub walk: Walk,
    /// Whether they stop where robot or handler is within [`YIELD_M`] ahead; others walk on until they touch.
    pub yields: bool,
    /// Run time at which they set out, seconds.
    pub start_s: f64,
}

/// Where one of them is.
#[derive(Debug, Clone)]
struct State {
    person: Person,
    /// The path, closed where it is walked as a loop.
    corners: Vec<Point>,
    length_m: f64,
    /// Way from the path's start, metres, and whether it grows.
    at_m: f64,
    onward: bool,
    waited_s: f64,
}

/// All walking people of a world, at one moment.
#[derive(Debug, Clone)]
pub struct People {
    states: Vec<State>,
}

/// Robot or handler, as people see them.
#[derive(Debug, Clone, Copy)]
pub struct Agent {
    /// Place, world frame.
    pub at: Point,
    /// Radius of the body, metres.
    pub radius_m: f64,
}

impl People {
    /// These people at the start of their paths.
    #[must_use]
    pub fn new(people: &[Person]) -> Self {
        Self { states: people.iter().map(State::new).collect() }
    }

    /// The discs that they are.
    pub fn walkers(&self) -> impl Iterator<Item = Walker> + '_ {
        self.states.iter().map(|state| {
            let at = state.place(state.at_m);
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

    /// Lets everybody walk for `dt_s`. Nobody steps into an agent: who would is held, and `touched(person, agent)` is
    /// called.
    pub fn step(&mut self, time_s: f64, dt_s: f64, agents: &[Agent], mut touched: impl FnMut(usize, usize)) {
        for (number, state) in self.states.iter_mut().enumerate() {
            state.step(time_s, dt_s, agents, |agent| touched(number, agent));
        }
    }
}

impl State {
    fn new(person: &Person) -> Self {
        let mut corners = person.path.clone();
        if person.walk == Walk::Loop {
            corners.extend(person.path.first());
        }
        let length_m = corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        Self { person: person.clone(), corners, length_m, at_m: 0.0, onward: true, waited_s: 0.0 }
    }

    /// The place `way_m` along the path.
    fn place(&self, way_m: f64) -> Point {
        let mut left = way_m;
        for pair in self.corners.windows(2) {
            let side = pair[1] - pair[0];
            let length = side.norm();
            if left <= length && length > 0.0 {
                return pair[0] + side * (left / length);
            }
            left -= length;
        }
        self.corners.last().copied().unwrap_or_default()
    }

    /// Way along the path and direction after going `step_m` on.
    fn after(&self, step_m: f64) -> (f64, bool) {
        let to = if self.onward { self.at_m + step_m } else { self.at_m - step_m };
        match self.person.walk {
            Walk::Loop => (to.rem_euclid(self.length_m), self.onward),
            Walk::Once => (to.min(self.length_m), self.onward),
            Walk::BackAndForth if to > self.length_m => ((2.0 * self.length_m - to).max(0.0), false),
            Walk::BackAndForth if to < 0.0 => ((-to).min(self.length_m), true),
            Walk::BackAndForth => (to, self.onward),
        }
    }

    fn step(&mut self, time_s: f64, dt_s: f64, agents: &[Agent], mut touched: impl FnMut(usize)) {
        if self.length_m <= 0.0 || time_s < self.person.start_s {
            return;
        }
        let (from, (way_m, onward)) = (self.place(self.at_m), self.after(self.person.speed_mps * dt_s));
        let to = self.place(way_m);
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
    use super::{Agent, People, Person, Walk};
    use guidance::se2::Point;

    fn walker(walk: Walk, yields: bool) -> People {
        let path = vec![Point::new(0.0, 0.0), Point::new(3.0, 0.0)];
        People::new(&[Person { path, speed_mps: 1.0, radius_m: 0.25, walk, yields, start_s: 0.0 }])
    }

    fn x_after(people: &mut People, seconds: f64, agents: &[Agent]) -> (f64, usize) {
        let mut touches = 0;
        for tick in 0..(seconds * 100.0) as usize {
            people.step(tick as f64 * 0.01, 0.01, agents, |_, _| touches += 1);
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
