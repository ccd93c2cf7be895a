//! The key that is held while a direction is said.

use buttons::InputDevice;
use messages::{NS_PER_S, StopInput};
use settings::{EstopInput, TalkKey};
use transport::Io;

/// Between two tries to open what is not there, nanoseconds.
const REOPEN_NS: u64 = NS_PER_S;
/// A word counts for this long after the key was released, nanoseconds: the recogniser decides after its end.
const AFTER_NS: u64 = NS_PER_S * 6 / 10;
/// So long after the key went down, what is recognised may have been said before; no word is shorter, nanoseconds.
const BEFORE_NS: u64 = NS_PER_S * 4 / 10;

/// The key, and whether it is held.
pub struct Talk {
    settings: EstopInput,
    device: Option<InputDevice>,
    token: u64,
    held: Held,
    reopen_ns: u64,
    /// Why it is not there, as was told.
    told: Option<String>,
}

/// When what is said counts, nanoseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Held {
    /// Since when it is held, if it is.
    since_ns: Option<u64>,
    /// When it was held last.
    last: Option<(u64, u64)>,
}

impl Held {
    fn take(&mut self, is_held: bool, now_ns: u64) {
        match (self.since_ns, is_held) {
            (None, true) => self.since_ns = Some(now_ns),
            (Some(since_ns), false) => (self.since_ns, self.last) = (None, Some((since_ns, now_ns))),
            (None, false) | (Some(_), true) => {}
        }
    }

    fn counts(self, at_ns: u64) -> bool {
        let is_held = self.since_ns.is_some_and(|since_ns| at_ns >= since_ns + BEFORE_NS);
        let was_held =
            self.last.is_some_and(|(since_ns, until_ns)| (since_ns + BEFORE_NS..until_ns + AFTER_NS).contains(&at_ns));
        is_held || was_held
    }
}

impl Talk {
    /// The key of these settings; it is opened when it is first asked for.
    pub fn new(settings: &TalkKey, token: u64) -> Self {
        // Held down is what lets a dead man's switch go.
        let settings = EstopInput { device: settings.device.clone(), key: Some(settings.key), held: true };
        Self { settings, device: None, token, held: Held::default(), reopen_ns: 0, told: None }
    }

    /// Whether what is recognised at a run time counts.
    pub fn counts(&self, at_ns: u64) -> bool {
        self.held.counts(at_ns)
    }

    /// Takes the key's news: what the operator has to be told of it, if anything. Where it is not there, it is looked
    /// for again each second.
    pub fn take(&mut self, io: &Io) -> Option<String> {
        let now_ns = io.now_ns();
        let read = self.open(io, now_ns).and_then(|()| self.device.as_mut().map(InputDevice::read).transpose());
        match read {
            // A key whose state is unknown counts as released.
            Ok(Some(state)) => self.held.take(state == StopInput::Released, now_ns),
            Ok(None) => return None,
            Err(why) => {
                (self.device, self.reopen_ns) = (None, now_ns + REOPEN_NS);
                self.held.take(false, now_ns);
                let is_new = self.told.as_ref() != Some(&why);
                self.told = Some(why.clone());
                return is_new.then(|| format!("no direction is heard: {why} (cue.voice.talk)"));
            }
        }
        self.told.take().map(|_| "the key to speak is there again".to_owned())
    }

    fn open(&mut self, io: &Io, now_ns: u64) -> Result<(), String> {
        if self.device.is_some() || now_ns < self.reopen_ns {
            return Ok(());
        }
        let device = InputDevice::open(&self.settings, false)?;
        io.watch(&device, self.token).map_err(|error| error.to_string())?;
        self.device = Some(device);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{AFTER_NS, BEFORE_NS, Held};

    #[test]
    fn what_is_said_counts_while_the_key_is_held_and_shortly_after() {
        let mut held = Held::default();
        assert!(!held.counts(0));
        held.take(false, 5);
        assert!(!held.counts(5), "it was never held");
        held.take(true, 10);
        held.take(true, 11);
        assert!(!held.counts(9) && !held.counts(9 + BEFORE_NS), "it was said before");
        assert!(held.counts(10 + BEFORE_NS) && held.counts(10 + 3 * AFTER_NS), "it is held");
        let let_go_ns = 20 + AFTER_NS;
        held.take(false, let_go_ns);
        assert!(held.counts(let_go_ns - 1 + AFTER_NS) && !held.counts(let_go_ns + AFTER_NS));
        held.take(false, let_go_ns + 30);
        assert!(!held.counts(let_go_ns + AFTER_NS), "letting go counts once");
        held.take(true, let_go_ns + 2 * AFTER_NS);
        assert!(!held.counts(let_go_ns + 2 * AFTER_NS), "and holding it again begins anew");
    }
}
