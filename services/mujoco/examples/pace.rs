//! How fast a Go2 walks straight on in MuJoCo, with a lidar and a depth camera cast from its swaying body:
//! `pace WORLD X Y YAW_DEG SECONDS`. Two runs print the same digest.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;
use std::time::{Duration, Instant};

use guidedog_mujoco::legs::{Legs, VelocityLoop, attitude};
use guidedog_mujoco::rays::Rays;
use guidedog_mujoco::robot::Robot;
use guidedog_mujoco::scene::{self, STEP_S, Scene};
use messages::{Pose2, Twist2};
use mujoco_rs::prelude::*;
use nalgebra::Vector3;
use world::World;

const LEGS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/legs/go2");
/// Steps of the physics between two scans at 10 Hz, and between two depth frames at 15 Hz or little less.
const SCAN_STEPS: u64 = 40;
const FRAME_STEPS: u64 = 27;
/// The camera's columns and rows, and half the angle of its columns, degrees.
const PIXELS: [u32; 2] = [160, 120];
const HALF_FOV_DEG: f64 = 43.5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [world, x_m, y_m, yaw_deg, seconds] = &args[..] else { return Err("pace WORLD X Y YAW_DEG SECONDS".into()) };
    let start = Pose2::new(x_m.parse()?, y_m.parse()?, yaw_deg.parse::<f64>()?.to_radians());
    let seconds: f64 = seconds.parse()?;
    let begun = Instant::now();
    let model = Scene {
        robot: &Path::new(LEGS).join("go2.xml"),
        world: &World::load(Path::new(world))?,
        start,
        body_m: Robot::go2().body_m,
        person: None,
    }
    .build()?;
    let mut legs = Legs::new(&model, &Robot::go2(), &Path::new(LEGS).join("policy.onnx"), VelocityLoop::SOFT)?;
    let mut data = MjData::new(Box::new(model));
    legs.pose(&mut data);
    let mut rays = Rays::new(&data, &[scene::SEEN], &[scene::PERSON]);
    println!("{} geoms that stand still, built in {:.1?}", rays.geoms(), begun.elapsed());
    let mut digest = DefaultHasher::new();
    let [mut physics, mut scans, mut frames] = [Duration::ZERO; 3];
    for step in 0..(seconds / STEP_S).round() as u64 {
        let begun = Instant::now();
        legs.drive(&mut data, Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 })?;
        scene::step(&mut data)?;
        physics += begun.elapsed();
        if step % SCAN_STEPS == 0 {
            scans += cast(&mut rays, &data, [0.1, 0.0, 0.11], &beams(), 12.0, &mut digest);
        }
        if step % FRAME_STEPS == 0 {
            frames += cast(&mut rays, &data, [0.25, 0.0, 0.15], &pixels(), 10.0, &mut digest);
        }
    }
    data.qpos().iter().for_each(|number| number.to_bits().hash(&mut digest));
    let way_m = (data.qpos()[0] - start.x_m).hypot(data.qpos()[1] - start.y_m);
    let whole = physics + scans + frames;
    println!("{seconds} s, {way_m:.2} m of way, in {whole:.1?}: {:.1} times real time", seconds / whole.as_secs_f64());
    println!("physics and policy {physics:.1?}, scans {scans:.1?}, depth frames {frames:.1?}");
    println!("digest {:016x}", digest.finish());
    if whole.as_secs_f64() > seconds {
        return Err("slower than real time".into());
    }
    if (way_m - 0.5 * seconds).abs() > 0.1 * 0.5 * seconds {
        return Err("it did not walk as fast as it was told".into());
    }
    Ok(())
}

/// Casts a ray along each way (body frame) from a place on the body, metres: how long that took.
fn cast(
    rays: &mut Rays,
    data: &MjData<Box<MjModel>>,
    at: [f64; 3],
    ways: &[Vector3<f64>],
    max_m: f64,
    digest: &mut DefaultHasher,
) -> Duration {
    let begun = Instant::now();
    let (attitude, body) = (attitude(data), Vector3::from_column_slice(&data.qpos()[..3]));
    let from = (body + attitude * Vector3::from(at)).into();
    for way in ways {
        rays.cast(&from, &(attitude * way).into(), max_m).map(f64::to_bits).hash(digest);
    }
    begun.elapsed()
}

fn beams() -> Vec<Vector3<f64>> {
    (0..360).map(|beam| f64::from(beam).to_radians()).map(|a| Vector3::new(a.cos(), a.sin(), 0.0)).collect()
}

fn pixels() -> Vec<Vector3<f64>> {
    let [width, height] = PIXELS;
    let focal_px = f64::from(width) / 2.0 / HALF_FOV_DEG.to_radians().tan();
    let off = |pixel: u32, count: u32| (f64::from(count - 1) / 2.0 - f64::from(pixel)) / focal_px;
    (0..height)
        .flat_map(|row| {
            (0..width).map(move |column| Vector3::new(1.0, off(column, width), off(row, height)).normalize())
        })
        .collect()
}
