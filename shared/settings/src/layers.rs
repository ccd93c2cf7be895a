//! Reading the layers and laying them on top of each other.

use std::path::{Path, PathBuf};

use crate::checks::check;
use crate::origins::{KeyOrigin, Origins};
use crate::path::starting_at;
use crate::sections::Settings;

/// Longest map or route path and the like are the file system's business; a configuration file over this is not ours.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Why a configuration cannot be used. Always the author of the file named is to mend it.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("failed to read {path}: {reason}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's word.
        reason: String,
    },
    /// A key is unknown, or a value is wrong; the message names line and column.
    #[error("{path}: {reason}")]
    Parse {
        /// The file.
        path: PathBuf,
        /// Line, column, and what is wrong there.
        reason: String,
    },
    /// Values that are right by themselves do not go together.
    #[error("{path}: {reason}")]
    Conflict {
        /// The file, or the words of the command line, that set one of them.
        path: PathBuf,
        /// Which keys, and why.
        reason: String,
    },
}

/// A built-in layer for a kind of run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// The defaults: a simulated walk.
    Walk,
    /// The same with a Unitree Go2 on legs.
    Go2,
    /// A simulated walk of a Go2 in MuJoCo.
    Mujoco,
    /// Recorded laser logs: no depth, null link, longer lives of permits.
    Carmen,
}

impl Profile {
    /// Names and texts of its files, the lowest layer first.
    fn layers(self) -> &'static [(&'static str, &'static str)] {
        const WALK: (&str, &str) = ("config/guidedog.toml", include_str!("../../../config/guidedog.toml"));
        const GO2: (&str, &str) = ("config/profiles/go2.toml", include_str!("../../../config/profiles/go2.toml"));
        const MUJOCO: (&str, &str) =
            ("config/profiles/mujoco.toml", include_str!("../../../config/profiles/mujoco.toml"));
        const CARMEN: (&str, &str) =
            ("config/profiles/carmen.toml", include_str!("../../../config/profiles/carmen.toml"));
        match self {
            Self::Walk => &[WALK],
            Self::Go2 => &[GO2],
            Self::Mujoco => &[GO2, MUJOCO],
            Self::Carmen => &[CARMEN],
        }
    }
}

/// What an operator lays over what is built in.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Operator {
    /// A configuration file. Its relative paths start at its own folder.
    pub file: Option<PathBuf>,
    /// Single values over those of the file, such as `lidar.rate_hz=8`. Their relative paths start at the present
    /// folder.
    pub set: Vec<String>,
}

impl From<Option<&Path>> for Operator {
    fn from(file: Option<&Path>) -> Self {
        Self { file: file.map(Path::to_owned), set: Vec::new() }
    }
}

/// Settings, and where each of them comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Effective {
    /// The settings.
    pub settings: Settings,
    /// Where each comes from.
    pub origins: Origins,
}

/// The settings of a profile with what the operator lays over it. Without a file, relative paths start at the present
/// folder.
///
/// # Errors
/// Where a file cannot be read, a key is unknown, a value is wrong, or values do not go together.
pub fn load(profile: Profile, operator: impl Into<Operator>) -> Result<Settings, SettingsError> {
    load_with_origins(profile, operator).map(|effective| effective.settings)
}

/// The same, and where each value comes from.
///
/// # Errors
/// As [`load`].
pub fn load_with_origins(profile: Profile, operator: impl Into<Operator>) -> Result<Effective, SettingsError> {
    load_layers(profile.layers(), &operator.into())
}

/// The settings `text`, which are called `name` in errors, with what the operator lays over them.
///
/// # Errors
/// As [`load`].
pub fn load_over(name: &str, text: &str, operator: impl Into<Operator>) -> Result<Settings, SettingsError> {
    load_layers(&[(name, text)], &operator.into()).map(|effective| effective.settings)
}

fn load_layers(layers: &[(&str, &str)], operator: &Operator) -> Result<Effective, SettingsError> {
    let mut merged = toml::Table::new();
    let mut origins = Origins::default();
    let mut last = PathBuf::new();
    for (name, text) in layers {
        last = PathBuf::from(name);
        lay_over(&mut merged, parse(&last, text)?);
        origins.lay_over(name, text, false);
    }
    let mut operators_text = String::new();
    if let Some(path) = &operator.file {
        operators_text = read(path)?;
        lay_over(&mut merged, parse(path, &operators_text)?);
        origins.lay_over(&path.display().to_string(), &operators_text, true);
        last.clone_from(path);
    }
    for assignment in &operator.set {
        let layer = format!("--set {assignment}");
        let (text, table) = assigned(&layer, assignment)?;
        lay_over(&mut merged, table);
        origins.set(&layer, &text);
    }
    // One folder serves all layers: those that are built in have no relative path, and what was recorded is absolute.
    let settings: Settings = starting_at(folder_of(operator.file.as_deref())?, || merged.try_into())
        .map_err(|error: toml::de::Error| SettingsError::Parse { path: last.clone(), reason: error.to_string() })?;
    check(&settings).map_err(|reason| match (line_of_planned(&operators_text, &reason), origins.blamed(&reason)) {
        (Some(line), _) => SettingsError::Conflict { path: last, reason: format!("line {line}: {reason}") },
        (None, None) => SettingsError::Conflict { path: last, reason },
        (None, Some(KeyOrigin { layer, line, .. })) => {
            let reason = line.map_or_else(|| reason.clone(), |line| format!("line {line}: {reason}"));
            SettingsError::Conflict { path: layer.into(), reason }
        }
    })?;
    Ok(Effective { settings, origins })
}

/// The assignment as TOML, and the layer with that value alone. What is no TOML is a text: quotes would have to be
/// quoted for the shell.
fn assigned(layer: &str, assignment: &str) -> Result<(String, toml::Table), SettingsError> {
    let fail = |reason: String| SettingsError::Parse { path: layer.into(), reason };
    let (key, value) = assignment.split_once('=').ok_or_else(|| fail("it is not KEY=VALUE".to_owned()))?;
    let (key, value) = (key.trim(), value.trim());
    let is_key = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
    if !key.chars().all(is_key) || !key.contains('.') {
        return Err(fail(format!("\"{key}\" is no key of a single value, such as lidar.rate_hz")));
    }
    if assignment.contains(char::is_control) {
        return Err(fail("it holds a control character".to_owned()));
    }
    let as_text = || format!("{key} = {}", toml::Value::String(value.to_owned()));
    // What TOML would take for a comment is a part of the text, as in a path.
    let is_toml = value.starts_with(['"', '\'', '[', '{']) || !value.contains('#');
    let is_right = |text: &String| value.starts_with(['"', '\'']) || text.parse::<toml::Table>().is_ok();
    let text = Some(format!("{key} = {value}")).filter(|text| is_toml && is_right(text)).unwrap_or_else(as_text);
    let told = |error: toml::de::Error| fail(error.message().to_owned());
    let settings: Settings = starting_at(folder_of(None)?, || toml::from_str(&text)).map_err(told)?;
    // As the settings have it: a path is whole by now.
    let whole = toml::Table::try_from(&settings).map_err(|error| fail(error.to_string()))?;
    let mut table: toml::Table = text.parse().map_err(told)?;
    take_values_of(&mut table, &whole);
    Ok((text, table))
}

/// Takes over the values of those keys that both have.
fn take_values_of(table: &mut toml::Table, whole: &toml::Table) {
    for (key, value) in table {
        match (value, whole.get(key)) {
            (toml::Value::Table(table), Some(toml::Value::Table(whole))) => take_values_of(table, whole),
            (value, Some(whole)) => value.clone_from(whole),
            (_, None) => {}
        }
    }
}

/// The line of the plan that a reason begins with.
fn line_of_planned(text: &str, reason: &str) -> Option<usize> {
    let number: usize = reason.strip_prefix("planned[")?.split(']').next()?.parse().ok()?;
    let mut tables = text.lines().enumerate().filter(|(_, line)| line.trim() == "[[planned]]");
    tables.nth(number).map(|(i, _)| i + 1)
}

/// The settings that the supervisor wrote for its children.
///
/// # Errors
/// As [`load`].
pub fn load_resolved(path: &Path) -> Result<Settings, SettingsError> {
    toml::from_str(&read(path)?)
        .map_err(|error| SettingsError::Parse { path: path.to_owned(), reason: error.to_string() })
}

/// Where relative paths start.
fn folder_of(operator: Option<&Path>) -> Result<PathBuf, SettingsError> {
    let path = operator.unwrap_or(Path::new("."));
    let whole = std::path::absolute(path)
        .map_err(|error| SettingsError::Read { path: path.to_owned(), reason: error.to_string() })?;
    Ok(if operator.is_some() { whole.parent().map(Path::to_owned).unwrap_or_default() } else { whole })
}

fn read(path: &Path) -> Result<String, SettingsError> {
    let fail = |reason: String| SettingsError::Read { path: path.to_owned(), reason };
    let found = std::fs::metadata(path).map_err(|error| fail(error.to_string()))?;
    // Before it is opened: opening a pipe would wait for its writer.
    if !found.is_file() {
        return Err(fail("it is not a file".to_owned()));
    }
    let size = found.len();
    if size > MAX_FILE_BYTES {
        return Err(fail(format!("{size} bytes are no configuration file")));
    }
    std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))
}

/// Checks one layer by itself, so that an error names its line.
fn parse(path: &Path, text: &str) -> Result<toml::Table, SettingsError> {
    let fail = |error: toml::de::Error| SettingsError::Parse { path: path.to_owned(), reason: error.to_string() };
    toml::from_str::<Settings>(text).map_err(fail)?;
    toml::from_str(text).map_err(fail)
}

fn lay_over(below: &mut toml::Table, above: toml::Table) {
    for (key, value) in above {
        match (below.get_mut(&key), value) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Operator, Profile, Settings, check, load, parse};
    use std::path::Path;

    #[test]
    fn the_shipped_file_says_what_the_defaults_are() {
        let shipped: Settings = toml::from_str(Profile::Walk.layers()[0].1).expect("the shipped file is right");
        assert_eq!(shipped, Settings::default());
        assert_eq!(check(&shipped), Ok(()));
    }

    #[test]
    fn every_profile_is_right() {
        for profile in [Profile::Walk, Profile::Carmen] {
            load(profile, Operator::default()).expect("the profile is right");
        }
    }

    #[test]
    fn the_shipped_robots_walk_by_devices_alone() {
        for name in ["aliengo.toml", "go2.toml"] {
            let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name);
            let settings = load(Profile::Walk, Some(file.as_path())).expect("the file is right");
            assert!(settings.commands_robot() && !settings.has_world(), "{name}");
        }
    }

    #[test]
    fn an_unknown_key_and_a_wrong_value_are_named_with_their_line() {
        for (text, line, what) in [
            ("[lidar]\nbeems = 3\n", "line 2", "beems"),
            ("\n\n[handler]\nalpha = 1.5\n", "line 4", "1.5"),
            ("[max_age]\nscan = \"0s\"\n", "line 2", "turned off"),
            ("[lidar]\nbeams = \"many\"\n", "line 2", "many"),
        ] {
            let error = parse(Path::new("x.toml"), text).expect_err("it is wrong").to_string();
            assert!(error.contains("x.toml") && error.contains(line) && error.contains(what), "{error}");
        }
    }

    #[test]
    fn an_unknown_robot_and_lidar_are_named() {
        for (text, what) in [
            ("[locomotion.unitree]\nprofile = \"go9\"\n", "aliengo-3.8.4, aliengo-3.3.1, go1-3.8"),
            ("[simulation.emulated]\nrplidar = \"a9\"\n", "a1-old"),
        ] {
            let error = parse(Path::new("x.toml"), text).expect_err("it is wrong").to_string();
            assert!(error.contains("line 2") && error.contains(what), "{error}");
        }
    }

    #[test]
    fn values_that_do_not_go_together_are_told_with_their_line() {
        let dir = std::env::temp_dir().join(format!("guidedog-settings-{}.toml", std::process::id()));
        std::fs::write(&dir, "[robot]\nradius_m = 0.3\n\n[odometry]\nrate_hz = 50.0\nscale_sigma = inf\n")
            .expect("written");
        let error = load(Profile::Walk, Some(dir.as_path())).expect_err("it is wrong").to_string();
        let _ = std::fs::remove_file(&dir);
        assert!(error.contains("line 6: odometry.scale_sigma = inf"), "{error}");
    }

    #[test]
    fn single_values_lie_over_the_file() {
        let operator = |set: &[&str]| Operator { file: None, set: set.iter().map(|&set| set.to_owned()).collect() };
        let set = ["lidar.rate_hz=8", "max_age.scan=250ms", "depth.range_m = [0.5, 4]", "estop.source=absent"];
        let loaded = load(Profile::Walk, operator(&set)).expect("they are right");
        assert_eq!((loaded.lidar.rate_hz.get(), loaded.depth.range_m), (8.0, [0.5, 4.0]));
        let here = std::env::current_dir().expect("there is one");
        let recorded = load(Profile::Walk, operator(&["record.path=walk.mcap"])).expect("it is right").record;
        assert_eq!(recorded.path.as_deref(), Some(here.join("walk.mcap").as_path()));
        for (set, what) in [
            ("lidar.beems=3", "--set lidar.beems=3: unknown field `beems`"),
            ("lidar.rate_hz=fast", "--set lidar.rate_hz=fast: invalid type"),
            ("lidar.rate_hz", "it is not KEY=VALUE"),
            ("seed=3", "\"seed\" is no key"),
            ("lidar.rate_hz=8#fast", "invalid type"),
            ("policy.model=\"a", "--set policy.model=\"a: "),
            ("lidar.beams=3\n[depth]", "control character"),
            ("odometry.scale_sigma=inf", "--set odometry.scale_sigma=inf: odometry.scale_sigma = inf"),
        ] {
            let error = load(Profile::Walk, operator(&[set])).expect_err(set).to_string();
            assert!(error.starts_with(&format!("--set {set}: ")) && error.contains(what), "{error}");
        }
    }

    #[test]
    fn resolved_settings_come_back_as_they_were() {
        let text = toml::to_string(&Settings::default()).expect("settings can be written");
        assert_eq!(toml::from_str::<Settings>(&text).expect("and read"), Settings::default());
    }
}
