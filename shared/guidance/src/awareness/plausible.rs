//! What no age tells: a sensor that sends the same bytes again and again, and scans that cannot follow one another.

use multiversion::multiversion;

use crate::scan::{BeamKind, Beams};
use crate::se2::{Point, Se2, about_bearing_rad};

/// Who moved this far since the first of the equal frames sees something else, metres,
const MOVED_M: f64 = 0.03;
/// or turned this far, radians.
const MOVED_RAD: f64 = 0.03;
/// A frame that sees less than this many things has nothing to tell apart by.
const SEEN_MIN: usize = 8;
/// Of a depth frame, every so many pixels are looked at: an eighth of a noisy image does not come twice.
const PIXEL_STRIDE: usize = 8;

/// Whether a sensor is stuck on one frame.
#[derive(Debug, Clone, Default)]
pub struct Repeats {
    /// Digest of the newest frame, and where the robot was at the first one with it.
    frame: Option<(u64, Se2)>,
    stuck: bool,
}

/// FNV-1a by words: equal frames have equal digests, and others as good as never.
fn digest(words: impl Iterator<Item = u32>) -> u64 {
    words.fold(0xCBF2_9CE4_8422_2325, |sum, word| (sum ^ u64::from(word)).wrapping_mul(0x0100_0000_01B3))
}

impl Repeats {
    /// A scan has come while the robot was there.
    pub fn take_scan(&mut self, ranges_m: &[f32], odom_from_robot: &Se2) {
        let seen = ranges_m.iter().filter(|range| range.is_finite()).take(SEEN_MIN).count();
        let frame = (seen == SEEN_MIN).then(|| digest(ranges_m.iter().map(|range| range.to_bits())));
        self.take(frame, odom_from_robot);
    }

    /// A depth frame has come while the robot was there.
    pub fn take_depth(&mut self, pixels_mm: &[u16], odom_from_robot: &Se2) {
        let looked_at = || pixels_mm.iter().step_by(PIXEL_STRIDE);
        let seen = looked_at().filter(|pixel| **pixel > 0).take(SEEN_MIN).count();
        let frame = (seen == SEEN_MIN).then(|| digest(looked_at().map(|pixel| u32::from(*pixel))));
        self.take(frame, odom_from_robot);
    }

    fn take(&mut self, frame: Option<u64>, odom_from_robot: &Se2) {
        match (frame, self.frame) {
            (Some(new), Some((old, from))) if new == old => {
                let moved = from.inverse() * odom_from_robot;
                self.stuck |= moved.translation.vector.norm() > MOVED_M || moved.rotation.angle().abs() > MOVED_RAD;
            }
            (frame, _) => {
                self.frame = frame.map(|digest| (digest, *odom_from_robot));
                self.stuck = false;
            }
        }
    }

    /// Whether the robot has moved, and the frame is still the same.
    pub fn is_stuck(&self) -> bool {
        self.stuck
    }

    /// Where the robot was is not known any more.
    pub fn lose_place(&mut self) {
        *self = Self::default();
    }
}

/// A scan and the last accepted one are compared in so many directions.
const SECTORS: usize = 120;
/// Directions in which both must see something; fewer say nothing.
const SECTORS_MIN: usize = 24;
/// Two readings of one direction are of one thing where they differ by no more than this, metres,
const NEAR_M: f64 = 0.3;
/// and this share of the reading: at another angle it is another place of a wall.
const NEAR_SHARE: f64 = 0.3;
/// Above this share of directions that differ, it is not people who have moved.
const DIFFERENT: f64 = 0.7;

/// Number of ends that one pass works on: the compiler makes vector instructions of it.
const SIDE_BY_SIDE: usize = 32;

type Sectors = [f64; SECTORS];

/// Whether scans can follow one another: a lidar whose scale is suddenly another sees nothing where it was.
#[derive(Debug, Clone, Default)]
pub struct Succession {
    /// Where the robot was when the last scan that was accepted was taken; none yet.
    odom_from_then: Option<Se2>,
    /// Where its beams ended on something, in the robot frame of then.
    ends: Vec<Point>,
    /// The same of the scan that is looked at.
    newest: Vec<Point>,
}

/// The nearest thing in each direction from the robot; infinite where none is. The ends are seen from where the robot
/// was.
#[multiversion(targets("x86_64+avx2"))]
fn sectors(ends: &[Point], now_from_then: &Se2) -> Sectors {
    let mut nearest2 = [f64::INFINITY; SECTORS];
    let (mut sector, mut square) = ([0.0; SIDE_BY_SIDE], [0.0; SIDE_BY_SIDE]);
    for ends in ends.chunks(SIDE_BY_SIDE) {
        // The compiler works on several of them at a time.
        for ((end, sector), square) in ends.iter().zip(&mut sector).zip(&mut square) {
            // Of less than a turn either way: `rem_euclid` costs more than all the rest.
            let end = now_from_then * end;
            let share = about_bearing_rad(end.coords) / std::f64::consts::TAU;
            *sector = (if share < 0.0 { share + 1.0 } else { share }) * SECTORS as f64;
            *square = end.coords.norm_squared();
        }
        for (sector, square) in sector.iter().zip(&square).take(ends.len()) {
            let nearest2 = &mut nearest2[(*sector as u32 as usize).min(SECTORS - 1)];
            *nearest2 = nearest2.min(*square);
        }
    }
    nearest2.map(f64::sqrt)
}

fn hits(beams: &Beams) -> impl Iterator<Item = Point> {
    beams.beams().iter().filter(|beam| beam.kind == BeamKind::Hit).map(|beam| beam.end)
}

impl Succession {
    /// Whether a scan, in the robot frame of its stamp, contradicts the last accepted one wholesale. One that does not
    /// takes its place. The robot was at `odom_from_robot` at that stamp.
    pub fn contradicts(&mut self, beams: &Beams, odom_from_robot: &Se2) -> bool {
        self.newest.clear();
        self.newest.extend(hits(beams));
        if let Some(odom_from_then) = &self.odom_from_then {
            let now_from_then = odom_from_robot.inverse() * odom_from_then;
            let (now, then) = (sectors(&self.newest, &Se2::identity()), sectors(&self.ends, &now_from_then));
            let both = || now.iter().zip(&then).filter(|(now, then)| now.is_finite() && then.is_finite());
            let differ =
                both().filter(|(now, then)| (*now - *then).abs() > NEAR_M + NEAR_SHARE * now.min(**then)).count();
            let count = both().count();
            if count >= SECTORS_MIN && differ as f64 > DIFFERENT * count as f64 {
                return true;
            }
        }
        self.odom_from_then = Some(*odom_from_robot);
        std::mem::swap(&mut self.ends, &mut self.newest);
        false
    }

    /// What was seen has no place any more.
    pub fn lose_place(&mut self) {
        self.odom_from_then = None;
    }
}

#[cfg(test)]
mod tests {
    use super::{Repeats, Succession};
    use crate::scan::Beams;
    use crate::se2::Se2;
    use messages::ScanHeader;

    fn at(x_m: f64) -> Se2 {
        crate::se2::se2(messages::Pose2::new(x_m, 0.0, 0.0))
    }

    #[test]
    fn equal_frames_are_stuck_only_where_the_robot_has_moved_and_something_is_seen() {
        let mut repeats = Repeats::default();
        let frame = [1.0_f32; 360];
        for x_m in [0.0, 0.0, 0.02] {
            repeats.take_scan(&frame, &at(x_m));
            assert!(!repeats.is_stuck(), "it stood");
        }
        repeats.take_scan(&frame, &at(0.05));
        assert!(repeats.is_stuck());
        repeats.take_scan(&frame, &at(0.05));
        assert!(repeats.is_stuck(), "standing does not mend it");
        let mut other = frame;
        other[7] += 1e-6;
        repeats.take_scan(&other, &at(0.05));
        assert!(!repeats.is_stuck());
        let open = [f32::INFINITY; 360];
        for x_m in [0.0, 1.0, 2.0] {
            repeats.take_scan(&open, &at(x_m));
            assert!(!repeats.is_stuck(), "in the open all scans are the same");
        }
        let pixels = [900_u16; 640];
        repeats.take_depth(&pixels, &at(0.0));
        repeats.take_depth(&pixels, &at(1.0));
        assert!(repeats.is_stuck());
    }

    /// A corridor 2.4 m wide with an end at 8 m, seen from `x_m`, and readings times `scale`.
    fn corridor(x_m: f64, scale: f64) -> Beams {
        let header = ScanHeader {
            angle_min_rad: -std::f64::consts::PI,
            angle_increment_rad: 1f64.to_radians(),
            range_min_m: 0.1,
            range_max_m: 12.0,
            ..ScanHeader::default()
        };
        let range = |i: usize| {
            let (sin, cos) = (i as f64 - 180.0).to_radians().sin_cos();
            let ahead_m = if cos > 0.0 { (8.0 - x_m) / cos } else { f64::INFINITY };
            scale * ahead_m.min(1.2 / sin.abs())
        };
        let mut beams = Beams::default();
        let ranges: Vec<f32> = (0..360).map(|i| range(i) as f32).collect();
        beams.fill(&header, &ranges).expect("it is a scan");
        beams
    }

    #[test]
    fn a_scan_of_another_scale_contradicts_and_one_on_the_way_does_not() {
        let mut succession = Succession::default();
        for i in 0..60 {
            let x_m = 0.1 * f64::from(i);
            assert!(!succession.contradicts(&corridor(x_m, 1.0), &at(x_m)), "{x_m}");
        }
        for _ in 0..3 {
            assert!(succession.contradicts(&corridor(5.9, 2.0), &at(5.9)), "it does not get used to it");
        }
        assert!(!succession.contradicts(&corridor(5.9, 1.0), &at(5.9)), "mended");
        assert!(succession.contradicts(&corridor(5.9, 0.5), &at(5.9)));
        succession.lose_place();
        assert!(!succession.contradicts(&corridor(5.9, 0.5), &at(5.9)));
    }
}
