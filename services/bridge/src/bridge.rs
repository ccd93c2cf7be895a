//! Locomotion's voice.

use dds::PERIOD_NS;
use links::{FromBridge, ToBridge, WORD_MAX};
use messages::Twist2;
use transport::{Io, Line, LineListener, Received, Service, TransportError, monotonic_ns};

use crate::voice::Voice;
use crate::{LOOK_NS, LOST_LIMIT_NS};

const TOKEN_LISTENER: u64 = 0;
/// So many lines at once: locomotion's, the backstop's, and those of their lives before.
const PEERS_MAX: usize = 8;
/// A stop that the robot does not answer for so long is the backstop's to say as well, nanoseconds.
const UNANSWERED_NS: u64 = 100_000_000;

/// Who is at the other end of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Who {
    /// It has not said so yet.
    Unknown,
    Locomotion(u32),
    Backstop,
}

struct Peer {
    line: Line,
    token: u64,
    who: Who,
}

/// The service.
pub struct Bridge {
    voice: Voice,
    listener: LineListener,
    peers: Vec<Peer>,
    tokens: u64,
    /// The newest life of locomotion that was here; the words of one before are worth nothing.
    life: u32,
    forgotten: u32,
    reported_ns: u64,
    next_ns: u64,
    /// Set when it leaves: nothing but stop is said from then on.
    leaves: bool,
    ends_by_ns: Option<u64>,
}

impl Bridge {
    /// Takes part in the robot's network, and listens for locomotion and the backstop.
    ///
    /// # Errors
    /// Where it cannot, or the settings of the run are not readable.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let voice = Voice::open(&settings.locomotion, monotonic_ns())?;
        let listener = LineListener::open(&io.domain.dir.bridge_socket())?;
        io.watch(&listener, TOKEN_LISTENER)?;
        Ok(Self {
            voice,
            listener,
            peers: Vec::new(),
            tokens: TOKEN_LISTENER,
            life: 0,
            forgotten: 0,
            reported_ns: 0,
            next_ns: 0,
            leaves: false,
            ends_by_ns: None,
        })
    }

    fn admit(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(line) = self.listener.accept() {
            if self.peers.len() == PEERS_MAX {
                let oldest = self.peers.remove(0);
                io.unwatch(&oldest.line);
            }
            self.tokens += 1;
            io.watch(&line, self.tokens)?;
            self.peers.push(Peer { line, token: self.tokens, who: Who::Unknown });
        }
        Ok(())
    }

    /// Everything that waits on a line; who is gone is forgotten, and wishes for nothing any more.
    fn listen(&mut self, io: &Io, token: u64) {
        let mut bytes = [0; WORD_MAX];
        loop {
            let Some(at) = self.peers.iter().position(|peer| peer.token == token) else { return };
            match self.peers[at].line.receive_bytes(&mut bytes) {
                Received::Nothing => return,
                Received::Message(len, _) => {
                    if let Some(word) = ToBridge::of(&bytes[..len]) {
                        self.take(at, word);
                    }
                }
                Received::Closed => {
                    let gone = self.peers.remove(at);
                    io.unwatch(&gone.line);
                }
            }
            if !self.may_move() {
                self.voice.driver.wish(Twist2::ZERO, 0);
            }
            self.voice.speak();
        }
    }

    fn take(&mut self, at: usize, word: ToBridge) {
        match (self.peers[at].who, word) {
            (Who::Unknown, ToBridge::Locomotion(life)) if life >= self.life => {
                self.peers[at].who = Who::Locomotion(life);
                (self.life, self.forgotten) = (life, 0);
            }
            (Who::Unknown, ToBridge::Backstop) => self.peers[at].who = Who::Backstop,
            (Who::Locomotion(life), ToBridge::Wish(velocity, until_ns)) if life == self.life => {
                self.voice.driver.wish(velocity, until_ns);
            }
            (Who::Locomotion(life), ToBridge::ForgetRemoteStop(count)) if life == self.life => {
                self.voice.driver.forget_remote_stop();
                self.forgotten = count;
            }
            _ => {}
        }
    }

    /// Whether both are there who see to it that the robot stops.
    fn may_move(&self) -> bool {
        let here = |who| self.peers.iter().any(|peer| peer.who == who);
        let hears = self.voice.hears_remote(monotonic_ns());
        !self.leaves && hears && here(Who::Locomotion(self.life)) && here(Who::Backstop)
    }

    /// Where the robot does not answer a stop, the line to the backstop is closed: it then says stop by itself.
    fn call_for_help(&mut self, io: &Io, now_ns: u64) {
        if self.voice.driver.unanswered_ns(now_ns) > UNANSWERED_NS {
            for peer in self.peers.extract_if(.., |peer| peer.who == Who::Backstop) {
                io.unwatch(&peer.line);
            }
        }
        if !self.may_move() {
            self.voice.driver.wish(Twist2::ZERO, 0);
        }
    }

    fn report(&mut self, now_ns: u64) {
        if now_ns.saturating_sub(self.reported_ns) < PERIOD_NS / 2 {
            return;
        }
        self.reported_ns = now_ns;
        let word = FromBridge {
            state: self.voice.newest.map(|(state, came_ns)| (state.velocity, state.own_from_robot, came_ns)),
            charge_percent: self.voice.charge_percent(now_ns),
            remote_stop: self.voice.driver.remote_stop(),
            forgotten: self.forgotten,
        };
        for peer in self.peers.iter().filter(|peer| peer.who == Who::Locomotion(self.life)) {
            // Who does not listen hears the next one.
            let _ = word.send(&peer.line);
        }
    }
}

impl Service for Bridge {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if io.now_ns() >= self.next_ns {
            self.next_ns = io.now_ns() + LOOK_NS;
            self.call_for_help(io, monotonic_ns());
            self.voice.go_on(io);
            self.report(monotonic_ns());
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        if token == TOKEN_LISTENER {
            return self.admit(io);
        }
        self.listen(io, token);
        Ok(())
    }

    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        // Locomotion stops the robot by itself; it may still have to be heard.
        self.ends_by_ns = Some(monotonic_ns() + LOST_LIMIT_NS);
        false
    }

    fn wants_wall_ticks(&self) -> bool {
        self.ends_by_ns.is_some()
    }

    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        self.leaves = true;
        self.voice.driver.wish(Twist2::ZERO, 0);
        self.voice.speak();
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.ends_by_ns.is_some_and(|by| monotonic_ns() >= by)
    }
}
