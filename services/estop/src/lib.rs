//! The emergency stop: a button, a gamepad, a dead man's switch, or a box at a serial line.
//!
//! Its word has to keep arriving to let the robot move. Pressed, unplugged or silent are all the same: a stop, which
//! locks the run until the operator resumes. It never replaces the power cut or the robot's own hand remote.

mod heartbeat;

use std::os::fd::{AsFd, BorrowedFd};

use buttons::InputDevice;
use messages::{EmergencyStop, StopInput};
use settings::EstopSource;
use transport::{FromChild, Io, Publisher, Rhythm, Service, TransportError};

pub use heartbeat::{Heartbeat, SerialBox};

/// Words a second, besides every change.
const RATE_HZ: f64 = 50.0;
/// Told of what cannot be watched.
const NO_DEVICE: &str = "what estop.input.device or estop.serial.port names is no device whose news can be waited for";
/// Between two tries to open what is not there, nanoseconds.
const REOPEN_NS: u64 = 200_000_000;
/// As long as this after its start nothing is lost yet, only unknown, nanoseconds: nobody has to resume a run that has
/// only just begun.
const GRACE_NS: u64 = 1_000_000_000;
const TOKEN: u64 = 0;

/// An emergency stop that is plugged in.
pub trait Input {
    /// What becomes readable when there is news.
    fn fd(&self) -> BorrowedFd<'_>;

    /// What has become of it: the worst since it was last asked, so that no press is too short.
    ///
    /// # Errors
    /// Where it is gone; the reason says what to do.
    fn read(&mut self, now_ns: u64) -> Result<StopInput, String>;

    /// Why its last word was that it is lost, where it knows.
    fn why_lost(&self) -> Option<String> {
        None
    }
}

impl Input for InputDevice {
    fn fd(&self) -> BorrowedFd<'_> {
        self.as_fd()
    }

    fn read(&mut self, _now_ns: u64) -> Result<StopInput, String> {
        Self::read(self)
    }
}

/// Opens it; the reason says what to do.
type Opens = Box<dyn Fn(u64) -> Result<Box<dyn Input>, String>>;

/// The service.
pub struct EstopDriver {
    opens: Opens,
    input: Option<Box<dyn Input>>,
    words: Publisher<EmergencyStop>,
    rhythm: Rhythm,
    reopen_ns: u64,
    begun_ns: u64,
    last: StopInput,
    /// The last thing told, which is not told again, and whether it is told yet: the word goes out first.
    note: String,
    untold: bool,
}

impl EstopDriver {
    /// An emergency stop as the settings name it, which is opened when the service first wakes.
    ///
    /// # Errors
    /// Where the settings name none, or the port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let (real, settings) = (settings.commands_robot(), settings.estop);
        let opens: Opens = match settings.source {
            EstopSource::Input => Box::new(move |_| Ok(Box::new(InputDevice::open(&settings.input, real)?))),
            EstopSource::Serial => Box::new(move |now_ns| Ok(Box::new(SerialBox::open(&settings.serial, now_ns)?))),
            EstopSource::Absent => {
                return Err(TransportError::Service("estop.source names no emergency stop".to_owned()));
            }
        };
        Ok(Self {
            opens,
            input: None,
            words: io.publisher()?,
            rhythm: Rhythm::at_hz(RATE_HZ),
            reopen_ns: 0,
            begun_ns: io.now_ns(),
            last: StopInput::Unknown,
            note: String::new(),
            untold: false,
        })
    }

    /// What is known now; what is gone is opened again.
    fn look(&mut self, io: &Io) -> Result<StopInput, TransportError> {
        let now_ns = io.now_ns();
        if self.input.is_none() && now_ns >= self.reopen_ns {
            // A plain file, for one, has no news that could be waited for.
            let watched = |input: Box<dyn Input>| match io.watch(input.fd(), TOKEN) {
                Ok(()) => Ok(input),
                Err(_) => Err(NO_DEVICE.to_owned()),
            };
            match (self.opens)(now_ns).and_then(watched) {
                Ok(input) => self.input = Some(input),
                Err(why) => self.lose(io, why),
            }
        }
        let Some(input) = &mut self.input else { return Ok(self.nothing(now_ns)) };
        match input.read(now_ns) {
            Ok(StopInput::Unknown) => Ok(self.nothing(now_ns)),
            Ok(known) => {
                if known != StopInput::Lost {
                    self.note.clear();
                }
                Ok(known)
            }
            Err(why) => {
                self.lose(io, why);
                Ok(self.nothing(now_ns))
            }
        }
    }

    fn nothing(&self, now_ns: u64) -> StopInput {
        let young = self.last == StopInput::Unknown && now_ns.saturating_sub(self.begun_ns) < GRACE_NS;
        if young { StopInput::Unknown } else { StopInput::Lost }
    }

    fn lose(&mut self, io: &Io, why: String) {
        if let Some(input) = self.input.take() {
            io.unwatch(input.fd());
        }
        self.reopen_ns = io.now_ns() + REOPEN_NS;
        self.note(why);
    }

    fn note(&mut self, why: String) {
        if self.note != why {
            (self.note, self.untold) = (why, true);
        }
    }

    fn say(&mut self, input: StopInput, now_ns: u64) -> Result<(), TransportError> {
        self.last = input;
        self.words.publish(now_ns, EmergencyStop { input, ..EmergencyStop::default() }).map(|_| ())
    }
}

impl Service for EstopDriver {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        let (input, now_ns) = (self.look(io)?, io.now_ns());
        let due = self.rhythm.due(now_ns).is_some();
        if due || input != self.last {
            self.say(input, now_ns)?;
        }
        // Only now: the word waits for nothing.
        if let Some(why) = self.input.as_ref().filter(|_| input == StopInput::Lost).and_then(|it| it.why_lost()) {
            self.note(why);
        }
        if std::mem::take(&mut self.untold) {
            io.tell(&FromChild::Note { text: self.note.clone() });
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.rhythm.next_ns())
    }

    fn on_fd(&mut self, io: &mut Io, _token: u64) -> Result<(), TransportError> {
        self.on_wake(io)
    }
}
