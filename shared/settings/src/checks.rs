//! What no single key can say: values that do not go together, or are like no robot, handler or device.

mod lidar;
mod voice;

use messages::topic::{AgeLimit, TOPICS};
use messages::{Formation, ServiceId};

use crate::devices::{DeviceRow, either};
use crate::sections::{
    AttitudeSource, DepthDevice, DepthSettings, EstopSource, LidarDevice, LinkKind, LinkRow, OdometryDevice, Origin,
    Robot, Settings, Source,
};
use crate::units::Millis;

pub use voice::{check_tone, no_start_by_voice};

/// The least depth images a second that an attitude may come from. One holds for 100 ms: the period of the images, the
/// camera's latency and the period of the poses together.
const ATTITUDE_HZ: f64 = 30.0;
/// In single file the robot walks at this share of its speed at the least: legs do not follow a slower command.
const BEHIND_SPEED_MIN: f64 = 0.3;

/// Whether the settings go together.
///
/// # Errors
/// Where values do not go together or are out of their bounds; the reason begins with the key.
pub fn check(settings: &Settings) -> Result<(), String> {
    let depth = &settings.depth;
    lidar::check(settings)?;
    if depth.field_of_view_deg.get() >= 170.0 {
        return Err("depth.field_of_view_deg is 170 or over".to_owned());
    }
    if depth.width == 0 || depth.width > 1280 || depth.height == 0 || depth.height > 720 {
        return Err(format!(
            "depth.width x depth.height = {}x{} is not within 1x1..1280x720",
            depth.width, depth.height
        ));
    }
    let [near, far] = depth.range_m;
    if !(near > 0.0 && near < far && far <= 65.0) {
        return Err("depth.range_m is not [near, far] with 0 < near < far <= 65".to_owned());
    }
    check_rates(settings)?;
    check_bounds(settings)?;
    check_ages(settings)?;
    if !(0.0..=0.5).contains(&settings.shield.margin_m) {
        return Err(format!("shield.margin_m = {} is not in 0..0.5", settings.shield.margin_m));
    }
    check_rows(settings)?;
    check_devices(settings)?;
    check_depth_device(depth, settings.commands_robot())?;
    voice::check(&settings.cue)?;
    if depth.needed && depth.source == Source::Absent {
        return Err("depth.needed, but depth.source = \"absent\"".to_owned());
    }
    let dt_ns = settings.policy.dt.ns();
    if dt_ns < 50_000_000 || !dt_ns.is_multiple_of(messages::QUANTUM_NS) {
        return Err("policy.dt is not a multiple of 10ms from 50ms".to_owned());
    }
    settings.interaction().map_err(|error| format!("[handler]: {error}"))?;
    settings.interaction_in(Formation::Behind).map_err(|error| format!("[handler] behind_m: {error}"))?;
    let (behind_m, radius_m) = (settings.handler.behind_m.get(), settings.robot.radius_m.get());
    if behind_m < radius_m {
        return Err(format!("handler.behind_m = {behind_m} is within the robot, whose radius is {radius_m} m"));
    }
    let behind_speed = settings.handler.behind_speed.get();
    if behind_speed < BEHIND_SPEED_MIN {
        return Err(format!(
            "handler.behind_speed = {behind_speed} is less than {BEHIND_SPEED_MIN}: a robot would stand"
        ));
    }
    crate::planned::check(settings)?;
    crate::sections::check_speak(&settings.speak)?;
    if settings.supervision.restart_budget == 0 {
        return Err("supervision.restart_budget = 0 would lock the run at the first fault".to_owned());
    }
    Ok(())
}

/// A real robot walks by a response that was measured on it. A configuration alone may leave that open: `--emulated`
/// puts an emulated robot in its place, and `guidedog doctor` tells what is missing.
///
/// # Errors
/// Where it was not measured, and `robot.profile_unmeasured` is not set; the reason begins with the key.
pub fn check_origin(settings: &Settings) -> Result<(), String> {
    let (robot, link) = (&settings.robot, settings.locomotion.link.row().name);
    let origin = robot.response.origin;
    if !settings.commands_robot() || origin == Origin::Measured || robot.profile_unmeasured {
        return Ok(());
    }
    Err(format!(
        "robot.response.origin = \"{}\", and locomotion.link = \"{link}\" commands a real robot: measure how it \
         answers (guidedog fit-robot RECORDING), or, to walk without that, write robot.profile_unmeasured = true",
        origin.name()
    ))
}

/// A real robot starts only if its floor is watched, or if the configuration says `watched = false`. A configuration
/// alone may leave that open, as in [`check_origin`].
///
/// # Errors
/// Where nothing watches the floor, and `shield.floor.watched` is not false; the reason begins with the key.
pub fn check_floor(settings: &Settings) -> Result<(), String> {
    if !settings.commands_robot() || settings.watches_floor() || !settings.shield.floor.watched {
        return Ok(());
    }
    let why =
        if settings.depth.source == Source::Absent { "depth.source = \"absent\"" } else { "shield.memory.on = false" };
    Err(format!(
        "shield.floor.watched = true, but {why}: nothing watches the floor, and locomotion.link = \"{}\" commands a \
         real robot. It would walk over an edge. To walk without that, write [shield.floor] watched = false",
        settings.locomotion.link.row().name
    ))
}

/// The settings of each device and link, also where it is not in use.
fn check_rows(settings: &Settings) -> Result<(), String> {
    let Settings { lidar, depth, odometry, estop, locomotion, .. } = settings;
    LidarDevice::ALL.into_iter().try_for_each(|device| (device.row().check)(lidar))?;
    DepthDevice::ALL.into_iter().try_for_each(|device| (device.row().check)(depth))?;
    OdometryDevice::ALL.into_iter().try_for_each(|device| (device.row().check)(odometry))?;
    EstopSource::ALL.into_iter().try_for_each(|source| (source.row().check)(estop))?;
    LinkKind::ALL.into_iter().try_for_each(|link| (link.row().check)(locomotion))
}

/// A robot that is really there walks by sensors that are really there; one that is not is kept off the others' lines.
fn check_devices(settings: &Settings) -> Result<(), String> {
    let (lidar, odometry) = (settings.lidar.source, settings.odometry.source);
    let emulated = settings.simulation.emulated.on;
    let is_device = settings.locomotion.link.is_device();
    let own = odometry == Source::Device && settings.odometry.device == OdometryDevice::Robot;
    if own && !is_device {
        let links = link_names(|link| link.far_end.is_device());
        return Err(format!("odometry.source = \"device\" is the robot's own: locomotion.link has to be {links}"));
    }
    check_matching(settings)?;
    check_attitude(settings)?;
    if settings.commands_robot() {
        for (key, source) in settings.sources() {
            if source != Source::Device {
                return Err(format!(
                    "{key} is no device, and locomotion.link commands a real robot: it would walk blind"
                ));
            }
        }
    }
    if settings.cue.forward_when_ready && settings.commands_robot() {
        return Err(
            "cue.forward_when_ready would start a real robot by itself, and locomotion.link commands one".to_owned()
        );
    }
    if settings.odometry.t265.file.is_some() && settings.commands_robot() {
        return Err("odometry.t265.file is a recording, and locomotion.link commands a real robot".to_owned());
    }
    if emulated && (lidar, own, is_device) != (Source::Device, true, true) {
        let needed = "lidar.source and odometry.source \"device\" and a locomotion.link to a robot";
        return Err(format!("simulation.emulated.on needs {needed}"));
    }
    if emulated {
        check_emulated(settings)?;
    }
    let [warn, stop] = [settings.locomotion.charge_warn_percent, settings.locomotion.charge_stop_percent];
    if stop > warn || warn > 100 {
        return Err(format!("locomotion.charge_stop_percent = {stop} is not in 0..charge_warn_percent = {warn}..100"));
    }
    Ok(())
}

/// Only what is emulated can be a device in the simulated world.
fn check_emulated(settings: &Settings) -> Result<(), String> {
    fn has_emulator<S>(key: &str, row: &DeviceRow<S>) -> Result<(), String> {
        let refused = || format!("{key} = \"{}\" is not emulated, and simulation.emulated.on", row.name);
        row.emulated.map(|_| ()).ok_or_else(refused)
    }
    let mut robots = LinkKind::ALL.into_iter().filter_map(|link| link.row().emulated.as_ref());
    if let Some(key) = robots.find_map(|robot| (robot.elsewhere)(settings)) {
        return Err(format!("{key} is no emulated robot's address: it is not this machine"));
    }
    has_emulator("lidar.device", settings.lidar.device.row())?;
    has_emulator("odometry.device", settings.odometry.device.row())?;
    if settings.depth.source == Source::Device {
        has_emulator("depth.device", settings.depth.device.row())?;
    }
    if settings.estop.source != EstopSource::Absent {
        has_emulator("estop.source", settings.estop.source.row())?;
    }
    let link = settings.locomotion.link.row();
    if link.emulated.is_none() {
        let links = link_names(|link| link.emulated.is_some());
        return Err(format!("locomotion.link = \"{}\": only {links} are emulated", link.name));
    }
    Ok(())
}

/// The links for which that holds, as they stand in the file.
fn link_names(which: impl Fn(&LinkRow) -> bool) -> String {
    either(&LinkKind::names(which).map(|name| format!("{name:?}")).collect::<Vec<_>>())
}

/// A device of which nobody else tells what its frames are.
fn check_depth_device(depth: &DepthSettings, commands_robot: bool) -> Result<(), String> {
    if let Some(lens) = depth.intrinsics {
        lens.head(depth).check().map_err(|refused| format!("depth.intrinsics: {refused}"))?;
    }
    if depth.source != Source::Device {
        return Ok(());
    }
    if depth.device == DepthDevice::Realsense && depth.realsense.file.is_some() && commands_robot {
        return Err("depth.realsense.file is a recording, and locomotion.link commands a real robot".to_owned());
    }
    Ok(())
}

/// Scans correct the poses that this run makes, and no others.
fn check_matching(settings: &Settings) -> Result<(), String> {
    if !settings.matches_scans() {
        return Ok(());
    }
    if matches!(settings.odometry.source, Source::Replayed | Source::Absent) {
        return Err("odometry.matching.on needs odometry.source \"simulated\" or \"device\": poses that are replayed \
                    stay as they were recorded"
            .to_owned());
    }
    if settings.lidar.source == Source::Absent {
        return Err("odometry.matching.on needs a lidar, and lidar.source is \"absent\"".to_owned());
    }
    Ok(())
}

/// An attitude that depth images tell needs a camera, young images, and poses that this run makes.
fn check_attitude(settings: &Settings) -> Result<(), String> {
    if settings.odometry.attitude != AttitudeSource::Depth {
        return Ok(());
    }
    let refused = |why: &str| Err(format!("odometry.attitude = \"depth\" needs {why}"));
    if matches!(settings.odometry.source, Source::Replayed | Source::Absent) {
        return refused("odometry.source \"simulated\" or \"device\": poses that are replayed keep their attitude");
    }
    if matches!(settings.depth.source, Source::Replayed | Source::Absent) {
        return refused("depth.source \"simulated\" or \"device\": images of this robot, now");
    }
    if !settings.depth.needed {
        return refused("depth.needed = true: without images the attitude is unknown");
    }
    if settings.depth.rate_hz.get() < ATTITUDE_HZ {
        return refused("depth.rate_hz of 30 or more: an attitude holds for 100 ms");
    }
    Ok(())
}

/// Keys of the robot, their values, and the least and the greatest that they may be.
fn robot_bounds(robot: &Robot) -> [(&'static str, f64, f64, f64); 21] {
    let (response, gait) = (&robot.response, &robot.gait);
    [
        ("robot.radius_m", robot.radius_m.get(), 0.05, 2.0),
        ("robot.nose_m", robot.nose_m, 0.0, 1.0),
        ("robot.body_height_m", robot.body_height_m.get(), 0.05, 2.0),
        ("robot.response.overrun_m ahead", response.overrun_m[0], 0.0, 0.5),
        ("robot.response.overrun_m aside", response.overrun_m[1], 0.0, 0.5),
        ("robot.response.overrun_rad", response.overrun_rad, 0.0, 0.5),
        ("robot.response.lag", response.lag.s(), 0.0, 0.5),
        // Where it may be farther off, a robot that stands while it is to walk is not found within two seconds.
        ("robot.response.way_off_m", response.way_off_m.get(), 0.01, 0.25),
        ("robot.response.turn_off_rad", response.turn_off_rad.get(), 0.01, 0.60),
        ("robot.response.delay", response.delay.s(), 0.0, 0.5),
        ("robot.response.time_constant_s ahead", response.time_constant_s[0], 0.0, 2.0),
        ("robot.response.time_constant_s aside", response.time_constant_s[1], 0.0, 2.0),
        ("robot.response.time_constant_s of turns", response.time_constant_s[2], 0.0, 2.0),
        ("robot.gait.stride", gait.stride.s(), 0.1, 5.0),
        ("robot.gait.roll_rad", gait.roll_rad, 0.0, 0.2),
        ("robot.gait.pitch_rad", gait.pitch_rad, 0.0, 0.2),
        ("robot.gait.rise_m", gait.rise_m, 0.0, 0.1),
        ("robot.gait.sway_m", gait.sway_m, 0.0, 0.1),
        ("robot.gait.sway_rad", gait.sway_rad, 0.0, 0.2),
        ("robot.gait.lean_rad_per_mps", gait.lean_rad_per_mps, 0.0, 1.0),
        ("robot.gait.slip", gait.slip, 0.0, 0.5),
    ]
}

/// What no robot, handler or lidar is like.
fn check_bounds(settings: &Settings) -> Result<(), String> {
    let (limits, odometry, matching) = (&settings.locomotion.limits, &settings.odometry, &settings.odometry.matching);
    let mujoco = &settings.simulation.mujoco;
    let others = [
        ("handler.radius_m", settings.handler.radius_m.get(), 0.05, 2.0),
        ("handler.walks_on_s", settings.handler.walks_on_s, 0.0, 1.5),
        ("handler.seen_radius_m", settings.handler.seen_radius_m.get(), 0.05, settings.handler.radius_m.get()),
        // From the finest that a camera counts in to a centimetre.
        ("depth.gstreamer.unit_m", settings.depth.gstreamer.unit_m.get(), 1e-5, 0.01),
        ("depth.gstreamer.latency", settings.depth.gstreamer.latency.map_or(0.0, Millis::s), 0.0, 1.0),
        ("depth.redwood", settings.depth.redwood, 0.0, 10.0),
        ("depth.robot_from_camera.x_m", settings.depth.robot_from_camera.x_m, -3.0, 3.0),
        ("depth.robot_from_camera.y_m", settings.depth.robot_from_camera.y_m, -3.0, 3.0),
        ("depth.robot_from_camera.z_m", settings.depth.robot_from_camera.z_m, 0.0, 3.0),
        ("depth.robot_from_camera.yaw_rad", settings.depth.robot_from_camera.yaw_rad, -3.15, 3.15),
        ("depth.robot_from_camera.pitch_rad", settings.depth.robot_from_camera.pitch_rad, -1.6, 1.6),
        ("odometry.scale_sigma", odometry.scale_sigma, 0.0, 0.5),
        ("odometry.yaw_walk_rad_per_sqrt_m", odometry.yaw_walk_rad_per_sqrt_m, 0.0, 0.5),
        ("odometry.attitude_bias_deg", odometry.attitude_bias_deg, 0.0, 5.0),
        ("odometry.attitude_sigma_deg", odometry.attitude_sigma_deg, 0.0, 5.0),
        ("odometry.matching.place_sigma_m", matching.place_sigma_m.get(), 0.001, 1.0),
        ("odometry.matching.yaw_sigma_rad", matching.yaw_sigma_rad.get(), 0.001, 1.0),
        ("odometry.matching.turn_sigma_rad", matching.turn_sigma_rad.get(), 0.001, 1.0),
        // Locomotion takes what is more than 5 cm or 0.1 rad off in half a second for a contradiction.
        ("odometry.matching.feed_mps", matching.feed_mps.get(), 0.001, 0.08),
        ("odometry.matching.feed_radps", matching.feed_radps.get(), 0.001, 0.16),
        ("locomotion.limits.speed_mps", limits.speed_mps.get(), 0.05, 3.0),
        // More than Unitree's link can say.
        ("locomotion.limits.turn_radps", limits.turn_radps.get(), 0.05, 3.2),
        ("locomotion.limits.acceleration_mps2", limits.acceleration_mps2.get(), 0.1, 100.0),
        ("locomotion.limits.acceleration_radps2", limits.acceleration_radps2.get(), 0.1, 1000.0),
        ("simulation.handler_sway_m", settings.simulation.handler_sway_m, 0.0, 0.3),
        ("simulation.mujoco.mass_scale", mujoco.mass_scale, 0.5, 2.0),
        ("simulation.mujoco.friction", mujoco.friction, 0.1, 2.0),
        ("simulation.mujoco.handler_mass_kg", mujoco.handler_mass_kg, 20.0, 200.0),
        ("simulation.mujoco.handler_reaction", mujoco.handler_reaction.s(), 0.0, 2.0),
        ("simulation.mujoco.handler_acceleration_mps2", mujoco.handler_acceleration_mps2, 0.1, 10.0),
        ("shield.unknown_gap_m", settings.shield.unknown_gap_m.get(), 0.0, 1.0),
        ("shield.unseen_limit_m2", settings.shield.unseen_limit_m2.unwrap_or(1.0), 0.0, 100.0),
        ("shield.floor.edge_ahead_m", settings.shield.floor.edge_ahead_m, 0.0, 1.0),
        ("shield.floor.edge_beside_m", settings.shield.floor.edge_beside_m, 0.0, 1.0),
        ("shield.floor.step_max_m.down", settings.shield.floor.step_max_m.down, 0.0, 0.2),
        ("shield.floor.step_max_m.up", settings.shield.floor.step_max_m.up, 0.0, 0.2),
        ("shield.memory.drift", settings.shield.memory.drift.get(), 0.0, 0.5),
        // Who walks into the way comes nearer by a metre in this time.
        ("shield.memory.free", settings.shield.memory.free.s(), 0.0, 1.0),
        ("walk.errors.orientation_deg", settings.walk.errors.orientation_deg, -60.0, 60.0),
        ("walk.errors.timing_m", settings.walk.errors.timing_m, -10.0, 10.0),
        ("supervision.memory_mib", f64::from(settings.supervision.memory_mib), 16.0, 1024.0),
        ("supervision.large_memory_mib", f64::from(settings.supervision.large_memory_mib), 64.0, 16384.0),
        ("supervision.open_files", f64::from(settings.supervision.open_files), 128.0, 65536.0),
        ("policy.swap.decisions", f64::from(settings.policy.swap.decisions), 1.0, 1000.0),
        ("policy.swap.probation", settings.policy.swap.probation.s(), 0.5, 3600.0),
        ("supervision.ready_within", settings.supervision.ready_within.s(), 1.0, 3600.0),
        ("supervision.step_limit", settings.supervision.step_limit.s(), 0.2, 3600.0),
    ];
    for (name, value, from, to) in robot_bounds(&settings.robot).into_iter().chain(others) {
        if !(from..=to).contains(&value) {
            return Err(format!("{name} = {value} is not in {from}..{to}"));
        }
    }
    Ok(())
}

fn check_rates(settings: &Settings) -> Result<(), String> {
    // A slower lidar leaves gaps longer than a permit lives; recorded logs may, with the null link.
    let slowest_lidar = if settings.lidar.source == Source::Replayed { 1.0 } else { 8.0 };
    let second = settings.lidar.second.as_ref().map(|second| ("lidar.second", second.rate_hz, slowest_lidar, 50.0));
    for (name, rate, from, to) in [
        ("lidar", settings.lidar.rate_hz, slowest_lidar, 50.0),
        ("depth", settings.depth.rate_hz, 1.0, 100.0),
        ("odometry", settings.odometry.rate_hz, 20.0, 100.0),
        ("locomotion", settings.locomotion.rate_hz, 20.0, 100.0),
    ]
    .into_iter()
    .chain(second)
    {
        if !(from..=to).contains(&rate.get()) {
            return Err(format!("{name}.rate_hz = {} is not in {from}..{to}", rate.get()));
        }
    }
    Ok(())
}

/// The promise that a stop never waits for longer than this is not the configuration's to give away; recorded logs move
/// no robot, and may be slower.
fn check_ages(settings: &Settings) -> Result<(), String> {
    let null = !settings.locomotion.link.is_obeyed();
    let recorded_ms = if null { 2000 } else { 0 };
    for spec in TOPICS {
        let AgeLimit::Configured { key, most_ms, .. } = spec.max_age else { continue };
        let is_recorded = spec.publishers.contains(&ServiceId::Replay);
        let most_ms = if is_recorded { most_ms.max(recorded_ms) } else { most_ms };
        if settings.max_age_ns(spec.id) > most_ms * 1_000_000 {
            return Err(format!("max_age.{key} is over {most_ms} ms"));
        }
    }
    let supervision = &settings.supervision;
    for (name, value, most_ms) in [
        ("locomotion.permit_life", settings.locomotion.permit_life, 200.max(recorded_ms)),
        ("supervision.beat_limit", supervision.beat_limit, 200),
        ("supervision.brake_limit", supervision.brake_limit, 200),
    ] {
        if value.ns() > most_ms * 1_000_000 {
            return Err(format!("{name} is over {most_ms} ms"));
        }
    }
    for (name, value) in [("beat_limit", supervision.beat_limit), ("brake_limit", supervision.brake_limit)] {
        if value.ns() < 60_000_000 {
            return Err(format!("supervision.{name} is under 60 ms: beats come every 20 ms"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{Settings, check, check_floor, check_origin};
    use crate::sections::PhysicsKind;

    #[test]
    fn what_would_give_the_stop_away_is_refused_with_its_key() {
        for (text, key) in [
            ("[lidar]\nrate_hz = 2.0\n", "lidar.rate_hz"),
            ("[lidar]\npitch_deg = 20.0\n", "lidar.pitch_deg"),
            ("[lidar.second]\nrate_hz = 2.0\n", "lidar.second.rate_hz"),
            ("[lidar.second]\nbeams = 3\n", "lidar.second.beams"),
            ("[lidar.second]\npitch_deg = 20.0\n[shield.memory]\non = false\n", "lidar.second.pitch_deg"),
            ("[lidar.second]\nsource = \"absent\"\n", "lidar.second.source"),
            ("[lidar.second]\nrplidar = { baud = 0 }\n", "lidar.second.rplidar.baud"),
            ("[lidar.second]\n[lidar.second.second]\n", "lidar.second.second"),
            ("[lidar]\nsource = \"device\"\n[lidar.second]\nsource = \"device\"\n", "lidar.second.rplidar.port"),
            ("[locomotion]\nrate_hz = 1.0\n", "locomotion.rate_hz"),
            ("[locomotion]\npermit_life = \"5s\"\n", "locomotion.permit_life"),
            ("[max_age]\nscan = \"10s\"\n", "max_age.scan"),
            ("[supervision]\nbrake_limit = \"1h\"\n", "supervision.brake_limit"),
            ("[supervision]\nbeat_limit = \"1ms\"\n", "supervision.beat_limit"),
            ("[shield]\nmargin_m = -0.1\n", "shield.margin_m"),
            ("[handler]\nalpha = 1.0\n", "[handler]"),
            ("[handler]\nbehind_speed = 0.0\n", "handler.behind_speed"),
            ("[handler]\nbehind_speed = 0.29\n", "handler.behind_speed = 0.29 is less than 0.3"),
        ] {
            let settings: Settings = toml::from_str(text).expect("each key by itself is right");
            assert!(check(&settings).is_err_and(|why| why.contains(key)), "{text}");
        }
    }

    #[test]
    fn a_real_robot_walks_by_real_sensors_and_an_emulated_one_is_at_this_machine() {
        let real = "[locomotion]\nlink = \"unitree\"\n[odometry]\nsource = \"device\"\n";
        let emulated = format!("{real}[lidar]\nsource = \"device\"\n[simulation.emulated]\non = true\n");
        let elsewhere = format!("{emulated}[locomotion.unitree]\nrobot = \"192.168.123.220:8082\"\n");
        for (text, key) in [
            (real, "lidar.source"),
            (&format!("{real}[lidar]\nsource = \"device\"\n"), "depth.source"),
            ("[odometry]\nsource = \"device\"\n", "odometry.source"),
            ("[odometry]\nsource = \"replayed\"\n[odometry.matching]\non = true\n", "odometry.matching.on"),
            ("[lidar]\nsource = \"absent\"\n[odometry.matching]\non = true\n", "odometry.matching.on"),
            ("[odometry]\nsource = \"replayed\"\nattitude = \"depth\"\n", "odometry.attitude"),
            ("[depth]\nrate_hz = 15\n[odometry]\nattitude = \"depth\"\n", "odometry.attitude"),
            ("[depth]\nsource = \"absent\"\nneeded = false\n[odometry]\nattitude = \"depth\"\n", "odometry.attitude"),
            ("[depth]\nrate_hz = 30\nneeded = false\n[odometry]\nattitude = \"depth\"\n", "odometry.attitude"),
            ("[simulation.emulated]\non = true\n", "simulation.emulated.on"),
            (&elsewhere, "locomotion.unitree.robot"),
            ("[locomotion]\ncharge_stop_percent = 30\n", "locomotion.charge_stop_percent"),
            (&format!("{emulated}[estop]\nsource = \"input\"\n"), "estop.source"),
            (&format!("{emulated}[depth]\nsource = \"device\"\ndevice = \"realsense\"\n"), "depth.device"),
            ("[max_age]\nestop = \"1s\"\n", "max_age.estop"),
            ("[estop.input]\nkey = 1000\n", "estop.input.key"),
            ("[estop.input]\nheld = true\n", "estop.input.held"),
            ("[estop.serial]\nbaud = 0\n", "estop.serial.baud"),
            ("[lidar.rplidar]\nbaud = 0\n", "lidar.rplidar.baud"),
            ("[lidar.rplidar]\nbaud = 12345678\n", "lidar.rplidar.baud"),
            ("[lidar.rplidar]\nmotor_rpm = 0\n", "lidar.rplidar.motor_rpm"),
            ("[lidar.rplidar]\nmode = \"\"\n", "lidar.rplidar.mode"),
        ] {
            let settings: Settings = toml::from_str(text).expect("each key by itself is right");
            let why = check(&settings).expect_err(text);
            assert!(why.starts_with(key), "{text}: {why}");
        }
        let settings: Settings = toml::from_str(&emulated).expect("it is right");
        assert_eq!(check(&settings), Ok(()));
        for physics in [PhysicsKind::Flat, PhysicsKind::Mujoco] {
            let mut by_flag = Settings::default();
            by_flag.simulation.physics = physics;
            by_flag.emulate();
            assert_eq!(check(&by_flag), Ok(()));
        }
    }

    #[test]
    fn a_real_robot_walks_by_a_measured_response_or_by_a_word_of_its_own() {
        let real = "[lidar]\nsource = \"device\"\n[depth]\nsource = \"device\"\n[odometry]\nsource = \"device\"\n";
        let origin = |link: &str, robot: &str, more: &str| {
            let text = format!("{real}[locomotion]\nlink = \"{link}\"\n{more}{robot}");
            let settings: Settings = toml::from_str(&text).expect("each key by itself is right");
            assert_eq!(check(&settings), Ok(()), "a configuration may leave it open: {text}");
            check_origin(&settings)
        };
        let of = |name: &str| format!("[robot.response]\norigin = \"{name}\"\n");
        for link in ["unitree", "go2", "ros2"] {
            for (robot, name) in
                [(String::new(), "assumed"), (of("assumed"), "assumed"), (of("simulated"), "simulated")]
            {
                let why = origin(link, &robot, "").expect_err(link);
                assert!(why.starts_with(&format!("robot.response.origin = \"{name}\"")), "{why}");
                for what in [link, "guidedog fit-robot RECORDING", "robot.profile_unmeasured = true"] {
                    assert!(why.contains(what), "{why}");
                }
                let by_hand = format!("[robot]\nprofile_unmeasured = true\n{robot}");
                assert_eq!(origin(link, &by_hand, ""), Ok(()));
                assert!(origin(link, &by_hand.replace("true", "false"), "").is_err());
                assert_eq!(origin(link, &robot, "[simulation.emulated]\non = true\n"), Ok(()), "it is emulated");
            }
            assert_eq!(origin(link, &of("measured"), ""), Ok(()));
        }
        assert_eq!(check_origin(&Settings::default()), Ok(()), "the simulated robot");
        assert!(toml::from_str::<Settings>(&of("guessed")).is_err_and(|error| error.to_string().contains("line 2")));
    }

    #[test]
    fn a_real_robot_walks_where_the_floor_is_watched_or_by_a_word_of_its_own() {
        let real = "[lidar]\nsource = \"device\"\n[odometry]\nsource = \"device\"\n[locomotion]\nlink = \"go2\"\n";
        let blind = "[depth]\nsource = \"absent\"\nneeded = false\n";
        let floor = |text: &str| {
            let settings: Settings = toml::from_str(&format!("{real}{text}")).expect("each key by itself is right");
            check_floor(&settings)
        };
        let why = floor(blind).expect_err("no camera");
        assert!(why.starts_with("shield.floor.watched = true") && why.contains("depth.source = \"absent\""), "{why}");
        assert_eq!(floor(&format!("{blind}[shield.floor]\nwatched = false\n")), Ok(()), "written by hand");
        assert_eq!(floor(&format!("{blind}[simulation.emulated]\non = true\n")), Ok(()), "it is emulated");
        let sees = "[depth]\nsource = \"device\"\n";
        assert_eq!(floor(sees), Ok(()));
        assert!(floor(&format!("{sees}[shield.memory]\non = false\n")).is_err_and(|why| why.contains("memory.on")));
        assert_eq!(check_floor(&Settings::default()), Ok(()), "the simulated robot");
    }

    #[test]
    fn nothing_but_handler_and_operator_starts_a_real_robot() {
        let real = "[lidar]\nsource = \"device\"\n[depth]\nsource = \"device\"\n[odometry]\nsource = \"device\"\n\
                    [locomotion]\nlink = \"unitree\"\n";
        let planned = |ask: &str| format!("[[planned]]\nat = \"1s\"\nask = {{ {ask} }}\n");
        for (more, key) in [
            ("[cue]\nforward_when_ready = true\n".to_owned(), "cue.forward_when_ready"),
            (planned("verb = \"cue\", cue = \"forward\""), "planned[0]"),
            (planned("verb = \"resume\""), "planned[0]"),
        ] {
            let of = |text: &str| check(&toml::from_str::<Settings>(text).expect("each key by itself is right"));
            assert_eq!(of(&more), Ok(()), "in simulation");
            assert!(of(&format!("{real}{more}")).is_err_and(|why| why.starts_with(key)), "{more}");
        }
        let stop = format!("{real}{}", planned("verb = \"stop\""));
        assert_eq!(check(&toml::from_str::<Settings>(&stop).expect("right")), Ok(()));
    }

    #[test]
    fn a_pipeline_has_its_lens_from_here_and_a_file_moves_no_robot() {
        let gstreamer = "[depth]\nsource = \"device\"\ndevice = \"gstreamer\"\n[depth.gstreamer]\n";
        let lens =
            |fx: &str| format!("[depth.intrinsics]\nfx_px = {fx}\nfy_px = 380.0\ncx_px = 320.0\ncy_px = 240.0\n");
        let real = "[lidar]\nsource = \"device\"\n[odometry]\nsource = \"device\"\n[locomotion]\nlink = \"unitree\"\n";
        let file = "[depth]\nsource = \"device\"\ndevice = \"realsense\"\n[depth.realsense]\nfile = \"x.db3\"\n";
        let depth = "[depth]\nsource = \"device\"\n";
        let check_of = |text: &str| check(&toml::from_str::<Settings>(text).expect("each key by itself is right"));
        for (text, key) in [
            (gstreamer.to_owned(), "depth.gstreamer.pipeline"),
            (format!("{gstreamer}pipeline = \"x\"\n"), "depth.intrinsics"),
            (format!("{gstreamer}pipeline = \"x\"\n{}", lens("0.0")), "depth.intrinsics: a frame with focal lengths 0"),
            (lens("nan"), "depth.intrinsics"),
            ("[depth.gstreamer]\nunit_m = 1.0\n".to_owned(), "depth.gstreamer.unit_m = 1"),
            ("[depth.gstreamer]\nlatency = \"2s\"\n".to_owned(), "depth.gstreamer.latency = 2"),
            (format!("{real}{file}"), "depth.realsense.file"),
            (format!("{real}{depth}[odometry.t265]\nfile = \"x.bag\"\n"), "odometry.t265.file"),
        ] {
            let why = check_of(&text).expect_err(&text);
            assert!(why.starts_with(key), "{text}: {why}");
        }
        for text in [format!("{gstreamer}pipeline = \"x\"\n{}", lens("380.0")), file.to_owned()] {
            assert_eq!(check_of(&text), Ok(()));
        }
        let lacking = toml::from_str::<Settings>("[depth.intrinsics]\nfx_px = 1.0\n").expect_err("three are missing");
        assert!(lacking.to_string().contains("fy_px"), "{lacking}");
    }
}
