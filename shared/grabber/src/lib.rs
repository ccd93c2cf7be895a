//! Depth frames from cameras, and sound from microphones, by libraries that are opened as the program runs: it builds
//! and starts without them, and says what to install where one is missing.
//!
//! The libraries block, take their time to begin and may hang, so each is spoken to by a thread of its own
//! ([`Grabber`]). A frame stays in the library's buffer until it is written to shared memory: that pass is the only
//! copy, and makes millimetres of the camera's unit as it goes.

mod feed;
pub mod gstreamer;
mod library;
pub mod microphone;
pub mod realsense;

use camera::{Head, Raw};

pub use feed::{Grab, Grabbed, Grabber};

/// Why nothing comes of a camera or microphone.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{found}; {fix}")]
pub struct Trouble {
    /// What was found.
    pub found: String,
    /// What to do about it.
    pub fix: String,
}

impl Trouble {
    /// What was found, and what to do about it.
    #[must_use]
    pub fn new(found: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { found: found.into(), fix: fix.into() }
    }
}

/// A frame in its library's buffer, which is given back when this is dropped.
pub trait Frame: Send {
    /// What stands before the pixels.
    fn head(&self) -> Head;

    /// The pixels.
    fn raw(&self) -> Raw<'_>;
}

/// An open camera.
pub type Camera = Box<dyn Grab<Item = Box<dyn Frame>>>;
