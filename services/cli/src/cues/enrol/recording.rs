//! Asks for the clips, aloud and in writing, and cuts them out of the microphone's sound.

use std::time::{Duration, Instant};

use enrolment::{Take, Takes};
use grabber::microphone::Microphone;
use grabber::{Grab, Trouble};
use hearing::{RATE_HZ, Signal};
use settings::Settings;
use transport::Helper;

use super::folder::{Folder, clips_of};
use super::{CUES, OTHERS, TAKES, TAKES_OF_OTHERS};
use crate::exit::Failure;
use crate::out::say;

/// So long a word is waited for.
const WORD_LIMIT: Duration = Duration::from_secs(10);
/// A word that is not heard, or not well, is asked for so often.
const TRIES: usize = 4;
/// What asks aloud takes no longer.
const ALOUD_LIMIT: Duration = Duration::from_secs(6);
/// No sentence has more sound, bytes.
const WAV_MAX_BYTES: usize = 4 << 20;
/// The prompt's own sound rings for so long, and waits in buffers.
const ECHO: Duration = Duration::from_millis(300);

/// Records what is missing in the folder.
///
/// # Errors
/// Where the microphone cannot be used, or nothing is heard; what was recorded stays, and is gone on with.
pub fn record(settings: &Settings, folder: &Folder, quiet: bool) -> Result<(), Failure> {
    // Whether it is there is told before anybody is asked to speak.
    let mut listener = Listener::open(&settings.cue.voice.microphone)?;
    let mut aloud = Aloud::new(settings, quiet);
    let there = |word: &str| clips_of(&folder.new_clips(), word).map_or(0, |clips| clips.len());
    let kept: usize = asked().map(|(word, _)| there(word)).sum();
    if kept > 0 {
        say(format!("{kept} clips are there already, from before: going on"));
    }
    aloud.ask("Say each word after me, as you would on the way.");
    for take in 1..=TAKES {
        for (word, takes) in asked() {
            if take > takes || clips_of(&folder.new_clips(), word)?.len() >= take {
                continue;
            }
            say(format!("say \"{word}\" ({take} of {takes})"));
            let samples = one(word, &mut aloud, &mut listener)?;
            folder.put_clip(word, take, &samples)?;
        }
    }
    aloud.ask("Thank you.");
    Ok(())
}

/// Words that are asked for, and how often each.
fn asked() -> impl Iterator<Item = (&'static str, usize)> {
    CUES.into_iter().map(|cue| (cue, TAKES)).chain(OTHERS.into_iter().map(|word| (word, TAKES_OF_OTHERS)))
}

/// One clip, asked for until it is good.
fn one(word: &str, aloud: &mut Aloud, listener: &mut Listener) -> Result<Vec<f32>, Failure> {
    let mut why = String::new();
    for _ in 0..TRIES {
        if aloud.ask(word) {
            // The prompt itself was heard, too.
            listener.forget()?;
        }
        match listener.word()? {
            Ok(Ok(samples)) => return Ok(samples),
            Ok(Err(rejected)) => why = rejected.to_string(),
            Err(silence) => why = silence,
        }
        say(format!("  {why}; once more"));
        aloud.ask("Once more.");
    }
    Err(Failure::run(format!("{why}, {TRIES} times; what was recorded is kept, and the same command goes on with it")))
}

/// The microphone, and the words in its sound.
struct Listener {
    microphone: Microphone,
    takes: Takes,
}

impl Listener {
    fn open(name: &str) -> Result<Self, Failure> {
        let microphone = Microphone::open(name, RATE_HZ).map_err(lost)?;
        say(microphone.about());
        Ok(Self { microphone, takes: Takes::default() })
    }

    /// Throws away what was heard until now.
    fn forget(&mut self) -> Result<(), Failure> {
        let begun = Instant::now();
        while begun.elapsed() < ECHO {
            let _ = self.microphone.grab().map_err(lost)?;
        }
        self.takes.forget();
        Ok(())
    }

    /// The next word, or why there is none.
    fn word(&mut self) -> Result<Result<Take, String>, Failure> {
        let (mut signal, begun) = (Signal::default(), Instant::now());
        while begun.elapsed() < WORD_LIMIT {
            let Some(sound) = self.microphone.grab().map_err(lost)? else { continue };
            if sound.samples.is_empty() {
                self.takes.forget();
            }
            signal.take(&sound.samples);
            if let Some(trouble) = signal.trouble() {
                return Ok(Err(trouble.text().to_owned()));
            }
            if let Some(take) = self.takes.push(&sound.samples) {
                return Ok(Ok(take));
            }
        }
        let (waited_s, level_dbfs) = (WORD_LIMIT.as_secs(), signal.quality().level_dbfs);
        Ok(Err(format!("no word was heard in {waited_s} s, the last second at {level_dbfs:.0} dBFS")))
    }
}

fn lost(trouble: Trouble) -> Failure {
    Failure::run(trouble.to_string())
}

/// Who is enrolled may not see: what is asked is asked aloud, where there is a voice.
struct Aloud {
    voice: Vec<String>,
    player: Vec<String>,
    on: bool,
}

impl Aloud {
    fn new(settings: &Settings, quiet: bool) -> Self {
        // The words are English whatever the robot speaks.
        let voice = settings.speak.voice.iter().map(|word| word.replace("{language}", "en")).collect();
        Self { voice, player: settings.speak.player.clone(), on: !quiet }
    }

    /// Whether it was heard.
    fn ask(&mut self, text: &str) -> bool {
        if !self.on {
            return false;
        }
        let words: Vec<String> = self.voice.iter().map(|word| word.replace("{text}", text)).collect();
        let heard = run(&words, format!("{text}\n").as_bytes(), true).and_then(|wav| run(&self.player, &wav, false));
        if let Err(why) = heard {
            say(format!("nothing is asked aloud: {why}"));
            self.on = false;
        }
        self.on
    }
}

/// Runs a program of others to its end: what it gave.
fn run(words: &[String], input: &[u8], gives: bool) -> Result<Vec<u8>, String> {
    let mut helper = Helper::start(words, input, gives)?;
    let (begun, mut given) = (Instant::now(), Vec::new());
    loop {
        let ended = helper.ended();
        helper.read(&mut given, WAV_MAX_BYTES).map_err(|errno| format!("{}: {errno}", words.join(" ")))?;
        match ended {
            Some(status) if status.success() => return Ok(given),
            Some(_) => return Err(helper.failure()),
            None if begun.elapsed() > ALOUD_LIMIT => return Err(format!("{}: it takes too long", words.join(" "))),
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}
