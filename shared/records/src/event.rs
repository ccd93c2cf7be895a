//! What happened in a run: one line of JSON for each event.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::past::is_file;
use crate::{EVENTS, OLD_EVENTS};

/// At this size, bytes, the file of events is renamed and a new one begins.
const FILE_BYTES: u64 = 8 << 20;

/// The event that says only that the supervisor lives.
pub const ALIVE: &str = "alive";

/// How a line says that it is a warning or an error.
const LEVELS: [&[u8]; 2] = [br#""level":"WARN""#, br#""level":"ERROR""#];

/// One event, as `tracing` writes it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Event {
    /// Wall time, UTC, as RFC 3339 has it.
    pub timestamp: String,
    /// "DEBUG", "INFO", "WARN" or "ERROR".
    pub level: String,
    /// What happened, for people.
    pub message: String,
    /// What kind of event it is: "stop", "mode", "note".
    #[serde(default)]
    pub event: String,
    /// Run time, seconds.
    #[serde(default)]
    pub run_s: f64,
    /// What else is known of it.
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

impl Event {
    /// The text under that name, if it is one.
    #[must_use]
    pub fn text(&self, name: &str) -> Option<&str> {
        self.more.get(name).and_then(Value::as_str)
    }

    /// The number under that name, if it is one.
    #[must_use]
    pub fn number(&self, name: &str) -> Option<f64> {
        self.more.get(name).and_then(Value::as_f64)
    }

    /// The event as one line for people; nothing for a sign of life.
    #[must_use]
    pub fn line(&self) -> Option<String> {
        let Self { timestamp, level, message, run_s, event, .. } = self;
        (event != ALIVE).then(|| format!("{timestamp} {run_s:9.2} s {level:>5}  {message}"))
    }
}

/// The events of the record in `folder`, the oldest first. A line that was cut off by a crash is left out.
///
/// # Errors
/// Where the file cannot be read.
pub(crate) fn read(folder: &Path) -> io::Result<Vec<Event>> {
    let mut events = Vec::new();
    for name in [OLD_EVENTS, EVENTS] {
        let path = folder.join(name);
        if !is_file(&path) {
            continue;
        }
        let file = File::open(path)?;
        for line in BufReader::new(file).split(b'\n') {
            events.extend(serde_json::from_slice::<Event>(&line?));
        }
    }
    Ok(events)
}

/// The file that events are written to. It never grows beyond 8 MiB: then it is renamed and begins anew.
#[derive(Debug)]
pub struct EventFile {
    folder: PathBuf,
    file: File,
    bytes: u64,
    /// A warning or an error was written.
    urgent: bool,
}

impl EventFile {
    pub(crate) fn create(folder: &Path) -> io::Result<Self> {
        Ok(Self { folder: folder.to_owned(), file: open(folder)?, bytes: 0, urgent: false })
    }
}

fn open(folder: &Path) -> io::Result<File> {
    OpenOptions::new().append(true).create(true).mode(0o640).open(folder.join(EVENTS))
}

impl Write for EventFile {
    /// Writes a whole line, so that no event is split between two files.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if self.bytes > FILE_BYTES {
            std::fs::rename(self.folder.join(EVENTS), self.folder.join(OLD_EVENTS))?;
            (self.file, self.bytes) = (open(&self.folder)?, 0);
        }
        self.file.write_all(line)?;
        self.bytes += line.len() as u64;
        self.urgent |= LEVELS.iter().any(|level| line.windows(level.len()).any(|part| part == *level));
        Ok(line.len())
    }

    /// Syncs warnings and errors, so that the journal shows what led to a power cut. Other lines are not synced:
    /// frequent syncs slow the disk for all other programs.
    fn flush(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.urgent) { self.file.sync_data() } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::{EventFile, FILE_BYTES, read};
    use std::io::Write;

    #[test]
    fn the_newest_events_are_kept_and_a_torn_line_is_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut file = EventFile::create(folder.path()).expect("made");
        let lines = 3 * FILE_BYTES / 1000;
        for number in 0..lines {
            let filler = "x".repeat(900);
            let line = format!(
                r#"{{"timestamp":"t","level":"INFO","message":"m","run_s":1.5,"number":{number},"f":"{filler}"}}"#
            );
            file.write_all(format!("{line}\n").as_bytes()).expect("written");
        }
        file.write_all(br#"{"timestamp":"t","le"#).expect("written");
        let events = read(folder.path()).expect("read");
        let numbers: Vec<u64> = events.iter().filter_map(|event| event.more["number"].as_u64()).collect();
        assert_eq!(numbers.last(), Some(&(lines - 1)));
        assert!(numbers.windows(2).all(|pair| pair[0] + 1 == pair[1]));
        assert!(numbers.len() as u64 > FILE_BYTES / 1000 && (numbers.len() as u64) < lines, "{}", numbers.len());
    }
}
