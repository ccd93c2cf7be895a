//! A report in words, for people.

use std::collections::BTreeMap;

use control::{Collisions, ComparedCount, LatencyRow, Report};
use messages::{ClockKind, TopicId};
use serde_json::Value;

use crate::out::{count, number, table, text};
use crate::runs::RunEnding;

/// Notes told at the end; the report has them all.
const MAX_NOTES: usize = 8;

/// Summary of a walk.
pub fn walk(report: &Report, ending: &RunEnding) -> Vec<String> {
    let Collisions { robot, handler, hit_by_others } = report.collisions();
    let (distance_m, duration_s) = (report.distance_m(), report.duration_s);
    let mut lines = vec![
        String::new(),
        format!("walk {}: {}", report.run, ending.words),
        format!("  {distance_m:.1} m in {duration_s:.1} s of run time ({})", pace(report.clock)),
        format!("  collisions: robot {robot}, handler {handler}, hit by others {hit_by_others}"),
        format!("  falls: robot {}, handler {}", report.falls().robot, report.falls().handler),
    ];
    lines.extend(common(report));
    lines
}

/// Summary of a replay of a recording with those anomalies.
pub fn replay(report: &Report, anomalies: &BTreeMap<String, u64>, ending: &RunEnding) -> Vec<String> {
    let scans = report.published.get(TopicId::LidarScan.name()).unwrap_or(&0);
    let refused: u64 = report.refusals.values().sum();
    let mut lines = vec![
        String::new(),
        format!("replay {}: {}", report.run, ending.words),
        format!("  {:.1} s of run time ({})", report.duration_s, pace(report.clock)),
        format!("  scans: {scans} published, {} verdicts + {refused} refusals", report.verdicts),
        format!("  refusals: {}", counts(&report.refusals)),
        format!("  input anomalies: {}", counts(anomalies)),
        format!("  digest: {}", report.digest),
    ];
    lines.extend(compared(report));
    lines.extend(common(report));
    lines
}

/// Summary of a replay that is held against its recording.
pub fn against(report: &Report, differences: &[Value]) -> Vec<String> {
    let of = |count: ComparedCount| {
        let ComparedCount { recorded, equal, different, additional } = count;
        format!("{recorded} recorded, {equal} equal, {different} different, {additional} additional")
    };
    let Some(compared) = report.compared() else { return vec!["not compared with its recording".to_owned()] };
    let mut lines = vec![
        format!("permits: {}", of(compared.permits)),
        format!("actions: {}", of(compared.actions)),
        format!("decided differently: {}", compared.decided_differently),
    ];
    let side = |difference: &Value, side: &str| {
        let margin = difference.pointer(&format!("/{side}/margin_m")).and_then(Value::as_f64);
        let margin = margin.map_or_else(|| "-".to_owned(), |margin| format!("{margin:.3} m"));
        format!(
            "{} {} ({margin})",
            text(difference, &format!("/{side}/action")),
            text(difference, &format!("/{side}/outcome"))
        )
    };
    let rows: Vec<Vec<String>> = differences
        .iter()
        .map(|difference| {
            let at = format!("{:.2} s", number(difference, "/at_s"));
            let step = count(difference, "/step").to_string();
            let decision = count(difference, "/decision").to_string();
            vec![
                at,
                step,
                text(difference, "/cause").to_owned(),
                decision,
                side(difference, "recorded"),
                side(difference, "replayed"),
            ]
        })
        .collect();
    if !rows.is_empty() {
        lines.extend(table(&["at", "step", "cause", "decision", "recorded", "now"], &rows));
    }
    lines
}

/// How the run compares with the recorded one, where that can be said.
fn compared(report: &Report) -> Option<String> {
    let compared = report.compared()?;
    let ComparedCount { equal, recorded, .. } = compared.permits;
    let same = if compared.exact {
        format!("{equal} of {recorded} permits equal to the byte")
    } else {
        format!("{recorded} permits recorded, at other steps")
    };
    Some(format!("  beside the recording: {same}; {} decided differently", compared.decided_differently))
}

fn common(report: &Report) -> Vec<String> {
    let mut lines = vec![
        format!("  decisions: {}, missed {}", report.decisions, report.missed_decisions),
        format!("  messages lost: {}", counts(&report.lost)),
        format!("  longest freeze: {:.1} s", report.longest_freeze_s),
    ];
    if !report.restarts.is_empty() {
        lines.push(format!("  restarts: {}", counts(&report.restarts)));
    }
    lines.push("  stops:".to_owned());
    lines.extend(indented(&table(&["class", "reason", "times", "in all"], &stop_rows(report))));
    let measured = report.latency_us.iter().filter(|(_, row)| row.n > 0);
    let latencies: Vec<Vec<String>> = measured.map(latency_row).collect();
    if !latencies.is_empty() {
        lines.push("  latency:".to_owned());
        lines.extend(indented(&table(&["from-to", "n", "p50", "p99", "max"], &latencies)));
    }
    let notes = &report.notes;
    let last = &notes[notes.len().saturating_sub(MAX_NOTES)..];
    if !last.is_empty() {
        lines.push(format!("  notes (the last {} of {}):", last.len(), notes.len()));
        lines.extend(last.iter().map(|note| format!("    {:8.2} s  {}", note.at_s, note.text)));
    }
    lines
}

fn indented(lines: &[String]) -> impl Iterator<Item = String> + '_ {
    lines.iter().map(|line| format!("    {line}"))
}

fn pace(clock: ClockKind) -> String {
    match clock {
        ClockKind::Stepped { speed } if speed > 0.0 => format!("at most {speed} times faster than real"),
        ClockKind::Stepped { .. } => "as fast as it went".to_owned(),
        ClockKind::Real => "real time".to_owned(),
    }
}

/// The counts that are not 0.
fn counts<N: Copy + Into<u64>>(counts: &BTreeMap<String, N>) -> String {
    let known = counts.iter().map(|(name, n)| (name, (*n).into())).filter(|(_, n)| *n > 0);
    let words: Vec<String> = known.map(|(name, n): (_, u64)| format!("{name} {n}")).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

fn stop_rows(report: &Report) -> Vec<Vec<String>> {
    let mut sums: BTreeMap<(&str, &str), (u64, f64)> = BTreeMap::new();
    for stop in &report.stops {
        let sum = sums.entry((&stop.class, &stop.reason)).or_default();
        sum.0 += 1;
        sum.1 += stop.lasted_s;
    }
    let row = |((class, reason), (times, lasted_s)): ((&str, &str), (u64, f64))| {
        vec![class.to_owned(), reason.to_owned(), times.to_string(), format!("{lasted_s:.2} s")]
    };
    sums.into_iter().map(row).collect()
}

fn latency_row((name, row): (&String, &LatencyRow)) -> Vec<String> {
    let us = |us: Option<f64>| us.map_or("-".to_owned(), duration);
    vec![name.clone(), row.n.to_string(), us(row.p50), us(row.p99), us(Some(row.max))]
}

fn duration(us: f64) -> String {
    if us < 1000.0 { format!("{us:.1} us") } else { format!("{:.1} ms", us / 1000.0) }
}

#[cfg(test)]
mod tests {
    use super::{replay, walk};
    use crate::runs::RunEnding;
    use control::{LatencyRow, Report, RunFigures, Stop};
    use messages::ClockKind;

    fn ending() -> RunEnding {
        RunEnding { words: "reached the goal".to_owned(), well: true }
    }

    #[test]
    fn stops_are_summed_up_by_reason() {
        let stop = |lasted_s: f64| {
            let (class, reason) = ("hold".to_owned(), "no_permit".to_owned());
            Stop { class, reason, lasted_s, ..Stop::default() }
        };
        let row = LatencyRow { n: 5, p50: Some(480.2), p99: Some(2100.0), max: 2200.0, ..LatencyRow::default() };
        let report = Report {
            clock: ClockKind::Stepped { speed: 10.0 },
            world: Some(RunFigures { distance_m: 33.04, ..RunFigures::default() }),
            duration_s: 61.0,
            stops: vec![stop(0.5), stop(1.0)],
            latency_us: [("scan_to_permit".to_owned(), row)].into(),
            ..Report::default()
        };
        let lines = walk(&report, &ending()).join("\n");
        for what in ["33.0 m in 61.0 s", "at most 10 times", "hold   no_permit  2      1.50 s", "480.2 us  2.1 ms"] {
            assert!(lines.contains(what), "{what} is not in\n{lines}");
        }
    }

    #[test]
    fn a_replay_tells_scans_and_digest() {
        let report = Report {
            published: [("lidar/scan".to_owned(), 100)].into(),
            verdicts: 90,
            refusals: [("stale_scan".to_owned(), 10), ("none".to_owned(), 0)].into(),
            digest: "ab12".to_owned(),
            ..Report::default()
        };
        let lines = replay(&report, &[("gap".to_owned(), 3)].into(), &ending()).join("\n");
        for what in ["100 published, 90 verdicts + 10 refusals", "refusals: stale_scan 10", "gap 3", "ab12"] {
            assert!(lines.contains(what), "{what} is not in\n{lines}");
        }
    }
}
