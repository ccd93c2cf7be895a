//! A stretch of a corridor like those of buildings that widens into a hall, behind which the corridor goes on.

use guidance::se2::Point;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::layout::{Branch, FULL, Leads, Plan};
use super::{GeneratorConfig, between};
use crate::prism::Prism;
use crate::site::Side;

/// A hall is drawn in this share of the corridors. One in sixteen then has one: not every corridor has room for it.
/// With more of them the widths would no longer lie within those of real floors.
const SHARE: f64 = 0.1;
/// Its length and its width, metres, and the power of the draw that makes small ones more frequent. So much of what it
/// is wider than the corridor is to the left.
const LENGTH_M: [f64; 2] = [5.0, 12.0];
const WIDE_M: [f64; 2] = [4.0, 9.0];
const SMALL: f64 = 2.0;
const LEFT: [f64; 2] = [0.2, 0.8];
/// Least length of the corridor before the hall and behind it, metres: a team that is sent on can leave the hall.
const ENDS_M: f64 = 4.5;
/// Number of things that are tried in a hall; half of their length and width (or their radius), metres; and their
/// heights, metres.
const THINGS: usize = 8;
const HALF_M: [f64; 2] = [0.2, 0.6];
const RADIUS_M: [f64; 2] = [0.15, 0.35];
const HIGH_M: [f64; 2] = [0.4, 1.4];

/// A hall.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hall {
    /// Where its middle is, along the corridor, and its length, metres.
    pub(super) way_m: f64,
    pub(super) length_m: f64,
    /// From the corridor's middle to its walls on the left and on the right, metres.
    beside_m: [f64; 2],
}

impl Plan {
    /// Two sides of a hall, each as an alcove of its length: what leads off elsewhere keeps clear of them.
    pub(super) fn draw_hall(&mut self, random: &mut ChaCha8Rng) {
        if !random.random_bool(SHARE) {
            return;
        }
        let mut size_m =
            |[least_m, most_m]: [f64; 2]| least_m + (most_m - least_m) * random.random::<f64>().powf(SMALL);
        let [length_m, wide_m] = [LENGTH_M, WIDE_M].map(&mut size_m);
        let end_m = self.line.length_m() - ENDS_M;
        let room = |stretch: &super::layout::Stretch| {
            let [from_m, to_m] = [stretch.from_m.max(ENDS_M), stretch.to_m.min(end_m)];
            let half_m = length_m / 2.0 + 0.4;
            (to_m - from_m > 2.0 * half_m).then_some([from_m + half_m, to_m - half_m])
        };
        let rooms: Vec<[f64; 2]> = self.stretches.iter().filter_map(room).collect();
        let Some(room_m) = rooms.get(random.random_range(0..rooms.len().max(1))) else { return };
        let (way_m, left) = (between(random, *room_m), between(random, LEFT));
        let before = self.branches.len();
        for (side, share) in [(Side::Left, left), (Side::Right, 1.0 - left)] {
            let alcove = Branch {
                side,
                way_m,
                width_m: length_m,
                skew_rad: 0.0,
                length_m: (wide_m - self.width_m) * share,
                leads: Leads::Unclear,
                room: None,
            };
            self.add(alcove);
        }
        if self.branches.len() < before + 2 {
            self.branches.truncate(before);
            return;
        }
        let beside_m = [left, 1.0 - left].map(|share| self.width_m / 2.0 + (wide_m - self.width_m) * share);
        self.hall = Some(Hall { way_m, length_m, beside_m });
    }

    /// What stands in the hall, also in its middle: round each thing there is a passage, and before either end of the
    /// hall.
    pub(super) fn furnish_hall(&self, config: &GeneratorConfig, random: &mut ChaCha8Rng) -> Vec<Prism> {
        let Some(Hall { way_m, length_m, beside_m: [left_m, right_m] }) = self.hall else { return Vec::new() };
        let middle = self.line.at(way_m);
        let mut things: Vec<(Prism, Point, f64)> = Vec::new();
        for _ in 0..THINGS {
            let sizes = [HALF_M; 2].map(|range_m| between(random, range_m));
            let (is_round, radius_m) = (random.random_bool(0.3), between(random, RADIUS_M));
            let reach_m = if is_round { radius_m } else { sizes[0].hypot(sizes[1]) };
            let ahead_m = length_m / 2.0 - config.passage_m - reach_m;
            let place = Point::new(
                between(random, [-ahead_m, ahead_m]),
                between(random, [reach_m - right_m, left_m - reach_m]),
            );
            let (turned_rad, high_m) = (between(random, [0.0, 1.5]), between(random, HIGH_M));
            let is_apart =
                |(_, at, other_m): &(Prism, Point, f64)| (at - place).norm() > reach_m + other_m + config.passage_m;
            let has_way = (left_m - place.y).max(right_m + place.y) - reach_m >= config.passage_m;
            if ahead_m < 0.0 || !has_way || !things.iter().all(is_apart) {
                continue;
            }
            let at = middle * place;
            let thing = if is_round {
                Prism::pillar(at, radius_m, FULL)
            } else {
                Prism::cuboid(at, sizes.map(|half_m| 2.0 * half_m), middle.rotation.angle() + turned_rad, [0.0, high_m])
            };
            things.push((thing, place, reach_m));
        }
        things.into_iter().map(|(thing, ..)| thing).collect()
    }
}
