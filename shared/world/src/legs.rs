//! How a legged robot moves and sways when it is told to walk: a simple model of the response and the gait that a
//! profile tells, for worlds in which nothing else makes the robot sway.
//!
//! A command takes effect after a delay, and the velocity follows it with a time constant for each axis; so a robot
//! overruns a stop. The body sways with its stride, with a slow wandering beside it, leans into a sidestep, and slips.
//! Steps may be of any length: the same model serves ticks of 10 ms and parts of a decision.

use std::f64::consts::TAU;

use messages::{Attitude, Twist2};
use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::ConfigError;
use crate::noise::{Source, generator};

/// At this speed the body sways as much as it ever does: m/s, and rad/s times [`ARM_M`].
const FULL_SWAY_MPS: f64 = 0.3;
/// So far from the body's middle a turn is as fast as a walk, metres.
const ARM_M: f64 = 0.8;
/// A standing body sways by this share of it.
const STANDING_SHARE: f64 = 0.1;
/// The sway comes and goes with this time constant, seconds.
const SWAY_S: f64 = 0.25;
/// Half of the sway's variance is the stride's, and half wanders with this time constant, seconds.
const WANDER_S: f64 = 1.0;
const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// A sine of this height has a standard deviation of 1.
const SINE: f64 = std::f64::consts::SQRT_2;
/// The slip wanders with this time constant, seconds.
const SLIP_S: f64 = 0.5;

/// A robot's response and gait, `[robot.response]` and `[robot.gait]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LegsConfig {
    /// A command takes effect after this, seconds.
    pub delay_s: f64,
    /// Time constants of the velocity ahead, aside and of turns, seconds.
    pub time_constant_s: [f64; 3],
    /// Period of a stride, seconds.
    pub stride_s: f64,
    /// Sway of a walking body, one standard deviation: roll and pitch, radians,
    pub roll_rad: f64,
    /// see `roll_rad`,
    pub pitch_rad: f64,
    /// and height, metres.
    pub rise_m: f64,
    /// Roll of a sidestep, radians for 1 m/s.
    pub lean_rad_per_mps: f64,
    /// Sway of the body's place to either side, one standard deviation, metres,
    pub sway_m: f64,
    /// and of its heading, radians.
    pub sway_rad: f64,
    /// Slip, one standard deviation, as a share of the speed.
    pub slip: f64,
    /// Height of the body's origin while it stands, metres.
    pub standing_m: f64,
}

impl LegsConfig {
    /// Refuses what no legs are like.
    ///
    /// # Errors
    /// Names the first key that is out of its bounds.
    pub fn validate(&self) -> Result<(), ConfigError> {
        ConfigError::check("legs.delay_s", self.delay_s, 0.0, 0.5)?;
        for constant_s in self.time_constant_s {
            ConfigError::check("legs.time_constant_s", constant_s, 0.0, 2.0)?;
        }
        ConfigError::check("legs.stride_s", self.stride_s, 0.1, 5.0)?;
        ConfigError::check("legs.roll_rad", self.roll_rad, 0.0, 0.2)?;
        ConfigError::check("legs.pitch_rad", self.pitch_rad, 0.0, 0.2)?;
        ConfigError::check("legs.rise_m", self.rise_m, 0.0, 0.1)?;
        ConfigError::check("legs.lean_rad_per_mps", self.lean_rad_per_mps, 0.0, 1.0)?;
        ConfigError::check("legs.sway_m", self.sway_m, 0.0, 0.1)?;
        ConfigError::check("legs.sway_rad", self.sway_rad, 0.0, 0.2)?;
        ConfigError::check("legs.slip", self.slip, 0.0, 0.5)?;
        ConfigError::check("legs.standing_m", self.standing_m, 0.05, 2.0)
    }
}

/// A number that wanders about 0 and forgets where it was.
#[derive(Debug, Clone, Copy, Default)]
struct Wander(f64);

impl Wander {
    /// With one standard deviation of 1, whatever the step.
    fn go(&mut self, dt_s: f64, constant_s: f64, normal: f64) {
        let kept = (-dt_s / constant_s).exp();
        self.0 = self.0 * kept + (1.0 - kept * kept).sqrt() * normal;
    }
}

/// Legs in motion.
#[derive(Debug, Clone)]
pub struct Legs {
    config: LegsConfig,
    seed: u64,
    steps: u64,
    /// The command in effect, and the next one with the seconds until it takes effect.
    command: Vector3<f64>,
    coming: Option<(f64, Vector3<f64>)>,
    /// Velocity ahead, to the left and of the turn, without sway and slip.
    velocity: Vector3<f64>,
    /// Of a stride, 0 to 1.
    phase: f64,
    /// 0 for a body that stands still, 1 for one that sways as much as it ever does.
    share: f64,
    roll: Wander,
    pitch: Wander,
    slip: [Wander; 3],
    /// The body beside its mean way: to the left, metres, and turned, radians.
    beside: [f64; 2],
}

impl Legs {
    /// Legs at rest, whose sway depends on `seed`.
    ///
    /// # Errors
    /// Where the configuration is out of its bounds.
    pub fn new(config: LegsConfig, seed: u64) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self {
            config,
            seed,
            steps: 0,
            command: Vector3::zeros(),
            coming: None,
            velocity: Vector3::zeros(),
            phase: 0.0,
            share: STANDING_SHARE,
            roll: Wander::default(),
            pitch: Wander::default(),
            slip: [Wander::default(); 3],
            beside: [0.0; 2],
        })
    }

    /// Lets `dt_s` seconds pass under a command: the mean velocity of the body in that time, robot frame.
    pub fn go(&mut self, command: Twist2, dt_s: f64) -> Twist2 {
        let asked = Vector3::new(command.vx_mps, command.vy_mps, command.wz_radps);
        let newest = self.coming.map_or(self.command, |(_, coming)| coming);
        if asked != newest {
            let left_s = self.coming.map_or(self.config.delay_s, |(left_s, _)| left_s);
            self.coming = Some((left_s, asked));
        }
        let mut way = Vector3::zeros();
        let mut left_s = dt_s;
        if let Some((until_s, coming)) = self.coming {
            let first_s = until_s.min(left_s);
            way += self.follow(first_s);
            left_s -= first_s;
            self.coming = Some((until_s - first_s, coming)).filter(|(until_s, _)| *until_s > 0.0);
            if self.coming.is_none() {
                self.command = coming;
            }
        }
        way += self.follow(left_s);
        self.sway(dt_s, way / dt_s)
    }

    /// Follows the command in effect for so long: the way and the turn.
    fn follow(&mut self, dt_s: f64) -> Vector3<f64> {
        let mut way = self.command * dt_s;
        for (axis, constant_s) in self.config.time_constant_s.into_iter().enumerate() {
            let off = self.velocity[axis] - self.command[axis];
            let kept = if constant_s > 0.0 { (-dt_s / constant_s).exp() } else { 0.0 };
            way[axis] += off * constant_s * (1.0 - kept);
            self.velocity[axis] = self.command[axis] + off * kept;
        }
        way
    }

    /// Adds sway and slip to a mean velocity.
    fn sway(&mut self, dt_s: f64, mean: Vector3<f64>) -> Twist2 {
        let mut random = generator(Source::Legs, self.seed, 0, self.steps);
        self.steps += 1;
        let mut normal = || StandardNormal.sample(&mut random);
        self.roll.go(dt_s, WANDER_S, normal());
        self.pitch.go(dt_s, WANDER_S, normal());
        self.slip.iter_mut().for_each(|slip| slip.go(dt_s, SLIP_S, normal()));
        let speed_mps = mean.xy().norm() + ARM_M * mean.z.abs();
        let target = (speed_mps / FULL_SWAY_MPS).clamp(STANDING_SHARE, 1.0);
        self.share += (target - self.share) * (1.0 - (-dt_s / SWAY_S).exp());
        self.phase = (self.phase + dt_s / self.config.stride_s).fract();
        let stride = SINE * self.share * (TAU * self.phase).sin();
        let before = std::mem::replace(&mut self.beside, [self.config.sway_m * stride, self.config.sway_rad * stride]);
        let [aside_mps, aside_radps] = [0, 1].map(|i| (self.beside[i] - before[i]) / dt_s);
        let slip = self.slip.map(|slip| self.config.slip * slip.0);
        Twist2 {
            vx_mps: mean.x + slip[0] * speed_mps,
            vy_mps: mean.y + slip[1] * speed_mps + aside_mps,
            wz_radps: mean.z + slip[2] * speed_mps / ARM_M + aside_radps,
        }
    }

    /// Something holds the robot: it goes no farther.
    pub fn halt(&mut self) {
        self.velocity.x = 0.0;
        self.velocity.y = 0.0;
    }

    /// How the body is held now; its stamp is left for the publisher, and is not 0.
    #[must_use]
    pub fn attitude(&self) -> Attitude {
        let config = &self.config;
        let (once, twice) = (TAU * self.phase, 2.0 * TAU * self.phase);
        let half = self.share * HALF;
        Attitude {
            stamp_ns: 1,
            roll_rad: config.roll_rad * half * (SINE * once.sin() + self.roll.0)
                + config.lean_rad_per_mps * self.velocity.y,
            pitch_rad: config.pitch_rad * half * (SINE * twice.sin() + self.pitch.0),
            height_m: config.standing_m + config.rise_m * self.share * SINE * twice.cos(),
            standing_m: config.standing_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Legs, LegsConfig};
    use messages::Twist2;

    const STEADY: LegsConfig = LegsConfig {
        delay_s: 0.04,
        time_constant_s: [0.12, 0.1, 0.2],
        stride_s: 0.48,
        roll_rad: 0.0,
        pitch_rad: 0.0,
        rise_m: 0.0,
        lean_rad_per_mps: 0.0,
        sway_m: 0.0,
        sway_rad: 0.0,
        slip: 0.0,
        standing_m: 0.3,
    };
    const ON: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.3, wz_radps: 0.35 };

    fn legs(config: &LegsConfig) -> Legs {
        Legs::new(config.clone(), 1).expect("legs")
    }

    /// The way ahead, to the left, and the turn.
    fn way(legs: &mut Legs, command: Twist2, seconds: f64, dt_s: f64) -> [f64; 3] {
        let mut way = [0.0; 3];
        for _ in 0..(seconds / dt_s).round() as usize {
            let twist = legs.go(command, dt_s);
            [twist.vx_mps, twist.vy_mps, twist.wz_radps]
                .into_iter()
                .zip(&mut way)
                .for_each(|(v, way)| *way += v * dt_s);
        }
        way
    }

    /// What is lost at the start is overrun at the end: speed times delay and time constant, for any step.
    #[test]
    fn a_stop_is_overrun_by_delay_and_time_constant_whatever_the_step() {
        for dt_s in [0.01, 0.1, 0.5] {
            let mut legs = legs(&STEADY);
            let begun = way(&mut legs, ON, 4.0, dt_s);
            let overrun = way(&mut legs, Twist2::ZERO, 4.0, dt_s);
            for ((speed, constant_s), (begun, overrun)) in
                [0.5, 0.3, 0.35].into_iter().zip(STEADY.time_constant_s).zip(begun.into_iter().zip(overrun))
            {
                let lag = speed * (STEADY.delay_s + constant_s);
                assert!((overrun - lag).abs() < 1e-6, "{overrun} {lag} at {dt_s}");
                assert!((speed * 4.0 - begun - lag).abs() < 1e-6, "{begun} at {dt_s}");
            }
        }
    }

    #[test]
    fn a_walking_body_sways_as_much_as_the_profile_says_and_a_standing_one_hardly() {
        let config = LegsConfig { roll_rad: 0.02, pitch_rad: 0.03, rise_m: 0.01, slip: 0.05, ..STEADY };
        let mut legs = legs(&config);
        let mut spread = |command: Twist2| {
            way(&mut legs, command, 3.0, 0.01);
            let mut squares = [0.0; 3];
            for _ in 0..20_000 {
                legs.go(command, 0.01);
                let held = legs.attitude();
                assert!(held.is_known() && held.is_usable());
                let off = [held.roll_rad, held.pitch_rad, held.height_m - 0.3];
                off.into_iter().zip(&mut squares).for_each(|(off, square)| *square += off * off / 20_000.0);
            }
            squares.map(f64::sqrt)
        };
        let walking = spread(Twist2 { vx_mps: 0.5, ..Twist2::ZERO });
        for (sigma, wanted) in walking.into_iter().zip([0.02, 0.03, 0.01]) {
            assert!((sigma / wanted - 1.0).abs() < 0.15, "{walking:?}");
        }
        let standing = spread(Twist2::ZERO);
        assert!(standing.into_iter().zip(walking).all(|(stands, walks)| stands < 0.2 * walks), "{standing:?}");
        let leans = LegsConfig { lean_rad_per_mps: 0.2, ..STEADY };
        let mut legs = super::Legs::new(leans, 1).expect("legs");
        way(&mut legs, Twist2 { vy_mps: 0.25, ..Twist2::ZERO }, 3.0, 0.01);
        assert!((legs.attitude().roll_rad - 0.05).abs() < 1e-9);
    }

    #[test]
    fn equal_seeds_sway_alike_and_others_do_not() {
        let config = LegsConfig { roll_rad: 0.02, slip: 0.05, ..STEADY };
        let walk = |seed: u64| {
            let mut legs = Legs::new(config.clone(), seed).expect("legs");
            (way(&mut legs, ON, 5.0, 0.01), legs.attitude())
        };
        assert_eq!(walk(1), walk(1));
        assert_ne!(walk(1), walk(2));
        assert!(Legs::new(LegsConfig { stride_s: 0.0, ..STEADY }, 1).is_err());
    }
}
