//! The direction of travel: the corridor's, as its walls show it (Kim et al. 2023, section 3: the travel line).

use guidance::Se2;
use guidance::se2::{Point, wrap_angle};
use std::f64::consts::{FRAC_PI_2, PI};

/// A cue may be out of line with the corridor by 30 degrees; a little more is searched.
const FIRST_SEARCH_RAD: f64 = 0.73;
/// Search round a direction already found.
const SEARCH_RAD: f64 = 0.44;
/// Decisions for which the whole orientation error may still be taken back.
const SETTLING: u32 = 6;
/// A corridor of 2.5 m radius turns by this in one step of 0.25 m.
const TURN_MAX_RAD: f64 = 0.1;
/// Wall seen, metres (weighted), below which the walls do not say.
const EVIDENCE_M: f64 = 1.2;
/// Decisions after which a way that keeps leading elsewhere is the direction of travel.
const DEVIATION_COUNT: u32 = 5;
const DEVIATION_RAD: f64 = 0.52;
/// The team's own way tells the direction over this length, metres. A way back does not.
const WALKED_M: f64 = 1.5;
const BACK_RAD: f64 = 2.0;
const BIN_RAD: f64 = PI / 90.0;
const BINS: usize = 90;

/// The direction of travel in the odometry frame, with what it was set from.
#[derive(Debug, Clone, Copy)]
pub struct TravelLine {
    /// Radians, odometry frame.
    pub yaw_rad: f64,
    reference_rad: f64,
    settled: u32,
    deviating: u32,
    /// Where the team began the part of the way that it walks (odometry frame).
    walked_from: Option<Point>,
}

impl TravelLine {
    /// Along this direction, to be corrected by the walls.
    pub fn new(yaw_rad: f64) -> Self {
        Self { yaw_rad, reference_rad: yaw_rad, settled: 0, deviating: 0, walked_from: None }
    }

    /// Follows the walls seen (robot frame, in the order of the beams) and, where it keeps leading elsewhere, the way
    /// that was planned last (`way_rad`, odometry frame).
    pub fn follow(&mut self, odom_from_robot: &Se2, hits: &[Option<Point>], way_rad: Option<f64>) {
        self.follow_walked(Point::from(odom_from_robot.translation.vector));
        let robot_yaw = odom_from_robot.rotation.angle();
        let settling = self.settled < SETTLING;
        let (centre, search) =
            if settling { (self.reference_rad, FIRST_SEARCH_RAD) } else { (self.yaw_rad, SEARCH_RAD) };
        self.settled = self.settled.saturating_add(1);
        if let Some((turn, evidence_m)) = wall_direction(hits, wrap_angle(centre - robot_yaw), search)
            && evidence_m > EVIDENCE_M
        {
            let error = wrap_angle(centre + turn - self.yaw_rad);
            let turn = if settling { error } else { (0.5 * error).clamp(-TURN_MAX_RAD, TURN_MAX_RAD) };
            self.yaw_rad = wrap_angle(self.yaw_rad + turn);
        } else if let Some(way) = way_rad {
            let error = wrap_angle(way - self.yaw_rad);
            self.yaw_rad = wrap_angle(self.yaw_rad + (0.15 * error).clamp(-0.05, 0.05));
        }
        let elsewhere = way_rad.filter(|way| wrap_angle(way - self.yaw_rad).abs() > DEVIATION_RAD);
        self.deviating = if elsewhere.is_some() { self.deviating + 1 } else { 0 };
        if let Some(way) = elsewhere.filter(|_| self.deviating >= DEVIATION_COUNT) {
            *self = Self::new(way);
        }
    }

    /// The way that the team walks now tells nothing of the corridor: it turns into an opening.
    pub fn leave(&mut self) {
        self.walked_from = None;
    }

    /// Where the team has walked elsewhere for a while, round a bend, that is the direction of travel.
    fn follow_walked(&mut self, here: Point) {
        let walked = here - *self.walked_from.get_or_insert(here);
        if walked.norm() < WALKED_M {
            return;
        }
        let walked_rad = walked.y.atan2(walked.x);
        let is_elsewhere = (DEVIATION_RAD..BACK_RAD).contains(&wrap_angle(walked_rad - self.yaw_rad).abs());
        *self = if is_elsewhere { Self::new(walked_rad) } else { Self { walked_from: Some(here), ..*self } };
    }
}

/// The direction that most wall runs along, as a turn from `centre_rad` (robot frame) of at most `search_rad`, and how
/// much wall says so, metres.
fn wall_direction(hits: &[Option<Point>], centre_rad: f64, search_rad: f64) -> Option<(f64, f64)> {
    let mut histogram = [0.0; BINS];
    let mut pieces = Vec::new();
    let (ux, uy) = (centre_rad.cos(), centre_rad.sin());
    for i in 0..hits.len() {
        let Some((turn, length_m, middle)) = piece(hits, i, centre_rad) else { continue };
        let along_m = middle.x * ux + middle.y * uy;
        if turn.abs() > search_rad || !(-3.0..6.0).contains(&along_m) {
            continue;
        }
        let weight = length_m / (1.0 + 0.3 * (along_m - 1.0).abs());
        let bin = ((turn + FRAC_PI_2) / BIN_RAD) as usize;
        histogram[bin.min(BINS - 1)] += weight;
        pieces.push((turn, weight));
    }
    let smooth = |bin: usize| -> f64 {
        let sum: f64 = histogram[bin.saturating_sub(3)..(bin + 4).min(BINS)].iter().sum();
        let turn = (bin as f64 + 0.5) * BIN_RAD - FRAC_PI_2;
        sum * (1.0 - 0.3 * (turn / search_rad).powi(2))
    };
    let best = (0..BINS).max_by(|a, b| smooth(*a).total_cmp(&smooth(*b)))?;
    let peak = (best as f64 + 0.5) * BIN_RAD - FRAC_PI_2;
    let (mut sum, mut weights) = (0.0, 0.0);
    for (turn, weight) in pieces.into_iter().filter(|(turn, _)| (turn - peak).abs() < 0.14) {
        sum += turn * weight;
        weights += weight;
    }
    (weights > 0.0).then(|| (sum / weights, weights))
}

/// A piece of wall of 0.4 m or more that begins at beam `i`: its direction as a turn from `centre_rad`, in
/// (-pi/2, pi/2], the wall that this beam stands for (metres), and its middle.
fn piece(hits: &[Option<Point>], i: usize, centre_rad: f64) -> Option<(f64, f64, Point)> {
    let first = hits[i]?;
    if first.coords.norm() > 6.0 {
        return None;
    }
    let mut last = first;
    for step in 1..80 {
        let next = hits[(i + step) % hits.len()]?;
        if (next - last).norm() > 0.5 {
            return None;
        }
        last = next;
        let run = last - first;
        if run.norm() >= 0.4 {
            let turn = wrap_angle(2.0 * (run.y.atan2(run.x) - centre_rad)) / 2.0;
            let own_m = (hits[(i + 1) % hits.len()]? - first).norm().min(0.3);
            return Some((turn, own_m, first + run / 2.0));
        }
    }
    None
}
