//! A door of a corridor like those of buildings, which opens while the team comes by, and shuts again.

use std::f64::consts::FRAC_PI_2;

use guidance::se2::Point;
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::building::LEAF_THICK_M;
use super::layout::{Branch, Plan};
use super::{GeneratorConfig, between};
use crate::door::{Door, Opens};
use crate::people::Moves;
use crate::{SeenBy, World};

/// A door is drawn in this share of the corridors, and this share of the doors opens inwards. Only some corridors have
/// a door that may open so: then one in twelve has one, and three of ten open inwards.
const SHARE: f64 = 0.26;
const INWARDS: f64 = 0.65;
/// Shortest and longest leaf, metres.
const LENGTH_M: [f64; 2] = [0.7, 1.1];
/// The robot is so near to its hinge when it opens, metres; so far it opens, radians, so fast, radians per second, and
/// for so long it stays open, seconds.
const NEAR_M: [f64; 2] = [2.0, 5.0];
const OPEN_RAD: [f64; 2] = [1.2, FRAC_PI_2];
const SPEED_RADPS: [f64; 2] = [0.6, 1.4];
const STAYS_S: [f64; 2] = [3.0, 8.0];
/// This much about the leaf is free where it swings, metres: looked at along its outer part, from an angle on at which
/// it has left the wall, radians.
const CLEAR_M: f64 = 0.05;
const OUTER: [f64; 4] = [0.4, 0.6, 0.8, 1.0];
const OFF_WALL_RAD: f64 = 0.3;
const LOOK_RAD: f64 = 0.1;

impl Plan {
    /// The door that opens, in some corridors: into the corridor, which it may block until it shuts again, or into its
    /// room. None is a clear way to turn into, and none opens where people walk on a path: they would walk through it.
    pub(super) fn draw_door(&self, config: &GeneratorConfig, world: &World, random: &mut ChaCha8Rng) -> Option<Door> {
        let is_on_path = world.people().iter().any(|person| person.moves == Moves::Path);
        if !self.is_building || is_on_path || !random.random_bool(SHARE) {
            return None;
        }
        let is_inwards = random.random_bool(INWARDS);
        let may_open = |branch: &&Branch| {
            let is_room = branch.room.is_some_and(|room| room.leaf.is_none()) && !branch.is_way();
            (LENGTH_M[0]..LENGTH_M[1]).contains(&branch.width_m) && (is_room || !is_inwards && branch.is_shut_door())
        };
        let doors: Vec<&Branch> = self.branches.iter().filter(may_open).collect();
        let door = self.door(config, doors.get(random.random_range(0..doors.len().max(1)))?, is_inwards, random);
        swings_freely(&door, world).then_some(door)
    }

    fn door(&self, config: &GeneratorConfig, branch: &Branch, is_inwards: bool, random: &mut ChaCha8Rng) -> Door {
        // Where the open leaf leaves no way it stands between the team and its doorway, and shuts without them.
        let near = branch.side.sign();
        let blocks = !is_inwards && self.width_m - branch.width_m < config.passage_m;
        let hinge = if blocks || random.random_bool(0.5) { near } else { -near };
        let frame = self.branch_frame(branch);
        let wall_m = branch.room.filter(|_| is_inwards).map_or(0.0, |room| room.wall_m);
        let in_frame = Point::new(self.width_m / 2.0 + wall_m + LEAF_THICK_M / 2.0, hinge * branch.width_m / 2.0);
        let shut_rad = frame.rotation.angle() - hinge * FRAC_PI_2;
        let turn = if is_inwards { hinge } else { -hinge };
        let seen_by = if random.random_bool(0.1) { SeenBy::Camera } else { SeenBy::Both };
        Door {
            hinge: frame * in_frame,
            size_m: [branch.width_m, LEAF_THICK_M],
            z: [0.0, 2.05],
            swing_rad: [shut_rad, shut_rad + turn * between(random, OPEN_RAD)],
            speed_radps: between(random, SPEED_RADPS),
            opens: Opens::Near(between(random, NEAR_M)),
            stays_s: between(random, STAYS_S),
            seen_by,
        }
    }
}

/// Whether nothing stands where a leaf swings.
fn swings_freely(door: &Door, world: &World) -> bool {
    let ([shut_rad, open_rad], [length_m, _]) = (door.swing_rad, door.size_m);
    let swing_rad = open_rad - shut_rad;
    let looks = ((swing_rad.abs() - OFF_WALL_RAD) / LOOK_RAD) as usize;
    let is_free = |look: usize| {
        let at_rad = open_rad - (LOOK_RAD * look as f64).copysign(swing_rad);
        let along = Vector2::new(at_rad.cos(), at_rad.sin()) * length_m;
        OUTER.iter().all(|share| world.clearance(door.hinge + along * *share, door.z, CLEAR_M) >= CLEAR_M)
    };
    (0..=looks).all(is_free)
}
