//! From the command line to a running supervisor, and from its end to an empty machine.

use std::io::Write;
use std::os::fd::{AsFd, OwnedFd};
use std::process::ExitCode;

use control::{Report, Right, framing};
use messages::{QUANTUM_NS, ServiceId};
use rustix::event::{EventfdFlags, eventfd};
use settings::Settings;
use transport::{ClockKind, Domain, Io, Janitor, Oversleep, RunDir, RunInfo, SupervisorArgs, TransportError};
use transport::{inherited_fd, monotonic_ns, run_supervisor};

use crate::children::Children;
use crate::ending::Ending;
use crate::faults::Faults;
use crate::journal::{Journal, Keeper, LogTo};
use crate::machine::Machine;
use crate::plan::Plan;
use crate::planned::PlannedRequests;
use crate::report::Figures;
use crate::server::ControlServer;
use crate::step_watch::StepWatch;
use crate::systemd::Systemd;
use crate::tone::Tone;
use crate::{Supervisor, TICK_NS, TOKEN_OWNER, TOKEN_SIGNAL, new_run_dir};

/// Exit code: arguments or settings cannot be used.
pub const EXIT_BAD_SETTINGS: u8 = 2;
/// Exit code: the run could not begin or go on.
pub const EXIT_RUN_FAILED: u8 = 3;

struct Arguments {
    name: String,
    clock: ClockKind,
    report: bool,
    log: LogTo,
}

fn parse(mut args: impl Iterator<Item = String>) -> Result<Arguments, String> {
    let mut parsed = Arguments { name: "run".to_owned(), clock: ClockKind::Real, report: false, log: LogTo::default() };
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--name" => parsed.name = args.next().ok_or("--name needs a value")?,
            "--speed" => {
                let text = args.next().ok_or("--speed needs a value")?;
                let speed: f64 = text.parse().map_err(|_| format!("--speed {text} is no number"))?;
                if !(speed.is_finite() && speed >= 0.0) {
                    return Err(format!("--speed {text} is not 0 (unlimited) or more"));
                }
                parsed.clock = ClockKind::Stepped { speed };
            }
            "--report" => parsed.report = true,
            "--log" => parsed.log.format = Some(args.next().ok_or("--log needs a value")?.parse()?),
            "--log-level" => parsed.log.set_level(&args.next().ok_or("--log-level needs a value")?)?,
            _ => return Err(format!("unknown argument {arg}; `guidedog up` and `guidedog walk` start this program")),
        }
    }
    Ok(parsed)
}

/// The whole of `guidedog-supervisor`.
#[must_use]
pub fn main() -> ExitCode {
    let fail = |code: u8, why: String| {
        // The reader may be gone; there is nobody else to tell.
        let _ = writeln!(std::io::stderr(), "guidedog-supervisor: {why}");
        ExitCode::from(code)
    };
    let arguments = match parse(std::env::args().skip(1)) {
        Ok(arguments) => arguments,
        Err(why) => return fail(EXIT_BAD_SETTINGS, why),
    };
    let settings = match std::env::var(SupervisorArgs::SETTINGS) {
        Ok(text) => match toml::from_str::<Settings>(&text) {
            Ok(settings) => settings,
            Err(error) => return fail(EXIT_BAD_SETTINGS, format!("{}: {error}", SupervisorArgs::SETTINGS)),
        },
        Err(_) => {
            return fail(
                EXIT_BAD_SETTINGS,
                format!("{} is not set: start with `guidedog up`", SupervisorArgs::SETTINGS),
            );
        }
    };
    transport::keep_others_out();
    let dir = match new_run_dir(&arguments.name) {
        Ok(dir) => dir,
        Err(error) => return fail(EXIT_RUN_FAILED, error.to_string()),
    };
    match run(&arguments, &settings, &dir) {
        Ok(report) => {
            if arguments.report
                && let Err(error) = tell(&report)
                // A reader that is gone wanted no more.
                && error.kind() != std::io::ErrorKind::BrokenPipe
            {
                return fail(EXIT_RUN_FAILED, format!("failed to write the report: {error}"));
            }
            match report.failure {
                Some(why) => fail(EXIT_RUN_FAILED, why),
                None => ExitCode::SUCCESS,
            }
        }
        Err(error) => {
            dir.remove();
            fail(EXIT_RUN_FAILED, error.to_string())
        }
    }
}

fn tell(report: &Report) -> std::io::Result<()> {
    std::io::stdout().write_all(framing::line(report)?.as_bytes())
}

fn run(arguments: &Arguments, settings: &Settings, dir: &RunDir) -> Result<Report, TransportError> {
    let text = toml::to_string(settings).map_err(TransportError::service)?;
    std::fs::write(dir.settings(), &text).map_err(TransportError::service)?;
    dir.write_info(&RunInfo {
        name: arguments.name.clone(),
        prefix: dir.prefix(),
        supervisor_pid: std::process::id(),
        started_monotonic_ns: monotonic_ns(),
        clock: arguments.clock,
        faults: settings.faults.allowed,
    })?;
    let signals = signals()?;
    let keeper = Keeper::begin(arguments.log, &arguments.name, &text, settings.run_record, dir);
    let outcome = supervise(arguments, settings, signals, dir, keeper.without.clone());
    keeper.end(&arguments.name, &outcome);
    outcome
}

/// The run itself: nothing is left of it afterwards but its record.
fn supervise(
    arguments: &Arguments,
    settings: &Settings,
    signals: OwnedFd,
    dir: &RunDir,
    note: Option<String>,
) -> Result<Report, TransportError> {
    let domain = Domain::open(RunDir::open(dir.path()), "supervisor.1")?;
    let holder = domain.create_all()?;
    let mut supervisor = run_supervisor(domain, |io| {
        let mut supervisor = Supervisor::open(settings, arguments.clock, signals, io)?;
        note.into_iter().for_each(|note| supervisor.figures.note(0, note));
        Ok(supervisor)
    })?;
    supervisor.figures.world_at_least(supervisor.last_truth.as_ref());
    let report = supervisor.report(&arguments.name, arguments.clock);
    drop(supervisor);
    drop(holder);
    dir.remove();
    Ok(report)
}

/// A descriptor that becomes readable at a signal that asks for the end.
fn signals() -> Result<OwnedFd, TransportError> {
    let flags = EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK;
    let fd = eventfd(0, flags).map_err(|errno| TransportError::System { call: "eventfd", errno })?;
    let writer = fd.try_clone().map_err(TransportError::service)?;
    transport::on_end_signals(move || {
        // A full counter has been seen by nobody yet, so the wake-up is there already.
        let _ = rustix::io::write(&writer, &1u64.to_ne_bytes());
    })?;
    Ok(fd)
}

/// What members of the control socket's group may do.
fn group_right(settings: &Settings) -> Right {
    if settings.access.group_may_command { Right::Change } else { Right::Read }
}

/// How long a step may take, wall time: at a crawl the pace itself is slow.
fn step_limit_ns(settings: &Settings, clock: ClockKind) -> u64 {
    let pace_ns = match clock {
        ClockKind::Stepped { speed } if speed > 0.0 => (QUANTUM_NS as f64 / speed) as u64,
        ClockKind::Stepped { .. } | ClockKind::Real => 0,
    };
    settings.supervision.step_limit.ns().saturating_add(pace_ns.saturating_mul(2))
}

impl Supervisor {
    fn open(settings: &Settings, clock: ClockKind, signals: OwnedFd, io: &mut Io) -> Result<Self, TransportError> {
        let plan = Plan::of(settings, clock);
        let health = plan.services.iter().map(|s| io.health_of(s.service)).collect::<Result<_, _>>()?;
        io.watch(signals.as_fd(), TOKEN_SIGNAL)?;
        let owner = inherited_fd(SupervisorArgs::OWNER_FD).ok();
        if let Some(owner) = &owner {
            io.watch(owner, TOKEN_OWNER)?;
        }
        debug_assert!(plan.services.iter().all(|s| s.service != ServiceId::Supervisor));
        let mut supervisor = Self {
            machine: Machine::new(plan),
            children: Children::new(io.domain.dir.path())?,
            physics: settings.simulation.physics,
            attitude: settings.odometry.attitude,
            watches_floor: settings.watches_floor(),
            no_start_by_voice: settings::no_start_by_voice(settings),
            server: ControlServer::open(&io.domain.dir.control_socket(), group_right(settings), io)?,
            figures: Figures::default(),
            journal: Journal::default(),
            ending: Ending::No,
            faults: Faults::new(settings.faults.allowed),
            planned: PlannedRequests::of(settings),
            health,
            cues: io.subscriber()?,
            estop: io.subscriber()?,
            locomotion: io.subscriber()?,
            decisions: io.quiet_subscriber()?,
            permits: io.quiet_subscriber()?,
            abouts: std::collections::BTreeMap::new(),
            truth: io.quiet_subscriber()?,
            modes: io.publisher()?,
            requests: io.publisher()?,
            answers: io.publisher()?,
            said: io.quiet_subscriber()?,
            last_said: None,
            tone: Tone::new(settings.speak.tone_command()),
            last_truth: None,
            last_locomotion: None,
            next_tick_ns: 0,
            ticks: false,
            oversleep: Oversleep::new(TICK_NS),
            mode_due_ns: 0,
            steps: StepWatch::new(step_limit_ns(settings, clock), monotonic_ns()),
            condemned: Vec::new(),
            acks: io.quiet_subscriber()?,
            janitor: Janitor::start(&io.domain)?,
            waiting: Vec::new(),
            signals,
            systemd: Systemd::of_environment(),
            owner,
            failure: None,
            woken_ns: 0,
            ended_ns: 0,
        };
        if settings.speak.on && io.domain.clock.is_stepped() {
            supervisor.figures.note(0, "speak.on: in stepped time the robot does not speak".to_owned());
        }
        if let Some(path) = &settings.record.path {
            supervisor.want_recording(path.clone().into(), io)?;
        }
        Ok(supervisor)
    }
}
