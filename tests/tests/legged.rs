//! Guided walks of a legged robot: in MuJoCo, a physics simulation that this project did not write, and by the simple
//! model of its gait in the project's own world.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use guidedog_tests::{Live, Place, has_legs, touches};
use recording::Reader;
use serde_json::Value;

use crate::walks::walk;

/// Faults of a walk but the boot.
fn faults(report: &Value) -> Vec<&Value> {
    let stops = report["stops"].as_array().expect("stops");
    stops.iter().filter(|stop| stop["class"] == "fault" && stop["reason"] != "boot").collect()
}

#[test]
fn a_go2_guides_a_handler_down_a_corridor_and_two_walks_are_one() {
    if has_legs() {
        let report = two_walks_are_one("corridor", &["--physics", "mujoco"]);
        assert_eq!(
            (&report["legs"]["model"]["known"], &report["legs"]["policy"]["known"]),
            (&true.into(), &true.into())
        );
    }
}

/// The robot lags, overruns, sways and tilts, and knows its attitude to half a degree.
#[test]
fn a_robot_that_sways_in_the_flat_world_guides_a_handler_round_a_corner() {
    two_walks_are_one("l-turn", &["--noise", "legged"]);
}

/// A configuration in which no source tells the attitude.
fn seen(place: &Place, velocity_loop: &str) -> String {
    let path = place.path().join("seen.toml");
    let text = format!(
        "odometry.attitude = \"depth\"\ndepth.rate_hz = 30\nsimulation.mujoco.velocity_loop = {velocity_loop:?}\n"
    );
    fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

/// What `doctor`, `status` and the report have to say where no source tells the attitude.
const SEEN: &str = "from depth images alone";

#[test]
fn a_robot_whose_attitude_only_the_camera_tells_guides_a_handler_round_a_corner() {
    let place = Place::new();
    let config = seen(&place, "soft");
    let report = two_walks_are_one("l-turn", &["--noise", "legged", "--config", &config]);
    assert!(report["notes"].to_string().contains(SEEN), "{report:#}");
    let (doctor, _) = place.json(&["doctor", "--config", &config, "--json"]);
    let row = doctor["checks"].as_array().expect("checks").iter().find(|check| check["name"] == "attitude");
    assert!(row.is_some_and(|row| row["ok"] == true && row["found"].to_string().contains(SEEN)), "{doctor:#}");
    let mut run = Live::up(&place, "seen", &["--config", &config]);
    run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
    assert_eq!(run.status().attitude.as_deref(), Some("depth"));
    let output = place.guidedog(&["status", "--run", "seen"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains(SEEN), "{output:?}");
    let _ = run.end();
    place.assert_empty();
}

/// A few minutes: `scripts/nightly physics` runs it.
#[test]
#[ignore = "a few minutes: scripts/nightly physics"]
fn a_go2_whose_attitude_only_the_camera_tells_is_guided() {
    if !has_legs() {
        return;
    }
    let place = Place::new();
    for velocity_loop in ["soft", "stiff"] {
        let config = seen(&place, velocity_loop);
        for scenario in ["corridor", "curve", "l-turn", "left-at-tee", "crossing"] {
            let report = walk(scenario, &["--physics", "mujoco", "--config", &config]);
            let what = format!("{scenario}, {velocity_loop}");
            assert_eq!((touches(&report), faults(&report)), ([0, 0], Vec::new()), "{what}: {report:#}");
            assert_eq!(report["reached"], true, "{what}");
        }
    }
}

fn two_walks_are_one(scenario: &str, options: &[&str]) -> Value {
    let report = walk(scenario, options);
    assert_eq!(report["reached"], true, "{report:#}");
    for who in ["robot", "handler", "hit_by_others"] {
        assert_eq!(report["collisions"][who], 0, "{who}");
    }
    assert_eq!(report["missed_decisions"], 0);
    assert_eq!(faults(&report), Vec::<&Value>::new());
    let again = walk(scenario, options);
    for key in ["digest", "decisions", "verdicts", "stops", "distance_m", "duration_s"] {
        assert_eq!(report[key], again[key], "{key}");
    }
    assert_eq!(report["digest"].as_str().map(str::len), Some(64));
    report
}

/// A configuration of real sensors and that link, which `--emulated` leads to emulated devices.
fn linked(place: &Place, link: &str) -> String {
    let path = place.path().join("linked.toml");
    let sources = "lidar.source = \"device\"\ndepth.source = \"device\"\nodometry.source = \"device\"\n";
    fs::write(&path, format!("{sources}locomotion.link = {link:?}\n")).expect("written");
    path.to_string_lossy().into_owned()
}

/// Beams of an RPLIDAR over its turns, frames with their own time, attitudes by the robot's own state: what the swaying
/// body's drivers make of them.
#[test]
fn a_go2_is_guided_by_real_drivers_and_a_real_link() {
    if !has_legs() {
        return;
    }
    let mut reports = Vec::new();
    // On a busy machine physics and drivers are late, and a walk may end at a wall. Three in a row are no accident.
    let is_well = (1..=3).any(|seed| {
        let report = behind_real_drivers(seed);
        let is_well = report["reached"] == true && touches(&report) == [0, 0] && faults(&report).is_empty();
        reports.push(report);
        is_well
    });
    assert!(is_well, "{reports:#?}");
}

/// A walk of 4 m in real time: its report. The drivers have told that they read their devices.
fn behind_real_drivers(seed: u32) -> Value {
    let (place, seed) = (Place::new(), seed.to_string());
    let scenario = place.along_corridor(4.0);
    let walk = ["walk", "--physics", "mujoco", "--emulated", "--scenario", &scenario, "--seed", &seed, "--json"];
    let (report, _) = place.json(&walk);
    for text in ["answers", "samples a second", "a program is connected"] {
        assert!(report["notes"].to_string().contains(text), "{text}: {report:#}");
    }
    place.assert_empty();
    report
}

/// Nothing in a run's time begins with the physics' own.
#[test]
fn a_go2_walks_in_real_time_as_well() {
    if !has_legs() {
        return;
    }
    let place = Place::new();
    let (report, code) =
        place.json(&["walk", "--physics", "mujoco", "--scenario", &place.along_corridor(2.0), "--json"]);
    assert_eq!((code, &report["reached"]), (0, &true.into()), "{report:#}");
    place.assert_empty();
}

#[test]
fn legs_that_cannot_be_used_are_told_before_anything_is_started() {
    if !has_legs() {
        return;
    }
    let place = Place::new();
    let file = |text: &str| {
        let path = place.path().join("legs.toml");
        fs::write(&path, text).expect("written");
        path.to_string_lossy().into_owned()
    };
    let no_policy = place.path().join("no.onnx");
    fs::write(&no_policy, "this is no policy").expect("written");
    for (text, told) in [
        ("policy = \"none.onnx\"", "simulation.mujoco.policy"),
        ("model = \"none.xml\"", "simulation.mujoco.model"),
        ("policy_sha256 = \"0123\"", "policy.onnx has the digest d6c8be"),
        ("friction = 9.0", "simulation.mujoco.friction"),
        ("velocity_loop = \"hard\"", "unknown variant `hard`"),
    ] {
        let config = file(&format!("[simulation.mujoco]\n{text}\n"));
        let output = place.guidedog(&["walk", "--physics", "mujoco", "--config", &config]);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}: {error}");
        assert!(error.contains(told), "{text}: {error}");
    }
    let sources = "lidar.source = \"device\"\nodometry.source = \"device\"\nlocomotion.link = \"unitree\"\n";
    let emulated = "simulation.emulated.on = true\ndepth = { source = \"device\", device = \"realsense\" }\n";
    let config = file(&format!("{sources}{emulated}"));
    let output = place.guidedog(&["walk", "--physics", "mujoco", "--config", &config]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && error.contains("\"realsense\" is not emulated"), "{error}");
    let config = file("[simulation.mujoco]\npolicy = \"no.onnx\"\n");
    let output = place.guidedog(&["walk", "--physics", "mujoco", "--config", &config, "--speed", "0"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && error.contains("no.onnx"), "{error}");
    place.assert_empty();
}

/// A world that has a corridor of 2.4 m with a thing across it at x = 5 m: its depth, and from which height to which.
fn barred(place: &Place, depth_m: f64, z_m: [f64; 2]) -> String {
    let world = place.path().join("barred.toml");
    let walls = "[[wall]]\npoints = [[-3, -1.2], [12, -1.2], [12, 1.2], [-3, 1.2], [-3, -1.2]]\n";
    let thing = format!("[[box]]\nat = [5, 0]\nsize = [{depth_m}, 2.4]\nz = {z_m:?}\n");
    fs::write(&world, walls.to_owned() + &thing).expect("written");
    let lines = "start = { at = [0, 0], yaw_deg = 0 }\ngoal = { at = [9, 0], within_m = 0.5 }\ntime_limit_s = 20\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0";
    place.scenario(&world.to_string_lossy(), lines)
}

/// The robot comes to what is across the way, and neither it nor the handler touches it.
fn stops_before(depth_m: f64, z_m: [f64; 2], velocity_loop: &str) {
    let (place, config) = (Place::new(), format!("[simulation.mujoco]\nvelocity_loop = {velocity_loop:?}\n"));
    let file = place.path().join("legs.toml");
    fs::write(&file, config).expect("written");
    let scenario = barred(&place, depth_m, z_m);
    let common = ["walk", "--physics", "mujoco", "--scenario", &scenario, "--speed", "0", "--json"];
    let (report, _) = place.json(&[&common[..], &["--config", &file.to_string_lossy()]].concat());
    assert_eq!((touches(&report), faults(&report)), ([0, 0], Vec::new()), "{z_m:?}, {velocity_loop}: {report:#}");
    assert_eq!(report["reached"], false, "{report:#}");
    assert!(report["distance_m"].as_f64().is_some_and(|way_m| way_m > 2.5), "{report:#}");
    place.assert_empty();
}

/// The robot would fit under it, the handler would not. Near by the camera looks beneath it.
#[test]
fn a_bar_at_the_height_of_a_chest_stops_a_go2_that_would_fit_under_it() {
    if has_legs() {
        stops_before(0.05, [1.18, 1.22], "soft");
    }
}

#[test]
#[ignore = "a minute: scripts/nightly physics"]
fn a_kerb_and_bars_stop_a_go2() {
    for velocity_loop in ["soft", "stiff"].into_iter().filter(|_| has_legs()) {
        stops_before(0.3, [0.0, 0.1], velocity_loop);
        stops_before(0.05, [0.58, 0.62], velocity_loop);
        // Near by the camera looks beneath it.
        stops_before(0.05, [1.18, 1.22], velocity_loop);
    }
}

/// What must be the same in a walk, its reruns and its replays.
fn result(report: &Value) -> [&Value; 4] {
    ["digest", "decisions", "verdicts", "refusals"].map(|key| &report[key])
}

/// Two at once, each at a place of its own. The recording has model and policy by their digests.
#[test]
#[ignore = "ten minutes: scripts/nightly physics"]
fn sixteen_reruns_and_sixty_four_replays_of_a_walk_on_legs_are_equal() {
    if !has_legs() {
        return;
    }
    let common = ["walk", "--physics", "mujoco", "--scenario", "l-turn", "--speed", "0", "--json"];
    let place = Place::new();
    let recording = place.path().join("legs.mcap").to_string_lossy().into_owned();
    let (walked, code) = place.json(&[&common[..], &["--record", &recording]].concat());
    assert_eq!((code, &walked["not_recorded"]), (0, &0.into()), "{walked:#}");
    let settings = Reader::open(Path::new(&recording)).and_then(|mut reader| reader.settings()).expect("a recording");
    let settings = settings.expect("the settings of the run");
    for part in ["model", "policy"] {
        let sha256 = walked["legs"][part]["sha256"].as_str().expect("a digest");
        assert!(settings.contains(sha256), "{part}: {settings}");
    }
    let both = |times: usize, args: &[&str]| {
        let again = || {
            let place = Place::new();
            for _ in 0..times / 2 {
                let (report, code) = place.json(args);
                assert_eq!((code, result(&report)), (0, result(&walked)), "{args:?}: {report:#}");
                assert!(result(&report).iter().all(|part| !part.is_null()), "{report:#}");
                let compared = &report["compared"];
                assert!(args[0] == "walk" || compared["permits"]["recorded"].as_u64() > Some(100), "{report:#}");
                assert!(args[0] == "walk" || compared["permits"]["recorded"] == compared["permits"]["equal"]);
            }
            place.assert_empty();
        };
        thread::scope(|scope| {
            let one = scope.spawn(again);
            again();
            one.join().expect("the other half");
        });
    };
    both(16, &common);
    both(64, &["replay", &recording, "--speed", "0", "--json"]);
    place.assert_empty();
}

/// All scenarios and routes, both velocity loops, three seeds: half an hour. `scripts/nightly physics` runs it.
#[test]
#[ignore = "half an hour: scripts/nightly physics"]
fn a_go2_guides_a_handler_through_every_scenario() {
    if !has_legs() {
        return;
    }
    let scenarios =
        ["corridor", "curve", "l-turn", "left-at-tee", "crossing", "cluttered", "route-a", "route-b", "route-c"];
    let (place, mut wrong) = (Place::new(), Vec::new());
    for velocity_loop in ["soft", "stiff"] {
        let config = place.path().join("legs.toml");
        fs::write(&config, format!("[simulation.mujoco]\nvelocity_loop = {velocity_loop:?}\n")).expect("written");
        let config = config.to_string_lossy().into_owned();
        for scenario in scenarios {
            let (flat, _) = place.json(&["walk", "--scenario", scenario, "--speed", "0", "--json"]);
            for seed in ["1", "2", "3"] {
                let common = ["walk", "--physics", "mujoco", "--scenario", scenario, "--speed", "0", "--json"];
                let more = ["--seed", seed, "--config", &config];
                let (report, _) = place.json(&[&common[..], &more[..]].concat());
                let touches = touches(&report);
                let times = [&report, &flat].map(|report| report["duration_s"].as_f64().unwrap_or(f64::NAN));
                let line = format!(
                    "{scenario} {velocity_loop} {seed}: reached {}, touches {touches:?}, {:.1} s ({:.1}), {} faults",
                    report["reached"],
                    times[0],
                    times[1],
                    faults(&report).len()
                );
                eprintln!("{line}");
                let good = report["reached"] == true && touches == [0, 0] && faults(&report).is_empty();
                if !good || times[0] > 1.25 * times[1] {
                    wrong.push(line);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Three scenarios behind the real drivers, over each link that can be emulated, in real time: a quarter of an hour. A
/// walk that fails is tried again with other seeds, twice at most: a machine that is busy with other things is late.
#[test]
#[ignore = "a quarter of an hour: scripts/nightly physics"]
fn a_go2_is_guided_over_every_link() {
    if !has_legs() {
        return;
    }
    let (place, mut wrong) = (Place::new(), Vec::new());
    for scenario in ["corridor", "l-turn", "curve"] {
        let (flat, _) = place.json(&["walk", "--scenario", scenario, "--speed", "0", "--json"]);
        let limit_s = 1.25 * flat["duration_s"].as_f64().expect("a duration");
        for link in ["unitree", "go2", "ros2"] {
            let config = linked(&place, link);
            let is_good = (1..=3).any(|seed: u32| {
                let (seed, limit) = (seed.to_string(), format!("{limit_s:.0}s"));
                let common = ["walk", "--physics", "mujoco", "--emulated", "--scenario", scenario, "--json"];
                let more = ["--config", &config, "--seed", &seed, "--time-limit", &limit];
                let (report, _) = place.json(&[&common[..], &more[..]].concat());
                let duration_s = report["duration_s"].as_f64().unwrap_or(f64::NAN);
                eprintln!(
                    "{scenario} {link} {seed}: reached {}, touches {:?}, {duration_s:.1} s ({limit_s:.1}), {} faults",
                    report["reached"],
                    touches(&report),
                    faults(&report).len()
                );
                report["reached"] == true && touches(&report) == [0, 0] && faults(&report).is_empty()
            });
            if !is_good {
                wrong.push(format!("{scenario} {link}"));
            }
        }
    }
    place.assert_empty();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Scenarios, and what the robot and the floor are like in them: mass, times that of the model, and friction.
const HOURS_SCENARIOS: [&str; 6] = ["corridor", "curve", "l-turn", "left-at-tee", "crossing", "cluttered"];
const HOURS_MASSES: [f64; 5] = [0.8, 0.9, 1.0, 1.1, 1.2];
const HOURS_FRICTIONS: [f64; 4] = [0.4, 0.6, 0.8, 1.0];

/// The walk of that number: its report, and a line that tells what came of it.
fn walk_of_hours(place: &Place, number: usize) -> (Value, String) {
    let scenario = HOURS_SCENARIOS[number % HOURS_SCENARIOS.len()];
    let mass = HOURS_MASSES[number % HOURS_MASSES.len()];
    // Each round of scenarios meets other frictions and the other loop.
    let friction = HOURS_FRICTIONS[(number + number / 6) % HOURS_FRICTIONS.len()];
    let velocity_loop = ["soft", "stiff"][(number + number / 12) % 2];
    let text = format!("velocity_loop = {velocity_loop:?}\nmass_scale = {mass:?}\nfriction = {friction:?}\n");
    let (config, seed) = (place.path().join("legs.toml"), (number + 1).to_string());
    fs::write(&config, format!("[simulation.mujoco]\n{text}")).expect("written");
    let common = ["walk", "--physics", "mujoco", "--scenario", scenario, "--speed", "0", "--json"];
    let (report, _) = place.json(&[&common[..], &["--seed", &seed, "--config", &config.to_string_lossy()]].concat());
    let reasons: Vec<_> = faults(&report).iter().map(|fault| fault["reason"].clone()).collect();
    let like = format!("{number}: {scenario} {velocity_loop}, mass {mass}, friction {friction}");
    let (touches, duration_s) = (touches(&report), &report["duration_s"]);
    let line = format!("{like}: reached {}, touches {touches:?}, {duration_s} s, {reasons:?}", report["reached"]);
    (report, line)
}

/// Walks of other masses and frictions, two at once, until `LEGGED_HOURS` (3) of them are together: no healthy robot is
/// taken for one whose odometry lies.
#[test]
#[ignore = "three hours of simulated time: scripts/nightly physics"]
fn odometry_is_believed_over_hours_of_walks_with_other_masses_and_frictions() {
    if !has_legs() {
        return;
    }
    let hours: f64 = std::env::var("LEGGED_HOURS").map_or(3.0, |hours| hours.parse().expect("hours"));
    let (numbers, walked) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let walked_s = || walked.lock().expect("no panic").iter().filter_map(duration_s).sum::<f64>();
    let walk_on = || {
        let place = Place::new();
        while walked_s() < hours * 3600.0 {
            let (report, line) = walk_of_hours(&place, numbers.fetch_add(1, Ordering::Relaxed));
            eprintln!("{line}");
            assert!(duration_s(&report).is_some_and(|duration_s| duration_s > 1.0), "{report:#}");
            walked.lock().expect("no panic").push(report);
        }
        place.assert_empty();
    };
    thread::scope(|scope| {
        let other = scope.spawn(walk_on);
        walk_on();
        other.join().expect("the other half");
    });
    let walked = walked.into_inner().expect("no panic");
    let mut reasons = BTreeMap::new();
    for reason in walked.iter().flat_map(faults).map(|fault| fault["reason"].to_string()) {
        *reasons.entry(reason).or_insert(0) += 1;
    }
    let arrived = walked.iter().filter(|report| report["reached"] == true).count();
    let touched = [0, 1].map(|who| walked.iter().map(|report| touches(report)[who]).sum::<u64>());
    let hours = walked.iter().filter_map(duration_s).sum::<f64>() / 3600.0;
    eprintln!("{} walks, {hours:.2} h: {arrived} arrived, touches {touched:?}, faults {reasons:?}", walked.len());
    let contradicts = |report: &Value| report["stops"].to_string().contains("odometry_contradicts");
    assert_eq!(walked.iter().filter(|report| contradicts(report)).count(), 0);
    assert!(!reasons.contains_key("\"robot_fell\""), "{reasons:?}");
}

fn duration_s(report: &Value) -> Option<f64> {
    report["duration_s"].as_f64()
}
