//! A world and what is known of its ways: for who sets tasks in it and judges how they were done. The robot is told
//! none of it.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use guidance::TravelLine;
use guidance::se2::{Point, Se2, wrap_angle};

use crate::{GridMap, World};

/// A side of a way, as one walks along it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// To the left.
    Left,
    /// To the right.
    Right,
}

impl Side {
    /// 1 to the left, -1 to the right.
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

/// A way that leads off another one.
#[derive(Debug, Clone, PartialEq)]
pub struct Opening {
    /// Where it is left, along the main way, metres: where the middles of both meet.
    pub way_m: f64,
    /// Its width, metres.
    pub width_m: f64,
    /// To which side it leads.
    pub side: Side,
    /// Its middle, from where it meets the main way's to its end.
    pub line: TravelLine,
    /// Where its floor ends at an edge, along that line, metres.
    pub edge_m: Option<f64>,
    /// What is behind it, where it need not be a straight corridor.
    pub behind: Option<Arc<Behind>>,
}

/// What is behind an opening: how far one is inside, beyond the wall of the corridor.
#[derive(Debug, Clone)]
pub enum Behind {
    /// Cells of a floor plan.
    Cells {
        /// The floor plan.
        map: Arc<GridMap>,
        /// How far one has walked in, by number of a cell, metres.
        depths_m: HashMap<usize, f32>,
    },
    /// A room.
    Room {
        /// Where its doorway is, x inwards.
        world_from_door: Se2,
        /// How far it reaches to the right of that and to the left, y, metres.
        across_m: [f64; 2],
    },
}

impl Behind {
    pub(crate) fn of_cells(map: Arc<GridMap>, depths_m: impl Iterator<Item = (usize, f64)>) -> Self {
        Self::Cells { map, depths_m: depths_m.map(|(cell, depth_m)| (cell, depth_m as f32)).collect() }
    }

    /// How far inside a place is, metres; none: it is not behind the opening, or far behind it.
    #[must_use]
    pub fn depth_m(&self, place: Point) -> Option<f64> {
        match self {
            Self::Cells { map, depths_m } => depths_m.get(&map.number_at(place)?).map(|depth_m| f64::from(*depth_m)),
            Self::Room { world_from_door, across_m: [right_m, left_m] } => {
                let at = world_from_door.inverse() * place;
                (at.x >= 0.0 && (*right_m..=*left_m).contains(&at.y)).then_some(at.x)
            }
        }
    }
}

impl PartialEq for Behind {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Cells { depths_m: a, .. }, Self::Cells { depths_m: b, .. }) => a == b,
            (
                Self::Room { world_from_door: a, across_m: across_a },
                Self::Room { world_from_door: b, across_m: across_b },
            ) => a == b && across_a == across_b,
            _ => false,
        }
    }
}

impl Opening {
    /// A place where a way can be left, and of which it is not clear whether it is meant. None where the way is too
    /// short to tell.
    pub(crate) fn unclear(main: &TravelLine, way_m: f64, width_m: f64, side: Side) -> Option<Self> {
        let at = main.at(way_m);
        let [from, to] = [0.0, side.sign() * UNCLEAR_M].map(|left_m| at * Point::new(0.0, left_m));
        Some(Self { way_m, width_m, side, line: TravelLine::new(&[from, to])?, edge_m: None, behind: None })
    }

    /// Where its farther edge is, along the main way, metres.
    #[must_use]
    pub fn far_edge_m(&self) -> f64 {
        self.way_m + self.width_m / 2.0
    }

    /// Its direction, world frame, radians.
    #[must_use]
    pub fn axis_rad(&self) -> f64 {
        self.line.at(0.0).rotation.angle()
    }
}

/// A corridor and what leads off it.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// The middle of the corridor, to its end.
    pub line: TravelLine,
    /// Width of the corridor, metres.
    pub width_m: f64,
    /// What leads off it, in the order of the way.
    pub openings: Vec<Opening>,
    /// Where its floor ends at an edge, along its middle, metres.
    pub edge_m: Option<f64>,
    /// What is known of it where it is a building's; none: it was generated, and all of it is known.
    pub mapped: Option<Mapped>,
}

/// What is known of a corridor of a building, or of one that is like those.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mapped {
    /// Its line ends where the corridor does: at a wall. Otherwise it forks there, or leads into the open.
    pub has_end: bool,
    /// It widens into a hall from there to there along its middle, metres, and goes on behind it. A floor plan's
    /// corridor ends at a hall.
    pub hall_m: Option<[f64; 2]>,
}

/// A corridor that itself turns by so much, radians,
const CORNER_RAD: f64 = FRAC_PI_4;
/// in so short a way, metres, is a turn: whoever is asked to turn to that side has done so when they are round it.
const CORNER_M: f64 = guidance::cue::TURN_WITHIN_M;
/// Corners and openings are as near to each other as this where they are the same, metres.
const SAME_M: f64 = 2.0;
/// A way that leaves another one by less is that way: one of its corners.
const ALONG_RAD: f64 = 0.1;
/// Ways are looked at every so far, metres.
const LOOK_M: f64 = 0.25;
/// A way off that is not clear leads on for no more than this, metres: no task is set where it would be next.
const UNCLEAR_M: f64 = 0.3;

impl Course {
    /// A corridor with what leads off it, and its own sharp corners as ways to turn into.
    #[must_use]
    pub fn new(line: TravelLine, width_m: f64, mut openings: Vec<Opening>) -> Self {
        for corner in corners(&line, width_m) {
            let is_same = |o: &Opening| o.side == corner.side && (o.way_m - corner.way_m).abs() < SAME_M;
            if !openings.iter().any(is_same) {
                openings.push(corner);
            }
        }
        openings.sort_by(|a, b| a.way_m.total_cmp(&b.way_m));
        Self { line, width_m, openings, edge_m: None, mapped: None }
    }

    /// The first opening to a side whose farther edge is ahead of that way and whose middle is within `reach_m`.
    #[must_use]
    pub fn next(&self, side: Side, from_m: f64, reach_m: f64) -> Option<&Opening> {
        let mut ahead = self.openings.iter().filter(|opening| opening.side == side);
        ahead.find(|opening| opening.far_edge_m() > from_m && opening.way_m <= from_m + reach_m)
    }

    /// Whether an opening is a corner of the corridor itself.
    #[must_use]
    pub fn is_corner(&self, opening: &Opening) -> bool {
        wrap_angle(opening.axis_rad() - self.line.at(opening.way_m).rotation.angle()).abs() < ALONG_RAD
    }

    /// The line of who turns into an opening: along the corridor, round the corner, and on to the branch's end; the
    /// corridor's own where it is one of its corners.
    #[must_use]
    pub fn line_into(&self, opening: &Opening) -> Option<TravelLine> {
        if self.is_corner(opening) {
            return Some(self.line.clone());
        }
        let corner = self.line.at(opening.way_m);
        // As round as both ways have room for.
        let cut_m = (0.5 * self.width_m.min(opening.width_m)).min(opening.way_m).max(0.1);
        let mut places: Vec<Point> = self.line.part(0.0, opening.way_m - cut_m)?.corners().to_vec();
        let (before, after) = (self.line.at(opening.way_m - cut_m), opening.line.at(cut_m));
        let (from, to) = (Point::from(before.translation.vector), Point::from(after.translation.vector));
        places.extend(round(from, Point::from(corner.translation.vector), to));
        places.extend(opening.line.part(cut_m, opening.line.length_m())?.corners());
        TravelLine::new(&places)
    }
}

/// The way round a corner between two places, both left out: a parabola whose tangents there lead to the corner.
fn round(from: Point, corner: Point, to: Point) -> impl Iterator<Item = Point> {
    let turn_rad = (corner - from).angle(&(to - corner));
    let steps = (turn_rad.to_degrees() / 10.0).ceil().max(1.0) as usize;
    (1..steps).map(move |i| {
        let share = i as f64 / steps as f64;
        let (a, b) = (from + (corner - from) * share, corner + (to - corner) * share);
        a + (b - a) * share
    })
}

/// A line whose square corners are cut, so far on either side of each, metres: as who walks there takes them.
pub(crate) fn rounded(line: &TravelLine, cut_m: f64) -> TravelLine {
    let corners = line.corners();
    let mut places = vec![corners[0]];
    for way in corners.windows(3) {
        let (before, after) = (way[1] - way[0], way[2] - way[1]);
        // No more than half of a stretch, whose other end may be a corner as well.
        let cut_m = cut_m.min(before.norm() / 2.0).min(after.norm() / 2.0);
        if before.angle(&after) > CORNER_RAD {
            let (from, to) = (way[1] - before.normalize() * cut_m, way[1] + after.normalize() * cut_m);
            places.push(from);
            places.extend(round(from, way[1], to));
            places.push(to);
        } else {
            places.push(way[1]);
        }
    }
    places.extend(corners.last());
    TravelLine::new(&places).unwrap_or_else(|| line.clone())
}

/// The sharp corners of a corridor: where it turns most, its way on being the way turned into.
fn corners(line: &TravelLine, width_m: f64) -> Vec<Opening> {
    let heading = |way_m: f64| line.at(way_m).rotation.angle();
    let turned = |way_m: f64| wrap_angle(heading(way_m + CORNER_M / 2.0) - heading(way_m - CORNER_M / 2.0));
    let looks = (line.length_m() / LOOK_M) as usize;
    let turns: Vec<(f64, f64)> = (0..=looks).map(|i| i as f64 * LOOK_M).map(|way_m| (way_m, turned(way_m))).collect();
    let mut corners = Vec::new();
    for bend in turns.chunk_by(|a, b| (a.1.abs() > CORNER_RAD) == (b.1.abs() > CORNER_RAD) && a.1 * b.1 > 0.0) {
        let [first, .., last] = bend else { continue };
        if first.1.abs() <= CORNER_RAD {
            continue;
        }
        let way_m = f64::midpoint(first.0, last.0);
        let side = if first.1 > 0.0 { Side::Left } else { Side::Right };
        corners.extend(line.part(way_m, line.length_m()).map(|on| Opening {
            way_m,
            width_m,
            side,
            line: on,
            edge_m: None,
            behind: None,
        }));
    }
    corners
}

/// A world whose ways are known.
#[derive(Debug, Clone)]
pub struct Site {
    /// The file of its floor plan; "generated" where it has none.
    pub place: Arc<str>,
    /// What stands and walks there.
    pub world: World,
    /// Its corridor.
    pub course: Course,
    /// What becomes of its floor.
    pub drop: DropKind,
}

/// How an edge of the floor lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum DropKind {
    /// The floor has no edge.
    None,
    /// Across the corridor, also askew.
    Across,
    /// In a branch, behind the turn into it.
    Turn,
    /// Along the whole corridor, which is a platform.
    Beside,
    /// A hole in the corridor, with a way past it.
    Past,
    /// The floor has no edge. A low step lies across the corridor, which the handler may allow.
    Step,
}
