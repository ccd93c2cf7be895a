//! The plan of a generated world: the corridor, its branches, and the walls of both.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use guidance::TravelLine;
use guidance::se2::{Point, Se2, wrap_angle};
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::building::{Gate, Room, draw_width_m, uneven};
use super::hall::Hall;
use super::{GeneratorConfig, between};
use crate::prism::{Prism, SeenBy};
use crate::site::{Course, Mapped, Opening, Side, rounded};
use crate::world::DEFAULT_CEILING_M;

/// A bend is a polygon with corners of so much, radians.
const CORNER_RAD: f64 = 0.14;
/// Branches keep so far from each other and from the corridor's ends, metres.
const APART_M: f64 = 1.0;
/// A corridor that goes on for less beyond its last branch is a corner, metres.
const DEAD_END_M: f64 = 1.5;
/// A corridor that meets itself is drawn anew so many times.
const TRIES: usize = 20;
/// Floor to ceiling.
pub(super) const FULL: [f64; 2] = [0.0, DEFAULT_CEILING_M];

/// A straight stretch of the corridor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    pub(super) from_m: f64,
    pub(super) to_m: f64,
}

/// A branch that leads off the corridor.
#[derive(Debug, Clone)]
pub(super) struct Branch {
    pub(super) side: Side,
    /// Where the middles meet, along the corridor, metres.
    pub(super) way_m: f64,
    pub(super) width_m: f64,
    /// Off the right angle, radians, counter-clockwise.
    pub(super) skew_rad: f64,
    /// From the corridor's wall to the end, metres.
    pub(super) length_m: f64,
    /// Whether a handler who asks for a turn means it.
    pub(super) leads: Leads,
    /// A doorway into a room; otherwise its walls go straight on.
    pub(super) room: Option<Room>,
}

/// Whether a branch is a way to turn into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Leads {
    /// It is a niche, or a door that is shut or too narrow.
    Nowhere,
    /// Two people would not say the same.
    Unclear,
    /// Two can walk into it, and it is deep.
    Somewhere,
}

impl Branch {
    pub(super) fn is_way(&self) -> bool {
        self.leads == Leads::Somewhere
    }

    /// Half of the width that it takes behind its mouth, metres.
    fn half_behind_m(&self) -> f64 {
        self.width_m / 2.0 + self.room.map_or(0.0, |room| room.beyond_m[0].max(room.beyond_m[1]))
    }
}

/// The plan.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) line: TravelLine,
    pub(super) width_m: f64,
    pub(super) stretches: Vec<Stretch>,
    pub(super) branches: Vec<Branch>,
    /// It is like a building's.
    pub(super) is_building: bool,
    /// The door across the corridor, where there is one.
    pub(super) gate: Option<Gate>,
    /// The hall into which the corridor widens, where there is one.
    pub(super) hall: Option<Hall>,
}

impl Plan {
    pub(super) fn draw(config: &GeneratorConfig, random: &mut ChaCha8Rng) -> Self {
        // Without such worlds nothing is drawn, and the others stay what they always were.
        let is_building = config.buildings > 0.0 && random.random_bool(config.buildings);
        let width_m = if is_building { draw_width_m(random) } else { between(random, config.width_m) };
        let (line, stretches) = corridor(config, width_m, random);
        let mut plan = Self { line, width_m, stretches, branches: Vec::new(), is_building, gate: None, hall: None };
        plan.draw_end(random);
        if is_building {
            // Drawn apart: worlds without a hall are what they were.
            let mut apart = random.clone();
            apart.set_stream(1);
            plan.draw_hall(&mut apart);
            plan.draw_sides(random);
            plan.gate = plan.draw_gate(random);
        } else {
            plan.draw_branches(random);
            plan.draw_doors(random);
        }
        plan.branches.sort_by(|a, b| a.way_m.total_cmp(&b.way_m));
        plan
    }

    /// What the corridor ends on: a wall, or a crossing corridor. One that leads to one side only would be a corner:
    /// nobody who walks there could say whether it is the corridor's end.
    fn draw_end(&mut self, random: &mut ChaCha8Rng) {
        if random.random_bool(0.4) {
            return;
        }
        let (before, width_m) = (self.branches.len(), between(random, [1.7, 3.0]));
        let way_m = self.line.length_m() - width_m / 2.0;
        for side in [Side::Left, Side::Right] {
            let length_m = between(random, [4.0, 11.0]);
            self.add(Branch { side, way_m, width_m, skew_rad: 0.0, length_m, leads: Leads::Somewhere, room: None });
        }
        if self.branches.len() < before + 2 {
            self.branches.truncate(before);
        }
    }

    fn draw_branches(&mut self, random: &mut ChaCha8Rng) {
        for stretch in self.stretches.clone() {
            let mut way_m = stretch.from_m + between(random, [1.5, 7.0]);
            while way_m < stretch.to_m - 1.5 {
                let width_m = between(random, [1.5, 2.8]);
                let skew_rad = if random.random_bool(0.3) { between(random, [-0.3, 0.3]) } else { 0.0 };
                let sides = match random.random_range(0..5) {
                    0 | 1 => &[Side::Left][..],
                    2 | 3 => &[Side::Right][..],
                    _ => &[Side::Left, Side::Right][..],
                };
                for &side in sides {
                    let length_m = between(random, [4.0, 11.0]);
                    self.add(Branch { side, way_m, width_m, skew_rad, length_m, leads: Leads::Somewhere, room: None });
                }
                way_m += width_m + between(random, [2.5, 10.0]);
            }
        }
    }

    /// Doors too narrow for two, open into rooms or closed in their niches.
    fn draw_doors(&mut self, random: &mut ChaCha8Rng) {
        for stretch in self.stretches.clone() {
            let mut way_m = stretch.from_m + between(random, [0.8, 6.0]);
            while way_m < stretch.to_m - 0.8 {
                let side = if random.random_bool(0.5) { Side::Left } else { Side::Right };
                let length_m =
                    if random.random_bool(0.3) { between(random, [2.0, 4.0]) } else { between(random, [0.08, 0.35]) };
                let width_m = between(random, [0.75, 0.95]);
                self.add(Branch { side, way_m, width_m, skew_rad: 0.0, length_m, leads: Leads::Nowhere, room: None });
                way_m += between(random, [2.0, 8.0]);
            }
        }
    }

    /// Adds a branch where there is room for it.
    pub(super) fn add(&mut self, branch: Branch) {
        let half = |branch: &Branch| {
            branch.width_m / 2.0 / branch.skew_rad.cos() + self.width_m / 2.0 * branch.skew_rad.tan().abs()
        };
        let clear = |other: &Branch| {
            other.side != branch.side || (other.way_m - branch.way_m).abs() > half(other) + half(&branch) + APART_M
        };
        let end_m = self.line.length_m();
        let at_end = branch.way_m + half(&branch) > end_m - 1e-9;
        let in_stretch = self.stretches.iter().any(|stretch| {
            let room_m = half(&branch) + 0.3;
            let ahead_m =
                if branch.is_way() && stretch.to_m > end_m - 1e-6 { half(&branch) + DEAD_END_M } else { room_m };
            branch.way_m - room_m >= stretch.from_m
                && (branch.way_m + ahead_m <= stretch.to_m || at_end && branch.way_m <= stretch.to_m)
        });
        if in_stretch && self.branches.iter().all(clear) && self.is_free(&branch) {
            self.branches.push(branch);
        }
    }

    /// Whether a branch runs into nothing: neither the corridor nor another branch.
    fn is_free(&self, branch: &Branch) -> bool {
        let line = self.branch_line(branch);
        let begin_m = self.width_m / 2.0 / branch.skew_rad.cos() + 0.4;
        let mut way_m = begin_m;
        let half_m = branch.half_behind_m();
        while way_m < line.length_m() + branch.width_m / 2.0 {
            let place = line.at(line.length_m().min(way_m)) * Point::new((way_m - line.length_m()).max(0.0), 0.0);
            let off_corridor = self.line.foot(place).left_m.abs() > (self.width_m + branch.width_m) / 2.0 + 0.2;
            // Near its own mouth a branch is as near to the corridor as it is long there.
            let at_mouth = way_m - self.width_m / 2.0 < branch.width_m / 2.0 + 0.6;
            if !(off_corridor || at_mouth) {
                return false;
            }
            let apart = |other: &Branch| {
                let foot = self.branch_line(other).foot(place);
                foot.left_m.abs() > other.half_behind_m() + half_m + 0.2
            };
            if !self
                .branches
                .iter()
                .all(|other| (other.side != branch.side && (other.way_m - branch.way_m).abs() < 0.1) || apart(other))
            {
                return false;
            }
            way_m += 0.4;
        }
        self.is_room_free(branch)
    }

    /// Whether the walls of a branch's room lie off the corridor, which may bend.
    fn is_room_free(&self, branch: &Branch) -> bool {
        let Some(room) = branch.room else { return true };
        let (frame, end_m) = (self.branch_frame(branch), self.branch_line(branch).length_m());
        let jamb_m = self.width_m / 2.0 + room.wall_m;
        let [left_m, right_m] = room.beyond_m.map(|beyond_m| branch.width_m / 2.0 + beyond_m);
        let corners = [(jamb_m, left_m), (end_m, left_m), (end_m, -right_m), (jamb_m, -right_m), (jamb_m, left_m)];
        let walls = corners.map(|(x_m, y_m)| frame * Point::new(x_m, y_m));
        let Some(walls) = TravelLine::new(&walls) else { return true };
        let looks = (walls.length_m() / 0.2) as usize;
        let is_off = |i: usize| {
            let place = Point::from(walls.at(0.2 * i as f64).translation.vector);
            self.line.foot(place).left_m.abs() > self.width_m / 2.0 + 0.05
        };
        (0..=looks).all(is_off)
    }

    /// Direction of a branch where the corridor is at its middle.
    pub(super) fn branch_frame(&self, branch: &Branch) -> Se2 {
        let at = self.line.at(branch.way_m);
        let yaw_rad = at.rotation.angle() + branch.side.sign() * FRAC_PI_2 + branch.skew_rad;
        Se2::new(at.translation.vector, wrap_angle(yaw_rad))
    }

    /// The middle of a branch, from the corridor's middle to its end.
    pub(super) fn branch_line(&self, branch: &Branch) -> TravelLine {
        let frame = self.branch_frame(branch);
        let end_m = self.width_m / 2.0 / branch.skew_rad.cos() + branch.length_m;
        let (from, to) = (frame * Point::origin(), frame * Point::new(end_m, 0.0));
        TravelLine::new(&[from, to]).unwrap_or_else(|| self.line.clone())
    }

    pub(super) fn course(&self) -> Course {
        let line = rounded(&self.line, self.width_m / 2.0);
        let opening = |branch: &Branch| {
            let way_m = line.foot(Point::from(self.line.at(branch.way_m).translation.vector)).way_m;
            let width_m = branch.width_m / branch.skew_rad.cos();
            match branch.leads {
                Leads::Nowhere => None,
                Leads::Unclear => Opening::unclear(&line, way_m, width_m, branch.side),
                Leads::Somewhere => Some(Opening {
                    way_m,
                    width_m,
                    side: branch.side,
                    line: self.branch_line(branch),
                    edge_m: None,
                    behind: self.behind(branch).map(Arc::new),
                }),
            }
        };
        let openings = self.branches.iter().filter_map(opening).collect();
        // As on a floor plan, a cue beside an opening is not clear.
        let way_m = |way_m: f64| line.foot(Point::from(self.line.at(way_m).translation.vector)).way_m;
        let hall_m = self.hall.map(|hall| [-0.5, 0.5].map(|share| way_m(hall.way_m + share * hall.length_m)));
        let mapped = self.is_building.then_some(Mapped { has_end: true, hall_m });
        Course { mapped, ..Course::new(line, self.width_m, openings) }
    }

    /// All walls.
    pub(super) fn walls(&self, config: &GeneratorConfig, random: &mut ChaCha8Rng) -> Vec<Prism> {
        let mut walls = Vec::new();
        let half_m = self.width_m / 2.0;
        for side in [Side::Left, Side::Right] {
            let edge = self.edge(side.sign() * half_m);
            let mut from_m = 0.0;
            for branch in self.branches.iter().filter(|branch| branch.side == side) {
                let [near, far] = self.mouth(branch);
                let (near_m, far_m) = (edge.foot(near).way_m, edge.foot(far).way_m);
                self.add_wall(edge.part(from_m, near_m), side, config, random, &mut walls);
                walls.push(self.branch_walls(branch, near, far));
                from_m = far_m;
            }
            self.add_wall(edge.part(from_m, edge.length_m()), side, config, random, &mut walls);
        }
        for way_m in [0.0, self.line.length_m()] {
            let at = self.line.at(way_m);
            walls.push(Prism::wall(vec![at * Point::new(0.0, half_m), at * Point::new(0.0, -half_m)], FULL));
        }
        walls
    }

    fn add_wall(
        &self,
        line: Option<TravelLine>,
        side: Side,
        config: &GeneratorConfig,
        random: &mut ChaCha8Rng,
        walls: &mut Vec<Prism>,
    ) {
        let Some(mut line) = line else { return };
        if self.is_building {
            let room_m = (self.width_m - config.passage_m) / 2.0;
            line = uneven(&line, side, room_m, random);
        }
        let glass = random.random_bool(config.glass) && line.length_m() > 1.5;
        if !glass {
            walls.push(Prism::wall(line.corners().to_vec(), FULL));
            return;
        }
        let from_m = between(random, [0.3, line.length_m() - 1.0]);
        let to_m = (from_m + between(random, [0.7, 2.5])).min(line.length_m() - 0.2);
        for (part, seen_by) in [
            (line.part(0.0, from_m), SeenBy::Both),
            (line.part(from_m, to_m), SeenBy::Camera),
            (line.part(to_m, line.length_m()), SeenBy::Both),
        ] {
            walls.extend(part.map(|part| Prism::wall(part.corners().to_vec(), FULL).seen_by(seen_by)));
        }
    }

    /// The line beside the corridor's middle: each corner moved out along the bisector of its neighbours.
    fn edge(&self, left_m: f64) -> TravelLine {
        let corners = self.line.corners();
        let normal = |i: usize| {
            let along = (corners[i + 1] - corners[i]).normalize();
            Vector2::new(-along.y, along.x)
        };
        let moved = |i: usize| {
            let (before, after) =
                (normal(i.saturating_sub(1).min(corners.len() - 2)), normal(i.min(corners.len() - 2)));
            let bisector = (before + after).normalize();
            corners[i] + bisector * (left_m / bisector.dot(&after))
        };
        let moved: Vec<Point> = (0..corners.len()).map(moved).collect();
        TravelLine::new(&moved).unwrap_or_else(|| self.line.clone())
    }

    /// Where a branch's sides meet the corridor's wall: the near and the far edge.
    pub(super) fn mouth(&self, branch: &Branch) -> [Point; 2] {
        let frame = self.branch_frame(branch);
        let along = self.line.at(branch.way_m).rotation.angle();
        let edge = |left_m: f64| {
            // The side line starts on the corridor's middle line and meets the wall after half a width.
            let reach_m = (self.width_m / 2.0 + left_m * branch.skew_rad.sin()) / branch.skew_rad.cos();
            frame * Point::new(reach_m, left_m)
        };
        let (a, b) = (edge(branch.width_m / 2.0), edge(-branch.width_m / 2.0));
        let ahead = Vector2::new(along.cos(), along.sin());
        if ahead.dot(&(b - a)) > 0.0 { [a, b] } else { [b, a] }
    }

    /// Both sides of a branch and its end.
    fn branch_walls(&self, branch: &Branch, near: Point, far: Point) -> Prism {
        let frame = self.branch_frame(branch);
        let end_m = self.branch_line(branch).length_m();
        let corner = |mouth: Point| {
            let left_m = (frame.inverse() * mouth).y;
            frame * Point::new(end_m, left_m)
        };
        let Some(room) = branch.room else {
            return Prism::wall(vec![near, corner(near), corner(far), far], FULL);
        };
        let jamb_m = self.width_m / 2.0 + room.wall_m;
        let place = |x_m: f64, mouth: Point| {
            let left_m = (frame.inverse() * mouth).y;
            let beyond_m = room.beyond_m[if left_m > 0.0 { 0 } else { 1 }];
            let wall = left_m + beyond_m.copysign(left_m);
            [frame * Point::new(x_m, left_m), frame * Point::new(x_m, wall)]
        };
        let [[near_jamb, near_wall], [far_jamb, far_wall]] = [near, far].map(|mouth| place(jamb_m, mouth));
        let [near_end, far_end] = [near, far].map(|mouth| place(end_m, mouth)[1]);
        Prism::wall(vec![near, near_jamb, near_wall, near_end, far_end, far_wall, far_jamb, far], FULL)
    }
}

/// The corridor's middle, and where it is straight: drawn anew until it does not meet itself.
fn corridor(config: &GeneratorConfig, width_m: f64, random: &mut ChaCha8Rng) -> (TravelLine, Vec<Stretch>) {
    let length_m = between(random, config.length_m);
    let bends = random.random_bool(config.bends);
    for _ in 0..TRIES {
        if let Some((line, stretches)) = wind(length_m, width_m, bends, random)
            && !meets_itself(&line, width_m)
        {
            return (line, stretches);
        }
    }
    let ends = [Point::origin(), Point::new(length_m, 0.0)];
    let line = TravelLine::new(&ends).unwrap_or_else(|| unreachable!("two ends of a corridor differ"));
    (line, vec![Stretch { from_m: 0.0, to_m: length_m }])
}

/// Straight stretches with bends between.
fn wind(length_m: f64, width_m: f64, bends: bool, random: &mut ChaCha8Rng) -> Option<(TravelLine, Vec<Stretch>)> {
    let (mut at, mut yaw_rad) = (Point::origin(), between(random, [-PI, PI]));
    let (mut places, mut stretches, mut way_m) = (vec![at], Vec::new(), 0.0);
    let mut side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    // What a square corner takes of the straight stretches beside it.
    let mut corner_m = 0.0;
    loop {
        let straight_m = if bends { between(random, [4.0, 14.0]) } else { length_m };
        let straight_m = straight_m.min(length_m - way_m).max(2.0);
        at += Vector2::new(yaw_rad.cos(), yaw_rad.sin()) * straight_m;
        places.push(at);
        let (from_m, ends_here) = (way_m + corner_m, way_m + straight_m >= length_m - 2.0);
        way_m += straight_m;
        // A square corner, a sharp one or a long bend; back the other way more often than not.
        let (square, sharp) = (random.random_bool(0.3), random.random_bool(0.3));
        let turn_rad = between(random, if square { [1.2, 1.65] } else { [0.3, 1.5] }) * side;
        corner_m = if square && !ends_here { width_m / 2.0 * (turn_rad.abs() / 2.0).tan() } else { 0.0 };
        stretches.push(Stretch { from_m, to_m: way_m - corner_m });
        if ends_here {
            return Some((TravelLine::new(&places)?, stretches));
        }
        side = if random.random_bool(0.7) { -side } else { side };
        if square {
            yaw_rad += turn_rad;
            continue;
        }
        let radius_m = if sharp { width_m / 2.0 + 0.1 } else { between(random, [width_m / 2.0 + 0.5, 14.0]) };
        let steps = (turn_rad.abs() / CORNER_RAD).ceil().max(1.0);
        let chord_m = 2.0 * radius_m * (turn_rad.abs() / steps / 2.0).sin();
        for _ in 0..steps as usize {
            yaw_rad += turn_rad / steps / 2.0;
            at += Vector2::new(yaw_rad.cos(), yaw_rad.sin()) * chord_m;
            yaw_rad += turn_rad / steps / 2.0;
            places.push(at);
            way_m += chord_m;
        }
    }
}

/// Whether a corridor comes back to where it was.
fn meets_itself(line: &TravelLine, width_m: f64) -> bool {
    let apart_m = width_m + 0.5;
    let samples: Vec<f64> = (0..=line.length_m() as usize).map(|way_m| way_m as f64).collect();
    let place = |way_m: f64| Point::from(line.at(way_m).translation.vector);
    samples.iter().any(|a| samples.iter().any(|b| b - a > 2.5 * apart_m && (place(*a) - place(*b)).norm() < apart_m))
}
