//! Samples to whole turns: as many beams as wanted, counter-clockwise, each the nearest reading that fell into it.

use std::f64::consts::TAU;

use crate::Sample;

/// The beams of a scan in the lidar's frame: counter-clockwise, straight ahead is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beams {
    /// How many.
    pub count: usize,
    /// Angle of the first one, radians.
    pub angle_min_rad: f64,
    /// From one to the next, radians; over 0.
    pub angle_increment_rad: f64,
}

impl Beams {
    /// The beam that is nearest to a clockwise angle, degrees; none where there is none within half a step.
    #[must_use]
    pub fn at(&self, clockwise_deg: f64) -> Option<usize> {
        let turned_rad = (-clockwise_deg.to_radians() - self.angle_min_rad).rem_euclid(TAU);
        let beam = (turned_rad / self.angle_increment_rad).round() as usize;
        // Half a step before the first one is the end of the turn.
        let before_first = TAU - turned_rad < self.angle_increment_rad / 2.0;
        if before_first { Some(0) } else { (beam < self.count).then_some(beam) }
    }

    /// Enters a sample into the ranges of its beams, of which the nearest reading counts; they begin as NaN.
    pub fn enter(&self, sample: &Sample, ranges_m: &mut [f32]) {
        if let (Some(range_m), Some(beam)) = (sample.range_m, self.at(sample.angle_deg)) {
            ranges_m[beam] = ranges_m[beam].min(range_m);
        }
    }
}

/// Where more time than this is missing, what came before is no part of the same turn: a lidar of 20 turns a second
/// moves on by less than half a turn in it, so that no end of a turn is overlooked.
const GAP_NS_MAX: u64 = 20_000_000;
/// Once a lidar has looked at its far side, degrees, it has begun a new turn where it looks at its near side. Between
/// them is more than the few degrees by which the lidar's geometry moves a reading.
const FAR_SIDE_DEG: std::ops::Range<f64> = 180.0..330.0;
const NEAR_SIDE_DEG: std::ops::Range<f64> = 0.0..150.0;

/// A whole turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn<'a> {
    /// For each beam, metres; NaN where nothing is known.
    pub ranges_m: &'a [f32],
    /// When the first and the last sample were measured, nanoseconds.
    pub stamps_ns: (u64, u64),
    /// Samples, those without a reading among them.
    pub samples: usize,
}

/// Gathers turns.
#[derive(Debug, Clone)]
pub struct Turns {
    beams: Beams,
    here: Gathered,
    done: Gathered,
    /// From the beginning of the turn: where samples are missing before, it is none.
    whole: bool,
    far_side: bool,
}

#[derive(Debug, Clone)]
struct Gathered {
    ranges_m: Vec<f32>,
    stamps_ns: Option<(u64, u64)>,
    samples: usize,
}

impl Gathered {
    fn clear(&mut self) {
        self.ranges_m.fill(f32::NAN);
        self.stamps_ns = None;
        self.samples = 0;
    }

    fn take(&mut self, sample: &Sample, beams: &Beams) {
        beams.enter(sample, &mut self.ranges_m);
        self.stamps_ns = Some((self.stamps_ns.map_or(sample.stamp_ns, |(first, _)| first), sample.stamp_ns));
        self.samples += 1;
    }
}

impl Turns {
    /// Turns of such beams.
    #[must_use]
    pub fn new(beams: Beams) -> Self {
        let empty = Gathered { ranges_m: vec![f32::NAN; beams.count], stamps_ns: None, samples: 0 };
        Self { beams, here: empty.clone(), done: empty, whole: false, far_side: false }
    }

    /// Takes a sample; gives the turn that it ends, being the first of the next.
    pub fn push(&mut self, sample: &Sample) -> Option<Turn<'_>> {
        let gap = self.here.stamps_ns.is_some_and(|(_, last)| sample.stamp_ns.saturating_sub(last) > GAP_NS_MAX);
        if gap {
            self.here.clear();
            (self.whole, self.far_side) = (false, false);
        }
        let ends = self.far_side && NEAR_SIDE_DEG.contains(&sample.angle_deg);
        let whole = ends && self.whole;
        if ends {
            std::mem::swap(&mut self.here, &mut self.done);
            self.here.clear();
            (self.whole, self.far_side) = (true, false);
        }
        self.far_side |= FAR_SIDE_DEG.contains(&sample.angle_deg);
        self.here.take(sample, &self.beams);
        let Gathered { ranges_m, stamps_ns, samples } = &self.done;
        stamps_ns.filter(|_| whole).map(|stamps_ns| Turn { ranges_m, stamps_ns, samples: *samples })
    }
}

#[cfg(test)]
mod tests {
    use super::{Beams, Turns};
    use crate::Sample;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// A whole turn from straight back.
    const ROUND: Beams = Beams { count: 36, angle_min_rad: -PI, angle_increment_rad: TAU / 36.0 };

    fn sample(i: u64) -> Sample {
        let angle_deg = (i as f64 * 0.9) % 360.0;
        // Ahead 1 m, to the right 2 m, behind 3 m, to the left nothing.
        let range_m = (angle_deg < 225.0).then(|| 1.0 + ((angle_deg + 45.0) / 90.0).floor() as f32);
        Sample { angle_deg, range_m, stamp_ns: i * 250_000, ..Sample::default() }
    }

    #[test]
    fn a_turn_is_counter_clockwise_and_what_gave_nothing_is_unknown() {
        let mut turns = Turns::new(ROUND);
        let mut seen = Vec::new();
        for i in 100..1300 {
            if let Some(turn) = turns.push(&sample(i)) {
                seen.push((turn.ranges_m.to_vec(), turn.stamps_ns, turn.samples));
            }
        }
        assert_eq!(seen.len(), 2, "the first and the last one are not whole");
        let (ranges_m, stamps_ns, samples) = &seen[0];
        assert_eq!((*stamps_ns, *samples), ((400 * 250_000, 799 * 250_000), 400));
        assert_eq!((ranges_m[18], ranges_m[9], ranges_m[0]), (1.0, 2.0, 3.0), "ahead, right, behind");
        assert!(ranges_m[27].is_nan(), "left");
    }

    #[test]
    fn a_beam_is_the_nearest_of_its_fan() {
        assert_eq!([0.0, 90.0, 180.0, 359.9, 184.9].map(|deg| ROUND.at(deg)), [18, 9, 0, 18, 0].map(Some));
        // From the right over ahead to the left, a beam at either end.
        let half = Beams { count: 19, angle_min_rad: -FRAC_PI_2, angle_increment_rad: PI / 18.0 };
        let found = [0.0, 90.0, 94.9, 95.1, 180.0, 265.1, 270.0].map(|deg| half.at(deg));
        assert_eq!(found, [Some(9), Some(0), Some(0), None, None, Some(18), Some(18)]);
    }

    #[test]
    fn readings_that_wobble_about_straight_ahead_begin_one_turn() {
        let mut turns = Turns::new(ROUND);
        let mut count = 0;
        for i in 0..4000_u64 {
            let moved = if i % 2 == 0 { 0.0 } else { 8.0 };
            let angle_deg = (i as f64 * 0.9 - moved).rem_euclid(360.0);
            count += usize::from(turns.push(&Sample { angle_deg, ..sample(i) }).is_some());
        }
        assert_eq!(count, 8);
    }

    #[test]
    fn what_was_lost_for_long_ends_the_turn_for_short_leaves_beams_unknown() {
        let (mut turns, mut seen) = (Turns::new(ROUND), Vec::new());
        // Of the second turn an eighth is missing, of the third a half.
        for i in (0..3000).filter(|i| !(500..550).contains(i) && !(900..1100).contains(i)) {
            seen.extend(turns.push(&sample(i)).map(|turn| (turn.samples, turn.ranges_m[5].is_nan())));
        }
        let whole = (400, false);
        assert_eq!(seen, [(350, false), whole, whole, whole, whole], "{seen:?}");
    }
}
