//! An emergency stop box at a pseudo-terminal.

use std::path::PathBuf;

use messages::Fault;
use serial::PseudoTerminal;

/// From one beat to the next, nanoseconds.
const BEAT_NS: u64 = 25_000_000;

/// A box whose port is at a path.
#[derive(Debug)]
pub struct EmulatedEstop {
    /// None while it is unplugged.
    terminal: Option<PseudoTerminal>,
    port: PathBuf,
    fault: Option<Fault>,
    beat_ns: u64,
}

impl EmulatedEstop {
    /// Plugs a box in, which is released.
    #[must_use]
    pub fn new(terminal: PseudoTerminal) -> Self {
        let port = terminal.path().to_owned();
        Self { terminal: Some(terminal), port, fault: None, beat_ns: 0 }
    }

    /// From now on that is done to it.
    ///
    /// # Errors
    /// Where it is to be plugged in again, and its port cannot be made.
    pub fn suffer(&mut self, fault: Option<Fault>) -> std::io::Result<()> {
        if fault == self.fault {
            return Ok(());
        }
        // A press is told at once.
        (self.fault, self.beat_ns) = (fault, 0);
        if fault == Some(Fault::Unplugged) {
            self.terminal = None;
        } else if self.terminal.is_none() {
            self.terminal = Some(PseudoTerminal::open(&self.port)?);
        }
        Ok(())
    }

    /// Beats, where it is time to.
    ///
    /// # Errors
    /// Where the pseudo-terminal fails.
    pub fn serve(&mut self, now_ns: u64) -> std::io::Result<()> {
        let Some(terminal) = &self.terminal else { return Ok(()) };
        if now_ns.saturating_sub(self.beat_ns) < BEAT_NS || self.fault == Some(Fault::Silent) {
            return Ok(());
        }
        self.beat_ns = now_ns;
        // What nobody reads is lost.
        terminal.write(if self.fault == Some(Fault::Pressed) { b"p" } else { b"r" }).map(|_| ())
    }
}
