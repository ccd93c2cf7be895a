//! How well the walls that a robot sees lie on those that it saw before: a figure that needs no truth.
//!
//! Every half metre of way the hits of a scan are placed by the odometry under test, and so is what was seen 5 to 20 m
//! of way before; the figure is the distance from each hit to the nearest of these, where one is within half a metre.
//! An odometry that drifts draws walls twice. Nearer than 5 m nothing is taken, as a scan matcher looks for just that
//! there. Which hits are held against which is the same for all odometries but for that half metre: the way is the
//! raw one's.

use std::collections::VecDeque;

use guidance::se2::{Point, Se2};
use guidance::{BeamKind, Beams};
use rstar::RTree;
use serde::Serialize;

use super::Which;

/// A scan is taken every so much way, metres.
const EVERY_M: f64 = 0.5;
/// Held against what was seen so much way before, metres.
const BEFORE_M: std::ops::Range<f64> = 5.0..20.0;
/// What is farther away is something else, metres.
const SAME_M: f64 = 0.5;
/// Farther away beams are too wide apart, metres.
const RANGE_MAX_M: f64 = 10.0;

/// How well one odometry's walls lie on each other.
#[derive(Debug, Clone, Serialize)]
pub struct Crispness {
    /// Hits that have something within half a metre.
    pub n: usize,
    /// Share of all hits that they are.
    pub share: f64,
    /// Mean distance, metres.
    pub mean_m: f64,
    /// Half of them are not over it, metres.
    pub median_m: f64,
}

/// A scan and where it was taken from.
struct Seen {
    way_m: f64,
    odom_from_robot: [Se2; 3],
    hits: Vec<Point>,
}

/// Gathers it over a log.
#[derive(Default)]
pub struct Consistency {
    way_m: f64,
    last: Option<Se2>,
    seen: VecDeque<Seen>,
    hits: usize,
    distances_m: [Vec<f64>; 3],
}

impl Consistency {
    /// Takes a scan (robot frame) and its poses by each odometry.
    pub fn take(&mut self, beams: &Beams, odom_from_robot: [Se2; 3]) {
        let [raw, ..] = odom_from_robot;
        self.way_m += self.last.replace(raw).map_or(0.0, |last| (last.inverse() * raw).translation.vector.norm());
        if self.seen.back().is_some_and(|last| self.way_m - last.way_m < EVERY_M) {
            return;
        }
        let is_hit = |beam: &&guidance::Beam| beam.kind == BeamKind::Hit && beam.reading_m <= RANGE_MAX_M;
        let hits: Vec<Point> = beams.beams().iter().filter(is_hit).map(|beam| beam.end).collect();
        let now = Seen { way_m: self.way_m, odom_from_robot, hits };
        while self.seen.front().is_some_and(|seen| now.way_m - seen.way_m > BEFORE_M.end) {
            self.seen.pop_front();
        }
        self.hits += now.hits.len();
        for which in Which::ALL {
            self.measure(&now, which);
        }
        self.seen.push_back(now);
    }

    fn measure(&mut self, now: &Seen, which: Which) {
        let before = self.seen.iter().take_while(|seen| now.way_m - seen.way_m >= BEFORE_M.start);
        let placed = |seen: &Seen| -> Vec<[f64; 2]> {
            seen.hits.iter().map(|hit| (seen.odom_from_robot[which as usize] * hit).into()).collect()
        };
        let walls = RTree::bulk_load(before.flat_map(placed).collect());
        let near = placed(now).into_iter().filter_map(|hit| {
            let [x, y] = walls.nearest_neighbor(&hit)?;
            Some((x - hit[0]).hypot(y - hit[1])).filter(|distance_m| *distance_m <= SAME_M)
        });
        self.distances_m[which as usize].extend(near);
    }

    /// Of one odometry; none where nothing was seen twice.
    pub fn of(&mut self, which: Which) -> Option<Crispness> {
        let distances_m = &mut self.distances_m[which as usize];
        distances_m.sort_by(f64::total_cmp);
        let n = distances_m.len();
        let median_m = *distances_m.get(n.saturating_sub(1) / 2)?;
        let mean_m = distances_m.iter().sum::<f64>() / n as f64;
        Some(Crispness { n, share: n as f64 / self.hits as f64, mean_m, median_m })
    }
}
