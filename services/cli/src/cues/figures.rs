//! What many recordings amount to, with intervals of 95 %.

use std::collections::BTreeMap;

use enrolment::SILENCE;
use hearing::RATE_HZ;
use messages::CueKind;
use serde_json::{Value, json};

use super::Outcome;
use super::files::What;
use crate::out::number;
use crate::statistics::{an_hour, ratio};

const CUES: [CueKind; 4] = [CueKind::Forward, CueKind::Left, CueKind::Right, CueKind::Stop];

/// What is heard before and after a recording is no part of it.
const SILENCES_S: f64 = 2.0 * SILENCE as f64 / RATE_HZ as f64;

/// What was counted under one condition.
#[derive(Debug, Default)]
pub struct Counts {
    /// By word that is a cue: whether that was the first that was heard.
    recall: BTreeMap<String, Vec<bool>>,
    /// Of words that start the robot, where it stands by a stop and they have to be surer.
    from_standing: BTreeMap<String, Vec<bool>>,
    /// By other word: whether anything was heard.
    false_accepts: BTreeMap<String, Vec<bool>>,
    /// By what was said: what was heard in its place, and how often.
    confusions: BTreeMap<String, BTreeMap<&'static str, usize>>,
    /// By cue, in streams without one.
    alarms: BTreeMap<&'static str, usize>,
    /// Of these streams.
    stream_hours: f64,
    /// After what was said had ended, seconds.
    latencies_s: Vec<f64>,
    length_s: f64,
    taken_s: f64,
}

impl Counts {
    /// Counts.
    pub fn of(outcomes: &[Outcome]) -> Self {
        let mut counts = Self::default();
        outcomes.iter().for_each(|outcome| counts.take(outcome));
        counts.latencies_s.sort_by(f64::total_cmp);
        counts
    }

    fn take(&mut self, outcome: &Outcome) {
        self.length_s += outcome.length_s;
        self.taken_s += outcome.taken_s;
        let (said, meant) = match &outcome.what {
            What::Cue(word, cue) => {
                let first = outcome.heard.first().filter(|_| outcome.is_right());
                self.recall.entry(word.clone()).or_default().push(outcome.is_right());
                self.latencies_s.extend(first.map(|(_, latency_s)| latency_s));
                if let Some(starts) = outcome.from_standing {
                    self.from_standing.entry(word.clone()).or_default().push(starts);
                }
                (word, Some(*cue))
            }
            What::Other(word) => {
                self.false_accepts.entry(word.clone()).or_default().push(!outcome.is_right());
                (word, None)
            }
            What::Stream => {
                self.stream_hours += (outcome.length_s - SILENCES_S) / 3600.0;
                for (kind, _) in &outcome.heard {
                    *self.alarms.entry(kind.name()).or_default() += 1;
                }
                return;
            }
        };
        for (kind, _) in outcome.heard.iter().filter(|(kind, _)| Some(*kind) != meant) {
            *self.confusions.entry(said.clone()).or_default().entry(kind.name()).or_default() += 1;
        }
    }

    /// As one object.
    pub fn report(&self) -> Value {
        let rates = |counts: &BTreeMap<String, Vec<bool>>| -> Value {
            let mut rates: serde_json::Map<String, Value> =
                counts.iter().map(|(word, hits)| (word.clone(), ratio(hits.iter().copied()))).collect();
            rates.insert("all".to_owned(), ratio(counts.values().flatten().copied()));
            Value::Object(rates)
        };
        let alarms = |wanted: &dyn Fn(CueKind) -> bool| {
            let count = CUES.into_iter().filter(|kind| wanted(*kind)).filter_map(|kind| self.alarms.get(kind.name()));
            an_hour(count.sum(), self.stream_hours)
        };
        let mut alarms_an_hour: serde_json::Map<String, Value> =
            CUES.into_iter().map(|cue| (cue.name().to_owned(), alarms(&|kind| kind == cue))).collect();
        alarms_an_hour.insert("directions".to_owned(), alarms(&CueKind::is_moving));
        let at = |share: f64| {
            let last = self.latencies_s.len().checked_sub(1)?;
            self.latencies_s.get(((self.latencies_s.len() as f64 * share) as usize).min(last))
        };
        json!({
            "recall": rates(&self.recall),
            "recall_from_standing": rates(&self.from_standing),
            "false_accepts": rates(&self.false_accepts),
            "confusions": self.confusions,
            "alarms_per_hour": alarms_an_hour,
            "latency_s": { "p50": at(0.5), "p95": at(0.95), "n": self.latencies_s.len() },
            "cpu_share": self.taken_s / self.length_s.max(1e-9),
            "audio_s": self.length_s,
        })
    }
}

/// The report as lines for people.
pub fn text(report: &Value) -> String {
    let mut lines = Vec::new();
    let rate = |name: &str, value: &Value, digits: usize| {
        let of = |key| number(value, key);
        let n = if value["n"].is_u64() { format!("n = {}", of("/n")) } else { format!("{:.2} h", of("/hours")) };
        format!("  {name:<24}{:>8.digits$}  [{:.digits$}, {:.digits$}]  {n}", of("/mean"), of("/lo"), of("/hi"))
    };
    for left_out in report["left_out"].as_array().into_iter().flatten() {
        lines.push(format!("left out: {}", left_out["why"].as_str().unwrap_or_default()));
    }
    for (condition, counts) in report["conditions"].as_object().into_iter().flatten() {
        lines.push(condition.clone());
        for (title, key, digits) in [
            ("", "recall", 3),
            ("from standing ", "recall_from_standing", 3),
            ("false accepts of ", "false_accepts", 3),
            ("false alarms/h ", "alarms_per_hour", 1),
        ] {
            for (word, value) in counts[key].as_object().into_iter().flatten().filter(|(_, value)| value.is_object()) {
                let is_worth_a_line = key != "false_accepts" || word == "all" || number(value, "/mean") > 0.0;
                if is_worth_a_line {
                    lines.push(rate(&format!("{title}{word}"), value, digits));
                }
            }
        }
        for (word, value) in counts["against"]["right"].as_object().into_iter().flatten() {
            lines.push(rate(&format!("against it, {word}"), value, 3));
        }
        let of = |key| number(counts, key);
        let latency = counts["latency_s"]["n"].as_u64() > Some(0);
        if latency {
            lines.push(format!(
                "  {:<24}{:>8.2}  p95 {:.2} s  n = {}",
                "after the word's end",
                of("/latency_s/p50"),
                of("/latency_s/p95"),
                of("/latency_s/n")
            ));
        }
        lines.push(format!(
            "  {:<24}{:>8.1} % of a core, {:.0} s of sound",
            "cost",
            100.0 * of("/cpu_share"),
            of("/audio_s")
        ));
    }
    lines.join("\n")
}
