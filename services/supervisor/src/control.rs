//! The operator's socket: JSON lines, one answer for each request. It needs no shared memory.
//!
//! Who may connect is the kernel's business: the socket is the user's and the group's. Who may change anything is
//! decided here, by the peer's credentials: the run's own user and root; the group may only read, unless the settings
//! say otherwise.

mod inbox;

use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use messages::CueKind;
use serde::Deserialize;
use serde_json::{Value, json};
use settings::PolicyModel;
use transport::{Io, TransportError};

pub use inbox::{Abuse, Inbox, MAX_REQUEST, MAX_WAITING};

/// Clients at once that may change the run. One more takes the place of the one that has said nothing for longest, so
/// that nobody's idle connections keep a stop out.
const MAX_OPERATORS: usize = 16;
/// Clients at once that may only read; they have places of their own, so that they never take an operator's.
const MAX_READERS: usize = 8;
/// Connections taken at one wake-up: a flood of them must not keep the supervisor from its beats.
const MAX_ACCEPTED: usize = 32;
/// What the answer to a request that the client has no right to says in its member `refused`.
pub const NOT_PERMITTED: &str = "not_permitted";
/// A client that had to make room for another one, and had asked nothing; or had, and what it asked is done, unless it
/// was to be told something.
const CROWDED_OUT: &str = "crowded_out";
const ANSWER_LOST: &str = "answer_lost";

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
    /// The run is to be recorded from now on.
    Record {
        /// The recording, absolute.
        path: PathBuf,
    },
    /// The recording is to end.
    RecordStop,
    /// Another policy is to be swapped in.
    PolicySwap {
        /// Another executable in place of `guidedog-policy`, its path absolute.
        exe: Option<PathBuf>,
        /// The model to load, a file's path absolute.
        model: Option<PolicyModel>,
    },
    /// Back to the policy before.
    PolicyRollback,
    /// The policy in force, and the last swaps.
    PolicyShow,
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

/// What a client may do, and what a request needs. In this order: who may change may read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Right {
    /// Ask how things are.
    Read,
    /// Have the robot walk or stand, and end the run.
    Change,
    /// Have a program run as the run's own user.
    Own,
}

impl Request {
    /// The request that a line is.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub fn parse(line: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(line).map_err(|error| format!("bad request: {error}"))
    }

    /// The right that it needs.
    #[must_use]
    pub const fn needs(&self) -> Right {
        match self {
            Self::Status | Self::Why | Self::PolicyShow => Right::Read,
            Self::Cue { .. } | Self::Stop | Self::Resume | Self::Quit => Right::Change,
            // They start programs, or write files, with the rights of the run.
            Self::PolicySwap { .. }
            | Self::PolicyRollback
            | Self::Record { .. }
            | Self::RecordStop
            | Self::Inject { .. } => Right::Own,
        }
    }
}

#[derive(Debug)]
struct Client {
    token: u64,
    stream: UnixStream,
    inbox: Inbox,
    right: Right,
    /// Counts connections and whole requests: the least of all is the longest idle.
    heard: u64,
}

/// The listening socket and its clients.
#[derive(Debug)]
pub struct ControlServer {
    listener: UnixListener,
    path: PathBuf,
    /// What a member of the socket's group may do.
    group: Right,
    clients: Vec<Client>,
    next_token: u64,
    heard: u64,
}

impl ControlServer {
    /// Token of the listening socket; those of the clients are greater.
    pub const TOKEN: u64 = 1 << 20;

    /// Listens at `path`, for this user and its group, whose members have the right `group`.
    ///
    /// # Errors
    /// Where the socket cannot be made.
    pub fn open(path: &Path, group: Right, io: &Io) -> Result<Self, TransportError> {
        let listener = UnixListener::bind(path).map_err(TransportError::service)?;
        listener.set_nonblocking(true).map_err(TransportError::service)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660)).map_err(TransportError::service)?;
        io.watch(&listener, Self::TOKEN)?;
        Ok(Self { listener, path: path.to_owned(), group, clients: Vec::new(), next_token: Self::TOKEN, heard: 0 })
    }

    /// Takes what has come on `token`: the requests, each with the client to answer.
    pub fn requests(&mut self, token: u64, io: &Io) -> Vec<(u64, Request)> {
        if token == Self::TOKEN { self.accept(io) } else { self.read(token, io) }
    }

    /// What a client has sent; one that is gone or out of order is let go.
    fn read(&mut self, token: u64, io: &Io) -> Vec<(u64, Request)> {
        let Some(client) = self.clients.iter_mut().find(|client| client.token == token) else { return Vec::new() };
        let (lines, end) = client.read();
        if !lines.is_empty() {
            self.heard += 1;
            client.heard = self.heard;
        }
        let right = client.right;
        let mut requests = Vec::new();
        for line in lines {
            match Request::parse(&line) {
                Ok(request) if request.needs() <= right => requests.push((token, request)),
                Ok(_) => {
                    let why = "you may read how the run is, and not do that; its own user and root may";
                    self.answer(token, &json!({ "error": why, "refused": NOT_PERMITTED }), io);
                }
                Err(why) => self.answer(token, &json!({ "error": why }), io),
            }
        }
        match end {
            None => {}
            Some(End::Gone) => self.drop_client(token, io),
            Some(End::Abuse(abuse)) => {
                self.answer(token, &json!({ "error": abuse.to_string() }), io);
                self.drop_client(token, io);
            }
        }
        requests
    }

    fn drop_client(&mut self, token: u64, io: &Io) {
        if let Some(i) = self.clients.iter().position(|client| client.token == token) {
            let client = self.clients.swap_remove(i);
            io.unwatch(&client.stream);
        }
    }

    /// Makes room for one more with that right. What the one that has to go has sent is heard before.
    fn make_room(&mut self, right: Right, io: &Io) -> Vec<(u64, Request)> {
        let limit = if right == Right::Read { MAX_READERS } else { MAX_OPERATORS };
        let alike = self.clients.iter().filter(|client| client.right == right);
        if alike.clone().count() < limit {
            return Vec::new();
        }
        let Some(idle) = alike.min_by_key(|client| client.heard).map(|client| client.token) else { return Vec::new() };
        let mut requests = self.read(idle, io);
        let refused = if requests.is_empty() { CROWDED_OUT } else { ANSWER_LOST };
        // Its answer could reach nobody.
        requests.retain(|(_, request)| request.needs() != Right::Read);
        self.answer(idle, &json!({ "error": "idle for too long: another client came", "refused": refused }), io);
        self.drop_client(idle, io);
        requests
    }

    fn accept(&mut self, io: &Io) -> Vec<(u64, Request)> {
        let mut requests = Vec::new();
        for _ in 0..MAX_ACCEPTED {
            let Ok((stream, _)) = self.listener.accept() else { break };
            // A stranger is let go without a word.
            let Some(right) = self.right_of(&stream) else { continue };
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            requests.extend(self.make_room(right, io));
            (self.next_token, self.heard) = (self.next_token + 1, self.heard + 1);
            let token = self.next_token;
            if io.watch(&stream, token).is_ok() {
                self.clients.push(Client { token, stream, inbox: Inbox::default(), right, heard: self.heard });
                // Most have asked already: nobody's flood of connections comes between.
                requests.extend(self.read(token, io));
            }
        }
        requests
    }

    /// What the other end may do, if anything. That a peer which is neither root nor our user could connect says that
    /// it is in the socket's group, as long as the socket is closed to everybody else.
    fn right_of(&self, stream: &UnixStream) -> Option<Right> {
        let peer = rustix::net::sockopt::socket_peercred(stream).ok()?;
        if peer.uid.is_root() || peer.uid == rustix::process::geteuid() {
            return Some(Right::Own);
        }
        let closed = std::fs::symlink_metadata(&self.path).is_ok_and(|socket| socket.mode() & 0o007 == 0);
        closed.then_some(self.group)
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

/// Why a client is heard no longer.
enum End {
    Gone,
    Abuse(Abuse),
}

impl Client {
    /// Whole lines that have come, and whether they were the last ones.
    fn read(&mut self) -> (Vec<Vec<u8>>, Option<End>) {
        let mut bytes = [0u8; MAX_REQUEST];
        match self.stream.read(&mut bytes) {
            Ok(0) => (Vec::new(), Some(End::Gone)),
            Ok(n) => {
                let (lines, abuse) = self.inbox.take(&bytes[..n]);
                (lines, abuse.map(End::Abuse))
            }
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => (Vec::new(), None),
            Err(_) => (Vec::new(), Some(End::Gone)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Request, Right};
    use messages::CueKind;

    #[test]
    fn a_request_is_exactly_what_it_may_be() {
        assert_eq!(Request::parse(br#"{"verb":"cue","cue":"left"}"#).ok(), Some(Request::Cue { cue: CueKind::Left }));
        for bad in [r#"{"verb":"fly"}"#, r#"{"verb":"cue","cue":"up"}"#, "", "[]", r#"{"verb":"cue"}"#] {
            assert!(Request::parse(bad.as_bytes()).is_err(), "{bad}");
        }
    }

    #[test]
    fn reading_is_not_changing() {
        assert!(Right::Read < Right::Change);
        for (request, needs) in [("status", Right::Read), ("why", Right::Read), ("stop", Right::Change)] {
            let request = Request::parse(format!("{{\"verb\":\"{request}\"}}").as_bytes()).expect("a request");
            assert_eq!(request.needs(), needs);
        }
    }
}
