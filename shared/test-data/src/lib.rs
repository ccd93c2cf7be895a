//! What tests need and the repository does not hold: real recordings, maps, programs and models of others.
//!
//! Where it is missing, a test fails under `CI=true`. Elsewhere it says what is missing, and is skipped.

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
    if !there {
        assert!(std::env::var_os("CI").is_none_or(|ci| ci != "true"), "{missing}");
        let test = std::thread::current();
        // Not by `eprintln!`, which cargo's test harness keeps to itself where a test passes.
        let _ = writeln!(std::io::stderr(), "skipped: {}: {missing}", test.name().unwrap_or_default());
    }
    there
}
