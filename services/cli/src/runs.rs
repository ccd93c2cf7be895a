//! `up`, `walk`: runs from their start to their report.

use clap::ValueEnum;
use control::{Collisions, Falls, Report};
use serde_json::{Value, json};
use world::Route;

use crate::args::{UpArgs, WalkArgs};
use crate::exit::{EXIT_NOT_REACHED, EXIT_OK, Failure};
use crate::find::free_name;
use crate::launch::{Launch, Outcome};
use crate::live::Live;
use crate::map_view::MapView;
use crate::out::{self, say};
use crate::{legs, prepare, summary};

/// `guidedog up`: becomes the supervisor; returns only where it cannot.
pub fn up(UpArgs { world: args, log, log_level }: &UpArgs, as_json: bool) -> Failure {
    let settings = match prepare::up(args) {
        Ok(settings) => settings,
        Err(failure) => return failure,
    };
    let name = args.pace.name.clone().unwrap_or_else(|| free_name("run"));
    settings::no_start_by_voice(&settings).iter().for_each(say);
    say(format!("run {name} starts as process {}; `guidedog status --run {name}`, Ctrl-C ends it", std::process::id()));
    Launch { settings: &settings, name, speed: args.pace.speed }.exec(as_json, [value_name(log), value_name(log_level)])
}

/// The name of a value as the command line has it.
fn value_name(value: &impl ValueEnum) -> String {
    value.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
}

/// `guidedog walk`: the exit code.
///
/// # Errors
/// Where the walk cannot be started, or failed.
pub fn walk(args: &WalkArgs, as_json: bool) -> Result<u8, Failure> {
    let prepared = prepare::walk(args)?;
    let pace = &args.world.pace;
    let name = pace.name.clone().unwrap_or_else(|| free_name("walk"));
    settings::no_start_by_voice(&prepared.settings).iter().for_each(say);
    let running = Launch { settings: &prepared.settings, name, speed: pace.speed }.spawn()?;
    let map = MapView::new(&prepared.world, &prepared.scenario);
    let mut live = (!as_json).then(|| Live::new(running.name(), Some(map)));
    let outcome = running.wait(|| live.iter_mut().for_each(Live::tick))?;
    let limit = prepared.settings.walk.time_limit.map(|limit| limit.s()).or(prepared.scenario.route.time_limit_s);
    let ending = walk_ending(&outcome, &prepared.scenario.route, limit);
    let legs = legs::about(&prepared.settings);
    let added = json!({ "has_goal": prepared.scenario.route.goal.is_some(), "legs": legs });
    let summary = || [summary::walk(&outcome.report, &ending), legs::lines(&legs)].concat();
    finish(&outcome.report, added, as_json, summary)?;
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
    let Falls { robot, handler } = report.falls();
    if robot + handler > 0 {
        return ending(if robot > 0 { "the robot fell" } else { "the handler fell" }, false);
    }
    if report.reached() {
        return ending("reached the goal", true);
    }
    if outcome.interrupted {
        return ending("ended by a signal", false);
    }
    // The last step may be the one before the limit.
    let lasted = limit_s.is_some_and(|limit_s| report.duration_s + 0.05 >= limit_s);
    let how = if lasted { "at its time limit" } else { "before its time limit" };
    if route.goal.is_some() {
        return ending(&format!("did not reach the goal; ended {how}"), false);
    }
    let Collisions { robot, handler, .. } = report.collisions();
    ending(&format!("no goal; ended {how}"), lasted && robot + handler == 0)
}

/// Tells the report, as JSON with the members of the object `added`; a run that failed is an error even so, which the
/// JSON object tells already.
pub fn finish(
    report: &Report,
    added: Value,
    as_json: bool,
    summary: impl FnOnce() -> Vec<String>,
) -> Result<(), Failure> {
    if as_json {
        let mut told = json!(report);
        if let (Value::Object(told), Value::Object(added)) = (&mut told, added) {
            told.extend(added);
        }
        if let Some(why) = &report.failure {
            told["error"] = json!(why);
        }
        out::json(&told)?;
    } else {
        out::report(summary())?;
    }
    report.failure.as_ref().map_or(Ok(()), |why| Err(Failure { told: as_json, ..Failure::run(why) }))
}

#[cfg(test)]
mod tests {
    use super::walk_ending;
    use crate::launch::Outcome;
    use control::{Collisions, Report, RunFigures};
    use guidance::se2::Point;
    use world::{Goal, Route};

    fn outcome(duration_s: f64, reached: bool, robot: u32) -> Outcome {
        let collisions = Collisions { robot, ..Collisions::default() };
        let world = Some(RunFigures { reached, collisions, ..RunFigures::default() });
        Outcome { report: Report { duration_s, world, ..Report::default() }, interrupted: false }
    }

    fn route(goal: bool) -> Route {
        let goal = goal.then(|| Goal { at: Point::new(1.0, 0.0), within_m: 1.0 });
        Route { cues: Vec::new(), goal, time_limit_s: None }
    }

    #[test]
    fn a_walk_with_a_goal_is_well_when_it_reached_it() {
        assert!(walk_ending(&outcome(60.0, true, 0), &route(true), Some(240.0)).well);
        let ending = walk_ending(&outcome(240.0, false, 0), &route(true), Some(240.0));
        assert_eq!((ending.words.as_str(), ending.well), ("did not reach the goal; ended at its time limit", false));
    }

    #[test]
    fn a_walk_without_a_goal_is_well_when_it_lasts_without_a_collision() {
        let is_well = |duration_s: f64, robot: u32| {
            walk_ending(&outcome(duration_s, false, robot), &route(false), Some(120.0)).well
        };
        assert!(is_well(120.0, 0));
        assert!(!is_well(120.0, 1));
        assert!(!is_well(20.0, 0));
    }
}
