//! What many episodes say of edges of the floor.

use episodes::{FloorReport, Report, StepCounts};
use serde_json::{Value, json};
use world::DropKind;

use super::outcome::Outcome;
use crate::statistics::{a_km, ratio};

/// An edge across the way was in view for a metre of way where the robot began so far from it, metres.
const IN_VIEW_M: f64 = 1.3;
/// The robot's foremost point stays so far from an edge ahead, metres.
const AHEAD_M: f64 = 0.3;
/// Robot and handler stay so far from an edge beside their way, metres.
const BESIDE_M: f64 = 0.15;

/// Adds the figures of edges to a report.
pub fn add(report: &mut Value, outcomes: &[Outcome]) {
    let reports = || outcomes.iter().map(|outcome| &outcome.report);
    let has_edge = |r: &&Report| !matches!(r.floor.kind, DropKind::None | DropKind::Step);
    let is_plain = |r: &&Report| r.floor.kind == DropKind::None;
    let ahead = || {
        let across = reports().map(|r| &r.floor).filter(|floor| floor.kind == DropKind::Across && floor.before_edge);
        across.filter(|floor| floor.begun_m.is_some_and(|[robot_m, _]| robot_m >= IN_VIEW_M)).filter_map(robot_m)
    };
    let beside = || {
        let platforms = reports().map(|r| &r.floor).filter(|floor| floor.kind == DropKind::Beside);
        // The shield does not place them: who begins nearer does not count.
        let begins_off = |floor: &&FloorReport| nearer_m(floor.begun_m).is_some_and(|begun_m| begun_m >= BESIDE_M);
        platforms.filter(begins_off).filter_map(|floor| nearer_m(floor.to_edge_m))
    };
    let least = |gaps: &mut dyn Iterator<Item = f64>| gaps.min_by(f64::total_cmp);
    let km = reports().map(|r| r.walked_m).sum::<f64>() / 1000.0;
    let stops = |count: fn(&FloorReport) -> u32| a_km(reports().map(|r| count(&r.floor) as usize).sum(), km);
    let plain_km = reports().filter(is_plain).map(|r| r.walked_m).sum::<f64>() / 1000.0;
    let plain = reports().filter(is_plain).map(|r| (r.floor.false_stops - r.floor.dark_stops) as usize).sum();
    let figures = json!({
        "falls": {
            "robot": ratio(reports().map(|r| r.floor.robot_fell)),
            "handler": ratio(reports().map(|r| r.floor.handler_fell)),
        },
        "stood_before_edge": ratio(reports().filter(|r| r.floor.before_edge).map(|r| r.success)),
        "robot_0.3_m_before_edge": ratio(ahead().map(|m| m >= AHEAD_M)),
        "robot_before_edge_min_m": least(&mut ahead()),
        "both_0.15_m_beside_edge": ratio(beside().map(|m| m >= BESIDE_M)),
        "beside_edge_min_m": least(&mut beside()),
        "cue_followed_where_a_way_exists":
            ratio(reports().filter(|r| has_edge(r) && !r.floor.before_edge && !r.to_stand).map(|r| r.success)),
        "stood_where_no_way_exists":
            ratio(reports().filter(|r| has_edge(r) && !r.floor.before_edge && r.to_stand).map(|r| r.success)),
        "cue_followed_with_low_steps":
            ratio(reports().filter(|r| r.floor.kind == DropKind::Step).map(|r| r.success)),
        "low_steps_announced": ratio(reports().flat_map(|r| announced(&r.floor.steps))),
        "false_announcements_per_km": stops(|floor| floor.steps.false_announcements),
        "cue_followed_without_edges": ratio(reports().filter(is_plain).map(|r| r.success)),
        "false_stops_per_km": stops(|floor| floor.false_stops - floor.dark_stops),
        "false_stops_per_km_without_edges": a_km(plain, plain_km),
        "dark_floor_stops_per_km": stops(|floor| floor.dark_stops),
        "floor_unseen_stops_per_km": stops(|floor| floor.unseen_stops),
    });
    if let (Value::Object(report), Value::Object(figures)) = (report, figures) {
        report.extend(figures);
    }
}

/// Of each low step that was taken, whether it was announced before.
fn announced(steps: &StepCounts) -> impl Iterator<Item = bool> {
    let of = |count: u32, was: bool| std::iter::repeat_n(was, count as usize);
    of(steps.announced, true).chain(of(steps.unannounced, false))
}

/// Of robot and handler, the one that is nearer.
fn nearer_m(to_edge_m: Option<[f64; 2]>) -> Option<f64> {
    to_edge_m.map(|[robot_m, handler_m]| robot_m.min(handler_m))
}

fn robot_m(floor: &FloorReport) -> Option<f64> {
    floor.to_edge_m.map(|[robot_m, _]| robot_m)
}
