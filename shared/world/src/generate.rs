//! Worlds by seed: a corridor, straight or curved, what leads off it, what stands in it, and who walks there.
//!
//! The same seed gives the same world, to the bit. Kim et al. 2023 trained in scans of buildings (Matterport3D); these
//! worlds have what makes such buildings hard: bends, junctions, dead ends, doors, pillars, boxes below and above the
//! lidar's plane, hanging curtains, glass that the lidar looks through, people.

mod building;
mod crowd;
mod doors;
mod drops;
mod furnish;
mod hall;
mod layout;

use guidance::se2::Point;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::World;
use crate::site::{Course, DropKind, Site};
use crate::world::DEFAULT_CEILING_M;
use layout::Plan;

pub use drops::generate_drops;

pub use crowd::Crowd;
pub(crate) use crowd::populate_course;
pub(crate) use furnish::{Kinds, furnish_course, room_beside_m};

/// What a generated world is like. Shares are probabilities, 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct GeneratorConfig {
    /// Narrowest and widest corridor, metres.
    pub width_m: [f64; 2],
    /// Shortest and longest corridor, metres.
    pub length_m: [f64; 2],
    /// Share of corridors that bend.
    pub bends: f64,
    /// Things in the way for each metre of corridor.
    pub clutter_per_m: f64,
    /// Share of stretches of wall that the lidar looks through.
    pub glass: f64,
    /// Share of worlds in which people walk.
    pub people: f64,
    /// Who they are.
    pub crowd: Crowd,
    /// What is left free beside a thing, at the least, metres.
    pub passage_m: f64,
    /// Share of corridors that are like those of buildings: rooms behind doorways, alcoves, narrow openings, uneven
    /// walls, frames, doors across the corridor, doors that open while the team comes by, halls, radiators and benches.
    pub buildings: f64,
}

impl Default for GeneratorConfig {
    fn default() -> Self {
        Self {
            width_m: [1.6, 3.4],
            length_m: [12.0, 34.0],
            bends: 0.45,
            clutter_per_m: 0.2,
            glass: 0.06,
            people: 0.35,
            crowd: Crowd::Paths,
            passage_m: 1.35,
            buildings: 0.0,
        }
    }
}

impl GeneratorConfig {
    /// Corridors like those of buildings alone.
    #[must_use]
    pub fn of_buildings() -> Self {
        Self { buildings: 1.0, ..Self::default() }
    }
}

/// The place of worlds that have no floor plan.
pub(crate) const GENERATED: &str = "generated";

/// The world of a seed.
#[must_use]
pub fn generate(config: &GeneratorConfig, seed: u64) -> Site {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let plan = Plan::draw(config, &mut random);
    let mut prisms = plan.walls(config, &mut random);
    prisms.extend(plan.fittings(config, &mut random));
    let things = if plan.is_building {
        plan.furnish_building(config, prisms.clone(), &mut random)
    } else {
        furnish::things(config, &plan, &mut random)
    };
    prisms.extend(things);
    prisms.extend(plan.furnish_hall(config, &mut random));
    let (world, course) = (World::new(DEFAULT_CEILING_M, prisms), plan.course());
    let people = populate_course(config, &course, &world, &mut random);
    let world = world.with_people(people);
    // The last draw: worlds without such a door are what they were.
    let world = match plan.draw_door(config, &world, &mut random) {
        Some(door) => world.with_doors([door]),
        None => world,
    };
    Site { place: GENERATED.into(), world, course, drop: DropKind::None }
}

/// A number between two.
fn between(random: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    if high > low { random.random_range(low..high) } else { low }
}

/// The place so far along a course and so far to the left of its middle.
fn beside(course: &Course, way_m: f64, left_m: f64) -> Point {
    course.line.at(way_m) * Point::new(0.0, left_m)
}
