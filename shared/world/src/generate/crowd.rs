//! Who walks in a generated world: along a wall, across the corridor, or who stands at a wall.

use guidance::se2::Point;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{GeneratorConfig, beside, between};
use crate::World;
use crate::people::{Person, Walk};
use crate::scene::PERSON_HEIGHT_M;
use crate::site::Course;

/// Share of people who stop for robot and handler; the others walk on until they touch.
const YIELDING: f64 = 0.85;
/// Corridors that are narrower leave no room to pass somebody, metres.
const PASSABLE_M: f64 = 2.3;
/// People keep so far from things and walls, metres.
const CLEAR_M: f64 = 0.1;
/// A path is looked at in steps of so much, metres.
const CLEAR_STEP_M: f64 = 0.2;

/// The people of a course in a world.
pub(crate) fn populate_course(
    config: &GeneratorConfig,
    course: &Course,
    world: &World,
    random: &mut ChaCha8Rng,
) -> Vec<Person> {
    if !random.random_bool(config.people) || course.width_m < PASSABLE_M {
        return Vec::new();
    }
    let count = random.random_range(1..=2);
    (0..count).filter_map(|_| person(course, world, random)).collect()
}

fn person(course: &Course, world: &World, random: &mut ChaCha8Rng) -> Option<Person> {
    let radius_m = between(random, [0.2, 0.28]);
    let lane_m = course.width_m / 2.0 - radius_m - CLEAR_M;
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let at_m = between(random, [2.0, (course.line.length_m() - 1.0).max(2.5)]);
    let path = match random.random_range(0..4) {
        // Along a wall, either way.
        0 | 1 => {
            let to_m = (at_m + between(random, [2.0, 8.0])).min(course.line.length_m() - 0.5);
            let steps = ((to_m - at_m).abs().ceil() as usize).max(1);
            let along = (0..=steps).map(|i| at_m + (to_m - at_m) * i as f64 / steps as f64);
            along.map(|way_m| beside(course, way_m, side * lane_m)).collect()
        }
        2 => vec![beside(course, at_m, lane_m), beside(course, at_m, -lane_m)],
        _ => vec![beside(course, at_m, side * lane_m)],
    };
    is_clear(&path, world, radius_m).then_some(())?;
    Some(Person {
        path,
        speed_mps: between(random, [0.3, 1.2]),
        radius_m,
        walk: Walk::BackAndForth,
        yields: random.random_bool(YIELDING),
        start_s: 0.0,
    })
}

/// Whether nobody would walk into a thing.
fn is_clear(path: &[Point], world: &World, radius_m: f64) -> bool {
    let needed_m = radius_m + CLEAR_M / 2.0;
    let is_free = |at: Point| world.clearance(at, [0.0, PERSON_HEIGHT_M], needed_m) >= needed_m;
    let between = |pair: &[Point]| {
        let steps = ((pair[1] - pair[0]).norm() / CLEAR_STEP_M).ceil().max(1.0) as usize;
        (0..=steps).all(|i| is_free(pair[0] + (pair[1] - pair[0]) * (i as f64 / steps as f64)))
    };
    path.first().is_some_and(|only| is_free(*only)) && path.windows(2).all(between)
}
