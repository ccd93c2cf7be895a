//! From text to sound, by a program of others that is never waited for. What is said again and again is prepared as the
//! service begins, and kept: a stop then needs no voice any more, only its sound.

use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

use transport::{Helper, Io, TransportError};

use crate::clip::Clip;

/// A voice that takes longer for a sentence hangs, nanoseconds.
const LIMIT_NS: u64 = 5_000_000_000;
/// After a failure nothing is prepared for so long, nanoseconds; what is wanted is tried all the same.
const PAUSE_NS: u64 = 10_000_000_000;
/// A sentence that takes more is none: a minute of it.
const WAV_MAX_BYTES: usize = 12 << 20;
/// Sound that is kept: half as much again as the sentences of a language take.
const KEPT_MAX_BYTES: usize = 24 << 20;

/// A text on its way to sound.
struct Job {
    helper: Helper,
    text: String,
    bytes: Vec<u8>,
    by_ns: u64,
}

/// What became of a text.
pub type Spoken = (String, Result<Rc<Clip>, String>);

/// The voice.
pub struct Voice {
    /// The command, the language filled in.
    words: Vec<String>,
    token: u64,
    kept: BTreeMap<String, Rc<Clip>>,
    kept_bytes: usize,
    to_prepare: VecDeque<String>,
    paused_until_ns: u64,
    job: Option<Job>,
    /// Those whose end was not seen yet.
    ending: Vec<Helper>,
}

impl Voice {
    /// A voice by that command, that prepares these texts in their order; its sound comes under that token.
    pub fn new(words: &[String], language: &str, texts: Vec<String>, token: u64) -> Self {
        Self {
            words: words.iter().map(|word| word.replace("{language}", language)).collect(),
            token,
            kept: BTreeMap::new(),
            kept_bytes: 0,
            to_prepare: texts.into(),
            paused_until_ns: 0,
            job: None,
            ending: Vec::new(),
        }
    }

    /// The sound of a text, where it is kept.
    pub fn kept(&self, text: &str) -> Option<Rc<Clip>> {
        self.kept.get(text).cloned()
    }

    /// Samples a second of what it gives; where it has given nothing yet, what espeak-ng does.
    pub fn rate_hz(&self) -> u32 {
        self.kept.values().next().map_or(22_050, |clip| clip.spec().sample_rate)
    }

    /// A text is wanted now: it goes before whatever is being prepared. Its sound comes out of [`Voice::read`], or of
    /// [`Voice::tick`] where it takes too long.
    ///
    /// # Errors
    /// Where no voice can be started; the reason says so.
    pub fn want(&mut self, text: &str, io: &Io) -> Result<(), String> {
        if self.job.as_ref().is_some_and(|job| job.text == text) {
            return Ok(());
        }
        if let Some(text) = self.give_up(io) {
            self.to_prepare.push_front(text);
        }
        self.begin(text, io).map(|_| ())
    }

    /// Takes what the voice has given: a text and its sound, once it is whole.
    pub fn read(&mut self, io: &Io) -> Option<Spoken> {
        let job = self.job.as_mut()?;
        let why = match job.helper.read(&mut job.bytes, WAV_MAX_BYTES) {
            Ok(_) if job.bytes.len() > WAV_MAX_BYTES => Some("it gives no end of sound".to_owned()),
            Ok(false) => return None,
            Ok(true) => None,
            Err(errno) => Some(errno.to_string()),
        };
        let parsed = why.map_or_else(|| Clip::parse(&job.bytes), Err);
        let sound = parsed.map_err(|why| format!("{}; {why}", job.helper.failure()));
        let text = self.give_up(io)?;
        Some((text.clone(), self.keep(text, sound, io)))
    }

    /// Time passes: prepares the next text, and gives up a voice that hangs.
    pub fn tick(&mut self, io: &Io) -> Option<Spoken> {
        self.ending.retain_mut(|helper| helper.ended().is_none());
        let now_ns = io.now_ns();
        if self.job.as_ref().is_some_and(|job| now_ns > job.by_ns) {
            let text = self.give_up(io)?;
            let why = format!("{}: no word in {} s", self.words[0], LIMIT_NS / 1_000_000_000);
            return Some((text.clone(), self.keep(text, Err(why), io)));
        }
        if self.job.is_none() && now_ns >= self.paused_until_ns {
            let text = self.to_prepare.pop_front()?;
            if self.kept.contains_key(&text) {
                return None;
            }
            match self.begin(&text, io) {
                Ok(job) => job.helper.do_not_hurry(),
                Err(why) => return Some((text.clone(), self.keep(text, Err(why), io))),
            }
        }
        None
    }

    /// Whether there is still something to prepare, and no reason to wait with it.
    pub fn is_busy(&self, now_ns: u64) -> bool {
        self.job.is_none() && !self.to_prepare.is_empty() && now_ns >= self.paused_until_ns
    }

    fn begin(&mut self, text: &str, io: &Io) -> Result<&Job, String> {
        let words: Vec<String> = self.words.iter().map(|word| word.replace("{text}", text)).collect();
        let by_stdin = !self.words.iter().any(|word| word.contains("{text}"));
        let line = if by_stdin { format!("{text}\n") } else { String::new() };
        let helper = Helper::start(&words, line.as_bytes(), true)?;
        if let Some(stdout) = helper.stdout() {
            io.watch(stdout, self.token).map_err(|error: TransportError| error.to_string())?;
        }
        let by_ns = io.now_ns() + LIMIT_NS;
        Ok(self.job.insert(Job { helper, text: text.to_owned(), bytes: Vec::new(), by_ns }))
    }

    /// Lets the voice go: the text that it was at.
    fn give_up(&mut self, io: &Io) -> Option<String> {
        let mut job = self.job.take()?;
        if let Some(stdout) = job.helper.stdout() {
            io.unwatch(stdout);
        }
        job.helper.kill();
        self.ending.push(job.helper);
        Some(job.text)
    }

    fn keep(&mut self, text: String, sound: Result<Clip, String>, io: &Io) -> Result<Rc<Clip>, String> {
        match sound {
            Ok(clip) => {
                let clip = Rc::new(clip);
                if self.kept_bytes + clip.bytes() <= KEPT_MAX_BYTES {
                    self.kept_bytes += clip.bytes();
                    self.kept.insert(text, Rc::clone(&clip));
                }
                Ok(clip)
            }
            Err(why) => {
                // It is tried again, after the others.
                if !self.to_prepare.contains(&text) {
                    self.to_prepare.push_back(text);
                }
                self.paused_until_ns = io.now_ns() + PAUSE_NS;
                Err(why)
            }
        }
    }
}
