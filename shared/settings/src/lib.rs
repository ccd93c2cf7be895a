//! The configuration file, typed and validated. An unknown or wrong key is an error that names file and line.
//!
//! Layers lie on top of each other: the defaults below, then a profile, then the operator's file. Each layer is checked
//! by itself, so an error names the line that caused it.

mod checks;
mod devices;
mod emulated;
mod layers;
mod origins;
mod path;
mod planned;
mod program;
mod recorded;
mod schema;
mod sections;
mod units;

pub use checks::{check, check_floor, check_origin, check_tone, no_start_by_voice};
pub use devices::{DeviceRow, Reach, either};
pub use emulated::{EmulatedPlaces, LinkEmulation, Place};
pub use layers::{Effective, Operator, Profile, SettingsError, load, load_over, load_resolved, load_with_origins};
pub use origins::{KeyOrigin, Origins};
pub use path::ConfigPath;
pub use planned::{Ask, Planned};
pub use program::find_program;
pub use recorded::{CueOrigin, RecordSettings, Replay, RunRecordSettings};
pub use schema::schema;
pub use sections::*;
pub use units::{Millis, Positive, Share};
