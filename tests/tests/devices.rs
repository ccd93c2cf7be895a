//! The real drivers against emulated devices: neither driver nor supervisor can tell.

use std::f32::consts::FRAC_PI_2;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use control::{ModeStatus, Status};
use guidedog_tests::{Came, Live, Place, Wire, project, service, signal, told, until};
use messages::{ModeClass, ServiceId};
use serde_json::Value;

/// An emulated lidar, plugged in until it is dropped.
struct Plugged(Child);

impl Plugged {
    fn lidar(place: &Place, model: &str) -> Self {
        let port = port(place);
        let args = ["emulate", "rplidar", "--port", &port.to_string_lossy(), "--model", model];
        let mut command = place.command(&args);
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("guidedog starts");
        until("a port comes", || port.exists());
        Self(child)
    }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        // Pulled out: no farewell.
        signal(self.0.id(), "KILL");
        let _ = self.0.wait();
    }
}

fn port(place: &Place) -> PathBuf {
    place.path().join("rplidar")
}

/// A configuration with the lidar at that port.
fn config(place: &Place, port: &Path, more: &str) -> String {
    let config = place.path().join("device.toml");
    let text = format!("[lidar]\nsource = \"device\"\n[lidar.rplidar]\nport = \"{}\"\n{more}\n", port.display());
    std::fs::write(&config, text).expect("written");
    config.to_string_lossy().into_owned()
}

/// The last scan is that of who stands at the corridor's start: walls 1.2 m to either side and 3 m behind; ahead the
/// wall is far, and where that is farther than the lidar sees, nothing is known.
fn sees_corridor(came: &Came) -> bool {
    let Some((_, header, ranges_m)) = came.scans.last() else { return false };
    let at = |angle_rad: f32| {
        let beam = (f64::from(angle_rad) - header.angle_min_rad) / header.angle_increment_rad;
        ranges_m[beam.round() as usize % ranges_m.len()]
    };
    let near = |range_m: f32, expected_m: f32| (range_m - expected_m).abs() < 0.12;
    near(at(FRAC_PI_2), 1.2)
        && near(at(-FRAC_PI_2), 1.2)
        && near(at(2.0 * FRAC_PI_2), 3.0)
        && (at(0.0).is_nan() || at(0.0) > 20.0)
}

/// Whether a note of a report tells of it.
fn report_tells(report: &Value, text: &str) -> bool {
    report["notes"].to_string().contains(text)
}

#[test]
fn every_lidar_is_read_at_its_speed() {
    for (model, baud) in [
        ("a1", 115_200),
        ("a1-old", 115_200),
        ("a2", 115_200),
        ("a3", 256_000),
        ("s1", 256_000),
        ("s2", 1_000_000),
        ("s3", 1_000_000),
        ("c1", 460_800),
    ] {
        let place = Place::new();
        let _lidar = Plugged::lidar(&place, model);
        let config = config(&place, &port(&place), &format!("baud = {baud}"));
        let mut run = Live::up(&place, "device", &["--config", &config]);
        run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
        let wire = Wire::on(run.dir());
        wire.wait(&format!("{model} sees the corridor"), sees_corridor);
        wire.stop();
        let (report, _) = run.end();
        assert!(report.is_object(), "{model}");
        place.assert_empty();
    }
}

/// Pulled out and put back, by the driver that goes on and by one that finds nothing at first.
#[test]
fn an_unplugged_lidar_stops_the_robot_and_a_replugged_one_is_read_again() {
    let place = Place::new();
    let config = config(&place, &port(&place), "");
    let mut run = Live::up(&place, "device", &["--config", &config]);
    run.wait("it is told what is missing", |status| told(status, "is the device plugged in"));
    for _ in 0..2 {
        // The speed is found by itself.
        let lidar = Plugged::lidar(&place, "s2");
        run.wait("it is ready for a cue", |status| status.mode.ready_for_cue);
        drop(lidar);
        run.wait("it is ready no more", |status| !status.mode.ready_for_cue);
    }
    run.wait("the plug is told of", |status| told(status, "it was unplugged"));
    let status = run.status();
    assert_eq!(service(&status, "lidar").restarts, 0, "the driver needed no restart: {status:#?}");
    let _ = run.end();
    place.assert_empty();
}

#[test]
fn the_doctor_tells_what_the_sensors_give_and_which_gives_nothing() {
    let place = Place::new();
    let config = config(&place, &port(&place), "");
    let rates = || {
        let (report, _) = place.json(&["doctor", "--config", &config, "--rates", "2s", "--json"]);
        let found = |name: &str| {
            let check = report["checks"].as_array()?.iter().find(|check| check["name"] == name)?;
            let (rate_hz, _) = check["found"].as_str()?.split_once(" a second")?;
            Some((rate_hz.parse::<f64>().ok()?, check["ok"].as_bool()?))
        };
        let found = ["lidar rate", "depth rate", "odometry rate"].map(found);
        found.map(|rate| rate.unwrap_or_else(|| panic!("{report:#}")))
    };
    let [lidar, _, odometry] = rates();
    assert_eq!(lidar, (0.0, false));
    assert!(odometry.0 > 0.0);
    let _lidar = Plugged::lidar(&place, "s2");
    let [lidar, ..] = rates();
    assert!(lidar.0 > 0.0);
    place.assert_empty();
}

/// A robot on DDS is found by its network's own discovery, over loopback.
#[test]
fn robots_on_dds_are_guided_through_bridge_and_backstop() {
    for link in ["go2", "ros2"] {
        let place = Place::new();
        let shipped = std::fs::read_to_string(project().join("config/go2.toml")).expect("readable");
        let config = place.path().join("robot.toml");
        std::fs::write(&config, shipped.replace("link = \"go2\"", &format!("link = \"{link}\""))).expect("written");
        let config = config.to_string_lossy().into_owned();
        let scenario = place.along_corridor(3.5);
        let walk = ["walk", "--emulated", "--config", &config, "--scenario", &scenario, "--json"];
        let (report, code) = place.json(&walk);
        assert_eq!((code, &report["reached"]), (0, &true.into()), "{link}: {report:#}");
        for text in ["bridge: the robot on DDS answers", "backstop: the robot on DDS answers"] {
            assert!(report_tells(&report, text), "{link}, {text}: {report:#}");
        }
        place.assert_empty();
    }
}

/// A walk from `place` through the real drivers and the real link: its report and exit code.
fn walked(place: &Place, robot: &str, lidar: &str, args: &[&str]) -> (Value, i32) {
    let config = place.path().join("robot.toml");
    let text = format!("[locomotion.unitree]\nprofile = \"{robot}\"\n[simulation.emulated]\nrplidar = \"{lidar}\"\n");
    std::fs::write(&config, text).expect("written");
    let config = config.to_string_lossy().into_owned();
    let (report, code) = place.json(&[&["walk", "--emulated", "--config", &config, "--json"], args].concat());
    let collisions = &report["collisions"];
    assert_eq!((&collisions["robot"], &collisions["handler"]), (&0.into(), &0.into()), "{report:#}");
    for text in ["answers", "samples a second", "a program is connected"] {
        assert!(report_tells(&report, text), "{text}: {report:#}");
    }
    place.assert_empty();
    (report, code)
}

#[test]
fn an_emulated_aliengo_is_guided_to_its_goal_through_real_drivers() {
    let place = Place::new();
    let lines = "start = { at = [11, 0], yaw_deg = 0 }\ngoal = { at = [18, 8], within_m = 1.5 }\ntime_limit_s = 120\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0\n[[cue]]\nkind = \"left\"\nat = [14, 0]\nwithin_m = 1.2";
    let scenario = place.scenario("left-at-tee.toml", lines);
    let (report, code) = walked(&place, "aliengo-3.8.4", "s2", &["--scenario", &scenario]);
    assert_eq!((code, &report["reached"]), (0, &true.into()), "{report:#}");
}

#[test]
fn every_other_robot_is_guided_through_real_drivers() {
    for (robot, lidar) in [("go1-3.8", "a3"), ("aliengo-3.3.1", "s1")] {
        let place = Place::new();
        let (report, code) = walked(&place, robot, lidar, &["--scenario", &place.along_corridor(3.5)]);
        assert_eq!((code, &report["reached"]), (0, &true.into()), "{robot}, {lidar}: {report:#}");
    }
}

#[test]
fn a_lidar_that_cannot_be_read_is_told_with_what_to_do() {
    let place = Place::new();
    let _lidar = Plugged::lidar(&place, "a1");
    for (more, text) in [
        ("baud = 256000", "nothing answers at 256000 baud"),
        ("baud = 115200\nmode = \"Turbo\"", "has no mode \"Turbo\", only Standard, Express, Boost, Sensitivity"),
    ] {
        let config = config(&place, &port(&place), more);
        let mut run = Live::up(&place, "device", &["--config", &config]);
        run.wait(text, |status| told(status, text));
        let _ = run.end();
    }
    let config = config(&place, &port(&place), "");
    let stepped = place.guidedog(&["walk", "--speed", "0", "--config", &config]);
    let said = String::from_utf8_lossy(&stepped.stderr).into_owned();
    assert!(stepped.status.code() == Some(2) && said.contains("keeps its own time"), "{said}");
}

#[test]
fn a_robot_that_is_there_needs_no_scenario_and_takes_none() {
    let place = Place::new();
    let shipped = project().join("config/aliengo.toml").to_string_lossy().into_owned();
    for (verb, more, text) in [
        ("walk", &[][..], "`guidedog up` runs devices"),
        ("up", &["--scenario", "corridor"], "there is no world for a scenario"),
    ] {
        let refused = place.guidedog(&[&[verb, "--config", &shipped], more].concat());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(2) && said.contains(text), "{said}");
    }
    // A robot that nobody switched on, at this machine.
    let depth = format!("[depth]\nsource = \"device\"\nsocket = {{ path = \"{}/depth\" }}", place.path().display());
    let robot = "unitree = { robot = \"127.9.8.7:8082\", local = \"127.9.8.7:8081\" }";
    let rest = format!("{depth}\n[odometry]\nsource = \"device\"\n[locomotion]\nlink = \"unitree\"\n{robot}\n");
    let unmeasured = config(&place, &port(&place), &rest);
    let refused = place.guidedog(&["up", "--config", &unmeasured]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    for what in ["robot.response.origin = \"assumed\"", "\"unitree\"", "guidedog fit-robot", "robot.profile_unmeasured"]
    {
        assert!(said.contains(what), "{what}: {said}");
    }
    let config = config(&place, &port(&place), &format!("{rest}[robot]\nprofile_unmeasured = true\n"));
    let mut run = Live::up(&place, "device", &["--config", &config]);
    for text in ["is the device plugged in", "does not answer: is it on"] {
        run.wait(text, |status| told(status, text));
    }
    let status = run.status();
    assert!(!status.mode.ready_for_cue && status.service(ServiceId::Simulator).is_none(), "{status:#?}");
    let _ = run.end();
    place.assert_empty();
}

/// A key of an input device goes down or up, as Linux tells it.
fn key(down: bool) -> Vec<u8> {
    let mut event = vec![0; 16];
    event.extend(1_u16.to_le_bytes());
    event.extend(304_u16.to_le_bytes());
    event.extend(i32::from(down).to_le_bytes());
    event
}

/// The button is a pipe: it cannot be asked what is down, but has its events and its end.
#[test]
fn a_pressed_or_unplugged_button_locks_a_walk_until_it_is_released_and_resumed() {
    let place = Place::new();
    let (device, config) = (place.path().join("button"), place.path().join("estop.toml"));
    assert!(Command::new("mkfifo").arg(&device).status().expect("coreutils").success());
    let mut button = OpenOptions::new().read(true).write(true).open(&device).expect("a pipe");
    button.write_all(&key(false)).expect("written");
    let text = format!("[estop]\nsource = \"input\"\n[estop.input]\ndevice = \"{}\"\nkey = 304\n", device.display());
    std::fs::write(&config, text).expect("written");
    let config = config.to_string_lossy().into_owned();
    let mut run = Live::up(&place, "estop", &["--scenario", "corridor", "--config", &config]);
    run.wait_walking();
    let resume = || place.guidedog(&["resume", "--run", "estop"]);
    let is_pressed = |mode: &ModeStatus| mode.reason.as_ref().is_some_and(|why| why.contains("emergency_stop"));
    let is_locked = |status: &Status| status.mode.class == ModeClass::Lock && is_pressed(&status.mode);
    button.write_all(&[key(true), key(false), key(true)].concat()).expect("written");
    run.wait("a press locks", is_locked);
    resume();
    run.wait("it is still pressed", |status| told(status, "resume refused: the emergency stop is pressed"));
    button.write_all(&key(false)).expect("written");
    let mut resumed = |what: &str| {
        run.wait(what, |status| {
            resume();
            status.mode.ready_for_cue
        });
    };
    resumed("it is released");
    drop(button);
    run.wait("an end locks", is_locked);
    run.wait("it is told", |status| told(status, "was unplugged"));
    let _ = run.end();
    place.assert_empty();
}
