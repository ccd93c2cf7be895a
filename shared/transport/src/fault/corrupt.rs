//! What garbage and a plausible wrong value are, for each type that a fault can be injected into. Enumerations and
//! booleans stay valid here: what is no value of its type is another matter (`checked`).

use std::any::{Any, TypeId};

use messages::fault::{Dice, Fault, TILT_RAD, WRONG_AGE_NS, WRONG_SCALE};
use messages::{
    Cue, CueKind, CueRequest, DepthFrame, DepthHeader, Frame, Health, LidarScan, LocomotionState, Message, Mode,
    Odometry, Outcome, Permit, PolicyAction, Pose2, ScanHeader, SecondScan, SecondScanHeader, Twist2,
};
use zerocopy::{FromBytes, IntoBytes};

/// How a message goes wrong. Seq, incarnation and step are the envelope that transport puts around it, and stay.
trait Corrupt {
    /// Random numbers.
    fn garble(&mut self, dice: &mut Dice);

    /// A plausible wrong value; `first` is the first message that was to be wrong, as it was.
    fn falsify(&mut self, first: &Self);
}

/// How a frame goes wrong.
trait CorruptFrame: Frame {
    /// Random numbers beside the slice.
    fn garble_meta(meta: &mut Self::Meta, dice: &mut Dice);

    /// Random numbers in the slice.
    fn garble(data: &mut [Self::Element], dice: &mut Dice);

    /// A plausible wrong value in the slice.
    fn falsify(data: &mut [Self::Element]);

    /// What only this kind of frame can have, where it can.
    fn spoil(meta: &mut Self::Meta, data: &mut [Self::Element], fault: Fault);
}

/// Keeps the code where a row of the topic table is of the kind that is wanted.
macro_rules! only {
    (message, message, $code:block) => {
        $code
    };
    (frame, frame, $code:block) => {
        $code
    };
    ($wanted:ident, $kind:ident, $code:block) => {};
}

/// The publishers are generic over all topics, and only some can go wrong: each is looked for here as its own type. One
/// that lacks its implementation does not compile.
macro_rules! dispatch {
    ($($kind:ident $id:ident $type:ident by $by:ident;)+) => {
        /// Puts random numbers into a message.
        pub(crate) fn garble<M: Message>(message: &mut M, dice: &mut Dice) {
            let message: &mut dyn Any = message;
            $(only!(message, $kind, {
                if let Some(own) = message.downcast_mut::<messages::$type>() {
                    own.garble(dice);
                }
            });)+
        }

        /// Puts a plausible wrong value into a message; `first` is the first message that was to be wrong, as it was.
        pub(crate) fn falsify<M: Message>(message: &mut M, first: &M) {
            let (message, first): (&mut dyn Any, &dyn Any) = (message, first);
            $(only!(message, $kind, {
                if let (Some(own), Some(first)) = (message.downcast_mut::<messages::$type>(), first.downcast_ref()) {
                    own.falsify(first);
                }
            });)+
        }

        /// Puts random numbers beside a slice and into it. Every other header stays as it is, so that what lies behind
        /// its checks is met too.
        pub(crate) fn garble_frame<F: Frame>(meta: &mut F::Meta, data: &mut [F::Element], dice: &mut Dice) {
            let with_meta = dice.bits().is_multiple_of(2);
            $(only!(frame, $kind, {
                if let Some(data) = elements_of::<messages::$type, F>(data) {
                    let meta: &mut dyn Any = meta;
                    if let Some(meta) = meta.downcast_mut().filter(|_| with_meta) {
                        messages::$type::garble_meta(meta, dice);
                    }
                    messages::$type::garble(data, dice);
                }
            });)+
        }

        /// Puts a plausible wrong value into a slice.
        pub(crate) fn falsify_frame<F: Frame>(data: &mut [F::Element]) {
            $(only!(frame, $kind, {
                if let Some(data) = elements_of::<messages::$type, F>(data) {
                    messages::$type::falsify(data);
                }
            });)+
        }

        /// Does to a frame what only frames of its kind can have.
        pub(crate) fn spoil_frame<F: Frame>(meta: &mut F::Meta, data: &mut [F::Element], fault: Fault) {
            $(only!(frame, $kind, {
                if let Some(data) = elements_of::<messages::$type, F>(data) {
                    let meta: &mut dyn Any = meta;
                    if let Some(meta) = meta.downcast_mut() {
                        messages::$type::spoil(meta, data, fault);
                    }
                }
            });)+
        }
    };
}

messages::for_each_injectable_topic!(dispatch);

/// The elements of an `F` as those of a `G`, where they are the same topic.
fn elements_of<G: Frame<Element: FromBytes + IntoBytes>, F: Frame>(
    data: &mut [F::Element],
) -> Option<&mut [G::Element]> {
    (TypeId::of::<F>() == TypeId::of::<G>()).then(|| <[G::Element]>::mut_from_bytes(data.as_mut_bytes()).ok())?
}

/// Random values for faults, of the types that messages are made of.
trait Draw {
    fn pose(&mut self) -> Pose2;
    fn twist(&mut self) -> Twist2;
}

impl Draw for Dice {
    fn pose(&mut self) -> Pose2 {
        Pose2::new(self.number(), self.number(), self.number())
    }

    fn twist(&mut self) -> Twist2 {
        Twist2 { vx_mps: self.number(), vy_mps: self.number(), wz_radps: self.number() }
    }
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

impl CorruptFrame for LidarScan {
    fn garble_meta(meta: &mut ScanHeader, dice: &mut Dice) {
        meta.header.stamp_ns = dice.count();
        (meta.angle_min_rad, meta.angle_increment_rad) = (dice.number(), dice.number());
        (meta.range_min_m, meta.range_max_m, meta.sigma_m) = (dice.number(), dice.number(), dice.number());
        meta.robot_from_lidar = dice.pose();
    }

    fn garble(ranges_m: &mut [f32], dice: &mut Dice) {
        ranges_m.iter_mut().for_each(|range| *range = dice.number() as f32);
    }

    /// Readings that are too long, up to where a lidar sees nothing.
    fn falsify(ranges_m: &mut [f32]) {
        ranges_m.iter_mut().for_each(|range| *range *= WRONG_SCALE as f32);
    }

    fn spoil(_: &mut ScanHeader, _: &mut [f32], _: Fault) {
        // Every fault of a scan is one of all streams.
    }
}

impl CorruptFrame for SecondScan {
    fn garble_meta(meta: &mut SecondScanHeader, dice: &mut Dice) {
        LidarScan::garble_meta(&mut meta.scan, dice);
        (meta.header.stamp_ns, meta.pitch_rad) = (dice.count(), dice.number());
    }

    fn garble(ranges_m: &mut [f32], dice: &mut Dice) {
        LidarScan::garble(ranges_m, dice);
    }

    fn falsify(ranges_m: &mut [f32]) {
        LidarScan::falsify(ranges_m);
    }

    fn spoil(_: &mut SecondScanHeader, _: &mut [f32], _: Fault) {}
}

impl CorruptFrame for DepthFrame {
    fn garble_meta(meta: &mut DepthHeader, dice: &mut Dice) {
        meta.header.stamp_ns = dice.count();
        (meta.width, meta.height) = (dice.bits() as u32, dice.bits() as u32);
        (meta.fx_px, meta.fy_px, meta.cx_px, meta.cy_px) = (dice.number(), dice.number(), dice.number(), dice.number());
        meta.robot_from_camera.x_m = dice.number();
        meta.robot_from_camera.pitch_rad = dice.number();
    }

    fn garble(pixels_mm: &mut [u16], dice: &mut Dice) {
        for four in pixels_mm.chunks_mut(4) {
            let bits = dice.bits();
            for (i, pixel) in four.iter_mut().enumerate() {
                *pixel = (bits >> (16 * i)) as u16;
            }
        }
    }

    /// Depths that are too long; what was not seen is not seen.
    fn falsify(pixels_mm: &mut [u16]) {
        pixels_mm.iter_mut().for_each(|pixel| *pixel = pixel.saturating_mul(WRONG_SCALE as u16));
    }

    fn spoil(meta: &mut DepthHeader, pixels_mm: &mut [u16], fault: Fault) {
        match fault {
            Fault::NoFloor => hide_floor(meta, pixels_mm),
            Fault::Tilted => meta.robot_from_camera.pitch_rad += TILT_RAD,
            _ => {}
        }
    }
}

/// Pixels that see what is low say nothing.
fn hide_floor(header: &DepthHeader, pixels_mm: &mut [u16]) {
    const LOW_M: f64 = 0.2;
    let (mount, width) = (header.robot_from_camera, (header.width as usize).max(1));
    let (sin, cos) = mount.pitch_rad.sin_cos();
    for (v, row_mm) in pixels_mm.chunks_mut(width).enumerate() {
        let up = (header.cy_px - v as f64) / header.fy_px;
        let rise = up * cos - sin;
        let is_low = |pixel_mm: u16| mount.z_m + rise * f64::from(pixel_mm) / 1000.0 < LOW_M;
        row_mm.iter_mut().filter(|pixel| is_low(**pixel)).for_each(|pixel| *pixel = 0);
    }
}

impl Corrupt for Odometry {
    fn garble(&mut self, dice: &mut Dice) {
        self.odom_from_robot = dice.pose();
        self.twist = dice.twist();
        (self.attitude.stamp_ns, self.attitude.height_m) = (dice.count(), dice.number());
        (self.attitude.roll_rad, self.attitude.pitch_rad) = (dice.number(), dice.number());
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
        self.own_roll_pitch_rad = [dice.number(), dice.number()];
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

#[cfg(test)]
mod tests {
    use super::{falsify, falsify_frame, garble, garble_frame};
    use messages::fault::Dice;
    use messages::{Frame, Message};
    use zerocopy::IntoBytes;

    /// A fault that does nothing looks like one that was survived.
    #[test]
    fn every_topic_that_can_be_injected_into_is_garbled_and_falsified() {
        macro_rules! check {
            ($($kind:ident $id:ident $type:ident by $by:ident;)+) => { $(check!($kind $type);)+ };
            (message $type:ident) => { check_message::<messages::$type>() };
            (frame $type:ident) => { check_frame::<messages::$type>() };
        }
        messages::for_each_injectable_topic!(check);
    }

    fn check_message<M: Message + Default>() {
        // As text, NaN is equal to itself.
        let text = |message: &M| format!("{message:?}");
        let mut garbled = M::default();
        garble(&mut garbled, &mut Dice::new(3));
        assert_ne!(text(&garbled), text(&M::default()), "garbage");
        // One that is all zero may have nothing to double; of random ones, some have.
        let falsified = |seed| {
            let mut message = M::default();
            garble(&mut message, &mut Dice::new(seed));
            let before = message;
            falsify(&mut message, &M::default());
            text(&message) != text(&before)
        };
        assert!((0..8).any(falsified), "a wrong value: {}", M::TOPIC);
    }

    fn check_frame<F: Frame>() {
        // Any bytes are an element; of these none is 0 or NaN.
        let mut data = vec![F::Element::default(); 8];
        data.as_mut_bytes().fill(1);
        // Every other header stays as it is.
        let garbled = |seed| {
            let (mut meta, mut garbled) = (F::Meta::default(), data.clone());
            garble_frame::<F>(&mut meta, &mut garbled, &mut Dice::new(seed));
            assert_ne!(garbled, data, "garbage: {}", F::Meta::TOPIC);
            meta != F::Meta::default()
        };
        assert!((0..8).any(garbled), "garbage beside it: {}", F::Meta::TOPIC);
        let mut falsified = data.clone();
        falsify_frame::<F>(&mut falsified);
        assert_ne!(falsified, data, "a wrong value: {}", F::Meta::TOPIC);
    }

    #[test]
    fn a_wrong_pose_has_gone_twice_the_way() {
        let mut pose = messages::Odometry::default();
        let first = pose;
        pose.odom_from_robot.x_m = 0.5;
        falsify(&mut pose, &first);
        assert!((pose.odom_from_robot.x_m - 1.0).abs() < 1e-12);
    }
}
