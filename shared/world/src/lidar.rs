//! A planar lidar. On a body that tilts its beams rise and fall: they pass over what is low and meet the floor. Exact
//! on a level body. Otherwise the bearings of beams are those of the level body, which is off by the square of the tilt
//! (0.1 degrees at 5), and what is low has no top.

use guidance::Tilt;
use guidance::se2::{Point, Se2, se2};
use messages::{Header, MAX_BEAMS, Pose2, ScanHeader};
use nalgebra::{Point3, Rotation3, Vector3};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::noise::{Source, generator};
use crate::polar::PolarImage;
use crate::scene::PERSON_HEIGHT_M;
use crate::{ConfigError, Scene};

/// What a lidar is like and where it sits. The default is that of a small round lidar (RPLIDAR A1 class) on the robot's
/// back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarConfig {
    /// Beams of a scan, 1 to [`MAX_BEAMS`].
    pub beams: usize,
    /// Angle of the first beam in the lidar frame, radians.
    pub angle_min_rad: f64,
    /// Angle from one beam to the next, radians; negative turns clockwise.
    pub angle_increment_rad: f64,
    /// Readings under it are unknown, metres.
    pub range_min_m: f64,
    /// Nothing is seen beyond it, metres.
    pub range_max_m: f64,
    /// One standard deviation of a reading, metres (Kim et al. 2023: +-5 cm, read as two of them).
    pub sigma_m: f64,
    /// Share of the beams that give no reading, 0 to 1.
    pub drop_out: f64,
    /// Where it is on the robot.
    pub robot_from_lidar: Pose2,
    /// Height of its plane above the floor, metres.
    pub height_m: f64,
    /// How far its x axis looks down, radians.
    pub pitch_rad: f64,
}

/// Farther than any lidar that is emulated sees, metres.
const ALL_ROUND_M: f64 = 50.0;

impl Default for LidarConfig {
    fn default() -> Self {
        Self {
            beams: 360,
            angle_min_rad: -std::f64::consts::PI,
            angle_increment_rad: std::f64::consts::TAU / 360.0,
            range_min_m: 0.10,
            range_max_m: 12.0,
            sigma_m: 0.025,
            drop_out: 0.005,
            robot_from_lidar: Pose2::new(0.10, 0.0, 0.0),
            height_m: 0.40,
            pitch_rad: 0.0,
        }
    }
}

impl LidarConfig {
    /// The same lidar with this number of beams all round, counter-clockwise from straight back, and the greatest range
    /// of any lidar. An emulated lidar takes its samples from it, each at its own angle and up to its own range.
    #[must_use]
    pub fn all_round(self, beams: usize) -> Self {
        let turn = std::f64::consts::TAU;
        Self {
            beams,
            angle_min_rad: -turn / 2.0,
            angle_increment_rad: turn / beams as f64,
            range_max_m: ALL_ROUND_M,
            ..self
        }
    }

    /// What stands beside the ranges; the header is left for the publisher.
    #[must_use]
    pub fn scan_header(&self) -> ScanHeader {
        ScanHeader {
            header: Header::default(),
            angle_min_rad: self.angle_min_rad,
            angle_increment_rad: self.angle_increment_rad,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            sigma_m: self.sigma_m,
            robot_from_lidar: self.robot_from_lidar,
            height_m: self.height_m,
        }
    }

    /// Refuses what no lidar is like.
    ///
    /// # Errors
    /// Names the first key that is out of its bounds.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let turn = std::f64::consts::TAU;
        ConfigError::check_count("beams", self.beams, 1, MAX_BEAMS)?;
        ConfigError::check("angle_min_rad", self.angle_min_rad, -turn, turn)?;
        ConfigError::check("angle_increment_rad", self.angle_increment_rad, -turn, turn)?;
        ConfigError::check("range_min_m", self.range_min_m, 0.0, 10.0)?;
        ConfigError::check("range_max_m", self.range_max_m, self.range_min_m + 0.1, 300.0)?;
        ConfigError::check("sigma_m", self.sigma_m, 0.0, 1.0)?;
        ConfigError::check("drop_out", self.drop_out, 0.0, 1.0)?;
        ConfigError::check("robot_from_lidar.x_m", self.robot_from_lidar.x_m, -2.0, 2.0)?;
        ConfigError::check("robot_from_lidar.y_m", self.robot_from_lidar.y_m, -2.0, 2.0)?;
        ConfigError::check("robot_from_lidar.yaw_rad", self.robot_from_lidar.yaw_rad, -turn, turn)?;
        ConfigError::check("height_m", self.height_m, 0.0, 3.0)?;
        ConfigError::check("pitch_rad", self.pitch_rad, -turn / 4.0, turn / 4.0)
    }
}

/// A simulated lidar. All beams of a scan are of one moment.
#[derive(Debug, Clone)]
pub struct LidarSensor {
    config: LidarConfig,
    seed: u64,
    incarnation: u32,
    image: PolarImage,
    /// Of each beam, where the body tilts.
    rises: Vec<Rise>,
}

/// How a beam leads over the floor.
#[derive(Debug, Clone, Copy)]
struct Rise {
    /// Its rise for each metre over the floor.
    slope: f64,
    /// Its length for each metre over the floor.
    stretch: f64,
}

impl LidarSensor {
    /// A lidar whose noise depends on `seed` and `incarnation`.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds.
    pub fn new(config: LidarConfig, seed: u64, incarnation: u32) -> Result<Self, ConfigError> {
        config.validate()?;
        let image = PolarImage::new(config.beams, config.angle_min_rad, config.angle_increment_rad, config.range_max_m);
        Ok(Self { config, seed, incarnation, image, rises: Vec::new() })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &LidarConfig {
        &self.config
    }

    /// The same lidar with other noise.
    pub fn reseed(&mut self, seed: u64) {
        self.seed = seed;
    }

    /// What stands beside the ranges; the header is left for the publisher.
    #[must_use]
    pub fn scan_header(&self) -> ScanHeader {
        self.config.scan_header()
    }

    /// Writes scan number `frame` in metres: one range for each beam, as many as `ranges` has room for. Infinite where
    /// nothing was hit, NaN where there is no reading (drop-out, or nearer than the least range).
    pub fn scan(&mut self, scene: &Scene<'_>, frame: u64, ranges: &mut [f32]) {
        match &scene.tilt {
            _ if self.config.pitch_rad != 0.0 => self.draw_pitched(scene),
            None => self.draw(scene),
            Some(tilt) => self.draw_tilted(scene, tilt),
        }
        let stretch = |beam: usize| self.rises.get(beam).map_or(1.0, |rise| rise.stretch);
        self.measure(|beam| Some(self.image.range_m(beam)? * stretch(beam)), frame, ranges);
    }

    /// As [`Self::scan`], of ranges that are told: `range_m` gives the true range of a beam, metres; `None` where it
    /// meets nothing within the greatest range.
    pub fn measure(&self, range_m: impl Fn(usize) -> Option<f64>, frame: u64, ranges: &mut [f32]) {
        let config = &self.config;
        let readings = ranges.iter_mut().take(config.beams).enumerate();
        if config.sigma_m == 0.0 && config.drop_out == 0.0 {
            for (beam, range) in readings {
                *range = self.reading(range_m(beam), 0.0);
            }
            return;
        }
        let mut random = generator(Source::Lidar, self.seed, self.incarnation, frame);
        for (beam, range) in readings {
            // Both are drawn for every beam, so that what one beam sees changes no other beam's noise.
            let (lost, noise): (f64, f64) = (random.random(), StandardNormal.sample(&mut random));
            let reading = self.reading(range_m(beam), noise * config.sigma_m);
            *range = if lost < config.drop_out { f32::NAN } else { reading };
        }
    }

    /// The true ranges on a level body.
    fn draw(&mut self, scene: &Scene<'_>) {
        let (config, image) = (&self.config, &mut self.image);
        self.rises.clear();
        let world_from_lidar = scene.world_from(config.robot_from_lidar);
        let lidar_from_world = world_from_lidar.inverse();
        let origin = Point::from(world_from_lidar.translation.vector);
        image.clear();
        scene.world.faces_in_sight(origin, [config.height_m; 2], config.range_max_m, |a, b, _| {
            image.draw_face(lidar_from_world * a, lidar_from_world * b);
        });
        self.draw_all_else(scene, &world_from_lidar);
    }

    /// The true ranges over the floor on a body that tilts.
    fn draw_tilted(&mut self, scene: &Scene<'_>, tilt: &Tilt) {
        let (config, image) = (&self.config, &mut self.image);
        let mount = config.robot_from_lidar;
        let eye = tilt.place(Point3::new(mount.x_m, mount.y_m, config.height_m));
        let mount_yaw = nalgebra::Rotation2::new(mount.yaw_rad);
        self.rises.clear();
        self.rises.extend((0..config.beams).map(|beam| {
            let ahead = mount_yaw * image.direction(beam);
            let way = tilt.direction(Vector3::new(ahead.x, ahead.y, 0.0));
            let level = way.xy().norm();
            Rise { slope: way.z / level, stretch: level.recip() }
        }));
        let rises = &self.rises;
        let world_from_lidar =
            se2(scene.world_from_robot) * se2(Pose2 { x_m: eye.x, y_m: eye.y, yaw_rad: mount.yaw_rad });
        let lidar_from_world = world_from_lidar.inverse();
        let origin = Point::from(world_from_lidar.translation.vector);
        image.clear();
        let rise_m = rises.iter().fold(0.0, |most: f64, rise| most.max(rise.slope.abs())) * config.range_max_m;
        let heights_m = [eye.z - rise_m, eye.z + rise_m];
        scene.world.faces_in_sight(origin, heights_m, config.range_max_m, |a, b, [z0_m, z1_m]| {
            let meets = |beam: usize, inverse: f64| (z0_m..=z1_m).contains(&(eye.z + rises[beam].slope / inverse));
            image.draw_face_where(lidar_from_world * a, lidar_from_world * b, meets);
        });
        for (beam, rise) in rises.iter().enumerate().filter(|(_, rise)| rise.slope < 0.0) {
            image.put(beam, eye.z / -rise.slope);
        }
        self.draw_all_else(scene, &world_from_lidar);
    }

    /// The true ranges of a lidar that does not turn in the plane of the body: beam by beam, each with its own bearing.
    fn draw_pitched(&mut self, scene: &Scene<'_>) {
        let config = &self.config;
        let mount = config.robot_from_lidar;
        let eye = Point3::new(mount.x_m, mount.y_m, config.height_m);
        let eye = scene.tilt.map_or(eye, |tilt| tilt.place(eye));
        let mounted = Rotation3::from_euler_angles(0.0, config.pitch_rad, mount.yaw_rad);
        let world_from_robot = se2(scene.world_from_robot);
        let at = world_from_robot * eye.xy();
        let eye = Vector3::new(at.x, at.y, eye.z);
        self.rises.clear();
        self.image.clear();
        for beam in 0..config.beams {
            let angle_rad = config.angle_min_rad + beam as f64 * config.angle_increment_rad;
            let way = mounted * Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
            let way = scene.tilt.map_or(way, |tilt| tilt.direction(way));
            let over = world_from_robot.rotation * way.xy();
            if let Some(range_m) = scene.meets(&eye, &Vector3::new(over.x, over.y, way.z), config.range_max_m) {
                self.image.put(beam, range_m);
            }
        }
    }

    /// Floor plan and people.
    fn draw_all_else(&mut self, scene: &Scene<'_>, world_from_lidar: &Se2) {
        let (config, image) = (&self.config, &mut self.image);
        let lidar_from_world = world_from_lidar.inverse();
        let origin = Point::from(world_from_lidar.translation.vector);
        if let Some(map) = scene.world.map() {
            for beam in 0..config.beams {
                let direction = world_from_lidar.rotation * image.direction(beam);
                if let Some(range_m) = map.cast(origin, direction, config.range_max_m) {
                    image.put(beam, range_m);
                }
            }
        }
        if config.height_m <= PERSON_HEIGHT_M {
            for (center, radius_m) in scene.bodies() {
                image.draw_disc(lidar_from_world * center, radius_m);
            }
        }
    }

    /// What the lidar says of a true range. A hit stays a hit, whatever the noise on it.
    fn reading(&self, truth_m: Option<f64>, noise_m: f64) -> f32 {
        match truth_m {
            None => f32::INFINITY,
            Some(range_m) if range_m < self.config.range_min_m => f32::NAN,
            Some(range_m) => {
                let (min, max) = (self.config.range_min_m as f32, self.config.range_max_m as f32);
                ((range_m + noise_m) as f32).clamp(min.next_up(), max.next_down())
            }
        }
    }
}
