//! `record`: records a live run on demand.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::args::{RecordArgs, RunArg};
use crate::control::ask;
use crate::exit::{EXIT_NO_RUN, Failure};
use crate::launch::Signals;
use crate::out::{elements, say, text};
use crate::policy;
use crate::prepare::new_recording;
use crate::recording_files;

/// The run is looked at this often.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// A recorder that ends its file has at most this long for it.
const END_WITHIN: Duration = Duration::from_secs(10);

/// `guidedog record`
///
/// # Errors
/// Where the recording is there already or cannot be written, and as [`ask`].
pub fn record(args: &RecordArgs, as_json: bool) -> Result<(), Failure> {
    let path = new_recording(&args.output)?;
    let signals = Signals::of_this_process()?;
    let run = named(&args.run)?;
    ask(Some(&run), &json!({ "verb": "record", "path": policy::named(&path)? }))?;
    if !as_json {
        say(format!("recording {run} to {}; Ctrl-C ends the recording", path.display()));
    }
    let begun = Instant::now();
    let mut was_ready = false;
    let lasts = args.duration.map(|duration| Duration::from_nanos(duration.ns()));
    while !signals.came() && lasts.is_none_or(|lasts| begun.elapsed() < lasts) {
        std::thread::sleep(LOOK_EVERY);
        match recorder(&run)?.as_deref() {
            // The run is at its end, and with it the recording.
            None => break,
            Some("off" | "spent") => {
                return Err(Failure::run(format!("run {run}: the recorder ended: {}", last_note(&run))));
            }
            Some(state) => was_ready |= state == "ready",
        }
    }
    let ended = Instant::now();
    match ask(Some(&run), &json!({ "verb": "record_stop" })) {
        Err(failure) if failure.code != EXIT_NO_RUN => return Err(failure),
        _ => {}
    }
    while recorder(&run)?.is_some_and(|state| state != "off") && ended.elapsed() < END_WITHIN {
        std::thread::sleep(LOOK_EVERY);
    }
    if !was_ready && !path.exists() {
        return Err(Failure::run(format!("run {run}: nothing was recorded: {}", last_note(&run))));
    }
    recording_files::info(&path, as_json)
}

/// The name of the run that is meant, which stays the same while it is recorded.
fn named(run: &RunArg) -> Result<String, Failure> {
    let status = ask(run.run.as_deref(), &json!({ "verb": "status" }))?;
    Ok(text(&status, "/run").to_owned())
}

/// How far the recorder is; nothing where the run is gone.
fn recorder(run: &str) -> Result<Option<String>, Failure> {
    let status = match ask(Some(run), &json!({ "verb": "status" })) {
        Err(failure) if failure.code == EXIT_NO_RUN => return Ok(None),
        status => status?,
    };
    let state = |service: &Value| service["name"] == "recorder";
    let recorder = elements(&status, "/services").iter().find(|service| state(service));
    Ok(recorder.map(|recorder| text(recorder, "/state").to_owned()))
}

fn last_note(run: &str) -> String {
    let status = ask(Some(run), &json!({ "verb": "status" })).unwrap_or_default();
    elements(&status, "/notes").last().map_or_else(|| "no note".to_owned(), |note| text(note, "/text").to_owned())
}
