//! Recording on demand: the order goes into the run directory, and the recorder runs while it is wanted.

use std::path::PathBuf;

use control::Refusal;
use messages::ServiceId;
use transport::{Io, RecordingOrder, TransportError};

use crate::Supervisor;
use crate::journal;
use crate::machine::{Event, Phase};

impl Supervisor {
    /// Wants the run recorded in `path` from now on.
    ///
    /// # Errors
    /// Where the order cannot be left in the run directory.
    pub(crate) fn want_recording(&mut self, path: PathBuf, io: &Io) -> Result<(), TransportError> {
        let lives_before = self.recorder(io).map_or(0, |(_, incarnation)| incarnation);
        io.domain.dir.write_recording_order(&RecordingOrder { path: path.clone(), lives_before })?;
        self.machine.handle(Event::Demand(ServiceId::Recorder), Self::now(io));
        journal::recording(io.now_ns(), &path);
        Ok(())
    }

    /// The operator wants the run recorded in `path`.
    ///
    /// # Errors
    /// Where it is recorded already, or the order cannot be given.
    pub(crate) fn record(&mut self, path: PathBuf, io: &Io) -> Result<(), Refusal> {
        if self.recorder(io).is_some_and(|(phase, _)| phase == Phase::Spent) {
            // The recording before came to nothing, and is over.
            self.machine.handle(Event::Release(ServiceId::Recorder), Self::now(io));
        }
        if self.recorder(io).is_none_or(|(phase, _)| phase != Phase::Off) {
            return Err(Refusal::RecordedAlready);
        }
        if !path.is_absolute() {
            return Err(Refusal::RelativePath);
        }
        self.want_recording(path, io).map_err(|error| Refusal::NoOrder(error.to_string()))
    }

    /// The operator wants the recording ended.
    ///
    /// # Errors
    /// Where there is none.
    pub(crate) fn end_recording(&mut self, io: &Io) -> Result<(), Refusal> {
        if self.recorder(io).is_none_or(|(phase, _)| phase == Phase::Off) {
            return Err(Refusal::NotRecorded);
        }
        self.machine.handle(Event::Release(ServiceId::Recorder), Self::now(io));
        Ok(())
    }

    fn recorder(&self, io: &Io) -> Option<(Phase, u32)> {
        let services = self.machine.status(io.now_ns());
        let recorder = services.iter().find(|service| service.service == ServiceId::Recorder)?;
        Some((recorder.phase, recorder.incarnation))
    }
}
