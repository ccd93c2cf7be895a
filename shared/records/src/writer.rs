//! Writing a record: only the supervisor does.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use control::Report;
use rustix::fs::FlockOperation;

use crate::{ABOUT, About, EventFile, LOCK, LOGS, REPORT, RecordError, SETTINGS, at, past};

/// How many records are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Keep {
    /// Number of runs that are kept, the newest; 0 keeps no records at all.
    pub runs: usize,
    /// Number of bytes that are kept in all.
    pub bytes: u64,
}

/// The record of a live run.
#[derive(Debug)]
pub struct Record {
    folder: PathBuf,
    /// Held while the run is live.
    _lock: File,
}

impl Record {
    /// Begins the record of a run with these settings in the state folder `root`, after removing the oldest records
    /// beyond `keep`.
    ///
    /// # Errors
    /// Where the record cannot be written.
    pub fn begin(root: &Path, about: &About, settings: &str, keep: Keep) -> Result<Self, RecordError> {
        let runs = root.join("runs");
        DirBuilder::new().recursive(true).mode(0o750).create(&runs).map_err(at(&runs))?;
        prune(root, Keep { runs: keep.runs.saturating_sub(1), ..keep });
        let folder = new_folder(&runs, about)?;
        Self::fill(&folder, about, settings).inspect_err(|_| {
            // Half a record tells of nothing.
            let _ = fs::remove_dir_all(&folder);
        })
    }

    fn fill(folder: &Path, about: &About, settings: &str) -> Result<Self, RecordError> {
        let lock = create(&folder.join(LOCK))?;
        // Nobody else knows of it yet: it is no record before `record.json` is there.
        rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive)
            .map_err(|errno| at(&folder.join(LOCK))(errno.into()))?;
        let record = Self { folder: folder.to_owned(), _lock: lock };
        DirBuilder::new().mode(0o750).create(record.logs()).map_err(at(&record.logs()))?;
        record.write(SETTINGS, settings)?;
        let text = serde_json::to_string_pretty(about).map_err(|error| at(&record.folder)(error.into()))?;
        record.write(ABOUT, &text)?;
        Ok(record)
    }

    /// Removes the record of a run that cannot keep one.
    pub fn discard(self) {
        // What cannot be removed now goes when a later run starts.
        let _ = fs::remove_dir_all(&self.folder);
    }

    /// The folder of the record.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The folder of the services' logs.
    #[must_use]
    pub fn logs(&self) -> PathBuf {
        self.folder.join(LOGS)
    }

    /// The file for the events of the run.
    ///
    /// # Errors
    /// Where it cannot be made.
    pub fn events(&self) -> Result<EventFile, RecordError> {
        EventFile::create(&self.folder).map_err(at(&self.folder))
    }

    /// Writes how the run ended.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn end(&self, report: &Report) -> Result<(), RecordError> {
        let text = serde_json::to_string_pretty(report).map_err(|error| at(&self.folder)(error.into()))?;
        self.write(REPORT, &text)
    }

    /// Writes a file as a whole: a crash or a power cut leaves none rather than half of one.
    fn write(&self, name: &str, text: &str) -> Result<(), RecordError> {
        let (path, new) = (self.folder.join(name), self.folder.join(format!("{name}.new")));
        let mut file = create(&new)?;
        file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).map_err(at(&new))?;
        fs::rename(&new, &path).map_err(at(&path))?;
        File::open(&self.folder).and_then(|folder| folder.sync_all()).map_err(at(&self.folder))
    }
}

fn create(path: &Path) -> Result<File, RecordError> {
    OpenOptions::new().write(true).create(true).truncate(true).mode(0o640).open(path).map_err(at(path))
}

/// Makes a folder with the next number. Two runs that start at once may get the same number, with different names.
fn new_folder(runs: &Path, about: &About) -> Result<PathBuf, RecordError> {
    const TRIES: u64 = 100;
    let entries = fs::read_dir(runs).map_err(at(runs))?.flatten();
    let last = entries.map(|entry| past::number_of(&entry.file_name().to_string_lossy())).max().unwrap_or(0);
    let started = about.started.replace(['-', ':'], "");
    let mut made = Err(std::io::ErrorKind::AlreadyExists.into());
    let mut folder = runs.to_owned();
    for number in last + 1..=last + TRIES {
        folder = runs.join(format!("{number:06}-{started}-{}", about.name));
        made = DirBuilder::new().mode(0o750).create(&folder);
        if made.as_ref().err().is_none_or(|error| error.kind() != std::io::ErrorKind::AlreadyExists) {
            break;
        }
    }
    made.map_err(at(&folder)).map(|()| folder)
}

/// Removes the oldest records of ended runs beyond `keep`; the newest of them stays, however large: it may be the one
/// that an engineer wants. Also removes what a supervisor left that died before it had begun its record.
fn prune(root: &Path, keep: Keep) {
    let (mut runs, mut bytes, mut ended) = (0, 0, 0);
    for run in past::in_root(root) {
        runs += 1;
        bytes += size_of(&run.folder);
        ended += usize::from(!run.is_live());
        if (runs > keep.runs || bytes > keep.bytes) && !run.is_live() && (ended > 1 || keep.runs == 0) {
            // What cannot be removed now is tried again at the next start.
            let _ = fs::remove_dir_all(&run.folder);
        }
    }
    let entries = fs::read_dir(root.join("runs")).into_iter().flatten().flatten();
    for folder in entries.map(|entry| entry.path()).filter(|folder| past::is_unfinished(folder)) {
        let _ = fs::remove_dir_all(folder);
    }
}

/// Bytes of all files in a folder and those below it.
fn size_of(folder: &Path) -> u64 {
    let size = |entry: fs::DirEntry| match entry.metadata() {
        Ok(found) if found.is_dir() => size_of(&entry.path()),
        Ok(found) => found.len(),
        Err(_) => 0,
    };
    fs::read_dir(folder).into_iter().flatten().flatten().map(size).sum()
}
