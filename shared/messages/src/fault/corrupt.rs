//! What garbage and a plausible wrong value are, for each type. Enumerations and booleans stay valid here.

use crate::{
    ClockAck, ClockStep, Cue, CueAnswer, CueHeard, CueKind, CueRequest, DepthHeader, Health, LocomotionState, Mode,
    Odometry, Outcome, Permit, PolicyAction, Pose2, RobotCommand, ScanHeader, Twist2, WorldTruth,
};

use super::{WRONG_AGE_NS, WRONG_SCALE};

/// Random numbers by seed (SplitMix64): the same seed makes the same fault.
#[derive(Debug, Clone, Default)]
pub struct Dice(u64);

impl Dice {
    /// Dice of that seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Any 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number from `from` up to, but not including, `to`.
    pub fn between(&mut self, (from, to): (u64, u64)) -> u64 {
        from + self.bits() % to.saturating_sub(from).max(1)
    }

    /// What a broken sensor might say: NaN, an infinity, something absurd, or something ordinary.
    pub fn number(&mut self) -> f64 {
        match self.bits() % 8 {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => f64::NEG_INFINITY,
            3 => f64::MAX,
            4 => -1e-300,
            5 => f64::from_bits(self.bits()),
            _ => self.between((0, 20_000)) as f64 / 1000.0 - 10.0,
        }
    }

    /// A count or a time: absurd, or ordinary.
    pub fn count(&mut self) -> u64 {
        match self.bits() % 3 {
            0 => u64::MAX,
            1 => self.bits(),
            _ => self.bits() % 1000,
        }
    }

    fn pose(&mut self) -> Pose2 {
        Pose2::new(self.number(), self.number(), self.number())
    }

    fn twist(&mut self) -> Twist2 {
        Twist2 { vx_mps: self.number(), vy_mps: self.number(), wz_radps: self.number() }
    }
}

/// How a message goes wrong. Seq, incarnation and step are the envelope that transport puts around it, and stay.
pub trait Corrupt {
    /// Random numbers.
    fn garble(&mut self, _dice: &mut Dice) {}

    /// A plausible wrong value; `first` is the first message that was to be wrong, as it was.
    fn falsify(&mut self, _first: &Self) {}
}

fn twice(twist: Twist2) -> Twist2 {
    Twist2 {
        vx_mps: WRONG_SCALE * twist.vx_mps,
        vy_mps: WRONG_SCALE * twist.vy_mps,
        wz_radps: WRONG_SCALE * twist.wz_radps,
    }
}

/// The kind that a recogniser takes this one for: left and right are confused, and what is no turn becomes one.
fn misheard(kind: CueKind) -> CueKind {
    match kind {
        CueKind::Left => CueKind::Right,
        CueKind::Right | CueKind::Forward => CueKind::Left,
        CueKind::Stop => CueKind::Forward,
    }
}

fn any_cue(dice: &mut Dice) -> CueKind {
    [CueKind::Stop, CueKind::Forward, CueKind::Left, CueKind::Right][(dice.bits() % 4) as usize]
}

impl Corrupt for ScanHeader {
    fn garble(&mut self, dice: &mut Dice) {
        self.header.stamp_ns = dice.count();
        (self.angle_min_rad, self.angle_increment_rad) = (dice.number(), dice.number());
        (self.range_min_m, self.range_max_m, self.sigma_m) = (dice.number(), dice.number(), dice.number());
        self.robot_from_lidar = dice.pose();
    }
}

impl Corrupt for DepthHeader {
    fn garble(&mut self, dice: &mut Dice) {
        self.header.stamp_ns = dice.count();
        (self.width, self.height) = (dice.bits() as u32, dice.bits() as u32);
        (self.fx_px, self.fy_px, self.cx_px, self.cy_px) = (dice.number(), dice.number(), dice.number(), dice.number());
        self.robot_from_camera.x_m = dice.number();
        self.robot_from_camera.pitch_rad = dice.number();
    }
}

impl Corrupt for Odometry {
    fn garble(&mut self, dice: &mut Dice) {
        self.odom_from_robot = dice.pose();
        self.twist = dice.twist();
        self.sigma = [dice.number(), dice.number(), dice.number()];
    }

    /// The way since then is doubled.
    fn falsify(&mut self, first: &Self) {
        let (from, to) = (first.odom_from_robot, self.odom_from_robot);
        self.odom_from_robot.x_m = from.x_m + WRONG_SCALE * (to.x_m - from.x_m);
        self.odom_from_robot.y_m = from.y_m + WRONG_SCALE * (to.y_m - from.y_m);
        self.twist = twice(self.twist);
    }
}

impl Corrupt for Cue {
    fn garble(&mut self, dice: &mut Dice) {
        self.kind = any_cue(dice);
        (self.confidence, self.signal_db) = (dice.number() as f32, dice.number() as f32);
        self.odom_from_start = dice.pose();
        (self.odometry_incarnation, self.request_seq) = (dice.bits() as u32, dice.count());
    }

    fn falsify(&mut self, _first: &Self) {
        self.kind = misheard(self.kind);
    }
}

impl Corrupt for CueRequest {
    fn garble(&mut self, dice: &mut Dice) {
        self.header.stamp_ns = dice.count();
        self.kind = any_cue(dice);
    }

    fn falsify(&mut self, _first: &Self) {
        self.kind = misheard(self.kind);
    }
}

impl Corrupt for PolicyAction {
    fn garble(&mut self, dice: &mut Dice) {
        (self.decision, self.action_table_id) = (dice.count(), dice.bits());
        self.action_count = dice.bits() as u32;
        self.probabilities.iter_mut().for_each(|p| *p = dice.number() as f32);
    }

    /// The probabilities of another action each: what they say is wrong, not what they are.
    fn falsify(&mut self, _first: &Self) {
        let count = (self.action_count as usize).min(self.probabilities.len());
        if let Some(moving) = self.probabilities.get_mut(1..count).filter(|moving| !moving.is_empty()) {
            moving.rotate_right(1);
        }
    }
}

impl Corrupt for Permit {
    fn garble(&mut self, dice: &mut Dice) {
        self.outcome = Outcome::ALL[(dice.bits() % Outcome::ALL.len() as u64) as usize];
        self.velocity = dice.twist();
        (self.expiry_ns, self.action_end_ns) = (dice.count(), dice.count());
        (self.decision, self.epoch, self.cue_seq) = (dice.count(), dice.count(), dice.count());
        (self.action, self.policy_incarnation) = (dice.bits() as u32, dice.bits() as u32);
        (self.margin_m, self.unseen_area_m2) = (dice.number(), dice.number());
        self.robot_from_handler = dice.pose();
    }

    /// A velocity that the shield has not judged.
    fn falsify(&mut self, _first: &Self) {
        self.velocity = Twist2 { vy_mps: self.velocity.vy_mps + 0.1, ..self.velocity };
    }
}

impl Corrupt for Mode {
    fn garble(&mut self, dice: &mut Dice) {
        self.epoch = dice.count();
        (self.active_policy, self.active_shield) = (dice.bits() as u32, dice.bits() as u32);
        self.cue.cue.garble(dice);
        self.reason.age_ns = dice.count();
    }

    /// Another policy is named active.
    fn falsify(&mut self, _first: &Self) {
        self.active_policy = self.active_policy.wrapping_add(1);
    }
}

impl Corrupt for LocomotionState {
    fn garble(&mut self, dice: &mut Dice) {
        (self.applied, self.measured) = (dice.twist(), dice.twist());
        (self.permit_seq, self.decision, self.epoch) = (dice.count(), dice.count(), dice.count());
        (self.own_from_robot, self.own_stamp_ns) = (dice.pose(), dice.count());
        self.charge_percent = dice.bits() as u32;
    }

    fn falsify(&mut self, _first: &Self) {
        (self.applied, self.measured) = (twice(self.applied), twice(self.measured));
    }
}

impl Corrupt for Health {
    fn garble(&mut self, dice: &mut Dice) {
        (self.decisions, self.missed_decisions) = (dice.count(), dice.count());
        (self.invalid_inputs, self.pose_jumps) = (dice.count(), dice.count());
        (self.pid, self.port_count) = (dice.bits() as u32, dice.bits() as u32);
        self.outcomes.iter_mut().for_each(|n| *n = dice.count());
        for port in &mut self.ports {
            (port.count, port.lost) = (dice.count(), dice.count());
            (port.last_seq, port.last_stamp_ns) = (dice.count(), dice.count());
        }
        for latency in &mut self.latencies {
            (latency.n, latency.max_ns) = (dice.count(), dice.count());
        }
    }

    /// The streams are told older than they are.
    fn falsify(&mut self, _first: &Self) {
        for port in &mut self.ports {
            port.last_stamp_ns = port.last_stamp_ns.saturating_sub(WRONG_AGE_NS);
        }
    }
}

// Outside of the runtime, or its clock: no fault is injected there.
impl Corrupt for WorldTruth {}
impl Corrupt for RobotCommand {}
impl Corrupt for ClockStep {}
impl Corrupt for ClockAck {}

/// It moves nobody: there is no fault of it to try.
impl Corrupt for CueAnswer {}
/// It asks for a tone, and moves nothing.
impl Corrupt for CueHeard {}

/// Random readings.
pub(crate) fn garble_ranges(ranges_m: &mut [f32], dice: &mut Dice) {
    ranges_m.iter_mut().for_each(|range| *range = dice.number() as f32);
}

/// Readings that are too long, up to where a lidar sees nothing.
pub(crate) fn falsify_ranges(ranges_m: &mut [f32]) {
    ranges_m.iter_mut().for_each(|range| *range *= WRONG_SCALE as f32);
}

/// Random pixels.
pub(crate) fn garble_pixels(pixels_mm: &mut [u16], dice: &mut Dice) {
    for four in pixels_mm.chunks_mut(4) {
        let bits = dice.bits();
        for (i, pixel) in four.iter_mut().enumerate() {
            *pixel = (bits >> (16 * i)) as u16;
        }
    }
}

/// Depths that are too long; what was not seen is not seen.
pub(crate) fn falsify_pixels(pixels_mm: &mut [u16]) {
    pixels_mm.iter_mut().for_each(|pixel| *pixel = pixel.saturating_mul(WRONG_SCALE as u16));
}
