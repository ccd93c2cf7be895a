//! A client's end of the socket.

use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::framing::{self, MAX_ANSWER};
use crate::{Done, Reading, Refusal, Request};

/// The supervisor answers at its next wake-up; one that takes longer than this is stopped or dead.
pub const ANSWER_WITHIN: Duration = Duration::from_secs(3);

/// A connection to a supervisor.
#[derive(Debug)]
pub struct Client {
    stream: BufReader<UnixStream>,
}

/// Why there is no answer to a request.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// The supervisor refuses.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The supervisor does not answer, or not with JSON.
    #[error(transparent)]
    Unanswered(#[from] io::Error),
}

impl From<serde_json::Error> for AskError {
    fn from(error: serde_json::Error) -> Self {
        Self::Unanswered(error.into())
    }
}

impl Client {
    /// Connects to the socket at `path`.
    ///
    /// # Errors
    /// Where nobody listens there.
    pub fn connect(path: &Path) -> io::Result<Self> {
        let stream = UnixStream::connect(path)?;
        stream.set_read_timeout(Some(ANSWER_WITHIN))?;
        stream.set_write_timeout(Some(ANSWER_WITHIN))?;
        Ok(Self { stream: BufReader::new(stream) })
    }

    /// Asks, and waits for the answer, as it comes.
    ///
    /// # Errors
    /// Where the supervisor refuses, does not answer, or not with JSON.
    pub fn ask(&mut self, request: &Request) -> Result<Value, AskError> {
        self.stream.get_mut().write_all(framing::line(request)?.as_bytes())?;
        let mut line = Vec::new();
        io::Read::take(&mut self.stream, MAX_ANSWER).read_until(b'\n', &mut line)?;
        if line.is_empty() {
            let closed = io::Error::new(io::ErrorKind::UnexpectedEof, "the supervisor closed the connection");
            return Err(closed.into());
        }
        let answer: Value = serde_json::from_slice(&line)?;
        if answer.get("error").is_some_and(Value::is_string) {
            return Err(serde_json::from_value::<Refusal>(answer)?.into());
        }
        Ok(answer)
    }

    /// Reads something of the run.
    ///
    /// # Errors
    /// As [`Client::ask`], and where the answer is another.
    pub fn read<T: Reading>(&mut self) -> Result<T, AskError> {
        Ok(serde_json::from_value(self.ask(&T::REQUEST)?)?)
    }

    /// Has something done.
    ///
    /// # Errors
    /// As [`Client::read`].
    pub fn tell(&mut self, request: &Request) -> Result<Done, AskError> {
        Ok(serde_json::from_value(self.ask(request)?)?)
    }
}
