//! Another policy for a walking robot: planned swaps stop nothing, and whatever is wrong with a candidate, the policy
//! before goes on and the operator is told why.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;

use control::{ServiceStatus, Status};
use guidedog_tests::{Live, Place, pid_of, programs, service, signal};
use serde_json::Value;
use sha2::{Digest, Sha256};

const QUICK: &str = "[policy.swap]\ndecisions = 2\nprobation = \"2s\"\nlatency = \"400ms\"\n";

fn config(place: &Place, text: &str) -> String {
    let path = place.path().join("swap.toml");
    fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

/// A walking robot.
fn walking<'a>(place: &'a Place, name: &str, text: &str) -> Live<'a> {
    let mut run = Live::up(place, name, &["--scenario", "corridor", "--config", &config(place, text)]);
    run.wait_walking();
    run
}

/// The executable with that fault.
fn faulty(place: &Place, fault: &str) -> String {
    let link = place.path().join(fault);
    if !link.exists() {
        symlink(programs().join("guidedog-faulty-policy"), &link).expect("linked");
    }
    link.to_string_lossy().into_owned()
}

fn policy(run: &Live<'_>, place: &Place, args: &[&str]) -> (Value, i32) {
    let mut all = vec!["policy"];
    all.extend(args);
    all.extend(["--json", "--run", &run.name]);
    place.json(&all)
}

/// The stops so far: what they were for.
fn stops(run: &Live<'_>, place: &Place) -> Vec<String> {
    let (why, _) = place.json(&["why", "--json", "--run", &run.name]);
    let stops = why["stops"].as_array().expect("stops").iter();
    // Holds come and go by themselves, and locomotion may tell of a death before the supervisor calls it a fault.
    let stops = stops.filter(|stop| stop["class"] == "fault" || stop["class"] == "lock");
    stops.map(|stop| stop["reason"].as_str().unwrap_or_default().to_owned()).collect()
}

/// The policies that are there, the one in force first.
fn policies(status: &Status) -> impl Iterator<Item = &ServiceStatus> {
    status.services.iter().filter(|service| service.name == "policy")
}

fn active(run: &Live<'_>, place: &Place) -> u64 {
    policy(run, place, &["show"]).0["active"]["incarnation"].as_u64().expect("a policy is active")
}

#[test]
fn whatever_is_wrong_with_a_candidate_the_policy_before_goes_on() {
    let place = Place::new();
    let run = walking(&place, "bad", QUICK);
    for (fault, why) in [
        ("nan", "its output is no probability"),
        ("other-table", "another action table (10 actions)"),
        ("crash-in-shadow", "SIGABRT"),
        ("hang-on-activation", "policy"),
    ] {
        let (swap, code) = policy(&run, &place, &["swap", "--exe", &faulty(&place, fault), "--settle"]);
        assert_eq!((code, swap["state"].as_str()), (6, Some("failed")), "{fault}: {swap:#}");
        assert!(swap["why"].as_str().is_some_and(|said| said.contains(why)), "{fault}: {swap:#}");
        assert_eq!(active(&run, &place), 1, "{fault}");
        assert_eq!(stops(&run, &place), ["boot"], "{fault} stopped the robot");
    }
    let (report, code) = run.end();
    assert_eq!((code, report["missed_decisions"].as_u64()), (0, Some(0)), "{report:#}");
    place.assert_empty();
}

#[test]
fn a_policy_that_is_too_slow_is_not_swapped_in() {
    let place = Place::new();
    let run = walking(&place, "slow", "[policy.swap]\nlatency = \"5ms\"\n");
    let (swap, code) = policy(&run, &place, &["swap", "--exe", &faulty(&place, "slow")]);
    assert_eq!(code, 6, "{swap:#}");
    assert!(swap["why"].as_str().is_some_and(|why| why.contains("too slow")), "{swap:#}");
    assert_eq!(stops(&run, &place), ["boot"]);
    drop(run);
    place.assert_empty();
}

#[test]
fn death_on_probation_is_one_stop_and_the_policy_before_is_back() {
    let place = Place::new();
    let mut run = walking(&place, "prob", QUICK);
    let (swap, code) = policy(&run, &place, &["swap", "--exe", &faulty(&place, "crash-on-probation"), "--settle"]);
    assert_eq!(code, 6, "{swap:#}");
    assert!(swap["why"].as_str().is_some_and(|why| why.contains("one stop")), "{swap:#}");
    run.wait_walking();
    assert_eq!(active(&run, &place), 1);
    let stops = stops(&run, &place);
    assert_eq!(stops.len(), 2, "boot, and one stop: {stops:?}");
    let (report, _) = run.end();
    assert_eq!(report["restarts"]["policy"], Value::Null, "nothing was restarted: the one before was there");
    place.assert_empty();
}

#[test]
fn a_model_is_swapped_in_and_rolled_back_while_the_robot_walks() {
    let place = Place::new();
    let mut run = walking(&place, "good", QUICK);
    let (model, sha256) = write_model(&place, "careful", "500ms");
    let (swap, code) = policy(&run, &place, &["swap", "--model", &model, "--settle"]);
    assert_eq!((code, swap["state"].as_str()), (0, Some("done")), "{swap:#}");
    let shown = policy(&run, &place, &["show"]).0;
    assert_eq!(shown["active"]["runs"]["sha256"], sha256, "{shown:#}");
    let (swap, code) = policy(&run, &place, &["rollback", "--settle"]);
    assert_eq!((code, swap["state"].as_str()), (0, Some("done")), "{swap:#}");
    // On probation the way back is at once.
    assert_eq!(policy(&run, &place, &["swap", "--model", &model]).1, 0);
    let (swap, code) = policy(&run, &place, &["rollback", "--settle"]);
    assert_eq!((code, swap["state"].as_str()), (0, Some("rolled_back")), "{swap:#}");
    run.wait("one policy is left", |status| policies(status).count() == 1);
    assert_eq!(stops(&run, &place), ["boot"]);
    let (report, code) = run.end();
    assert_eq!((code, report["missed_decisions"].as_u64()), (0, Some(0)), "{report:#}");
    place.assert_empty();
}

#[test]
fn what_is_built_in_needs_no_file() {
    let place = Place::new();
    let run = walking(&place, "named", QUICK);
    for (name, engine) in [("guide", "learnt"), ("geometric", "geometric")] {
        let (swap, code) = policy(&run, &place, &["swap", "--model", name, "--settle"]);
        assert_eq!((code, swap["state"].as_str()), (0, Some("done")), "{swap:#}");
        let shown = policy(&run, &place, &["show"]).0;
        assert_eq!(shown["active"]["runs"]["engine"], engine, "{shown:#}");
    }
    assert_eq!(stops(&run, &place), ["boot"]);
    let (report, code) = run.end();
    assert_eq!((code, report["missed_decisions"].as_u64()), (0, Some(0)), "{report:#}");
    assert_eq!(report["policy"]["engine"], "geometric", "{report:#}");
    place.assert_empty();
}

fn write_model(place: &Place, name: &str, dt: &str) -> (String, String) {
    let tuning = "reserve_m = 0.05\n";
    let path: PathBuf = place.path().join(format!("{name}.geometric"));
    fs::write(&path, tuning).expect("written");
    let sha256: String = Sha256::digest(tuning).iter().map(|byte| format!("{byte:02x}")).collect();
    let manifest = format!(
        "sha256 = \"{sha256}\"\nobservation = \"lidar-depth-pose-cue/1\"\nactions = \"eight\"\ndt = \"{dt}\"\n"
    );
    fs::write(place.path().join(format!("{name}.toml")), manifest).expect("written");
    (path.to_string_lossy().into_owned(), sha256)
}

#[test]
fn a_swap_is_refused_where_it_cannot_be_and_says_why() {
    let place = Place::new();
    let mut run = walking(&place, "refuse", "[policy.swap]\ndecisions = 8\n");
    let (model, _) = write_model(&place, "hasty", "250ms");
    let (swap, code) = policy(&run, &place, &["swap", "--model", &model]);
    assert_eq!(code, 6, "{swap:#}");
    assert!(swap["why"].as_str().is_some_and(|why| why.contains("decision period of 250 ms")), "{swap:#}");
    assert_eq!(policy(&run, &place, &["swap", "--model", "/nowhere.geometric"]).1, 2);
    let (refused, code) = policy(&run, &place, &["rollback"]);
    assert_eq!(code, 5, "{refused:#}");
    // A swap under way refuses a second one, and a stop ends it.
    let (model, _) = write_model(&place, "careful", "500ms");
    let mut under_way =
        place.command(&["policy", "swap", "--model", &model, "--json", "--run", "refuse"]).spawn().expect("starts");
    run.wait("a candidate is there", |status| policies(status).any(|policy| policy.shadow));
    let (refused, code) = policy(&run, &place, &["swap", "--model", &model]);
    assert_eq!(code, 5, "{refused:#}");
    assert!(refused["error"].as_str().is_some_and(|error| error.contains("is under way")), "{refused:#}");
    assert_eq!(place.json(&["stop", "--json", "--run", "refuse"]).1, 0);
    assert_eq!(under_way.wait().expect("it ends").code(), Some(6));
    let (refused, code) = policy(&run, &place, &["swap", "--model", &model]);
    assert_eq!(code, 5, "{refused:#}");
    assert!(refused["error"].as_str().is_some_and(|error| error.contains("the run is stopped")), "{refused:#}");
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn where_the_policy_before_dies_the_swap_stands_and_there_is_no_way_back() {
    let place = Place::new();
    let mut run = walking(&place, "noway", "[policy.swap]\ndecisions = 2\nprobation = \"60s\"\nlatency = \"400ms\"\n");
    let (model, _) = write_model(&place, "careful", "500ms");
    assert_eq!(policy(&run, &place, &["swap", "--model", &model]).1, 0);
    let status = run.status();
    assert!(!service(&status, "policy").shadow, "the active one stands first");
    let before = policies(&status).last().expect("two policies");
    assert!(before.shadow);
    signal(before.pid, "KILL");
    run.wait("the swap is over", |_| policy_state(&place) == "done");
    let swap = policy(&run, &place, &["show"]).0["swaps"][0].clone();
    assert!(swap["why"].as_str().is_some_and(|why| why.contains("there is no way back")), "{swap:#}");
    assert_eq!(stops(&run, &place), ["boot"], "it stopped nothing");
    // The one in force is now restarted as any other, with its model.
    signal(pid_of(&run.status(), "policy"), "KILL");
    run.wait("it is restarted", |status| service(status, "policy").incarnation == 3);
    run.wait_walking();
    let shown = policy(&run, &place, &["show"]).0;
    assert_eq!(shown["active"]["runs"]["model"].as_str(), Some(model.as_str()), "{shown:#}");
    let _ = run.end();
    place.assert_empty();
}

fn policy_state(place: &Place) -> String {
    let (shown, _) = place.json(&["policy", "show", "--json", "--run", "noway"]);
    shown["swaps"][0]["state"].as_str().unwrap_or_default().to_owned()
}
