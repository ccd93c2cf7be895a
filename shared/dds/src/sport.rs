//! Unitree's sport service: requests, answers and states of a Go2 or B2, after the IDL of `unitree_sdk2`.

use messages::Twist2;
use serde::{Deserialize, Serialize};
use unitree::Remote;

use crate::{Posture, RobotState};

/// Topic and type of requests.
pub const REQUEST: [&str; 2] = ["rt/api/sport/request", "unitree_api::msg::dds_::Request_"];
/// Topic and type of answers.
pub const RESPONSE: [&str; 2] = ["rt/api/sport/response", "unitree_api::msg::dds_::Response_"];
/// Topic and type of states.
pub const STATE: [&str; 2] = ["rt/sportmodestate", "unitree_go::msg::dds_::SportModeState_"];
/// Topic and type of what is below: battery and hand remote among it.
pub const LOW_STATE: [&str; 2] = ["rt/lowstate", "unitree_go::msg::dds_::LowState_"];

/// What can be asked for; the same numbers on Go2 and B2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i64)]
pub enum Api {
    /// Unlocks the joints of a robot that stands up.
    BalanceStand = 1002,
    /// Stands.
    StopMove = 1003,
    /// Walks at a velocity, which the robot keeps for a second.
    Move = 1008,
}

impl Api {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::BalanceStand, Self::StopMove, Self::Move];

    /// The one of that number.
    #[must_use]
    pub fn of(id: i64) -> Option<Self> {
        Self::ALL.into_iter().find(|api| *api as i64 == id)
    }
}

/// Which request, and what for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Its number.
    pub id: i64,
    /// What is asked for, by the number of [`Api`].
    pub api_id: i64,
}

/// `unitree_api::msg::dds_::RequestHeader_`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestHeader {
    /// Which.
    pub identity: Identity,
    /// Nobody has leased the robot: 0.
    pub lease_id: i64,
    /// Not told: 0.
    pub priority: i32,
    /// No answer is wanted.
    pub noreply: bool,
}

/// `unitree_api::msg::dds_::Request_`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Request {
    /// Which.
    pub header: RequestHeader,
    /// JSON.
    pub parameter: String,
    /// Not used by the sport service.
    pub binary: Vec<u8>,
}

/// A walk's parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Velocity {
    x: f64,
    y: f64,
    z: f64,
}

impl Request {
    /// A request for something that has no parameter, with an answer.
    #[must_use]
    pub fn plain(id: i64, api: Api) -> Self {
        let identity = Identity { id, api_id: api as i64 };
        Self { header: RequestHeader { identity, ..RequestHeader::default() }, ..Self::default() }
    }

    /// A request to walk; another one follows, so that no answer is wanted.
    #[must_use]
    pub fn walk(id: i64, velocity: Twist2) -> Self {
        let mut request = Self::plain(id, Api::Move);
        request.header.noreply = true;
        let Twist2 { vx_mps: x, vy_mps: y, wz_radps: z } = velocity;
        request.parameter = serde_json::to_string(&Velocity { x, y, z }).unwrap_or_default();
        request
    }

    /// The velocity that is asked for, where it is one: the robot's side.
    #[must_use]
    pub fn velocity(&self) -> Option<Twist2> {
        let Velocity { x, y, z } = serde_json::from_str(&self.parameter).ok()?;
        let velocity = Twist2 { vx_mps: x, vy_mps: y, wz_radps: z };
        velocity.is_finite().then_some(velocity)
    }
}

/// `unitree_api::msg::dds_::Response_`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Response {
    /// Which request is answered.
    pub identity: Identity,
    /// 0 where it is done.
    pub code: i32,
    /// Not used by what is asked here.
    pub data: String,
    /// Nor this.
    pub binary: Vec<u8>,
}

/// `unitree_go::msg::dds_::IMUState_`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Imu {
    /// Attitude: w, x, y, z.
    pub quaternion: [f32; 4],
    /// rad/s.
    pub gyroscope: [f32; 3],
    /// m/s2.
    pub accelerometer: [f32; 3],
    /// Roll, pitch, yaw, radians.
    pub rpy: [f32; 3],
    /// Degrees Celsius.
    pub temperature: u8,
}

impl Default for Imu {
    fn default() -> Self {
        let zero = [0.0; 3];
        Self { quaternion: [1.0, 0.0, 0.0, 0.0], gyroscope: zero, accelerometer: zero, rpy: zero, temperature: 0 }
    }
}

/// `unitree_go::msg::dds_::PathPoint_`: when, and where to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PathPoint([f32; 7]);

/// `unitree_go::msg::dds_::SportModeState_`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SportModeState {
    /// Of the robot's own clock: seconds and nanoseconds.
    pub stamp: (i32, u32),
    /// 0 where all is well.
    pub error_code: u32,
    /// Attitude.
    pub imu_state: Imu,
    /// What it does with its legs.
    pub mode: u8,
    /// Of a dance.
    pub progress: f32,
    /// Which gait.
    pub gait_type: u8,
    /// Metres.
    pub foot_raise_height: f32,
    /// Where it believes to be since it was switched on, metres: forward, left, up. It drifts.
    pub position: [f32; 3],
    /// Metres.
    pub body_height: f32,
    /// m/s: forward, left, up.
    pub velocity: [f32; 3],
    /// rad/s.
    pub yaw_speed: f32,
    /// Metres.
    pub range_obstacle: [f32; 4],
    /// Of each foot.
    pub foot_force: [i16; 4],
    /// Metres.
    pub foot_position_body: [f32; 12],
    /// m/s.
    pub foot_speed_body: [f32; 12],
    /// Where to.
    pub path_point: [PathPoint; 10],
}

/// Modes that are told apart.
pub mod mode {
    /// It stands and balances.
    pub const BALANCE_STAND: u8 = 1;
    /// It walks.
    pub const LOCOMOTION: u8 = 3;
    /// It lies.
    pub const LIE_DOWN: u8 = 5;
    /// It stands with its joints locked.
    pub const JOINT_LOCK: u8 = 6;
    /// It is limp.
    pub const DAMPING: u8 = 7;
}

impl SportModeState {
    /// What it says of where the robot is and goes; nothing, where its numbers are none.
    #[must_use]
    pub fn state(&self) -> Option<RobotState> {
        let [vx, vy, _] = self.velocity.map(f64::from);
        let velocity = Twist2 { vx_mps: vx, vy_mps: vy, wz_radps: self.yaw_speed.into() };
        let [w, x, y, z] = self.imu_state.quaternion.map(f64::from);
        let posture = match self.mode {
            mode::LIE_DOWN | mode::DAMPING => Posture::Down,
            mode::JOINT_LOCK => Posture::Locked,
            _ => Posture::Ready,
        };
        RobotState::checked(velocity, [self.position[0].into(), self.position[1].into()], [w, x, y, z], posture)
    }
}

/// `unitree_go::msg::dds_::MotorState_`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Motor {
    mode: u8,
    joint: [f32; 7],
    temperature: u8,
    lost: u32,
    reserve: [u32; 2],
}

/// `unitree_go::msg::dds_::BmsState_`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Battery {
    version: [u8; 2],
    status: u8,
    /// Charge, percent.
    pub soc: u8,
    current: i32,
    cycle: u16,
    temperatures: [u8; 4],
    cell_vol: [u16; 15],
}

/// `unitree_go::msg::dds_::LowState_`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LowState {
    head: [u8; 2],
    level_flag: u8,
    frame_reserve: u8,
    sn: [u32; 2],
    version: [u32; 2],
    bandwidth: u16,
    imu_state: Imu,
    motor_state: [Motor; 20],
    /// Battery.
    pub bms_state: Battery,
    foot_force: [i16; 4],
    foot_force_est: [i16; 4],
    tick: u32,
    /// As [`Remote`] has it.
    wireless_remote: [[u8; 20]; 2],
    bit_flag: u8,
    adc_reel: f32,
    temperature_ntc: [u8; 2],
    power_v: f32,
    power_a: f32,
    fan_frequency: [u16; 4],
    reserve: u32,
    crc: u32,
}

impl LowState {
    /// The hand remote.
    #[must_use]
    pub fn remote(&self) -> Remote {
        Remote::decode(self.wireless_remote.as_flattened())
    }

    /// A state that says this of remote and battery: the robot's side.
    #[must_use]
    pub fn of(remote: Remote, charge_percent: u8) -> Self {
        let mut state = Self { bms_state: Battery { soc: charge_percent, ..Battery::default() }, ..Self::default() };
        remote.encode(state.wireless_remote.as_flattened_mut());
        state
    }
}
