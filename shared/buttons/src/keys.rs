//! What a Linux input device's events say of its keys: pure.

use messages::StopInput;

/// Bytes of an event on a 64-bit machine: two of time, type, code, value.
pub const EVENT_LEN: usize = 24;
const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
/// Events were lost: nobody knows what is pressed.
const SYN_DROPPED: u16 = 3;
/// Keys that there are.
const KEYS: usize = 0x300;

/// Whether a key's bit is set, where a device tells of each of its keys by one.
#[must_use]
pub fn is_set(bits: &[u8], key: usize) -> bool {
    bits.get(key / 8).is_some_and(|byte| byte >> (key % 8) & 1 == 1)
}

/// Which keys are down.
#[derive(Debug, Clone)]
pub struct Keys {
    /// The one that counts; none: all of them.
    key: Option<u16>,
    /// Whether the robot moves only while it is held.
    held: bool,
    down: [bool; KEYS],
    /// What is down is known.
    known: bool,
    /// Of an event, the bytes that have come, and how many.
    begun: ([u8; EVENT_LEN], usize),
}

impl Keys {
    /// Keys of which nothing is known.
    #[must_use]
    pub fn new(key: Option<u16>, held: bool) -> Self {
        Self { key, held, down: [false; KEYS], known: false, begun: ([0; EVENT_LEN], 0) }
    }

    /// Whether events were lost, so that the device has to be asked what is down.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.known
    }

    /// What the device says is down, a bit for each key.
    pub fn answered(&mut self, bits: &[u8]) {
        for (key, down) in self.down.iter_mut().enumerate() {
            *down = is_set(bits, key);
        }
        self.known = true;
    }

    /// Takes bytes of events: the worst of the states that they passed through.
    pub fn take(&mut self, bytes: &[u8]) -> StopInput {
        let mut worst = self.state();
        for byte in bytes {
            let (event, len) = &mut self.begun;
            event[*len] = *byte;
            *len += 1;
            if *len == EVENT_LEN {
                *len = 0;
                let event = *event;
                worst = self.event(&event, worst);
            }
        }
        worst
    }

    /// One event, where it was `worst` before.
    fn event(&mut self, event: &[u8; EVENT_LEN], worst: StopInput) -> StopInput {
        let half = |at: usize| u16::from_le_bytes([event[at], event[at + 1]]);
        let value = i32::from_le_bytes([event[20], event[21], event[22], event[23]]);
        match (half(16), half(18)) {
            // A press may be among what was lost.
            (EV_SYN, SYN_DROPPED) => {
                self.known = false;
                return StopInput::Lost;
            }
            (EV_KEY, key) if self.counts(key) => {
                self.down[usize::from(key)] = value != 0;
                // One key alone is known by its own event.
                self.known |= self.key.is_some();
            }
            _ => return worst,
        }
        if self.state().stops() || worst == StopInput::Unknown { self.state() } else { worst }
    }

    fn counts(&self, key: u16) -> bool {
        usize::from(key) < KEYS && self.key.is_none_or(|only| only == key)
    }

    /// What is known now.
    #[must_use]
    pub fn state(&self) -> StopInput {
        let any = match self.key {
            Some(key) => self.down.get(usize::from(key)).copied().unwrap_or_default(),
            None => self.down.contains(&true),
        };
        match (self.known, any == self.held) {
            (false, _) => StopInput::Unknown,
            (true, true) => StopInput::Released,
            (true, false) => StopInput::Pressed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{EV_KEY, EV_SYN, EVENT_LEN, Keys, SYN_DROPPED};
    use messages::StopInput::{Pressed, Released, Unknown};

    const SOUTH: u16 = 304;
    const EAST: u16 = 305;

    fn event(kind: u16, code: u16, value: i32) -> [u8; EVENT_LEN] {
        let mut bytes = [0x5a; EVENT_LEN];
        bytes[16..18].copy_from_slice(&kind.to_le_bytes());
        bytes[18..20].copy_from_slice(&code.to_le_bytes());
        bytes[20..].copy_from_slice(&value.to_le_bytes());
        bytes
    }

    #[test]
    fn a_button_stops_while_it_is_down_and_however_short_it_was() {
        let mut keys = Keys::new(Some(SOUTH), false);
        assert_eq!(keys.take(&[]), Unknown, "it has not been asked");
        keys.answered(&[0; 96]);
        assert_eq!(keys.take(&event(EV_KEY, EAST, 1)), Released, "another one");
        assert_eq!(keys.take(&event(EV_KEY, SOUTH, 1)), Pressed);
        assert_eq!(keys.take(&event(EV_KEY, SOUTH, 2)), Pressed, "it repeats itself");
        assert_eq!((keys.take(&event(EV_KEY, SOUTH, 0)), keys.take(&[])), (Pressed, Released));
        let tap = [event(EV_KEY, SOUTH, 1), event(EV_KEY, SOUTH, 0)].concat();
        let (first, second) = tap.split_at(30);
        assert_eq!((keys.take(first), keys.take(second), keys.take(&[])), (Pressed, Pressed, Released), "in pieces");
        keys.answered(&[0; 10]);
        assert_eq!(keys.state(), Released);
    }

    #[test]
    fn where_none_is_named_every_key_stops() {
        let mut keys = Keys::new(None, false);
        let mut bits = [0; 96];
        bits[usize::from(SOUTH) / 8] = 1 << (SOUTH % 8);
        keys.answered(&bits);
        assert_eq!(keys.take(&[]), Pressed, "it was down when it was plugged in");
        keys.take(&event(EV_KEY, EAST, 1));
        keys.take(&event(EV_KEY, SOUTH, 0));
        assert_eq!(keys.state(), Pressed, "the other one is");
        keys.take(&event(EV_KEY, EAST, 0));
        assert_eq!(keys.state(), Released);
        assert_eq!(keys.take(&event(EV_KEY, u16::MAX, 1)), Released, "no key at all");
    }

    #[test]
    fn a_dead_mans_switch_stops_when_it_is_let_go_of() {
        let mut keys = Keys::new(Some(SOUTH), true);
        keys.answered(&[]);
        assert_eq!(keys.state(), Pressed, "nobody holds it");
        keys.take(&event(EV_KEY, SOUTH, 1));
        assert_eq!(keys.state(), Released);
        assert_eq!(keys.take(&event(EV_KEY, SOUTH, 0)), Pressed);
    }

    #[test]
    fn events_that_were_lost_leave_nothing_known() {
        let mut keys = Keys::new(None, false);
        keys.answered(&[]);
        keys.take(&event(EV_SYN, SYN_DROPPED, 0));
        assert!(!keys.is_known() && keys.state() == Unknown);
    }
}
