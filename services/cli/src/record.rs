//! `record`: records a live run on demand.

use std::time::{Duration, Instant};

use control::{Note, Request, ServicePhase, Status};
use messages::ServiceId;

use crate::args::{RecordArgs, RunArg};
use crate::exit::{EXIT_NO_RUN, EXIT_REFUSED, Failure};
use crate::find::{ask, read, tell};
use crate::launch::Signals;
use crate::out::{self, say};
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
/// Where the recording is there already, cannot be written or came to its end before its time, and as [`ask`].
pub fn record(args: &RecordArgs, as_json: bool) -> Result<(), Failure> {
    let Some(output) = &args.output else { return stop(&args.run, as_json) };
    let path = new_recording(output)?;
    let signals = Signals::of_this_process()?;
    let run = named(&args.run)?;
    let mut troubles = Troubles::from_now_on(&run)?;
    tell(Some(&run), &Request::Record { path: policy::named(path.clone())? })?;
    if !as_json {
        say(format!("recording {run} to {}; Ctrl-C ends the recording", path.display()));
    }
    let begun = Instant::now();
    let mut was_ready = false;
    let lasts = args.duration.map(|duration| Duration::from_nanos(duration.ns()));
    while !signals.came() && lasts.is_none_or(|lasts| begun.elapsed() < lasts) {
        std::thread::sleep(LOOK_EVERY);
        // Where the run is at its end, so is the recording.
        let Some(status) = status(&run)? else { break };
        troubles.look(&status);
        match recorder(&status) {
            // Somebody else has ended it.
            Some(ServicePhase::Off) if was_ready => break,
            Some(ServicePhase::Off | ServicePhase::Spent) => {
                return Err(Failure::run(format!("run {run}: the recorder ended: {}", troubles.last())));
            }
            state => was_ready |= state == Some(ServicePhase::Ready),
        }
    }
    end(&run, &mut troubles)?;
    if !was_ready && !path.exists() {
        return Err(Failure::run(format!("run {run}: nothing was recorded: {}", troubles.last())));
    }
    recording_files::lives(&path, as_json)
}

/// `guidedog record --stop`: ends a recording whose `record` is gone.
fn stop(run: &RunArg, as_json: bool) -> Result<(), Failure> {
    let run = named(run)?;
    let mut troubles = Troubles::from_now_on(&run)?;
    let answer = ask(Some(&run), &Request::RecordStop {})?;
    wait_for_end(&run, &mut troubles)?;
    out::tell(as_json, &answer, || vec![format!("run {run} is no longer recorded")])
}

/// Has the recorder end its files, and waits until it has; that the run has ended meanwhile is as well.
fn end(run: &str, troubles: &mut Troubles) -> Result<(), Failure> {
    match tell(Some(run), &Request::RecordStop {}) {
        // Somebody else has ended it.
        Err(failure) if !matches!(failure.code, EXIT_NO_RUN | EXIT_REFUSED) => Err(failure),
        _ => wait_for_end(run, troubles),
    }
}

fn wait_for_end(run: &str, troubles: &mut Troubles) -> Result<(), Failure> {
    let begun = Instant::now();
    while let Some(status) = status(run)? {
        troubles.look(&status);
        if recorder(&status).is_none_or(|state| state == ServicePhase::Off) || begun.elapsed() >= END_WITHIN {
            break;
        }
        std::thread::sleep(LOOK_EVERY);
    }
    Ok(())
}

/// What goes wrong with the recorder, told when it happens: a disk that is full an hour before the end is no news then.
struct Troubles {
    /// Run time from which on notes count, seconds.
    from_s: f64,
    told: Vec<Note>,
}

impl Troubles {
    fn from_now_on(run: &str) -> Result<Self, Failure> {
        Ok(Self { from_s: read::<Status>(Some(run))?.now_s, told: Vec::new() })
    }

    fn look(&mut self, status: &Status) {
        for note in status.notes.iter().filter(|note| note.at_s >= self.from_s) {
            if note.text.starts_with(ServiceId::Recorder.name()) && !self.told.contains(note) {
                say(&note.text);
                self.told.push(note.clone());
            }
        }
    }

    fn last(&self) -> &str {
        self.told.last().map_or("no note", |note| &note.text)
    }
}

/// The name of the run that is meant, which stays the same while it is recorded.
fn named(run: &RunArg) -> Result<String, Failure> {
    Ok(read::<Status>(run.run.as_deref())?.run)
}

/// What the run says of itself; nothing where it is gone.
fn status(run: &str) -> Result<Option<Status>, Failure> {
    match read(Some(run)) {
        Err(failure) if failure.code == EXIT_NO_RUN => Ok(None),
        status => status.map(Some),
    }
}

/// How far the recorder is.
fn recorder(status: &Status) -> Option<ServicePhase> {
    status.service(ServiceId::Recorder).map(|recorder| recorder.state)
}
