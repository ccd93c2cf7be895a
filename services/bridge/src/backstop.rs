//! The brake's voice, and the one that speaks where the bridge is gone.

use links::{ToBridge, WORD_MAX};
use transport::{Io, Line, LineListener, Received, Service, TransportError, monotonic_ns};

use crate::peers::{Heard, Peers, TOKEN_LISTENER, Who};
use crate::voice::Voice;
use crate::{LOOK_NS, LOST_LIMIT_NS};

/// The line to the bridge; those of whoever comes by the listener are counted from one.
const TOKEN_BRIDGE: u64 = 1 << 32;
/// After the brake's last word a stop is said for so long, nanoseconds: it says it every 20 ms while it means it.
const MEANT_NS: u64 = 100_000_000;

/// The service.
pub struct Backstop {
    voice: Voice,
    peers: Peers,
    bridge: Option<Line>,
    /// When the brake last asked for a stop, nanoseconds.
    asked_ns: Option<u64>,
    next_ns: u64,
    /// It leaves by plan: whose ends come then is no news.
    leaves: bool,
    ends_by_ns: Option<u64>,
}

impl Backstop {
    /// Takes part in the robot's network, and listens for the brake.
    ///
    /// # Errors
    /// Where it cannot, or the settings of the run are not readable.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let voice = Voice::open(&settings.locomotion, monotonic_ns())?;
        let peers = Peers::of(LineListener::open(&io.domain.dir.backstop_socket())?, io)?;
        Ok(Self { voice, peers, bridge: None, asked_ns: None, next_ns: 0, leaves: false, ends_by_ns: None })
    }

    /// Says stop for as long as somebody who can stop the robot is gone, or asks for it.
    fn judge(&mut self) {
        let asked = self.asked_ns.is_some_and(|asked_ns| monotonic_ns().saturating_sub(asked_ns) <= MEANT_NS);
        let gone = !self.leaves && (self.bridge.is_none() || !self.peers.has(Who::Brake));
        self.voice.driver.insist(asked || gone);
        self.voice.speak();
    }

    /// Seeks the bridge, where there is none. Who does not hear the robot could not stop it, and is no backstop.
    fn seek(&mut self, io: &Io) -> Result<(), TransportError> {
        if !self.voice.answers {
            if let Some(line) = self.bridge.take() {
                io.unwatch(&line);
            }
        } else if self.bridge.is_none() && !self.leaves {
            self.bridge = Line::connect(&io.domain.dir.bridge_socket()).filter(|line| ToBridge::Backstop.send(line));
            if let Some(line) = &self.bridge {
                io.watch(line, TOKEN_BRIDGE)?;
            }
        }
        Ok(())
    }

    fn listen(&mut self, io: &Io, token: u64) {
        while let Some(heard) = self.peers.hear(io, token) {
            if heard == Heard::Word(Who::Brake, ToBridge::Zero) {
                self.asked_ns = Some(monotonic_ns());
            }
        }
    }

    fn hear_bridge(&mut self, io: &Io) {
        let mut bytes = [0; WORD_MAX];
        let Some(line) = &self.bridge else { return };
        while let received @ (Received::Message(..) | Received::Closed) = line.receive_bytes(&mut bytes) {
            if matches!(received, Received::Closed) {
                io.unwatch(line);
                self.bridge = None;
                return;
            }
        }
    }
}

impl Service for Backstop {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if io.now_ns() >= self.next_ns {
            self.next_ns = io.now_ns() + LOOK_NS;
            self.voice.hear();
            self.seek(io)?;
            self.judge();
            self.voice.tell(io);
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        match token {
            TOKEN_LISTENER => self.peers.admit(io)?,
            TOKEN_BRIDGE => self.hear_bridge(io),
            token => self.listen(io, token),
        }
        self.judge();
        Ok(())
    }

    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        self.ends_by_ns = Some(monotonic_ns() + LOST_LIMIT_NS);
        false
    }

    fn wants_wall_ticks(&self) -> bool {
        self.ends_by_ns.is_some()
    }

    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        self.leaves = true;
        self.judge();
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.ends_by_ns.is_some_and(|by| monotonic_ns() >= by)
    }
}
