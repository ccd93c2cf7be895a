//! What a service is, and the whole `main` of one.

use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::ExitCode;

use messages::{Health, Member, ServiceId};

use crate::TransportError;
use crate::domain::Domain;
use crate::io::Io;
use crate::line::{FromChild, Line, ToChild, inherited_fd};
use crate::room;
use crate::run_dir::RunDir;
use crate::urgent;
use crate::wait_loop::WaitLoop;

/// Exit code of a service that was started with wrong arguments, or by hand.
pub const EXIT_BAD_ARGUMENTS: u8 = 2;
/// Exit code of a service that could not go on; it told the supervisor why.
pub const EXIT_FAILED: u8 = 1;

/// What a service says that exits as it starts.
const EXITS: &str = "exits as it starts: an injected fault";

/// Which service a process is, and which life of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Which service.
    pub service: ServiceId,
    /// Which life of it, from 1.
    pub incarnation: u32,
}

/// What the supervisor passes to a child.
#[derive(Debug)]
pub struct ChildArgs {
    /// The run directory.
    pub run: PathBuf,
    /// Which life this is.
    pub incarnation: u32,
}

/// What the command line passes to the supervisor.
#[derive(Debug)]
pub struct SupervisorArgs;

impl SupervisorArgs {
    /// Environment variable with the resolved settings, as TOML.
    pub const SETTINGS: &'static str = "GUIDEDOG_SETTINGS";
    /// Environment variable that names a descriptor whose closing ends the run: its other end is the starter's.
    pub const OWNER_FD: &'static str = "GUIDEDOG_OWNER_FD";
    /// Environment variable that names the descriptor of the run's lock, which the starter took to have the name.
    pub const LOCK_FD: &'static str = "GUIDEDOG_LOCK_FD";
}

impl ChildArgs {
    /// Environment variable that names the descriptor of the control line.
    pub const CONTROL_FD: &'static str = "GUIDEDOG_CONTROL_FD";
    /// Environment variable that names the descriptor of the lifeline.
    pub const LIFELINE_FD: &'static str = "GUIDEDOG_LIFELINE_FD";
    /// Environment variable that lets the service exit as it starts: an injected fault.
    pub const EXIT_ON_START: &'static str = "GUIDEDOG_EXIT_ON_START";
    /// Environment variable that names the descriptor of locomotion's line to the brake.
    pub const BRAKE_FD: &'static str = "GUIDEDOG_BRAKE_FD";

    /// Environment variable that names the model to load in place of the configured one (policy).
    pub const MODEL: &'static str = "GUIDEDOG_MODEL";

    /// Reads `--run DIR --incarnation N`.
    ///
    /// # Errors
    /// Where an argument is missing or unknown.
    pub fn parse(mut args: impl Iterator<Item = String>) -> Result<Self, TransportError> {
        let wrong = |what: &str| TransportError::Arguments(format!("{what}; the supervisor starts this program"));
        let (mut run, mut incarnation) = (None, None);
        while let Some(arg) = args.next() {
            let value = args.next().ok_or_else(|| wrong(&format!("{arg} needs a value")));
            match arg.as_str() {
                "--run" => run = Some(PathBuf::from(value?)),
                "--incarnation" => incarnation = Some(value?.parse().map_err(|_| wrong("--incarnation is no number"))?),
                _ => return Err(wrong(&format!("unknown argument {arg}"))),
            }
        }
        Ok(Self {
            run: run.ok_or_else(|| wrong("--run is missing"))?,
            incarnation: incarnation.ok_or_else(|| wrong("--incarnation is missing"))?,
        })
    }
}

/// A service: woken by its loop, never waiting by itself.
pub trait Service {
    /// Called whenever an input may have come or a timer is due: takes what there is, does the work, publishes.
    ///
    /// # Errors
    /// Where the service cannot go on; its process then ends, and the supervisor hears why.
    fn on_wake(&mut self, io: &mut Io) -> Result<(), TransportError>;

    /// Run time at which the service wants to be woken, if any.
    fn next_timer_ns(&self) -> Option<u64> {
        None
    }

    /// A message on the control line that is not the loop's own business.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_control(&mut self, _io: &mut Io, _message: ToChild, _fd: Option<OwnedFd>) -> Result<(), TransportError> {
        Ok(())
    }

    /// A descriptor given to [`Io::watch`] has something to read, or its other end is gone.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_fd(&mut self, _io: &mut Io, _token: u64) -> Result<(), TransportError> {
        Ok(())
    }

    /// Called every 20 ms of wall time, in stepped time too, where [`Service::wants_wall_ticks`].
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_wall_tick(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    /// Whether [`Service::on_wall_tick`] is to be called.
    fn wants_wall_ticks(&self) -> bool {
        false
    }

    /// The supervisor is gone. `true`: the process ends at once; `false`: the service ends by [`Service::is_done`].
    fn on_supervisor_lost(&mut self, _io: &mut Io) -> bool {
        true
    }

    /// The supervisor wants the service to leave: finish what must be finished.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_leave(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    /// Whether the process may end.
    fn is_done(&self) -> bool {
        false
    }

    /// Adds the service's own figures to its beat.
    fn fill_health(&self, _health: &mut Health) {}

    /// Whether this service gives out the steps of stepped time.
    fn is_clock_master(&self) -> bool {
        false
    }

    /// Whether the run has come to its end: no further step is given.
    fn time_is_over(&self) -> bool {
        false
    }

    /// Time is over, and everybody has done the last step.
    ///
    /// # Errors
    /// As [`Service::on_wake`].
    fn on_time_over(&mut self, _io: &mut Io) -> Result<(), TransportError> {
        Ok(())
    }

    /// Whether the step may be acknowledged; the supervisor holds time while a restarted service joins.
    fn may_acknowledge(&self) -> bool {
        true
    }

    /// The members from the next step on, with a version that grows; only the supervisor has one.
    fn roster(&self) -> Option<(u64, &[Member])> {
        None
    }
}

/// The whole `main` of a service: parses the arguments, opens the run, builds the service, runs it.
pub fn service_main<S: Service>(
    service: ServiceId,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> ExitCode {
    let args = match ChildArgs::parse(std::env::args().skip(1)) {
        Ok(args) => args,
        Err(error) => {
            eprintln!("guidedog-{service}: {error}");
            return ExitCode::from(EXIT_BAD_ARGUMENTS);
        }
    };
    match run_child(service, &args, build) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("guidedog-{service}: {error}");
            ExitCode::from(if matches!(error, TransportError::Arguments(_)) { EXIT_BAD_ARGUMENTS } else { EXIT_FAILED })
        }
    }
}

fn run_child<S: Service>(
    service: ServiceId,
    args: &ChildArgs,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> Result<(), TransportError> {
    urgent::hurry(service);
    let control = Line::from_fd(inherited_fd(ChildArgs::CONTROL_FD)?);
    let lifeline = inherited_fd(ChildArgs::LIFELINE_FD).ok();
    let identity = Identity { service, incarnation: args.incarnation };
    let name = format!("{service}.{}", args.incarnation);
    let mut io = match room::check().and_then(|()| Domain::open(RunDir::open(&args.run), &name)) {
        Ok(domain) => Io::new(domain, identity, false, Some(control), lifeline)?,
        Err(error) => {
            control.send(&FromChild::Failed { why: error.to_string() }.bounded(), None);
            return Err(error);
        }
    };
    let doomed = io.domain.info.faults && std::env::var_os(ChildArgs::EXIT_ON_START).is_some();
    let built = if doomed { Err(TransportError::Service(EXITS.to_owned())) } else { build(&mut io) };
    let outcome = built.and_then(|mut service| run(&mut io, &mut service));
    if let Err(error) = &outcome {
        io.tell(&FromChild::Failed { why: error.to_string() });
    }
    outcome
}

/// Runs the supervisor in the domain that it has made.
///
/// # Errors
/// As [`run`].
pub fn run_supervisor<S: Service>(
    domain: Domain,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> Result<S, TransportError> {
    run_here(domain, false, build)
}

/// Runs a tool: a bench, or a test that listens to a run. It may open every topic, also one whose row does not list it:
/// its port takes a slot that is spare for a process that died. It beats under the supervisor's name.
///
/// # Errors
/// As [`run`].
pub fn run_tool<S: Service>(
    domain: Domain,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> Result<S, TransportError> {
    run_here(domain, true, build)
}

fn run_here<S: Service>(
    domain: Domain,
    is_tool: bool,
    build: impl FnOnce(&mut Io) -> Result<S, TransportError>,
) -> Result<S, TransportError> {
    let identity = Identity { service: ServiceId::Supervisor, incarnation: 1 };
    let mut io = Io::new(domain, identity, is_tool, None, None)?;
    let mut service = build(&mut io)?;
    run(&mut io, &mut service)?;
    Ok(service)
}

/// Runs a service until it has left or is done.
///
/// # Errors
/// Where the service fails, or the transport does.
pub fn run<S: Service>(io: &mut Io, service: &mut S) -> Result<(), TransportError> {
    let mut wait_loop = WaitLoop::open(io, service)?;
    room::take_all(&io.domain.info.prefix)?;
    io.tell(&FromChild::Ready);
    if io.domain.clock.is_stepped() { wait_loop.run_stepped(io, service) } else { wait_loop.run_real(io, service) }
}
