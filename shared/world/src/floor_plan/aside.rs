//! What lies beside a course: where robot and handler can leave it, found without the ways, and what is behind an
//! opening.

use std::sync::Arc;

use guidance::TravelLine;
use guidance::se2::{Point, Se2};

use super::FloorPlan;
use super::flood::flood;
use crate::site::{Behind, Side};

/// A body that gets this far to a side, beyond the corridor, has left it, metres.
const LEFT_M: f64 = 1.0;
/// A body of this radius goes there, metres. Half of the pair side by side is 0.45 m wide, but a map may be off by as
/// much.
const BODY_M: f64 = 0.40;
/// Places that are so near to each other are one, metres.
const SAME_M: f64 = 0.6;
/// So near to a course's ends it is not clear what is beside, and what is before or behind, metres.
const END_M: f64 = 0.6;
/// A person goes through a door of twice this, metres.
const PERSON_M: f64 = 0.33;
/// A person who gets this far beyond the end of a course has gone on, metres.
const ON_M: f64 = 0.4;
/// Distance between the places of a course that are looked at, metres.
const EVERY_M: f64 = 0.2;
/// A handler has so much room where they stand inside, metres.
const HANDLER_M: f64 = 0.25;
/// What is behind an opening is looked at so deep, metres.
const DEPTH_M: f64 = 5.0;
/// The corridor's own floor is so much wider than its middle tells, metres; its floor is looked at for so far to both
/// sides of an opening.
const WALL_M: f64 = 0.15;
const BESIDE_M: f64 = 6.0;

/// What leads back into the corridor within so much way is a way round something, metres, where it does so beside the
/// opening's own mouth by so much.
const BACK_M: f64 = 5.0;
const BACK_BESIDE_M: f64 = 0.8;

/// Where an opening is, along its course, and how wide, metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mouth {
    pub(super) way_m: f64,
    pub(super) width_m: f64,
}

/// Where a course can be left to a side: from where to where along it, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gap {
    pub(super) side: Side,
    pub(super) from_m: f64,
    pub(super) to_m: f64,
}

impl FloorPlan {
    /// Where robot and handler can leave a course, whose walls are half of `width_m` from its middle.
    pub(super) fn gaps(&self, line: &TravelLine, width_m: f64) -> Vec<Gap> {
        let ways_m: Vec<f64> = (0..=(line.length_m() / EVERY_M) as usize).map(|i| EVERY_M * i as f64).collect();
        let frames: Vec<Se2> = ways_m.iter().map(|way_m| line.at(*way_m)).collect();
        let cells: Vec<(usize, usize)> = (frames.iter().enumerate())
            .filter_map(|(i, frame)| Some((i, self.map.number_at(super::place(frame))?)))
            .collect();
        let seeds = cells.iter().map(|(_, cell)| *cell);
        let far_m = width_m / 2.0 + LEFT_M;
        let reached = flood(&self.map, seeds, far_m + 0.3, |cell| self.room.of_cell(cell) >= BODY_M);
        let mut left: Vec<(Side, f64)> = Vec::new();
        for reached in reached.iter().filter(|reached| reached.way_m >= far_m) {
            let (frame, way_m) = (frames[cells[reached.seed].0], ways_m[cells[reached.seed].0]);
            let there = frame.inverse() * self.map.middle_of(reached.cell);
            let aside_m = there.y;
            // What lies ahead of its end is no way to a side.
            let is_ahead = way_m > line.length_m() - END_M && there.x > aside_m.abs();
            if aside_m.abs() >= width_m / 2.0 && way_m >= END_M && !is_ahead {
                left.push((if aside_m > 0.0 { Side::Left } else { Side::Right }, way_m));
            }
        }
        let mut gaps = Vec::new();
        for side in [Side::Left, Side::Right] {
            let mut ways_m: Vec<f64> = left.iter().filter(|(at, _)| *at == side).map(|(_, way_m)| *way_m).collect();
            ways_m.sort_by(f64::total_cmp);
            for run in ways_m.chunk_by(|a, b| b - a <= SAME_M) {
                gaps.push(Gap { side, from_m: run[0], to_m: run[run.len() - 1] });
            }
        }
        gaps
    }

    /// Whether a person can go on beyond a course's end, straight on or askew: through a door, for example.
    pub(super) fn leads_on(&self, line: &TravelLine, width_m: f64) -> bool {
        let end = line.at(line.length_m());
        let from = line.at(line.length_m() - END_M);
        let far_m = width_m / 2.0 + END_M + LEFT_M;
        let seed = self.map.number_at(super::place(&from));
        let reached = flood(&self.map, seed, far_m, |cell| self.room.of_cell(cell) >= PERSON_M);
        reached.iter().any(|reached| {
            let there = end.inverse() * self.map.middle_of(reached.cell);
            there.x > ON_M && there.x > there.y.abs()
        })
    }

    /// What is behind an opening whose middle is `branch`: how far a handler has walked in, beyond the wall of the
    /// corridor. None where it soon leads back into the corridor: a way round a pillar is no way off.
    pub(super) fn behind(&self, line: &TravelLine, width_m: f64, mouth: &Mouth, branch: &TravelLine) -> Option<Behind> {
        let from_m = (mouth.way_m - BESIDE_M).max(0.0);
        let near = line.part(from_m, mouth.way_m + BESIDE_M)?;
        self.beyond(&near, width_m, &Mouth { way_m: mouth.way_m - from_m, ..*mouth }, branch)
    }

    /// What is behind a corner of the corridor itself, whose middle is at `way_m`: all that is beyond the wall of the
    /// corridor before it. None as above.
    pub(super) fn behind_corner(&self, line: &TravelLine, width_m: f64, way_m: f64) -> Option<Behind> {
        let from_m = (way_m - BESIDE_M).max(0.0);
        let before = line.part(from_m, (way_m - width_m / 2.0).max(from_m))?;
        let mouth = Mouth { way_m: way_m - from_m, width_m };
        self.beyond(&before, width_m, &mouth, &line.part(way_m, line.length_m())?)
    }

    /// What is beyond the walls of the corridor `near`, from the middle of `branch` on. The way of `mouth` is along
    /// `near`.
    fn beyond(&self, near: &TravelLine, width_m: f64, mouth: &Mouth, branch: &TravelLine) -> Option<Behind> {
        // The corridor goes on before the part that is looked at, and beyond it.
        let ends = [(near.at(0.0), -1.0), (near.at(near.length_m()), 1.0)];
        let in_corridor = |place: Point| {
            let wall_m = width_m / 2.0 + WALL_M;
            let is_beyond = ends.iter().any(|(end, sign)| {
                let there = end.inverse() * place;
                sign * there.x >= 0.0 && there.y.abs() < wall_m
            });
            is_beyond || near.foot(place).left_m.abs() < wall_m
        };
        let goes = |cell: usize| self.room.of_cell(cell) >= HANDLER_M && !in_corridor(self.map.middle_of(cell));
        // The first place of its middle that is beyond the wall.
        let steps = (branch.length_m() / EVERY_M) as usize;
        let places = (0..=steps).map(|i| super::place(&branch.at(EVERY_M * i as f64)));
        let mut seeds = places.filter_map(|place| self.map.number_at(place).filter(|cell| goes(*cell)));
        let reached = flood(&self.map, seeds.next(), DEPTH_M, goes);
        let is_back = |place: Point| {
            let foot = near.foot(place);
            let beside_m = (foot.way_m - mouth.way_m).abs();
            beside_m > mouth.width_m / 2.0 + BACK_BESIDE_M
                && foot.way_m > 0.0
                && foot.way_m < near.length_m()
                && foot.left_m.abs() < width_m / 2.0 + 2.0 * WALL_M
        };
        let soon = reached.iter().take_while(|reached| reached.way_m < BACK_M);
        let rooms = soon.filter(|reached| self.room.of_cell(reached.cell) >= BODY_M);
        if rooms.map(|reached| self.map.middle_of(reached.cell)).any(is_back) {
            return None;
        }
        Some(Behind::of_cells(
            Arc::clone(&self.map),
            reached.into_iter().map(|reached| (reached.cell, reached.way_m + WALL_M)),
        ))
    }
}
