//! Fitting interaction models to walks of handlers with the robot (Kim et al. 2023, section 4 and table 1).
//!
//! [`data`] reads and writes recordings, [`walker`] makes them where none are at hand, [`fit`] finds the parameters,
//! [`table`] sets them side by side, [`picture`] draws a walk. [`response`] tells how a robot answers a command.

pub mod data;
pub mod fit;
pub mod picture;
pub mod response;
pub mod script;
pub mod table;
pub mod walker;

pub use data::{DataError, Recording, Sample};
pub use fit::{Fit, FitError, ModelKind};
