//! How a run is: the answer to `status`.

use std::collections::BTreeMap;
use std::fmt;

use messages::{CueKind, CueSource, MicrophoneState, ModeClass, ServiceId, SpeechPhase, TopicId, Urgency};
use serde::{Deserialize, Serialize};

use crate::number;

/// How a run is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The run's name.
    pub run: String,
    /// Process id of the supervisor.
    pub supervisor_pid: u32,
    /// Run time, seconds.
    pub now_s: f64,
    /// Whether the robot may move, and why not.
    pub mode: ModeStatus,
    /// The services in the order of their start; of two policies the one in force is first.
    pub services: Vec<ServiceStatus>,
    /// How old the newest message of a watched stream is, milliseconds, by topic.
    pub stream_age_ms: BTreeMap<String, f64>,
    /// Messages published so far, by topic.
    pub published: BTreeMap<String, u64>,
    /// What is true in a simulated or replayed world.
    pub world: Option<WorldStatus>,
    /// Where roll, pitch and height of the body come from, if no source tells them: `depth` images (`[odometry]
    /// attitude`). Not there otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attitude: Option<String>,
    /// `not_watched` where nothing watches the floor. Not there otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<String>,
    /// Why no spoken cue starts a robot that stands by a stop, and what to do; absent where one does, or none is heard.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub no_start_by_voice: Option<String>,
    /// What locomotion commands the robot; none before its first word.
    pub locomotion: Option<LocomotionStatus>,
    /// The sentence that the robot said last.
    pub said: Option<SaidStatus>,
    /// How the handler's voice is heard, where it is to be.
    pub microphone: Option<MicrophoneStatus>,
    /// What was found in shared memory that is no message, by topic and consumer; only where there was any.
    pub invalid_messages: BTreeMap<String, BTreeMap<String, u64>>,
    /// The newest notes for the operator, the oldest of them first.
    pub notes: Vec<Note>,
}

impl Status {
    /// The service, if the run has it; of two policies the one in force.
    #[must_use]
    pub fn service(&self, service: ServiceId) -> Option<&ServiceStatus> {
        self.services.iter().find(|status| status.name == service.name())
    }

    /// Messages published on a topic so far.
    #[must_use]
    pub fn published(&self, topic: TopicId) -> u64 {
        self.published.get(topic.name()).copied().unwrap_or(0)
    }
}

/// Whether the robot may move, and why not.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModeStatus {
    /// Run, fault or lock.
    pub class: ModeClass,
    /// Why it is not run, with evidence.
    pub reason: Option<String>,
    /// Counts the stops.
    pub epoch: u64,
    /// Whether a cue would be taken.
    pub ready_for_cue: bool,
    /// The cue in force.
    pub cue: Option<CueStatus>,
    /// Incarnation of the policy in force.
    pub active_policy: u32,
}

/// The cue in force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CueStatus {
    /// What is asked for.
    pub kind: CueKind,
    /// Where it came from.
    pub source: CueSource,
    /// Run time since which it is, seconds.
    pub since_s: f64,
}

/// How a service is.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ServiceStatus {
    /// Its name.
    pub name: String,
    /// Process id; 0 while there is none.
    pub pid: u32,
    /// How far it is.
    pub state: ServicePhase,
    /// Which life.
    pub incarnation: u32,
    /// Restarts so far.
    pub restarts: u32,
    /// Whether motion needs it.
    pub critical: bool,
    /// Whether it is a policy beside the one in force.
    pub shadow: bool,
    /// Topic of the input that it lacks, if any.
    pub starved_of: Option<String>,
}

/// How far a service is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServicePhase {
    /// It is not wanted now.
    #[default]
    Off,
    /// It is to be started.
    Down,
    /// It has not said yet that it is ready.
    Starting,
    /// It works.
    Ready,
    /// It was killed, and is not gone yet.
    Dying,
    /// It was asked to leave.
    Leaving,
    /// It died too often.
    Spent,
    /// Read from the wire: a phase that a later supervisor knows.
    #[serde(other)]
    Unknown,
}

impl ServicePhase {
    /// The name, as in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Down => "down",
            Self::Starting => "starting",
            Self::Ready => "ready",
            Self::Dying => "dying",
            Self::Leaving => "leaving",
            Self::Spent => "spent",
            Self::Unknown => "unknown",
        }
    }
}

impl fmt::Display for ServicePhase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// What is true in a simulated or replayed world, in its frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct WorldStatus {
    /// The robot: x and y in metres, heading in radians.
    #[serde(deserialize_with = "number::three")]
    pub robot: [f64; 3],
    /// The handler: x and y, metres.
    #[serde(deserialize_with = "number::two")]
    pub handler: [f64; 2],
    /// Other people: x and y, metres.
    #[serde(deserialize_with = "number::pairs")]
    pub walkers: Vec<[f64; 2]>,
    /// Way walked by the robot, metres.
    #[serde(deserialize_with = "number::one")]
    pub distance_m: f64,
    /// Collisions so far.
    pub collisions: Collisions,
    /// Falls so far.
    #[serde(default)]
    pub falls: Falls,
}

/// Collisions in a simulated world.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Collisions {
    /// That the robot ran into.
    pub robot: u32,
    /// That the handler was led into.
    pub handler: u32,
    /// Times that robot or handler were walked into by others.
    pub hit_by_others: u32,
}

/// Falls in a simulated world: a footprint that left the floor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Falls {
    /// Of the robot.
    pub robot: u32,
    /// Of the handler.
    pub handler: u32,
}

/// What locomotion commands the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LocomotionStatus {
    /// Forward and left in metres per second, counter-clockwise in radians per second.
    #[serde(deserialize_with = "number::three")]
    pub velocity: [f64; 3],
    /// The kind of stop by which it is zero; "none" while it is not.
    pub limited_by: String,
    /// Decision of the permit obeyed last.
    pub decision: u64,
}

/// The sentence that the robot said last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SaidStatus {
    /// What is said.
    pub text: String,
    /// Run time of the phase, seconds.
    pub at_s: f64,
    /// How far it is.
    pub phase: SpeechPhase,
    /// How urgent it is.
    pub urgency: Urgency,
}

/// How the handler's voice is heard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MicrophoneStatus {
    /// Whether it is heard.
    pub state: MicrophoneState,
    /// How loud the last second was, decibels of full scale.
    #[serde(deserialize_with = "number::one_f32")]
    pub level_dbfs: f32,
    /// How far the loudest of late stands out from what is always there, decibels.
    #[serde(deserialize_with = "number::one_f32")]
    pub above_floor_db: f32,
    /// Share of the last second's samples that were cut off.
    #[serde(deserialize_with = "number::one_f32")]
    pub clipped: f32,
}

/// What the operator is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Note {
    /// Run time, seconds.
    pub at_s: f64,
    /// What.
    pub text: String,
}
