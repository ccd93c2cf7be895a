//! `logs`: the journal of a run and what its services wrote.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::time::Duration;

use messages::ServiceId;
use records::{Event, PastRun};
use serde_json::{Value, json};

use crate::args::LogsArgs;
use crate::exit::Failure;
use crate::history;
use crate::out;

/// The files of a live run are looked at this often.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// What the journal is called among the logs: the supervisor writes it.
const JOURNAL: &str = "supervisor";

/// `guidedog logs`
///
/// # Errors
/// Where there is no such run or service, or a log cannot be read.
pub fn logs(args: &LogsArgs, as_json: bool) -> Result<(), Failure> {
    if let Some(service) = &args.service
        && !ServiceId::ALL.iter().any(|known| known.name() == service)
    {
        let names: Vec<&str> = ServiceId::ALL.iter().map(|service| service.name()).collect();
        return Err(Failure::input(format!("{service} is no service; there are {}", names.join(", "))));
    }
    if as_json && args.follow {
        return Err(Failure::input("--follow and --json exclude each other"));
    }
    let run = history::chosen(args.run.as_deref())?;
    let mut reader = Reader { run, service: args.service.clone(), read: BTreeMap::new(), last: None };
    if as_json {
        return out::json(&reader.json()?);
    }
    if !args.follow {
        return reader.tell_new(true);
    }
    loop {
        // Looked at first: what a run writes before its end is read after it.
        let live = reader.is_live();
        reader.tell_new(!live)?;
        if !live {
            return Ok(());
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Reads the logs of a run as they grow.
struct Reader {
    run: PastRun,
    service: Option<String>,
    /// How far each file was read.
    read: BTreeMap<PathBuf, u64>,
    /// Whose lines came last.
    last: Option<String>,
}

impl Reader {
    fn is_live(&self) -> bool {
        self.run.is_still_live()
    }

    /// The files: what each is called, and where it lies.
    fn files(&self) -> Result<Vec<(String, PathBuf)>, Failure> {
        let failed = |error| Failure::run(format!("{}: {error}", self.run.folder.display()));
        let journal = self.run.journal().into_iter().map(|path| (JOURNAL.to_owned(), path));
        let all = journal.chain(self.run.logs().map_err(failed)?);
        let meant = |name: &str| self.service.as_ref().is_none_or(|service| name.split('.').next() == Some(service));
        Ok(all.filter(|(name, _)| meant(name)).collect())
    }

    /// Writes what is new, file by file; of an unfinished line nothing yet, unless `all` is wanted.
    fn tell_new(&mut self, all: bool) -> Result<(), Failure> {
        for (name, path) in self.files()? {
            let text = self.take_new(&path, all)?;
            if text.is_empty() {
                continue;
            }
            let mut lines = Vec::new();
            if self.service.as_deref() != Some(JOURNAL) && self.last.as_ref() != Some(&name) {
                lines.push(format!("==> {name} <=="));
            }
            let told = |line: &str| if name == JOURNAL { event_line(line) } else { Some(line.to_owned()) };
            lines.extend(text.lines().filter_map(told).map(|line| out::plain(&line)));
            out::report(lines)?;
            self.last = Some(name);
        }
        Ok(())
    }

    fn take_new(&mut self, path: &PathBuf, all: bool) -> Result<String, Failure> {
        let from = self.read.get(path).copied().unwrap_or(0);
        let failed = |error: std::io::Error| Failure::run(format!("{}: {error}", path.display()));
        // It was there a moment ago: the log of an old life is removed, and the journal begins anew.
        let Ok(mut file) = File::open(path) else { return Ok(String::new()) };
        let length = file.metadata().map_err(failed)?.len();
        let from = if length < from { 0 } else { from };
        file.seek(SeekFrom::Start(from)).map_err(failed)?;
        let mut bytes = Vec::new();
        file.take(length - from).read_to_end(&mut bytes).map_err(failed)?;
        if !all {
            bytes.truncate(bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1));
        }
        self.read.insert(path.clone(), from + bytes.len() as u64);
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    fn json(&mut self) -> Result<Value, Failure> {
        let mut logs = BTreeMap::new();
        let mut journal: Vec<Value> = Vec::new();
        for (name, path) in self.files()? {
            let text = self.take_new(&path, true)?;
            if name == JOURNAL {
                journal.extend(text.lines().flat_map(serde_json::from_str));
            } else {
                logs.insert(name, text);
            }
        }
        Ok(json!({ "run": self.run.about.name, "id": self.run.id, "journal": journal, "logs": logs }))
    }
}

/// One line of the journal for people; nothing where it says nothing, or was cut off by a crash.
fn event_line(line: &str) -> Option<String> {
    serde_json::from_str::<Event>(line).ok()?.line()
}
