//! How a Go2 answers commands on open floor: `gait soft|stiff` prints a line of CSV for each 20 ms, and on the standard
//! error what becomes of each command: speed, sway, overrun after zero, and the time until the feet are planted.

use std::path::Path;

use guidedog_mujoco::legs::{Legs, VelocityLoop, attitude};
use guidedog_mujoco::robot;
use guidedog_mujoco::scene::{self, STEP_S, Scene};
use messages::{Pose2, Twist2};
use mujoco_rs::prelude::*;
use nalgebra::Vector2;
use world::World;

const LEGS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/legs/go2");
/// Steps of the physics between two lines: 20 ms.
const LINE_STEPS: u64 = 8;
/// Seconds of each command, and of the zero after it.
const ASKED_S: f64 = 6.0;
const ZERO_S: f64 = 4.0;

/// What is asked in turn: the actions of the eight-action table at their speeds.
const ASKED: [(&str, Twist2); 6] = [
    ("forward", Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.0 }),
    ("left", Twist2 { vx_mps: 0.0, vy_mps: 0.3, wz_radps: 0.0 }),
    ("right", Twist2 { vx_mps: 0.0, vy_mps: -0.3, wz_radps: 0.0 }),
    ("turn left", Twist2 { vx_mps: 0.0, vy_mps: 0.0, wz_radps: 0.349 }),
    ("turn right", Twist2 { vx_mps: 0.0, vy_mps: 0.0, wz_radps: -0.349 }),
    ("diagonal left", Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.349 }),
];

/// The body at one moment: seconds, place on the floor and height, metres, roll, pitch and yaw, radians.
#[derive(Debug, Clone, Copy)]
struct Moment {
    t_s: f64,
    place: Vector2<f64>,
    height_m: f64,
    roll_rad: f64,
    pitch_rad: f64,
    yaw_rad: f64,
    stands: bool,
}

struct Robot {
    data: MjData<Box<MjModel>>,
    legs: Legs,
    steps: u64,
}

impl Robot {
    fn moment(&self) -> Moment {
        let ((roll_rad, pitch_rad, yaw_rad), q) = (attitude(&self.data).euler_angles(), self.data.qpos());
        let t_s = self.steps as f64 * STEP_S;
        let (place, height_m) = (Vector2::new(q[0], q[1]), q[2]);
        Moment { t_s, place, height_m, roll_rad, pitch_rad, yaw_rad, stands: self.legs.stands() }
    }

    /// Obeys a command for so long: what came of it, line by line.
    fn obey(&mut self, command: Twist2, seconds: f64) -> Result<Vec<Moment>, Box<dyn std::error::Error>> {
        let mut moments = Vec::new();
        for _ in 0..(seconds / STEP_S) as u64 {
            self.legs.drive(&mut self.data, command)?;
            scene::step(&mut self.data)?;
            self.steps += 1;
            if self.steps.is_multiple_of(LINE_STEPS) {
                moments.push(self.moment());
                print_line(&command, moments.last().ok_or("no line")?);
            }
        }
        Ok(moments)
    }
}

fn print_line(command: &Twist2, now: &Moment) {
    println!(
        "{:.2},{},{},{},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{}",
        now.t_s,
        command.vx_mps,
        command.vy_mps,
        command.wz_radps,
        now.place.x,
        now.place.y,
        now.height_m,
        now.roll_rad,
        now.pitch_rad,
        now.yaw_rad,
        u8::from(now.stands)
    );
}

/// Least and greatest of something, in degrees or in its own unit.
fn ends(moments: &[Moment], of: impl Fn(&Moment) -> f64) -> (f64, f64) {
    moments.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

fn tell(name: &str, walked: &[Moment], after: &[Moment]) {
    // The first two seconds are those of setting off.
    let steady = &walked[walked.len() / 3..];
    let (from, to) = (&steady[0], &steady[steady.len() - 1]);
    let took_s = to.t_s - from.t_s;
    let middle_rad = f64::midpoint(from.yaw_rad, to.yaw_rad);
    let speed = nalgebra::Rotation2::new(-middle_rad) * (to.place - from.place) / took_s;
    let zero = &after[0];
    let back = nalgebra::Rotation2::new(-to.yaw_rad) * (after[after.len() - 1].place - to.place);
    let stands = after.iter().find(|now| now.stands).map(|now| now.t_s - zero.t_s);
    let ((roll_low, roll_high), (pitch_low, pitch_high)) =
        (ends(steady, |now| now.roll_rad.to_degrees()), ends(steady, |now| now.pitch_rad.to_degrees()));
    let (low_m, high_m) = ends(steady, |now| now.height_m);
    let turns = (to.yaw_rad - from.yaw_rad) / took_s;
    let stands = stands.map_or("never".to_owned(), |s| format!("{s:.2} s"));
    eprintln!("{name}: {:.2} m/s ahead, {:.2} m/s to the left, {turns:.2} rad/s", speed.x, speed.y);
    eprintln!("  roll {roll_low:.1} to {roll_high:.1} deg, pitch {pitch_low:.1} to {pitch_high:.1} deg");
    eprintln!("  height {low_m:.3} to {high_m:.3} m");
    let turned_deg = (after[after.len() - 1].yaw_rad - to.yaw_rad).to_degrees();
    let [x_cm, y_cm] = [back.x, back.y].map(|m| m * 100.0);
    eprintln!("  after zero: {x_cm:.1} cm ahead, {y_cm:.1} cm to the left, {turned_deg:.1} deg; stands after {stands}");
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let keeps = match std::env::args().nth(1).as_deref() {
        Some("soft") => VelocityLoop::SOFT,
        Some("stiff") => VelocityLoop::STIFF,
        _ => return Err("gait soft|stiff".into()),
    };
    println!("t_s,asked_vx_mps,asked_vy_mps,asked_wz_radps,x_m,y_m,height_m,roll_rad,pitch_rad,yaw_rad,stands");
    for (name, asked) in ASKED {
        let world = World::new(2.6, Vec::new());
        let model = Scene {
            robot: &Path::new(LEGS).join("go2.xml"),
            world: &world,
            start: Pose2::default(),
            body_m: robot::Robot::go2().body_m,
            person: None,
        }
        .build()?;
        let legs = Legs::new(&model, &robot::Robot::go2(), &Path::new(LEGS).join("policy.onnx"), keeps)?;
        let mut data = MjData::new(Box::new(model));
        legs.pose(&mut data);
        let mut robot = Robot { data, legs, steps: 0 };
        robot.obey(Twist2::ZERO, 1.0)?;
        let walked = robot.obey(asked, ASKED_S)?;
        let after = robot.obey(Twist2::ZERO, ZERO_S)?;
        tell(name, &walked, &after);
    }
    Ok(())
}
