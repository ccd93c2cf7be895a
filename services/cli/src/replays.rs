//! `replay`: recorded frames through policy, shield and locomotion.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use messages::s_from_ns;
use serde_json::{Value, json};
use settings::Settings;

use crate::args::ReplayArgs;
use crate::exit::{EXIT_DIFFERENT, EXIT_NOT_REACHED, EXIT_OK, Failure};
use crate::find::free_name;
use crate::launch::{Launch, Outcome};
use crate::live::Live;
use crate::prepare_replay::{self, PreparedReplay};
use crate::runs::{RunEnding, finish};
use crate::summary;

/// The last scans of a recording may lie this much before its end, and a run ends in steps of 10 ms, seconds.
const END_SLACK_S: f64 = 2.0;
/// Differences that are told; the report counts all.
const MAX_TOLD: usize = 1000;

/// `guidedog replay`: the exit code.
///
/// # Errors
/// Where the replay cannot be started, or failed.
pub fn replay(args: &ReplayArgs, as_json: bool) -> Result<u8, Failure> {
    let mut prepared = prepare_replay::replay(args)?;
    let folder = args.against.then(tempfile::tempdir).transpose().map_err(Failure::of_run)?;
    let differences = folder.as_ref().map(|folder| folder.path().join("differences.jsonl"));
    prepared.settings.replay.differences = differences.clone().map(Into::into);
    // Whether decisions differ is a question of stepped time only: nothing else is the same twice.
    let speed = args.pace.speed.or(args.against.then_some(0.0));
    let name = args.pace.name.clone().unwrap_or_else(|| free_name("replay"));
    let running = Launch { settings: &prepared.settings, name, speed }.spawn()?;
    let mut live = (!as_json).then(|| Live::new(running.name(), None));
    let outcome = running.wait(|| live.iter_mut().for_each(Live::tick))?;
    let report = &outcome.report;
    let ending = ending(&outcome, &prepared);
    // What is known before the run: a replay that died told nothing.
    let anomalies = report.replayed().map_or(&prepared.info.about.anomalies, |replayed| &replayed.input_anomalies);
    let mut added = json!({ "input_anomalies": anomalies, "experiment": prepared.experiment });
    if let Some(differences) = differences.filter(|_| report.failure.is_none()) {
        let differences = read_differences(&differences, &prepared.settings)?;
        added["differences"] = json!(differences);
        finish(report, added, as_json, || summary::against(report, &differences))?;
        let differ = report.compared().map(|compared| compared.decided_differently > 0);
        return Ok(match (differ, ending.well) {
            (Some(true), _) => EXIT_DIFFERENT,
            (Some(false), true) => EXIT_OK,
            // What was not compared may differ.
            (None, _) | (_, false) => EXIT_NOT_REACHED,
        });
    }
    finish(report, added, as_json, || summary::replay(report, anomalies, &ending))?;
    Ok(if ending.well { EXIT_OK } else { EXIT_NOT_REACHED })
}

/// How long the replay should last, seconds; none: until it is ended, or as long as the simulated world goes on.
fn expected_s(prepared: &PreparedReplay) -> Option<f64> {
    let replay = &prepared.settings.replay;
    if replay.times == 0 || prepared.settings.has_world() {
        return None;
    }
    let whole_s = s_from_ns(prepared.info.duration_ns);
    let (from_s, to_s) =
        (replay.from.map_or(0.0, |from| from.s()), replay.to.map_or(whole_s, |to| to.s().min(whole_s)));
    Some((to_s - from_s) * f64::from(replay.times))
}

fn ending(outcome: &Outcome, prepared: &PreparedReplay) -> RunEnding {
    ending_of(outcome, expected_s(prepared))
}

fn ending_of(outcome: &Outcome, expected_s: Option<f64>) -> RunEnding {
    let lasted_s = outcome.report.duration_s;
    let Some(expected_s) = expected_s else {
        return RunEnding { words: format!("ended after {lasted_s:.1} s"), well: true };
    };
    if outcome.interrupted {
        return RunEnding {
            words: format!("ended by a signal after {lasted_s:.1} s of {expected_s:.1} s"),
            well: false,
        };
    }
    if lasted_s + END_SLACK_S < expected_s {
        return RunEnding { words: format!("ended after {lasted_s:.1} s of {expected_s:.1} s"), well: false };
    }
    RunEnding { words: "came to its end".to_owned(), well: true }
}

/// What the replay noted down, its actions by name.
fn read_differences(path: &Path, settings: &Settings) -> Result<Vec<Value>, Failure> {
    let told = |error: std::io::Error| Failure::run(format!("{}: {error}", path.display()));
    let table = settings.policy.actions.table();
    let mut differences = Vec::new();
    for line in BufReader::new(File::open(path).map_err(told)?).lines().take(MAX_TOLD) {
        let mut difference: Value = serde_json::from_str(&line.map_err(told)?).map_err(Failure::of_run)?;
        for side in ["recorded", "replayed"] {
            let action =
                difference[side]["action"].as_u64().and_then(|i| table.actions().get(usize::try_from(i).ok()?));
            difference[side]["action"] = json!(action.map(|action| action.name.to_string()));
        }
        differences.push(difference);
    }
    Ok(differences)
}

#[cfg(test)]
mod tests {
    use super::ending_of;
    use crate::launch::Outcome;
    use control::Report;

    #[test]
    fn a_replay_is_well_when_it_came_to_its_end() {
        let outcome =
            |duration_s, interrupted| Outcome { report: Report { duration_s, ..Report::default() }, interrupted };
        assert!(ending_of(&outcome(60.0, false), Some(60.5)).well);
        assert!(!ending_of(&outcome(20.0, false), Some(60.0)).well);
        assert!(!ending_of(&outcome(99.0, true), Some(60.0)).well);
    }
}
