//! What tests need and the repository does not hold: real recordings, maps, programs and models of others.
//!
//! Where it is missing, a test fails under `CI=true`. Elsewhere it says what is missing, and is skipped.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A file or folder of the real inputs, which lie in `$GUIDEDOG_DATA`, or in `../shared/data` beside the project;
/// `None` where it is missing and the test is to be skipped.
///
/// # Panics
/// Where it is missing under `CI=true`.
#[must_use]
pub fn data(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let path = std::env::var_os("GUIDEDOG_DATA").map_or_else(beside, PathBuf::from).join(name);
    has(path.exists(), &format!("{} is missing (GUIDEDOG_DATA names the folder)", path.display())).then_some(path)
}

/// Whether what a test needs is `there`; `missing` says what it lacks, and how it is got. `false`: the test is to be
/// skipped.
///
/// # Panics
/// Where it is not there under `CI=true`.
#[must_use]
pub fn has(there: bool, missing: &str) -> bool {
    assert!(there || std::env::var_os("CI").is_none_or(|ci| ci != "true"), "{missing}");
    may(there, missing)
}

/// Whether the machine `lets` a test do what it needs: be another user, mount a file system. `false`: the test is to be
/// skipped, under `CI=true` as well.
#[must_use]
pub fn may(lets: bool, missing: &str) -> bool {
    if !lets {
        let test = std::thread::current();
        let line = format!("skipped: {}: {missing}\n", test.name().unwrap_or_default());
        // A test runner keeps what a test that passes prints to itself, so scripts/test names a file, and prints that.
        let told = std::env::var_os("GUIDEDOG_SKIPPED").and_then(|path| File::options().append(true).open(path).ok());
        let _ = match told {
            Some(mut file) => file.write_all(line.as_bytes()),
            // Not by `eprintln!`, which cargo's test harness keeps to itself.
            None => std::io::stderr().write_all(line.as_bytes()),
        };
    }
    lets
}
