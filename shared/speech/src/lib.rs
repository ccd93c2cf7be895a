//! What the robot says to its handler, and when: sentences, their texts by language, and who is heard first.
//!
//! Pure: no clock, no I/O but for reading a language file.

mod language;
mod sentence;
mod speaker;
mod tone;

pub use language::{Language, LanguageError};
pub use sentence::{News, Sentence, Topic};
pub use speaker::{Speaker, SpeakerConfig, Utterance};
pub use tone::Tone;
