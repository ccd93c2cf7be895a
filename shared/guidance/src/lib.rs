//! The domain: actions, cues, interaction models, the handler's estimate and the action shield of Kim et al. 2023.
//!
//! No I/O, no clock, no thread, no randomness of its own: same input, same output, to the bit.

pub mod action;
pub mod se2;

pub use action::{Action, ActionTable};
pub use se2::Se2;
