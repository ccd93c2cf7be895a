//! Which services a run has, in which order they start, and what each is held to.

use messages::{ClockRole, MemoryClass, NS_PER_S, QUANTUM_NS, ServiceId, TopicId};
use settings::{CueOrigin, EstopSource, Settings, Source, VoiceSource};
use transport::ClockKind;

use crate::machine::SwapLimits;

/// What a service takes and gives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StreamRule {
    /// The stream that it gives.
    pub output: TopicId,
    /// The stream without which it can give nothing; none for a device.
    pub input: Option<TopicId>,
    /// So many inputs make an output.
    pub inputs_per_output: u64,
    /// With input and without output for this long, it is hung, nanoseconds.
    pub hang_ns: u64,
    /// How old the output may be for motion; none where motion does not need it.
    pub max_age_ns: Option<u64>,
    /// How often it comes; none where that is nobody's promise (recorded logs).
    pub rate: Option<Rate>,
}

/// How often a stream comes when all is well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    /// From one output to the next, nanoseconds.
    pub period_ns: u64,
    /// Inputs to an output, rounded up: what is driven by an input that is slow is not itself slow. 0: a device.
    pub inputs: u64,
}

/// What a process may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Allowance {
    /// Memory of its own, bytes.
    pub private_bytes: u64,
    /// Descriptors.
    pub files: u32,
}

impl Allowance {
    /// Nobody counts.
    const ANY: Self = Self { private_bytes: u64::MAX, files: u32::MAX };
}

/// One service of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServicePlan {
    /// Which.
    pub service: ServiceId,
    /// Starts when everything of lower stages is ready.
    pub stage: u8,
    /// Whether motion needs it.
    pub critical: bool,
    /// Whether it is restarted; the end of what is not ends the run.
    pub restartable: bool,
    /// Whether it runs only while somebody wants it.
    pub on_demand: bool,
    /// Whether others, and the run's beginning, wait for it to be up.
    pub waited_for: bool,
    /// Whether its line is watched: by locomotion, or by the brake where it is locomotion.
    pub has_line: bool,
    /// Whether it gives out stepped time.
    pub clock_master: bool,
    /// Its last beat may be this old, nanoseconds.
    pub beat_limit_ns: u64,
    /// What it may use.
    pub allowance: Allowance,
    /// Its streams.
    pub streams: Vec<StreamRule>,
}

/// Limits that hold for all.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Whether run time is stepped.
    pub stepped: bool,
    /// From spawn to ready.
    pub ready_ns: u64,
    /// A critical service's last beat.
    pub beat_ns: u64,
    /// Beats tell of a stream this much late.
    pub beat_lag_ns: u64,
    /// First pause before a restart.
    pub back_off_ns: u64,
    /// Longest pause before a restart.
    pub back_off_max_ns: u64,
    /// Restarts within the window.
    pub restart_budget: u32,
    /// See `restart_budget`.
    pub budget_window_ns: u64,
    /// Stepped time: joins this long after the death.
    pub restart_time_ns: u64,
    /// What a service of the class `Small` may use, and one of the class `Large`.
    pub allowances: [Allowance; 2],
    /// Locomotion stands without a younger mode.
    pub mode_max_age_ns: u64,
    /// A cue must be younger to be accepted.
    pub cue_max_age_ns: u64,
    /// Whether there is an emergency stop.
    pub estop: bool,
    /// The robot's charge at which the operator is warned, and at which it stops, percent.
    pub charge_percent: [u8; 2],
    /// When the handler knows what a stop asks of them, after it began. None: the robot does not speak.
    pub asked_after_ns: Option<u64>,
    /// What a policy has to show to be swapped in.
    pub swap: SwapLimits,
}

impl Limits {
    /// What a service of that class may use.
    fn allowance(&self, memory: MemoryClass) -> Allowance {
        match memory {
            MemoryClass::Small => self.allowances[0],
            MemoryClass::Large => self.allowances[1],
            MemoryClass::Any => Allowance::ANY,
        }
    }
}

/// A run's services and limits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// In the order of their start.
    pub services: Vec<ServicePlan>,
    /// Limits that hold for all.
    pub limits: Limits,
}

/// The simulated world tells where everything is so often.
const WORLD_HZ: f64 = (NS_PER_S / QUANTUM_NS) as f64;
/// Beats every 20 ms, read every 20 ms.
const BEAT_LAG_NS: u64 = 40_000_000;
impl Plan {
    /// The plan of a run with these settings.
    #[must_use]
    pub fn of(settings: &Settings, clock: ClockKind) -> Self {
        let supervision = &settings.supervision;
        let limits = Limits {
            stepped: matches!(clock, ClockKind::Stepped { .. }),
            ready_ns: supervision.ready_within.ns(),
            beat_ns: supervision.beat_limit.ns(),
            beat_lag_ns: BEAT_LAG_NS,
            back_off_ns: supervision.back_off.ns(),
            back_off_max_ns: supervision.back_off_max.ns(),
            restart_budget: supervision.restart_budget,
            budget_window_ns: supervision.budget_window.ns(),
            restart_time_ns: supervision.restart_time.ns(),
            allowances: [supervision.memory_mib, supervision.large_memory_mib]
                .map(|mib| Allowance { private_bytes: u64::from(mib) << 20, files: supervision.open_files }),
            mode_max_age_ns: settings.max_age_ns(TopicId::Mode),
            cue_max_age_ns: settings.max_age_ns(TopicId::Cue),
            estop: settings.estop.source != EstopSource::Absent,
            charge_percent: [settings.locomotion.charge_warn_percent, settings.locomotion.charge_stop_percent],
            asked_after_ns: settings.asked_after_ns(),
            swap: swap_limits(settings),
        };
        let mut services = vec![
            plan(ServiceId::Locomotion, &limits, vec![state_stream(settings)]),
            plan(ServiceId::Brake, &limits, vec![]),
        ];
        if settings.locomotion.link.is_dds() {
            services.push(plan(ServiceId::Bridge, &limits, vec![]));
            services.push(plan(ServiceId::Backstop, &limits, vec![]));
        }
        if settings.has_world() {
            services.push(plan(ServiceId::Simulator, &limits, vec![]));
        }
        if settings.simulation.emulated.on {
            services.push(plan(ServiceId::Emulator, &limits, vec![]));
        }
        if settings.estop.source != EstopSource::Absent {
            services.push(plan(ServiceId::Estop, &limits, vec![estop_stream(settings)]));
        }
        if let driven @ (Source::Simulated | Source::Device) = settings.odometry.source {
            let stream = odometry_stream(settings, driven == Source::Simulated);
            services.push(plan(ServiceId::Odometry, &limits, vec![stream]));
        }
        if let driven @ (Source::Simulated | Source::Device) = settings.lidar.source {
            let stream = scan_stream(settings, driven == Source::Simulated);
            services.push(plan(ServiceId::Lidar, &limits, vec![stream]));
        }
        if let Some(second) = &settings.lidar.second
            && let driven @ (Source::Simulated | Source::Device) = second.source
        {
            let stream = second_stream(settings, driven == Source::Simulated);
            services.push(plan(ServiceId::SecondLidar, &limits, vec![stream]));
        }
        if let driven @ (Source::Simulated | Source::Device) = settings.depth.source {
            services.push(depth(settings, &limits, driven == Source::Simulated));
        }
        if settings.replays() {
            services.push(replay(settings, &limits));
        }
        if settings.cue.source == CueOrigin::Own {
            services.push(cue(settings, &limits));
        }
        services.push(plan(ServiceId::Policy, &limits, vec![action_stream(settings)]));
        services.push(plan(ServiceId::Shield, &limits, vec![permit_stream(settings)]));
        // In stepped time a run goes as fast as the machine lets it, and a sentence takes as long as it takes.
        if settings.speak.on && !limits.stepped {
            services.push(plan(ServiceId::Speak, &limits, vec![]));
        }
        services.push(plan(ServiceId::Recorder, &limits, vec![]));
        Self { services, limits }
    }
}

fn swap_limits(settings: &Settings) -> SwapLimits {
    let (policy, table) = (&settings.policy, settings.policy.actions.table());
    SwapLimits {
        decisions: policy.swap.decisions,
        latency_ns: policy.swap.latency.ns(),
        probation_ns: policy.swap.probation.ns(),
        dt_ns: policy.dt.ns(),
        action_table_id: table.id(),
        action_count: table.len() as u32,
    }
}

/// A service as its row of the table has it.
fn plan(service: ServiceId, limits: &Limits, streams: Vec<StreamRule>) -> ServicePlan {
    let spec = service.spec().expect("every service but `None`, which no plan names, has a row");
    ServicePlan {
        service,
        stage: spec.stage,
        critical: spec.critical,
        restartable: spec.restartable,
        on_demand: spec.on_demand,
        waited_for: spec.waited_for,
        has_line: spec.watched_by.is_some(),
        // Replay beside a simulated world is a driver: the simulator is the master then.
        clock_master: spec.clock == ClockRole::Master && service != ServiceId::Replay,
        beat_limit_ns: spec.beat_limit_ms.map_or(limits.beat_ns, |ms| u64::from(ms) * 1_000_000),
        allowance: limits.allowance(spec.memory),
        streams,
    }
}

/// Cues: a recogniser that listens has networks to do it with.
fn cue(settings: &Settings, limits: &Limits) -> ServicePlan {
    let hears = settings.cue.voice.source != VoiceSource::Absent;
    let memory = if hears { MemoryClass::Large } else { MemoryClass::Small };
    ServicePlan { allowance: limits.allowance(memory), ..plan(ServiceId::Cue, limits, vec![]) }
}

fn depth(settings: &Settings, limits: &Limits, driven: bool) -> ServicePlan {
    ServicePlan {
        critical: settings.depth.needed,
        has_line: settings.depth.needed,
        ..plan(ServiceId::Depth, limits, vec![depth_stream(settings, driven)])
    }
}

/// Recorded frames: in the place of single drivers beside a simulated world, or of the whole world. It is then what the
/// simulator is in other runs, and motion needs it besides.
fn replay(settings: &Settings, limits: &Limits) -> ServicePlan {
    let second = settings.lidar.second.as_ref();
    let second = second.map(|second| (second.source, second_stream as fn(&Settings, bool) -> StreamRule));
    let sources = [
        (settings.lidar.source, scan_stream as fn(&Settings, bool) -> StreamRule),
        (settings.odometry.source, odometry_stream),
        (settings.depth.source, depth_stream),
    ];
    let replayed = sources.into_iter().chain(second).filter(|(source, _)| *source == Source::Replayed);
    let streams = replayed.map(|(_, stream)| stream(settings, false)).collect();
    let driver = plan(ServiceId::Replay, limits, streams);
    if settings.has_world() {
        return driver;
    }
    let ServicePlan { service, critical, has_line, streams, .. } = driver;
    ServicePlan { service, critical, has_line, streams, ..plan(ServiceId::Simulator, limits, vec![]) }
}

/// The rate of a driver, driven by the simulated world or not.
fn rate(hz: f64, driven: bool) -> Rate {
    Rate { period_ns: (1e9 / hz) as u64, inputs: if driven { inputs(WORLD_HZ, hz) } else { 0 } }
}

/// Inputs at `from_hz` for one output at `to_hz`, rounded up.
fn inputs(from_hz: f64, to_hz: f64) -> u64 {
    (from_hz / to_hz).ceil().max(1.0) as u64
}

fn scan_stream(settings: &Settings, driven: bool) -> StreamRule {
    stream_of_scans(settings, TopicId::LidarScan, settings.lidar.rate_hz.get(), driven)
}

fn second_stream(settings: &Settings, driven: bool) -> StreamRule {
    let rate_hz = settings.lidar.second.as_ref().map_or(settings.lidar.rate_hz, |second| second.rate_hz);
    stream_of_scans(settings, TopicId::SecondScan, rate_hz.get(), driven)
}

fn stream_of_scans(settings: &Settings, output: TopicId, rate_hz: f64, driven: bool) -> StreamRule {
    let max_age = settings.max_age_ns(output);
    StreamRule {
        output,
        input: driven.then_some(TopicId::WorldTruth),
        inputs_per_output: 2 * inputs(WORLD_HZ, rate_hz),
        hang_ns: 2 * max_age,
        max_age_ns: Some(max_age),
        rate: driven.then(|| rate(rate_hz, driven)),
    }
}

fn odometry_stream(settings: &Settings, driven: bool) -> StreamRule {
    let max_age = settings.max_age_ns(TopicId::Odometry);
    StreamRule {
        output: TopicId::Odometry,
        input: driven.then_some(TopicId::WorldTruth),
        inputs_per_output: 2 * inputs(WORLD_HZ, settings.odometry.rate_hz.get()),
        hang_ns: 2 * max_age,
        max_age_ns: Some(max_age),
        rate: driven.then(|| rate(settings.odometry.rate_hz.get(), driven)),
    }
}

fn estop_stream(settings: &Settings) -> StreamRule {
    let max_age = settings.max_age_ns(TopicId::Estop);
    StreamRule {
        output: TopicId::Estop,
        input: None,
        inputs_per_output: 1,
        hang_ns: 2 * max_age,
        max_age_ns: Some(max_age),
        rate: None,
    }
}

fn depth_stream(settings: &Settings, driven: bool) -> StreamRule {
    let max_age = settings.max_age_ns(TopicId::DepthFrame);
    StreamRule {
        output: TopicId::DepthFrame,
        input: driven.then_some(TopicId::WorldTruth),
        inputs_per_output: 2 * inputs(WORLD_HZ, settings.depth.rate_hz.get()),
        hang_ns: 2 * max_age,
        max_age_ns: settings.depth.needed.then_some(max_age),
        rate: driven.then(|| rate(settings.depth.rate_hz.get(), driven)),
    }
}

fn action_stream(settings: &Settings) -> StreamRule {
    StreamRule {
        output: TopicId::PolicyAction,
        input: Some(TopicId::Mode),
        inputs_per_output: 1,
        hang_ns: 3 * settings.policy.dt.ns(),
        max_age_ns: Some(settings.max_age_ns(TopicId::PolicyAction)),
        // A decision that is missed is seen by its age.
        rate: None,
    }
}

/// What locomotion tells of itself, at its own rate whatever comes; the mode is what it needs.
fn state_stream(settings: &Settings) -> StreamRule {
    StreamRule {
        output: TopicId::LocomotionState,
        input: Some(TopicId::Mode),
        inputs_per_output: 1,
        hang_ns: settings.max_age_ns(TopicId::Mode),
        max_age_ns: None,
        rate: None,
    }
}

fn permit_stream(settings: &Settings) -> StreamRule {
    StreamRule {
        output: TopicId::ShieldPermit,
        input: Some(TopicId::LidarScan),
        inputs_per_output: 1,
        hang_ns: 2 * settings.max_age_ns(TopicId::LidarScan),
        // Permits are not required for a cue to be accepted; a permit too old stops the robot by itself.
        max_age_ns: None,
        rate: Some(Rate { period_ns: (1e9 / settings.lidar.rate_hz.get()) as u64, inputs: 1 }),
    }
}
