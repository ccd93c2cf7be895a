//! The texts of a language, from its file.

use std::collections::BTreeMap;

use messages::{ServiceId, SpeechText};
use serde::Deserialize;
use settings::SpokenLanguage;

use crate::sentence::{Sentence, Topic};

/// A sentence of more words keeps whoever walks from listening to the way.
pub const MAX_WORDS: usize = 8;
/// Where the name of a part goes.
const PART: &str = "{part}";
/// Longest file that is read.
const MAX_FILE_BYTES: u64 = 1 << 18;

/// The languages that are built in.
const BUILT_IN: [(&str, &str); 2] = [
    ("en", include_str!("../../../config/languages/en.toml")),
    ("de", include_str!("../../../config/languages/de.toml")),
];

/// Why a language cannot be spoken. Always the author of the file named is to mend it.
#[derive(Debug, thiserror::Error)]
pub enum LanguageError {
    /// There is none of that name.
    #[error("no language \"{name}\" is built in ({known}); a file of your own is named with its .toml")]
    Unknown {
        /// The name.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// The file cannot be read.
    #[error("failed to read {file}: {reason}")]
    Read {
        /// The file.
        file: String,
        /// The system's word.
        reason: String,
    },
    /// It is no language file, or a key is missing, unknown or wrong.
    #[error("{file}: {reason}")]
    Wrong {
        /// The file.
        file: String,
        /// Which key, and what is wrong with it.
        reason: String,
    },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    voice: String,
    stops: BTreeMap<String, String>,
    refusals: BTreeMap<String, String>,
    cues: BTreeMap<String, String>,
    news: BTreeMap<String, String>,
    parts: BTreeMap<String, String>,
}

/// A language: a text for every sentence.
#[derive(Debug, Clone)]
pub struct Language {
    voice: String,
    texts: Vec<(Topic, String)>,
    parts: Vec<(ServiceId, String)>,
}

impl Language {
    /// The language of that name, or of that file.
    ///
    /// # Errors
    /// Where there is none, or its file lacks a text, has one of nothing, or one that is too long.
    pub fn load(language: &SpokenLanguage) -> Result<Self, LanguageError> {
        let unknown = |name: String| {
            let known = BUILT_IN.map(|(name, _)| name).join(", ");
            LanguageError::Unknown { name, known }
        };
        let path = match language {
            SpokenLanguage::Named(name) => {
                let text = BUILT_IN.iter().find(|(built_in, _)| built_in == name).map(|(_, text)| text);
                return Self::parse(name, text.ok_or_else(|| unknown(name.clone()))?);
            }
            SpokenLanguage::File(path) => path,
        };
        let file = path.display().to_string();
        if path.extension().is_none_or(|extension| extension != "toml") {
            return Err(unknown(file));
        }
        let fail = |reason: String| LanguageError::Read { file: file.clone(), reason };
        let found = std::fs::metadata(path).map_err(|error| fail(error.to_string()))?;
        // Before it is opened: opening a pipe would wait for its writer.
        if !found.is_file() || found.len() > MAX_FILE_BYTES {
            return Err(fail("it is no language file".to_owned()));
        }
        Self::parse(&file, &std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?)
    }

    /// English, which is built in.
    ///
    /// # Errors
    /// As [`Language::load`].
    pub fn english() -> Result<Self, LanguageError> {
        Self::load(&SpokenLanguage::Named("en".to_owned()))
    }

    /// The language in `text`, which is called `file` in errors.
    ///
    /// # Errors
    /// As [`Language::load`].
    pub fn parse(file: &str, text: &str) -> Result<Self, LanguageError> {
        let wrong = |reason: String| LanguageError::Wrong { file: file.to_owned(), reason };
        let mut read: File = toml::from_str(text).map_err(|error| wrong(error.to_string()))?;
        if read.voice.trim().is_empty() || read.voice.contains(char::is_control) {
            return Err(wrong("voice is empty, or no text".to_owned()));
        }
        let mut parts = Vec::new();
        for part in ServiceId::ALL {
            parts.push((part, taken(&mut read.parts, "parts", part.name()).map_err(wrong)?));
        }
        let mut texts = Vec::new();
        for topic in Sentence::topics() {
            let (table, key) = topic.key();
            let from = match topic {
                Topic::Stop(_) => &mut read.stops,
                Topic::Refusal(_) => &mut read.refusals,
                Topic::Cue(_) => &mut read.cues,
                Topic::News(_) => &mut read.news,
                Topic::Tone => continue,
            };
            let text = taken(from, table, key).map_err(wrong)?;
            let is_about_a_part = matches!(topic, Topic::Stop(_) | Topic::Refusal(_));
            if text.replace(PART, "").contains(['{', '}']) || (text.contains(PART) && !is_about_a_part) {
                return Err(wrong(format!("{table}.{key}: only a stop or a refusal has a place to fill: {PART}")));
            }
            texts.push((topic, text));
        }
        for (table, left) in [
            ("stops", read.stops),
            ("refusals", read.refusals),
            ("cues", read.cues),
            ("news", read.news),
            ("parts", read.parts),
        ] {
            if let Some(key) = left.keys().next() {
                return Err(wrong(format!("{table}.{key} is no sentence that is known")));
            }
        }
        let language = Self { voice: read.voice, texts, parts };
        language.check().map_err(wrong)?;
        Ok(language)
    }

    /// Every text with every part is short enough.
    fn check(&self) -> Result<(), String> {
        for topic in Sentence::topics() {
            for part in ServiceId::ALL {
                let (text, (table, key)) = (self.text(&Sentence { topic, part }), topic.key());
                let words = text.split_whitespace().count();
                if words > MAX_WORDS || text.len() > SpeechText::MAX_BYTES {
                    return Err(format!(
                        "{table}.{key} is too long, {words} words with parts.{part}: a sentence has {MAX_WORDS} words \
                         and {} bytes at most",
                        SpeechText::MAX_BYTES
                    ));
                }
            }
        }
        Ok(())
    }

    /// What the voice calls the language.
    #[must_use]
    pub fn voice(&self) -> &str {
        &self.voice
    }

    /// The text of a sentence.
    #[must_use]
    pub fn text(&self, sentence: &Sentence) -> String {
        let wordless = sentence.topic.key().1;
        let text = self.texts.iter().find(|(topic, _)| *topic == sentence.topic).map_or(wordless, |(_, text)| text);
        // A reason that should name a part and does not is told all the same: as the robot's own.
        let part = self.parts.iter().find(|(part, _)| *part == sentence.part).or(self.parts.first());
        text.replace(PART, part.map_or("", |(_, name)| name))
    }

    /// Every text that may be needed in a run with these parts, each once: those first that are about none or the first
    /// part, and of these the stops.
    #[must_use]
    pub fn texts(&self, parts: &[ServiceId]) -> Vec<String> {
        let mut all: Vec<String> = Vec::new();
        for part in parts {
            for topic in Sentence::topics() {
                let text = self.text(&Sentence { topic, part: *part });
                if !all.contains(&text) {
                    all.push(text);
                }
            }
        }
        all
    }
}

/// Takes the text of a key out of its table.
fn taken(table: &mut BTreeMap<String, String>, name: &str, key: &str) -> Result<String, String> {
    let text = table.remove(key).ok_or_else(|| format!("{name}.{key} is missing"))?;
    if text.trim().is_empty() || text.chars().any(char::is_control) {
        return Err(format!("{name}.{key} is empty, or no single line of text"));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::{BUILT_IN, Language, SpokenLanguage};
    use crate::sentence::Sentence;
    use messages::stops::STOPS;
    use messages::{CueRefusal, ServiceId, StopKind, StopReason, TopicId};

    /// `parse` refuses what lacks a text, has an unknown key, or is too long.
    #[test]
    fn every_reason_has_a_short_text_in_every_language() {
        for (name, text) in BUILT_IN {
            let language = Language::parse(name, text).expect("complete");
            for info in STOPS {
                let reason = StopReason::service(info.kind, ServiceId::Lidar, 1);
                assert!(!language.text(&Sentence::stop(&reason)).is_empty(), "{name}: {}", info.kind.name());
            }
            for refusal in CueRefusal::ALL {
                let text = language.text(&Sentence::refusal(refusal, &StopReason::default()));
                assert!(!text.is_empty() && !text.contains('{'), "{name}: {}", refusal.name());
            }
        }
    }

    #[test]
    fn a_stop_names_its_part_or_who_gives_the_stream() {
        let english = Language::english().expect("built in");
        let lost = StopReason::service(StopKind::ServiceDied, ServiceId::Lidar, 2);
        assert_eq!(english.text(&Sentence::stop(&lost)), "Stopped: lidar lost, restarting.");
        let stale = StopReason::stream(StopKind::StreamStale, TopicId::DepthFrame, 1, 1);
        assert_eq!(english.text(&Sentence::stop(&stale)), "Stopped: no camera signal.");
    }

    #[test]
    fn each_text_is_prepared_once_and_stops_come_first() {
        let texts = Language::english().expect("built in").texts(&[ServiceId::Lidar, ServiceId::Depth]);
        let at = |text: &str| texts.iter().position(|other| other == text).expect(text);
        assert!(at("Emergency stop.") < at("Not now: I am locked."));
        assert!(at("Forward.") < at("Stopped: camera lost, restarting."));
        assert_eq!(texts.iter().filter(|text| *text == "Standing.").count(), 1);
    }

    #[test]
    fn what_is_wrong_with_a_file_is_told_with_file_and_key() {
        let (_, english) = BUILT_IN[0];
        let long = "boot = \"one two three four five six seven eight nine\"";
        for (text, what) in [
            (english.replace("emergency_stop = \"Emergency stop.\"\n", ""), "stops.emergency_stop is missing"),
            (english.replace("[news]", "[news]\nhello = \"Hello.\""), "news.hello is no sentence"),
            (english.replace("ready = \"Ready.\"", "ready = \" \""), "news.ready is empty"),
            (english.replace("ready = \"Ready.\"", "ready = \"{part}.\""), "news.ready: only a stop"),
            (english.replace("boot = \"Starting.\"", "boot = \"{lidar}\""), "stops.boot: only a stop"),
            (english.replace("boot = \"Starting.\"", long), "stops.boot is too long, 9 words"),
            (english.replace("brake = \"brake\"\n", ""), "parts.brake is missing"),
            (english.replace("voice = \"en\"", "voices = 1"), "line"),
            (english.replace("voice = \"en\"", "voice = \"\""), "voice is empty"),
            ("no toml".to_owned(), "line 1"),
        ] {
            let error = Language::parse("my.toml", &text).expect_err(what).to_string();
            assert!(error.starts_with("my.toml: ") && error.contains(what), "{error}");
        }
        let why = |language| Language::load(&language).expect_err("it is refused").to_string();
        let error = why(SpokenLanguage::Named("klingon".to_owned()));
        assert!(error.contains("\"klingon\"") && error.contains("en, de"), "{error}");
        let error = why(SpokenLanguage::File("nowhere.toml".into()));
        assert!(error.contains("failed to read nowhere.toml"), "{error}");
    }
}
