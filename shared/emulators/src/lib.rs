//! Devices that are not there, for programs that cannot tell: each speaks its device's language on a line of its own,
//! and senses the simulated world where it senses at all. Its line can be made to fail.

mod cable;
mod camera;
mod dds;
mod estop;
mod floor;
mod rplidar;
mod unitree;

use std::os::fd::BorrowedFd;

use ::unitree::{Silence, State};
use messages::{Fault, Twist2};
use settings::{Locomotion, RobotKind};

pub use self::dds::{EmulatedRos2, EmulatedSport};
pub use camera::EmulatedCamera;
pub use estop::EmulatedEstop;
pub use floor::OpenFloor;
pub use rplidar::EmulatedRplidar;
pub use unitree::EmulatedUnitree;

/// A robot that is not there. Where it is, whoever moves it knows.
pub trait EmulatedRobot {
    /// How fast it goes.
    fn velocity(&self, now_ns: u64) -> Twist2;

    /// What it does with its legs, in a word.
    fn posture(&self, now_ns: u64) -> String;

    /// From now on that goes wrong with it or its line; by that seed, where it is random.
    fn suffer(&mut self, fault: Option<(Fault, u64)>);

    /// Takes what has come.
    ///
    /// # Errors
    /// Where its line fails.
    fn hear(&mut self, now_ns: u64) -> std::io::Result<()>;

    /// Listens, obeys, and says how it is: `measured` is what its sensors know.
    ///
    /// # Errors
    /// Where its line fails.
    fn serve(&mut self, now_ns: u64, measured: State) -> std::io::Result<()>;

    /// What becomes readable when it is commanded, where there is such a thing.
    fn fd(&self) -> Option<BorrowedFd<'_>> {
        None
    }
}

/// The robot of that kind, where and how these settings seek it.
///
/// # Errors
/// Where it cannot listen there.
pub fn open_robot(kind: RobotKind, at: &Locomotion, silence: Silence) -> std::io::Result<Box<dyn EmulatedRobot>> {
    Ok(match kind {
        RobotKind::Unitree => Box::new(EmulatedUnitree::open(&at.unitree, silence)?),
        RobotKind::Go2 => Box::new(EmulatedSport::new(&at.dds, silence).map_err(std::io::Error::other)?),
        RobotKind::Ros2 => Box::new(EmulatedRos2::new(&at.dds, &at.ros2, silence).map_err(std::io::Error::other)?),
    })
}
