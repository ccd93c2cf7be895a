//! The sections of the configuration file and their defaults.

mod cue;
mod depth;
mod estop;
mod handler;
mod lidar;
mod locomotion;
mod max_age;
mod odometry;
mod policy;
mod robot;
mod shield;
mod sources;
mod speak;

use guidance::se2::Point;
use guidance::{
    AwarenessConfig, DelayedHarness, Disc, EdgeDistance, FloorInView, Footing, HandlerEstimate, HandlerLimits,
    HarnessError, Interaction, InteractionModel, MemoryConfig, Pace, RigidHarness, RotatingRod, ShieldConfig, StepMax,
};
use matching::CorrectedConfig;
use messages::{Formation, NS_PER_S, Pose2, TopicId};
use rplidar::Model;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use unitree::Silence;

use crate::path::ConfigPath;
use crate::planned::Planned;
use crate::recorded::{RecordSettings, Replay, RunRecordSettings};
use crate::units::Millis;

pub use cue::{Attention, CueSettings, TalkKey, VoiceSettings, VoiceSource};
pub use depth::*;
pub use estop::*;
pub use handler::{Handler, HandlerModel};
pub use lidar::*;
pub use locomotion::*;
pub use max_age::MaxAge;
pub use odometry::*;
pub use policy::{ActionTableName, PlannerUse, PolicyModel, PolicySettings, SwapSettings};
pub use robot::{Origin, Response, Robot};
pub use shield::{Choice, FloorSettings, MemorySettings, ShieldSettings, StepMaxSettings};
pub(crate) use speak::check as check_speak;
pub use speak::{Speak, SpokenLanguage, Verbosity};

/// Without a scan for longer, the handler's estimate is worth nothing, unless decisions are farther apart.
const SCAN_GAP_NS: u64 = NS_PER_S;
/// Nobody where the handler should be, where visible, for this long.
const NOT_SEEN_NS: u64 = NS_PER_S;
/// A handler knows what a sentence asks so long after the voice has begun to say it, nanoseconds.
const SAID_NS: u64 = NS_PER_S * 3 / 2;
/// A step back stays so far from every edge and step of the floor, metres.
const BACK_FROM_EDGES_M: f64 = 1.0;

/// Everything that can be configured.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The robot's body.
    pub robot: Robot,
    /// The handler, as fitted.
    pub handler: Handler,
    /// The lidar and its driver.
    pub lidar: LidarSettings,
    /// The depth camera and its driver.
    pub depth: DepthSettings,
    /// The odometry driver.
    pub odometry: OdometrySettings,
    /// The cue recogniser.
    pub cue: CueSettings,
    /// The policy.
    pub policy: PolicySettings,
    /// The action shield.
    pub shield: ShieldSettings,
    /// The last gate.
    pub locomotion: Locomotion,
    /// The emergency stop.
    pub estop: Estop,
    /// The robot's voice.
    pub speak: Speak,
    /// How old an input may be for motion.
    pub max_age: MaxAge,
    /// The supervisor.
    pub supervision: Supervision,
    /// Who may do what.
    pub access: Access,
    /// Fault injection.
    pub faults: Faults,
    /// The simulated world.
    pub simulation: Simulation,
    /// The walk, where the run is one.
    pub walk: Walk,
    /// The recording, where the run replays one.
    pub replay: Replay,
    /// What is recorded.
    pub record: RecordSettings,
    /// What every run leaves behind.
    pub run_record: RunRecordSettings,
    /// What is planned to happen.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub planned: Vec<Planned>,
}

impl Settings {
    /// Whether a real robot is commanded.
    #[must_use]
    pub fn commands_robot(&self) -> bool {
        self.locomotion.link.is_device() && !self.simulation.emulated.on
    }

    /// Whether poses come from a device that is really there.
    #[must_use]
    pub fn has_real_odometry(&self) -> bool {
        self.odometry.source == Source::Device && !self.simulation.emulated.on
    }

    /// Whether the link leads to this very machine, where only an emulated robot can be.
    #[must_use]
    pub fn robot_is_here(&self) -> bool {
        let locomotion = &self.locomotion;
        match locomotion.link.row().far_end {
            FarEnd::Nothing | FarEnd::SimulatedRobot => false,
            FarEnd::Robot => locomotion.unitree.robot().ip().is_loopback(),
            FarEnd::DdsRobot(_) => {
                let networks = &locomotion.dds.networks;
                !networks.is_empty() && networks.iter().all(std::net::Ipv4Addr::is_loopback)
            }
        }
    }

    /// What the handler's estimate is held to.
    #[must_use]
    pub fn handler_limits(&self) -> HandlerLimits {
        let table = self.policy.actions.table();
        let speeds_mps = table.actions().iter().map(|action| action.velocity(self.policy.dt.s()).speed_mps());
        HandlerLimits {
            radius_m: self.handler.radius_m.get(),
            seen_radius_m: self.handler.seen_radius_m.get(),
            speed_max_mps: speeds_mps.fold(0.0, f64::max),
            not_seen_ns: NOT_SEEN_NS,
        }
    }

    /// What measurements are held to before shield, policy and episodes judge on them.
    #[must_use]
    pub fn awareness_config(&self) -> AwarenessConfig {
        let limits = &self.locomotion.limits;
        AwarenessConfig {
            limits: self.handler_limits(),
            memory: self.memory_config(),
            pace: Pace::of_limits(limits.speed_mps.get(), limits.turn_radps.get()),
            // The policy and episodes take a scan for each decision.
            scan_gap_ns: SCAN_GAP_NS.max(2 * self.policy.dt.ns()),
            scan_max_age_ns: self.max_age_ns(TopicId::LidarScan),
            depth_max_age_ns: self.max_age_ns(TopicId::DepthFrame),
            // The shield alone takes its scans.
            second_max_age_ns: None,
            odometry_max_age_ns: self.max_age_ns(TopicId::Odometry),
            depth_min_m: self.depth.range_m[0],
            depth_needed: self.depth.needed,
        }
    }

    /// When the handler knows what a stop asks of them, after it began, nanoseconds. None: the robot does not speak.
    #[must_use]
    pub fn asked_after_ns(&self) -> Option<u64> {
        self.speak.on.then(|| self.speak.hold_after.ns().saturating_add(SAID_NS))
    }

    /// Whether scans correct the odometry: as it is said, else where both come from devices.
    #[must_use]
    pub fn matches_scans(&self) -> bool {
        let are_devices = (self.lidar.source, self.odometry.source) == (Source::Device, Source::Device);
        self.odometry.matching.on.unwrap_or(are_devices)
    }

    /// How odometry is corrected by scans: robot and handler, who move with the lidar, are left out of them.
    ///
    /// # Errors
    /// Where the handler's parameters are no handler's.
    pub fn matching_config(&self) -> Result<CorrectedConfig, HarnessError> {
        let robot = Disc { center: Point::origin(), radius_m: self.robot.radius_m.get() };
        let handler = HandlerEstimate::new(self.interaction()?, self.handler_limits()).everywhere();
        Ok(self.odometry.matching.config(vec![robot, handler]))
    }

    /// How the shield judges.
    #[must_use]
    pub fn shield_config(&self) -> ShieldConfig {
        let shield = &self.shield;
        ShieldConfig {
            robot_radius_m: self.robot.radius_m.get(),
            margin_m: shield.margin_m,
            unknown_gap_m: shield.unknown_gap_m.get(),
            escape: shield.escape,
            unseen_limit_m2: shield.unseen_limit_m2,
            back_from_edges_m: Some(BACK_FROM_EDGES_M),
            reach: self.reach(),
            edges: EdgeDistance { ahead_m: shield.floor.edge_ahead_m, beside_m: shield.floor.edge_beside_m },
        }
    }

    /// Where robot and handler really stand after a stop.
    fn reach(&self) -> guidance::Reach {
        let (robot, response) = (&self.robot, &self.robot.response);
        // What is no handler's model is refused where the handler's estimate is made.
        let rest = self.shield.until_rest.then(|| self.interaction().ok()).flatten();
        let actions = self.policy.actions.table();
        let dt_s = self.policy.dt.s();
        let fastest = actions.actions().iter().map(|action| action.velocity(dt_s)).fold([0.0_f64; 3], |most, v| {
            [most[0].max(v.vx_mps.abs()), most[1].max(v.vy_mps.abs()), most[2].max(v.wz_radps.abs())]
        });
        let [ahead_m, aside_m] = response.overrun_m;
        let carried_s = [ahead_m / fastest[0], aside_m / fastest[1], response.overrun_rad / fastest[2]];
        guidance::Reach {
            nose_m: robot.nose_m,
            carried_s,
            robot_from_rest: rest.map(|model| model.robot_from_default()),
            walks_on_s: self.handler.walks_on_s,
        }
    }

    /// The room that the robot stands on; none where its floor is not watched.
    #[must_use]
    pub fn footing(&self) -> Option<Footing> {
        let watches = self.shield.floor.watched && self.depth.source != Source::Absent;
        watches.then(|| Footing {
            radius_m: self.robot.radius_m.get(),
            nose_m: self.robot.nose_m,
            handler_m: self.handler.radius_m.get(),
            overrun_m: self.robot.response.overrun_m[0],
            overrun_rad: self.robot.response.overrun_rad,
            step_max: self.step_max(),
        })
    }

    /// How high a step in the floor may be that is taken.
    #[must_use]
    pub fn step_max(&self) -> StepMax {
        StepMax { down_m: self.shield.floor.step_max_m.down, up_m: self.shield.floor.step_max_m.up }
    }

    /// The floor on which the camera finds edges while the body is level; none where there is no camera, or it sees
    /// none.
    #[must_use]
    pub fn floor_in_view(&self) -> Option<FloorInView> {
        let depth = &self.depth;
        (depth.source != Source::Absent).then(|| FloorInView::of(&depth.header(), depth.range_m)).flatten()
    }

    /// Distance ahead of the robot's middle at which two frames must have shown an edge, metres.
    #[must_use]
    pub fn edge_wanted_m(&self) -> f64 {
        let (robot, dt_s) = (&self.robot, self.policy.dt.s());
        let actions = self.policy.actions.table();
        let ahead_m = actions.actions().iter().map(|action| action.motion.x_m).fold(0.0_f64, f64::max);
        let front_m = robot.nose_m + robot.radius_m.get() + self.shield.margin_m + robot.response.overrun_m[0];
        let frames_m = 2.0 * ahead_m / dt_s / self.depth.rate_hz.get();
        front_m + ahead_m + self.shield.floor.edge_ahead_m + frames_m
    }

    /// Whether anything watches the floor.
    #[must_use]
    pub fn watches_floor(&self) -> bool {
        self.shield.memory.on && self.footing().is_some()
    }

    /// What is remembered; none: one scan and one frame decide alone.
    #[must_use]
    pub fn memory_config(&self) -> Option<MemoryConfig> {
        let memory = &self.shield.memory;
        memory.on.then(|| memory.config(self.footing()))
    }

    /// The handler's interaction model in a formation, one step of which is a decision.
    ///
    /// # Errors
    /// Where the parameters are no handler's; the reason says which.
    pub fn interaction_in(&self, formation: Formation) -> Result<InteractionModel, HarnessError> {
        let beside = self.interaction()?;
        match formation {
            Formation::Beside => Ok(beside),
            Formation::Behind => beside.at(Pose2::new(-self.handler.behind_m.get(), 0.0, 0.0)),
        }
    }

    /// The share of its speed at which the robot makes its motions in a formation.
    #[must_use]
    pub fn speed_in(&self, formation: Formation) -> f64 {
        match formation {
            Formation::Beside => 1.0,
            Formation::Behind => self.handler.behind_speed.get(),
        }
    }

    /// How the handler follows beside the robot.
    ///
    /// # Errors
    /// As [`Settings::interaction_in`].
    pub fn interaction(&self) -> Result<InteractionModel, HarnessError> {
        let handler = &self.handler;
        Ok(match handler.model {
            HandlerModel::Delayed => {
                let alpha = handler.alpha.get();
                InteractionModel::Delayed(DelayedHarness::new(handler.robot_from_handler, alpha, self.policy.dt.s())?)
            }
            HandlerModel::Rigid => InteractionModel::Rigid(RigidHarness::new(handler.robot_from_handler)?),
            HandlerModel::Rod => {
                let [x_m, y_m] = handler.rod_grip_m;
                InteractionModel::Rod(RotatingRod::new(x_m, y_m, handler.rod_length_m.get())?)
            }
        })
    }
}

/// Where a driver's frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// Computed from the simulated world.
    Simulated,
    /// Read from a device.
    Device,
    /// Published by `replay` in the driver's place.
    Replayed,
    /// There is none; declared in every permit, and refused with a real link.
    Absent,
}

/// Who may do what through the control socket, besides the run's own user and root, who may everything.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Access {
    /// Members of the socket's group may command, not only read.
    pub group_may_command: bool,
}

/// The supervisor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Supervision {
    /// From spawn to ready, wall time.
    pub ready_within: Millis,
    /// A critical service whose last beat is older is at fault.
    pub beat_limit: Millis,
    /// The same in stepped time: a step not done, wall time.
    pub step_limit: Millis,
    /// First pause before a restart; it doubles with every restart in a row.
    pub back_off: Millis,
    /// Longest pause before a restart.
    pub back_off_max: Millis,
    /// Restarts of one service within `budget_window` before it stays down and the run locks.
    pub restart_budget: u32,
    /// See `restart_budget`.
    pub budget_window: Millis,
    /// Memory of its own that a critical service may have, mebibytes: a larger process is slower to die.
    pub memory_mib: u32,
    /// The same for depth and policy, which cannot stay as small.
    pub large_memory_mib: u32,
    /// Descriptors that a critical service may have open.
    pub open_files: u32,
    /// The brake engages when locomotion's last beat is older.
    pub brake_limit: Millis,
    /// Stepped time: a restarted service joins at death plus this much run time.
    pub restart_time: Millis,
}

impl Default for Supervision {
    fn default() -> Self {
        Self {
            ready_within: Millis::of_ms(10_000),
            beat_limit: Millis::of_ms(120),
            step_limit: Millis::of_ms(10_000),
            back_off: Millis::of_ms(20),
            back_off_max: Millis::of_ms(2_000),
            restart_budget: 10,
            budget_window: Millis::of_ms(60_000),
            memory_mib: 32,
            large_memory_mib: 256,
            open_files: 256,
            brake_limit: Millis::of_ms(100),
            restart_time: Millis::of_ms(500),
        }
    }
}

/// Fault injection.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Faults {
    /// Whether `guidedog inject` may break things in the run.
    pub allowed: bool,
}

/// The simulated world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Simulation {
    /// Seed of everything random in the world and its sensors.
    pub seed: u64,
    /// Sway of the simulated handler, metres.
    pub handler_sway_m: f64,
    /// What moves robot and handler.
    pub physics: PhysicsKind,
    /// How real the robot of the project's own world is.
    pub noise: SimulatedNoise,
    /// The legged robot and the handler of `physics = "mujoco"`.
    pub mujoco: Mujoco,
    /// Devices in the simulated world, for the real drivers.
    pub emulated: Emulated,
}

/// How real the robot of the project's own world is. Its sensors' noise stands in their own sections.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SimulatedNoise {
    /// It obeys exactly, on a level body.
    #[default]
    Noisy,
    /// It walks on legs by `[robot.response]` and `[robot.gait]`: it lags, overruns, sways, tilts and slips.
    Legged,
}

/// What moves robot and handler in the simulated world.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PhysicsKind {
    /// The project's own flat world.
    #[default]
    Flat,
    /// A legged robot in MuJoCo, which `guidedog-mujoco` simulates.
    Mujoco,
}

impl PhysicsKind {
    /// The program that simulates it.
    #[must_use]
    pub const fn program(self) -> &'static str {
        match self {
            Self::Flat => "guidedog-simulator",
            Self::Mujoco => "guidedog-mujoco",
        }
    }
}

/// How the velocity of a legged robot is kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VelocityLoop {
    /// As the package has it that brings the walking policy.
    #[default]
    Soft,
    /// Twice as fast, with a trim that fades while the body leans.
    Stiff,
}

/// A legged robot and a handler in MuJoCo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mujoco {
    /// The robot's model (MJCF); without it the Go2 that `scripts/mujoco` brings.
    pub model: Option<ConfigPath>,
    /// The policy that it walks by (ONNX); without it the one that `scripts/mujoco` brings.
    pub policy: Option<ConfigPath>,
    /// SHA-256 of the model's file in hexadecimal digits. Another file is refused. Each run sets it, so that recordings
    /// have it.
    pub model_sha256: Option<String>,
    /// The same of the policy's file.
    pub policy_sha256: Option<String>,
    /// How its velocity is kept.
    pub velocity_loop: VelocityLoop,
    /// Mass of all its parts, times that of the model.
    pub mass_scale: f64,
    /// Friction of the floor: sliding, without unit.
    pub friction: f64,
    /// Mass of the handler, kilograms.
    pub handler_mass_kg: f64,
    /// Until the handler answers what the harness tells.
    pub handler_reaction: Millis,
    /// The most that the handler speeds up or slows down, m/s^2.
    pub handler_acceleration_mps2: f64,
}

impl Default for Mujoco {
    fn default() -> Self {
        Self {
            model: None,
            policy: None,
            model_sha256: None,
            policy_sha256: None,
            velocity_loop: VelocityLoop::Soft,
            mass_scale: 1.0,
            friction: 1.0,
            handler_mass_kg: 70.0,
            handler_reaction: Millis::of_ms(300),
            handler_acceleration_mps2: 2.0,
        }
    }
}

/// Devices that are emulated in the simulated world, for the drivers and the link that speak to real ones.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Emulated {
    /// Whether there are any.
    pub on: bool,
    /// Which RPLIDAR.
    #[schemars(with = "String")]
    pub rplidar: Model,
    /// What the robot of `[locomotion.unitree]` does when nothing more comes.
    #[schemars(with = "String")]
    pub silence: Silence,
}

impl Default for Emulated {
    fn default() -> Self {
        Self { on: false, rplidar: Model::S2, silence: Silence::HoldsLast }
    }
}

impl Default for Simulation {
    fn default() -> Self {
        Self {
            seed: 1,
            handler_sway_m: 0.01,
            physics: PhysicsKind::Flat,
            noise: SimulatedNoise::Noisy,
            mujoco: Mujoco::default(),
            emulated: Emulated::default(),
        }
    }
}

/// The walk, where the run is one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Walk {
    /// A scenario file: world, start, route and goal.
    pub scenario: Option<ConfigPath>,
    /// A map_server map in place of a scenario.
    pub map: Option<ConfigPath>,
    /// Start in the map, world frame.
    #[schemars(with = "Option<crate::schema::Pose2>")]
    pub start: Option<Pose2>,
    /// A route file: cues and goal, in place of the scenario's.
    pub cues: Option<ConfigPath>,
    /// What the handler does wrong.
    pub errors: WalkErrors,
    /// The run ends after this much run time, whatever happened.
    pub time_limit: Option<Millis>,
}

/// The errors of a simulated handler (Kim et al. 2023, section 3 and figure 8).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WalkErrors {
    /// Facing off the travel line at the start, degrees to the left.
    pub orientation_deg: f64,
    /// The cues of places come so much too late (negative: too early), metres of way.
    pub timing_m: f64,
}
