//! The processes of a simulated run: from their start over beats and outputs to their end.

use guidedog_brake::Watch;
use guidedog_locomotion::Gate;
use messages::{Health, PolicyAction, PortCounters, PortRole, ServiceId, TopicId};
use rand::RngExt;

use super::links::{ToGate, ToSupervisor};
use super::{MS, Simulation};

/// How far a process is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    Starting {
        ready_ms: u64,
        fails: bool,
    },
    Running,
    /// Stopped: it runs no instruction until it is killed, or until then.
    Hung {
        since_ms: u64,
        until_ms: u64,
    },
}

/// One process.
#[derive(Debug, Clone)]
pub struct Process {
    pub service: ServiceId,
    pub life: u32,
    pub state: State,
    pub leaks: bool,
    /// Gives only every so many outputs.
    pub every: u64,
    pub spoils: bool,
    /// Its loop beats, and its work is stuck.
    pub stuck: bool,
    outputs: u64,
    output_ms: u64,
    inputs: u64,
}

/// What a service gives and takes, and how often, milliseconds.
fn work(service: ServiceId) -> Option<(TopicId, u64, TopicId, u64)> {
    Some(match service {
        ServiceId::Lidar => (TopicId::LidarScan, 100, TopicId::WorldTruth, 10),
        ServiceId::Depth => (TopicId::DepthFrame, 65, TopicId::WorldTruth, 10),
        ServiceId::Odometry => (TopicId::Odometry, 20, TopicId::WorldTruth, 10),
        ServiceId::Policy => (TopicId::PolicyAction, 500, TopicId::Mode, 50),
        ServiceId::Shield => (TopicId::ShieldPermit, 100, TopicId::LidarScan, 100),
        ServiceId::Locomotion => (TopicId::LocomotionState, 20, TopicId::Mode, 50),
        _ => return None,
    })
}

impl Simulation {
    /// The life of a service that runs now.
    pub(super) fn running(&self, service: ServiceId) -> Option<u32> {
        let mut lives = self.processes.iter().filter(|p| p.service == service && p.state == State::Running);
        lives.next().map(|p| p.life)
    }

    pub(super) fn life_of(&self, service: ServiceId) -> u32 {
        self.processes.iter().filter(|p| p.service == service).map(|p| p.life).max().unwrap_or(0)
    }

    pub(super) fn spawn(&mut self, service: ServiceId, life: u32) {
        self.note(format!("starts {service} {life}"));
        self.checks.spawned(service, &self.processes);
        let in_trouble = self.now_ms < super::TROUBLE_MS;
        let late_ms = if in_trouble && self.rng.random_bool(0.04) { self.rng.random_range(200..4500) } else { 0 };
        let fails = in_trouble && self.rng.random_bool(0.03);
        let ready_ms = self.now_ms + self.rng.random_range(10..60) + late_ms;
        self.processes.push(Process {
            service,
            life,
            state: State::Starting { ready_ms, fails },
            leaks: false,
            every: 1,
            spoils: service == ServiceId::Policy && self.machine.policy_spec(life).exe.is_some(),
            stuck: false,
            outputs: 0,
            output_ms: 0,
            inputs: 0,
        });
        self.machine.started(service, life, life);
        if service != ServiceId::Locomotion && self.machine.has_line(service) {
            self.line_to_gate(ToGate::Line(service, life));
        }
    }

    /// A process ends, however: its line closes, and the supervisor hears of it.
    pub(super) fn kill(&mut self, service: ServiceId, life: u32, who: &str) {
        let Some(i) = self.processes.iter().position(|p| p.service == service && p.life == life) else { return };
        self.note(format!("{who} {service} {life}"));
        self.count("deaths");
        self.processes.swap_remove(i);
        self.checks.ended(service, life, self.now_ms);
        if service == ServiceId::Locomotion {
            self.to_gate.clear();
            self.checks.gate_gone();
            if self.running(ServiceId::Brake).is_some()
                && let Some(engagement) = self.watch.closed()
            {
                self.robot = (false, 0);
                let life = engagement.incarnation;
                self.line_to_supervisor(ServiceId::Brake, ToSupervisor::BrakeEngaged(life));
            }
        } else if self.machine.has_line(service) {
            let due_ms = self.now_ms + self.rng.random_range(0..=3);
            self.to_gate.push(due_ms, ToGate::Closed(service, life));
        }
        self.line_to_supervisor(service, ToSupervisor::Died(service, life));
    }

    /// A process is asked to leave.
    pub(super) fn leave(&mut self, service: ServiceId, life: u32) {
        let Some(i) = self.processes.iter().position(|p| p.service == service && p.life == life) else { return };
        if self.processes[i].state != State::Running {
            return;
        }
        self.note(format!("{service} {life} leaves"));
        self.processes.swap_remove(i);
        self.checks.ended(service, life, self.now_ms);
        if self.machine.has_line(service) {
            let due_ms = self.now_ms + self.rng.random_range(0..=3);
            self.to_gate.push(due_ms, ToGate::Closed(service, life));
        }
        self.line_to_supervisor(service, ToSupervisor::Left(service, life));
    }

    /// Every process lives for a tick.
    pub(super) fn live(&mut self) {
        let lives: Vec<(ServiceId, u32)> = self.processes.iter().map(|p| (p.service, p.life)).collect();
        for (service, life) in lives {
            let Some(i) = self.processes.iter().position(|p| p.service == service && p.life == life) else { continue };
            match self.processes[i].state {
                State::Starting { ready_ms, fails } if self.now_ms >= ready_ms => {
                    if fails {
                        self.kill(service, life, "could not start:");
                    } else {
                        self.processes[i].state = State::Running;
                        self.get_ready(service, life);
                    }
                }
                State::Hung { until_ms, .. } if self.now_ms >= until_ms => {
                    self.note(format!("{service} {life} runs again"));
                    self.processes[i].state = State::Running;
                    self.checks.resumed(service, life);
                    if service == ServiceId::Brake {
                        // What came down its line meanwhile is still there.
                        self.watch_locomotion();
                    }
                }
                State::Running => self.do_work(i),
                State::Starting { .. } | State::Hung { .. } => {}
            }
        }
    }

    fn get_ready(&mut self, service: ServiceId, life: u32) {
        match service {
            ServiceId::Locomotion => {
                self.gate = Gate::new(self.gate_limits.clone());
                self.gate_life = life;
                self.checks.gate_gone();
                // The link is told zero before anything else.
                self.robot = (false, life);
                let lines: Vec<(ServiceId, u32)> = self.processes.iter().map(|p| (p.service, p.life)).collect();
                for (whose, life) in lines {
                    if whose != ServiceId::Locomotion && self.machine.has_line(whose) {
                        self.line_to_gate(ToGate::Line(whose, life));
                    }
                }
                self.watch_locomotion();
            }
            ServiceId::Brake => {
                self.watch = Watch::new(100 * MS);
                self.watch_locomotion();
            }
            _ => {}
        }
        self.line_to_supervisor(service, ToSupervisor::Ready(service, life));
    }

    /// The supervisor hands locomotion's line to the brake.
    fn watch_locomotion(&mut self) {
        let is_up = |p: &&Process| p.service == ServiceId::Locomotion && !matches!(p.state, State::Starting { .. });
        let locomotion = self.processes.iter().find(is_up).map(|p| p.life);
        let (Some(brake), Some(life)) = (self.running(ServiceId::Brake), locomotion) else { return };
        self.watch.rearm(life);
        let armed = ToSupervisor::Armed { service: ServiceId::Locomotion, incarnation: life, by: brake };
        self.line_to_supervisor(ServiceId::Brake, armed);
    }

    fn do_work(&mut self, i: usize) {
        let (now_ms, still) = (self.now_ms, self.now_ms < self.world_still_until_ms);
        let process = &mut self.processes[i];
        let (service, life) = (process.service, process.life);
        let mut gave = false;
        if let Some((_, out_ms, input, in_ms)) = work(service) {
            let fed = input != TopicId::WorldTruth && input != TopicId::LidarScan || !still;
            process.inputs += u64::from(fed && now_ms.is_multiple_of(in_ms));
            gave = fed && !process.stuck && now_ms.is_multiple_of(out_ms * process.every);
            if gave {
                (process.outputs, process.output_ms) = (process.outputs + 1, now_ms);
            }
        }
        if now_ms.is_multiple_of(20) {
            self.beat(i);
        }
        match service {
            ServiceId::Odometry if gave => self.odometry(life),
            ServiceId::Policy if gave => self.decide(i),
            _ => {}
        }
    }

    fn beat(&mut self, i: usize) {
        let header = self.header(self.processes[i].life);
        let process = &self.processes[i];
        let mut health = Health { header, service: process.service, ..Health::default() };
        health.private_bytes = if process.leaks { 1 << 40 } else { 8 << 20 };
        if let Some((output, _, input, _)) = work(process.service) {
            let last_stamp_ns = process.output_ms * MS;
            let port =
                |topic, role, count| PortCounters { topic, role, count, last_stamp_ns, ..PortCounters::default() };
            health.port_count = 2;
            health.ports[0] = port(output, PortRole::Publisher, process.outputs);
            health.ports[1] = port(input, PortRole::Subscriber, process.inputs);
        }
        self.topic_to_supervisor(ToSupervisor::Beat(Box::new(health)));
    }

    fn decide(&mut self, i: usize) {
        let (life, spoils) = (self.processes[i].life, self.processes[i].spoils);
        let decision = self.now_ms / 500;
        let table = guidance::ActionTable::eight();
        let mut action = PolicyAction {
            header: self.header(life),
            decision,
            action_table_id: table.id(),
            action_count: table.len() as u32,
            ..PolicyAction::default()
        };
        action.probabilities[1] = if spoils { f32::NAN } else { 1.0 };
        if !spoils {
            self.decisions.insert(life, decision);
        }
        // One a decision, four deep: never lost.
        let due_ms = self.topic_due_ms();
        self.to_supervisor.push(due_ms, ToSupervisor::Decision(Box::new(action)));
    }
}
