//! `emulate`: devices that are not there.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use rplidar::Model;
use settings::Millis;
use unitree::{Profile, Silence};

/// Examples for `emulate`.
pub const HELP: &str = "\
Examples:
  guidedog emulate rplidar --port /tmp/rplidar                 an A1 in the built-in corridor, until Ctrl-C
  guidedog emulate rplidar --port /tmp/s2 --model s2 --scenario left-at-tee
  guidedog emulate unitree --profile go1-3.8 --listen 127.0.0.1:8082
  guidedog emulate go2 --network 192.168.123.18

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
        /// Which one; a1-old has firmware 1.16, which cannot be asked for its modes
        #[arg(long, default_value = Model::A1.name(), value_parser = named(Model::ALL, Model::name))]
        model: Model,
        /// A scenario by name or file; the robot stands at its start
        #[arg(long, value_name = "NAME|FILE.toml", default_value = crate::prepare::DEFAULT_SCENARIO)]
        scenario: String,
        /// End after so long
        #[arg(long, value_name = "TIME", value_parser = super::values::duration)]
        duration: Option<Millis>,
    },
    /// A Unitree robot at a UDP port, on a floor without walls; tells when it begins or ends to walk
    Unitree {
        /// Which robot, by which version of its protocol
        #[arg(long, default_value = Profile::AlienGo384.name(), value_parser = named(Profile::ALL, Profile::name))]
        profile: Profile,
        /// Where it listens; it answers whoever spoke last
        #[arg(long, value_name = "IP:PORT")]
        listen: SocketAddr,
        /// What it does where nothing more comes: nobody knows that the real ones do not keep their last command
        #[arg(long, default_value = Silence::HoldsLast.name(), value_parser = named(Silence::ALL, Silence::name))]
        silence: Silence,
        /// End after so long
        #[arg(long, value_name = "TIME", value_parser = super::values::duration)]
        duration: Option<Millis>,
    },
    /// A Unitree Go2 or B2 on DDS, on a floor without walls; tells when it begins or ends to walk
    Go2(DdsArgs),
    /// A robot of ROS 2 on DDS, on a floor without walls: cmd_vel in, odom out
    Ros2 {
        /// Where it takes velocities
        #[arg(long, value_name = "TOPIC", default_value = "/cmd_vel")]
        cmd_vel: String,
        /// Where it gives odometry
        #[arg(long, value_name = "TOPIC", default_value = "/odom")]
        odom: String,
        /// It takes TwistStamped, not Twist
        #[arg(long)]
        stamped: bool,
        #[command(flatten)]
        dds: DdsArgs,
    },
}

/// Where a robot is on DDS, and what it is like.
#[derive(Debug, Args)]
pub struct DdsArgs {
    /// The domain
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=232))]
    pub domain: u16,
    /// This machine's own address in a network that it takes part in; every network, where none is named
    #[arg(long, value_name = "IP")]
    pub network: Vec<Ipv4Addr>,
    /// What it does where nothing more comes: a Go2 keeps its last velocity for a second, its maker says
    #[arg(long, default_value = Silence::HoldsLast.name(), value_parser = named(Silence::ALL, Silence::name))]
    pub silence: Silence,
    /// End after so long
    #[arg(long, value_name = "TIME", value_parser = super::values::duration)]
    pub duration: Option<Millis>,
}

/// The one of these names; clap lists them.
fn named<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.map(name))
        .try_map(move |given| all.into_iter().find(|one| name(*one) == given).ok_or("is none of them"))
}
