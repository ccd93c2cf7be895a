//! `emulate`: devices that are not there.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use settings::Millis;

/// Examples for `emulate`.
pub const HELP: &str = "\
Examples:
  guidedog emulate rplidar --port /tmp/rplidar                 an A1 in the built-in corridor, until Ctrl-C
  guidedog emulate rplidar --port /tmp/s2 --model s2 --scenario left-at-tee
  guidedog emulate unitree --profile go1-3.8 --listen 127.0.0.1:8082

Whatever speaks to such a device may do so: this project's own programs, the maker's\nlibrary, a viewer.";

/// Which device.
#[derive(Debug, Args)]
pub struct EmulateArgs {
    /// Which device
    #[command(subcommand)]
    pub device: Device,
}

/// A device.
#[derive(Debug, Subcommand)]
pub enum Device {
    /// An RPLIDAR at a pseudo-terminal, standing where a scenario starts
    Rplidar {
        /// Where its serial port is to be found: a link that is made, and removed at the end
        #[arg(long, value_name = "PATH")]
        port: PathBuf,
        /// Which one
        #[arg(long, value_enum, default_value_t = LidarModel::A1)]
        model: LidarModel,
        /// A scenario by name or file; the robot stands at its start
        #[arg(long, value_name = "NAME|FILE.toml", default_value = crate::prepare::DEFAULT_SCENARIO)]
        scenario: String,
        /// End after so long
        #[arg(long, value_name = "TIME", value_parser = super::duration)]
        duration: Option<Millis>,
    },
    /// A Unitree robot at a UDP port, on a floor without walls; tells when it begins or ends to walk
    Unitree {
        /// Which robot, by which version of its protocol
        #[arg(long, value_enum, default_value_t = Robot::AlienGo384)]
        profile: Robot,
        /// Where it listens; it answers whoever spoke last
        #[arg(long, value_name = "IP:PORT")]
        listen: SocketAddr,
        /// What it does where nothing more comes
        #[arg(long, value_enum, default_value_t = OnSilence::HoldsLast)]
        silence: OnSilence,
        /// End after so long
        #[arg(long, value_name = "TIME", value_parser = super::duration)]
        duration: Option<Millis>,
    },
}

/// Robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Robot {
    /// AlienGo, sport mode 1.0.20 and later
    #[value(name = "aliengo-3.8.4")]
    AlienGo384,
    /// AlienGo before that
    #[value(name = "aliengo-3.3.1")]
    AlienGo331,
    /// Go1
    #[value(name = "go1-3.8")]
    Go138,
}

/// What a robot does when its line goes quiet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OnSilence {
    /// It keeps its last command for ever: nobody knows that the real ones do not
    HoldsLast,
    /// It stands after half a second
    Stands,
}

/// RPLIDARs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LidarModel {
    /// A1M8, 115200 baud
    A1,
    /// A1 with firmware 1.16, which cannot be asked for its modes
    A1Old,
    /// A2M8, 115200 baud
    A2,
    /// A3M1, 256000 baud
    A3,
    /// S1, 256000 baud
    S1,
    /// S2, 1000000 baud
    S2,
    /// S3, 1000000 baud
    S3,
    /// C1, 460800 baud
    C1,
}
