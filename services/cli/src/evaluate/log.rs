//! Outcomes in a file, a line of JSON for each episode as it ends: an evaluation goes on from there, and those of
//! several machines are put together.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use episodes::{Failure as Failed, Report};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::outcome::Outcome;
use super::regular;
use crate::exit::Failure;

/// Key of a head that tells which part of the episodes a file has.
pub const SHARD: &str = "shard";

/// Keys of a head that stand in no report: digests of the program and of the maps.
pub const ONLY_THERE: [&str; 2] = ["program_sha256", "worlds_sha256"];

/// Outcomes by the number of their episode.
pub type Outcomes = BTreeMap<usize, Outcome>;

/// A line of the file.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    number: usize,
    report: Report,
    stopped: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    failed: Option<Failed>,
    latency_us: Vec<u32>,
}

impl Line {
    fn of(number: usize, outcome: &Outcome) -> Self {
        let latency_us = outcome.latency_us.iter().map(|us| us.round() as u32).collect();
        Self { number, report: outcome.report, stopped: outcome.stopped, failed: outcome.failed, latency_us }
    }

    fn text(&self) -> Result<String, Failure> {
        Ok(serde_json::to_string(self).map_err(Failure::of_run)? + "\n")
    }
}

/// SHA-256 over what became of each episode, in the order of their numbers. How long decisions took is not in it, so
/// that every machine has the same.
///
/// # Errors
/// Where an outcome cannot be written as JSON.
pub fn digest(outcomes: &Outcomes) -> Result<String, Failure> {
    let mut hash = Sha256::new();
    for (number, outcome) in outcomes {
        hash.update(Line { latency_us: Vec::new(), ..Line::of(*number, outcome) }.text()?);
    }
    Ok(super::hex(&hash.finalize()))
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
        let created = OpenOptions::new().append(true).create_new(true).open(path).map_err(|error| {
            let more =
                if error.kind() == std::io::ErrorKind::AlreadyExists { "; --resume goes on with it" } else { "" };
            Failure::input(format!("{}: {error}{more}", path.display()))
        })?;
        Self::begin(path, created, head)
    }

    /// A file that is there, and what it has. A line that was being written when it was left is dropped.
    ///
    /// # Errors
    /// Where it is of other episodes than `head` describes, cannot be read and written, or another evaluation writes to
    /// it.
    pub fn resume(path: &Path, head: &Value) -> Result<(Self, Outcomes), Failure> {
        regular(path)?;
        let open = OpenOptions::new().read(true).append(true).open(path);
        let mut file = open.map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
        lock(path, &file)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(|error| failed(path, &error))?;
        let whole = whole(&bytes);
        if whole.is_empty() {
            if !format!("{head}\n").into_bytes().starts_with(&bytes) {
                return Err(Failure::input(format!("{}: this is no file of outcomes", path.display())));
            }
            file.set_len(0).map_err(|error| failed(path, &error))?;
            return Ok((Self::begin(path, file, head)?, Outcomes::new()));
        }
        let (theirs, outcomes) = parse(path, whole)?;
        same(path, &theirs, head, &[])?;
        file.set_len(whole.len() as u64).map_err(|error| failed(path, &error))?;
        Ok((Self { path: path.to_owned(), file: Mutex::new(file) }, outcomes))
    }

    fn begin(path: &Path, mut file: File, head: &Value) -> Result<Self, Failure> {
        lock(path, &file)?;
        writeln!(file, "{head}").map_err(|error| failed(path, &error))?;
        Ok(Self { path: path.to_owned(), file: Mutex::new(file) })
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn add(&self, number: usize, outcome: &Outcome) -> Result<(), Failure> {
        let text = Line::of(number, outcome).text()?;
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(text.as_bytes()).map_err(|error| failed(&self.path, &error))
    }
}

/// Writes a file with these episodes.
///
/// # Errors
/// As [`Log::create`].
pub fn write(path: &Path, head: &Value, outcomes: &Outcomes) -> Result<(), Failure> {
    let log = Log::create(path, head)?;
    outcomes.iter().try_for_each(|(number, outcome)| log.add(*number, outcome))
}

/// The episodes of several files, which must be of one evaluation, and what describes it.
///
/// # Errors
/// Where a file cannot be read, is of other episodes than the first, or tells otherwise of one that another has.
pub fn merge(paths: &[PathBuf]) -> Result<(Value, Outcomes), Failure> {
    let (mut head, mut all) = (None, Outcomes::new());
    for path in paths {
        regular(path)?;
        let bytes = std::fs::read(path).map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
        let (theirs, outcomes) = parse(path, whole(&bytes))?;
        same(path, &theirs, head.get_or_insert_with(|| theirs.clone()), &[SHARD])?;
        for (number, outcome) in outcomes {
            add(path, &mut all, number, outcome)?;
        }
    }
    Ok((head.unwrap_or_default(), all))
}

/// Adds an episode. The same one has the same outcome wherever it was run.
fn add(path: &Path, all: &mut Outcomes, number: usize, outcome: Outcome) -> Result<(), Failure> {
    if all.get(&number).is_some_and(|other| other.told() != outcome.told()) {
        return Err(Failure::input(format!(
            "{}: episode {number} is there twice, and came out otherwise",
            path.display()
        )));
    }
    all.insert(number, outcome);
    Ok(())
}

/// The lines that were written to their end.
fn whole(bytes: &[u8]) -> &[u8] {
    &bytes[..bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1)]
}

fn parse(path: &Path, bytes: &[u8]) -> Result<(Value, Outcomes), Failure> {
    let wrong =
        |line: usize, why: &dyn std::fmt::Display| Failure::input(format!("{}, line {line}: {why}", path.display()));
    let none = |why: &dyn std::fmt::Display| wrong(1, &format!("these are no outcomes of an evaluation: {why}"));
    let mut lines = bytes.split(|byte| *byte == b'\n').enumerate().filter(|(_, line)| !line.is_empty());
    let (_, head) = lines.next().ok_or_else(|| none(&"it is empty"))?;
    let head: Value = serde_json::from_slice(head).map_err(|error| none(&error))?;
    let count = head["episodes"].as_u64().filter(|_| head["seed"].is_u64() && head["tasks"].is_string());
    let count = count.ok_or_else(|| none(&"it says neither episodes nor seed nor tasks"))?;
    let mut outcomes = Outcomes::new();
    for (i, line) in lines {
        let line: Line = serde_json::from_slice(line).map_err(|error| wrong(i + 1, &error))?;
        if line.number as u64 >= count {
            return Err(wrong(i + 1, &format!("episode {} of {count}, counted from 0", line.number)));
        }
        let latency_us = line.latency_us.iter().map(|us| *us as f32).collect();
        let Line { report, stopped, failed, .. } = line;
        let outcome = Outcome { report, stopped, failed, latency_us, trace: None };
        add(path, &mut outcomes, line.number, outcome)?;
    }
    Ok((head, outcomes))
}

/// Refuses a file of other episodes. Some keys may differ.
fn same(path: &Path, theirs: &Value, ours: &Value, but: &[&str]) -> Result<(), Failure> {
    let keys =
        |of: &'_ Value| of.as_object().map(|object| object.keys().cloned().collect::<Vec<_>>()).unwrap_or_default();
    let mut all = keys(ours).into_iter().chain(keys(theirs));
    let other = all.find(|key| !but.contains(&key.as_str()) && theirs[key] != ours[key]);
    other.map_or(Ok(()), |key| {
        let (theirs, ours) = (&theirs[&key], &ours[&key]);
        Err(Failure::input(format!("{}: its {key} is {theirs}, not {ours}", path.display())))
    })
}

fn lock(path: &Path, file: &File) -> Result<(), Failure> {
    let locked = file.try_lock();
    locked.map_err(|error| Failure::input(format!("{}: another evaluation writes to it ({error})", path.display())))
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::run(format!("{}: {error}", path.display()))
}
