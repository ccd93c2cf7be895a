//! A turn takes a lidar 100 ms, in which a robot walks 5 cm and turns by 2 degrees: what it measured first is laid to
//! where it is seen from at the last sample, whose stamp the scan has. Pure.

use guidance::PoseTrack;
use guidance::se2::{Point, Se2, exp, log};
use messages::{Odometry, Twist2};
use rplidar::Sample;

/// No robot moves faster, metres and radians a second: odometry that says so has jumped, and lays nothing anywhere.
const FASTEST: (f64, f64) = (4.0, 6.0);

/// Where the lidar was while it turned.
#[derive(Debug)]
pub struct Deskew {
    robot_from_lidar: Se2,
    track: PoseTrack,
    /// The odometry frame that the track is in.
    incarnation: u32,
}

/// How the lidar moved in the course of one turn.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Lidar frame; at rest where nothing is known.
    twist: Twist2,
    end_ns: u64,
}

impl Deskew {
    /// For a lidar there; it knows nothing yet.
    #[must_use]
    pub fn new(robot_from_lidar: Se2) -> Self {
        Self { robot_from_lidar, track: PoseTrack::default(), incarnation: 0 }
    }

    /// Takes a pose.
    pub fn take(&mut self, odometry: &Odometry) {
        if !(odometry.odom_from_robot.is_finite() && odometry.twist.is_finite()) {
            return;
        }
        if odometry.header.incarnation != self.incarnation {
            self.track.clear();
            self.incarnation = odometry.header.incarnation;
        }
        self.track.push(odometry);
    }

    /// The motion from the first sample of a turn to its last, as far as odometry knows it.
    #[must_use]
    pub fn motion(&self, from_ns: u64, to_ns: u64) -> Motion {
        Motion { twist: self.twist(from_ns, to_ns).unwrap_or(Twist2::ZERO), end_ns: to_ns }
    }

    fn twist(&self, from_ns: u64, to_ns: u64) -> Option<Twist2> {
        let (odom_from_first, odom_from_last) = (self.track.at(from_ns)?, self.track.at(to_ns)?);
        let last_from_first = odom_from_last.inverse() * odom_from_first;
        let lidar_from_first = self.robot_from_lidar.inverse() * last_from_first * self.robot_from_lidar;
        let taken_s = messages::s_from_ns(to_ns.checked_sub(from_ns).filter(|taken_ns| *taken_ns > 0)?);
        let twist = log(&lidar_from_first.inverse(), taken_s);
        let is_possible = twist.vx_mps.hypot(twist.vy_mps) <= FASTEST.0 && twist.wz_radps.abs() <= FASTEST.1;
        is_possible.then_some(twist)
    }
}

impl Motion {
    /// Everything stays where it was measured.
    pub const NONE: Self = Self { twist: Twist2::ZERO, end_ns: 0 };

    /// The sample as it would have been at the end of the turn.
    #[must_use]
    pub fn at_end(&self, sample: &Sample) -> Sample {
        let Some(range_m) = sample.range_m.filter(|_| self.twist != Twist2::ZERO) else { return *sample };
        let before_s = messages::s_from_ns(self.end_ns.saturating_sub(sample.stamp_ns));
        let bearing_rad = -sample.angle_deg.to_radians();
        let seen = Point::new(bearing_rad.cos(), bearing_rad.sin()) * f64::from(range_m);
        let at_end = exp(self.twist, before_s).inverse() * seen;
        let angle_deg = (-at_end.y.atan2(at_end.x)).to_degrees().rem_euclid(360.0);
        Sample { angle_deg, range_m: Some(at_end.coords.norm() as f32), ..*sample }
    }
}

#[cfg(test)]
mod tests {
    use super::Deskew;
    use guidance::se2::{Point, exp, pose2, se2};
    use messages::{Header, Odometry, Pose2, Twist2};
    use rplidar::Sample;

    const MS: u64 = 1_000_000;
    const TWIST: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.1, wz_radps: 0.35 };
    const ROBOT_FROM_LIDAR: Pose2 = Pose2 { x_m: 0.2, y_m: 0.05, yaw_rad: 0.3 };

    fn odometry(at_ms: u64, incarnation: u32) -> Odometry {
        Odometry {
            header: Header { stamp_ns: at_ms * MS, incarnation, ..Header::default() },
            odom_from_robot: pose2(&exp(TWIST, at_ms as f64 / 1000.0)),
            twist: TWIST,
            ..Odometry::default()
        }
    }

    /// A sample of a post that stands still, seen from where the robot is then.
    fn sample_of(post: Point, at_ms: u64) -> Sample {
        let odom_from_lidar = exp(TWIST, at_ms as f64 / 1000.0) * se2(ROBOT_FROM_LIDAR);
        let seen = odom_from_lidar.inverse() * post;
        let angle_deg = (-seen.y.atan2(seen.x)).to_degrees().rem_euclid(360.0);
        Sample { angle_deg, range_m: Some(seen.coords.norm() as f32), stamp_ns: at_ms * MS, ..Sample::default() }
    }

    #[test]
    fn what_was_seen_at_the_beginning_of_a_turn_is_where_it_is_at_its_end() {
        let mut deskew = Deskew::new(se2(ROBOT_FROM_LIDAR));
        (900..1090).step_by(10).for_each(|at_ms| deskew.take(&odometry(at_ms, 1)));
        let motion = deskew.motion(1000 * MS, 1100 * MS);
        for post in [Point::new(3.0, 0.4), Point::new(-1.0, 2.0), Point::new(0.9, -4.0)] {
            for at_ms in [1000, 1030, 1099, 1100] {
                let (moved, truth) = (motion.at_end(&sample_of(post, at_ms)), sample_of(post, 1100));
                let off_m = moved.range_m.zip(truth.range_m).map(|(a, b)| (a - b).abs());
                assert!(off_m.is_some_and(|off_m| off_m < 1e-4), "{at_ms}: {moved:?} {truth:?}");
                assert!((moved.angle_deg - truth.angle_deg).abs() < 1e-2, "{at_ms}: {moved:?} {truth:?}");
            }
        }
    }

    #[test]
    fn where_nothing_is_known_of_the_motion_samples_stay_as_they_were_measured() {
        let sample = sample_of(Point::new(3.0, 0.4), 1000);
        let mut deskew = Deskew::new(se2(ROBOT_FROM_LIDAR));
        assert_eq!(deskew.motion(1000 * MS, 1100 * MS).at_end(&sample), sample, "no odometry");
        deskew.take(&odometry(990, 1));
        deskew.take(&odometry(1050, 2));
        assert_eq!(
            deskew.motion(1000 * MS, 1100 * MS).at_end(&sample),
            sample,
            "a frame that is younger than the turn"
        );
        let jumped = Odometry { odom_from_robot: Pose2::new(9.0, 0.0, 0.0), ..odometry(1100, 2) };
        deskew.take(&jumped);
        assert_eq!(deskew.motion(1050 * MS, 1100 * MS).at_end(&sample), sample, "a jump");
        let unknown = Sample { range_m: None, ..sample };
        assert_eq!(deskew.motion(0, 0).at_end(&unknown), unknown);
    }
}
