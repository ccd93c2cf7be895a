//! Locomotion's voice.

use dds::PERIOD_NS;
use links::{FromBridge, ToBridge, Told};
use messages::Twist2;
use transport::{Io, LineListener, Service, TransportError, monotonic_ns};

use crate::peers::{Heard, Peers, TOKEN_LISTENER, Who};
use crate::voice::Voice;
use crate::{LOOK_NS, LOST_LIMIT_NS};

/// A stop that the robot does not answer for so long is the backstop's to say as well, nanoseconds.
const UNANSWERED_NS: u64 = 100_000_000;

/// The service.
pub struct Bridge {
    voice: Voice,
    peers: Peers,
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
        let peers = Peers::of(LineListener::open(&io.domain.dir.bridge_socket())?, io)?;
        Ok(Self { voice, peers, life: 0, forgotten: 0, reported_ns: 0, next_ns: 0, leaves: false, ends_by_ns: None })
    }

    /// Everything that waits on a line. Each wish is said before the next is read.
    fn listen(&mut self, io: &Io, token: u64) {
        while let Some(heard) = self.peers.hear(io, token) {
            if let Heard::Word(who, word) = heard {
                self.take(who, word);
            }
            self.speak();
        }
    }

    fn take(&mut self, who: Who, word: ToBridge) {
        match (who, word) {
            (Who::Locomotion(life), ToBridge::Locomotion(said)) if life == said && life >= self.life => {
                (self.life, self.forgotten) = (life, 0);
            }
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

    /// Says what is wished for, or zero where it may not move.
    fn speak(&mut self) {
        if !self.may_move() {
            self.voice.driver.wish(Twist2::ZERO, 0);
        }
        self.voice.speak();
    }

    /// Whether both are there who see to it that the robot stops.
    fn may_move(&self) -> bool {
        let hears = self.voice.hears_remote(monotonic_ns());
        !self.leaves && hears && self.peers.has(Who::Locomotion(self.life)) && self.peers.has(Who::Backstop)
    }

    /// Where the robot does not answer a stop, the line to the backstop is closed: it then says stop by itself.
    fn call_for_help(&mut self, io: &Io, now_ns: u64) {
        if self.voice.driver.unanswered_ns(now_ns) > UNANSWERED_NS {
            self.peers.send_away(io, Who::Backstop);
        }
    }

    fn report(&mut self, now_ns: u64) {
        if now_ns.saturating_sub(self.reported_ns) < PERIOD_NS / 2 {
            return;
        }
        self.reported_ns = now_ns;
        let word = FromBridge {
            state: self.voice.newest.map(|(state, came_ns)| Told {
                velocity: state.velocity,
                own_from_robot: state.own_from_robot,
                roll_pitch_rad: state.roll_pitch_rad,
                came_ns,
            }),
            charge_percent: self.voice.charge_percent(now_ns),
            remote_stop: self.voice.driver.remote_stop(),
            forgotten: self.forgotten,
        };
        self.peers.tell(Who::Locomotion(self.life), &word);
    }
}

impl Service for Bridge {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if io.now_ns() >= self.next_ns {
            self.next_ns = io.now_ns() + LOOK_NS;
            self.voice.hear();
            self.call_for_help(io, monotonic_ns());
            self.speak();
            self.report(monotonic_ns());
            self.voice.tell(io);
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_fd(&mut self, io: &mut Io, token: u64) -> Result<(), TransportError> {
        if token == TOKEN_LISTENER {
            return self.peers.admit(io);
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
        self.speak();
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.ends_by_ns.is_some_and(|by| monotonic_ns() >= by)
    }
}
