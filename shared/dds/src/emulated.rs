//! A Go2's side: what it makes of its requests, and what it says of itself.

use messages::Twist2;
use unitree::{Remote, Silence, State};

use crate::sport::{Api, Imu, LowState, Request, Response, SportModeState, mode};

/// A Go2 keeps a velocity for so long, as its maker says, nanoseconds.
const KEPT_NS: u64 = 1_000_000_000;
/// What a server answers that does not know what is asked.
const NOT_IMPLEMENTED: i32 = 3203;
/// What it answers to a parameter that is none.
const BAD_PARAMETER: i32 = 3204;

/// An emulated Go2: it takes every velocity at once, and leaves where it gets to whoever moves it.
#[derive(Debug, Clone)]
pub struct EmulatedGo2 {
    silence: Silence,
    velocity: Twist2,
    commanded_ns: u64,
    locked: bool,
    limp: bool,
    remote: Remote,
}

impl EmulatedGo2 {
    /// A robot that has just stood up, its joints locked; one that holds its last velocity for ever is worse than any
    /// that its maker describes.
    #[must_use]
    pub fn new(silence: Silence) -> Self {
        Self { silence, velocity: Twist2::ZERO, commanded_ns: 0, locked: true, limp: false, remote: Remote::default() }
    }

    /// Takes a request: its answer, where one is wanted.
    pub fn received(&mut self, request: &Request, now_ns: u64) -> Option<Response> {
        let identity = request.header.identity;
        let code = match (Api::of(identity.api_id), request.velocity()) {
            (Some(Api::BalanceStand), _) => {
                self.locked = false;
                0
            }
            (Some(Api::StopMove), _) => {
                self.velocity = Twist2::ZERO;
                0
            }
            (Some(Api::Move), Some(velocity)) => {
                (self.velocity, self.commanded_ns) = (velocity, now_ns);
                0
            }
            (Some(Api::Move), None) => BAD_PARAMETER,
            (None, _) => NOT_IMPLEMENTED,
        };
        let wanted = !request.header.noreply;
        wanted.then(|| Response { identity, code, ..Response::default() })
    }

    /// What is pressed on its hand remote from now on.
    pub fn press(&mut self, remote: Remote) {
        self.remote = remote;
        if remote.says_stop() {
            (self.limp, self.velocity) = (true, Twist2::ZERO);
        }
    }

    /// Whoever holds its hand remote makes it stand again after a stop.
    pub fn recover(&mut self) {
        (self.limp, self.locked) = (false, false);
    }

    /// How fast it goes.
    #[must_use]
    pub fn velocity(&self, now_ns: u64) -> Twist2 {
        let kept = self.silence == Silence::HoldsLast || now_ns.saturating_sub(self.commanded_ns) <= KEPT_NS;
        if kept && !self.locked && !self.limp { self.velocity } else { Twist2::ZERO }
    }

    /// What it does with its legs, by its maker's number.
    #[must_use]
    pub fn mode(&self, now_ns: u64) -> u8 {
        match (self.limp, self.locked, self.velocity(now_ns).is_zero()) {
            (true, ..) => mode::DAMPING,
            (false, true, _) => mode::JOINT_LOCK,
            (false, false, true) => mode::BALANCE_STAND,
            (false, false, false) => mode::LOCOMOTION,
        }
    }

    /// What it says of itself, of what its sensors have measured.
    #[must_use]
    pub fn state(&self, measured: &State, now_ns: u64) -> SportModeState {
        let (velocity, rpy) = (measured.velocity, measured.roll_pitch_yaw_rad().map(|angle_rad| angle_rad as f32));
        SportModeState {
            stamp: ((now_ns / 1_000_000_000) as i32, (now_ns % 1_000_000_000) as u32),
            imu_state: Imu { quaternion: measured.quaternion, rpy, ..Imu::default() },
            mode: self.mode(now_ns),
            position: measured.position_m,
            body_height: measured.position_m[2],
            velocity: [velocity.vx_mps as f32, velocity.vy_mps as f32, 0.0],
            yaw_speed: velocity.wz_radps as f32,
            ..SportModeState::default()
        }
    }

    /// What it says of remote and battery.
    #[must_use]
    pub fn low_state(&self, charge_percent: u8) -> LowState {
        LowState::of(self.remote, charge_percent)
    }
}

#[cfg(test)]
mod tests {
    use messages::{Attitude, Pose2, Twist2};
    use unitree::{Button, Remote, Silence, State};

    use super::EmulatedGo2;
    use crate::Posture;
    use crate::sport::{Api, Request};

    const AHEAD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: -0.25, wz_radps: 0.125 };

    #[test]
    fn a_go2_walks_once_it_balances_and_as_long_as_it_is_told() {
        for (silence, after) in [(Silence::HoldsLast, AHEAD), (Silence::Stands, Twist2::ZERO)] {
            let mut robot = EmulatedGo2::new(silence);
            assert_eq!(robot.received(&Request::walk(1, AHEAD), 0), None, "no answer is wanted");
            assert_eq!(robot.velocity(0), Twist2::ZERO, "its joints are locked");
            let balanced = robot.received(&Request::plain(2, Api::BalanceStand), 0).expect("an answer");
            assert_eq!((balanced.identity.id, balanced.code), (2, 0));
            robot.received(&Request::walk(3, AHEAD), 0);
            assert_eq!((robot.velocity(999_000_000), robot.velocity(1_001_000_000)), (AHEAD, after));
            let attitude =
                Attitude { stamp_ns: 1, roll_rad: 0.1, pitch_rad: -0.2, height_m: 0.27, ..Attitude::default() };
            let told = robot.state(&State::held(Pose2::new(1.0, 2.0, 0.5), &attitude, AHEAD, None), 0);
            assert_eq!((told.position, told.body_height), ([1.0, 2.0, 0.27], 0.27));
            let state = told.state().expect("a state");
            assert_eq!((state.velocity, state.posture), (AHEAD, Posture::Ready));
            let [roll_rad, pitch_rad] = state.roll_pitch_rad;
            let off = [roll_rad - 0.1, pitch_rad + 0.2, state.own_from_robot.yaw_rad - 0.5];
            assert!(off.iter().all(|off_rad| off_rad.abs() < 1e-6), "{off:?}");
            robot.received(&Request::plain(4, Api::StopMove), 0);
            assert_eq!(robot.velocity(0), Twist2::ZERO);
        }
    }

    #[test]
    fn what_is_no_request_is_answered_so() {
        let mut robot = EmulatedGo2::new(Silence::Stands);
        let mut wrong = Request::plain(1, Api::Move);
        assert_eq!(robot.received(&wrong, 0).map(|answer| answer.code), Some(3204));
        wrong.header.identity.api_id = 1036;
        assert_eq!(robot.received(&wrong, 0).map(|answer| answer.code), Some(3203));
    }

    #[test]
    fn a_stop_by_the_remote_is_seen_in_both_states() {
        let mut robot = EmulatedGo2::new(Silence::HoldsLast);
        let buttons = 1 << Button::L2 as u16 | 1 << Button::B as u16;
        robot.press(Remote { buttons, ..Remote::default() });
        let state = robot.state(&State::default(), 0).state().expect("a state");
        assert_eq!(state.posture, Posture::Down);
        let low = robot.low_state(61);
        assert!(low.remote().says_stop() && low.bms_state.soc == 61);
    }
}
