//! `guidedog evaluate`: the shipped policy, and what an operator gets to read.

use std::fs;
use std::process::Output;

use guidedog_tests::Place;
use serde_json::Value;

fn evaluate(place: &Place, args: &[&str]) -> Output {
    place.command(&[&["evaluate"], args].concat()).output().expect("runs")
}

fn report(place: &Place, args: &[&str]) -> Value {
    let output = evaluate(place, &[args, &["--json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one object")
}

/// Far below what it reaches on more episodes: this is whether it works at all, and whether it stays so.
#[test]
fn the_shipped_policy_guides() {
    let place = Place::new();
    let found = report(&place, &["--policy", "guide", "--episodes", "100", "--seed", "77"]);
    for (figure, least) in [
        ("/collision_free/mean", 0.93),
        ("/cue_success/forward/mean", 0.85),
        ("/cue_success/turn_taken/mean", 0.70),
        ("/cue_success/stop/mean", 1.0),
    ] {
        let value = found.pointer(figure).and_then(Value::as_f64).unwrap_or_default();
        assert!(value >= least, "{figure} = {value}, at least {least} is wanted: {found:#}");
    }
    assert_eq!(found["unsafe_taken"]["mean"], 0.0, "behind beta 0 nothing forbidden is done: {found:#}");
}

#[test]
fn the_same_seed_gives_the_same_figures_on_any_number_of_cores() {
    let place = Place::new();
    let figures = |policy: &str, seed: &str, workers: &str| {
        let args = ["--policy", policy, "--episodes", "12", "--seed", seed, "--workers", workers];
        let mut found = report(&place, &args);
        // The clock's, not the seed's.
        assert!(found.as_object_mut().is_some_and(|report| report.remove("decision_us").is_some()), "{found:#}");
        found
    };
    for policy in ["guide", "geometric"] {
        assert_eq!(figures(policy, "3", "1"), figures(policy, "3", "3"), "{policy}");
    }
    assert_ne!(figures("guide", "3", "2")["walked_m"], figures("guide", "4", "2")["walked_m"]);
}

/// The digest of a few episodes, in some of which people are in the way.
fn outcomes_among(place: &Place, people: &[&str]) -> Value {
    let episodes = ["--policy", "guide", "--planner", "off", "--noise", "ideal", "--camera", "16x8"];
    let found = report(place, &[&episodes[..], &["--episodes", "6", "--seed", "4"], people].concat());
    assert!(found["outcomes_sha256"].is_string(), "{found:#}");
    found["outcomes_sha256"].clone()
}

#[test]
fn each_kind_of_people_gives_other_outcomes_and_the_same_ones_again() {
    let place = Place::new();
    let kinds = ["social", "paths", "none"];
    let digests = kinds.map(|people| outcomes_among(&place, &["--people", people]));
    for (people, digest) in kinds.iter().zip(&digests) {
        assert_eq!(outcomes_among(&place, &["--people", people]), *digest, "{people}");
    }
    let [social, paths, none] = &digests;
    assert!(social != paths && social != none && paths != none, "{digests:?}");
    assert_eq!(outcomes_among(&place, &[]), *paths, "people on paths are the default");
}

#[test]
fn pictures_are_drawn_and_what_cannot_be_evaluated_is_named() {
    let place = Place::new();
    let folder = place.path().join("pictures");
    fs::create_dir(&folder).expect("a folder");
    for there in ["wrong-7.svg", "wrong-notes.svg"] {
        fs::write(folder.join(there), "").expect("written");
    }
    let folder = folder.to_string_lossy();
    report(&place, &["--policy", "guide", "--episodes", "2", "--pictures", &folder]);
    let is_there = |name: &str| fs::exists(format!("{folder}/{name}")).expect("a folder");
    assert!(!is_there("wrong-7.svg") && is_there("wrong-notes.svg"), "an earlier evaluation's go, and nothing else");
    let picture = fs::read_to_string(format!("{folder}/first-0.svg")).expect("a picture");
    assert!(picture.starts_with("<svg ") && picture.ends_with("</svg>"), "{picture}");
    let rod = place.path().join("rod.toml");
    fs::write(&rod, "[handler]\nmodel = \"rod\"\n").expect("written");
    let rod = rod.to_string_lossy();
    let stout = place.path().join("stout.toml");
    fs::write(&stout, "[handler]\nradius_m = 2.0\n").expect("written");
    let stout = stout.to_string_lossy();
    for (args, why) in [
        (&["--policy", "guide.bin"][..], "guide.bin: no engine loads a file of that kind"),
        (&["--policy", "nowhere.onnx"], "failed to read nowhere.onnx"),
        (&["--worlds", "nowhere.yaml"], "nowhere.yaml"),
        (&["--beta-test", "2"], "--beta-test is 2, not in 0..1"),
        (&["--episodes", "0"], "0 is not in 1..=1000000"),
        (&["--config", &rod], "handler.model of the configuration is \"rod\""),
        (&["--config", &stout], "no corridor with room for robot and handler"),
        (&["--worlds", "generated", "nowhere.yaml"], "or maps, not two of them"),
        (&["--worlds", "generated", "buildings"], "or maps, not two of them"),
        (&["--worlds", "buildings", "--tasks", "drops"], "is of --worlds generated"),
        (&["--worlds", "nowhere.yaml", "--tasks", "orientation"], "empty corridors: --worlds generated"),
        (&["--paired", "--beta-test", "1"], "--paired compares with episodes without the shield"),
        (&["--people", "crowd"], "invalid value 'crowd' for '--people"),
        (&["--people", "crowd"], "[possible values: paths, social, none]"),
        (&["--people", "social", "--tasks", "orientation"], "empty corridors: --people none"),
        (&["--pictures", "/dev/null/pictures"], "/dev/null/pictures: Not a directory"),
    ] {
        let output = evaluate(&place, args);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && told.contains(why), "{args:?}: {told}");
    }
}

#[test]
fn what_tasks_ask_for_is_told_and_drawn() {
    let Some(maps) = test_data::data("maps") else { return };
    let place = Place::new();
    let (map, folder) = (maps.join("utexas_gdc/3.yaml"), place.path().join("tasks"));
    let (map, folder) = (map.to_string_lossy(), folder.to_string_lossy());
    let args = ["--policy", "geometric", "--worlds", &map, "--explain", "6", "--pictures", &folder];
    let tasks = report(&place, &args)["tasks"].as_array().expect("tasks").clone();
    assert_eq!(tasks.len(), 6);
    for (number, task) in tasks.iter().enumerate() {
        let words = task["explanation"].as_str().expect("words");
        let cue = task["cue"].as_str().expect("a cue");
        assert!(words.to_lowercase().starts_with(cue) && words.contains(" Done when "), "{words}");
        assert_eq!(task["place"], *map);
        let picture = fs::read_to_string(format!("{folder}/task-{number}.svg")).expect("a picture");
        assert!(picture.starts_with("<svg ") && picture.contains("Done when"), "{picture}");
    }
    let lines = String::from_utf8(evaluate(&place, &args).stdout).expect("text");
    let told: Vec<&str> = lines.lines().collect();
    assert!(told.len() == 6 && told[5].contains(tasks[5]["explanation"].as_str().expect("words")), "{lines}");
}

/// Worlds whose floor ends, the robot on legs.
fn drops(place: &Place, episodes: &str, camera: &str) -> Value {
    let args = ["--policy", "geometric", "--tasks", "drops", "--noise", "legged", "--camera", camera];
    report(place, &[&args[..], &["--episodes", episodes, "--seed", "5"]].concat())
}

fn stay_on_the_floor(found: &Value) {
    let figure = |at: &str| found.pointer(at).and_then(Value::as_f64).unwrap_or(f64::NAN);
    for fell in ["/falls/robot/mean", "/falls/handler/mean"] {
        assert_eq!(figure(fell), 0.0, "{fell}: {found:#}");
    }
    for (at, least) in [
        ("/stood_before_edge/n", 5.0),
        ("/stood_before_edge/mean", 0.7),
        ("/robot_before_edge_min_m", 0.3),
        ("/beside_edge_min_m", 0.1),
        ("/cue_followed_where_a_way_exists/mean", 0.7),
    ] {
        assert!(figure(at) >= least, "{at} = {}, at least {least} is wanted: {found:#}", figure(at));
    }
    let false_stops = figure("/false_stops_per_km/lo");
    assert!(false_stops <= 1.0, "{found:#}");
}

#[test]
fn shards_that_were_interrupted_come_to_the_same_figures_as_one_evaluation() {
    let place = Place::new();
    let file = |name: &str| place.path().join(name).with_extension("jsonl").display().to_string();
    let of = |more: &[&str]| {
        let args = ["evaluate", "--policy", "geometric", "--tasks", "drops", "--episodes", "6", "--json"];
        let (mut report, code) = place.json(&[&args, more].concat());
        report["decision_us"] = Value::Null;
        (report, code)
    };
    let (whole, code) = of(&[]);
    assert_eq!((code, &whole["episodes"]), (0, &6.into()), "{whole:#}");
    for shard in ["1/2", "2/2"] {
        let file = file(&shard[..1]);
        let (part, code) = of(&["--shard", shard, "--outcomes", &file]);
        assert_eq!((code, &part["episodes"], &part["episodes_missing"]), (0, &3.into(), &3.into()), "{part:#}");
    }
    // It was left while it wrote its last line.
    let first = file("1");
    let text = std::fs::read_to_string(&first).expect("written");
    std::fs::write(&first, &text[..text.len() - 40]).expect("written");
    let (refused, code) = of(&["--shard", "1/2", "--outcomes", &first]);
    assert!(code != 0 && refused["error"].to_string().contains("--resume goes on with it"), "{refused:#}");
    let (other, code) = of(&["--shard", "1/2", "--outcomes", &first, "--resume", "--seed", "2"]);
    assert!(code != 0 && other["error"].to_string().contains("its seed is 1, not 2"), "{other:#}");
    assert_eq!(of(&["--shard", "1/2", "--outcomes", &first, "--resume"]).1, 0);
    let (empty, code) = of(&["--shard", "7/7", "--outcomes", &file("7")]);
    assert_eq!((code, &empty["episodes"]), (0, &0.into()), "{empty:#}");
    std::fs::write(file("mine"), "my only copy").expect("written");
    let (mine, code) = of(&["--outcomes", &file("mine"), "--resume"]);
    assert!(code == 2 && mine["error"].to_string().contains("this is no file of outcomes"), "{mine:#}");
    assert_eq!(std::fs::read_to_string(file("mine")).expect("readable"), "my only copy");
    std::fs::write(file("null"), "null\n").expect("written");
    let (none, code) = place.json(&["evaluate", "--json", "--merge", &file("null")]);
    assert!(code == 2 && none["error"].to_string().contains("null.jsonl, line 1"), "{none:#}");
    let (mut merged, code) = place.json(&["evaluate", "--json", "--merge", &first, &file("2")]);
    merged["decision_us"] = Value::Null;
    assert_eq!(code, 0);
    assert_eq!(merged, whole);
}

#[test]
fn robot_and_handler_stay_on_the_floor_where_it_ends() {
    stay_on_the_floor(&drops(&Place::new(), "200", "128x64"));
}

/// By hand, and in `scripts/nightly physics`: a quarter of an hour.
#[test]
#[ignore = "minutes"]
fn robot_and_handler_stay_on_the_floor_in_two_thousand_worlds() {
    stay_on_the_floor(&drops(&Place::new(), "2000", "128x64"));
    stay_on_the_floor(&drops(&Place::new(), "100", "640x480"));
}
