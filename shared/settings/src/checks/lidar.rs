//! What no lidar is like, and what does not go together of two.

use crate::sections::{LidarSettings, PhysicsKind, Settings, Source};

/// Whether the lidars' settings go together.
///
/// # Errors
/// The reason begins with the key.
pub(super) fn check(settings: &Settings) -> Result<(), String> {
    check_lidar(&settings.lidar, "lidar")?;
    check_second(settings)
}

/// What no lidar is like.
fn check_lidar(lidar: &LidarSettings, key: &str) -> Result<(), String> {
    if lidar.beams < 8 || lidar.beams as usize > messages::MAX_BEAMS {
        return Err(format!("{key}.beams = {} is not in 8..{}", lidar.beams, messages::MAX_BEAMS));
    }
    if lidar.field_of_view_deg.get() > 360.0 {
        return Err(format!("{key}.field_of_view_deg is over 360"));
    }
    if lidar.range_min_m >= lidar.range_max_m {
        return Err(format!("{key}.range_min_m is not under {key}.range_max_m"));
    }
    if !(0.0..=guidance::scan::SIGMA_MAX_M).contains(&lidar.sigma_m) {
        return Err(format!("{key}.sigma_m = {} is not in 0..{}", lidar.sigma_m, guidance::scan::SIGMA_MAX_M));
    }
    // What lies beyond the range is not seen, and hulls reach as far as two metres and more.
    if lidar.range_max_m.get() < 3.0 {
        return Err(format!("{key}.range_max_m = {} is under 3", lidar.range_max_m.get()));
    }
    if !(-80.0..=80.0).contains(&lidar.pitch_deg) {
        return Err(format!("{key}.pitch_deg = {} is not in -80..80", lidar.pitch_deg));
    }
    Ok(())
}

/// The second lidar beside the first.
fn check_second(settings: &Settings) -> Result<(), String> {
    let lidar = &settings.lidar;
    if lidar.pitch_deg != 0.0 {
        return Err("lidar.pitch_deg is not 0: only the second lidar may look down".to_owned());
    }
    let Some(second) = &lidar.second else { return Ok(()) };
    check_lidar(second, "lidar.second")?;
    if second.second.is_some() {
        return Err("lidar.second.second: there are two lidars at most".to_owned());
    }
    if second.source == Source::Absent {
        return Err("lidar.second.source is \"absent\": leave [lidar.second] out".to_owned());
    }
    if (lidar.source, second.source) == (Source::Device, Source::Device) && lidar.rplidar.port == second.rplidar.port {
        let port = second.rplidar.port.display();
        return Err(format!("lidar.second.rplidar.port = \"{port}\" is the first lidar's"));
    }
    if second.source == Source::Simulated && settings.simulation.physics == PhysicsKind::Mujoco {
        return Err("lidar.second.source = \"simulated\" is of the flat world, not of physics = \"mujoco\"".to_owned());
    }
    if second.pitch_deg > 0.0 && !settings.shield.memory.on {
        return Err(
            "lidar.second.pitch_deg needs shield.memory.on: its plane passes over an edge before the robot is \
                    there"
                .to_owned(),
        );
    }
    if settings.simulation.emulated.on && second.source == Source::Device {
        return Err("lidar.second.source = \"device\" is not emulated, and simulation.emulated.on".to_owned());
    }
    (second.device.row().check)(second).map_err(|why| why.replacen("lidar.", "lidar.second.", 1))
}
