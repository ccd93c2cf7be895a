//! A map without its furniture: what stands free in the room, a table or a pillar, makes no corridor of it.

use crate::grid_map::{Cell, GridMap};

/// What stands free and fills this share of the box about it is furniture up to this length, metres; what does not may
/// be walls between doors, and is furniture only where it is shorter.
const FILLED: f64 = 0.3;
const FURNITURE_M: f64 = 6.5;
const POST_M: f64 = 1.5;
const THIN_M: f64 = 0.6;

/// The same map, with free floor where furniture stands.
pub(super) fn without_furniture(map: &GridMap) -> GridMap {
    let (width, height) = map.size();
    let blocked = |cell: usize| map.cell((cell % width) as i64, (cell / width) as i64) != Cell::Free;
    let mut seen = vec![false; width * height];
    let mut furniture = Vec::new();
    for first in (0..width * height).filter(|cell| blocked(*cell)) {
        if seen[first] {
            continue;
        }
        seen[first] = true;
        let mut island = vec![first];
        let mut next = 0;
        while let Some(cell) = island.get(next).copied() {
            next += 1;
            let (column, row) = (cell % width, cell / width);
            for y in row.saturating_sub(1)..(row + 2).min(height) {
                for beside in (column.saturating_sub(1)..(column + 2).min(width)).map(|x| y * width + x) {
                    if !seen[beside] && blocked(beside) {
                        seen[beside] = true;
                        island.push(beside);
                    }
                }
            }
        }
        let is_at_edge = |cell: &usize| {
            let (column, row) = (cell % width, cell / width);
            column == 0 || row == 0 || column + 1 == width || row + 1 == height
        };
        if is_furniture(&island, width, map.resolution_m()) && !island.iter().any(is_at_edge) {
            furniture.extend(island);
        }
    }
    map.with_free(&furniture)
}

fn is_furniture(island: &[usize], width: usize, resolution_m: f64) -> bool {
    let extent_m = |of: fn(usize, usize) -> usize| {
        let all = || island.iter().map(|cell| of(*cell, width));
        let cells = all().max().unwrap_or(0) - all().min().unwrap_or(0) + 1;
        cells as f64 * resolution_m
    };
    let [x_m, y_m] = [extent_m(|cell, width| cell % width), extent_m(|cell, width| cell / width)];
    let filled = island.len() as f64 * resolution_m * resolution_m / (x_m * y_m);
    // A wall fills its box as well, but that is thin.
    let is_thick = filled > FILLED && x_m.min(y_m) > THIN_M;
    x_m.max(y_m) <= if is_thick { FURNITURE_M } else { POST_M }
}

#[cfg(test)]
mod tests {
    use messages::Pose2;

    use super::without_furniture;
    use crate::grid_map::{Cell, GridMap};

    #[test]
    fn a_table_is_taken_out_and_a_wall_between_two_doors_is_not() {
        let cells = (0..200 * 100).map(|i| {
            let (x, y) = (i % 200, i / 200);
            let table = (20..60).contains(&x) && (20..40).contains(&y);
            let wall = (80..140).contains(&x) && (70..74).contains(&y);
            if table || wall { Cell::Occupied } else { Cell::Free }
        });
        let map = without_furniture(&GridMap::new(200, 0.05, Pose2::default(), cells.collect()));
        assert_eq!(map.cell(30, 30), Cell::Free);
        assert_eq!(map.cell(100, 72), Cell::Occupied);
    }
}
