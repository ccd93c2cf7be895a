//! Paths of a configuration. A relative one starts at the folder of the file that it is written in.
//!
//! Serde tells a field nothing about the file. [`starting_at`] therefore notes the file's folder for the thread while
//! the settings are read, and every [`ConfigPath`] joins it as it is read: no list of paths exists that could lack one.
//! Neither a `DeserializeSeed` nor a deserializer around the file's own can carry the folder instead. Derived code
//! hands no seed on, and an internally tagged enum (`planned.ask`) buffers its fields and reads them by serde's own
//! deserializer.

use std::cell::RefCell;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use serde::de::IntoDeserializer;
use serde::{Deserialize, Deserializer, Serialize};

thread_local! {
    static FOLDER: RefCell<Option<PathBuf>> = const { RefCell::new(None) };
}

/// A path of the configuration: absolute, once `load` has read it from a file.
///
/// Read by other means, such as a request on the control socket, it stays as it is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct ConfigPath(PathBuf);

/// Reads with relative paths starting at `folder`, which has to be absolute.
pub(crate) fn starting_at<T>(folder: PathBuf, read: impl FnOnce() -> T) -> T {
    /// Puts back what was noted before, also where `read` panics.
    struct Before(Option<PathBuf>);
    impl Drop for Before {
        fn drop(&mut self) {
            FOLDER.set(self.0.take());
        }
    }
    let _before = Before(FOLDER.replace(Some(folder)));
    read()
}

impl ConfigPath {
    /// This path, where a file that is being read holds it.
    fn rooted(self) -> Self {
        FOLDER.with_borrow(|folder| folder.as_ref().map(|folder| Self(folder.join(&self)))).unwrap_or(self)
    }
}

impl<'de> Deserialize<'de> for ConfigPath {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        PathBuf::deserialize(deserializer).map(|path| Self(path).rooted())
    }
}

/// Reads the name of something that is built in, or else the path of a file.
pub(crate) fn name_or_file<'de, D: Deserializer<'de>, T>(
    deserializer: D,
    named: impl FnOnce(&str) -> Option<T>,
    file: impl FnOnce(ConfigPath) -> T,
) -> Result<T, D::Error> {
    let text = String::deserialize(deserializer)?;
    named(&text).map_or_else(|| ConfigPath::deserialize(text.into_deserializer()).map(file), Ok)
}

impl Deref for ConfigPath {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl AsRef<Path> for ConfigPath {
    fn as_ref(&self) -> &Path {
        self
    }
}

impl From<PathBuf> for ConfigPath {
    fn from(path: PathBuf) -> Self {
        Self(path)
    }
}

impl From<&str> for ConfigPath {
    fn from(path: &str) -> Self {
        Self(path.into())
    }
}

impl From<ConfigPath> for PathBuf {
    fn from(path: ConfigPath) -> Self {
        path.0
    }
}

#[cfg(test)]
mod tests {
    use super::{ConfigPath, starting_at};
    use crate::{Profile, Settings, load};
    use std::path::{Path, PathBuf};

    /// A configuration that names every path there is, each in a folder called `here`.
    const EVERY_PATH: &str = r#"
        depth.socket.path = "here/depth.sock"
        depth.realsense = { library = "here/realsense.so", file = "here/depth.db3" }
        odometry.t265 = { library = "here/t265.so", file = "here/poses.db3" }
        lidar.rplidar.port = "here/lidar"
        cue.script = "here/script.toml"
        cue.voice = { stream = "here/voice.wav", model = "here/cues.toml", embedding = "here/embedding.onnx" }
        policy = { model = "here/guide.onnx", onnx_runtime = "here/onnxruntime.so" }
        estop = { input.device = "here/button", serial.port = "here/box" }
        speak = { language = "here/mine.toml", file = "here/said.wav" }
        walk = { scenario = "here/walk.toml", map = "here/map.yaml", cues = "here/route.toml" }
        replay = { recording = "here/old.mcap", differences = "here/differences.jsonl" }
        record.path = "here/new.mcap"
        [[planned]]
        at = "1s"
        ask = { verb = "policy_swap", exe = "here/policy", model = "here/other.onnx" }
    "#;

    /// Every text in a tree of values.
    fn texts(value: &toml::Value) -> Vec<&str> {
        match value {
            toml::Value::String(text) => vec![text],
            toml::Value::Array(values) => values.iter().flat_map(texts).collect(),
            toml::Value::Table(table) => table.iter().flat_map(|(_, value)| texts(value)).collect(),
            _ => Vec::new(),
        }
    }

    #[test]
    fn every_path_of_a_configuration_starts_at_its_folder() {
        let read: Settings = starting_at("/etc/dog".into(), || toml::from_str(EVERY_PATH)).expect("every key is known");
        assert_eq!(read.replay.differences.as_deref(), Some(Path::new("/etc/dog/here/differences.jsonl")));
        let written = toml::Value::try_from(&read).expect("settings can be written");
        let found = texts(&written);
        assert_eq!(found.iter().filter(|text| text.starts_with("here/")).count(), 0, "{found:?}");
        let rooted = found.iter().filter(|text| text.starts_with("/etc/dog/here/")).count();
        assert_eq!(rooted, EVERY_PATH.matches("\"here/").count(), "{found:?}");
        // What the supervisor writes for its children is read as it is.
        assert_eq!(written.try_into::<Settings>().expect("and read"), read);
    }

    /// One folder serves all layers only as long as those that are built in name no relative path.
    #[test]
    fn what_is_built_in_names_no_relative_path() {
        for profile in [Profile::Walk, Profile::Carmen] {
            let settings = load(profile, None).expect("the profile is right");
            let written = toml::Value::try_from(&settings).expect("settings can be written");
            let here = std::env::current_dir().expect("a folder").display().to_string();
            assert!(!texts(&written).iter().any(|text| text.starts_with(&here)), "{written}");
        }
    }

    #[test]
    fn names_absolute_paths_and_what_no_file_holds_stay_as_they_are() {
        let text = "policy.model = \"guide\"\nspeak.language = \"de\"\nrecord.path = \"/rec/a.mcap\"\n";
        let read: Settings = starting_at("/etc/dog".into(), || toml::from_str(text)).expect("right");
        assert_eq!(read, toml::from_str(text).expect("right"));
        assert_eq!(read.record.path, Some("/rec/a.mcap".into()));
        let asked: ConfigPath = toml::Value::from("swapped.onnx").try_into().expect("a path");
        assert_eq!(asked, "swapped.onnx".into());
    }

    #[test]
    fn a_folder_holds_only_while_its_file_is_read() {
        let read = || -> PathBuf { ConfigPath::from("a").rooted().into() };
        let within = starting_at("/x".into(), || (starting_at("/y".into(), read), read()));
        assert_eq!((within.0, within.1, read()), ("/y/a".into(), "/x/a".into(), "a".into()));
        let panics = std::panic::catch_unwind(|| starting_at("/x".into(), || panic!("while reading")));
        assert!(panics.is_err());
        assert_eq!(read(), Path::new("a"));
    }
}
