//! What the robot says aloud.

use crate::json::{mirrored, named};
use crate::{Header, StopReason};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// How urgent a sentence is: what is more urgent interrupts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Urgency/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum Urgency {
    /// Accepted cues, "ready", and the like.
    #[default]
    News = 0,
    /// The battery.
    Warning,
    /// A cue was refused.
    Refusal,
    /// The robot waits within run, without a permit.
    Hold,
    /// The tone before a cue that would start the robot.
    Tone,
    /// The robot was stopped: fault or lock.
    Stop,
}

named!(Urgency);

/// How far a sentence is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/SpeechPhase/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum SpeechPhase {
    /// Its first sample was handed to the output: whoever listens to a microphone does not until its end is told, or
    /// (the voice may die) until that is overdue.
    #[default]
    Begun = 0,
    /// It was heard to its end.
    Ended,
    /// Something more urgent cut it short.
    Cut,
    /// There is no sound of it, or none to its end: voice or output failed.
    Unheard,
}

named!(SpeechPhase);

/// A short text in a message.
#[derive(Clone, Copy, PartialEq, Eq, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/SpeechText/1"))]
#[repr(C)]
pub struct SpeechText {
    bytes: [u8; SpeechText::MAX_BYTES],
}

impl SpeechText {
    /// The longest text, bytes of UTF-8.
    pub const MAX_BYTES: usize = 120;

    /// The text; nothing where the bytes are none.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.bytes.iter().position(|byte| *byte == 0).unwrap_or(Self::MAX_BYTES);
        core::str::from_utf8(&self.bytes[..end]).unwrap_or_default()
    }
}

impl From<&str> for SpeechText {
    /// The text, cut at a whole character where it is too long.
    fn from(text: &str) -> Self {
        let end = (0..=text.len().min(Self::MAX_BYTES)).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
        let mut bytes = [0; Self::MAX_BYTES];
        bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self { bytes }
    }
}

impl Default for SpeechText {
    fn default() -> Self {
        Self { bytes: [0; Self::MAX_BYTES] }
    }
}

impl core::fmt::Debug for SpeechText {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

mirrored! {
    /// A sentence that the robot says: once as it begins, and once at its end.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/SpeechSaid/1"))]
    #[repr(C)]
    pub struct SpeechSaid {
        /// Stamp (run time of the phase), seq, incarnation.
        pub header: Header,
        /// How far it is.
        pub phase: SpeechPhase,
        /// How urgent it is.
        pub urgency: Urgency,
        /// Which sentence of this incarnation, from 1.
        pub number: u64,
        /// Run time of what it tells of: of the stop, of the answer to a cue, nanoseconds.
        pub about_ns: u64,
        /// Run time at which its first sample was handed to the output, nanoseconds; 0 where none was. A player has
        /// been started then, and what it takes to open its device comes on top.
        pub first_sample_ns: u64,
        /// How long it takes, nanoseconds; 0 where there is no sound of it.
        pub duration_ns: u64,
        /// The stop that it tells of, if any.
        pub reason: StopReason,
        /// What is said.
        pub text: SpeechText,
    }
}

#[cfg(test)]
mod tests {
    use super::SpeechText;

    #[test]
    fn a_text_comes_back_and_a_long_one_is_cut_at_a_character() {
        assert_eq!(SpeechText::from("Links geht nicht: blockiert.").as_str(), "Links geht nicht: blockiert.");
        let long = "ü".repeat(100);
        assert_eq!(SpeechText::from(long.as_str()).as_str(), "ü".repeat(SpeechText::MAX_BYTES / 2));
        assert_eq!(SpeechText::default().as_str(), "");
    }
}
