//! The files that hearing needs: the embedding, the head, and the manifest, which names both by their digests. What is
//! verified is what is used.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use inference::{Session, TensorRef};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::mel::{BANDS, Mel};
use crate::rules::Rules;
use crate::{LABELS, Probabilities};

/// What is to be done about a manifest without the rules of talk.
const EARLIER: &str = "\nthis head is of an earlier version: enrol anew (guidedog cue enrol)";
/// What the head is fed with, and its version.
const FEATURES: &str = "speech-embedding-96/2";
/// Frames that one embedding is of.
pub const FRAMES: usize = 76;
/// Frames from one embedding to the next.
pub const FRAMES_AN_EMBEDDING: usize = 8;
/// Numbers that the embedding hands from one step to the next: the last two rows that each of its layers saw.
const MEMORY: usize = 9472;
/// Numbers of an embedding.
pub const EMBEDDING: usize = 96;
/// Embeddings that the head looks at.
pub const WINDOWS: usize = 8;
/// A file that is larger is none of ours, bytes.
const BYTES_MAX: u64 = 16 << 20;

/// Why nothing can be heard.
#[derive(Debug, thiserror::Error)]
pub enum SpeechError {
    /// A file cannot be read.
    #[error("failed to read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The embedding is not there.
    #[error("{} is missing: it is shipped with cues.toml, in config/cues", path.display())]
    NoEmbedding {
        /// Where it is looked for.
        path: PathBuf,
    },
    /// It is not what such a file holds.
    #[error("{}: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// It is another file than the manifest is about.
    #[error("{} has the digest {found}, and {} says {wanted}", path.display(), manifest.display())]
    Digest {
        /// The file.
        path: PathBuf,
        /// The manifest.
        manifest: PathBuf,
        /// What the manifest says.
        wanted: String,
        /// What it is.
        found: String,
    },
    /// A network failed.
    #[error("the {network} cannot be run: {what}")]
    Run {
        /// Which.
        network: &'static str,
        /// Why.
        what: String,
    },
}

/// Where the files are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelFiles {
    /// The manifest, `NAME.toml`; the head is `NAME.onnx` beside it.
    pub manifest: PathBuf,
    /// The embedding.
    pub embedding: PathBuf,
    /// ONNX Runtime's library, where networks are not to be run by tract.
    pub onnx_runtime: Option<PathBuf>,
}

/// What stands beside the head.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// SHA-256 of the head, in hexadecimal.
    pub sha256: String,
    /// SHA-256 of the embedding that it was trained with.
    pub embedding_sha256: String,
    /// What it is fed with.
    pub features: String,
    /// Its outputs.
    pub labels: Vec<String>,
    /// How many embeddings it looks at.
    pub windows: usize,
    /// How its outputs become cues.
    pub rules: Rules,
    /// SHA-256 of the rehearsal set, with which its dense layers are trained anew for one speaker.
    pub rehearsal_sha256: Option<String>,
    /// How it was trained, and what it scored.
    #[serde(default)]
    pub trained: toml::Table,
}

impl Manifest {
    /// Reads a manifest, and says what of it does not fit.
    ///
    /// # Errors
    /// Where it is none, or is of a head that this program cannot feed.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, SpeechError> {
        let wrong = |what: String| SpeechError::Content { path: path.to_owned(), what };
        let text = std::str::from_utf8(bytes).map_err(|error| wrong(error.to_string()))?;
        let manifest: Self = toml::from_str(text).map_err(|error| {
            let earlier = if error.message().contains("missing field `talk`") { EARLIER } else { "" };
            wrong(format!("{}{earlier}", error.to_string().trim_end()))
        })?;
        if manifest.features != FEATURES {
            return Err(wrong(format!("features = \"{}\", and this program makes \"{FEATURES}\"", manifest.features)));
        }
        if manifest.labels != LABELS {
            return Err(wrong(format!("labels = {:?}, and this program knows {LABELS:?}", manifest.labels)));
        }
        if manifest.windows != WINDOWS {
            return Err(wrong(format!("windows = {}, and this program has {WINDOWS}", manifest.windows)));
        }
        manifest.rules.check().map_err(wrong)?;
        Ok(manifest)
    }
}

/// Reads a file that is no larger than any of ours.
///
/// # Errors
/// Where it cannot be read, is no file, or is larger.
pub fn read(path: &Path) -> Result<Vec<u8>, SpeechError> {
    let failed = |source| SpeechError::Read { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    let found = std::fs::metadata(path).map_err(failed)?;
    // Before it is opened: opening a pipe would wait for its writer.
    if !found.is_file() {
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it is not a file")));
    }
    File::open(path).and_then(|file| file.take(BYTES_MAX + 1).read_to_end(&mut bytes)).map_err(failed)?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(SpeechError::Content { path: path.to_owned(), what: format!("it has over {BYTES_MAX} bytes") });
    }
    Ok(bytes)
}

/// SHA-256 in hexadecimal.
#[must_use]
pub fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn verify(path: &Path, bytes: &[u8], manifest: &Path, wanted: &str) -> Result<(), SpeechError> {
    let found = digest(bytes);
    if found == wanted {
        return Ok(());
    }
    let (path, manifest) = (path.to_owned(), manifest.to_owned());
    Err(SpeechError::Digest { path, manifest, wanted: wanted.to_owned(), found })
}

/// The head's bytes, verified, with its manifest.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// Where it is.
    pub path: PathBuf,
    /// An ONNX file.
    pub bytes: Vec<u8>,
    /// What stands beside it.
    pub manifest: Manifest,
}

impl Head {
    /// Reads head and manifest.
    ///
    /// # Errors
    /// Where one cannot be read, or they do not belong together.
    pub fn read(manifest_path: &Path) -> Result<Self, SpeechError> {
        let manifest = Manifest::parse(manifest_path, &read(manifest_path)?)?;
        let path = manifest_path.with_extension("onnx");
        let bytes = read(&path)?;
        verify(&path, &bytes, manifest_path, &manifest.sha256)?;
        Ok(Self { path, bytes, manifest })
    }
}

/// A network by its name, and what it gives.
pub struct Network {
    session: Session,
    name: &'static str,
}

impl Network {
    /// Makes one of a model's bytes, which were read from `path`; `name` is what it is called where it fails.
    ///
    /// # Errors
    /// Where it is none that the engine can run.
    pub fn new(
        path: &Path,
        bytes: &[u8],
        name: &'static str,
        onnx_runtime: Option<&Path>,
    ) -> Result<Self, SpeechError> {
        let wrong = |what: String| SpeechError::Content { path: path.to_owned(), what };
        Ok(Self { session: inference::session(bytes, onnx_runtime).map_err(wrong)?, name })
    }

    /// Runs a network of one input and one output: numbers of this shape in, finite numbers out.
    ///
    /// # Errors
    /// Where it cannot be run.
    pub fn run(&mut self, shape: &[usize], numbers: &[f32]) -> Result<Vec<f32>, SpeechError> {
        let network = self.name;
        let failed = |error: inference::Error| SpeechError::Run { network, what: error.to_string() };
        let input = TensorRef::from_array_view((shape.to_vec(), numbers)).map_err(failed)?;
        let outputs = self.session.run(inference::inputs![input]).map_err(failed)?;
        let (_, found) = outputs[0].try_extract_tensor::<f32>().map_err(failed)?;
        all_finite(network, found).map(<[f32]>::to_vec)
    }

    /// As [`Network::run`], where so many numbers have to come.
    fn run_for<const N: usize>(&mut self, shape: &[usize], numbers: &[f32]) -> Result<[f32; N], SpeechError> {
        let found = self.run(shape, numbers)?;
        exactly(self.name, &found)
    }

    /// A step of a network that remembers: `frames` and `memory` in, `embedding` and `memory_after` out.
    fn step(&mut self, frames: &[Mel], memory: &mut [f32]) -> Result<[f32; EMBEDDING], SpeechError> {
        let network = self.name;
        let failed = |error: inference::Error| SpeechError::Run { network, what: error.to_string() };
        let frames = TensorRef::from_array_view((vec![1, frames.len(), BANDS], frames.as_flattened()));
        let before = TensorRef::from_array_view((vec![1, memory.len()], &*memory));
        let inputs = inference::inputs!["frames" => frames.map_err(failed)?, "memory" => before.map_err(failed)?];
        let outputs = self.session.run(inputs).map_err(failed)?;
        let numbers = |name: &str| outputs[name].try_extract_tensor::<f32>().map_err(failed);
        let (embedding, after) = (numbers("embedding")?.1, numbers("memory_after")?.1);
        let embedding = exactly(network, all_finite(network, embedding)?)?;
        let after = all_finite(network, after)?;
        if after.len() != memory.len() {
            let what = format!("it remembers {} numbers, not {}", after.len(), memory.len());
            return Err(SpeechError::Run { network, what });
        }
        memory.copy_from_slice(after);
        Ok(embedding)
    }
}

fn all_finite<'a>(network: &'static str, numbers: &'a [f32]) -> Result<&'a [f32], SpeechError> {
    if numbers.iter().all(|number| number.is_finite()) {
        return Ok(numbers);
    }
    Err(SpeechError::Run { network, what: "its output is not finite".to_owned() })
}

fn exactly<const N: usize>(network: &'static str, found: &[f32]) -> Result<[f32; N], SpeechError> {
    let what = || format!("it gives {} numbers, not {N}", found.len());
    found.try_into().map_err(|_| SpeechError::Run { network, what: what() })
}

/// What the embedding remembers of the frames so far; of none, zeros.
#[derive(Debug, Clone, PartialEq)]
pub struct Embedder {
    memory: Vec<f32>,
}

impl Default for Embedder {
    fn default() -> Self {
        Self { memory: vec![0.0; MEMORY] }
    }
}

impl Embedder {
    /// Takes the next [`FRAMES_AN_EMBEDDING`] frames: the embedding of the last [`FRAMES`]. Before there were as many,
    /// it is of nothing.
    ///
    /// # Errors
    /// Where the network cannot be run.
    pub fn push(&mut self, frames: &[Mel], networks: &mut Networks) -> Result<[f32; EMBEDDING], SpeechError> {
        networks.embedding.step(frames, &mut self.memory)
    }
}

/// The two networks.
pub struct Networks {
    embedding: Network,
    head: Network,
}

impl Networks {
    /// Reads and verifies the embedding, and runs both networks once.
    ///
    /// # Errors
    /// Where a file is missing, not what its digest says, or of another shape.
    pub fn new(head: &Head, files: &ModelFiles) -> Result<Self, SpeechError> {
        if !files.embedding.exists() {
            return Err(SpeechError::NoEmbedding { path: files.embedding.clone() });
        }
        let embedding = read(&files.embedding)?;
        verify(&files.embedding, &embedding, &files.manifest, &head.manifest.embedding_sha256)?;
        let onnx_runtime = files.onnx_runtime.as_deref();
        let mut networks = Self {
            embedding: Network::new(&files.embedding, &embedding, "embedding", onnx_runtime)?,
            head: Network::new(&head.path, &head.bytes, "head", onnx_runtime)?,
        };
        // One of another shape is found out now.
        let shape =
            |path: &Path, error: SpeechError| SpeechError::Content { path: path.to_owned(), what: error.to_string() };
        let frames = [[0.0; BANDS]; FRAMES_AN_EMBEDDING];
        Embedder::default().push(&frames, &mut networks).map_err(|error| shape(&files.embedding, error))?;
        networks.judge(&[[0.0; EMBEDDING]; WINDOWS]).map_err(|error| shape(&head.path, error))?;
        Ok(networks)
    }

    /// Embeddings of a stretch: one each [`FRAMES_AN_EMBEDDING`] frames, the first of the first [`FRAMES`].
    ///
    /// # Errors
    /// Where the network cannot be run.
    pub fn embed(&mut self, frames: &[Mel]) -> Result<Vec<[f32; EMBEDDING]>, SpeechError> {
        // Padding, so that the first embedding ends with a whole step.
        let unseen = FRAMES.next_multiple_of(FRAMES_AN_EMBEDDING) - FRAMES;
        let padded: Vec<Mel> = std::iter::repeat_n([0.0; BANDS], unseen).chain(frames.iter().copied()).collect();
        let mut embedder = Embedder::default();
        let (steps, _) = padded.as_chunks::<FRAMES_AN_EMBEDDING>();
        let made = steps.iter().map(|step| embedder.push(step, self)).collect::<Result<Vec<_>, _>>()?;
        Ok(made.into_iter().skip(FRAMES / FRAMES_AN_EMBEDDING).collect())
    }

    /// How probable each word is after [`WINDOWS`] embeddings.
    ///
    /// # Errors
    /// Where it cannot be run.
    pub fn judge(&mut self, embeddings: &[[f32; EMBEDDING]]) -> Result<Probabilities, SpeechError> {
        let probabilities: Probabilities = self.head.run_for(&[1, WINDOWS, EMBEDDING], embeddings.as_flattened())?;
        if probabilities.iter().all(|p| (0.0..=1.0).contains(p)) {
            return Ok(probabilities);
        }
        Err(SpeechError::Run { network: "head", what: format!("{probabilities:?} are no probabilities") })
    }
}
