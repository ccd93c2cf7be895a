//! Reading records: of live runs and of ended ones.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use control::{Note, Report, Stop};
use rustix::fs::FlockOperation;

use crate::{
    ABOUT, About, EVENTS, Event, LOCK, LOGS, OLD_EVENTS, REPORT, RecordError, SETTINGS, at, boot_id, event, place, utc,
    wall_time,
};

/// The record of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct PastRun {
    /// Name of the record: its number, start and name of the run.
    pub id: String,
    /// Where it lies.
    pub folder: PathBuf,
    /// What was known of the run at its start.
    pub about: About,
    /// Whether and how it ended.
    pub end: End,
}

/// Whether and how a run ended.
#[derive(Debug, Clone, PartialEq)]
pub enum End {
    /// The run is live.
    Live,
    /// It ended in order, with a report.
    Reported(Box<Report>),
    /// Its supervisor ended without a report.
    Died {
        /// When it last wrote an event.
        last_heard: SystemTime,
        /// Whether the machine was restarted since the run began.
        rebooted: bool,
    },
}

/// All records that this user may read: this user's, the newest first, then those of the system's service.
#[must_use]
pub fn all() -> Vec<PastRun> {
    place::roots().iter().flat_map(|root| in_root(root)).collect()
}

/// The newest record of a run of that name, or with that id.
#[must_use]
pub fn find(name: &str) -> Option<PastRun> {
    all().into_iter().find(|run| run.about.name == name || run.id == name)
}

/// The records in the state folder `root`, the newest first.
pub(crate) fn in_root(root: &Path) -> Vec<PastRun> {
    let entries = fs::read_dir(root.join("runs")).into_iter().flatten().flatten();
    let mut runs: Vec<PastRun> = entries.filter_map(|entry| PastRun::open(entry.path())).collect();
    runs.sort_by_key(|run| std::cmp::Reverse(number_of(&run.id)));
    runs
}

/// The number that the name of a record begins with. Records are numbered, for a robot's clock may be wrong.
pub(crate) fn number_of(id: &str) -> u64 {
    id.split('-').next().and_then(|number| number.parse().ok()).unwrap_or(0)
}

impl PastRun {
    /// The record in `folder`; none where there is no record.
    fn open(folder: PathBuf) -> Option<Self> {
        let id = folder.file_name()?.to_string_lossy().into_owned();
        let about: About = serde_json::from_slice(&read_whole(&folder.join(ABOUT)).ok()?).ok()?;
        // The lock is looked at first: a run that ends in between is then live, and not taken for a dead one.
        let end = if is_locked(&folder) {
            End::Live
        } else if let Some(report) =
            read_whole(&folder.join(REPORT)).ok().and_then(|text| serde_json::from_slice(&text).ok())
        {
            End::Reported(Box::new(report))
        } else {
            let written = |name: &str| fs::metadata(folder.join(name)).and_then(|found| found.modified()).ok();
            let last_heard = written(EVENTS).or_else(|| written(ABOUT)).unwrap_or(SystemTime::UNIX_EPOCH);
            End::Died { last_heard, rebooted: about.boot_id != boot_id() }
        };
        Some(Self { id, folder, about, end })
    }

    /// Whether the run is live.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.end == End::Live
    }

    /// Why and when the run ended, for people; nothing while it is live.
    #[must_use]
    pub fn ended(&self) -> Option<String> {
        match &self.end {
            End::Live => None,
            End::Reported(report) => Some(match &report.failure {
                Some(why) => why.clone(),
                None if report.reached() => "reached its goal".to_owned(),
                None => "in order".to_owned(),
            }),
            End::Died { last_heard, rebooted } => {
                let last_word = |events: Vec<Event>| events.into_iter().rev().find(|event| event.event == "end");
                let killed =
                    if *rebooted { "supervisor killed, or the machine went down" } else { "supervisor killed" };
                let what = self.events().ok().and_then(last_word).map_or(killed.to_owned(), |end| end.message);
                Some(format!("{what}, last heard {}", utc(*last_heard)))
            }
        }
    }

    /// How long the run lasted, or has by now, seconds: run time where there is a report, else wall time.
    #[must_use]
    pub fn lasted_s(&self) -> f64 {
        let since_start = |until: SystemTime| {
            let started = humantime::parse_rfc3339(&self.about.started).unwrap_or(until);
            until.duration_since(started).unwrap_or_default().as_secs_f64()
        };
        match &self.end {
            End::Live => since_start(wall_time()),
            End::Reported(report) => report.duration_s,
            End::Died { last_heard, .. } => since_start(*last_heard),
        }
    }

    /// The events of the run, the oldest first.
    ///
    /// # Errors
    /// Where they cannot be read.
    pub fn events(&self) -> io::Result<Vec<Event>> {
        event::read(&self.folder)
    }

    /// The stops of the run, the oldest first: those of its report, else those of its events.
    ///
    /// # Errors
    /// Where the events cannot be read.
    pub fn stops(&self) -> io::Result<Vec<Stop>> {
        match &self.end {
            End::Reported(report) => Ok(report.stops.clone()),
            End::Live | End::Died { .. } => Ok(stops_of(&self.events()?)),
        }
    }

    /// The notes of the run, the oldest first: those of its report, else those of its events.
    ///
    /// # Errors
    /// Where the events cannot be read.
    pub fn notes(&self) -> io::Result<Vec<Note>> {
        let of_events = || {
            let note = |event: Event| Note { at_s: event.run_s, text: event.message };
            Ok(self.events()?.into_iter().filter(|event| event.event == "note").map(note).collect())
        };
        match &self.end {
            End::Reported(report) => Ok(report.notes.clone()),
            End::Live | End::Died { .. } => of_events(),
        }
    }

    /// The logs of the services, in the order of their names: what each file is called, without `.log`, and its path.
    ///
    /// # Errors
    /// Where the folder cannot be read.
    pub fn logs(&self) -> io::Result<Vec<(String, PathBuf)>> {
        logs_in(&self.folder.join(LOGS))
    }

    /// How many stops the run had.
    ///
    /// # Errors
    /// Where the events cannot be read.
    pub fn stop_count(&self) -> io::Result<u64> {
        match &self.end {
            End::Reported(report) => Ok(report.stops.len() as u64 + report.stops_not_kept),
            End::Live | End::Died { .. } => Ok(self.stops()?.len() as u64),
        }
    }

    /// The files of the journal, lines of JSON, the older one first.
    #[must_use]
    pub fn journal(&self) -> Vec<PathBuf> {
        [OLD_EVENTS, EVENTS].map(|name| self.folder.join(name)).into_iter().filter(|path| is_file(path)).collect()
    }

    /// Whether a run that was live when this was read still is.
    #[must_use]
    pub fn is_still_live(&self) -> bool {
        is_locked(&self.folder)
    }

    /// The settings of the run, whole.
    #[must_use]
    pub fn settings(&self) -> PathBuf {
        self.folder.join(SETTINGS)
    }

    /// The recordings that were asked for, the oldest first.
    ///
    /// # Errors
    /// Where the events cannot be read.
    pub fn recordings(&self) -> io::Result<Vec<PathBuf>> {
        let events = self.events()?.into_iter().filter(|event| event.event == "recording");
        Ok(events.filter_map(|event| event.text("path").map(PathBuf::from)).collect())
    }
}

/// The logs in a folder, in the order of their names.
fn logs_in(folder: &Path) -> io::Result<Vec<(String, PathBuf)>> {
    let name = |path: PathBuf| Some((path.file_name()?.to_str()?.strip_suffix(".log")?.to_owned(), path));
    // A link could lead to what this user may read and whoever made it may not.
    let files = fs::read_dir(folder)?.flatten().filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()));
    let mut logs: Vec<_> = files.filter_map(|entry| name(entry.path())).collect();
    // The tenth life comes behind the second.
    let key = |name: &str| name.split_once('.').map(|(service, life)| (service.to_owned(), life.parse::<u32>().ok()));
    logs.sort_by_cached_key(|(name, _)| key(name));
    Ok(logs)
}

/// Whether it is a file, and no link to one.
pub(crate) fn is_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|found| found.is_file())
}

/// A file of a record, unless it is none or larger than any.
fn read_whole(path: &Path) -> io::Result<Vec<u8>> {
    const MOST_BYTES: u64 = 64 << 20;
    let found = fs::symlink_metadata(path)?;
    if !found.is_file() || found.len() > MOST_BYTES {
        return Err(io::ErrorKind::InvalidData.into());
    }
    fs::read(path)
}

/// Folders of records that this user may not read: of all runs, or of one.
#[must_use]
pub fn closed() -> Vec<PathBuf> {
    let is_closed =
        |folder: &Path| matches!(fs::read_dir(folder), Err(error) if error.kind() == io::ErrorKind::PermissionDenied);
    let below = |runs: PathBuf| {
        let entries: Vec<_> = fs::read_dir(&runs).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        std::iter::once(runs).chain(entries)
    };
    place::roots().into_iter().flat_map(|root| below(root.join("runs"))).filter(|folder| is_closed(folder)).collect()
}

/// Whether the folders of records can be used, where they are there.
///
/// # Errors
/// Names the one that cannot.
pub fn check() -> Result<(), RecordError> {
    for runs in place::roots().into_iter().map(|root| root.join("runs")) {
        match fs::read_dir(&runs) {
            Err(error) if !matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied) => {
                return Err(at(&runs)(error));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Whether a supervisor began this record and died before it was complete.
pub(crate) fn is_unfinished(folder: &Path) -> bool {
    const MAKING: Duration = Duration::from_secs(60);
    let modified = fs::metadata(folder).and_then(|found| found.modified()).ok();
    let age = modified.and_then(|at| wall_time().duration_since(at).ok());
    // The lock is looked at last: a look at a new record could keep its supervisor from taking the lock.
    age.is_some_and(|age| age > MAKING)
        && PastRun::open(folder.to_owned()).is_none()
        && folder.join(LOCK).exists()
        && !is_locked(folder)
}

fn is_locked(folder: &Path) -> bool {
    let Ok(lock) = File::open(folder.join(LOCK)) else { return false };
    matches!(rustix::fs::flock(&lock, FlockOperation::NonBlockingLockShared), Err(rustix::io::Errno::WOULDBLOCK))
}

/// The stops that the events tell of; the last event gives the time of what had not ended by then.
fn stops_of(events: &[Event]) -> Vec<Stop> {
    let mut stops: Vec<(Option<f64>, Stop)> = Vec::new();
    let text = |event: &Event, name: &str| event.text(name).map(str::to_owned);
    for event in events {
        let number = event.number("number");
        match event.event.as_str() {
            "stop" => {
                let stop = Stop {
                    class: text(event, "class").unwrap_or_default(),
                    reason: text(event, "reason").unwrap_or_default(),
                    why: text(event, "why").unwrap_or_default(),
                    service: text(event, "service"),
                    stream: text(event, "stream"),
                    at_s: event.run_s,
                    ..Stop::default()
                };
                stops.push((number, stop));
            }
            "stop_over" => {
                if let Some((_, stop)) = stops.iter_mut().rev().find(|(of, _)| *of == number) {
                    (stop.lasted_s, stop.ended) = (event.number("lasted_s").unwrap_or_default(), true);
                }
            }
            _ => {}
        }
    }
    let last_s = events.last().map_or(0.0, |event| event.run_s);
    let told = |(_, stop): (_, Stop)| {
        let lasted_s = if stop.ended { stop.lasted_s } else { last_s - stop.at_s };
        Stop { lasted_s, ..stop }
    };
    stops.into_iter().map(told).collect()
}
