//! What can go wrong between processes.

use std::path::PathBuf;

use messages::{ServiceId, TopicId};

/// An error of the transport. None of them is the caller's fault, bar [`TransportError::Arguments`] and
/// [`TransportError::NotListed`].
#[derive(Debug, thiserror::Error)]
pub enum TransportError {
    /// A topic cannot be created or opened: the run's shared memory is gone, full, or not ours.
    #[error("failed to open {topic}: {reason}")]
    Open {
        /// The topic.
        topic: String,
        /// What iceoryx2 says.
        reason: String,
    },
    /// A service asked for an end of a topic that its row of the topic table does not give it.
    #[error("failed to open {topic}: the topic table does not list {service} among its {end}")]
    NotListed {
        /// The topic.
        topic: TopicId,
        /// The service.
        service: ServiceId,
        /// The list that it is not in: publishers or subscribers.
        end: &'static str,
    },
    /// A message cannot be loaned or sent.
    #[error("failed to publish on {topic}: {reason}")]
    Publish {
        /// The topic.
        topic: TopicId,
        /// What iceoryx2 says.
        reason: String,
    },
    /// A message cannot be received.
    #[error("failed to receive on {topic}: {reason}")]
    Receive {
        /// The topic.
        topic: TopicId,
        /// What iceoryx2 says.
        reason: String,
    },
    /// The run directory is missing, not ours, or not readable.
    #[error("run directory {path}: {reason}")]
    RunDir {
        /// The directory or file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Another run of that name is alive.
    #[error("run directory {path}: a run of that name is alive")]
    NameTaken {
        /// Its directory.
        path: PathBuf,
    },
    /// A call to the kernel failed.
    #[error("{call} failed: {errno}")]
    System {
        /// What was tried.
        call: &'static str,
        /// The kernel's word.
        errno: rustix::io::Errno,
    },
    /// A service was started by hand, or with wrong arguments.
    #[error("{0}")]
    Arguments(String),
    /// The service itself failed.
    #[error("{0}")]
    Service(String),
}

impl TransportError {
    /// A failure of the service itself, in its own words.
    pub fn service(error: impl std::fmt::Display) -> Self {
        Self::Service(error.to_string())
    }

    /// For `map_err`: names the call that failed.
    pub(crate) fn system(call: &'static str) -> impl FnOnce(rustix::io::Errno) -> Self {
        move |errno| Self::System { call, errno }
    }
}
