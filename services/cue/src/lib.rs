//! The cue recogniser: the handler's voice, the operator's cues, those of a script, and the forward that follows a done
//! turn.
//!
//! It recognises; the supervisor alone accepts.

mod script;
mod voice;

use std::path::{Path, PathBuf};

use guidance::cue::CueTrack;
use guidance::se2::{Se2, pose2, se2};
use messages::{Cue, CueKind, CueRequest, CueSource, Health, Mode, ModeClass, Odometry, Pose2, WorldTruth};
use settings::{Settings, VoiceSource};
use transport::{FromChild, Io, Publisher, Service, Subscriber, TransportError};

pub use script::{Memory, Script, Situation};
use voice::{Said, Voice};

/// The service.
pub struct CueService {
    script: Script,
    voice: Option<Voice>,
    said: Vec<Said>,
    requests: Subscriber<CueRequest>,
    odometry: Subscriber<Odometry>,
    modes: Subscriber<Mode>,
    truths: Subscriber<WorldTruth>,
    cues: Publisher<Cue>,
    pose: Option<Odometry>,
    mode: Option<Mode>,
    truth: Option<WorldTruth>,
    /// The scripted handler's memory as last written, and where.
    remembered: Memory,
    memory_path: PathBuf,
    /// The turn in force, by (incarnation, seq) of its cue, and what has been walked since.
    turning: ((u32, u64), CueTrack),
    /// The turn for which "forward" was given already.
    turned: Option<(u32, u64)>,
}

impl CueService {
    /// Reads the route, if the settings name one.
    ///
    /// # Errors
    /// Where the route is wrong or a port cannot be opened.
    pub fn open(io: &mut Io) -> Result<Self, TransportError> {
        let settings = settings::load_resolved(&io.domain.dir.settings()).map_err(TransportError::service)?;
        let mut script = script_of(&settings)?;
        let memory_path = io.domain.dir.path().join("handler.json");
        let remembered = recall(&memory_path)?;
        script.recall(remembered);
        Ok(Self {
            script,
            voice: Voice::open(&settings, io)?,
            said: Vec::new(),
            remembered,
            memory_path,
            requests: io.subscriber()?,
            odometry: io.quiet_subscriber()?,
            modes: io.subscriber()?,
            truths: io.quiet_subscriber()?,
            cues: io.publisher()?,
            pose: None,
            mode: None,
            truth: None,
            turning: ((0, 0), CueTrack::default()),
            turned: None,
        })
    }

    /// Writes down what the scripted handler remembers: a handler does not forget when this process dies.
    fn remember(&mut self) -> Result<(), TransportError> {
        let memory = self.script.memory();
        if memory != self.remembered {
            let text = serde_json::to_string(&memory).map_err(TransportError::service)?;
            let beside = self.memory_path.with_extension("new");
            std::fs::write(&beside, text).map_err(TransportError::service)?;
            std::fs::rename(&beside, &self.memory_path).map_err(TransportError::service)?;
            self.remembered = memory;
        }
        Ok(())
    }

    fn take_inputs(&mut self) -> Result<(), TransportError> {
        if let Some(pose) = self.odometry.take_newest()? {
            self.pose = Some(pose);
        }
        if let Some(mode) = self.modes.take_newest()? {
            if self.mode.is_some_and(|before| before.epoch != mode.epoch) {
                self.interrupt_voice();
            }
            self.mode = Some(mode);
        }
        if let Some(truth) = self.truths.take_newest()? {
            self.truth = Some(truth);
        }
        Ok(())
    }

    /// What the voice has heard and not given yet is over.
    fn interrupt_voice(&mut self) {
        if let Some(voice) = &mut self.voice {
            voice.interrupt();
        }
    }

    fn give(&mut self, io: &Io, kind: CueKind, source: CueSource, request_seq: u64) -> Result<(), TransportError> {
        self.publish(io.now_ns(), Cue { kind, source, confidence: 1.0, request_seq, ..Cue::default() })
    }

    /// Gives a cue from where the robot is. Where nobody knows that yet, a stop needs no start frame, and a moving cue
    /// is one that the supervisor refuses and answers.
    fn publish(&mut self, stamp_ns: u64, cue: Cue) -> Result<(), TransportError> {
        let pose = self.pose.unwrap_or_default();
        self.publish_from(stamp_ns, &se2(pose.odom_from_robot), cue)
    }

    fn publish_from(&mut self, stamp_ns: u64, odom_from_start: &Se2, cue: Cue) -> Result<(), TransportError> {
        let odometry_incarnation = self.pose.map_or(0, |pose| pose.header.incarnation);
        let odom_from_start = pose2(odom_from_start);
        self.cues.publish(stamp_ns, Cue { odom_from_start, odometry_incarnation, ..cue }).map(|_| ())
    }

    /// Gives what the handler said.
    fn listen(&mut self, io: &Io) -> Result<(), TransportError> {
        let Some(voice) = &mut self.voice else { return Ok(()) };
        voice.stands(self.mode.is_none_or(|mode| mode.class != ModeClass::Run || !mode.cue.valid));
        voice.listen(io, &mut self.said)?;
        for said in std::mem::take(&mut self.said) {
            self.script.heard(said.kind);
            let Said { kind, score, stamp_ns, signal_db, clipped, after_stop: _ } = said;
            // Cues are in the order of their stamps, and a stop is older than none: another may have been given since
            // it was said.
            let stamp_ns = if kind.is_moving() { stamp_ns } else { io.now_ns() };
            let source = CueSource::Voice;
            self.publish(stamp_ns, Cue { kind, source, confidence: score, signal_db, clipped, ..Cue::default() })?;
        }
        Ok(())
    }

    /// The left or right in force, if one is.
    fn turn_in_force(&self) -> Option<Cue> {
        let mode = self.mode.as_ref().filter(|mode| mode.class == ModeClass::Run && mode.cue.valid)?;
        matches!(mode.cue.cue.kind, CueKind::Left | CueKind::Right).then_some(mode.cue.cue)
    }

    /// The turn in force, where it is done and "forward" has not been given for it: its number, and where forward
    /// begins.
    fn turn_done(&mut self) -> Option<(u64, Se2)> {
        let (turn, pose) = (self.turn_in_force()?, self.pose?);
        let id = (turn.header.incarnation, turn.header.seq);
        if self.turned == Some(id) || turn.odometry_incarnation != pose.header.incarnation {
            return None;
        }
        if self.turning.0 != id {
            self.turning = (id, CueTrack::default());
        }
        let (odom_from_start, track) = (se2(turn.odom_from_start), &mut self.turning.1);
        track.observe(&(odom_from_start.inverse() * se2(pose.odom_from_robot)));
        let odom_from_branch = odom_from_start * track.after_turn(turn.kind)?;
        self.turned = Some(id);
        Some((turn.header.seq, odom_from_branch))
    }
}

/// What the scripted handler remembers from before; nothing at the run's beginning.
fn recall(path: &Path) -> Result<Memory, TransportError> {
    match std::fs::read_to_string(path) {
        Ok(text) => serde_json::from_str(&text).map_err(TransportError::service),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Memory::default()),
        Err(error) => Err(TransportError::Service(format!("{}: {error}", path.display()))),
    }
}

fn script_of(settings: &Settings) -> Result<Script, TransportError> {
    if settings.cue.forward_when_ready {
        return Ok(Script::forward_when_ready());
    }
    if let Some(path) = &settings.cue.script {
        return world::Route::load(path).map(|route| Script::of(&route)).map_err(TransportError::service);
    }
    // Whose voice is heard gives the cues of the walk.
    let is_spoken = settings.cue.voice.source != VoiceSource::Absent;
    if !is_spoken && (settings.walk.scenario.is_some() || settings.walk.cues.is_some()) {
        let scenario = world::scenario_of(settings).map_err(TransportError::service)?;
        return Ok(Script::of(&scenario.route));
    }
    Ok(Script::silent())
}

impl Service for CueService {
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError> {
        while let Some(request) = self.requests.take()? {
            self.take_inputs()?;
            self.script.heard(request.kind);
            self.interrupt_voice();
            self.give(io, request.kind, CueSource::Operator, request.header.seq)?;
        }
        self.take_inputs()?;
        self.listen(io)?;
        if let Some((request_seq, odom_from_branch)) = self.turn_done() {
            let (kind, source) = (CueKind::Forward, CueSource::TurnDone);
            let cue = Cue { kind, source, confidence: 1.0, request_seq, ..Cue::default() };
            self.publish_from(io.now_ns(), &odom_from_branch, cue)?;
        }
        let situation = Situation {
            now_ns: io.now_ns(),
            world_from_robot: self.truth.map_or(Pose2::default(), |truth| truth.world_from_robot),
            mode: self.mode.as_ref(),
            pose_known: self.pose.is_some(),
        };
        if let Some((kind, source)) = self.script.due(&situation) {
            self.give(io, kind, source, 0)?;
        }
        if let Err(error) = self.remember() {
            // A full disk costs the handler's memory after a death of this process, not the process.
            io.tell(&FromChild::Note { text: format!("what the scripted handler wants is not kept: {error}") });
            self.remembered = self.script.memory();
        }
        Ok(())
    }

    fn next_timer_ns(&self) -> Option<u64> {
        let tone_ns = self.voice.as_ref().and_then(Voice::next_ns);
        [self.script.next_timer_ns(), tone_ns].into_iter().flatten().min()
    }

    fn fill_health(&self, health: &mut Health) {
        if let Some(voice) = &self.voice {
            health.microphone = voice.health();
        }
    }
}
