//! A robot's side: what it makes of its commands, and what it says of itself.

use messages::Twist2;
use serde::{Deserialize, Serialize};

use crate::{Command, Mode, Profile, Remote, State, WireError};

/// What a robot does when nothing more comes. No document says which of them the real ones are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Silence {
    /// It keeps its last command for ever.
    HoldsLast,
    /// It stands after [`SILENT_NS`].
    Stands,
}

impl Silence {
    /// Both.
    pub const ALL: [Self; 2] = [Self::HoldsLast, Self::Stands];

    /// Its name on a command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::HoldsLast => "holds-last",
            Self::Stands => "stands",
        }
    }
}

/// A robot that stands by itself does so after this long, nanoseconds.
pub const SILENT_NS: u64 = 500_000_000;

/// An emulated robot: it takes every velocity at once, and leaves where it gets to whoever moves it.
#[derive(Debug, Clone)]
pub struct EmulatedRobot {
    profile: Profile,
    silence: Silence,
    /// Whether it takes high-level commands: an AlienGo does when it was triggered.
    sport: bool,
    command: Command,
    commanded_ns: u64,
    remote: Remote,
    limp: bool,
}

impl EmulatedRobot {
    /// A robot that stands.
    #[must_use]
    pub fn new(profile: Profile, silence: Silence) -> Self {
        Self {
            profile,
            silence,
            sport: profile != Profile::AlienGo384,
            command: Command::default(),
            commanded_ns: 0,
            remote: Remote::default(),
            limp: false,
        }
    }

    /// Takes a command.
    ///
    /// # Errors
    /// Where the bytes are none; the robot then goes on as before.
    pub fn received(&mut self, bytes: &[u8], now_ns: u64) -> Result<(), WireError> {
        let command = Command::decode(self.profile, bytes)?;
        self.sport |= command.trigger;
        self.limp |= command.mode == Mode::Damping;
        self.limp &= command.mode != Mode::Recovery;
        (self.command, self.commanded_ns) = (command, now_ns);
        Ok(())
    }

    /// What is pressed on its hand remote from now on.
    pub fn press(&mut self, remote: Remote) {
        self.remote = remote;
        self.limp |= remote.says_stop();
    }

    /// Whoever holds its hand remote makes it stand again after a stop.
    pub fn recover(&mut self) {
        self.limp = false;
    }

    /// What it does with its legs.
    #[must_use]
    pub fn mode(&self) -> Mode {
        if self.limp { Mode::Damping } else { self.command.mode }
    }

    /// How fast it goes.
    #[must_use]
    pub fn velocity(&self, now_ns: u64) -> Twist2 {
        let silent = self.silence == Silence::Stands && now_ns.saturating_sub(self.commanded_ns) > SILENT_NS;
        let walks = self.sport && self.mode() == Mode::Walk && !silent;
        if walks { self.command.velocity } else { Twist2::ZERO }
    }

    /// What it says of itself, where `measured` is what its sensors know.
    #[must_use]
    pub fn state(&self, measured: State) -> State {
        State { mode: self.mode() as u8, remote: self.remote, ..measured }
    }
}
