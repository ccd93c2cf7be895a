//! People who walk by the social force model: along their path, round people and things in the way, with their group,
//! and with stops.

use guidance::se2::Point;
use nalgebra::Vector2;

use super::social::{Mover, SocialForce};
use super::way::Way;
use super::{Agent, Manner, Moves, PATIENCE_S, Person, Walk};
use crate::World;
use crate::physics::STEP_M;
use crate::scene::PERSON_HEIGHT_M;

/// Forces are taken anew at least so often, seconds: a tenth of the time in which people react to them.
const STEP_S: f64 = 0.05;
/// People walk towards the farthest of these places ahead on their path to which the straight way is clear, metres: who
/// was pushed aside does not hurry back. They look for it this often, seconds.
const AHEAD_M: [f64; 4] = [6.0, 4.0, 2.5, 1.2];
const LOOK_S: f64 = 0.25;
/// The path's end is reached within this, metres.
const REACHED_M: f64 = 0.3;
/// How far back on the path, and how far on, a person may get in a step, metres.
const FOOT_M: [f64; 2] = [0.5, 1.0];
/// Walls within this of the body are felt, metres.
const FEEL_M: f64 = 0.6;
/// A person who has not come this far waits, metres.
const CAME_ON_M: f64 = 0.25;
/// The velocities of robot and handler are means over this time, seconds: legs sway.
const SMOOTH_S: f64 = 0.3;
/// An agent that comes farther in a step was put elsewhere, metres per second.
const FASTEST_MPS: f64 = 4.0;
/// The heights in which things are in a person's way, metres.
const HEIGHTS_M: [f64; 2] = [STEP_M, PERSON_HEIGHT_M];

/// All of them.
#[derive(Debug, Clone)]
pub(super) struct Strolls {
    /// Between people: as fitted to recorded tracks.
    law: SocialForce,
    /// Away from robot and handler: as published, which was measured in a corridor, on people who pass one who stands
    /// or comes towards them.
    of_team: SocialForce,
    /// By person; none for those who walk otherwise.
    strolls: Vec<Option<Stroll>>,
    count: usize,
    /// Robot and handler as they were seen last.
    seen: Vec<Mover>,
}

/// One of them.
#[derive(Debug, Clone)]
struct Stroll {
    person: Person,
    manner: Manner,
    path: Way,
    own: Mover,
    /// Way along the path, and whether it grows, metres.
    way_m: f64,
    onward: bool,
    /// How far ahead they walk towards, metres, and how old that is, seconds.
    ahead_m: f64,
    looked_s: f64,
    /// The next of the stops, and how much of one is left, seconds.
    next_pause: usize,
    pause_s: f64,
    /// The way at which they last had come on, metres, and how long ago that was, seconds.
    came_on_m: f64,
    waited_s: f64,
    /// Whether they have touched robot or handler: then they take notice of them.
    noticed: bool,
    /// Agents who were touched in this step, a bit for each.
    touched: u64,
}

impl Strolls {
    pub(super) fn new(people: &[Person]) -> Self {
        let strolls: Vec<_> = people.iter().map(Stroll::of).collect();
        let count = strolls.iter().flatten().count();
        Self { law: SocialForce::default(), of_team: SocialForce::PUBLISHED, strolls, count, seen: Vec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Where a person is; none where they do not walk by the model.
    pub(super) fn place(&self, person: usize) -> Option<Point> {
        self.strolls[person].as_ref().map(|stroll| stroll.own.at)
    }

    /// Lets them walk; see [`super::People::step`].
    pub(super) fn step(
        &mut self,
        world: &World,
        (time_s, dt_s): (f64, f64),
        agents: &[Agent],
        on_paths: &[Mover],
        mut touched: impl FnMut(usize, usize),
    ) {
        if self.is_empty() {
            return;
        }
        self.see(agents, dt_s);
        self.strolls.iter_mut().flatten().for_each(|stroll| stroll.touched = 0);
        let parts = (dt_s / STEP_S - 1e-9).ceil().max(1.0);
        let part_s = dt_s / parts;
        for part in 0..parts as usize {
            let time_s = time_s + part as f64 * part_s;
            let wishes: Vec<_> = (0..self.strolls.len()).map(|i| self.wish(world, i, on_paths, part_s)).collect();
            for (stroll, velocity) in self.strolls.iter_mut().zip(wishes) {
                if let Some(stroll) = stroll {
                    stroll.step(world, velocity, (time_s, part_s), agents);
                }
            }
        }
        for (person, stroll) in self.strolls.iter().enumerate() {
            let bits = stroll.as_ref().map_or(0, |stroll| stroll.touched);
            (0..agents.len()).filter(|agent| bits & (1 << agent) != 0).for_each(|agent| touched(person, agent));
        }
    }

    /// Notes where robot and handler are, and how they move.
    fn see(&mut self, agents: &[Agent], dt_s: f64) {
        let fresh = self.seen.len() != agents.len();
        let seen = agents.iter().enumerate().map(|(i, agent)| {
            let before = self.seen.get(i).filter(|_| !fresh);
            let velocity = before.map_or(Vector2::zeros(), |before| {
                let now = (agent.at - before.at) / dt_s;
                let kept = (1.0 - dt_s / SMOOTH_S).max(0.0);
                if now.norm() > FASTEST_MPS { Vector2::zeros() } else { now + (before.velocity - now) * kept }
            });
            Mover { at: agent.at, velocity, radius_m: agent.radius_m }
        });
        self.seen = seen.collect();
    }

    /// The velocity with which one of them goes on, metres per second.
    fn wish(&self, world: &World, person: usize, on_paths: &[Mover], dt_s: f64) -> Vector2<f64> {
        let Some(stroll) = &self.strolls[person] else { return Vector2::zeros() };
        let (law, own, desired) = (&self.law, &stroll.own, stroll.desired());
        let others = self.strolls.iter().enumerate().filter(|(number, _)| *number != person);
        let others = others.filter_map(|(_, other)| other.as_ref());
        let is_friend = |other: &&Stroll| stroll.manner.group.is_some() && other.manner.group == stroll.manner.group;
        let (friends, strangers): (Vec<&Stroll>, Vec<&Stroll>) = others.partition(is_friend);
        let friends: Vec<Mover> = friends.into_iter().map(|other| other.own).collect();
        let strangers: Vec<Mover> =
            strangers.into_iter().map(|other| other.own).chain(on_paths.iter().copied()).collect();
        let team = if stroll.person.yields || stroll.noticed { self.seen.as_slice() } else { &[] };
        let mut force = law.towards(own, desired) + law.in_group(own, desired, &friends);
        force += strangers.iter().map(|other| law.from_other(own, other)).sum::<Vector2<f64>>();
        force += team.iter().map(|other| self.of_team.from_other(own, other)).sum::<Vector2<f64>>();
        if let Some((distance_m, towards)) = nearest(world, own.at, own.radius_m + FEEL_M) {
            force += law.from_wall(distance_m - own.radius_m, towards);
        }
        let speed_mps = stroll.person.speed_mps;
        law.not_into(team, own, law.next_velocity(own, force, speed_mps, dt_s), speed_mps)
    }
}

impl Stroll {
    fn of(person: &Person) -> Option<Self> {
        let Moves::Social(manner) = &person.moves else { return None };
        let path = Way::of(person);
        let own = Mover { at: path.place(0.0), velocity: Vector2::zeros(), radius_m: person.radius_m };
        Some(Self {
            person: person.clone(),
            manner: manner.clone(),
            path,
            own,
            way_m: 0.0,
            onward: true,
            ahead_m: AHEAD_M[3],
            looked_s: LOOK_S,
            next_pause: 0,
            pause_s: 0.0,
            came_on_m: 0.0,
            waited_s: 0.0,
            noticed: false,
            touched: 0,
        })
    }

    /// The velocity that they wish for, metres per second.
    fn desired(&self) -> Vector2<f64> {
        let goal = self.ahead(self.ahead_m);
        (goal - self.own.at).try_normalize(1e-6).unwrap_or_default() * self.person.speed_mps
    }

    /// The place so far ahead on the path.
    fn ahead(&self, ahead_m: f64) -> Point {
        self.path.place(self.path.after(self.way_m, if self.onward { ahead_m } else { -ahead_m }))
    }

    /// Looks for the place to walk towards, if it is time to.
    fn look(&mut self, world: &World, dt_s: f64) {
        self.looked_s += dt_s;
        if self.looked_s < LOOK_S {
            return;
        }
        let is_clear = |ahead_m: &f64| is_free(world, self.own.at, self.ahead(*ahead_m), self.own.radius_m);
        let [.., nearest_m] = AHEAD_M;
        let ahead_m = AHEAD_M.into_iter().find(is_clear).unwrap_or(nearest_m);
        (self.ahead_m, self.looked_s) = (ahead_m, 0.0);
    }

    /// Whether they stand where they are: before they set out, in a stop, and at the end of a path walked once.
    fn stands(&self, time_s: f64) -> bool {
        let is_there = self.person.walk == Walk::Once && self.way_m >= self.path.length_m - REACHED_M;
        time_s < self.person.start_s || self.pause_s > 0.0 || self.path.length_m <= 0.0 || is_there
    }

    fn step(&mut self, world: &World, velocity: Vector2<f64>, (time_s, dt_s): (f64, f64), agents: &[Agent]) {
        if self.stands(time_s) {
            self.own.velocity = Vector2::zeros();
            self.pause_s = (self.pause_s - dt_s).max(0.0);
            return;
        }
        self.look(world, dt_s);
        let from = self.own.at;
        let to = self.clear_of_agents(self.along_walls(world, from + velocity * dt_s), agents);
        // Giving way to an agent may lead into a wall.
        let to = if is_free(world, from, to, self.own.radius_m) { to } else { from };
        self.own = Mover { at: to, velocity: (to - from) / dt_s, ..self.own };
        self.note_way(dt_s);
    }

    /// Where they get who wish to get there: walls are walked along.
    fn along_walls(&self, world: &World, to: Point) -> Point {
        let (from, radius_m) = (self.own.at, self.own.radius_m);
        if is_free(world, from, to, radius_m) {
            return to;
        }
        let way = to - from;
        let Some((_, towards)) = nearest(world, from, radius_m + way.norm() + FEEL_M) else { return from };
        let along = from + (way - towards * way.dot(&towards).max(0.0));
        if is_free(world, from, along, radius_m) { along } else { from }
    }

    /// The same for robot and handler. Notes whom they would have walked into.
    fn clear_of_agents(&mut self, mut to: Point, agents: &[Agent]) -> Point {
        let from = self.own.at;
        for (number, agent) in agents.iter().enumerate() {
            let limit_m = agent.radius_m + self.own.radius_m;
            let (before, after) = (agent.at - from, agent.at - to);
            if after.norm() >= limit_m || after.norm() >= before.norm() {
                continue;
            }
            self.touched |= 1 << number;
            self.noticed = true;
            let towards = before.normalize();
            let way = to - from;
            to = from + (way - towards * way.dot(&towards).max(0.0));
        }
        let into = |agent: &Agent| {
            let (before_m, after_m) = ((agent.at - from).norm(), (agent.at - to).norm());
            after_m < agent.radius_m + self.own.radius_m && after_m < before_m - 1e-9
        };
        if agents.iter().any(into) { from } else { to }
    }

    /// How far they have come on their path, and what follows from it.
    fn note_way(&mut self, dt_s: f64) {
        let [back_m, on_m] = FOOT_M;
        let within_m = if self.onward { [back_m, on_m] } else { [on_m, back_m] };
        self.way_m = self.path.foot(self.own.at, self.way_m, within_m);
        let pause = self.manner.pauses.get(self.next_pause);
        if let Some(pause) = pause.filter(|pause| self.onward && self.way_m >= pause.way_m) {
            (self.pause_s, self.next_pause) = (pause.for_s, self.next_pause + 1);
        }
        let turns = match (self.person.walk, self.onward) {
            (Walk::BackAndForth, true) => self.way_m >= self.path.length_m - REACHED_M,
            (Walk::BackAndForth, false) => self.way_m <= REACHED_M,
            _ => false,
        };
        self.waited_s += dt_s;
        if (self.way_m - self.came_on_m).abs() > CAME_ON_M {
            (self.came_on_m, self.waited_s) = (self.way_m, 0.0);
        }
        if turns || self.waited_s >= PATIENCE_S && self.person.walk == Walk::BackAndForth {
            (self.onward, self.came_on_m, self.waited_s) = (!self.onward, self.way_m, 0.0);
        }
    }
}

/// Distance to the nearest wall, thing or edge of the floor, metres, and the direction to it; none within `up_to_m`.
fn nearest(world: &World, at: Point, up_to_m: f64) -> Option<(f64, Vector2<f64>)> {
    const ASIDE_M: f64 = 1e-3;
    let room_m = |at: Point| room_m(world, at, up_to_m + ASIDE_M);
    let here_m = room_m(at);
    if here_m >= up_to_m {
        return None;
    }
    let slope = |aside: Vector2<f64>| room_m(at - aside) - room_m(at + aside);
    let towards = Vector2::new(slope(Vector2::new(ASIDE_M, 0.0)), slope(Vector2::new(0.0, ASIDE_M)));
    Some((here_m, towards.try_normalize(1e-9)?))
}

/// The room around a place, metres, at most `up_to_m`.
fn room_m(world: &World, at: Point, up_to_m: f64) -> f64 {
    world.clearance(at, HEIGHTS_M, up_to_m).min(world.to_edge_m(at))
}

/// Whether a body gets there without touching a wall or reaching over an edge of the floor.
fn is_free(world: &World, from: Point, to: Point, radius_m: f64) -> bool {
    let edge_m = world.to_edge_m(to);
    let keeps_off = edge_m >= radius_m || edge_m >= world.to_edge_m(from);
    keeps_off && !world.is_blocked(from, to, radius_m, HEIGHTS_M)
}
