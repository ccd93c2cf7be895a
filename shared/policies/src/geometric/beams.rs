//! A scan read as beams: what each one says about the way to a place.

use guidance::Se2;
use guidance::se2::{Point, se2};
use messages::ScanHeader;
use std::f64::consts::TAU;

/// Readings beyond it say nothing that a decision needs, metres.
const RANGE_USED_M: f64 = 12.0;

/// What one beam says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Nothing.
    Unknown,
    /// Free up to there, metres.
    Clear(f64),
    /// Free up to there, and something stands there, metres.
    Hit(f64),
}

impl Reading {
    fn free_m(self) -> f64 {
        match self {
            Self::Unknown => 0.0,
            Self::Clear(range_m) | Self::Hit(range_m) => range_m,
        }
    }
}

/// The beams of one scan, those that end on the handler taken out.
#[derive(Debug)]
pub struct Beams {
    lidar_from_robot: Se2,
    angle_min_rad: f64,
    increment_rad: f64,
    full_circle: bool,
    readings: Vec<Reading>,
    /// Where each beam ended on something, robot frame, in the order of the beams.
    pub hits: Vec<Option<Point>>,
    /// One standard deviation of a reading, metres.
    pub sigma_m: f64,
}

impl Beams {
    /// Reads a scan. Beams that end within `mask_radius_m` of the `handler` (robot frame) are unknown. `None` where the
    /// header makes no sense or no beam says anything.
    pub fn read(header: &ScanHeader, ranges: &[f32], handler: Point, mask_radius_m: f64) -> Option<Self> {
        Self::read_but(header, ranges, |hit| (hit - handler).norm() < mask_radius_m)
    }

    /// Reads a scan likewise; beams that end where `on_handler` says so (robot frame) are unknown.
    pub fn read_but(header: &ScanHeader, ranges: &[f32], on_handler: impl Fn(Point) -> bool) -> Option<Self> {
        let increment = header.angle_increment_rad;
        let sane = header.robot_from_lidar.is_finite()
            && header.angle_min_rad.is_finite()
            && increment.is_finite()
            && increment.abs() > 1e-6
            && header.range_max_m > header.range_min_m
            && ranges.len() >= 2
            && ranges.len() as f64 * increment.abs() < TAU + 0.5;
        if !sane {
            return None;
        }
        let robot_from_lidar = se2(header.robot_from_lidar);
        let mut readings = Vec::with_capacity(ranges.len());
        let mut hits = Vec::with_capacity(ranges.len());
        for (i, &range) in ranges.iter().enumerate() {
            let bearing = header.angle_min_rad + increment * i as f64;
            let (reading, hit) = read_one(header, f64::from(range), bearing, &robot_from_lidar);
            let on_handler = hit.is_some_and(&on_handler);
            readings.push(if on_handler { Reading::Unknown } else { reading });
            hits.push(if on_handler { None } else { hit });
        }
        readings.iter().any(|reading| *reading != Reading::Unknown).then(|| Self {
            lidar_from_robot: robot_from_lidar.inverse(),
            angle_min_rad: header.angle_min_rad,
            increment_rad: increment,
            full_circle: ranges.len() as f64 * increment.abs() > TAU - 1.5 * increment.abs(),
            readings,
            hits,
            sigma_m: if header.sigma_m.is_finite() { header.sigma_m.clamp(0.0, 0.1) } else { 0.0 },
        })
    }

    /// How far the place (robot frame) lies before the nearer end of the two beams beside it, metres: positive where
    /// both beams pass it by that much.
    pub fn passed_by_m(&self, place: Point) -> f64 {
        let seen = self.lidar_from_robot * place;
        let turn = (seen.y.atan2(seen.x) - self.angle_min_rad) * self.increment_rad.signum();
        let position = turn.rem_euclid(TAU) / self.increment_rad.abs();
        let (low, last) = (position as usize, self.readings.len() - 1);
        let high = if low < last {
            low + 1
        } else if self.full_circle {
            0
        } else if position - last as f64 <= 1e-6 {
            last
        } else {
            return f64::NEG_INFINITY;
        };
        let free_m = self.readings[low.min(last)].free_m().min(self.readings[high].free_m());
        free_m - seen.coords.norm()
    }
}

fn read_one(header: &ScanHeader, range_m: f64, bearing_rad: f64, robot_from_lidar: &Se2) -> (Reading, Option<Point>) {
    if range_m.is_nan() || range_m < header.range_min_m || range_m < 0.0 {
        return (Reading::Unknown, None);
    }
    if range_m >= header.range_max_m || range_m > RANGE_USED_M {
        return (Reading::Clear(header.range_max_m.min(RANGE_USED_M)), None);
    }
    let end = Point::new(range_m * bearing_rad.cos(), range_m * bearing_rad.sin());
    (Reading::Hit(range_m), Some(robot_from_lidar * end))
}

#[cfg(test)]
mod tests {
    use super::{Beams, Point};
    use messages::ScanHeader;

    fn header(beams: usize) -> ScanHeader {
        ScanHeader {
            angle_min_rad: -std::f64::consts::PI,
            angle_increment_rad: std::f64::consts::TAU / beams as f64,
            range_min_m: 0.1,
            range_max_m: 10.0,
            ..ScanHeader::default()
        }
    }

    #[test]
    fn odd_readings_are_unknown_or_clear_and_never_a_panic() {
        let ranges = [f32::NAN, f32::INFINITY, -1.0, 0.0, 20.0, 2.0, f32::NEG_INFINITY, 1.0];
        let beams = Beams::read(&header(8), &ranges, Point::new(-0.75, -0.35), 0.4).expect("some beams are good");
        assert_eq!(beams.hits.iter().flatten().count(), 2);
        for i in 0..64 {
            let bearing = f64::from(i) * 0.1;
            assert!(!beams.passed_by_m(Point::new(bearing.cos(), bearing.sin())).is_nan());
        }
        assert!(Beams::read(&header(4), &[f32::NAN; 4], Point::origin(), 0.4).is_none());
        assert!(Beams::read(&header(4), &[], Point::origin(), 0.4).is_none());
        assert!(Beams::read(&ScanHeader::default(), &[1.0; 4], Point::origin(), 0.4).is_none());
    }

    #[test]
    fn a_half_circle_that_turns_clockwise_is_read_the_same_way() {
        let clockwise = ScanHeader {
            angle_min_rad: std::f64::consts::FRAC_PI_2,
            angle_increment_rad: -std::f64::consts::PI / 180.0,
            ..header(360)
        };
        let beams = Beams::read(&clockwise, &[3.0; 181], Point::new(9.0, 9.0), 0.4).expect("a scan");
        assert!((beams.passed_by_m(Point::new(0.7, 0.7)) - 2.01).abs() < 0.01);
        assert!((beams.passed_by_m(Point::new(0.7, -0.7)) - 2.01).abs() < 0.01);
        assert_eq!(beams.passed_by_m(Point::new(-0.7, 0.1)), f64::NEG_INFINITY);
    }

    #[test]
    fn a_place_before_both_ends_is_passed() {
        let beams = Beams::read(&header(360), &[3.0; 360], Point::new(9.0, 9.0), 0.4).expect("a scan");
        assert!((beams.passed_by_m(Point::new(-1.0, 0.01)) - 2.0).abs() < 1e-3);
        assert!(beams.passed_by_m(Point::new(0.0, 3.5)) < 0.0);
    }
}
