//! Starting processes, their lines, and their ends.

use std::fs::File;
use std::os::fd::{AsFd, AsRawFd, OwnedFd, RawFd};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use control::PolicySpec;
use messages::{DeathSignal, ServiceId};
use nix::libc;
use rustix::event::{PollFd, PollFlags};
use rustix::process::{Pid, PidfdFlags, Resource, Rlimit, Signal};
use transport::{ChildArgs, Io, Line, ToChild, TransportError, monotonic_ns};

/// A supervisor that fails waits so long for its children: longer than the last of them needs.
const LAST_WAIT_NS: u64 = 900_000_000;

/// A child as the shell holds it.
#[derive(Debug)]
pub struct Running {
    /// Which service.
    pub service: ServiceId,
    /// Which life of it.
    pub incarnation: u32,
    /// Token of its control line; its pidfd's is one more.
    pub token: u64,
    /// Our end of its control line; none once it closed.
    pub control: Option<Line>,
    /// Readable when the process has ended.
    pub pidfd: OwnedFd,
    child: Child,
    /// The other end of its lifeline, kept for a restarted locomotion (for locomotion itself: for the brake).
    far_end: Option<Line>,
    /// The incarnation of locomotion (of the brake) that was given `far_end`.
    handed_to: Option<u32>,
    /// Why it said that it failed.
    pub failed: Option<String>,
    /// Whether it said that it has left.
    pub left: bool,
}

impl Running {
    /// Ends what a process that has ended, but is not reaped yet, has left: it leads a group of its own.
    fn kill_what_it_started(&self) {
        let now = rustix::event::Timespec { tv_sec: 0, tv_nsec: 0 };
        let ended =
            rustix::event::poll(&mut [PollFd::new(&self.pidfd, PollFlags::IN)], Some(&now)).is_ok_and(|n| n > 0);
        if let Some(group) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw).filter(|_| ended) {
            // As a rule there is nobody.
            let _ = rustix::process::kill_process_group(group, Signal::KILL);
        }
    }
}

/// All children.
#[derive(Debug)]
pub struct Children {
    running: Vec<Running>,
    executables: PathBuf,
    run: PathBuf,
    next_token: u64,
    /// Services whose next starts are to fail, one entry for each: an injected fault.
    doomed: Vec<ServiceId>,
}

impl Drop for Children {
    /// Where the supervisor fails, its end is told to all by their lines, and awaited: the brake still needs the run's
    /// directory for its way to the robot.
    fn drop(&mut self) {
        for child in &mut self.running {
            (child.control, child.far_end) = (None, None);
        }
        let deadline_ns = monotonic_ns() + LAST_WAIT_NS;
        for child in &mut self.running {
            let left_ns = deadline_ns.saturating_sub(monotonic_ns());
            let timeout = rustix::event::Timespec { tv_sec: 0, tv_nsec: left_ns.min(999_999_999) as _ };
            let mut fds = [PollFd::new(&child.pidfd, PollFlags::IN)];
            let ended = rustix::event::poll(&mut fds, Some(&timeout)).is_ok_and(|n| n > 0);
            if !ended {
                // It may have ended by itself.
                let _ = rustix::process::pidfd_send_signal(&child.pidfd, Signal::KILL);
            }
            let _ = child.child.wait();
        }
    }
}

fn system(call: &'static str) -> impl FnOnce(rustix::io::Errno) -> TransportError {
    move |errno| TransportError::System { call, errno }
}

impl Children {
    /// No children yet; their executables lie beside ours.
    ///
    /// # Errors
    /// Where our own executable cannot be found.
    pub fn new(run: &Path) -> Result<Self, TransportError> {
        let own = std::env::current_exe().map_err(TransportError::service)?;
        let executables = own.parent().map(Path::to_owned).unwrap_or_default();
        Ok(Self { running: Vec::new(), executables, run: run.to_owned(), next_token: 100, doomed: Vec::new() })
    }

    /// The executable of that name.
    #[must_use]
    pub fn executable(&self, name: &str) -> PathBuf {
        self.executables.join(name)
    }

    /// The children that have not been reaped.
    #[must_use]
    pub fn running(&self) -> &[Running] {
        &self.running
    }

    /// The child whose control line or pidfd has that token.
    pub fn by_token(&mut self, token: u64) -> Option<&mut Running> {
        self.running.iter_mut().find(|child| child.token == token || child.token + 1 == token)
    }

    /// The child that is that incarnation.
    pub fn incarnation(&mut self, service: ServiceId, incarnation: u32) -> Option<&mut Running> {
        self.running.iter_mut().find(|child| child.service == service && child.incarnation == incarnation)
    }

    /// The newest life of a service; an older one may not have been reaped yet.
    fn newest(&self, service: ServiceId) -> Option<&Running> {
        self.running.iter().filter(|child| child.service == service).max_by_key(|child| child.incarnation)
    }

    /// Starts an incarnation, with a lifeline where `has_line`, of the executable and with the model that `spec` names:
    /// its process id.
    ///
    /// # Errors
    /// Where the executable is missing or the kernel refuses.
    pub fn spawn(
        &mut self,
        (service, incarnation): (ServiceId, u32),
        has_line: bool,
        spec: &PolicySpec,
        log: &Path,
        io: &Io,
    ) -> Result<u32, TransportError> {
        let (control, control_child) = Line::pair()?;
        let control = if service.stops_robot() { closing_first(control) } else { control };
        let (far_end, life_child) = Line::pair()?;
        let path = spec.exe.clone().unwrap_or_else(|| self.executable(&format!("guidedog-{service}")));
        let log = File::create(log).map_err(TransportError::service)?;
        let mut command = Command::new(&path);
        command
            .arg("--run")
            .arg(&self.run)
            .args(["--incarnation", &incarnation.to_string()])
            // Only the supervisor speaks to systemd.
            .env_remove("NOTIFY_SOCKET")
            .env(ChildArgs::CONTROL_FD, control_child.as_fd().as_raw_fd().to_string())
            .stdin(Stdio::null())
            .stdout(log.try_clone().map_err(TransportError::service)?)
            .stderr(log)
            .process_group(0);
        let life_variable = if service == ServiceId::Locomotion { ChildArgs::BRAKE_FD } else { ChildArgs::LIFELINE_FD };
        command.env(life_variable, life_child.as_fd().as_raw_fd().to_string());
        if let Some(model) = &spec.model {
            command.env(ChildArgs::MODEL, model);
        }
        if let Some(i) = self.doomed.iter().position(|doomed| *doomed == service) {
            self.doomed.swap_remove(i);
            command.env(ChildArgs::EXIT_ON_START, "1");
        }
        prepare(&mut command, service, [control_child.as_fd().as_raw_fd(), life_child.as_fd().as_raw_fd()]);
        let child = command
            .spawn()
            .map_err(|error| TransportError::Service(format!("failed to start {}: {error}", path.display())))?;
        // Ours must close now, or the child's death would go unnoticed.
        drop((control_child, life_child));
        let pid = child.id();
        let raw = i32::try_from(pid).ok().and_then(Pid::from_raw);
        let raw = raw.ok_or_else(|| TransportError::Service(format!("{pid} is no process id")))?;
        let pidfd = rustix::process::pidfd_open(raw, PidfdFlags::empty()).map_err(system("pidfd_open"))?;
        self.next_token += 2;
        io.watch(&control, self.next_token)?;
        io.watch(&pidfd, self.next_token + 1)?;
        self.running.push(Running {
            service,
            incarnation,
            token: self.next_token,
            control: Some(control),
            pidfd,
            child,
            far_end: has_line.then_some(far_end),
            handed_to: None,
            failed: None,
            left: false,
        });
        self.hand_out_lines();
        Ok(pid)
    }

    /// Gives locomotion the far ends of all lifelines that it has not got, and the brake that of locomotion. What finds
    /// no room in a line now is given with the next tick: until then the line is not armed, and no cue is accepted.
    pub fn hand_out_lines(&mut self) {
        for i in 0..self.running.len() {
            let child = &self.running[i];
            let &Running { service, incarnation, .. } = child;
            let (to, message) = if service == ServiceId::Locomotion {
                (ServiceId::Brake, ToChild::Watch { incarnation, pid: child.child.id() })
            } else {
                (ServiceId::Locomotion, ToChild::Lifeline { service, incarnation })
            };
            let Some((life, line)) = self.newest(to).and_then(|to| Some((to.incarnation, to.control.as_ref()?))) else {
                continue;
            };
            if let Some(far_end) = child.far_end.as_ref().filter(|_| child.handed_to != Some(life))
                && line.send(&message, Some(far_end.as_fd()))
            {
                self.running[i].handed_to = Some(life);
            }
        }
    }

    /// Tells one service something on its control line.
    pub fn tell(&self, service: ServiceId, message: &ToChild) {
        if let Some(line) = self.newest(service).and_then(|child| child.control.as_ref()) {
            // Where it is gone, its end is on the way to us.
            line.send(message, None);
        }
    }

    /// Tells one life of a service something on its control line.
    pub fn tell_life(&self, service: ServiceId, incarnation: u32, message: &ToChild) {
        let life = self.running.iter().find(|c| c.service == service && c.incarnation == incarnation);
        if let Some(line) = life.and_then(|child| child.control.as_ref()) {
            // Where it is gone, its end is on the way to us.
            line.send(message, None);
        }
    }

    /// Tells every life of a service something on its control line.
    pub fn tell_all(&self, service: ServiceId, message: &ToChild) {
        for child in self.running.iter().filter(|child| child.service == service) {
            self.tell_life(service, child.incarnation, message);
        }
    }

    /// Lets so many next starts of a service fail: an injected fault.
    pub fn doom(&mut self, service: ServiceId, times: u32) {
        self.doomed.retain(|doomed| *doomed != service);
        self.doomed.extend((0..times).map(|_| service));
    }

    /// Signals an incarnation.
    pub fn signal(&self, service: ServiceId, incarnation: u32, signal: Signal) {
        for child in self.running.iter().filter(|c| c.service == service && c.incarnation == incarnation) {
            // It may have ended by itself.
            let _ = rustix::process::pidfd_send_signal(&child.pidfd, signal);
        }
    }

    /// Ends an incarnation.
    pub fn kill(&self, service: ServiceId, incarnation: u32) {
        self.signal(service, incarnation, Signal::KILL);
    }

    /// Takes the child off the list, if it has ended: its exit, in words.
    pub fn reap(&mut self, token: u64, io: &Io) -> Option<(Running, String)> {
        let i = self.running.iter().position(|child| child.token == token || child.token + 1 == token)?;
        self.running[i].kill_what_it_started();
        let status = self.running[i].child.try_wait().ok().flatten()?;
        let child = self.running.swap_remove(i);
        io.unwatch(&child.pidfd);
        if let Some(control) = &child.control {
            io.unwatch(control);
        }
        Some((child, status.to_string()))
    }
}

/// The line under a high number. When a process dies, the kernel closes its descriptors from the highest on, each with
/// the wake-up of whoever holds its other end: who stops the robot need not wait for the others.
fn closing_first(line: Line) -> Line {
    const HIGH: RawFd = 1000;
    // Where so many may not be open, the line stays what it is.
    rustix::io::fcntl_dupfd_cloexec(&line, HIGH).map_or(line, Line::from_fd)
}

/// The longest file that a policy may write, its log included; its shared memory is far smaller.
const POLICY_FILE_BYTES: u64 = 16 << 20;

/// What has to be done in the child between fork and exec.
fn prepare(command: &mut Command, service: ServiceId, keep: [RawFd; 2]) {
    let at_our_death = match service.spec().map_or(DeathSignal::Kill, |spec| spec.at_supervisor_death) {
        DeathSignal::HangUp => Some(Signal::HUP),
        DeathSignal::Nothing => None,
        DeathSignal::Kill => Some(Signal::KILL),
    };
    let parent = rustix::process::getpid();
    let before_exec = move || {
        // iceoryx2 opens its files and sockets without close-on-exec, and a child that inherited them would keep them
        // open after our death.
        // SAFETY: only flags of descriptors are changed, in the child.
        if unsafe { libc::close_range(3, libc::c_uint::MAX, libc::CLOSE_RANGE_CLOEXEC as libc::c_int) } != 0 {
            return Err(std::io::Error::last_os_error());
        }
        for fd in keep {
            // SAFETY: the parent holds both open until the child is spawned.
            let fd = unsafe { std::os::fd::BorrowedFd::borrow_raw(fd) };
            rustix::io::fcntl_setfd(fd, rustix::io::FdFlags::empty())?;
        }
        // A core dump would keep the lifeline open for as long as it takes. 1 rather than 0: some kernels still run a
        // piped core handler at 0.
        rustix::process::setrlimit(Resource::Core, Rlimit { current: Some(1), maximum: Some(1) })?;
        if service == ServiceId::Policy {
            // Whatever an executable of others prints, it does not fill the disk: it dies of it.
            let log = Rlimit { current: Some(POLICY_FILE_BYTES), maximum: Some(POLICY_FILE_BYTES) };
            rustix::process::setrlimit(Resource::Fsize, log)?;
        }
        // A supervisor under `nohup` ignores SIGHUP; to a child it tells of the supervisor's death.
        // SAFETY: one system call, in the child.
        unsafe { nix::sys::signal::signal(nix::sys::signal::Signal::SIGHUP, nix::sys::signal::SigHandler::SigDfl) }?;
        if at_our_death.is_some() {
            rustix::process::set_parent_process_death_signal(at_our_death)?;
            if rustix::process::getppid() != Some(parent) {
                return Err(std::io::Error::other("the supervisor is gone"));
            }
        }
        Ok(())
    };
    // SAFETY: the closure makes system calls only: it neither allocates nor takes a lock.
    unsafe { command.pre_exec(before_exec) };
}
