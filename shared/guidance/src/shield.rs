//! The action shield (Kim et al. 2023, section 5 and alg. 1) with the resolutions of the design contract: unknown
//! beams, the handler's own beams, the escape rule, virtual beams from depth.

use messages::{MAX_ACTIONS, Twist2};

use crate::action::ActionTable;
use crate::depth::DepthView;
use crate::handler::HandlerEstimate;
use crate::hull::{Disc, Hull};
use crate::interaction::{Interaction, place};
use crate::scan::{Beam, BeamKind, Beams};
use crate::se2::{Point, Se2, exp, log};

/// An action's hull reaches beyond the present one where its threshold is greater by more than this, metres.
const BEYOND_M: f64 = 1e-3;
/// Parts of a motion at which the escape rule looks.
const ESCAPE_STEPS: u32 = 8;
/// Getting closer by less than this is rounding, metres.
const CLOSER_M: f64 = 1e-6;

/// How the shield judges.
#[derive(Debug, Clone, PartialEq)]
pub struct ShieldConfig {
    /// Radius of the disc that stands for the robot, metres.
    pub robot_radius_m: f64,
    /// Added to both radii, metres.
    pub margin_m: f64,
    /// A run of unknown beams wider than this is unsafe, metres.
    pub unknown_gap_m: f64,
    /// Whether points inside the present hull are judged by the escape rule; off is the paper's algorithm.
    pub escape: bool,
    /// Largest unseen part of the hull, square metres; `None`: it makes nothing unsafe by itself.
    pub unseen_limit_m2: Option<f64>,
}

/// A motion of robot and handler, from the robot's present frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The robot at the end.
    pub robot: Se2,
    /// The handler at the end.
    pub handler: Se2,
}

/// What the shield found about one motion, and by which beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// Whether the swept hull is free.
    pub safe: bool,
    /// Smallest reading minus threshold over the judged beams, metres; infinite where no beam is judged.
    pub margin_m: f64,
    /// The beam with that margin.
    pub beam: Option<usize>,
    /// Its reading, metres.
    pub reading_m: f64,
    /// Its threshold, metres.
    pub threshold_m: f64,
    /// Part of the hull that no beam sees, square metres.
    pub unseen_area_m2: f64,
}

/// Probabilities after suppression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suppressed {
    /// One for each action of the table; they sum to 1.
    pub probabilities: [f64; MAX_ACTIONS],
    /// Whether every action was unsafe.
    pub all_unsafe: bool,
}

/// How one of the actions is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Draw {
    /// The most probable one; the first of equals.
    ArgMax,
    /// By the probabilities, from a generator keyed by run seed and decision.
    Seeded(u64),
}

/// The shield. It keeps nothing but its scratch space.
#[derive(Debug, Clone)]
pub struct Shield {
    config: ShieldConfig,
    present_thresholds_m: Vec<f64>,
}

/// What all motions from one moment have in common.
struct Present<'a> {
    beams: &'a Beams,
    depth: Option<&'a DepthView>,
    handler: &'a HandlerEstimate,
    robot_disc: Disc,
    handler_disc: Disc,
    hull: Hull,
}

impl Shield {
    /// A shield that judges so.
    #[must_use]
    pub fn new(config: ShieldConfig) -> Self {
        Self { config, present_thresholds_m: Vec::new() }
    }

    /// Where an action of `start_from_end` leads to when it begins now (Kim et al. 2023, alg. 1 line 5).
    #[must_use]
    pub fn predict(handler: &HandlerEstimate, start_from_end: &Se2) -> Motion {
        let after = handler.model().step(handler.robot_from_handler(), start_from_end);
        Motion { robot: *start_from_end, handler: start_from_end * after }
    }

    /// Judges every action of a table, beginning now (Kim et al. 2023, alg. 1 lines 2-11): bit *i* of the mask is set
    /// where action *i* is unsafe; `judgements` has one row for each.
    pub fn judge_actions(
        &mut self,
        table: &ActionTable,
        beams: &Beams,
        depth: Option<&DepthView>,
        handler: &HandlerEstimate,
        judgements: &mut Vec<Judgement>,
    ) -> u32 {
        judgements.clear();
        let mut mask = 0;
        for (i, action) in table.actions().iter().enumerate() {
            let motion = Self::predict(handler, &action.start_from_end());
            let judgement = self.judge(&motion, beams, depth, handler);
            mask |= u32::from(!judgement.safe) << i;
            judgements.push(judgement);
        }
        mask
    }

    /// Judges one motion on one scan.
    pub fn judge(
        &mut self,
        motion: &Motion,
        beams: &Beams,
        depth: Option<&DepthView>,
        handler: &HandlerEstimate,
    ) -> Judgement {
        let present = self.present(beams, depth, handler);
        let end = |pose: &Se2, disc: &Disc| Disc { center: place(pose), radius_m: disc.radius_m };
        let swept = Hull::new([
            present.robot_disc,
            present.handler_disc,
            end(&motion.robot, &present.robot_disc),
            end(&motion.handler, &present.handler_disc),
        ]);
        let origin = beams.origin();
        self.present_thresholds_m.clear();
        self.present_thresholds_m
            .extend(beams.beams().iter().map(|beam| present.hull.threshold_m(origin, beam.direction)));
        let mut judgement = Judgement {
            safe: true,
            margin_m: f64::INFINITY,
            beam: None,
            reading_m: 0.0,
            threshold_m: 0.0,
            unseen_area_m2: 0.0,
        };
        let mut run = UnknownRun::default();
        let mut seen_rad = 0.0;
        for (i, beam) in beams.beams().iter().enumerate() {
            let threshold = swept.threshold_m(origin, beam.direction);
            self.judge_beam(i, beam, threshold, motion, &present, &mut judgement);
            run.take(&self.config, beam, threshold, self.present_thresholds_m[i], &present, &mut judgement);
            seen_rad += beams.increment_rad();
        }
        run.close(&self.config, beams, &mut judgement);
        if let Some(depth) = depth {
            self.judge_points(depth.points(), &swept, motion, &present, &mut judgement);
        }
        // What lies outside the field of view is seen by no beam.
        judgement.unseen_area_m2 += unseen_outside(&swept, beams, seen_rad);
        if self.config.unseen_limit_m2.is_some_and(|limit| judgement.unseen_area_m2 > limit) {
            judgement.safe = false;
        }
        judgement
    }

    fn present<'a>(&self, beams: &'a Beams, depth: Option<&'a DepthView>, handler: &'a HandlerEstimate) -> Present<'a> {
        let robot_disc = Disc { center: Point::origin(), radius_m: self.config.robot_radius_m + self.config.margin_m };
        let handler_disc =
            Disc { center: place(handler.robot_from_handler()), radius_m: handler.radius_m() + self.config.margin_m };
        let hull = Hull::new([robot_disc, handler_disc, robot_disc, handler_disc]);
        Present { beams, depth, handler, robot_disc, handler_disc, hull }
    }

    /// Kim et al. 2023, alg. 1 line 8: a reading less than its threshold is unsafe.
    fn judge_beam(
        &self,
        i: usize,
        beam: &Beam,
        threshold_m: f64,
        motion: &Motion,
        present: &Present<'_>,
        judgement: &mut Judgement,
    ) {
        if beam.kind == BeamKind::Unknown {
            return;
        }
        let increment = present.beams.increment_rad();
        let masked = beam.kind == BeamKind::Hit && present.handler.masks(beam.end, present.beams.sigma_m());
        let reading = beam.reading_m.min(threshold_m);
        judgement.unseen_area_m2 += (threshold_m * threshold_m - reading * reading) / 2.0 * increment;
        if masked {
            return;
        }
        let margin = beam.reading_m - threshold_m;
        if margin < 0.0 && self.config.escape && present.hull.contains(beam.end) {
            if gets_closer(beam.end, motion, present) {
                judgement.note(margin, i, beam.reading_m, threshold_m);
                judgement.safe = false;
            }
            return;
        }
        judgement.note(margin, i, beam.reading_m, threshold_m);
        judgement.safe &= margin >= 0.0;
    }

    /// Virtual beams from the depth frame: points strictly inside the hull.
    fn judge_points(
        &self,
        points: &[Point],
        swept: &Hull,
        motion: &Motion,
        present: &Present<'_>,
        judgement: &mut Judgement,
    ) {
        for point in points {
            if !swept.contains(*point) || present.handler.masks(*point, present.beams.sigma_m()) {
                continue;
            }
            if self.config.escape && present.hull.contains(*point) && !gets_closer(*point, motion, present) {
                continue;
            }
            judgement.safe = false;
            judgement.margin_m = judgement.margin_m.min(swept.signed_distance_m(*point));
        }
    }

    /// Where the running action leads to from now: what is left of it, and one scan period more at the same velocity.
    #[must_use]
    pub fn remainder(
        handler: &HandlerEstimate,
        odom_from_robot: &Se2,
        velocity: Twist2,
        left_s: f64,
        end_fraction: f64,
    ) -> Motion {
        let now_from_end = exp(velocity, left_s);
        let after = handler.ahead(odom_from_robot, &now_from_end, end_fraction);
        Motion { robot: now_from_end, handler: now_from_end * after }
    }
}

impl Judgement {
    fn note(&mut self, margin_m: f64, beam: usize, reading_m: f64, threshold_m: f64) {
        if margin_m < self.margin_m {
            *self = Self { margin_m, beam: Some(beam), reading_m, threshold_m, ..*self };
        }
    }
}

/// Whether a point comes closer to either disc along the motion: the escape rule allows only what does not.
fn gets_closer(point: Point, motion: &Motion, present: &Present<'_>) -> bool {
    let (robot, handler) = (present.robot_disc.center, present.handler_disc.center);
    let twist = log(&motion.robot, 1.0);
    let way = place(&motion.handler) - handler;
    let (mut to_robot, mut to_handler) = ((point - robot).norm(), (point - handler).norm());
    (1..=ESCAPE_STEPS).any(|i| {
        let share = f64::from(i) / f64::from(ESCAPE_STEPS);
        let next_robot = (point - place(&exp(twist, share))).norm();
        let next_handler = (point - (handler + way * share)).norm();
        let closer = next_robot < to_robot - CLOSER_M || next_handler < to_handler - CLOSER_M;
        (to_robot, to_handler) = (next_robot, next_handler);
        closer
    })
}

/// A run of unknown beams within the part of the hull that is beyond the present one.
#[derive(Debug, Default)]
struct UnknownRun {
    beams: usize,
    threshold_m: f64,
    /// The run that began with the very first beam, for a lidar that sees all around.
    first: Option<(usize, f64)>,
    began_at_first: bool,
    started: bool,
}

impl UnknownRun {
    fn take(
        &mut self,
        config: &ShieldConfig,
        beam: &Beam,
        threshold_m: f64,
        present_m: f64,
        present: &Present<'_>,
        judgement: &mut Judgement,
    ) {
        let first = !self.started;
        self.started = true;
        if beam.kind == BeamKind::Unknown {
            judgement.unseen_area_m2 += threshold_m * threshold_m / 2.0 * present.beams.increment_rad();
        }
        let counts = beam.kind == BeamKind::Unknown
            && threshold_m > present_m + BEYOND_M
            && !seen_by_depth(present, beam, threshold_m, present_m);
        if counts {
            self.began_at_first |= first;
            self.beams += 1;
            self.threshold_m = self.threshold_m.max(threshold_m);
        } else {
            self.end(config, present.beams, judgement);
        }
    }

    fn end(&mut self, config: &ShieldConfig, beams: &Beams, judgement: &mut Judgement) {
        if self.began_at_first && self.first.is_none() {
            self.first = Some((self.beams, self.threshold_m));
        }
        self.began_at_first = false;
        judgement.safe &= !is_gap(config, beams, self.beams, self.threshold_m);
        (self.beams, self.threshold_m) = (0, 0.0);
    }

    /// The last run of a whole turn goes on in the first.
    fn close(&mut self, config: &ShieldConfig, beams: &Beams, judgement: &mut Judgement) {
        if beams.is_whole_turn()
            && let Some((count, threshold)) = self.first
        {
            self.beams += count;
            self.threshold_m = self.threshold_m.max(threshold);
        }
        self.end(config, beams, judgement);
    }
}

fn is_gap(config: &ShieldConfig, beams: &Beams, count: usize, threshold_m: f64) -> bool {
    let half = (count as f64 * beams.increment_rad() / 2.0).min(std::f64::consts::FRAC_PI_2);
    count > 0 && 2.0 * threshold_m * half.sin() > config.unknown_gap_m
}

fn seen_by_depth(present: &Present<'_>, beam: &Beam, threshold_m: f64, present_m: f64) -> bool {
    present.depth.is_some_and(|depth| {
        let at = |t: f64| present.beams.origin() + beam.direction * t;
        depth.sees_free(at(threshold_m)) && depth.sees_free(at((threshold_m + present_m) / 2.0))
    })
}

/// Area of the hull in directions that the lidar does not cover, square metres.
fn unseen_outside(swept: &Hull, beams: &Beams, seen_rad: f64) -> f64 {
    let rest = std::f64::consts::TAU - seen_rad;
    let Some(last) = beams.beams().last().filter(|_| rest > beams.increment_rad() / 2.0) else { return 0.0 };
    // The beams turn one way; the rest of the circle follows the last one.
    let first = beams.beams()[0].direction;
    let turns_left = beams.beams().get(1).is_none_or(|second| first.perp(&second.direction) > 0.0);
    let steps = (rest / beams.increment_rad().max(0.01)).ceil() as usize;
    let step = rest / steps as f64 * if turns_left { 1.0 } else { -1.0 };
    let start = last.direction.y.atan2(last.direction.x);
    (0..steps)
        .map(|i| {
            let angle = start + step * (i as f64 + 0.5);
            let threshold = swept.threshold_m(beams.origin(), nalgebra::Vector2::new(angle.cos(), angle.sin()));
            threshold * threshold / 2.0 * step.abs()
        })
        .sum()
}

/// Multiplies the probabilities of unsafe actions by `beta` and normalises (Kim et al. 2023, alg. 1 lines 8-12). Where
/// every action is unsafe, beta 0 gives stop for certain, any other beta the probabilities as they were.
#[must_use]
pub fn suppress(probabilities: &[f64], unsafe_mask: u32, beta: f64) -> Suppressed {
    let count = probabilities.len().min(MAX_ACTIONS);
    let is_unsafe = |i: usize| unsafe_mask >> i & 1 == 1;
    let all_unsafe = (0..count).all(is_unsafe);
    let mut out = [0.0; MAX_ACTIONS];
    for i in 0..count {
        out[i] = probabilities[i] * if is_unsafe(i) && !all_unsafe { beta } else { 1.0 };
    }
    let sum: f64 = out.iter().sum();
    if (all_unsafe && beta == 0.0) || sum <= 0.0 {
        out = [0.0; MAX_ACTIONS];
        out[ActionTable::STOP] = 1.0;
    } else {
        out.iter_mut().for_each(|p| *p /= sum);
    }
    Suppressed { probabilities: out, all_unsafe }
}

/// Chooses an action of decision `n`.
#[must_use]
pub fn choose(probabilities: &[f64], draw: Draw, decision: u64) -> usize {
    match draw {
        Draw::ArgMax => {
            let mut best = ActionTable::STOP;
            for (i, p) in probabilities.iter().enumerate() {
                if *p > probabilities[best] {
                    best = i;
                }
            }
            best
        }
        Draw::Seeded(seed) => {
            let mut left = uniform(seed, decision);
            for (i, p) in probabilities.iter().enumerate() {
                left -= p;
                if left < 0.0 {
                    return i;
                }
            }
            ActionTable::STOP
        }
    }
}

/// A number in [0, 1) that depends on seed and counter alone (the finaliser of SplitMix64), so that a restarted shield
/// draws the same.
fn uniform(seed: u64, counter: u64) -> f64 {
    let mut z = seed.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    for (shift, factor) in [(30, 0xbf58_476d_1ce4_e5b9), (27, 0x94d0_49bb_1331_11eb)] {
        z = (z ^ (z >> shift)).wrapping_mul(factor);
    }
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests;
