//! What the robot says aloud.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::path::{ConfigPath, name_or_file};
use crate::units::Millis;

/// How much is said. Each level says what those before it say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verbosity {
    /// Stops, holds, refused cues, "ready", the battery.
    Stops,
    /// And accepted cues.
    #[default]
    Normal,
    /// And what changes nothing for who walks: a start, another policy, that a hold is over.
    All,
}

/// The language that the robot speaks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(into = "String")]
pub enum SpokenLanguage {
    /// A built-in one, by its name.
    Named(String),
    /// A language file (`NAME.toml`): any name that has an extension.
    File(ConfigPath),
}

impl<'de> Deserialize<'de> for SpokenLanguage {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let named = |text: &str| Path::new(text).extension().is_none().then(|| Self::Named(text.to_owned()));
        name_or_file(deserializer, named, Self::File)
    }
}

impl From<SpokenLanguage> for String {
    fn from(language: SpokenLanguage) -> Self {
        match language {
            SpokenLanguage::Named(name) => name,
            SpokenLanguage::File(path) => path.to_string_lossy().into_owned(),
        }
    }
}

/// The robot's voice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Speak {
    /// Whether the robot speaks.
    pub on: bool,
    /// In which language.
    pub language: SpokenLanguage,
    /// How much is said.
    pub verbosity: Verbosity,
    /// The command that gives a WAV of a text on its standard output: `{text}` and `{language}` are filled in; without
    /// `{text}` it is given the text on its standard input.
    pub voice: Vec<String>,
    /// The command that plays a WAV from its standard input.
    pub player: Vec<String>,
    /// What is said goes to this WAV file in place of the player; what is there already stays before it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<ConfigPath>,
    /// The command by which the supervisor lets a tone be heard when the voice is lost, as `player`, which it is where
    /// this is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tone_player: Option<Vec<String>>,
    /// A hold is told once it has lasted for so long.
    pub hold_after: Millis,
    /// And again every so often.
    pub remind: Millis,
}

impl Default for Speak {
    fn default() -> Self {
        let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect();
        Self {
            on: false,
            language: SpokenLanguage::Named("en".to_owned()),
            verbosity: Verbosity::Normal,
            voice: words(&["espeak-ng", "--stdout", "-v", "{language}", "-s", "180", "--", "{text}"]),
            player: words(&["aplay", "-q", "-"]),
            file: None,
            tone_player: None,
            hold_after: Millis::of_ms(600),
            remind: Millis::of_ms(10_000),
        }
    }
}

impl Speak {
    /// The command by which a tone is heard; none where nothing plays.
    #[must_use]
    pub fn tone_command(&self) -> Option<&[String]> {
        let player = self.tone_player.as_ref().or(self.file.is_none().then_some(&self.player));
        player.map(Vec::as_slice).filter(|words| !words.is_empty())
    }
}

/// What cannot be; the reason begins with the key.
pub(crate) fn check(speak: &Speak) -> Result<(), String> {
    for (key, words) in [("voice", &speak.voice), ("player", &speak.player)] {
        if words.first().is_none_or(|program| program.is_empty()) {
            return Err(format!("speak.{key} names no command"));
        }
    }
    for (key, value, from_ms, to_ms) in
        [("hold_after", speak.hold_after, 200, 5_000), ("remind", speak.remind, 2_000, 600_000)]
    {
        if !(from_ms * 1_000_000..=to_ms * 1_000_000).contains(&value.ns()) {
            return Err(format!("speak.{key} is not in {from_ms} to {to_ms} ms"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{Speak, check};

    #[test]
    fn who_plays_the_tone_is_the_player_unless_another_is_named() {
        let mut speak = Speak::default();
        assert_eq!(speak.tone_command(), Some(&speak.player[..]));
        speak.file = Some("said.wav".into());
        assert_eq!(speak.tone_command(), None);
        speak.tone_player = Some(vec!["beep".to_owned()]);
        assert_eq!(speak.tone_command(), Some(&["beep".to_owned()][..]));
        speak.tone_player = Some(Vec::new());
        assert_eq!(speak.tone_command(), None);
    }

    #[test]
    fn what_cannot_be_said_is_refused_with_its_key() {
        for (text, key) in [
            ("voice = []", "speak.voice"),
            ("player = [\"\"]", "speak.player"),
            ("hold_after = \"1ms\"", "speak.hold_after"),
            ("remind = \"1s\"", "speak.remind"),
        ] {
            let speak: Speak = toml::from_str(text).expect("each key by itself is right");
            assert!(check(&speak).expect_err(text).starts_with(key), "{text}");
        }
        assert!(toml::from_str::<Speak>("verbosity = \"loud\"").is_err_and(|error| error.to_string().contains("loud")));
        assert_eq!(check(&Speak::default()), Ok(()));
    }
}
