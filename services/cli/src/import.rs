//! `import`: other people's logs into recordings.

use std::path::{Path, PathBuf};

use recording::carmen::{ImportOptions, ImportReport, import as import_carmen};
use recording::{Existing, rplidar};
use serde_json::Value;

use crate::args::{ImportArgs, ImportFormat};
use crate::exit::Failure;
use crate::out;

/// `guidedog import`
///
/// # Errors
/// Where the log is wrong or the recording cannot be written.
pub fn import(args: &ImportArgs, as_json: bool) -> Result<(), Failure> {
    let existing = |force: bool| if force { Existing::Replace } else { Existing::Refuse };
    match &args.format {
        ImportFormat::Carmen { log, output, force, allow_truncated } => {
            let options = ImportOptions { existing: existing(*force), allow_truncated: *allow_truncated };
            carmen(log, output, options, as_json)
        }
        ImportFormat::Rplidar { captures, output, force, field_of_view } => {
            let field_of_view_rad = field_of_view.to_radians();
            rplidar(captures, output, rplidar::ImportOptions { existing: existing(*force), field_of_view_rad }, as_json)
        }
    }
}

fn rplidar(captures: &[PathBuf], output: &Path, options: rplidar::ImportOptions, as_json: bool) -> Result<(), Failure> {
    let report = rplidar::import(captures, output, options).map_err(|error| {
        let exists = matches!(error, rplidar::ImportError::Write(recording::WriteError::Exists { .. }));
        let hint = if exists { "; --force replaces it" } else { "" };
        Failure::input(format!("{}{hint}", crate::exit::chain(&error)))
    })?;
    out::tell(as_json, &serde_json::to_value(&report).map_err(Failure::of_run)?, || {
        let zeros = 100.0 * report.zero_distance as f64 / report.nodes.max(1) as f64;
        vec![
            format!("{} captures -> {}", report.sources.len(), report.recording.display()),
            format!("  {} scans of {} beams, {:.1} s", report.scans, report.beams, report.duration_s),
            format!("  {} nodes, {zeros:.1} % with distance 0; {} bytes skipped", report.nodes, report.skipped_bytes),
        ]
    })
}

fn carmen(log: &Path, output: &Path, options: ImportOptions, as_json: bool) -> Result<(), Failure> {
    let report = import_carmen(log, output, options).map_err(|error| {
        let hint = match &error {
            recording::carmen::ImportError::Write(recording::WriteError::Exists { .. }) => "; --force replaces it",
            recording::carmen::ImportError::TruncatedLine { .. }
            | recording::carmen::ImportError::TruncatedStream { .. } => "; --allow-truncated takes what is there",
            _ => "",
        };
        Failure::input(format!("{}{hint}", crate::exit::chain(&error)))
    })?;
    out::tell(as_json, &serde_json::to_value(&report).map_err(Failure::of_run)?, || lines(&report))
}

fn lines(report: &ImportReport) -> Vec<String> {
    let mut lines = vec![
        format!("{} -> {}", report.source.display(), report.recording.display()),
        format!(
            "  {} scans of {} beams, {} odometry records, {} lines",
            report.scans, report.beams, report.odometry, report.lines
        ),
        format!(
            "  {:.1} s, {:.1} m, longest gap {:.2} s, range to {:.1} m, {} clock",
            report.duration_s,
            report.distance_m,
            report.longest_gap_s,
            report.range_max_m,
            serde_json::to_value(report.clock).ok().as_ref().and_then(Value::as_str).unwrap_or("?"),
        ),
    ];
    let odd: Vec<String> =
        report.anomalies.iter().filter(|(_, n)| **n > 0).map(|(name, n)| format!("{name} {n}")).collect();
    lines.push(format!("  anomalies: {}", if odd.is_empty() { "none".to_owned() } else { odd.join(", ") }));
    if !report.skipped.is_empty() {
        let skipped: Vec<String> = report.skipped.iter().map(|(word, n)| format!("{word} {n}")).collect();
        lines.push(format!("  not imported: {}", skipped.join(", ")));
    }
    if let Some(line) = report.truncated_at_line {
        lines.push(format!("  truncated at line {line}: taken as far as it goes"));
    }
    lines
}
