//! What stands and hangs in a generated corridor. Beside each thing there is a passage.

use guidance::se2::Point;
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::layout::{FULL, Plan};
use super::{GeneratorConfig, beside, between};
use crate::World;
use crate::prism::Prism;
use crate::site::{Course, Opening};

/// Things keep so far from each other along the way, metres: room to go from one side to the other.
const APART_M: f64 = 2.2;
/// And from the mouths of branches and the corridor's ends, metres.
const MOUTH_M: f64 = 0.7;
/// What protrudes by less is no thing, metres.
const LEAST_M: f64 = 0.12;
/// The room beside the middle is looked at so far before and behind a thing, and so high above the floor, metres.
const BESIDE_M: [f64; 5] = [-0.7, -0.35, 0.0, 0.35, 0.7];
const WALL_Z_M: f64 = 1.0;

/// Thickness of a curtain's folds; a door's leaf, and its thickness, metres.
const CLOTH_M: f64 = 0.06;
const LEAF_M: f64 = 0.85;
const LEAF_THICK_M: f64 = 0.04;
/// Depth of a radiator and of a bench; radius of a fire extinguisher, metres.
const RADIATOR_M: f64 = 0.15;
const BENCH_M: f64 = 0.5;
const EXTINGUISHER_M: f64 = 0.085;

/// Which things stand along a course.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kinds {
    /// Boxes, tables, pillars, curtains and doors.
    Usual,
    /// Those, and radiators, fire extinguishers, benches and bins.
    OfBuildings,
}

/// All things of a generated corridor, and one in some branches.
pub(super) fn things(config: &GeneratorConfig, plan: &Plan, random: &mut ChaCha8Rng) -> Vec<Prism> {
    let course = plan.course();
    let mut things = furnish_course(config, &course, |_| [course.width_m / 2.0; 2], Kinds::Usual, random);
    for branch in plan.branches.iter().filter(|branch| branch.is_way()) {
        let line = plan.branch_line(branch);
        let from_m = plan.width_m / 2.0 + branch.width_m.max(1.5) + 1.5;
        if line.length_m() > from_m + 1.5 && random.random_bool((2.0 * config.clutter_per_m).min(0.5)) {
            let way_m = between(random, [from_m, line.length_m() - 1.0]);
            let course = Course::new(line, branch.width_m, Vec::new());
            things.extend(thing(config, &course, [branch.width_m / 2.0; 2], [way_m, 0.5], Kinds::Usual, random));
        }
    }
    things
}

/// The least room to the left and to the right of a corridor's middle, near a way along it, metres, up to `most_m`: a
/// doorway beside a thing gives no room, because its jamb is nearer than the thing is long.
pub(crate) fn room_beside_m(world: &World, course: &Course, way_m: f64, most_m: f64) -> [f64; 2] {
    [1.0, -1.0].map(|side| {
        let to_wall_m = |off_m: &f64| {
            let at = course.line.at(way_m + off_m);
            let direction = at.rotation * Vector2::new(0.0, side);
            world.cast(beside(course, way_m + off_m, 0.0), direction, WALL_Z_M, most_m).unwrap_or(most_m)
        };
        BESIDE_M.iter().map(to_wall_m).fold(most_m, f64::min)
    })
}

/// What stands along a course; `free_m` tells how much room there is to the left and to the right of its middle at a
/// way.
pub(crate) fn furnish_course(
    config: &GeneratorConfig,
    course: &Course,
    free_m: impl Fn(f64) -> [f64; 2],
    kinds: Kinds,
    random: &mut ChaCha8Rng,
) -> Vec<Prism> {
    let mut things = Vec::new();
    let mut way_m = between(random, [0.5, 2.0]);
    while config.clutter_per_m > 0.0 && way_m < course.line.length_m() - 1.0 {
        let length_m = between(random, [0.2, 1.0]);
        let at_mouth =
            |opening: &Opening| (opening.way_m - way_m).abs() < opening.width_m / 2.0 + length_m / 2.0 + MOUTH_M;
        if !course.openings.iter().any(at_mouth) {
            things.extend(thing(config, course, free_m(way_m), [way_m, length_m], kinds, random));
        }
        way_m += APART_M + length_m + between(random, [0.0, 2.0 / config.clutter_per_m]);
    }
    things
}

/// One thing at a way along a corridor that is so wide to the left and to the right of its middle there.
fn thing(
    config: &GeneratorConfig,
    course: &Course,
    [left_m, right_m]: [f64; 2],
    [way_m, length_m]: [f64; 2],
    kinds: Kinds,
    random: &mut ChaCha8Rng,
) -> Option<Prism> {
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let width_m = left_m + right_m;
    let room_m = width_m - config.passage_m;
    let yaw_rad = course.line.at(way_m).rotation.angle();
    // In the middle where both sides are wide enough, at a wall otherwise.
    let radius_m = between(random, [0.12, 0.3]);
    if left_m.min(right_m) > config.passage_m + radius_m + 0.1 && random.random_bool(0.4) {
        return Some(Prism::pillar(beside(course, way_m, between(random, [-0.1, 0.1])), radius_m, FULL));
    }
    if room_m < LEAST_M {
        return None;
    }
    let depth_m = between(random, [LEAST_M, room_m.min(1.6)]);
    let wall_m = if side > 0.0 { left_m } else { -right_m };
    let at_wall = |depth_m: f64| beside(course, way_m, wall_m - side * depth_m / 2.0);
    let cuboid = |z: [f64; 2]| Some(Prism::cuboid(at_wall(depth_m), [length_m, depth_m], yaw_rad, z));
    let kind = match kinds {
        Kinds::Usual => random.random_range(0..10_u32),
        Kinds::OfBuildings => random.random_range(0..18),
    };
    match kind {
        // Above the lidar's plane, and below it.
        0..=2 => cuboid([0.0, between(random, [0.5, 1.9])]),
        3..=4 => cuboid([0.0, between(random, [0.12, 0.33])]),
        // A table or a shelf: the lidar sees nothing under it.
        5 => cuboid([between(random, [0.45, 0.58]), between(random, [0.7, 1.3])]),
        6..=7 => {
            let radius_m = (depth_m / 2.0).min(0.35);
            Some(Prism::pillar(at_wall(2.0 * radius_m), radius_m, FULL))
        }
        // A curtain, from the ceiling to a hand's breadth above the floor.
        8 => {
            let hung =
                Prism::cuboid(at_wall(depth_m), [CLOTH_M, depth_m], yaw_rad, [between(random, [0.05, 0.3]), 2.2]);
            Some(hung)
        }
        10.. => Some(of_building(kind, at_wall, depth_m, yaw_rad, random)),
        // A door's leaf, ajar.
        _ => {
            let (out_m, hinge) = (depth_m.min(LEAF_M), Point::new(0.0, wall_m));
            let along_m = if random.random_bool(0.5) { 1.0 } else { -1.0 } * (LEAF_M.powi(2) - out_m.powi(2)).sqrt();
            let leaf = Point::new(along_m, wall_m - side * out_m) - hinge;
            let middle = course.line.at(way_m) * (hinge + leaf / 2.0);
            let leaf_yaw_rad = yaw_rad + leaf.y.atan2(leaf.x);
            Some(Prism::cuboid(middle, [LEAF_M, LEAF_THICK_M], leaf_yaw_rad, [0.0, 2.05]))
        }
    }
}

/// A radiator, a bench, a fire extinguisher or a bin, at a wall. `at_wall` gives the middle of a thing of that depth.
fn of_building(kind: u32, at_wall: impl Fn(f64) -> Point, room_m: f64, yaw_rad: f64, random: &mut ChaCha8Rng) -> Prism {
    match kind {
        10..=12 => {
            let (depth_m, long_m) = (room_m.min(RADIATOR_M), between(random, [0.5, 1.4]));
            let z = [0.1, between(random, [0.5, 0.9])];
            Prism::cuboid(at_wall(depth_m), [long_m, depth_m], yaw_rad, z)
        }
        13..=14 => {
            let (depth_m, long_m) = (room_m.min(BENCH_M), between(random, [0.8, 1.4]));
            // On a plinth or on legs.
            let z = if random.random_bool(0.5) { [0.0, 0.45] } else { [0.38, 0.45] };
            Prism::cuboid(at_wall(depth_m), [long_m, depth_m], yaw_rad, z)
        }
        15..=16 => {
            let z = [between(random, [0.0, 0.5]), between(random, [0.6, 1.1])];
            Prism::pillar(at_wall(2.0 * EXTINGUISHER_M), EXTINGUISHER_M, z)
        }
        _ => {
            let radius_m = (room_m / 2.0).min(0.22);
            Prism::pillar(at_wall(2.0 * radius_m), radius_m, [0.0, between(random, [0.3, 0.8])])
        }
    }
}
