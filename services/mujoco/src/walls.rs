//! A floor plan's cells as few boxes: a ray asks every box that it may meet, and a building has tens of thousands of
//! cells that are not free.

use world::{Cell, GridMap};

/// A rectangle of cells that are not free: first column and row, and one past the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// First column, and one past the last.
    pub columns: (usize, usize),
    /// First row, and one past the last.
    pub rows: (usize, usize),
}

/// Rectangles that cover every cell that is not free, each cell once, and no free one. A run of cells in a row grows
/// over the rows above it as long as all of them are not free.
#[must_use]
pub fn blocks(map: &GridMap) -> Vec<Block> {
    let (width, height) = map.size();
    let mut left: Vec<bool> =
        (0..width * height).map(|i| map.cell((i % width) as i64, (i / width) as i64) != Cell::Free).collect();
    let mut blocks = Vec::new();
    for row in 0..height {
        let mut column = 0;
        while column < width {
            if !left[row * width + column] {
                column += 1;
                continue;
            }
            let is_left = |row: usize, column: usize| left[row * width + column];
            let end = (column..width).find(|&c| !is_left(row, c)).unwrap_or(width);
            let top = (row + 1..height).find(|&r| !(column..end).all(|c| is_left(r, c))).unwrap_or(height);
            for r in row..top {
                left[r * width + column..r * width + end].fill(false);
            }
            blocks.push(Block { columns: (column, end), rows: (row, top) });
            column = end;
        }
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::{Block, blocks};
    use messages::Pose2;
    use world::{Cell, GridMap};

    fn map(rows: &[&str]) -> GridMap {
        let cells = rows.iter().flat_map(|row| row.chars().map(|c| if c == '.' { Cell::Free } else { Cell::Occupied }));
        GridMap::new(rows[0].len(), 0.05, Pose2::default(), cells.collect())
    }

    #[test]
    fn each_cell_that_is_not_free_is_covered_once() {
        let map = map(&["##..#", "##.##", ".....", "#####"]);
        let blocks = blocks(&map);
        let mut covered = vec![0; 20];
        for block in &blocks {
            for row in block.rows.0..block.rows.1 {
                for column in block.columns.0..block.columns.1 {
                    covered[row * 5 + column] += 1;
                }
            }
        }
        for (i, count) in covered.into_iter().enumerate() {
            let is_free = map.cell((i % 5) as i64, (i / 5) as i64) == Cell::Free;
            assert_eq!(count, usize::from(!is_free), "cell {i}");
        }
        assert_eq!(blocks[0], Block { columns: (0, 2), rows: (0, 2) });
        assert_eq!(blocks.len(), 4);
    }
}
