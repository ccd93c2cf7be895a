//! The robot's voice: tells the handler aloud what the robot does, and why it stands.
//!
//! Duties: every stop with its reason within a second, system faults included; refused and accepted cues, "ready", the
//! battery, the goal, and a tone before a spoken cue that starts the robot; publishes each text as it is said. Motion
//! needs it not (but where a voice starts it): it outlives what it tells of, and nobody
//! waits for it. It must never wait for a voice or a player, which are programs of others. `speech` decides what is
//! said; this file is the thin shell between that, the voice and the output.
//!
//! Where the supervisor dies, it says so before it ends: nobody else could.
//!
//! In stepped time it does not run: that goes as fast as the machine lets it, and a sentence takes as long as it takes.

mod clip;
mod output;
mod voice;

use std::collections::BTreeSet;
use std::rc::Rc;

use messages::{
    CueAnswer, CueHeard, Health, Latency, LatencyHistogram, LocomotionState, Mode, Odometry, Permit, SERVICES,
    ServiceId, SpeechPhase, SpeechSaid, StopKind, StopReason, Urgency,
};
use settings::Settings;
use speech::{Language, Sentence, Speaker, SpeakerConfig, Tone, Utterance};
use transport::{FromChild, Io, Publisher, Service, Subscriber, TransportError};

use clip::Clip;
use output::{Output, Progress};
use voice::{Spoken, Voice};

/// The shallowest queue that does not wake its reader holds 80 ms of odometry.
const PERIOD_NS: u64 = 40_000_000;
/// A sentence that has no sound after so long is not heard: what it tells of is long over, nanoseconds.
const SOUND_LIMIT_NS: u64 = 3_000_000_000;
/// The last word, after the supervisor's death, takes no longer, nanoseconds.
const LAST_WORD_LIMIT_NS: u64 = 3_000_000_000;
/// So many different troubles are told.
const TROUBLES_TOLD: usize = 20;
const TOKEN_VOICE: u64 = 0;

/// The sentence that is being said.
struct Current {
    utterance: Utterance,
    said: SpeechSaid,
    text: String,
    /// Run time at which it was to be said, nanoseconds.
    wanted_ns: u64,
}

/// The service.
pub struct Speak {
    speaker: Speaker,
    language: Language,
    voice: Voice,
    output: Box<dyn Output>,
    modes: Subscriber<Mode>,
    answers: Subscriber<CueAnswer>,
    heard: Subscriber<CueHeard>,
    states: Subscriber<LocomotionState>,
    permits: Subscriber<Permit>,
    odometry: Subscriber<Odometry>,
    said: Publisher<SpeechSaid>,
    current: Option<Current>,
    number: u64,
    latency: LatencyHistogram,
    troubles: BTreeSet<String>,
    next_ns: u64,
    /// Once the supervisor is gone: run time by which the process ends.
    ends_by_ns: Option<u64>,
    is_done: bool,
}

impl Speak {
    /// A voice as the settings name it; nothing is said yet.
    ///
    /// # Errors
    /// Where a port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let language = language_of(&settings, io)?;
        // What stops the robot when it is lost is put into words before it is needed.
        let parts: Vec<ServiceId> =
            SERVICES.iter().filter(|service| service.watched_by.is_some()).map(|service| service.id).collect();
        let texts = language.texts(&parts);
        let latency = LatencyHistogram { what: Latency::StopToSpeech, ..LatencyHistogram::default() };
        Ok(Self {
            speaker: Speaker::new(SpeakerConfig::of(&settings)),
            voice: Voice::new(&settings.speak.voice, language.voice(), texts, TOKEN_VOICE),
            language,
            output: output::of(&settings.speak),
            modes: io.subscriber()?,
            answers: io.subscriber()?,
            heard: io.subscriber()?,
            states: io.quiet_subscriber()?,
            permits: io.quiet_subscriber()?,
            odometry: io.quiet_subscriber()?,
            said: io.publisher()?,
            current: None,
            number: 0,
            latency,
            troubles: BTreeSet::new(),
            next_ns: 0,
            ends_by_ns: None,
            is_done: false,
        })
    }

    fn take_inputs(&mut self, now_ns: u64) -> Result<(), TransportError> {
        while let Some(mode) = self.modes.take()? {
            self.speaker.mode(&mode, now_ns);
        }
        while let Some(answer) = self.answers.take()? {
            self.speaker.answer(&answer, now_ns);
        }
        while let Some(heard) = self.heard.take()? {
            self.speaker.heard(&heard, now_ns);
        }
        while let Some(permit) = self.permits.take()? {
            self.speaker.permit(&permit, now_ns);
        }
        while let Some(odometry) = self.odometry.take()? {
            self.speaker.odometry(&odometry);
        }
        while let Some(state) = self.states.take()? {
            self.speaker.state(&state, now_ns);
        }
        Ok(())
    }

    /// Says what is to be said now, if anything.
    fn say_next(&mut self, io: &Io) -> Result<(), TransportError> {
        while let Some(utterance) = self.speaker.next(io.now_ns()) {
            self.end(SpeechPhase::Cut, io)?;
            self.begin(&utterance, io);
            self.give_sound(io)?;
            if self.current.is_some() {
                break;
            }
        }
        Ok(())
    }

    fn begin(&mut self, utterance: &Utterance, io: &Io) {
        let text = self.language.text(&utterance.sentence);
        self.number += 1;
        let said = SpeechSaid {
            urgency: utterance.urgency,
            number: self.number,
            about_ns: utterance.about_ns,
            reason: utterance.reason,
            text: text.as_str().into(),
            ..SpeechSaid::default()
        };
        self.current = Some(Current { utterance: *utterance, said, text, wanted_ns: io.now_ns() });
    }

    /// Lets the sentence be heard, where its sound is kept; else the voice is to give it.
    fn give_sound(&mut self, io: &Io) -> Result<(), TransportError> {
        let Some(text) = self.current.as_ref().map(|current| current.text.clone()) else { return Ok(()) };
        if self.current.as_ref().is_some_and(|current| current.said.urgency == Urgency::Tone) {
            let clip = Rc::new(Clip::tone(&Tone::BEFORE_MOTION, self.voice.rate_hz()));
            return self.play(&clip, io);
        }
        match self.voice.kept(&text) {
            Some(clip) => self.play(&clip, io),
            None => self.voice.want(&text, io).or_else(|why| self.fail(&why, io)),
        }
    }

    /// Lets the sentence be heard.
    fn play(&mut self, clip: &Rc<Clip>, io: &Io) -> Result<(), TransportError> {
        if let Err(why) = self.output.start(clip, io.now_ns()) {
            return self.fail(&why, io);
        }
        let Some(current) = &mut self.current else { return Ok(()) };
        let now_ns = io.now_ns();
        (current.said.first_sample_ns, current.said.duration_ns) = (now_ns, clip.duration_ns());
        if matches!(current.said.urgency, Urgency::Hold | Urgency::Stop) {
            self.latency.record(now_ns.saturating_sub(current.said.about_ns));
        }
        self.said.publish(now_ns, current.said).map(|_| ())
    }

    /// The sentence is no longer said; where it was not begun yet, nobody hears of it but as of one that is not heard.
    fn end(&mut self, phase: SpeechPhase, io: &Io) -> Result<(), TransportError> {
        let Some(current) = self.current.take() else { return Ok(()) };
        self.output.cut();
        let was_begun = current.said.first_sample_ns > 0;
        let phase = if was_begun { phase } else { SpeechPhase::Unheard };
        self.said.publish(io.now_ns(), SpeechSaid { phase, ..current.said }).map(|_| ())
    }

    /// The sentence cannot be heard; its text is published all the same.
    fn fail(&mut self, why: &str, io: &Io) -> Result<(), TransportError> {
        self.tell_trouble(why, io);
        match &self.current {
            Some(current) => self.speaker.unheard(&current.utterance, io.now_ns()),
            None => self.speaker.finished(),
        }
        self.end(SpeechPhase::Unheard, io)
    }

    fn tell_trouble(&mut self, why: &str, io: &Io) {
        if self.troubles.len() < TROUBLES_TOLD && self.troubles.insert(why.to_owned()) {
            io.tell(&FromChild::Note { text: with_advice(why) });
        }
    }

    /// A text has its sound, or has none.
    fn take_sound(&mut self, (text, sound): Spoken, io: &Io) -> Result<(), TransportError> {
        let is_waited_for = self.current.as_ref().is_some_and(|c| c.text == text && c.said.first_sample_ns == 0);
        match sound {
            Ok(clip) if is_waited_for => self.play(&clip, io),
            Ok(_) => Ok(()),
            Err(why) if is_waited_for => self.fail(&why, io),
            Err(why) => {
                self.tell_trouble(&why, io);
                Ok(())
            }
        }
    }

    /// What is being said goes on, or comes to its end.
    fn go_on(&mut self, io: &Io) -> Result<(), TransportError> {
        let Some(current) = &self.current else {
            // A player that was cut short is seen to its end.
            self.output.tick(io.now_ns());
            return Ok(());
        };
        if current.said.first_sample_ns == 0 {
            let is_late = io.now_ns().saturating_sub(current.wanted_ns) > SOUND_LIMIT_NS;
            return if is_late { self.fail("the voice is too slow", io) } else { Ok(()) };
        }
        match self.output.tick(io.now_ns()) {
            Progress::Going => Ok(()),
            Progress::Done => {
                self.speaker.finished();
                self.end(SpeechPhase::Ended, io)
            }
            Progress::Failed(why) => self.fail(&why, io),
        }
    }
}

/// The language that the settings name. One that went wrong since the run began keeps nobody silent.
fn language_of(settings: &Settings, io: &Io) -> Result<Language, TransportError> {
    Language::load(&settings.speak.language).or_else(|error| {
        io.tell(&FromChild::Note { text: format!("{error}; English is spoken") });
        Language::english().map_err(TransportError::service)
    })
}

/// A trouble, and what to do about it where that is not plain.
fn with_advice(why: &str) -> String {
    match why.strip_suffix(" is not there") {
        Some("espeak-ng") => format!("{why}, and nothing is heard: apt-get install espeak-ng, or [speak] voice"),
        Some("aplay") => format!("{why}, and nothing is heard: apt-get install alsa-utils, or [speak] player"),
        Some(_) => format!("{why}, and nothing is heard: install it, or name another in [speak]"),
        None => format!("not heard: {why}"),
    }
}

impl Service for Speak {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        if let Some(by_ns) = self.ends_by_ns {
            self.next_ns = io.now_ns() + PERIOD_NS;
            self.go_on(io)?;
            self.is_done = self.current.is_none() || io.now_ns() > by_ns;
            return Ok(());
        }
        self.take_inputs(io.now_ns())?;
        self.go_on(io)?;
        self.say_next(io)?;
        if let Some(spoken) = self.voice.tick(io) {
            self.take_sound(spoken, io)?;
        }
        let now_ns = io.now_ns();
        self.next_ns = if self.voice.is_busy(now_ns) { now_ns } else { now_ns + PERIOD_NS };
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.next_ns)
    }

    fn on_fd(&mut self, io: &mut Io, _token: u64) -> Result<(), TransportError> {
        match self.voice.read(io) {
            Some(spoken) => self.take_sound(spoken, io),
            None => Ok(()),
        }
    }

    fn on_supervisor_lost(&mut self, io: &mut Io) -> bool {
        let reason = StopReason::of(StopKind::SupervisorLost);
        let (sentence, urgency, about_ns) = (Sentence::stop(&reason), Urgency::Stop, io.now_ns());
        self.ends_by_ns = Some(about_ns + LAST_WORD_LIMIT_NS);
        let ended = self.end(SpeechPhase::Cut, io);
        self.begin(&Utterance { sentence, urgency, about_ns, reason }, io);
        // Who has nothing to say it with goes at once, and so does who cannot even publish.
        ended.and_then(|()| self.give_sound(io)).is_err() || self.current.is_none()
    }

    fn is_done(&self) -> bool {
        self.is_done
    }

    fn fill_health(&self, health: &mut Health) {
        health.latencies[0] = self.latency;
    }
}
