//! The run directory: everything of one run that is a file, and the lock that says whether the run is alive.
//!
//! `<root>/<name>/` holds `lock` (held by the supervisor), `run.json`, `settings.toml`, `recording.json`,
//! `control.sock`, `logs/` and `iox/` (iceoryx2's files). Its shared memory carries a prefix of its own, so that
//! many runs live side by side.
//!
//! The directory is the user's and open to its group, which may read and connect to the socket; `iox/` and `lock` are
//! the user's alone. Nothing is made in, believed of, or removed from a place that another user may have made.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::net::Ipv4Addr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

use messages::ServiceId;
use rustix::fs::{FlockOperation, Mode, OFlags};
use serde::{Deserialize, Serialize};

use crate::short_path::short_folder;
use crate::{ClockKind, TransportError};

/// Where the runs of the system's service live (config/systemd/guidedog.service). Only root can make it.
const SERVICE_ROOT: &str = "/run/guidedog";
/// What a run's lock says.
const MARK: &str = "a run of guidedog\n";
/// Everything that a run leaves in its directory. A directory with anything else in it is not ours to remove.
const OURS: [&str; 20] = [
    "lock",
    "recording.json",
    "run.json",
    "settings.toml",
    "control.sock",
    "robot.sock",
    "rplidar",
    "lidar.kept",
    // What earlier versions called `lidar.kept`: the runs that they left behind are swept, too.
    "rplidar.baud",
    "estop",
    "camera.sock",
    "bridge.sock",
    "backstop.sock",
    "handler.json",
    "handler.new",
    "voice.begun",
    "logs",
    "logs.link",
    "iox",
    "plain",
];

/// What every process of a run must know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunInfo {
    /// Name of the run.
    pub name: String,
    /// Prefix of the run's shared memory.
    pub prefix: String,
    /// Process id of the supervisor.
    pub supervisor_pid: u32,
    /// Start of the run on the monotonic clock, nanoseconds.
    pub started_monotonic_ns: u64,
    /// How run time passes.
    pub clock: ClockKind,
    /// Whether faults may be injected.
    pub faults: bool,
}

/// The directory of a run.
#[derive(Debug)]
pub struct RunDir {
    path: PathBuf,
    /// Held for as long as the run is alive; only by the supervisor.
    lock: Option<File>,
}

fn fail(path: &Path, reason: impl std::fmt::Display) -> TransportError {
    TransportError::RunDir { path: path.to_owned(), reason: reason.to_string() }
}

/// Whether a run may have that name; its path is checked when it is made.
///
/// # Errors
/// Says what a name is like.
pub fn check_run_name(name: &str) -> Result<(), String> {
    let usable = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    if usable { Ok(()) } else { Err("a run's name has letters, digits, '-' and '_' only".to_owned()) }
}

/// Where this user's runs live: `$GUIDEDOG_RUNS`, else `/tmp/guidedog-<uid>`.
#[must_use]
pub fn runs_root() -> PathBuf {
    named_root().unwrap_or_else(|| PathBuf::from(format!("/tmp/guidedog-{}", rustix::process::getuid().as_raw())))
}

fn named_root() -> Option<PathBuf> {
    let named = std::env::var_os("GUIDEDOG_RUNS").filter(|root| !root.is_empty()).map(PathBuf::from)?;
    // Prefixes in shared memory are of the path: the same words in two folders are two places.
    Some(std::path::absolute(&named).unwrap_or(named))
}

/// Where runs are looked for: `$GUIDEDOG_RUNS` alone, else the user's own place and the service's.
fn roots() -> Vec<PathBuf> {
    named_root().map_or_else(|| vec![runs_root(), SERVICE_ROOT.into()], |root| vec![root])
}

/// Whether what is found where runs live may be believed. Anybody can make the default place in `/tmp` before its user
/// does; whose runs are looked at by naming their place is the caller's own choice.
///
/// # Errors
/// Says what is wrong with it. A place that is not there yet is none.
pub fn check_runs_root() -> Result<(), TransportError> {
    let root = runs_root();
    match fs::symlink_metadata(&root) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Ok(_) if named_root().is_some() && root.is_dir() => Ok(()),
        _ => check_own(&root),
    }
}

/// Whether a directory is of this user (or root's) and nobody else may write to it.
fn check_own(dir: &Path) -> Result<(), TransportError> {
    const HINT: &str = "set GUIDEDOG_RUNS to a folder of your own";
    let found = fs::symlink_metadata(dir).map_err(|error| fail(dir, error))?;
    if !found.is_dir() {
        return Err(fail(dir, format!("is no directory; {HINT}")));
    }
    if !is_mine(&found) && found.uid() != 0 {
        return Err(fail(dir, format!("belongs to user {}, who may have made it first; {HINT}", found.uid())));
    }
    let mode = found.mode() & 0o7777;
    if mode & 0o022 != 0 {
        return Err(fail(dir, format!("may be written by others (mode {mode:03o}): chmod go-w it, or {HINT}")));
    }
    Ok(())
}

fn is_mine(found: &fs::Metadata) -> bool {
    found.uid() == rustix::process::geteuid().as_raw()
}

/// What this process and its children make from now on is closed to others, and to the group but for reading.
pub fn keep_others_out() {
    rustix::process::umask(Mode::RWXO | Mode::WGRP);
}

impl RunDir {
    /// Makes the directory of a new run and takes its lock.
    ///
    /// # Errors
    /// Where the name is not usable, a run of that name is alive, the directory cannot be made, or the place where runs
    /// live is not this user's alone.
    pub fn create(name: &str) -> Result<Self, TransportError> {
        let root = runs_root();
        let path = root.join(name);
        check_run_name(name).map_err(|why| fail(&path, why))?;
        DirBuilder::new().recursive(true).mode(0o750).create(&root).map_err(|error| fail(&root, error))?;
        check_own(&root)?;
        let mut last = String::new();
        // A sweep may remove the directory between our making it and our locking it; then it is made again.
        for _ in 0..16 {
            match DirBuilder::new().mode(0o750).create(&path) {
                Ok(()) => {}
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                    // Between the two looks another run may have made it anew.
                    if !may_be_a_run(&path) && fs::symlink_metadata(&path).is_ok() {
                        "holds files that are no run's; it is left as it is".clone_into(&mut last);
                        continue;
                    }
                }
                Err(error) => return Err(fail(&path, error)),
            }
            match take_lock(&path, true) {
                Ok(Some(lock)) => {
                    let dir = Self { path, lock: Some(lock) };
                    dir.wipe()?;
                    return Ok(dir);
                }
                Ok(None) => return Err(TransportError::NameTaken { path }),
                Err(error) => last = error.to_string(),
            }
        }
        Err(fail(&path, last))
    }

    /// The directory of a new run whose lock another process has taken and handed over.
    ///
    /// # Errors
    /// Where that is not the lock of the run of that name.
    pub fn adopt(name: &str, lock: OwnedFd) -> Result<Self, TransportError> {
        let path = runs_root().join(name);
        let lock = File::from(lock);
        if !is_at(&lock, &path.join("lock"))
            || rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err()
        {
            return Err(fail(&path, "the lock that was handed over is not its own"));
        }
        Ok(Self { path, lock: Some(lock) })
    }

    /// The lock, to be handed over; none where this is somebody else's run.
    #[must_use]
    pub fn lock(&self) -> Option<BorrowedFd<'_>> {
        self.lock.as_ref().map(AsFd::as_fd)
    }

    /// The directory of a run that exists.
    #[must_use]
    pub fn open(path: &Path) -> Self {
        Self { path: path.to_owned(), lock: None }
    }

    /// Removes what an earlier run left in the directory and in shared memory, bar the lock.
    fn wipe(&self) -> Result<(), TransportError> {
        remove_shared_memory(&prefix_of(&self.path));
        for entry in fs::read_dir(&self.path).map_err(|error| fail(&self.path, error))?.flatten() {
            let path = entry.path();
            if entry.file_name() == "lock" {
                continue;
            }
            let removed = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            removed.map_err(|error| fail(&path, error))?;
        }
        for (name, mode) in [("iox", 0o700), ("logs", 0o750)] {
            let path = self.path.join(name);
            DirBuilder::new().mode(mode).create(&path).map_err(|error| fail(&path, error))?;
        }
        // Whatever the umask; who set its group to be inherited meant it.
        let inherits = fs::metadata(&self.path).map_err(|error| fail(&self.path, error))?.mode() & 0o2000;
        fs::set_permissions(&self.path, fs::Permissions::from_mode(0o750 | inherits))
            .map_err(|error| fail(&self.path, error))
    }

    /// Has the logs of the services written to `folder`, which outlives the run.
    ///
    /// # Errors
    /// Where the link cannot be made.
    pub fn keep_logs_in(&self, folder: &Path) -> Result<(), TransportError> {
        let (logs, link) = (self.path.join("logs"), self.path.join("logs.link"));
        std::os::unix::fs::symlink(folder, &link).map_err(|error| fail(&link, error))?;
        let replaced = fs::remove_dir(&logs).and_then(|()| fs::rename(&link, &logs));
        replaced.map_err(|error| {
            // Services write their logs here all the same.
            let _ = DirBuilder::new().mode(0o750).create(&logs);
            fail(&logs, error)
        })
    }

    /// Removes the directory and the run's shared memory. Only the holder of the lock does.
    pub fn remove(&self) {
        if self.lock.is_some() {
            remove_run(&self.path);
        }
    }

    /// Takes from others what iceoryx2 lets them have of the run's shared memory: it makes one file, a counter for its
    /// numbers, that everybody may write, whatever the umask.
    pub(crate) fn close_shared_memory(&self) {
        for path in shared_memory(&self.prefix()) {
            if fs::metadata(&path).is_ok_and(|found| found.mode() & 0o077 != 0) {
                // Somebody who died may have taken it along, which is as good.
                let _ = fs::set_permissions(&path, fs::Permissions::from_mode(0o600));
            }
        }
    }

    /// The directory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The operator's socket, by a path for this process alone; so are those below, and iceoryx2's folder.
    #[must_use]
    pub fn control_socket(&self) -> PathBuf {
        short_folder(&self.path).join("control.sock")
    }

    /// The settings of the run, as resolved at its start.
    #[must_use]
    pub fn settings(&self) -> PathBuf {
        self.path.join("settings.toml")
    }

    /// The simulated robot's second way in, for the brake.
    #[must_use]
    pub fn robot_socket(&self) -> PathBuf {
        short_folder(&self.path).join("robot.sock")
    }

    /// Where locomotion finds its voice on a robot's DDS network.
    #[must_use]
    pub fn bridge_socket(&self) -> PathBuf {
        short_folder(&self.path).join("bridge.sock")
    }

    /// Where the brake finds its own there.
    #[must_use]
    pub fn backstop_socket(&self) -> PathBuf {
        short_folder(&self.path).join("backstop.sock")
    }

    /// The port of an emulated lidar.
    #[must_use]
    pub fn lidar_port(&self) -> PathBuf {
        self.path.join("rplidar")
    }

    /// What a service keeps for its next life.
    #[must_use]
    pub fn kept(&self, service: ServiceId) -> PathBuf {
        self.path.join(format!("{service}.kept"))
    }

    /// The port of an emulated emergency stop.
    #[must_use]
    pub fn estop_port(&self) -> PathBuf {
        self.path.join("estop")
    }

    /// Where an emulated camera hands its frames over.
    #[must_use]
    pub fn camera_socket(&self) -> PathBuf {
        self.path.join("camera.sock")
    }

    /// The address of an emulated robot: all of 127.0.0.0/8 is this machine, and hardly another run has this one.
    #[must_use]
    pub fn robot_address(&self) -> Ipv4Addr {
        let [a, b, c, ..] = digest_of(&self.path).to_be_bytes();
        // Neither the usual one nor the network's own.
        Ipv4Addr::new(127, a, b, c.clamp(2, 254))
    }

    /// The DDS domain of an emulated robot: hardly another run has this one, and no robot leaves its factory with it.
    #[must_use]
    pub fn dds_domain(&self) -> u16 {
        100 + (digest_of(&self.path) % 100) as u16
    }

    /// Where iceoryx2 keeps its files.
    #[must_use]
    pub fn iceoryx2_root(&self) -> PathBuf {
        short_folder(&self.path.join("iox"))
    }

    /// The log of one service incarnation.
    #[must_use]
    pub fn log(&self, service: messages::ServiceId, incarnation: u32) -> PathBuf {
        self.path.join("logs").join(format!("{service}.{incarnation}.log"))
    }

    /// The prefix of this run's shared memory.
    #[must_use]
    pub fn prefix(&self) -> String {
        prefix_of(&self.path)
    }

    /// Writes what every process of the run must know.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn write_info(&self, info: &RunInfo) -> Result<(), TransportError> {
        let path = self.path.join("run.json");
        let text = serde_json::to_string_pretty(info).map_err(|error| fail(&path, error))?;
        let mut file = File::create(&path).map_err(|error| fail(&path, error))?;
        file.write_all(text.as_bytes()).map_err(|error| fail(&path, error))
    }

    /// Reads what every process of the run must know.
    ///
    /// # Errors
    /// Where the file cannot be read or is not ours.
    pub fn read_info(&self) -> Result<RunInfo, TransportError> {
        let path = self.path.join("run.json");
        let text = fs::read_to_string(&path).map_err(|error| fail(&path, error))?;
        serde_json::from_str(&text).map_err(|error| fail(&path, error))
    }
}

/// Whether a directory is a run's of this user: its lock says so, and nothing else lies there. Nothing else is ever
/// removed.
fn may_be_a_run(dir: &Path) -> bool {
    if !fs::symlink_metadata(dir).is_ok_and(|found| found.is_dir() && is_mine(&found)) {
        return false;
    }
    let Ok(entries) = fs::read_dir(dir) else { return false };
    let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    let ours = names.iter().all(|name| OURS.iter().any(|ours| name == ours));
    let mark = fs::read_to_string(dir.join("lock")).unwrap_or_else(|_| "none".to_owned());
    // One that is between its first steps, or was killed there, is empty, or has not marked its lock yet.
    names.is_empty() || (ours && mark == MARK) || (names.len() == 1 && mark.is_empty())
}

/// Whether a file that was opened is still the one at a path.
fn is_at(file: &File, path: &Path) -> bool {
    let id = |found: std::io::Result<fs::Metadata>| found.map(|found| (found.dev(), found.ino())).ok();
    id(file.metadata()).is_some_and(|of| Some(of) == id(fs::symlink_metadata(path)))
}

/// Takes the lock of a run directory; `None` while another process holds it. Only `to_own` it is anything written.
fn take_lock(dir: &Path, to_own: bool) -> Result<Option<File>, TransportError> {
    let path = dir.join("lock");
    let mut options = OpenOptions::new();
    options.read(true).write(to_own).create(to_own).truncate(false).mode(0o600);
    // A link could have anything written to.
    options.custom_flags(OFlags::NOFOLLOW.bits().cast_signed());
    let file = options.open(&path).map_err(|error| fail(&path, error))?;
    match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
        // Whoever held it before may have removed it with its directory, and another have made both anew since.
        Ok(()) if !is_at(&file, &path) => Err(fail(&path, "was replaced while it was taken")),
        Ok(()) if !to_own => Ok(Some(file)),
        Ok(()) => {
            (&file).write_all(MARK.as_bytes()).map_err(|error| fail(&path, error))?;
            Ok(Some(file))
        }
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
        Err(errno) => Err(TransportError::System { call: "flock", errno }),
    }
}

/// FNV-1a of a run directory's path.
fn digest_of(path: &Path) -> u64 {
    path.as_os_str()
        .as_encoded_bytes()
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |digest, byte| (digest ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// A prefix of its own for each run directory.
fn prefix_of(path: &Path) -> String {
    format!("gd{:016x}_", digest_of(path))
}

/// The files of a run's shared memory.
fn shared_memory(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(crate::SHM).into_iter().flatten().flatten();
    entries.filter(move |entry| entry.file_name().to_string_lossy().starts_with(prefix)).map(|entry| entry.path())
}

fn remove_shared_memory(prefix: &str) {
    for path in shared_memory(prefix) {
        // Somebody else may have removed it first, which is as good.
        let _ = fs::remove_file(path);
    }
}

/// Removes a run whose lock is held here. The lock goes last: until then the directory is seen to be a run's.
fn remove_run(path: &Path) {
    remove_shared_memory(&prefix_of(path));
    for entry in fs::read_dir(path).into_iter().flatten().flatten().filter(|entry| entry.file_name() != "lock") {
        let path = entry.path();
        // What cannot be removed now is swept at the next boot.
        let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
    }
    let _ = fs::remove_dir_all(path);
}

/// Removes what runs left behind that are no longer alive: every run directory whose lock is free.
pub fn sweep() {
    let root = runs_root();
    let Ok(entries) = check_own(&root).and_then(|()| fs::read_dir(&root).map_err(|error| fail(&root, error))) else {
        return;
    };
    let dirs = entries.flatten().map(|entry| entry.path());
    for path in dirs.filter(|path| path.join("lock").is_file() && may_be_a_run(path)) {
        if let Ok(Some(_lock)) = take_lock(&path, false) {
            remove_run(&path);
        }
    }
}

/// What is known of the run in a directory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Life {
    Alive,
    Ended,
    /// This user may not look into the directory.
    Closed,
}

impl Life {
    /// The run is alive while its lock is held, or, for another user's, while something listens.
    fn of(dir: &Path) -> Self {
        if fs::symlink_metadata(dir).is_ok_and(|found| is_mine(&found)) {
            let is_alive = may_be_a_run(dir) && matches!(take_lock(dir, false), Ok(None));
            return if is_alive { Self::Alive } else { Self::Ended };
        }
        match UnixStream::connect(short_folder(dir).join("control.sock")) {
            Ok(_) => Self::Alive,
            Err(error) if error.kind() == ErrorKind::PermissionDenied => Self::Closed,
            Err(_) => Self::Ended,
        }
    }
}

/// A run that is alive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveRun {
    /// Its name. Runs in two places may have the same.
    pub name: String,
    /// Its directory.
    pub dir: PathBuf,
}

/// What is found where runs live.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FoundRuns {
    /// Runs that are alive, by name; of one name, the user's own comes first.
    pub live: Vec<LiveRun>,
    /// Places of runs that this user may not look into.
    pub closed_places: Vec<PathBuf>,
    /// Directories of runs that this user may not look into.
    pub closed_runs: Vec<PathBuf>,
    /// Why what is found in the user's own place is not believed.
    pub refused: Option<String>,
}

/// Looks for runs in `$GUIDEDOG_RUNS` alone, else in the user's own place and in `/run/guidedog`, the service's.
#[must_use]
pub fn find_runs() -> FoundRuns {
    let mut found = FoundRuns::default();
    for root in roots() {
        if root == runs_root()
            && let Err(error) = check_runs_root()
        {
            found.refused = Some(error.to_string());
            continue;
        }
        match fs::read_dir(&root) {
            Ok(entries) => entries.flatten().for_each(|entry| found.take(entry.path())),
            Err(error) if error.kind() == ErrorKind::PermissionDenied => found.closed_places.push(root),
            // There are no runs where there is no such place.
            Err(_) => {}
        }
    }
    found.live.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

impl FoundRuns {
    fn take(&mut self, dir: PathBuf) {
        let Some(name) = dir.file_name().map(|name| name.to_string_lossy().into_owned()) else { return };
        match Life::of(&dir) {
            Life::Alive => self.live.push(LiveRun { name, dir }),
            Life::Closed => self.closed_runs.push(dir),
            Life::Ended => {}
        }
    }
}

/// Names of this user's runs that are alive.
#[must_use]
pub fn live_runs() -> Vec<String> {
    let Ok(entries) = fs::read_dir(runs_root()) else { return Vec::new() };
    let mut own = FoundRuns::default();
    entries.flatten().for_each(|entry| own.take(entry.path()));
    own.live.into_iter().map(|run| run.name).collect()
}

#[cfg(test)]
mod tests {
    use super::{RunDir, may_be_a_run, prefix_of};
    use std::path::Path;

    #[test]
    fn runs_do_not_share_a_prefix() {
        assert_ne!(prefix_of(Path::new("/tmp/a")), prefix_of(Path::new("/tmp/b")));
    }

    #[test]
    fn a_directory_with_anything_else_in_it_is_no_runs() {
        let dir = tempfile::tempdir().expect("a folder");
        std::fs::write(dir.path().join("lock"), "somebody else's").expect("written");
        assert!(!may_be_a_run(dir.path()));
        std::fs::write(dir.path().join("lock"), super::MARK).expect("written");
        std::fs::create_dir(dir.path().join("logs")).expect("made");
        assert!(may_be_a_run(dir.path()));
        std::fs::write(dir.path().join("rplidar.baud"), "").expect("written");
        assert!(may_be_a_run(dir.path()), "one that an earlier version left");
        let begun = tempfile::tempdir().expect("a folder");
        std::fs::write(begun.path().join("lock"), "").expect("written");
        assert!(may_be_a_run(begun.path()), "one that has only just begun");
        std::fs::write(dir.path().join("thesis.tex"), "").expect("written");
        assert!(!may_be_a_run(dir.path()));
    }

    #[test]
    fn a_name_that_would_leave_the_root_is_refused() {
        for name in ["", "..", "a/b", "a b"] {
            assert!(RunDir::create(name).is_err(), "{name:?}");
        }
    }
}
