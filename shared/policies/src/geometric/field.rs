//! Where the team can go, and what it costs from everywhere to the goal.

use super::grid::{CELL_M, Known, Window};
use guidance::se2::Point;
use nalgebra::Vector2;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// Within this of the robot any floor will do: it stands there, metres.
const STANDING_M: f64 = 0.3;
/// Nothing goes nearer to an obstacle than this with the middle of the team.
const WALL_M: f64 = 0.12;
/// Cost of a cell of unknown floor, in cells of free floor.
const UNKNOWN_PRICE: f64 = 3.0;

/// The cells that the middle of the team can get to over known free floor. Where it stands too near to something, it
/// may go where that is farther.
///
/// `ahead` tells for a place whether the team may go there at all (it does not look for its way behind its back).
pub fn reachable(window: &Window, from: Point, ahead: impl Fn(Point) -> bool) -> Vec<bool> {
    let mut reached = vec![false; window.known.len()];
    let mut open = VecDeque::new();
    if let Some(start) = window.cell_at(from) {
        reached[start] = true;
        open.push_back(start);
    }
    while let Some(cell) = open.pop_front() {
        for next in Window::neighbours(cell) {
            let centre = window.centre(next);
            let needed_m = window.clearance_m[cell].min(window.fits_m);
            let fits = window.clearance_m[next] >= needed_m || (centre - from).norm() < STANDING_M;
            if !reached[next] && fits && window.known[next] == Known::Free && ahead(centre) {
                reached[next] = true;
                open.push_back(next);
            }
        }
    }
    reached
}

/// Cost to the goal from every cell: metres of clear floor, more where it is narrow.
#[derive(Debug)]
pub struct CostToGo {
    cost_m: Vec<f64>,
}

impl CostToGo {
    /// Spreads the cost from the seeds (cell, cost there) by fast marching, until a little beyond `to`.
    pub fn spread(window: &Window, seeds: &[(usize, f64)], to: Point) -> Self {
        Self::spread_by(window, seeds, to, price)
    }

    /// The same by another price: what a metre through a cell costs, metres; infinite where there is no way.
    pub fn spread_by(
        window: &Window,
        seeds: &[(usize, f64)],
        to: Point,
        price: impl Fn(&Window, usize) -> f64,
    ) -> Self {
        let mut cost_m = vec![f64::INFINITY; window.known.len()];
        let mut done = vec![false; window.known.len()];
        let mut open = BinaryHeap::new();
        for &(cell, cost) in seeds {
            if cost < cost_m[cell] {
                cost_m[cell] = cost;
                open.push(Reverse((cost.max(0.0).to_bits(), cell)));
            }
        }
        let target = window.cell_at(to);
        let mut limit_m = f64::INFINITY;
        while let Some(Reverse((_, cell))) = open.pop() {
            if done[cell] {
                continue;
            }
            done[cell] = true;
            if cost_m[cell] > limit_m {
                break;
            }
            if Some(cell) == target {
                limit_m = cost_m[cell] + 6.0;
            }
            for next in Window::neighbours(cell) {
                let price = price(window, next);
                if done[next] || !price.is_finite() {
                    continue;
                }
                let cost = march(&cost_m, next, price * CELL_M);
                if cost < cost_m[next] {
                    cost_m[next] = cost;
                    open.push(Reverse((cost.to_bits(), next)));
                }
            }
        }
        Self { cost_m }
    }

    /// Cost at a place, metres; `None` where there is no way.
    pub fn at(&self, window: &Window, place: Point) -> Option<f64> {
        window.interpolate(&self.cost_m, place)
    }

    /// Where the way down the cost leads from a place within `way_m` metres.
    pub fn downhill(&self, window: &Window, from: Point, way_m: f64) -> Point {
        const STEP_M: f64 = 0.2;
        let mut place = from;
        for _ in 0..(way_m / STEP_M).ceil() as usize {
            let Some(slope) = self.slope(window, place) else { break };
            let steepness = slope.norm();
            if steepness < 0.3 {
                break;
            }
            place -= slope * (STEP_M / steepness);
        }
        place
    }

    fn slope(&self, window: &Window, place: Point) -> Option<Vector2<f64>> {
        let at = |dx: f64, dy: f64| self.at(window, Point::new(place.x + dx, place.y + dy));
        let dx = at(CELL_M, 0.0)? - at(-CELL_M, 0.0)?;
        let dy = at(0.0, CELL_M)? - at(0.0, -CELL_M)?;
        Some(Vector2::new(dx, dy) / (2.0 * CELL_M))
    }
}

/// What a metre through the cell costs, in metres of clear floor.
fn price(window: &Window, cell: usize) -> f64 {
    let clearance_m = window.clearance_m[cell];
    if clearance_m < WALL_M || window.known[cell] == Known::Occupied {
        return f64::INFINITY;
    }
    let near = (1.0 - clearance_m).max(0.0) / (1.0 - window.fits_m);
    let tight = (window.fits_m - clearance_m).max(0.0) / window.fits_m;
    let unknown = if window.known[cell] == Known::Unknown { UNKNOWN_PRICE } else { 1.0 };
    unknown * (1.0 + 1.5 * near * near + if tight > 0.0 { 5.0 + 25.0 * tight } else { 0.0 })
}

/// One upwind step of the eikonal equation.
fn march(cost_m: &[f64], cell: usize, step: f64) -> f64 {
    let side = super::grid::SIDE;
    let (i, j) = (cell % side, cell / side);
    let at = |inside: bool, cell: usize| if inside { cost_m[cell] } else { f64::INFINITY };
    let a = at(i > 0, cell.wrapping_sub(1)).min(at(i + 1 < side, cell + 1));
    let b = at(j > 0, cell.wrapping_sub(side)).min(at(j + 1 < side, cell + side));
    let (low, high) = (a.min(b), a.max(b));
    if high - low >= step {
        low + step
    } else {
        let gap = high - low;
        (low + high + (2.0 * step * step - gap * gap).sqrt()) / 2.0
    }
}
