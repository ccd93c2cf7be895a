//! The action shield (Kim et al. 2023, section 5 and alg. 1) with the resolutions of the design contract: unknown
//! beams, the handler's own beams, the escape rule, virtual beams from depth, obstacle memory.

mod judging;

use messages::{MAX_ACTIONS, Pose2, Twist2, UnsafeCause};
use nalgebra::Vector2;

use crate::action::{Action, ActionTable};
use crate::depth::DepthView;
use crate::handler::{HandlerBody, HandlerEstimate};
use crate::hull::Discs;
use crate::interaction::{Interaction, InteractionModel, place};
use crate::memory::Memory;
use crate::scan::Beams;
use crate::se2::{Point, Se2, exp, se2};
use crate::second::SecondView;
use crate::seed::mixed;
use judging::{Present, Sorted};

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
    /// A motion that leads back stays so far from every edge and step of the floor, metres, leads over floor alone that
    /// was seen or trodden, and to no handler who stands. None: it is judged as any other.
    pub back_from_edges_m: Option<f64>,
    /// Shape of the robot, and where robot and handler come to rest.
    pub reach: Reach,
    /// How far it keeps from an edge.
    pub edges: EdgeDistance,
}

/// How far the hull of a motion stays from an edge of the floor. Within 60 degrees of the way an edge is ahead; from
/// there to abeam the distance falls.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EdgeDistance {
    /// From one that the robot goes towards, metres.
    pub ahead_m: f64,
    /// From one beside its way or behind it, metres.
    pub beside_m: f64,
}

/// Shape of the robot, and where robot and handler come to rest after a stop. The default is one disc that stands at
/// once.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Reach {
    /// Two discs stand for the body, so far ahead of its middle and behind it, metres; 0 is one disc.
    pub nose_m: f64,
    /// A robot is carried on by what it moved before, for so long at that velocity: along its axis, across it, and in a
    /// turn, seconds.
    pub carried_s: [f64; 3],
    /// Where the handler comes to rest (robot frame). None: the hull ends with the motion.
    pub robot_from_rest: Option<Se2>,
    /// Before they come to rest, the handler walks on for so long at the robot's speed ahead, seconds: beyond where
    /// they come to rest, and back. It counts where they come to rest at all.
    pub walks_on_s: f64,
}

impl Reach {
    /// Where a robot is carried that moves so when the next command comes. It begins that command as much later as it
    /// overruns the stop after it, so that it comes to rest where the command leads from there.
    #[must_use]
    pub fn carries_to(&self, moves: &Twist2) -> Se2 {
        let [ahead_s, aside_s, turn_s] = self.carried_s;
        se2(Pose2::new(moves.vx_mps * ahead_s, moves.vy_mps * aside_s, moves.wz_radps * turn_s))
    }

    /// How far the handler comes before they go back to rest, where the robot moves so when it stops (robot frame).
    #[must_use]
    pub fn walks_on(&self, moves: &Twist2) -> Option<Point> {
        let ahead_m = moves.vx_mps * self.walks_on_s;
        let rest = self.robot_from_rest.filter(|_| ahead_m > 0.0)?;
        Some(place(&rest) + Vector2::new(ahead_m, 0.0))
    }
}

/// What a moment is judged on, all seen from where the robot is now.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// The newest scan.
    pub beams: &'a Beams,
    /// The newest depth frame, where it may be judged on.
    pub depth: Option<&'a DepthView>,
    /// The newest scan of the second lidar, where there is one.
    pub second: Option<&'a SecondView>,
    /// What was seen before; none is the paper's algorithm.
    pub memory: Option<&'a Memory>,
    /// How the robot moves, as it was commanded (robot frame).
    pub moves: Twist2,
}

impl<'a> Evidence<'a> {
    /// One scan and nothing else, as in the paper.
    #[must_use]
    pub fn scan(beams: &'a Beams) -> Self {
        Self { beams, depth: None, second: None, memory: None, moves: Twist2::ZERO }
    }
}

/// A motion of robot and handler, from the robot's present frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The robot at the end.
    pub robot: Se2,
    /// The handler at the end; none: the robot is alone.
    pub handler: Option<Se2>,
}

impl Motion {
    /// A motion to its end.
    #[must_use]
    pub fn new(robot: Se2, handler: Se2) -> Self {
        Self { robot, handler: Some(handler) }
    }

    /// The motion of a robot that walks alone.
    #[must_use]
    pub fn alone(robot: Se2) -> Self {
        Self { robot, handler: None }
    }
}

/// What the shield found about one motion, and by which beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// Whether the swept hull is free.
    pub safe: bool,
    /// The first cause for which it is not.
    pub cause: UnsafeCause,
    /// Smallest reading minus threshold over the judged beams, metres; infinite where no beam is judged. A point that
    /// lies deeper in the hull counts with its depth.
    pub margin_m: f64,
    /// The beam with that margin, by the lidar's own number; none where it is a point's.
    pub beam: Option<usize>,
    /// Its reading, metres.
    pub reading_m: f64,
    /// Its threshold, metres. Of an edge, the distance that is kept from it; its reading is the hull's.
    pub threshold_m: f64,
    /// The place that makes it unsafe, where a point does (robot frame).
    pub place: Option<Point>,
    /// How much the floor rises there by a step, metres; less than 0: it falls. 0 where the cause is no step.
    pub step_m: f64,
    /// It leads over floor that was not seen and is assumed.
    pub assumes_floor: bool,
    /// Part of the hull that no beam sees, square metres: behind what beams end on, masked, unknown, outside the
    /// field of view.
    pub unseen_area_m2: f64,
}

impl Default for Judgement {
    /// Nothing is in the way.
    fn default() -> Self {
        Self {
            safe: true,
            cause: UnsafeCause::None,
            margin_m: f64::INFINITY,
            beam: None,
            reading_m: 0.0,
            threshold_m: 0.0,
            place: None,
            step_m: 0.0,
            assumes_floor: false,
            unseen_area_m2: 0.0,
        }
    }
}

impl Judgement {
    /// The floor at a place forbids it: it is so far from the hull, and so much is needed, metres.
    fn forbid_floor(&mut self, cause: UnsafeCause, place: Point, away_m: f64, needed_m: f64) {
        if self.safe {
            (self.beam, self.place, self.step_m) = (None, Some(place), 0.0);
            (self.reading_m, self.threshold_m, self.margin_m) = (away_m, needed_m, away_m - needed_m);
        }
        self.forbid(cause);
    }

    fn forbid(&mut self, cause: UnsafeCause) {
        if self.safe {
            (self.safe, self.cause) = (false, cause);
        }
    }
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
    /// The most probable one; where that is to stop, by the probabilities: who stands sees the same again and again,
    /// and would stand for good.
    Surest(u64),
}

/// What a shield has had to do so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Work {
    /// Motions that it judged: each has a hull, whose boundary all beams are held against.
    pub motions: u64,
    /// Places that it looked at for each motion: what the camera sees, what is remembered, edges, steps and floor that
    /// was not seen. For a step back it looks at some of them twice.
    pub places: u64,
    /// Those of them that it held against the motion's hull.
    pub held: u64,
}

/// The shield. It keeps nothing but its scratch space, and counts its work.
#[derive(Debug, Clone)]
pub struct Shield {
    config: ShieldConfig,
    sorted: Sorted,
}

impl Shield {
    /// A shield that judges so.
    #[must_use]
    pub fn new(config: ShieldConfig) -> Self {
        Self { config, sorted: Sorted::with_room() }
    }

    /// What it has had to do so far.
    #[must_use]
    pub fn work(&self) -> Work {
        self.sorted.work
    }

    /// The handler comes to rest where that model leads them, if the hull holds their rest at all.
    pub fn take_place(&mut self, model: &InteractionModel) {
        let rest = &mut self.config.reach.robot_from_rest;
        *rest = rest.map(|_| model.robot_from_default());
    }

    /// Where an action of `start_from_end` leads to when it begins now (Kim et al. 2023, alg. 1 line 5).
    #[must_use]
    pub fn predict(handler: &HandlerEstimate, start_from_end: &Se2) -> Motion {
        let after = handler.model().step(handler.robot_from_handler(), start_from_end);
        Motion::new(*start_from_end, start_from_end * after)
    }

    /// Judges every action of a table, beginning now (Kim et al. 2023, alg. 1 lines 2-11): bit *i* of the mask is set
    /// where action *i* is unsafe; `judgements` has one row for each.
    pub fn judge_actions(
        &mut self,
        table: &ActionTable,
        evidence: Evidence<'_>,
        handler: &HandlerEstimate,
        judgements: &mut Vec<Judgement>,
    ) -> u32 {
        let motions = table.actions().iter().map(|action| Self::predict(handler, &action.start_from_end()));
        self.judge_motions(motions, evidence, handler.body(evidence.beams.sigma_m()), judgements);
        unsafe_mask(judgements)
    }

    /// The same for a robot that walks alone.
    pub fn judge_actions_alone(
        &mut self,
        table: &ActionTable,
        evidence: Evidence<'_>,
        judgements: &mut Vec<Judgement>,
    ) -> u32 {
        let motions = table.actions().iter().map(|action| Motion::alone(action.start_from_end()));
        self.judge_motions(motions, evidence, None, judgements);
        unsafe_mask(judgements)
    }

    /// Judges motions that begin now, all on one scan: one row of `judgements` for each. Without a handler the robot
    /// walks alone.
    pub fn judge_motions(
        &mut self,
        motions: impl Iterator<Item = Motion>,
        evidence: Evidence<'_>,
        handler: impl Into<Option<HandlerBody>>,
        judgements: &mut Vec<Judgement>,
    ) {
        judgements.clear();
        let mut present = Present::prepare(&self.config, evidence, handler.into(), &mut self.sorted);
        judgements.extend(motions.map(|motion| present.judge(&motion)));
    }

    /// Judges one motion on one scan.
    pub fn judge(&mut self, motion: &Motion, evidence: Evidence<'_>, handler: &HandlerEstimate) -> Judgement {
        let body = Some(handler.body(evidence.beams.sigma_m()));
        Present::prepare(&self.config, evidence, body, &mut self.sorted).judge(motion)
    }

    /// The thresholds of one motion, metres, in the lidar's own order of beams (Kim et al. 2023, alg. 1 line 7).
    #[must_use]
    pub fn thresholds_m(&mut self, motion: &Motion, beams: &Beams, handler: HandlerBody) -> Vec<f64> {
        let thresholds_m =
            Present::prepare(&self.config, Evidence::scan(beams), Some(handler), &mut self.sorted).thresholds_m(motion);
        let mut ordered = vec![0.0; thresholds_m.len()];
        for (beam, threshold_m) in thresholds_m.into_iter().enumerate() {
            ordered[beams.number_of(beam)] = threshold_m;
        }
        ordered
    }

    /// The discs whose hull has to be free for a motion of a robot that moves so when it begins, robot frame, the
    /// margin included: robot and handler as they are, then where they come to rest, and what lies between.
    #[must_use]
    pub fn swept(&mut self, motion: &Motion, moves: Twist2, handler: HandlerBody) -> Discs {
        let nothing = Beams::default();
        let evidence = Evidence { moves, ..Evidence::scan(&nothing) };
        Present::prepare(&self.config, evidence, Some(handler), &mut self.sorted).discs(motion)
    }

    /// Where the running action leads to from now: what is left of it, and one scan period more at the same velocity.
    #[must_use]
    pub fn remainder(handler: &HandlerEstimate, odom_from_robot: &Se2, velocity: Twist2, left_s: f64) -> Motion {
        let now_from_end = exp(velocity, left_s);
        let after = handler.ahead(odom_from_robot, &now_from_end, 1.0);
        Motion::new(now_from_end, now_from_end * after)
    }
}

/// Bit *i* is set where judgement *i* forbids.
fn unsafe_mask(judgements: &[Judgement]) -> u32 {
    let bits = judgements.iter().enumerate().map(|(i, judgement)| u32::from(!judgement.safe) << i);
    bits.fold(0, |mask, bit| mask | bit)
}

/// Multiplies the probabilities of unsafe actions by `beta` and normalises (Kim et al. 2023, alg. 1 lines 8-12). Where
/// every action is unsafe, beta 0 gives stop for certain, any other beta the probabilities as they were. Where what
/// is left sums to nothing, it is stop as well.
#[must_use]
pub fn suppress(probabilities: &[f64], unsafe_mask: u32, beta: f64) -> Suppressed {
    let count = probabilities.len().min(MAX_ACTIONS);
    let mut out = [0.0; MAX_ACTIONS];
    out[..count].copy_from_slice(&probabilities[..count]);
    let all_unsafe = suppress_in_place(&mut out[..count], |i| unsafe_mask >> i & 1 == 1, beta, ActionTable::STOP);
    Suppressed { probabilities: out, all_unsafe }
}

/// [`suppress`] for any number of actions, stop being number `stop`: whether all are unsafe.
pub fn suppress_in_place(probabilities: &mut [f64], is_unsafe: impl Fn(usize) -> bool, beta: f64, stop: usize) -> bool {
    let all_unsafe = (0..probabilities.len()).all(&is_unsafe);
    for (i, p) in probabilities.iter_mut().enumerate() {
        *p *= if is_unsafe(i) && !all_unsafe { beta } else { 1.0 };
    }
    let sum: f64 = probabilities.iter().sum();
    if (all_unsafe && beta == 0.0) || sum <= 0.0 {
        probabilities.fill(0.0);
        if let Some(p) = probabilities.get_mut(stop) {
            *p = 1.0;
        }
    } else {
        probabilities.iter_mut().for_each(|p| *p /= sum);
    }
    all_unsafe
}

/// The mask of a robot that was cued forward. Where `wanted`, the policy's first choice, leads over an edge, the robot
/// waits: every action is taken away. The handler says where to turn.
#[must_use]
pub fn masked_at_edge(table: &ActionTable, judgements: &[Judgement], mask: u32, wanted: usize) -> u32 {
    if waits_at_edge(table, judgements, wanted) { (1 << table.len()) - 1 } else { mask }
}

/// Whether `wanted`, the policy's first choice, leads ahead over an edge and no action that leads ahead is left.
fn waits_at_edge(table: &ActionTable, judgements: &[Judgement], wanted: usize) -> bool {
    let leads_ahead = |i: usize| table.actions().get(i).is_some_and(Action::leads_ahead);
    let is_left = |(i, judgement): (usize, &Judgement)| judgement.safe && leads_ahead(i);
    judgements.get(wanted).is_some_and(|judgement| judgement.cause.is_edge())
        && leads_ahead(wanted)
        && !judgements.iter().enumerate().any(is_left)
}

/// Whether the mask takes every motion away, but for a step back, which is no way on.
#[must_use]
pub fn leaves_only_stop(unsafe_mask: u32, table: &ActionTable) -> bool {
    let is_way_on =
        |(i, action): (usize, &Action)| i != ActionTable::STOP && !action.leads_back() && unsafe_mask >> i & 1 == 0;
    !table.actions().iter().enumerate().any(is_way_on)
}

/// The policy's first choice, `wanted`. Where that is to stop or a step back, it is its first choice of the other
/// actions: those are the ways on.
#[must_use]
pub fn most_wanted_motion(table: &ActionTable, probabilities: &[f64], wanted: usize) -> usize {
    let is_way_on = |i: &usize| *i != ActionTable::STOP && !table.actions()[*i].leads_back();
    if is_way_on(&wanted) {
        return wanted;
    }
    // The first of equals.
    let ways_on = (0..probabilities.len()).filter(is_way_on).rev();
    ways_on.max_by(|a, b| probabilities[*a].total_cmp(&probabilities[*b])).unwrap_or(wanted)
}

/// Chooses an action of decision `n`.
#[must_use]
pub fn choose(probabilities: &[f64], draw: Draw, decision: u64) -> usize {
    match draw {
        Draw::ArgMax => most_probable(probabilities),
        Draw::Surest(seed) => match most_probable(probabilities) {
            ActionTable::STOP => choose(probabilities, Draw::Seeded(seed), decision),
            best => best,
        },
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

/// The first of equals; "stop" where there is none.
fn most_probable(probabilities: &[f64]) -> usize {
    let mut best = ActionTable::STOP;
    for (i, p) in probabilities.iter().enumerate() {
        if *p > probabilities[best] {
            best = i;
        }
    }
    best
}

/// A number in [0, 1) that depends on seed and counter alone, so that a restarted shield draws the same.
fn uniform(seed: u64, counter: u64) -> f64 {
    (mixed(seed, counter) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests;
