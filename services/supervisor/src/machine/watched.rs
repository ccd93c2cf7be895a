//! One service as the machine watches it: how far it is, whether it beats, whether its streams go on.

use std::collections::VecDeque;

use messages::{Health, PortRole, StopKind, StopReason, TopicId, age_ns};

use crate::plan::{Rate, ServicePlan};

/// How far a service is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Not wanted: started only on demand.
    Off,
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
    /// No longer wanted; killed at that wall time.
    Leaving {
        /// Wall time, nanoseconds.
        kill_at_ns: u64,
        /// Whether it was asked to leave, and may do so before.
        asked: bool,
    },
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
    in_count: u64,
    /// Run time when `in_count` last grew.
    fed_at_ns: u64,
    window: Window,
}

/// The messages of a stream are counted over windows, beat by beat.
#[derive(Debug, Clone, Copy, Default)]
struct Window {
    /// Stamp of the beat that began it; 0 before the first.
    from_ns: u64,
    outputs: u64,
    inputs: u64,
    /// What the last whole window came to: from one output to the next, where that was too long, nanoseconds.
    too_slow_ns: Option<u64>,
}

/// Length of a window.
const WINDOW_NS: u64 = 2_000_000_000;
/// A stream that gives less than this share of what it should is slow.
const RATE_SHARE: f64 = 0.7;

impl Window {
    fn take(&mut self, rate: &Rate, beat_ns: u64, outputs: u64, inputs: u64) {
        let begin = Self { from_ns: beat_ns, outputs, inputs, too_slow_ns: None };
        let lasted_ns = beat_ns.saturating_sub(self.from_ns);
        if self.from_ns == 0 || outputs < self.outputs || inputs < self.inputs {
            *self = begin;
        } else if lasted_ns >= WINDOW_NS {
            let (out, fed) = (outputs - self.outputs, inputs - self.inputs);
            let should = fed.checked_div(rate.inputs).unwrap_or(lasted_ns / rate.period_ns);
            let is_slow = (out as f64) < RATE_SHARE * should.min(lasted_ns / rate.period_ns) as f64;
            *self = Self { too_slow_ns: is_slow.then(|| lasted_ns / out.max(1)), ..begin };
        }
    }
}

/// Which of two policies it is; all other services are one of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Named by `mode`.
    Active,
    /// Beside it: a candidate, or the one before.
    Shadow,
}

#[derive(Debug)]
pub(super) struct Watched {
    pub plan: ServicePlan,
    pub role: Role,
    pub phase: Phase,
    pub incarnation: u32,
    pub pid: u32,
    /// Its line is watched.
    pub armed: bool,
    /// Stepped time: it is ready, and waits for its time to join.
    pub said_ready: bool,
    /// Stepped time: a member of the roster.
    pub joined: bool,
    /// Stepped time: joins at this run time; 0 once it has.
    pub joins_at_ns: u64,
    pub restarts: u32,
    /// Times of the last deaths, for the budget: wall time, in stepped time run time.
    pub deaths_ns: VecDeque<u64>,
    last_beat_ns: u64,
    /// Nothing before this is held against it, run time: its readiness, or the judge's own waking up.
    judged_from_ns: u64,
    progress: Vec<Progress>,
    pose_jumps: u64,
    used: (u64, u32),
}

impl Watched {
    pub fn new(plan: ServicePlan, role: Role) -> Self {
        let progress = vec![Progress::default(); plan.streams.len()];
        Self {
            phase: if plan.on_demand { Phase::Off } else { Phase::Down { start_at_ns: 0 } },
            plan,
            role,
            incarnation: 0,
            pid: 0,
            armed: false,
            said_ready: false,
            joined: false,
            joins_at_ns: 0,
            restarts: 0,
            deaths_ns: VecDeque::new(),
            last_beat_ns: 0,
            judged_from_ns: 0,
            progress,
            pose_jumps: 0,
            used: (0, 0),
        }
    }

    /// Stepped time: whether it is ready but for its time to join.
    pub fn waits_to_join(&self) -> bool {
        self.said_ready && matches!(self.phase, Phase::Starting { .. })
    }

    /// Whether motion needs it.
    pub fn is_critical(&self) -> bool {
        self.plan.critical && self.role == Role::Active
    }

    /// Whether it is, or is to be, at work: what the run waits for.
    pub fn is_wanted(&self) -> bool {
        !matches!(self.phase, Phase::Off | Phase::Leaving { .. } | Phase::Spent)
    }

    /// The next incarnation starts, and has done nothing yet.
    pub fn begin_life(&mut self, incarnation: u32, ready_by_ns: u64) {
        self.incarnation = incarnation;
        self.phase = Phase::Starting { ready_by_ns };
        self.armed = !self.plan.has_line;
        self.said_ready = false;
        self.joined = false;
        self.pose_jumps = 0;
        self.last_beat_ns = 0;
        self.used = (0, 0);
        self.progress.iter_mut().for_each(|progress| *progress = Progress::default());
    }

    /// What it is judged by is counted from now on.
    pub fn count_from(&mut self, run_ns: u64) {
        self.judged_from_ns = run_ns;
        for progress in &mut self.progress {
            (progress.changed_at_ns, progress.fed_at_ns) = (run_ns, run_ns);
            progress.window = Window::default();
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
            if input != progress.in_count {
                (progress.in_count, progress.fed_at_ns) = (input, run_ns);
            }
            if let Some(rate) = &rule.rate {
                progress.window.take(rate, health.header.stamp_ns, out.count, input);
            }
            if out.count != progress.out_count {
                *progress = Progress { out_count: out.count, changed_at_ns: run_ns, in_then: input, ..*progress };
            } else if input < progress.in_then.saturating_add(rule.inputs_per_output) {
                // No input, no output: starved, which is nobody's fault here.
                progress.changed_at_ns = run_ns;
            }
        }
        self.used = (health.private_bytes, health.open_files);
        let jumped = health.pose_jumps > self.pose_jumps;
        self.pose_jumps = health.pose_jumps;
        jumped
    }

    /// Whether it beats on time. What it did while nobody looked is not known, and so is not taken for well.
    pub fn beats_on_time(&self, run_ns: u64) -> bool {
        age_ns(run_ns, self.last_beat_ns) <= self.plan.beat_limit_ns
    }

    /// For how long it has not beaten, where that is too long to let it live, nanoseconds.
    fn silence(&self, run_ns: u64) -> Option<u64> {
        let since_ns = self.last_beat_ns.max(self.judged_from_ns);
        Some(age_ns(run_ns, since_ns)).filter(|age| *age > self.plan.beat_limit_ns)
    }

    /// What it is to be ended for, if anything: silence, too much memory or too many descriptors, input without output,
    /// or less output than its input makes.
    pub fn judge(&self, run_ns: u64) -> Option<StopReason> {
        let of = |kind| StopReason::service(kind, self.plan.service, self.incarnation);
        if let Some(age_ns) = self.silence(run_ns) {
            return Some(StopReason { age_ns, limit_ns: self.plan.beat_limit_ns, ..of(StopKind::BeatsMissed) });
        }
        let ((bytes, files), allowed) = (self.used, self.plan.allowance);
        if bytes > allowed.private_bytes {
            let (used, used_limit) = (bytes, allowed.private_bytes);
            return Some(StopReason { used, used_limit, ..of(StopKind::MemoryExhausted) });
        }
        if files > allowed.files {
            let (used, used_limit) = (u64::from(files), u64::from(allowed.files));
            return Some(StopReason { used, used_limit, ..of(StopKind::FilesExhausted) });
        }
        self.plan.streams.iter().zip(&self.progress).find_map(|(rule, progress)| {
            let about = |kind, age_ns, limit_ns| StopReason { topic: rule.output, age_ns, limit_ns, ..of(kind) };
            let silent_ns = run_ns.saturating_sub(progress.changed_at_ns);
            if rule.input.is_some() && silent_ns > rule.hang_ns {
                return Some(about(StopKind::ServiceHung, silent_ns, rule.hang_ns));
            }
            let limit_ns = (rule.rate?.period_ns as f64 / RATE_SHARE) as u64;
            Some(about(StopKind::StreamSlow, progress.window.too_slow_ns?, limit_ns))
        })
    }

    /// The input that it lacks, if any: starved, which is nobody's fault here.
    pub fn starved_of(&self, run_ns: u64) -> Option<TopicId> {
        if self.phase != Phase::Ready {
            return None;
        }
        self.plan.streams.iter().zip(&self.progress).find_map(|(rule, progress)| {
            rule.input.filter(|_| run_ns.saturating_sub(progress.fed_at_ns) > rule.hang_ns)
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
