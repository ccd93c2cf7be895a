//! Walking on along the ways of a floor plan, as a person would who was told to go on: straight over crossings, round
//! corners, to where the way ends or it is not clear which way is on.

use std::f64::consts::PI;

use guidance::TravelLine;
use guidance::se2::{Point, wrap_angle};
use nalgebra::Vector2;

use super::FloorPlan;
use super::ways::Along;

/// A way leads on that turns by less than this, radians; a way to the side turns by more.
const ASIDE_RAD: f64 = 0.95;
/// Of several that lead on the one is meant that turns by so much less than all others, and by at most so much.
const CLEARLY_RAD: f64 = 0.35;
const ON_RAD: f64 = 0.7;
/// A way that turns back by more than this is not the way round a corner, radians, and no clear way to a side.
const BACK_RAD: f64 = 2.3;
/// Directions are taken over so much way, metres,
const LOOK_M: f64 = 1.5;
const LEAST_LOOK_M: f64 = 0.4;
/// beginning so much of the room about a joint away from it, at most so far, metres.
const ABOUT_JOINT: f64 = 0.8;
const ABOUT_JOINT_MAX_M: f64 = 1.5;
/// Length over which a line is smoothed to either side, and distance between its corners, metres.
const SMOOTH_M: f64 = 0.4;
const CORNER_EVERY_M: f64 = 0.3;
/// Joints are one crossing where one is within the room about the other, and no farther than this, metres.
const ONE_CROSSING_M: f64 = 1.5;
/// A line ends so far before a wall, metres, and goes on straight for at most so far to get there.
const BEFORE_WALL_M: f64 = 0.3;
const TO_WALL_M: f64 = 4.0;
/// A way does not end where so much more than the room about it is free straight on, metres.
const STRAIGHT_ON_M: f64 = 1.0;
/// Length over which a corner is as wide as a way, metres.
const CORNER_M: f64 = 2.5;

/// What ends a walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// A wall straight on. To its sides something may lead off, in which case the walk ends at a crossing.
    Wall,
    /// Several ways, of which none is clearly the way on.
    Fork,
    /// It has come as far as was asked, or back to where it was.
    Enough,
}

/// A way that leads off a walk.
#[derive(Debug, Clone, Copy)]
pub(super) struct Branch {
    pub(super) along: Along,
    /// Where it begins: a number of a cell.
    pub(super) cell: usize,
    /// How it leads off, radians, positive to the left.
    pub(super) turn_rad: f64,
}

impl Branch {
    /// Whether it clearly leads to the side.
    pub(super) fn is_aside(&self) -> bool {
        (ASIDE_RAD..BACK_RAD).contains(&self.turn_rad.abs())
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Walk {
    /// The cells of its middle.
    pub(super) cells: Vec<usize>,
    /// What leads off, in the order of the way.
    pub(super) branches: Vec<Branch>,
    pub(super) end: End,
}

/// What a walk meets at a joint.
struct Crossing {
    /// The direction of the walk, radians.
    heading_rad: f64,
    /// Each with the cells that lead from the joint to where it begins.
    branches: Vec<(Branch, Vec<usize>)>,
}

impl FloorPlan {
    /// Walks on along a stretch, from the cell of that place in its order, for at most so far, metres.
    pub(super) fn walk(&self, along: Along, from: usize, most_m: f64) -> Walk {
        let mut walk = Walk { cells: self.ways.cells(along)[from..].to_vec(), branches: Vec::new(), end: End::Enough };
        let (mut along, mut way_m, mut joints) = (along, self.length_m(&walk.cells), Vec::new());
        while way_m < most_m {
            let joint = self.ways.end(along);
            if joints.contains(&joint) {
                break;
            }
            joints.push(joint);
            let crossing = self.crossing(along, &walk.cells);
            let on = self.on(&crossing, joint);
            walk.branches.extend(crossing.branches.iter().enumerate().filter(|(i, _)| on != Ok(*i)).map(|(_, b)| b.0));
            match on {
                Err(end) => {
                    walk.end = end;
                    return walk;
                }
                Ok(on) => {
                    let (branch, lead) = &crossing.branches[on];
                    walk.cells.extend(lead);
                    walk.cells.extend(self.ways.cells(branch.along).into_iter().skip(1));
                    (along, way_m) = (branch.along, self.length_m(&walk.cells));
                }
            }
        }
        walk
    }

    /// Cuts cells to those within this length, metres.
    pub(super) fn cut(&self, cells: &mut Vec<usize>, most_m: f64) {
        let mut way_m = 0.0;
        let steps = cells.windows(2).take_while(|pair| {
            way_m += self.length_m(pair);
            way_m <= most_m
        });
        let count = steps.count() + 1;
        cells.truncate(count);
    }

    /// Which of the branches leads on from a joint.
    fn on(&self, crossing: &Crossing, joint: usize) -> Result<usize, End> {
        let turns = |most_rad: f64| {
            let all = crossing.branches.iter().enumerate().map(|(i, (branch, _))| (i, branch.turn_rad.abs()));
            let mut turns: Vec<(usize, f64)> = all.filter(|(_, turn_rad)| *turn_rad <= most_rad).collect();
            turns.sort_by(|a, b| a.1.total_cmp(&b.1));
            turns
        };
        match (&turns(ASIDE_RAD)[..], &turns(BACK_RAD)[..]) {
            ([(on, _)], _) => Ok(*on),
            ([(on, first), (_, second), ..], _) if *first <= ON_RAD && second - first >= CLEARLY_RAD => Ok(*on),
            ([_, ..], _) => Err(End::Fork),
            ([], [(corner, _)]) if self.is_corner(&crossing.branches[*corner].0) => Ok(*corner),
            ([], _) if self.goes_straight_on(crossing, joint) => Err(End::Fork),
            ([], []) => Err(End::Wall),
            ([], [_]) => Err(End::Fork),
            ([], _) => Err(End::Wall),
        }
    }

    /// Whether the only way from a joint is the corridor's own way round a corner, and not a door at its end.
    fn is_corner(&self, branch: &Branch) -> bool {
        let cells = self.ways.cells(branch.along);
        2.0 * self.narrowest_m(&cells, [0.0, CORNER_M]) >= super::CLEAR_M
    }

    /// Whether it is free straight on beyond a joint, though no way leads there: it is not clear that it ends.
    fn goes_straight_on(&self, crossing: &Crossing, joint: usize) -> bool {
        let from = self.map.middle_of(self.ways.joints[joint].cell);
        let direction = Vector2::new(crossing.heading_rad.cos(), crossing.heading_rad.sin());
        let room_m = self.room.of_cell(self.ways.joints[joint].cell);
        self.goes_m(from, direction, TO_WALL_M + room_m, BEFORE_WALL_M) > room_m + STRAIGHT_ON_M
    }

    /// What leads off where a stretch ends; `cells` are those walked so far.
    fn crossing(&self, along: Along, cells: &[usize]) -> Crossing {
        let joint = self.ways.end(along);
        let heading_rad = self.heading_rad(cells.iter().rev(), self.about_m(joint)) + PI;
        let back = Along { is_forth: !along.is_forth, ..along };
        let mut crossing = Crossing { heading_rad, branches: Vec::new() };
        let (mut joints, mut todo) = (vec![joint], vec![(joint, Vec::new())]);
        while let Some((here, lead)) = todo.pop() {
            for off in self.ways.leading_off(here).filter(|off| *off != back) {
                let (next, cells) = (self.ways.end(off), self.ways.cells(off));
                if self.is_one_crossing(here, next) && self.length_m(&cells) <= 2.0 * ONE_CROSSING_M {
                    if !joints.contains(&next) {
                        joints.push(next);
                        todo.push((next, lead.iter().chain(&cells[1..]).copied().collect()));
                    }
                    continue;
                }
                let turn_rad = wrap_angle(self.heading_rad(cells.iter(), self.about_m(here)) - heading_rad);
                let cell = self.ways.joints[here].cell;
                crossing.branches.push((Branch { along: off, cell, turn_rad }, lead.clone()));
            }
        }
        crossing
    }

    fn is_one_crossing(&self, a: usize, b: usize) -> bool {
        let cells = [a, b].map(|joint| self.ways.joints[joint].cell);
        let room_m = cells.map(|cell| self.room.of_cell(cell));
        let apart_m = (self.map.middle_of(cells[1]) - self.map.middle_of(cells[0])).norm();
        let leads_on = self.ways.joints[b].stretches.len() > 1;
        a != b && leads_on && apart_m <= room_m[0].max(room_m[1]).min(ONE_CROSSING_M)
    }

    /// The room about a joint in which ways have not got their direction yet, metres.
    fn about_m(&self, joint: usize) -> f64 {
        (ABOUT_JOINT * self.room.of_cell(self.ways.joints[joint].cell)).min(ABOUT_JOINT_MAX_M)
    }

    /// The direction in which cells lead away beyond their first `about_m`, radians; of fewer cells their last ones'.
    fn heading_rad<'a>(&self, cells: impl Iterator<Item = &'a usize>, about_m: f64) -> f64 {
        let mut places: Vec<(f64, Point)> = Vec::new();
        for place in cells.map(|cell| self.map.middle_of(*cell)) {
            let way_m = places.last().map_or(0.0, |(way_m, before)| way_m + (place - before).norm());
            places.push((way_m, place));
            if way_m > about_m + LOOK_M {
                break;
            }
        }
        let Some((length_m, to)) = places.last().copied() else { return 0.0 };
        let from_m = about_m.min((length_m - LEAST_LOOK_M).max(0.0));
        let from = places.iter().find(|(way_m, _)| *way_m >= from_m).map_or(to, |(_, place)| *place);
        (to - from).y.atan2((to - from).x)
    }

    /// The least room about cells between two ways along them, metres; of fewer cells about the last one.
    pub(super) fn narrowest_m(&self, cells: &[usize], [from_m, to_m]: [f64; 2]) -> f64 {
        let mut way_m = 0.0;
        let mut narrowest_m = f64::INFINITY;
        for pair in cells.windows(2) {
            way_m += self.length_m(pair);
            if way_m > to_m {
                break;
            }
            if way_m >= from_m {
                narrowest_m = narrowest_m.min(self.room.of_cell(pair[1]));
            }
        }
        if narrowest_m.is_finite() { narrowest_m } else { cells.last().map_or(0.0, |cell| self.room.of_cell(*cell)) }
    }

    fn length_m(&self, cells: &[usize]) -> f64 {
        cells.windows(2).map(|pair| (self.map.middle_of(pair[1]) - self.map.middle_of(pair[0])).norm()).sum()
    }

    /// The line along the middle of a walk, to just before the wall where it ends at one.
    pub(super) fn line(&self, walk: &Walk) -> Option<TravelLine> {
        let cells_of = |way_m: f64| (way_m / self.map.resolution_m()).round().max(1.0) as usize;
        let (most, every) = (cells_of(SMOOTH_M), cells_of(CORNER_EVERY_M));
        let raw: Vec<Point> = walk.cells.iter().map(|cell| self.map.middle_of(*cell)).collect();
        let smooth = |i: usize| {
            // As far to one side as to the other, so that the ends stay.
            let reach = most.min(i).min(raw.len() - 1 - i);
            let near = &raw[i - reach..=i + reach];
            Point::from(near.iter().map(|place| place.coords).sum::<Vector2<f64>>() / near.len() as f64)
        };
        let mut places: Vec<Point> = (0..raw.len()).step_by(every).map(smooth).collect();
        places.extend(raw.last());
        if walk.end == End::Wall {
            let before = places[places.len().saturating_sub(4)];
            let last = places[places.len() - 1];
            if let Some(direction) = (last - before).try_normalize(1e-9) {
                let to_wall_m = self.goes_m(last, direction, TO_WALL_M, BEFORE_WALL_M);
                places.push(last + direction * to_wall_m);
            }
        }
        TravelLine::new(&places)
    }
}
