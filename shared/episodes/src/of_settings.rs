//! Episodes of a configured robot.

use guidance::{Delta, HarnessError, Interaction, RewardConfig};
use messages::CueKind;
use settings::{Profile, Settings, Source};
use world::{Bodies, DepthConfig, GeneratorConfig, LegsConfig, LidarConfig, OdometryConfig, PhysicsConfig};

use crate::config::{Arrival, Config, Handlers, Harness, Noise, Places, RewardMeasure};

/// Pixels of the camera of episodes: enough to learn from, and to tell a thing of 8 cm from the floor. Its place and
/// field of view are those of the settings.
const DEPTH_WIDTH: usize = 128;
const DEPTH_HEIGHT: usize = 64;
/// What costs what is taught by: a metre is worth 1.
const MOTION_PENALTY: f64 = 0.02;

impl Config {
    /// Episodes of the robot, sensors, handler and shield of these settings, in generated worlds with noisy sensors and
    /// handlers of all kinds.
    ///
    /// # Errors
    /// Where the handler's parameters are no handler's.
    pub fn of(settings: &Settings) -> Result<Self, HarnessError> {
        let interaction = settings.interaction()?;
        let depth = DepthConfig { width: DEPTH_WIDTH, height: DEPTH_HEIGHT, ..DepthConfig::from(&settings.depth) };
        Ok(Self {
            places: Places::Generated(GeneratorConfig::default()),
            arrival: Arrival::SPARSE,
            noise: Noise::Noisy,
            harness: Harness::Delayed,
            handlers: Handlers::Personal,
            robot_from_handler: guidance::se2::pose2(&interaction.robot_from_default()),
            alpha: settings.handler.alpha.get(),
            bodies: Bodies::from(&PhysicsConfig::from(settings)),
            awareness: settings.awareness_config(),
            table: settings.policy.actions.table(),
            dt_s: settings.policy.dt.s(),
            decisions: 100,
            has_time: false,
            cues: vec![(CueKind::Forward, 0.3), (CueKind::Left, 0.35), (CueKind::Right, 0.35)],
            orientation_max_rad: 30f64.to_radians(),
            timing_max_m: None,
            walked_before: 0.0,
            reward: RewardConfig {
                delta: Delta::Difference,
                motion_penalty: MOTION_PENALTY,
                ..RewardConfig::default()
            },
            followed_reward: 0.0,
            forbidden_penalty: 0.0,
            measure: RewardMeasure::Line,
            shield: settings.shield_config(),
            lidar: LidarConfig::from(&settings.lidar),
            depth: (settings.depth.source != Source::Absent).then_some(depth),
            odometry: OdometryConfig::from(&settings.odometry),
            legs: LegsConfig::from(&settings.robot),
            judges: true,
            frames: 1,
        })
    }
}

impl Config {
    /// Those of the built-in profile of a Go2, which walks on legs.
    #[must_use]
    pub fn go2() -> Self {
        let settings =
            settings::load(Profile::Go2, None).unwrap_or_else(|error| unreachable!("it is built in: {error}"));
        let config = Self::of(&settings).unwrap_or_else(|_| unreachable!("its handler is the default one"));
        Self { noise: Noise::Legged, ..config }
    }
}

/// Those of the default settings.
impl Default for Config {
    fn default() -> Self {
        Self::of(&Settings::default()).unwrap_or_else(|_| unreachable!("the default handler is one"))
    }
}
