//! Reads the tree and holds it to the house rules: lengths, banned calls, who may depend on whom.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use guidedog_tests::project;

const LINE_MAX: usize = 120;
const FUNCTION_MAX: usize = 70;
const FILE_MAX: usize = 600;

fn rust_files() -> Vec<PathBuf> {
    fn walk(dir: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(dir).expect("readable").flatten() {
            let path = entry.path();
            let name = entry.file_name();
            if path.is_dir() && name != "target" && name != ".git" {
                walk(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    for top in ["services", "shared", "tests"] {
        walk(&project().join(top), &mut found);
    }
    // A reader that takes everything for a test, or reads nothing, would find nothing wrong.
    assert!(found.iter().filter(|path| !is_test(path)).count() > 80, "the tree was read");
    found
}

fn is_test(path: &Path) -> bool {
    let path = path.strip_prefix(project()).expect("a file of the project");
    path.components().any(|part| part.as_os_str() == "tests") || path.ends_with("tests.rs")
}

/// The lines of a file before its test module, with their numbers.
fn code(text: &str) -> Vec<(usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line)).take_while(|(_, line)| *line != "#[cfg(test)]").collect()
}

fn name(path: &Path) -> String {
    path.strip_prefix(project()).unwrap_or(path).display().to_string()
}

#[test]
fn lines_functions_and_files_are_of_a_size_to_read() {
    let mut wrong = Vec::new();
    for path in rust_files() {
        let text = fs::read_to_string(&path).expect("readable");
        let at = |line: usize, what: &str| format!("{}:{line}: {what}", name(&path));
        wrong.extend(
            text.lines()
                .enumerate()
                .filter(|(_, line)| line.chars().count() > LINE_MAX)
                .map(|(i, _)| at(i + 1, "a line of over 120 columns")),
        );
        if is_test(&path) {
            continue;
        }
        let lines = code(&text);
        if lines.len() > FILE_MAX {
            wrong.push(at(lines.len(), "a file of over 600 lines"));
        }
        let mut begun: Option<(usize, usize)> = None;
        for (number, line) in &lines {
            let indent = line.len() - line.trim_start().len();
            let is_function = line.trim_start().starts_with("fn ") || line.contains(" fn ");
            if begun.is_none() && is_function && !line.trim_start().starts_with("//") && !line.ends_with(';') {
                begun = Some((*number, indent));
            } else if let Some((start, _)) = begun.filter(|(_, i)| *i == indent && line.trim() == "}") {
                if number - start + 1 > FUNCTION_MAX {
                    wrong.push(at(start, "a function of over 70 lines"));
                }
                begun = None;
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn banned_calls_are_not_made() {
    // (what, where it may be all the same)
    let banned: [(&str, &[&str]); 8] = [
        (".unwrap()", &[]),
        // Cargo reads what a build script prints; an example is a program to be watched.
        ("println!(", &["services/mujoco/build.rs", "services/mujoco/examples/"]),
        ("dbg!(", &[]),
        ("todo!(", &[]),
        ("unimplemented!(", &[]),
        ("Instant::now", &["services/cli/", "services/mujoco/examples/"]),
        ("SystemTime::now", &["shared/records/src/lib.rs"]),
        ("thread::sleep", &["services/cli/"]),
    ];
    let mut wrong = Vec::new();
    for path in rust_files().into_iter().filter(|path| !is_test(path)) {
        let text = fs::read_to_string(&path).expect("readable");
        let lines = code(&text);
        for (i, (number, line)) in lines.iter().enumerate() {
            let call = line.split("//").next().unwrap_or_default();
            for (what, allowed) in banned {
                let may = allowed.iter().any(|place| name(&path).starts_with(place));
                // `eprintln!` holds `println!(`; services say there why they could not begin.
                if call.replace("eprintln!(", "").contains(what) && !may {
                    wrong.push(format!("{}:{number}: {what}", name(&path)));
                }
            }
            let word = |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|w| w == "unsafe");
            let is_unsafe = word(call) && (call.contains("unsafe {") || call.contains("unsafe impl"));
            let explained = lines[i.saturating_sub(4)..=i].iter().any(|(_, before)| before.contains("SAFETY:"));
            if is_unsafe && !explained {
                wrong.push(format!("{}:{number}: unsafe without SAFETY", name(&path)));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn guidance_has_no_clock_thread_file_or_randomness() {
    let banned =
        ["std::fs", "std::net", "std::io", "std::thread", "std::time", "std::env", "rand::", "HashMap", "HashSet"];
    let mut wrong = Vec::new();
    let pure = rust_files().into_iter().filter(|path| name(path).starts_with("shared/guidance/src") && !is_test(path));
    for path in pure {
        let text = fs::read_to_string(&path).expect("readable");
        for (number, line) in code(&text) {
            wrong.extend(
                banned
                    .iter()
                    .filter(|what| line.contains(**what))
                    .map(|what| format!("{}:{number}: {what}", name(&path))),
            );
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A plain path in what is read from a configuration would start at the folder in which a program happens to work.
#[test]
fn paths_of_the_configuration_start_at_its_folder() {
    let (mut types, mut wrong) = (0, Vec::new());
    let settings = rust_files().into_iter().filter(|path| name(path).starts_with("shared/settings/src"));
    for path in settings {
        let text = fs::read_to_string(&path).expect("readable");
        let (mut derives, mut is_read) = (String::new(), false);
        for (number, line) in code(&text) {
            let is_type = ["struct ", "enum "].iter().any(|kind| {
                line.strip_prefix("pub ").or(line.strip_prefix("pub(crate) ")).unwrap_or(line).starts_with(kind)
            });
            match line {
                _ if line.starts_with("#[derive(") => derives = line.to_owned(),
                // A derive may stand on several lines.
                _ if derives.starts_with('#') && !derives.contains(")]") => derives.push_str(line),
                _ if is_type => {
                    is_read = std::mem::take(&mut derives).contains("Deserialize");
                    types += usize::from(is_read);
                }
                "}" => is_read = false,
                _ if is_read && (line.contains("PathBuf") || line.contains("Box<Path>")) => {
                    wrong.push(format!("{}:{number}: {line}", name(&path)))
                }
                _ => {}
            }
        }
    }
    assert!(types > 30 && wrong.is_empty(), "of {types} types: {}", wrong.join("\n"));
}

/// Names of the dependencies of each of our crates, those for tests apart.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let mut all = BTreeMap::new();
    for top in ["services", "shared"] {
        for entry in fs::read_dir(project().join(top)).expect("readable").flatten() {
            let Ok(text) = fs::read_to_string(entry.path().join("Cargo.toml")) else { continue };
            let own = text.split("[dev-dependencies]").next().unwrap_or_default();
            let listed = own.split("[dependencies]").nth(1).unwrap_or_default().split("\n[").next().unwrap_or_default();
            let names = listed
                .lines()
                .filter(|line| line.contains('=') && !line.trim_start().starts_with('#'))
                .filter_map(|line| line.split(['.', '=']).next())
                .map(|name| name.trim().to_owned())
                .collect();
            all.insert(format!("{top}/{}", entry.file_name().to_string_lossy()), names);
        }
    }
    assert!(all.len() >= 19, "{all:?}");
    all
}

const OURS: [&str; 21] = [
    "control",
    "messages",
    "transport",
    "guidance",
    "links",
    "world",
    "settings",
    "recording",
    "fitting",
    "policies",
    "episodes",
    "rplidar",
    "serial",
    "unitree",
    "emulators",
    "camera",
    "dds",
    "grabber",
    "matching",
    "speech",
    "yardsticks",
];

#[test]
fn dependencies_point_one_way() {
    let allowed: BTreeMap<&str, &[&str]> = BTreeMap::from([
        ("shared/messages", &[][..]),
        ("shared/control", &["messages"][..]),
        ("shared/guidance", &["messages"][..]),
        ("shared/settings", &["camera", "messages", "guidance", "matching", "rplidar", "unitree"][..]),
        ("shared/world", &["messages", "guidance", "settings"][..]),
        ("shared/policies", &["messages", "guidance", "settings"][..]),
        ("shared/episodes", &["messages", "guidance", "settings", "world"][..]),
        ("shared/yardsticks", &["episodes", "guidance", "messages", "policies", "settings", "world"][..]),
        ("shared/rplidar", &["messages"][..]),
        ("shared/matching", &["messages", "guidance"][..]),
        ("shared/unitree", &["messages"][..]),
        ("shared/serial", &[][..]),
        ("shared/camera", &["messages"][..]),
        ("shared/grabber", &["camera", "settings", "transport"][..]),
        ("shared/dds", &["messages", "settings", "unitree"][..]),
        ("shared/emulators", &["camera", "dds", "messages", "rplidar", "serial", "settings", "unitree", "world"][..]),
        ("shared/recording", &["messages", "rplidar"][..]),
        ("shared/fitting", &["messages", "guidance"][..]),
        ("shared/speech", &["messages", "guidance", "settings"][..]),
        ("shared/transport", &["messages"][..]),
        ("shared/links", &["messages", "settings", "transport", "unitree"][..]),
    ]);
    for (name, dependencies) in dependencies() {
        for dependency in &dependencies {
            // A simulator around another physics is the simulator.
            let is_one = (name.as_str(), dependency.as_str()) == ("services/mujoco", "guidedog-simulator");
            assert!(is_one || !dependency.starts_with("guidedog-"), "{name} knows the service {dependency}");
            if let Some(allowed) = allowed.get(name.as_str()) {
                let ours = OURS.contains(&dependency.as_str());
                assert!(!ours || allowed.contains(&dependency.as_str()), "{name} depends on {dependency}");
            }
            // messages derives behind a feature; the command line measures the plain library beside ours.
            let may = ["shared/transport", "shared/messages", "services/cli"].contains(&name.as_str());
            assert!(dependency != "iceoryx2" || may, "{name} talks to iceoryx2");
        }
    }
}

#[test]
fn every_dependency_has_its_reason() {
    let page = fs::read_to_string(project().join("ARCHITECTURE.md")).expect("readable");
    for (name, dependencies) in dependencies() {
        for dependency in dependencies.iter().filter(|dependency| !OURS.contains(&dependency.as_str())) {
            assert!(page.contains(dependency.as_str()), "{name} depends on {dependency}, which has no reason");
        }
    }
}

/// What a package of the lock file depends on, through others as well.
fn all_dependencies(lock: &toml::Table, package: &str) -> BTreeSet<String> {
    let packages = lock["package"].as_array().expect("packages");
    let (mut found, mut left) = (BTreeSet::new(), vec![package.to_owned()]);
    while let Some(name) = left.pop() {
        for package in packages.iter().filter(|package| package["name"].as_str() == Some(&name)) {
            let dependencies = package.get("dependencies").and_then(toml::Value::as_array).into_iter().flatten();
            // "name", or "name version" where there are several.
            let names = dependencies.filter_map(|entry| entry.as_str()?.split(' ').next().map(str::to_owned));
            left.extend(names.filter(|name| found.insert(name.clone())));
        }
    }
    found
}

#[test]
fn what_stops_the_robot_links_no_runtime_and_no_machine_learning() {
    let lock = fs::read_to_string(project().join("Cargo.lock")).expect("readable");
    let lock: toml::Table = toml::from_str(&lock).expect("a lock file");
    for service in ["supervisor", "shield", "locomotion", "brake"] {
        let linked = all_dependencies(&lock, &format!("guidedog-{service}"));
        assert!(linked.contains("iceoryx2"), "{service}: the lock file was read");
        for banned in ["tokio", "async-std", "smol", "rustdds", "ort", "ort-sys", "tract-core", "candle-core"] {
            assert!(!linked.contains(banned), "{service} links {banned}");
        }
    }
    assert!(all_dependencies(&lock, "guidedog-policy").contains("ort-tract"), "who does is found");
}

#[test]
fn every_test_that_the_architecture_names_exists() {
    let page = fs::read_to_string(project().join("ARCHITECTURE.md")).expect("readable");
    let files = page.split('`').filter(|word| word.contains('/') && word.ends_with(".rs") && !word.contains(' '));
    for file in
        files.filter(|file| file.starts_with("services/") || file.starts_with("shared/") || file.starts_with("tests/"))
    {
        assert!(project().join(file).exists(), "ARCHITECTURE.md names {file}");
    }
    let all: String = rust_files().iter().map(|path| fs::read_to_string(path).expect("readable")).collect();
    // A test is named by a sentence in snake case.
    let named = page
        .split('`')
        .filter(|word| word.matches('_').count() >= 3 && word.chars().all(|c| c.is_ascii_lowercase() || c == '_'));
    for test in named {
        assert!(all.contains(&format!("fn {test}(")), "ARCHITECTURE.md names the test {test}");
    }
}

/// The black-box tests are modules of one executable, and the programs' own files are built without tests. A test that
/// is written elsewhere would never run.
#[test]
fn every_test_is_run() {
    let main = fs::read_to_string(project().join("tests/tests/main.rs")).expect("readable");
    for path in rust_files() {
        let (name, text) = (name(&path), fs::read_to_string(&path).expect("readable"));
        if let Some(file) = name.strip_prefix("tests/tests/").filter(|file| !["main.rs", "tidy.rs"].contains(file)) {
            let module = file.split(['/', '.']).next().unwrap_or_default();
            assert!(main.contains(&format!("mod {module};")), "tests/tests/main.rs does not name {module}");
        }
        let is_program = name.ends_with("src/main.rs") || name.contains("/src/bin/");
        assert!(!is_program || !text.contains("#[test]"), "{name}: a program's tests lie in its library");
    }
}
