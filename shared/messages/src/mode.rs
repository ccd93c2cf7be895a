//! Run, fault or lock, why, and what the robot does about it.

use crate::json::{mirrored, named};
use crate::{Cue, Header, Pose2, ServiceId, StopKind, TopicId, Twist2};
#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};
use zerocopy::TryFromBytes;

/// The class of the mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/ModeClass/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum ModeClass {
    /// Stopped by a fault; ends by an accepted cue.
    #[default]
    Fault = 0,
    /// Motion is possible with a permit.
    Run,
    /// Stopped by the operator, an emergency stop or a spent restart budget; ends by `resume`.
    Lock,
}

named!(ModeClass);

impl ModeClass {
    /// The name, as in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::Run => "run",
            Self::Lock => "lock",
        }
    }
}

mirrored! {
    /// Why the robot stands, with evidence.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/StopReason/4"))]
    #[repr(C)]
    pub struct StopReason {
        /// What kind of stop.
        pub kind: StopKind,
        /// The service it is about, if any.
        pub service: ServiceId,
        /// The stream it is about, if any.
        pub topic: TopicId,
        /// The incarnation it is about; 0 where none is.
        pub incarnation: u32,
        /// Age that was seen (for a slow stream: from one message to the next), nanoseconds; 0 where none applies, the
        /// greatest where there is no usable stamp.
        pub age_ns: u64,
        /// Limit that it broke, nanoseconds; 0 where none applies.
        pub limit_ns: u64,
        /// What it had of what it exhausted: bytes, or descriptors; 0 where none applies.
        pub used: u64,
        /// Limit that this broke.
        pub used_limit: u64,
        /// Where the floor ends, or was not seen, robot frame, millimetres.
        #[serde(default)]
        pub ahead_mm: i32 = default,
        /// See `ahead_mm`.
        #[serde(default)]
        pub left_mm: i32 = default,
        /// From there to the hull of the motion, millimetres; less than 0 in it.
        #[serde(default)]
        pub away_mm: i32 = default,
        /// The distance that is kept from it, millimetres.
        #[serde(default)]
        pub kept_mm: i32 = default,
        /// How much the floor rises there by a step, millimetres; less than 0: it falls.
        #[serde(default)]
        pub step_mm: i32 = default,
    }
}

impl StopReason {
    /// A reason that needs no evidence beside its kind.
    #[must_use]
    pub const fn of(kind: StopKind) -> Self {
        let (service, topic) = (ServiceId::None, TopicId::None);
        Self {
            kind,
            service,
            topic,
            incarnation: 0,
            age_ns: 0,
            limit_ns: 0,
            used: 0,
            used_limit: 0,
            ahead_mm: 0,
            left_mm: 0,
            away_mm: 0,
            kept_mm: 0,
            step_mm: 0,
        }
    }

    /// A reason about one service incarnation.
    #[must_use]
    pub const fn service(kind: StopKind, service: ServiceId, incarnation: u32) -> Self {
        Self { service, incarnation, ..Self::of(kind) }
    }

    /// The floor ends, or was not seen, at a place (robot frame, metres), so far from the hull of the motion; so much
    /// is kept from it, metres.
    #[must_use]
    pub fn floor(kind: StopKind, [ahead_m, left_m]: [f64; 2], away_m: f64, kept_m: f64) -> Self {
        let [ahead_mm, left_mm, away_mm, kept_mm] =
            [ahead_m, left_m, away_m, kept_m].map(|m| (m * 1000.0).round() as i32);
        Self { ahead_mm, left_mm, away_mm, kept_mm, ..Self::of(kind) }
    }

    /// The same, of a step by which the floor rises so much, metres; less than 0: it falls.
    #[must_use]
    pub fn step(self, rise_m: f64) -> Self {
        Self { step_mm: (rise_m * 1000.0).round() as i32, ..self }
    }

    /// Where the floor ends, or a step is.
    fn fmt_place(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let m = |mm: i32| f64::from(mm.abs()) / 1000.0;
        if self.step_mm != 0 {
            write!(f, ": {:.2} m {},", m(self.step_mm), if self.step_mm < 0 { "down" } else { "up" })?;
        } else {
            f.write_str(":")?;
        }
        let side = if self.left_mm < 0 { "right" } else { "left" };
        let way = if self.ahead_mm < 0 { "behind" } else { "ahead" };
        write!(f, " {:.2} m {way} and {:.2} m to the {side}", m(self.ahead_mm), m(self.left_mm))?;
        if self.kept_mm > 0 {
            let away_m = f64::from(self.away_mm) / 1000.0;
            write!(f, ", {away_m:.2} m from the hull, where {:.2} m are kept", m(self.kept_mm))?;
        }
        Ok(())
    }

    /// A reason about a stream that is too old.
    #[must_use]
    pub const fn stream(kind: StopKind, topic: TopicId, age_ns: u64, limit_ns: u64) -> Self {
        Self { topic, age_ns, limit_ns, ..Self::of(kind) }
    }
}

impl core::fmt::Display for StopReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.kind.name())?;
        if self.service != ServiceId::None {
            write!(f, ": {}", self.service)?;
            if self.incarnation > 0 {
                write!(f, " (incarnation {})", self.incarnation)?;
            }
        }
        if self.topic != TopicId::None {
            write!(f, ": {}", self.topic)?;
        }
        let limit_ms = self.limit_ns / 1_000_000;
        match (self.kind, self.age_ns) {
            _ if self.limit_ns == 0 => {}
            (_, u64::MAX) => write!(f, ", nothing with a usable stamp, limit {limit_ms} ms")?,
            (StopKind::StreamSlow, apart) => write!(f, ", {} ms apart, limit {limit_ms} ms", apart / 1_000_000)?,
            (_, age_ns) => write!(f, ", {} ms old, limit {limit_ms} ms", age_ns / 1_000_000)?,
        }
        if self.kind.is_floor() {
            self.fmt_place(f)?;
        }
        match (self.kind, self.used >> 20, self.used_limit >> 20) {
            _ if self.used_limit == 0 => Ok(()),
            (StopKind::MemoryExhausted, mib, limit) => write!(f, ", {mib} MiB of its own, limit {limit} MiB"),
            _ => write!(f, ", {}, limit {}", self.used, self.used_limit),
        }
    }
}

mirrored! {
    /// The cue in force, as accepted by the supervisor.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/CueInForce/1"))]
    #[repr(C)]
    pub struct CueInForce {
        /// Whether there is one; the rest means nothing otherwise.
        pub valid: bool,
        /// The cue as it came, header included: (incarnation, seq) name it.
        pub cue: Cue,
    }
}

/// Where the handler walks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, TryFromBytes)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[cfg_attr(feature = "ipc", type_name("guidedog/Formation/1"))]
#[repr(C)]
#[serde(rename_all = "snake_case")]
pub enum Formation {
    /// Beside the robot, at the default offset of the interaction model.
    #[default]
    Beside = 0,
    /// Behind the robot, in single file: through a passage that is too narrow for both side by side.
    Behind,
}

impl Formation {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 2] = [Self::Beside, Self::Behind];
}

named!(Formation);

mirrored! {
    /// The supervisor's word on whether motion is possible.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/Mode/2"))]
    #[repr(C)]
    pub struct Mode {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// Run, fault or lock.
        pub class: ModeClass,
        /// Whether a moving cue would be accepted now.
        pub ready_for_cue: bool,
        /// The policy incarnation whose decisions the shield draws from.
        pub active_policy: u32,
        /// While a swapped policy is on probation, the one before it: its decision is drawn where the active one's does
        /// not come, and its running action goes on. 0: none.
        pub previous_policy: u32,
        /// The shield incarnation on the armed line: locomotion obeys no other.
        pub active_shield: u32,
        /// Raised at every entry into fault or lock, and at no other time.
        pub epoch: u64,
        /// Why the class is what it is.
        pub reason: StopReason,
        /// The moving cue in force.
        pub cue: CueInForce,
        /// Where the handler walks.
        pub formation: Formation = default,
        /// Where the handler has been asked to walk: the next cue *forward* agrees. Otherwise as `formation`.
        pub formation_asked: Formation = default,
    }
}

impl Mode {
    /// Whether the decisions of that incarnation may be drawn.
    #[must_use]
    pub const fn allows_policy(&self, incarnation: u32) -> bool {
        incarnation != 0 && (incarnation == self.active_policy || incarnation == self.previous_policy)
    }

    /// Whether it may follow `old`. An epoch rises by one at a time: one that leaps is no supervisor's. Of one that
    /// falls the one before was never true, for the supervisor only counts up.
    #[must_use]
    pub const fn may_follow(&self, old: &Self) -> bool {
        if self.epoch < old.epoch { self.header.seq > old.header.seq } else { self.epoch - old.epoch <= EPOCHS_AT_ONCE }
    }
}

/// Stops that a reader may have slept through.
const EPOCHS_AT_ONCE: u64 = 100;

mirrored! {
    /// What locomotion does.
    #[derive(Debug, Clone, Copy, Default, PartialEq, TryFromBytes)]
    #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
    #[cfg_attr(feature = "ipc", type_name("guidedog/LocomotionState/3"))]
    #[repr(C)]
    pub struct LocomotionState {
        /// Stamp, seq, incarnation.
        pub header: Header,
        /// Velocity last written to the link.
        pub applied: Twist2,
        /// Why it is zero; [`StopKind::None`] while it is not.
        pub limited_by: StopReason,
        /// Velocity that the link reports, where it does.
        pub measured: Twist2,
        /// Whether `measured` means something.
        pub measured_valid: bool,
        /// Seq of the permit obeyed last.
        pub permit_seq: u64,
        /// Decision of the permit obeyed last.
        pub decision: u64,
        /// The epoch in force at locomotion.
        pub epoch: u64,
        /// Where the robot itself believes to be, in a frame of its own.
        pub own_from_robot: Pose2,
        /// Run time at which the robot told so, nanoseconds; 0 where it tells nothing, or nothing lately.
        pub own_stamp_ns: u64,
        /// How its body was held then, about the forward and about the left axis, radians.
        pub own_roll_pitch_rad: [f64; 2] = default,
        /// Charge of its battery, percent; 0 where it does not tell (one that is empty counts as 1).
        pub charge_percent: u32,
        /// Whether somebody has stopped the robot by its hand remote, and nobody has resumed since.
        pub remote_stop: bool,
    }
}

#[cfg(test)]
mod tests {
    use super::StopReason;
    use crate::StopKind;

    #[test]
    fn a_reason_tells_where_the_floor_ends_and_how_high_a_step_is() {
        let edge = StopReason::floor(StopKind::DropOff, [0.62, -0.1], 0.21, 0.35);
        let said = "0.62 m ahead and 0.10 m to the right, 0.21 m from the hull, where 0.35 m are kept";
        assert_eq!(edge.to_string(), format!("drop_off: {said}"));
        let step = |kind, rise_m| StopReason { kind, ..edge }.step(rise_m).to_string();
        assert_eq!(step(StopKind::LowStepDown, -0.0812), format!("low_step_down: 0.08 m down, {said}"));
        assert_eq!(step(StopKind::StepUp, 0.17), format!("step_up: 0.17 m up, {said}"));
        let unseen = StopReason::floor(StopKind::FloorUnseen, [-0.3, 0.5], 0.0, 0.0);
        assert_eq!(unseen.to_string(), "floor_unseen: 0.30 m behind and 0.50 m to the left");
    }
}
