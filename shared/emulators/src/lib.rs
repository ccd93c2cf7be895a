//! Devices that are not there, for programs that cannot tell: each speaks its device's language on a line of its own,
//! and senses the simulated world.

mod rplidar;

pub use rplidar::EmulatedRplidar;
