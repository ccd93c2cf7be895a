//! Openings in the corridor's sides, found by looking across it at every 0.1 m of the travel line.

use super::grid::{CELL_M, Known, Window};
use guidance::Se2;
use guidance::se2::Point;

/// How far behind the robot openings are looked for, metres.
const BEHIND_M: f64 = 3.0;
/// How far ahead, metres.
const AHEAD_M: f64 = 7.0;
/// How far across, metres.
const ACROSS_M: f64 = 6.0;
/// What lies back from the wall by less than this is wall, metres.
const NICHE_M: f64 = 0.6;
/// An opening is this wide, metres; cells at its edges are lost to the wall.
const WIDE_M: f64 = 0.85;
/// Something on the line itself is passed over up to this width, metres.
const ON_LINE_M: f64 = 0.8;
/// Fewer looks do not tell where a wall is.
const LOOKS_MIN: usize = 5;
/// A wall is still there where this part of the looks ends on it: a quarter.
const STILL_SHARE: usize = 4;
/// A wall farther away than this bounds a hall, not a corridor, metres.
const WALL_MAX_M: f64 = 4.0;

/// A side of the travel line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// y > 0.
    Left,
    /// y < 0.
    Right,
}

impl Side {
    /// +1 for left, -1 for right.
    pub fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }

    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// What a look across finds.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Look {
    /// Free floor, then an obstacle at that distance, metres.
    Wall(f64),
    /// Free floor up to that distance, then nothing known, metres.
    Unseen(f64),
    /// No free floor to look from.
    Nowhere,
}

impl Look {
    fn free_m(self) -> f64 {
        match self {
            Self::Wall(free_m) | Self::Unseen(free_m) => free_m,
            Self::Nowhere => 0.0,
        }
    }
}

/// An opening: metres along the travel line from the robot, and the wall's distance from the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opening {
    /// Where it begins.
    pub begin_m: f64,
    /// Where it ends.
    pub end_m: f64,
    /// How far across the wall is in which it opens.
    pub wall_m: f64,
}

impl Opening {
    /// Its middle, metres along the line.
    pub fn middle_m(&self) -> f64 {
        (self.begin_m + self.end_m) / 2.0
    }
}

/// The looks to one side along the travel line.
#[derive(Debug)]
pub struct Profile {
    looks: Vec<Look>,
}

impl Profile {
    /// Looks across from the line (`odom_from_line`: at the robot, x along the travel direction).
    pub fn look(window: &Window, odom_from_line: &Se2, side: Side) -> Self {
        let count = ((BEHIND_M + AHEAD_M) / CELL_M) as usize;
        let looks = (0..count).map(|i| look(window, odom_from_line, along(i), side)).collect();
        Self { looks }
    }

    /// Distance of the wall from the line, metres: the usual look that ends on something near the robot. While enough
    /// looks end on the wall that was there before (`before_m`), what lies farther is the far end of an opening.
    pub fn wall_m(&self, before_m: Option<f64>) -> Option<f64> {
        let mut walls: Vec<f64> = (0..self.looks.len())
            .filter(|i| (-2.0..4.0).contains(&along(*i)))
            .filter_map(|i| match self.looks[i] {
                Look::Wall(free_m) if free_m < WALL_MAX_M => Some(free_m),
                _ => None,
            })
            .collect();
        walls.sort_by(f64::total_cmp);
        if walls.len() < LOOKS_MIN {
            return None;
        }
        let median = |walls: &[f64]| walls[walls.len() / 2];
        let is_before = |wall_m: &f64| before_m.is_some_and(|before_m| (wall_m - before_m).abs() < NICHE_M);
        let still: Vec<f64> = walls.iter().copied().filter(is_before).collect();
        let is_farther = before_m.is_some_and(|before_m| median(&walls) >= before_m + NICHE_M);
        let is_there = still.len() >= LOOKS_MIN && still.len() * STILL_SHARE >= walls.len();
        Some(median(if is_farther && is_there { &still } else { &walls }))
    }

    /// The openings in a wall at that distance, from behind to ahead.
    pub fn openings(&self, wall_m: f64) -> Vec<Opening> {
        let mut found = Vec::new();
        let mut begin = None;
        for i in 0..=self.looks.len() {
            let deep = self.looks.get(i).is_some_and(|look| look.free_m() >= wall_m + NICHE_M);
            match (deep, begin) {
                (true, None) => begin = Some(i),
                (false, Some(first)) => {
                    let opening = Opening { begin_m: along(first), end_m: along(i), wall_m };
                    if opening.end_m - opening.begin_m >= WIDE_M {
                        found.push(opening);
                    }
                    begin = None;
                }
                _ => {}
            }
        }
        found
    }

    /// Whether a wall is seen all along the stretch (metres along the line), niches of up to a metre apart.
    pub fn closed(&self, begin_m: f64, end_m: f64, wall_m: f64) -> bool {
        let in_stretch = |i: &usize| (begin_m..end_m).contains(&along(*i));
        let (mut walls, mut all) = (0, 0);
        for i in (0..self.looks.len()).filter(in_stretch) {
            match self.looks[i] {
                Look::Wall(free_m) if free_m <= wall_m + 1.0 => walls += 1,
                Look::Nowhere => continue,
                _ => {}
            }
            all += 1;
        }
        all > 0 && walls * 10 >= all * 9
    }
}

fn along(i: usize) -> f64 {
    i as f64 * CELL_M - BEHIND_M
}

fn look(window: &Window, odom_from_line: &Se2, along_m: f64, side: Side) -> Look {
    let mut seen_free = false;
    let mut across_m = 0.0;
    while across_m < ACROSS_M {
        match window.known_at(odom_from_line * Point::new(along_m, side.sign() * across_m)) {
            Known::Free => seen_free = true,
            _ if !seen_free && across_m < ON_LINE_M => {}
            _ if !seen_free => return Look::Nowhere,
            Known::Occupied => return Look::Wall(across_m),
            Known::Unknown => return Look::Unseen(across_m),
        }
        across_m += CELL_M;
    }
    Look::Unseen(ACROSS_M)
}

#[cfg(test)]
mod tests {
    use super::{Look, Profile};

    /// A corridor that ends soon: its wall from 2 m behind, then the short arm of a bend.
    fn at_a_bend() -> Profile {
        let mut looks = vec![Look::Nowhere; 100];
        looks[10..25].fill(Look::Wall(1.5));
        looks[25..45].fill(Look::Wall(3.6));
        Profile { looks }
    }

    #[test]
    fn the_far_end_of_an_opening_is_not_taken_for_the_wall_that_was_seen_before() {
        let profile = at_a_bend();
        assert_eq!(profile.wall_m(Some(1.4)), Some(1.5));
        let [opening] = profile.openings(1.5)[..] else { panic!("one opening") };
        assert!((opening.begin_m + 0.5).abs() < 1e-9 && (opening.end_m - 1.5).abs() < 1e-9, "{opening:?}");
        // Clutter before the wall is not the wall that was seen.
        let mut clutter = at_a_bend();
        clutter.looks[10..25].fill(Look::Wall(0.5));
        assert_eq!(clutter.wall_m(Some(1.5)), Some(3.6));
        // Nothing tells it from a wall where none was seen before, and a corridor may become wider.
        assert_eq!(profile.wall_m(None), Some(3.6));
        assert_eq!(profile.wall_m(Some(0.5)), Some(3.6));
    }

    #[test]
    fn a_wall_that_comes_nearer_is_taken_at_once() {
        assert_eq!(at_a_bend().wall_m(Some(3.6)), Some(3.6));
        let looks = vec![Look::Wall(1.2); 100];
        assert_eq!(Profile { looks }.wall_m(Some(3.6)), Some(1.2));
        let few = vec![Look::Wall(1.2); 14];
        assert_eq!(Profile { looks: few }.wall_m(Some(3.6)), None);
    }
}
