//! Emulated devices in the place of real ones (`--emulated`). How the settings are pointed at one stands in its row.

use std::net::Ipv4Addr;
use std::path::PathBuf;

use crate::devices::Reach;
use crate::sections::{DepthDevice, EstopSource, LidarDevice, LinkKind, OdometryDevice, RobotKind, Settings, Source};

/// Points the settings at an emulated device.
pub type Place = fn(&mut Settings, &EmulatedPlaces);

/// Where emulated devices are found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EmulatedPlaces {
    /// The lidar's serial port.
    pub lidar_port: PathBuf,
    /// The socket at which the camera hands its frames over.
    pub camera_socket: PathBuf,
    /// The emergency stop's serial port.
    pub estop_port: PathBuf,
    /// The robot's address, which is this machine's.
    pub robot: Ipv4Addr,
    /// The DDS domain of a robot that speaks DDS.
    pub dds_domain: u16,
}

/// The emulated robot at the other end of a link.
#[derive(Debug)]
pub struct LinkEmulation {
    /// Which robot.
    pub kind: RobotKind,
    /// Points the link at it.
    pub place: Place,
    /// The key by which the settings name another machine as the robot's, where they do.
    pub elsewhere: fn(&Settings) -> Option<&'static str>,
}

impl Settings {
    /// Puts emulated devices in the place of what is simulated: every sensor and the robot, and an emergency stop
    /// beside them. A device that is not emulated gives way to the first one that is.
    pub fn emulate(&mut self) {
        let Self { lidar, depth, odometry, estop, locomotion, simulation, .. } = self;
        simulation.emulated.on = true;
        (lidar.source, depth.source, odometry.source) = (Source::Device, Source::Device, Source::Device);
        lidar.device = emulated_one(lidar.device, &LidarDevice::ALL, |it| it.row().emulated.is_some());
        depth.device = emulated_one(depth.device, &DepthDevice::ALL, |it| it.row().emulated.is_some());
        odometry.device = emulated_one(odometry.device, &OdometryDevice::ALL, |it| it.row().emulated.is_some());
        estop.source = emulated_one(estop.source, &EstopSource::ALL, |it| it.row().emulated.is_some());
        // A robot is never exchanged for another one.
        if !locomotion.link.is_device() {
            locomotion.link = emulated_one(locomotion.link, &LinkKind::ALL, |it| it.row().emulated.is_some());
        }
    }

    /// Points the settings at the emulated devices, whether or not each is in use.
    ///
    /// # Errors
    /// Where a device in use would still be the real one: its row does not place it.
    pub fn place_emulated(&mut self, places: &EmulatedPlaces) -> Result<(), String> {
        let sensors = LidarDevice::ALL.into_iter().filter_map(|it| it.row().emulated);
        let sensors = sensors.chain(DepthDevice::ALL.into_iter().filter_map(|it| it.row().emulated));
        let sensors = sensors.chain(OdometryDevice::ALL.into_iter().filter_map(|it| it.row().emulated));
        let devices = sensors.chain(EstopSource::ALL.into_iter().filter_map(|it| it.row().emulated));
        let robots = LinkKind::ALL.into_iter().filter_map(|it| it.row().emulated.as_ref()).map(|robot| robot.place);
        devices.chain(robots).for_each(|place| place(self, places));
        match self.devices().into_iter().find(|(_, reach)| !is_placed(*reach, places)) {
            Some((name, reach)) => Err(format!("{name}: {reach:?} does not lead to an emulated device")),
            None => Ok(()),
        }
    }
}

/// That one, where it is emulated, and otherwise the first that is.
fn emulated_one<T: Copy>(named: T, all: &[T], is_emulated: fn(T) -> bool) -> T {
    let mut candidates = std::iter::once(named).chain(all.iter().copied());
    candidates.find(|one| is_emulated(*one)).unwrap_or(named)
}

/// Whether nothing but an emulated device can be there.
fn is_placed(reach: Reach<'_>, places: &EmulatedPlaces) -> bool {
    match reach {
        Reach::Nothing => true,
        Reach::SerialPort { path, .. } => path == places.lidar_port || path == places.estop_port,
        Reach::FrameSocket(path) => path == places.camera_socket,
        Reach::Udp { device, local } => [device, local].iter().all(|at| at.ip().is_loopback()),
        Reach::Dds(dds) => !dds.networks.is_empty() && dds.networks.iter().all(Ipv4Addr::is_loopback),
        Reach::InputDevice(_) | Reach::Gstreamer(_) | Reach::DepthCamera(_) | Reach::TrackingCamera(_) => false,
    }
}

#[cfg(test)]
mod tests {
    use super::{EmulatedPlaces, is_placed};
    use crate::{DepthDevice, EstopSource, LidarDevice, LinkKind, OdometryDevice, Reach, Settings, check};

    fn places() -> EmulatedPlaces {
        EmulatedPlaces {
            lidar_port: "/run/lidar".into(),
            camera_socket: "/run/camera".into(),
            estop_port: "/run/estop".into(),
            robot: [127, 0, 0, 9].into(),
            dds_domain: 100,
        }
    }

    /// A row that says that it is emulated, and does not place the device, would command the real one.
    #[test]
    fn every_row_that_is_emulated_places_its_device() {
        let mut emulated = Settings::default();
        emulated.emulate();
        let with = |change: &dyn Fn(&mut Settings)| {
            let mut settings = emulated.clone();
            change(&mut settings);
            settings
        };
        let mut all = Vec::new();
        let lidars = LidarDevice::ALL.into_iter().filter(|it| it.row().emulated.is_some());
        all.extend(lidars.map(|device| with(&|settings| settings.lidar.device = device)));
        let cameras = DepthDevice::ALL.into_iter().filter(|it| it.row().emulated.is_some());
        all.extend(cameras.map(|device| with(&|settings| settings.depth.device = device)));
        let trackers = OdometryDevice::ALL.into_iter().filter(|it| it.row().emulated.is_some());
        all.extend(trackers.map(|device| with(&|settings| settings.odometry.device = device)));
        let stops = EstopSource::ALL.into_iter().filter(|it| it.row().emulated.is_some());
        all.extend(stops.map(|source| with(&|settings| settings.estop.source = source)));
        let links = LinkKind::ALL.into_iter().filter(|it| it.row().emulated.is_some());
        all.extend(links.map(|link| with(&|settings| settings.locomotion.link = link)));
        assert!(all.len() >= 5, "one of each kind at least");
        for mut settings in all {
            assert_eq!(check(&settings), Ok(()));
            assert_eq!(settings.place_emulated(&places()), Ok(()));
            // A robot whose place cannot be looked at could be anywhere.
            let locomotion = &settings.locomotion;
            assert_ne!((locomotion.link.row().reach)(locomotion), Reach::Nothing, "{:?}", locomotion.link);
        }
    }

    #[test]
    fn a_real_device_is_not_taken_for_an_emulated_one() {
        let mut settings = Settings::default();
        settings.emulate();
        let real = settings.devices().into_iter().filter(|(_, reach)| *reach != Reach::Nothing);
        for (name, reach) in real {
            assert!(!is_placed(reach, &places()), "{name}");
        }
    }
}
