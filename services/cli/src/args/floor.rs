//! Arguments of `guidedog floor`.

use std::path::PathBuf;

use clap::Args;

/// A depth frame, and the camera that took it.
#[derive(Debug, Clone, Args)]
pub struct FloorArgs {
    /// A grey image of 16 bits a pixel (PGM or PNG): depth in millimetres, 0 where nothing was measured
    pub frame: PathBuf,
    /// Focal lengths and optical axis, pixels; without it, the configuration's lens or field of view
    #[arg(long, value_name = "FX,FY,CX,CY", value_parser = lens)]
    pub lens: Option<[f64; 4]>,
    /// Height of the camera over the floor, metres, in place of the configuration's
    #[arg(long, value_name = "M", value_parser = height)]
    pub height_m: Option<f64>,
    /// How far the camera looks down, degrees, in place of the configuration's
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = angle)]
    pub pitch_deg: Option<f64>,
    /// Roll of the body, degrees: its left side up
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = angle, default_value_t = 0.0)]
    pub roll_deg: f64,
    /// Estimate roll and pitch of the body from the frame, up to 12 degrees
    #[arg(long, conflicts_with = "roll_deg")]
    pub find: bool,
    /// Mount and lens of the camera
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

fn lens(text: &str) -> Result<[f64; 4], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let lens = numbers.and_then(|numbers| <[f64; 4]>::try_from(numbers).ok());
    lens.filter(|lens| lens.iter().all(|px| px.is_finite()) && lens[0] > 0.0 && lens[1] > 0.0)
        .ok_or_else(|| format!("{text} is no lens such as 518.0,519.0,325.5,253.5"))
}

fn height(text: &str) -> Result<f64, String> {
    let height_m = text.parse().ok().filter(|height_m| (0.05..=3.0).contains(height_m));
    height_m.ok_or_else(|| format!("{text} is no height from 0.05 to 3 m"))
}

fn angle(text: &str) -> Result<f64, String> {
    let angle_deg = text.parse().ok().filter(|angle_deg: &f64| angle_deg.abs() <= 85.0);
    angle_deg.ok_or_else(|| format!("{text} is no angle from -85 to 85 degrees"))
}

/// Examples of `guidedog floor --help`.
pub const HELP: &str = "\
Examples:
  guidedog floor frame.png --config robot.toml
  guidedog floor frame.pgm --lens 518,519,325.5,253.5 --height-m 1.1 --pitch-deg 25 --find

The picture is seen from above, 10 cm a character, the robot at the bottom and facing up: `.` floor that is seen,
`E` an edge beyond which the floor drops, `~` what lies beyond it, `s` a step down or up,
`#` an obstacle, ` ` what the camera does not see.
On standard output with --json: what was found, in the robot frame, metres.";
