//! The brake's voice, and the one that speaks where the bridge is gone.

use links::{ToBridge, WORD_MAX};
use transport::{Io, Line, LineListener, Received, Service, TransportError, monotonic_ns};

use crate::voice::Voice;
use crate::{LOOK_NS, LOST_LIMIT_NS};

const TOKEN_LISTENER: u64 = 0;
const TOKEN_BRIDGE: u64 = 1;
/// Lines of the brake's lives are numbered from here on.
const TOKEN_BRAKE: u64 = 2;
/// So many may wait to say who they are.
const UNKNOWN_MAX: usize = 8;
/// After the brake's last word a stop is said for so long, nanoseconds: it says it every 20 ms while it means it.
const MEANT_NS: u64 = 100_000_000;

/// The service.
pub struct Backstop {
    voice: Voice,
    listener: LineListener,
    /// The brake's line, and its token.
    brake: Option<(Line, u64)>,
    /// Who has not said yet that it is the brake.
    unknown: Vec<(Line, u64)>,
    bridge: Option<Line>,
    tokens: u64,
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
        let listener = LineListener::open(&io.domain.dir.backstop_socket())?;
        io.watch(&listener, TOKEN_LISTENER)?;
        Ok(Self {
            voice,
            listener,
            brake: None,
            unknown: Vec::new(),
            bridge: None,
            tokens: TOKEN_BRAKE,
            asked_ns: None,
            next_ns: 0,
            leaves: false,
            ends_by_ns: None,
        })
    }

    /// Says stop for as long as somebody who can stop the robot is gone, or asks for it.
    fn judge(&mut self) {
        let asked = self.asked_ns.is_some_and(|asked_ns| monotonic_ns().saturating_sub(asked_ns) <= MEANT_NS);
        let gone = !self.leaves && (self.bridge.is_none() || self.brake.is_none());
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

    fn admit(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(line) = self.listener.accept() {
            if self.unknown.len() == UNKNOWN_MAX {
                io.unwatch(&self.unknown.remove(0).0);
            }
            self.tokens += 1;
            io.watch(&line, self.tokens)?;
            self.unknown.push((line, self.tokens));
        }
        Ok(())
    }

    /// The newest brake is the one that counts.
    fn greet(&mut self, io: &Io, token: u64) {
        let Some(at) = self.unknown.iter().position(|(_, known)| *known == token) else { return };
        let mut bytes = [0; WORD_MAX];
        let received = self.unknown[at].0.receive_bytes(&mut bytes);
        if matches!(received, Received::Nothing) {
            return;
        }
        let (line, token) = self.unknown.remove(at);
        let is_brake =
            matches!(received, Received::Message(len, _) if ToBridge::of(&bytes[..len]) == Some(ToBridge::Brake));
        let gone = if is_brake { self.brake.replace((line, token)) } else { Some((line, token)) };
        if let Some((gone, _)) = gone {
            io.unwatch(&gone);
        }
        self.hear_brake(io);
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

    fn hear_brake(&mut self, io: &Io) {
        let mut bytes = [0; WORD_MAX];
        let Some((line, _)) = &self.brake else { return };
        loop {
            match line.receive_bytes(&mut bytes) {
                Received::Nothing => return,
                Received::Message(len, _) if ToBridge::of(&bytes[..len]) == Some(ToBridge::Zero) => {
                    self.asked_ns = Some(monotonic_ns());
                }
                Received::Message(..) => {}
                Received::Closed => break,
            }
        }
        io.unwatch(line);
        self.brake = None;
    }
}

impl Service for Backstop {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if io.now_ns() >= self.next_ns {
            self.next_ns = io.now_ns() + LOOK_NS;
            self.seek(io)?;
            self.judge();
            self.voice.go_on(io);
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        match token {
            TOKEN_LISTENER => self.admit(io)?,
            TOKEN_BRIDGE => self.hear_bridge(io),
            token if self.brake.as_ref().is_some_and(|(_, newest)| *newest == token) => self.hear_brake(io),
            token => self.greet(io, token),
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
