//! Guided walks of a Go2 in MuJoCo towards edges of the floor and along them: neither robot nor handler leaves it.

use std::fs;

use guidance::se2::{Point, se2};
use guidedog_tests::{Place, has_legs};
use messages::WorldTruth;
use recording::{Reader, Record};
use serde_json::{Value, json};

/// Corners of a Go2's body (robot frame), metres.
const CORNERS: [(f64, f64); 4] = [(0.35, 0.155), (0.35, -0.155), (-0.35, 0.155), (-0.35, -0.155)];
const HANDLER_M: f64 = 0.25;

/// A straight edge: a point of it, and the direction away from the floor (world frame).
struct Edge {
    at: Point,
    away: [f64; 2],
}

/// A floor that ends at a straight edge: where, and what lies around the corridor's middle, 2.4 m wide.
struct Floor {
    name: &'static str,
    /// World files' `[[ramp]]` entries: at, size, height of the foot, direction in degrees.
    plateaus: Vec<([f64; 2], [f64; 2], f64, f64)>,
    /// Other entries.
    more: &'static str,
    /// None where a way leads over it.
    edge: Option<Edge>,
    /// Why they wait there, and whether the handler then says forward once more.
    waits: Option<(&'static str, bool)>,
    /// What both bodies keep from it, metres.
    kept_m: f64,
    /// Whether a way goes on.
    reaches: bool,
}

fn across(at_m: f64) -> Option<Edge> {
    Some(Edge { at: Point::new(at_m, 0.0), away: [1.0, 0.0] })
}

fn floors() -> Vec<Floor> {
    let plateau = |high_m: f64| ([-3.0, 0.0], [8.0, 2.4], high_m, 0.0);
    let steps = (0..5).map(|i| ([5.0 + 0.28 * f64::from(i), 0.0], [0.28, 2.4], 0.85 - 0.17 * f64::from(i), 0.0));
    let ends = |name, high_m| {
        let plateaus = vec![plateau(high_m)];
        let waits = Some(("drop_off", false));
        Floor { name, plateaus, more: "", edge: across(5.0), waits, kept_m: 0.3, reaches: false }
    };
    let low_step = |name, from_m: f64, to_m: f64, waits| Floor {
        name,
        plateaus: vec![plateau(from_m), ([5.0, 0.0], [7.0, 2.4], to_m, 0.0)],
        more: "",
        edge: None,
        waits: Some((waits, true)),
        kept_m: 0.0,
        reaches: true,
    };
    let turned = std::f64::consts::FRAC_PI_6;
    let (sin, cos) = turned.sin_cos();
    let oblique = ([5.0 - 8.0 * cos, -8.0 * sin], [8.0, 8.0], 1.0, 30.0);
    vec![
        Floor { name: "stairs", plateaus: [plateau(1.02)].into_iter().chain(steps).collect(), ..ends("", 0.0) },
        ends("cliff", 1.0),
        Floor { waits: Some(("drop_off", true)), ..ends("kerb-15", 0.15) },
        // From farther off the camera cannot tell it from its noise.
        Floor { kept_m: 0.2, waits: Some(("low_step_down", false)), ..ends("kerb-10", 0.10) },
        low_step("kerb-10-taken", 0.10, 0.0, "low_step_down"),
        low_step("kerb-5", 0.05, 0.0, "low_step_down"),
        low_step("kerb-5-up", 0.0, 0.05, "low_step_up"),
        Floor { reaches: false, ..low_step("kerb-10-up", 0.0, 0.10, "step_up") },
        Floor { reaches: false, ..low_step("kerb-15-up", 0.0, 0.15, "step_up") },
        Floor { name: "hole", plateaus: vec![plateau(1.0), ([6.0, 0.0], [6.0, 2.4], 1.0, 0.0)], ..ends("", 0.0) },
        Floor {
            name: "hole-of-1-m",
            plateaus: Vec::new(),
            more: "[[hole]]\nat = [5, 0]\nsize = [1, 2.4]\ndepth_m = 1\n",
            ..ends("", 0.0)
        },
        Floor {
            name: "stairs-of-a-file",
            plateaus: Vec::new(),
            more: "[[stairs]]\nat = [5, 0]\nsteps = 8\nwidth_m = 2.4\nrise_m = -0.17\nlanding_m = 4\n",
            ..ends("", 0.0)
        },
        Floor {
            name: "oblique",
            plateaus: vec![oblique],
            more: "",
            edge: Some(Edge { at: Point::new(5.0, 0.0), away: [cos, sin] }),
            waits: Some(("drop_off", false)),
            kept_m: 0.3,
            reaches: false,
        },
        Floor {
            name: "platform",
            plateaus: vec![([-3.0, 0.15], [15.0, 2.1], 1.0, 0.0)],
            more: "",
            edge: Some(Edge { at: Point::new(0.0, -0.9), away: [0.0, -1.0] }),
            waits: None,
            kept_m: 0.15,
            reaches: true,
        },
    ]
}

/// The scenario of a walk ahead over it.
fn scenario(place: &Place, floor: &Floor) -> String {
    let walls = "ceiling_m = 5.0\n[[wall]]\npoints = [[-3, -1.2], [12, -1.2], [12, 1.2], [-3, 1.2], [-3, -1.2]]\n";
    let ramps = floor.plateaus.iter().filter(|(.., from_m, _)| *from_m > 0.0).map(|(at, size, from_m, yaw_deg)| {
        format!("[[ramp]]\nat = {at:?}\nsize = {size:?}\nfrom_m = {from_m:?}\nrise_m = 0\nyaw_deg = {yaw_deg:?}\n")
    });
    let world = place.path().join("floor.toml");
    fs::write(&world, walls.to_owned() + &ramps.collect::<String>() + floor.more).expect("written");
    let lines = "start = { at = [0, 0], yaw_deg = 0 }\ngoal = { at = [9, 0], within_m = 0.7 }\ntime_limit_s = 40\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0";
    // The slowest stand before it after 16 s, and a handler says it again where nothing comes of it.
    let word = [18.0, 26.0].map(|at_s| format!("\n[[cue]]\nkind = \"forward\"\nat_s = {at_s:?}")).concat();
    let again = if floor.waits.is_some_and(|(_, says_it)| says_it) { word } else { String::new() };
    place.scenario(&world.to_string_lossy(), &(lines.to_owned() + &again))
}

/// The least that robot and handler were off the edge, metres.
fn least_m(truths: &[WorldTruth], edge: &Edge) -> [f64; 2] {
    let off_m = |point: Point| (edge.at.x - point.x) * edge.away[0] + (edge.at.y - point.y) * edge.away[1];
    let robot = truths.iter().flat_map(|truth| {
        let body = se2(truth.world_from_robot);
        CORNERS.map(|(x_m, y_m)| off_m(body * Point::new(x_m, y_m)))
    });
    let handler = truths.iter().map(|truth| {
        let body = truth.world_from_handler;
        off_m(Point::new(body.x_m, body.y_m)) - HANDLER_M
    });
    [robot.fold(f64::INFINITY, f64::min), handler.fold(f64::INFINITY, f64::min)]
}

/// What became of a walk: whether it reached its goal where it should, and what else is not as such a floor asks.
struct Walked {
    reached: bool,
    /// A touch of robot or handler that such a floor does not explain.
    touch: Option<String>,
    wrong: Vec<String>,
}

/// Walks ahead over it.
fn walks(floor: &Floor, velocity_loop: &str, seed: u64) -> Walked {
    let place = Place::new();
    let config = place.path().join("legs.toml");
    let text = format!("depth.redwood = 1.0\nsimulation.mujoco.velocity_loop = {velocity_loop:?}\n");
    fs::write(&config, text).expect("written");
    let (config, seed) = (config.to_string_lossy().into_owned(), seed.to_string());
    let recording = place.path().join("walk.mcap");
    let (to, over) = (recording.to_string_lossy().into_owned(), scenario(&place, floor));
    let options = ["--scenario", &over, "--seed", &seed, "--config", &config, "--record", &to, "--json"];
    let (report, _) = place.json(&[&["walk", "--physics", "mujoco", "--speed", "0"], &options[..]].concat());
    let truths = Reader::open(&recording).expect("a recording").filter_map(|record| match record.expect("whole") {
        Record::WorldTruth(truth) => Some(*truth),
        _ => None,
    });
    let truths: Vec<_> = truths.collect();
    let least_m = floor.edge.as_ref().map_or([f64::INFINITY; 2], |edge| least_m(&truths, edge));
    let what = format!(
        "{}, {velocity_loop} {seed}: reached {}, off the edge {least_m:.3?} m, collisions {}, falls {}, stood {}",
        floor.name, report["reached"], report["collisions"], report["falls"], report["stopped_s_by_reason"]
    );
    eprintln!("{what}");
    place.assert_empty();
    let is_stiff = velocity_loop == "stiff";
    let is_wrong = wrong(floor, is_stiff, &report, least_m).map(|wrong| format!("{wrong}: {what}")).collect();
    // The feet of a robot that takes a step meet its front. With the stiff loop the handler may be pressed against a
    // wall.
    let takes_step = floor.reaches && floor.waits.is_some();
    let touched = |who: &str| report["collisions"][who] != 0 && !is_stiff;
    let touch = (touched("handler") || touched("robot") && !takes_step).then(|| format!("a touch: {what}"));
    Walked { reached: report["reached"] == floor.reaches, touch, wrong: is_wrong }
}

/// What is not as such a floor asks.
fn wrong(floor: &Floor, is_stiff: bool, report: &Value, least_m: [f64; 2]) -> impl Iterator<Item = &'static str> {
    // With the stiff loop the handler pushes the robot on after a stop.
    let push_m = if is_stiff { 0.15 } else { 0.0 };
    let waited_s = floor.waits.map_or(0.0, |(why, _)| report["stopped_s_by_reason"][why].as_f64().unwrap_or(0.0));
    // A policy that stands before what is too high may say so itself.
    let least_s = floor.waits.map_or(-1.0, |(why, _)| match why {
        "step_up" => 0.3,
        _ if floor.reaches => 1.0,
        _ => 5.0,
    });
    let found = [
        (report["falls"] != json!({ "robot": 0, "handler": 0 }), "a fall"),
        (waited_s <= least_s, "it did not wait"),
        (least_m.iter().any(|least_m| *least_m < floor.kept_m - push_m), "too near the edge"),
        (report["reached"] == true && !floor.reaches, "it came over"),
    ];
    found.into_iter().filter_map(|(is_so, wrong)| is_so.then_some(wrong))
}

/// A platform whose edge is 0.9 m to the right, with an opening to the left, and a handler who does something there.
fn beside_an_edge(place: &Place, disturbance: &str) -> String {
    let world = place.path().join("platform.toml");
    let text = "ceiling_m = 5.0\n\
         [[wall]]\npoints = [[4.2, 1.2], [-3, 1.2], [-3, -3], [12, -3], [12, 1.2], [5.8, 1.2]]\n\
         [[wall]]\npoints = [[4.2, 1.2], [4.2, 7], [5.8, 7], [5.8, 1.2]]\n\
         [[hole]]\nat = [4.5, -1.95]\nyaw_deg = 90\nsize = [1.05, 15]\ndepth_m = 1.0\n";
    fs::write(&world, text).expect("written");
    let lines = "start = { at = [0, 0], yaw_deg = 0 }\ntime_limit_s = 20\n[[cue]]\nkind = \"forward\"\nat_s = 1.0\n\
         [[cue]]\nkind = \"left\"\nat = [3.5, 0]\n";
    place.scenario(&world.to_string_lossy(), &(lines.to_owned() + disturbance))
}

/// Disturbances while the robot walks along the edge, and while it turns.
fn disturbances() -> Vec<String> {
    let disturbance = |does: &str, at_s: f64, for_s: f64, more: &str| {
        format!("[[handler]]\ndoes = {does:?}\nat_s = {at_s:?}\nfor_s = {for_s:?}\n{more}")
    };
    let at = |at_s: f64| {
        // What the Go2's policy withstands at the body. With 45 N the handler drags the robot towards the edge.
        let pulls = [-20, 20].map(|left_n| disturbance("pull", at_s, 1.0, &format!("pull_n = [0, {left_n}]\n")));
        [disturbance("snag", at_s, 2.0, ""), disturbance("let_go", at_s, 3.0, "")].into_iter().chain(pulls)
    };
    [5.0, 9.0].into_iter().flat_map(at).chain([String::new()]).collect()
}

/// The report, where robot or handler falls or hardly walks.
fn falls_beside_an_edge(disturbance: &str, seed: u64) -> Option<String> {
    let place = Place::new();
    let (scenario, seed) = (beside_an_edge(&place, disturbance), seed.to_string());
    let options = ["--scenario", &scenario, "--seed", &seed, "--json"];
    let (report, _) = place.json(&[&["walk", "--physics", "mujoco", "--speed", "0"], &options[..]].concat());
    place.assert_empty();
    let walked_m = report["distance_m"].as_f64().unwrap_or(0.0);
    let is_well = report["falls"] == json!({ "robot": 0, "handler": 0 }) && walked_m > 2.0;
    eprintln!("seed {seed}: {walked_m:.1} m, falls {}, {disturbance}", report["falls"]);
    (!is_well).then(|| format!("seed {seed}, {disturbance}: {report:#}"))
}

#[test]
fn a_handler_who_is_caught_beside_an_edge_does_not_fall() {
    if has_legs() {
        assert_eq!(falls_beside_an_edge(&disturbances()[0], 1), None);
    }
}

#[test]
#[ignore = "five minutes: scripts/nightly physics"]
fn a_handler_who_is_caught_pulls_or_lets_go_beside_an_edge_does_not_fall() {
    let all = disturbances()
        .into_iter()
        .filter(|_| has_legs())
        .flat_map(|disturbance| (1..=3).map(move |seed| (disturbance.clone(), seed)));
    let fell: Vec<_> = all.filter_map(|(disturbance, seed)| falls_beside_an_edge(&disturbance, seed)).collect();
    assert!(fell.is_empty(), "{fell:#?}");
}

#[test]
fn in_the_flat_world_nothing_catches_a_handler() {
    let place = Place::new();
    let scenario = beside_an_edge(&place, &disturbances()[0]);
    let output = place.command(&["walk", "--scenario", &scenario]).output().expect("it runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && told.contains("need --physics mujoco: here nothing pulls"), "{told}");
    place.assert_empty();
}

/// The learnt policy, judged by the planner.
#[test]
fn a_turn_before_stairs_is_found() {
    for rise_m in [-0.17, 0.17] {
        let place = Place::new();
        let world = place.path().join("turn.toml");
        let text = "[[wall]]\npoints = [[5, 1.2], [-3, 1.2], [-3, -1.2], [14, -1.2], [14, 1.2], [7, 1.2]]\n\
             [[wall]]\npoints = [[5, 1.2], [5, 8], [7, 8], [7, 1.2]]\n\
             [[stairs]]\nat = [8.5, 0]\nsteps = 8\nwidth_m = 2.4\nlanding_m = 2\n";
        fs::write(&world, format!("{text}rise_m = {rise_m:?}\n")).expect("written");
        let lines = "start = { at = [0, 0], yaw_deg = 0 }\ngoal = { at = [6, 5], within_m = 1.0 }\n\
             time_limit_s = 60\n[[cue]]\nkind = \"forward\"\nat_s = 1.0\n\
             [[cue]]\nkind = \"left\"\nat = [3.6, 0]\nwithin_m = 0.5";
        let scenario = place.scenario(&world.to_string_lossy(), lines);
        let (report, _) = place.json(&["walk", "--scenario", &scenario, "--speed", "0", "--json"]);
        let touches = guidedog_tests::touches(&report);
        assert_eq!((&report["reached"], touches), (&json!(true), [0, 0]), "{rise_m}: {report:#}");
        place.assert_empty();
    }
}

/// A walk in the flat world, ahead to stairs that lead down.
fn to_stairs(place: &Place, config: &str, more: &[&str]) -> Value {
    let world = place.path().join("stairs.toml");
    let text = "[[wall]]\npoints = [[-3, -1.2], [12, -1.2], [12, 1.2], [-3, 1.2], [-3, -1.2]]\n\
         [[stairs]]\nat = [5, 0]\nsteps = 8\nwidth_m = 2.4\nrise_m = -0.17\nlanding_m = 4\n";
    fs::write(&world, text).expect("written");
    let lines = "start = { at = [0, 0], yaw_deg = 0 }\ngoal = { at = [9, 0], within_m = 0.7 }\ntime_limit_s = 25\n\
         [[cue]]\nkind = \"forward\"\nat_s = 1.0";
    let scenario = place.scenario(&world.to_string_lossy(), lines);
    let settings = place.path().join("run.toml");
    fs::write(&settings, config).expect("written");
    let settings = settings.to_string_lossy();
    let args = ["walk", "--scenario", &scenario, "--config", &settings, "--speed", "0", "--json"];
    place.json(&[&args, more].concat()).0
}

#[test]
fn in_the_flat_world_they_stand_before_stairs_and_the_report_tells_where() {
    let place = Place::new();
    let report = to_stairs(&place, "", &[]);
    assert_eq!(report["falls"], json!({ "robot": 0, "handler": 0 }), "{report:#}");
    let waited_s = report["stopped_s_by_reason"]["drop_off"].as_f64().unwrap_or(0.0);
    assert!(waited_s > 5.0, "{report:#}");
    let (away, [x, ..]) = ("m from the hull", report["end_pose"].as_array().expect("a pose").as_slice()) else {
        panic!("{report:#}")
    };
    assert!(x.as_f64().is_some_and(|x_m| (3.5..4.5).contains(&x_m)), "{report:#}");
    assert!(report["stops"].to_string().contains(away), "{report:#}");
    place.assert_empty();
}

#[test]
fn a_robot_that_does_not_see_the_floor_falls_and_the_report_says_so() {
    let place = Place::new();
    let report = to_stairs(&place, "[depth]\nsource = \"absent\"\nneeded = false\n", &[]);
    assert_eq!(report["falls"], json!({ "robot": 1, "handler": 0 }), "{report:#}");
    assert_eq!(report["reached"], false);
    place.assert_empty();
}

#[test]
fn a_second_lidar_that_looks_down_keeps_a_robot_without_a_camera_off_stairs() {
    let place = Place::new();
    let recording = place.path().join("walk.mcap").to_string_lossy().into_owned();
    let report = to_stairs(
        &place,
        "depth = { source = \"absent\", needed = false }\n[lidar.second]\nfield_of_view_deg = 120\nbeams = 120\n\
         height_m = 0.40\npitch_deg = 22\nrobot_from_lidar = { x_m = 0.30, y_m = 0.0, yaw_rad = 0.0 }\n",
        &["--record", &recording],
    );
    assert_eq!(report["falls"], json!({ "robot": 0, "handler": 0 }), "{report:#}");
    let waited_s = report["stopped_s_by_reason"]["drop_off"].as_f64().unwrap_or(0.0);
    assert!(waited_s > 5.0, "{report:#}");
    let (replay, _) = place.json(&["replay", &recording, "--speed", "0", "--json"]);
    let permits = &replay["compared"]["permits"];
    assert!(permits["recorded"].as_u64().is_some_and(|count| count > 200), "{replay:#}");
    assert_eq!(permits["equal"], permits["recorded"], "{replay:#}");
    place.assert_empty();
}

/// SECURITY.md tells of both.
#[test]
fn robot_and_handler_are_led_into_what_no_sensor_sees_and_the_report_says_so() {
    let place = Place::new();
    let walk = |scenario: &str| place.json(&["walk", "--scenario", scenario, "--speed", "0", "--json"]).0;
    let glass = walk("glass");
    assert!(glass["collisions"]["robot"].as_u64().is_some_and(|touches| touches > 0), "{glass:#}");
    let gap = walk("platform-gap");
    assert_eq!(gap["falls"], json!({ "robot": 1, "handler": 0 }), "{gap:#}");
    place.assert_empty();
}

#[test]
fn a_go2_stands_before_stairs_that_lead_down() {
    let of_a_file = floors().into_iter().find(|floor| floor.name == "stairs-of-a-file").expect("it is one of them");
    if has_legs() {
        let Walked { reached, touch, wrong } = walks(&of_a_file, "soft", 1);
        assert!(reached && touch.is_none() && wrong.is_empty(), "{touch:?} {wrong:#?}");
    }
}

#[test]
fn a_go2_takes_a_kerb_on_the_word_of_its_handler() {
    let taken = floors().into_iter().find(|floor| floor.name == "kerb-10-taken").expect("it is one of them");
    if has_legs() {
        let Walked { reached, touch, wrong } = walks(&taken, "soft", 1);
        assert!(reached && touch.is_none() && wrong.is_empty(), "{touch:?} {wrong:#?}");
    }
}

#[test]
#[ignore = "twenty minutes: scripts/nightly physics"]
fn a_go2_and_its_handler_keep_off_every_edge() {
    // Names of floors, with commas between them; all without it.
    let asked = std::env::var("GUIDEDOG_FLOORS").ok();
    let is_asked = |name: &str| asked.as_ref().is_none_or(|asked| asked.split(',').any(|other| other == name));
    let mut wrong = Vec::new();
    for floor in floors().into_iter().filter(|floor| has_legs() && is_asked(floor.name)) {
        let each = |velocity_loop| (1..=5).map(move |seed| (velocity_loop, seed));
        let walked: Vec<Walked> =
            ["soft", "stiff"].into_iter().flat_map(each).map(|(by, seed)| walks(&floor, by, seed)).collect();
        let (reached, all) = (walked.iter().filter(|walked| walked.reached).count(), walked.len());
        // The robot may come to stand astride a kerb. That is no fall.
        let takes_step = floor.reaches && floor.waits.is_some();
        if reached * 10 < all * if takes_step { 8 } else { 10 } {
            wrong.push(format!("{}: {reached} of {all} came as far as they should", floor.name));
        }
        // A leg that stumbles counts as a touch.
        let touches: Vec<_> = walked.iter().filter_map(|walked| walked.touch.clone()).collect();
        if touches.len() > 1 {
            wrong.extend(touches);
        }
        wrong.extend(walked.into_iter().flat_map(|walked| walked.wrong));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
