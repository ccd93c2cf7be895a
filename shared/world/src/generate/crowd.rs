//! Who walks in a generated world: along a wall, across the corridor, or who stands at a wall.

use guidance::se2::Point;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::layout::Plan;
use super::{GeneratorConfig, beside, between};
use crate::people::{Person, Walk};
use crate::prism::Prism;
use crate::site::Course;

/// Share of people who stop for robot and handler; the others walk on until they touch.
const YIELDING: f64 = 0.85;
/// Corridors that are narrower leave no room to pass somebody, metres.
const PASSABLE_M: f64 = 2.3;
/// People keep so far from things and walls, metres.
const CLEAR_M: f64 = 0.1;

/// The people of a world.
pub(super) fn people(config: &GeneratorConfig, plan: &Plan, things: &[Prism], random: &mut ChaCha8Rng) -> Vec<Person> {
    if !random.random_bool(config.people) || plan.width_m < PASSABLE_M {
        return Vec::new();
    }
    let course = plan.course();
    let count = random.random_range(1..=2);
    (0..count).filter_map(|_| person(&course, things, random)).collect()
}

fn person(course: &Course, things: &[Prism], random: &mut ChaCha8Rng) -> Option<Person> {
    let radius_m = between(random, [0.2, 0.28]);
    let lane_m = course.width_m / 2.0 - radius_m - CLEAR_M;
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let at_m = between(random, [2.0, (course.line.length_m() - 1.0).max(2.5)]);
    let path = match random.random_range(0..4) {
        // Along a wall, either way.
        0 | 1 => {
            let to_m = (at_m + between(random, [2.0, 8.0])).min(course.line.length_m() - 0.5);
            let part = course.line.part(at_m.min(to_m - 0.5), to_m)?;
            let steps = (part.length_m().ceil() as usize).max(1);
            let along = (0..=steps).map(|i| at_m + (to_m - at_m) * i as f64 / steps as f64);
            along.map(|way_m| beside(course, way_m, side * lane_m)).collect()
        }
        2 => vec![beside(course, at_m, lane_m), beside(course, at_m, -lane_m)],
        _ => vec![beside(course, at_m, side * lane_m)],
    };
    if !is_clear(&path, things, radius_m) {
        return None;
    }
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
fn is_clear(path: &[Point], things: &[Prism], radius_m: f64) -> bool {
    let reach_m = radius_m + CLEAR_M;
    let near = |a: Point, b: Point, p: Point| crate::sweep::to_segment(p, a, b) < reach_m;
    let ends = path.windows(2).map(|pair| (pair[0], pair[1])).chain(path.first().map(|only| (*only, *only)));
    ends.into_iter().all(|(a, b)| {
        let (min, max) =
            (a.inf(&b) - nalgebra::Vector2::repeat(reach_m), a.sup(&b) + nalgebra::Vector2::repeat(reach_m));
        things.iter().all(|thing| {
            let beside = thing.outline.iter().all(|p| p.x < min.x || p.x > max.x || p.y < min.y || p.y > max.y);
            beside && !thing.outline.iter().any(|p| near(a, b, *p)) && !thing.contains(nalgebra::center(&a, &b))
        })
    })
}
