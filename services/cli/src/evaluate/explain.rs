//! What the tasks of an evaluation ask for, without walking them.

use std::path::Path;

use episodes::{Goal, explain as in_words, part_seed};
use guidance::Se2;
use guidance::se2::pose2;
use serde_json::{Value, json};

use super::{Evaluation, picture, picture_name};
use crate::args::evaluate::EvaluateArgs;
use crate::exit::Failure;
use crate::out;

/// `guidedog evaluate --explain`: a line for each task, and its picture where those are wanted.
///
/// # Errors
/// Where a picture cannot be written.
pub fn explain(evaluation: &Evaluation, args: &EvaluateArgs, count: u32, as_json: bool) -> Result<(), Failure> {
    let mut episode = evaluation.episode()?;
    let mut tasks = Vec::new();
    for number in 0..count as usize {
        let seed = part_seed(args.seed, number as u64);
        episode.begin(seed);
        let (task, site) = (episode.task(), episode.site());
        let words = in_words(task, &site.course);
        let handler = episode.team().world_from_handler();
        if as_json {
            tasks.push(json!({
                "number": number,
                "place": &*site.place,
                "cue": task.cue.name(),
                "goal": goal(&task.goal),
                "world_from_robot": told(&task.world_from_robot),
                "world_from_handler": told(&handler),
                "explanation": words,
            }));
        } else {
            out::raw(&format!("{number:>4}  {}  {words}", site.place))?;
        }
        if let Some(folder) = &args.pictures {
            let drawn = picture::task(task, site, &handler, &words, &evaluation.config.bodies);
            write(&folder.join(picture_name("task", number)), &drawn)?;
        }
    }
    if as_json { out::json(&json!({ "tasks": tasks })) } else { Ok(()) }
}

fn goal(goal: &Goal) -> Value {
    match goal {
        Goal::Along(way_m) => json!({ "kind": "along", "way_m": way_m }),
        Goal::BeforeEdge => json!({ "kind": "before_edge" }),
        Goal::Into(openings) | Goal::Stand(openings) => {
            let mouths: Vec<Value> = openings
                .iter()
                .map(|opening| {
                    let mouth = opening.line.at(0.0).translation;
                    json!({ "x_m": mouth.x, "y_m": mouth.y, "width_m": opening.width_m })
                })
                .collect();
            let kind = if matches!(goal, Goal::Into(_)) { "into" } else { "stand" };
            json!({ "kind": kind, "openings": mouths })
        }
    }
}

fn told(pose: &Se2) -> Value {
    let pose = pose2(pose);
    json!({ "x_m": pose.x_m, "y_m": pose.y_m, "yaw_rad": pose.yaw_rad })
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|error| Failure::run(format!("{}: {error}", path.display())))
}
