//! The middle of a set of cells: thinned from its borders until it is one cell wide.

/// A set of cells, row by row, with a border of one cell that is never in it.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    width: usize,
    is_in: Vec<bool>,
}

impl Cells {
    /// Cells of a grid of that size, by whether their number is in the set; those on the grid's border are not.
    pub(super) fn new((width, height): (usize, usize), is_in: impl Fn(usize) -> bool) -> Self {
        let inner = |i: usize| {
            let (column, row) = (i % width, i / width);
            column > 0 && row > 0 && column + 1 < width && row + 1 < height
        };
        Self { width, is_in: (0..width * height).map(|i| inner(i) && is_in(i)).collect() }
    }

    /// Numbers of the cells in the set.
    pub(super) fn numbers(&self) -> Vec<usize> {
        (0..self.is_in.len()).filter(|i| self.is_in[*i]).collect()
    }

    /// The eight cells around one, counter-clockwise from the right.
    pub(super) fn around(&self, cell: usize) -> [usize; 8] {
        let width = self.width;
        [
            cell + 1,
            cell + width + 1,
            cell + width,
            cell + width - 1,
            cell - 1,
            cell - width - 1,
            cell - width,
            cell - width + 1,
        ]
    }

    /// The cells of the set beside one: a diagonal one only where no other leads to it.
    pub(super) fn beside(&self, cell: usize) -> impl Iterator<Item = usize> + use<'_> {
        let around = self.around(cell);
        (0..8)
            .filter(move |i| {
                let leads = |j: usize| self.is_in[around[j % 8]];
                self.is_in[around[*i]] && (i % 2 == 0 || !(leads(i + 1) || leads(i + 7)))
            })
            .map(move |i| around[i])
    }

    /// Thins the set to its middle, about one cell wide (Zhang and Suen 1984, with the bound of Lü and Wang 1986 that
    /// keeps oblique lines): what hangs together still does, and ends stay.
    pub(super) fn thin(&mut self) {
        let is_at_border = |cells: &Self, cell: usize| cells.around(cell).iter().any(|beside| !cells.is_in[*beside]);
        let mut border: Vec<usize> = self.numbers().into_iter().filter(|cell| is_at_border(self, *cell)).collect();
        let mut is_known = vec![false; self.is_in.len()];
        border.iter().for_each(|cell| is_known[*cell] = true);
        loop {
            let mut is_done = true;
            for is_second in [false, true] {
                let goes: Vec<usize> = border.iter().copied().filter(|cell| self.may_go(*cell, is_second)).collect();
                goes.iter().for_each(|cell| self.is_in[*cell] = false);
                border.retain(|cell| self.is_in[*cell]);
                for beside in goes.iter().flat_map(|cell| self.around(*cell)) {
                    if self.is_in[beside] && !is_known[beside] {
                        is_known[beside] = true;
                        border.push(beside);
                    }
                }
                is_done &= goes.is_empty();
            }
            if is_done {
                return;
            }
        }
    }

    fn may_go(&self, cell: usize, is_second: bool) -> bool {
        let around = self.around(cell).map(|i| self.is_in[i]);
        let count = around.iter().filter(|is_in| **is_in).count();
        let changes = (0..8).filter(|i| !around[*i] && around[(i + 1) % 8]).count();
        // On a border to the right or below in the first half, to the left or above in the second.
        let [right, _, up, _, left, _, down, _] = around;
        let [a, b] = if is_second {
            [up && right && left, up && left && down]
        } else {
            [up && right && down, right && down && left]
        };
        (3..=6).contains(&count) && changes == 1 && !a && !b
    }
}

#[cfg(test)]
mod tests {
    use super::Cells;

    /// A plus of two bars, 5 cells wide and 40 long.
    fn plus() -> Cells {
        let in_bar = |along: usize, across: usize| (5..45).contains(&along) && (23..28).contains(&across);
        Cells::new((50, 50), |i| in_bar(i % 50, i / 50) || in_bar(i / 50, i % 50))
    }

    #[test]
    fn a_plus_becomes_two_lines_that_cross() {
        let mut cells = plus();
        cells.thin();
        let numbers = cells.numbers();
        assert!(numbers.iter().all(|i| (24..27).contains(&(i % 50)) || (24..27).contains(&(i / 50))), "{numbers:?}");
        let ends = numbers.iter().filter(|cell| cells.beside(**cell).count() == 1).count();
        assert_eq!(ends, 4);
        assert!((66..82).contains(&numbers.len()), "{}", numbers.len());
    }

    #[test]
    fn an_oblique_bar_stays_as_long_as_it_is() {
        let in_bar = |x: usize, y: usize| (5..45).contains(&x) && (x..x + 4).contains(&y);
        let mut cells = Cells::new((50, 50), |i| in_bar(i % 50, i / 50));
        cells.thin();
        let columns: Vec<usize> = cells.numbers().iter().map(|cell| cell % 50).collect();
        assert!((5..45).filter(|x| columns.contains(x)).count() > 34, "{columns:?}");
    }

    #[test]
    fn what_hangs_together_still_does() {
        let mut cells = plus();
        cells.thin();
        let numbers = cells.numbers();
        let (mut seen, mut todo) = (vec![numbers[0]], vec![numbers[0]]);
        while let Some(cell) = todo.pop() {
            for next in cells.beside(cell) {
                if !seen.contains(&next) {
                    seen.push(next);
                    todo.push(next);
                }
            }
        }
        assert_eq!(seen.len(), numbers.len());
    }
}
