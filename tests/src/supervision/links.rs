//! How messages travel: lines keep their order and lose nothing; topics lose what finds no room.

use std::collections::BTreeMap;

use messages::{Cue, Health, LocomotionState, Mode, Permit, PolicyAction, ServiceId, StopReason};
use rand::RngExt;

use super::Simulation;

/// To the supervisor.
#[derive(Debug, Clone)]
pub enum ToSupervisor {
    Ready(ServiceId, u32),
    Armed { service: ServiceId, incarnation: u32, by: u32 },
    Died(ServiceId, u32),
    Left(ServiceId, u32),
    BrakeEngaged(u32),
    Beat(Box<Health>),
    Cue(Box<Cue>),
    State(Box<LocomotionState>),
    Decision(Box<PolicyAction>),
    Permit(Box<Permit>),
    Stop,
    Resume,
}

/// To locomotion's gate.
#[derive(Debug, Clone)]
pub enum ToGate {
    Mode(Box<Mode>),
    Stop { epoch: u64, reason: StopReason },
    Permit(Box<Permit>),
    StopCue(Box<Cue>),
    Line(ServiceId, u32),
    Closed(ServiceId, u32),
}

/// Messages under way, by the time at which they arrive.
#[derive(Debug)]
pub struct Inbox<T> {
    under_way: BTreeMap<(u64, u64), T>,
    count: u64,
}

impl<T> Default for Inbox<T> {
    fn default() -> Self {
        Self { under_way: BTreeMap::new(), count: 0 }
    }
}

impl<T> Inbox<T> {
    /// Something that arrives at `due_ms`.
    pub fn push(&mut self, due_ms: u64, message: T) {
        self.count += 1;
        self.under_way.insert((due_ms, self.count), message);
    }

    /// What has arrived by now, in that order.
    pub fn due(&mut self, now_ms: u64) -> Vec<T> {
        let later = self.under_way.split_off(&(now_ms + 1, 0));
        std::mem::replace(&mut self.under_way, later).into_values().collect()
    }

    /// Whoever was to take them is gone.
    pub fn clear(&mut self) {
        self.under_way.clear();
    }
}

impl Simulation {
    fn network_is_bad(&self) -> bool {
        self.now_ms < self.network_bad_until_ms
    }

    pub(super) fn message_is_lost(&mut self) -> bool {
        self.network_is_bad() && self.rng.random_bool(0.2)
    }

    pub(super) fn topic_due_ms(&mut self) -> u64 {
        let most_ms = if self.network_is_bad() { 30 } else { 2 };
        self.now_ms + self.rng.random_range(0..=most_ms)
    }

    /// Lines are of the kernel: never slow for long. Of one sender they keep their order.
    fn line_due_ms(&mut self, sender: ServiceId) -> u64 {
        let most_ms = if self.network_is_bad() { 25 } else { 3 };
        let drawn_ms = self.now_ms + self.rng.random_range(0..=most_ms);
        let last_ms = self.lines_busy_until_ms.entry(sender).or_default();
        *last_ms = drawn_ms.max(*last_ms);
        *last_ms
    }

    pub(super) fn line_to_supervisor(&mut self, sender: ServiceId, message: ToSupervisor) {
        let due_ms = self.line_due_ms(sender);
        self.to_supervisor.push(due_ms, message);
    }

    pub(super) fn topic_to_supervisor(&mut self, message: ToSupervisor) {
        if !self.message_is_lost() {
            let due_ms = self.topic_due_ms();
            self.to_supervisor.push(due_ms, message);
        }
    }

    pub(super) fn line_to_gate(&mut self, message: ToGate) {
        let due_ms = self.line_due_ms(ServiceId::Supervisor);
        self.to_gate.push(due_ms, message);
    }

    pub(super) fn topic_to_gate(&mut self, message: ToGate) {
        if !self.message_is_lost() {
            let due_ms = self.topic_due_ms();
            self.to_gate.push(due_ms, message);
        }
    }
}
