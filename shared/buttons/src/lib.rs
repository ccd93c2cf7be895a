//! Keys and buttons of a Linux input device: whether one is down. What is unplugged, or cannot be asked, is told.

mod input;
mod keys;

pub use input::InputDevice;
pub use keys::{EVENT_LEN, Keys};
