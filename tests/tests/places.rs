//! Where a run keeps its files and its shared memory: any folder does, and what does not is told before the start.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use guidedog_tests::{Live, Place, pid_of, project, service, signal};

/// Everything that it said.
fn told(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned()).concat()
}

#[test]
fn runs_live_in_a_folder_with_a_long_path() {
    let place = Place::with_runs_in(&Path::new(&"r".repeat(75)).join("s".repeat(75)));
    let mut run = Live::up(&place, "demo", &["--scenario", "corridor", "--emulated"]);
    run.wait_walking();
    // The brake reaches the robot, and a new locomotion everybody else.
    let locomotion = pid_of(&run.status(), "locomotion");
    signal(locomotion, "KILL");
    run.wait("locomotion is back", |status| {
        pid_of(status, "locomotion") != locomotion && service(status, "locomotion").restarts == 1
    });
    for verb in ["status", "why", "stop"] {
        let output = place.guidedog(&[verb, "--run", "demo"]);
        assert!(output.status.success(), "{verb}: {}", told(&output));
    }
    let (doctor, _) = place.json(&["doctor", "--json"]);
    let checks = doctor["checks"].as_array().expect("checks");
    let directory = checks.iter().find(|check| check["name"] == "run directory").expect("it is looked at");
    assert_eq!(directory["ok"], true, "{directory}");
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    place.assert_empty();
}

/// `guidedog` with a `/dev/shm` that is mounted so; none where nothing can be mounted.
fn with_shm(place: &Place, options: &str, args: &[&str]) -> Option<Output> {
    let may = Command::new("unshare").args(["--mount", "true"]).stderr(Stdio::null()).status();
    if !test_data::may(may.is_ok_and(|status| status.success()), "only root can mount") {
        return None;
    }
    let command = place.command(args);
    let mount = format!("mount -t tmpfs -o {options} tmpfs /dev/shm && exec \"$0\" \"$@\"");
    let mut inside = Command::new("unshare");
    inside.args(["--mount", "sh", "-c", &mount]).arg(command.get_program()).args(command.get_args());
    inside.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?)))).current_dir(project());
    Some(inside.output().expect("unshare starts"))
}

#[test]
fn doctor_and_walk_agree_on_shared_memory() {
    let place = Place::new();
    let route = place.along_corridor(1.0);
    let walk = ["walk", "--speed", "0", "--scenario", &route];
    let mut agreed = [false; 2];
    for size_mib in [8, 24, 32, 36, 38, 40, 48, 64, 128] {
        let size = format!("size={size_mib}m");
        let Some(doctor) = with_shm(&place, &size, &["doctor", "--json"]) else { return };
        let report: serde_json::Value = serde_json::from_slice(&doctor.stdout).expect("JSON");
        let checks = report["checks"].as_array().expect("checks");
        let memory = checks.iter().find(|check| check["name"] == "shared memory").expect("it is looked at");
        let ok = memory["ok"].as_bool().expect("a truth");
        let walked = with_shm(&place, &size, &walk).expect("it was possible a moment ago");
        assert_eq!(walked.status.success(), ok, "{size_mib} MiB: doctor says {memory}, walk {}", told(&walked));
        assert!(ok || told(&walked).contains("shared memory: "), "{}", told(&walked));
        agreed[usize::from(ok)] = true;
    }
    assert_eq!(agreed, [true; 2], "of both kinds there is one");
    // One that cannot be written is told as that.
    for args in [&["doctor"][..], &walk] {
        let output = with_shm(&place, "ro", args).expect("it was possible a moment ago");
        assert_eq!(output.status.code(), Some(3), "{}", told(&output));
        assert!(told(&output).contains("writing to /dev/shm failed: Read-only file system"), "{}", told(&output));
    }
    place.assert_empty();
}
