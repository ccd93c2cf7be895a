//! `runs`, and what `status` and `why` say of a run that has ended.

use records::PastRun;
use serde_json::{Value, json};
use transport::find_runs;

use crate::args::RunArg;
use crate::exit::{EXIT_NO_RUN, EXIT_NOT_PERMITTED, Failure};
use crate::find;
use crate::operate::{notes, stops};
use crate::out::{self, plain, table};

/// Number of stops that are shown, the newest.
const STOPS_TOLD: usize = 20;
/// Number of notes that are shown, the newest.
const NOTES_TOLD: usize = 10;

/// `guidedog runs`
///
/// # Errors
/// Where nothing can be written.
pub fn runs(as_json: bool) -> Result<(), Failure> {
    let found = find_runs();
    if let Some(why) = found.refused {
        return Err(Failure::input(why));
    }
    let past = records::all();
    // A run that keeps no record is found where runs live.
    let unrecorded: Vec<String> = found
        .live
        .into_iter()
        .map(|live| live.name)
        .filter(|name| !past.iter().any(|run| run.is_live() && run.about.name == *name))
        .collect();
    if unrecorded.is_empty() && past.is_empty() {
        records::check().map_err(Failure::of_input)?;
        may_look()?;
    }
    if as_json {
        let live = unrecorded.iter().map(|name| json!({ "name": name, "live": true }));
        let told: Vec<Value> = live.chain(past.iter().map(|run| about(run, run.stop_count().ok()))).collect();
        return out::json(&json!({ "runs": told }));
    }
    out::report({
        let without = |name: &String| [name, "-", "-", "-", "live, without a record"].map(str::to_owned).to_vec();
        let rows: Vec<Vec<String>> = unrecorded.iter().map(without).chain(past.iter().map(row)).collect();
        if rows.is_empty() {
            vec!["no runs".to_owned()]
        } else {
            table(&["run", "started", "lasted", "stops", "state"], &rows)
        }
    })
}

fn row(run: &PastRun) -> Vec<String> {
    // A journal that cannot be read tells of no stops; `why` tells what is wrong with it.
    let stops = run.stop_count().map_or_else(|_| "-".to_owned(), |count| count.to_string());
    let state = run.ended().map_or_else(|| "live".to_owned(), |why| format!("ended: {why}"));
    vec![plain(&run.about.name), plain(&run.about.started), format!("{:.0} s", run.lasted_s()), stops, state]
}

/// Whether there is no record that this user may not read.
fn may_look() -> Result<(), Failure> {
    records::closed().first().map_or(Ok(()), |folder| Err(find::closed(folder)))
}

fn about(run: &PastRun, stops: Option<u64>) -> Value {
    json!({
        "name": run.about.name, "id": run.id, "folder": run.folder.display().to_string(), "version": run.about.version,
        "started": run.about.started, "lasted_s": run.lasted_s(), "stops": stops, "live": run.is_live(),
        "ended": run.ended(),
    })
}

/// Shows the record of the named run if no live run has that name.
///
/// # Errors
/// The failure, where no record tells of that run; with the newest run's name where none is named.
pub fn or_ended(failure: Failure, run: &RunArg, as_json: bool) -> Result<(), Failure> {
    // Where a place of runs is closed, the run may have been this user's own all the same.
    if failure.code != EXIT_NO_RUN && (failure.code != EXIT_NOT_PERMITTED || run.run.is_none()) {
        return Err(failure);
    }
    let Some(name) = &run.run else {
        let all = records::all();
        // While runs are live, the question is which of them is meant.
        let newest = all.first().filter(|_| !all.iter().any(PastRun::is_live));
        let hint = newest.map(|run| format!("; the last one has ended: `guidedog why --run {}`", run.about.name));
        return Err(Failure { message: failure.message + &hint.unwrap_or_default(), ..failure });
    };
    match records::find(name).filter(|run| !run.is_live()) {
        Some(run) => tell(&run, as_json),
        None if failure.code == EXIT_NO_RUN => may_look().and(Err(failure)),
        None => Err(failure),
    }
}

fn tell(run: &PastRun, as_json: bool) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::run(format!("{}: {error}", run.folder.display()));
    let (mut all, notes_of_run) = (run.stops().map_err(failed)?, run.notes().map_err(failed)?);
    let count = run.stop_count().map_err(failed)?;
    all.reverse();
    all.truncate(STOPS_TOLD);
    let mut report = about(run, Some(count));
    (report["stops"], report["stop_count"], report["notes"]) = (json!(all), json!(count), json!(notes_of_run));
    if let records::End::Reported(whole) = &run.end {
        report["report"] = json!(whole);
    }
    out::tell(as_json, &report, || {
        let mut lines = vec![
            format!("run      {} (record {})", run.about.name, run.id),
            format!("ended: {}", run.ended().unwrap_or_default()),
            format!("started  {}, guidedog {}", run.about.started, run.about.version),
            format!("lasted   {:.1} s", run.lasted_s()),
            format!("record   {}", run.folder.display()),
            String::new(),
        ];
        lines.extend(stops(&all));
        lines.extend(notes(&notes_of_run, NOTES_TOLD));
        lines
    })
}

/// The record that is meant: of the run that is named, else of the only live run, else of the newest.
///
/// # Errors
/// If there is no record, or several runs are live.
pub fn chosen(run: Option<&str>) -> Result<PastRun, Failure> {
    records::check().map_err(Failure::of_input)?;
    if let Some(name) = run {
        let none = || Failure::no_run(format!("no record of a run {name}; `guidedog runs` lists all runs"));
        return records::find(name).ok_or_else(|| may_look().err().unwrap_or_else(none));
    }
    let all = records::all();
    let live: Vec<&PastRun> = all.iter().filter(|run| run.is_live()).collect();
    if live.len() > 1 {
        let names: Vec<&str> = live.iter().map(|run| run.about.name.as_str()).collect();
        return Err(Failure::no_run(format!("several runs are alive: {}; name one with --run", names.join(", "))));
    }
    let only = live.first().copied().or(all.first()).cloned();
    let none = || Failure::no_run("there is no record of any run; `guidedog walk` makes one");
    only.ok_or_else(|| may_look().err().unwrap_or_else(none))
}
