//! `guidedog evaluate --replay`: episodes are walked again, and held against what is stored of them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use episodes::{Failure as Failed, explain, part_seed};
use serde_json::{Map, Value, json};

use super::failures::{LIST, Stored, file_name, load, number_of};
use super::outcome::Outcome;
use super::{Evaluation, check, may_write, picture, settings_of, words};
use crate::args::evaluate::EvaluateArgs;
use crate::exit::{EXIT_DIFFERENT, Failure};
use crate::out::{self, elements, text};

/// An episode to walk again.
struct Again {
    /// The file that it is from; none: it was named by its number.
    stored: Option<(PathBuf, Stored)>,
    number: usize,
}

/// What came of one.
const VERDICTS: [&str; 4] = ["same", "fixed", "fails otherwise", "other class"];

/// Walks them again, and tells what changed.
///
/// # Errors
/// Where a file is no such failure, its episode cannot be walked, or an equal program walks it otherwise.
pub fn replay(args: &EvaluateArgs, as_json: bool) -> Result<(), Failure> {
    args.pictures.as_ref().map_or(Ok(()), |folder| may_write(folder))?;
    let mut by_words: BTreeMap<Vec<String>, Vec<Again>> = BTreeMap::new();
    let now = words::given();
    for again in args.replay.iter().map(|what| named(what)).collect::<Result<Vec<_>, _>>()?.into_iter().flatten() {
        let theirs = again.stored.as_ref().map_or(&[][..], |(_, stored)| &stored.arguments);
        by_words.entry(words::replaced(theirs, &now)).or_default().push(again);
    }
    let all_numbers: Vec<usize> = by_words.values().flatten().map(|again| again.number).collect();
    let twice = all_numbers.iter().enumerate().find(|(i, number)| all_numbers[..*i].contains(number));
    if let (Some(_), Some((_, number))) = (&args.pictures, twice) {
        return Err(Failure::input(format!(
            "--pictures: there are several episodes {number}; replay one folder at a time"
        )));
    }
    let mut told = Vec::new();
    for (words, all) in by_words {
        let of_file = |failure: Failure| match all.iter().find_map(|again| again.stored.as_ref()) {
            Some((path, _)) => Failure { message: format!("{}: {}", path.display(), failure.message), ..failure },
            None => failure,
        };
        let mut then = words::parsed(&words).map_err(of_file)?;
        (then.workers, then.pictures) = (args.workers, args.pictures.clone());
        told.extend(walk(&then, &words, &all).map_err(of_file)?);
    }
    let broken = told.iter().find(|told| told["verdict"] != json!("same") && told["differs"] == json!([]));
    let broken =
        broken.map(|told| format!("{}: the same program, model and maps gave another outcome", text(told, "/file")));
    tell(&told, broken.as_deref(), as_json)?;
    broken.map_or(Ok(()), |message| Err(Failure { code: EXIT_DIFFERENT, message, told: as_json }))
}

/// The episodes that a word of `--replay` names.
fn named(what: &str) -> Result<Vec<Again>, Failure> {
    if let Ok(number) = what.parse() {
        return Ok(vec![Again { stored: None, number }]);
    }
    let path = Path::new(what);
    let of = |path: PathBuf| {
        let stored = load(&path)?;
        Ok(Again { number: stored.number, stored: Some((path, stored)) })
    };
    if !path.is_dir() {
        return Ok(vec![of(path.to_owned())?]);
    }
    let entries = std::fs::read_dir(path).map_err(|error| Failure::input(format!("{what}: {error}")))?;
    let number = |path: &PathBuf| number_of(path.file_name()?.to_str()?, "json");
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|p| number(p).is_some()).collect();
    files.sort_by_key(number);
    if files.is_empty() && !path.join(LIST).is_file() {
        return Err(Failure::input(format!("{what}: there are no failures of an evaluation (episode-N.json)")));
    }
    files.into_iter().map(of).collect()
}

/// Walks episodes of the same arguments.
fn walk(args: &EvaluateArgs, words: &[String], all: &[Again]) -> Result<Vec<Value>, Failure> {
    check(args)?;
    let evaluation = Evaluation::of(args, settings_of(args)?)?;
    let mut digests = evaluation.digests(args);
    digests.insert("arguments".to_owned(), json!(words));
    let mut numbers: Vec<usize> = all.iter().map(|again| again.number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let way = evaluation.way(args.beta_test, args.pictures.is_some());
    let walked: BTreeMap<usize, Outcome> = evaluation.run(args, way, &numbers, None)?.into_iter().collect();
    for (number, outcome) in walked.iter().filter(|(_, outcome)| outcome.trace.is_some()) {
        let Some(folder) = &args.pictures else { continue };
        let path = folder.join(file_name(*number, "svg"));
        let drawn = picture::svg(outcome, &evaluation.config.bodies);
        std::fs::write(&path, drawn).map_err(|error| Failure::run(format!("{}: {error}", path.display())))?;
    }
    let mut episode = evaluation.episode()?;
    let mut told = Vec::new();
    for again in all {
        episode.begin(part_seed(args.seed, again.number as u64));
        let task = explain(episode.task(), &episode.site().course);
        told.push(compared(again, &walked[&again.number], &task, &digests));
    }
    Ok(told)
}

/// An episode of now beside that of then.
fn compared(again: &Again, outcome: &Outcome, task: &str, digests: &Map<String, Value>) -> Value {
    let words = |failed: Option<&Failed>| match failed {
        Some(failed) => format!("{}: {}", failed.asked.words(), failed.words()),
        None => "followed".to_owned(),
    };
    let mut told = json!({
        "number": again.number,
        "task": task,
        "now": words(outcome.failed.as_ref()),
        "happened": outcome.failed.map(|failed| failed.happened()),
        "failed": outcome.failed,
        "report": outcome.report,
        "stopped": outcome.stopped,
    });
    if let Some((path, stored)) = &again.stored {
        let of = |failed: &Failed| (failed.asked, failed.class, failed.thing);
        let verdict = match &outcome.failed {
            _ if outcome.told() == (stored.report, stored.stopped, Some(stored.failed)) => VERDICTS[0],
            None => VERDICTS[1],
            Some(failed) if of(failed) == of(&stored.failed) => VERDICTS[2],
            Some(_) => VERDICTS[3],
        };
        let then = |key: &str| match key {
            "arguments" => json!(stored.arguments),
            _ => stored.digests.get(key).cloned().unwrap_or_default(),
        };
        let differs: Vec<&String> =
            digests.iter().filter(|(key, now)| then(key) != **now).map(|(key, _)| key).collect();
        told["file"] = json!(path.display().to_string());
        told["was"] = json!(words(Some(&stored.failed)));
        told["verdict"] = json!(verdict);
        told["differs"] = json!(differs);
    }
    told
}

fn tell(told: &[Value], error: Option<&str>, as_json: bool) -> Result<(), Failure> {
    let counts: BTreeMap<&str, usize> =
        VERDICTS.map(|verdict| (verdict, told.iter().filter(|told| told["verdict"] == json!(verdict)).count())).into();
    if as_json {
        let mut report = json!({ "replays": told, "verdicts": counts });
        if let Some(error) = error {
            report["error"] = json!(error);
        }
        return out::json(&report);
    }
    let row = |told: &Value| {
        let verdict = told["verdict"].as_str().unwrap_or("-");
        vec![
            told["number"].to_string(),
            text(told, "/was").to_owned(),
            text(told, "/now").to_owned(),
            verdict.to_owned(),
        ]
    };
    let rows: Vec<Vec<String>> = told.iter().map(row).collect();
    for line in out::table(&["episode", "was", "now", ""], &rows) {
        out::raw(&line)?;
    }
    if let [one] = told {
        out::raw(text(one, "/task"))?;
        one["happened"].as_str().map_or(Ok(()), out::raw)?;
    }
    if told.iter().any(|told| told["verdict"].is_string()) {
        let of = |i: usize| format!("{} {}", counts[VERDICTS[i]], VERDICTS[i]);
        out::raw(&[0, 1, 2, 3].map(of).join(", "))?;
    }
    let mut differs: Vec<&str> =
        told.iter().flat_map(|told| elements(told, "/differs")).filter_map(Value::as_str).collect();
    differs.sort_unstable();
    differs.dedup();
    if differs.is_empty() { Ok(()) } else { out::raw(&format!("not as it was then: {}", differs.join(", "))) }
}
