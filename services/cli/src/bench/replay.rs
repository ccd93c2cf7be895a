//! `bench replay`: many stepped replays of one recording, which have to give the same bytes.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use clap::Parser;
use control::{ComparedCount, Report};
use serde_json::{Value, json};

use crate::args::{Cli, ReplayArgs, Verb};
use crate::exit::{EXIT_DIFFERENT, EXIT_OK, Failure};
use crate::find::free_name;
use crate::launch::{Launch, Signals};
use crate::out::{self, say};
use crate::prepare_replay;
use crate::workers::progress;

/// What came of the replays so far.
#[derive(Debug, Default)]
struct Tally {
    digests: BTreeMap<String, u32>,
    walls_s: Vec<f64>,
    equal_to_recording: u32,
    lost: u64,
    /// Whether the recording is of a whole stepped run, so that there is something to be equal to.
    exact: bool,
    first_difference: Option<String>,
}

impl Tally {
    fn take(&mut self, report: &Report, wall_s: f64) {
        self.walls_s.push(wall_s);
        *self.digests.entry(report.digest.clone()).or_default() += 1;
        self.lost += report.lost.values().sum::<u64>();
        // A recording without permits leaves nothing to compare.
        let Some(compared) = report.compared() else { return };
        let differ = |count: ComparedCount| count.different + count.additional;
        self.equal_to_recording += u32::from(differ(compared.permits) + differ(compared.actions) == 0);
        self.exact = compared.exact;
        if self.first_difference.is_none() {
            self.first_difference.clone_from(&compared.first_difference);
        }
    }

    fn replays(&self) -> u32 {
        self.walls_s.len() as u32
    }

    /// Whether all `wanted` replays gave the same, and, where they must, what was recorded.
    fn is_well(&self, wanted: u32, must_equal: bool) -> bool {
        let equal = !must_equal || self.equal_to_recording == wanted;
        self.replays() == wanted && self.digests.len() == 1 && self.lost == 0 && equal
    }

    fn wall_s(&self) -> (f64, f64) {
        let mut walls_s = self.walls_s.clone();
        walls_s.sort_by(f64::total_cmp);
        let at = |i: usize| walls_s.get(i).copied().unwrap_or(0.0);
        (at(walls_s.len() / 2), at(walls_s.len().saturating_sub(1)))
    }

    fn json(&self, recording: &Path, well: bool) -> Value {
        let (p50_s, max_s) = self.wall_s();
        json!({
            "recording": recording.display().to_string(),
            "replays": self.replays(),
            "digests": self.digests,
            "exact": self.exact,
            "equal_to_recording": self.equal_to_recording,
            "first_difference": self.first_difference,
            "lost": self.lost,
            "wall_s": { "p50": p50_s, "max": max_s },
            "well": well,
        })
    }

    fn lines(&self) -> Vec<String> {
        let (replays, digests, lost) = (self.replays(), self.digests.len(), self.lost);
        let (p50_s, _) = self.wall_s();
        let mut lines = vec![format!(
            "{replays} replays, {digests} different digests, {lost} messages lost, {p50_s:.2} s each (p50)"
        )];
        if self.exact {
            let equal = self.equal_to_recording;
            lines.push(format!("{equal} of them equal to the recorded run in every action and permit"));
        }
        lines.extend(self.first_difference.iter().map(|what| format!("first difference: {what}")));
        lines
    }
}

/// `guidedog bench replay`: the exit code. One that is ended by a signal reports what it had.
///
/// # Errors
/// Where the recording cannot be replayed, or a replay fails.
pub fn bench(recording: &Path, repeat: u32, config: Option<&Path>, as_json: bool) -> Result<u8, Failure> {
    let mut prepared = prepare_replay::replay(&arguments(recording, config)?)?;
    prepared.settings.run_record.keep_runs = 0;
    let signals = Signals::of_this_process()?;
    let mut tally = Tally::default();
    for done in progress(repeat.into(), "replays").wrap_iter(1..=repeat) {
        let begun = Instant::now();
        let launch = Launch { settings: &prepared.settings, name: free_name("replay"), speed: Some(0.0) };
        let outcome = launch.spawn()?.wait(|| {})?;
        if signals.came() {
            say(format!("ended by a signal after {} of {repeat} replays", done - 1));
            break;
        }
        if let Some(failure) = &outcome.report.failure {
            return Err(Failure::run(format!("replay {done}: {failure}")));
        }
        tally.take(&outcome.report, begun.elapsed().as_secs_f64());
        if !as_json && done % 16 == 0 {
            say(format!("{done} of {repeat} replays, {} different digests", tally.digests.len()));
        }
    }
    // A run that was not recorded whole has nothing to be equal to, but every replay of it is equal to every other.
    let well = tally.is_well(repeat, tally.exact && config.is_none());
    out::tell(as_json, &tally.json(recording, well), || tally.lines())?;
    Ok(if well { EXIT_OK } else { EXIT_DIFFERENT })
}

/// As `guidedog replay RECORDING` has them.
fn arguments(recording: &Path, config: Option<&Path>) -> Result<ReplayArgs, Failure> {
    let line = ["guidedog".as_ref(), "replay".as_ref(), recording.as_os_str()];
    match Cli::try_parse_from(line).map_err(Failure::of_input)?.verb {
        Verb::Replay(mut args) => {
            args.pace.config.file = config.map(Path::to_owned);
            Ok(args)
        }
        _ => Err(Failure::input("the recording is no argument")),
    }
}

#[cfg(test)]
mod tests {
    use control::{Compared, ReplayFigures, RunFigures};

    use super::*;

    fn report(compared: Option<Compared>) -> Report {
        let replayed = ReplayFigures {
            recording: "walk.mcap".to_owned(),
            scans: 1,
            depth_frames: 0,
            recorded_s: 1.0,
            input_anomalies: BTreeMap::new(),
            compared,
        };
        Report { world: Some(RunFigures { replayed: Some(replayed), ..RunFigures::default() }), ..Report::default() }
    }

    #[test]
    fn a_replay_that_was_not_compared_is_not_equal_to_the_recording() {
        let mut tally = Tally::default();
        tally.take(&report(None), 1.0);
        assert_eq!((tally.equal_to_recording, tally.exact), (0, false));
        assert!(tally.is_well(1, false) && !tally.is_well(1, true));
        tally.take(&report(Some(Compared { exact: true, ..Compared::default() })), 1.0);
        assert_eq!((tally.equal_to_recording, tally.exact), (1, true));
        assert!(!tally.is_well(2, true), "one of two was compared");
    }
}
