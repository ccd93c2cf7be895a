//! Walks along routes on real floors, through the whole stack, with a handler who errs.
//!
//! `tests/routes.toml` holds the routes, which were drawn on the maps by hand.

use std::fs;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use guidedog_tests::{Place, data, has_legs, project, touches};
use serde::Deserialize;
use serde_json::{Value, json};

/// A route on a floor. Places are of the map's frame, metres.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Route {
    /// The floor and a letter.
    name: String,
    /// The map, below the folder of the maps.
    map: String,
    /// The length of the way.
    length_m: f64,
    start: Start,
    goal: [f64; 2],
    /// The turns: the cue, and where a handler who does not err gives it.
    cues: Vec<(String, f64, f64)>,
    /// The way that is meant.
    path: Vec<[f64; 2]>,
    /// What a person would say of the way.
    about: String,
    /// Why the route may be unfair.
    doubt: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Start {
    at: [f64; 2],
    yaw_deg: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Routes {
    route: Vec<Route>,
}

/// A goal is reached where the robot comes this near, metres.
const WITHIN_M: f64 = 1.5;
/// On its way to the last turn a route keeps so much farther from its goal, metres.
const PASSING_M: f64 = 1.0;
/// The longest freeze that is allowed, seconds. Nobody stands in the way.
const FREEZE_MAX_S: f64 = 20.0;
/// Number of walks along each route. Each walk has its own seed and errors.
const SEEDS: usize = 3;
/// Number of walks on legs.
const ON_LEGS: usize = 20;

fn routes() -> Vec<Route> {
    let text = fs::read_to_string(project().join("tests/routes.toml")).expect("the routes");
    toml::from_str::<Routes>(&text).expect("routes").route
}

/// What the handler does wrong in the walk of that number: in every second walk nothing; otherwise they face up to 30
/// degrees off at the start, and give their cues up to 2 m early or late.
fn errors(number: usize) -> (f64, f64) {
    const ERRORS: [(f64, f64); 6] =
        [(30.0, 2.0), (-30.0, -2.0), (20.0, -1.0), (-20.0, 1.0), (-30.0, 2.0), (30.0, -2.0)];
    if number.is_multiple_of(2) { (0.0, 0.0) } else { ERRORS[number / 2 % ERRORS.len()] }
}

/// Walks a route; the report, and a line that tells what came of it. Where there is no room for the handler of a pair
/// that faces off to one side, it faces off to the other.
fn walk(route: &Route, number: usize, more: &[&str]) -> Option<(Value, String)> {
    let (orientation_deg, timing_m) = errors(number);
    let (report, line) = walk_with(route, number, (orientation_deg, timing_m), more)?;
    let has_no_room = report["error"].as_str().is_some_and(|error| error.contains("start is not free"));
    if has_no_room && orientation_deg != 0.0 {
        return walk_with(route, number, (-orientation_deg, timing_m), more);
    }
    Some((report, line))
}

fn walk_with(
    route: &Route,
    number: usize,
    (orientation_deg, timing_m): (f64, f64),
    more: &[&str],
) -> Option<(Value, String)> {
    let map = data(&format!("maps/{}", route.map))?;
    let place = Place::new();
    // The turns may take as long as the way.
    let limit_s = 60.0 + 2.0 * route.length_m / 0.5;
    let mut lines = format!(
        "goal = {{ at = {:?}, within_m = {WITHIN_M:?} }}\ntime_limit_s = {limit_s:?}\n[[cue]]\nkind = \"forward\"\n\
         at_s = 1.0\n",
        route.goal
    );
    for (kind, x_m, y_m) in &route.cues {
        lines += &format!("[[cue]]\nkind = {kind:?}\nat = [{x_m:?}, {y_m:?}]\nwithin_m = 1.2\n");
    }
    let cues = place.path().join("route.toml");
    fs::write(&cues, lines).expect("written");
    let config = place.path().join("errors.toml");
    let errors = format!("[walk.errors]\norientation_deg = {orientation_deg:?}\ntiming_m = {timing_m:?}\n");
    fs::write(&config, errors).expect("written");
    let [x_m, y_m] = route.start.at;
    let start = format!("{x_m},{y_m},{}", route.start.yaw_deg.to_radians());
    let seed = (number % SEEDS + 1).to_string();
    let [map, cues, config] = [map, cues, config].map(|path| path.to_string_lossy().into_owned());
    let args = ["walk", "--map", &map, "--start", &start, "--cues", &cues, "--config", &config, "--seed", &seed];
    let (report, _) = place.json(&[&args[..], more, &["--speed", "0", "--json"]].concat());
    place.assert_empty();
    let line = format!(
        "{}, seed {seed}, {orientation_deg} degrees, {timing_m} m: reached {}, collisions {}, freeze {:.1} s, {:.0} s, \
         {:.0} m of way, stood {}",
        route.name,
        report["reached"],
        report["collisions"],
        report["longest_freeze_s"].as_f64().unwrap_or(f64::NAN),
        report["duration_s"].as_f64().unwrap_or(f64::NAN),
        route.length_m,
        report["stopped_s_by_reason"]
    );
    eprintln!("{line}");
    Some((report, line))
}

/// Walks all of them, two at once. The lines of those that did not arrive, that touched something, and that froze.
fn walk_all(numbers: &[(usize, &Route)], more: &[&str]) -> [Vec<String>; 3] {
    let (next, walked) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let walk_on = || {
        while let Some((number, route)) = numbers.get(next.fetch_add(1, Ordering::Relaxed)) {
            walked.lock().expect("no panic").extend(walk(route, *number, more));
        }
    };
    thread::scope(|scope| {
        let other = scope.spawn(walk_on);
        walk_on();
        other.join().expect("the other half");
    });
    let walked = walked.into_inner().expect("no panic");
    let which = |is_so: &dyn Fn(&Value) -> bool| {
        walked.iter().filter(|(report, _)| is_so(report)).map(|(_, line)| line.clone()).collect::<Vec<_>>()
    };
    let found = [
        which(&|report| report["reached"] != json!(true)),
        which(&|report| touches(report) != [0, 0]),
        which(&|report| report["longest_freeze_s"].as_f64().is_none_or(|freeze_s| freeze_s > FREEZE_MAX_S)),
    ];
    let [not_arrived, touched, frozen] = found.each_ref().map(Vec::len);
    eprintln!("{} walks: {not_arrived} did not arrive, {touched} touched, {frozen} froze", walked.len());
    found
}

fn distance_m(a: &[f64; 2], b: &[f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn every_route_tells_of_a_map_and_of_turns() {
    let routes = routes();
    assert!(routes.len() >= 30, "{}", routes.len());
    for route in &routes {
        let is_turn = |(kind, x_m, y_m): &(String, f64, f64)| {
            ["left", "right"].contains(&kind.as_str()) && x_m.is_finite() && y_m.is_finite()
        };
        assert!(!route.cues.is_empty() && route.cues.iter().all(is_turn), "{route:?}");
        assert!(route.length_m > 30.0 && !route.about.is_empty() && route.doubt.as_deref() != Some(""), "{route:?}");
        // Each turn is asked for on the way, and the way leads from start to goal.
        let near = |a: &[f64; 2], b: &[f64; 2]| distance_m(a, b) < 1.0;
        assert!(near(&route.path[0], &route.start.at), "{route:?}");
        assert!(near(&route.path[route.path.len() - 1], &route.goal), "{route:?}");
        for (_, x_m, y_m) in &route.cues {
            assert!(route.path.iter().any(|at| near(at, &[*x_m, *y_m])), "{route:?}");
        }
        // A walk ends where it comes to its goal: not before the last turn.
        let last = route.cues.last().map_or(route.start.at, |(_, x_m, y_m)| [*x_m, *y_m]);
        let ways = route.path.windows(2).take_while(|way| !near(&way[0], &last));
        for (from, to) in ways.map(|way| (way[0], way[1])) {
            let at = |i: f64| [from[0] + (to[0] - from[0]) * i / 1e2, from[1] + (to[1] - from[1]) * i / 1e2];
            let passes = (0..=100).any(|i| distance_m(&at(f64::from(i)), &route.goal) < WITHIN_M + PASSING_M);
            assert!(!passes, "{} comes past its goal on the way", route.name);
        }
        assert_eq!(routes.iter().filter(|other| other.name == route.name).count(), 1, "{}", route.name);
    }
}

/// One of them in every test run; the rest is `scripts/nightly routes`.
#[test]
fn a_route_on_a_real_floor_is_walked() {
    let routes = routes();
    let route = routes.iter().find(|route| route.name == "eng2-3f-a").expect("the route");
    let Some((report, line)) = walk(route, 0, &[]) else { return };
    assert_eq!((&report["reached"], touches(&report)), (&json!(true), [0, 0]), "{line}");
}

/// The routes whose names begin with the text of the variable `ROUTES`; all where it is not set.
fn asked_routes() -> Vec<Route> {
    let begins = std::env::var("ROUTES").unwrap_or_default();
    let asked: Vec<_> = routes().into_iter().filter(|route| route.name.starts_with(&begins)).collect();
    assert!(!asked.is_empty(), "no route of tests/routes.toml begins with {begins:?}");
    asked
}

#[test]
#[ignore = "two hours: scripts/nightly routes"]
fn every_route_on_every_floor_is_walked() {
    let routes = asked_routes();
    let numbers: Vec<_> = (0..SEEDS)
        .flat_map(|seed| routes.iter().enumerate().map(move |(i, route)| (SEEDS * i + seed, route)))
        .collect();
    let [not_arrived, touched, frozen] = walk_all(&numbers, &[]);
    assert!(not_arrived.len() * 50 <= numbers.len(), "{not_arrived:#?}");
    assert!(touched.is_empty() && frozen.is_empty(), "touched: {touched:#?}, froze: {frozen:#?}");
}

#[test]
#[ignore = "an hour: scripts/nightly routes"]
fn routes_on_real_floors_are_walked_on_legs() {
    if !has_legs() {
        return;
    }
    let routes = asked_routes();
    // Of all floors: they follow one another in the file.
    let count = routes.len().min(ON_LEGS);
    let numbers: Vec<_> = (0..count).map(|i| (i, &routes[i * routes.len() / count])).collect();
    let [not_arrived, touched, _] = walk_all(&numbers, &["--physics", "mujoco"]);
    assert!(not_arrived.len() <= 1, "{not_arrived:#?}");
    assert!(touched.is_empty(), "{touched:#?}");
}
