//! What a second lidar adds to the first: what stands where the first does not look, and where the floor drops. It
//! takes actions away, and excuses nothing.

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
/// A drop counts where the next beam shows one within this distance, metres. One alone is noise.
const AGREE_M: f64 = 0.15;

/// A scan of the second lidar as the shield sees it. Reused from scan to scan.
#[derive(Debug, Clone, Default)]
pub struct SecondView {
    /// What stands on the floor, in the robot frame of the scan's stamp, and of now.
    stamped: Vec<Point>,
    points: Vec<Point>,
    /// Where a beam passes the level of the floor and finds none, likewise.
    stamped_edges: Vec<Point>,
    edges: Vec<Point>,
    /// Scans taken in so far.
    number: u64,
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
        let mount = header.scan.robot_from_lidar;
        let eye = Point3::new(mount.x_m, mount.y_m, header.scan.height_m);
        let eye = tilt.map_or(eye, |tilt| tilt.place(eye));
        let mounted = Rotation3::from_euler_angles(0.0, header.pitch_rad, mount.yaw_rad);
        let (mut known, mut last_edge) = (0, None::<Point>);
        for (i, range_m) in ranges_m.iter().enumerate() {
            let (kind, reading_m) = classify(f64::from(*range_m), &header.scan);
            known += usize::from(kind != BeamKind::Unknown);
            let angle_rad = header.scan.angle_min_rad + i as f64 * header.scan.angle_increment_rad;
            let way = mounted * Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
            let way = tilt.map_or(way, |tilt| tilt.direction(way));
            let end = eye + way * reading_m;
            let distance_m = end.xy().coords.norm();
            let edge = (kind == BeamKind::Hit && end.z < -DROP_M - DROP_PER_M * distance_m)
                .then(|| (eye + way * (eye.z / -way.z)).xy());
            if let Some((edge, last)) = edge.zip(last_edge).filter(|(edge, last)| (edge - last).norm() <= AGREE_M) {
                self.stamped_edges.extend([last, edge]);
            }
            last_edge = edge;
            let stands = (FLOOR_M + FLOOR_PER_M * distance_m..HEAD_M).contains(&end.z);
            if kind == BeamKind::Hit && stands {
                self.stamped.push(end.xy());
            }
        }
        if known == 0 {
            return Err(ScanError::AllUnknown(ranges_m.len()));
        }
        self.move_to(&Se2::identity());
        Ok(())
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
        [&mut self.stamped, &mut self.points, &mut self.stamped_edges, &mut self.edges]
            .into_iter()
            .for_each(Vec::clear);
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
        view.fill(&header, &ranges_m(&header, 9.0, 0.0), None).expect("usable");
        assert!(view.points().is_empty() && view.edges().is_empty());
        view.fill(&header, &ranges_m(&header, 0.5, 0.17), None).expect("usable");
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
    }
}
