//! Leg odometry: the true motion, with a scale error and a heading that wanders off.

use guidance::se2::{Se2, pose2, se2};
use messages::{Attitude, Pose2, Twist2};
use nalgebra::Vector2;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::noise::{Source, generator};

/// How far odometry is off. The default drifts by about 1 % of the way and 2 degrees in 10 m.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OdometryConfig {
    /// One standard deviation of the scale error, drawn once for each incarnation.
    pub scale_sigma: f64,
    /// Wandering of the heading with the way: one standard deviation after 1 m, radians; it grows with the way's root.
    pub yaw_walk_rad_per_sqrt_m: f64,
    /// Wandering of the heading with turning: one standard deviation after a turn of 1 rad, radians.
    pub yaw_walk_rad_per_sqrt_rad: f64,
    /// Error of roll and of pitch that lasts: drawn evenly up to this for each incarnation, radians.
    pub attitude_bias_rad: f64,
    /// Error of each reading of roll and pitch: one standard deviation, radians.
    pub attitude_sigma_rad: f64,
}

impl Default for OdometryConfig {
    fn default() -> Self {
        Self {
            scale_sigma: 0.01,
            yaw_walk_rad_per_sqrt_m: 0.011,
            yaw_walk_rad_per_sqrt_rad: 0.01,
            attitude_bias_rad: 0.0,
            attitude_sigma_rad: 0.0,
        }
    }
}

impl OdometryConfig {
    /// Refuses what no odometry is like.
    ///
    /// # Errors
    /// Names the first key that is out of its bounds.
    pub fn validate(&self) -> Result<(), ConfigError> {
        ConfigError::check("scale_sigma", self.scale_sigma, 0.0, 0.5)?;
        ConfigError::check("yaw_walk_rad_per_sqrt_m", self.yaw_walk_rad_per_sqrt_m, 0.0, 1.0)?;
        ConfigError::check("yaw_walk_rad_per_sqrt_rad", self.yaw_walk_rad_per_sqrt_rad, 0.0, 1.0)?;
        ConfigError::check("attitude_bias_rad", self.attitude_bias_rad, 0.0, 0.1)?;
        ConfigError::check("attitude_sigma_rad", self.attitude_sigma_rad, 0.0, 0.1)
    }
}

/// What odometry says at one moment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct OdometryReading {
    /// Pose of the robot in the odometry frame, whose origin is where this incarnation first looked.
    pub odom_from_robot: Pose2,
    /// Velocity in the robot frame.
    pub twist: Twist2,
    /// Standard deviations of x (m), y (m) and yaw (rad) gained since the frame began.
    pub sigma: [f64; 3],
}

/// Simulated odometry. A new incarnation begins a new frame.
#[derive(Debug, Clone)]
pub struct OdometrySensor {
    config: OdometryConfig,
    seed: u64,
    incarnation: u32,
    /// 1 plus the scale error.
    scale: f64,
    world_from_last: Option<Se2>,
    odom_from_robot: Se2,
    way_m: f64,
    yaw_variance: f64,
    /// Variance of the place that wandering headings have led to, square metres.
    place_variance: f64,
    /// Metre radians.
    place_yaw_covariance: f64,
}

impl OdometrySensor {
    /// Odometry whose errors depend on `seed` and `incarnation`.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds.
    pub fn new(config: OdometryConfig, seed: u64, incarnation: u32) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self::begin(config, seed, incarnation))
    }

    /// Begins anew, in another frame, as odometry of another seed.
    pub fn reseed(&mut self, seed: u64) {
        *self = Self::begin(self.config.clone(), seed, self.incarnation);
    }

    fn begin(config: OdometryConfig, seed: u64, incarnation: u32) -> Self {
        let error: f64 = StandardNormal.sample(&mut generator(Source::OdometryScale, seed, incarnation, 0));
        let scale = (1.0 + config.scale_sigma * error).max(0.1);
        Self {
            config,
            seed,
            incarnation,
            scale,
            world_from_last: None,
            odom_from_robot: Se2::identity(),
            way_m: 0.0,
            yaw_variance: 0.0,
            place_variance: 0.0,
            place_yaw_covariance: 0.0,
        }
    }

    /// Takes the true pose and velocity at tick number `tick` (counted by the world; the noise depends on it) and gives
    /// what odometry makes of it. The first call sets the frame's origin.
    pub fn update(&mut self, tick: u64, world_from_robot: Pose2, robot_twist: Twist2) -> OdometryReading {
        let world_from_robot = se2(world_from_robot);
        let last = self.world_from_last.replace(world_from_robot).unwrap_or(world_from_robot);
        let moved = last.inverse() * world_from_robot;
        let (way_m, turn) = (moved.translation.vector.norm(), moved.rotation.angle());
        let variance = self.config.yaw_walk_rad_per_sqrt_m.powi(2) * way_m
            + self.config.yaw_walk_rad_per_sqrt_rad.powi(2) * turn.abs();
        let normal: f64 = StandardNormal.sample(&mut generator(Source::Odometry, self.seed, self.incarnation, tick));
        let step: Vector2<f64> = moved.translation.vector * self.scale;
        // Normalised, so that rounding does not pile up over hours.
        let pose = pose2(&(self.odom_from_robot * Se2::new(step, turn + variance.sqrt() * normal)));
        self.odom_from_robot = se2(pose);
        self.way_m += way_m;
        // As on a straight way, where each bit of it goes off sideways by the heading's error.
        self.place_variance += way_m * (2.0 * self.place_yaw_covariance + way_m * self.yaw_variance);
        self.place_yaw_covariance += way_m * self.yaw_variance;
        self.yaw_variance += variance;
        OdometryReading { odom_from_robot: pose, twist: self.measured(robot_twist), sigma: self.sigma() }
    }

    /// What the robot's own sensors make of an attitude at tick number `tick`. One that is not known stays so.
    #[must_use]
    pub fn attitude(&self, tick: u64, truth: &Attitude) -> Attitude {
        let OdometryConfig { attitude_bias_rad, attitude_sigma_rad, .. } = self.config;
        if !truth.is_known() || (attitude_bias_rad == 0.0 && attitude_sigma_rad == 0.0) {
            return *truth;
        }
        let mut lasting = generator(Source::AttitudeBias, self.seed, self.incarnation, 0);
        let mut passing = generator(Source::Attitude, self.seed, self.incarnation, tick);
        let mut error_rad = || {
            let normal: f64 = StandardNormal.sample(&mut passing);
            attitude_bias_rad * (2.0 * lasting.random::<f64>() - 1.0) + attitude_sigma_rad * normal
        };
        let (roll_rad, pitch_rad) = (truth.roll_rad + error_rad(), truth.pitch_rad + error_rad());
        Attitude { roll_rad, pitch_rad, ..*truth }
    }

    fn measured(&self, twist: Twist2) -> Twist2 {
        Twist2 { vx_mps: twist.vx_mps * self.scale, vy_mps: twist.vy_mps * self.scale, wz_radps: twist.wz_radps }
    }

    fn sigma(&self) -> [f64; 3] {
        let scale_m = self.config.scale_sigma * self.way_m;
        let place_m = (scale_m * scale_m + self.place_variance).sqrt();
        [place_m, place_m, self.yaw_variance.sqrt()]
    }
}
