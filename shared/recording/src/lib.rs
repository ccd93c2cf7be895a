//! The recording file format, and importers of other people's logs into it.
//!
//! A recording is an MCAP file, `NAME.mcap`, and where depth was recorded another beside it, `NAME.depth.mcap`, so
//! that the small topics are read without the pixels: chunks of at most 4 MiB compressed with zstd, one channel for
//! each topic of ours and named like it, under Foxglove's well-known schemas where there is one, so that MCAP
//! viewers open it as it is. A message's log time is its record's time of publication: run time in nanoseconds; an
//! import, which does not know it, has the stamp there, and counts from 0 at its first record.
//!
//! | topic | schema | |
//! |---|---|---|
//! | `lidar/scan` | `foxglove.LaserScan`, JSON | the scan in `robot`, placed by `robot_from_lidar` |
//! | `depth/frame` | `foxglove.RawImage`, protobuf | 16UC1 in millimetres |
//! | `odometry` | `foxglove.FrameTransform`, JSON | `robot` in `odom` |
//! | `cue`, `cue/request`, `policy/action`, `shield/permit`, | `guidedog.*`, JSON | the message, field by field |
//! | `mode`, `locomotion/state`, `world/truth` | likewise | |
//! | `log` | `foxglove.Log`, JSON | for people: what stops the robot, and its cues |
//! | `scene` | `foxglove.SceneUpdate`, JSON | for people: robot, handler and the hull of the permit, in `robot` |
//!
//! What Foxglove's schemas have no room for stands in the member `guidedog` of each message.
//!
//! Numbers come back to the bit. JSON has no NaN and no infinity: `null` is NaN (for a range: unknown), and the
//! greatest finite number of the type stands for infinity (for a range: nothing was hit), its negative for minus
//! infinity. A NaN's payload is not kept.
//!
//! Metadata: `guidedog`, written last, holds what [`Info`] holds; a file that was not finished lacks it, and MCAP's
//! footer with it, and [`Reader`] refuses it. A live recording begins with `guidedog.begun`, what was known about it by
//! then, and `guidedog.settings`, the settings of the run: with them [`recover`] makes a whole recording of a torn one.
//!
//! What is recorded, in which file and in which form, stands in the topic table (`messages::topic`).

pub mod carmen;
mod channel;
mod chunk;
mod file_reader;
mod image;
mod index;
mod info;
mod json;
mod lengths;
mod reader;
mod record;
mod recover;
pub mod rplidar;
mod viewer;
mod writer;

pub use info::{About, FORMAT_VERSION, Info, RunAbout};
pub use reader::{ReadError, Reader};
pub use record::{Order, Record, Slice};
pub use recover::{RecoverError, Recovered, recover, write_last};
pub use viewer::{Level, Viewer, log_json, time_json};
pub use writer::{Existing, Part, Sink, WriteError, Writer, later_lives, life_path};
