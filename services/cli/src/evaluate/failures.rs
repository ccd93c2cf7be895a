//! The episodes that failed, by class: what fails most comes first. With `--failures` each is stored to be walked
//! again.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use episodes::{Asked, Class, Failure as Failed, Report, Thing, explain, part_seed};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::log::Outcomes;
use super::outcome::Outcome;
use super::{Evaluation, picture, regular, words};
use crate::args::evaluate::EvaluateArgs;
use crate::exit::Failure;
use crate::out::{count, elements, number, text};
use crate::statistics::ratio;

/// The version of the files.
const FORMAT: u32 = 1;
/// Number of episodes of each class that have a picture.
const PICTURES: usize = 3;
const INDEX: &str = "index.html";
pub const LIST: &str = "failures.json";

/// An episode that failed, with all that it takes to walk it again.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stored {
    /// Version of the file.
    pub guidedog_failure: u32,
    /// The number of the episode.
    pub number: usize,
    /// The arguments of `guidedog evaluate`.
    pub arguments: Vec<String>,
    /// Digests of program, model, settings and maps, and what chooses actions.
    pub digests: Map<String, Value>,
    /// What was asked, for people.
    pub task: String,
    /// What happened, for people.
    pub happened: String,
    /// Why it failed.
    pub failed: Failed,
    /// Its figures.
    pub report: Report,
    /// Whether the robot obeyed *stop* after its end.
    pub stopped: bool,
}

/// The name of an episode's file, or of its picture.
pub fn file_name(number: usize, kind: &str) -> String {
    format!("episode-{number}.{kind}")
}

/// The number in such a name.
pub fn number_of(name: &str, kind: &str) -> Option<usize> {
    name.strip_prefix("episode-")?.strip_suffix(kind)?.strip_suffix('.')?.parse().ok()
}

/// An episode of a file.
///
/// # Errors
/// Where it cannot be read, or is no such file.
pub fn load(path: &Path) -> Result<Stored, Failure> {
    let wrong = |why: &dyn std::fmt::Display| Failure::input(format!("{}: {why}", path.display()));
    regular(path)?;
    let text = std::fs::read_to_string(path).map_err(|error| wrong(&error))?;
    let none = |why: &dyn std::fmt::Display| wrong(&format!("this is no failure of an evaluation: {why}"));
    let value: Value = serde_json::from_str(&text).map_err(|error| none(&error))?;
    match value["guidedog_failure"].as_u64() {
        Some(format) if format == u64::from(FORMAT) => {}
        Some(format) => return Err(wrong(&format!("guidedog_failure is {format}, and this program reads {FORMAT}"))),
        None => return Err(none(&"it has no guidedog_failure")),
    }
    serde_json::from_str(&text).map_err(|error| none(&error))
}

/// Failures of one class.
type Key = (bool, Asked, Class, Option<Thing>);

/// Numbers by class, the greatest first; what is not the guide's failure comes last.
fn clusters(outcomes: &Outcomes) -> Vec<(Failed, Vec<usize>)> {
    let mut found: BTreeMap<Key, (Failed, Vec<usize>)> = BTreeMap::new();
    for (number, failed) in outcomes.iter().filter_map(|(number, outcome)| Some((*number, outcome.failed?))) {
        let key = (!failed.class.is_ours(), failed.asked, failed.class, failed.thing);
        found.entry(key).or_insert_with(|| (failed, Vec::new())).1.push(number);
    }
    let mut clusters: Vec<_> = found.into_values().collect();
    clusters.sort_by_key(|(failed, numbers)| (!failed.class.is_ours(), std::cmp::Reverse(numbers.len())));
    clusters
}

/// What failed, by class. `arguments` are those of `guidedog evaluate`; where they are not known, no command tells how
/// to walk an episode again.
pub fn summary(outcomes: &Outcomes, arguments: Option<&[String]>, folder: Option<&Path>) -> Value {
    let is_ours = |outcome: &Outcome| outcome.failed.is_some_and(|failed| failed.class.is_ours());
    let replay = |number: usize| match (folder, arguments) {
        (Some(folder), _) => {
            let path = folder.join(file_name(number, "json")).display().to_string();
            Some(words::command(&["--replay".to_owned(), path]))
        }
        (None, Some(given)) => Some(words::command(&[given, &["--replay".to_owned(), number.to_string()]].concat())),
        (None, None) => None,
    };
    let told = |(failed, numbers): (Failed, Vec<usize>)| {
        json!({
            "asked": failed.asked,
            "class": failed.class,
            "thing": failed.thing,
            "words": format!("{}: {}", failed.asked.words(), failed.words()),
            "explanation": failed.class.explanation(),
            "is_failure": failed.class.is_ours(),
            "count": numbers.len(),
            "share": numbers.len() as f64 / outcomes.len() as f64,
            "replay": numbers.first().and_then(|number| replay(*number)),
            "episodes": numbers,
        })
    };
    json!({
        "count": outcomes.values().filter(|outcome| is_ours(outcome)).count(),
        "share": ratio(outcomes.values().map(is_ours)),
        "clusters": clusters(outcomes).into_iter().map(told).collect::<Vec<_>>(),
    })
}

/// What fails most, in a line for people.
pub fn line(summary: &Value) -> String {
    let Some(most) = elements(summary, "/clusters").iter().find(|cluster| cluster["is_failure"] == json!(true)) else {
        return if summary["share"].is_null() { "no episode was walked" } else { "no episode failed" }.to_owned();
    };
    let (what, of, all) = (text(most, "/words"), count(most, "/count"), count(summary, "/count"));
    let share = 100.0 * number(most, "/share");
    let see = most["replay"].as_str().map_or(String::new(), |command| format!("; see one: {command}"));
    format!("fails most: {what} ({of} of {all} failures, {share:.1} % of episodes){see}")
}

/// Stores each failure, and what shows them, in place of what an earlier evaluation stored there.
///
/// # Errors
/// Where a file cannot be written, or an episode cannot be walked again.
pub fn store(evaluation: &Evaluation, args: &EvaluateArgs, folder: &Path, outcomes: &Outcomes) -> Result<(), Failure> {
    for earlier in earlier(folder) {
        std::fs::remove_file(&earlier).map_err(|error| failed(&earlier, &error))?;
    }
    let (arguments, digests) = (words::given(), evaluation.digests(args));
    let mut episode = evaluation.episode()?;
    let mut tasks = BTreeMap::new();
    for (number, outcome) in outcomes {
        let Some(why) = outcome.failed else { continue };
        episode.begin(part_seed(args.seed, *number as u64));
        let task = explain(episode.task(), &episode.site().course);
        tasks.insert(*number, task.clone());
        let stored = Stored {
            guidedog_failure: FORMAT,
            number: *number,
            arguments: arguments.clone(),
            digests: digests.clone(),
            task,
            happened: why.happened(),
            failed: why,
            report: outcome.report,
            stopped: outcome.stopped,
        };
        let text = serde_json::to_string_pretty(&stored).map_err(Failure::of_run)? + "\n";
        write(&folder.join(file_name(*number, "json")), &text)?;
    }
    let mut summary = summary(outcomes, Some(&arguments), Some(folder));
    summary["episodes"] = json!(outcomes.len());
    summary["arguments"] = json!(arguments);
    summary["digests"] = json!(digests);
    summary["outcomes_sha256"] = json!(super::log::digest(outcomes)?);
    write(&folder.join(LIST), &format!("{summary:#}\n"))?;
    let drawn = draw(evaluation, args, outcomes)?;
    write(&folder.join(INDEX), &page(&summary, outcomes, &tasks, &drawn))
}

/// The pictures of a few episodes of each class.
fn draw(evaluation: &Evaluation, args: &EvaluateArgs, outcomes: &Outcomes) -> Result<BTreeMap<usize, String>, Failure> {
    let some = clusters(outcomes).into_iter().flat_map(|(_, numbers)| numbers.into_iter().take(PICTURES));
    let mut numbers: Vec<usize> = some.collect();
    numbers.sort_unstable();
    let way = evaluation.way(args.beta_test, true);
    let walked = evaluation.run(args, way, &numbers, None)?;
    let again = |(number, outcome): &(usize, Outcome)| outcome.told() != outcomes[number].told();
    if let Some((number, _)) = walked.iter().find(|walked| again(walked)) {
        return Err(Failure::run(format!("episode {number} came out otherwise when it was walked again")));
    }
    Ok(walked.iter().map(|(number, outcome)| (*number, picture::svg(outcome, &evaluation.config.bodies))).collect())
}

/// The page that shows them. It needs nothing but itself.
fn page(
    summary: &Value,
    outcomes: &Outcomes,
    tasks: &BTreeMap<usize, String>,
    drawn: &BTreeMap<usize, String>,
) -> String {
    let given = elements(summary, "/arguments").iter().filter_map(Value::as_str).map(str::to_owned);
    let given = escaped(&words::command(&given.collect::<Vec<_>>()));
    let (failed, all) = (count(summary, "/count"), outcomes.len());
    let mut body = format!(
        "<h1>{failed} of {all} episodes failed</h1>\n<pre>{given}</pre>\n<p>Red is the robot, blue the handler, grey \
         the way that was meant; a red dot is a motion that was refused. Green is lower than the lidar's plane, orange \
         above it, cyan glass.</p>\n",
    );
    for cluster in elements(summary, "/clusters") {
        let (share, count) = (100.0 * number(cluster, "/share"), count(cluster, "/count"));
        let note = if cluster["is_failure"] == json!(true) { "" } else { " Not counted as a failure." };
        let [what, why, replay] = ["/words", "/explanation", "/replay"].map(|key| escaped(text(cluster, key)));
        let _ = writeln!(body, "<h2>{what}</h2>\n<p><b>{count} episodes, {share:.1} %.</b> {why}{note}</p>");
        let _ = writeln!(body, "<pre>{replay}</pre>\n<div class=\"cases\">");
        let numbers = elements(cluster, "/episodes").iter().filter_map(|number| Some(number.as_u64()? as usize));
        let numbers: Vec<usize> = numbers.collect();
        for number in &numbers {
            let Some(picture) = drawn.get(number) else { continue };
            let happened = outcomes.get(number).and_then(|outcome| outcome.failed).map(|failed| failed.happened());
            let [task, happened] = [tasks.get(number), happened.as_ref()].map(|text| text.map(|text| escaped(text)));
            let (task, happened) = (task.unwrap_or_default(), happened.unwrap_or_default());
            let caption = format!("{}. {task} <i>{happened}.</i>", link(*number, &format!("Episode {number}")));
            let _ = writeln!(body, "<figure>{picture}<figcaption>{caption}</figcaption></figure>");
        }
        let links: Vec<String> = numbers.iter().map(|number| link(*number, &number.to_string())).collect();
        let _ = writeln!(body, "</div>\n<p>Episodes: {}</p>", links.join(", "));
    }
    let head = format!("<meta charset=\"utf-8\"><title>Failures</title>\n<style>{STYLE}</style>");
    format!("<!DOCTYPE html>\n<html lang=\"en\"><head>{head}</head>\n<body>\n{body}</body></html>\n")
}

/// A link to an episode's file.
fn link(number: usize, text: &str) -> String {
    format!("<a href=\"{}\">{text}</a>", file_name(number, "json"))
}

const STYLE: &str = "body{font-family:sans-serif;margin:2em;max-width:90em}pre{background:#eee;padding:.5em;\
    white-space:pre-wrap}.cases{display:flex;flex-wrap:wrap;gap:1em}figure{margin:0;width:28em}\
    svg{width:100%;height:auto;border:1px solid #ccc}";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Refuses a folder that has a page, or a list, which is of no evaluation.
///
/// # Errors
/// Where it has one.
pub fn may_replace(folder: &Path) -> Result<(), Failure> {
    let is_list = |text: String| serde_json::from_str::<Value>(&text).is_ok_and(|list| list.get("clusters").is_some());
    let is_ours = std::fs::read_to_string(folder.join(LIST)).is_ok_and(is_list);
    let others = [INDEX, LIST].into_iter().find(|name| !is_ours && folder.join(name).exists());
    others.map_or(Ok(()), |name| {
        let path = folder.join(name);
        Err(Failure::input(format!("{}: it is there already, and of no evaluation", path.display())))
    })
}

/// The files of an earlier evaluation.
fn earlier(folder: &Path) -> Vec<PathBuf> {
    let is_ours = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name == INDEX || name == LIST || number_of(name, "json").is_some()
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(is_ours).collect()
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|error| failed(path, &error))
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::run(format!("{}: {error}", path.display()))
}
