//! Run records: what a run leaves behind, also when its supervisor was killed. Warnings in its journal also survive a
//! power cut.
//!
//! `<state>/runs/<number>-<start>-<name>/` holds `record.json` ([`About`]), `settings.toml`, `events.jsonl` (one line
//! for each [`Event`]), `logs/` (the logs of the services, which write there from their start), `report.json` (written
//! at an orderly end) and `lock`. The supervisor holds the lock while the run is live. So a record without a lock
//! holder and without a report is that of a run whose supervisor died.
//!
//! Architecture invariant: this crate knows neither shared memory nor settings. Only the supervisor writes; everybody
//! who may read the files can look.

mod event;
mod past;
mod place;
mod writer;

pub use event::{ALIVE, Event, EventFile};
pub use past::{End, PastRun, all, check, closed, find};
pub use place::own_root;
pub use writer::{Keep, Record};

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

const ABOUT: &str = "record.json";
const EVENTS: &str = "events.jsonl";
const OLD_EVENTS: &str = "events.old.jsonl";
const LOCK: &str = "lock";
const LOGS: &str = "logs";
const REPORT: &str = "report.json";
const SETTINGS: &str = "settings.toml";

/// What is known of a run at its start.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct About {
    /// Name of the run.
    pub name: String,
    /// Version of the supervisor.
    pub version: String,
    /// Start of the run, UTC, as RFC 3339 has it.
    pub started: String,
    /// Process id of the supervisor.
    pub supervisor_pid: u32,
    /// The kernel's id of the boot: where it is another now, the machine was restarted.
    pub boot_id: String,
}

impl About {
    /// A run of that name which this process, of that version, starts now.
    #[must_use]
    pub fn now(name: &str, version: &str) -> Self {
        Self {
            name: name.to_owned(),
            version: version.to_owned(),
            started: now_utc(),
            supervisor_pid: std::process::id(),
            boot_id: boot_id(),
        }
    }
}

/// Why a record cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct RecordError {
    /// The file or folder.
    path: PathBuf,
    /// What went wrong.
    source: std::io::Error,
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> RecordError {
    let path = path.to_owned();
    move |source| RecordError { path, source }
}

/// Wall time, UTC, as RFC 3339 has it, to the second. It is for people: nothing else in a run depends on it.
#[must_use]
pub fn now_utc() -> String {
    utc(wall_time())
}

fn utc(time: SystemTime) -> String {
    humantime::format_rfc3339_seconds(time).to_string()
}

fn wall_time() -> SystemTime {
    SystemTime::now()
}

fn boot_id() -> String {
    let id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id");
    id.map(|id| id.trim().to_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
