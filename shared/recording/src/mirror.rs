//! Our own messages as JSON: every type has a mirror whose numbers come back to the bit, and tells its JSON schema.

use messages::{
    Cue, CueAnswer, CueHeard, CueInForce, CueKind, CueRefusal, CueRequest, CueSource, EmergencyStop, Header,
    LocomotionState, Mode, ModeClass, Outcome, Permit, PermitCause, PolicyAction, Pose2, Pose3, ServiceId, SpeechPhase,
    SpeechSaid, SpeechText, StopInput, StopKind, StopReason, TopicId, Twist2, UnsafeCause, Urgency, Walker, WorldTruth,
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::json::{HeaderJson, Reading, Real};

/// A type and its mirror in JSON.
pub trait Mirrored: Copy {
    /// The mirror.
    type Json;
    /// Into the mirror.
    fn mirror(self) -> Self::Json;
    /// Out of it.
    fn back(json: Self::Json) -> Self;
    /// JSON schema of the mirror.
    fn schema() -> Value;
}

/// Types that are their own mirror.
macro_rules! plain {
    ($schema:tt: $($name:ty),+ $(,)?) => {$(
        impl Mirrored for $name {
            type Json = Self;
            fn mirror(self) -> Self {
                self
            }
            fn back(json: Self) -> Self {
                json
            }
            fn schema() -> Value {
                json!($schema)
            }
        }
    )+};
}

plain!({ "type": "integer", "minimum": 0 }: u32, u64);
plain!({ "type": "boolean" }: bool);
plain!({ "type": "string" }: CueKind, CueSource, ModeClass, Outcome, PermitCause, ServiceId, StopKind, TopicId);
plain!({ "type": "string" }: CueRefusal, SpeechPhase, StopInput, UnsafeCause, Urgency);

/// Numbers that may be NaN or infinite.
macro_rules! number {
    ($($name:ty => $json:ident),+ $(,)?) => {$(
        impl Mirrored for $name {
            type Json = $json;
            fn mirror(self) -> $json {
                $json(self)
            }
            fn back(json: $json) -> Self {
                json.0
            }
            fn schema() -> Value {
                json!({ "type": ["number", "null"] })
            }
        }
    )+};
}

number!(f64 => Real, f32 => Reading);

impl Mirrored for SpeechText {
    type Json = String;
    fn mirror(self) -> String {
        self.as_str().to_owned()
    }
    fn back(json: String) -> Self {
        json.as_str().into()
    }
    fn schema() -> Value {
        json!({ "type": "string" })
    }
}

impl Mirrored for Header {
    type Json = HeaderJson;
    fn mirror(self) -> HeaderJson {
        self.into()
    }
    fn back(json: HeaderJson) -> Self {
        json.into()
    }
    fn schema() -> Value {
        let members = ["stamp_ns", "seq", "step", "published_ns", "incarnation"];
        object(members.map(|member| (member, u64::schema())))
    }
}

/// The schema of a struct with these members.
fn object<const N: usize>(members: [(&str, Value); N]) -> Value {
    let required: Vec<&str> = members.iter().map(|(name, _)| *name).collect();
    let properties: Value = members.iter().map(|(name, schema)| ((*name).to_owned(), schema.clone())).collect();
    json!({ "type": "object", "properties": properties, "required": required })
}

impl<T: Mirrored, const N: usize> Mirrored for [T; N] {
    type Json = [T::Json; N];
    fn mirror(self) -> Self::Json {
        self.map(T::mirror)
    }
    fn back(json: Self::Json) -> Self {
        json.map(T::back)
    }
    fn schema() -> Value {
        json!({ "type": "array", "items": T::schema(), "minItems": N, "maxItems": N })
    }
}

/// The mirror of a struct, field by field: one that is left out does not compile.
macro_rules! mirror {
    ($($json:ident = $name:ident { $($(#[$attribute:meta])* $field:ident: $type:ty),+ $(,)? })+) => {$(
        #[derive(Debug, Clone, Serialize, Deserialize)]
        pub struct $json {
            $($(#[$attribute])* $field: <$type as Mirrored>::Json,)+
        }

        impl Mirrored for $name {
            type Json = $json;
            fn mirror(self) -> $json {
                $json { $($field: self.$field.mirror(),)+ }
            }
            fn back(json: $json) -> Self {
                Self { $($field: <$type as Mirrored>::back(json.$field),)+ }
            }
            fn schema() -> Value {
                object([$((stringify!($field), <$type as Mirrored>::schema()),)+])
            }
        }
    )+};
}

mirror! {
    PoseJson = Pose2 { x_m: f64, y_m: f64, yaw_rad: f64 }
    Pose3Json = Pose3 { x_m: f64, y_m: f64, z_m: f64, yaw_rad: f64, pitch_rad: f64 }
    TwistJson = Twist2 { vx_mps: f64, vy_mps: f64, wz_radps: f64 }
    WalkerMirror = Walker { x_m: f64, y_m: f64, radius_m: f64 }
    CueMirror = Cue {
        header: Header, kind: CueKind, source: CueSource, confidence: f32,
        // Older recordings know of no voice.
        #[serde(default)] signal_db: f32,
        #[serde(default)] clipped: f32,
        odom_from_start: Pose2, odometry_incarnation: u32, request_seq: u64,
    }
    CueRequestMirror = CueRequest { header: Header, kind: CueKind }
    CueAnswerMirror = CueAnswer {
        header: Header, kind: CueKind, source: CueSource, cue_incarnation: u32, cue_seq: u64, refusal: CueRefusal,
        reason: StopReason,
    }
    CueHeardMirror = CueHeard { header: Header, kind: CueKind, confidence: f32 }
    SpeechSaidMirror = SpeechSaid {
        header: Header, phase: SpeechPhase, urgency: Urgency, number: u64, about_ns: u64, first_sample_ns: u64,
        duration_ns: u64, reason: StopReason, text: SpeechText,
    }
    PolicyActionMirror = PolicyAction {
        header: Header, decision: u64, action_table_id: u64, action_count: u32,
        probabilities: [f32; messages::MAX_ACTIONS], cue_incarnation: u32, cue_seq: u64, scan_stamp_ns: u64,
        scan_seq: u64, depth_stamp_ns: u64, depth_seq: u64, odometry_stamp_ns: u64, odometry_seq: u64,
    }
    PermitMirror = Permit {
        header: Header, outcome: Outcome, cause: PermitCause, all_unsafe: bool, absent_streams: u32, decision: u64,
        action: u32, unsafe_mask: u32, velocity: Twist2, action_end_ns: u64, expiry_ns: u64, epoch: u64,
        policy_incarnation: u32, odometry_incarnation: u32, lidar_incarnation: u32, cue_incarnation: u32,
        cue_seq: u64, unseen_area_m2: f64, margin_m: f64, beam: u32, unsafe_cause: UnsafeCause, reading_m: f64,
        threshold_m: f64, scan_seq: u64, scan_stamp_ns: u64, depth_seq: u64, depth_stamp_ns: u64,
        odometry_seq: u64, odometry_stamp_ns: u64, robot_from_handler: Pose2,
    }
    StopReasonMirror = StopReason {
        kind: StopKind, service: ServiceId, topic: TopicId, incarnation: u32, age_ns: u64, limit_ns: u64,
        used: u64, used_limit: u64,
    }
    CueInForceMirror = CueInForce { valid: bool, cue: Cue }
    ModeMirror = Mode {
        header: Header, class: ModeClass, ready_for_cue: bool, active_policy: u32, previous_policy: u32,
        active_shield: u32, epoch: u64,
        reason: StopReason, cue: CueInForce,
    }
    LocomotionStateMirror = LocomotionState {
        header: Header, applied: Twist2, limited_by: StopReason, measured: Twist2, measured_valid: bool,
        permit_seq: u64, decision: u64, epoch: u64, own_from_robot: Pose2, own_stamp_ns: u64, charge_percent: u32,
        remote_stop: bool,
    }
    EmergencyStopMirror = EmergencyStop { header: Header, input: StopInput }
    WorldTruthMirror = WorldTruth {
        header: Header, world_from_robot: Pose2, robot_twist: Twist2, command: Twist2, command_since_ns: u64,
        world_from_handler: Pose2, distance_m: f64,
        robot_collisions: u32, handler_collisions: u32, hit_by_others: u32, walker_count: u32,
        walkers: [Walker; messages::MAX_WALKERS],
    }
}
