//! `bench shield`: the shield beside the direct reading of the paper's pseudo-code, in one run, on one core.

mod floor;

use std::hint::black_box;
use std::time::Instant;

use guidance::se2::{Point, Se2, se2};
use guidance::{
    ActionTable, Beams, DelayedHarness, EdgeDistance, Evidence, HandlerBody, Interaction, Judgement, Motion, Reach,
    Shield, ShieldConfig,
};
use messages::{Pose2, ScanHeader};
use parry2d_f64::math::Vector;
use parry2d_f64::query::{Ray, RayCast};
use parry2d_f64::shape::ConvexPolygon;
use serde_json::{Value, json};

use super::Percentiles;
use crate::exit::Failure;
use crate::out::{self, table};
use crate::workers::progress;

const ROBOT_RADIUS_M: f64 = 0.30;
const HANDLER_RADIUS_M: f64 = 0.25;
/// Nav2's collision monitor, a zone and a scan of 360 points, as published, microseconds.
const NAV2_US: f64 = 4450.0;
/// The handler is somewhere else in every measurement, in so many places.
const PLACES: usize = 64;
/// Corners that stand for a disc's edge in the pseudo-code.
const CORNERS: usize = 32;
/// The pseudo-code is slow: it is measured once in this many measurements of ours.
const OURS_FOR_THEIRS: u32 = 20;

/// `guidedog bench shield`.
///
/// # Errors
/// Where the report cannot be written.
pub fn bench(times: u32, as_json: bool) -> Result<(), Failure> {
    let mut rows = Vec::new();
    let tables = [ActionTable::eight(), ActionTable::ten()];
    let cases: Vec<_> = tables.iter().flat_map(|actions| [360, 1440, 3600].map(|beams| (actions, beams))).collect();
    for (actions, beams) in progress(cases.len() as u64, "rows").wrap_iter(cases.into_iter()) {
        rows.push(row(actions, beams, times)?);
    }
    let floor = floor::row(times)?;
    let report = json!({ "rows": rows, "floor": floor, "nav2_published_us": NAV2_US });
    out::tell(as_json, &report, || [lines(&rows), vec![floor::line(&floor)]].concat())
}

/// A corridor of 1.8 m with the robot in its middle, straight on; a bend, people and noise are for the tests.
fn corridor(count: usize) -> (ScanHeader, Vec<f32>) {
    let increment = std::f64::consts::TAU / count as f64;
    let header = ScanHeader {
        angle_min_rad: -std::f64::consts::PI,
        angle_increment_rad: increment,
        range_min_m: 0.15,
        range_max_m: 12.0,
        sigma_m: 0.01,
        ..ScanHeader::default()
    };
    let reading = |i: usize| {
        let angle = -std::f64::consts::PI + i as f64 * increment;
        let wobble = 0.01 * (i as f64 * 1.7).sin();
        ((0.9 / angle.sin().abs().max(1e-6)).min(6.0 / angle.cos().abs().max(1e-6)) + wobble) as f32
    };
    (header, (0..count).map(reading).collect())
}

fn handlers() -> Vec<Se2> {
    (0..PLACES)
        .map(|i| {
            let a = i as f64;
            se2(Pose2::new(-0.8 + 0.1 * (a * 0.9).sin(), -0.3 + 0.15 * (a * 1.3).cos(), 0.2 * a.sin()))
        })
        .collect()
}

fn motion(harness: &DelayedHarness, handler: &Se2, start_from_end: Se2) -> Motion {
    Motion::new(start_from_end, start_from_end * harness.step(handler, &start_from_end))
}

fn row(actions: &ActionTable, count: usize, times: u32) -> Result<Value, Failure> {
    let (header, ranges) = corridor(count);
    let harness = DelayedHarness::default();
    let ends: Vec<Se2> = actions.actions().iter().map(|action| action.start_from_end()).collect();
    let handlers = handlers();
    let mut ours = Ours::new(&header, &ranges)?;
    let (mut ours_ns, mut fill_ns, mut theirs_ns) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..times {
        let handler = handlers[i as usize % PLACES];
        let began = Instant::now();
        ours.fill(&header, &ranges)?;
        fill_ns.push(began.elapsed().as_nanos() as u64);
        let began = Instant::now();
        ours.judge(ends.iter().map(|end| motion(&harness, &handler, *end)), &handler);
        ours_ns.push(began.elapsed().as_nanos() as u64);
        // Both in one run, side by side: a machine that slows down slows both.
        if i.is_multiple_of(OURS_FOR_THEIRS) {
            let began = Instant::now();
            let margins = pseudo_code(&ends, &handler, &harness, ours.beams());
            theirs_ns.push(began.elapsed().as_nanos() as u64);
            black_box(margins);
        }
    }
    let of = |ns| Percentiles::of(ns).ok_or_else(|| Failure::run("nothing was measured"));
    let (ours, fill, theirs) = (of(ours_ns)?, of(fill_ns)?, of(theirs_ns)?);
    Ok(json!({
        "actions": actions.len(),
        "beams": count,
        "ours_us": { "n": ours.n, "p50": ours.p50_us, "p99": ours.p99_us },
        "fill_us": { "n": fill.n, "p50": fill.p50_us, "p99": fill.p99_us },
        "pseudo_code_us": { "n": theirs.n, "p50": theirs.p50_us, "p99": theirs.p99_us },
        "ratio": theirs.p50_us / ours.p50_us.max(0.1),
    }))
}

/// The shield as the runtime uses it.
struct Ours {
    shield: Shield,
    beams: Beams,
    judgements: Vec<Judgement>,
}

impl Ours {
    fn config() -> ShieldConfig {
        ShieldConfig {
            robot_radius_m: ROBOT_RADIUS_M,
            margin_m: 0.0,
            unknown_gap_m: 0.1,
            escape: true,
            unseen_limit_m2: None,
            back_from_edges_m: None,
            reach: Reach::default(),
            edges: EdgeDistance::default(),
        }
    }

    fn new(header: &ScanHeader, ranges: &[f32]) -> Result<Self, Failure> {
        let mut ours = Self { shield: Shield::new(Self::config()), beams: Beams::default(), judgements: Vec::new() };
        ours.fill(header, ranges)?;
        Ok(ours)
    }

    fn fill(&mut self, header: &ScanHeader, ranges: &[f32]) -> Result<(), Failure> {
        self.beams.fill(header, ranges).map_err(Failure::of_run)
    }

    fn judge(&mut self, motions: impl Iterator<Item = Motion>, handler: &Se2) {
        let body = HandlerBody {
            center: Point::from(handler.translation.vector),
            radius_m: HANDLER_RADIUS_M,
            mask_radius_m: Some(HANDLER_RADIUS_M + 0.03),
            seen: None,
        };
        self.shield.judge_motions(motions, Evidence::scan(&self.beams), body, &mut self.judgements);
        black_box(&self.judgements);
    }

    fn beams(&self) -> &Beams {
        &self.beams
    }
}

/// Kim et al. 2023, alg. 1 as it is written: for each action the hull of the four shapes, a ray for each beam, and the
/// least reading minus threshold.
fn pseudo_code(ends: &[Se2], handler: &Se2, harness: &DelayedHarness, beams: &Beams) -> Vec<f64> {
    let circle = |center: Vector, radius_m: f64| {
        (0..CORNERS).map(move |i| {
            let a = std::f64::consts::TAU * i as f64 / CORNERS as f64;
            center + Vector::new(a.cos(), a.sin()) * radius_m
        })
    };
    let center = |pose: &Se2| Vector::new(pose.translation.x, pose.translation.y);
    ends.iter()
        .map(|end| {
            let next = motion(harness, handler, *end);
            let corners: Vec<Vector> = circle(Vector::new(0.0, 0.0), ROBOT_RADIUS_M)
                .chain(circle(center(handler), HANDLER_RADIUS_M))
                .chain(circle(center(&next.robot), ROBOT_RADIUS_M))
                .chain(next.handler.iter().flat_map(|handler| circle(center(handler), HANDLER_RADIUS_M)))
                .collect();
            let Some(hull) = ConvexPolygon::from_convex_hull(&corners) else { return f64::NAN };
            let origin = Vector::new(beams.origin().x, beams.origin().y);
            let margins = beams.beams().iter().map(|beam| {
                let ray = Ray::new(origin, Vector::new(beam.direction.x, beam.direction.y));
                beam.reading_m - hull.cast_local_ray(&ray, 100.0, false).unwrap_or(0.0)
            });
            margins.fold(f64::INFINITY, f64::min)
        })
        .collect()
}

fn lines(rows: &[Value]) -> Vec<String> {
    let cell = |row: &Value, key: &str| format!("{:>9.1}", row.pointer(key).and_then(Value::as_f64).unwrap_or(0.0));
    let whole = |row: &Value, key: &str| format!("{:>7}", row[key].as_u64().unwrap_or(0));
    let lines: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            vec![
                whole(row, "actions"),
                whole(row, "beams"),
                cell(row, "/ours_us/p50"),
                cell(row, "/ours_us/p99"),
                cell(row, "/pseudo_code_us/p50"),
                cell(row, "/pseudo_code_us/p99"),
                cell(row, "/ratio"),
            ]
        })
        .collect();
    let heads = ["actions", "  beams", " ours p50", " ours p99", " alg1 p50", " alg1 p99", "    ratio"];
    let unit = format!("times in microseconds, one core; Nav2's collision monitor publishes {NAV2_US} for 360 points");
    [table(&heads, &lines), vec![unit]].concat()
}
