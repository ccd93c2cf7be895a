//! The built programs. A test must never pass by one that is older than its sources, so that is looked for first.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::SystemTime;

use messages::ServiceId;

use crate::project;

/// Where the built programs lie: beside the test's own executable. Panics where one is missing or older than a source.
#[must_use]
pub fn programs() -> PathBuf {
    static DIR: OnceLock<PathBuf> = OnceLock::new();
    let dir = DIR.get_or_init(|| {
        let own = std::env::current_exe().expect("a test has an executable");
        let dir = own.ancestors().nth(2).expect("it lies in deps").to_owned();
        let mut changed = BTreeMap::new();
        for program in names() {
            if let Some(why) = is_stale(&dir.join(&program), &mut changed) {
                panic!("{program} {why}: run `cargo build --workspace --bins` first");
            }
        }
        dir
    });
    dir.clone()
}

/// Whether the simulator of a legged robot is built, with all that it needs; `false`: the test is to be skipped. Panics
/// where it is older than a source, or missing under `CI=true`.
#[must_use]
pub fn has_legs() -> bool {
    let program = programs().join("guidedog-mujoco");
    let brought = project().join("config/legs/go2/policy.onnx");
    let missing = "MuJoCo's simulator is missing: scripts/mujoco, then `cargo build` in services/mujoco";
    if !test_data::has(program.is_file() && brought.is_file(), missing) {
        return false;
    }
    if let Some(why) = is_stale(&program, &mut BTreeMap::new()) {
        panic!("guidedog-mujoco {why}: run `cargo build` in services/mujoco first");
    }
    true
}

/// Names of all programs: of the command line, of the services, and of the tests' own.
fn names() -> impl Iterator<Item = String> {
    let own = ["guidedog", "guidedog-faulty-policy"].map(str::to_owned);
    own.into_iter().chain(ServiceId::ALL.into_iter().map(|service| format!("guidedog-{service}")))
}

/// What is wrong with a program, by cargo's own list of its sources, which lies beside it. When each source was last
/// changed is kept in `changed`: programs share most of theirs.
fn is_stale(program: &Path, changed: &mut BTreeMap<PathBuf, Option<SystemTime>>) -> Option<String> {
    let (Ok(built), Ok(list)) = (modified(program), fs::read_to_string(program.with_extension("d"))) else {
        return Some("is not built".to_owned());
    };
    let mut is_of_here = false;
    for source in sources(&list) {
        is_of_here |= source.starts_with(project());
        let source_changed = *changed.entry(source.clone()).or_insert_with(|| modified(&source).ok());
        if source_changed.is_none_or(|changed| changed > built) {
            return Some(format!("is older than {}", source.display()));
        }
    }
    // A target directory may have been copied here.
    (!is_of_here).then(|| "was built from other sources".to_owned())
}

fn modified(path: &Path) -> std::io::Result<SystemTime> {
    fs::metadata(path)?.modified()
}

/// The sources in one of cargo's lists, a rule of make: `program: source source`. A space in a name has a backslash.
fn sources(list: &str) -> Vec<PathBuf> {
    let line = list.lines().next().unwrap_or_default();
    let (_, sources) = line.split_once(": ").unwrap_or_default();
    let names = sources.replace("\\ ", "\0");
    names.split(' ').filter(|name| !name.is_empty()).map(|name| PathBuf::from(name.replace('\0', " "))).collect()
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_list_of_sources_is_read_with_spaces_in_names() {
        let found = sources("/t/guidedog: /a/b.rs /a/with\\ space.rs\n\n/other: /x.rs\n");
        assert_eq!(found, [PathBuf::from("/a/b.rs"), PathBuf::from("/a/with space.rs")]);
        assert!(sources("").is_empty());
    }

    #[test]
    fn a_program_older_than_a_source_or_built_elsewhere_is_stale() {
        let folder = tempfile::tempdir().expect("a folder");
        let (program, source) = (folder.path().join("program"), project().join("Cargo.toml"));
        let elsewhere = folder.path().join("elsewhere.rs");
        fs::write(&elsewhere, "").expect("written");
        let stale = |list: &str| {
            fs::write(program.with_extension("d"), format!("program: {list}\n")).expect("written");
            is_stale(&program, &mut BTreeMap::new())
        };
        let here = source.display().to_string();
        assert_eq!(stale(&here).as_deref(), Some("is not built"));
        let file = File::create(&program).expect("made");
        assert_eq!(stale(&here), None);
        assert_eq!(stale(&elsewhere.display().to_string()).as_deref(), Some("was built from other sources"));
        assert_eq!(stale(&format!("{here} /nowhere.rs")).as_deref(), Some("is older than /nowhere.rs"));
        let before = modified(&source).expect("there") - Duration::from_secs(1);
        file.set_modified(before).expect("ours");
        assert_eq!(stale(&here), Some(format!("is older than {here}")));
    }
}
