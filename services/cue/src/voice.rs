//! The handler's voice: from a microphone, or what stands in its place, to cues.
//!
//! It is one way to give a cue among others. Without it, whatever the reason, the others go on and the operator is told
//! what is missing; no walk's safety depends on it.

mod stream;

use std::path::Path;

use grabber::microphone::{Microphone, Sound};
use grabber::{Grab, Grabbed, Grabber, Trouble};
use hearing::{ModelFiles, RATE_HZ, Recogniser, STEP_NS, Step};
use messages::{CueKind, NS_PER_S, SpeechPhase, SpeechSaid};
use settings::{Settings, VoiceSettings, VoiceSource};
use transport::{FromChild, Io, Subscriber, TransportError};

use stream::Stream;

/// Of [`Io::watch`].
const TOKEN_VOICE: u64 = 0;
/// So many pieces of sound are heard at a waking: who catches up has beats to give as well, every 20 ms. A microphone
/// gives one in 80 ms.
const PIECES_MAX: usize = 3;
/// A sentence of the robot's own is heard for so long after its end: players have buffers, and rooms ring, nanoseconds.
const ECHO_NS: u64 = 300_000_000;

/// A cue that was said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// Which.
    pub kind: CueKind,
    /// The head's score.
    pub score: f32,
    /// Run time at which it was sure of it, nanoseconds.
    pub stamp_ns: u64,
    /// How far it stood out, decibels.
    pub signal_db: f32,
    /// Share of the last second's samples that were cut off.
    pub clipped: f32,
}

/// Hears cues.
pub struct Voice {
    grabber: Grabber<Sound>,
    recogniser: Recogniser,
    robot: Subscriber<SpeechSaid>,
    /// The robot itself speaks until then, run time, nanoseconds: what is heard is not the handler.
    muted_until_ns: u64,
    steps: Vec<Step>,
    /// The last thing told, which is not told again.
    told: String,
}

impl Voice {
    /// Loads what is needed and starts to listen, where the settings say so; `None` where it cannot be, which is told.
    ///
    /// # Errors
    /// Where there can be no thread, or the topic of what the robot says cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Option<Self>, TransportError> {
        let voice = &settings.cue.voice;
        if voice.source == VoiceSource::Absent {
            return Ok(None);
        }
        let files = ModelFiles {
            manifest: voice.model.clone().unwrap_or_default(),
            embedding: voice.embedding.clone().unwrap_or_default(),
            onnx_runtime: settings.policy.onnx_runtime.clone(),
        };
        let recogniser = match Recogniser::load(&files) {
            Ok(recogniser) => recogniser,
            Err(error) => {
                io.tell(&FromChild::Note { text: format!("no voice is heard: {error}") });
                return Ok(None);
            }
        };
        let grabber = Grabber::start(opener(voice)).map_err(TransportError::service)?;
        io.watch(&grabber, TOKEN_VOICE)?;
        let robot = io.quiet_subscriber()?;
        Ok(Some(Self { grabber, recogniser, robot, muted_until_ns: 0, steps: Vec::new(), told: String::new() }))
    }

    /// While the robot speaks, what is heard is not the handler.
    fn mute(&mut self) -> Result<(), TransportError> {
        while let Some(said) = self.robot.take()? {
            let end_ns = match said.phase {
                SpeechPhase::Begun => said.first_sample_ns.max(said.header.stamp_ns).saturating_add(said.duration_ns),
                SpeechPhase::Ended | SpeechPhase::Cut | SpeechPhase::Unheard => said.header.stamp_ns,
            };
            self.muted_until_ns = end_ns.saturating_add(ECHO_NS);
        }
        Ok(())
    }

    /// The robot was stopped by whomever: *forward* has to be surer.
    pub fn stopped(&mut self) {
        self.recogniser.stopped();
    }

    /// What was said since the last call.
    ///
    /// # Errors
    /// Where the source's library hangs, or a network fails.
    pub fn listen(&mut self, io: &Io, said: &mut Vec<Said>) -> Result<(), TransportError> {
        self.mute()?;
        for _ in 0..PIECES_MAX {
            let Some(grabbed) = self.grabber.take() else { break };
            match grabbed {
                Grabbed::Opened(about) => {
                    self.recogniser.clear();
                    self.tell(io, about);
                }
                Grabbed::Item(sound) if sound.samples.is_empty() => {
                    self.recogniser.clear();
                    self.tell(io, "some of the microphone's sound was lost: this process came too late".to_owned());
                }
                Grabbed::Item(sound) => self.hear(&sound, io, said)?,
                Grabbed::Lost(trouble) => self.tell(io, format!("no voice is heard: {trouble}")),
            }
        }
        if self.grabber.is_stuck() {
            // Only a new process is rid of it.
            return Err(TransportError::Service("the microphone's library hangs".to_owned()));
        }
        Ok(())
    }

    fn hear(&mut self, sound: &Sound, io: &Io, said: &mut Vec<Said>) -> Result<(), TransportError> {
        let taken_ns = io.domain.clock.of_monotonic_ns(sound.taken_ns);
        let muted = taken_ns < self.muted_until_ns;
        let steps = &mut self.steps;
        self.recogniser.push(&sound.samples, muted, |step| steps.push(step)).map_err(TransportError::service)?;
        let (taken, quality) = (self.recogniser.taken(), self.recogniser.quality());
        for step in self.steps.drain(..) {
            let Some(heard) = step.heard else { continue };
            let after_ns = (taken - step.end) * NS_PER_S / u64::from(RATE_HZ) + heard.steps_ago * STEP_NS;
            said.push(Said {
                kind: heard.kind,
                score: heard.score,
                stamp_ns: taken_ns.saturating_sub(after_ns),
                signal_db: step.above_floor_db as f32,
                clipped: quality.clipped,
            });
        }
        match self.recogniser.trouble().filter(|_| !muted) {
            Some(trouble) => self.tell(io, trouble.text().to_owned()),
            None if self.told_trouble() => self.tell(io, "the microphone gives sound again".to_owned()),
            None => {}
        }
        Ok(())
    }

    fn told_trouble(&self) -> bool {
        hearing::Trouble::ALL.iter().any(|trouble| trouble.text() == self.told)
    }

    fn tell(&mut self, io: &Io, text: String) {
        if self.told != text {
            io.tell(&FromChild::Note { text: text.clone() });
            self.told = text;
        }
    }
}

/// Opens what the settings name; a file once, since it ends for good.
fn opener(voice: &VoiceSettings) -> impl FnMut() -> Result<Box<dyn Grab<Item = Sound>>, Trouble> + Send + 'static {
    let (voice, mut ended) = (voice.clone(), false);
    move || match voice.source {
        VoiceSource::Stream => {
            let path = voice.stream.as_deref().unwrap_or(Path::new(""));
            if ended {
                let fix = "no voice is heard from there any more";
                return Err(Trouble::new(format!("{}: it has ended", path.display()), fix));
            }
            let stream = Stream::open(path)?;
            ended = stream.is_file();
            Ok(Box::new(stream))
        }
        VoiceSource::Microphone | VoiceSource::Absent => Ok(Box::new(Microphone::open(&voice.microphone, RATE_HZ)?)),
    }
}
