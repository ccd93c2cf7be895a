//! `guidedog record` on live runs whose recorder, disk or operator fails.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::Child;

use control::ServicePhase;
use guidedog_tests::{Live, Place, pid_of, service, signal};

/// `guidedog record` at work.
fn recording_of<'a>(place: &Place, run: &mut Live<'a>, args: &[&str]) -> Child {
    let child = place.command(&[&["record", "--run", &run.name], args].concat()).spawn().expect("guidedog starts");
    run.wait("the recorder is up", |status| service(status, "recorder").state == ServicePhase::Ready);
    child
}

#[test]
fn a_recording_whose_record_was_killed_can_be_ended() {
    let place = Place::new();
    let mut run = Live::up(&place, "live", &["--scenario", "corridor"]);
    run.wait_walking();
    let path = place.path().join("a.mcap").to_string_lossy().into_owned();
    let mut record = recording_of(&place, &mut run, &["-o", &path]);
    signal(record.id(), "KILL");
    record.wait().expect("it is ours");
    assert_eq!(service(&run.status(), "recorder").state, ServicePhase::Ready, "the run's recorder is nobody's child");
    let (_, code) = place.json(&["record", "--stop", "--run", "live", "--json"]);
    assert_eq!((code, service(&run.status(), "recorder").state), (0, ServicePhase::Off));
    assert_eq!(place.json(&["recording", "check", &path, "--json"]).1, 0, "it is whole");
    assert_eq!(place.json(&["record", "--stop", "--run", "live", "--json"]).1, 5, "nothing is recorded any more");
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn record_tells_of_a_recorder_that_died_and_of_both_its_files() {
    let place = Place::new();
    let mut run = Live::up(&place, "live", &["--scenario", "corridor"]);
    run.wait_walking();
    let path = place.path().join("a.mcap").to_string_lossy().into_owned();
    let record = recording_of(&place, &mut run, &["-o", &path]);
    let first = pid_of(&run.status(), "recorder");
    run.wait("something is on the disk", |_| fs::metadata(&path).is_ok_and(|file| file.len() > 20_000));
    signal(first, "KILL");
    run.wait("the next recorder is up", |status| {
        let recorder = service(status, "recorder");
        recorder.state == ServicePhase::Ready && recorder.pid != first
    });
    signal(record.id(), "INT");
    let output = record.wait_with_output().expect("it is ours");
    let [report, told] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert_eq!(output.status.code(), Some(3), "{told}");
    assert!(report.contains("a.2.mcap: run live"), "{report}");
    assert!(told.contains("a.mcap is torn") && told.contains("recover"), "{told}");
    let (recovered, code) = place.json(&["recording", "recover", &path, "--json"]);
    assert_eq!(code, 0, "{recovered:#}");
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn record_tells_of_a_full_disk_when_it_is_full() {
    let place = Place::new();
    let mut run = Live::up(&place, "live", &["--scenario", "corridor", "--faults"]);
    run.wait_walking();
    let path = place.path().join("a.mcap").to_string_lossy().into_owned();
    let mut record = recording_of(&place, &mut run, &["-o", &path]);
    assert_eq!(place.json(&["inject", "host", "full-disk", "--run", "live", "--json"]).1, 0);
    // It says so while it still waits for its end.
    let told = BufReader::new(record.stderr.take().expect("piped"));
    let told = told.lines().map_while(Result::ok).find(|line| line.contains("recording ended"));
    assert!(told.is_some_and(|line| line.starts_with("recorder: ")));
    assert!(record.try_wait().expect("it is ours").is_none());
    signal(record.id(), "INT");
    assert_eq!(record.wait().expect("it is ours").code(), Some(3));
    let _ = run.end();
    place.assert_empty();
}
