//! What runs ONNX models: tract, which is built in, or ONNX Runtime from a library.
//!
//! One of them for the life of a process: `ort` takes its functions from a table that is set once.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use ort::environment::Environment;
use ort::session::builder::GraphOptimizationLevel;

pub use ort::Error;
pub use ort::inputs;
pub use ort::session::Session;
pub use ort::value::TensorRef;

/// The interface version that is asked of the library: that of ONNX Runtime 1.22, and of all newer ones.
const API: u32 = 22;

/// Where ONNX Runtime looks for weights that a model keeps in files of their own: nowhere. What runs is what was
/// verified, the bytes of the model.
const WEIGHTS_BESIDE: (&str, &str) = ("session.model_external_initializers_file_folder_path", "/dev/null");

/// Why no model can be run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RuntimeError {
    /// The library cannot be loaded, or is none of ONNX Runtime.
    #[error("failed to load ONNX Runtime from {}: {what}", path.display())]
    Library {
        /// The library.
        path: PathBuf,
        /// Why.
        what: String,
    },
    /// Another one is in use already.
    #[error("this process runs its models by {0} already")]
    Taken(String),
    /// It could not be started.
    #[error("failed to start {engine}: {what}")]
    Start {
        /// Which.
        engine: String,
        /// Why.
        what: String,
    },
}

/// Which one it is, and its environment.
struct Runtime {
    library: Option<PathBuf>,
    environment: Environment,
}

static RUNTIME: OnceLock<Result<Runtime, RuntimeError>> = OnceLock::new();

fn name(library: Option<&Path>) -> String {
    library.map_or_else(|| "tract".to_owned(), |path| path.display().to_string())
}

fn start(library: Option<&Path>) -> Result<Runtime, RuntimeError> {
    let api = match library {
        None => ort_tract::api(),
        Some(path) => load(path)?,
    };
    ort::set_api(api);
    let failed = |error: ort::Error| RuntimeError::Start { engine: name(library), what: error.to_string() };
    let environment = ort::init().with_name("guidedog").with_telemetry(false).build().map_err(failed)?;
    Ok(Runtime { library: library.map(Path::to_owned), environment })
}

/// The functions of ONNX Runtime in a library.
fn load(path: &Path) -> Result<ort_sys::OrtApi, RuntimeError> {
    let failed = |what: String| RuntimeError::Library { path: path.to_owned(), what };
    // SAFETY: loading a library runs its initialisers; the operator names it in the configuration as ONNX Runtime's.
    let library = unsafe { libloading::Library::new(path) }.map_err(|error| failed(with_reason(&error)))?;
    // SAFETY: the symbol is ONNX Runtime's documented entry point, of this type in every version.
    let base: libloading::Symbol<'_, unsafe extern "C" fn() -> *const ort_sys::OrtApiBase> =
        unsafe { library.get(b"OrtGetApiBase\0") }.map_err(|error| failed(with_reason(&error)))?;
    // SAFETY: the entry point takes nothing and gives a table that lives as long as the library.
    let base = unsafe { base().as_ref() }.ok_or_else(|| failed("it gives no interface".to_owned()))?;
    // SAFETY: the table's function of that name is called as it is documented.
    let api = unsafe { (base.GetApi)(API) };
    if api.is_null() {
        return Err(failed("it is older than ONNX Runtime 1.22".to_owned()));
    }
    // SAFETY: not null, and of the version that was asked for: the table is as long as our type.
    let api = unsafe { std::ptr::read(api) };
    // Its functions are used until the process ends.
    std::mem::forget(library);
    Ok(api)
}

/// What went wrong, and what the loader says of it.
fn with_reason(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or_else(|| error.to_string(), |reason| format!("{error}: {reason}"))
}

/// A session for a model, by tract or by the library.
///
/// # Errors
/// Where there is no such engine, this process runs its models by another one, or the engine does not take the model.
pub fn session(bytes: &[u8], library: Option<&Path>) -> Result<Session, String> {
    let runtime = RUNTIME.get_or_init(|| start(library)).as_ref().map_err(ToString::to_string)?;
    if runtime.library.as_deref() != library {
        return Err(RuntimeError::Taken(name(runtime.library.as_deref())).to_string());
    }
    let session = || -> ort::Result<Session> {
        // tract's speed depends on the level: without it a small network takes 20 times as long.
        let mut builder = Session::builder(&runtime.environment)?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_intra_threads(1)?;
        // tract knows no such weights.
        if library.is_some() {
            builder = builder.with_config_entry(WEIGHTS_BESIDE.0, WEIGHTS_BESIDE.1)?;
        }
        builder.commit_from_memory(bytes)
    };
    session().map_err(|error| error.to_string())
}
