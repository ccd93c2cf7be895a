//! Every fault that can be injected does what its row of the table says, seen by who reads the stream or looks at the
//! process; and none is taken by a run that was not started for it. What comes of them is `fault_matrix.rs`'s.

use std::fs;

use control::{ServicePhase, Status};
use guidedog_tests::{Came, Live, Place, Wire, is_alive, pid_of, service, told, vx_mps};
use messages::{ModeClass, Odometry};

const MS: u64 = 1_000_000;

/// Whether what came shows the fault.
type Oracle<'a> = &'a dyn Fn(&Came) -> bool;

fn inject(place: &Place, run: &str, target: &str, fault: &str, more: &[&str]) {
    let mut args = vec!["inject", target, fault, "--run", run, "--json"];
    args.extend(more);
    let (answer, code) = place.json(&args);
    assert_eq!(code, 0, "{target} {fault}: {answer:#}");
}

/// A configuration under which drivers may be restarted for as long as a fault lasts.
fn patient(place: &Place) -> String {
    let config = place.path().join("patient.toml");
    fs::write(&config, "[supervision]\nrestart_budget = 1000\nback_off_max = \"20ms\"\n").expect("written");
    config.to_string_lossy().into_owned()
}

/// Whether some of the last poses follow one another as wanted, `times` times in a row.
fn in_a_row(came: &Came, times: usize, wanted: impl Fn(&Odometry, &Odometry) -> bool) -> bool {
    came.poses.windows(times + 1).any(|run| run.windows(2).all(|pair| wanted(&pair[0].1, &pair[1].1)))
}

/// The longest silence between poses that came, milliseconds.
fn silence_ms(came: &Came) -> u64 {
    came.poses.windows(2).map(|pair| (pair[1].0 - pair[0].0) / MS).max().unwrap_or(0)
}

#[test]
fn a_run_that_was_not_started_for_faults_takes_none() {
    let place = Place::new();
    let mut run = Live::up(&place, "calm", &["--scenario", "corridor"]);
    run.wait_walking();
    for (target, fault) in [("lidar/scan", "off"), ("policy", "kill"), ("host", "full-shm"), ("mode", "none")] {
        let (answer, code) = place.json(&["inject", target, fault, "--run", "calm", "--json"]);
        assert_eq!(code, 5, "{answer:#}");
        assert!(answer["error"].as_str().is_some_and(|why| why.contains("--faults")), "{answer:#}");
    }
    for (target, fault) in [("lidar/scan", "kill"), ("lidar", "off"), ("world/truth", "off"), ("mode", "bent")] {
        let (answer, code) = place.json(&["inject", target, fault, "--run", "calm", "--json"]);
        assert_eq!(code, 2, "{target} {fault}: {answer:#}");
    }
    run.wait_walking();
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn what_would_do_nothing_is_refused() {
    let place = Place::new();
    let mut run = Live::up(&place, "void", &["--scenario", "corridor", "--faults"]);
    run.wait_walking();
    for (target, fault) in
        [("recorder", "kill"), ("host", "full-disk"), ("health/replay", "off"), ("supervisor", "exit-on-start")]
    {
        let (answer, code) = place.json(&["inject", target, fault, "--run", "void", "--json"]);
        assert_eq!(code, 5, "{target} {fault}: {answer:#}");
    }
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn a_full_disk_ends_the_recording_and_stops_no_walk() {
    let place = Place::new();
    let recording = place.path().join("full.mcap").to_string_lossy().into_owned();
    let mut run = Live::up(&place, "disk", &["--scenario", "corridor", "--faults", "--record", &recording]);
    run.wait_walking();
    let (answer, code) = place.json(&["inject", "host", "full-disk", "--run", "disk", "--json"]);
    assert_eq!(code, 0, "{answer:#}");
    run.wait("the recorder says so", |status| told(status, "recording ended"));
    run.wait_walking();
    let (report, code) = run.end();
    assert_eq!(code, 0, "{report:#}");
    // A busy machine may stop the robot for want of beats of others.
    let mut stops = report["stops"].as_array().expect("stops").iter();
    assert!(!stops.any(|stop| stop["service"] == "recorder"), "the recorder stops nothing: {report:#}");
    assert_eq!(place.json(&["recording", "recover", &recording, "--json"]).1, 0, "what was written is not lost");
    place.assert_empty();
}

#[test]
fn every_fault_of_a_stream_is_seen_by_its_readers() {
    let place = Place::new();
    let mut run = Live::up(&place, "odo", &["--scenario", "corridor", "--faults", "--config", &patient(&place)]);
    run.wait_walking();
    let wire = Wire::on(run.dir());
    let equal_pose = |a: &Odometry, b: &Odometry| a.odom_from_robot == b.odom_from_robot;
    let checks: [(&str, Oracle<'_>); 9] = [
        ("off", &|came| silence_ms(came) >= 900),
        ("stuck-seq", &|came| in_a_row(came, 10, |a, b| a.header.seq == b.header.seq && a != b)),
        ("stuck-stamp", &|came| in_a_row(came, 10, |a, b| a.header.stamp_ns == b.header.stamp_ns && a != b)),
        // The robot walks, or it would be no fault.
        ("stuck-bytes", &|came| {
            in_a_row(came, 5, |a, b| equal_pose(a, b) && b.header.seq == a.header.seq + 1 && a.twist.vx_mps > 0.2)
        }),
        ("garbage", &|came| came.poses.iter().any(|(_, pose)| !pose.odom_from_robot.is_finite())),
        ("wrong", &|came| came.poses.iter().any(|(_, pose)| pose.twist.vx_mps > 1.5 * 0.5)),
        ("slow", &|came| in_a_row(came, 3, |a, b| b.header.seq == a.header.seq + 10)),
        ("delayed", &|came| {
            let late =
                |(came_ns, pose): &&(u64, Odometry)| came_ns.saturating_sub(pose.header.published_ns) >= 400 * MS;
            came.poses.iter().filter(late).count() >= 5
        }),
        ("intermittent", &|came| {
            let gaps = came.poses.windows(2).filter(|pair| pair[1].0 - pair[0].0 >= 290 * MS);
            gaps.count() >= 3
        }),
    ];
    for (fault, seen) in checks {
        run.wait_walking();
        wire.clear();
        wire.wait("a pose", |came| !came.poses.is_empty());
        inject(&place, "odo", "odometry", fault, if fault == "off" { &["--for", "1s"] } else { &[] });
        wire.wait(fault, seen);
        inject(&place, "odo", "odometry", "none", &[]);
        wire.clear();
        wire.wait("it is well again", |came| in_a_row(came, 10, |a, b| b.header.seq == a.header.seq + 1));
    }
    wire.stop();
    let (report, code) = run.end();
    assert_eq!((code, &report["collisions"]["robot"]), (0, &0.into()), "{report:#}");
    place.assert_empty();
}

#[test]
fn every_fault_of_a_frame_is_seen_by_its_readers() {
    let place = Place::new();
    let mut run = Live::up(&place, "scan", &["--scenario", "corridor", "--faults", "--config", &patient(&place)]);
    run.wait_walking();
    let wire = Wire::on(run.dir());
    let longest = |ranges: &[f32]| ranges.iter().copied().filter(|range| range.is_finite()).fold(0.0_f32, f32::max);
    let checks: [(&str, Oracle<'_>); 5] = [
        ("off", &|came| came.scans.windows(2).any(|pair| pair[1].0 - pair[0].0 >= 900 * MS)),
        ("stuck-bytes", &|came| {
            let same = |pair: &[(u64, messages::ScanHeader, Vec<f32>)]| {
                let bits = |i: usize| pair[i].2.iter().map(|range| range.to_bits()).collect::<Vec<_>>();
                bits(0) == bits(1) && pair[1].1.header.stamp_ns > pair[0].1.header.stamp_ns
            };
            came.scans.windows(2).filter(|pair| same(pair)).count() >= 3
        }),
        ("garbage", &|came| came.scans.iter().any(|(_, header, _)| !header.angle_increment_rad.is_finite())),
        // The lidar's range is 12 m.
        ("wrong", &|came| came.scans.iter().any(|(_, _, ranges)| longest(ranges) > 12.5)),
        ("delayed", &|came| {
            came.scans
                .iter()
                .filter(|(came_ns, header, _)| came_ns.saturating_sub(header.header.published_ns) >= 400 * MS)
                .count()
                >= 3
        }),
    ];
    for (fault, seen) in checks {
        wire.clear();
        wire.wait("a scan", |came| !came.scans.is_empty());
        inject(&place, "scan", "lidar/scan", fault, if fault == "off" { &["--for", "1s"] } else { &[] });
        wire.wait(fault, seen);
        inject(&place, "scan", "lidar/scan", "none", &[]);
        run.wait_walking();
    }
    // The wire's, not the process's: a new driver is as deaf.
    let before = run.wait_walking();
    inject(&place, "scan", "lidar/scan", "off", &[]);
    inject(&place, "scan", "lidar", "kill", &[]);
    run.wait("a new lidar is up, and says nothing", |status| {
        service(status, "lidar").incarnation > service(&before, "lidar").incarnation
            && service(status, "lidar").state == ServicePhase::Ready
            && !status.mode.ready_for_cue
    });
    inject(&place, "scan", "lidar/scan", "none", &[]);
    run.wait_walking();
    wire.stop();
    let _ = run.end();
    place.assert_empty();
}

/// Resident memory of a process, KiB.
fn resident_kib(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

#[test]
fn every_fault_of_a_process_is_seen_on_it() {
    let place = Place::new();
    let mut run = Live::up(&place, "proc", &["--scenario", "corridor", "--faults"]);
    for (fault, lives) in [("kill", 1), ("hang", 1), ("slow", 1), ("exit-on-start", 3)] {
        let before = run.wait_walking();
        let incarnation = service(&before, "shield").incarnation;
        let pid = pid_of(&before, "shield");
        inject(&place, "proc", "shield", fault, &[]);
        run.wait(&format!("{fault}: life {incarnation} and {lives} more"), |status| {
            service(status, "shield").incarnation >= incarnation + lives
                && service(status, "shield").state == ServicePhase::Ready
        });
        assert!(!is_alive(pid), "{fault}");
        let status = run.status();
        assert!(fault != "exit-on-start" || told(&status, "an injected fault"), "{status:#?}");
    }
    let before = run.wait_walking();
    let (pid, from_kib) = (pid_of(&before, "shield"), resident_kib(pid_of(&before, "shield")));
    inject(&place, "proc", "shield", "leak", &[]);
    // Whoever is over a limit on memory is ended.
    run.wait("the shield leaks", |_| !is_alive(pid) || resident_kib(pid) > from_kib + (16 << 10));
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn a_full_shm_stops_no_walk_and_who_dies_meanwhile_comes_back_once_there_is_room() {
    let place = Place::new();
    let run = Live::up_in_shm_of(&place, "full", "64m", &["--scenario", "corridor", "--faults"]);
    if !test_data::may(run.is_some(), "no mount namespace can be had here") {
        return;
    }
    let mut run = run.expect("it is up");
    run.wait_walking();
    inject(&place, "full", "host", "full-shm", &[]);
    let walked_m = |status: &Status| status.world.as_ref().map_or(0.0, |world| world.distance_m);
    let from_m = walked_m(&run.status());
    run.wait("it walks on", |status| walked_m(status) > from_m + 1.0);
    run.wait_walking();
    inject(&place, "full", "depth", "kill", &[]);
    run.wait("it does not come back, and says why", |status| {
        service(status, "depth").restarts >= 2 && told(status, "is full")
    });
    inject(&place, "full", "host", "none", &[]);
    run.wait("it is back", |status| service(status, "depth").state == ServicePhase::Ready);
    run.wait_walking();
    let (report, code) = run.end();
    assert_eq!((code, &report["collisions"]["robot"]), (0, &0.into()), "{report:#}");
    let mut stops = report["stops"].as_array().expect("stops").iter();
    let others = stops.find(|stop| stop["reason"] == "service_died" && stop["service"] != "depth");
    assert!(others.is_none(), "a full shared memory kills no other service: {others:#?}");
    place.assert_empty();
}

#[test]
fn a_camera_that_is_knocked_out_of_its_mount_stops_the_walk_until_it_looks_as_before() {
    let place = Place::new();
    let config = place.path().join("legged.toml");
    fs::write(&config, "simulation.noise = \"legged\"\n").expect("written");
    let config = config.to_string_lossy().into_owned();
    let mut run = Live::up(&place, "knock", &["--scenario", "corridor", "--faults", "--config", &config]);
    run.wait_walking();
    inject(&place, "knock", "depth/frame", "tilted", &[]);
    let is_told = |status: &Status| {
        let is_named = status.mode.reason.as_ref().is_some_and(|reason| reason.starts_with("camera_tilted"));
        is_named && status.mode.class == ModeClass::Fault && status.mode.ready_for_cue
    };
    let epoch = run.wait("it is told", is_told).mode.epoch;
    // A cue does not make the camera look right.
    let (answer, code) = place.json(&["cue", "forward", "--run", "knock", "--json"]);
    assert_eq!(code, 0, "{answer:#}");
    run.wait("it is told again", |status| is_told(status) && status.mode.epoch > epoch);
    inject(&place, "knock", "depth/frame", "none", &[]);
    run.wait("it walks on", |status| {
        if status.mode.class == ModeClass::Fault && status.mode.ready_for_cue {
            let _ = place.json(&["cue", "forward", "--run", "knock", "--json"]);
        }
        vx_mps(status) > 0.2
    });
    let (report, _) = run.end();
    assert_eq!(report["collisions"]["robot"], 0, "{report:#}");
    place.assert_empty();
}
