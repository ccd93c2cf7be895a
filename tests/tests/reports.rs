//! Every verb that reports does so on standard output, and says nothing on standard error when all is well.

use std::fs;
use std::process::Output;

use guidedog_tests::{Live, Place, project};

/// Whether a verb tells of its progress on standard error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    None,
    Told,
}

/// Runs a verb that reports: its report, which must be on standard output.
fn assert_reports(place: &Place, args: &[&str], progress: Progress) -> String {
    let Output { status, stdout, stderr } = place.guidedog(args);
    let [report, told] = [stdout, stderr].map(|text| String::from_utf8(text).expect("text"));
    assert!(status.success(), "{args:?}: {report}{told}");
    assert!(!report.trim().is_empty(), "{args:?} reports nothing; on standard error: {told}");
    assert!(progress == Progress::Told || told.is_empty(), "{args:?} on standard error: {told}");
    report
}

/// A verb whose report cannot be written ends with exit code 3 and says so.
fn assert_notices_a_full_disk(place: &Place, args: &[&str]) {
    let full = fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let output = place.command(args).stdout(full).output().expect("it starts");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{args:?}: {told}");
    assert!(told.contains("failed to write to standard output"), "{args:?}: {told}");
}

#[test]
fn verbs_that_ask_a_run_report_on_standard_output() {
    let place = Place::new();
    let mut run = Live::up(&place, "demo", &["--scenario", "corridor", "--faults"]);
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    for (args, first) in [
        (&["status"][..], "run      demo"),
        (&["why"], "run        demo"),
        (&["policy", "show"], "active "),
        (&["cue", "forward"], "cue forward"),
        (&["stop"], "stopped"),
        (&["resume"], "lock ended"),
        (&["inject", "lidar", "kill"], "lidar"),
    ] {
        let args = [args, &["--run", "demo"]].concat();
        let report = assert_reports(&place, &args, Progress::None);
        assert!(report.starts_with(first), "{args:?}: {report}");
    }
    run.wait("the lidar is back", |status| status.mode.ready_for_cue);
    let swap = ["policy", "rollback", "--run", "demo"];
    let refused = place.guidedog(&swap);
    assert!(refused.stdout.is_empty() && !refused.stderr.is_empty(), "an error is no report: {refused:?}");
    for args in [["status", "--run", "demo"], ["why", "--run", "demo"], ["stop", "--run", "demo"]] {
        assert_notices_a_full_disk(&place, &args);
    }
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn verbs_of_files_and_of_the_machine_report_on_standard_output() {
    let place = Place::new();
    let at = |name: &str| place.path().join(name).to_string_lossy().into_owned();
    let [recording, imported] = ["walk.mcap", "imported.mcap"].map(at);
    let walk = ["walk", "--scenario", "corridor", "--speed", "0", "--record", &recording];
    assert!(assert_reports(&place, &walk, Progress::Told).contains("reached the goal"));
    let log = at("a.log");
    let ranges = "1.0 ".repeat(30);
    let flaser = |t: u32| format!("FLASER 30 {ranges}0.0 0 0 0.0 0 0 {t}.0 host {t}.0\n");
    fs::write(&log, (1..4).map(flaser).collect::<String>()).expect("written");
    let replay = ["replay", &recording, "--speed", "0", "--against"];
    for (args, progress) in [
        (&["why", "--reasons"][..], Progress::None),
        (&["recording", "info", &recording], Progress::None),
        (&["recording", "check", &recording], Progress::None),
        (&["shield", "--recording", &recording], Progress::None),
        (&["import", "carmen", &log, "-o", &imported], Progress::None),
        (&replay, Progress::Told),
        (&["evaluate", "--policy", "geometric", "--episodes", "2"], Progress::None),
        (&["fit", "--synthesize", "--model", "rigid", "--pooled"], Progress::None),
        // Of the benches, the two that are over soon: they share one way to report.
        (&["bench", "decoders", "--times", "1"], Progress::None),
        (&["bench", "transport", "--seconds", "4"], Progress::None),
    ] {
        let lines = assert_reports(&place, args, progress).lines().count();
        assert!(args[0] != "evaluate" || lines > 10, "{lines} lines");
    }
    for args in [
        &["why", "--reasons"][..],
        &["recording", "info", &recording],
        &["evaluate", "--policy", "geometric", "--episodes", "2"],
        &["bench", "decoders", "--times", "1"],
        &walk[..5],
    ] {
        assert_notices_a_full_disk(&place, args);
    }
    place.assert_empty();
}

#[test]
fn a_reader_that_closes_its_pipe_is_no_error() {
    let place = Place::new();
    let guidedog = guidedog_tests::programs().join("guidedog");
    let line = format!("set -o pipefail; {} why --reasons | head -1", guidedog.display());
    let output = std::process::Command::new("bash").args(["-c", &line]).current_dir(project()).output();
    let output = output.expect("bash");
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), 1, "{output:?}");
    place.assert_empty();
}
