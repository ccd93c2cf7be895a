//! Robots on a DDS network.

use ::dds::EmulatedGo2;
use ::dds::bus::{BusError, Ros2Server, SportServer};
use ::dds::ros2::{Header, Odometry, Twist};
use ::dds::sport::{LowState, Request, SportModeState};
use messages::{Fault, NS_PER_S, Twist2};
use settings::{DdsSettings, Ros2Settings};
use unitree::{Button, Remote, SILENT_NS, Silence, State};

use crate::EmulatedRobot;
use crate::cable::{Trouble, lost};

/// From one state to the next, nanoseconds.
const STATE_NS: u64 = 10_000_000;
/// Of a robot that does not tell it otherwise, percent.
const CHARGE_PERCENT: u8 = 80;

/// A Go2 or B2.
pub struct EmulatedSport {
    server: SportServer,
    robot: EmulatedGo2,
    told_ns: u64,
    line: Trouble<Request, (SportModeState, LowState)>,
}

impl EmulatedSport {
    /// Switches a robot on that has just stood up.
    ///
    /// # Errors
    /// Where it cannot take part in its network.
    pub fn new(dds: &DdsSettings, silence: Silence) -> Result<Self, BusError> {
        let (server, robot) = (SportServer::open(dds)?, EmulatedGo2::new(silence));
        Ok(Self { server, robot, told_ns: 0, line: Trouble::none() })
    }
}

impl EmulatedRobot for EmulatedSport {
    fn velocity(&self, now_ns: u64) -> Twist2 {
        self.robot.velocity(now_ns)
    }

    fn posture(&self, now_ns: u64) -> String {
        format!("mode {}", self.robot.mode(now_ns))
    }

    fn suffer(&mut self, fault: Option<(Fault, u64)>) {
        match self.line.suffer(fault) {
            Some(true) => {
                let buttons = 1 << Button::L2 as u16 | 1 << Button::B as u16;
                self.robot.press(Remote { buttons, ..Remote::default() });
            }
            Some(false) => {
                self.robot.press(Remote::default());
                self.robot.recover();
            }
            None => {}
        }
    }

    fn hear(&mut self, now_ns: u64) -> std::io::Result<()> {
        let line = &mut self.line;
        self.server.each_request(|request| line.heard.put(now_ns, request, line.fault, lost));
        while let Some(request) = self.line.heard.take(now_ns) {
            let answer = self.robot.received(&request, now_ns);
            let heard = !matches!(self.line.fault, Some(Fault::Silent | Fault::Unplugged));
            if let Some(answer) = answer.filter(|_| heard) {
                self.server.answer(answer);
            }
        }
        Ok(())
    }

    fn serve(&mut self, now_ns: u64, measured: State) -> std::io::Result<()> {
        self.hear(now_ns)?;
        if now_ns.saturating_sub(self.told_ns) >= STATE_NS {
            self.told_ns = now_ns;
            let charge_percent = self.line.charge_percent(measured.charge_percent).unwrap_or(CHARGE_PERCENT);
            let state = self.robot.state(&measured, now_ns);
            if self.line.fault != Some(Fault::Silent) {
                let low = self.robot.low_state(charge_percent);
                self.line.said.put(now_ns, (state, low), self.line.fault, lost);
            }
        }
        while let Some((state, low)) = self.line.said.take(now_ns) {
            self.server.tell(state, low);
        }
        Ok(())
    }
}

/// A robot that takes velocities of ROS 2.
pub struct EmulatedRos2 {
    server: Ros2Server,
    silence: Silence,
    velocity: Twist2,
    commanded_ns: u64,
    limp: bool,
    told_ns: u64,
    line: Trouble<Twist2, Odometry>,
}

impl EmulatedRos2 {
    /// Switches a robot on.
    ///
    /// # Errors
    /// Where it cannot take part in its network.
    pub fn new(dds: &DdsSettings, topics: &Ros2Settings, silence: Silence) -> Result<Self, BusError> {
        Ok(Self {
            server: Ros2Server::open(dds, topics)?,
            silence,
            velocity: Twist2::ZERO,
            commanded_ns: 0,
            limp: false,
            told_ns: 0,
            line: Trouble::none(),
        })
    }
}

impl EmulatedRobot for EmulatedRos2 {
    fn velocity(&self, now_ns: u64) -> Twist2 {
        let kept = self.silence == Silence::HoldsLast || now_ns.saturating_sub(self.commanded_ns) <= SILENT_NS;
        if kept && !self.limp { self.velocity } else { Twist2::ZERO }
    }

    fn posture(&self, now_ns: u64) -> String {
        if self.velocity(now_ns).is_zero() { "stands" } else { "walks" }.to_owned()
    }

    fn suffer(&mut self, fault: Option<(Fault, u64)>) {
        if let Some(pressed) = self.line.suffer(fault) {
            self.limp = pressed;
        }
    }

    fn hear(&mut self, now_ns: u64) -> std::io::Result<()> {
        if let Some(velocity) = self.server.velocity() {
            self.line.heard.put(now_ns, velocity, self.line.fault, lost);
        }
        while let Some(velocity) = self.line.heard.take(now_ns) {
            (self.velocity, self.commanded_ns) = (velocity, now_ns);
        }
        Ok(())
    }

    fn serve(&mut self, now_ns: u64, measured: State) -> std::io::Result<()> {
        self.hear(now_ns)?;
        if now_ns.saturating_sub(self.told_ns) >= STATE_NS && self.line.fault != Some(Fault::Silent) {
            self.told_ns = now_ns;
            self.line.said.put(now_ns, odometry(now_ns, &measured), self.line.fault, lost);
        }
        while let Some(odometry) = self.line.said.take(now_ns) {
            self.server.tell(odometry);
        }
        Ok(())
    }
}

fn odometry(now_ns: u64, measured: &State) -> Odometry {
    let [w, x, y, z] = measured.quaternion.map(f64::from);
    let stamp = ((now_ns / NS_PER_S) as i32, (now_ns % NS_PER_S) as u32);
    Odometry {
        header: Header { stamp, frame_id: "odom".to_owned() },
        child_frame_id: "base_link".to_owned(),
        position: measured.position_m.map(f64::from),
        orientation: [x, y, z, w],
        twist: Twist::from(measured.velocity),
        ..Odometry::default()
    }
}

#[cfg(test)]
mod tests {
    use messages::{Attitude, Pose2, Twist2};
    use unitree::State;

    use super::odometry;

    #[test]
    fn odometry_of_ros_2_tells_the_whole_attitude_and_the_height() {
        let attitude = Attitude { stamp_ns: 1, roll_rad: 0.1, pitch_rad: -0.2, height_m: 0.27, ..Attitude::default() };
        let walks = Twist2 { vx_mps: 0.5, vy_mps: -0.25, wz_radps: 0.125 };
        let told = odometry(1, &State::held(Pose2::new(1.0, -2.0, 2.5), &attitude, walks, None));
        assert!((told.position[2] - 0.27).abs() < 1e-6);
        let state = told.state().expect("a state");
        let ([roll_rad, pitch_rad], pose) = (state.roll_pitch_rad, state.own_from_robot);
        let off = [pose.x_m - 1.0, pose.y_m + 2.0, pose.yaw_rad - 2.5, roll_rad - 0.1, pitch_rad + 0.2].map(f64::abs);
        assert!(off.iter().all(|off| *off < 1e-6), "{state:?}");
        assert_eq!(state.velocity, walks);
    }
}
