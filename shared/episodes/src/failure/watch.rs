//! What is noted of each decision of an episode, so that its failure can be told.

use guidance::TravelLine;
use guidance::se2::{Point, Se2};
use world::{Prism, Scene, SeenBy};

use super::{Failure, Thing, apart_m, classify};
use crate::config::Config;
use crate::episode::Episode;
use crate::score::{Held, Report};

/// Height of the lidar's plane, about, metres: what ends below it, or begins above it, the lidar does not see.
const LIDAR_M: f64 = 0.35;
/// What is farther from robot and handler does not matter, metres.
const UP_TO_M: f64 = 2.0;

/// One decision.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Where the robot is (world frame).
    pub robot: Point,
    /// Where the handler is (world frame).
    pub handler: Point,
    /// The action was another one than stop.
    pub moved: bool,
    /// What held the robot in this decision; all 0 where nothing did.
    pub held: Held,
    /// Robot and handler would have touched that.
    pub touched: [Option<Thing>; 2],
    /// The task was done by now.
    pub arrived: bool,
    /// Distance of the nearest person to robot or handler, metres, from middle to middle.
    pub person_m: f64,
    /// Room about robot and handler, metres, at most 2.
    pub room_m: f64,
    /// Distance of robot or handler to an edge of the floor, metres; infinite where there is none.
    pub edge_m: f64,
    /// How far the handler has walked, metres.
    pub walked_m: f64,
}

/// Watches one episode.
#[derive(Debug, Clone, Default)]
pub struct Watch {
    seen: Vec<Seen>,
    before: Option<Report>,
}

impl Watch {
    /// Watches an episode that has begun.
    #[must_use]
    pub fn begin(episode: &Episode) -> Self {
        Self { seen: Vec::with_capacity(episode.decisions()), before: Some(episode.report()) }
    }

    /// Notes a decision that has been carried out: `moved` where its action was not stop.
    pub fn step(&mut self, episode: &Episode, config: &Config, moved: bool) {
        let (report, team) = (episode.report(), episode.team());
        let before = self.before.replace(report).unwrap_or(report);
        let world = &episode.site().world;
        let scene = team.scene(world);
        let (robot, handler) = (*team.world_from_robot(), team.world_from_handler());
        let places = [robot, handler].map(|pose| Point::from(pose.translation.vector));
        let bodies = &config.bodies;
        let heights_m = [bodies.robot_height_m, bodies.handler_height_m];
        let hits =
            [report.robot_collisions > before.robot_collisions, report.handler_collisions > before.handler_collisions];
        let touched = [0, 1].map(|body| hits[body].then(|| nearest(&scene, places[body], heights_m[body])));
        let people = scene.walkers.iter().map(|walker| Point::new(walker.x_m, walker.y_m));
        let person_m = |at: Point| apart_m(at, places[0]).min(apart_m(at, places[1]));
        self.seen.push(Seen {
            robot: places[0],
            handler: places[1],
            moved,
            held: since(report.held, before.held),
            touched,
            arrived: report.success,
            person_m: people.map(person_m).fold(f64::INFINITY, f64::min),
            room_m: team.room_m(world, &robot, &handler, UP_TO_M),
            edge_m: team.to_edge_m(world).into_iter().fold(f64::INFINITY, f64::min),
            walked_m: report.walked_m,
        });
    }

    /// Why the episode failed; none where all went well. `report` is of its end, before *stop* was asked for, and
    /// `stopped` is whether the robot obeyed that; `start` is where the handler gave the cue (world frame).
    #[must_use]
    pub fn failure(&self, episode: &Episode, start: &Se2, report: &Report, stopped: bool) -> Option<Failure> {
        classify::Case {
            task: episode.task(),
            course: &episode.site().course,
            start: Point::from(start.translation.vector),
            report,
            stopped,
            seen: &self.seen,
        }
        .failure()
    }
}

fn since(now: Held, before: Held) -> Held {
    Held {
        policy: now.policy - before.policy,
        lidar: now.lidar - before.lidar,
        camera: now.camera - before.camera,
        memory: now.memory - before.memory,
        contact: now.contact - before.contact,
        floor: now.floor - before.floor,
    }
}

/// The nearest thing to a body that is so high.
fn nearest(scene: &Scene<'_>, at: Point, height_m: f64) -> Thing {
    let people = scene
        .walkers
        .iter()
        .map(|walker| (apart_m(at, Point::new(walker.x_m, walker.y_m)) - walker.radius_m, Thing::Person));
    let prisms = scene.world.prisms().iter().filter(|prism| prism.z0_m < height_m);
    let things = prisms.filter_map(|prism| Some((to_outline_m(prism, at)?, kind(prism))));
    let map = scene.world.map().map(|map| (map.clearance(at, UP_TO_M), Thing::Wall));
    let nearest = people.chain(things).chain(map).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map_or(Thing::Obstacle, |(_, thing)| thing)
}

fn kind(prism: &Prism) -> Thing {
    match prism {
        Prism { seen_by: SeenBy::Camera | SeenBy::Nobody, .. } => Thing::Glass,
        Prism { z0_m, .. } if *z0_m > LIDAR_M => Thing::Overhead,
        Prism { z1_m, .. } if *z1_m < LIDAR_M => Thing::Low,
        Prism { solid: true, .. } => Thing::Obstacle,
        Prism { .. } => Thing::Wall,
    }
}

fn to_outline_m(prism: &Prism, at: Point) -> Option<f64> {
    let closing = prism.outline.first().filter(|_| prism.solid);
    let outline: Vec<Point> = prism.outline.iter().chain(closing).copied().collect();
    let outline = TravelLine::new(&outline)?;
    let foot = outline.at(outline.foot(at).way_m);
    Some(apart_m(at, Point::from(foot.translation.vector)))
}
