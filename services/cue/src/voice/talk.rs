//! The key that is held while a direction is said.

use buttons::InputDevice;
use messages::{NS_PER_S, StopInput};
use settings::{EstopInput, TalkKey};
use transport::{Io, TransportError};

/// Between two tries to open what is not there, nanoseconds.
const REOPEN_NS: u64 = NS_PER_S;
/// Whoever lets go of the key has said the word; its end is waited for, nanoseconds.
const AFTER_NS: u64 = NS_PER_S * 6 / 10;

/// The key, and whether it is held.
pub struct Talk {
    settings: EstopInput,
    device: Option<InputDevice>,
    token: u64,
    held_until: HeldUntil,
    reopen_ns: u64,
}

/// Until when what is said counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct HeldUntil {
    is_held: bool,
    until_ns: u64,
}

impl HeldUntil {
    fn take(&mut self, is_held: bool, now_ns: u64) {
        if is_held || self.is_held {
            self.until_ns = now_ns + AFTER_NS;
        }
        self.is_held = is_held;
    }

    fn counts(self, at_ns: u64) -> bool {
        self.is_held || at_ns < self.until_ns
    }
}

impl Talk {
    /// The key of these settings; it is opened when it is first asked for.
    pub fn new(settings: &TalkKey, token: u64) -> Self {
        // Held down is what lets a dead man's switch go.
        let settings = EstopInput { device: settings.device.clone(), key: Some(settings.key), held: true };
        Self { settings, device: None, token, held_until: HeldUntil::default(), reopen_ns: 0 }
    }

    /// Whether what was said at a run time counts.
    pub fn counts(&self, at_ns: u64) -> bool {
        self.held_until.counts(at_ns)
    }

    /// Takes the key's news.
    ///
    /// # Errors
    /// Where it is not there: what to do. It is looked for again each second.
    pub fn take(&mut self, io: &Io) -> Result<(), String> {
        let now_ns = io.now_ns();
        if self.device.is_none() && now_ns >= self.reopen_ns {
            self.reopen_ns = now_ns + REOPEN_NS;
            let device = InputDevice::open(&self.settings, false)?;
            io.watch(&device, self.token).map_err(|error: TransportError| error.to_string())?;
            self.device = Some(device);
        }
        let Some(device) = &mut self.device else { return Ok(()) };
        match device.read() {
            // Nobody holds what nothing is known of.
            Ok(state) => self.held_until.take(state == StopInput::Released, now_ns),
            Err(why) => {
                (self.device, self.reopen_ns) = (None, now_ns + REOPEN_NS);
                self.held_until.take(false, now_ns);
                return Err(why);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{AFTER_NS, HeldUntil};

    #[test]
    fn what_is_said_counts_while_the_key_is_held_and_shortly_after() {
        let mut held = HeldUntil::default();
        assert!(!held.counts(0));
        held.take(false, 5);
        assert!(!held.counts(5), "it was never held");
        held.take(true, 10);
        assert!(held.counts(10 + 3 * AFTER_NS), "it is held");
        held.take(false, 20);
        assert!(held.counts(19 + AFTER_NS) && !held.counts(20 + AFTER_NS));
        held.take(false, 30);
        assert!(!held.counts(25 + AFTER_NS), "letting go counts once");
    }
}
