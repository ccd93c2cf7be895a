//! The second pass over a log: writes the recording.

use std::path::Path;

use messages::{Header, LidarScan, NS_PER_S, Odometry, Pose2, ScanHeader, s_from_ns};

use super::input::{Lines, Next};
use super::line::{Line, geometry, parse};
use super::motion::odometry;
use super::report::{Anomaly, Clock, ImportError, ImportReport};
use super::survey::{Survey, survey};
use super::timeline::{choose, stamps_ns};
use crate::{About, Existing, Record, Slice, Writer};

/// Less than any laser of these logs sees; it makes 0 unknown.
const RANGE_MIN_M: f64 = 0.02;

/// One standard deviation of a reading of a SICK LMS, by whose data sheet 5 cm is the most it is off.
const SIGMA_M: f64 = 0.025;

/// From one scan to the next, a longer time is a gap.
const GAP_NS: u64 = NS_PER_S;

/// How to import.
#[derive(Debug, Clone, Copy, Default)]
pub struct ImportOptions {
    /// What to do where the recording is already there.
    pub existing: Existing,
    /// Take a truncated log as far as it goes, and report where it ended, rather than refuse it.
    pub allow_truncated: bool,
}

/// Imports the CARMEN log at `log` into a recording at `out`, which is written whole or not at all.
///
/// # Errors
/// For a log that cannot be read, is none, has a line that makes no sense, is truncated (unless that is allowed) or
/// holds no scan; and where the recording cannot be written.
pub fn import(log: &Path, out: &Path, options: ImportOptions) -> Result<ImportReport, ImportError> {
    if let (Ok(log), Ok(out)) = (log.canonicalize(), out.canonicalize())
        && log == out
    {
        return Err(ImportError::SameFile { path: out });
    }
    // Told before the work rather than after.
    let mut writer = Writer::create(out, options.existing)?;
    let Ordered { mut survey, clock, scans, odometry, odometry_left_out, distance_m, longest_gap_ns } =
        Ordered::of(log, options.allow_truncated)?;
    let range_max_m = survey.range_max_m();
    each(log, &mut survey, &scans, &odometry, |record, _| Ok(writer.write(&record)?))?;

    let (_, increment_rad) = geometry(survey.beams);
    let anomalies = survey.counts.by_name();
    let info = writer.finish(About {
        source: log.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        robot: survey.robot.clone(),
        field_of_view_rad: increment_rad * survey.beams.saturating_sub(1) as f64,
        first_wall_clock_s: survey.first_wall_clock_s,
        anomalies: anomalies.clone(),
        run: None,
    })?;
    Ok(ImportReport {
        source: log.to_owned(),
        recording: out.to_owned(),
        lines: survey.lines,
        scans: scans.len() as u64,
        odometry: odometry.len() as u64,
        odometry_left_out,
        duration_s: s_from_ns(info.duration_ns),
        distance_m,
        longest_gap_s: s_from_ns(longest_gap_ns),
        clock,
        beams: survey.beams,
        range_max_m: f64::from(range_max_m),
        robot_from_lidar_x_m: survey.laser_offset_m,
        robot: survey.robot,
        first_wall_clock_s: survey.first_wall_clock_s,
        anomalies,
        skipped: survey.skipped,
        truncated_at_line: survey.truncated_at_line,
    })
}

/// Counts gaps and repeated poses; the way walked, metres, and the longest time between scans, nanoseconds.
fn judge_scans(survey: &mut Survey, stamps_ns: &[u64]) -> (f64, u64) {
    let (mut distance_m, mut longest_ns) = (0.0, 0);
    let (mut gaps, mut repeated) = (0, 0);
    let mut last: Option<(Pose2, u64)> = None;
    for (entry, &stamp_ns) in survey.entries.iter().zip(stamps_ns).filter(|(entry, _)| entry.laser) {
        if let Some((pose, before_ns)) = last {
            distance_m += (entry.pose.x_m - pose.x_m).hypot(entry.pose.y_m - pose.y_m);
            longest_ns = longest_ns.max(stamp_ns - before_ns);
            gaps += u64::from(stamp_ns - before_ns > GAP_NS);
            repeated += u64::from(entry.pose == pose);
        }
        last = Some((entry.pose, stamp_ns));
    }
    survey.counts.add(Anomaly::Gap, gaps);
    survey.counts.add(Anomaly::RepeatedPose, repeated);
    (distance_m, longest_ns)
}

/// Hands every scan and pose of the CARMEN log at `log` to `take`, as [`import`] would write them, in the same order; a
/// scan with the time at which it was sent, in seconds of the log's own clock (`ipc_time`).
///
/// # Errors
/// As [`import`], but for the recording; `take` has had a part of the log only where that changed meanwhile.
pub fn read(log: &Path, mut take: impl FnMut(Record, Option<f64>)) -> Result<(), ImportError> {
    let Ordered { mut survey, scans, odometry, .. } = Ordered::of(log, false)?;
    each(log, &mut survey, &scans, &odometry, |record, sent_s| {
        take(record, sent_s);
        Ok(())
    })
}

/// A log that was read once: its run time and its odometry are known.
struct Ordered {
    survey: Survey,
    clock: Clock,
    /// Stamp, nanoseconds, and time of sending, seconds, of each scan.
    scans: Vec<(u64, f64)>,
    odometry: Vec<Odometry>,
    odometry_left_out: u64,
    distance_m: f64,
    longest_gap_ns: u64,
}

impl Ordered {
    fn of(log: &Path, allow_truncated: bool) -> Result<Self, ImportError> {
        let mut survey = survey(log, allow_truncated)?;
        let clock = choose(&survey.entries);
        let stamps_ns = stamps_ns(&survey.entries, clock, &mut survey.counts);
        let (odometry, odometry_left_out) = odometry(&survey.entries, &stamps_ns);
        let (distance_m, longest_gap_ns) = judge_scans(&mut survey, &stamps_ns);
        let lasers = survey.entries.iter().zip(&stamps_ns).filter(|(entry, _)| entry.laser);
        let scans = lasers.map(|(entry, &stamp_ns)| (stamp_ns, entry.ipc_s)).collect();
        Ok(Self { survey, clock, scans, odometry, odometry_left_out, distance_m, longest_gap_ns })
    }
}

/// Reads the scans once more, as they stand in the log, and gives them away with the odometry between them.
fn each(
    log: &Path,
    survey: &mut Survey,
    scans: &[(u64, f64)],
    odometry: &[Odometry],
    mut give: impl FnMut(Record, Option<f64>) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    let mut odometry = odometry.iter().peekable();
    let mut lines = Lines::open(log)?;
    let mut readings_m = Vec::new();
    for (&(stamp_ns, sent_s), seq) in scans.iter().zip(1..) {
        next_scan(log, &mut lines, &mut readings_m)?;
        while let Some(odometry) = odometry.next_if(|odometry| odometry.header.stamp_ns < stamp_ns) {
            give(Record::from(*odometry), None)?;
        }
        let header = Header { stamp_ns, seq, step: 0, published_ns: 0, incarnation: 1, reserved: 0 };
        give(scan(survey, header, std::mem::take(&mut readings_m)), Some(sent_s))?;
    }
    odometry.try_for_each(|odometry| give(Record::from(*odometry), None))
}

fn next_scan(log: &Path, lines: &mut Lines, readings_m: &mut Vec<f32>) -> Result<(), ImportError> {
    // The survey has seen so many scans; without them it is another log by now.
    while let Next::Line { text, .. } = lines.advance()? {
        if text.starts_with(b"FLASER") {
            let text = String::from_utf8_lossy(text);
            if let Ok(Line::Laser { .. }) = parse(&text, readings_m) {
                return Ok(());
            }
        }
    }
    Err(ImportError::Changed { path: log.to_owned() })
}

fn scan(survey: &mut Survey, header: Header, mut ranges_m: Vec<f32>) -> Record {
    let range_max_m = survey.range_max_m();
    let (mut max, mut zero, mut unknown) = (0, 0, 0);
    for range_m in &mut ranges_m {
        if range_m.is_nan() || *range_m < 0.0 {
            *range_m = f32::NAN;
            unknown += 1;
        }
        zero += u64::from(*range_m == 0.0);
        max += u64::from(*range_m >= range_max_m);
    }
    survey.counts.add(Anomaly::MaxRangeReading, max);
    survey.counts.add(Anomaly::ZeroReading, zero);
    survey.counts.add(Anomaly::UnknownReading, unknown);
    let (angle_min_rad, angle_increment_rad) = geometry(ranges_m.len());
    let header = ScanHeader {
        header,
        angle_min_rad,
        angle_increment_rad,
        range_min_m: RANGE_MIN_M,
        range_max_m: f64::from(range_max_m),
        sigma_m: SIGMA_M,
        robot_from_lidar: Pose2::new(survey.laser_offset_m, 0.0, 0.0),
        height_m: 0.0,
    };
    Slice::<LidarScan> { header, data: ranges_m }.into()
}
