//! `emulate`: devices that are not there.

use std::net::SocketAddr;
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
        #[arg(long, value_name = "TIME", value_parser = super::duration)]
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
        #[arg(long, value_name = "TIME", value_parser = super::duration)]
        duration: Option<Millis>,
    },
}

/// The one of these names; clap lists them.
fn named<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.map(name))
        .try_map(move |given| all.into_iter().find(|one| name(*one) == given).ok_or("is none of them"))
}
