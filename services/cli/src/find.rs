//! Finding a run, and asking its supervisor.

use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use control::{ANSWER_WITHIN, AskError, Client, Done, Query, Refusal, Request};
use serde_json::Value;
use transport::{FoundRuns, LiveRun, RunDir, TransportError, runs_root};

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
    ask_run(&choose(&find(run)?, run)?, request, ask)
}

/// What is found where runs live. A run that has no socket yet counts where it is named.
fn find(run: Option<&str>) -> Result<FoundRuns, Failure> {
    let mut found = transport::find_runs();
    found.live.retain(|live| run == Some(&live.name) || RunDir::open(&live.dir).control_socket().exists());
    match &found.refused {
        Some(why) if found.live.is_empty() => Err(Failure::input(why.clone())),
        _ => Ok(found),
    }
}

/// The runs that a verb is for.
#[derive(Debug)]
pub struct Runs {
    /// Live ones.
    pub live: Vec<LiveRun>,
    /// Directories that this user may not read, where there may be more, with the error.
    pub closed: Vec<(PathBuf, Failure)>,
}

/// The live run of this name, else every live run.
///
/// # Errors
/// Where there is no such run.
pub fn all(run: Option<&str>) -> Result<Runs, Failure> {
    let found = find(run)?;
    if run.is_some() || found.live.is_empty() {
        return choose(&found, run).map(|run| Runs { live: vec![run], closed: Vec::new() });
    }
    let FoundRuns { live, closed_places, closed_runs, refused } = found;
    let closed_dirs = closed_places.into_iter().chain(closed_runs).map(|dir| (dir.clone(), closed(&dir)));
    let refused = refused.map(|why| (runs_root(), Failure::input(why)));
    Ok(Runs { live, closed: closed_dirs.chain(refused).collect() })
}

/// Asks the supervisor of this run.
///
/// # Errors
/// As [`ask`].
pub fn ask_run<T>(
    LiveRun { name, dir }: &LiveRun,
    request: &Request,
    ask: impl Fn(&mut Client) -> Result<T, AskError>,
) -> Result<T, Failure> {
    let since = Instant::now();
    loop {
        let socket = RunDir::open(dir).control_socket();
        let mut client = Client::connect(&socket).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => Failure::no_run(format!("run {name} has only just begun, or is at its end")),
            _ => unanswered(name, dir, &error),
        })?;
        match ask(&mut client) {
            Ok(answer) => return Ok(answer),
            // Other clients came before it was heard: nothing was done yet.
            Err(AskError::Refused(Refusal::CrowdedOut)) if since.elapsed() < ANSWER_WITHIN => {}
            // A stop may be asked for twice.
            Err(AskError::Refused(Refusal::AnswerLost))
                if *request == Request::Stop && since.elapsed() < ANSWER_WITHIN => {}
            Err(AskError::Refused(refusal)) => return Err(refused(name, &refusal)),
            Err(AskError::Unanswered(error)) => return Err(unanswered(name, dir, &error)),
            Err(error @ AskError::Unreadable { .. }) => return Err(Failure::run(format!("run {name}: {error}"))),
        }
    }
}

fn refused(name: &str, refusal: &Refusal) -> Failure {
    let told = format!("run {name}: {refusal}");
    if *refusal == Refusal::NotPermitted { Failure::not_permitted(told) } else { Failure::refused(told) }
}

fn unanswered(name: &str, dir: &Path, error: &io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => {
            let pid = RunDir::open(dir).read_info().map_or(0, |info| info.supervisor_pid);
            let limit_s = ANSWER_WITHIN.as_secs();
            Failure::run(format!("run {name}: its supervisor (process {pid}) has not answered for {limit_s} s"))
        }
        io::ErrorKind::PermissionDenied => closed(dir),
        _ => Failure::run(format!("run {name}: its supervisor does not answer: {error}")),
    }
}

/// This user may not look into a directory of runs.
pub fn closed(dir: &Path) -> Failure {
    // What lies above may be closed already: that is the folder to open.
    let is_hidden =
        |dir: &&Path| std::fs::metadata(dir).is_err_and(|why| why.kind() == io::ErrorKind::PermissionDenied);
    let dir = dir.ancestors().find(|dir| !is_hidden(dir)).unwrap_or(dir);
    let whose = std::fs::metadata(dir).map_or_else(
        |_| "others".to_owned(),
        |found| {
            format!("user {} and group {}", name_of("/etc/passwd", found.uid()), name_of("/etc/group", found.gid()))
        },
    );
    let fix = "ask as that user (sudo -u), or as a member of that group";
    Failure::not_permitted(format!("{} belongs to {whose}: this user may not look into it; {fix}", dir.display()))
}

/// The name of a user or group in such a file, else its number.
fn name_of(file: &str, id: u32) -> String {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let id = id.to_string();
    let named = text.lines().find(|line| line.split(':').nth(2) == Some(&id)).and_then(|line| line.split(':').next());
    named.unwrap_or(&id).to_owned()
}

/// Where the supervisor of a run of this user listens.
pub fn socket(name: &str) -> PathBuf {
    RunDir::open(&runs_root().join(name)).control_socket()
}

/// The run that is meant.
fn choose(found: &FoundRuns, named: Option<&str>) -> Result<LiveRun, Failure> {
    let FoundRuns { live, closed_places, closed_runs, .. } = found;
    let names = || live.iter().map(|run| run.name.as_str()).collect::<Vec<_>>().join(", ");
    let list = || if live.is_empty() { "none is".to_owned() } else { format!("these are: {}", names()) };
    if let Some(name) = named {
        if let Some(run) = live.iter().find(|run| run.name == name) {
            return Ok(run.clone());
        }
        let shut = closed_runs.iter().find(|dir| dir.ends_with(name)).or(closed_places.first());
        let none = || Failure::no_run(format!("no run {name} is alive; {}", list()));
        return Err(shut.map_or_else(none, |dir| closed(dir)));
    }
    match (&live[..], closed_runs.first().or(closed_places.first())) {
        ([only], _) => Ok(only.clone()),
        ([], Some(dir)) => Err(closed(dir)),
        ([], None) => Err(Failure::no_run("no run is alive; start one with `guidedog walk` or `guidedog up`")),
        _ => Err(Failure::no_run(format!("several runs are alive: {}; name one with --run", names()))),
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
    use crate::exit::{EXIT_NO_RUN, EXIT_NOT_PERMITTED};
    use std::path::Path;
    use transport::{FoundRuns, LiveRun};

    fn live(names: &[&str]) -> FoundRuns {
        let run = |name: &&str| LiveRun { name: (*name).to_owned(), dir: Path::new("/r").join(name) };
        FoundRuns { live: names.iter().map(run).collect(), ..FoundRuns::default() }
    }

    fn chosen(found: &FoundRuns, named: Option<&str>) -> String {
        choose(found, named).expect("there is one").name
    }

    #[test]
    fn the_only_live_run_is_meant_where_none_is_named() {
        assert_eq!(chosen(&live(&["a"]), None), "a");
        assert_eq!(chosen(&live(&["a", "b"]), Some("b")), "b");
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

    #[test]
    fn what_this_user_may_not_look_into_is_told_and_hides_nothing_else() {
        let place = FoundRuns { closed_places: vec!["/run/guidedog".into()], ..live(&["a"]) };
        assert_eq!(chosen(&place, None), "a");
        let run = FoundRuns { closed_runs: vec!["/r/own".into()], ..live(&[]) };
        for (found, named, dir) in [
            (&place, Some("robot"), "/run/guidedog belongs to"),
            (&run, Some("own"), "/r/own belongs to"),
            (&run, None, "/r/own belongs to"),
        ] {
            let error = choose(found, named).expect_err("it is closed");
            assert_eq!(error.code, EXIT_NOT_PERMITTED);
            assert!(error.message.contains(dir), "{}", error.message);
        }
        assert_eq!(choose(&run, Some("other")).expect_err("there is none").code, EXIT_NO_RUN);
    }
}
