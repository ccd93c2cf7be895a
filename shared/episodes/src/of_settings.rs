//! Episodes of a configured robot.

use settings::Settings;
use world::{DepthConfig, LidarConfig};

use guidance::{HarnessError, Interaction};

use crate::config::Config;

impl Config {
    /// Episodes of the robot, sensors, handler and shield of these settings. The camera has its place and field of
    /// view, and fewer pixels.
    ///
    /// # Errors
    /// Where the handler's parameters are no handler's.
    pub fn of(settings: &Settings) -> Result<Self, HarnessError> {
        let default = Self::default();
        let interaction = settings.interaction()?;
        let camera = default.depth.as_ref().map(|small| DepthConfig {
            width: small.width,
            height: small.height,
            ..DepthConfig::from(&settings.depth)
        });
        let has_depth = settings.depth.source != settings::Source::Absent;
        Ok(Self {
            table: settings.policy.actions.table(),
            dt_s: settings.policy.dt.s(),
            robot_from_handler: guidance::se2::pose2(&interaction.robot_from_default()),
            alpha: settings.handler.alpha.get(),
            shield: settings.shield_config(),
            memory: settings.memory_config(),
            handler_limits: settings.handler_limits(),
            lidar: LidarConfig::from(&settings.lidar),
            depth: camera.filter(|_| has_depth),
            ..default
        })
    }
}
