//! `recording`: what a recording says about itself, whether it is whole, and how a torn one becomes whole.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use recording::{Info, Part, ReadError, Reader, RecoverError, Recovered, later_lives, recover};
use serde_json::{Value, json};

use crate::args::{RecordingArgs, RecordingVerb};
use crate::exit::{Failure, chain};
use crate::out;
use crate::prepare::new_recording;

/// `guidedog recording`
///
/// # Errors
/// Where the recording cannot be read, is damaged or torn, or the whole one cannot be written.
pub fn recording(args: &RecordingArgs, as_json: bool) -> Result<(), Failure> {
    match &args.what {
        RecordingVerb::Info { recording } => info(recording, as_json),
        RecordingVerb::Check { recording } => check(recording, as_json),
        RecordingVerb::Recover { recording, output } => {
            let output = output.clone().unwrap_or_else(|| recording.with_extension("recovered.mcap"));
            recover_all(recording, &new_recording(&output)?, as_json)
        }
    }
}

/// What can be done about it is told with the error.
fn of_reading(error: &ReadError) -> Failure {
    let hint = if matches!(error, ReadError::Torn { .. }) {
        "; `guidedog recording recover` makes a whole one of it"
    } else {
        ""
    };
    Failure::input(format!("{}{hint}", chain(error)))
}

/// What a recording says about itself.
fn info(path: &Path, as_json: bool) -> Result<(), Failure> {
    let info = WholeInfo::of(path)?;
    if as_json {
        return out::json(&info.json()?);
    }
    out::report(info.lines())
}

/// What was recorded in `path` says about itself, and what restarted recorders wrote beside it.
///
/// # Errors
/// Where a file is not whole; the others are told nevertheless.
pub fn lives(path: &Path, as_json: bool) -> Result<(), Failure> {
    let (mut whole, mut torn) = (Vec::new(), Vec::new());
    for path in std::iter::once(path.to_owned()).chain(later_lives(path)) {
        match WholeInfo::of(&path) {
            Ok(info) => whole.push(info),
            Err(failure) => torn.push(failure.message),
        }
    }
    let failure = (!torn.is_empty()).then(|| Failure::run(torn.join("; ")));
    if as_json {
        let mut told = whole.iter().map(WholeInfo::json).collect::<Result<Vec<_>, _>>()?;
        let mut first = if failure.is_none() { told.remove(0) } else { json!({ "torn": torn }) };
        first["further"] = json!(told);
        let Some(failure) = failure else { return out::json(&first) };
        first["error"] = json!(failure.message);
        out::json(&first)?;
        return Err(Failure { told: true, ..failure });
    }
    out::report(whole.iter().flat_map(WholeInfo::lines))?;
    failure.map_or(Ok(()), Err)
}

/// What a recording says about itself, its depth frames included.
struct WholeInfo {
    path: PathBuf,
    info: Info,
    depth_missing: Option<String>,
}

impl WholeInfo {
    fn of(path: &Path) -> Result<Self, Failure> {
        let reader = Reader::open(path).map_err(|error| of_reading(&error))?;
        let depth_missing = reader.depth_missing().map(|file| file.display().to_string());
        Ok(Self { path: path.to_owned(), info: reader.info().clone(), depth_missing })
    }

    fn json(&self) -> Result<Value, Failure> {
        let mut told = told(&self.path, &self.info)?;
        told["depth_missing"] = json!(self.depth_missing);
        Ok(told)
    }

    fn lines(&self) -> Vec<String> {
        let missing = self.depth_missing.iter().map(|missing| format!("  depth: {missing} is missing"));
        lines(&self.path, &self.info).into_iter().chain(missing).collect()
    }
}

fn check(path: &Path, as_json: bool) -> Result<(), Failure> {
    let mut reader = Reader::open(path).map_err(|error| of_reading(&error))?;
    let info = reader.info().clone();
    let missing = reader.depth_missing().map(Path::to_owned);
    reader.settings().map_err(|error| of_reading(&error))?;
    reader.check_bytes().map_err(|error| of_reading(&error))?;
    let mut records: BTreeMap<&str, u64> = BTreeMap::new();
    for record in reader {
        let record = record.map_err(|error| of_reading(&error))?;
        *records.entry(record.topic().name()).or_default() += 1;
    }
    if let Some(missing) = missing {
        return Err(Failure::input(format!(
            "{}: its depth frames are missing: no {}",
            path.display(),
            missing.display()
        )));
    }
    let all: u64 = records.values().sum();
    let report = json!({ "recording": path.display().to_string(), "whole": true, "read": records });
    out::tell(as_json, &report, || {
        let first = format!("{}: {all} records, each of them whole", path.display());
        std::iter::once(first).chain(lines(path, &info).into_iter().skip(1)).collect()
    })
}

/// Recovers a recording, and the file of its depth frames where that is beside it.
fn recover_all(from: &Path, to: &Path, as_json: bool) -> Result<(), Failure> {
    let recovered = |from: &Path, to: &Path| {
        recover(from, to).map_err(|error| match &error {
            RecoverError::Read(error) => of_reading(error),
            RecoverError::Write(error) => Failure::of_run(error),
        })
    };
    let small = recovered(from, to)?;
    let named = small.info.about.run.as_ref().is_some_and(|run| run.depth_file.is_some());
    let beside: PathBuf = Part::Depth.path(from);
    let depth = if named && beside.is_file() { Some(recovered(&beside, &Part::Depth.path(to))?) } else { None };
    let all: Vec<&Recovered> = std::iter::once(&small).chain(&depth).collect();
    out::tell(as_json, &json!({ "recovered": all }), || all.iter().flat_map(|part| recovered_lines(part)).collect())
}

fn recovered_lines(part: &Recovered) -> Vec<String> {
    let cut = part.bytes - part.cut_at_byte;
    let what = match &part.why {
        Some(why) if cut == 0 => format!("  taken over whole, but: {why}"),
        Some(why) => format!("  cut at byte {}, {cut} bytes lost: {why}", part.cut_at_byte),
        None => "  nothing but its end was missing".to_owned(),
    };
    let first = [format!("{} -> {}", part.from.display(), part.to.display()), what];
    first.into_iter().chain(lines(&part.to, &part.info).into_iter().skip(1)).collect()
}

fn told(path: &Path, info: &Info) -> Result<Value, Failure> {
    let mut value = serde_json::to_value(info).map_err(Failure::of_run)?;
    value["recording"] = json!(path.display().to_string());
    value["whole_run"] = json!(info.about.run.as_ref().is_some_and(recording::RunAbout::is_whole));
    Ok(value)
}

fn lines(path: &Path, info: &Info) -> Vec<String> {
    let about = &info.about;
    let records: Vec<String> =
        info.records.iter().filter(|(_, n)| **n > 0).map(|(topic, n)| format!("{topic} {n}")).collect();
    let mut lines = vec![
        format!("{}: {}, robot {}", path.display(), about.source, about.robot),
        format!("  {:.2} s from {:.2} s", messages::s_from_ns(info.duration_ns), messages::s_from_ns(info.start_ns)),
        format!("  records: {}", if records.is_empty() { "none".to_owned() } else { records.join(", ") }),
    ];
    if let Some(run) = &about.run {
        let time = if run.stepped { "stepped" } else { "real" };
        let whole = if run.is_whole() { ", from its first step to its last" } else { "" };
        lines.push(format!("  run {} in {time} time{whole}, seed {}; {}", run.name, run.seed, run.ended));
        let lost: Vec<String> = run.lost.iter().map(|(topic, n)| format!("{topic} {n}")).collect();
        lines.push(format!("  lost: {}", if lost.is_empty() { "none".to_owned() } else { lost.join(", ") }));
    }
    lines
}
