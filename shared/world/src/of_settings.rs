//! The world and the sensors of a run, as its settings say.

use guidance::se2::pose2;
use guidance::{HandlerErrors, Interaction};
use settings::{DepthSettings, LidarSettings, OdometrySettings, Robot, Settings, SimulatedNoise, Walk};

use crate::{
    DepthConfig, HandlerConfig, LegsConfig, LidarConfig, OdometryConfig, PhysicsConfig, RobotConfig, Route, Scenario,
    WorldError,
};

/// The scenario of a run: a scenario file, or a map with a start; with a route file in place of its route, if given;
/// and the handler's errors in it.
///
/// # Errors
/// Where a file cannot be read or is wrong, or there is neither scenario nor map with start.
pub fn scenario_of(settings: &Settings) -> Result<Scenario, WorldError> {
    let walk = &settings.walk;
    let errors =
        HandlerErrors { orientation_rad: walk.errors.orientation_deg.to_radians(), timing_m: walk.errors.timing_m };
    Ok(without_errors(walk)?.with_errors(&errors))
}

fn without_errors(walk: &Walk) -> Result<Scenario, WorldError> {
    let route = walk.cues.as_deref().map(Route::load).transpose()?;
    if let Some(path) = &walk.scenario {
        let scenario = Scenario::load(path)?;
        return Ok(Scenario { route: route.unwrap_or(scenario.route.clone()), ..scenario });
    }
    match (&walk.map, walk.start) {
        (Some(map), Some(start)) => {
            let route = route.unwrap_or(Route { cues: Vec::new(), goal: None, time_limit_s: None });
            Ok(Scenario { world: map.clone().into(), start, route, disturbances: Vec::new() })
        }
        _ => Err(WorldError::NoScenario),
    }
}

impl From<&LidarSettings> for LidarConfig {
    fn from(lidar: &LidarSettings) -> Self {
        let span_rad = lidar.field_of_view_deg.get().to_radians();
        let whole_turn = lidar.field_of_view_deg.get() >= 360.0;
        // A whole turn has its last beam one step before the first; a sector has a beam at either end.
        let steps = if whole_turn { lidar.beams } else { lidar.beams - 1 };
        Self {
            beams: lidar.beams as usize,
            angle_min_rad: -span_rad / 2.0,
            angle_increment_rad: span_rad / f64::from(steps),
            range_min_m: lidar.range_min_m.get(),
            range_max_m: lidar.range_max_m.get(),
            sigma_m: lidar.sigma_m,
            drop_out: lidar.drop_out.get(),
            robot_from_lidar: lidar.robot_from_lidar,
            height_m: lidar.height_m.get(),
            pitch_rad: lidar.pitch_deg.to_radians(),
        }
    }
}

impl From<&DepthSettings> for DepthConfig {
    fn from(depth: &DepthSettings) -> Self {
        Self {
            width: depth.width as usize,
            height: depth.height as usize,
            hfov_rad: depth.field_of_view_deg.get().to_radians(),
            robot_from_camera: depth.robot_from_camera,
            range_min_m: depth.range_m[0],
            range_max_m: depth.range_m[1],
            redwood: depth.redwood,
            ..Self::default()
        }
    }
}

impl From<&OdometrySettings> for OdometryConfig {
    fn from(odometry: &OdometrySettings) -> Self {
        Self {
            scale_sigma: odometry.scale_sigma,
            yaw_walk_rad_per_sqrt_m: odometry.yaw_walk_rad_per_sqrt_m,
            attitude_bias_rad: odometry.attitude_bias_deg.to_radians(),
            attitude_sigma_rad: odometry.attitude_sigma_deg.to_radians(),
            ..Self::default()
        }
    }
}

impl From<&Robot> for LegsConfig {
    fn from(robot: &Robot) -> Self {
        let (response, gait) = (&robot.response, &robot.gait);
        Self {
            delay_s: response.delay.s(),
            time_constant_s: response.time_constant_s,
            stride_s: gait.stride.s(),
            roll_rad: gait.roll_rad,
            pitch_rad: gait.pitch_rad,
            rise_m: gait.rise_m,
            lean_rad_per_mps: gait.lean_rad_per_mps,
            sway_m: gait.sway_m,
            sway_rad: gait.sway_rad,
            slip: gait.slip,
            standing_m: robot.body_height_m.get(),
        }
    }
}

impl From<&Settings> for PhysicsConfig {
    fn from(settings: &Settings) -> Self {
        let (robot, handler) = (&settings.robot, &settings.handler);
        let limits = &settings.locomotion.limits;
        Self {
            robot: RobotConfig {
                radius_m: robot.radius_m.get(),
                nose_m: robot.nose_m,
                acceleration_mps2: limits.acceleration_mps2.get(),
                turn_acceleration_radps2: limits.acceleration_radps2.get(),
                ..RobotConfig::default()
            },
            handler: HandlerConfig {
                // Where the model says that they walk: a rod has a place of its own.
                robot_from_handler: settings
                    .interaction()
                    .map_or(handler.robot_from_handler, |model| pose2(&model.robot_from_default())),
                behind_m: handler.behind_m.get(),
                alpha: handler.alpha.get(),
                dt_s: settings.policy.dt.s(),
                radius_m: handler.radius_m.get(),
                sway_m: settings.simulation.handler_sway_m,
                ..HandlerConfig::default()
            },
            legs: (settings.simulation.noise == SimulatedNoise::Legged).then(|| LegsConfig::from(robot)),
            seed: settings.simulation.seed,
        }
    }
}
