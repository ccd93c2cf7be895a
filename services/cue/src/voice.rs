//! The handler's voice: from a microphone, or what stands in its place, to cues.
//!
//! It is one way to give a cue among others. Without it, whatever the reason, the others go on and the operator is told
//! what is missing; no walk's safety depends on it.

mod confirmation;
mod repeated;
mod stream;
mod talk;

use std::path::{Path, PathBuf};

use grabber::microphone::{Microphone, Sound};
use grabber::{Grab, Grabbed, Grabber, Trouble};
use hearing::{Ears, ModelFiles, RATE_HZ, Recogniser, STEP_NS, Step};
use messages::{CueHeard, CueKind, MicrophoneState, NS_PER_S, SpeechPhase, SpeechSaid, Urgency};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use settings::{Attention, Settings, VoiceSettings, VoiceSource};
use transport::{FromChild, Io, Publisher, Subscriber, TransportError, monotonic_ns};

use confirmation::{Confirmation, Confirmed};
use repeated::Repeated;
use stream::Stream;
use talk::Talk;

/// Of [`Io::watch`].
const TOKEN_VOICE: u64 = 0;
const TOKEN_TALK: u64 = 1;
/// So many pieces of sound are heard at a waking: who catches up has beats to give as well, every 20 ms. A microphone
/// gives one in 20 ms, a file or pipe one of 80 ms.
const PIECES_MAX: usize = 3;
/// So long the service waits for enough sound to tell words, wall time, nanoseconds: 1.34 s of it, and what a source
/// takes to open.
const WARM_UP_LIMIT_NS: u64 = 2_500_000_000;
const WARM_UP_WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
/// How a note begins that tells why nothing is heard.
const UNHEARD: &str = "no voice is heard: ";
/// A sentence of the robot's own is heard for so long after its end: players have buffers, and rooms ring, nanoseconds.
const ECHO_NS: u64 = 300_000_000;
/// The end of a sentence that is not told by so long after its length will not be: its voice is gone. A player that
/// opens a device takes less, nanoseconds.
const PLAYER_LATE_NS: u64 = NS_PER_S;

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
    /// The robot stood by a stop.
    pub after_stop: bool,
}

/// Hears cues.
pub struct Voice {
    grabber: Grabber<Sound>,
    recogniser: Recogniser,
    robot: Subscriber<SpeechSaid>,
    /// Asks for the tone; none where none is wanted.
    asks: Option<Publisher<CueHeard>>,
    confirmation: Confirmation,
    /// A word that starts the robot has to be said twice.
    repeated: Option<Repeated>,
    /// The key that is held to speak.
    talk: Option<Talk>,
    is_open: bool,
    /// A network cannot be run: nothing is heard any more.
    is_deaf: bool,
    /// The robot itself spoke when the last of its sound came.
    is_muted: bool,
    /// The robot stands by a stop.
    stands: bool,
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
            manifest: voice.model.clone().map(PathBuf::from).unwrap_or_default(),
            embedding: voice.embedding.clone().map(PathBuf::from).unwrap_or_default(),
            onnx_runtime: settings.policy.onnx_runtime.clone().map(Into::into),
        };
        let recogniser = match Recogniser::load(&files) {
            Ok(recogniser) => recogniser.wanting_go(voice.attention == Attention::Go),
            Err(error) => {
                io.tell(&FromChild::Note { text: format!("{UNHEARD}{error}") });
                return Ok(None);
            }
        };
        let begun_ns = begun_ns(&io.domain.dir.path().join("voice.begun"));
        let asks = voice.tone && !voice.repeat;
        let grabber = Grabber::start(opener(voice, begun_ns)).map_err(TransportError::service)?;
        io.watch(&grabber, TOKEN_VOICE)?;
        let mut voice = Self {
            grabber,
            recogniser,
            robot: io.subscriber()?,
            asks: if asks { Some(io.publisher()?) } else { None },
            confirmation: Confirmation::default(),
            repeated: voice.repeat.then(Repeated::default),
            talk: voice.talk.as_ref().map(|talk| Talk::new(talk, TOKEN_TALK)),
            is_open: false,
            is_deaf: false,
            is_muted: false,
            stands: true,
            muted_until_ns: 0,
            steps: Vec::new(),
            told: String::new(),
        };
        voice.warm_up(io)?;
        Ok(Some(voice))
    }

    /// Hears enough to tell words before the service is ready: who is told "ready" may speak. A source that does not
    /// come keeps nobody waiting.
    fn warm_up(&mut self, io: &Io) -> Result<(), TransportError> {
        let by_ns = monotonic_ns() + WARM_UP_LIMIT_NS;
        while !self.recogniser.is_warm() && monotonic_ns() < by_ns {
            // An interrupted wait is a shorter one.
            let _ = poll(&mut [PollFd::new(&self.grabber, PollFlags::IN)], Some(&WARM_UP_WAIT));
            self.listen(io, &mut Vec::new())?;
            if self.told.starts_with(UNHEARD) {
                break;
            }
        }
        Ok(())
    }

    /// While the robot speaks, what is heard is not the handler.
    fn mute(&mut self) -> Result<(), TransportError> {
        while let Some(said) = self.robot.take()? {
            if said.urgency == Urgency::Tone {
                // It is no word, and whoever wants to stop what it announces has to be heard.
                self.confirmation.hear(&said);
                continue;
            }
            let for_ns = match said.phase {
                SpeechPhase::Begun => said.duration_ns.saturating_add(PLAYER_LATE_NS),
                SpeechPhase::Ended | SpeechPhase::Cut | SpeechPhase::Unheard => ECHO_NS,
            };
            self.muted_until_ns = said.header.stamp_ns.saturating_add(for_ns);
        }
        Ok(())
    }

    /// Whether the robot stands by a stop of whomever: *forward* has to be surer.
    pub fn stands(&mut self, is_stopped: bool) {
        self.stands = is_stopped;
        self.recogniser.stands(is_stopped);
    }

    /// Somebody else has given a cue, or the robot was stopped again: what was said before and waits for its sound's
    /// end, or for its tone, is over.
    pub fn interrupt(&mut self) {
        self.recogniser.forget();
        self.confirmation.forget();
        self.repeated.iter_mut().for_each(Repeated::forget);
    }

    /// Run time at which a tone is over, if one is waited for.
    pub fn next_ns(&self) -> Option<u64> {
        self.confirmation.next_ns()
    }

    /// How the microphone does.
    pub fn health(&self) -> messages::Microphone {
        let quality = self.recogniser.quality();
        let state = match self.recogniser.trouble() {
            _ if !self.is_open || self.is_deaf || self.grabber.is_stuck() => MicrophoneState::Lost,
            _ if self.is_muted => MicrophoneState::Muted,
            Some(hearing::Trouble::Dead) => MicrophoneState::Dead,
            Some(hearing::Trouble::Clipping) => MicrophoneState::Clipping,
            None if !self.recogniser.is_warm() => MicrophoneState::WarmingUp,
            None => MicrophoneState::Hearing,
        };
        messages::Microphone {
            state,
            level_dbfs: quality.level_dbfs,
            above_floor_db: self.recogniser.above_floor_db() as f32,
            clipped: quality.clipped,
        }
    }

    /// What was said since the last call.
    ///
    /// # Errors
    /// Where a port fails. What fails to hear is told, and costs nobody else his cues.
    pub fn listen(&mut self, io: &Io, said: &mut Vec<Said>) -> Result<(), TransportError> {
        self.mute()?;
        if let Some(text) = self.talk.as_mut().and_then(|talk| talk.take(io)) {
            io.tell(&FromChild::Note { text });
        }
        for _ in 0..PIECES_MAX {
            let Some(grabbed) = self.grabber.take() else { break };
            match grabbed {
                Grabbed::Opened(about) => {
                    self.is_open = true;
                    self.recogniser.clear();
                    self.tell(io, about);
                }
                Grabbed::Item(sound) if sound.samples.is_empty() => {
                    self.recogniser.clear();
                    self.tell(io, "some of the microphone's sound was lost: this process came too late".to_owned());
                }
                Grabbed::Item(sound) => self.hear(&sound, io, said),
                Grabbed::Lost(trouble) => {
                    self.is_open = false;
                    self.tell(io, format!("{UNHEARD}{trouble}"));
                }
            }
        }
        if self.grabber.is_stuck() {
            self.tell(io, format!("{UNHEARD}the microphone's library hangs; it is waited for"));
        }
        self.confirm(io, said)
    }

    /// What would start the robot waits for its tone, or to be said again; whatever else is said ends that.
    fn confirm(&mut self, io: &Io, said: &mut Vec<Said>) -> Result<(), TransportError> {
        if let Some(repeated) = &mut self.repeated {
            said.retain(|said| {
                let starts = said.after_stop && said.kind.is_moving();
                if !starts {
                    repeated.forget();
                }
                !starts || repeated.take(said)
            });
        }
        if let Some(asks) = &mut self.asks {
            let (confirmation, now_ns) = (&mut self.confirmation, io.now_ns());
            for said in said.iter() {
                confirmation.forget();
                if said.after_stop && said.kind.is_moving() {
                    asks.publish(
                        said.stamp_ns,
                        CueHeard { kind: said.kind, confidence: said.score, ..CueHeard::default() },
                    )?;
                    confirmation.ask(*said, now_ns);
                }
            }
            said.retain(|said| !(said.after_stop && said.kind.is_moving()));
        }
        match self.confirmation.due(io.now_ns()) {
            Some(Confirmed::Given(confirmed)) => said.push(confirmed),
            Some(Confirmed::Unheard(unheard)) => {
                let name = unheard.kind.name();
                let why = "the tone before it was not heard to its end in time ([speak] player, `guidedog doctor`)";
                let text = format!("\"{name}\" was said and is not given: {why}");
                io.tell(&FromChild::Note { text });
            }
            None => {}
        }
        Ok(())
    }

    fn hear(&mut self, sound: &Sound, io: &Io, said: &mut Vec<Said>) {
        if self.is_deaf {
            return;
        }
        let taken_ns = io.domain.clock.of_monotonic_ns(sound.taken_ns);
        // What the robot says as it stands may have "stop" in it; as it walks, nothing has.
        self.is_muted = taken_ns < self.muted_until_ns;
        let may_direct = self.talk.as_ref().is_none_or(|talk| talk.counts(taken_ns));
        let ears = match self.is_muted {
            false if may_direct => Ears::Open,
            false => Ears::OnlyStop,
            true if self.stands => Ears::Shut,
            true => Ears::ForStop,
        };
        let steps = &mut self.steps;
        if let Err(error) = self.recogniser.push(&sound.samples, ears, |step| steps.push(step)) {
            self.is_deaf = true;
            self.tell(io, format!("{UNHEARD}{error}"));
            return;
        }
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
                after_stop: heard.after_stop,
            });
        }
        match self.recogniser.trouble().filter(|_| !self.is_muted) {
            Some(trouble) => self.tell(io, trouble.text().to_owned()),
            None if self.told_trouble() => self.tell(io, "the microphone gives sound again".to_owned()),
            None => {}
        }
    }

    fn told_trouble(&self) -> bool {
        self.told.starts_with(UNHEARD) || hearing::Trouble::ALL.iter().any(|trouble| trouble.text() == self.told)
    }

    fn tell(&mut self, io: &Io, text: String) {
        if self.told != text {
            io.tell(&FromChild::Note { text: text.clone() });
            self.told = text;
        }
    }
}

/// When the first life of this service in the run began to listen, monotonic clock, nanoseconds: of a file, who died
/// hears no word twice.
fn begun_ns(path: &Path) -> u64 {
    let before = std::fs::read_to_string(path).ok().and_then(|text| text.trim().parse().ok());
    before.unwrap_or_else(|| {
        let now_ns = monotonic_ns();
        // Where it cannot be kept, a file begins anew with the next life.
        let _ = std::fs::write(path, now_ns.to_string());
        now_ns
    })
}

/// Opens what the settings name.
fn opener(
    voice: &VoiceSettings,
    begun_ns: u64,
) -> impl FnMut() -> Result<Box<dyn Grab<Item = Sound>>, Trouble> + Send + 'static {
    let voice = voice.clone();
    move || match voice.source {
        VoiceSource::Stream => {
            let path = voice.stream.as_deref().unwrap_or(Path::new(""));
            Ok(Box::new(Stream::open(path, begun_ns)?))
        }
        VoiceSource::Microphone | VoiceSource::Absent => Ok(Box::new(Microphone::open(&voice.microphone, RATE_HZ)?)),
    }
}
