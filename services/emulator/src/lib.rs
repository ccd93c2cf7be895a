//! Devices that are not there, in the simulated world: an RPLIDAR and an emergency stop at pseudo-terminals, a depth
//! camera at the frame socket, and a robot at a UDP port or on a DDS network, for the drivers and the link that speak
//! to real ones.
//!
//! Its robot keeps the last command when the line goes quiet, as a real one may. It stands for what is outside, like
//! the simulator: nothing restarts it, and its end ends the run.

mod camera;
mod sight;

use std::path::Path;

use emulators::{EmulatedCamera, EmulatedEstop, EmulatedRobot, EmulatedRplidar, open_robot};
use messages::fault::Device;
use messages::{Attitude, Pose2, RobotCommand, ServiceId, Twist2, WorldTruth};
use serial::PseudoTerminal;
use settings::{DepthDevice, EstopSource, LidarDevice, PhysicsKind, Settings, Source};
use transport::{Io, Publisher, Service, Subscriber, TransportError, monotonic_ns, short_socket};
use unitree::State;
use world::{DepthConfig, LidarConfig, OdometryConfig, OdometrySensor};

use crate::camera::CameraThread;
use crate::sight::{Sight, load_world};

/// Between two looks at the lines, nanoseconds: a frame of the fastest lidar, half the robot's own period.
const PERIOD_NS: u64 = 1_000_000;
/// Without a supervisor it ends after this long: after locomotion and brake have stopped the robot.
const LOST_LIMIT_NS: u64 = 700_000_000;
/// Of a robot that tells it, percent.
const CHARGE_PERCENT: u8 = 80;
const TOKEN_ROBOT: u64 = 1;

/// The service.
pub struct Emulator {
    sight: Sight,
    lidar: EmulatedRplidar,
    robot: Box<dyn EmulatedRobot>,
    estop: EmulatedEstop,
    /// None where depth comes from elsewhere.
    camera: Option<CameraThread>,
    odometry: OdometrySensor,
    /// What the robot's sensors know.
    measured: State,
    truths: Subscriber<WorldTruth>,
    commands: Publisher<RobotCommand>,
    commanded: Twist2,
    next_ns: u64,
    ends_by_wall_ns: Option<u64>,
}

impl Emulator {
    /// Plugs lidar and robot in.
    ///
    /// # Errors
    /// Where the world cannot be read, the lidar's port or the robot's socket not be made, or a topic not be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        check(&settings).map_err(TransportError::service)?;
        let (seed, incarnation) = (settings.simulation.seed, io.identity().incarnation);
        let odometry = OdometrySensor::new(OdometryConfig::from(&settings.odometry), seed, incarnation);
        let robot = robot(&settings)?;
        if let Some(fd) = robot.fd() {
            io.watch(fd, TOKEN_ROBOT)?;
        }
        let started_ns = io.domain.info.started_monotonic_ns;
        Ok(Self {
            sight: Sight::open(&settings, io)?,
            lidar: lidar(&settings)?,
            estop: EmulatedEstop::new(terminal(&settings.estop.serial.port)?),
            camera: camera(&settings, started_ns)?,
            robot,
            odometry: odometry.map_err(TransportError::service)?,
            measured: State::held(Pose2::default(), &Attitude::default(), Twist2::ZERO, Some(CHARGE_PERCENT)),
            truths: io.subscriber()?,
            commands: io.publisher()?,
            commanded: Twist2::ZERO,
            next_ns: 0,
            ends_by_wall_ns: None,
        })
    }

    /// The world has gone on: what the devices sense of it from now on. The simulator hears the command again.
    fn sense(&mut self, truth: &WorldTruth, newest: bool) {
        let seq = truth.header.seq;
        let reading = self.odometry.update(seq, truth.world_from_robot, truth.robot_twist);
        let (pose, attitude) = (reading.odom_from_robot, self.odometry.attitude(seq, &truth.attitude));
        self.measured = State::held(pose, &attitude, reading.twist, Some(CHARGE_PERCENT));
        if newest {
            self.sight.look(truth, &mut self.lidar, self.camera.as_ref());
        }
    }

    /// What the robot does now, to whoever moves it: at once where it is new, and otherwise where `again`.
    fn command(&mut self, now_ns: u64, again: bool) -> Result<(), TransportError> {
        let velocity = self.robot.velocity(now_ns);
        if again || velocity != self.commanded {
            self.commanded = velocity;
            let command = RobotCommand { source: ServiceId::Emulator, velocity, ..RobotCommand::default() };
            self.commands.publish(now_ns, command)?;
        }
        Ok(())
    }

    fn suffer(&mut self, io: &Io) -> Result<(), TransportError> {
        self.robot.suffer(io.line_fault(Device::Robot));
        if let Some(camera) = &self.camera {
            camera.suffer(io.line_fault(Device::Camera).map(|(fault, _)| fault));
        }
        self.estop.suffer(io.line_fault(Device::Estop).map(|(fault, _)| fault)).map_err(TransportError::service)?;
        self.lidar.suffer(io.line_fault(Device::Lidar)).map_err(TransportError::service)
    }

    fn serve(&mut self, now_ns: u64) -> Result<(), TransportError> {
        self.robot.serve(now_ns, self.measured).map_err(TransportError::service)?;
        self.estop.serve(now_ns).map_err(TransportError::service)?;
        self.lidar.serve(now_ns).map_err(TransportError::service)
    }
}

/// Whether every device that the settings name has its emulator here: another one must not answer in its place.
fn check(settings: &Settings) -> Result<(), String> {
    let (lidar, depth, estop) = (settings.lidar.device, &settings.depth, settings.estop.source);
    for (key, name, is_here) in [
        ("lidar.device", lidar.row().name, lidar == LidarDevice::Rplidar),
        ("depth.device", depth.device.row().name, !has_camera(settings) || depth.device == DepthDevice::Socket),
        ("estop.source", estop.row().name, matches!(estop, EstopSource::Absent | EstopSource::Serial)),
    ] {
        if !is_here {
            return Err(format!("{key} = {name:?} has no emulator"));
        }
    }
    Ok(())
}

fn has_camera(settings: &Settings) -> bool {
    settings.depth.source == Source::Device
}

fn terminal(port: &Path) -> Result<PseudoTerminal, TransportError> {
    PseudoTerminal::open(port).map_err(|error| {
        TransportError::service(format!("no port of an emulated device can be made at {}: {error}", port.display()))
    })
}

fn lidar(settings: &Settings) -> Result<EmulatedRplidar, TransportError> {
    let terminal = terminal(&settings.lidar.rplidar.port)?;
    let (emulated, seed) = (&settings.simulation.emulated, settings.simulation.seed);
    let config = LidarConfig::from(&settings.lidar);
    EmulatedRplidar::new(terminal, emulated.rplidar, config, seed).map_err(TransportError::service)
}

fn camera(settings: &Settings, started_ns: u64) -> Result<Option<CameraThread>, TransportError> {
    let depth = &settings.depth;
    if !has_camera(settings) {
        return Ok(None);
    }
    let is_flat = settings.simulation.physics == PhysicsKind::Flat;
    let world = if is_flat { Some(load_world(settings)?) } else { None };
    let camera = EmulatedCamera::new(
        short_socket(depth.socket.path.as_ref()),
        DepthConfig::from(depth),
        settings.simulation.seed,
    );
    let camera = camera.map_err(TransportError::service)?;
    CameraThread::begin(camera, world, depth.rate_hz.get(), started_ns).map(Some)
}

fn robot(settings: &Settings) -> Result<Box<dyn EmulatedRobot>, TransportError> {
    let (locomotion, silence) = (&settings.locomotion, settings.simulation.emulated.silence);
    let Some(robot) = &locomotion.link.row().emulated else {
        return Err(TransportError::service("locomotion.link names no robot that is emulated"));
    };
    open_robot(robot.kind, locomotion, silence).map_err(TransportError::service)
}

impl Service for Emulator {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        self.suffer(io)?;
        let mut told = false;
        let mut next = self.truths.take()?;
        while let Some(truth) = next {
            next = self.truths.take()?;
            self.sense(&truth, next.is_none());
            told = true;
        }
        self.sight.take(&mut self.lidar, self.camera.as_ref())?;
        let now_ns = io.now_ns();
        self.serve(now_ns)?;
        self.next_ns = now_ns + PERIOD_NS;
        self.command(now_ns, told)
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_fd(&mut self, io: &mut Io, _token: u64) -> Result<(), TransportError> {
        let now_ns = io.now_ns();
        self.robot.hear(now_ns).map_err(TransportError::service)?;
        self.command(now_ns, false)
    }

    fn wants_wall_ticks(&self) -> bool {
        self.ends_by_wall_ns.is_some()
    }

    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        self.ends_by_wall_ns = Some(monotonic_ns() + LOST_LIMIT_NS);
        false
    }

    fn is_done(&self) -> bool {
        self.ends_by_wall_ns.is_some_and(|by| monotonic_ns() >= by)
    }
}

#[cfg(test)]
mod tests {
    use settings::{DepthDevice, EstopSource, LidarDevice, Settings};

    /// The rows of the devices say what is emulated; the emulators are here.
    #[test]
    fn every_device_that_is_emulated_has_its_emulator() {
        let mut settings = Settings::default();
        settings.emulate();
        let check = |change: &dyn Fn(&mut Settings)| {
            let mut settings = settings.clone();
            change(&mut settings);
            super::check(&settings)
        };
        for device in LidarDevice::ALL {
            let found = check(&|settings| settings.lidar.device = device);
            assert_eq!(found.is_ok(), device.row().emulated.is_some(), "{device:?}: {found:?}");
        }
        for device in DepthDevice::ALL {
            let found = check(&|settings| settings.depth.device = device);
            assert_eq!(found.is_ok(), device.row().emulated.is_some(), "{device:?}: {found:?}");
        }
        for source in EstopSource::ALL.into_iter().filter(|source| *source != EstopSource::Absent) {
            let found = check(&|settings| settings.estop.source = source);
            assert_eq!(found.is_ok(), source.row().emulated.is_some(), "{source:?}: {found:?}");
        }
    }
}
