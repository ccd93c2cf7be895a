//! Processes die, hang and are stopped; the robot stops, the service comes back, nothing is left behind.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use control::Status;
use guidedog_tests::{
    Live, Place, Seen, Tap, WATCHDOG, is_alive, monotonic_ns, pid_of, pids, service, signal, until, vx_mps,
};
use messages::ModeClass;
use serde_json::Value;

const CRITICAL: [&str; 8] = ["locomotion", "brake", "odometry", "lidar", "depth", "cue", "policy", "shield"];

/// Below this a robot stands, metres and radians per second added up.
const STANDING: f64 = 0.02;

/// Sends a signal to a service of a walking robot, sees the robot stand, and waits until it walks again with a new life
/// of that service.
fn strike(run: &mut Live<'_>, victim: &str, with: &str, tap: Option<&Tap>) {
    let before = run.wait_walking();
    let incarnation = service(&before, victim).incarnation;
    let epoch = before.mode.epoch;
    let struck_ns = monotonic_ns();
    signal(pid_of(&before, victim), with);
    run.wait(&format!("{victim} is struck by {with} and the fault is seen"), |status| {
        status.mode.epoch > epoch && service(status, victim).incarnation > incarnation
    });
    if let Some(tap) = tap {
        saw_it_stand(tap, struck_ns, victim);
    }
    run.wait_walking();
}

/// Waits until the robot has stood since it was struck; zero came to its link, but where locomotion itself is struck:
/// the brake has a path of its own.
fn saw_it_stand(tap: &Tap, struck_ns: u64, victim: &str) {
    let since = Instant::now();
    loop {
        let seen = tap.since(struck_ns);
        let first = |what: fn(&Seen) -> bool| seen.iter().find(|(_, seen)| what(seen)).map(|(at_ns, _)| *at_ns);
        let zero = first(|seen| matches!(seen, Seen::Command { zero: true }));
        if let Some(stood) = first(|seen| matches!(seen, Seen::Speed(speed) if *speed < STANDING)) {
            let ms = |at: u64| at.saturating_sub(struck_ns) / 1_000_000;
            eprintln!("{victim}: zero at the link after {:?} ms, standing after {} ms", zero.map(ms), ms(stood));
            assert!(zero.is_some() || victim == "locomotion", "{victim}: no zero at the link");
            return;
        }
        assert!(since.elapsed() < WATCHDOG, "{victim}: the robot did not stand");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn any_critical_service_may_die_and_the_walk_goes_on() {
    let place = Place::new();
    let mut run = Live::up(&place, "kill", &["--scenario", "corridor"]);
    run.wait_walking();
    let tap = Tap::on(run.dir());
    for victim in CRITICAL {
        strike(&mut run, victim, "KILL", Some(&tap));
    }
    tap.stop();
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    assert_eq!(report["collisions"]["robot"], 0);
    let stops = report["stops"].as_array().expect("stops");
    for victim in CRITICAL {
        // On a busy machine one may be restarted for want of a beat as well: then another stop names it.
        let named = stops.iter().filter(|stop| stop["class"] == "fault" && stop["service"] == victim).count() as u64;
        let restarts = report["restarts"][victim].as_u64().unwrap_or_default();
        assert!((1..=named).contains(&restarts), "{victim}: {named} stops name it: {report:#}");
    }
    // Whichever of the two words comes first is the stop's reason.
    let notes = report["notes"].to_string();
    assert!(notes.contains("brake engaged: locomotion (1) was gone"), "the brake acts when locomotion dies: {notes}");
    place.assert_empty();
}

#[test]
fn a_stopped_process_is_found_by_its_silence_and_replaced() {
    let place = Place::new();
    let mut run = Live::up(&place, "hang", &["--scenario", "corridor"]);
    run.wait_walking();
    let tap = Tap::on(run.dir());
    for victim in ["lidar", "shield", "locomotion", "policy"] {
        strike(&mut run, victim, "STOP", Some(&tap));
    }
    tap.stop();
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
}

#[test]
fn who_stops_the_robot_takes_a_hangup_for_the_supervisors_death_stops_it_and_ends() {
    let place = Place::new();
    let mut run = Live::up(&place, "hup", &["--scenario", "corridor"]);
    run.wait_walking();
    let tap = Tap::on(run.dir());
    for victim in ["locomotion", "brake"] {
        strike(&mut run, victim, "HUP", Some(&tap));
    }
    tap.stop();
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
}

#[test]
fn when_the_supervisor_dies_nobody_is_left_and_the_next_run_cleans_up() {
    let place = Place::new();
    let mut run = Live::up(&place, "orphan", &["--scenario", "corridor"]);
    let status = run.wait_walking();
    let pids = pids(&status);
    assert_eq!(pids.len(), 9);
    let tap = Tap::on(run.dir());
    until("the tap hears", || !tap.since(0).is_empty());
    let struck_ns = monotonic_ns();
    signal(run.pid(), "KILL");
    let since = Instant::now();
    until("every process has ended", || !pids.iter().any(|pid| is_alive(*pid)));
    // The contract says 1 s; a machine under the load of other tests gets some more.
    assert!(since.elapsed() < Duration::from_secs(5), "{:?}", since.elapsed());
    saw_it_stand(&tap, struck_ns, "supervisor");
    let seen = tap.since(struck_ns);
    let last = seen.iter().rev().find_map(|(_, seen)| if let Seen::Speed(speed) = seen { Some(*speed) } else { None });
    assert!(last.is_some_and(|speed| speed < STANDING), "it stands to the end: {last:?}");
    tap.stop();
    drop(run);
    let (report, _) = place.json(&["walk", "--speed", "0", "--time-limit", "3s", "--json"]);
    assert!(report["duration_s"].is_number(), "{report:#}");
    place.assert_empty();
}

#[test]
fn the_operators_stop_locks_and_only_resume_and_a_cue_go_on() {
    let place = Place::new();
    let mut run = Live::up(&place, "stop", &["--scenario", "corridor"]);
    run.wait_walking();
    assert_eq!(place.json(&["stop", "--json", "--run", "stop"]).1, 0);
    let standing = |status: &Status| vx_mps(status) == 0.0;
    run.wait("locked and standing", |status| status.mode.class == ModeClass::Lock && standing(status));
    let (refused, code) = place.json(&["cue", "forward", "--json", "--run", "stop"]);
    assert_eq!(code, 5, "{refused:#}");
    assert!(refused["error"].as_str().is_some_and(|error| error.contains("locked")), "{refused:#}");
    let (why, _) = place.json(&["why", "--json", "--run", "stop"]);
    assert_eq!(why["stops"][0]["reason"], "operator_stop", "{why:#}");
    assert_eq!(place.json(&["resume", "--json", "--run", "stop"]).1, 0);
    // The scripted handler says it again; nothing else starts motion.
    run.wait_walking();
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn a_run_boots_in_fault_and_an_operators_cue_starts_it() {
    let place = Place::new();
    let route = place.path().join("silent.toml");
    fs::write(&route, "cue = []\n").expect("written");
    let route = route.to_string_lossy().into_owned();
    let mut run = Live::up(&place, "boot", &["--scenario", "corridor", "--cues", &route]);
    run.wait("ready, and in fault", |status| status.mode.class == ModeClass::Fault && status.mode.ready_for_cue);
    assert_eq!(place.json(&["cue", "forward", "--json", "--run", "boot"]).1, 0);
    run.wait_walking();
    assert_eq!(place.json(&["cue", "stop", "--json", "--run", "boot"]).1, 0);
    run.wait("standing, in run", |status| status.mode.class == ModeClass::Run && vx_mps(status) == 0.0);
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn every_lifeline_has_two_ends_and_no_third() {
    let place = Place::new();
    let mut run = Live::up(&place, "fds", &["--scenario", "corridor"]);
    let status = run.wait_walking();
    let mut holders: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut processes = vec![("supervisor".to_owned(), run.pid())];
    let others = CRITICAL.iter().chain(&["simulator"]);
    processes.extend(others.map(|name| ((*name).to_owned(), pid_of(&status, name))));
    for (name, pid) in &processes {
        for entry in fs::read_dir(format!("/proc/{pid}/fd")).expect("readable").flatten() {
            let Ok(target) = fs::read_link(entry.path()) else { continue };
            let target = target.to_string_lossy().into_owned();
            if target.starts_with("socket:") {
                holders.entry(target).or_default().push(name.clone());
            }
        }
    }
    // A service's own end of its lifeline must be the service's alone: nobody else may keep it open.
    for (socket, names) in &holders {
        let services: Vec<_> = names.iter().filter(|name| *name != "supervisor" && *name != "locomotion").collect();
        let foreign = services.len() > 1 || (services.len() == 1 && names.len() > 1 && names[0] != *services[0]);
        // The supervisor keeps the far end of locomotion's line for a restarted brake.
        let brake_line = *names == ["supervisor", "brake"];
        assert!(!foreign || brake_line, "{socket} is held by {names:?}");
    }
    let _ = run.end();
}

#[test]
fn in_stepped_time_only_the_member_that_hangs_is_replaced() {
    let place = Place::new();
    let config = place.path().join("quick.toml");
    // On a busy machine the others need over a second for a step now and then.
    fs::write(&config, "[supervision]\nstep_limit = \"2s\"\n").expect("written");
    let config = config.to_string_lossy().into_owned();
    let mut run = Live::up(&place, "hold", &["--scenario", "corridor", "--speed", "2", "--config", &config]);
    for victim in ["lidar", "cue", "policy"] {
        strike(&mut run, victim, "STOP", None);
    }
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    let restarts = report["restarts"].as_object().expect("restarts");
    assert_eq!(restarts.keys().collect::<Vec<_>>(), ["cue", "lidar", "policy"], "nobody else is condemned");
    place.assert_empty();
}

#[test]
fn idle_connections_do_not_keep_a_stop_out() {
    let place = Place::new();
    let mut run = Live::up(&place, "idle", &["--scenario", "corridor"]);
    run.wait_walking();
    let socket = place.path().join("r/idle/control.sock");
    let idle: Vec<_> = (0..40).filter_map(|_| UnixStream::connect(&socket).ok()).collect();
    assert_eq!(idle.len(), 40);
    assert_eq!(place.json(&["stop", "--json", "--run", "idle"]).1, 0);
    run.wait("locked", |status| status.mode.class == ModeClass::Lock);
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn a_stop_is_not_undone_by_a_resume_that_came_with_it() {
    let place = Place::new();
    let mut run = Live::up(&place, "both", &["--scenario", "corridor"]);
    run.wait_walking();
    assert_eq!(place.json(&["stop", "--json", "--run", "both"]).1, 0);
    run.wait("locked", |status| status.mode.class == ModeClass::Lock);
    let mut client = UnixStream::connect(place.path().join("r/both/control.sock")).expect("it listens");
    client.write_all(b"{\"verb\":\"resume\"}\n{\"verb\":\"stop\"}\n").expect("sent");
    let answers: Vec<String> = BufReader::new(client).lines().take(2).map_while(Result::ok).collect();
    assert!(answers.iter().any(|answer| answer.contains("overtaken by a stop")), "{answers:?}");
    assert_eq!(run.status().mode.class, ModeClass::Lock);
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn in_stepped_time_a_killed_driver_joins_again() {
    let place = Place::new();
    let mut run = Live::up(&place, "step", &["--scenario", "corridor", "--speed", "4"]);
    strike(&mut run, "lidar", "KILL", None);
    strike(&mut run, "policy", "KILL", None);
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
}

#[test]
fn ctrl_c_ends_a_walk_whose_supervisor_is_stopped() {
    let place = Place::new();
    let walk = place.command(&["walk", "--scenario", "corridor", "--name", "walk", "--json"]).spawn().expect("starts");
    let ready = || {
        let (status, code) = place.json(&["status", "--run", "walk", "--json"]);
        (code == 0 && status["mode"]["class"] == "run").then(|| status["supervisor_pid"].as_u64())
    };
    let mut pid = None;
    until("the walk begins", || {
        pid = ready();
        pid.is_some()
    });
    let supervisor = pid.flatten().and_then(|pid| u32::try_from(pid).ok()).expect("a process id");
    signal(supervisor, "STOP");
    signal(walk.id(), "INT");
    let output = walk.wait_with_output().expect("it is ours");
    assert!(!is_alive(supervisor));
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_eq!(report["run"], "walk", "{report:#}");
    place.assert_empty();
}
