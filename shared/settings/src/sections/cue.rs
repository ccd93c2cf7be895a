//! The cue recogniser's section.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::path::ConfigPath;
use crate::recorded::CueOrigin;

/// Where cues come from.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CueSettings {
    /// Where cues come from.
    pub source: CueOrigin,
    /// A route file whose cues the scripted handler gives; none: only the operator gives cues.
    pub script: Option<ConfigPath>,
    /// Replay: the scripted handler gives "forward" once `ready_for_cue`, and again after every fault.
    pub forward_when_ready: bool,
    /// The handler's voice, beside the others.
    pub voice: VoiceSettings,
}

/// How a voice is heard.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VoiceSource {
    /// Not at all.
    #[default]
    Absent,
    /// By a microphone, through ALSA.
    Microphone,
    /// From a file or a pipe: WAV, or raw samples; 16 kHz, 16 bits, one channel.
    Stream,
}

/// What has to be said before a direction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Attention {
    /// Nothing.
    #[default]
    None,
    /// "Go", at most two seconds before: "go left". By itself it is no cue then.
    Go,
}

/// A key of a Linux input device that is held to speak.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TalkKey {
    /// The device's file.
    pub device: ConfigPath,
    /// The key's number; `evtest` tells it.
    pub key: u16,
}

/// The handler's voice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VoiceSettings {
    /// How it is heard.
    pub source: VoiceSource,
    /// The microphone, by ALSA's name for it (`arecord -L`).
    pub microphone: String,
    /// The file or pipe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stream: Option<ConfigPath>,
    /// The head's manifest, NAME.toml beside NAME.onnx; none: the one that is shipped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<ConfigPath>,
    /// Whether a tone is heard, by `[speak]`, before a spoken cue starts a robot that stands by a stop.
    pub tone: bool,
    /// Whether a word that would start a robot that stands by a stop has to be said again within two seconds, in place
    /// of the tone.
    pub repeat: bool,
    /// What has to be said before a direction.
    pub attention: Attention,
    /// The key that has to be held while a direction is said; none: directions are always heard. *stop* always is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub talk: Option<TalkKey>,
    /// The speech embedding; none: `cues/embedding.onnx`, the one that is shipped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub embedding: Option<ConfigPath>,
}

impl Default for VoiceSettings {
    fn default() -> Self {
        Self {
            source: VoiceSource::Absent,
            microphone: "default".to_owned(),
            stream: None,
            model: None,
            tone: true,
            repeat: false,
            attention: Attention::None,
            talk: None,
            embedding: None,
        }
    }
}
