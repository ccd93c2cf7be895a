//! A policy's model: a file, and the manifest beside it that says what it is for. Both are read once; what is verified
//! is what is used.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use guidance::{ActionTable, observation};
use serde::Deserialize;
use serde_json::{Value, json};
use settings::{ActionTableName, HandlerModel, Millis, PolicyModel, Positive, Settings, Source};
use sha2::{Digest, Sha256};

use crate::geometric::GeometricConfig;

/// The observation that a geometric model is fed with, and its version: what [`crate::geometric::Observation`] holds.
/// That of a learnt one is [`guidance::observation::OBSERVATION`].
pub const OBSERVATION: &str = "lidar-depth-pose-cue/1";
/// No policy of ours remembers more.
const MEMORY_MAX: usize = 4096;
/// A file that is larger is no model of ours, bytes.
const BYTES_MAX: u64 = 64 << 20;

/// What stands in the manifest, `NAME.toml` beside `NAME.onnx` or `NAME.geometric`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// SHA-256 of the model file, in hexadecimal.
    pub sha256: String,
    /// The observation that it was made for; see [`OBSERVATION`].
    pub observation: String,
    /// The action table that it decides over: the run's, or the first actions of it.
    pub actions: ActionTableName,
    /// The decision period that it was made for.
    pub dt: Millis,
    /// Observations of the last so many decisions are one input.
    #[serde(default = "one")]
    pub frames: usize,
    /// Size of the recurrent state; 0: there is none.
    #[serde(default)]
    pub memory: usize,
    /// A learnt policy's logits are divided by it: below 1 what is drawn is drawn more surely, above 1 less.
    pub temperature: Option<Positive>,
    /// How it was trained.
    pub trained: Option<Trained>,
    /// What it scored when it was made, as `guidedog evaluate` tells it.
    #[serde(default)]
    pub scores: toml::Table,
}

fn one() -> usize {
    1
}

/// How a learnt policy was trained.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trained {
    /// Environment steps of reinforcement.
    pub steps: u64,
    /// Environment steps of imitation before.
    #[serde(default)]
    pub taught: u64,
    /// The shield's suppression factor (Kim et al. 2023, section 5).
    pub beta: f64,
    /// "ideal" or "noisy".
    pub noise: String,
    /// How handlers followed.
    pub harness: HandlerModel,
    /// Whether there was a camera.
    #[serde(default = "yes")]
    pub depth: bool,
    /// Whether what was seen before was remembered.
    #[serde(default = "yes")]
    pub memory: bool,
    /// Seed of the training.
    pub seed: u64,
    /// The handlers' remembered share, least and greatest.
    pub alpha: [f64; 2],
    /// Where they walked, robot frame, x and y, least and greatest, metres.
    pub offset_x_m: [f64; 2],
    /// See [`Trained::offset_x_m`].
    pub offset_y_m: [f64; 2],
    /// The command that makes it again.
    pub command: String,
}

fn yes() -> bool {
    true
}

impl Trained {
    fn strange(&self, settings: &Settings) -> Option<String> {
        let handler = &settings.handler;
        let checks = [
            ("alpha", handler.alpha.get(), self.alpha),
            ("robot_from_handler.x_m", handler.robot_from_handler.x_m, self.offset_x_m),
            ("robot_from_handler.y_m", handler.robot_from_handler.y_m, self.offset_y_m),
        ];
        let outside = checks.into_iter().filter(|(_, value, [least, most])| !(*least..=*most).contains(value));
        let mut told: Vec<String> = outside
            .map(|(key, value, [least, most])| format!("handler.{key} = {value} (trained with {least} to {most})"))
            .collect();
        if handler.model != self.harness {
            told.push(format!("handler.model = {} (trained with {})", json!(handler.model), json!(self.harness)));
        }
        // What is not seen or not remembered looks to a network as what is free.
        if self.depth && settings.depth.source == Source::Absent {
            told.push("depth.source = \"absent\" (trained with a camera)".to_owned());
        }
        if self.memory && settings.memory_config().is_none() {
            told.push("shield.memory is off (trained with it)".to_owned());
        }
        (!told.is_empty()).then(|| told.join(", "))
    }
}

/// What a run expects of its model.
#[derive(Debug, Clone)]
pub struct Expected {
    /// The run's action table.
    pub table: ActionTable,
    /// The run's decision period, nanoseconds.
    pub dt_ns: u64,
}

impl Expected {
    /// What the run of these settings expects.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        Self { table: settings.policy.actions.table(), dt_ns: settings.policy.dt.ns() }
    }
}

/// The geometric engine's tuning: the model file `NAME.geometric`. What it leaves out is as built.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GeometricTuning {
    /// What was seen is remembered for so long, seconds.
    pub memory_s: Option<Positive>,
    /// Room that is kept beyond what the shield demands, metres.
    pub reserve_m: Option<Positive>,
    /// Beams that end this near to the predicted handler are taken to end on the handler, metres.
    pub handler_mask_m: Option<Positive>,
}

impl GeometricTuning {
    /// Changes what the model says.
    pub fn apply(&self, config: &mut GeometricConfig) {
        config.memory_s = self.memory_s.map_or(config.memory_s, Positive::get);
        config.reserve_m = self.reserve_m.map_or(config.reserve_m, Positive::get);
        config.handler_mask_m = self.handler_mask_m.map_or(config.handler_mask_m, Positive::get);
    }
}

/// Why a model is refused.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The operating system failed.
    #[error("failed to read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// No engine of this build loads such a file.
    #[error("{}: no engine loads a file of that kind; \"NAME.onnx\" and \"NAME.geometric\" are two", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
    },
    /// It is no file, or larger than any model.
    #[error("{} is no model: {what}", path.display())]
    NoModel {
        /// The file.
        path: PathBuf,
        /// What it is.
        what: String,
    },
    /// It is not what its kind of file holds; the message names the line.
    #[error("{}: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The file is not the one that the manifest is about.
    #[error("{} has the digest {found}, and its manifest says {wanted}", path.display())]
    Digest {
        /// The model file.
        path: PathBuf,
        /// What the manifest says.
        wanted: String,
        /// What it is.
        found: String,
    },
    /// It was made for something else than this run has.
    #[error("{} was made for {what} {found}, and the run has {wanted}", path.display())]
    Other {
        /// The manifest.
        path: PathBuf,
        /// What differs.
        what: &'static str,
        /// What the run has.
        wanted: String,
        /// What the manifest says.
        found: String,
    },
}

/// A model that was loaded and verified.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Where it came from.
    pub path: PathBuf,
    /// Its digest, verified.
    pub sha256: String,
    /// What stands beside it.
    pub manifest: Manifest,
    /// What it says.
    pub kind: ModelKind,
}

/// What a model file holds.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelKind {
    /// The geometric engine's tuning.
    Geometric(GeometricTuning),
    /// A network: the bytes of an ONNX file.
    Learnt {
        /// As verified.
        bytes: Vec<u8>,
    },
}

/// The learnt policy that is shipped: `scripts/train/guide` makes it again.
const GUIDE: (&[u8], &[u8]) =
    (include_bytes!("../../../config/policies/guide.onnx"), include_bytes!("../../../config/policies/guide.toml"));

impl Model {
    /// The model of that name; none for an engine that is built in and needs none.
    ///
    /// # Errors
    /// As [`Model::load`].
    pub fn named(name: &PolicyModel, expected: &Expected) -> Result<Option<Self>, ModelError> {
        match name {
            PolicyModel::Geometric | PolicyModel::Steps => Ok(None),
            PolicyModel::Guide => {
                let (bytes, manifest) = GUIDE;
                Self::verified(&PathBuf::from(name.clone()), true, bytes.to_vec(), manifest, expected).map(Some)
            }
            PolicyModel::File(path) => Self::load(path, expected).map(Some),
        }
    }

    /// Loads the model at `path` with its manifest beside it.
    ///
    /// # Errors
    /// Where one of them cannot be read, or they do not fit each other or the run.
    pub fn load(path: &Path, expected: &Expected) -> Result<Self, ModelError> {
        let is_learnt = match path.extension().and_then(|kind| kind.to_str()) {
            Some("onnx") => true,
            Some("geometric") => false,
            _ => return Err(ModelError::Kind { path: path.to_owned() }),
        };
        let bytes = read(path)?;
        Self::verified(path, is_learnt, bytes, &read(&path.with_extension("toml"))?, expected)
    }

    fn verified(
        path: &Path,
        is_learnt: bool,
        bytes: Vec<u8>,
        manifest: &[u8],
        expected: &Expected,
    ) -> Result<Self, ModelError> {
        let manifest_path = path.with_extension("toml");
        let manifest: Manifest = parse(&manifest_path, manifest)?;
        let sha256: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        if !manifest.sha256.eq_ignore_ascii_case(&sha256) {
            return Err(ModelError::Digest { path: path.to_owned(), wanted: manifest.sha256, found: sha256 });
        }
        manifest.check(&manifest_path, expected, if is_learnt { observation::OBSERVATION } else { OBSERVATION })?;
        let kind = if is_learnt { ModelKind::Learnt { bytes } } else { ModelKind::Geometric(parse(path, &bytes)?) };
        Ok(Self { path: path.to_owned(), sha256, manifest, kind })
    }

    /// What an operator is told of it, a handler that it was not trained with included.
    #[must_use]
    pub fn about(&self, settings: &Settings) -> Value {
        let engine = match self.kind {
            ModelKind::Geometric(_) => "geometric",
            ModelKind::Learnt { .. } => "learnt",
        };
        json!({
            "engine": engine,
            "model": self.path,
            "sha256": self.sha256,
            "not_trained_with": self.strange(settings),
            "scores": self.manifest.scores,
        })
    }

    /// What of the configured handler and senses lies outside of what it was trained with, if anything.
    #[must_use]
    pub fn strange(&self, settings: &Settings) -> Option<String> {
        self.manifest.trained.as_ref()?.strange(settings)
    }
}

impl Manifest {
    fn check(&self, path: &Path, expected: &Expected, observation: &str) -> Result<(), ModelError> {
        let other = |what, wanted: &str, found: &str| ModelError::Other {
            path: path.to_owned(),
            what,
            wanted: wanted.to_owned(),
            found: found.to_owned(),
        };
        if self.observation != observation {
            return Err(other("the observation", observation, &self.observation));
        }
        for (what, size, bounds) in
            [("frames", self.frames, 1..=observation::FRAMES_MAX), ("memory", self.memory, 0..=MEMORY_MAX)]
        {
            if !bounds.contains(&size) {
                let what = format!("{what} = {size} is not in {}..{}", bounds.start(), bounds.end());
                return Err(ModelError::Content { path: path.to_owned(), what });
            }
        }
        let table = self.actions.table();
        // What it does not know of, it does not propose.
        if !expected.table.begins_with(&table) {
            let actions = |table: &ActionTable| format!("of {} actions", table.len());
            return Err(other("the action table", &actions(&expected.table), &actions(&table)));
        }
        if self.dt.ns() != expected.dt_ns {
            let ms = |ns: u64| format!("{} ms", ns / 1_000_000);
            return Err(other("a decision period of", &ms(expected.dt_ns), &ms(self.dt.ns())));
        }
        Ok(())
    }
}

fn read(path: &Path) -> Result<Vec<u8>, ModelError> {
    let failed = |source| ModelError::Read { path: path.to_owned(), source };
    let no_model = |what: &str| ModelError::NoModel { path: path.to_owned(), what: what.to_owned() };
    // Before it is opened: opening a pipe would wait for its writer.
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(no_model("it is not a file"));
    }
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(BYTES_MAX + 1).read_to_end(&mut bytes)).map_err(failed)?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(no_model(&format!("it has over {BYTES_MAX} bytes")));
    }
    Ok(bytes)
}

fn parse<T: for<'a> Deserialize<'a>>(path: &Path, bytes: &[u8]) -> Result<T, ModelError> {
    let wrong = |what: String| ModelError::Content { path: path.to_owned(), what };
    let text = std::str::from_utf8(bytes).map_err(|error| wrong(format!("not text: {error}")))?;
    toml::from_str(text).map_err(|error| wrong(error.to_string().trim_end().replace('\n', " ")))
}

#[cfg(test)]
mod tests {
    use super::{Expected, Model, ModelKind, OBSERVATION};
    use guidance::ActionTable;
    use sha2::{Digest, Sha256};
    use std::path::{Path, PathBuf};

    const TUNING: &str = "reserve_m = 0.08\n";

    fn expected() -> Expected {
        Expected { table: ActionTable::eight(), dt_ns: 500_000_000 }
    }

    fn manifest(tuning: &str) -> String {
        let sha256: String = Sha256::digest(tuning).iter().map(|byte| format!("{byte:02x}")).collect();
        format!("sha256 = \"{sha256}\"\nobservation = \"{OBSERVATION}\"\nactions = \"eight\"\ndt = \"500ms\"\n")
    }

    fn model(dir: &Path, tuning: &str, manifest: &str) -> PathBuf {
        let path = dir.join("careful.geometric");
        std::fs::write(&path, tuning).expect("written");
        std::fs::write(dir.join("careful.toml"), manifest).expect("written");
        path
    }

    #[test]
    fn a_model_that_fits_is_loaded() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = model(dir.path(), TUNING, &manifest(TUNING));
        let loaded = Model::load(&path, &expected()).expect("it fits");
        let ModelKind::Geometric(tuning) = loaded.kind else { panic!("a tuning") };
        assert_eq!(tuning.reserve_m.map(settings::Positive::get), Some(0.08));
        assert_eq!(loaded.sha256.len(), 64);
    }

    #[test]
    fn what_does_not_fit_is_refused_with_the_reason() {
        let dir = tempfile::tempdir().expect("a folder");
        let good = manifest(TUNING);
        let cases = [
            (good.replace("sha256 = \"", "sha256 = \"0"), "has the digest"),
            (good.replace(OBSERVATION, "depth-only/3"), "the observation depth-only/3"),
            (good.replace("eight", "ten"), "the action table of 10 actions, and the run has of 8 actions"),
            (good.replace("500ms", "250ms"), "a decision period of 250 ms"),
            (good.replace("dt", "tick"), "careful.toml: TOML parse error at line 4"),
            (String::new(), "careful.toml: TOML parse error"),
        ];
        for (manifest, what) in cases {
            let path = model(dir.path(), TUNING, &manifest);
            let error = Model::load(&path, &expected()).expect_err(what).to_string();
            assert!(error.contains(what), "{error}");
        }
    }

    #[test]
    fn what_is_no_model_is_named() {
        let dir = tempfile::tempdir().expect("a folder");
        let wrong = "reserve_m = -1.0\n";
        let path = model(dir.path(), wrong, &manifest(wrong));
        let error = Model::load(&path, &expected()).expect_err("negative").to_string();
        assert!(error.contains("careful.geometric: TOML parse error at line 1"), "{error}");
        std::fs::remove_file(dir.path().join("careful.toml")).expect("removed");
        let error = Model::load(&path, &expected()).expect_err("no manifest").to_string();
        assert!(error.contains("failed to read") && error.contains("careful.toml"), "{error}");
        for (name, what) in [("none.geometric", "failed to read"), ("guide.bin", "no engine loads")] {
            let error = Model::load(&dir.path().join(name), &expected()).expect_err(name).to_string();
            assert!(error.contains(what), "{error}");
        }
        std::fs::create_dir(dir.path().join("folder.geometric")).expect("made");
        let error = Model::load(&dir.path().join("folder.geometric"), &expected()).expect_err("a folder").to_string();
        assert!(error.contains("it is not a file"), "{error}");
    }
}
