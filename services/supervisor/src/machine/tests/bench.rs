//! A machine with the world that it believes in, and the time that passes in it.

use crate::machine::{Action, Event, Machine, Now};
use crate::plan::Plan;
use messages::{Cue, CueKind, Header, Health, ModeClass, PortCounters, PortRole, ServiceId, StopKind, TopicId};
use settings::Settings;
use transport::ClockKind;

pub(super) const MS: u64 = 1_000_000;
pub(super) const STEPPED: ClockKind = ClockKind::Stepped { speed: 0.0 };

/// A machine with the world that it believes in: which process lives, which beats.
pub(super) struct Bench {
    pub(super) machine: Machine,
    pub(super) now_ms: u64,
    /// (service, incarnation, whether it beats and works).
    pub(super) alive: Vec<(ServiceId, u32, bool)>,
    pub(super) actions: Vec<Action>,
    pub(super) cue_seq: u64,
}

impl Bench {
    pub(super) fn new(clock: ClockKind) -> Self {
        let machine = Machine::new(Plan::of(&Settings::default(), clock));
        Self { machine, now_ms: 0, alive: Vec::new(), actions: Vec::new(), cue_seq: 0 }
    }

    pub(super) fn now(&self) -> Now {
        Now { run_ns: self.now_ms * MS, wall_ns: (self.now_ms + 1_000_000) * MS }
    }

    pub(super) fn handle(&mut self, event: Event<'_>) {
        let now = self.now();
        self.machine.handle(event, now);
        self.act();
    }

    /// Does what the machine wants, as the shell would; processes get ready at once.
    pub(super) fn act(&mut self) {
        loop {
            let actions = self.machine.take_actions();
            if actions.is_empty() {
                return;
            }
            for action in actions {
                let now = self.now();
                match &action {
                    Action::Spawn(service, incarnation) => {
                        assert!(!self.alive.iter().any(|(s, ..)| s == service), "two lives of {service} at once");
                        self.alive.push((*service, *incarnation, true));
                        self.machine.started(*service, *incarnation, 7);
                        self.machine.handle(Event::Ready(*service, *incarnation), now);
                        self.arm(now);
                    }
                    Action::Kill(service, incarnation) => {
                        self.alive.retain(|(s, i, _)| (s, i) != (service, incarnation));
                        self.machine.handle(Event::Died(*service, *incarnation, "killed".to_owned()), now);
                    }
                    _ => {}
                }
                self.actions.push(action);
            }
        }
    }

    /// Locomotion and brake watch all lines that they are given.
    pub(super) fn arm(&mut self, now: Now) {
        let life = |alive: &[(ServiceId, u32, bool)], of| alive.iter().find(|(s, ..)| *s == of).map(|(_, i, _)| *i);
        for (service, incarnation, _) in self.alive.clone() {
            let watcher = if service == ServiceId::Locomotion { ServiceId::Brake } else { ServiceId::Locomotion };
            if let Some(by) = life(&self.alive, watcher) {
                self.machine.handle(Event::Armed { service, incarnation, by }, now);
            }
        }
    }

    /// Time passes in ticks of 20 ms, with the beats of all that beat.
    pub(super) fn pass(&mut self, ms: u64) {
        for _ in 0..ms / 20 {
            self.now_ms += 20;
            for (service, incarnation, works) in self.alive.clone() {
                if works {
                    self.beat(service, incarnation, self.now_ms);
                }
            }
            let now = self.now();
            self.machine.tick_starts(now);
            self.machine.let_in(now);
            self.act();
            self.machine.tick_judge(now);
            self.act();
        }
    }

    pub(super) fn beat(&mut self, service: ServiceId, incarnation: u32, count: u64) {
        let output = match service {
            ServiceId::Lidar => (TopicId::LidarScan, TopicId::WorldTruth),
            ServiceId::Depth => (TopicId::DepthFrame, TopicId::WorldTruth),
            ServiceId::Odometry => (TopicId::Odometry, TopicId::WorldTruth),
            ServiceId::Policy => (TopicId::PolicyAction, TopicId::Mode),
            ServiceId::Shield => (TopicId::ShieldPermit, TopicId::LidarScan),
            ServiceId::Locomotion => (TopicId::LocomotionState, TopicId::Mode),
            _ => (TopicId::None, TopicId::None),
        };
        let mut health = Health {
            header: Header { stamp_ns: self.now_ms * MS, incarnation, ..Header::default() },
            service,
            port_count: 2,
            ..Health::default()
        };
        let port = |topic, role, count| PortCounters {
            topic,
            role,
            count,
            last_stamp_ns: count * MS,
            ..PortCounters::default()
        };
        health.ports[0] = port(output.0, PortRole::Publisher, count);
        health.ports[1] = port(output.1, PortRole::Subscriber, self.now_ms);
        let now = self.now();
        self.machine.handle(Event::Beat(&health), now);
    }

    pub(super) fn up(clock: ClockKind) -> Self {
        let mut bench = Self::new(clock);
        bench.pass(400);
        bench
    }

    /// In run, with a cue in force.
    pub(super) fn running() -> Self {
        let mut bench = Self::up(ClockKind::Real);
        bench.cue(CueKind::Forward, 0);
        assert_eq!(bench.class(), ModeClass::Run);
        bench
    }

    pub(super) fn cue(&mut self, kind: CueKind, age_ms: u64) {
        self.cue_seq += 1;
        let stamp_ns = self.now_ms.saturating_sub(age_ms) * MS;
        let header = Header { stamp_ns, seq: self.cue_seq, incarnation: 1, ..Header::default() };
        self.handle(Event::Cue(&Cue { header, kind, odometry_incarnation: 1, ..Cue::default() }));
    }

    pub(super) fn die(&mut self, service: ServiceId) {
        if let Some(i) = self.alive.iter().position(|(s, ..)| *s == service) {
            let (_, incarnation, _) = self.alive.remove(i);
            self.handle(Event::Died(service, incarnation, "killed".to_owned()));
        }
    }

    pub(super) fn silence(&mut self, service: ServiceId) {
        self.alive.iter_mut().filter(|(s, ..)| *s == service).for_each(|(.., works)| *works = false);
    }

    pub(super) fn class(&self) -> ModeClass {
        self.machine.mode().class
    }

    pub(super) fn reason(&self) -> StopKind {
        self.machine.mode().reason.kind
    }

    pub(super) fn noted(&self, word: &str) -> bool {
        self.actions.iter().any(|action| matches!(action, Action::Note(text) if text.contains(word)))
    }
}
