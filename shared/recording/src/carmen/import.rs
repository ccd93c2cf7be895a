//! The second pass over a log: writes the recording.

use std::path::Path;

use messages::{Header, NS_PER_S, Odometry, Pose2, ScanHeader, s_from_ns};

use super::input::{Lines, Next};
use super::line::{Line, geometry, parse};
use super::motion::odometry;
use super::report::{Anomaly, ImportError, ImportReport};
use super::survey::{Survey, survey};
use super::timeline::{choose, stamps_ns};
use crate::{About, Existing, Record, Writer};

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
    let mut survey = survey(log, options.allow_truncated)?;
    let clock = choose(&survey.entries);
    let stamps_ns = stamps_ns(&survey.entries, clock, &mut survey.counts);
    let (odometry, odometry_left_out) = odometry(&survey.entries, &stamps_ns);
    let (distance_m, longest_gap_ns) = judge_scans(&mut survey, &stamps_ns);
    let range_max_m = survey.range_max_m();

    let lasers = survey.entries.iter().zip(&stamps_ns).filter(|(entry, _)| entry.laser);
    let scan_stamps_ns: Vec<u64> = lasers.map(|(_, &stamp_ns)| stamp_ns).collect();
    write_all(log, &mut writer, &mut survey, &scan_stamps_ns, &odometry)?;

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
        scans: scan_stamps_ns.len() as u64,
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

/// Writes the scans as they stand in the log, and the odometry between them.
fn write_all(
    log: &Path,
    writer: &mut Writer,
    survey: &mut Survey,
    scan_stamps_ns: &[u64],
    odometry: &[Odometry],
) -> Result<(), ImportError> {
    let mut odometry = odometry.iter().peekable();
    let mut lines = Lines::open(log)?;
    let mut readings_m = Vec::new();
    for (&stamp_ns, seq) in scan_stamps_ns.iter().zip(1..) {
        next_scan(log, &mut lines, &mut readings_m)?;
        while let Some(odometry) = odometry.next_if(|odometry| odometry.header.stamp_ns < stamp_ns) {
            writer.write(&Record::Odometry(*odometry))?;
        }
        let header = Header { stamp_ns, seq, step: 0, published_ns: 0, incarnation: 1, reserved: 0 };
        writer.write(&scan(survey, header, std::mem::take(&mut readings_m)))?;
    }
    for odometry in odometry {
        writer.write(&Record::Odometry(*odometry))?;
    }
    Ok(())
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
    };
    Record::Scan { header, ranges_m }
}
