//! `bench depth`: how long one depth frame takes on one core: seen by a level body, by one that sways, and to find the
//! body's attitude.

use std::hint::black_box;
use std::time::Instant;

use guidance::{DepthView, Stance, Tilt};
use messages::{Attitude, DepthHeader, Pose2, Pose3};
use serde_json::{Value, json};
use world::{DepthConfig, DepthSensor, Hole, Prism, Scene, World};

use super::Percentiles;
use crate::exit::Failure;
use crate::out::{self, table};

/// Columns and rows of the cameras.
const SIZES: [(usize, usize); 3] = [(128, 64), (160, 120), (640, 480)];
/// Frames that take turns: no branch is foreseen by having seen the frame before.
const FRAMES: usize = 16;
const STANDING_M: f64 = 0.30;
/// Largest roll and pitch of a body that walks, radians.
const SWAY_RAD: f64 = 0.05;

/// A frame, and how the body was held.
pub(super) struct Frame {
    pub header: DepthHeader,
    pub pixels_mm: Vec<u16>,
    pub tilt: Tilt,
}

/// Metres that the robot goes on between two frames.
pub(super) const STEP_M: f64 = 0.1;

/// Frames of a corridor with a box in it, and with these holes in its floor.
pub(super) fn frames(width: usize, height: usize, holes: &[Hole]) -> Result<Vec<Frame>, Failure> {
    let wall = |y_m: f64| Prism::wall(vec![[-2.0, y_m].into(), [12.0, y_m].into()], [0.0, 2.6]);
    let thing = Prism::cuboid([3.0, 0.3].into(), [0.3, 0.3], 0.4, [0.0, 0.5]);
    let world = World::new(2.6, vec![wall(1.2), wall(-1.2), thing]).with_holes(holes.to_vec());
    let robot_from_camera = Pose3 { x_m: 0.28, z_m: 0.40, ..Pose3::default() };
    let config = DepthConfig { width, height, redwood: 1.0, robot_from_camera, ..DepthConfig::default() };
    let mut camera = DepthSensor::new(config, 1, 1).map_err(Failure::of_run)?;
    let frame = |i: usize| {
        let swings = i as f64 * 0.7;
        let [roll_rad, pitch_rad] = [swings.sin(), swings.cos()].map(|share| SWAY_RAD * share);
        let tilt = Tilt::of(&Attitude::at_height(1, roll_rad, pitch_rad, STANDING_M))?;
        let world_from_robot = Pose2::new(STEP_M * i as f64, 0.0, 0.0);
        let scene = Scene { world: &world, world_from_robot, tilt: Some(tilt), world_from_handler: None, walkers: &[] };
        let mut pixels_mm = vec![0; camera.pixels()];
        camera.render(&scene, i as u64, &mut pixels_mm);
        Some(Frame { header: camera.depth_header(), pixels_mm, tilt })
    };
    Ok((0..FRAMES).filter_map(frame).collect())
}

fn row((width, height): (usize, usize), times: u32) -> Result<Value, Failure> {
    let (frames, mut view, mut stance) = (frames(width, height, &[])?, DepthView::default(), Stance::default());
    let mut ns = [const { Vec::new() }; 3];
    for frame in frames.iter().cycle().take(times as usize) {
        let Frame { header, pixels_mm, tilt } = frame;
        let began = Instant::now();
        view.fill(header, pixels_mm).map_err(Failure::of_run)?;
        ns[0].push(began.elapsed().as_nanos() as u64);
        let began = Instant::now();
        view.fill_tilted(header, pixels_mm, Some(tilt)).map_err(Failure::of_run)?;
        ns[1].push(began.elapsed().as_nanos() as u64);
        let began = Instant::now();
        black_box(stance.attitude(header, pixels_mm, STANDING_M)).map_err(Failure::of_run)?;
        ns[2].push(began.elapsed().as_nanos() as u64);
    }
    let [level, swaying, attitude] =
        ns.map(|ns| Percentiles::of(ns).ok_or_else(|| Failure::run("nothing was measured")));
    let us = |of: &Percentiles| json!({ "n": of.n, "p50": of.p50_us, "p99": of.p99_us });
    Ok(json!({
        "width": width,
        "height": height,
        "level_us": us(&level?),
        "swaying_us": us(&swaying?),
        "attitude_us": us(&attitude?),
    }))
}

/// `guidedog bench depth`.
///
/// # Errors
/// Where a frame cannot be used, or the report cannot be written.
pub fn bench(times: u32, as_json: bool) -> Result<(), Failure> {
    let rows = SIZES.into_iter().map(|size| row(size, times)).collect::<Result<Vec<_>, _>>()?;
    out::tell(as_json, &json!({ "rows": rows }), || told(&rows))
}

fn told(rows: &[Value]) -> Vec<String> {
    let lines = rows.iter().map(|row| {
        let size = format!("{}x{}", out::number(row, "/width"), out::number(row, "/height"));
        let us =
            |what: &str| ["p50", "p99"].map(|share| format!("{:.0}", out::number(row, &format!("/{what}_us/{share}"))));
        [vec![size], us("level").to_vec(), us("swaying").to_vec(), us("attitude").to_vec()].concat()
    });
    let heads = ["pixels", "level us", "99 %", "swaying us", "99 %", "attitude us", "99 %"];
    let head =
        "one depth frame on one core: for a level body, for one that sways, and to find its attitude; microseconds";
    [vec![head.to_owned()], table(&heads, &lines.collect::<Vec<_>>())].concat()
}
