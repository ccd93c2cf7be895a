//! The boundary of the shielding zone, piece by piece, in the order in which a turning ray meets it.
//!
//! Seen from within, each piece of the boundary of the hull of discs (an arc of a disc, or an outer tangent of two)
//! covers one range of directions. So every beam has one piece to be held against, and neighbours mostly the same:
//! what remains for a beam is one division or one root, whatever the number of discs.

mod parts;

use nalgebra::Vector2;

use crate::hull::{Disc, Discs};
use crate::se2::Point;

pub use parts::{BLOCK, Directions, Parts, Readings, Room};

/// The hull of n discs has at most 2n - 1 arcs and as many tangents, and one arc is cut where the walk begins.
const MAX_PIECES: usize = 4 * Discs::MAX;
/// Two tangents whose normals differ by less are one and the same, in the measure of [`turn_of`]; two directions
/// likewise, radians.
const SAME: f64 = 1e-9;
/// One piece of the boundary, walked counter-clockwise.
#[derive(Debug, Clone, Copy)]
enum Piece {
    /// Part of a disc's edge, from one outward normal (a unit vector) to another.
    Arc { disc: Disc, from: Vector2<f64>, to: Vector2<f64>, whole: bool },
    /// A tangent from one disc to the next.
    Edge { from: Point, to: Point },
}

impl Piece {
    fn from(&self) -> Point {
        match self {
            Self::Arc { disc, from, .. } => disc.center + from * disc.radius_m,
            Self::Edge { from, .. } => *from,
        }
    }

    /// Twice the area between the piece and a point, square metres (Green's theorem).
    fn twice_area_from(&self, origin: Point) -> f64 {
        match self {
            Self::Edge { from, to } => (from - origin).perp(&(to - origin)),
            Self::Arc { disc, from, to, whole } => {
                let turn = if *whole { std::f64::consts::TAU } else { positive_turn(from, to) };
                let chord = (to - from) * disc.radius_m;
                disc.radius_m * disc.radius_m * turn + (disc.center - origin).perp(&chord)
            }
        }
    }
}

/// Angle from one direction to another, counter-clockwise, radians in [0, 2 pi).
pub(crate) fn positive_turn(from: &Vector2<f64>, to: &Vector2<f64>) -> f64 {
    let turn = from.perp(to).atan2(from.dot(to)).rem_euclid(std::f64::consts::TAU);
    // A whole turn by less than nothing is rounding.
    if turn > std::f64::consts::TAU - SAME { 0.0 } else { turn }
}

/// A measure of a direction that grows with its angle, from 0 along x to 4 once around, without a root or an arc
/// tangent.
fn turn_of(n: &Vector2<f64>) -> f64 {
    let share = n.y / (n.x.abs() + n.y.abs());
    let turn = if n.x < 0.0 { 2.0 - share } else { share };
    if turn < 0.0 { turn + 4.0 } else { turn }
}

/// The boundary of the convex hull of discs.
#[derive(Debug, Clone, Default)]
pub struct Boundary {
    pieces: Vec<Piece>,
}

impl Boundary {
    /// Of nothing, with room for all pieces that there can be.
    pub(crate) fn with_room() -> Self {
        Self { pieces: Vec::with_capacity(MAX_PIECES) }
    }

    /// Walks once around the discs.
    #[must_use]
    pub fn of(discs: &[Disc]) -> Self {
        let mut boundary = Self::default();
        boundary.take(discs);
        boundary
    }

    /// Becomes the boundary of other discs; nothing is allocated once there have been as many. From the disc that
    /// reaches farthest in a direction it goes always to the next that a line laid against them and turned
    /// counter-clockwise meets.
    pub fn take(&mut self, discs: &[Disc]) {
        debug_assert!(discs.len() <= Discs::MAX);
        self.pieces.clear();
        let counts = not_held(discs);
        let first = first_disc(discs, &counts);
        let (mut current, mut turned, mut normal) = (first, 0.0, Vector2::x());
        while self.pieces.len() + 2 < MAX_PIECES {
            let Some((next, tangent)) = next_tangent(discs, &counts, current, turned) else { break };
            self.push_arc(discs[current], (turned, normal), (tangent.turn, tangent.normal));
            let on = |disc: &Disc| disc.center + tangent.normal * disc.radius_m;
            self.push(Piece::Edge { from: on(&discs[current]), to: on(&discs[next]) });
            (current, turned, normal) = (next, tangent.turn, tangent.normal);
        }
        self.push_arc(discs[current], (turned, normal), (4.0, Vector2::x()));
        // Two discs that reach equally far, such as a robot before and after a step to the side: the edge between them
        // closes the walk.
        let (from, to) = [current, first].map(|i| discs[i].center + Vector2::x() * discs[i].radius_m).into();
        if (to - from).norm() > SAME {
            self.push(Piece::Edge { from, to });
        }
    }

    fn push(&mut self, piece: Piece) {
        if self.pieces.len() < MAX_PIECES {
            self.pieces.push(piece);
        }
    }

    fn push_arc(&mut self, disc: Disc, from: (f64, Vector2<f64>), to: (f64, Vector2<f64>)) {
        if to.0 > from.0 && disc.radius_m > 0.0 {
            self.push(Piece::Arc { disc, from: from.1, to: to.1, whole: to.0 - from.0 == 4.0 });
        }
    }
}

/// Which discs count: not those that another holds, touching it from within or the same included. Of such a pair the
/// walk could begin at the one from which no tangent leads on.
pub(crate) fn not_held(discs: &[Disc]) -> [bool; Discs::MAX] {
    let is_held = |i: usize| {
        let larger = |j: usize| (discs[j].radius_m, i) > (discs[i].radius_m, j);
        let reach_m = |j: usize| (discs[i].center - discs[j].center).norm() + discs[i].radius_m;
        (0..discs.len()).any(|j| j != i && larger(j) && reach_m(j) <= discs[j].radius_m + SAME)
    };
    std::array::from_fn(|i| i < discs.len() && !is_held(i))
}

/// The disc that reaches farthest along x; of equals the one that is farthest along the walk.
fn first_disc(discs: &[Disc], counts: &[bool]) -> usize {
    let reach = |disc: &Disc| (disc.center.x + disc.radius_m, disc.center.y);
    let mut best = counts.iter().position(|counts| *counts).unwrap_or(0);
    for i in (best + 1..discs.len()).filter(|i| counts[*i]) {
        let (mine, others) = (reach(&discs[i]), reach(&discs[best]));
        if mine.0 > others.0 + SAME || (mine.0 >= others.0 - SAME && mine.1 > others.1) {
            best = i;
        }
    }
    best
}

/// An outer tangent from one disc to another.
#[derive(Debug, Clone, Copy)]
struct Tangent {
    /// Outward normal, and [`turn_of`] it.
    normal: Vector2<f64>,
    turn: f64,
}

/// The outer tangent that leads counter-clockwise from one disc to another. Both count: neither holds the other.
fn tangent_between(discs: &[Disc], from: usize, to: usize) -> Tangent {
    // Reckoned from one of them whichever way it leads: rounding is the same.
    let (i, j) = (from.min(to), from.max(to));
    let between = discs[j].center - discs[i].center;
    let distance_m = between.norm();
    let wider_m = discs[i].radius_m - discs[j].radius_m;
    debug_assert!(distance_m > wider_m.abs());
    let u = between / distance_m;
    let cos = wider_m / distance_m;
    let side = Vector2::new(-u.y, u.x) * (1.0 - cos * cos).max(0.0).sqrt();
    let normal = if from < to { u * cos - side } else { u * cos + side };
    Tangent { normal, turn: turn_of(&normal) }
}

/// The first tangent from a disc that a line turned on from `turned` meets, before it is once around.
fn next_tangent(discs: &[Disc], counts: &[bool], current: usize, turned: f64) -> Option<(usize, Tangent)> {
    let mut best: Option<(usize, Tangent)> = None;
    for i in (0..discs.len()).filter(|i| *i != current && counts[*i] && counts[current]) {
        let tangent = tangent_between(discs, current, i);
        // What lies behind by rounding lies here; what really lies behind comes only once around.
        let turn = if tangent.turn < turned && tangent.turn > turned - SAME { turned } else { tangent.turn };
        if turn >= turned && best.is_none_or(|(_, best)| turn < best.turn) {
            best = Some((i, Tangent { turn, ..tangent }));
        }
    }
    best
}

/// What the boundary is from one origin strictly within it.
#[derive(Debug, Clone)]
pub struct Seen<'a> {
    boundary: &'a Boundary,
    origin: Point,
    /// Angle at which each piece begins, and the first's once more a turn later, radians.
    begins_rad: [f64; MAX_PIECES + 1],
}

/// How far away a piece is in a direction `d`.
#[derive(Debug, Clone, Copy)]
enum Law {
    /// `k / n.d`
    Line { n: Vector2<f64>, k: f64 },
    /// `m.d + sqrt((m.d)^2 - c)`
    Circle { m: Vector2<f64>, c: f64 },
}

impl Law {
    fn at(self, x: f64, y: f64) -> f64 {
        match self {
            Self::Line { n, k } => k / (n.x * x + n.y * y),
            Self::Circle { m, c } => {
                let b = m.x * x + m.y * y;
                b + (b * b - c).max(0.0).sqrt()
            }
        }
    }
}

impl Boundary {
    /// The boundary seen from `origin`; none where that is not within by more than rounding.
    #[must_use]
    pub fn seen_from(&self, origin: Point) -> Option<Seen<'_>> {
        let pieces = &self.pieces;
        let within = pieces.iter().all(|piece| match piece {
            Piece::Edge { from, to } => (to - from).perp(&(origin - from)) > SAME * (to - from).norm(),
            Piece::Arc { disc, from, to, whole } => {
                let away = origin - disc.center;
                away.norm() < disc.radius_m - SAME || !(*whole || positive_turn(from, &away) <= positive_turn(from, to))
            }
        });
        if !within || pieces.is_empty() {
            return None;
        }
        let mut begins_rad = [0.0; MAX_PIECES + 1];
        let angle = |point: Point| (point.y - origin.y).atan2(point.x - origin.x);
        begins_rad[0] = angle(pieces[0].from());
        for i in 1..pieces.len() {
            let turn = (angle(pieces[i].from()) - begins_rad[i - 1]).rem_euclid(std::f64::consts::TAU);
            // Seen from within the boundary never turns back: a whole turn by less than nothing is rounding.
            let long = matches!(pieces[i - 1], Piece::Arc { from, to, .. } if from.dot(&to) < 0.5);
            let turn = if turn > std::f64::consts::TAU - SAME && !long { 0.0 } else { turn };
            begins_rad[i] = begins_rad[i - 1] + turn;
        }
        begins_rad[pieces.len()] = begins_rad[0] + std::f64::consts::TAU;
        Some(Seen { boundary: self, origin, begins_rad })
    }
}

impl Seen<'_> {
    /// Which beams leave through which piece.
    #[must_use]
    pub fn over<'b>(&self, beams: Directions<'b>) -> Parts<'b> {
        self.over_in(beams, Room::default())
    }

    /// The same in the room of others, see [`Parts::into_room`]: nothing is allocated once there have been as many.
    #[must_use]
    pub fn over_in<'b>(&self, beams: Directions<'b>, room: Room) -> Parts<'b> {
        Parts::of(self, beams, room)
    }

    fn law(&self, piece: usize) -> Law {
        match self.boundary.pieces[piece] {
            Piece::Edge { from, to } => {
                let along = to - from;
                let n = Vector2::new(along.y, -along.x);
                Law::Line { n, k: n.dot(&(from - self.origin)) }
            }
            Piece::Arc { disc, .. } => {
                let m = disc.center - self.origin;
                Law::Circle { m, c: m.norm_squared() - disc.radius_m * disc.radius_m }
            }
        }
    }

    /// Area of the hull between two directions, counter-clockwise from the first, square metres.
    #[must_use]
    pub fn area_between_m2(&self, from_rad: f64, to_rad: f64) -> f64 {
        let tau = std::f64::consts::TAU;
        let from = self.begins_rad[0] + (from_rad - self.begins_rad[0]).rem_euclid(tau);
        let to = from + (to_rad - from_rad);
        let mut twice = 0.0;
        for turn in [0.0, tau] {
            for piece in 0..self.boundary.pieces.len() {
                let begin = (self.begins_rad[piece] + turn).max(from);
                let end = (self.begins_rad[piece + 1] + turn).min(to);
                if end > begin {
                    twice += self.cut(piece, begin, end).twice_area_from(self.origin);
                }
            }
        }
        twice / 2.0
    }

    /// The part of a piece between two directions.
    fn cut(&self, piece: usize, from_rad: f64, to_rad: f64) -> Piece {
        let law = self.law(piece);
        let at = |rad: f64| {
            let d = Vector2::new(rad.cos(), rad.sin());
            self.origin + d * law.at(d.x, d.y)
        };
        let (from, to) = (at(from_rad), at(to_rad));
        match self.boundary.pieces[piece] {
            Piece::Edge { .. } => Piece::Edge { from, to },
            Piece::Arc { disc, .. } => {
                let normal = |p: Point| (p - disc.center) / disc.radius_m;
                let whole = to_rad - from_rad > std::f64::consts::TAU - SAME;
                Piece::Arc { disc, from: normal(from), to: normal(to), whole }
            }
        }
    }
}

#[cfg(test)]
mod tests;
