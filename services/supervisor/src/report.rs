//! The figures of a run: what `status`, `why` and the report at the end say.

use std::collections::{BTreeMap, VecDeque};

use messages::{
    Health, Latency, LatencyHistogram, Microphone, MicrophoneState, Mode, ModeClass, Outcome, PortCounters, PortRole,
    ServiceId, SpeechSaid, StopReason, TopicId, WorldTruth, s_from_ns,
};
use serde_json::{Map, Value, json};

use crate::machine::{Phase, Role, ServiceStatus};
use crate::stops::{Stop, StopLog};

/// The last beat of every incarnation, and what the world said at its end.
#[derive(Debug, Default)]
pub struct Figures {
    lives: BTreeMap<(ServiceId, u32), Box<Health>>,
    /// The supervisor's own ports, which it hears no beats of.
    own: Vec<PortCounters>,
    /// What simulator or replay said when the run ended.
    pub world: Option<Value>,
    /// What the policy ran that decided last.
    pub policy: Option<Value>,
    /// Notes for the operator, with run time.
    pub notes: VecDeque<(u64, String)>,
    /// Notes that had to make room.
    pub notes_not_kept: u64,
}

/// So many lives of a service are told apart.
const LIVES_KEPT: usize = 8;
/// So many notes are kept, the newest.
const MAX_NOTES: usize = 400;
/// And of each so many bytes.
const BRIEF_BYTES: usize = 500;

impl Figures {
    /// Takes a beat.
    pub fn beat(&mut self, health: &Health) {
        let key = (health.service, health.header.incarnation);
        let before = self.lives.get(&key).map_or(&[][..], |life| life.ports());
        for topic in newly_invalid(before, health.ports()) {
            self.note(health.header.stamp_ns, format!("{} dropped what is no message: {topic}", health.service));
        }
        match self.lives.get_mut(&key) {
            Some(life) => **life = *health,
            None => {
                self.lives.insert(key, Box::new(*health));
                self.fold_lives(health.service);
            }
        }
    }

    /// Of many lives of a service the oldest are told as one: a run may last for long.
    fn fold_lives(&mut self, service: ServiceId) {
        let keys: Vec<_> = self.lives.keys().filter(|(s, _)| *s == service).copied().collect();
        if let [first, second, rest @ ..] = &keys[..]
            && rest.len() + 2 > LIVES_KEPT
            && let Some(second) = self.lives.remove(second)
            && let Some(first) = self.lives.get_mut(first)
        {
            first.absorb(&second);
        }
    }

    /// What the world last showed, where it died without a word.
    pub fn world_at_least(&mut self, truth: Option<&WorldTruth>) {
        if let (None, Some(truth)) = (&self.world, truth) {
            let collisions = collisions_json(truth);
            self.world = Some(json!({ "reached": false, "distance_m": truth.distance_m, "collisions": collisions }));
        }
    }

    /// Keeps a note.
    pub fn note(&mut self, run_ns: u64, text: String) {
        if self.notes.len() >= MAX_NOTES {
            self.notes.pop_front();
            self.notes_not_kept += 1;
        }
        self.notes.push_back((run_ns, brief(&text)));
    }

    /// Takes what the supervisor's own ports have done.
    pub fn own_ports(&mut self, run_ns: u64, ports: Vec<PortCounters>) {
        for topic in newly_invalid(&self.own, &ports) {
            self.note(run_ns, format!("supervisor dropped what is no message: {topic}"));
        }
        self.own = ports;
    }

    /// What was found in shared memory that is no message, by topic and consumer; nothing where nothing was.
    #[must_use]
    pub fn invalid_messages(&self) -> Value {
        let mut counts: BTreeMap<&str, BTreeMap<&str, u64>> = BTreeMap::new();
        let own = self.own.iter().map(|port| (port, ServiceId::Supervisor));
        for (port, consumer) in self.ports(PortRole::Subscriber).chain(own).filter(|(port, _)| port.invalid > 0) {
            add(counts.entry(port.topic.name()).or_default().entry(consumer.name()).or_default(), port.invalid);
        }
        json!(counts)
    }

    /// Messages published by topic.
    #[must_use]
    pub fn published(&self) -> Value {
        let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
        for port in self.ports(PortRole::Publisher) {
            add(counts.entry(port.0.topic.name()).or_default(), port.0.count);
        }
        json!(counts)
    }

    /// Messages taken by topic and consumer.
    fn taken(&self) -> Value {
        let mut counts: BTreeMap<&str, BTreeMap<&str, u64>> = BTreeMap::new();
        for (port, consumer) in self.ports(PortRole::Subscriber) {
            add(counts.entry(port.topic.name()).or_default().entry(consumer.name()).or_default(), port.count);
        }
        json!(counts)
    }

    /// Messages missed by topic, and by topic and consumer.
    fn lost(&self) -> (Value, Value) {
        let mut by_topic: BTreeMap<&str, u64> = BTreeMap::new();
        let mut by_consumer: BTreeMap<&str, BTreeMap<&str, u64>> = BTreeMap::new();
        for (port, consumer) in self.ports(PortRole::Subscriber) {
            add(by_topic.entry(port.topic.name()).or_default(), port.lost);
            add(by_consumer.entry(port.topic.name()).or_default().entry(consumer.name()).or_default(), port.lost);
        }
        (json!(by_topic), json!(by_consumer))
    }

    fn ports(&self, role: PortRole) -> impl Iterator<Item = (&messages::PortCounters, ServiceId)> {
        self.lives.values().flat_map(move |life| {
            life.ports()
                .iter()
                .filter(move |port| port.role == role && port.topic != TopicId::None)
                .map(|port| (port, life.service))
        })
    }

    fn latencies(&self) -> Value {
        let mut all: BTreeMap<&str, LatencyHistogram> = BTreeMap::new();
        for histogram in self.lives.values().flat_map(|life| &life.latencies) {
            if histogram.what != Latency::None {
                all.entry(histogram.what.name()).or_default().add(histogram);
            }
        }
        let mut map = Map::new();
        for (name, histogram) in all {
            let us = |q| histogram.quantile_us(q).map(|us| (us * 10.0).round() / 10.0);
            let max = histogram.max_ns as f64 / 1000.0;
            let row = json!({
                "n": histogram.n, "p50": us(0.5), "p95": us(0.95), "p99": us(0.99), "p999": us(0.999), "max": max,
            });
            map.insert(name.to_owned(), row);
        }
        Value::Object(map)
    }

    fn of(&self, service: ServiceId) -> impl Iterator<Item = &Health> {
        self.lives.iter().filter(move |((s, _), _)| *s == service).map(|(_, life)| life.as_ref())
    }

    /// Decisions drawn and missed, scans judged and refused by reason, and the digest over actions and permits.
    fn shield(&self, map: &mut Map<String, Value>) {
        let sum = |of: fn(&Health) -> u64| sum_of(self.of(ServiceId::Shield).map(of));
        map.insert("decisions".to_owned(), json!(sum(|life| life.decisions)));
        map.insert("missed_decisions".to_owned(), json!(sum(|life| life.missed_decisions)));
        let count = |outcome: Outcome| sum_of(self.of(ServiceId::Shield).map(|life| life.outcomes[outcome as usize]));
        let verdicts = Outcome::ALL.into_iter().filter(|o| o.is_verdict());
        let refusals = Outcome::ALL.into_iter().filter(|o| !o.is_verdict());
        let by_name = |outcomes: Vec<Outcome>| -> BTreeMap<&str, u64> {
            outcomes.into_iter().map(|o| (o.name(), count(o))).filter(|(_, n)| *n > 0).collect()
        };
        let verdicts = by_name(verdicts.collect());
        let refusals = by_name(refusals.collect());
        // One for each life of the shield: a death in between does not hide what was before it.
        let hex = |life: &Health| life.digest.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let digest = self.of(ServiceId::Shield).map(hex).collect::<Vec<_>>().join("-");
        map.insert("verdicts".to_owned(), json!(sum_of(verdicts.values().copied())));
        map.insert("verdicts_by_outcome".to_owned(), json!(verdicts));
        map.insert("refusals".to_owned(), json!(refusals));
        map.insert("digest".to_owned(), json!(digest));
    }

    /// The report at the end of the run.
    #[must_use]
    pub fn report(&self, run: &str, clock: &Value, run_ns: u64, stops: &StopLog, services: &[ServiceStatus]) -> Value {
        let mut map = Map::new();
        map.insert("run".to_owned(), json!(run));
        map.insert("clock".to_owned(), clock.clone());
        map.insert("duration_s".to_owned(), json!(s_from_ns(run_ns)));
        if let Some(Value::Object(world)) = &self.world {
            map.extend(world.clone());
        }
        map.insert("stops".to_owned(), stops.stops().iter().map(|stop| stop_json(stop, run_ns)).collect());
        map.insert("policy".to_owned(), json!(self.policy));
        map.insert("stops_not_kept".to_owned(), json!(stops.not_kept));
        map.insert("stopped_s_by_reason".to_owned(), stopped_by_reason(stops, run_ns));
        map.insert("longest_freeze_s".to_owned(), json!(s_from_ns(stops.longest_freeze_ns)));
        self.shield(&mut map);
        map.insert("latency_us".to_owned(), self.latencies());
        map.insert("published".to_owned(), self.published());
        map.insert("taken".to_owned(), self.taken());
        let (lost, lost_by_consumer) = self.lost();
        map.insert("lost".to_owned(), lost);
        map.insert("lost_by_consumer".to_owned(), lost_by_consumer);
        map.insert("invalid_messages".to_owned(), self.invalid_messages());
        map.insert("invalid_inputs".to_owned(), json!(sum_of(self.lives.values().map(|life| life.invalid_inputs))));
        map.insert("not_recorded".to_owned(), json!(sum_of(self.lives.values().map(|life| life.not_recorded))));
        let restarts: BTreeMap<&str, u32> =
            services.iter().filter(|s| s.restarts > 0).map(|s| (s.service.name(), s.restarts)).collect();
        map.insert("restarts".to_owned(), json!(restarts));
        map.insert("notes".to_owned(), self.notes_json());
        map.insert("notes_not_kept".to_owned(), json!(self.notes_not_kept));
        Value::Object(map)
    }

    /// How the handler's voice is heard, where it is to be.
    #[must_use]
    pub fn microphone(&self) -> Option<&Microphone> {
        let newest = self.of(ServiceId::Cue).max_by_key(|life| life.header.incarnation)?;
        Some(&newest.microphone).filter(|microphone| microphone.state != MicrophoneState::None)
    }

    /// The notes, with run time.
    #[must_use]
    pub fn notes_json(&self) -> Value {
        notes_json(self.notes.iter())
    }

    /// The newest of them: so many that an answer holds them.
    #[must_use]
    pub fn last_notes_json(&self) -> Value {
        const LAST: usize = 100;
        notes_json(self.notes.iter().skip(self.notes.len().saturating_sub(LAST)))
    }
}

/// Collisions as reported.
#[must_use]
pub fn collisions_json(truth: &WorldTruth) -> Value {
    json!({
        "robot": truth.robot_collisions, "handler": truth.handler_collisions, "hit_by_others": truth.hit_by_others,
    })
}

fn notes_json<'a>(notes: impl Iterator<Item = &'a (u64, String)>) -> Value {
    notes.map(|(at, text)| json!({ "at_s": s_from_ns(*at), "text": text })).collect()
}

/// A text as it is kept: whoever wrote it, and however long. What would steer a terminal does not.
#[must_use]
pub fn brief(text: &str) -> String {
    let mut text = text.replace(char::is_control, " ");
    if text.len() > BRIEF_BYTES {
        let end = (0..=BRIEF_BYTES).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
        text.truncate(end);
        text.push_str(" ...");
    }
    text
}

/// Adds what a beat says: a number that another process wrote, and no more to be trusted than that.
fn add(count: &mut u64, n: u64) {
    *count = count.saturating_add(n);
}

fn sum_of(counts: impl Iterator<Item = u64>) -> u64 {
    counts.fold(0, u64::saturating_add)
}

/// Topics of which something is no message that was none before.
fn newly_invalid(before: &[PortCounters], ports: &[PortCounters]) -> Vec<String> {
    let had = |i: usize| before.get(i).is_some_and(|port| port.invalid > 0);
    let new = ports.iter().enumerate().filter(|(i, port)| port.invalid > 0 && !had(*i)).map(|(_, port)| port);
    new.map(
        |port| if port.of == ServiceId::None { port.topic.to_string() } else { format!("{}/{}", port.topic, port.of) },
    )
    .collect()
}

/// One stop as reported.
#[must_use]
pub fn stop_json(stop: &Stop, now_ns: u64) -> Value {
    let lasted = stop.lasted_ns(now_ns);
    json!({
        "class": stop.class,
        "reason": stop.reason.kind.name(),
        "why": stop.reason.to_string(),
        "service": (stop.reason.service != ServiceId::None).then(|| stop.reason.service.name()),
        "stream": (stop.reason.topic != TopicId::None).then(|| stop.reason.topic.name()),
        "at_s": s_from_ns(stop.at_ns),
        "lasted_s": s_from_ns(lasted),
        "ended": stop.ended_ns.is_some(),
    })
}

fn stopped_by_reason(stops: &StopLog, now_ns: u64) -> Value {
    let times = stops.lasted_ns(now_ns).into_iter();
    times.map(|(name, ns)| (name.to_owned(), json!(s_from_ns(ns)))).collect::<Map<_, _>>().into()
}

/// A reason as reported.
#[must_use]
pub fn reason_json(reason: &StopReason) -> Value {
    json!(reason.to_string())
}

/// The mode as reported.
#[must_use]
pub fn mode_json(mode: &Mode) -> Value {
    let cue =
        mode.cue.valid.then_some(mode.cue.cue).map(
            |cue| json!({ "kind": cue.kind.name(), "source": cue.source, "since_s": s_from_ns(cue.header.stamp_ns) }),
        );
    let reason = if mode.class == ModeClass::Run { Value::Null } else { reason_json(&mode.reason) };
    json!({
        "class": mode.class.name(),
        "reason": reason,
        "epoch": mode.epoch,
        "ready_for_cue": mode.ready_for_cue,
        "cue": cue,
        "active_policy": mode.active_policy,
    })
}

/// A sentence of the robot as reported.
#[must_use]
pub fn said_json(said: &SpeechSaid) -> Value {
    json!({
        "text": said.text.as_str(),
        "at_s": s_from_ns(said.header.stamp_ns),
        "phase": said.phase,
        "urgency": said.urgency,
    })
}

/// How the handler's voice is heard, as reported.
#[must_use]
pub fn microphone_json(microphone: &Microphone) -> Value {
    json!({
        "state": microphone.state,
        "level_dbfs": microphone.level_dbfs,
        "above_floor_db": microphone.above_floor_db,
        "clipped": microphone.clipped,
    })
}

/// The services as reported.
#[must_use]
pub fn services_json(services: &[ServiceStatus]) -> Value {
    services
        .iter()
        .map(|s| {
            let state = match s.phase {
                Phase::Off => "off",
                Phase::Down { .. } => "down",
                Phase::Starting { .. } => "starting",
                Phase::Ready => "ready",
                Phase::Dying => "dying",
                Phase::Leaving { .. } => "leaving",
                Phase::Spent => "spent",
            };
            json!({
                "name": s.service.name(), "pid": s.pid, "state": state, "incarnation": s.incarnation,
                "restarts": s.restarts, "critical": s.critical, "shadow": s.role == Role::Shadow,
                "starved_of": s.starved_of.map(TopicId::name),
            })
        })
        .collect()
}
