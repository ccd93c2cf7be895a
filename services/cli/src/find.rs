//! Finding a run, and asking its supervisor.

use std::io;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use control::{ANSWER_WITHIN, AskError, Client, Done, Query, Refusal, Request};
use serde_json::Value;
use transport::{RunDir, TransportError, live_runs, runs_root};

use crate::exit::Failure;

/// Asks the supervisor of a run, which is the only live one where none is named: its answer, as it comes.
///
/// # Errors
/// Where there is no such run, it does not answer, or it refuses.
pub fn ask(run: Option<&str>, request: &Request) -> Result<Value, Failure> {
    with_client(run, request, |client| client.ask(request))
}

/// Reads something of a run.
///
/// # Errors
/// As [`ask`], and where this program cannot read the answer.
pub fn read<T: Query>(run: Option<&str>) -> Result<T, Failure> {
    with_client(run, &T::REQUEST, Client::read)
}

/// Has a run do something.
///
/// # Errors
/// As [`read`].
pub fn tell(run: Option<&str>, request: &Request) -> Result<Done, Failure> {
    with_client(run, request, |client| client.tell(request))
}

fn with_client<T>(
    run: Option<&str>,
    request: &Request,
    ask: impl Fn(&mut Client) -> Result<T, AskError>,
) -> Result<T, Failure> {
    transport::check_runs_root().map_err(Failure::of_input)?;
    // A run that is named need not be looked at beyond its socket; the others can be told apart only by their locks.
    let live: Vec<String> = live_runs().into_iter().filter(|name| run == Some(name) || socket(name).exists()).collect();
    let name = choose(&live, run)?;
    let since = Instant::now();
    loop {
        let mut client = Client::connect(&socket(&name)).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => Failure::no_run(format!("run {name} has only just begun, or is at its end")),
            _ => unanswered(&name, &error),
        })?;
        match ask(&mut client) {
            Ok(answer) => return Ok(answer),
            // Other clients came before it was heard: nothing was done yet.
            Err(AskError::Refused(Refusal::CrowdedOut)) if since.elapsed() < ANSWER_WITHIN => {}
            // A stop may be asked for twice.
            Err(AskError::Refused(Refusal::AnswerLost))
                if *request == Request::Stop && since.elapsed() < ANSWER_WITHIN => {}
            Err(AskError::Refused(refusal)) => return Err(refused(&name, &refusal)),
            Err(AskError::Unanswered(error)) => return Err(unanswered(&name, &error)),
            Err(error @ AskError::Unreadable { .. }) => return Err(Failure::run(format!("run {name}: {error}"))),
        }
    }
}

fn refused(name: &str, refusal: &Refusal) -> Failure {
    let told = format!("run {name}: {refusal}");
    if *refusal == Refusal::NotPermitted { Failure::not_permitted(told) } else { Failure::refused(told) }
}

fn unanswered(name: &str, error: &io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => {
            let pid = RunDir::open(&runs_root().join(name)).read_info().map_or(0, |info| info.supervisor_pid);
            let limit_s = ANSWER_WITHIN.as_secs();
            Failure::run(format!("run {name}: its supervisor (process {pid}) has not answered for {limit_s} s"))
        }
        _ => Failure::run(format!("run {name}: its supervisor does not answer: {error}")),
    }
}

/// Where the supervisor of a run listens.
pub fn socket(name: &str) -> PathBuf {
    RunDir::open(&runs_root().join(name)).control_socket()
}

/// The run that is meant.
fn choose(live: &[String], named: Option<&str>) -> Result<String, Failure> {
    let list = || if live.is_empty() { "none is".to_owned() } else { format!("these are: {}", live.join(", ")) };
    match (named, live) {
        (Some(name), _) if live.iter().any(|run| run == name) => Ok(name.to_owned()),
        (Some(name), _) => Err(Failure::no_run(format!("no run {name} is alive; {}", list()))),
        (None, [only]) => Ok(only.clone()),
        (None, []) => Err(Failure::no_run("no run is alive; start one with `guidedog walk` or `guidedog up`")),
        (None, _) => Err(Failure::no_run(format!("several runs are alive: {}; name one with --run", live.join(", ")))),
    }
}

/// The run directory that this process has taken for the run that it is about to start.
static TAKEN: Mutex<Option<RunDir>> = Mutex::new(None);

/// A name that no live run has, `base`, else `base-2` and so on, taken at once: two commands that start together get
/// two names. Where none can be taken, `base`; starting it says why.
pub fn free_name(base: &str) -> String {
    transport::sweep();
    for name in std::iter::once(base.to_owned()).chain((2..1000).map(|n| format!("{base}-{n}"))) {
        match RunDir::create(&name) {
            Ok(dir) => {
                *TAKEN.lock().unwrap_or_else(PoisonError::into_inner) = Some(dir);
                return name;
            }
            Err(TransportError::NameTaken { .. }) => {}
            Err(_) => break,
        }
    }
    base.to_owned()
}

/// The directory of a new run of that name: the one taken before, or taken now.
///
/// # Errors
/// Where a run of that name is alive; where none can be made there, the place where runs live is at fault.
pub fn take_name(name: &str) -> Result<RunDir, Failure> {
    let taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some(dir) = taken.filter(|dir| dir.path().ends_with(name)) {
        return Ok(dir);
    }
    transport::sweep();
    RunDir::create(name).map_err(|error| match error {
        TransportError::NameTaken { .. } => {
            Failure::run(format!("a run {name} is alive already; give this one another --name"))
        }
        error => Failure::of_input(error),
    })
}

/// Removes the directory that was taken for a run that cannot be started after all.
pub fn let_name_go() {
    if let Some(dir) = TAKEN.lock().unwrap_or_else(PoisonError::into_inner).take() {
        dir.remove();
    }
}

#[cfg(test)]
mod tests {
    use super::choose;
    use crate::exit::EXIT_NO_RUN;

    fn live(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn the_only_live_run_is_meant_where_none_is_named() {
        assert_eq!(choose(&live(&["a"]), None), Ok("a".to_owned()));
        assert_eq!(choose(&live(&["a", "b"]), Some("b")), Ok("b".to_owned()));
    }

    #[test]
    fn the_message_says_which_runs_are_alive() {
        for (names, named, what) in [
            (&[][..], None, "no run is alive"),
            (&["a", "b"][..], None, "several runs are alive: a, b"),
            (&["a", "b"][..], Some("c"), "no run c is alive; these are: a, b"),
            (&[][..], Some("c"), "no run c is alive; none is"),
        ] {
            let error = choose(&live(names), named).expect_err("nothing can be chosen");
            assert_eq!(error.code, EXIT_NO_RUN);
            assert!(error.message.contains(what), "{}", error.message);
        }
    }
}
