//! `bench faults`: every fault of every target on the real processes, at random moments of a walk, against the matrix.

mod machine;
pub mod rig;
pub mod table;
pub mod tap;
mod trial;

use std::time::{Duration, Instant};

use messages::fault::{Device, Dice, Fault, Target};
use messages::{MemoryClass, ServiceId, StopKind, TopicId};
use serde_json::{Value, json};
use settings::{LidarSettings, LinkKind, PolicyModel, SimulatedNoise};

use crate::args::FaultsArgs;
use crate::exit::{EXIT_NOT_REACHED, EXIT_OK, Failure};
use crate::out::{self, say, table as columns};
use machine::Pauses;
use rig::Rig;
use table::{Cell, Expect, ON_DDS, cells};
use trial::Outcome;
use unitree::Silence;

/// Whether a service's memory lets it die later than the small ones.
fn is_large(service: ServiceId) -> bool {
    service.spec().is_some_and(|spec| spec.memory == MemoryClass::Large)
}

/// A cell and what came of its trials.
struct Row {
    cell: Cell,
    outcomes: Vec<Outcome>,
}

/// A walk that was to go on is tried so many times.
const TRIES: u32 = 3;

/// `guidedog bench faults`: the exit code.
///
/// # Errors
/// Where no run can be started, or a fault is refused.
pub fn bench(args: &FaultsArgs, as_json: bool) -> Result<u8, Failure> {
    let mut rows: Vec<Row> =
        cells(args.cells.as_deref())?.into_iter().map(|cell| Row { cell, outcomes: Vec::new() }).collect();
    let mut rigs = Rigs { robot: args.robot, rig: None };
    let pauses = Pauses::watch();
    let done = all_trials(&mut rigs, &mut rows, pauses.as_ref(), args);
    rigs.end();
    // Whatever ended the trials, those that were done were done.
    let mut report = report(&rows);
    report["machine"] = json!(pauses.map(|pauses| pauses.json()));
    out::tell(as_json, &report, || lines(&rows, &report))?;
    done.map_err(|failure| Failure { told: as_json, ..failure })?;
    let met = rows.iter().filter(|row| !row.outcomes.is_empty()).all(Row::is_met);
    Ok(if met { EXIT_OK } else { EXIT_NOT_REACHED })
}

/// The run that the next trial is done in: another where the cell wants one of another kind.
struct Rigs {
    /// The link that is asked for, whatever the cell.
    robot: Option<LinkKind>,
    rig: Option<(Kind, Rig)>,
}

/// What kind of run.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Simulated,
    /// The same with the learnt policy, in whose process it is.
    Learnt,
    /// The same with a second lidar, which looks back.
    TwoLidars,
    /// The same on legs, which tell how they hold the body.
    Legged,
    /// With emulated devices, whose robot is commanded so, and does that when nothing more comes.
    Emulated(LinkKind, Silence),
}

impl Rigs {
    fn of(&mut self, cell: &Cell) -> Result<&mut Rig, Failure> {
        let link = self.robot.unwrap_or(LinkKind::Unitree);
        let kind = match (cell.target, cell.fault) {
            // No word reaches it: what it does then is its own affair.
            (Target::Line(Device::Robot), Fault::Unplugged) => Kind::Emulated(link, Silence::Stands),
            (Target::Line(_), _) => Kind::Emulated(link, Silence::HoldsLast),
            (Target::Service(of) | Target::Stream(TopicId::Health, of), _) if ON_DDS.contains(&of) => {
                Kind::Emulated(self.robot.unwrap_or(LinkKind::Go2), Silence::HoldsLast)
            }
            _ if self.robot.is_some() => Kind::Emulated(link, Silence::HoldsLast),
            (Target::Service(ServiceId::Policy), _) => Kind::Learnt,
            (Target::Service(of) | Target::Stream(TopicId::Health, of), _) if of == ServiceId::SecondLidar => {
                Kind::TwoLidars
            }
            (Target::Stream(TopicId::SecondScan, _), _) => Kind::TwoLidars,
            // Where the attitude of the body is not known, the floor cannot tell how the camera is held.
            (_, Fault::Tilted) => Kind::Legged,
            _ => Kind::Simulated,
        };
        if self.rig.as_ref().is_none_or(|(other, _)| *other != kind) {
            self.end();
            let rig = match kind {
                Kind::Simulated => Rig::new()?,
                Kind::Learnt => Rig::with(|settings| settings.policy.model = PolicyModel::Guide)?,
                Kind::TwoLidars => Rig::with(|settings| settings.lidar.second = Some(Box::new(looking_back())))?,
                Kind::Legged => Rig::with(|settings| settings.simulation.noise = SimulatedNoise::Legged)?,
                Kind::Emulated(link, silence) => Rig::emulated(link, silence)?,
            };
            self.rig = Some((kind, rig));
        }
        // It is there by now.
        self.rig.as_mut().map(|(_, rig)| rig).ok_or_else(|| Failure::run("there is no run"))
    }

    fn end(&mut self) {
        if let Some((_, mut rig)) = self.rig.take() {
            rig.end();
        }
    }
}

/// A second lidar that looks back.
fn looking_back() -> LidarSettings {
    let behind = messages::Pose2::new(-0.2, 0.0, std::f64::consts::PI);
    LidarSettings { robot_from_lidar: behind, ..LidarSettings::default() }
}

/// Every cell once, then every cell again, so that a budget that runs out has met all of them alike.
fn all_trials(rigs: &mut Rigs, rows: &mut [Row], pauses: Option<&Pauses>, args: &FaultsArgs) -> Result<(), Failure> {
    let until = args.budget_s.map(|seconds| Instant::now() + Duration::from_secs(seconds));
    let mut dice = Dice::new(args.seed);
    for round in 0..args.repeat {
        for row in rows.iter_mut() {
            if until.is_some_and(|until| Instant::now() >= until) {
                return Ok(());
            }
            let rig = rigs.of(&row.cell)?;
            let mut outcome = trial::run(rig, &row.cell, &mut dice, args.slack)?;
            for _ in 1..TRIES {
                if !is_tried_again(&row.cell, &outcome, args.slack) {
                    break;
                }
                outcome = trial::run(rig, &row.cell, &mut dice, args.slack)?;
            }
            if let Some(why) = &outcome.unmet {
                let reasons: Vec<&str> = outcome.reasons.iter().copied().map(StopKind::name).collect();
                let name = row.cell.name();
                say(format!("{name}, trial {}: {why} (stood for: {})", round + 1, reasons.join(", ")));
                if let Some(ms) = pauses.and_then(|pauses| pauses.longest_ms(outcome.struck_ns, outcome.zero_ns()?)) {
                    say(format!("  the machine itself paused for {ms:.1} ms then"));
                }
                say(format!("  wanted: {}, since {}", row.cell.expect.name(), row.cell.why));
            }
            row.outcomes.push(outcome);
        }
    }
    Ok(())
}

/// A walk that was to go on and stood for its way is tried again; where others load the machine, whatever it stood for.
fn is_tried_again(cell: &Cell, outcome: &Outcome, slack: f64) -> bool {
    cell.expect == Expect::None && outcome.unmet.is_some() && (outcome.is_of_its_way() || slack > 1.0)
}

impl Cell {
    fn name(&self) -> String {
        format!("{}:{}", self.target, self.fault.name())
    }
}

impl Row {
    fn is_met(&self) -> bool {
        !self.outcomes.is_empty() && self.outcomes.iter().all(|outcome| outcome.unmet.is_none())
    }

    fn figures(&self, what: impl Fn(&Outcome) -> Option<f64>) -> Value {
        let quantiles = Quantiles::of(self.outcomes.iter().filter_map(what).collect());
        json!({ "p50": quantiles.at(0.5), "p99": quantiles.at(0.99), "max": quantiles.at(1.0) })
    }

    fn json(&self) -> Value {
        let why = |outcome: &Outcome| {
            let reasons: Vec<&str> = outcome.reasons.iter().map(|reason| reason.name()).collect();
            outcome.unmet.as_ref().map(|why| json!({ "why": why, "stood_by": reasons }))
        };
        json!({
            "target": self.cell.target.to_string(), "fault": self.cell.fault.name(),
            "expect": self.cell.expect.name(), "stays": self.cell.stays, "n": self.outcomes.len(), "met": self.is_met(),
            "stop_ms": self.figures(|o| o.stop_ms), "standstill_m": self.figures(|o| o.standstill_m),
            "recovery_ms": self.figures(|o| o.recovery_ms),
            "unmet": self.outcomes.iter().filter_map(why).collect::<Vec<Value>>(),
        })
    }

    /// The service whose deaths the row is about.
    fn killed(&self) -> Option<ServiceId> {
        match self.cell.target {
            // The world's end is nobody's stop, and that of the recorder is none.
            Target::Service(ServiceId::Simulator | ServiceId::Recorder) => None,
            Target::Service(service) if self.cell.fault == Fault::Kill => Some(service),
            _ => None,
        }
    }
}

/// Values in their order.
struct Quantiles(Vec<f64>);

impl Quantiles {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_unstable_by(f64::total_cmp);
        Self(values)
    }

    /// By nearest rank, to a thousandth; none of none.
    fn at(&self, q: f64) -> Option<f64> {
        let rank = ((q * self.0.len() as f64).ceil() as usize).clamp(1, self.0.len().max(1)) - 1;
        self.0.get(rank).map(|value| (value * 1000.0).round() / 1000.0)
    }
}

fn pooled(rows: &[Row], is_meant: impl Fn(ServiceId) -> bool) -> Value {
    let deaths = rows.iter().filter(|row| row.killed().is_some_and(&is_meant));
    let stops: Vec<f64> = deaths.flat_map(|row| row.outcomes.iter().filter_map(|outcome| outcome.stop_ms)).collect();
    let (n, quantiles) = (stops.len(), Quantiles::of(stops));
    json!({
        "n": n, "p50": quantiles.at(0.5), "p99": quantiles.at(0.99), "p999": quantiles.at(0.999),
        "max": quantiles.at(1.0),
    })
}

fn report(rows: &[Row]) -> Value {
    json!({
        "cells": rows.iter().map(Row::json).collect::<Vec<Value>>(),
        "kills": pooled(rows, |service| !is_large(service)),
        "kills_large": pooled(rows, is_large),
    })
}

fn lines(rows: &[Row], report: &Value) -> Vec<String> {
    let row = |row: &Row| {
        let figure = |value: Value, places: usize| match (value["p50"].as_f64(), value["max"].as_f64()) {
            (Some(p50), Some(max)) => format!("{p50:.places$} / {max:.places$}"),
            _ => "-".to_owned(),
        };
        let met = row.outcomes.iter().filter(|outcome| outcome.unmet.is_none()).count();
        vec![
            row.cell.name(),
            row.cell.expect.name().to_owned(),
            format!("{met} of {}", row.outcomes.len()),
            figure(row.figures(|o| o.stop_ms), 1),
            figure(row.figures(|o| o.standstill_m), 3),
            figure(row.figures(|o| o.recovery_ms), 0),
        ]
    };
    let head = ["cell", "expect", "met", "stop, ms", "standstill, m", "recovery, ms"];
    let mut lines = columns(&head, &rows.iter().map(row).collect::<Vec<_>>());
    lines.push("stop, standstill and recovery: half of the trials / all of them".to_owned());
    for (name, what) in [("kills", "small services"), ("kills_large", "depth and policy")] {
        let pool = &report[name];
        lines.push(format!(
            "{} deaths of {what}: p50 {} ms, p99 {} ms, p99.9 {} ms, max {} ms",
            pool["n"], pool["p50"], pool["p99"], pool["p999"], pool["max"]
        ));
    }
    let machine = &report["machine"];
    if machine.is_object() {
        let (n, max) = (&machine["pauses_over_1_ms"], machine["max_ms"].as_f64().unwrap_or(0.0));
        lines.push(format!("the machine itself: {n} pauses of over 1 ms, {max:.1} ms at most"));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::{Row, pooled, report, trial::Outcome};
    use crate::bench::faults::table::cells;

    #[test]
    fn the_report_pools_the_deaths_of_small_and_large_services_apart() {
        let outcome = |ms: f64| Outcome { stop_ms: Some(ms), ..Outcome::default() };
        let rows: Vec<Row> = cells(Some("*:kill,lidar/scan:off"))
            .expect("they are there")
            .into_iter()
            .map(|cell| Row { outcomes: vec![outcome(1.0), outcome(2.5)], cell })
            .collect();
        let report = report(&rows);
        assert_eq!(report["cells"].as_array().map(Vec::len), Some(15));
        assert_eq!((&report["kills"]["n"], &report["kills_large"]["n"]), (&20.into(), &4.into()));
        assert_eq!(report["kills"]["max"], 2.5);
        assert_eq!(report["cells"][0]["stop_ms"]["p50"], 1.0);
        assert!(pooled(&[], |_| true)["p50"].is_null());
    }
}
