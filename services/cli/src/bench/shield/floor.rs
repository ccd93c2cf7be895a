//! The shield with its memory of floor: all that one depth frame of 640x480 costs it.

use std::hint::black_box;
use std::time::Instant;

use guidance::se2::Se2;
use guidance::{
    ActionTable, Beams, DelayedHarness, DepthView, EdgeDistance, Evidence, Footing, HandlerBody, Memory, Shield,
    StepMax,
};
use messages::Pose2;
use serde_json::{Value, json};
use settings::Settings;
use world::Hole;

use super::super::depth::{STEP_M, frames};
use super::{HANDLER_RADIUS_M, Ours, PLACES, ROBOT_RADIUS_M, corridor, handlers, motion};
use crate::bench::Percentiles;
use crate::exit::Failure;
use crate::out;

/// Columns and rows of the frames, and beams of the scan.
const PIXELS: (usize, usize) = (640, 480);
const BEAMS: usize = 1440;
/// How high a step may be that is taken.
const STEP_MAX: StepMax = StepMax { down_m: 0.12, up_m: 0.06 };
/// How far ahead of the first frame a low step is, and by how much its floor lies lower, metres.
const LOW_STEP: (f64, f64) = (2.6, 0.08);
/// Between two frames, nanoseconds.
const FRAME_NS: u64 = 33_000_000;

/// A memory that keeps as the configuration does by default.
fn memory() -> Memory {
    let footing = Footing {
        radius_m: ROBOT_RADIUS_M,
        nose_m: 0.0,
        handler_m: HANDLER_RADIUS_M,
        overrun_m: 0.2,
        overrun_rad: 0.0,
        step_max: STEP_MAX,
    };
    Memory::new(Settings::default().shield.memory.config(Some(footing)))
}

/// Takes frames in one after the other, judges all actions, and remembers. Each part is measured.
pub(super) fn row(times: u32) -> Result<Value, Failure> {
    let step =
        Hole { outline: world::floor::rectangle(Pose2::new(LOW_STEP.0, 0.0, 0.0), 6.0, 2.4), depth_m: LOW_STEP.1 };
    let (frames, (header, ranges), handlers) = (frames(PIXELS.0, PIXELS.1, &[step])?, corridor(BEAMS), handlers());
    let ends: Vec<Se2> = ActionTable::ten().actions().iter().map(|action| action.start_from_end()).collect();
    let harness = DelayedHarness::default();
    let mut shield =
        Shield::new(guidance::ShieldConfig { edges: EdgeDistance { ahead_m: 0.3, beside_m: 0.15 }, ..Ours::config() });
    let (mut beams, mut view, mut memory) = (Beams::default(), DepthView::with_steps(STEP_MAX), memory());
    beams.fill(&header, &ranges).map_err(Failure::of_run)?;
    let mut ns = [const { Vec::new() }; 4];
    let (mut judgements, mut with_step) = (Vec::new(), 0);
    for i in 0..times {
        let (frame, at) = (&frames[i as usize % frames.len()], i as usize % PLACES);
        let body = HandlerBody {
            center: handlers[at].translation.vector.into(),
            radius_m: HANDLER_RADIUS_M,
            mask_radius_m: Some(HANDLER_RADIUS_M + 0.03),
            seen: None,
        };
        // After the last frame the first comes again: the robot goes on and on.
        let odom_from_robot = Se2::translation(STEP_M * f64::from(i), 0.0);
        let began = Instant::now();
        view.fill_tilted(&frame.header, &frame.pixels_mm, Some(&frame.tilt)).map_err(Failure::of_run)?;
        let seen = Instant::now();
        memory.update(u64::from(i) * FRAME_NS, &odom_from_robot, &beams, Some(&view), &body);
        let remembered = Instant::now();
        let motions = ends.iter().map(|end| motion(&harness, &handlers[at], *end));
        let evidence = Evidence { depth: Some(&view), memory: Some(&memory), ..Evidence::scan(&beams) };
        shield.judge_motions(motions, evidence, body, &mut judgements);
        let judged = Instant::now();
        black_box(&judgements);
        with_step += u32::from(!view.steps().is_empty());
        let parts = [seen - began, remembered - seen, judged - remembered, judged - began];
        ns.iter_mut().zip(parts).for_each(|(ns, part)| ns.push(part.as_nanos() as u64));
    }
    let [frame, memory, judging, all] = ns.map(|ns| {
        let of = Percentiles::of(ns).ok_or_else(|| Failure::run("nothing was measured"))?;
        Ok::<_, Failure>(json!({ "n": of.n, "p50": of.p50_us, "p99": of.p99_us }))
    });
    Ok(json!({
        "width": PIXELS.0,
        "height": PIXELS.1,
        "beams": BEAMS,
        "actions": ends.len(),
        "with_step": f64::from(with_step) / f64::from(times.max(1)),
        "frame_us": frame?,
        "memory_us": memory?,
        "judging_us": judging?,
        "all_us": all?,
    }))
}

pub(super) fn line(row: &Value) -> String {
    let us = |part: &str| {
        let [p50, p99] = ["p50", "p99"].map(|share| out::number(row, &format!("/{part}_us/{share}")));
        format!("{p50:.0} ({p99:.0})")
    };
    format!(
        "with floor and a low step (seen in {:.0} % of the frames), a frame of {}x{} and {BEAMS} beams, microseconds, \
         median (99 %): frame {}, memory {}, judging {}, all {}",
        100.0 * out::number(row, "/with_step"),
        PIXELS.0,
        PIXELS.1,
        us("frame"),
        us("memory"),
        us("judging"),
        us("all"),
    )
}
