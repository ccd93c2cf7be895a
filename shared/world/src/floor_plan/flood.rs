//! How far one walks from some cells to others.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::grid_map::GridMap;

/// A step to a cell beside, and to one across a corner, in tenths of a cell.
const STEP: [u32; 2] = [10, 14];

/// A cell that was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reached {
    pub(super) cell: usize,
    /// The way to it, metres.
    pub(super) way_m: f64,
    /// Which seed it was reached from: the nearest.
    pub(super) seed: usize,
}

/// All cells within `most_m` of way from the seeds, over passable cells, the nearest first.
pub(super) fn flood(
    map: &GridMap,
    seeds: impl IntoIterator<Item = usize>,
    most_m: f64,
    is_passable: impl Fn(usize) -> bool,
) -> Vec<Reached> {
    let (width, height) = map.size();
    let most = (most_m / map.resolution_m() * 10.0) as u32;
    // One more than the way to each; 0: not reached.
    let mut costs = vec![0u32; width * height];
    let mut todo = BinaryHeap::new();
    for (seed, cell) in seeds.into_iter().enumerate() {
        if is_passable(cell) && costs[cell] == 0 {
            costs[cell] = 1;
            todo.push(Reverse((1, cell, seed)));
        }
    }
    let mut reached = Vec::new();
    while let Some(Reverse((cost, cell, seed))) = todo.pop() {
        if costs[cell] != cost {
            continue;
        }
        let way_m = f64::from(cost - 1) / 10.0 * map.resolution_m();
        reached.push(Reached { cell, way_m, seed });
        let (column, row) = ((cell % width) as i64, (cell / width) as i64);
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|d| *d != (0, 0)) {
            let (x, y) = (column + dx, row + dy);
            if !(0..width as i64).contains(&x) || !(0..height as i64).contains(&y) {
                continue;
            }
            let next = y as usize * width + x as usize;
            let next_cost = cost + STEP[usize::from(dx != 0 && dy != 0)];
            if next_cost - 1 <= most && (costs[next] == 0 || costs[next] > next_cost) && is_passable(next) {
                costs[next] = next_cost;
                todo.push(Reverse((next_cost, next, seed)));
            }
        }
    }
    reached
}
