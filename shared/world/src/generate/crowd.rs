//! Who walks in a generated world. Usually one or two people: along a wall, across the corridor, or one who stands at a
//! wall. A crowd of the social force model has people who come towards the team or walk along with it, alone or in a
//! group, one who stops in the way, and one who overtakes.

use guidance::se2::Point;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{GeneratorConfig, beside, between};
use crate::World;
use crate::people::{Manner, Moves, Pause, Person, Walk};
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

/// Speeds of single people, of groups (which walk slower, Moussaid et al. 2010), and of those who
/// overtake, metres per second.
const SINGLE_MPS: [f64; 2] = [0.8, 1.4];
const GROUP_MPS: [f64; 2] = [0.8, 1.2];
const OVERTAKING_MPS: [f64; 2] = [1.3, 1.6];
/// One stops in the way for so long, seconds.
const STOPS_S: [f64; 2] = [10.0, 60.0];
/// They set out within this time, seconds.
const SET_OUT_S: f64 = 10.0;
/// Members of a group walk so far from each other, side by side and, where there is no room, in a file, metres.
const ABREAST_M: f64 = 0.6;
const IN_FILE_M: f64 = 0.9;
/// A way of the social force model is at least so long, metres, and is drawn anew so often until it is clear.
const STROLL_M: f64 = 4.0;
const STROLL_TRIES: usize = 12;

/// Who walks in generated worlds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Crowd {
    /// People on fixed paths.
    Paths,
    /// People of the social force model.
    Social,
}

/// The people of a course in a world.
pub(crate) fn populate_course(
    config: &GeneratorConfig,
    course: &Course,
    world: &World,
    random: &mut ChaCha8Rng,
) -> Vec<Person> {
    let has_room = course.width_m >= PASSABLE_M || config.crowd == Crowd::Social;
    if !random.random_bool(config.people) || !has_room {
        return Vec::new();
    }
    let count = random.random_range(1..=2);
    match config.crowd {
        Crowd::Paths => (0..count).filter_map(|_| person(course, world, random)).collect(),
        Crowd::Social => (0..count).flat_map(|group| party(course, world, group, random)).collect(),
    }
}

/// One person or a group of the social force model; none where their way is not clear.
fn party(course: &Course, world: &World, group: u32, random: &mut ChaCha8Rng) -> Vec<Person> {
    let kind = random.random_range(0..5);
    let (members, speeds_mps) = match kind {
        0 | 1 => (1, SINGLE_MPS),
        2 => (random.random_range(2..=3), GROUP_MPS),
        3 => (1, SINGLE_MPS),
        _ => (1, OVERTAKING_MPS),
    };
    let (speed_mps, start_s) = (between(random, speeds_mps), between(random, [0.0, SET_OUT_S]));
    let radii_m: Vec<f64> = (0..members).map(|_| between(random, [0.2, 0.28])).collect();
    // Those who overtake come from behind, the others from either end.
    let comes_towards = kind != 4 && random.random_bool(0.5);
    let Some(paths) = (0..STROLL_TRIES).find_map(|_| lanes(course, world, &radii_m, comes_towards, random)) else {
        return Vec::new();
    };
    // Who meets the team in a narrow corridor turns round in the end. One who stops there would block it.
    let pauses = match kind {
        3 if course.width_m >= PASSABLE_M => {
            vec![Pause { way_m: between(random, [1.0, STROLL_M]), for_s: between(random, STOPS_S) }]
        }
        _ => Vec::new(),
    };
    let yields = random.random_bool(YIELDING);
    let member = |(path, &radius_m)| Person {
        path,
        speed_mps,
        radius_m,
        walk: Walk::BackAndForth,
        yields,
        start_s,
        moves: Moves::Social(Manner { group: (members > 1).then_some(group), pauses: pauses.clone() }),
    };
    paths.into_iter().zip(&radii_m).map(member).collect()
}

/// Clear ways along a course for people beside each other, or one behind the other.
fn lanes(
    course: &Course,
    world: &World,
    radii_m: &[f64],
    comes_towards: bool,
    random: &mut ChaCha8Rng,
) -> Option<Vec<Vec<Point>>> {
    let length_m = course.line.length_m() - 1.0;
    let from_m = between(random, [0.5, (length_m / 2.0 - STROLL_M / 2.0).max(0.5)]);
    let to_m = between(random, [(from_m + STROLL_M).min(length_m), length_m]);
    (to_m - from_m >= STROLL_M).then_some(())?;
    let free_m = (course.width_m / 2.0 - radii_m[0] - CLEAR_M).max(0.0);
    let left_m = between(random, [-free_m, free_m]);
    let inwards = -left_m.signum();
    let are_abreast = radii_m.len() > 1 && 2.0 * free_m > ABREAST_M * radii_m.len() as f64;
    let paths = radii_m.iter().enumerate().map(|(member, &radius_m)| {
        let place = member as f64;
        let (aside_m, behind_m) = if are_abreast { (place * ABREAST_M, 0.0) } else { (0.0, place * IN_FILE_M) };
        let steps = (to_m - from_m).ceil().max(1.0);
        let along = (0..=steps as usize).map(|step| from_m + behind_m + (to_m - from_m) * step as f64 / steps);
        let along = along.filter(|way_m| *way_m <= length_m);
        let mut path: Vec<Point> = along.map(|way_m| beside(course, way_m, left_m + inwards * aside_m)).collect();
        if comes_towards {
            path.reverse();
        }
        is_clear_on_floor(&path, world, radius_m).then_some(path)
    });
    paths.collect()
}

/// Whether nobody would walk into a thing or over an edge.
fn is_clear_on_floor(path: &[Point], world: &World, radius_m: f64) -> bool {
    let keeps_off = |at: &Point| world.to_edge_m(*at) >= radius_m + CLEAR_M;
    path.iter().all(keeps_off) && is_clear(path, world, radius_m)
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
        moves: Moves::Path,
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
