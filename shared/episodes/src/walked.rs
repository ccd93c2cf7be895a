//! Whether robot and handler stayed within the hulls of a run's permits: each hull from its permit until the next one
//! is granted, so the last one before a stop until they set off again.
//!
//! A permit does not carry its hull. It is made anew from what the permit was judged on, by the shield's own code, and
//! lies where the robot truly was.

use std::collections::VecDeque;

use guidance::se2::{Se2, se2};
use guidance::{Awareness, AwarenessConfig, Discs, HandlerBody, Shield};
use messages::{Odometry, Outcome, Permit, PermitCause, ScanHeader, Twist2, WorldTruth, s_from_ns};
use settings::Settings;

use crate::Excess;
use crate::judged::{Judged, Shape};

/// The estimate of the handler that is made anew and the permit's own are one if they are this near, metres.
const SAME_M: f64 = 1e-6;

/// A verdict whose hull waits for the truth of its time.
struct Verdict {
    stamp_ns: u64,
    decision: u64,
    /// The hull's discs (robot frame), the handler of then and how the robot moved; none: no permit was granted.
    granted: Option<(Discs, HandlerBody, Twist2)>,
}

/// Takes the first of a queue where that holds of it.
fn next_if<T>(queue: &mut VecDeque<T>, is_due: impl FnOnce(&T) -> bool) -> Option<T> {
    if queue.front().is_some_and(is_due) { queue.pop_front() } else { None }
}

/// A run's permits, held against the truth of its world. Messages are taken in the order of their publication.
pub struct Walked {
    shape: Shape,
    awareness: Awareness,
    shield: Shield,
    dt_s: f64,
    scan_period_ns: u64,
    /// What the next permit may have been judged on.
    poses: VecDeque<Odometry>,
    scans: VecDeque<(ScanHeader, Vec<f32>)>,
    verdicts: VecDeque<Verdict>,
    /// When the running action began.
    begun_ns: Option<u64>,
    decision: Option<u64>,
    /// The hull in force.
    held: Option<Judged>,
    excess: Excess,
}

impl Walked {
    /// The robot, handler and shield of these settings.
    ///
    /// # Errors
    /// Where the handler's model is out of its bounds.
    pub fn new(settings: &Settings) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let config = AwarenessConfig { memory: None, ..settings.awareness_config() };
        Ok(Self {
            shape: Shape::of(settings),
            awareness: Awareness::new(settings.interaction()?, config),
            shield: Shield::new(settings.shield_config()),
            dt_s: settings.policy.dt.s(),
            scan_period_ns: (1e9 / settings.lidar.rate_hz.get()) as u64,
            poses: VecDeque::new(),
            scans: VecDeque::new(),
            verdicts: VecDeque::new(),
            begun_ns: None,
            decision: None,
            held: None,
            excess: Excess::default(),
        })
    }

    /// The next pose that odometry told.
    pub fn take_odometry(&mut self, odometry: &Odometry) {
        self.poses.push_back(*odometry);
    }

    /// The next scan.
    pub fn take_scan(&mut self, header: &ScanHeader, ranges_m: &[f32]) {
        self.scans.push_back((*header, ranges_m.to_vec()));
    }

    /// The next permit: what it was judged on is taken in first.
    ///
    /// # Errors
    /// Where it was not judged on the poses and scans before it: its hull cannot be made anew.
    pub fn take_permit(&mut self, permit: &Permit) -> Result<(), String> {
        let now_ns = permit.header.stamp_ns;
        while let Some(odometry) = next_if(&mut self.poses, |pose| pose.header.seq <= permit.odometry_seq) {
            self.awareness.take_odometry(&odometry);
        }
        while let Some((header, ranges_m)) = next_if(&mut self.scans, |(scan, _)| scan.header.seq <= permit.scan_seq) {
            self.awareness.take_scan(now_ns, self.step_share(now_ns), &header, &ranges_m);
        }
        if permit.cause == PermitCause::Decision {
            self.awareness.come_to(now_ns, self.step_share(now_ns));
            self.awareness.begin_step();
            self.begun_ns = Some(now_ns);
        }
        let granted = (permit.outcome == Outcome::Granted).then(|| self.hull(permit)).transpose()?;
        self.verdicts.push_back(Verdict { stamp_ns: now_ns, decision: permit.decision, granted });
        self.awareness.permit(now_ns, permit.velocity);
        Ok(())
    }

    fn step_share(&self, now_ns: u64) -> f64 {
        s_from_ns(now_ns.saturating_sub(self.begun_ns.unwrap_or(now_ns))) / self.dt_s
    }

    /// What was judged: the way to the end of the action and one scan period more, or where the permit ends with the
    /// action, to that.
    fn hull(&mut self, permit: &Permit) -> Result<(Discs, HandlerBody, Twist2), String> {
        let handler = self.awareness.handler();
        let apart = handler.robot_from_handler().inverse() * se2(permit.robot_from_handler);
        if apart.translation.vector.norm() > SAME_M {
            let at_s = s_from_ns(permit.header.stamp_ns);
            return Err(format!("the permit of {at_s:.2} s was not judged on the scans and poses before it"));
        }
        let more_ns = if permit.expiry_ns == permit.action_end_ns { 0 } else { self.scan_period_ns };
        let left_ns = (permit.action_end_ns + more_ns).saturating_sub(permit.header.stamp_ns);
        let motion = Shield::remainder(handler, self.awareness.odom_from_robot(), permit.velocity, s_from_ns(left_ns));
        let (body, moves) = (self.awareness.body(), self.awareness.evidence(permit.header.stamp_ns).moves);
        Ok((self.shield.swept(&motion, moves, body), body, moves))
    }

    /// Where robot and handler are.
    pub fn take_truth(&mut self, truth: &WorldTruth) {
        while let Some(verdict) = next_if(&mut self.verdicts, |verdict| verdict.stamp_ns <= truth.header.stamp_ns) {
            self.begin(&verdict, se2(truth.world_from_robot));
        }
        if let Some(held) = &mut self.held {
            held.hold(truth);
            if let (Some(robot_m), Some(handler_m)) =
                (self.excess.robot_beyond_m.last_mut(), self.excess.handler_beyond_m.last_mut())
            {
                (*robot_m, *handler_m) = (robot_m.max(held.beyond_m[0]), handler_m.max(held.beyond_m[1]));
            }
        }
    }

    fn begin(&mut self, verdict: &Verdict, world_from_robot: Se2) {
        let Some((discs, handler, moves)) = verdict.granted else { return };
        if self.decision != Some(verdict.decision) {
            self.decision = Some(verdict.decision);
            self.excess.decisions += 1;
            self.excess.robot_beyond_m.push(f64::NEG_INFINITY);
            self.excess.handler_beyond_m.push(f64::NEG_INFINITY);
        }
        self.held = Some(Judged::new(self.shape, world_from_robot, &moves, handler, discs));
    }

    /// What came of it: for each decision that was granted, by how much robot and handler left its hulls.
    #[must_use]
    pub fn finish(self) -> Excess {
        self.excess
    }
}
