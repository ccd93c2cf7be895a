//! The devices that the configuration can name, a row each: what is known of one stands in its row, and nowhere else.
//! The code of a device stands with its service, in a match that lacks no row.

use std::net::SocketAddrV4;
use std::path::Path;

use crate::emulated::Place;
use crate::sections::{DdsSettings, DepthSettings, Librealsense, Settings, Source};

/// What is known of a device; `S` is the section that names it, as `lidar.device` or `estop.source`.
#[derive(Debug)]
pub struct DeviceRow<S: 'static> {
    /// Its name in the configuration.
    pub name: &'static str,
    /// What `guidedog doctor` calls it.
    pub doctor_name: &'static str,
    /// How it is reached.
    pub reach: for<'a> fn(&'a S) -> Reach<'a>,
    /// Checks its settings, also where it is not in use; the reason begins with the key.
    pub check: fn(&S) -> Result<(), String>,
    /// Points the settings at the one that `--emulated` puts into the simulated world; none where it is not emulated.
    pub emulated: Option<Place>,
}

/// What this machine must have for a device to be used: what `guidedog doctor` looks at, without a word to the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reach<'a> {
    /// Nothing that can be looked at before a run.
    Nothing,
    /// A serial port; without a speed, any will do.
    SerialPort {
        /// Its file.
        path: &'a Path,
        /// Bits a second.
        baud: Option<u32>,
    },
    /// A place for a Unix socket that the driver makes; another program then connects to it.
    FrameSocket(&'a Path),
    /// The file of a Linux input device.
    InputDevice(&'a Path),
    /// GStreamer, with the elements of the section's pipeline.
    Gstreamer(&'a DepthSettings),
    /// librealsense and a depth camera.
    DepthCamera(&'a Librealsense),
    /// librealsense and a tracking camera.
    TrackingCamera(&'a Librealsense),
    /// An address of this machine in the device's own network.
    Udp {
        /// Where the device listens.
        device: SocketAddrV4,
        /// Where this machine hears it.
        local: SocketAddrV4,
    },
    /// The addresses by which this machine takes part in a DDS network.
    Dds(&'a DdsSettings),
}

impl Settings {
    /// The devices that the settings name: what `guidedog doctor` calls each, and by what it is reached.
    #[must_use]
    pub fn devices(&self) -> Vec<(&'static str, Reach<'_>)> {
        fn used<'a, S>(row: &DeviceRow<S>, section: &'a S) -> (&'static str, Reach<'a>) {
            (row.doctor_name, (row.reach)(section))
        }
        let second = self.lidar.second.as_deref();
        let second = second.map(|second| (second.source, ("second lidar", (second.device.row().reach)(second))));
        let sensors = [
            (self.lidar.source, used(self.lidar.device.row(), &self.lidar)),
            (self.depth.source, used(self.depth.device.row(), &self.depth)),
            (self.odometry.source, used(self.odometry.device.row(), &self.odometry)),
        ];
        let link = self.locomotion.link.row();
        let others = [used(self.estop.source.row(), &self.estop), ("robot", (link.reach)(&self.locomotion))];
        let sensors =
            sensors.into_iter().chain(second).filter(|(source, _)| *source == Source::Device).map(|(_, device)| device);
        sensors.chain(others).collect()
    }
}

/// What serial lines run at, bits a second.
const BAUDS: std::ops::RangeInclusive<u32> = 1_200..=4_000_000;

/// Whether a serial line can run at that speed.
pub(crate) fn check_baud(key: &str, baud: u32) -> Result<(), String> {
    if BAUDS.contains(&baud) {
        return Ok(());
    }
    Err(format!("{key} = {baud} is not in {}..{}", BAUDS.start(), BAUDS.end()))
}

/// Whether a value is left out where settings are written: what says nothing changes no recording.
pub(crate) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// `a, b or c`.
#[must_use]
pub fn either(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [most @ .., last] => format!("{} or {last}", most.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use crate::{DepthDevice, EstopSource, LidarDevice, LinkKind, OdometryDevice, Settings};

    /// What the parser knows, and the rows know no less: a device without its name in `ALL` would not be listed.
    #[test]
    fn every_name_that_the_configuration_takes_is_a_row() {
        for (section, key, names) in [
            ("lidar", "device", LidarDevice::ALL.map(|it| it.row().name).to_vec()),
            ("depth", "device", DepthDevice::ALL.map(|it| it.row().name).to_vec()),
            ("odometry", "device", OdometryDevice::ALL.map(|it| it.row().name).to_vec()),
            ("estop", "source", EstopSource::ALL.map(|it| it.row().name).to_vec()),
            ("locomotion", "link", LinkKind::ALL.map(|it| it.row().name).to_vec()),
        ] {
            let text = format!("[{section}]\n{key} = \"?\"\n");
            let why = toml::from_str::<Settings>(&text).expect_err("no such name").to_string();
            let listed: Vec<&str> = why.lines().last().unwrap_or_default().split('`').skip(3).step_by(2).collect();
            assert_eq!(listed, names, "{section}.{key}: {why}");
        }
    }

    /// Recordings carry the settings: those of a run with the default lidar stay as they were.
    #[test]
    fn the_default_lidar_is_not_written() {
        let written = toml::Table::try_from(Settings::default()).expect("settings can be written");
        assert!(written["lidar"].get("source").is_some() && written["lidar"].get("device").is_none());
    }

    #[test]
    fn the_shipped_file_names_every_lidar_and_every_link() {
        let shipped = include_str!("../../../config/guidedog.toml");
        let lidars = LidarDevice::ALL.map(|it| it.row().name);
        for name in lidars.into_iter().chain(LinkKind::ALL.map(|it| it.row().name)) {
            assert!(shipped.contains(&format!("\"{name}\"")), "config/guidedog.toml does not name {name}");
        }
    }
}
