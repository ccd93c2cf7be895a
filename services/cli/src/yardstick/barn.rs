//! `guidedog yardstick barn`.

use serde_json::{Value, json};
use yardsticks::Passage;
use yardsticks::barn::{Score, Task, worlds};

use super::{How, Outcome, check, conclude, write};
use crate::args::yardstick::BarnArgs;
use crate::evaluate::word;
use crate::exit::Failure;
use crate::out::{self, table};
use crate::statistics::{line, mean, ratio};

/// See [`super::yardstick`].
pub fn barn(args: &BarnArgs, as_json: bool) -> Result<(), Failure> {
    let files = worlds(&args.worlds).map_err(Failure::of_input)?;
    let tasks = files.iter().map(|file| Task::load(file)).collect::<Result<Vec<_>, _>>().map_err(Failure::of_input)?;
    let how = How::of(&args.how)?;
    check(&args.how)?;
    let passages: Vec<Passage> = tasks.iter().map(Task::passage).collect();
    let repeats = args.how.repeats as usize;
    let walked: Vec<&Passage> = passages.iter().flat_map(|passage| std::iter::repeat_n(passage, repeats)).collect();
    let outcomes = how.run(&args.how, &walked, |number, trace| {
        let task = &tasks[number / repeats];
        let score = task.score(trace);
        let words =
            format!("world {}, {}, {:.1} s, score {:.3}", task.number, ending(&score), score.actual_s, score.score);
        let picture = args.how.pictures.is_some().then(|| how.picture(walked[number], trace, &words));
        Outcome { figures: figures(task, number % repeats, &score), picture }
    })?;
    let written = write(&args.how, &outcomes, |figures| format!("world-{}-{}", figures["world"], figures["repeat"]));
    let all: Vec<&Value> = outcomes.iter().map(|outcome| &outcome.figures).collect();
    let is = |key: &'static str| ratio(all.iter().map(move |walk| walk[key] == json!(true)));
    let number = |walk: &Value, key: &str| walk[key].as_f64().unwrap_or(0.0);
    let report = json!({
        "yardstick": "barn",
        "body": word(&args.how.body),
        "noise": word(&args.how.noise),
        "seed": args.how.seed,
        "score": mean(all.iter().map(|walk| number(walk, "score"))),
        "success": is("success"),
        "collision": is("collision"),
        "timeout": is("timeout"),
        "time_s": mean(all.iter().filter(|walk| walk["success"] == json!(true)).map(|walk| number(walk, "time_s"))),
        "walks": all,
    });
    conclude(report, written, as_json, lines)
}

fn ending(score: &Score) -> &'static str {
    match (score.success, score.collided) {
        (true, _) => "success",
        (_, true) => "collision",
        _ => "timeout",
    }
}

fn figures(task: &Task, repeat: usize, score: &Score) -> Value {
    json!({
        "world": task.number,
        "repeat": repeat,
        "success": score.success,
        "collision": score.collided,
        "timeout": score.timed_out,
        "time_s": score.actual_s,
        "optimal_s": score.optimal_s,
        "score": score.score,
    })
}

/// The report as lines for people.
fn lines(report: &Value) -> Vec<String> {
    let rows: Vec<Vec<String>> = out::elements(report, "/walks").iter().map(row).collect();
    let mut lines = table(&["world", "ended", "time, s", "optimal, s", "score"], &rows);
    let summaries = [
        ("score", "/score", 4),
        ("success", "/success", 3),
        ("collision", "/collision", 3),
        ("timeout", "/timeout", 3),
        ("time, s", "/time_s", 2),
    ];
    lines.extend(summaries.into_iter().filter_map(|(name, at, digits)| {
        let of = report.pointer(at).filter(|value| value.is_object())?;
        Some(line(name, of, [16, 8], digits))
    }));
    lines
}

fn row(walk: &Value) -> Vec<String> {
    let ended = ["success", "collision", "timeout"].into_iter().find(|key| walk[*key] == json!(true));
    let number = |key: &str, digits: usize| format!("{:.digits$}", walk[key].as_f64().unwrap_or(0.0));
    vec![
        walk["world"].to_string(),
        ended.unwrap_or_default().to_owned(),
        number("time_s", 2),
        number("optimal_s", 2),
        number("score", 4),
    ]
}
