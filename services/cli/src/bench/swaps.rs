//! `bench swaps`: another policy again and again for a walking robot. No decision may be missed, and nothing may stop.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use control::{AskError, Policies, Report, Request, Status, SwapState};
use messages::StopKind;
use serde_json::{Value, json};
use settings::Millis;
use sha2::{Digest, Sha256};

use super::Percentiles;
use super::faults::rig::Rig;
use crate::exit::{EXIT_NOT_REACHED, EXIT_OK, Failure};
use crate::out;
use crate::workers::progress;

/// The supervisor is asked this often how a swap goes.
const ASK_EVERY: Duration = Duration::from_millis(10);
/// A swap that is not over by then never is.
const OVER_WITHIN: Duration = Duration::from_secs(60);

/// What came of the swaps.
#[derive(Debug, Default)]
struct Outcome {
    /// From the request to the first permit with the candidate's decision, nanoseconds.
    decided_ns: Vec<u64>,
    /// Why those failed that did.
    failed: Vec<String>,
    missed_decisions: u64,
    /// Stops but the run's own beginning and end, and stops for want of a way, by their reasons.
    stops: Vec<String>,
    /// Holds before a wall, which no swap has a part in.
    holds_of_its_way: u64,
    /// Run time at which the robot of the run that goes on walked.
    walks_since_s: Option<f64>,
}

/// Holds of a robot that comes near a wall.
const OF_ITS_WAY: [&str; 3] =
    [StopKind::PolicyStop.name(), StopKind::AllUnsafe.name(), StopKind::RemainderUnsafe.name()];
/// Stops of a run that ends.
const OF_ITS_END: [&str; 2] = [StopKind::ShuttingDown.name(), StopKind::Arrived.name()];

/// `guidedog bench swaps`: the exit code.
///
/// # Errors
/// Where no run can be started, or it ends by itself.
pub fn bench(swaps: u32, as_json: bool) -> Result<u8, Failure> {
    let half_second = Millis::try_from("500ms".to_owned()).map_err(Failure::input)?;
    let mut rig = Rig::with(|settings| {
        settings.policy.swap.decisions = 1;
        settings.policy.swap.probation = half_second;
    })?;
    let models = [write_model(&rig, "careful", 0.05)?, write_model(&rig, "bold", 0.03)?];
    let mut outcome = Outcome::default();
    let done = swap_again_and_again(&mut rig, swaps, &models, &mut outcome);
    outcome.take_report(rig.end().as_ref());
    // Whatever ended the swaps, those that were done were done.
    if let Err(failure) = &done {
        outcome.failed.push(failure.message.clone());
    }
    let is_met = outcome.failed.is_empty() && outcome.missed_decisions == 0 && outcome.stops.is_empty();
    out::tell(as_json, &outcome.json(swaps), || outcome.lines(swaps))?;
    Ok(if is_met { EXIT_OK } else { EXIT_NOT_REACHED })
}

fn swap_again_and_again(rig: &mut Rig, swaps: u32, models: &[PathBuf], outcome: &mut Outcome) -> Result<(), Failure> {
    let mut runs = 0;
    for i in progress(swaps.into(), "swaps").wrap_iter(0..swaps) {
        if rig.is_near_the_end() {
            outcome.take_report(rig.end().as_ref());
            runs = rig.runs;
        }
        rig.walk()?;
        if rig.runs > runs + 1 {
            return Err(Failure::run("a run ended, or did not walk, in the middle of its swaps"));
        }
        if outcome.walks_since_s.is_none() {
            outcome.walks_since_s = rig.read::<Status>().ok().map(|status| status.now_s);
        }
        let since = Instant::now();
        let model = models[i as usize % models.len()].clone();
        match rig.tell(&Request::PolicySwap { exe: None, model: Some(model) }) {
            Ok(begun) => wait_for(rig, begun.swap.unwrap_or(0), since, outcome)?,
            Err(AskError::Refused(why)) => outcome.failed.push(why.to_string()),
            Err(AskError::Unanswered(_)) => return Err(Failure::run("the supervisor does not answer")),
            Err(error @ AskError::Unreadable { .. }) => return Err(Failure::of_run(error)),
        }
    }
    Ok(())
}

/// Waits until a swap is over.
fn wait_for(rig: &mut Rig, number: u64, since: Instant, outcome: &mut Outcome) -> Result<(), Failure> {
    let mut decided = None;
    while since.elapsed() < OVER_WITHIN {
        if rig.interrupted() || !rig.is_alive() {
            return Err(Failure::run(format!("ended in the middle of swap {number}")));
        }
        let policies = rig.read::<Policies>().unwrap_or_default();
        let swap = policies.swap(number);
        let state = swap.map(|swap| swap.state);
        if let Some(SwapState::Probation | SwapState::Ending | SwapState::Done) = state {
            decided.get_or_insert_with(|| since.elapsed());
        }
        match (state, decided) {
            (Some(SwapState::Done), Some(after)) => {
                outcome.decided_ns.push(u64::try_from(after.as_nanos()).unwrap_or(u64::MAX));
                return Ok(());
            }
            (Some(SwapState::Failed | SwapState::RolledBack), _) => {
                outcome.failed.push(swap.and_then(|swap| swap.why.clone()).unwrap_or_default());
                return Ok(());
            }
            _ => std::thread::sleep(ASK_EVERY),
        }
    }
    Err(Failure::run(format!("swap {number} is not over after {} s", OVER_WITHIN.as_secs())))
}

fn write_model(rig: &Rig, name: &str, reserve_m: f64) -> Result<PathBuf, Failure> {
    let tuning = format!("reserve_m = {reserve_m}\n");
    let sha256: String = Sha256::digest(&tuning).iter().map(|byte| format!("{byte:02x}")).collect();
    let manifest = format!(
        "sha256 = \"{sha256}\"\nobservation = \"lidar-depth-pose-cue/1\"\nactions = \"eight\"\ndt = \"500ms\"\n"
    );
    let model = rig.folder().join(format!("{name}.geometric"));
    std::fs::write(&model, tuning).map_err(Failure::of_run)?;
    std::fs::write(model.with_extension("toml"), manifest).map_err(Failure::of_run)?;
    Ok(model)
}

impl Outcome {
    /// What a run's report says of decisions and stops.
    fn take_report(&mut self, report: Option<&Report>) {
        let Some(report) = report else { return };
        self.missed_decisions += report.missed_decisions;
        let since_s = self.walks_since_s.take().unwrap_or(0.0);
        // The corridor is straight and nobody gives another cue: once it walks, only what is beside its way stops it
        // rightly.
        let stops = report.stops.iter().filter(|stop| stop.at_s >= since_s);
        for reason in stops.map(|stop| stop.reason.as_str()).filter(|reason| !OF_ITS_END.contains(reason)) {
            if OF_ITS_WAY.contains(&reason) {
                self.holds_of_its_way += 1;
            } else {
                self.stops.push(reason.to_owned());
            }
        }
    }

    fn json(&self, asked: u32) -> Value {
        let ms = Percentiles::of(self.decided_ns.clone())
            .map(|p| json!({ "n": p.n, "p50": p.p50_us / 1000.0, "p99": p.p99_us / 1000.0, "max": p.max_us / 1000.0 }));
        json!({
            "swaps": asked, "done": self.decided_ns.len(), "failed": self.failed,
            "missed_decisions": self.missed_decisions, "stops": self.stops,
            "holds_of_its_way": self.holds_of_its_way, "decided_ms": ms,
        })
    }

    fn lines(&self, asked: u32) -> Vec<String> {
        let mut lines = vec![format!("{} of {asked} swaps done", self.decided_ns.len())];
        lines.extend(self.failed.iter().map(|why| format!("failed: {why}")));
        lines.push(format!("{} decisions missed, {} stops", self.missed_decisions, self.stops.len()));
        lines.extend(self.stops.iter().map(|reason| format!("stopped: {reason}")));
        lines.push(format!("{} holds before a wall", self.holds_of_its_way));
        if let Some(p) = Percentiles::of(self.decided_ns.clone()) {
            let [p50, p99, max] = [p.p50_us, p.p99_us, p.max_us].map(|us| us / 1000.0);
            let from = "from the request to the first permit";
            lines.push(format!("{from}: p50 {p50:.0} ms, p99 {p99:.0} ms, max {max:.0} ms"));
        }
        lines
    }
}
