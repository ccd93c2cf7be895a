//! What a second lidar adds to the first: what stands where the first does not look, and where the floor drops. It
//! takes actions away, and excuses nothing.

use std::f64::consts::FRAC_PI_2;

use messages::SecondScanHeader;
use nalgebra::{Point3, Rotation3, Vector3};

use crate::scan::{BeamKind, ScanError, check, classify};
use crate::se2::{Point, Se2};
use crate::tilt::Tilt;

/// What is higher is above the handler's head, metres.
const HEAD_M: f64 = 1.90;
/// What is lower is floor: metres, and an increase per metre of distance, for the error of the attitude.
const FLOOR_M: f64 = 0.05;
const FLOOR_PER_M: f64 = 0.015;
/// Floor that lies lower has dropped: metres, and an increase per metre of distance.
const DROP_M: f64 = 0.08;
const DROP_PER_M: f64 = 0.02;
/// A drop counts where the next beam shows one within this distance, metres, or within two beams of it. One alone is
/// noise.
const AGREE_M: f64 = 0.15;
const AGREE_BEAMS: f64 = 2.2;
/// Beams that should meet the floor within this distance, metres, and meet nothing over this width, metres, show none.
const FLOOR_REACH_M: f64 = 3.0;
const NOTHING_M: f64 = 0.3;
/// Floor that is seen this near to a place shows that the place has floor, metres.
const SAME_M: f64 = 0.07;
/// A mount that looks further down than this, radians, looks at the floor.
const DOWN_RAD: f64 = 0.05;

/// A scan of the second lidar as the shield sees it. Reused from scan to scan.
#[derive(Debug, Clone, Default)]
pub struct SecondView {
    /// What stands on the floor, in the robot frame of the scan's stamp, and of now.
    stamped: Vec<Point>,
    points: Vec<Point>,
    /// Where a beam passes the level of the floor and finds none, likewise.
    stamped_edges: Vec<Point>,
    edges: Vec<Point>,
    /// Where beams met the floor, in the robot frame of the scan's stamp.
    floor: Vec<Point>,
    looks_down: bool,
    /// Scans taken in so far.
    number: u64,
}

/// What the beams next to one another show of a floor that is missing.
#[derive(Debug, Clone, Copy, Default)]
struct Missing {
    /// Where the last beam should have met it, and whether what it met lies lower.
    last: Option<(Point, bool)>,
    /// The first of the edges that were put down for beams that met nothing, and how wide these are, metres.
    from: usize,
    wide_m: f64,
}

impl SecondView {
    /// Takes in a scan of a lidar on a body that was held so at the scan's stamp; level without a tilt.
    ///
    /// # Errors
    /// Where the scan cannot be used; the view is then empty.
    pub fn fill(&mut self, header: &SecondScanHeader, ranges_m: &[f32], tilt: Option<&Tilt>) -> Result<(), ScanError> {
        self.clear();
        self.number += 1;
        check(&header.scan, ranges_m.len())?;
        let is_mounted = header.pitch_rad.abs() < FRAC_PI_2 && header.scan.height_m > 0.0;
        if !is_mounted || !header.scan.height_m.is_finite() {
            return Err(ScanError::Geometry("mounting pose"));
        }
        self.looks_down = header.pitch_rad > DOWN_RAD;
        let mount = header.scan.robot_from_lidar;
        let eye = Point3::new(mount.x_m, mount.y_m, header.scan.height_m);
        let eye = tilt.map_or(eye, |tilt| tilt.place(eye));
        let mounted = Rotation3::from_euler_angles(0.0, header.pitch_rad, mount.yaw_rad);
        let (mut known, mut missing) = (0, Missing::default());
        for (i, range_m) in ranges_m.iter().enumerate() {
            let (kind, reading_m) = classify(f64::from(*range_m), &header.scan);
            known += usize::from(kind != BeamKind::Unknown);
            let angle_rad = header.scan.angle_min_rad + i as f64 * header.scan.angle_increment_rad;
            let way = mounted * Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
            let way = tilt.map_or(way, |tilt| tilt.direction(way));
            let end = (kind == BeamKind::Hit).then(|| eye + way * reading_m);
            self.take(&eye, &way, end, header.scan.angle_increment_rad.abs(), &mut missing);
        }
        self.give_up(&missing);
        if known == 0 {
            self.clear();
            return Err(ScanError::AllUnknown(ranges_m.len()));
        }
        self.move_to(&Se2::identity());
        Ok(())
    }

    /// Takes in a beam that ends there, or meets nothing.
    fn take(
        &mut self,
        eye: &Point3<f64>,
        way: &Vector3<f64>,
        end: Option<Point3<f64>>,
        apart_rad: f64,
        missing: &mut Missing,
    ) {
        let to_floor = eye + way * (eye.z / -way.z);
        let to_floor_m = (to_floor - eye).norm();
        let should_meet = self.looks_down && way.z < 0.0 && to_floor.xy().coords.norm() <= FLOOR_REACH_M;
        let distance_m = end.map_or(0.0, |end| end.xy().coords.norm());
        let height_m = end.map(|end| end.z);
        let is_low = height_m.is_some_and(|z_m| way.z < 0.0 && z_m < -DROP_M - DROP_PER_M * distance_m);
        if let Some(end) = end.filter(|_| !is_low) {
            if end.z >= HEAD_M {
                // It passes above.
            } else if end.z >= FLOOR_M + FLOOR_PER_M * distance_m {
                self.stamped.push(end.xy());
            } else {
                self.floor.push(end.xy());
            }
        }
        if !is_low && (end.is_some() || !should_meet) {
            self.give_up(missing);
            *missing = Missing::default();
            return;
        }
        let edge = to_floor.xy();
        let near_m = AGREE_M.max(AGREE_BEAMS * apart_rad * to_floor_m);
        let before = missing.last.filter(|(last, _)| (edge - last).norm() <= near_m);
        let Some((last, was_low)) = before else {
            self.give_up(missing);
            *missing = Missing { last: Some((edge, is_low)), from: self.stamped_edges.len(), wide_m: 0.0 };
            return;
        };
        if was_low && is_low {
            (missing.from, missing.wide_m) = (self.stamped_edges.len() + 2, 0.0);
        } else {
            missing.wide_m += (edge - last).norm();
        }
        self.stamped_edges.extend([last, edge]);
        missing.last = Some((edge, is_low));
    }

    /// Beams that met nothing over less than [`NOTHING_M`] say nothing.
    fn give_up(&mut self, missing: &Missing) {
        if missing.last.is_some() && missing.wide_m < NOTHING_M {
            self.stamped_edges.truncate(missing.from);
        }
    }

    /// Whether it looks at the floor.
    #[must_use]
    pub fn looks_down(&self) -> bool {
        self.looks_down
    }

    /// Whether a beam met the floor at a place (robot frame of the scan's stamp).
    #[must_use]
    pub fn showed_floor(&self, place: Point) -> bool {
        self.floor.iter().any(|floor| (floor - place).norm_squared() <= SAME_M * SAME_M)
    }

    /// From now on seen from where the robot is now: `now_from_stamped` is the robot of the scan's stamp in the robot
    /// frame of now.
    pub fn move_to(&mut self, now_from_stamped: &Se2) {
        self.points.clear();
        self.points.extend(self.stamped.iter().map(|point| now_from_stamped * point));
        self.edges.clear();
        self.edges.extend(self.stamped_edges.iter().map(|edge| now_from_stamped * edge));
    }

    /// Nothing seen.
    pub fn clear(&mut self) {
        let all = [&mut self.stamped, &mut self.points, &mut self.stamped_edges, &mut self.edges, &mut self.floor];
        all.into_iter().for_each(Vec::clear);
    }

    /// Number of the scan that was taken in last, counted from 1.
    #[must_use]
    pub fn number(&self) -> u64 {
        self.number
    }

    /// What stands on the floor, robot frame.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Where the floor has dropped, robot frame: the first place of each beam that has no floor.
    #[must_use]
    pub fn edges(&self) -> &[Point] {
        &self.edges
    }
}

#[cfg(test)]
mod tests {
    use super::SecondView;
    use crate::se2::Point;
    use messages::{Pose2, ScanHeader, SecondScanHeader};

    /// A lidar that looks so far down, degrees, 90 degrees wide, 0.4 m above the floor.
    fn header(pitch_deg: f64, yaw_deg: f64) -> SecondScanHeader {
        let scan = ScanHeader {
            angle_min_rad: -std::f64::consts::FRAC_PI_4,
            angle_increment_rad: std::f64::consts::FRAC_PI_2 / 90.0,
            range_min_m: 0.1,
            range_max_m: 8.0,
            sigma_m: 0.01,
            robot_from_lidar: Pose2 { x_m: 0.2, yaw_rad: yaw_deg.to_radians(), ..Pose2::default() },
            height_m: 0.4,
            ..ScanHeader::default()
        };
        SecondScanHeader { scan, pitch_rad: pitch_deg.to_radians(), ..SecondScanHeader::default() }
    }

    /// The ranges over a floor that lies so low from a distance ahead of the robot on, metres.
    fn ranges_m(header: &SecondScanHeader, edge_m: f64, low_m: f64) -> Vec<f32> {
        let range = |i: usize| {
            let angle_rad = header.scan.angle_min_rad + i as f64 * header.scan.angle_increment_rad;
            let down = angle_rad.cos() * header.pitch_rad.sin();
            let ahead = angle_rad.cos() * header.pitch_rad.cos();
            let range_m = header.scan.height_m / down;
            let is_low = 0.2 + ahead * range_m > edge_m;
            if is_low { ((header.scan.height_m + low_m) / down) as f32 } else { range_m as f32 }
        };
        (0..91).map(range).collect()
    }

    #[test]
    fn one_that_looks_down_sees_where_the_floor_drops_and_floor_is_nothing() {
        let (header, mut view) = (header(30.0, 0.0), SecondView::default());
        let place = Point::new(0.2 + 0.4 / 30.0_f64.to_radians().tan(), 0.0);
        view.fill(&header, &ranges_m(&header, 9.0, 0.0), None).expect("usable");
        assert!(view.points().is_empty() && view.edges().is_empty() && view.showed_floor(place));
        view.fill(&header, &ranges_m(&header, 0.5, 0.17), None).expect("usable");
        assert!(!view.showed_floor(place), "of this scan alone");
        assert!(view.points().is_empty() && view.edges().len() > 90, "{}", view.edges().len());
        // All its beams meet the level of the floor at the same distance ahead.
        let ahead_m = 0.2 + 0.4 / 30.0_f64.to_radians().tan();
        assert!(view.edges().iter().all(|edge| (edge.x - ahead_m).abs() < 1e-6), "{:?}", view.edges());
    }

    #[test]
    fn one_that_looks_back_sees_what_stands_there() {
        let (header, mut view) = (header(0.0, 180.0), SecondView::default());
        let mut ranges_m = [f32::INFINITY; 91];
        ranges_m[45] = 1.0;
        view.fill(&header, &ranges_m, None).expect("usable");
        assert!((view.points()[0] - Point::new(-0.8, 0.0)).norm() < 1e-6, "{:?}", view.points());
        assert_eq!((view.points().len(), view.edges().len()), (1, 0));
        assert!(view.fill(&header, &[f32::NAN; 91], None).is_err() && view.points().is_empty());
        for pitch_rad in [f64::NAN, 2.0] {
            let wrong = SecondScanHeader { pitch_rad, ..header };
            assert!(view.fill(&wrong, &ranges_m, None).is_err(), "{pitch_rad}");
        }
    }

    #[test]
    fn a_floor_that_gives_no_echo_over_a_wide_place_is_missing_and_single_beams_say_nothing() {
        let (header, mut view) = (header(30.0, 0.0), SecondView::default());
        let mut edges = |silent: std::ops::Range<usize>, reading_m: f32| {
            let mut ranges_m = ranges_m(&header, 9.0, 0.0);
            ranges_m[silent].fill(reading_m);
            view.fill(&header, &ranges_m, None).expect("usable");
            view.edges().len()
        };
        for nothing in [f32::NAN, f32::INFINITY] {
            assert_eq!((edges(45..46, nothing), edges(40..47, nothing)), (0, 0), "{nothing}");
            assert!(edges(30..60, nothing) >= 29, "{nothing}");
        }
    }
}
