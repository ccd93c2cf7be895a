//! The robot's own odometry, as its link passes it on.

use messages::{Attitude, LocomotionState, Odometry, Twist2, s_from_ns};
use settings::Settings;
use transport::{Io, Rhythm, Subscriber, TransportError};

use crate::PoseSource;

/// Poses that the robot tells.
#[derive(Debug)]
pub struct RobotOdometry {
    states: Subscriber<LocomotionState>,
    rhythm: Rhythm,
    /// Stamp of the last pose published, nanoseconds.
    told_ns: u64,
    /// Way and turning since the first pose: metres, radians.
    travelled: (f64, f64),
    last: Option<Odometry>,
    /// Height of its body, metres: no robot tells one that can be trusted on stairs and slopes.
    body_height_m: f64,
}

/// The link tells at whole periods; asked so much later, its word is there, nanoseconds.
const BEHIND_NS: u64 = 3_000_000;
/// A robot that said nothing for so long may have been switched off and on, and counts anew then, nanoseconds.
const AWAY_NS: u64 = 1_000_000_000;
/// Legs slip: one standard deviation of the place after 1 m of way, metres.
const PLACE_SIGMA: f64 = 0.02;
/// One standard deviation of the heading after 1 m of way, and after a turn of 1 rad; radians.
const YAW_SIGMA: [f64; 2] = [0.01, 0.01];

impl RobotOdometry {
    /// Hears the link from now on.
    ///
    /// # Errors
    /// Where the topic cannot be opened.
    pub fn open(settings: &Settings, io: &mut Io) -> Result<Self, TransportError> {
        let rhythm = Rhythm::at_hz(settings.odometry.rate_hz.get());
        let body_height_m = settings.robot.body_height_m.get();
        let (travelled, last) = ((0.0, 0.0), None);
        Ok(Self { states: io.quiet_subscriber()?, rhythm, told_ns: 0, travelled, last, body_height_m })
    }

    fn pose(&mut self, state: &LocomotionState) -> Odometry {
        let pose = state.own_from_robot;
        if let Some(last) = &self.last {
            let before = last.odom_from_robot;
            self.travelled.0 += (pose.x_m - before.x_m).hypot(pose.y_m - before.y_m);
            self.travelled.1 += (pose.yaw_rad - before.yaw_rad).sin().abs();
        }
        let (way_m, turn_rad) = self.travelled;
        let twist = if state.measured_valid { state.measured } else { Twist2::ZERO };
        let yaw = YAW_SIGMA[0] * way_m.sqrt() + YAW_SIGMA[1] * turn_rad.sqrt();
        let sigma = [PLACE_SIGMA * way_m, PLACE_SIGMA * way_m, yaw];
        let [roll_rad, pitch_rad] = state.own_roll_pitch_rad;
        let attitude = Attitude::at_height(state.own_stamp_ns, roll_rad, pitch_rad, self.body_height_m);
        let odometry = Odometry { odom_from_robot: pose, twist, sigma, attitude, ..Odometry::default() };
        self.last = Some(odometry);
        odometry
    }
}

impl PoseSource for RobotOdometry {
    fn next_timer_ns(&self) -> Option<u64> {
        Some(self.rhythm.next_ns() + BEHIND_NS)
    }

    fn poll(&mut self, io: &Io) -> Result<Option<(u64, Odometry)>, TransportError> {
        if self.rhythm.due(io.now_ns().saturating_sub(BEHIND_NS)).is_none() {
            return Ok(None);
        }
        // A state without a pose, or with one that was told already, is no news: the stream grows old, and that stops.
        let newest = self.states.take_newest()?.filter(|state| state.own_stamp_ns > self.told_ns);
        let Some(state) = newest else { return Ok(None) };
        let silent_ns = state.own_stamp_ns - self.told_ns;
        if self.told_ns > 0 && silent_ns > AWAY_NS {
            // A new life is a new odometry frame, which everybody notices.
            let text =
                format!("the robot was silent for {:.1} s, and may count anew: so does odometry", s_from_ns(silent_ns));
            return Err(TransportError::Service(text));
        }
        self.told_ns = state.own_stamp_ns;
        Ok(Some((state.own_stamp_ns, self.pose(&state))))
    }
}
