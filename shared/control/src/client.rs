//! A client's end of the socket.

use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::framing::{self, MAX_ANSWER};
use crate::{Done, Query, Refusal, Request};

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
    /// The supervisor does not answer, or not to the end.
    #[error(transparent)]
    Unanswered(#[from] io::Error),
    /// The supervisor answers, and this program cannot read it: it is of another version.
    #[error("the supervisor answers `{request}` in a form that this program does not know: {source}")]
    Unreadable {
        /// What was asked: the verb.
        request: String,
        /// What is wrong with the answer.
        source: serde_json::Error,
    },
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
        let asked = framing::line(request).map_err(io::Error::from)?;
        self.stream.get_mut().write_all(asked.as_bytes())?;
        let mut line = Vec::new();
        io::Read::take(&mut self.stream, MAX_ANSWER).read_until(b'\n', &mut line)?;
        if line.last() != Some(&b'\n') {
            let closed = io::Error::new(io::ErrorKind::UnexpectedEof, "the supervisor closed the connection");
            return Err(closed.into());
        }
        let answer: Value = serde_json::from_slice(&line).map_err(unreadable(request))?;
        if answer.get("error").is_some_and(Value::is_string) {
            return Err(serde_json::from_value::<Refusal>(answer).map_err(unreadable(request))?.into());
        }
        Ok(answer)
    }

    /// Reads something of the run.
    ///
    /// # Errors
    /// As [`Client::ask`], and where the answer is another.
    pub fn read<T: Query>(&mut self) -> Result<T, AskError> {
        self.ask_for(&T::REQUEST)
    }

    /// Has something done.
    ///
    /// # Errors
    /// As [`Client::read`].
    pub fn tell(&mut self, request: &Request) -> Result<Done, AskError> {
        self.ask_for(request)
    }

    fn ask_for<T: DeserializeOwned>(&mut self, request: &Request) -> Result<T, AskError> {
        serde_json::from_value(self.ask(request)?).map_err(unreadable(request))
    }
}

/// For `map_err`: the answer to the request cannot be read.
fn unreadable(request: &Request) -> impl FnOnce(serde_json::Error) -> AskError {
    |source| AskError::Unreadable { request: request.verb(), source }
}

#[cfg(test)]
mod tests {
    use super::{AskError, Client};
    use crate::{Done, Request, Status};
    use std::io::{BufReader, Write};
    use std::net::Shutdown;
    use std::os::unix::net::UnixStream;

    /// A client of a supervisor that says this, and nothing more.
    fn client(says: &str) -> (Client, UnixStream) {
        let (ours, mut supervisor) = UnixStream::pair().expect("sockets");
        supervisor.write_all(says.as_bytes()).expect("written");
        supervisor.shutdown(Shutdown::Write).expect("connected");
        (Client { stream: BufReader::new(ours) }, supervisor)
    }

    #[test]
    fn an_answer_that_cannot_be_read_says_what_was_asked_and_what_is_wrong() {
        let wrong = client("{\"run\":\"walk\"}\n").0.read::<Status>().expect_err("not a status").to_string();
        assert_eq!(
            wrong,
            "the supervisor answers `status` in a form that this program does not know: missing field `supervisor_pid`"
        );
        let asked: Result<Done, _> = client("yes\n").0.tell(&Request::RecordStop {});
        assert!(matches!(asked, Err(AskError::Unreadable { request, .. }) if request == "record_stop"));
    }

    #[test]
    fn half_an_answer_does_not_count() {
        for says in ["", "{\"ok\":true"] {
            let (mut client, _supervisor) = client(says);
            assert!(matches!(client.tell(&Request::Stop), Err(AskError::Unanswered(_))), "{says}");
        }
    }
}
