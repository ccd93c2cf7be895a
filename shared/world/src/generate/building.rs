//! What makes a generated corridor like one of a building: rooms behind doorways, alcoves, narrow openings, oblique and
//! uneven walls, frames, pillars at corners, doors across the corridor, radiators, fire extinguishers and benches.
//!
//! How often and how large follows what `tests/like_buildings.rs` measures of real floors, and that test holds both
//! against each other.

use std::f64::consts::FRAC_PI_2;

use guidance::TravelLine;
use guidance::se2::{Point, Se2};
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::furnish::{Kinds, furnish_course, room_beside_m};
use super::layout::{Branch, FULL, Leads, Plan};
use super::{GeneratorConfig, between};
use crate::World;
use crate::prism::{Prism, SeenBy};
use crate::site::{Behind, Side};
use crate::world::DEFAULT_CEILING_M;

/// Narrowest and widest corridor, metres, and the power of the draw that makes narrow ones more frequent.
const WIDTH_M: [f64; 2] = [1.3, 2.9];
const NARROW: f64 = 1.5;
/// From what leads off a side to the next one, metres; what comes nearer than a metre finds no place.
const APART_M: [f64; 2] = [0.6, 3.2];
/// The farther edge of a mouth is so far from the end of a straight stretch, metres.
const CORNER_M: f64 = 0.4;
/// Branches that two walk into side by side, doorways into rooms, doors that are shut, alcoves: in relation to each
/// other.
const KINDS: [u32; 4] = [3, 5, 4, 5];
/// Widths and lengths of those, metres.
const BRANCH_M: [[f64; 2]; 2] = [[1.15, 2.6], [4.0, 11.0]];
const ROOM_M: [[f64; 2]; 2] = [[0.7, 1.5], [2.5, 6.5]];
const SHUT_M: [[f64; 2]; 2] = [[0.75, 1.6], [0.06, 0.35]];
const ALCOVE_M: [[f64; 2]; 2] = [[0.5, 4.0], [0.35, 4.0]];
/// A branch is off the right angle by up to this, radians.
const SKEW_RAD: f64 = 0.5;
/// Two walk side by side through an opening of the first width, metres. Through one between the second and the first
/// it depends on centimetres.
const PAIR_M: [f64; 2] = [1.2, 0.8];
/// A shallower or narrower alcove is clearly no way, metres.
const NICHE_M: f64 = 0.8;
/// Thickness of walls, and so depth of jambs, metres.
const JAMB_M: [f64; 2] = [0.08, 0.3];
/// A room is wider than its doorway to either side by so much, metres.
const BEYOND_M: [f64; 2] = [0.1, 2.2];
/// A frame stands out of the wall by so much, and is so wide, metres.
const FRAME_M: [[f64; 2]; 2] = [[0.02, 0.05], [0.05, 0.1]];
pub(super) const LEAF_THICK_M: f64 = 0.04;
/// A wall goes on evenly for so long, metres,
const EVEN_M: [f64; 2] = [0.2, 2.0];
/// stands back or out by up to this then, metres,
const UNEVEN_M: f64 = 0.07;
/// or comes out at a pilaster, so long and deep, metres.
const PILASTER_M: [[f64; 2]; 2] = [[0.2, 0.7], [0.06, 0.3]];
/// It stands back by less than the thickness of a wall behind which there may be a room, metres.
const BACK_M: f64 = 0.07;
/// The width between the jambs of a door across the corridor, and the thickness of the wall there, metres.
const GATE_M: [[f64; 2]; 2] = [[1.25, 1.7], [0.08, 0.25]];
/// Nothing else stands so near to such a door, metres of way.
const GATE_FREE_M: f64 = 1.3;
/// A pillar at the corner of a branch is so thick, metres.
const PILLAR_M: [f64; 2] = [0.15, 0.4];

/// A room behind a doorway.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    /// Thickness of the wall, metres.
    pub(super) wall_m: f64,
    /// How much wider than its doorway it is, to the left and to the right of who goes in, metres.
    pub(super) beyond_m: [f64; 2],
    /// Its door, where it has one that stands open.
    pub(super) leaf: Option<Leaf>,
}

/// A door's leaf.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaf {
    /// Where its hinge is, as seen by who goes in.
    hinge: Side,
    /// How far it is open, radians; it opens inwards.
    open_rad: f64,
    seen_by: SeenBy,
}

/// A door across the corridor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gate {
    way_m: f64,
    /// Its jambs, metres to the left of the corridor's middle: the right one and the left one.
    jambs_m: [f64; 2],
    wall_m: f64,
    /// Whether its leaves stand open before it.
    has_leaves: bool,
}

/// The width of a corridor, metres.
pub(super) fn draw_width_m(random: &mut ChaCha8Rng) -> f64 {
    WIDTH_M[0] + (WIDTH_M[1] - WIDTH_M[0]) * random.random::<f64>().powf(NARROW)
}

impl Branch {
    pub(super) fn is_shut_door(&self) -> bool {
        let [[_, widest_m], [_, deepest_m]] = SHUT_M;
        self.room.is_none() && self.width_m <= widest_m && self.length_m < deepest_m
    }
}

impl Plan {
    /// What leads off both sides.
    pub(super) fn draw_sides(&mut self, random: &mut ChaCha8Rng) {
        for stretch in self.stretches.clone() {
            for side in [Side::Left, Side::Right] {
                let mut way_m = stretch.from_m + between(random, APART_M);
                while way_m < stretch.to_m - 0.6 {
                    let branch = draw_branch(side, way_m, random);
                    // The next one is beyond this one.
                    let (half_m, count) = (branch.width_m / 2.0, self.branches.len());
                    if way_m + 2.0 * half_m + CORNER_M < stretch.to_m {
                        self.add(Branch { way_m: way_m + half_m, ..branch });
                    }
                    let taken_m = if self.branches.len() > count { 2.0 * half_m } else { 0.0 };
                    way_m += taken_m + between(random, APART_M);
                }
            }
        }
    }

    /// A door across the corridor, in one of four.
    pub(super) fn draw_gate(&self, random: &mut ChaCha8Rng) -> Option<Gate> {
        let length_m = self.line.length_m();
        if !random.random_bool(0.25) || length_m < 10.0 {
            return None;
        }
        let (way_m, wide_m) = (between(random, [4.0, length_m - 4.0]), between(random, GATE_M[0]));
        let is_straight = |stretch: &super::layout::Stretch| {
            (stretch.from_m + GATE_FREE_M..stretch.to_m - GATE_FREE_M).contains(&way_m)
        };
        let is_free = |branch: &Branch| (branch.way_m - way_m).abs() > branch.width_m / 2.0 + GATE_FREE_M;
        if wide_m > self.width_m - 0.2 || !self.stretches.iter().any(is_straight) || !self.branches.iter().all(is_free)
        {
            return None;
        }
        let spare_m = (self.width_m - wide_m) / 2.0;
        let middle_m = if random.random_bool(0.5) { 0.0 } else { between(random, [-spare_m, spare_m]) };
        let jambs_m = [middle_m - wide_m / 2.0, middle_m + wide_m / 2.0];
        Some(Gate { way_m, jambs_m, wall_m: between(random, GATE_M[1]), has_leaves: random.random_bool(0.5) })
    }

    /// What is behind a branch, where it is a room.
    pub(super) fn behind(&self, branch: &Branch) -> Option<Behind> {
        let room = branch.room?;
        let [left_m, right_m] = room.beyond_m.map(|beyond_m| branch.width_m / 2.0 + beyond_m);
        let world_from_door = self.branch_frame(branch) * Se2::translation(self.width_m / 2.0, 0.0);
        Some(Behind::Room { world_from_door, across_m: [-right_m, left_m] })
    }

    /// Frames, leaves, pillars at corners, doors across the corridor.
    pub(super) fn fittings(&self, config: &GeneratorConfig, random: &mut ChaCha8Rng) -> Vec<Prism> {
        if !self.is_building {
            return Vec::new();
        }
        let mut fittings: Vec<Prism> = self.gate.iter().flat_map(|gate| self.gate_walls(gate)).collect();
        for branch in &self.branches {
            if branch.room.is_some() || branch.is_shut_door() {
                let [out_m, wide_m] = FRAME_M.map(|range_m| between(random, range_m));
                fittings.extend(self.at_mouth(branch, out_m, wide_m));
            } else if branch.is_way() && random.random_bool(0.3) {
                // Another one may stand on the other side.
                let most_m = ((self.width_m - config.passage_m) / 2.0).min(PILLAR_M[1]);
                if most_m > PILLAR_M[0] {
                    let size_m = between(random, [PILLAR_M[0], most_m]);
                    let beside = self.at_mouth(branch, size_m, size_m);
                    fittings.extend(beside.into_iter().take(random.random_range(1..=2)));
                }
            }
            fittings.extend(branch.room.and_then(|room| room.leaf).map(|leaf| self.leaf(branch, &leaf)));
        }
        fittings
    }

    /// Two boxes at the corridor's wall, on either side of a branch's mouth.
    fn at_mouth(&self, branch: &Branch, out_m: f64, wide_m: f64) -> [Prism; 2] {
        let side = branch.side.sign();
        let half_m = self.width_m / 2.0;
        let [near, far] = self.mouth(branch).map(|mouth| self.line.foot(mouth).way_m);
        [near - wide_m / 2.0, far + wide_m / 2.0].map(|way_m| {
            let at = self.line.at(way_m);
            let middle = at * Point::new(0.0, side * (half_m - out_m / 2.0));
            Prism::cuboid(middle, [wide_m, out_m], at.rotation.angle(), FULL)
        })
    }

    fn leaf(&self, branch: &Branch, leaf: &Leaf) -> Prism {
        let half_m = branch.width_m / 2.0;
        let wall_m = branch.room.map_or(0.0, |room| room.wall_m);
        let hinge = Point::new(self.width_m / 2.0 + wall_m, leaf.hinge.sign() * half_m);
        let (sin, cos) = leaf.open_rad.sin_cos();
        let along = Vector2::new(sin, -leaf.hinge.sign() * cos);
        let frame = self.branch_frame(branch);
        let middle = frame * (hinge + along * half_m);
        let yaw_rad = frame.rotation.angle() + along.y.atan2(along.x);
        Prism::cuboid(middle, [2.0 * half_m, LEAF_THICK_M], yaw_rad, [0.0, 2.05]).seen_by(leaf.seen_by)
    }

    fn gate_walls(&self, gate: &Gate) -> Vec<Prism> {
        let at = self.line.at(gate.way_m);
        let yaw_rad = at.rotation.angle();
        let half_m = self.width_m / 2.0;
        let wall = |[right_m, left_m]: [f64; 2]| {
            let wide_m = left_m - right_m;
            let middle = at * Point::new(0.0, f64::midpoint(right_m, left_m));
            (wide_m > 0.01).then(|| Prism::cuboid(middle, [gate.wall_m, wide_m], yaw_rad, FULL))
        };
        let [right_m, left_m] = gate.jambs_m;
        let walls = [[-half_m, right_m], [left_m, half_m]].into_iter().filter_map(wall);
        let leaf_m = (left_m - right_m) / 2.0;
        let leaves = [right_m - LEAF_THICK_M, left_m + LEAF_THICK_M].map(|at_m| {
            let middle = at * Point::new((gate.wall_m + leaf_m) / 2.0, at_m);
            Prism::cuboid(middle, [leaf_m, LEAF_THICK_M], yaw_rad, [0.0, 2.05])
        });
        walls.chain(leaves.into_iter().filter(|_| gate.has_leaves)).collect()
    }

    /// What stands in such a corridor, between walls that are not even.
    pub(super) fn furnish_building(
        &self,
        config: &GeneratorConfig,
        walls: Vec<Prism>,
        random: &mut ChaCha8Rng,
    ) -> Vec<Prism> {
        let (course, world) = (self.course(), World::new(DEFAULT_CEILING_M, walls));
        let half_m = self.width_m / 2.0;
        let free_m = |way_m: f64| {
            let here = Point::from(course.line.at(way_m).translation.vector);
            let at_m = self.line.foot(here).way_m;
            if self.gate.is_some_and(|gate| (gate.way_m - at_m).abs() < GATE_FREE_M) {
                return [0.0; 2];
            }
            room_beside_m(&world, &course, way_m, half_m)
        };
        furnish_course(config, &course, free_m, Kinds::OfBuildings, random)
    }
}

/// What leads off to a side from there on.
fn draw_branch(side: Side, way_m: f64, random: &mut ChaCha8Rng) -> Branch {
    let mut left = random.random_range(0..KINDS.iter().sum());
    let is_drawn = |share: &u32| {
        let is_it = left < *share;
        left = left.saturating_sub(*share);
        is_it
    };
    let kind = KINDS.iter().position(is_drawn).unwrap_or_default();
    let [width_m, length_m] = [BRANCH_M, ROOM_M, SHUT_M, ALCOVE_M][kind].map(|range_m| between(random, range_m));
    let branch = Branch { side, way_m, width_m, skew_rad: 0.0, length_m, leads: Leads::Nowhere, room: None };
    let by_width = match width_m {
        wide_m if wide_m >= PAIR_M[0] => Leads::Somewhere,
        wide_m if wide_m >= PAIR_M[1] => Leads::Unclear,
        _ => Leads::Nowhere,
    };
    match kind {
        0 => {
            let skew_rad = if random.random_bool(0.4) { between(random, [-SKEW_RAD, SKEW_RAD]) } else { 0.0 };
            Branch { skew_rad, leads: by_width, ..branch }
        }
        1 => {
            let beyond_m = [BEYOND_M; 2].map(|range_m| between(random, range_m));
            let leaf = draw_leaf(width_m, beyond_m, random);
            let room = Room { wall_m: between(random, JAMB_M), beyond_m, leaf };
            // A leaf that stands in the doorway leaves less.
            let leads =
                if leaf.is_some_and(|leaf| leaf.open_rad < 1.3) { by_width.min(Leads::Unclear) } else { by_width };
            Branch { leads, room: Some(room), ..branch }
        }
        2 => branch,
        _ if width_m.min(length_m) < NICHE_M => branch,
        _ => Branch { leads: Leads::Unclear, ..branch },
    }
}

/// Most doors stand wide open, some half. A leaf ends at the wall beside it: `beyond_m` beyond the doorway to the left
/// and to the right, metres.
fn draw_leaf(width_m: f64, beyond_m: [f64; 2], random: &mut ChaCha8Rng) -> Option<Leaf> {
    let open_rad: f64 = match random.random_range(0..10) {
        0..=1 => return None,
        2..=3 => between(random, [0.5, 1.2]),
        _ => between(random, [FRAC_PI_2, FRAC_PI_2 + 0.6]),
    };
    let hinge = if random.random_bool(0.5) { Side::Left } else { Side::Right };
    let seen_by = if random.random_bool(0.1) { SeenBy::Camera } else { SeenBy::Both };
    let beside_m = beyond_m[if hinge == Side::Left { 0 } else { 1 }] - LEAF_THICK_M;
    let most_rad = FRAC_PI_2 + (beside_m / width_m).clamp(0.0, 1.0).asin();
    Some(Leaf { hinge, open_rad: open_rad.min(most_rad), seen_by })
}

/// A wall that is not even: it stands back or out a little, comes out at pilasters, and is oblique in part. It comes
/// out by up to `room_m`, and its ends stay where they are.
pub(super) fn uneven(line: &TravelLine, side: Side, room_m: f64, random: &mut ChaCha8Rng) -> TravelLine {
    let place = |way_m: f64, out_m: f64| line.at(way_m) * Point::new(0.0, -side.sign() * out_m);
    let length_m = line.length_m();
    let mut places = vec![place(0.0, 0.0)];
    let mut way_m = between(random, [0.05, 0.4]);
    while way_m < length_m - 0.1 {
        let (to_m, out_m) = if random.random_bool(0.2) {
            let [long_m, deep_m] = PILASTER_M.map(|range_m| between(random, range_m));
            (way_m + long_m, [deep_m; 2])
        } else {
            let out_m = between(random, [-UNEVEN_M, UNEVEN_M]);
            let oblique_m = if random.random_bool(0.3) { between(random, [-0.15, 0.3]) } else { 0.0 };
            (way_m + between(random, EVEN_M), [out_m, out_m + oblique_m])
        };
        let to_m = to_m.min(length_m - 0.05);
        let inner = line.corners().iter().filter(|corner| {
            let corner_m = line.foot(**corner).way_m;
            corner_m > way_m + 1e-3 && corner_m < to_m - 1e-3
        });
        let [from_out_m, to_out_m] = out_m.map(|out_m| out_m.clamp(-BACK_M, room_m.max(0.0)));
        places.push(place(way_m, from_out_m));
        places.extend(inner.map(|corner| place(line.foot(*corner).way_m, f64::midpoint(from_out_m, to_out_m))));
        places.push(place(to_m, to_out_m));
        way_m = to_m + 1e-3;
    }
    places.push(place(length_m, 0.0));
    places.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
    TravelLine::new(&places).unwrap_or_else(|| line.clone())
}
