//! The ways of a floor plan: the middle of what robot and handler can walk, as stretches between places where ways
//! meet or end.

use std::collections::{HashMap, HashSet};

use super::room::Room;
use super::thinning::Cells;
use crate::grid_map::GridMap;

/// Robot and handler side by side need this much to either side of their middle, metres: they are 0.90 m wide, and keep
/// 0.04 m off everything.
pub(super) const PAIR_M: f64 = 0.49;
/// What leads off by less, beyond the room about where it begins, is a niche of the wall, metres.
const NICHE_M: f64 = 1.0;

/// A stretch of way between two joints, cell by cell, both joints included.
#[derive(Debug, Clone)]
pub(super) struct Stretch {
    pub(super) joints: [usize; 2],
    pub(super) cells: Vec<usize>,
    pub(super) length_m: f64,
}

/// A place where ways meet, or one ends.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    pub(super) cell: usize,
    /// The stretches that begin or end here; one that leads back here stands twice.
    pub(super) stretches: Vec<usize>,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Ways {
    pub(super) joints: Vec<Joint>,
    /// None: it was a niche, or has become part of another one.
    pub(super) stretches: Vec<Option<Stretch>>,
}

/// A stretch, as one walks along it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Along {
    pub(super) stretch: usize,
    /// From its first joint to its second.
    pub(super) is_forth: bool,
}

impl Ways {
    pub(super) fn new(map: &GridMap, room: &Room) -> Self {
        let mut cells = Cells::new(map.size(), |cell| room.of_cell(cell) >= PAIR_M);
        cells.thin();
        let mut ways = Self::traced(map, &cells);
        ways.prune(map, room);
        ways
    }

    /// The stretch of that number. It must be one that still is.
    pub(super) fn stretch(&self, number: usize) -> &Stretch {
        self.stretches[number].as_ref().unwrap_or_else(|| unreachable!("joints name stretches that are"))
    }

    /// The cells of a stretch in the order in which one walks over them.
    pub(super) fn cells(&self, along: Along) -> Vec<usize> {
        let mut cells = self.stretch(along.stretch).cells.clone();
        if !along.is_forth {
            cells.reverse();
        }
        cells
    }

    /// The joint at the end.
    pub(super) fn end(&self, along: Along) -> usize {
        self.stretch(along.stretch).joints[usize::from(along.is_forth)]
    }

    /// The stretches that lead away from a joint.
    pub(super) fn leading_off(&self, joint: usize) -> impl Iterator<Item = Along> + use<'_> {
        self.joints[joint].stretches.iter().enumerate().map(move |(i, stretch)| {
            let [first, second] = self.stretch(*stretch).joints;
            // Of one that leads back here the second mention is its other end.
            let is_again = self.joints[joint].stretches[..i].contains(stretch);
            Along { stretch: *stretch, is_forth: first == joint && !(first == second && is_again) }
        })
    }

    fn traced(map: &GridMap, cells: &Cells) -> Self {
        let numbers = cells.numbers();
        let mut tracing = Tracing { map, cells, joint_of: HashMap::new(), seen: HashSet::new(), ways: Self::default() };
        for cell in numbers.iter().copied().filter(|cell| cells.beside(*cell).count() != 2) {
            tracing.add_joint(cell);
        }
        (0..tracing.ways.joints.len()).for_each(|joint| tracing.trace_from(joint));
        // A ring from which nothing leads off has no joint of its own.
        for cell in numbers {
            if !tracing.seen.contains(&cell) && !tracing.joint_of.contains_key(&cell) {
                let joint = tracing.add_joint(cell);
                tracing.trace_from(joint);
            }
        }
        tracing.ways
    }

    fn add(&mut self, map: &GridMap, joints: [usize; 2], cells: Vec<usize>) {
        let length_m = cells.windows(2).map(|pair| (map.middle_of(pair[1]) - map.middle_of(pair[0])).norm()).sum();
        joints.iter().for_each(|joint| self.joints[*joint].stretches.push(self.stretches.len()));
        self.stretches.push(Some(Stretch { joints, cells, length_m }));
    }

    /// Takes away what is only a niche, the least first, and joins what then goes on as one.
    fn prune(&mut self, map: &GridMap, room: &Room) {
        let niche_m = |ways: &Self, number: usize| ways.depth_m(number, room).filter(|depth_m| *depth_m < NICHE_M);
        loop {
            let depths = (0..self.stretches.len()).filter_map(|i| Some((niche_m(self, i)?, i)));
            let mut niches: Vec<(f64, usize)> = depths.collect();
            if niches.is_empty() {
                return;
            }
            niches.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (_, number) in niches {
                // It may have become part of another one, or the only way from where it begins.
                if niche_m(self, number).is_some() {
                    let joints = self.remove(number);
                    joints.iter().for_each(|joint| self.join(map, *joint));
                }
            }
        }
    }

    /// How far a stretch with a dead end leads beyond the room about its other end, metres; none: it has no dead end,
    /// or nothing else leads off there.
    fn depth_m(&self, number: usize, room: &Room) -> Option<f64> {
        let stretch = self.stretches[number].as_ref()?;
        let degree = |joint: usize| self.joints[joint].stretches.len();
        let [a, b] = stretch.joints;
        let (root, tip) = match [degree(a) > 1, degree(b) > 1] {
            [false, true] => (b, a),
            [true, false] => (a, b),
            _ => return None,
        };
        let room_m = |joint: usize| room.of_cell(self.joints[joint].cell);
        Some(stretch.length_m - room_m(root) + room_m(tip))
    }

    fn remove(&mut self, number: usize) -> [usize; 2] {
        let joints = self.stretch(number).joints;
        self.stretches[number] = None;
        joints.iter().for_each(|joint| self.joints[*joint].stretches.retain(|stretch| *stretch != number));
        joints
    }

    /// Makes one stretch of two between which nothing leads off any more.
    fn join(&mut self, map: &GridMap, joint: usize) {
        let [first, second] = self.joints[joint].stretches[..] else { return };
        if first == second {
            return;
        }
        let towards = |number: usize| Along { stretch: number, is_forth: self.stretch(number).joints[1] == joint };
        let (before, after) = (towards(first), towards(second));
        let mut cells = self.cells(before);
        cells.extend(self.cells(Along { is_forth: !after.is_forth, ..after }).into_iter().skip(1));
        let from = self.stretch(first).joints[usize::from(!before.is_forth)];
        let to = self.stretch(second).joints[usize::from(!after.is_forth)];
        self.remove(first);
        self.remove(second);
        self.add(map, [from, to], cells);
    }
}

/// Ways as they are found along thinned cells.
struct Tracing<'a> {
    map: &'a GridMap,
    cells: &'a Cells,
    joint_of: HashMap<usize, usize>,
    /// Cells between joints.
    seen: HashSet<usize>,
    ways: Ways,
}

impl Tracing<'_> {
    fn add_joint(&mut self, cell: usize) -> usize {
        let joint = self.ways.joints.len();
        self.joint_of.insert(cell, joint);
        self.ways.joints.push(Joint { cell, stretches: Vec::new() });
        joint
    }

    /// Adds the stretches that lead away from a joint and are not known from their other end.
    fn trace_from(&mut self, joint: usize) {
        let from = self.ways.joints[joint].cell;
        for first in self.cells.beside(from) {
            let is_known = match self.joint_of.get(&first) {
                Some(other) => *other < joint,
                None => self.seen.contains(&first),
            };
            if is_known {
                continue;
            }
            let (mut way, mut at) = (vec![from], first);
            while !self.joint_of.contains_key(&at) {
                let before = way[way.len() - 1];
                way.push(at);
                self.seen.insert(at);
                let next = self.cells.beside(at).find(|next| *next != before);
                at = next.unwrap_or_else(|| unreachable!("a cell that is no joint has two beside it"));
            }
            way.push(at);
            self.ways.add(self.map, [joint, self.joint_of[&at]], way);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::room::Room;
    use super::super::tests::tee;
    use super::Ways;

    #[test]
    fn a_corridor_with_a_way_off_has_three_stretches() {
        let map = tee();
        let ways = Ways::new(&map, &Room::new(&map));
        let stretches: Vec<_> = ways.stretches.iter().flatten().collect();
        assert_eq!(stretches.len(), 3, "{stretches:?}");
        let ends = stretches.iter().flat_map(|stretch| stretch.joints);
        assert_eq!(ends.filter(|joint| ways.joints[*joint].stretches.len() == 3).count(), 3);
        let mut lengths_m: Vec<f64> = stretches.iter().map(|stretch| stretch.length_m).collect();
        lengths_m.sort_by(f64::total_cmp);
        // The way off is 6 m deep; the corridor goes on for 8 m behind it, and lies 11 m before it.
        for (length_m, expected) in lengths_m.iter().zip([6.2, 8.0, 10.0]) {
            assert!((length_m - expected).abs() < 1.0, "{lengths_m:?}");
        }
    }
}
