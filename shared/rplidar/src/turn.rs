//! Samples to whole turns ([`Turns`]), and a turn's samples to as many beams as wanted ([`Fan`]), counter-clockwise,
//! each the nearest surface that it met.

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
}

/// The readings of a turn, sorted into beams.
///
/// A lidar takes more readings than there are beams. Of a beam's readings the nearest surface counts: the mean of
/// those that can be of the same surface as the nearest one. The nearest alone would be too near wherever many fall
/// into a beam: of nine with Gaussian noise it is 1.5 standard deviations, and now and then it would stand out before a
/// handler or a wall as if something were there.
#[derive(Debug, Clone)]
pub struct Fan {
    beams: Beams,
    sigma_m: f32,
    /// Beam and metres.
    readings: Vec<(usize, f32)>,
    /// For each beam, the sum of the readings of its nearest surface, and how many they are.
    sums: Vec<(f32, u32)>,
    ranges_m: Vec<f32>,
}

/// Readings are of the nearest surface up to so many standard deviations behind the nearest one.
const SURFACE_SIGMAS: f32 = 3.0;
/// The mean is taken for no farther than so many standard deviations behind the nearest reading, which is what noise
/// does to the nearest of nine: where a thing stands close before another, it is not averaged away.
const NEAREST_SIGMAS: f32 = 1.5;

impl Fan {
    /// No readings yet, of which one standard deviation is `sigma_m`.
    #[must_use]
    pub fn new(beams: Beams, sigma_m: f64) -> Self {
        let (sums, ranges_m) = (vec![(0.0, 0); beams.count], vec![f32::NAN; beams.count]);
        Self { beams, sigma_m: sigma_m as f32, readings: Vec::new(), sums, ranges_m }
    }

    /// Takes a sample; one without a reading, or of where no beam looks, is none.
    pub fn enter(&mut self, sample: &Sample) {
        if let (Some(range_m), Some(beam)) = (sample.range_m, self.beams.at(sample.angle_deg)) {
            self.readings.push((beam, range_m));
        }
    }

    /// What each beam measured, metres; NaN where nothing is known. The next readings are of another turn.
    pub fn ranges_m(&mut self) -> &[f32] {
        self.ranges_m.fill(f32::NAN);
        self.sums.fill((0.0, 0));
        for (beam, range_m) in &self.readings {
            self.ranges_m[*beam] = self.ranges_m[*beam].min(*range_m);
        }
        for (beam, range_m) in &self.readings {
            if *range_m <= self.ranges_m[*beam] + SURFACE_SIGMAS * self.sigma_m {
                let (sum_m, count) = &mut self.sums[*beam];
                (*sum_m, *count) = (*sum_m + range_m, *count + 1);
            }
        }
        let farthest_m = NEAREST_SIGMAS * self.sigma_m;
        for (range_m, (sum_m, count)) in self.ranges_m.iter_mut().zip(&self.sums).filter(|(_, (_, count))| *count > 1) {
            *range_m = (sum_m / *count as f32).min(*range_m + farthest_m);
        }
        self.readings.clear();
        &self.ranges_m
    }
}

/// Where more time than this is missing, what came before is no part of the same turn: a lidar of 20 turns a second
/// moves on by less than half a turn in it, so that no end of a turn is overlooked.
const GAP_NS_MAX: u64 = 20_000_000;
/// What took longer is no turn: a motor that stalls while the lidar measures leaves readings behind that are as old.
const TURN_NS_MAX: u64 = 250_000_000;
/// Once a lidar has looked at its far side, degrees, it has begun a new turn where it looks at its near side. Between
/// them is more than the few degrees by which the lidar's geometry moves a reading.
const FAR_SIDE_DEG: std::ops::Range<f64> = 180.0..330.0;
const NEAR_SIDE_DEG: std::ops::Range<f64> = 0.0..150.0;

/// Gathers whole turns.
#[derive(Debug, Clone, Default)]
pub struct Turns {
    here: Vec<Sample>,
    done: Vec<Sample>,
    /// From the beginning of the turn: where samples are missing before, it is none.
    whole: bool,
    far_side: bool,
}

impl Turns {
    /// Takes a sample; gives the samples of the turn that it ends, being the first of the next. Those without a reading
    /// are among them.
    pub fn push(&mut self, sample: &Sample) -> Option<&[Sample]> {
        let gap = self.here.first().zip(self.here.last()).is_some_and(|(first, last)| {
            let [turn_ns, gap_ns] = [first, last].map(|since| sample.stamp_ns.saturating_sub(since.stamp_ns));
            turn_ns > TURN_NS_MAX || gap_ns > GAP_NS_MAX
        });
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
        self.here.push(*sample);
        whole.then_some(&self.done)
    }
}

#[cfg(test)]
mod tests {
    use super::{Beams, Fan, Turns};
    use crate::Sample;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    const SIGMA_M: f64 = 0.02;
    /// A whole turn from straight back.
    const ROUND: Beams = Beams { count: 36, angle_min_rad: -PI, angle_increment_rad: TAU / 36.0 };

    fn sample(i: u64) -> Sample {
        let angle_deg = (i as f64 * 0.9) % 360.0;
        // Ahead 1 m, to the right 2 m, behind 3 m, to the left nothing.
        let range_m = (angle_deg < 225.0).then(|| 1.0 + ((angle_deg + 45.0) / 90.0).floor() as f32);
        Sample { angle_deg, range_m, stamp_ns: i * 250_000, ..Sample::default() }
    }

    fn ranges_m(samples: &[Sample]) -> Vec<f32> {
        let mut fan = Fan::new(ROUND, SIGMA_M);
        samples.iter().for_each(|sample| fan.enter(sample));
        fan.ranges_m().to_vec()
    }

    #[test]
    fn a_turn_is_counter_clockwise_and_what_gave_nothing_is_unknown() {
        let mut turns = Turns::default();
        let mut seen = Vec::new();
        for i in 100..1300 {
            seen.extend(turns.push(&sample(i)).map(<[Sample]>::to_vec));
        }
        assert_eq!(seen.len(), 2, "the first and the last one are not whole");
        let stamps_ns: Vec<u64> = seen[0].iter().map(|sample| sample.stamp_ns).collect();
        assert_eq!((stamps_ns[0], stamps_ns[399], stamps_ns.len()), (400 * 250_000, 799 * 250_000, 400));
        let ranges_m = ranges_m(&seen[0]);
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
    fn a_beam_measures_the_nearest_surface_and_not_its_nearest_reading() {
        let ahead = |range_m: &f32| Sample { range_m: Some(*range_m), ..Sample::default() };
        let measure = |readings: &[f32]| ranges_m(&readings.iter().map(ahead).collect::<Vec<_>>())[18];
        let near = |found: f32, expected: f32| (found - expected).abs() < 1e-4;
        assert!(near(measure(&[2.0]), 2.0));
        assert!(near(measure(&[2.01, 1.98, 2.02, 1.99, 2.0]), 2.0), "noise is averaged");
        assert!(near(measure(&[3.0, 1.5, 3.0, 3.01, 2.99]), 1.5), "one reading of a pole before a wall");
        assert!(near(measure(&[2.0, 2.058, 2.058, 2.058]), 2.03), "a step as high as noise may be is cut off");
        assert!(measure(&[]).is_nan());
    }

    #[test]
    fn readings_that_wobble_about_straight_ahead_begin_one_turn() {
        let mut turns = Turns::default();
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
        let (mut turns, mut seen) = (Turns::default(), Vec::new());
        // Of the second turn an eighth is missing, of the third a half.
        for i in (0..3000).filter(|i| !(500..550).contains(i) && !(900..1100).contains(i)) {
            seen.extend(turns.push(&sample(i)).map(|turn| (turn.len(), ranges_m(turn)[5].is_nan())));
        }
        let whole = (400, false);
        assert_eq!(seen, [(350, false), whole, whole, whole, whole], "{seen:?}");
    }
}
