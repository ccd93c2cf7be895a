//! A small top view of the world around the robot, in characters.

use std::collections::HashMap;
use std::sync::Arc;

use control::WorldStatus;
use guidance::se2::Point;
use world::{Goal, Scenario, World};

/// Characters and lines of the view.
const COLUMNS: i64 = 56;
const ROWS: i64 = 13;
/// A character is about twice as high as wide; so is the piece of floor that it stands for, metres.
const COLUMN_M: f64 = 0.25;
const ROW_M: f64 = 0.5;
/// What stands between these heights is in the way, metres.
const HEIGHTS_M: [f64; 2] = [0.05, 1.8];
/// Cells remembered; a longer walk forgets and looks again.
const MAX_CELLS: usize = 200_000;

/// The view, which remembers what stands where.
#[derive(Debug)]
pub struct MapView {
    world: Arc<World>,
    goal: Option<Goal>,
    cells: HashMap<(i64, i64), bool>,
}

impl MapView {
    /// A view of a scenario's world.
    pub fn new(world: &Arc<World>, scenario: &Scenario) -> Self {
        Self { world: Arc::clone(world), goal: scenario.route.goal, cells: HashMap::new() }
    }

    /// The lines of the view around the robot; none without a world.
    pub fn lines(&mut self, world: Option<&WorldStatus>) -> Vec<String> {
        let Some(world) = world else { return Vec::new() };
        let robot = cell((world.robot[0], world.robot[1]));
        let (left, top) = (robot.0 - COLUMNS / 2, robot.1 + ROWS / 2);
        let mut lines: Vec<Vec<char>> = (0..ROWS).map(|row| self.row(left, top - row)).collect();
        let mut put = |(column, row): (i64, i64), mark: char| {
            let (x, y) = (usize::try_from(column - left), usize::try_from(top - row));
            if let (Ok(x), Ok(y)) = (x, y)
                && let Some(place) = lines.get_mut(y).and_then(|line| line.get_mut(x))
            {
                *place = mark;
            }
        };
        if let Some(goal) = self.goal {
            put(cell((goal.at.x, goal.at.y)), 'G');
        }
        for [x_m, y_m] in &world.walkers {
            put(cell((*x_m, *y_m)), 'o');
        }
        put(cell((world.handler[0], world.handler[1])), 'H');
        put(robot, 'R');
        lines.into_iter().map(String::from_iter).collect()
    }

    fn row(&mut self, left: i64, row: i64) -> Vec<char> {
        (left..left + COLUMNS).map(|column| if self.is_wall((column, row)) { '#' } else { ' ' }).collect()
    }

    fn is_wall(&mut self, (column, row): (i64, i64)) -> bool {
        if self.cells.len() > MAX_CELLS {
            self.cells.clear();
        }
        let world = &self.world;
        *self.cells.entry((column, row)).or_insert_with(|| {
            let x = (column as f64 + 0.5) * COLUMN_M;
            // A cell is two squares, one above the other.
            [0.25, 0.75].into_iter().any(|share| {
                let centre = Point::new(x, (row as f64 + share) * ROW_M);
                world.clearance(centre, HEIGHTS_M, COLUMN_M) < COLUMN_M / 2.0
            })
        })
    }
}

fn cell((x_m, y_m): (f64, f64)) -> (i64, i64) {
    ((x_m / COLUMN_M).floor() as i64, (y_m / ROW_M).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::{COLUMNS, MapView, ROWS};
    use control::WorldStatus;
    use std::path::PathBuf;
    use std::sync::Arc;
    use world::Scenario;

    #[test]
    fn the_corridor_has_walls_robot_and_handler() {
        let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios/corridor.toml");
        let scenario = Scenario::load(&file).expect("it is shipped");
        let world = Arc::new(scenario.load_world().expect("it is shipped"));
        let mut view = MapView::new(&world, &scenario);
        let team = WorldStatus { handler: [-0.75, -0.35], ..WorldStatus::default() };
        let lines = view.lines(Some(&team));
        assert_eq!(lines.len(), ROWS as usize);
        assert!(lines.iter().all(|line| line.chars().count() == COLUMNS as usize));
        let text = lines.join("\n");
        assert!(text.contains('#') && text.contains('R') && text.contains('H'), "{text}");
        assert!(view.lines(None).is_empty());
    }
}
