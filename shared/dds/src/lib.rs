//! Robots on DDS: Unitree's Go2 and B2 by their sport service, and any robot that takes ROS 2's `cmd_vel`.
//!
//! [`sport`] and [`ros2`] are the types on the wire (as their makers' IDL has them, CDR little endian), [`Driver`] says
//! what is to be said when, and [`EmulatedGo2`] is a robot's own side: all pure. [`bus`] puts them on the network.

pub mod bus;
mod driver;
mod emulated;
pub mod ros2;
pub mod sport;
mod state;

pub use driver::{Driver, PERIOD_NS, Say, Stops};
pub use emulated::EmulatedGo2;
pub use state::{Posture, RobotState};
