//! Public yardsticks of robot navigation, walked by this project's sensors, shield and planners: BARN's worlds
//! ([`barn`]) and SocNavBench's episodes ([`socnavbench`]), read from their original files and scored by their own
//! definitions. Files are read by [`mod@file`] alone.
//!
//! A [`Walk`] is one passage from a start to a goal, by a robot alone or with a handler at its harness. All of it
//! depends on files and seed alone.

pub mod barn;
mod crowd;
mod error;
pub mod file;
mod npy;
mod party;
pub mod socnavbench;
mod walk;

pub use crowd::{Crowd, Recorded};
pub use error::YardstickError;
pub use party::{Party, Touch};
pub use walk::{Body, Config, End, Noise, Passage, Trace, Walk};
