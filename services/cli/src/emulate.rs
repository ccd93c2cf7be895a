//! `emulate`: devices that are not there, as processes of their own.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

use emulators::{EmulatedRobot, EmulatedRos2, EmulatedRplidar, EmulatedSport, EmulatedUnitree, OpenFloor};
use rplidar::Model;
use serial::PseudoTerminal;
use settings::{DdsSettings, Millis, Ros2Settings, Settings};
use transport::monotonic_ns;
use unitree::{Profile, Silence};
use world::{LidarConfig, Scenario, Scene};

use crate::args::{DdsArgs, Device, EmulateArgs};
use crate::exit::Failure;
use crate::launch::Signals;
use crate::out::say;
use crate::prepare::scenario_file;

/// Between two looks at the line: short against a frame of any lidar but the fastest, which then come in twos.
const PAUSE: Duration = Duration::from_millis(1);

/// `guidedog emulate`
///
/// # Errors
/// Where the port cannot be made or the scenario is wrong.
pub fn emulate(args: &EmulateArgs) -> Result<(), Failure> {
    match &args.device {
        Device::Rplidar { port, model, scenario, duration } => rplidar(port, *model, scenario, *duration),
        Device::Unitree { profile, listen, silence, duration } => unitree(*profile, *listen, *silence, *duration),
        Device::Go2(dds) => {
            let robot = EmulatedSport::new(&network(dds), dds.silence).map_err(Failure::of_run)?;
            say(format!("a Go2 on DDS, domain {}; Ctrl-C ends it", dds.domain));
            walk(Box::new(robot), dds.duration)
        }
        Device::Ros2 { cmd_vel, odom, stamped, dds } => {
            let topics = Ros2Settings { cmd_vel: cmd_vel.clone(), odom: odom.clone(), stamped: *stamped };
            let robot = EmulatedRos2::new(&network(dds), &topics, dds.silence).map_err(Failure::of_run)?;
            say(format!("a robot of ROS 2 at {cmd_vel} on DDS, domain {}; Ctrl-C ends it", dds.domain));
            walk(Box::new(robot), dds.duration)
        }
    }
}

fn rplidar(port: &Path, model: Model, scenario: &str, duration: Option<Millis>) -> Result<(), Failure> {
    let scenario = Scenario::load(&scenario_file(scenario)?).map_err(Failure::of_input)?;
    let world = scenario.load_world().map_err(Failure::of_input)?;
    let terminal = PseudoTerminal::open(port)
        .map_err(|error| Failure::input(format!("no port can be made at {}: {error}", port.display())))?;
    let config = LidarConfig::from(&Settings::default().lidar);
    let mut lidar = EmulatedRplidar::new(terminal, model, config, 1).map_err(Failure::of_input)?;
    let scene =
        Scene { world: &world, world_from_robot: scenario.start, tilt: None, world_from_handler: None, walkers: &[] };
    lidar.look(&scene, 0);
    say(format!("RPLIDAR {} at {}, {} baud; Ctrl-C ends it", model.name(), port.display(), model.baud()));
    until_ended(duration, |now_ns| lidar.serve(now_ns))
}

fn network(dds: &DdsArgs) -> DdsSettings {
    DdsSettings { domain: dds.domain, networks: dds.network.clone() }
}

fn unitree(profile: Profile, at: SocketAddr, silence: Silence, duration: Option<Millis>) -> Result<(), Failure> {
    let socket =
        UdpSocket::bind(at).map_err(|error| Failure::input(format!("no robot can listen at {at}: {error}")))?;
    let at = socket.local_addr().map_err(Failure::of_run)?;
    let robot = EmulatedUnitree::new(socket, profile, silence).map_err(Failure::of_run)?;
    say(format!("robot {} at {at}; Ctrl-C ends it", profile.name()));
    walk(Box::new(robot), duration)
}

/// A robot on a floor without walls, which tells when it begins or ends to walk.
fn walk(mut robot: Box<dyn EmulatedRobot>, duration: Option<Millis>) -> Result<(), Failure> {
    let (mut floor, mut last) = (OpenFloor::default(), None);
    until_ended(duration, |now_ns| {
        robot.serve(now_ns, floor.go_on(now_ns, robot.velocity(now_ns)))?;
        let now = (robot.posture(now_ns), robot.velocity(now_ns));
        if last.as_ref() != Some(&now) {
            let (posture, velocity) = &now;
            let [x, y, turn] = [velocity.vx_mps, velocity.vy_mps, velocity.wz_radps];
            say(format!("{posture}: {x:.2} m/s ahead, {y:.2} m/s to the left, {turn:.2} rad/s to the left"));
            last = Some(now);
        }
        Ok(())
    })
}

/// Serves a device until Ctrl-C, or for so long.
fn until_ended(duration: Option<Millis>, mut serve: impl FnMut(u64) -> std::io::Result<()>) -> Result<(), Failure> {
    let signals = Signals::of_this_process()?;
    let (begun, lasts) = (Instant::now(), duration.map(|duration| Duration::from_nanos(duration.ns())));
    while !signals.came() && lasts.is_none_or(|lasts| begun.elapsed() < lasts) {
        serve(monotonic_ns()).map_err(Failure::of_run)?;
        std::thread::sleep(PAUSE);
    }
    Ok(())
}
