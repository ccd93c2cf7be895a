//! One service as the machine watches it: how far it is, whether it beats, whether its streams go on.

use std::collections::VecDeque;

use messages::{Health, PortRole, StopKind, StopReason, TopicId, age_ns};

use crate::plan::ServicePlan;

/// How far a service is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Not running; to be started at that wall time.
    Down {
        /// Wall time, nanoseconds.
        start_at_ns: u64,
    },
    /// Started; must be ready by that wall time.
    Starting {
        /// Wall time, nanoseconds.
        ready_by_ns: u64,
    },
    /// At work.
    Ready,
    /// Condemned; its end has not been seen yet.
    Dying,
    /// Stays down: its restart budget is spent.
    Spent,
}

/// A stream of a service, as its beats tell.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    out_count: u64,
    out_stamp_ns: u64,
    /// Run time when `out_count` last grew, and the input count then.
    changed_at_ns: u64,
    in_then: u64,
}

#[derive(Debug)]
pub(super) struct Watched {
    pub plan: ServicePlan,
    pub phase: Phase,
    pub incarnation: u32,
    pub pid: u32,
    /// Its line is watched.
    pub armed: bool,
    /// Stepped time: a member of the roster.
    pub joined: bool,
    /// Stepped time: joins at this run time.
    pub joins_at_ns: u64,
    pub restarts: u32,
    /// Wall times of the last deaths, for the budget.
    pub deaths_ns: VecDeque<u64>,
    last_beat_ns: u64,
    progress: Vec<Progress>,
    pose_jumps: u64,
}

impl Watched {
    pub fn new(plan: ServicePlan) -> Self {
        let progress = vec![Progress::default(); plan.streams.len()];
        Self {
            plan,
            phase: Phase::Down { start_at_ns: 0 },
            incarnation: 0,
            pid: 0,
            armed: false,
            joined: false,
            joins_at_ns: 0,
            restarts: 0,
            deaths_ns: VecDeque::new(),
            last_beat_ns: 0,
            progress,
            pose_jumps: 0,
        }
    }

    /// The next incarnation starts, and has done nothing yet.
    pub fn begin_life(&mut self, ready_by_ns: u64) {
        self.incarnation += 1;
        self.phase = Phase::Starting { ready_by_ns };
        self.armed = !self.plan.has_line;
        self.joined = false;
        self.pose_jumps = 0;
        self.progress.iter_mut().for_each(|progress| *progress = Progress::default());
    }

    /// What it is judged by is counted from now on.
    pub fn count_from(&mut self, run_ns: u64) {
        self.last_beat_ns = run_ns;
        for progress in &mut self.progress {
            progress.changed_at_ns = run_ns;
        }
    }

    /// Takes a beat: whether it tells of a pose that jumped.
    pub fn take_beat(&mut self, health: &Health, run_ns: u64) -> bool {
        self.last_beat_ns = self.last_beat_ns.max(health.header.stamp_ns);
        for (rule, progress) in self.plan.streams.iter().zip(&mut self.progress) {
            let port = |topic, role| health.ports().iter().find(|port| port.topic == topic && port.role == role);
            let input = rule.input.and_then(|topic| port(topic, PortRole::Subscriber)).map_or(0, |port| port.count);
            let Some(out) = port(rule.output, PortRole::Publisher) else { continue };
            progress.out_stamp_ns = out.last_stamp_ns;
            if out.count != progress.out_count {
                *progress = Progress { out_count: out.count, changed_at_ns: run_ns, in_then: input, ..*progress };
            } else if input < progress.in_then.saturating_add(rule.inputs_per_output) {
                // No input, no output: starved, which is nobody's fault here.
                progress.changed_at_ns = run_ns;
            }
        }
        let jumped = health.pose_jumps > self.pose_jumps;
        self.pose_jumps = health.pose_jumps;
        jumped
    }

    /// For how long it has not beaten, where that is too long, nanoseconds.
    pub fn silence(&self, run_ns: u64) -> Option<u64> {
        Some(age_ns(run_ns, self.last_beat_ns)).filter(|age| *age > self.plan.beat_limit_ns)
    }

    /// What it is to be ended for, if anything: silence, or input without output.
    pub fn judge(&self, run_ns: u64) -> Option<StopReason> {
        if let Some(age_ns) = self.silence(run_ns) {
            let reason = StopReason::service(StopKind::BeatsMissed, self.plan.service, self.incarnation);
            return Some(StopReason { age_ns, limit_ns: self.plan.beat_limit_ns, ..reason });
        }
        self.plan.streams.iter().zip(&self.progress).find_map(|(rule, progress)| {
            let silent = run_ns.saturating_sub(progress.changed_at_ns);
            (rule.input.is_some() && silent > rule.hang_ns).then(|| StopReason {
                age_ns: silent,
                limit_ns: rule.hang_ns,
                topic: rule.output,
                ..StopReason::service(StopKind::ServiceHung, self.plan.service, self.incarnation)
            })
        })
    }

    /// A stream of it that motion needs and that is older than `times` its max age; a beat brings a stamp up to
    /// `beat_lag_ns` late. One that never came is stale.
    pub fn stale_stream(&self, run_ns: u64, times: u64, beat_lag_ns: u64) -> Option<StopReason> {
        self.plan.streams.iter().zip(&self.progress).find_map(|(rule, progress)| {
            let limit = rule.max_age_ns?.saturating_mul(times);
            let age = if progress.out_count == 0 { u64::MAX } else { age_ns(run_ns, progress.out_stamp_ns) };
            (age > limit.saturating_add(beat_lag_ns))
                .then(|| StopReason::stream(StopKind::StreamStale, rule.output, age, limit))
        })
    }

    /// Its streams and their ages, nanoseconds.
    pub fn stream_ages(&self, run_ns: u64) -> impl Iterator<Item = (TopicId, u64)> {
        let streams = self.plan.streams.iter().zip(&self.progress);
        streams.map(move |(rule, progress)| (rule.output, run_ns.saturating_sub(progress.out_stamp_ns)))
    }
}
