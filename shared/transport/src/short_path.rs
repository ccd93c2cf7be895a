//! Names of Unix sockets in folders with long paths. A socket's name has at most 107 bytes; a folder that this process
//! holds open has a short one, under `/proc/self/fd`.

use std::collections::BTreeMap;
use std::fs;
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rustix::fs::{Mode, OFlags};

/// Folders up to this length are named as they are: the longest name below one is iceoryx2's, with 62 bytes.
const LONGEST_BYTES: usize = 44;

/// Folders that this process has opened for their short names.
static OPEN: Mutex<BTreeMap<PathBuf, OwnedFd>> = Mutex::new(BTreeMap::new());

/// A short path to a folder, for this process alone: its own where that is short enough, or where there is no folder.
#[must_use]
pub fn short_folder(folder: &Path) -> PathBuf {
    if folder.as_os_str().len() <= LONGEST_BYTES {
        return folder.to_owned();
    }
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    // A run that is over may have been followed by another of its name.
    if open.get(folder).is_none_or(|fd| !is_same(fd, folder)) {
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let Ok(fd) = rustix::fs::open(folder, flags, Mode::empty()) else { return folder.to_owned() };
        open.retain(|folder, fd| is_same(fd, folder));
        open.insert(folder.to_owned(), fd);
    }
    open.get(folder).map_or_else(|| folder.to_owned(), |fd| PathBuf::from(format!("/proc/self/fd/{}", fd.as_raw_fd())))
}

/// A short path to a socket, for this process alone.
#[must_use]
pub fn short_socket(path: &Path) -> PathBuf {
    match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => short_folder(folder).join(name),
        _ => path.to_owned(),
    }
}

fn is_same(fd: &OwnedFd, folder: &Path) -> bool {
    let Ok(held) = rustix::fs::fstat(fd) else { return false };
    fs::metadata(folder).is_ok_and(|found| (found.dev(), found.ino()) == (held.st_dev, held.st_ino))
}

#[cfg(test)]
mod tests {
    use super::{short_folder, short_socket};
    use std::os::unix::net::{UnixListener, UnixStream};
    use std::path::Path;

    #[test]
    fn a_socket_in_a_folder_with_a_long_path_is_listened_at_and_reached() {
        let root = tempfile::tempdir().expect("a folder");
        assert_eq!(short_folder(Path::new("/tmp")), Path::new("/tmp"));
        let folder = root.path().join("f".repeat(150));
        for _ in 0..2 {
            std::fs::create_dir(&folder).expect("made");
            let socket = folder.join("control.sock");
            assert!(UnixListener::bind(&socket).is_err(), "its name is too long");
            let _listener = UnixListener::bind(short_socket(&socket)).expect("listens");
            UnixStream::connect(short_socket(&socket)).expect("somebody listens");
            // A folder of the same name that is made anew is another one.
            std::fs::remove_dir_all(&folder).expect("ours");
        }
    }
}
