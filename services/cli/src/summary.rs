//! A report in words, for people.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::out::{count, elements, entries, number, table, text};
use crate::runs::RunEnding;

/// Notes told at the end; the report has them all.
const MAX_NOTES: usize = 8;

/// Summary of a walk.
pub fn walk(report: &Value, ending: &RunEnding) -> Vec<String> {
    let mut lines = vec![
        String::new(),
        format!("walk {}: {}", text(report, "/run"), ending.words),
        format!(
            "  {:.1} m in {:.1} s of run time ({})",
            number(report, "/distance_m"),
            number(report, "/duration_s"),
            pace(report)
        ),
        format!(
            "  collisions: robot {}, handler {}, hit by others {}",
            count(report, "/collisions/robot"),
            count(report, "/collisions/handler"),
            count(report, "/collisions/hit_by_others")
        ),
    ];
    lines.extend(common(report));
    lines
}

/// Summary of a replay.
pub fn replay(report: &Value, ending: &RunEnding) -> Vec<String> {
    let verdicts = count(report, "/verdicts");
    let refused: u64 = entries(report, "/refusals").filter_map(|(_, n)| n.as_u64()).sum();
    let mut lines = vec![
        String::new(),
        format!("replay {}: {}", text(report, "/run"), ending.words),
        format!("  {:.1} s of run time ({})", number(report, "/duration_s"), pace(report)),
        format!(
            "  scans: {} published, {verdicts} verdicts + {refused} refusals",
            count(report, "/published/lidar~1scan")
        ),
        format!("  refusals: {}", counts(report, "/refusals")),
        format!("  input anomalies: {}", counts(report, "/input_anomalies")),
        format!("  digest: {}", text(report, "/digest")),
    ];
    lines.extend(compared(report));
    lines.extend(common(report));
    lines
}

/// Summary of a replay that is held against its recording.
pub fn against(report: &Value) -> Vec<String> {
    let of = |what: &str| {
        let count = |name: &str| count(report, &format!("/compared/{what}/{name}"));
        format!(
            "{} recorded, {} equal, {} different, {} additional",
            count("recorded"),
            count("equal"),
            count("different"),
            count("additional")
        )
    };
    let mut lines = vec![
        format!("permits: {}", of("permits")),
        format!("actions: {}", of("actions")),
        format!("decided differently: {}", count(report, "/compared/decided_differently")),
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
    let rows: Vec<Vec<String>> = elements(report, "/differences")
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
fn compared(report: &Value) -> Option<String> {
    if !report["compared"].is_object() {
        return None;
    }
    let exact = report["compared"]["exact"].as_bool() == Some(true);
    let (equal, recorded) = (count(report, "/compared/permits/equal"), count(report, "/compared/permits/recorded"));
    let same = if exact {
        format!("{equal} of {recorded} permits equal to the byte")
    } else {
        format!("{recorded} permits recorded, at other steps")
    };
    let decided = count(report, "/compared/decided_differently");
    Some(format!("  beside the recording: {same}; {decided} decided differently"))
}

fn common(report: &Value) -> Vec<String> {
    let mut lines = vec![
        format!("  decisions: {}, missed {}", count(report, "/decisions"), count(report, "/missed_decisions")),
        format!("  messages lost: {}", counts(report, "/lost")),
        format!("  longest freeze: {:.1} s", number(report, "/longest_freeze_s")),
    ];
    if entries(report, "/restarts").next().is_some() {
        lines.push(format!("  restarts: {}", counts(report, "/restarts")));
    }
    lines.push("  stops:".to_owned());
    lines.extend(indented(&table(&["class", "reason", "times", "in all"], &stop_rows(report))));
    let measured = entries(report, "/latency_us").filter(|(_, row)| count(row, "/n") > 0);
    let latencies: Vec<Vec<String>> = measured.map(latency_row).collect();
    if !latencies.is_empty() {
        lines.push("  latency:".to_owned());
        lines.extend(indented(&table(&["from-to", "n", "p50", "p99", "max"], &latencies)));
    }
    let notes = elements(report, "/notes");
    let last = &notes[notes.len().saturating_sub(MAX_NOTES)..];
    if !last.is_empty() {
        lines.push(format!("  notes (the last {} of {}):", last.len(), notes.len()));
        let note = |note: &Value| format!("    {:8.2} s  {}", number(note, "/at_s"), text(note, "/text"));
        lines.extend(last.iter().map(note));
    }
    lines
}

fn indented(lines: &[String]) -> impl Iterator<Item = String> + '_ {
    lines.iter().map(|line| format!("    {line}"))
}

fn pace(report: &Value) -> String {
    match text(report, "/clock/kind") {
        "stepped" if number(report, "/clock/speed") > 0.0 => {
            format!("at most {} times faster than real", number(report, "/clock/speed"))
        }
        "stepped" => "as fast as it went".to_owned(),
        _ => "real time".to_owned(),
    }
}

/// The counts of an object that are not 0.
fn counts(report: &Value, path: &str) -> String {
    let known = entries(report, path).filter_map(|(name, n)| n.as_u64().filter(|n| *n > 0).map(|n| (name, n)));
    let words: Vec<String> = known.map(|(name, n)| format!("{name} {n}")).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

fn stop_rows(report: &Value) -> Vec<Vec<String>> {
    let mut sums: BTreeMap<(&str, &str), (u64, f64)> = BTreeMap::new();
    for stop in elements(report, "/stops") {
        let sum = sums.entry((text(stop, "/class"), text(stop, "/reason"))).or_default();
        sum.0 += 1;
        sum.1 += number(stop, "/lasted_s");
    }
    let row = |((class, reason), (times, lasted_s)): ((&str, &str), (u64, f64))| {
        vec![class.to_owned(), reason.to_owned(), times.to_string(), format!("{lasted_s:.2} s")]
    };
    sums.into_iter().map(row).collect()
}

fn latency_row((name, row): (&str, &Value)) -> Vec<String> {
    let us = |key: &str| row[key].as_f64().map_or("-".to_owned(), duration);
    vec![name.to_owned(), count(row, "/n").to_string(), us("p50"), us("p99"), us("max")]
}

fn duration(us: f64) -> String {
    if us < 1000.0 { format!("{us:.1} us") } else { format!("{:.1} ms", us / 1000.0) }
}

#[cfg(test)]
mod tests {
    use super::{replay, walk};
    use crate::runs::RunEnding;
    use serde_json::json;

    fn ending() -> RunEnding {
        RunEnding { words: "reached the goal".to_owned(), well: true }
    }

    #[test]
    fn stops_are_summed_up_by_reason() {
        let stop = |lasted_s: f64| json!({ "class": "hold", "reason": "no_permit", "lasted_s": lasted_s });
        let report = json!({
            "run": "w", "clock": { "kind": "stepped", "speed": 10.0 }, "distance_m": 33.04, "duration_s": 61.0,
            "stops": [stop(0.5), stop(1.0)],
            "latency_us": { "scan_to_permit": { "n": 5, "p50": 480.2, "p99": 2100.0, "p999": null, "max": 2200.0 } },
        });
        let lines = walk(&report, &ending()).join("\n");
        for what in ["33.0 m in 61.0 s", "at most 10 times", "hold   no_permit  2      1.50 s", "480.2 us  2.1 ms"] {
            assert!(lines.contains(what), "{what} is not in\n{lines}");
        }
    }

    #[test]
    fn a_replay_tells_scans_and_digest() {
        let report = json!({
            "published": { "lidar/scan": 100 }, "verdicts": 90, "refusals": { "stale_scan": 10, "none": 0 },
            "digest": "ab12", "input_anomalies": { "gap": 3 },
        });
        let lines = replay(&report, &ending()).join("\n");
        for what in ["100 published, 90 verdicts + 10 refusals", "refusals: stale_scan 10", "gap 3", "ab12"] {
            assert!(lines.contains(what), "{what} is not in\n{lines}");
        }
    }
}
