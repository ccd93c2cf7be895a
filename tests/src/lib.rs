//! What the black-box tests have in common: runs of the built programs, each in a folder of its own.

mod built;
mod ears;
mod mouth;
mod rig;
mod spoken;
pub mod supervision;
mod tap;
mod wire;

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use control::{AskError, Client, ServiceStatus, Status};
use messages::{CueKind, CueSource, MicrophoneState, ModeClass, ServiceId};
use serde_json::Value;
use transport::RunDir;

pub use built::{has_legs, programs};
pub use ears::Ears;
pub use mouth::Mouth;
pub use rig::{SoundRig, has_sound, speech_s};
pub use spoken::{RATE_HZ, can_hear, spoken, spoken_by, write_wav};
pub use tap::{Seen, Tap};
pub use test_data::data;
pub use transport::monotonic_ns;
pub use wire::{Came, Wire};

/// No wait of a test takes longer on any machine.
pub const WATCHDOG: Duration = Duration::from_secs(120);

/// Waits until it is so; the test has failed where it never is.
pub fn until(what: &str, is_so: impl FnMut() -> bool) {
    until_or(|| what.to_owned(), is_so);
}

/// Waits until it is so. Panics with `what()` after [`WATCHDOG`].
pub fn until_or(what: impl Fn() -> String, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < WATCHDOG, "never: {}", what());
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// How often robot and handler touched something, by the report of a walk.
#[must_use]
pub fn touches(report: &Value) -> [u64; 2] {
    ["robot", "handler"].map(|who| report["collisions"][who].as_u64().unwrap_or(u64::MAX))
}

/// The project's folder.
#[must_use]
pub fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests lie in the project").to_owned()
}

/// A folder for runs that no other test shares, short enough for socket names.
#[derive(Debug)]
pub struct Place {
    dir: tempfile::TempDir,
    /// Where runs live.
    runs: PathBuf,
    /// Prefixes of the shared memory of all runs that were seen alive here.
    prefixes: RefCell<BTreeSet<String>>,
    /// What the programs that are started here find in their environment.
    variables: Vec<(OsString, OsString)>,
}

impl Default for Place {
    fn default() -> Self {
        Self::new()
    }
}

impl Place {
    /// A new place.
    #[must_use]
    pub fn new() -> Self {
        let dir = tempfile::Builder::new().prefix("gd").tempdir_in("/tmp").expect("a folder in /tmp");
        let runs = dir.path().join("r");
        Self { dir, runs, prefixes: RefCell::default(), variables: Vec::new() }
    }

    /// A new place whose runs live in this folder below it.
    #[must_use]
    pub fn with_runs_in(folder: &Path) -> Self {
        let place = Self::new();
        Self { runs: place.path().join(folder), ..place }
    }

    /// A new place whose programs find this sound card.
    #[must_use]
    pub fn with_sound(rig: &SoundRig) -> Self {
        Self { variables: rig.variables().into(), ..Self::new() }
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    /// A scenario file in this built-in world, with these lines besides.
    #[must_use]
    pub fn scenario(&self, world: &str, lines: &str) -> String {
        let world = project().join("config/worlds").join(world);
        let path = self.path().join("scenario.toml");
        fs::write(&path, format!("world = {world:?}\n{lines}\n")).expect("written");
        path.to_string_lossy().into_owned()
    }

    /// A scenario that ends `way_m` along the built-in corridor. Its time limit is a watchdog: in real time, a run on a
    /// busy machine begins later.
    #[must_use]
    pub fn along_corridor(&self, way_m: f64) -> String {
        let lines =
            "time_limit_s = 120\nstart = { at = [0, 0], yaw_deg = 0 }\n[[cue]]\nkind = \"forward\"\nat_s = 1.0\n";
        self.scenario("corridor.toml", &format!("goal = {{ at = [{way_m:?}, 0], within_m = 0.5 }}\n{lines}"))
    }

    /// Notes the prefix of a run that is alive, so that [`Place::assert_empty`] can look for what it leaves.
    fn note_prefix(&self, run: &str) {
        let Ok(text) = fs::read_to_string(self.runs.join(run).join("run.json")) else { return };
        let info: Value = serde_json::from_str(&text).unwrap_or(Value::Null);
        if let Some(prefix) = info["prefix"].as_str() {
            self.prefixes.borrow_mut().insert(prefix.to_owned());
        }
    }

    /// `guidedog` with these arguments, at this place.
    #[must_use]
    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(programs().join("guidedog"));
        command.args(args).current_dir(project()).env("GUIDEDOG_RUNS", &self.runs);
        command.env("GUIDEDOG_STATE", self.path().join("state"));
        command.envs(self.variables.iter().map(|(name, value)| (name, value)));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Runs `guidedog` to its end.
    #[must_use]
    pub fn guidedog(&self, args: &[&str]) -> Output {
        self.command(args).output().expect("guidedog starts")
    }

    /// Runs `guidedog` to its end; what it printed as JSON, and its exit code.
    #[must_use]
    pub fn json(&self, args: &[&str]) -> (Value, i32) {
        let output = self.guidedog(args);
        let text = String::from_utf8_lossy(&output.stdout);
        let value = serde_json::from_str(&text).unwrap_or_else(|error| {
            panic!("{args:?} printed no JSON ({error}): {text}{}", String::from_utf8_lossy(&output.stderr))
        });
        (value, output.status.code().unwrap_or(-1))
    }

    /// Nothing of a run is left: no folder, no shared memory.
    pub fn assert_empty(&self) {
        let runs = &self.runs;
        let left: Vec<_> = fs::read_dir(runs).map(|entries| entries.flatten().collect()).unwrap_or_default();
        assert!(left.is_empty(), "left behind: {left:?}");
        // Whatever the run was called: those that were seen alive, and those that name themselves.
        for name in ["walk", "walk-2", "replay", "replay-2", "run", "one", "two"] {
            self.prefixes.borrow_mut().insert(RunDir::open(&runs.join(name)).prefix());
        }
        let prefixes = self.prefixes.borrow();
        let shared: Vec<_> = fs::read_dir("/dev/shm")
            .expect("Linux has it")
            .flatten()
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .filter(|name| prefixes.iter().any(|prefix| name.starts_with(prefix.as_str())))
            .collect();
        assert!(shared.is_empty(), "left in shared memory: {shared:?}");
    }
}

/// A run that goes on while the test looks at it.
#[derive(Debug)]
pub struct Live<'a> {
    place: &'a Place,
    /// Its name.
    pub name: String,
    child: Child,
}

impl<'a> Live<'a> {
    /// `guidedog up --json` with these arguments besides.
    #[must_use]
    pub fn up(place: &'a Place, name: &str, args: &[&str]) -> Self {
        Self::begun(place, "up", name, args)
    }

    /// `guidedog walk --json` with these arguments besides.
    #[must_use]
    pub fn walk(place: &'a Place, name: &str, args: &[&str]) -> Self {
        Self::begun(place, "walk", name, args)
    }

    fn begun(place: &'a Place, verb: &str, name: &str, args: &[&str]) -> Self {
        let mut all = vec![verb, "--json", "--name", name];
        all.extend(args);
        let child = place.command(&all).spawn().expect("guidedog starts");
        Self { place, name: name.to_owned(), child }
    }

    /// The same in a mount namespace of its own, with a `/dev/shm` of that size; none where none can be had.
    #[must_use]
    pub fn up_in_shm_of(place: &'a Place, name: &str, size: &str, args: &[&str]) -> Option<Self> {
        let may = Command::new("unshare").args(["--mount", "true"]).stderr(Stdio::null()).status();
        if !may.is_ok_and(|status| status.success()) {
            return None;
        }
        let up = place.command(&[]);
        let mount = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm && exec \"$0\" \"$@\"");
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", &mount]).arg(up.get_program()).args(["up", "--json", "--name", name]);
        command.args(args).current_dir(project()).env("GUIDEDOG_RUNS", &place.runs);
        command.env("GUIDEDOG_STATE", place.path().join("state"));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().expect("unshare starts");
        Some(Self { place, name: name.to_owned(), child })
    }

    /// A run that the test has started at this place, its output piped.
    #[must_use]
    pub fn of(place: &'a Place, name: &str, child: Child) -> Self {
        Self { place, name: name.to_owned(), child }
    }

    /// What the supervisor says of the run.
    ///
    /// # Errors
    /// While it says nothing, or what this program cannot read.
    pub fn try_status(&self) -> Result<Status, AskError> {
        self.place.note_prefix(&self.name);
        Client::connect(&RunDir::open(&self.dir()).control_socket())?.read()
    }

    /// What the supervisor says of the run, once it says something.
    #[must_use]
    pub fn status(&self) -> Status {
        let since = Instant::now();
        loop {
            match self.try_status() {
                Ok(status) => return status,
                Err(error) => assert!(since.elapsed() < WATCHDOG, "never a status of {}: {error}", self.name),
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until the status is as wanted.
    pub fn wait(&mut self, what: &str, wanted: impl Fn(&Status) -> bool) -> Status {
        let since = Instant::now();
        loop {
            let status = self.try_status();
            if let Ok(status) = &status
                && wanted(status)
            {
                return status.clone();
            }
            if let Some(exit) = self.child.try_wait().expect("the run is ours") {
                let mut text = String::new();
                if let Some(stderr) = &mut self.child.stderr {
                    let _ = stderr.read_to_string(&mut text);
                }
                panic!("the run ended ({exit}) before: {what}: {text}");
            }
            assert!(since.elapsed() < WATCHDOG, "never: {what}: {status:#?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until the robot walks.
    pub fn wait_walking(&mut self) -> Status {
        self.wait("the robot walks", |status| status.mode.class == ModeClass::Run && vx_mps(status).abs() > 0.2)
    }

    /// The run's directory.
    #[must_use]
    pub fn dir(&self) -> PathBuf {
        self.place.runs.join(&self.name)
    }

    /// Process id of the supervisor.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Ends the run as Ctrl-C does: its report and exit code.
    #[must_use]
    pub fn end(self) -> (Value, i32) {
        signal(self.child.id(), "INT");
        self.finish()
    }

    /// Waits for the run's own end: what it wrote to standard error.
    #[must_use]
    pub fn finish_told(mut self) -> String {
        let child = std::mem::replace(&mut self.child, Command::new("true").spawn().expect("true"));
        let output = child.wait_with_output().expect("the run is ours");
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    /// Waits for the run's own end: its report and exit code.
    #[must_use]
    pub fn finish(mut self) -> (Value, i32) {
        let child = std::mem::replace(&mut self.child, Command::new("true").spawn().expect("true"));
        let output = child.wait_with_output().expect("the run is ours");
        (serde_json::from_slice(&output.stdout).unwrap_or(Value::Null), output.status.code().unwrap_or(-1))
    }
}

impl Drop for Live<'_> {
    fn drop(&mut self) {
        // A test that failed must not leave a robot walking.
        if matches!(self.child.try_wait(), Ok(None)) {
            signal(self.child.id(), "TERM");
            let _ = self.child.wait();
        }
    }
}

/// Sends a signal by name.
pub fn signal(pid: u32, name: &str) {
    let status = Command::new("kill").args([&format!("-{name}"), &pid.to_string()]).status();
    assert!(status.is_ok_and(|status| status.success()), "kill -{name} {pid}");
}

/// The service of that name in a status.
#[must_use]
pub fn service<'a>(status: &'a Status, name: &str) -> &'a ServiceStatus {
    let service = ServiceId::from_name(name).and_then(|service| status.service(service));
    service.unwrap_or_else(|| panic!("no {name} in {status:#?}"))
}

/// Process id of a service.
#[must_use]
pub fn pid_of(status: &Status, name: &str) -> u32 {
    service(status, name).pid
}

/// Process ids of all services that are there.
#[must_use]
pub fn pids(status: &Status) -> Vec<u32> {
    status.services.iter().map(|service| service.pid).filter(|pid| *pid > 0).collect()
}

/// The velocity forward that locomotion commands, metres per second; 0 before its first word.
#[must_use]
pub fn vx_mps(status: &Status) -> f64 {
    status.locomotion.as_ref().map_or(0.0, |locomotion| locomotion.velocity[0])
}

/// Whether a note tells of it.
#[must_use]
pub fn told(status: &Status, what: &str) -> bool {
    status.notes.iter().any(|note| note.text.contains(what))
}

/// Whether the handler's voice is heard, or what there is instead.
#[must_use]
pub fn microphone(status: &Status) -> MicrophoneState {
    status.microphone.as_ref().map_or(MicrophoneState::None, |microphone| microphone.state)
}

/// Whether a spoken cue of that kind is in force.
#[must_use]
pub fn spoken_cue(status: &Status, kind: CueKind) -> bool {
    status.mode.cue.as_ref().is_some_and(|cue| cue.kind == kind && cue.source == CueSource::Voice)
}

/// Whether a process is alive (a zombie is not).
#[must_use]
pub fn is_alive(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat"))
        .is_ok_and(|stat| stat.rsplit(')').next().is_some_and(|rest| !rest.trim_start().starts_with('Z')))
}
