//! A lidar among straight walls and round people, computed here and nowhere else.

use guidance::se2::{Point, Se2};
use guidedog_matching::{Corrected, CorrectedConfig, LegNoise, MatcherConfig};
use messages::{Header, Odometry, Pose2, ScanHeader, Twist2};
use nalgebra::Vector2;

/// A tenth of a second.
pub const SCAN_NS: u64 = 100_000_000;

/// As in the configuration.
pub fn config() -> CorrectedConfig {
    let legs = LegNoise { place_m_per_sqrt_m: 0.15, yaw_rad_per_sqrt_m: 0.1, yaw_rad_per_sqrt_rad: 0.4 };
    CorrectedConfig { matcher: MatcherConfig { legs, left_out: Vec::new() }, feed_mps: 0.05, feed_radps: 0.1 }
}

/// Walls, from one end to the other, and people of 0.2 m.
#[derive(Debug, Clone, Default)]
pub struct Place {
    pub walls: Vec<[Point; 2]>,
    pub people: Vec<Point>,
}

impl Place {
    /// A room of 8 m by 6 m with a pillar in a corner, the origin in its middle.
    pub fn room() -> Self {
        let mut place = Self::default();
        place.outline(&[(-4.0, -3.0), (4.0, -3.0), (4.0, 3.0), (-4.0, 3.0)]);
        place.outline(&[(2.0, 1.5), (2.6, 1.5), (2.6, 2.1), (2.0, 2.1)]);
        place
    }

    /// Two bare walls, 2 m apart, that end nowhere in sight.
    pub fn corridor() -> Self {
        let wall = |y_m: f64| [Point::new(-500.0, y_m), Point::new(500.0, y_m)];
        Self { walls: vec![wall(-1.0), wall(1.0)], people: Vec::new() }
    }

    fn outline(&mut self, corners: &[(f64, f64)]) {
        let point = |i: usize| Point::new(corners[i % corners.len()].0, corners[i % corners.len()].1);
        self.walls.extend((0..corners.len()).map(|i| [point(i), point(i + 1)]));
    }

    fn range_m(&self, from: Point, direction: Vector2<f64>) -> f64 {
        let wall = |[a, b]: &[Point; 2]| {
            let (along, to) = (b - a, a - from);
            let cross = direction.perp(&along);
            let (range_m, share) = (to.perp(&along) / cross, to.perp(&direction) / cross);
            (range_m > 0.0 && (0.0..=1.0).contains(&share)).then_some(range_m)
        };
        let person = |center: &Point| {
            let to = center - from;
            let (ahead, aside) = (to.dot(&direction), to.perp(&direction));
            (ahead > 0.0 && aside.abs() < 0.2).then(|| ahead - (0.04 - aside * aside).sqrt())
        };
        let met = self.walls.iter().filter_map(wall).chain(self.people.iter().filter_map(person));
        met.fold(f64::INFINITY, f64::min)
    }

    /// What a lidar of 360 beams sees there; `noise_m` is the most that a reading is off.
    pub fn scan(&self, stamp_ns: u64, world_from_robot: &Se2, noise_m: f64) -> (ScanHeader, Vec<f32>) {
        let header = header(stamp_ns);
        let world_from_lidar = world_from_robot * Se2::translation(0.2, 0.0);
        let from = Point::from(world_from_lidar.translation.vector);
        let range_m = |beam: u32| {
            let angle = header.angle_min_rad + f64::from(beam) * header.angle_increment_rad;
            let direction = world_from_lidar.rotation * Vector2::new(angle.cos(), angle.sin());
            (self.range_m(from, direction) + noise_m * noise(stamp_ns, beam)) as f32
        };
        (header, (0..360).map(range_m).collect())
    }
}

/// Of a lidar 0.2 m ahead of the robot's middle.
pub fn header(stamp_ns: u64) -> ScanHeader {
    ScanHeader {
        header: Header { stamp_ns, seq: stamp_ns / SCAN_NS, ..Header::default() },
        angle_min_rad: -std::f64::consts::PI,
        angle_increment_rad: 1f64.to_radians(),
        range_min_m: 0.05,
        range_max_m: 25.0,
        sigma_m: 0.025,
        robot_from_lidar: Pose2::new(0.2, 0.0, 0.0),
        height_m: 0.0,
    }
}

/// The same each time: from -1 to 1, evenly (splitmix64).
fn noise(stamp_ns: u64, beam: u32) -> f64 {
    let mut bits = stamp_ns.wrapping_add(u64::from(beam) << 40).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (bits ^ (bits >> 31)) as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// What legs say.
pub fn odometry(stamp_ns: u64, leg_from_robot: &Se2) -> Odometry {
    let at = leg_from_robot.translation.vector;
    Odometry {
        header: Header { stamp_ns, seq: stamp_ns / SCAN_NS, incarnation: 1, ..Header::default() },
        odom_from_robot: Pose2::new(at.x, at.y, leg_from_robot.rotation.angle()),
        twist: Twist2::ZERO,
        sigma: [0.0; 3],
        ..Odometry::default()
    }
}

/// Walks `steps` scans of `truly` each, of which the legs say `said`, from the origin: the corrector, the last pose
/// that went out, and the true one. `people` are where they are at each step.
pub fn walk(
    place: &Place,
    steps: u64,
    [truly, said]: [Se2; 2],
    noise_m: f64,
    people: impl Fn(u64) -> Vec<Point>,
) -> (Corrected, Odometry, Se2) {
    let (mut corrected, mut place) = (Corrected::new(config()), place.clone());
    let (mut world_from_robot, mut leg_from_robot) = (Se2::identity(), Se2::identity());
    let mut out = Odometry::default();
    for step in 1..=steps {
        place.people = people(step);
        let (header, ranges_m) = place.scan(step * SCAN_NS, &world_from_robot, noise_m);
        corrected.take_scan(&header, &ranges_m);
        out = corrected.take_odometry(&odometry(step * SCAN_NS, &leg_from_robot));
        // Refusals are counted.
        let _ = corrected.work();
        if step < steps {
            world_from_robot *= truly;
            leg_from_robot *= said;
        }
    }
    (corrected, out, world_from_robot)
}
