//! `up`, `walk`: runs from their start to their report.

use serde_json::{Value, json};
use world::Route;

use crate::args::{WalkArgs, WorldArgs};
use crate::exit::{EXIT_NOT_REACHED, EXIT_OK, Failure};
use crate::find::free_name;
use crate::launch::{Launch, Outcome};
use crate::live::Live;
use crate::map_view::MapView;
use crate::out::{self, count, number, say, text};
use crate::{prepare, summary};

/// `guidedog up`: becomes the supervisor; returns only where it cannot.
pub fn up(args: &WorldArgs, as_json: bool) -> Failure {
    let settings = match prepare::up(args) {
        Ok(settings) => settings,
        Err(failure) => return failure,
    };
    let name = args.pace.name.clone().unwrap_or_else(|| free_name("run"));
    say(format!("run {name} starts as process {}; `guidedog status --run {name}`, Ctrl-C ends it", std::process::id()));
    Launch { settings: &settings, name, speed: args.pace.speed }.exec(as_json)
}

/// `guidedog walk`: the exit code.
///
/// # Errors
/// Where the walk cannot be started, or failed.
pub fn walk(args: &WalkArgs, as_json: bool) -> Result<u8, Failure> {
    let prepared = prepare::walk(args)?;
    let pace = &args.world.pace;
    let name = pace.name.clone().unwrap_or_else(|| free_name("walk"));
    let running = Launch { settings: &prepared.settings, name, speed: pace.speed }.spawn()?;
    let map = MapView::new(&prepared.world, &prepared.scenario);
    let mut live = (!as_json).then(|| Live::new(running.name(), Some(map)));
    let mut outcome = running.wait(|| live.iter_mut().for_each(Live::tick))?;
    outcome.report["has_goal"] = json!(prepared.scenario.route.goal.is_some());
    let limit = prepared.settings.walk.time_limit.map(|limit| limit.s()).or(prepared.scenario.route.time_limit_s);
    let ending = walk_ending(&outcome, &prepared.scenario.route, limit);
    finish(&outcome.report, as_json, || summary::walk(&outcome.report, &ending))?;
    Ok(if ending.well { EXIT_OK } else { EXIT_NOT_REACHED })
}

/// How a run ended, in words, and whether that is well.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunEnding {
    /// One line.
    pub words: String,
    /// Whether the exit code is 0.
    pub well: bool,
}

fn walk_ending(outcome: &Outcome, route: &Route, limit_s: Option<f64>) -> RunEnding {
    let report = &outcome.report;
    let ending = |words: &str, well: bool| RunEnding { words: words.to_owned(), well };
    if report["reached"].as_bool() == Some(true) {
        return ending("reached the goal", true);
    }
    if outcome.interrupted {
        return ending("ended by a signal", false);
    }
    // The last step may be the one before the limit.
    let lasted = limit_s.is_some_and(|limit_s| number(report, "/duration_s") + 0.05 >= limit_s);
    let how = if lasted { "at its time limit" } else { "before its time limit" };
    if route.goal.is_some() {
        return ending(&format!("did not reach the goal; ended {how}"), false);
    }
    let collisions = count(report, "/collisions/robot") + count(report, "/collisions/handler");
    ending(&format!("no goal; ended {how}"), lasted && collisions == 0)
}

/// Tells the report; a run that failed is an error even so, which the JSON object tells already.
pub fn finish(report: &Value, as_json: bool, summary: impl FnOnce() -> Vec<String>) -> Result<(), Failure> {
    let failure = text(report, "/failure");
    if as_json {
        let mut report = report.clone();
        if !failure.is_empty() {
            report["error"] = json!(failure);
        }
        out::json(&report)?;
    } else {
        summary().iter().for_each(say);
    }
    if failure.is_empty() { Ok(()) } else { Err(Failure { told: as_json, ..Failure::run(failure) }) }
}

#[cfg(test)]
mod tests {
    use super::walk_ending;
    use crate::launch::Outcome;
    use guidance::se2::Point;
    use serde_json::{Value, json};
    use world::{Goal, Route};

    fn outcome(report: Value) -> Outcome {
        Outcome { report, interrupted: false }
    }

    fn route(goal: bool) -> Route {
        let goal = goal.then(|| Goal { at: Point::new(1.0, 0.0), within_m: 1.0 });
        Route { cues: Vec::new(), goal, time_limit_s: None }
    }

    #[test]
    fn a_walk_with_a_goal_is_well_when_it_reached_it() {
        let reached = outcome(json!({ "reached": true, "duration_s": 60.0 }));
        assert!(walk_ending(&reached, &route(true), Some(240.0)).well);
        let late = outcome(json!({ "reached": false, "duration_s": 240.0 }));
        let ending = walk_ending(&late, &route(true), Some(240.0));
        assert_eq!((ending.words.as_str(), ending.well), ("did not reach the goal; ended at its time limit", false));
    }

    #[test]
    fn a_walk_without_a_goal_is_well_when_it_lasts_without_a_collision() {
        let report = |duration_s: f64, robot: u32| {
            outcome(
                json!({ "reached": false, "duration_s": duration_s, "collisions": { "robot": robot, "handler": 0 } }),
            )
        };
        assert!(walk_ending(&report(120.0, 0), &route(false), Some(120.0)).well);
        assert!(!walk_ending(&report(120.0, 1), &route(false), Some(120.0)).well);
        assert!(!walk_ending(&report(20.0, 0), &route(false), Some(120.0)).well);
    }
}
