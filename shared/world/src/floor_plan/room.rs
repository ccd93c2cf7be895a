//! How much room there is at each cell of a map.

use guidance::se2::Point;

use crate::grid_map::{Cell, GridMap};

/// The distance of each cell's middle from the nearest cell that is not free, metres: exact, by rows and then by
/// columns (Felzenszwalb and Huttenlocher 2012).
#[derive(Debug, Clone)]
pub(super) struct Room {
    room_m: Vec<f32>,
}

impl Room {
    pub(super) fn new(map: &GridMap) -> Self {
        let (width, height) = map.size();
        let far = (width + height) as f64;
        let blocked = |column: usize, row: usize| map.cell(column as i64, row as i64) != Cell::Free;
        let mut squares: Vec<f64> =
            (0..width * height).map(|i| if blocked(i % width, i / width) { 0.0 } else { far * far }).collect();
        let mut line = Vec::new();
        for row in 0..height {
            line.clear();
            line.extend_from_slice(&squares[row * width..(row + 1) * width]);
            squares[row * width..(row + 1) * width].copy_from_slice(&between_walls(&mut line));
        }
        for column in 0..width {
            line.clear();
            line.extend((0..height).map(|row| squares[row * width + column]));
            for (row, square) in between_walls(&mut line).into_iter().enumerate() {
                squares[row * width + column] = square;
            }
        }
        // From the middle of a cell to the nearer edge of the other.
        let to_m = |square: &f64| ((square.sqrt() - 0.5).max(0.0) * map.resolution_m()) as f32;
        Self { room_m: squares.iter().map(to_m).collect() }
    }

    /// At a cell by its number, metres.
    pub(super) fn of_cell(&self, cell: usize) -> f64 {
        f64::from(self.room_m[cell])
    }

    /// At a place, metres; 0 off the map.
    pub(super) fn at(&self, map: &GridMap, place: Point) -> f64 {
        map.number_at(place).map_or(0.0, |cell| self.of_cell(cell))
    }
}

/// The lower envelope of costs between two places that are not free: what lies off the map.
fn between_walls(costs: &mut Vec<f64>) -> Vec<f64> {
    costs.insert(0, 0.0);
    costs.push(0.0);
    let mut envelope = lower_envelope(costs);
    envelope.pop();
    envelope.remove(0);
    envelope
}

/// For each place the least of `costs[i] + (place - i)^2`.
fn lower_envelope(costs: &[f64]) -> Vec<f64> {
    let (mut roots, mut bounds) = (vec![0usize; costs.len()], vec![0.0f64; costs.len() + 1]);
    let mut last = 0;
    (bounds[0], bounds[1]) = (f64::NEG_INFINITY, f64::INFINITY);
    let value = |i: usize| costs[i] + (i * i) as f64;
    for i in 1..costs.len() {
        let meets = |root: usize| (value(i) - value(root)) / (2 * (i - root)) as f64;
        let mut at = meets(roots[last]);
        while at <= bounds[last] {
            last -= 1;
            at = meets(roots[last]);
        }
        last += 1;
        roots[last] = i;
        (bounds[last], bounds[last + 1]) = (at, f64::INFINITY);
    }
    let mut root = 0;
    (0..costs.len())
        .map(|place| {
            while bounds[root + 1] < place as f64 {
                root += 1;
            }
            let away = place as f64 - roots[root] as f64;
            away * away + costs[roots[root]]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use messages::Pose2;

    use super::Room;
    use crate::floor_plan::tests::tee;
    use crate::grid_map::{Cell, GridMap};

    #[test]
    fn what_is_off_the_map_is_not_free() {
        let map = GridMap::new(40, 0.05, Pose2::default(), vec![Cell::Free; 40 * 20]);
        let room = Room::new(&map);
        assert!((room.at(&map, map.middle(20, 9)) - 0.475).abs() < 0.03);
        assert!(room.at(&map, map.middle(0, 9)) < 0.03);
        let empty = GridMap::new(5, 0.05, Pose2::default(), Vec::new());
        assert!(Room::new(&empty).at(&empty, map.middle(0, 0)) == 0.0);
    }

    #[test]
    fn it_is_the_distance_of_the_nearest_blocked_cell() {
        let map = tee();
        let room = Room::new(&map);
        for (column, row) in [(100, 40), (30, 22), (240, 100), (239, 61)] {
            let place = map.middle(column, row);
            let expected = map.clearance(place, 5.0);
            assert!((room.at(&map, place) - expected).abs() < 0.03, "{} {expected}", room.at(&map, place));
        }
    }
}
