//! The operator's socket, at the supervisor's end of the protocol (`control`). It needs no shared memory.
//!
//! Who may connect is the kernel's business: the socket is the user's and the group's. Who may change anything is
//! decided here, by the peer's credentials: the run's own user and root; the group may only read, unless the settings
//! say otherwise.

use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use control::framing::{self, Abuse, Inbox, MAX_REQUEST};
use control::{Refusal, Request, Right};
use serde::Serialize;
use transport::{Io, TransportError};

/// Clients at once that may change the run. One more takes the place of the one that has said nothing for longest, so
/// that nobody's idle connections keep a stop out.
const MAX_OPERATORS: usize = 16;
/// Clients at once that may only read; they have places of their own, so that they never take an operator's.
const MAX_READERS: usize = 8;
/// Connections taken at one wake-up: a flood of them must not keep the supervisor from its beats.
const MAX_ACCEPTED: usize = 32;

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
                Ok(_) => self.answer(token, &Refusal::NotPermitted, io),
                Err(refusal) => self.answer(token, &refusal, io),
            }
        }
        match end {
            None => {}
            Some(End::Gone) => self.drop_client(token, io),
            Some(End::Abuse(abuse)) => {
                self.answer(token, &Refusal::Abuse(abuse), io);
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
        let refusal = if requests.is_empty() { Refusal::CrowdedOut } else { Refusal::AnswerLost };
        // Its answer could reach nobody.
        requests.retain(|(_, request)| request.needs() != Right::Read);
        self.answer(idle, &refusal, io);
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
    pub fn answer(&mut self, token: u64, answer: &impl Serialize, io: &Io) {
        let Some(client) = self.clients.iter_mut().find(|client| client.token == token) else { return };
        let told = framing::line(answer).is_ok_and(|line| client.stream.write_all(line.as_bytes()).is_ok());
        if !told {
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
