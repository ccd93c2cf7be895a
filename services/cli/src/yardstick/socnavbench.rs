//! `guidedog yardstick socnavbench`.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};
use world::Tracks;
use yardsticks::Passage;
use yardsticks::socnavbench::{Dataset, Episode, datasets, episodes, metrics, tracks, tracks_file};

use super::{How, Outcome, check, conclude, write};
use crate::args::yardstick::SocnavbenchArgs;
use crate::evaluate::word;
use crate::exit::Failure;
use crate::out::{self, table};
use crate::statistics::{line, mean, ratio};

/// The file of datasets beside the episodes.
const DATASETS: &str = "dataset_params.ini";

/// See [`super::yardstick`].
pub fn socnavbench(args: &SocnavbenchArgs, as_json: bool) -> Result<(), Failure> {
    let (walked, left_out) = passages(args)?;
    let how = How::of(&args.how)?;
    check(&args.how)?;
    let repeats = args.how.repeats as usize;
    let all: Vec<&Passage> = walked.iter().flat_map(|(_, passage)| std::iter::repeat_n(passage, repeats)).collect();
    let radius_m = how.config.base.bodies.robot_radius_m;
    let outcomes = how.run(&args.how, &all, |number, trace| {
        let (episode, passage) = &walked[number / repeats];
        let metrics = metrics::of(passage, trace, radius_m);
        let cause = metrics.termination_cause;
        let words = format!("{}, {cause}, {:.1} s", episode.name, metrics.total_sim_time_taken);
        let picture = args.how.pictures.is_some().then(|| how.picture(passage, trace, &words));
        let mut figures = json!(metrics);
        figures["episode"] = json!(episode.name);
        figures["map"] = json!(episode.map);
        figures["repeat"] = json!(number % repeats);
        figures["pedestrians"] = json!(passage.crowd.people.len());
        Outcome { figures, picture }
    })?;
    let name = |figures: &Value| format!("{}-{}", out::text(figures, "/episode"), figures["repeat"]);
    let written = write(&args.how, &outcomes, name);
    conclude(report(args, &outcomes, &left_out), written, as_json, lines)
}

/// The episodes that can be walked, and of the others why not.
type Passages = (Vec<(Episode, Passage)>, Vec<Value>);

fn passages(args: &SocnavbenchArgs) -> Result<Passages, Failure> {
    let all = episodes(&args.episodes).map_err(Failure::of_input)?;
    if let Some(name) = args.only.iter().find(|name| !all.iter().any(|episode| episode.name == **name)) {
        return Err(Failure::input(format!("{}: no episode {name}", args.episodes.display())));
    }
    let folder = args.episodes.parent().unwrap_or(Path::new(""));
    let datasets_path = args.datasets.clone().unwrap_or_else(|| folder.join(DATASETS));
    let datasets = datasets(&datasets_path).map_err(Failure::of_input)?;
    let tracks = all_tracks(&datasets, args.tracks.as_deref().unwrap_or(folder))?;
    let (mut walked, mut left_out) = (Vec::new(), Vec::new());
    for episode in all.into_iter().filter(|episode| args.only.is_empty() || args.only.contains(&episode.name)) {
        let passage = match episode.simulated {
            0 => episode.passage(&datasets, &tracks),
            count => Err(format!("{count} people who are simulated, and not recorded")),
        };
        match passage {
            Ok(passage) => walked.push((episode, passage)),
            Err(why) => left_out.push(json!({ "episode": episode.name, "why": why })),
        }
    }
    if walked.is_empty() {
        let why = left_out.first().map_or("", |first| out::text(first, "/why"));
        return Err(Failure::input(format!("{}: no episode can be walked: {why}", args.episodes.display())));
    }
    Ok((walked, left_out))
}

/// The tracks of all datasets whose files are in the folder.
fn all_tracks(datasets: &BTreeMap<String, Dataset>, folder: &Path) -> Result<BTreeMap<String, Tracks>, Failure> {
    let there = datasets.iter().filter_map(|(name, dataset)| Some((name, tracks_file(folder, dataset)?)));
    there.map(|(name, file)| Ok((name.clone(), tracks(&file).map_err(Failure::of_input)?))).collect()
}

fn report(args: &SocnavbenchArgs, outcomes: &[Outcome], left_out: &[Value]) -> Value {
    let all: Vec<&Value> = outcomes.iter().map(|outcome| &outcome.figures).collect();
    let of = |at: &'static str| mean(all.iter().filter_map(|walk| walk.pointer(at)?.as_f64()));
    json!({
        "yardstick": "socnavbench",
        "body": word(&args.how.body),
        "noise": word(&args.how.noise),
        "seed": args.how.seed,
        "success": ratio(all.iter().map(|walk| walk["success"] == json!(true))),
        "without_pedestrian_collision": ratio(all.iter().map(|walk| walk["pedestrian_collisions"] == json!(0))),
        "total_sim_time_taken": of("/total_sim_time_taken"),
        "robot_speed": of("/robot_speed/0"),
        "robot_motion_energy": of("/robot_motion_energy"),
        "robot_acceleration": of("/robot_acceleration/0"),
        "robot_jerk": of("/robot_jerk/0"),
        "path_length": of("/path_length"),
        "path_length_ratio": of("/path_length_ratio"),
        "goal_traversal_ratio": of("/goal_traversal_ratio"),
        "path_irregularity": of("/path_irregularity"),
        "closest_pedestrian_distance": of("/closest_pedestrian_distance/0"),
        "time_to_collision": of("/time_to_collision/0"),
        "pedestrian_collisions": of("/pedestrian_collisions"),
        "hit_by_others": of("/hit_by_others"),
        "walks": all,
        "left_out": left_out,
    })
}

/// The report as lines for people.
fn lines(report: &Value) -> Vec<String> {
    let rows: Vec<Vec<String>> = out::elements(report, "/walks").iter().map(row).collect();
    let headings = ["episode", "ended", "time, s", "way, m", "ratio", "nearest, m", "collisions", "hit by others"];
    let mut lines = table(&headings, &rows);
    for left_out in out::elements(report, "/left_out") {
        lines.push(format!("{}: not walked: {}", out::text(left_out, "/episode"), out::text(left_out, "/why")));
    }
    let keys = report.as_object().into_iter().flatten().filter(|(_, value)| value.get("mean").is_some());
    lines.extend(keys.map(|(key, of)| line(key, of, [30, 9], 3)));
    lines
}

fn row(walk: &Value) -> Vec<String> {
    let number = |at: &str| walk.pointer(at).and_then(Value::as_f64).map_or("-".into(), |n| format!("{n:.2}"));
    vec![
        out::text(walk, "/episode").to_owned(),
        out::text(walk, "/termination_cause").to_owned(),
        number("/total_sim_time_taken"),
        number("/path_length"),
        number("/path_length_ratio"),
        number("/closest_pedestrian_distance/0"),
        walk["pedestrian_collisions"].to_string(),
        walk["hit_by_others"].to_string(),
    ]
}
