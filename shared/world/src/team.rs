//! Robot, handler and people, one decision at a time: for training and evaluation, which judge whole motions as
//! Kim et al. 2023 do. [`crate::Physics`] moves them tick by tick, for the simulator.
//!
//! A motion in which robot or handler would touch something is refused: both stay where they were, and it is counted
//! once. Where the footprint of robot or handler leaves the floor it has fallen, and neither moves any more. While the
//! robot stands, a handler who has touched something does not try again. What people do goes on
//! meanwhile: who yields stops in time, and who walks into robot or handler is held there and counted apart.

use guidance::se2::{Point, Se2, exp, pose2, wrap_angle};
use guidance::{Interaction, InteractionModel, Tilt};
use messages::{Attitude, MAX_WALKERS, Twist2, Walker};
use nalgebra::Vector2;
use rand::{Rng, RngExt};

use crate::floor::Falls;
use crate::outline::Outline;
use crate::people::Agent;
use crate::physics::{HandlerConfig, PhysicsConfig, STEP_M};
use crate::{Legs, People, Scene, World};

/// A motion is swept in so many straight parts: a straight one, one that turns, and one among people, who walk
/// meanwhile.
const PARTS: [usize; 3] = [2, 3, 5];
/// They come along the corridor at this speed, m/s, and walk for so long between two looks, seconds.
const COMING: (Twist2, f64) = (Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 }, 1.5);

/// A handler as they really are, whatever the shield is told of them.
#[derive(Debug, Clone, PartialEq)]
pub struct HandlerProfile {
    /// How they follow.
    pub model: InteractionModel,
    /// Swaying to either side while walking, metres.
    pub sway_m: f64,
    /// Period of the swaying, seconds.
    pub sway_period_s: f64,
}

impl HandlerProfile {
    /// Who follows just as the model says.
    #[must_use]
    pub fn exact(model: impl Into<InteractionModel>) -> Self {
        Self { model: model.into(), sway_m: 0.0, sway_period_s: HandlerConfig::default().sway_period_s }
    }

    /// Who follows as the model says and sways by up to 4 cm, which no model tells.
    #[must_use]
    pub fn about(model: InteractionModel, random: &mut impl Rng) -> Self {
        let sway_period_s = random.random_range(1.0..1.5);
        Self { model, sway_m: random.random_range(0.0..0.04), sway_period_s }
    }
}

/// The bodies that may touch something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bodies {
    /// Radius of the robot's disc, metres.
    pub robot_radius_m: f64,
    /// Two such discs stand for a long body, so far ahead of its middle and behind it, metres; 0 is one disc.
    pub robot_nose_m: f64,
    /// Its height, metres.
    pub robot_height_m: f64,
    /// Radius of the handler's disc, metres.
    pub handler_radius_m: f64,
    /// Their height, metres.
    pub handler_height_m: f64,
}

impl From<&PhysicsConfig> for Bodies {
    fn from(PhysicsConfig { robot, handler, .. }: &PhysicsConfig) -> Self {
        Self {
            robot_radius_m: robot.radius_m,
            robot_nose_m: robot.nose_m,
            robot_height_m: robot.height_m,
            handler_radius_m: handler.radius_m,
            handler_height_m: handler.height_m,
        }
    }
}

impl Default for Bodies {
    fn default() -> Self {
        Self::from(&PhysicsConfig::default())
    }
}

/// What happened in one decision.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stepped {
    /// The robot would have touched something: the motion was refused.
    pub robot_hit: bool,
    /// The handler would have.
    pub handler_hit: bool,
    /// People who walked into robot or handler.
    pub hit_by_others: u32,
}

impl Stepped {
    /// Whether robot or handler moved into something.
    #[must_use]
    pub fn collided(&self) -> bool {
        self.robot_hit || self.handler_hit
    }
}

/// Robot, handler and people of a world.
#[derive(Debug, Clone)]
pub struct Team {
    handler: HandlerProfile,
    bodies: Bodies,
    world_from_robot: Se2,
    /// None: the robot moves as it is told, on a level body.
    legs: Option<Legs>,
    /// How the robot moves (robot frame).
    twist: Twist2,
    /// By the model alone, without the swaying.
    robot_from_handler: Se2,
    people: People,
    walkers: [Walker; MAX_WALKERS],
    /// Who touches whom: told once for each touch.
    touching: [[bool; 2]; MAX_WALKERS],
    time_s: f64,
    walked_s: f64,
    /// The handler has touched something, and the robot has not moved since.
    handler_rests: bool,
    falls: Falls,
}

const ROBOT: usize = 0;
const HANDLER: usize = 1;

impl Team {
    /// Robot and handler at rest, the handler at the default offset.
    #[must_use]
    pub fn new(world: &World, bodies: Bodies, handler: HandlerProfile, world_from_robot: &Se2) -> Self {
        let mut team = Self {
            robot_from_handler: handler.model.robot_from_default(),
            handler,
            bodies,
            world_from_robot: *world_from_robot,
            legs: None,
            twist: Twist2::ZERO,
            people: People::new(&world.people()[..world.people().len().min(MAX_WALKERS)]),
            walkers: [Walker::default(); MAX_WALKERS],
            touching: [[false; 2]; MAX_WALKERS],
            time_s: 0.0,
            walked_s: 0.0,
            handler_rests: false,
            falls: Falls::default(),
        };
        team.note_walkers();
        team
    }

    /// The same with a robot that walks on legs.
    #[must_use]
    pub fn on_legs(self, legs: Option<Legs>) -> Self {
        Self { legs, ..self }
    }

    /// The same on its way there: at rest as far as handler and people are concerned, and with legs that have walked
    /// on.
    #[must_use]
    pub fn coming_by(&self, world_from_robot: &Se2) -> Self {
        let robot_from_handler = self.handler.model.robot_from_default();
        let mut team = Self { world_from_robot: *world_from_robot, robot_from_handler, ..self.clone() };
        if let Some(legs) = &mut team.legs {
            legs.go(COMING.0, COMING.1);
        }
        team
    }

    /// How the robot's body is held; none where it is level.
    #[must_use]
    pub fn attitude(&self) -> Attitude {
        self.legs.as_ref().map_or(Attitude::default(), Legs::attitude)
    }

    /// The robot.
    #[must_use]
    pub fn world_from_robot(&self) -> &Se2 {
        &self.world_from_robot
    }

    /// How the robot moves at the end of a step (robot frame).
    #[must_use]
    pub fn twist(&self) -> Twist2 {
        self.twist
    }

    /// The handler, swaying.
    #[must_use]
    pub fn world_from_handler(&self) -> Se2 {
        self.world_from_robot * self.swayed(&self.robot_from_handler, self.walked_s)
    }

    /// Whose footprints have left the floor. Then neither moves any more.
    #[must_use]
    pub fn falls(&self) -> Falls {
        self.falls
    }

    /// Distance of the robot's body, and of the handler's, to the nearest hole that is a fall, metres. Infinite in a
    /// world without one.
    #[must_use]
    pub fn to_edge_m(&self, world: &World) -> [f64; 2] {
        let robot = self.outline(&self.world_from_robot);
        let robot_m = robot.iter().map(|at| world.to_edge_m(*at)).fold(f64::INFINITY, f64::min);
        let handler_m = world.to_edge_m(place(&self.world_from_handler()));
        [robot_m - self.bodies.robot_radius_m, handler_m - self.bodies.handler_radius_m]
    }

    /// The handler in the robot's frame, without the swaying.
    #[must_use]
    pub fn robot_from_handler(&self) -> &Se2 {
        &self.robot_from_handler
    }

    /// Who the handler is.
    #[must_use]
    pub fn handler(&self) -> &HandlerProfile {
        &self.handler
    }

    /// The room that robot and handler would have if they were there, metres, at most `up_to_m`; less than 0 in
    /// something. People are where they are now.
    #[must_use]
    pub fn room_m(&self, world: &World, world_from_robot: &Se2, world_from_handler: &Se2, up_to_m: f64) -> f64 {
        let room_m = |body: usize, at: &Point| {
            let radius_m = self.radius_m(body);
            let apart_m =
                |walker: &Walker| (Point::new(walker.x_m, walker.y_m) - at).norm() - walker.radius_m - radius_m;
            let in_world_m = world.clearance(*at, self.z(body), radius_m + up_to_m) - radius_m;
            self.walkers[..self.people.len()].iter().map(apart_m).fold(in_world_m, f64::min)
        };
        let robot = self.outline(world_from_robot);
        robot.iter().map(|at| room_m(ROBOT, at)).fold(room_m(HANDLER, &place(world_from_handler)), f64::min)
    }

    /// What sensors look at.
    #[must_use]
    pub fn scene<'a>(&'a self, world: &'a World) -> Scene<'a> {
        Scene {
            world,
            world_from_robot: pose2(&self.world_from_robot),
            tilt: Tilt::of(&self.attitude()),
            world_from_handler: Some(pose2(&self.world_from_handler())),
            walkers: &self.walkers[..self.people.len()],
        }
    }

    /// Whether robot and handler stand free, with so much room about both and between them, metres.
    #[must_use]
    pub fn is_free(&self, world: &World, room_m: f64) -> bool {
        let (robot, handler) = (place(&self.world_from_robot), place(&self.world_from_handler()));
        let outline = self.outline(&self.world_from_robot);
        let between = [(HANDLER, nalgebra::center(&robot, &handler)), (HANDLER, handler)];
        outline.iter().map(|at| (ROBOT, *at)).chain(between).all(|(body, at)| {
            let needed_m = self.radius_m(body) + room_m;
            let apart = |walker: &Walker| (Point::new(walker.x_m, walker.y_m) - at).norm() > needed_m + walker.radius_m;
            world.clearance(at, self.z(body), needed_m) >= needed_m
                && world.to_edge_m(at) >= needed_m
                && self.walkers[..self.people.len()].iter().all(apart)
        })
    }

    /// The robot's discs where it is there.
    fn outline(&self, world_from_robot: &Se2) -> Outline {
        Outline::of(world_from_robot, self.bodies.robot_nose_m)
    }

    fn radius_m(&self, body: usize) -> f64 {
        if body == ROBOT { self.bodies.robot_radius_m } else { self.bodies.handler_radius_m }
    }

    fn z(&self, body: usize) -> [f64; 2] {
        [STEP_M, if body == ROBOT { self.bodies.robot_height_m } else { self.bodies.handler_height_m }]
    }

    fn swayed(&self, robot_from_handler: &Se2, walked_s: f64) -> Se2 {
        let phase = std::f64::consts::TAU * walked_s / self.handler.sway_period_s;
        let aside = Se2::translation(0.0, self.handler.sway_m * phase.sin());
        aside * robot_from_handler
    }

    /// Lets a world's doors swing for `dt_s` before the team's next step.
    pub fn swing_doors(&self, world: &mut World, dt_s: f64) {
        let (agents, count) = self.agents();
        let people = self.walkers[..self.people.len()].iter().map(Agent::from);
        let all: Vec<Agent> = agents[..count].iter().copied().chain(people).collect();
        world.swing(self.time_s, dt_s, &all);
    }

    /// One decision: the robot moves at a constant velocity (robot frame) for `dt_s`.
    pub fn step(&mut self, world: &World, velocity: Twist2, dt_s: f64) -> Stepped {
        let (robot, offset, walked_s) = (self.world_from_robot, self.robot_from_handler, self.walked_s);
        let parts = PARTS[if !self.people.is_empty() { 2 } else { usize::from(velocity.wz_radps != 0.0) }];
        let part_s = dt_s / parts as f64;
        let stands = velocity.is_zero();
        let (mut stepped, mut now) = (Stepped::default(), Se2::identity());
        self.twist = Twist2::ZERO;
        for part in 1..=parts {
            stepped.hit_by_others += self.move_people(world, part_s, velocity);
            if stepped.collided() || self.falls.any() || stands && self.handler_rests {
                continue;
            }
            now = match &mut self.legs {
                Some(legs) => {
                    self.twist = legs.go(velocity, part_s);
                    now * exp(self.twist, part_s)
                }
                None => {
                    self.twist = velocity;
                    exp(velocity, part_s * part as f64)
                }
            };
            let share = part as f64 / parts as f64;
            let next = (robot * now, self.handler.model.follow(&offset, &now, share));
            let next_walked_s = walked_s + if stands { 0.0 } else { part_s * part as f64 };
            let handler = next.0 * self.swayed(&next.1, next_walked_s);
            let (from, to) = (self.outline(&self.world_from_robot), self.outline(&next.0));
            stepped.robot_hit = from.iter().zip(to.iter()).any(|(from, to)| self.is_blocked(world, ROBOT, *from, *to));
            stepped.handler_hit = self.is_blocked(world, HANDLER, place(&self.world_from_handler()), place(&handler));
            if stepped.collided() {
                (self.world_from_robot, self.robot_from_handler, self.walked_s) = (robot, offset, walked_s);
                self.legs.iter_mut().for_each(Legs::halt);
                self.twist = Twist2::ZERO;
            } else {
                (self.world_from_robot, self.robot_from_handler, self.walked_s) = (next.0, next.1, next_walked_s);
                let (robot, handler) = (self.outline(&self.world_from_robot), place(&self.world_from_handler()));
                let radii_m = [ROBOT, HANDLER].map(|body| self.radius_m(body));
                self.falls.look(world, [&robot, &[handler]], radii_m);
            }
        }
        self.handler_rests = stepped.handler_hit || stands && self.handler_rests;
        // Normalised, so that rounding does not pile up.
        let yaw_rad = wrap_angle(self.world_from_robot.rotation.angle());
        self.world_from_robot = Se2::new(self.world_from_robot.translation.vector, yaw_rad);
        stepped
    }

    fn is_blocked(&self, world: &World, body: usize, from: Point, to: Point) -> bool {
        let radius_m = self.radius_m(body);
        let into_person = |walker: &Walker| {
            let (center, limit_m) = (Point::new(walker.x_m, walker.y_m), radius_m + walker.radius_m);
            crate::sweep::is_blocked(from, to, limit_m, |p| (p - center).norm())
        };
        world.is_blocked(from, to, radius_m, self.z(body)) || self.walkers[..self.people.len()].iter().any(into_person)
    }

    /// Robot, handler, and the other disc of a long robot; and how many of them there are.
    fn agents(&self) -> ([Agent; 3], usize) {
        let outline = self.outline(&self.world_from_robot);
        let agent = |body: usize, at: Point| Agent { at, radius_m: self.radius_m(body) };
        let handler = agent(HANDLER, place(&self.world_from_handler()));
        ([agent(ROBOT, outline[0]), handler, agent(ROBOT, outline[outline.len() - 1])], 1 + outline.len())
    }

    /// Lets people walk on; how many of them walked into robot or handler, each touch once.
    fn move_people(&mut self, world: &World, dt_s: f64, velocity: Twist2) -> u32 {
        let time_s = self.time_s;
        self.time_s += dt_s;
        if self.people.is_empty() {
            return 0;
        }
        let places = [place(&self.world_from_robot), place(&self.world_from_handler())];
        let (agents, count) = self.agents();
        let mut touches = [[false; 2]; MAX_WALKERS];
        self.people.step(world, time_s, dt_s, &agents[..count], |person, agent| touches[person][agent % 2] = true);
        self.note_walkers();
        let towards = self.world_from_robot.rotation * Vector2::new(velocity.vx_mps, velocity.vy_mps);
        let mut hits = 0;
        for (person, touched) in touches.iter().enumerate().take(self.people.len()) {
            let at = Point::new(self.walkers[person].x_m, self.walkers[person].y_m);
            for body in [ROBOT, HANDLER] {
                // Who is being walked into is told by the team's own motion.
                let closing = towards.dot(&(at - places[body])) > 0.05 * (at - places[body]).norm();
                let is_hit = touched[body] && !closing;
                hits += u32::from(is_hit && !self.touching[person][body]);
                let apart_m = (at - places[body]).norm() - self.walkers[person].radius_m - self.radius_m(body);
                self.touching[person][body] = is_hit || (self.touching[person][body] && apart_m < 0.05);
            }
        }
        hits
    }

    fn note_walkers(&mut self) {
        for (slot, walker) in self.walkers.iter_mut().zip(self.people.walkers()) {
            *slot = walker;
        }
    }
}

fn place(pose: &Se2) -> Point {
    Point::from(pose.translation.vector)
}

#[cfg(test)]
mod tests {
    use super::{Bodies, HandlerProfile, Team};
    use crate::floor::{Hole, rectangle};
    use crate::prism::Prism;
    use crate::{Moves, Person, Walk, World};
    use guidance::DelayedHarness;
    use guidance::se2::{Point, Se2};
    use messages::{Pose2, Twist2};

    const ON: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 };

    fn team(world: &World) -> Team {
        Team::new(world, Bodies::default(), HandlerProfile::exact(DelayedHarness::default()), &Se2::identity())
    }

    #[test]
    fn the_handler_follows_as_the_model_says() {
        let world = World::new(2.6, Vec::new());
        let mut team = team(&world);
        for _ in 0..40 {
            assert_eq!(team.step(&world, ON, 0.5), super::Stepped::default());
        }
        assert!((team.world_from_robot().translation.x - 10.0).abs() < 1e-9);
        // 0.75 behind, and the lag of alpha 0.4.
        assert!((team.world_from_handler().translation.x - (10.0 - 0.75 - 0.25 * 0.4 / 0.6)).abs() < 1e-6);
    }

    #[test]
    fn a_motion_into_something_is_refused_and_counted_each_time() {
        let wall = Prism::wall(vec![Point::new(0.45, -2.0), Point::new(0.45, 2.0)], [0.0, 2.0]);
        let world = World::new(2.6, vec![wall]);
        let mut team = team(&world);
        assert!(team.is_free(&world, 0.1) && !team.is_free(&world, 0.2));
        for _ in 0..2 {
            let stepped = team.step(&world, ON, 0.5);
            assert!(stepped.robot_hit && !stepped.handler_hit);
            assert_eq!(team.world_from_robot(), &Se2::identity());
        }
        // Over the robot, but not over the handler.
        let shelf = Prism::cuboid(Point::new(-0.2, -0.35), [0.2, 0.2], 0.0, [1.0, 1.4]);
        let world = World::new(2.6, vec![shelf]);
        let stepped = (0..4).map(|_| self::team(&world).step(&world, ON, 0.5)).next_back().expect("steps");
        assert!(!stepped.robot_hit);
        let mut team = self::team(&world);
        assert!((0..4).any(|_| team.step(&world, ON, 0.5).handler_hit));
        // Beside a robot that stands nobody pushes on.
        assert!((0..4).all(|_| !team.step(&world, Twist2::ZERO, 0.5).collided()));
        assert!(team.step(&world, ON, 0.5).handler_hit);
    }

    #[test]
    fn a_footprint_that_leaves_the_floor_has_fallen() {
        let hole =
            |near: (f64, f64)| Hole { outline: rectangle(Pose2::new(near.0, near.1, 0.0), 4.0, 0.4), depth_m: 0.2 };
        for (near, fell) in [((1.0, 0.1), [1, 0]), ((0.2, -0.7), [0, 1])] {
            let world = World::new(2.6, Vec::new()).with_holes(vec![hole(near)]);
            let mut team = team(&world);
            let before_m = team.to_edge_m(&world);
            assert!(before_m[0] > 0.0 && before_m[1] > 0.0, "{before_m:?}");
            assert!((0..6).all(|_| !team.step(&world, ON, 0.5).collided()));
            assert_eq!([team.falls().robot(), team.falls().handler()], fell);
            let there = *team.world_from_robot();
            team.step(&world, ON, 0.5);
            assert_eq!(team.world_from_robot(), &there, "who has fallen walks no more");
        }
    }

    #[test]
    fn who_walks_into_a_standing_team_is_counted_apart() {
        let path = vec![Point::new(2.0, 0.0), Point::new(-2.0, 0.0)];
        let (walk, moves) = (Walk::Once, Moves::Path);
        let person = Person { path, speed_mps: 1.0, radius_m: 0.25, walk, yields: false, start_s: 0.0, moves };
        let world = World::new(2.6, Vec::new()).with_people(vec![person]);
        let mut team = team(&world);
        let others: u32 = (0..12)
            .map(|_| team.step(&world, Twist2::ZERO, 0.5))
            .map(|stepped| {
                assert!(!stepped.collided());
                stepped.hit_by_others
            })
            .sum();
        assert_eq!(others, 1, "one touch is one event");
        assert!(team.step(&world, ON, 0.5).robot_hit, "walking into them is the team's own collision");
        // Who pushes on after the team has stopped is counted then.
        let mut team = self::team(&world);
        let hits = |team: &mut Team, velocity| team.step(&world, velocity, 0.5).hit_by_others;
        assert_eq!((0..2).map(|_| hits(&mut team, ON)).sum::<u32>(), 0);
        assert_eq!((0..12).map(|_| hits(&mut team, Twist2::ZERO)).sum::<u32>(), 1);
    }
}
