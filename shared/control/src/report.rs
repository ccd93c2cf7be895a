//! What a run came to: the report that the supervisor writes at its end.

use std::collections::BTreeMap;

use messages::ClockKind;
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use crate::number;
use crate::policies::SwapRecord;
use crate::status::{Collisions, Falls, Note};
use crate::why::Stop;

/// What a run came to. Counts are over all lives of a service.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The run's name.
    pub run: String,
    /// How run time passed.
    pub clock: ClockKind,
    /// Run time at the end, seconds.
    pub duration_s: f64,
    /// What the world said at the end, where there was one to say anything.
    #[serde(flatten, deserialize_with = "part")]
    pub world: Option<RunFigures>,
    /// The newest stops, the oldest of them first.
    pub stops: Vec<Stop>,
    /// Stops that had to make room.
    pub stops_not_kept: u64,
    /// How long the robot stood, seconds, by the name of the kind of stop.
    pub stopped_s_by_reason: BTreeMap<String, f64>,
    /// Longest time in which the robot was asked to walk and came no farther than 0.25 m by its
    /// commands, seconds: it stood, or turned.
    pub longest_freeze_s: f64,
    /// What the policy ran that decided last, as it says.
    pub policy: Option<Value>,
    /// How the policy was swapped, the oldest swap first.
    pub policy_swaps: Vec<SwapRecord>,
    /// Decisions made.
    pub decisions: u64,
    /// Decisions that did not come in time.
    pub missed_decisions: u64,
    /// Scans that were judged.
    pub verdicts: u64,
    /// The same by what was found.
    pub verdicts_by_outcome: BTreeMap<String, u64>,
    /// Scans that could not be judged, by why.
    pub refusals: BTreeMap<String, u64>,
    /// Over all actions taken and permits given, hexadecimal; one for each life of the shield, with `-` between.
    pub digest: String,
    /// How long it took, by what.
    pub latency_us: BTreeMap<String, LatencyRow>,
    /// Messages published, by topic.
    pub published: BTreeMap<String, u64>,
    /// Messages taken, by topic and consumer.
    pub taken: BTreeMap<String, BTreeMap<String, u64>>,
    /// Messages missed, by topic.
    pub lost: BTreeMap<String, u64>,
    /// Messages missed, by topic and consumer.
    pub lost_by_consumer: BTreeMap<String, BTreeMap<String, u64>>,
    /// What was found in shared memory that is no message, by topic and consumer; only where there was any.
    pub invalid_messages: BTreeMap<String, BTreeMap<String, u64>>,
    /// Input that was refused as unusable.
    pub invalid_inputs: u64,
    /// Messages that were not recorded.
    pub not_recorded: u64,
    /// Restarts by service, of those that were restarted.
    pub restarts: BTreeMap<String, u32>,
    /// The newest notes for the operator, the oldest of them first.
    pub notes: Vec<Note>,
    /// Notes that had to make room.
    pub notes_not_kept: u64,
    /// Why the run ended, where it was not as planned.
    pub failure: Option<String>,
}

impl Report {
    /// Whether the walk came to its goal, or the replay to its end.
    #[must_use]
    pub fn reached(&self) -> bool {
        self.world.as_ref().is_some_and(|world| world.reached)
    }

    /// Collisions in the world; none where there was no world.
    #[must_use]
    pub fn collisions(&self) -> Collisions {
        self.world.as_ref().map(|world| world.collisions).unwrap_or_default()
    }

    /// Falls in the world; none where there was no world.
    #[must_use]
    pub fn falls(&self) -> Falls {
        self.world.as_ref().map(|world| world.falls).unwrap_or_default()
    }

    /// Way walked by the robot in the world, metres; 0 where there was no world.
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        self.world.as_ref().map_or(0.0, |world| world.distance_m)
    }

    /// What the replay said, where there was one.
    #[must_use]
    pub fn replayed(&self) -> Option<&ReplayFigures> {
        self.world.as_ref()?.replayed.as_ref()
    }

    /// How the run compares with the recorded one, where it was compared.
    #[must_use]
    pub fn compared(&self) -> Option<&Compared> {
        self.replayed()?.compared.as_ref()
    }
}

/// How long something took, microseconds.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LatencyRow {
    /// How often it was measured.
    pub n: u64,
    /// Median.
    pub p50: Option<f64>,
    /// 95th percentile.
    pub p95: Option<f64>,
    /// 99th percentile.
    pub p99: Option<f64>,
    /// 99.9th percentile.
    pub p999: Option<f64>,
    /// The longest.
    pub max: f64,
}

/// What the world says at the end of a run: simulator or replay; of one that died, what the supervisor last saw.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunFigures {
    /// Whether the walk came to its goal, or the replay to its end.
    pub reached: bool,
    /// Way walked by the robot, metres.
    #[serde(deserialize_with = "number::one")]
    pub distance_m: f64,
    /// Collisions.
    pub collisions: Collisions,
    /// Falls.
    #[serde(default)]
    pub falls: Falls,
    /// What only a simulator knows.
    #[serde(flatten, deserialize_with = "part")]
    pub simulated: Option<SimulatorFigures>,
    /// What only a replay knows.
    #[serde(flatten, deserialize_with = "part")]
    pub replayed: Option<ReplayFigures>,
}

/// What a simulator says besides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulatorFigures {
    /// The robot in the world: x and y in metres, heading in radians.
    #[serde(deserialize_with = "number::three")]
    pub end_pose: [f64; 3],
    /// Ticks of the physics that came too late to be simulated one by one.
    pub skipped_ticks: u64,
}

/// What a replay says besides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReplayFigures {
    /// What was recorded.
    pub recording: String,
    /// Scans played.
    pub scans: u64,
    /// Depth frames played.
    pub depth_frames: u64,
    /// How long the recording is, seconds.
    #[serde(deserialize_with = "number::one")]
    pub recorded_s: f64,
    /// What is odd about the recording, counted by kind.
    pub input_anomalies: BTreeMap<String, u64>,
    /// How the run compares with the recorded one, where it is compared.
    pub compared: Option<Compared>,
}

/// How a run compares with the recorded one.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Compared {
    /// Whether the recording is of a whole stepped run, so that every step has its counterpart.
    pub exact: bool,
    /// The shield's permits.
    pub permits: ComparedCount,
    /// The policy's actions.
    pub actions: ComparedCount,
    /// Verdicts that are another action or another outcome.
    pub decided_differently: u64,
    /// What differed first.
    pub first_difference: Option<String>,
}

/// How many messages are as they were recorded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ComparedCount {
    /// That were recorded.
    pub recorded: u64,
    /// Equal to the byte, header included.
    pub equal: u64,
    /// Different, or without a counterpart now.
    pub different: u64,
    /// Without a counterpart then.
    pub additional: u64,
}

/// Figures whose members stand among those of the whole.
trait Part: DeserializeOwned {
    /// The members. Where one of them is there, the part is.
    const MEMBERS: &'static [&'static str];
}

impl Part for RunFigures {
    const MEMBERS: &'static [&'static str] = &["reached", "distance_m", "collisions"];
}

impl Part for SimulatorFigures {
    const MEMBERS: &'static [&'static str] = &["end_pose", "skipped_ticks"];
}

impl Part for ReplayFigures {
    const MEMBERS: &'static [&'static str] =
        &["recording", "scans", "depth_frames", "recorded_s", "input_anomalies", "compared"];
}

/// Reads a part. By itself `serde` drops a whole flattened `Option` for one wrong member: a replay that decided
/// differently would then look like one that was not compared.
fn part<'de, D: Deserializer<'de>, T: Part>(deserializer: D) -> Result<Option<T>, D::Error> {
    let members = Map::deserialize(deserializer)?;
    let is_there = T::MEMBERS.iter().any(|member| members.contains_key(*member));
    is_there.then(|| serde_json::from_value(Value::Object(members)).map_err(D::Error::custom)).transpose()
}
