//! What the recorder of a run is to record, as the supervisor leaves it in the run directory.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::{RunDir, TransportError};

/// An order to record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingOrder {
    /// The recording's first file, absolute.
    pub path: PathBuf,
    /// Lives of the recorder that ended before the order was given: the next one begins `path`, those after it go on in
    /// numbered files.
    pub lives_before: u32,
}

impl RunDir {
    fn recording_order(&self) -> PathBuf {
        self.path().join("recording.json")
    }

    /// Leaves an order to the recorder.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn write_recording_order(&self, order: &RecordingOrder) -> Result<(), TransportError> {
        let text = serde_json::to_string(order).map_err(TransportError::service)?;
        let path = self.recording_order();
        std::fs::write(&path, text).map_err(|error| TransportError::RunDir { path, reason: error.to_string() })
    }

    /// The order, for the recorder.
    ///
    /// # Errors
    /// Where there is none, or it makes no sense.
    pub fn read_recording_order(&self) -> Result<RecordingOrder, TransportError> {
        let path = self.recording_order();
        let text = std::fs::read_to_string(&path);
        let order = text
            .map_err(|error| error.to_string())
            .and_then(|text| serde_json::from_str(&text).map_err(|error| error.to_string()));
        order.map_err(|reason| TransportError::RunDir { path, reason })
    }
}
