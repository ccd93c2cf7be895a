//! Who is on the lines to this process.

use links::{FromBridge, ToBridge, WORD_MAX};
use transport::{Io, Line, LineListener, Received, TransportError};

/// The listener's token. Every line has a token of its own, counted from here on.
pub const TOKEN_LISTENER: u64 = 0;
/// So many lines at once: theirs, and those of their lives before.
const PEERS_MAX: usize = 8;

/// Who is at the other end of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Who {
    /// It has not said so yet.
    Unknown,
    /// Locomotion, and which life of it.
    Locomotion(u32),
    /// The brake.
    Brake,
    /// The backstop.
    Backstop,
}

impl Who {
    /// As it introduces itself.
    fn of(word: ToBridge) -> Option<Self> {
        match word {
            ToBridge::Locomotion(life) => Some(Self::Locomotion(life)),
            ToBridge::Brake => Some(Self::Brake),
            ToBridge::Backstop => Some(Self::Backstop),
            _ => None,
        }
    }
}

/// What came on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Heard {
    /// A word, of whom.
    Word(Who, ToBridge),
    /// Its end.
    Gone,
}

struct Peer {
    line: Line,
    token: u64,
    who: Who,
}

/// A listener and the lines that came by it.
pub struct Peers {
    listener: LineListener,
    peers: Vec<Peer>,
    tokens: u64,
}

impl Peers {
    /// Listens.
    ///
    /// # Errors
    /// Where the wait loop cannot watch it.
    pub fn of(listener: LineListener, io: &Io) -> Result<Self, TransportError> {
        io.watch(&listener, TOKEN_LISTENER)?;
        Ok(Self { listener, peers: Vec::with_capacity(PEERS_MAX), tokens: TOKEN_LISTENER })
    }

    /// Everybody who waits at the listener. Where they are too many, who has not said who it is goes first.
    ///
    /// # Errors
    /// Where the wait loop cannot watch a line.
    pub fn admit(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(line) = self.listener.accept() {
            if self.peers.len() == PEERS_MAX {
                let stranger = self.peers.iter().position(|peer| peer.who == Who::Unknown);
                io.unwatch(&self.peers.remove(stranger.unwrap_or(0)).line);
            }
            self.tokens += 1;
            io.watch(&line, self.tokens)?;
            self.peers.push(Peer { line, token: self.tokens, who: Who::Unknown });
        }
        Ok(())
    }

    /// The next that waits on a line. The first word says who is there, and the newest of each is the one that counts.
    pub fn hear(&mut self, io: &Io, token: u64) -> Option<Heard> {
        let mut bytes = [0; WORD_MAX];
        loop {
            let at = self.peers.iter().position(|peer| peer.token == token)?;
            match self.peers[at].line.receive_bytes(&mut bytes) {
                Received::Nothing => return None,
                Received::Message(len, _) => {
                    let Some(word) = ToBridge::of(&bytes[..len]) else { continue };
                    if let (Who::Unknown, Some(who)) = (self.peers[at].who, Who::of(word)) {
                        self.peers[at].who = who;
                        self.dismiss(io, |peer| peer.who == who && peer.token != token);
                        return Some(Heard::Word(who, word));
                    }
                    return Some(Heard::Word(self.peers[at].who, word));
                }
                Received::Closed => {
                    self.dismiss(io, |peer| peer.token == token);
                    return Some(Heard::Gone);
                }
            }
        }
    }

    fn dismiss(&mut self, io: &Io, whom: impl Fn(&Peer) -> bool) {
        for peer in self.peers.extract_if(.., |peer| whom(peer)) {
            io.unwatch(&peer.line);
        }
    }

    /// Closes the line to somebody.
    pub fn send_away(&mut self, io: &Io, who: Who) {
        self.dismiss(io, |peer| peer.who == who);
    }

    /// Whether somebody is there.
    pub fn has(&self, who: Who) -> bool {
        self.peers.iter().any(|peer| peer.who == who)
    }

    /// Tells somebody. Who does not listen hears the next one.
    pub fn tell(&self, who: Who, word: &FromBridge) {
        for peer in self.peers.iter().filter(|peer| peer.who == who) {
            let _ = word.send(&peer.line);
        }
    }
}
