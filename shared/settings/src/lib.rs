//! The configuration file, typed and validated. An unknown or wrong key is an error that names file and line.
//!
//! Layers lie on top of each other: the defaults below, then a profile, then the operator's file. Each layer is checked
//! by itself, so an error names the line that caused it.

mod checks;
mod layers;
mod path;
mod planned;
mod recorded;
mod sections;
mod units;

pub use checks::{check, check_tone};
pub use layers::{Profile, SettingsError, load, load_over, load_resolved};
pub use path::ConfigPath;
pub use planned::{Ask, Planned};
pub use recorded::{CueOrigin, RecordSettings, Replay};
pub use sections::{
    Access, ActionTableName, Choice, CueSettings, DdsSettings, DepthDevice, DepthGstreamer, DepthIntrinsics,
    DepthSettings, DepthSocket, Emulated, EmulatedPlaces, Estop, EstopInput, EstopSerial, EstopSource, Handler,
    HandlerModel, Librealsense, LidarSettings, Limits, LinkKind, Locomotion, MatchingSettings, MaxAge, MemorySettings,
    OdometryDevice, OdometrySettings, PolicyModel, PolicySettings, Robot, Ros2Settings, RplidarSettings, Settings,
    ShieldSettings, Simulation, Source, Speak, SpokenLanguage, Supervision, SwapSettings, UnitreeSettings, Verbosity,
    VoiceSettings, VoiceSource, Walk, WalkErrors,
};
pub use units::{Millis, Positive, Share};
