//! What does not go together where the handler's voice is heard.

use crate::program::find_program;
use crate::recorded::CueOrigin;
use crate::sections::{CueSettings, EVDEV_KEYS, Settings, VoiceSource};

/// A voice needs a source. A run that plays recorded cues hears none.
///
/// # Errors
/// The reason begins with the key.
pub(super) fn check(cue: &CueSettings) -> Result<(), String> {
    let voice = &cue.voice;
    if voice.source == VoiceSource::Stream && voice.stream.is_none() {
        return Err("cue.voice.source = \"stream\" needs cue.voice.stream, a file or a pipe".to_owned());
    }
    if voice.source == VoiceSource::Microphone && voice.microphone.is_empty() {
        return Err("cue.voice.microphone is empty: `arecord -L` lists the names".to_owned());
    }
    if let Some(talk) = voice.talk.as_ref().filter(|talk| talk.key >= EVDEV_KEYS) {
        return Err(format!("cue.voice.talk.key = {} is not under {EVDEV_KEYS}: no key has such a number", talk.key));
    }
    if voice.source != VoiceSource::Absent && cue.source == CueOrigin::Replayed {
        return Err("cue.voice.source is not \"absent\", and cue.source = \"replayed\"".to_owned());
    }
    Ok(())
}

/// In a run somebody has to give the tone before a spoken cue starts the robot, where one is wanted. A configuration
/// alone may leave that open: `--voice` turns speaking on.
///
/// # Errors
/// Where nobody would.
pub fn check_tone(settings: &Settings) -> Result<(), String> {
    let voice = &settings.cue.voice;
    if voice.source != VoiceSource::Absent && voice.tone && !voice.repeat && !settings.speak.on {
        return Err("cue.voice.tone: the tone before a spoken cue starts the robot needs speak.on = true; or write \
                    cue.voice.repeat = true (the word is said twice), or cue.voice.tone = false (at once)"
            .to_owned());
    }
    Ok(())
}

/// Why no spoken cue would start a robot that stands by a stop, if so: its tone has no player on this machine.
#[must_use]
pub fn no_start_by_voice(settings: &Settings) -> Option<String> {
    let (voice, speak) = (&settings.cue.voice, &settings.speak);
    if voice.source == VoiceSource::Absent || !voice.tone || voice.repeat {
        return None;
    }
    let player = speak.tone_command()?.first()?;
    find_program(player).is_none().then(|| {
        format!(
            "no spoken cue will start the robot: its tone needs {player}, which is missing (apt: alsa-utils, or \
             [speak] player); with cue.voice.repeat = true the word is said twice in its place"
        )
    })
}
