//! A live run for faults to be done to: a long corridor, nobody but the bench to give cues, restarts without end.

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use control::{AskError, Client, Done, Query, Report, Request, ServicePhase, Status};
use messages::{CueKind, ServiceId};
use settings::{LinkKind, Millis, PolicyModel};
use tempfile::TempDir;
use transport::runs_root;
use unitree::{Profile, Silence};

use super::tap::{Seen, Tap};
use crate::args::{PaceArgs, WalkArgs, WorldArgs};
use crate::exit::Failure;
use crate::find::{free_name, socket};
use crate::launch::{Launch, Running};
use crate::prepare;

/// The corridor's length, metres: some thousand trials of a metre or two.
const CORRIDOR_M: u32 = 1900;
/// Its walls are of pieces so long, metres.
const PIECE_M: u32 = 400;
/// So much before its end the run begins again, metres.
const TURN_M: f64 = 30.0;
/// A run is up, and the robot walks after a stop, within this; otherwise the run is given up.
const WALKS_WITHIN: Duration = Duration::from_secs(30);
/// A cue that did not lead to a walk is given again after this.
const CUE_AGAIN: Duration = Duration::from_millis(300);
/// Looks at what the tap saw come this often.
pub const LOOK: Duration = Duration::from_millis(1);

/// And at the recorder, which the supervisor tells of.
const RECORDER_LOOK: Duration = Duration::from_millis(20);

/// One run, and what is needed for the next.
#[derive(Debug)]
pub struct Rig {
    place: TempDir,
    settings: settings::Settings,
    live: Option<Live>,
    /// Runs that were started.
    pub runs: u32,
    /// Folder of the recording, while there is one.
    recording: Option<TempDir>,
}

#[derive(Debug)]
struct Live {
    running: Running,
    tap: Tap,
    client: Option<Client>,
}

fn corridor() -> String {
    let mut text = "# A corridor 2.4 m wide.\n".to_owned();
    let ends = (0..=CORRIDOR_M / PIECE_M).map(|i| (i * PIECE_M, ((i + 1) * PIECE_M).min(CORRIDOR_M)));
    for (from, to) in ends.filter(|(from, to)| from < to) {
        for y in ["-1.2", "1.2"] {
            // A String takes whatever is written to it.
            let _ = writeln!(text, "[[wall]]\npoints = [[{from}, {y}], [{to}, {y}]]");
        }
    }
    text + &format!(
        "[[wall]]\npoints = [[0, -1.2], [0, 1.2]]\n[[wall]]\npoints = [[{CORRIDOR_M}, -1.2], [{CORRIDOR_M}, 1.2]]\n"
    )
}

fn settings_at(place: &TempDir) -> Result<settings::Settings, Failure> {
    let write = |name: &str, text: &str| -> Result<PathBuf, Failure> {
        let path = place.path().join(name);
        let mut file = std::fs::File::create(&path).map_err(Failure::of_run)?;
        file.write_all(text.as_bytes()).map_err(Failure::of_run)?;
        Ok(path)
    };
    let map = Some(write("corridor.toml", &corridor())?);
    let cues = Some(write("silent.toml", "# Nobody but the bench gives cues.\n")?);
    let pace = PaceArgs { faults: true, ..PaceArgs::default() };
    let start = Some(messages::Pose2::new(3.0, 0.0, 0.0));
    let world = WorldArgs { map, start, cues, pace, ..WorldArgs::default() };
    let mut settings = prepare::walk(&WalkArgs { world, ..WalkArgs::default() })?.settings;
    let time = |text: &str| Millis::try_from(text.to_owned()).map_err(Failure::input);
    // The longest there is; then another run begins.
    settings.walk.time_limit = Some(time("1h")?);
    // A learnt policy may turn to and fro where a fault of odometry has left it, and who hardly moves shows nothing.
    settings.policy.model = PolicyModel::Geometric;
    // Deaths without end are what is wanted here.
    settings.supervision.restart_budget = 1_000_000;
    settings.supervision.back_off_max = settings.supervision.back_off;
    // A bench makes many runs: their records would take the place of the operator's.
    settings.run_record.keep_runs = 0;
    Ok(settings)
}

impl Rig {
    /// Nothing is started yet.
    ///
    /// # Errors
    /// Where no temporary file can be written.
    pub fn new() -> Result<Self, Failure> {
        Self::with(|_| {})
    }

    /// The same with devices emulated in the simulated world, for the real drivers and link: a robot that tells of its
    /// battery, and that does that when nothing more comes.
    ///
    /// # Errors
    /// As [`Rig::new`].
    pub fn emulated(link: LinkKind, silence: Silence) -> Result<Self, Failure> {
        Self::with(|settings| {
            settings.locomotion.link = link;
            settings.emulate();
            settings.simulation.emulated.silence = silence;
            settings.locomotion.unitree.profile = Profile::Go138;
        })
    }

    /// The same with other settings.
    ///
    /// # Errors
    /// As [`Rig::new`].
    pub fn with(change: impl FnOnce(&mut settings::Settings)) -> Result<Self, Failure> {
        let place = tempfile::tempdir().map_err(Failure::of_run)?;
        let mut settings = settings_at(&place)?;
        change(&mut settings);
        Ok(Self { settings, place, live: None, runs: 0, recording: None })
    }

    /// A folder for files of the bench, gone with it.
    pub fn folder(&self) -> &Path {
        self.place.path()
    }

    fn start(&mut self) -> Result<(), Failure> {
        let launch = Launch { settings: &self.settings, name: free_name("faults"), speed: None };
        let running = launch.spawn()?;
        self.runs += 1;
        // Its topics are there once it answers.
        let until = Instant::now() + WALKS_WITHIN;
        let mut live = loop {
            std::thread::sleep(Duration::from_millis(20));
            let mut client = Client::connect(&socket(running.name())).ok();
            if client.as_mut().and_then(|client| client.read::<Status>().ok()).is_some() {
                let tap = Tap::on(&runs_root().join(running.name()));
                break Live { running, tap, client };
            }
            if running.interrupted() || Instant::now() > until {
                return Err(Failure::run("the run did not begin"));
            }
        };
        if live.running.has_ended() {
            return live.running.wait(|| {}).map(|_| ()).and(Err(Failure::run("the run ended as it began")));
        }
        self.live = Some(live);
        Ok(())
    }

    /// Why a run is no more that nobody has ended; none while it goes on.
    pub fn obituary(&mut self) -> Option<String> {
        if self.live.is_none() || self.is_alive() {
            return None;
        }
        let live = self.live.take()?;
        // The listener was of this run.
        let _ = live.tap.stop();
        let ended = live.running.wait(|| {}).map(|_| "it came to its end".to_owned());
        Some(ended.unwrap_or_else(|failure| failure.message))
    }

    /// What was seen of the run; nothing where there is none.
    pub fn seen<T>(&self, look: impl FnOnce(&Seen) -> T) -> T {
        match &self.live {
            Some(live) => look(&live.tap.seen()),
            None => look(&Seen::default()),
        }
    }

    /// Forgets what was, for a new trial.
    pub fn forget(&self) {
        self.live.iter().for_each(|live| live.tap.forget());
    }

    /// Whether the run goes on.
    pub fn is_alive(&mut self) -> bool {
        self.live.as_mut().is_some_and(|live| !live.running.has_ended())
    }

    /// Process id of the supervisor.
    pub fn supervisor_pid(&self) -> Option<u32> {
        self.live.as_ref().map(|live| live.running.pid())
    }

    /// Directory of the run.
    pub fn dir(&self) -> Option<PathBuf> {
        self.live.as_ref().map(|live| runs_root().join(live.running.name()))
    }

    /// Whether the bench was told to end.
    pub fn interrupted(&self) -> bool {
        self.live.as_ref().is_some_and(|live| live.running.interrupted())
    }

    /// Reads something of the run.
    ///
    /// # Errors
    /// Where the supervisor refuses or does not answer, and where no run goes on.
    pub fn read<T: Query>(&mut self) -> Result<T, AskError> {
        self.with_client(Client::read)
    }

    /// Has the run do something.
    ///
    /// # Errors
    /// As [`Rig::read`].
    pub fn tell(&mut self, request: &Request) -> Result<Done, AskError> {
        self.with_client(|client| client.tell(request))
    }

    fn with_client<T>(&mut self, ask: impl FnOnce(&mut Client) -> Result<T, AskError>) -> Result<T, AskError> {
        let live = self.live.as_mut().ok_or(std::io::Error::from(std::io::ErrorKind::NotConnected))?;
        let mut client = match live.client.take() {
            Some(client) => client,
            None => Client::connect(&socket(live.running.name()))?,
        };
        let answer = ask(&mut client);
        if !matches!(answer, Err(AskError::Unanswered(_))) {
            live.client = Some(client);
        }
        answer
    }

    /// Gives a cue, as an operator does: whether it was taken.
    pub fn cue(&mut self) -> bool {
        self.tell(&Request::Cue { cue: CueKind::Forward }).is_ok()
    }

    /// Has the run recorded, and waits until it is.
    ///
    /// # Errors
    /// Where it is not.
    pub fn record(&mut self) -> Result<(), Failure> {
        self.end_recording();
        let folder = tempfile::tempdir_in(self.place.path()).map_err(Failure::of_run)?;
        // Whether it is recorded is seen at the recorder.
        let _ = self.tell(&Request::Record { path: folder.path().join("walk.mcap") });
        self.recording = Some(folder);
        if self.wait_for_recorder(ServicePhase::Ready) {
            Ok(())
        } else {
            Err(Failure::run("the recorder does not record"))
        }
    }

    /// Has the run recorded no longer; the recording goes.
    pub fn end_recording(&mut self) {
        if let Some(folder) = self.recording.take() {
            // It may have ended by itself.
            let _ = self.tell(&Request::RecordStop {});
            self.wait_for_recorder(ServicePhase::Off);
            drop(folder);
        }
    }

    /// Whether it is.
    pub fn is_recording(&self) -> bool {
        self.recording.is_some()
    }

    fn wait_for_recorder(&mut self, state: ServicePhase) -> bool {
        let until = Instant::now() + WALKS_WITHIN;
        while Instant::now() < until && self.is_alive() && !self.interrupted() {
            let status: Option<Status> = self.read().ok();
            if status.and_then(|status| Some(status.service(ServiceId::Recorder)?.state)) == Some(state) {
                return true;
            }
            std::thread::sleep(RECORDER_LOOK);
        }
        false
    }

    /// Whether the corridor is nearly walked to its end.
    pub fn is_near_the_end(&self) -> bool {
        self.seen(|seen| seen.truth.is_some_and(|t| t.x_m > f64::from(CORRIDOR_M) - TURN_M))
    }

    /// Waits until the robot walks, in this run or in a new one.
    ///
    /// # Errors
    /// Where no run can be started, or the robot does not walk in a new one.
    pub fn walk(&mut self) -> Result<(), Failure> {
        for _ in 0..2 {
            if self.is_near_the_end() || !self.is_alive() {
                self.end();
                self.start()?;
            }
            if self.try_walk() {
                return Ok(());
            }
            if self.interrupted() {
                return Err(Failure::run("interrupted"));
            }
            self.end();
        }
        Err(Failure::run(format!("the robot did not walk within {} s", WALKS_WITHIN.as_secs())))
    }

    fn try_walk(&mut self) -> bool {
        let until = Instant::now() + WALKS_WITHIN;
        let mut cue_at = Instant::now();
        while Instant::now() < until && self.is_alive() && !self.interrupted() {
            if self.seen(Seen::walks) {
                return true;
            }
            let class = self.seen(|seen| seen.mode.map(|mode| (mode.class, mode.ready_for_cue, mode.cue.valid)));
            if Instant::now() >= cue_at {
                cue_at = Instant::now() + CUE_AGAIN;
                match class {
                    Some((messages::ModeClass::Lock, ..)) => drop(self.tell(&Request::Resume {})),
                    Some((messages::ModeClass::Fault, true, _) | (messages::ModeClass::Run, _, false)) => {
                        self.cue();
                    }
                    // Until the robot is ready a cue is refused.
                    _ => cue_at = Instant::now(),
                }
            }
            std::thread::sleep(LOOK);
        }
        false
    }

    /// Ends the run, if there is one: its report, if it left one.
    pub fn end(&mut self) -> Option<Report> {
        self.recording = None;
        let mut live = self.live.take()?;
        live.running.end();
        // The listener was of this run, and how that ended was seen.
        let _ = live.tap.stop();
        live.running.wait(|| {}).ok().map(|outcome| outcome.report)
    }
}

impl Seen {
    /// Whether the robot is commanded to walk, and does.
    pub fn walks(&self) -> bool {
        let moves = self.truth.is_some_and(|truth| !truth.stands && truth.zero_since_ns.is_none());
        let in_run = self.mode.is_some_and(|mode| mode.class == messages::ModeClass::Run);
        moves && in_run && self.command.is_some_and(|command| !command.zero)
    }
}
