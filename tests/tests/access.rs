//! Who may do what to a run: its files, its socket, its place, and that no flood keeps a stop out.

use std::collections::BTreeSet;
use std::fs;
use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, symlink};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use control::{Policies, Status, Why};
use guidedog_tests::{Live, Place, pids, programs, signal, until};
use messages::ModeClass;
use serde_json::{Value, json};
use transport::RunDir;

/// A user and a group that own nothing here.
const STRANGER: u32 = 65_534;
const GROUP: u32 = 42_424;

fn is_root() -> bool {
    fs::metadata("/proc/self").expect("Linux has it").uid() == 0
}

fn mode(path: &Path) -> u32 {
    fs::symlink_metadata(path).expect("it is there").mode() & 0o777
}

/// Everything below a directory.
fn below(dir: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in fs::read_dir(dir).expect("readable").flatten() {
        // Nodes and ports come and go.
        if let Ok(kind) = entry.file_type() {
            if kind.is_dir() {
                below(&entry.path(), found);
            }
            found.push(entry.path());
        }
    }
}

#[test]
fn what_a_run_makes_is_closed_to_others() {
    let place = Place::new();
    let mut run = Live::up(&place, "modes", &["--scenario", "corridor"]);
    run.wait_walking();
    assert_eq!(mode(&run.dir()), 0o750);
    assert_eq!(mode(&run.dir().join("iox")), 0o700);
    assert_eq!(mode(&run.dir().join("lock")), 0o600);
    assert_eq!(mode(&run.dir().join("control.sock")), 0o660);
    let mut all = Vec::new();
    below(&run.dir(), &mut all);
    assert!(all.len() > 50, "a run has many files: {}", all.len());
    below(&place.path().join("state"), &mut all);
    for path in all {
        // A link has no mode of its own.
        let mode = fs::metadata(&path).map_or(0, |found| found.mode());
        assert_eq!(mode & 0o007, 0, "{}: {mode:o}", path.display());
    }
    let prefix = RunDir::open(&run.dir()).prefix();
    let mut shared = 0;
    for entry in fs::read_dir("/dev/shm").expect("Linux has it").flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let mode = entry.metadata().map_or(0, |found| found.mode());
            assert_eq!(mode & 0o077, 0, "{}: {mode:o}", entry.path().display());
            shared += 1;
        }
    }
    assert!(shared > 50, "a run has much shared memory: {shared}");
    assert_eq!(run.end().1, 0);
    place.assert_empty();
}

/// `guidedog` of a copy that everybody may run, as another user, in another's place.
fn as_user(place: &Place, uid: u32, gid: u32, args: &[&str]) -> Output {
    let program = place.path().join("guidedog");
    if !program.exists() {
        // Another process copies: a file that this one has open for writing would be inherited by whatever another test
        // starts meanwhile, and what is open for writing cannot be run ("text file busy").
        let copied =
            Command::new("install").args(["-m", "755"]).arg(programs().join("guidedog")).arg(&program).status();
        assert!(copied.expect("coreutils").success());
    }
    let mut command = Command::new(program);
    command.args(args).current_dir("/").env("GUIDEDOG_RUNS", place.path().join("r")).uid(uid).gid(gid);
    command.env("GUIDEDOG_STATE", place.path().join("state"));
    command.stdin(Stdio::null()).output().expect("it starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A place whose runs belong to a group.
fn group_place() -> Place {
    let place = Place::new();
    fs::set_permissions(place.path(), fs::Permissions::from_mode(0o755)).expect("ours");
    let runs = place.path().join("r");
    fs::create_dir(&runs).expect("made");
    chown(&runs, None, Some(GROUP)).expect("root may");
    fs::set_permissions(&runs, fs::Permissions::from_mode(0o2750)).expect("ours");
    place
}

#[test]
fn the_group_reads_and_strangers_are_kept_out() {
    if !test_data::may(is_root(), "only root can be other users") {
        return;
    }
    let place = group_place();
    let mut run = Live::up(&place, "group", &["--scenario", "corridor"]);
    run.wait_walking();
    let member = |args: &[&str]| as_user(&place, STRANGER, GROUP, args);
    for args in [&["status", "--json", "--run", "group"][..], &["why", "--json"], &["policy", "show", "--json"]] {
        let output = member(args);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {}", said(&output));
    }
    for args in [&["stop"][..], &["cue", "forward"], &["resume"], &["policy", "swap", "--exe", "/bin/true"]] {
        let output = member(args);
        assert_eq!(output.status.code(), Some(8), "{args:?}: {}", said(&output));
    }
    // The place of runs is closed to strangers: they get exit code 8.
    for args in [&["status", "--run", "group"][..], &["stop", "--run", "group"], &["why"], &["stop", "--all"]] {
        let output = as_user(&place, STRANGER, STRANGER, args);
        let told = said(&output);
        assert_eq!(output.status.code(), Some(8), "{args:?}: {told}");
        let runs = place.path().join("r").display().to_string();
        assert!(told.contains(&format!("{runs} belongs to user root and group {GROUP}")), "{told}");
    }
    // The records of its runs are closed as well.
    for args in [&["runs"][..], &["logs"], &["bundle", "--run", "group"]] {
        let output = as_user(&place, STRANGER, STRANGER, args);
        assert_eq!(output.status.code(), Some(8), "{args:?}: {}", said(&output));
        assert!(said(&output).contains("/state belongs to user root"), "{}", said(&output));
    }
    // Where the place is open and the run's folder is not, the run's folder is named.
    fs::set_permissions(place.path().join("r"), fs::Permissions::from_mode(0o2755)).expect("ours");
    let output = as_user(&place, STRANGER, STRANGER, &["stop", "--run", "group"]);
    assert_eq!(output.status.code(), Some(8), "{}", said(&output));
    assert!(said(&output).contains("/r/group belongs to user root and group"), "{}", said(&output));
    // No such run is alive; whether one has ended is in the records, which are closed.
    let output = as_user(&place, STRANGER, STRANGER, &["status", "--run", "another"]);
    assert_eq!(output.status.code(), Some(8), "{}", said(&output));
    assert!(said(&output).contains("/state belongs to user root"), "{}", said(&output));
    // Nothing has changed: a stop would have locked it.
    run.wait_walking();
    assert_eq!(run.end().1, 0);
}

#[test]
fn the_group_commands_where_the_settings_say_so_but_runs_no_program() {
    if !test_data::may(is_root(), "only root can be other users") {
        return;
    }
    let place = group_place();
    let config = place.path().join("c.toml");
    fs::write(&config, "[access]\ngroup_may_command = true\n").expect("written");
    let config = config.to_string_lossy().into_owned();
    let mut run = Live::up(&place, "cmd", &["--scenario", "corridor", "--config", &config]);
    run.wait_walking();
    let output = as_user(&place, STRANGER, GROUP, &["policy", "swap", "--exe", "/bin/true"]);
    assert_eq!(output.status.code(), Some(8), "{}", said(&output));
    let output = as_user(&place, STRANGER, GROUP, &["stop"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    run.wait("it is locked", |status| status.mode.class == ModeClass::Lock);
    assert_eq!(run.end().1, 0);
}

#[test]
fn a_place_that_another_may_have_made_is_refused() {
    let place = Place::new();
    let runs = place.path().join("r");
    let refused = |word: &str| {
        for args in [&["walk", "--time-limit", "1s"][..], &["up", "--name", "x"]] {
            let output = place.guidedog(args);
            let text = said(&output);
            assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
            assert!(text.contains("/r") && text.contains(word), "{text}");
        }
    };
    fs::create_dir(place.path().join("elsewhere")).expect("made");
    symlink(place.path().join("elsewhere"), &runs).expect("made");
    refused("is no directory");
    fs::remove_file(&runs).expect("ours");
    fs::create_dir(&runs).expect("made");
    fs::set_permissions(&runs, fs::Permissions::from_mode(0o777)).expect("ours");
    refused("may be written by others");
    fs::set_permissions(&runs, fs::Permissions::from_mode(0o755)).expect("ours");
    if is_root() {
        chown(&runs, Some(STRANGER), None).expect("root may");
        refused("belongs to user 65534");
        chown(&runs, Some(0), None).expect("root may");
    }
    // A run's directory that is a link leads nowhere.
    symlink("/etc", runs.join("walk")).expect("made");
    let output = place.guidedog(&["up", "--name", "walk"]);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    fs::remove_dir(&runs).expect_err("the link is left as it is");
    fs::write(place.path().join("file"), "").expect("written");
    let mut command = place.command(&["walk", "--time-limit", "1s"]);
    let output = command.env("GUIDEDOG_RUNS", place.path().join("file")).output().expect("it starts");
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
}

#[test]
fn a_stop_that_names_no_run_stops_them_all() {
    let place = Place::new();
    let [mut one, mut two] = ["one", "two"].map(|name| Live::up(&place, name, &["--scenario", "corridor"]));
    one.wait_walking();
    two.wait_walking();
    let is_locked = |status: &Status| status.mode.class == ModeClass::Lock;
    let output = place.guidedog(&["stop"]);
    let report = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(report.contains("one: stopped") && report.contains("two: stopped"), "{report}");
    one.wait("it is locked", is_locked);
    two.wait("it is locked", is_locked);
    for run in ["one", "two"] {
        assert_eq!(place.guidedog(&["resume", "--run", run]).status.code(), Some(0));
    }
    let (report, code) = place.json(&["stop", "--all", "--json"]);
    assert_eq!((&report["stopped"], code), (&json!(["one", "two"]), 0), "{report:#}");
    // A run that does not answer is named, and the others are stopped.
    assert_eq!(place.guidedog(&["resume", "--run", "two"]).status.code(), Some(0));
    signal(one.pid(), "STOP");
    let (report, code) = place.json(&["stop", "--json"]);
    signal(one.pid(), "CONT");
    assert_eq!((&report["stopped"], code), (&json!(["two"]), 3), "{report:#}");
    assert!(report["failed"]["one"].is_string() && report["error"].is_string(), "{report:#}");
    two.wait("it is locked", is_locked);
    let _ = (one.end(), two.end());
    place.assert_empty();
}

#[test]
fn the_runs_of_the_system_service_are_found_without_variables() {
    if !test_data::may(is_root(), "only root can mount") {
        return;
    }
    // A /run of its own, with the folder that the service's unit makes.
    let script = "mount -t tmpfs tmpfs /run && mkdir -m 750 /run/guidedog && cd / || exit 90
        export GUIDEDOG_STATE=/run/state
        GUIDEDOG_RUNS=/run/guidedog \"$0\" up --name robot --scenario corridor >/dev/null 2>&1 &
        until \"$0\" status --run robot; do kill -0 $! || exit 91; sleep 0.1; done
        \"$0\" stop --run robot; code=$?; kill -INT $!; wait $!; exit $code";
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", script]).arg(programs().join("guidedog")).env_remove("GUIDEDOG_RUNS");
    let output = command.stdin(Stdio::null()).output().expect("unshare starts");
    let report = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{report}{}", said(&output));
    assert!(report.contains("run      robot") && report.contains("stopped and locked"), "{report}");
}

/// The inodes of a process's sockets.
fn sockets(pid: u32) -> BTreeSet<String> {
    let fds = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
    fds.filter_map(|fd| fs::read_link(fd.path()).ok())
        .filter_map(|link| Some(link.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned()))
        .collect()
}

#[test]
fn nothing_listens_on_a_network() {
    let place = Place::new();
    let mut run = Live::up(&place, "net", &["--scenario", "corridor"]);
    let status = run.wait_walking();
    let mut pids = pids(&status);
    pids.push(run.pid());
    let ours: BTreeSet<String> = pids.iter().flat_map(|pid| sockets(*pid)).collect();
    assert!(ours.len() >= pids.len(), "every process has a line: {ours:?}");
    for table in ["tcp", "tcp6", "udp", "udp6", "udplite", "raw", "raw6", "icmp", "packet", "netlink"] {
        let Ok(text) = fs::read_to_string(format!("/proc/{}/net/{table}", run.pid())) else { continue };
        for line in text.lines().skip(1) {
            let found = line.split_whitespace().find(|word| ours.contains(*word));
            assert!(found.is_none(), "{table}: {line}");
        }
    }
    let unix = fs::read_to_string(format!("/proc/{}/net/unix", run.pid())).expect("Linux has it");
    let inodes: BTreeSet<&str> = unix.lines().filter_map(|line| line.split_whitespace().nth(6)).collect();
    // A connection may have been closed between the two looks.
    let still: BTreeSet<String> = pids.iter().flat_map(|pid| sockets(*pid)).collect();
    let others: Vec<&String> = ours.intersection(&still).filter(|inode| !inodes.contains(inode.as_str())).collect();
    assert!(others.is_empty(), "these are no Unix sockets: {others:?}");
    assert_eq!(run.end().1, 0);
}

/// One of many who want nothing good, or nothing at all.
fn pester(socket: &Path, i: usize, kept: &mut Vec<UnixStream>) {
    let Ok(mut stream) = UnixStream::connect(socket) else { return };
    let _ = stream.set_write_timeout(Some(Duration::from_millis(200)));
    let _ = stream.set_read_timeout(Some(Duration::from_millis(200)));
    let sent = match i % 6 {
        0 => Ok(()),
        1 => stream.write_all(b"{\"verb\":\"sta"),
        2 => stream.write_all(&[0xff; 600]),
        3 => stream.write_all(&[b'x'; 20_000]),
        4 => stream.write_all(&b"{\"verb\":\"status\"}\n".repeat(500)),
        _ => stream.write_all(b"{\"verb\":\"status\"}\n\n\n{\"verb\":\"fly\"}\n"),
    };
    // The other end may have let go already.
    let _ = sent;
    kept.push(stream);
    if kept.len() > 40 {
        kept.remove(0);
    }
}

#[test]
fn no_flood_of_clients_keeps_a_stop_out() {
    let place = Place::new();
    let mut run = Live::up(&place, "flood", &["--scenario", "corridor"]);
    run.wait_walking();
    let socket = run.dir().join("control.sock");
    let (over, count) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
    let floods: Vec<_> = (0..3)
        .map(|_| {
            let (socket, over, count) = (socket.clone(), Arc::clone(&over), Arc::clone(&count));
            std::thread::spawn(move || {
                let mut kept = Vec::new();
                while !over.load(Ordering::Relaxed) {
                    pester(&socket, count.fetch_add(1, Ordering::Relaxed), &mut kept);
                }
            })
        })
        .collect();
    until("the flood is great", || count.load(Ordering::Relaxed) >= 10_000);
    let output = place.guidedog(&["stop", "--json", "--run", "flood"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    over.store(true, Ordering::Relaxed);
    for flood in floods {
        flood.join().expect("it does not panic");
    }
    run.wait("it is locked", |status| status.mode.class == ModeClass::Lock);
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
}

#[test]
fn what_is_no_request_is_answered_with_why_and_the_next_one_is_heard() {
    let place = Place::new();
    let run = Live::up(&place, "talk", &["--scenario", "corridor"]);
    // Once it answers.
    let _ = run.status();
    // What the command prints is the answer as it came, and the types hold every member of it.
    let printed = |args: &[&str]| place.json(&[args, &["--json", "--run", "talk"]].concat()).0;
    let (status, why, policies) = (printed(&["status"]), printed(&["why"]), printed(&["policy", "show"]));
    assert_eq!(json!(serde_json::from_value::<Status>(status.clone()).expect("a status")), status);
    assert_eq!(json!(serde_json::from_value::<Why>(why.clone()).expect("a why")), why);
    assert_eq!(json!(serde_json::from_value::<Policies>(policies.clone()).expect("policies")), policies);
    let ask = |sent: &[u8]| -> Vec<Value> {
        let mut stream = UnixStream::connect(run.dir().join("control.sock")).expect("it listens");
        stream.write_all(sent).expect("it reads");
        stream.shutdown(std::net::Shutdown::Write).expect("open");
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("it answers");
        text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
    };
    let answers = ask(b"\xff\xfe\n{\"verb\":\"fly\"}\n{\"verb\":\"why\"}\n");
    assert!(answers[0]["error"].is_string() && answers[1]["error"].is_string(), "{answers:?}");
    assert_eq!(answers[2]["run"], "talk");
    let answers = ask(&[b'x'; 5000]);
    assert!(answers[0]["error"].as_str().is_some_and(|why| why.contains("4096")), "{answers:?}");
    assert!(ask(b"{\"verb\":\"sto").is_empty(), "half a request is none");
    assert_eq!(run.end().1, 0);
}

#[test]
fn walks_that_start_together_get_names_of_their_own() {
    let place = Place::new();
    let start = || place.command(&["walk", "--speed", "0", "--time-limit", "1s", "--json"]).spawn().expect("starts");
    let walks: Vec<_> = (0..4).map(|_| start()).collect();
    let mut names = BTreeSet::new();
    for walk in walks {
        let output = walk.wait_with_output().expect("it ends");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        assert_eq!(output.status.code(), Some(1), "it did not get far: {}", said(&output));
        names.insert(report["run"].as_str().expect("a name").to_owned());
    }
    assert_eq!(names.len(), 4, "{names:?}");
    place.assert_empty();
}
