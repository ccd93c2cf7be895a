//! `scripts/cluster`: evaluations over Ray. `scripts/nightly cluster` runs what needs Ray.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use guidedog_tests::{Place, programs, project, until};
use serde_json::Value;

/// Episodes that take little time.
const CHEAP: [&str; 8] = ["--policy", "guide", "--planner", "off", "--noise", "ideal", "--camera", "16x8"];

fn cluster(place: &Place, python: &str, own: &[&str], args: &[&str]) -> Command {
    let mut command = Command::new(python);
    let program = programs().join("guidedog");
    command.arg(project().join("scripts/cluster")).arg(place.path().join("run"));
    command.arg("--guidedog").arg(program).args(own).arg("--").args(args);
    // Ray begins its workers with a low priority, which on a busy machine is none.
    command.env("RAY_worker_niceness", "0");
    command.current_dir(place.path()).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A Python that has Ray; `scripts/nightly cluster` names it.
fn ray_python() -> String {
    std::env::var("GUIDEDOG_RAY_PYTHON").expect("GUIDEDOG_RAY_PYTHON, as scripts/nightly cluster sets it")
}

fn report(output: &Output) -> Value {
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{told}");
    let mut report: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("one object: {told}"));
    // The clock's.
    report["decision_us"] = Value::Null;
    report
}

fn on_one_machine(place: &Place, args: &[&str]) -> Value {
    let output = place.command(&[&["evaluate", "--json"], args].concat()).current_dir(place.path()).output();
    report(&output.expect("runs"))
}

#[test]
fn without_ray_and_with_arguments_that_are_its_own_it_says_what_is_wrong() {
    let place = Place::new();
    // In this mode Python finds no library but its own.
    let isolated = place.path().join("python");
    fs::write(&isolated, "#!/bin/sh\nexec python3 -I -S \"$@\"\n").expect("written");
    fs::set_permissions(&isolated, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("a program");
    fs::write(place.path().join("robot.toml"), "").expect("written");
    let name = place.path().file_name().expect("a name").to_string_lossy();
    let outside = format!("../{name}/robot.toml");
    for (own, args, why) in [
        (&[][..], &["--episodes", "3"][..], "ray is missing in this Python: pip install"),
        (&[], &["--shard", "1/2"], "--shard is not for scripts/cluster"),
        (&["--cores", "0"], &[], "at least 1"),
        (&[], &["--config", &outside], "leads out of the current folder"),
    ] {
        let output = cluster(&place, &isolated.to_string_lossy(), own, args).output().expect("runs");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && told.contains(why) && !told.contains("Traceback"), "{why}: {told}");
    }
}

/// By hand, and in `scripts/nightly cluster`: with 10,000 episodes most of an hour.
#[test]
#[ignore = "needs Ray, minutes"]
fn two_workers_come_to_the_outcomes_of_one_machine() {
    let place = Place::new();
    let episodes = std::env::var("EPISODES").unwrap_or_else(|_| "10000".to_owned());
    let args = [&CHEAP[..], &["--episodes", &episodes]].concat();
    let own = ["--local-workers", "2"];
    let output = cluster(&place, &ray_python(), &own, &[&args[..], &["--json"]].concat()).output().expect("runs");
    let (ours, one) = (report(&output), on_one_machine(&place, &args));
    eprintln!("{episodes} episodes: {} and {}", ours["outcomes_sha256"], one["outcomes_sha256"]);
    assert!(one["outcomes_sha256"].is_string());
    assert_eq!(ours, one);
}

/// The Ray workers that run one of our shards.
fn workers(place: &Path) -> Vec<u32> {
    let is_ours = |folder: &Path| {
        let words = fs::read(folder.join("cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&words).contains("guidedog-cluster-")
            && fs::read(folder.join("environ"))
                .is_ok_and(|environ| String::from_utf8_lossy(&environ).contains(&place.display().to_string()))
    };
    let parent = |folder: PathBuf| {
        let status = fs::read_to_string(folder.join("status")).ok()?;
        status.lines().find_map(|line| line.strip_prefix("PPid:"))?.trim().parse().ok()
    };
    let processes = fs::read_dir("/proc").expect("processes").flatten().map(|entry| entry.path());
    processes.filter(|folder| is_ours(folder)).filter_map(parent).collect()
}

fn kill(id: u32) {
    Command::new("kill").args(["-KILL", &id.to_string()]).status().expect("kill");
}

fn begin(place: &Place, args: &[&str]) -> Child {
    let mut command = cluster(place, &ray_python(), &["--local-workers", "2", "--shards", "6"], args);
    // The workers are found by it.
    command.env("GUIDEDOG_TEST", place.path()).spawn().expect("starts")
}

#[test]
#[ignore = "needs Ray"]
fn a_lost_worker_s_shard_is_run_again_and_an_interrupted_run_goes_on() {
    let place = Place::new();
    fs::write(place.path().join("robot.toml"), "[robot]\nradius_m = 0.3\n").expect("written");
    let args = [&CHEAP[..], &["--episodes", "240", "--config", "robot.toml"]].concat();
    let with_json = [&args[..], &["--json"]].concat();
    let parts = || {
        fs::read_dir(place.path().join("run"))
            .into_iter()
            .flatten()
            .flatten()
            .filter(|entry| entry.path().extension().is_some_and(|kind| kind == "jsonl"))
            .count()
    };
    let mut interrupted = begin(&place, &with_json);
    until("a shard is done", || parts() > 0);
    interrupted.kill().expect("killed");
    interrupted.wait().expect("ended");
    until("its cluster has ended", || workers(place.path()).is_empty());
    assert!(parts() < 6, "it was interrupted");
    let going_on = begin(&place, &with_json);
    until("a worker runs a shard", || !workers(place.path()).is_empty());
    workers(place.path()).into_iter().take(1).for_each(kill);
    let output = going_on.wait_with_output().expect("ended");
    assert_eq!(report(&output), on_one_machine(&place, &args));
    // Another evaluation does not go on there.
    let other = [&with_json[..], &["--seed", "2"]].concat();
    let output = begin(&place, &other).wait_with_output().expect("ended");
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && told.contains("has another evaluation (arguments differ)"), "{told}");
}
