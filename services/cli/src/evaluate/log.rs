//! Outcomes in a file, a line of JSON for each episode as it ends: an evaluation goes on from there, and those of
//! several machines are put together.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use episodes::Report;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::outcome::Outcome;
use crate::exit::Failure;

/// Outcomes by the number of their episode.
pub type Outcomes = BTreeMap<usize, Outcome>;

/// A line of the file.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    number: usize,
    report: Report,
    stopped: bool,
    latency_us: Vec<u32>,
}

/// A file that outcomes are written to.
#[derive(Debug)]
pub struct Log {
    path: PathBuf,
    file: Mutex<File>,
}

impl Log {
    /// A new file for the episodes that `head` describes.
    ///
    /// # Errors
    /// Where there is one already, or it cannot be written.
    pub fn create(path: &Path, head: &Value) -> Result<Self, Failure> {
        let mut file = OpenOptions::new().write(true).create_new(true).open(path).map_err(|error| {
            let more =
                if error.kind() == std::io::ErrorKind::AlreadyExists { "; --resume goes on with it" } else { "" };
            Failure::input(format!("{}: {error}{more}", path.display()))
        })?;
        writeln!(file, "{head}").map_err(|error| failed(path, &error))?;
        Ok(Self { path: path.to_owned(), file: Mutex::new(file) })
    }

    /// A file that is there, and what it has. A line that was being written when it was left is dropped.
    ///
    /// # Errors
    /// Where it is of other episodes than `head` describes, or cannot be read and written.
    pub fn resume(path: &Path, head: &Value) -> Result<(Self, Outcomes), Failure> {
        let open = OpenOptions::new().read(true).write(true).open(path);
        let mut file = open.map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(|error| failed(path, &error))?;
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let (theirs, outcomes) = parse(path, &text[..whole])?;
        same(path, &theirs, head)?;
        let cut = file.set_len(whole as u64).and_then(|()| file.seek(SeekFrom::End(0)));
        cut.map_err(|error| failed(path, &error))?;
        Ok((Self { path: path.to_owned(), file: Mutex::new(file) }, outcomes))
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn add(&self, number: usize, outcome: &Outcome) -> Result<(), Failure> {
        let latency_us = outcome.latency_us.iter().map(|us| us.round() as u32).collect();
        let line = Line { number, report: outcome.report, stopped: outcome.stopped, latency_us };
        let text = serde_json::to_string(&line).map_err(Failure::of_run)? + "\n";
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(text.as_bytes()).map_err(|error| failed(&self.path, &error))
    }
}

/// The episodes of several files, which must be of one evaluation, and what describes it.
///
/// # Errors
/// Where a file cannot be read, or is of other episodes than the first.
pub fn merge(paths: &[PathBuf]) -> Result<(Value, Outcomes), Failure> {
    let (mut head, mut all) = (Value::Null, Outcomes::new());
    for path in paths {
        let text = std::fs::read_to_string(path);
        let text = text.map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
        let (theirs, outcomes) = parse(path, &text)?;
        if head.is_null() {
            head = theirs;
        } else {
            same(path, &theirs, &head)?;
        }
        all.extend(outcomes);
    }
    Ok((head, all))
}

fn parse(path: &Path, text: &str) -> Result<(Value, Outcomes), Failure> {
    let wrong =
        |line: usize, why: &dyn std::fmt::Display| Failure::input(format!("{}, line {line}: {why}", path.display()));
    let mut lines = text.lines();
    let head: Value = serde_json::from_str(lines.next().unwrap_or_default())
        .map_err(|error| wrong(1, &format!("these are no outcomes of an evaluation: {error}")))?;
    let outcome = |(i, line): (usize, &str)| {
        let line: Line = serde_json::from_str(line).map_err(|error| wrong(i + 2, &error))?;
        let latency_us = line.latency_us.iter().map(|us| *us as f32).collect();
        Ok((line.number, Outcome { report: line.report, stopped: line.stopped, latency_us, trace: None }))
    };
    Ok((head, lines.enumerate().map(outcome).collect::<Result<_, _>>()?))
}

/// Refuses a file of other episodes.
fn same(path: &Path, theirs: &Value, ours: &Value) -> Result<(), Failure> {
    let keys = ours.as_object().into_iter().flatten().map(|(key, _)| key);
    let keys = keys.chain(theirs.as_object().into_iter().flatten().map(|(key, _)| key));
    let other = keys.into_iter().find(|key| theirs[key.as_str()] != ours[key.as_str()]);
    other.map_or(Ok(()), |key| {
        let (theirs, ours) = (&theirs[key.as_str()], &ours[key.as_str()]);
        Err(Failure::input(format!("{}: its {key} is {theirs}, not {ours}", path.display())))
    })
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::run(format!("{}: {error}", path.display()))
}
