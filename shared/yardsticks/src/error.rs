//! What can be wrong with a yardstick's files.

use world::{ConfigError, WorldError};

/// A file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum YardstickError {
    /// The file cannot be read or unpacked.
    #[error("failed to read {file}: {source}")]
    Read {
        /// The file's path as given.
        file: String,
        /// What the operating system or the decoder said.
        source: std::io::Error,
    },
    /// What it holds cannot be used.
    #[error("{file}: {what}")]
    Content {
        /// The file's path as given.
        file: String,
        /// What is wrong, and where.
        what: String,
    },
    /// A world or tracks that cannot be used.
    #[error(transparent)]
    World(#[from] WorldError),
    /// Sensors or legs with parameters that cannot be.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A handler with parameters that cannot be.
    #[error(transparent)]
    Handler(#[from] guidance::HarnessError),
    /// The policy cannot decide.
    #[error(transparent)]
    Decide(#[from] policies::EngineError),
}

impl YardstickError {
    /// For what a file holds.
    pub(crate) fn content(file: &str, what: impl Into<String>) -> Self {
        Self::Content { file: file.to_owned(), what: what.into() }
    }
}
