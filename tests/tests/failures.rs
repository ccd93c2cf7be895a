//! `guidedog evaluate --failures` and `--replay`: what a developer gets to see of what fails, and what a change does to
//! it.

use std::fs;
use std::path::PathBuf;

use guidedog_tests::Place;
use serde_json::{Value, json};

/// Episodes that take little time, of which some fail.
const EPISODES: [&str; 13] = [
    "evaluate",
    "--policy",
    "guide",
    "--planner",
    "off",
    "--noise",
    "ideal",
    "--camera",
    "16x8",
    "--episodes",
    "16",
    "--seed",
    "4",
];

/// The report, and the folder of failures.
fn stored(place: &Place) -> (Value, PathBuf) {
    let folder = place.path().join("failures");
    let more = ["--failures", &folder.to_string_lossy(), "--json"].map(str::to_owned);
    let args: Vec<&str> = EPISODES.into_iter().chain(more.iter().map(String::as_str)).collect();
    let (report, code) = place.json(&args);
    assert_eq!(code, 0, "{report:#}");
    (report, folder)
}

fn load(path: &std::path::Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).expect("readable")).expect("JSON")
}

fn numbers(failures: &Value) -> Vec<u64> {
    let clusters = failures["clusters"].as_array().expect("clusters");
    let mut all: Vec<u64> = clusters
        .iter()
        .flat_map(|cluster| cluster["episodes"].as_array().expect("numbers"))
        .map(|number| number.as_u64().expect("a number"))
        .collect();
    all.sort_unstable();
    all
}

#[test]
fn failures_are_stored_by_class_and_come_out_the_same_when_they_are_walked_again() {
    let place = Place::new();
    fs::create_dir_all(place.path().join("failures")).expect("a folder");
    for there in ["episode-7777.json", "notes.json"] {
        fs::write(place.path().join("failures").join(there), "").expect("written");
    }
    let (report, folder) = stored(&place);
    let listed = load(&folder.join("failures.json"));
    let clusters = report["failures"]["clusters"].as_array().expect("clusters");
    assert!(clusters.len() > 1 && listed["clusters"] == report["failures"]["clusters"], "{listed:#}");
    let counts: Vec<u64> = clusters.iter().filter_map(|cluster| cluster["count"].as_u64()).collect();
    assert!(counts.is_sorted_by(|a, b| a >= b), "the greatest first: {counts:?}");
    let numbers = numbers(&listed);
    assert_eq!(numbers.len() as u64, report["failures"]["count"].as_u64().expect("a count"), "{report:#}");
    assert_eq!(report["failures"]["share"]["mean"], json!(numbers.len() as f64 / 16.0));
    let is_there = |name: &str| folder.join(name).exists();
    assert!(!is_there("episode-7777.json") && is_there("notes.json"), "an earlier evaluation's go, and nothing else");
    let page = fs::read_to_string(folder.join("index.html")).expect("a page");
    assert!(page.contains("<svg ") && page.ends_with("</html>\n"), "{page}");
    for number in &numbers {
        let file = load(&folder.join(format!("episode-{number}.json")));
        assert!(page.contains(&format!("href=\"episode-{number}.json\"")));
        assert!(file["task"].as_str().is_some_and(|task| task.contains("Done when")), "{file:#}");
        assert_ne!(file["report"]["success"], json!(null));
    }
    let (replay, code) = place.json(&["evaluate", "--replay", &folder.to_string_lossy(), "--json"]);
    assert_eq!((code, &replay["verdicts"]["same"]), (0, &json!(numbers.len())), "{replay:#}");
    // The command that the report names, with a picture.
    let first = clusters[0]["episodes"][0].to_string();
    let command = clusters[0]["replay"].as_str().expect("a command");
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    let pictures = place.path().join("pictures");
    let output = place.guidedog(&[&words[..], &["--pictures", &pictures.to_string_lossy()]].concat());
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && told.contains("1 same") && told.contains("Done when"), "{told}");
    let picture = fs::read_to_string(pictures.join(format!("episode-{first}.svg"))).expect("a picture");
    assert!(picture.starts_with("<svg "), "{picture}");
}

#[test]
fn a_report_begins_with_what_fails_most_and_its_command_walks_it_without_a_file() {
    let place = Place::new();
    let output = place.guidedog(&EPISODES);
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = told.lines().find(|line| line.starts_with("fails most: ")).expect("a line");
    assert_eq!(told.lines().find(|line| line.contains("episodes")), Some(line), "it comes first: {told}");
    let (what, command) = line.split_once("; see one: guidedog ").expect("a command");
    let output = place.guidedog(&command.split(' ').collect::<Vec<_>>());
    let again = String::from_utf8_lossy(&output.stdout).into_owned();
    let class = what["fails most: ".len()..].split(" (").next().expect("a class");
    assert!(output.status.success() && again.contains(class), "{class}: {again}");
    assert_eq!(again.lines().count(), 4, "a head, a row, the task, what happened: {again}");
}

#[test]
fn after_a_change_it_is_told_what_is_fixed_and_what_differs() {
    let place = Place::new();
    let (_, folder) = stored(&place);
    let folder = folder.to_string_lossy().into_owned();
    let (replay, code) = place.json(&["evaluate", "--replay", &folder, "--policy", "geometric", "--json"]);
    assert_eq!(code, 0, "{replay:#}");
    let verdicts = replay["verdicts"].as_object().expect("verdicts");
    assert!(verdicts["fixed"].as_u64() > Some(0) && verdicts["same"] == json!(0), "{verdicts:?}");
    for one in replay["replays"].as_array().expect("episodes") {
        let differs = one["differs"].as_array().expect("keys");
        assert!(["arguments", "policy"].iter().all(|key| differs.contains(&json!(key))), "{one:#}");
        assert!(!differs.contains(&json!("program_sha256")), "{one:#}");
        assert_eq!(one["verdict"] == json!("fixed"), one["failed"].is_null(), "{one:#}");
    }
}

#[test]
fn a_file_that_is_no_failure_or_was_changed_is_refused_by_name() {
    let place = Place::new();
    let (report, folder) = stored(&place);
    let number = numbers(&report["failures"])[0];
    let file = folder.join(format!("episode-{number}.json"));
    let text = fs::read_to_string(&file).expect("readable");
    let replay = |text: &str| {
        fs::write(&file, text).expect("written");
        let (told, code) = place.json(&["evaluate", "--replay", &file.to_string_lossy(), "--json"]);
        (told["error"].as_str().unwrap_or_default().to_owned(), code)
    };
    let name = file.to_string_lossy().into_owned();
    for (text, why) in [
        (text[..text.len() / 2].to_owned(), "this is no failure of an evaluation: EOF"),
        ("{}".to_owned(), "this is no failure of an evaluation: it has no guidedog_failure"),
        (text.replace("\"guidedog_failure\": 1", "\"guidedog_failure\": 9"), "guidedog_failure is 9"),
        (text.replace("\"class\": \"", "\"class\": \"un"), "this is no failure of an evaluation: unknown variant"),
        (text.replace("\"--planner\"", "\"--planer\""), "unexpected argument '--planer'"),
        (text.replace("\"digests\": {", "\"digests\": 3, \"more\": {"), "this is no failure of an evaluation"),
    ] {
        let (told, code) = replay(&text);
        assert!(code == 2 && told.contains(&name) && told.contains(why), "{code}, {why}: {told}");
    }
    // Its figures are not those of this episode.
    let (told, code) = replay(&text.replace("\"decisions\": ", "\"decisions\": 1"));
    assert!(code == 7 && told.contains("the same program, model and maps gave another outcome"), "{code}: {told}");
    for (what, why) in [("nowhere.json", "nowhere.json: No such file"), ("shared/control", "there are no failures")] {
        let (told, code) = place.json(&["evaluate", "--replay", what, "--json"]);
        assert!(code == 2 && told["error"].to_string().contains(why), "{told:#}");
    }
}

#[test]
fn what_is_of_others_is_neither_replaced_nor_read() {
    let place = Place::new();
    let folder = place.path().join("site");
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join("index.html"), "mine").expect("written");
    let site = folder.to_string_lossy().into_owned();
    let few =
        ["evaluate", "--policy", "geometric", "--noise", "ideal", "--camera", "16x8", "--episodes", "1", "--json"];
    let (told, code) = place.json(&[&few[..], &["--failures", &site]].concat());
    assert!(code == 2 && told["error"].to_string().contains("index.html: it is there already"), "{told:#}");
    assert_eq!(fs::read_to_string(folder.join("index.html")).expect("readable"), "mine");
    let (told, code) = place.json(&["evaluate", "--replay", "/dev/null", "--json"]);
    assert!(code == 2 && told["error"].to_string().contains("/dev/null: it is no regular file"), "{told:#}");
    let (told, code) = place.json(&["evaluate", "--explain", "3", "--shard", "1/2", "--json"]);
    assert!(code == 2 && told["error"].to_string().contains("cannot be used with"), "{told:#}");
    // Where nothing failed there is nothing to walk again.
    let none = place.path().join("none").to_string_lossy().into_owned();
    let (report, code) = place.json(&[&few[..], &["--failures", &none]].concat());
    assert_eq!((code, &report["failures"]["count"]), (0, &json!(0)), "{report:#}");
    let (told, code) = place.json(&["evaluate", "--replay", &none, "--json"]);
    assert_eq!((code, &told["replays"]), (0, &json!([])), "{told:#}");
}
