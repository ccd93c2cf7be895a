//! `bench soak`: what a thousand deaths leave behind, and how often a robot stops for no reason.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use messages::fault::Dice;
use messages::{ModeClass, ServiceId, StopKind};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use super::faults::rig::{LOOK, Rig};
use super::faults::table::RESTARTED;
use crate::args::{PaceArgs, SoakArgs, WalkArgs, WorldArgs};
use crate::exit::{EXIT_NOT_REACHED, EXIT_OK, Failure};
use crate::find::free_name;
use crate::launch::Launch;
use crate::out::{self, number};
use crate::prepare;
use crate::workers::progress;

/// A killed service is back, and the robot ready, within this.
const BACK_WITHIN: Duration = Duration::from_secs(20);
/// What is let go is gone after this.
const SETTLE: Duration = Duration::from_secs(2);
/// Growth that is none: what an allocator keeps for later, KiB, and files of a life that has just begun.
const RESIDENT_SLACK_KIB: i64 = 1024;
const FILES_SLACK: i64 = 2;
const SHM_SLACK_KIB: i64 = 64;
/// The scenarios of the quiet hour, in turn.
const QUIET: [&str; 6] = ["corridor", "curve", "left-at-tee", "crossing", "cluttered", "l-turn"];
/// What stops a robot rightly where nothing is broken: its way, its handler, its cues, the run's own ends.
const RIGHTLY: [StopKind; 10] = [
    StopKind::Boot,
    StopKind::ShuttingDown,
    StopKind::Arrived,
    StopKind::NoPermit,
    StopKind::NoCue,
    StopKind::StopCue,
    StopKind::PolicyStop,
    StopKind::AllUnsafe,
    StopKind::RemainderUnsafe,
    StopKind::OperatorStop,
];

/// What a run takes of the machine.
#[derive(Debug, Clone, Copy, Default)]
struct Taken {
    shm_files: i64,
    shm_kib: i64,
    files: i64,
    descriptors: i64,
    resident_kib: i64,
}

/// `guidedog bench soak`: the exit code.
///
/// # Errors
/// Where a run cannot be started or a service does not come back.
pub fn bench(args: &SoakArgs, as_json: bool) -> Result<u8, Failure> {
    if args.kills == 0 && args.quiet.is_none() {
        return Err(Failure::input("nothing to do: no kills, and no --quiet time"));
    }
    let (mut report, mut well) = (json!({}), true);
    if args.kills > 0 {
        let kills = kill_many(args.kills, args.warm_up)?;
        well &= kills["grown"] == json!([]) && kills["orphans"] == 0;
        report["kills"] = kills;
    }
    if let Some(span) = args.quiet {
        let quiet = quiet_time(span.s())?;
        well &= quiet["false_stops"] == 0;
        report["quiet"] = quiet;
    }
    out::tell(as_json, &report, || lines(&report))?;
    Ok(if well { EXIT_OK } else { EXIT_NOT_REACHED })
}

/// Takes a core's time while it lives.
struct Load(Arc<AtomicBool>);

impl Load {
    fn new() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&stop);
        std::thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                std::hint::spin_loop();
            }
        });
        Self(stop)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn kill_many(kills: u32, warm_up: u32) -> Result<Value, Failure> {
    let mut rig = Rig::new()?;
    let load = Load::new();
    let mut dice = Dice::new(1);
    let mut pids = BTreeSet::new();
    let mut before = Taken::default();
    for i in progress((warm_up + kills).into(), "kills").wrap_iter(0..warm_up + kills) {
        if i == warm_up {
            before = taken(&mut rig)?;
        }
        rig.walk()?;
        if rig.runs > 1 {
            return Err(Failure::run("the run did not survive: there is nothing to compare"));
        }
        let victim = RESTARTED[dice.between((0, RESTARTED.len() as u64)) as usize];
        pids.extend(kill(&mut rig, victim)?);
    }
    let after = taken(&mut rig)?;
    let dir = rig.dir();
    drop(load);
    rig.end();
    let orphans = pids.iter().filter(|pid| Path::new(&format!("/proc/{pid}")).exists()).count();
    let left = dir.is_some_and(|dir| dir.exists());
    let grown: Vec<&str> = [
        ("shm_files", after.shm_files - before.shm_files, FILES_SLACK),
        ("shm_kib", after.shm_kib - before.shm_kib, SHM_SLACK_KIB),
        ("files", after.files - before.files, FILES_SLACK),
        ("descriptors", after.descriptors - before.descriptors, 0),
        ("resident_kib", after.resident_kib - before.resident_kib, RESIDENT_SLACK_KIB),
        ("run directory left", i64::from(left), 0),
    ]
    .into_iter()
    .filter_map(|(what, growth, slack)| (growth > slack).then_some(what))
    .collect();
    Ok(json!({
        "n": kills, "orphans": orphans, "grown": grown, "before": before.json(), "after": after.json(),
    }))
}

/// Kills a service and waits until the robot is ready again: the process that died.
fn kill(rig: &mut Rig, victim: ServiceId) -> Result<Option<u32>, Failure> {
    let (pid, epoch) = rig.seen(|seen| (seen.pids.get(&victim).copied(), seen.mode.map(|mode| mode.epoch)));
    if let Some(pid) = pid.and_then(|pid| i32::try_from(pid).ok()).and_then(Pid::from_raw) {
        // It may be gone with the death before.
        let _ = kill_process(pid, Signal::KILL);
    }
    let since = Instant::now();
    let back = |rig: &Rig| {
        rig.seen(|seen| {
            let fault = seen.mode.is_some_and(|mode| mode.class == ModeClass::Fault && mode.ready_for_cue);
            fault && seen.mode.map(|mode| mode.epoch) != epoch
        })
    };
    while !back(rig) {
        if since.elapsed() > BACK_WITHIN || !rig.is_alive() {
            return Err(Failure::run(format!("{victim} did not come back")));
        }
        std::thread::sleep(LOOK);
    }
    rig.forget();
    Ok(pid)
}

fn count_files(path: &Path) -> i64 {
    let Ok(entries) = std::fs::read_dir(path) else { return 0 };
    let count = |entry: std::fs::DirEntry| 1 + if entry.path().is_dir() { count_files(&entry.path()) } else { 0 };
    entries.flatten().map(count).sum()
}

/// What the run takes now, and its long-lived processes: the supervisor and the world.
fn taken(rig: &mut Rig) -> Result<Taken, Failure> {
    std::thread::sleep(SETTLE);
    let dir = rig.dir().ok_or_else(|| Failure::run("the run is gone"))?;
    let prefix = transport::RunDir::open(&dir).prefix();
    let mut taken = Taken { files: count_files(&dir), ..Taken::default() };
    for entry in std::fs::read_dir(transport::SHM).map_err(Failure::of_run)?.flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let blocks = entry.metadata().map_or(0, |meta| std::os::unix::fs::MetadataExt::blocks(&meta));
            taken.shm_files += 1;
            taken.shm_kib += (blocks / 2) as i64;
        }
    }
    let world = rig.seen(|seen| seen.pids.get(&ServiceId::Simulator).copied());
    for pid in [rig.supervisor_pid(), world].into_iter().flatten() {
        taken.descriptors += count_files(Path::new(&format!("/proc/{pid}/fd")));
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"));
        taken.resident_kib += line.and_then(|l| l.split_whitespace().next()?.parse::<i64>().ok()).unwrap_or(0);
    }
    Ok(taken)
}

impl Taken {
    fn json(self) -> Value {
        json!({
            "shm_files": self.shm_files, "shm_kib": self.shm_kib, "files": self.files,
            "descriptors": self.descriptors, "resident_kib": self.resident_kib,
        })
    }
}

/// Walks of the built-in scenarios, as fast as they go, until so much run time has passed.
fn quiet_time(seconds: f64) -> Result<Value, Failure> {
    let (mut walked_s, mut false_stops) = (0.0, Vec::new());
    let mut walks = 0;
    while walked_s < seconds {
        let scenario = Some(QUIET[walks % QUIET.len()].to_owned());
        let world = WorldArgs { scenario, pace: PaceArgs::default(), ..WorldArgs::default() };
        let seed = Some(1 + (walks / QUIET.len()) as u64);
        let mut prepared = prepare::walk(&WalkArgs { world, seed, ..WalkArgs::default() })?;
        prepared.settings.run_record.keep_runs = 0;
        let launch = Launch { settings: &prepared.settings, name: free_name("soak"), speed: Some(0.0) };
        let outcome = launch.spawn()?.wait(|| {})?;
        if outcome.interrupted {
            return Err(Failure::run("interrupted"));
        }
        walks += 1;
        walked_s += outcome.report.duration_s;
        let wrong =
            outcome.report.stops.into_iter().filter(|stop| RIGHTLY.iter().all(|kind| stop.reason != kind.name()));
        false_stops.extend(wrong.map(|stop| stop.why));
    }
    Ok(json!({
        "hours": walked_s / 3600.0, "walks": walks, "false_stops": false_stops.len(),
        "false_stops_per_hour": false_stops.len() as f64 * 3600.0 / walked_s, "why": false_stops,
    }))
}

fn lines(report: &Value) -> Vec<String> {
    let mut lines = Vec::new();
    if report["kills"].is_object() {
        let kills = &report["kills"];
        lines.push(format!("{} kills: {} orphans, grown: {}", kills["n"], kills["orphans"], kills["grown"]));
        lines.push(format!("before  {}", kills["before"]));
        lines.push(format!("after   {}", kills["after"]));
    }
    if report["quiet"].is_object() {
        let quiet = &report["quiet"];
        lines.push(format!(
            "{:.2} h of walks without a fault: {} false stops, {:.2} an hour",
            number(quiet, "/hours"),
            quiet["false_stops"],
            number(quiet, "/false_stops_per_hour")
        ));
    }
    lines
}
