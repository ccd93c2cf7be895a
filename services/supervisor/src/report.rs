//! The figures of a run: what `status`, `why` and the report at the end say.

use std::collections::{BTreeMap, VecDeque};

use control::{
    Collisions, CueStatus, Falls, LatencyRow, MicrophoneStatus, ModeStatus, Note, Report, RunFigures, SaidStatus,
    ServicePhase, ServiceStatus, Stop,
};
use messages::{
    ClockKind, Health, Latency, LatencyHistogram, Microphone, MicrophoneState, Mode, ModeClass, Outcome, PortCounters,
    PortRole, ServiceId, SpeechSaid, TopicId, WorldTruth, s_from_ns,
};
use serde_json::Value;

use crate::Supervisor;
use crate::journal;
use crate::machine::{self, Phase, Role};
use crate::stops::{self, StopLog};

type ByTopic = BTreeMap<String, u64>;
type ByTopicAndConsumer = BTreeMap<String, BTreeMap<String, u64>>;
/// What went through a port, and whose port it is.
type Port<'a> = (&'a PortCounters, ServiceId);

/// The last beat of every incarnation, and what the world said at its end.
#[derive(Debug, Default)]
pub struct Figures {
    lives: BTreeMap<(ServiceId, u32), Box<Health>>,
    /// The supervisor's own ports, which it hears no beats of.
    own: Vec<PortCounters>,
    /// What simulator or replay said when the run ended.
    pub world: Option<RunFigures>,
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
            let (distance_m, collisions, falls) = (truth.distance_m, collisions(truth), falls(truth));
            self.world = Some(RunFigures { distance_m, collisions, falls, ..RunFigures::default() });
        }
    }

    /// Keeps a note, and tells the journal.
    pub fn note(&mut self, run_ns: u64, text: String) {
        journal::note(run_ns, &brief(&text));
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
    pub fn invalid_messages(&self) -> ByTopicAndConsumer {
        let own = self.own.iter().map(|port| (port, ServiceId::Supervisor));
        let invalid = self.ports(PortRole::Subscriber).chain(own).filter(|(port, _)| port.invalid > 0);
        by_consumer(invalid, |port| port.invalid)
    }

    /// Messages published by topic.
    #[must_use]
    pub fn published(&self) -> ByTopic {
        by_topic(self.ports(PortRole::Publisher), |port| port.count)
    }

    fn ports(&self, role: PortRole) -> impl Iterator<Item = Port<'_>> {
        self.lives.values().flat_map(move |life| {
            life.ports()
                .iter()
                .filter(move |port| port.role == role && port.topic != TopicId::None)
                .map(|port| (port, life.service))
        })
    }

    fn latencies(&self) -> BTreeMap<String, LatencyRow> {
        let mut all: BTreeMap<&str, LatencyHistogram> = BTreeMap::new();
        for histogram in self.lives.values().flat_map(|life| &life.latencies) {
            if histogram.what != Latency::None {
                all.entry(histogram.what.name()).or_default().add(histogram);
            }
        }
        all.into_iter().map(|(name, histogram)| (name.to_owned(), latency_row(&histogram))).collect()
    }

    fn of(&self, service: ServiceId) -> impl Iterator<Item = &Health> {
        self.lives.iter().filter(move |((s, _), _)| *s == service).map(|(_, life)| life.as_ref())
    }

    /// One digest over actions and permits for each life of the shield: a death in between does not hide what was
    /// before it.
    fn digest(&self) -> String {
        let hex = |life: &Health| life.digest.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        self.of(ServiceId::Shield).map(hex).collect::<Vec<_>>().join("-")
    }

    /// Scans by what the shield found, of the outcomes that are meant, and only those that there were.
    fn outcomes(&self, meant: impl Fn(Outcome) -> bool) -> BTreeMap<String, u64> {
        let count = |outcome: Outcome| sum_of(self.of(ServiceId::Shield).map(|life| life.outcomes[outcome as usize]));
        let counts =
            Outcome::ALL.into_iter().filter(|outcome| meant(*outcome)).map(|o| (o.name().to_owned(), count(o)));
        counts.filter(|(_, n)| *n > 0).collect()
    }

    /// How the handler's voice is heard, where it is to be.
    #[must_use]
    pub fn microphone(&self) -> Option<&Microphone> {
        let newest = self.of(ServiceId::Cue).max_by_key(|life| life.header.incarnation)?;
        Some(&newest.microphone).filter(|microphone| microphone.state != MicrophoneState::None)
    }

    /// The notes, with run time.
    #[must_use]
    pub fn notes(&self) -> Vec<Note> {
        notes(self.notes.iter())
    }

    /// The newest of them: so many that an answer holds them.
    #[must_use]
    pub fn last_notes(&self) -> Vec<Note> {
        const LAST: usize = 100;
        notes(self.notes.iter().skip(self.notes.len().saturating_sub(LAST)))
    }
}

impl Supervisor {
    /// The report at the end of the run.
    #[must_use]
    pub(crate) fn report(&self, run: &str, clock: ClockKind) -> Report {
        let (figures, run_ns) = (&self.figures, self.ended_ns);
        let log = &self.machine.stops;
        let taken = || figures.ports(PortRole::Subscriber);
        let (lives, shields) = (|| figures.lives.values(), || figures.of(ServiceId::Shield));
        let restarted = self.machine.status(run_ns).into_iter().filter(|s| s.restarts > 0);
        let verdicts_by_outcome = figures.outcomes(Outcome::is_verdict);
        Report {
            run: run.to_owned(),
            clock,
            duration_s: s_from_ns(run_ns),
            world: figures.world.clone(),
            stops: log.stops().iter().map(|told| stop(told, run_ns)).collect(),
            stops_not_kept: log.not_kept,
            stopped_s_by_reason: stopped_s_by_reason(log, run_ns),
            longest_freeze_s: s_from_ns(log.freeze.longest_ns()),
            policy: figures.policy.clone(),
            policy_swaps: self.machine.policies().last_records().to_vec(),
            decisions: sum_of(shields().map(|life| life.decisions)),
            missed_decisions: sum_of(shields().map(|life| life.missed_decisions)),
            verdicts: sum_of(verdicts_by_outcome.values().copied()),
            verdicts_by_outcome,
            refusals: figures.outcomes(|outcome| !outcome.is_verdict()),
            digest: figures.digest(),
            latency_us: figures.latencies(),
            published: figures.published(),
            taken: by_consumer(taken(), |port| port.count),
            lost: by_topic(taken(), |port| port.lost),
            lost_by_consumer: by_consumer(taken(), |port| port.lost),
            invalid_messages: figures.invalid_messages(),
            invalid_inputs: sum_of(lives().map(|life| life.invalid_inputs)),
            not_recorded: sum_of(lives().map(|life| life.not_recorded)),
            restarts: restarted.map(|s| (s.service.name().to_owned(), s.restarts)).collect(),
            notes: figures.notes(),
            notes_not_kept: figures.notes_not_kept,
            failure: self.failure.clone(),
        }
    }
}

fn by_topic<'a>(ports: impl Iterator<Item = Port<'a>>, count: impl Fn(&PortCounters) -> u64) -> ByTopic {
    let mut counts = ByTopic::new();
    for (port, _) in ports {
        add(counts.entry(port.topic.name().to_owned()).or_default(), count(port));
    }
    counts
}

fn by_consumer<'a>(ports: impl Iterator<Item = Port<'a>>, count: impl Fn(&PortCounters) -> u64) -> ByTopicAndConsumer {
    let mut counts = ByTopicAndConsumer::new();
    for (port, consumer) in ports {
        let of_topic = counts.entry(port.topic.name().to_owned()).or_default();
        add(of_topic.entry(consumer.name().to_owned()).or_default(), count(port));
    }
    counts
}

/// To a tenth of a microsecond.
fn latency_row(histogram: &LatencyHistogram) -> LatencyRow {
    let us = |q| histogram.quantile_us(q).map(|us| (us * 10.0).round() / 10.0);
    let max = histogram.max_ns as f64 / 1000.0;
    LatencyRow { n: histogram.n, p50: us(0.5), p95: us(0.95), p99: us(0.99), p999: us(0.999), max }
}

fn stopped_s_by_reason(stops: &StopLog, now_ns: u64) -> BTreeMap<String, f64> {
    stops.lasted_ns(now_ns).into_iter().map(|(name, ns)| (name.to_owned(), s_from_ns(ns))).collect()
}

/// Collisions as reported.
#[must_use]
pub fn collisions(truth: &WorldTruth) -> Collisions {
    Collisions { robot: truth.robot_collisions, handler: truth.handler_collisions, hit_by_others: truth.hit_by_others }
}

/// Falls as reported.
#[must_use]
pub fn falls(truth: &WorldTruth) -> Falls {
    Falls { robot: truth.robot_falls, handler: truth.handler_falls }
}

fn notes<'a>(notes: impl Iterator<Item = &'a (u64, String)>) -> Vec<Note> {
    notes.map(|(at_ns, text)| Note { at_s: s_from_ns(*at_ns), text: text.clone() }).collect()
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
pub fn stop(stop: &stops::Stop, now_ns: u64) -> Stop {
    let reason = &stop.reason;
    Stop {
        class: stop.class.name().to_owned(),
        reason: reason.kind.name().to_owned(),
        why: reason.to_string(),
        service: (reason.service != ServiceId::None).then(|| reason.service.name().to_owned()),
        stream: (reason.topic != TopicId::None).then(|| reason.topic.name().to_owned()),
        at_s: s_from_ns(stop.at_ns),
        lasted_s: s_from_ns(stop.lasted_ns(now_ns)),
        ended: stop.ended_ns.is_some(),
    }
}

/// The mode as reported.
#[must_use]
pub fn mode_status(mode: &Mode) -> ModeStatus {
    let cue = mode.cue.valid.then_some(mode.cue.cue);
    ModeStatus {
        class: mode.class,
        reason: (mode.class != ModeClass::Run).then(|| mode.reason.to_string()),
        epoch: mode.epoch,
        ready_for_cue: mode.ready_for_cue,
        cue: cue.map(|cue| CueStatus { kind: cue.kind, source: cue.source, since_s: s_from_ns(cue.header.stamp_ns) }),
        active_policy: mode.active_policy,
    }
}

/// A sentence of the robot as reported.
#[must_use]
pub fn said_status(said: &SpeechSaid) -> SaidStatus {
    SaidStatus {
        text: said.text.as_str().to_owned(),
        at_s: s_from_ns(said.header.stamp_ns),
        phase: said.phase,
        urgency: said.urgency,
    }
}

/// How the handler's voice is heard, as reported.
#[must_use]
pub fn microphone_status(microphone: &Microphone) -> MicrophoneStatus {
    let Microphone { state, level_dbfs, above_floor_db, clipped } = *microphone;
    MicrophoneStatus { state, level_dbfs, above_floor_db, clipped }
}

/// The services as reported.
#[must_use]
pub fn service_statuses(services: &[machine::ServiceStatus]) -> Vec<ServiceStatus> {
    let told = |s: &machine::ServiceStatus| ServiceStatus {
        name: s.service.name().to_owned(),
        pid: s.pid,
        state: match s.phase {
            Phase::Off => ServicePhase::Off,
            Phase::Down { .. } => ServicePhase::Down,
            Phase::Starting { .. } => ServicePhase::Starting,
            Phase::Ready => ServicePhase::Ready,
            Phase::Dying => ServicePhase::Dying,
            Phase::Leaving { .. } => ServicePhase::Leaving,
            Phase::Spent => ServicePhase::Spent,
        },
        incarnation: s.incarnation,
        restarts: s.restarts,
        critical: s.critical,
        shadow: s.role == Role::Shadow,
        starved_of: s.starved_of.map(|topic| topic.name().to_owned()),
    };
    services.iter().map(told).collect()
}

#[cfg(test)]
mod tests {
    use super::{Figures, mode_status, service_statuses, stop};
    use crate::machine::{Phase, Role, ServiceStatus};
    use crate::stops::Stop;
    use messages::{
        Cue, CueInForce, CueKind, CueSource, Header, Health, Mode, ModeClass, PortCounters, PortRole, ServiceId,
        StopClass, StopKind, StopReason, TopicId,
    };
    use serde_json::json;

    #[test]
    fn mode_stops_and_services_are_told_by_their_names() {
        let header = Header { stamp_ns: 1_500_000_000, ..Header::default() };
        let cue = Cue { header, kind: CueKind::Forward, source: CueSource::Script, ..Cue::default() };
        let cue = CueInForce { valid: true, cue };
        let run = Mode { class: ModeClass::Run, epoch: 2, cue, active_policy: 1, ..Mode::default() };
        assert_eq!(
            json!(mode_status(&run)).to_string(),
            concat!(
                r#"{"active_policy":1,"class":"run","cue":{"kind":"forward","since_s":1.5,"source":"script"},"#,
                r#""epoch":2,"ready_for_cue":false,"reason":null}"#
            )
        );
        let reason = StopReason::service(StopKind::ServiceDied, ServiceId::Lidar, 3);
        let lock = Mode { class: ModeClass::Lock, reason, ready_for_cue: true, ..Mode::default() };
        assert_eq!(
            json!(mode_status(&lock)).to_string(),
            concat!(
                r#"{"active_policy":0,"class":"lock","cue":null,"epoch":0,"ready_for_cue":true,"#,
                r#""reason":"service_died: lidar (incarnation 3)"}"#
            )
        );
        let begun = Stop { class: StopClass::Fault, reason, at_ns: 2_000_000_000, ended_ns: None };
        assert_eq!(
            json!(stop(&begun, 2_250_000_000)).to_string(),
            concat!(
                r#"{"at_s":2.0,"class":"fault","ended":false,"lasted_s":0.25,"reason":"service_died","#,
                r#""service":"lidar","stream":null,"why":"service_died: lidar (incarnation 3)"}"#
            )
        );
        let policy = ServiceStatus {
            service: ServiceId::Policy,
            pid: 7,
            phase: Phase::Starting { ready_by_ns: 5 },
            incarnation: 2,
            restarts: 1,
            critical: true,
            role: Role::Shadow,
            starved_of: Some(TopicId::LidarScan),
        };
        assert_eq!(
            json!(service_statuses(&[policy])).to_string(),
            concat!(
                r#"[{"critical":true,"incarnation":2,"name":"policy","pid":7,"restarts":1,"#,
                r#""shadow":true,"starved_of":"lidar/scan","state":"starting"}]"#
            )
        );
    }

    #[test]
    fn messages_are_counted_by_topic_and_consumer_over_all_lives() {
        let mut figures = Figures::default();
        for (service, incarnation, role) in [
            (ServiceId::Lidar, 1, PortRole::Publisher),
            (ServiceId::Lidar, 2, PortRole::Publisher),
            (ServiceId::Shield, 1, PortRole::Subscriber),
        ] {
            let mut beat = Health { service, port_count: 1, ..Health::default() };
            beat.header.incarnation = incarnation;
            let invalid = u64::from(role == PortRole::Subscriber);
            beat.ports[0] =
                PortCounters { topic: TopicId::LidarScan, role, count: 10, invalid, ..PortCounters::default() };
            figures.beat(&beat);
        }
        assert_eq!(json!(figures.published()).to_string(), r#"{"lidar/scan":20}"#);
        assert_eq!(json!(figures.invalid_messages()).to_string(), r#"{"lidar/scan":{"shield":1}}"#);
        assert_eq!(
            figures.last_notes().first().map(|note| note.text.as_str()),
            Some("shield dropped what is no message: lidar/scan")
        );
    }
}
