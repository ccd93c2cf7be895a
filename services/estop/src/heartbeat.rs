//! A box at a serial line, with a heartbeat.

use std::os::fd::{AsFd, BorrowedFd};

use messages::StopInput;
use serial::SerialPort;
use settings::EstopSerial;

use crate::Input;

/// A box that is silent for so long is lost, nanoseconds: four beats of the slowest that is allowed, 20 Hz. The robot
/// then stands within the budget of a lost sensor, 250 ms.
const SILENT_NS: u64 = 200_000_000;
const RELEASED: u8 = b'r';
const PRESSED: u8 = b'p';

/// What a box's bytes say, and for how long: pure.
#[derive(Debug, Clone, Copy)]
pub struct Heartbeat {
    last: StopInput,
    beat_ns: u64,
}

impl Heartbeat {
    /// A box that was plugged in just now, of which nothing is known.
    #[must_use]
    pub fn new(now_ns: u64) -> Self {
        Self { last: StopInput::Unknown, beat_ns: now_ns }
    }

    /// Takes what has come: pressed, where it was for as long as one byte. Who says something else, ends of lines
    /// apart, is no such box, or cannot be understood: lost until the next word.
    pub fn take(&mut self, bytes: &[u8], now_ns: u64) -> StopInput {
        let (mut pressed, mut garbled) = (false, false);
        for byte in bytes {
            self.last = match *byte {
                RELEASED => StopInput::Released,
                PRESSED => StopInput::Pressed,
                b'\r' | b'\n' => continue,
                // Half a byte at the beginning is none of its words yet.
                _ if self.last == StopInput::Unknown => continue,
                _ => {
                    garbled = true;
                    continue;
                }
            };
            self.beat_ns = now_ns;
            pressed |= self.last == StopInput::Pressed;
        }
        let silent = now_ns.saturating_sub(self.beat_ns) > SILENT_NS;
        match (pressed, silent) {
            (true, _) => StopInput::Pressed,
            (false, true) => StopInput::Lost,
            (false, false) if garbled => StopInput::Lost,
            (false, false) => self.last,
        }
    }
}

/// The box.
#[derive(Debug)]
pub struct SerialBox {
    port: SerialPort,
    heartbeat: Heartbeat,
    /// Whether it sent anything the last time that it was lost.
    garbled: bool,
}

impl SerialBox {
    /// Opens its port.
    ///
    /// # Errors
    /// Where that cannot be opened; the reason says what to do.
    pub fn open(settings: &EstopSerial, now_ns: u64) -> Result<Self, String> {
        let port = SerialPort::open(&settings.port, settings.baud).map_err(|error| error.to_string())?;
        Ok(Self { port, heartbeat: Heartbeat::new(now_ns), garbled: false })
    }
}

impl Input for SerialBox {
    fn fd(&self) -> BorrowedFd<'_> {
        self.port.as_fd()
    }

    fn read(&mut self, now_ns: u64) -> Result<StopInput, String> {
        let mut bytes = [0; 256];
        let count = self.port.read(&mut bytes).map_err(|error| error.to_string())?;
        let input = self.heartbeat.take(&bytes[..count], now_ns);
        if input == StopInput::Lost {
            self.garbled |= count > 0;
        } else {
            self.garbled = false;
        }
        Ok(input)
    }

    fn why_lost(&self) -> Option<String> {
        let what = if self.garbled {
            "what it sends is neither r nor p: is estop.serial.baud its own?".to_owned()
        } else {
            format!("it has been silent for over {} ms: is it switched on?", SILENT_NS / 1_000_000)
        };
        Some(format!("the emergency stop at {}: {what}", self.port.path().display()))
    }
}

#[cfg(test)]
mod tests {
    use super::Heartbeat;
    use messages::StopInput::{Lost, Pressed, Released, Unknown};

    const MS: u64 = 1_000_000;

    #[test]
    fn a_box_has_to_say_again_and_again_that_it_is_released() {
        let mut heartbeat = Heartbeat::new(0);
        let said: &[(u64, &[u8], _)] = &[
            (10, b"", Unknown),
            (20, b"\xff\x00", Unknown),
            (100, b"r", Released),
            (300, b"", Released),
            (301, b"", Lost),
            (402, b"xyz", Lost),
            (500, b"rrr", Released),
            (600, b"rpr", Pressed),
            (601, b"", Released),
            (610, b"r\r\n", Released),
            (620, b"error\n", Lost),
            (630, b"r\n", Released),
            (700, b"p", Pressed),
            (800, b"", Pressed),
            (901, b"", Lost),
        ];
        for (ms, bytes, expected) in said {
            assert_eq!(heartbeat.take(bytes, ms * MS), *expected, "at {ms} ms");
        }
        assert_eq!(Heartbeat::new(0).take(b"", 201 * MS), Lost, "one that never spoke");
    }
}
