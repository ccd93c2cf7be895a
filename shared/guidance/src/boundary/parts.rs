//! A scan held against a boundary: which beams leave through which piece, and what follows for many of them at once.

use std::ops::Range;

use super::{Law, MAX_PIECES, Piece, Seen};

/// Beams of a block of [`Readings`].
pub const BLOCK: usize = 32;
/// A scan goes over at most so many turns of the boundary: it begins within the first and ends within the last.
const TURNS: usize = 3;
/// Lanes that the compiler may work on side by side.
const LANES: usize = 8;
/// Greater than every margin, and finite, so that it can be reckoned with, metres.
const NO_MARGIN_M: f64 = 1e300;

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

/// Readings to be held against thresholds. One that is not to be judged is infinite.
#[derive(Debug, Clone, Default)]
pub struct Readings {
    readings_m: Vec<f64>,
    /// The least of each block.
    minima_m: Vec<f64>,
}

impl Readings {
    /// Takes them in; nothing is allocated once there have been as many.
    pub fn fill(&mut self, readings_m: impl Iterator<Item = f64>) {
        self.readings_m.clear();
        self.readings_m.extend(readings_m);
        self.minima_m.clear();
        let least = |block: &[f64]| lowest(block, block, block, |_, _, reading_m| reading_m);
        self.minima_m.extend(self.readings_m.chunks(BLOCK).map(least));
    }

    /// Takes over another's; `clone_from` would allocate.
    pub fn copy_from(&mut self, other: &Self) {
        self.readings_m.clone_from(&other.readings_m);
        self.minima_m.clone_from(&other.minima_m);
    }

    /// A reading, metres.
    #[must_use]
    pub fn get(&self, beam: usize) -> f64 {
        self.readings_m[beam]
    }

    /// This beam is not to be judged.
    pub fn leave_out(&mut self, beam: usize) {
        // The block's least may now be too small: it is looked at in vain.
        self.readings_m[beam] = f64::INFINITY;
    }

    /// The beam with the least of all.
    #[must_use]
    pub fn nearest(&self) -> Option<usize> {
        let block = (0..self.minima_m.len()).min_by(|a, b| self.minima_m[*a].total_cmp(&self.minima_m[*b]))?;
        let range = block * BLOCK..self.readings_m.len().min((block + 1) * BLOCK);
        range.min_by(|a, b| self.readings_m[*a].total_cmp(&self.readings_m[*b]))
    }
}

/// A run of beams that leave through one piece.
#[derive(Debug, Clone, Copy)]
struct Part {
    law: Law,
    /// No threshold of the piece is greater, metres.
    farthest_m: f64,
    begin: usize,
    end: usize,
}

/// A scan's beams by the piece of the boundary through which they leave; every beam is in one part.
#[derive(Debug, Clone)]
pub struct Parts<'a> {
    beams: Directions<'a>,
    parts: Vec<Part>,
}

/// Room for parts.
#[derive(Debug, Clone, Default)]
pub struct Room(Vec<Part>);

impl Room {
    /// For all parts that there can be.
    pub(crate) fn for_all() -> Self {
        Self(Vec::with_capacity(TURNS * MAX_PIECES))
    }
}

impl<'a> Parts<'a> {
    pub(super) fn of(seen: &Seen<'_>, beams: Directions<'a>, Room(mut room): Room) -> Self {
        room.clear();
        let mut parts = Self { beams, parts: room };
        let (count, tau) = (beams.x.len(), std::f64::consts::TAU);
        let start_rad = (seen.begins_rad[0] - beams.first_rad).rem_euclid(tau);
        let index = |rad: f64| first_at_or_after(rad / beams.increment_rad).min(count);
        // The pieces a turn earlier have the beams before the first piece begins; a turn later, the last beam of a scan
        // that ends where it began.
        let mut begin = 0;
        for turn in 0..TURNS {
            let from_rad = start_rad + (turn as f64 - 1.0) * tau;
            let to_rad = start_rad + turn as f64 * tau;
            for piece in 0..seen.boundary.pieces.len() {
                let last = piece + 1 == seen.boundary.pieces.len();
                let end_rad = from_rad + (seen.begins_rad[piece + 1] - seen.begins_rad[0]);
                let end = index(if last { to_rad } else { end_rad }).max(begin);
                if end > begin {
                    parts.parts.push(Part { law: seen.law(piece), farthest_m: farthest_m(seen, piece), begin, end });
                }
                begin = end;
            }
        }
        parts
    }

    /// Its room, for others.
    #[must_use]
    pub fn into_room(self) -> Room {
        Room(self.parts)
    }

    fn iter(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter()
    }

    fn threshold_m(&self, part: &Part, beam: usize) -> f64 {
        part.law.at(self.beams.x[beam], self.beams.y[beam])
    }

    /// Every beam's threshold: distance from the origin to where it leaves the hull, metres (Kim et al. 2023, alg. 1
    /// line 7).
    pub fn thresholds_m(&self, thresholds_m: &mut Vec<f64>) {
        thresholds_m.clear();
        thresholds_m.resize(self.beams.x.len(), 0.0);
        for part in self.iter() {
            let out = &mut thresholds_m[part.begin..part.end];
            let directions = self.beams.x[part.begin..part.end].iter().zip(&self.beams.y[part.begin..part.end]);
            out.iter_mut().zip(directions).for_each(|(out, (x, y))| *out = part.law.at(*x, *y));
        }
    }

    /// The thresholds of some beams, given in rising order, metres.
    pub fn some_thresholds_m(&self, which: &[usize], mut take: impl FnMut(usize, f64)) {
        for part in self.iter().filter(|_| !which.is_empty()) {
            let begin = which.partition_point(|beam| *beam < part.begin);
            for beam in which[begin..].iter().take_while(|beam| **beam < part.end) {
                take(*beam, self.threshold_m(part, *beam));
            }
        }
    }

    /// The smallest reading minus threshold, and its beam. `guess` is a beam that may be it: the nearer to the
    /// smallest its own is, the less has to be looked at.
    #[must_use]
    pub fn least_margin_m(&self, readings: &Readings, guess: Option<usize>) -> (f64, Option<usize>) {
        let mut least = (NO_MARGIN_M, None);
        let first = guess.and_then(|beam| Some(Part { begin: beam, end: beam + 1, ..*self.part_of(beam)? }));
        for part in first.iter().chain(self.iter()) {
            self.blocks_below(part, readings, &mut least.0, |least_m, beam, margin_m| {
                if margin_m < *least_m {
                    (*least_m, least.1) = (margin_m, Some(beam));
                }
            });
        }
        if least.1.is_none() { (f64::INFINITY, None) } else { least }
    }

    /// Each beam whose reading is less than its threshold, in rising order within each piece, with its threshold.
    pub fn each_below(&self, readings: &Readings, mut take: impl FnMut(usize, f64)) {
        for part in self.iter() {
            self.blocks_below(part, readings, &mut 0.0, |_, beam, margin_m| {
                if margin_m < 0.0 {
                    take(beam, readings.readings_m[beam] - margin_m);
                }
            });
        }
    }

    fn part_of(&self, beam: usize) -> Option<&Part> {
        self.iter().find(|part| (part.begin..part.end).contains(&beam))
    }

    /// Calls `take` with the margin of every beam of those blocks that may hold one under the level; it may lower the
    /// level.
    fn blocks_below(
        &self,
        part: &Part,
        readings: &Readings,
        level_m: &mut f64,
        mut take: impl FnMut(&mut f64, usize, f64),
    ) {
        let mut begin = part.begin;
        while begin < part.end {
            let block = begin / BLOCK;
            let range = begin..part.end.min((block + 1) * BLOCK);
            begin = range.end;
            if readings.minima_m[block] - part.farthest_m < *level_m
                && self.any_below(part.law, range.clone(), readings, *level_m)
            {
                for beam in range {
                    take(level_m, beam, readings.readings_m[beam] - self.threshold_m(part, beam));
                }
            }
        }
    }

    /// Whether any margin is less than `level_m`, or so near to it that only the exact figures tell. Asked of many
    /// beams side by side, with products alone: quotients and roots take far longer.
    ///
    /// With q = reading - level, that is whether the ray leaves after q. Through an edge: k / n.d > q. Through an arc:
    /// q lies before the middle of the chord that the ray cuts, or nearer to it than half of the chord.
    fn any_below(&self, law: Law, range: Range<usize>, readings: &Readings, level_m: f64) -> bool {
        let (x, y) = (&self.beams.x[range.clone()], &self.beams.y[range.clone()]);
        let r = &readings.readings_m[range];
        match law {
            Law::Line { n, k } => lowest(x, y, r, |x, y, r| (r - level_m) * (n.x * x + n.y * y) - k) <= 0.0,
            Law::Circle { m, c } => {
                let beyond = |x: f64, y: f64, r: f64| {
                    let b = m.x * x + m.y * y;
                    let past = r - level_m - b;
                    let past = if past > 0.0 { past } else { 0.0 };
                    let half_squared = b * b - c;
                    past * past - if half_squared > 0.0 { half_squared } else { 0.0 }
                };
                lowest(x, y, r, beyond) <= 0.0
            }
        }
    }
}

fn farthest_m(seen: &Seen<'_>, piece: usize) -> f64 {
    match seen.boundary.pieces[piece] {
        Piece::Edge { from, to } => (from - seen.origin).norm().max((to - seen.origin).norm()),
        Piece::Arc { disc, .. } => (disc.center - seen.origin).norm() + disc.radius_m,
    }
}

/// The least whole number that is not less; 0 for what is under 0. (`ceil` is a call on older processors.)
fn first_at_or_after(share: f64) -> usize {
    let whole = share as usize;
    whole.saturating_add(usize::from((whole as f64) < share))
}

/// The lowest of a figure of each beam, several beams side by side.
#[inline(always)]
fn lowest(x: &[f64], y: &[f64], r: &[f64], figure: impl Fn(f64, f64, f64) -> f64) -> f64 {
    let mut least = [f64::INFINITY; LANES];
    let (xs, ys, rs) = (x.chunks_exact(LANES), y.chunks_exact(LANES), r.chunks_exact(LANES));
    let rest = xs.remainder().iter().zip(ys.remainder()).zip(rs.remainder());
    for ((x, y), r) in rest {
        least[0] = least[0].min(figure(*x, *y, *r));
    }
    for ((x, y), r) in xs.zip(ys).zip(rs) {
        for lane in 0..LANES {
            let figure = figure(x[lane], y[lane], r[lane]);
            least[lane] = if figure < least[lane] { figure } else { least[lane] };
        }
    }
    least.into_iter().fold(f64::INFINITY, f64::min)
}
