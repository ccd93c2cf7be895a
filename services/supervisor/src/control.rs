//! The operator's socket: JSON lines, one answer for each request. It needs no shared memory.

use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

use messages::CueKind;
use serde::Deserialize;
use serde_json::{Value, json};
use transport::{Io, TransportError};

/// Longest request, bytes.
const MAX_REQUEST: usize = 4096;
/// Operators at once. One more takes the place of the one that has said nothing for longest, so that nobody's idle
/// connections keep a stop out.
const MAX_CLIENTS: usize = 16;

/// What an operator asks.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "verb", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Mode, services, the walk so far.
    Status,
    /// The last stops, with evidence.
    Why,
    /// A cue for the handler.
    Cue {
        /// Which.
        cue: CueKind,
    },
    /// The robot is to stand, and stay.
    Stop,
    /// Out of a lock.
    Resume,
    /// A fault is injected, or mended, in a run that allows it.
    Inject {
        /// A stream, a service, or the host, by name.
        target: String,
        /// Which fault, by name; "none" mends the target.
        fault: String,
        /// How long it lasts, milliseconds of run time; without it, until it is mended.
        #[serde(default)]
        for_ms: Option<u64>,
        /// Seed of what is random about it.
        #[serde(default)]
        seed: Option<u64>,
    },
    /// The run is to end.
    Quit,
}

#[derive(Debug)]
struct Client {
    token: u64,
    stream: UnixStream,
    buffer: Vec<u8>,
    /// Counts connections and whole requests: the least of all is the longest idle.
    heard: u64,
}

/// The listening socket and its clients.
#[derive(Debug)]
pub struct ControlServer {
    listener: UnixListener,
    clients: Vec<Client>,
    next_token: u64,
    heard: u64,
}

impl ControlServer {
    /// Token of the listening socket; those of the clients are greater.
    pub const TOKEN: u64 = 1 << 20;

    /// Listens at `path`, for this user and group.
    ///
    /// # Errors
    /// Where the socket cannot be made.
    pub fn open(path: &Path, io: &Io) -> Result<Self, TransportError> {
        let listener = UnixListener::bind(path).map_err(TransportError::service)?;
        listener.set_nonblocking(true).map_err(TransportError::service)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660)).map_err(TransportError::service)?;
        io.watch(&listener, Self::TOKEN)?;
        Ok(Self { listener, clients: Vec::new(), next_token: Self::TOKEN, heard: 0 })
    }

    /// Takes what has come on `token`: the requests, each with the client to answer.
    pub fn requests(&mut self, token: u64, io: &Io) -> Vec<(u64, Request)> {
        if token == Self::TOKEN {
            self.accept(io);
            return Vec::new();
        }
        let Some(i) = self.clients.iter().position(|client| client.token == token) else { return Vec::new() };
        let (lines, gone) = self.clients[i].read_lines();
        if !lines.is_empty() {
            self.heard += 1;
            self.clients[i].heard = self.heard;
        }
        let mut requests = Vec::new();
        for line in lines {
            match serde_json::from_slice(&line) {
                Ok(request) => requests.push((token, request)),
                Err(error) => self.answer(token, &json!({ "error": format!("bad request: {error}") }), io),
            }
        }
        if gone {
            self.drop_client(token, io);
        }
        requests
    }

    fn drop_client(&mut self, token: u64, io: &Io) {
        if let Some(i) = self.clients.iter().position(|client| client.token == token) {
            let client = self.clients.swap_remove(i);
            io.unwatch(&client.stream);
        }
    }

    fn make_room(&mut self, io: &Io) {
        if self.clients.len() >= MAX_CLIENTS
            && let Some(idle) = self.clients.iter().min_by_key(|client| client.heard).map(|client| client.token)
        {
            self.answer(idle, &json!({ "error": "idle for too long: another operator came" }), io);
            self.drop_client(idle, io);
        }
    }

    fn accept(&mut self, io: &Io) {
        while let Ok((stream, _)) = self.listener.accept() {
            let ours = rustix::net::sockopt::socket_peercred(&stream)
                .is_ok_and(|peer| peer.uid.is_root() || peer.uid == rustix::process::getuid());
            // A stranger is let go without a word.
            if !ours || stream.set_nonblocking(true).is_err() {
                continue;
            }
            self.make_room(io);
            (self.next_token, self.heard) = (self.next_token + 1, self.heard + 1);
            if io.watch(&stream, self.next_token).is_ok() {
                self.clients.push(Client { token: self.next_token, stream, buffer: Vec::new(), heard: self.heard });
            }
        }
    }

    /// Answers a client. One that does not read is let go, lest it take half an answer for a whole one: the supervisor
    /// waits for nobody.
    pub fn answer(&mut self, token: u64, answer: &Value, io: &Io) {
        let Some(client) = self.clients.iter_mut().find(|client| client.token == token) else { return };
        let mut line = answer.to_string();
        line.push('\n');
        if client.stream.write_all(line.as_bytes()).is_err() {
            self.drop_client(token, io);
        }
    }
}

impl Client {
    /// Whole lines that have come, and whether the client is gone.
    fn read_lines(&mut self) -> (Vec<Vec<u8>>, bool) {
        let mut bytes = [0u8; MAX_REQUEST];
        let gone = match self.stream.read(&mut bytes) {
            Ok(0) => true,
            Ok(n) => {
                self.buffer.extend_from_slice(&bytes[..n]);
                false
            }
            Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
        };
        let mut lines = Vec::new();
        while let Some(end) = self.buffer.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.buffer.drain(..=end).collect();
            lines.push(line[..end].to_vec());
        }
        (lines, gone || self.buffer.len() > MAX_REQUEST)
    }
}

#[cfg(test)]
mod tests {
    use super::Request;
    use messages::CueKind;

    #[test]
    fn a_request_is_exactly_what_it_may_be() {
        assert_eq!(
            serde_json::from_str::<Request>(r#"{"verb":"cue","cue":"left"}"#).ok(),
            Some(Request::Cue { cue: CueKind::Left })
        );
        for bad in [r#"{"verb":"fly"}"#, r#"{"verb":"cue","cue":"up"}"#, "", "[]", r#"{"verb":"cue"}"#] {
            assert!(serde_json::from_str::<Request>(bad).is_err(), "{bad}");
        }
    }
}
