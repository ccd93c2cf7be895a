//! What the handler says: from samples to cues, streaming.
//!
//! Samples → log-mel frames, 100 a second ([`LogMel`]) → a speech embedding every 80 ms → a small network, the head,
//! over the last eight of these → how probable each word is → cues, by rules that are data ([`Rules`], [`CueRules`]).
//! Four such lanes run 20 ms apart, so that a decision hardly depends on when a word falls into the 80 ms. Beside it
//! goes what the sound itself tells ([`Levels`], [`Periodicity`]; [`Signal`]: clipping, a microphone that is dead).
//!
//! [`Recogniser`] is all of it, for the robot and for the evaluation. Features and rules are those of
//! `scripts/train/cues`, to the last constant: `tests/golden.rs` holds one against the other.

mod clip;
mod levels;
mod mel;
mod model;
mod pcm;
mod periodicity;
mod recogniser;
mod rules;
mod signal;

pub use clip::{faster, mean_square, peak, speech_power, word_end};
pub use levels::{Around, Isolation, Levels, Sound, level_db};
pub use mel::{BANDS, FRAME, HOP, LogMel, Mel, RATE_HZ};
pub use model::{
    EMBEDDING, Embedder, FRAMES, FRAMES_AN_EMBEDDING, Head, Manifest, ModelFiles, Network, Networks, SpeechError,
    WINDOWS, digest, read,
};
pub use pcm::{PcmError, PcmStream};
pub use periodicity::Periodicity;
pub use recogniser::{Ears, FRAMES_A_STEP, Recogniser, STEP_NS, Step};
pub use rules::{
    CueRules, Direction, Heard, IsolationRules, Rules, Starts, Stop, TalkRules, Thresholds, VoiceRules, cue_of,
};
pub use signal::{Quality, Signal, Trouble};

/// The words that are told apart: the head's outputs, in this order; all else is the last. *go* means *forward*.
pub const LABELS: [&str; 6] = ["forward", "left", "right", "stop", "go", "other"];
/// How probable each of [`LABELS`] is.
pub type Probabilities = [f32; LABELS.len()];
