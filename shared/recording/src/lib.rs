//! The recording file format, and importers of other people's logs into it.
//!
//! A recording is one MCAP file, `NAME.mcap`: chunks of 4 MiB compressed with zstd, one channel for each topic of ours
//! and named like it, each message JSON under one of Foxglove's well-known schemas, so that MCAP viewers open it as it
//! is. A message's log time is its record's stamp: run time in nanoseconds; an import counts it from 0 at its first
//! record. What the schemas have no room for stands in the member `guidedog` of each message.
//!
//! | topic | schema | frames |
//! |---|---|---|
//! | `lidar/scan` | `foxglove.LaserScan` | the scan in `robot`, placed by `robot_from_lidar` |
//! | `odometry` | `foxglove.FrameTransform` | `robot` in `odom` |
//!
//! Numbers come back to the bit. JSON has no NaN and no infinity: `null` is NaN (for a range: unknown), and the
//! greatest finite number of the type stands for infinity (for a range: nothing was hit), its negative for minus
//! infinity. A NaN's payload is not kept.
//!
//! A metadata record named `guidedog`, written last, holds what [`Info`] holds. A file that was not finished lacks it,
//! and MCAP's footer with it, and [`Reader`] refuses it.
//!
//! To record one more topic: a variant of [`Record`] and a row of the table in `channel.rs`.

pub mod carmen;
mod channel;
mod index;
mod info;
mod json;
mod lengths;
mod reader;
mod record;
pub mod rplidar;
mod writer;

pub use info::{About, FORMAT_VERSION, Info};
pub use reader::{ReadError, Reader};
pub use record::Record;
pub use writer::{Existing, WriteError, Writer};
