//! The hand remote, as a robot passes on what is pressed on it.

use crate::field::{get_f32, put_f32};

/// Its length in a state.
pub(crate) const LEN: usize = 40;
const BUTTONS: usize = 2;
const STICKS: [usize; 4] = [4, 20, 8, 12];

/// A button, by its bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Button {
    /// Right shoulder, upper.
    R1 = 0,
    /// Left shoulder, upper.
    L1 = 1,
    /// Start.
    Start = 2,
    /// Select.
    Select = 3,
    /// Right shoulder, lower.
    R2 = 4,
    /// Left shoulder, lower.
    L2 = 5,
    /// A.
    A = 8,
    /// B.
    B = 9,
    /// X.
    X = 10,
    /// Y.
    Y = 11,
}

/// What is pressed and pushed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Remote {
    /// One bit for each [`Button`].
    pub buttons: u16,
    /// Left stick to the right and up, right stick to the right and up, -1 to 1.
    pub sticks: [f32; 4],
}

impl Remote {
    /// Whether a button is pressed.
    #[must_use]
    pub fn pressed(&self, button: Button) -> bool {
        self.buttons >> button as u16 & 1 == 1
    }

    /// Whether it says stop: both lower left shoulder and B, on which the robot lies down limp.
    #[must_use]
    pub fn says_stop(&self) -> bool {
        self.pressed(Button::L2) && self.pressed(Button::B)
    }

    /// Reads it of the 40 bytes that a state has for it.
    pub fn decode(bytes: &[u8]) -> Self {
        let buttons = u16::from_le_bytes([bytes[BUTTONS], bytes[BUTTONS + 1]]);
        Self { buttons, sticks: STICKS.map(|at| get_f32(bytes, at)) }
    }

    /// Writes it to them: the robot's side.
    pub fn encode(&self, bytes: &mut [u8]) {
        bytes[BUTTONS..BUTTONS + 2].copy_from_slice(&self.buttons.to_le_bytes());
        STICKS.iter().zip(self.sticks).for_each(|(at, value)| put_f32(bytes, *at, value));
    }
}
