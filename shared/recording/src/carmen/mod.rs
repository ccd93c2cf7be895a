//! Imports CARMEN logs: what the robots of the Radish repository recorded.
//!
//! A log is text, one message a line, plain or compressed with bzip2 or gzip (told by its first bytes):
//!
//! ```text
//! FLASER n r1 .. rn x y theta odom_x odom_y odom_theta ipc_time host logger_time
//! ODOM x y theta tv rv accel ipc_time host logger_time
//! PARAM name value ipc_time host logger_time
//! ```
//!
//! * **Read twice.** The first pass checks every line and gathers what the scans' headers need and only the whole log
//!   tells (clock, clock steps, ranges that mean nothing was hit); the second writes. So nothing is written for a log
//!   with a bad line, and no more than one scan's ranges are held.
//! * **Scans** are the `FLASER` lines. n readings span 180 degrees from right to left: at 180/n degrees from each to
//!   the next for an even n, at 180/(n-1) for an odd one.
//! * **Nothing was hit** at 81 m and more; at or over `PARAM robot_front_laser_max`; and at the log's greatest
//!   reading, where that is 20 m or more and one in a thousand readings or more equals it (aces: 50.0 m). The lowest
//!   of the three becomes the scans' `range_max_m`. A log with a lower ceiling and no such parameter has it taken for
//!   walls, which is the safe way to be wrong.
//! * **Odometry** has a record at every scan's stamp, from its `odom_*`. `ODOM` lines give the rest, but for those
//!   within 50 ms of a scan: the two disagree about time, and in aces closer poses would show 64 m/s and more.
//! * **Twists** come from tv and rv where one of them is ever not zero, otherwise from the poses, over 0.3 s or more;
//!   of the `ODOM` lines where the log has them. Standard deviations are 0: the log gives none.
//! * **Time** is `ipc_time`, when the message was sent; `logger_time` came later, by up to half a second. It is used
//!   only where more than one `ipc_time` in twenty stands still, goes back or leaps by over 10 s, and it is better.
//!   Run time begins at 0 and is strictly increasing on each stream; see [`Anomaly`] for what is done about stamps
//!   that are not.

mod import;
mod input;
mod line;
mod motion;
mod report;
mod survey;
mod timeline;

pub use import::{ImportOptions, import, read};
pub use line::LineError;
pub use report::{Anomaly, Clock, ImportError, ImportReport};
