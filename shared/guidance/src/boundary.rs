//! The boundary of the shielding zone, piece by piece, in the order in which a turning ray meets it.
//!
//! Seen from within, each piece of the boundary of the hull of discs (an arc of a disc, or an outer tangent of two)
//! covers one range of directions. So every beam has one piece to be held against, and neighbours mostly the same:
//! what remains for a beam is one division or one root, whatever the number of discs.

use nalgebra::Vector2;

use crate::hull::Disc;
use crate::se2::Point;

/// The hull of four discs has at most so many arcs and tangents: seven of each, and one arc cut where the walk begins.
const MAX_PIECES: usize = 16;
/// Two tangents whose normals differ by less are one and the same, in the measure of [`turn_of`]; two directions
/// likewise, radians.
const SAME: f64 = 1e-9;
/// Lanes that the compiler may work on side by side.
const LANES: usize = 8;

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
fn positive_turn(from: &Vector2<f64>, to: &Vector2<f64>) -> f64 {
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

/// The boundary of the convex hull of four discs.
#[derive(Debug, Clone)]
pub struct Boundary {
    pieces: [Piece; MAX_PIECES],
    count: usize,
}

impl Boundary {
    /// Walks once around the discs: from the one that reaches farthest in a direction, always to the next that a line
    /// laid against them and turned counter-clockwise meets.
    #[must_use]
    pub fn of(discs: &[Disc; 4]) -> Self {
        let nothing = Piece::Edge { from: Point::origin(), to: Point::origin() };
        let mut walk = Self { pieces: [nothing; MAX_PIECES], count: 0 };
        let tangents = tangents(discs);
        let (mut current, mut turned, mut normal) = (first_disc(discs), 0.0, Vector2::x());
        while walk.count + 2 < MAX_PIECES {
            let Some((next, tangent)) = next_tangent(&tangents[current], turned) else { break };
            walk.push_arc(discs[current], (turned, normal), (tangent.turn, tangent.normal));
            let on = |disc: &Disc| disc.center + tangent.normal * disc.radius_m;
            walk.push(Piece::Edge { from: on(&discs[current]), to: on(&discs[next]) });
            (current, turned, normal) = (next, tangent.turn, tangent.normal);
        }
        walk.push_arc(discs[current], (turned, normal), (4.0, Vector2::x()));
        walk
    }

    fn push(&mut self, piece: Piece) {
        if self.count < MAX_PIECES {
            self.pieces[self.count] = piece;
            self.count += 1;
        }
    }

    fn push_arc(&mut self, disc: Disc, from: (f64, Vector2<f64>), to: (f64, Vector2<f64>)) {
        if to.0 > from.0 && disc.radius_m > 0.0 {
            self.push(Piece::Arc { disc, from: from.1, to: to.1, whole: to.0 - from.0 == 4.0 });
        }
    }
}

/// The disc that reaches farthest along x; of equals the one that is farthest along the walk.
fn first_disc(discs: &[Disc; 4]) -> usize {
    let reach = |disc: &Disc| (disc.center.x + disc.radius_m, disc.center.y);
    let mut best = 0;
    for i in 1..discs.len() {
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
    distance_m: f64,
}

/// The outer tangent that leads counter-clockwise from each disc to each other; none where one holds the other.
fn tangents(discs: &[Disc; 4]) -> [[Option<Tangent>; 4]; 4] {
    let mut all = [[None; 4]; 4];
    for i in 0..4 {
        for j in i + 1..4 {
            let between = discs[j].center - discs[i].center;
            let distance_m = between.norm();
            let wider_m = discs[i].radius_m - discs[j].radius_m;
            if distance_m <= wider_m.abs() || distance_m < 1e-12 {
                continue;
            }
            let u = between / distance_m;
            let cos = wider_m / distance_m;
            let side = Vector2::new(-u.y, u.x) * (1.0 - cos * cos).max(0.0).sqrt();
            let tangent = |normal: Vector2<f64>| Some(Tangent { normal, turn: turn_of(&normal), distance_m });
            (all[i][j], all[j][i]) = (tangent(u * cos - side), tangent(u * cos + side));
        }
    }
    all
}

/// The first tangent that a line turned on from `turned` meets, before it is once around; of those that it meets at
/// once the one to the farthest disc.
fn next_tangent(tangents: &[Option<Tangent>; 4], turned: f64) -> Option<(usize, Tangent)> {
    let mut best: Option<(usize, Tangent)> = None;
    for (i, tangent) in tangents.iter().enumerate() {
        let Some(tangent) = tangent else { continue };
        // What lies behind by rounding lies here; what really lies behind comes only once around.
        let turn = if tangent.turn < turned && tangent.turn > turned - SAME { turned } else { tangent.turn };
        if turn < turned || turn >= 4.0 - SAME {
            continue;
        }
        let better = best.is_none_or(|(_, best)| {
            turn < best.turn - SAME || (turn <= best.turn + SAME && tangent.distance_m > best.distance_m)
        });
        if better {
            best = Some((i, Tangent { turn, ..*tangent }));
        }
    }
    best
}

/// Directions of a scan's beams in the order in which they turn counter-clockwise.
#[derive(Debug, Clone, Copy)]
pub struct Directions<'a> {
    /// Unit vectors.
    pub x: &'a [f64],
    /// Unit vectors.
    pub y: &'a [f64],
    /// Angle of the first, radians.
    pub first_rad: f64,
    /// From each to the next, radians, positive.
    pub increment_rad: f64,
}

/// What the boundary is from one origin strictly within it: for each piece the beams that leave through it, and the
/// line or circle that they meet.
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
    /// The boundary seen from `origin`; none where that is not strictly within.
    #[must_use]
    pub fn seen_from(&self, origin: Point) -> Option<Seen<'_>> {
        let pieces = &self.pieces[..self.count];
        let within = pieces.iter().all(|piece| match piece {
            Piece::Edge { from, to } => (to - from).perp(&(origin - from)) > 0.0,
            Piece::Arc { disc, from, to, whole } => {
                let away = origin - disc.center;
                away.norm_squared() < disc.radius_m * disc.radius_m
                    || !(*whole || positive_turn(from, &away) <= positive_turn(from, to))
            }
        });
        if !within || pieces.is_empty() {
            return None;
        }
        let mut begins_rad = [0.0; MAX_PIECES + 1];
        let angle = |point: Point| (point.y - origin.y).atan2(point.x - origin.x);
        begins_rad[0] = angle(pieces[0].from());
        for i in 1..self.count {
            let turn = (angle(pieces[i].from()) - begins_rad[i - 1]).rem_euclid(std::f64::consts::TAU);
            // Seen from within the boundary never turns back: a whole turn by less than nothing is rounding.
            let long = matches!(pieces[i - 1], Piece::Arc { from, to, .. } if from.dot(&to) < 0.5);
            let turn = if turn > std::f64::consts::TAU - SAME && !long { 0.0 } else { turn };
            begins_rad[i] = begins_rad[i - 1] + turn;
        }
        begins_rad[self.count] = begins_rad[0] + std::f64::consts::TAU;
        Some(Seen { boundary: self, origin, begins_rad })
    }
}

impl Seen<'_> {
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

    /// No threshold of the piece is greater, metres.
    fn farthest_m(&self, piece: usize) -> f64 {
        match self.boundary.pieces[piece] {
            Piece::Edge { from, to } => (from - self.origin).norm().max((to - self.origin).norm()),
            Piece::Arc { disc, .. } => (disc.center - self.origin).norm() + disc.radius_m,
        }
    }

    /// Calls `take` with each range of beams that leave through one piece, and the piece; every beam is in one range.
    fn ranges(&self, beams: &Directions<'_>, mut take: impl FnMut(usize, std::ops::Range<usize>)) {
        let (count, tau) = (beams.x.len(), std::f64::consts::TAU);
        let pieces = self.boundary.count;
        let start_rad = (self.begins_rad[0] - beams.first_rad).rem_euclid(tau);
        let index = |rad: f64| ((rad / beams.increment_rad).ceil().max(0.0) as usize).min(count);
        // The pieces a turn earlier have the beams before the first piece begins.
        for (from_rad, to_rad) in [(start_rad - tau, start_rad), (start_rad, start_rad + tau)] {
            let mut begin = index(from_rad);
            for piece in 0..pieces {
                let last = piece + 1 == pieces;
                let end_rad = from_rad + (self.begins_rad[piece + 1] - self.begins_rad[0]);
                let end = index(if last { to_rad } else { end_rad }).max(begin);
                if end > begin {
                    take(piece, begin..end);
                }
                begin = end;
            }
        }
    }

    /// Every beam's threshold: distance from the origin to where it leaves the hull, metres (Kim et al. 2023, alg. 1
    /// line 7).
    pub fn thresholds_m(&self, beams: &Directions<'_>, thresholds_m: &mut Vec<f64>) {
        thresholds_m.clear();
        thresholds_m.resize(beams.x.len(), 0.0);
        self.ranges(beams, |piece, range| {
            let out = &mut thresholds_m[range.clone()];
            let directions = beams.x[range.clone()].iter().zip(&beams.y[range]);
            // One loop for each law, so that it works on several beams side by side.
            match self.law(piece) {
                law @ Law::Line { .. } => {
                    out.iter_mut().zip(directions).for_each(|(out, (x, y))| *out = law.at(*x, *y));
                }
                law @ Law::Circle { .. } => {
                    out.iter_mut().zip(directions).for_each(|(out, (x, y))| *out = law.at(*x, *y));
                }
            }
        });
    }

    /// The thresholds of some beams, in rising order, metres.
    pub fn some_thresholds_m(&self, beams: &Directions<'_>, which: &[usize], mut take: impl FnMut(usize, f64)) {
        if which.is_empty() {
            return;
        }
        self.ranges(beams, |piece, range| {
            let law = self.law(piece);
            let begin = which.partition_point(|beam| *beam < range.start);
            for beam in which[begin..].iter().take_while(|beam| **beam < range.end) {
                take(*beam, law.at(beams.x[*beam], beams.y[*beam]));
            }
        });
    }

    /// The smallest reading minus threshold, and its beam; a reading that is not to be judged is infinite. What
    /// cannot be smaller than `block_min_m` (the least reading of each [`BLOCK`] beams) allows is not looked at.
    #[must_use]
    pub fn least_margin_m(
        &self,
        beams: &Directions<'_>,
        readings_m: &[f64],
        block_min_m: &[f64],
    ) -> (f64, Option<usize>) {
        let mut least = (f64::INFINITY, None);
        self.ranges(beams, |piece, range| {
            let (law, farthest_m) = (self.law(piece), self.farthest_m(piece));
            let mut begin = range.start;
            while begin < range.end {
                let block = begin / BLOCK;
                let end = range.end.min((block + 1) * BLOCK);
                if block_min_m[block] - farthest_m < least.0 {
                    let part = begin..end;
                    let (x, y, r) = (&beams.x[part.clone()], &beams.y[part.clone()], &readings_m[part]);
                    let margin = least_of(law, x, y, r);
                    if margin < least.0 {
                        let of = |i: usize| r[i] - law.at(x[i], y[i]);
                        let i = (0..r.len()).find(|i| of(*i) <= margin).unwrap_or(0);
                        least = (margin, Some(begin + i));
                    }
                }
                begin = end;
            }
        });
        least
    }

    /// Area of the hull between two directions, counter-clockwise from the first, square metres.
    #[must_use]
    pub fn area_between_m2(&self, from_rad: f64, to_rad: f64) -> f64 {
        let tau = std::f64::consts::TAU;
        let from = self.begins_rad[0] + (from_rad - self.begins_rad[0]).rem_euclid(tau);
        let to = from + (to_rad - from_rad);
        let mut twice = 0.0;
        for turn in [0.0, tau] {
            for piece in 0..self.boundary.count {
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

/// Beams of a block for [`Seen::least_margin_m`].
pub const BLOCK: usize = 32;

/// The least reading of each block.
pub fn block_minima(readings_m: &[f64], minima_m: &mut Vec<f64>) {
    minima_m.clear();
    minima_m.extend(readings_m.chunks(BLOCK).map(|block| block.iter().copied().fold(f64::INFINITY, f64::min)));
}

/// The least of reading minus threshold, several beams side by side.
fn least_of(law: Law, x: &[f64], y: &[f64], r: &[f64]) -> f64 {
    match law {
        Law::Line { n, k } => lanes(x, y, r, |x, y| k / (n.x * x + n.y * y)),
        Law::Circle { m, c } => lanes(x, y, r, |x, y| {
            let b = m.x * x + m.y * y;
            b + (b * b - c).max(0.0).sqrt()
        }),
    }
}

#[inline(always)]
fn lanes(x: &[f64], y: &[f64], r: &[f64], threshold: impl Fn(f64, f64) -> f64) -> f64 {
    let mut least = [f64::INFINITY; LANES];
    let (xs, ys, rs) = (x.chunks_exact(LANES), y.chunks_exact(LANES), r.chunks_exact(LANES));
    let rest = xs.remainder().iter().zip(ys.remainder()).zip(rs.remainder());
    for ((x, y), r) in rest {
        least[0] = least[0].min(r - threshold(*x, *y));
    }
    for ((x, y), r) in xs.zip(ys).zip(rs) {
        for lane in 0..LANES {
            let margin = r[lane] - threshold(x[lane], y[lane]);
            least[lane] = if margin < least[lane] { margin } else { least[lane] };
        }
    }
    least.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::{Boundary, Directions, block_minima};
    use crate::hull::{Disc, Hull};
    use crate::se2::Point;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn any_disc() -> impl Strategy<Value = Disc> {
        (-1.5..1.5f64, -1.5..1.5f64, 0.05..0.5f64)
            .prop_map(|(x, y, radius_m)| Disc { center: Point::new(x, y), radius_m })
    }

    /// Four discs as they are in practice too: some equal, some in one line, some within others.
    fn any_discs() -> impl Strategy<Value = [Disc; 4]> {
        ([any_disc(), any_disc(), any_disc(), any_disc()], 0..6u8).prop_map(|([a, b, c, d], kind)| match kind {
            0 => [a, b, a, b],
            1 => [a, a, a, a],
            2 => {
                let step = Vector2::new(0.25, 0.0);
                [a, b, Disc { center: a.center + step, ..a }, Disc { center: b.center + step, ..b }]
            }
            3 => {
                [a, Disc { radius_m: a.radius_m, ..b }, Disc { center: nalgebra::center(&a.center, &b.center), ..a }, a]
            }
            4 => [Disc { radius_m: 2.0, ..a }, b, c, d],
            _ => [a, b, c, d],
        })
    }

    fn fan(count: usize, first_rad: f64) -> (Vec<f64>, Vec<f64>, f64) {
        let increment = std::f64::consts::TAU / count as f64;
        let angle = |i: usize| first_rad + i as f64 * increment;
        ((0..count).map(|i| angle(i).cos()).collect(), (0..count).map(|i| angle(i).sin()).collect(), increment)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        #[test]
        fn piece_by_piece_is_as_all_at_once(discs in any_discs(), which in 0..4usize, first in -7.0..7.0f64) {
            let (hull, boundary) = (Hull::new(discs), Boundary::of(&discs));
            let origin = discs[which].center;
            let (x, y, increment_rad) = fan(97, first);
            let beams = Directions { x: &x, y: &y, first_rad: first, increment_rad };
            let seen = boundary.seen_from(origin).expect("a disc's middle is within");
            let mut thresholds = Vec::new();
            seen.thresholds_m(&beams, &mut thresholds);
            for i in 0..97 {
                let truth = hull.threshold_m(origin, Vector2::new(x[i], y[i]));
                prop_assert!((thresholds[i] - truth).abs() < 1e-6, "beam {i}: {} {}", thresholds[i], truth);
            }
            let readings: Vec<f64> = (0..97).map(|i| 0.5 + 0.02 * f64::from((i * 37 % 97) as u32)).collect();
            let mut minima = Vec::new();
            block_minima(&readings, &mut minima);
            let (least, beam) = seen.least_margin_m(&beams, &readings, &minima);
            let margins: Vec<f64> = readings.iter().zip(&thresholds).map(|(r, t)| r - t).collect();
            prop_assert!((least - margins.iter().copied().fold(f64::INFINITY, f64::min)).abs() < 1e-12);
            prop_assert!(beam.is_some_and(|beam| (margins[beam] - least).abs() < 1e-12));
        }

        #[test]
        fn within_is_where_the_distance_is_negative(discs in any_discs(), x in -2.5..2.5f64, y in -2.5..2.5f64) {
            let (hull, point) = (Hull::new(discs), Point::new(x, y));
            let distance = hull.signed_distance_m(point);
            if distance.abs() > 1e-7 {
                prop_assert_eq!(Boundary::of(&discs).seen_from(point).is_some(), distance < 0.0, "{}", distance);
            }
        }

        #[test]
        fn areas_add_up_to_what_many_thin_triangles_have(
            discs in any_discs(), from in -4.0..4.0f64, turn in 0.0..6.2f64,
        ) {
            let (hull, boundary) = (Hull::new(discs), Boundary::of(&discs));
            let seen = boundary.seen_from(discs[0].center).expect("a disc's middle is within");
            let steps = 4000;
            let thin: f64 = (0..steps)
                .map(|i| {
                    let angle = from + turn * (f64::from(i) + 0.5) / f64::from(steps);
                    hull.threshold_m(discs[0].center, Vector2::new(angle.cos(), angle.sin())).powi(2) / 2.0
                })
                .sum::<f64>() * turn / f64::from(steps);
            let area = seen.area_between_m2(from, from + turn);
            prop_assert!((area - thin).abs() < 2e-4 * (1.0 + thin), "{area} {thin}");
        }
    }

    #[test]
    fn a_disc_alone_is_a_circle() {
        let disc = Disc { center: Point::new(0.2, -0.1), radius_m: 0.5 };
        let boundary = Boundary::of(&[disc; 4]);
        let seen = boundary.seen_from(disc.center).expect("its middle is within");
        assert!((seen.area_between_m2(0.3, 0.3 + std::f64::consts::TAU) - std::f64::consts::PI * 0.25).abs() < 1e-9);
        assert!(boundary.seen_from(Point::new(0.8, -0.1)).is_none());
    }
}
