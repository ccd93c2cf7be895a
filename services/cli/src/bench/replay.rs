//! `bench replay`: many stepped replays of one recording, which have to give the same bytes.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use clap::Parser;
use serde_json::json;

use crate::args::{Cli, ReplayArgs, Verb};
use crate::control::free_name;
use crate::exit::{EXIT_DIFFERENT, EXIT_OK, Failure};
use crate::launch::{Launch, Signals};
use crate::out::{self, count, entries, say, text};
use crate::prepare_replay;

/// `guidedog bench replay`: the exit code.
///
/// # Errors
/// Where the recording cannot be replayed, or a replay fails.
pub fn bench(recording: &Path, repeat: u32, config: Option<&Path>, as_json: bool) -> Result<u8, Failure> {
    let prepared = prepare_replay::replay(&arguments(recording, config)?)?;
    let signals = Signals::of_this_process()?;
    let (mut digests, mut walls_s) = (BTreeMap::<String, u32>::new(), Vec::new());
    let (mut equal_to_recording, mut lost, mut exact) = (0_u32, 0, false);
    let mut first_difference = None;
    for done in 0..repeat {
        let begun = Instant::now();
        let launch = Launch { settings: &prepared.settings, name: free_name("replay"), speed: Some(0.0) };
        let outcome = launch.spawn()?.wait(|| {})?;
        if signals.came() {
            return Err(Failure::run(format!("ended by a signal after {done} of {repeat} replays")));
        }
        let report = &outcome.report;
        if !text(report, "/failure").is_empty() {
            return Err(Failure::run(format!("replay {}: {}", done + 1, text(report, "/failure"))));
        }
        walls_s.push(begun.elapsed().as_secs_f64());
        *digests.entry(text(report, "/digest").to_owned()).or_default() += 1;
        lost += entries(report, "/lost").filter_map(|(_, n)| n.as_u64()).sum::<u64>();
        let differ = |what: &str| {
            count(report, &format!("/compared/{what}/different"))
                + count(report, &format!("/compared/{what}/additional"))
        };
        equal_to_recording += u32::from(differ("permits") + differ("actions") == 0);
        exact = report["compared"]["exact"].as_bool().unwrap_or(false);
        first_difference =
            first_difference.or_else(|| report["compared"]["first_difference"].as_str().map(str::to_owned));
        if !as_json && (done + 1) % 16 == 0 {
            say(format!("{} of {repeat} replays, {} different digests", done + 1, digests.len()));
        }
    }
    walls_s.sort_by(f64::total_cmp);
    // A run that was not recorded whole has nothing to be equal to, but every replay of it is equal to every other.
    let must_equal = exact && config.is_none();
    let well = digests.len() == 1 && lost == 0 && (!must_equal || equal_to_recording == repeat);
    let median_s = walls_s.get(walls_s.len() / 2).copied().unwrap_or(0.0);
    if as_json {
        out::json(&json!({
            "recording": recording.display().to_string(),
            "replays": repeat,
            "digests": digests,
            "exact": exact,
            "equal_to_recording": equal_to_recording,
            "first_difference": first_difference,
            "lost": lost,
            "wall_s": { "p50": median_s, "max": walls_s.last() },
            "well": well,
        }))?;
    } else {
        say(format!(
            "{repeat} replays, {} different digests, {lost} messages lost, {median_s:.2} s each (p50)",
            digests.len()
        ));
        if exact {
            say(format!("{equal_to_recording} of them equal to the recorded run in every action and permit"));
        }
        first_difference.iter().for_each(|what| say(format!("first difference: {what}")));
    }
    Ok(if well { EXIT_OK } else { EXIT_DIFFERENT })
}

/// As `guidedog replay RECORDING` has them.
fn arguments(recording: &Path, config: Option<&Path>) -> Result<ReplayArgs, Failure> {
    let line = ["guidedog".as_ref(), "replay".as_ref(), recording.as_os_str()];
    match Cli::try_parse_from(line).map_err(Failure::of_input)?.verb {
        Verb::Replay(mut args) => {
            args.pace.config = config.map(Path::to_owned);
            Ok(args)
        }
        _ => Err(Failure::input("the recording is no argument")),
    }
}
