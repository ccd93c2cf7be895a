//! Starting the supervisor of a run, and waiting for its report. Should this process die, however it dies, the run
//! ends: the supervisor holds the read end of a pipe whose other end only this process has.

use std::io::Read;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use control::Report;
use rustix::process::{Pid, PidfdFlags, Signal};
use settings::{EmulatedPlaces, EstopSource, Settings, Source, VoiceSource};
use transport::{RunDir, SupervisorArgs};

use crate::exit::{EXIT_BAD_INPUT, Failure, one_line};
use crate::find::{let_name_go, take_name};

/// The live view is drawn this often.
const TICK: Duration = Duration::from_millis(200);
/// After the supervisor's end, what it wrote is there within this long.
const LAST_WORDS_WITHIN: Duration = Duration::from_millis(500);
/// A dead supervisor's children have ended after this long (DESIGN 6: at the latest 700 ms).
const ORPHANS_END_WITHIN: Duration = Duration::from_secs(1);

/// A run to start.
#[derive(Debug)]
pub struct Launch<'a> {
    /// Its settings, paths absolute.
    pub settings: &'a Settings,
    /// Its name.
    pub name: String,
    /// Stepped time, at most so many times faster than real; none: real time.
    pub speed: Option<f64>,
}

/// A run that was started here.
#[derive(Debug)]
pub struct Running {
    name: String,
    child: Child,
    /// Its closing ends the run.
    _owner: OwnedFd,
    stdout: Receiver<String>,
    stderr: Receiver<String>,
    signals: &'static Signals,
}

/// How a run ended.
#[derive(Debug)]
pub struct Outcome {
    /// The supervisor's report.
    pub report: Report,
    /// Whether it was ended by a signal to this process.
    pub interrupted: bool,
}

/// The program of that name, beside this one.
///
/// # Errors
/// Where this program's own place cannot be told.
pub fn beside(name: &str) -> Result<PathBuf, Failure> {
    let own = std::env::current_exe().map_err(|error| Failure::run(format!("this program's place: {error}")))?;
    Ok(own.with_file_name(name))
}

impl Launch<'_> {
    /// The supervisor's command line and settings.
    fn command(&self, report: bool) -> Result<Command, Failure> {
        let program = beside("guidedog-supervisor")?;
        if !program.is_file() {
            return Err(Failure::run(format!("{} is missing; build all with `cargo build`", program.display())));
        }
        let settings = self.settings;
        for (key, source) in settings.sources() {
            if self.speed.is_some() && source == Source::Device {
                let why = "is \"device\", and a device keeps its own time: no --speed with it";
                return Err(Failure::input(format!("{key} {why}")));
            }
        }
        if self.speed.is_some() && settings.estop.source != EstopSource::Absent {
            return Err(Failure::input("estop.source names a device, which keeps its own time: no --speed with it"));
        }
        if self.speed.is_some() && settings.cue.voice.source != VoiceSource::Absent {
            return Err(Failure::input("cue.voice: a voice is heard as fast as it speaks: no --speed with it"));
        }
        let depth = &self.settings.depth;
        crate::doctor::preflight((depth.width * depth.height) as usize)?;
        let mut settings = self.settings.clone();
        if settings.simulation.emulated.on {
            let dir = RunDir::open(&transport::runs_root().join(&self.name));
            let places = EmulatedPlaces {
                lidar_port: dir.lidar_port(),
                camera_socket: dir.camera_socket(),
                estop_port: dir.estop_port(),
                robot: dir.robot_address(),
                dds_domain: dir.dds_domain(),
            };
            settings.place_emulated(&places).map_err(Failure::run)?;
        }
        let settings = toml::to_string(&settings).map_err(Failure::of_input)?;
        let mut command = Command::new(program);
        command.args(["--name", &self.name]).env(SupervisorArgs::SETTINGS, settings);
        if let Some(speed) = self.speed {
            command.args(["--speed", &speed.to_string()]);
        }
        if report {
            command.arg("--report");
        }
        Ok(command)
    }

    /// Becomes the supervisor, which writes its journal to standard error in this form and from this level on; returns
    /// only where that fails.
    pub fn exec(&self, report: bool, [log, level]: [String; 2]) -> Failure {
        let command = self.command(report).map(|mut command| {
            command.args(["--log", &log, "--log-level", &level]);
            command
        });
        let run = command.and_then(|command| Ok((command, take_name(&self.name)?)));
        let_name_go();
        match run {
            Ok((mut command, dir)) => {
                hand_over(&mut command, SupervisorArgs::LOCK_FD, dir.lock());
                let error = command.exec();
                dir.remove();
                Failure::run(format!("failed to start {}: {error}", command.get_program().display()))
            }
            Err(failure) => failure,
        }
    }

    /// Starts the supervisor. Signals to this process are passed on to it.
    ///
    /// # Errors
    /// Where it cannot be started.
    pub fn spawn(&self) -> Result<Running, Failure> {
        let run = self.command(true).and_then(|command| Ok((command, take_name(&self.name)?)));
        let_name_go();
        let (command, dir) = run?;
        // Once it is started, the supervisor alone holds the lock.
        self.start(command, &dir).inspect_err(|_| dir.remove())
    }

    fn start(&self, mut command: Command, dir: &RunDir) -> Result<Running, Failure> {
        let (read, write) = rustix::pipe::pipe_with(rustix::pipe::PipeFlags::CLOEXEC).map_err(Failure::of_run)?;
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        hand_over(&mut command, SupervisorArgs::OWNER_FD, Some(read.as_fd()));
        hand_over(&mut command, SupervisorArgs::LOCK_FD, dir.lock());
        // Before there is anybody to pass them on to: a signal now must not leave a run behind.
        let signals = Signals::of_this_process()?;
        let mut child = command
            .spawn()
            .map_err(|error| Failure::run(format!("failed to start {}: {error}", command.get_program().display())))?;
        drop(read);
        let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let pid = pid.ok_or_else(|| Failure::run(format!("{} is no process id", child.id())))?;
        signals.pass_on_to(rustix::process::pidfd_open(pid, PidfdFlags::empty()).map_err(Failure::of_run)?);
        let stdout = read_all(child.stdout.take());
        let stderr = read_all(child.stderr.take());
        Ok(Running { name: self.name.clone(), child, _owner: write, stdout, stderr, signals })
    }
}

/// Leaves a descriptor open for the program that is started, and names it in the variable.
fn hand_over(command: &mut Command, variable: &str, fd: Option<BorrowedFd<'_>>) {
    let Some(raw) = fd.map(|fd| fd.as_raw_fd()) else { return };
    command.env(variable, raw.to_string());
    let keep = move || {
        // SAFETY: the parent holds it open until the child is spawned.
        let fd = unsafe { BorrowedFd::borrow_raw(raw) };
        rustix::io::fcntl_setfd(fd, rustix::io::FdFlags::empty())?;
        Ok(())
    };
    // SAFETY: the closure makes one system call: it neither allocates nor takes a lock.
    unsafe { command.pre_exec(keep) };
}

/// Signals to this process, which are passed on to the run that it waits for. Ctrl-C at a terminal reaches the
/// supervisor by itself; a second signal does no harm.
#[derive(Debug, Default)]
pub struct Signals {
    came: AtomicBool,
    /// The supervisor.
    child: Mutex<Option<OwnedFd>>,
}

impl Signals {
    /// Takes signals from now on; runs of one process, one after the other, share them.
    ///
    /// # Errors
    /// Where they cannot be taken.
    pub fn of_this_process() -> Result<&'static Self, Failure> {
        static SIGNALS: OnceLock<Result<Signals, String>> = OnceLock::new();
        let signals = SIGNALS.get_or_init(|| {
            let handle =
                || SIGNALS.get().and_then(|signals| signals.as_ref().ok()).into_iter().for_each(Self::on_signal);
            transport::on_end_signals(handle).map(|()| Self::default()).map_err(|error| error.to_string())
        });
        signals.as_ref().map_err(|why| Failure::run(why.clone()))
    }

    /// Whether one came.
    pub fn came(&self) -> bool {
        self.came.load(Ordering::Relaxed)
    }

    fn on_signal(&self) {
        self.came.store(true, Ordering::Relaxed);
        if let Some(child) = self.child().as_ref() {
            // It may have ended by itself. One that was stopped hears nothing until it goes on.
            let _ = rustix::process::pidfd_send_signal(child, Signal::TERM);
            let _ = rustix::process::pidfd_send_signal(child, Signal::CONT);
        }
    }

    fn pass_on_to(&self, child: OwnedFd) {
        *self.child() = Some(child);
        if self.came() {
            self.on_signal();
        }
    }

    fn child(&self) -> MutexGuard<'_, Option<OwnedFd>> {
        self.child.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn read_all(pipe: Option<impl Read + Send + 'static>) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // What was read until then is all there is.
            let _ = pipe.read_to_end(&mut bytes);
        }
        // Nobody may wait for it any more.
        let _ = sender.send(String::from_utf8_lossy(&bytes).into_owned());
    });
    receiver
}

impl Running {
    /// The run's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Process id of the supervisor.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Asks the run to end.
    pub fn end(&mut self) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid.filter(|_| !self.has_ended()) {
            // It is not reaped, so the id is still its own; it may have ended by itself. One that is stopped hears
            // nothing.
            let _ = rustix::process::kill_process(pid, Signal::TERM);
            let _ = rustix::process::kill_process(pid, Signal::CONT);
        }
    }

    /// Whether this process was signalled.
    pub fn interrupted(&self) -> bool {
        self.signals.came()
    }

    /// Whether the supervisor has ended; what is left is to [`Running::wait`].
    pub fn has_ended(&mut self) -> bool {
        !matches!(self.child.try_wait(), Ok(None))
    }

    /// Lets the run go on for a while.
    ///
    /// # Errors
    /// Where it ends meanwhile, or this process is signalled.
    pub fn sleep(&mut self, span: Duration) -> Result<(), Failure> {
        let until = Instant::now() + span;
        while Instant::now() < until {
            if self.interrupted() || self.has_ended() {
                return Err(Failure::run("the run ended early"));
            }
            std::thread::sleep((until - Instant::now().min(until)).min(TICK / 2));
        }
        Ok(())
    }

    /// Ends the run, of which something was asked: why a run ended says more than that it no longer answers.
    ///
    /// # Errors
    /// Where the run failed, or what was asked of it did.
    pub fn finish<T>(mut self, asked: Result<T, Failure>) -> Result<T, Failure> {
        self.end();
        match (asked, self.wait(|| {})) {
            (Err(_), Err(failure)) => Err(failure),
            (Err(failure), Ok(outcome)) => {
                let why = outcome.report.failure;
                Err(why.map_or(failure, |why| Failure::run(format!("the run ended: {why}"))))
            }
            (asked, _) => asked,
        }
    }

    /// Waits for the end of the run, calling `tick` five times a second.
    ///
    /// # Errors
    /// Where the run failed, or left no report that this program can read.
    pub fn wait(mut self, mut tick: impl FnMut()) -> Result<Outcome, Failure> {
        let mut report = String::new();
        loop {
            match self.stdout.recv_timeout(TICK) {
                Ok(text) => {
                    report = text;
                    break;
                }
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => tick(),
            }
            if self.has_ended() {
                report = self.stdout.recv_timeout(LAST_WORDS_WITHIN).unwrap_or_default();
                break;
            }
        }
        let status = self.child.wait().map_err(Failure::of_run)?;
        let words = self.stderr.recv_timeout(LAST_WORDS_WITHIN).unwrap_or_default();
        let interrupted = self.interrupted();
        if let Some(signal) = status.signal() {
            return Err(supervisor_died(signal));
        }
        if report.trim().is_empty() {
            return Err(without_report(status, &words));
        }
        match serde_json::from_str(&report) {
            Ok(report) => Ok(Outcome { report, interrupted }),
            Err(error) => Err(unreadable_report(&self.name, &error, &words)),
        }
    }
}

/// Its children stop the robot and end by themselves; what is left of the run is then removed.
fn supervisor_died(signal: i32) -> Failure {
    std::thread::sleep(ORPHANS_END_WITHIN);
    transport::sweep();
    Failure::run(format!(
        "the supervisor died (signal {signal}); its services stopped the robot and ended, and the run is cleaned up"
    ))
}

fn without_report(status: ExitStatus, words: &str) -> Failure {
    // One that could not begin has not taken over its directory.
    transport::sweep();
    let said = words.lines().rev().find_map(|line| line.trim().strip_prefix("guidedog-supervisor: "));
    let said = said.map_or_else(|| one_line(words), str::to_owned);
    let message = if said.is_empty() { format!("the supervisor ended without a report ({status})") } else { said };
    if status.code() == Some(i32::from(EXIT_BAD_INPUT)) { Failure::input(message) } else { Failure::run(message) }
}

/// The supervisor is of another version, or died while it wrote.
fn unreadable_report(name: &str, error: &serde_json::Error, words: &str) -> Failure {
    let wrong = format!("run {name}: the report has a form that this program does not know: {error}");
    let said = one_line(words);
    Failure::run(if said.is_empty() { wrong } else { format!("{wrong}; the supervisor said: {said}") })
}

#[cfg(test)]
mod tests {
    use super::{unreadable_report, without_report};
    use control::Report;
    use std::os::unix::process::ExitStatusExt;
    use std::process::ExitStatus;

    #[test]
    fn the_supervisors_last_words_and_code_are_passed_on() {
        let failure = without_report(ExitStatus::from_raw(2 << 8), "x\nguidedog-supervisor: no such key\n");
        assert_eq!((failure.code, failure.message.as_str()), (2, "no such key"));
        let failure = without_report(ExitStatus::from_raw(101 << 8), "thread panicked\nat a.rs\n");
        assert_eq!((failure.code, failure.message.as_str()), (3, "thread panicked: at a.rs"));
        assert!(without_report(ExitStatus::from_raw(0), "").message.contains("without a report"));
    }

    #[test]
    fn what_is_wrong_with_a_report_is_told() {
        let error = serde_json::from_str::<Report>(r#"{"run":7}"#).expect_err("not a report");
        let told = |words| unreadable_report("walk", &error, words).message;
        let wrong = "run walk: the report has a form that this program does not know: invalid type: integer `7`";
        assert!(told("").starts_with(wrong), "{}", told(""));
        assert!(told("no room\n").ends_with("; the supervisor said: no room"), "{}", told("no room\n"));
    }
}
