//! The end of a run: the robot stands first, then everybody leaves, then nothing of the run is left.

use messages::{LocomotionState, ServiceId, SpeechPhase, StopKind};
use transport::{Io, ToChild, TransportError, monotonic_ns};

use crate::Supervisor;
use crate::machine::{Event, Now};

/// The robot stands, or this long has passed since the stop.
const STAND_LIMIT_NS: u64 = 1_000_000_000;
/// The robot's last word is said, or this long has passed since the stop.
const LAST_WORD_LIMIT_NS: u64 = 4_000_000_000;
/// Everybody has left, or this long has passed since they were asked to.
const LEAVE_LIMIT_NS: u64 = 1_500_000_000;
/// Everybody has ended, or is killed after this long.
const EXIT_LIMIT_NS: u64 = 1_000_000_000;

/// How far the end is; the wall time at which each part began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The run goes on.
    No,
    /// The robot is being stopped.
    Stopping(u64),
    /// Everybody is asked to leave.
    Leaving(u64),
    /// Everybody is told to exit.
    Exiting(u64),
    /// Nobody is left.
    Done,
}

impl Ending {
    /// Whether the end has begun.
    #[must_use]
    pub fn has_begun(self) -> bool {
        self != Self::No
    }

    /// Whether nobody is left.
    #[must_use]
    pub fn is_done(self) -> bool {
        self == Self::Done
    }
}

fn stands(state: &LocomotionState) -> bool {
    state.applied.is_zero() && (!state.measured_valid || state.measured.is_standing())
}

impl Supervisor {
    pub(crate) fn begin_end(&mut self, why: StopKind, io: &Io) {
        if !self.ending.has_begun() {
            self.ending = Ending::Stopping(monotonic_ns());
            self.ended_ns = io.now_ns();
            let now = Now { run_ns: io.now_ns(), wall_ns: monotonic_ns() };
            self.machine.handle(Event::ShutDown(why), now);
        }
    }

    pub(crate) fn go_on_ending(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let now = monotonic_ns();
        match self.ending {
            Ending::No | Ending::Done => {}
            Ending::Stopping(since) => {
                let locomotion_up = self.children.running().iter().any(|c| c.service == ServiceId::Locomotion);
                // In stepped time the world stands still once its time is over.
                let time_is_over = io.domain.clock.is_stepped() && self.figures.world.is_some();
                let standing = self.last_locomotion.is_none_or(|state| stands(&state));
                let stands = standing || time_is_over || !locomotion_up || now > since + STAND_LIMIT_NS;
                if stands && (self.has_said_last_word() || now > since + LAST_WORD_LIMIT_NS) {
                    for child in self.children.running() {
                        self.children.tell(child.service, &ToChild::Leave);
                    }
                    self.ending = Ending::Leaving(now);
                }
            }
            Ending::Leaving(since) => {
                if self.children.running().iter().all(|child| child.left) || now > since + LEAVE_LIMIT_NS {
                    self.take_last_beats()?;
                    for child in self.children.running() {
                        self.children.tell(child.service, &ToChild::Exit);
                    }
                    self.ending = Ending::Exiting(now);
                }
            }
            Ending::Exiting(since) => {
                if now > since + EXIT_LIMIT_NS {
                    for child in self.children.running() {
                        self.children.kill(child.service, child.incarnation);
                    }
                }
                if self.children.running().is_empty() {
                    self.ending = Ending::Done;
                }
            }
        }
        Ok(())
    }

    /// Whether nobody speaks, or has said why the run ends.
    fn has_said_last_word(&self) -> bool {
        let is_last = |said: &messages::SpeechSaid| {
            let of_the_end = matches!(said.reason.kind, StopKind::ShuttingDown | StopKind::Arrived);
            of_the_end && said.phase != SpeechPhase::Begun
        };
        !self.machine.is_ready(ServiceId::Speak) || self.last_said.as_ref().is_some_and(is_last)
    }

    /// Everybody's last figures, which come outside of any step.
    fn take_last_beats(&mut self) -> Result<(), TransportError> {
        for beats in &mut self.health {
            while let Some(health) = beats.take_at_once()? {
                self.figures.beat(&health);
            }
        }
        Ok(())
    }
}
