//! Devices that are not there, for programs that cannot tell: each speaks its device's language on a line of its own,
//! and senses the simulated world where it senses at all. Its line can be made to fail.

mod cable;
mod camera;
mod estop;
mod floor;
mod rplidar;
mod unitree;

pub use camera::EmulatedCamera;
pub use estop::EmulatedEstop;
pub use floor::OpenFloor;
pub use rplidar::EmulatedRplidar;
pub use unitree::EmulatedUnitree;
