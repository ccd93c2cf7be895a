//! What many episodes amount to, with intervals of 95 %.

use episodes::Report;
use messages::CueKind;
use serde_json::{Value, json};

use super::failures;
use super::outcome::Outcome;
use crate::out::number;
use crate::statistics::{line, mean, ratio};

/// Adds the figures of these episodes to a report.
pub fn add(report: &mut Value, outcomes: &[Outcome]) {
    let reports = || outcomes.iter().map(|outcome| &outcome.report);
    let of = |value: fn(&Report) -> f64| mean(reports().map(value));
    let share =
        |count: fn(&Report) -> u32| mean(reports().map(|r| f64::from(count(r)) / f64::from(r.decisions.max(1))));
    let success = |wanted: &dyn Fn(&Report) -> bool| ratio(reports().filter(|r| wanted(r)).map(|r| r.success));
    // Who is to stand does not freeze.
    let going = || reports().filter(|r| !r.to_stand);
    let is_turn = |r: &Report| matches!(r.cue, CueKind::Left | CueKind::Right);
    let mut latency: Vec<f32> = outcomes.iter().flat_map(|outcome| outcome.latency_us.iter().copied()).collect();
    latency.sort_by(f32::total_cmp);
    let quantile =
        |share: f64| latency.get(((latency.len() as f64 * share) as usize).min(latency.len().saturating_sub(1)));
    let figures = json!({
        "collision_free": ratio(reports().map(|r| r.collisions == 0)),
        "collisions_per_episode": of(|r| f64::from(r.collisions)),
        "robot_collisions": of(|r| f64::from(r.robot_collisions)),
        "handler_collisions": of(|r| f64::from(r.handler_collisions)),
        "hit_by_others": of(|r| f64::from(r.hit_by_others)),
        "distance_m": of(|r| r.distance_m),
        "walked_m": of(|r| r.walked_m),
        "cue_success": {
            "all": success(&|_| true),
            "forward": success(&|r| r.cue == CueKind::Forward),
            "left": success(&|r| r.cue == CueKind::Left),
            "right": success(&|r| r.cue == CueKind::Right),
            "turn_taken": success(&|r| is_turn(r) && !r.to_stand),
            "turn_nowhere": success(&|r| is_turn(r) && r.to_stand),
            "stop": ratio(outcomes.iter().map(|outcome| outcome.stopped)),
        },
        "orientation_corrected": ratio(reports().filter_map(|r| r.corrected)),
        "orientation_faced": ratio(reports().filter_map(|r| r.faces_line)),
        "all_unsafe": share(|r| r.all_unsafe),
        "unsafe_taken": share(|r| r.unsafe_taken),
        // Who is to stand is not held.
        "held": {
            "policy": mean(going().map(|r| f64::from(r.held.policy))),
            "lidar": mean(going().map(|r| f64::from(r.held.lidar))),
            "camera": mean(going().map(|r| f64::from(r.held.camera))),
            "memory": mean(going().map(|r| f64::from(r.held.memory))),
            "contact": mean(going().map(|r| f64::from(r.held.contact))),
            "floor": mean(going().map(|r| f64::from(r.held.floor))),
        },
        "longest_freeze": mean(going().map(|r| f64::from(r.longest_freeze))),
        "longest_freeze_max": going().map(|r| r.longest_freeze).max(),
        "reward": of(|r| r.reward),
        "decision_us": { "p50": quantile(0.5), "p99": quantile(0.99), "n": latency.len() },
    });
    if let (Value::Object(report), Value::Object(figures)) = (report, figures) {
        report.extend(figures);
    }
}

/// What the shield changed, episode by episode.
pub fn difference(with: &[Outcome], without: &[Outcome]) -> Value {
    let pairs = || with.iter().zip(without).map(|(a, b)| (&a.report, &b.report));
    let free = |r: &Report| f64::from(u8::from(r.collisions == 0));
    let before_m = pairs().map(|(_, b)| b.distance_m).sum::<f64>() / with.len().max(1) as f64;
    let mut relative = mean(pairs().map(|(a, b)| (a.distance_m - b.distance_m) / before_m.max(1e-9)));
    relative["of_m"] = json!(before_m);
    json!({
        "collision_free": mean(pairs().map(|(a, b)| free(a) - free(b))),
        "distance_share": relative,
    })
}

/// The report as lines for people.
pub fn text(report: &Value) -> String {
    let missing = report["episodes_missing"].as_u64().map(|n| format!("{n} episodes are missing"));
    let mut lines: Vec<String> = missing.into_iter().chain([failures::line(&report["failures"])]).collect();
    let row = |name: &str, at: &str, digits: usize| {
        let interval = report.pointer(at).filter(|value| value.is_object())?;
        Some(line(name, interval, [34, 9], digits))
    };
    let rows = [
        ("collision-free episodes", "/collision_free", 3),
        ("collisions per episode", "/collisions_per_episode", 3),
        ("  of the robot", "/robot_collisions", 3),
        ("  of the handler", "/handler_collisions", 3),
        ("hit by others, per episode", "/hit_by_others", 3),
        ("distance from the cue, m", "/distance_m", 2),
        ("cue followed", "/cue_success/all", 3),
        ("  forward", "/cue_success/forward", 3),
        ("  left", "/cue_success/left", 3),
        ("  right", "/cue_success/right", 3),
        ("  into an opening", "/cue_success/turn_taken", 3),
        ("  where there was none", "/cue_success/turn_nowhere", 3),
        ("  stop", "/cue_success/stop", 3),
        ("orientation corrected in 3 m", "/orientation_corrected", 3),
        ("  faces the line then", "/orientation_faced", 3),
        ("steps with every action unsafe", "/all_unsafe", 4),
        ("reward (eq. 1, from the start)", "/reward", 2),
        ("without shield: collision-free", "/without_shield/collision_free", 3),
        ("without shield: distance, m", "/without_shield/distance_m", 2),
        ("gain of collision-free", "/difference/collision_free", 3),
        ("change of distance, share", "/difference/distance_share", 4),
        ("longest freeze, mean, decisions", "/longest_freeze", 2),
        ("decisions held by the policy", "/held/policy", 2),
        ("  by what the lidar sees", "/held/lidar", 2),
        ("  by what the camera sees", "/held/camera", 2),
        ("  by what is remembered", "/held/memory", 2),
        ("  by a contact before", "/held/contact", 2),
        ("  by the floor", "/held/floor", 2),
    ];
    lines.extend(rows.into_iter().filter_map(|(name, at, digits)| row(name, at, digits)));
    let us = |key: &str| number(report, &format!("/decision_us/{key}"));
    if us("n") > 0.0 {
        lines.push(format!("{:<34}{:>9.0}  p99 {:.0} us", "decision, p50", us("p50"), us("p99")));
    }
    lines.join("\n")
}
