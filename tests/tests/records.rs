//! What a run leaves behind: its record, also where its supervisor was killed.

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};
use std::time::Instant;

use guidedog_tests::{Live, Place, WATCHDOG, is_alive, pid_of, signal, until};
use serde_json::Value;

/// The report of a verb that ends well.
fn report(place: &Place, args: &[&str]) -> String {
    let output = place.guidedog(args);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {told}");
    String::from_utf8(output.stdout).expect("text")
}

/// A run that walks, and whose lidar then dies once.
fn walking<'a>(place: &'a Place, name: &str) -> Live<'a> {
    let mut run = Live::up(place, name, &["--scenario", "corridor"]);
    run.wait_walking();
    let lidar = pid_of(&run.status(), "lidar");
    signal(lidar, "KILL");
    run.wait("the lidar is back", |status| pid_of(status, "lidar") != lidar && status.mode.ready_for_cue);
    run
}

#[test]
fn the_record_of_a_killed_supervisor_tells_its_stops_and_its_end() {
    let place = Place::new();
    let run = walking(&place, "demo");
    let supervisor = run.pid();
    let live = report(&place, &["runs"]);
    assert!(live.lines().any(|line| line.starts_with("demo ") && line.ends_with("live")), "{live}");
    let all = run.status();
    signal(supervisor, "KILL");
    until("all services have ended", || guidedog_tests::pids(&all).into_iter().all(|pid| !is_alive(pid)));
    drop(run);

    for verb in ["why", "status"] {
        let told = report(&place, &[verb, "--run", "demo"]);
        assert!(told.contains("\nended: supervisor killed, last heard "), "{told}");
        assert!(told.contains("service_died: lidar (incarnation 1)"), "{told}");
    }
    let (why, code) = place.json(&["why", "--run", "demo", "--json"]);
    assert_eq!((code, why["live"].as_bool()), (0, Some(false)));
    let died = why["stops"].as_array().expect("stops").iter().find(|stop| stop["reason"] == "service_died");
    assert!(died.is_some_and(|stop| stop["service"] == "lidar" && stop["class"] == "fault"), "{why:#}");
    let output = place.guidedog(&["why"]);
    assert_eq!(output.status.code(), Some(4));
    assert!(String::from_utf8_lossy(&output.stderr).contains("`guidedog why --run demo`"), "{output:?}");

    let runs = report(&place, &["runs"]);
    assert!(runs.contains("ended: supervisor killed"), "{runs}");
    let logs = report(&place, &["logs"]);
    for what in ["==> supervisor <==", "lidar starts again: life 2", "fault: service_died: lidar (incarnation 1)"] {
        assert!(logs.contains(what), "{what} is not in\n{logs}");
    }
    let (logs, _) = place.json(&["logs", "supervisor", "--json"]);
    assert!(logs["journal"].as_array().is_some_and(|events| events.iter().any(|event| event["event"] == "stop")));
    assert_eq!(place.guidedog(&["logs", "flight"]).status.code(), Some(2));
    assert_eq!(place.guidedog(&["logs", "--run", "another"]).status.code(), Some(4));
}

#[test]
fn a_run_that_ended_in_order_has_its_report() {
    let place = Place::new();
    let run = walking(&place, "demo");
    let follow = place.command(&["logs", "supervisor", "--follow", "--run", "demo"]).spawn().expect("it starts");
    let (of_run, code) = run.end();
    assert_eq!(code, 0);
    let (status, _) = place.json(&["status", "--run", "demo", "--json"]);
    assert_eq!((&status["ended"], &status["report"]["digest"]), (&Value::from("in order"), &of_run["digest"]));
    assert_eq!(status["report"]["stops"], of_run["stops"]);
    // What is followed ends with the run, and has all of it.
    let followed = follow.wait_with_output().expect("it ends");
    let followed = String::from_utf8(followed.stdout).expect("text");
    assert!(
        followed.contains("fault: service_died: lidar") && followed.contains("the run ended in order"),
        "{followed}"
    );
    place.assert_empty();
}

#[test]
fn only_so_many_records_are_kept() {
    let place = Place::new();
    let config = place.path().join("few.toml");
    for (keep, name) in [(2, "one"), (2, "two"), (2, "three"), (0, "four")] {
        fs::write(&config, format!("[run_record]\nkeep_runs = {keep}\n")).expect("written");
        let route = place.along_corridor(1.5);
        let args = ["walk", "--json", "--speed", "0", "--name", name, "--scenario", &route];
        let (report, _) = place.json(&[&args[..], &["--config", &config.to_string_lossy()]].concat());
        assert_eq!(report["reached"], true, "{report:#}");
    }
    let (runs, _) = place.json(&["runs", "--json"]);
    let mut names: Vec<_> = runs["runs"].as_array().expect("runs").iter().map(|run| run["name"].clone()).collect();
    names.sort_by_key(ToString::to_string);
    assert_eq!(names, ["three", "two"]);
    assert!(runs["runs"].as_array().expect("runs").iter().all(|run| run["ended"] == "reached its goal"), "{runs:#}");
}

#[test]
fn a_run_that_cannot_leave_a_record_says_so_and_goes_on() {
    let place = Place::new();
    fs::write(place.path().join("state"), "no folder").expect("written");
    let mut run = Live::up(&place, "demo", &["--scenario", "corridor"]);
    run.wait_walking();
    let runs = report(&place, &["runs"]);
    assert!(runs.contains("live, without a record"), "{runs}");
    signal(run.pid(), "INT");
    let told = run.finish_told();
    assert!(told.contains("this run leaves no record: ") && told.contains("/state/runs: "), "{told}");
}

#[test]
fn a_record_that_is_none_harms_no_other() {
    let place = Place::new();
    let route = place.along_corridor(1.5);
    let (walk, _) = place.json(&["walk", "--json", "--speed", "0", "--name", "demo", "--scenario", &route]);
    let runs = place.path().join("state/runs");
    let record = fs::read_dir(&runs).expect("it is there").flatten().next().expect("a record").path();
    for (folder, file) in [("000900-pipe", "record.json"), ("000901-events", "events.jsonl")] {
        fs::create_dir(runs.join(folder)).expect("made");
        let other = fs::read_to_string(record.join("record.json")).expect("text").replace("demo", "other");
        fs::write(runs.join(folder).join("record.json"), other).expect("written");
        let _ = fs::remove_file(runs.join(folder).join(file));
        let made = Command::new("mkfifo").arg(runs.join(folder).join(file)).status().expect("mkfifo starts");
        assert!(made.success());
    }
    fs::write(runs.join("000901-events/report.json"), "{").expect("written");
    std::os::unix::fs::symlink("/etc/passwd", record.join("logs/lidar.2.log")).expect("made");
    for args in [&["runs"][..], &["logs", "--run", "demo"], &["why", "--run", "demo"]] {
        let told = report(&place, args);
        assert!(!told.contains("root:"), "{told}");
    }
    let (why, _) =
        place.json(&["why", "--run", record.file_name().and_then(|name| name.to_str()).expect("text"), "--json"]);
    assert_eq!(why["report"]["digest"], walk["digest"]);
    // What is no folder is told.
    fs::remove_dir_all(&runs).expect("ours");
    fs::write(&runs, "no folder").expect("written");
    for args in [&["runs"][..], &["logs"], &["bundle"]] {
        let output = place.guidedog(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {output:?}");
    }
}

#[test]
fn a_run_under_nohup_outlives_a_hang_up() {
    let place = Place::new();
    let guidedog = place.command(&["up", "--json", "--name", "demo", "--scenario", "corridor"]);
    let mut command = Command::new("nohup");
    command.arg(guidedog.get_program()).args(guidedog.get_args());
    command.envs(guidedog.get_envs().filter_map(|(name, value)| Some((name, value?))));
    command.current_dir(guidedog_tests::project()).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut run = Live::of(&place, "demo", command.spawn().expect("it starts"));
    run.wait_walking();
    signal(run.pid(), "HUP");
    // It hears the signal before what comes after it.
    assert_eq!(place.guidedog(&["cue", "forward"]).status.code(), Some(0));
    assert_eq!(place.guidedog(&["stop"]).status.code(), Some(0));
    run.wait("it is locked", |status| status.mode.class == messages::ModeClass::Lock);
    // Those who stop the robot at the supervisor's death still hear of it.
    let all = run.status();
    signal(run.pid(), "KILL");
    until("all services have ended", || guidedog_tests::pids(&all).into_iter().all(|pid| !is_alive(pid)));
}

#[test]
fn the_journal_is_plain_or_json_and_has_priorities_for_systemd() {
    let place = Place::new();
    let lines = |args: &[&str], journal: bool| -> Vec<String> {
        let mut command = place.command(&[&["up", "--name", "demo", "--scenario", "corridor"][..], args].concat());
        let (read, write) = std::io::pipe().expect("a pipe");
        if journal {
            let stat = fs::metadata(format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&write)));
            let stat = stat.expect("it is open");
            let (dev, ino) = (std::os::unix::fs::MetadataExt::dev(&stat), std::os::unix::fs::MetadataExt::ino(&stat));
            command.env("JOURNAL_STREAM", format!("{dev}:{ino}"));
        }
        let mut child = command.stderr(write).spawn().expect("it starts");
        drop(command);
        let since = Instant::now();
        let mut lines = Vec::new();
        for line in BufReader::new(read).lines() {
            let line = line.expect("text");
            if line.contains("fault: boot") {
                signal(child.id(), "INT");
            }
            lines.push(line);
            assert!(since.elapsed() < WATCHDOG, "never ends: {lines:#?}");
        }
        assert!(child.wait().expect("it is ours").success(), "{lines:#?}");
        lines.into_iter().skip_while(|line| line.starts_with("run demo starts")).collect()
    };
    let plain = lines(&[], false);
    assert!(plain.iter().any(|line| line.starts_with("20") && line.ends_with("INFO  fault: boot")), "{plain:#?}");
    assert!(plain.last().is_some_and(|line| line.ends_with("INFO  the run ended in order")), "{plain:#?}");
    let json = lines(&["--log", "json", "--log-level", "debug"], false);
    let events: Vec<Value> = json.iter().map(|line| serde_json::from_str(line).expect("an object")).collect();
    for (event, level) in [("mode", "INFO"), ("start", "DEBUG"), ("stop", "DEBUG"), ("end", "INFO")] {
        assert!(events.iter().any(|line| line["event"] == event && line["level"] == level), "no {event}: {json:#?}");
    }
    let journal = lines(&[], true);
    assert!(journal.iter().all(|line| line.starts_with('<') && line[2..].starts_with('>')), "{journal:#?}");
    assert!(journal.iter().any(|line| line.starts_with("<6>") && line.ends_with("fault: boot")), "{journal:#?}");
}

#[test]
fn a_bundle_holds_what_an_engineer_needs() {
    let place = Place::new();
    let recording = place.path().join("walk.mcap").to_string_lossy().into_owned();
    let route = place.along_corridor(4.0);
    let args = ["walk", "--json", "--speed", "0", "--name", "demo", "--scenario", &route, "--record", &recording];
    let (walk, _) = place.json(&args);
    let bundle = place.path().join("incident.tar.gz");
    let args = ["bundle", "--run", "demo", "--output", &bundle.to_string_lossy(), "--json"];
    let (told, code) = place.json(&args);
    assert_eq!((code, &told["recording"], &told["missing"]), (0, &Value::from(true), &Value::Null), "{told:#}");
    // It is not written over.
    assert_eq!(place.json(&args).1, 2);
    let to = place.path().join("unpacked");
    fs::create_dir(&to).expect("made");
    let tar = Command::new("tar").arg("-xzf").arg(&bundle).arg("-C").arg(&to).status().expect("tar starts");
    assert!(tar.success());
    let root = to.join(told["id"].as_str().expect("an id"));
    let json = |name: &str| -> Value {
        serde_json::from_slice(&fs::read(root.join(name)).expect("it is there")).expect("an object")
    };
    assert_eq!(json("record/report.json")["digest"], walk["digest"]);
    assert_eq!(json("versions.json")["run"]["name"], "demo");
    assert!(json("doctor.json")["checks"].is_array());
    for name in ["record/settings.toml", "record/events.jsonl", "record/logs/lidar.1.log"] {
        assert!(root.join(name).is_file(), "{name}");
    }
    let (part, code) = place.json(&["recording", "check", &root.join("recording.mcap").to_string_lossy(), "--json"]);
    assert_eq!((code, &part["whole"]), (0, &Value::from(true)), "{part:#}");
    // A folder that cannot be written, and one that does not exist.
    for output in ["/proc/x.tar.gz", "/nowhere/x.tar.gz"] {
        let output = place.guidedog(&["bundle", "--run", "demo", "--output", output]);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
    }
    let mode = fs::metadata(&bundle).expect("it is there").permissions().mode() & 0o777;
    assert_eq!(mode & 0o007, 0, "a bundle holds what the handler did: {mode:o}");
}
