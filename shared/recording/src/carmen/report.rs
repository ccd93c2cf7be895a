//! What an import reports, and why it may fail.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use serde::Serialize;

use super::line::LineError;
use crate::WriteError;

/// Why a log could not be imported. Lines count from 1.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system failed, or the compressed data is damaged.
    #[error("failed to read {} after line {lines}", path.display())]
    Read {
        /// The log.
        path: PathBuf,
        /// Whole lines read before.
        lines: u64,
        /// Why.
        source: io::Error,
    },
    /// It is a folder, a pipe or a device.
    #[error("{} is not a file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The recording would replace its own log.
    #[error("{} is the log itself", path.display())]
    SameFile {
        /// The file.
        path: PathBuf,
    },
    /// The first line that is no comment is no CARMEN message.
    #[error("{} is not a CARMEN log: line {line} begins with {word:?}", path.display())]
    NotCarmen {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// How it begins.
        word: String,
    },
    /// There is no scan in it.
    #[error("{} holds no scan: not one of its {lines} lines is a FLASER message{}", path.display(), others(skipped))]
    NoScan {
        /// The file.
        path: PathBuf,
        /// How many lines it has.
        lines: u64,
        /// What it holds that is not imported, by message.
        skipped: BTreeMap<String, u64>,
    },
    /// A line makes no sense.
    #[error("{} line {line}: {error}", path.display())]
    Line {
        /// The log.
        path: PathBuf,
        /// The line.
        line: u64,
        /// What is wrong with it.
        error: LineError,
    },
    /// The log ends in the middle of a line; what came before can be had with `allow_truncated`.
    #[error("{} is truncated: it ends inside line {line}", path.display())]
    TruncatedLine {
        /// The log.
        path: PathBuf,
        /// The line.
        line: u64,
    },
    /// The compressed data ends too early; what came before can be had with `allow_truncated`.
    #[error("{} is truncated: its compressed data ends early, after {lines} whole lines", path.display())]
    TruncatedStream {
        /// The log.
        path: PathBuf,
        /// Whole lines read.
        lines: u64,
    },
    /// A log of more messages than are kept in mind at once.
    #[error("{} has over {most} FLASER and ODOM messages", path.display())]
    TooLong {
        /// The log.
        path: PathBuf,
        /// The most that are taken.
        most: usize,
    },
    /// The log was changed while it was read.
    #[error("{} changed while it was read", path.display())]
    Changed {
        /// The log.
        path: PathBuf,
    },
    /// The recording could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

fn others(skipped: &BTreeMap<String, u64>) -> String {
    let list: Vec<_> = skipped.iter().map(|(word, n)| format!("{n} {word}")).collect();
    if list.is_empty() { String::new() } else { format!(" (not imported: {})", list.join(", ")) }
}

/// What may be odd about a log without being wrong. None of them costs a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Anomaly {
    /// A stamp before that of the message of its kind before it. Where the clock went on from there, time goes on by
    /// what the other clock says, or else by the interval before; where it came back at once, the stamp becomes that of
    /// the message before plus 1 us.
    ClockBackwards,
    /// A stamp more than 10 s after the one before, where the other clock says at most 1 s, or where the next is back.
    /// Treated alike.
    ClockForwards,
    /// A stamp equal to the one before. It becomes that plus 1 us.
    RepeatedStamp,
    /// A line that was logged after one of the other kind with a later stamp. Put in order.
    OutOfOrder,
    /// Two scans in a row with the same odometry pose.
    RepeatedPose,
    /// Over 1 s from one scan to the next.
    Gap,
    /// A reading at or over the scans' `range_max_m`.
    MaxRangeReading,
    /// A reading of 0, which is below `range_min_m` and so unknown.
    ZeroReading,
    /// A negative reading or NaN. Becomes NaN: unknown.
    UnknownReading,
    /// A scan with another number of readings than the one before. Kept, with the geometry of its number.
    BeamCountChanged,
    /// A scan of other than 180, 181, 360 or 361 readings, whose geometry is a guess.
    UnusualBeamCount,
    /// A line of no known message.
    UnknownMessage,
}

impl Anomaly {
    /// Every kind.
    pub const ALL: [Self; 12] = [
        Self::ClockBackwards,
        Self::ClockForwards,
        Self::RepeatedStamp,
        Self::OutOfOrder,
        Self::RepeatedPose,
        Self::Gap,
        Self::MaxRangeReading,
        Self::ZeroReading,
        Self::UnknownReading,
        Self::BeamCountChanged,
        Self::UnusualBeamCount,
        Self::UnknownMessage,
    ];

    /// The name, as in reports and in the recording.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ClockBackwards => "clock_backwards",
            Self::ClockForwards => "clock_forwards",
            Self::RepeatedStamp => "repeated_stamp",
            Self::OutOfOrder => "out_of_order",
            Self::RepeatedPose => "repeated_pose",
            Self::Gap => "gap",
            Self::MaxRangeReading => "max_range_reading",
            Self::ZeroReading => "zero_reading",
            Self::UnknownReading => "unknown_reading",
            Self::BeamCountChanged => "beam_count_changed",
            Self::UnusualBeamCount => "unusual_beam_count",
            Self::UnknownMessage => "unknown_message",
        }
    }
}

/// How often each [`Anomaly`] was met.
#[derive(Debug, Clone, Default)]
pub(super) struct Counts(BTreeMap<Anomaly, u64>);

impl Counts {
    pub(super) fn add(&mut self, anomaly: Anomaly, times: u64) {
        *self.0.entry(anomaly).or_default() += times;
    }

    pub(super) fn by_name(&self) -> BTreeMap<String, u64> {
        let count = |anomaly: Anomaly| self.0.get(&anomaly).copied().unwrap_or(0);
        Anomaly::ALL.into_iter().map(|anomaly| (anomaly.name().to_owned(), count(anomaly))).collect()
    }
}

/// Which of a log's two times became run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// When the message was sent.
    Ipc,
    /// When it was logged.
    Logger,
}

/// What was imported.
#[derive(Debug, Clone, Serialize)]
pub struct ImportReport {
    /// The log.
    pub source: PathBuf,
    /// The recording.
    pub recording: PathBuf,
    /// Whole lines of the log.
    pub lines: u64,
    /// Scans written, one for each `FLASER` line.
    pub scans: u64,
    /// Odometry records written.
    pub odometry: u64,
    /// `ODOM` lines left out for being too near to a scan.
    pub odometry_left_out: u64,
    /// From the first record to the last, seconds.
    pub duration_s: f64,
    /// Way along the scans' odometry, metres.
    pub distance_m: f64,
    /// The longest time from one scan to the next, seconds.
    pub longest_gap_s: f64,
    /// Which clock was used.
    pub clock: Clock,
    /// Readings of the first scan.
    pub beams: usize,
    /// Readings at or over it hit nothing, metres.
    pub range_max_m: f64,
    /// How far forward of the robot's centre the lidar is, metres.
    pub robot_from_lidar_x_m: f64,
    /// The host that logged the first scan.
    pub robot: String,
    /// The first Unix time among the log's stamps, seconds.
    pub first_wall_clock_s: Option<f64>,
    /// How often each [`Anomaly`] was met, by name; every name is there.
    pub anomalies: BTreeMap<String, u64>,
    /// Messages that are not imported, by their word.
    pub skipped: BTreeMap<String, u64>,
    /// Where a truncated log was taken as far as it went: the line inside or before which it ended.
    pub truncated_at_line: Option<u64>,
}
