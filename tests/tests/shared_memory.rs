//! Shared memory that somebody scribbles over while the robot walks: it stands or walks within its limits, nobody
//! hangs, the operator's stop gets through, and the run ends.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use control::Report;
use guidedog_tests::{Live, Place, Seen, Tap, WATCHDOG, is_alive, monotonic_ns, pids, until};
use transport::RunDir;

/// The services whose words are scribbled over. Not the simulator: what it writes is the world itself.
const WRITERS: [&str; 7] = ["lidar", "depth", "odometry", "cue", "policy", "shield", "supervisor"];
/// Faster than any permit lets the robot walk and turn, metres and radians per second added up.
const TOO_FAST: f64 = 0.8 + 1.2 + 0.1;
/// Below this a robot stands.
const STANDING: f64 = 0.02;

/// Numbers that depend on nothing but the seed (xorshift).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// The pools that a process writes its messages into.
fn pools_of(pid: u32) -> Vec<PathBuf> {
    let maps = fs::read_to_string(format!("/proc/{pid}/maps")).unwrap_or_default();
    let lines = maps.lines().filter(|line| line.contains("rw-s") && line.ends_with(".data"));
    let mut paths: Vec<PathBuf> = lines.filter_map(|line| Some(PathBuf::from(&line[line.find('/')?..]))).collect();
    paths.sort();
    paths.dedup();
    paths
}

/// Where the messages of a pool lie: between iceoryx2's books on it, which are at its head and at its end. Half of what
/// is scribbled goes to the first messages, which are used most.
fn messages_in(file: &fs::File, numbers: &mut Numbers) -> Option<Range<u64>> {
    const HEAD: usize = 136;
    let mut head = [0u8; HEAD];
    file.read_exact_at(&mut head, 0).ok()?;
    let count = u32::from_ne_bytes(head[28..32].try_into().ok()?);
    let bytes = u64::from_ne_bytes(head[48..56].try_into().ok()?);
    let used = if numbers.next().is_multiple_of(2) { 4 } else { u64::from(count) };
    let end = HEAD as u64 + used * bytes;
    (end <= file.metadata().ok()?.len()).then_some(HEAD as u64..end)
}

/// Writes up to `most` random bytes at a random place of a file, or only of its messages.
fn scribble(path: &PathBuf, numbers: &mut Numbers, most: u64, messages_only: bool) {
    // A process that was replaced has taken its pools along.
    let Ok(file) = fs::File::options().read(true).write(true).open(path) else { return };
    let whole = file.metadata().map_or(0..0, |found| 0..found.len());
    let place = if messages_only { messages_in(&file, numbers) } else { Some(whole) };
    let bytes: Vec<u8> = (0..1 + numbers.next() % most).map(|_| numbers.next() as u8).collect();
    // Never beyond the end, which would make the file longer.
    let Some(place) = place.filter(|place| place.end - place.start > bytes.len() as u64) else { return };
    let at = place.start + numbers.next() % (place.end - place.start - bytes.len() as u64);
    // One that is gone by now has taken what was written along.
    let _ = file.write_all_at(&bytes, at);
}

/// The invalid messages that consumers told of, all together; these numbers are scribbled over as well.
fn invalid(by_topic: &BTreeMap<String, BTreeMap<String, u64>>) -> u64 {
    by_topic.values().flat_map(BTreeMap::values).copied().fold(0, u64::saturating_add)
}

/// Waits until nothing faster than standing has been seen for half a second.
fn wait_standing(tap: &Tap) {
    let since = Instant::now();
    loop {
        let seen = tap.since(monotonic_ns().saturating_sub(500_000_000));
        let speeds: Vec<f64> = seen
            .iter()
            .filter_map(|(_, seen)| if let Seen::Speed(speed) = seen { Some(*speed) } else { None })
            .collect();
        if speeds.len() > 5 && speeds.iter().all(|speed| *speed < STANDING) {
            return;
        }
        assert!(since.elapsed() < WATCHDOG, "the robot does not stand: {speeds:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn messages_that_are_scribbled_over_move_nobody_and_the_stop_gets_through() {
    let place = Place::new();
    let mut run = Live::up(&place, "ink", &["--scenario", "corridor"]);
    run.wait_walking();
    let tap = Tap::on(run.dir());
    let mut numbers = Numbers(0x5eed_1234_5678_9abc);
    let since = Instant::now();
    let mut status = run.status();
    let mut rounds = 0;
    // Until somebody has dropped something, and for a while at least.
    while invalid(&status.invalid_messages) < 20 || rounds < 40 {
        assert!(since.elapsed() < WATCHDOG, "nobody notices: {status:#?}");
        let pids: BTreeMap<&str, u32> = WRITERS
            .into_iter()
            .filter_map(|name| match name {
                "supervisor" => Some((name, run.pid())),
                name => Some((name, status.services.iter().find(|service| service.name == name)?.pid)),
            })
            .collect();
        let pools: Vec<PathBuf> = pids.values().flat_map(|pid| pools_of(*pid)).collect();
        for _ in 0..200 {
            if let Some(path) = pools.get(numbers.next() as usize % pools.len().max(1)) {
                scribble(path, &mut numbers, 64, true);
            }
        }
        status = run.status();
        rounds += 1;
    }
    eprintln!(
        "{} invalid messages in {rounds} rounds: {:?}",
        invalid(&status.invalid_messages),
        status.invalid_messages
    );
    let output = place.guidedog(&["stop", "--run", "ink"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    wait_standing(&tap);
    let fastest = tap.since(0).into_iter().fold(0.0, |most: f64, (_, seen)| match seen {
        Seen::Speed(speed) => most.max(speed),
        Seen::Command { .. } => most,
    });
    assert!(fastest < TOO_FAST, "{fastest}");
    tap.stop();
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    let report: Report = serde_json::from_value(report).expect("a report");
    assert!(invalid(&report.invalid_messages) > 0, "the report tells as well");
    place.assert_empty();
}

/// All of a run's shared memory, iceoryx2's own books among it.
fn everything(prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir("/dev/shm").expect("Linux has it").flatten();
    let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    ours.map(|entry| entry.path()).collect()
}

#[test]
fn where_the_transports_own_books_are_scribbled_over_the_run_ends_and_nobody_is_left() {
    let place = Place::new();
    let mut run = Live::up(&place, "books", &["--scenario", "corridor"]);
    let status = run.wait_walking();
    let mut pids = pids(&status);
    pids.push(run.pid());
    let prefix = RunDir::open(&run.dir()).prefix();
    let mut numbers = Numbers(0x0b00_c5ee_d000_0001);
    for _ in 0..20 {
        for path in everything(&prefix) {
            scribble(&path, &mut numbers, 256, false);
        }
    }
    // The operator's stop needs none of it; where the supervisor itself has fallen, everybody has stopped already.
    let output = place.guidedog(&["stop", "--run", "books"]);
    eprintln!("stop: {:?} {}", output.status.code(), String::from_utf8_lossy(&output.stderr));
    let supervisor = run.pid();
    let (report, code) = run.end();
    eprintln!("the run ended with {code}: {} {}", report["failure"], report["stops"]);
    until(&format!("every process of the run of {supervisor} has ended"), || !pids.iter().any(|pid| is_alive(*pid)));
    // What a supervisor that fell left behind goes with the next run.
    let (_, code) = place.json(&["walk", "--speed", "0", "--time-limit", "1s", "--json"]);
    assert_eq!(code, 1, "the next run is a run like any other");
    place.assert_empty();
}
