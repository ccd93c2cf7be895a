//! What is said to the robot, and what has come of it.

use dds::bus::{Place, Robot, Ros2Robot, Ros2Topics, SportRobot};
use dds::{Driver, Posture, RobotState};
use messages::NS_PER_S;
use settings::{LinkKind, Locomotion};
use transport::{FromChild, Io, TransportError, hurry_robot_thread, monotonic_ns};

/// A robot that said nothing for so long does not answer, nanoseconds.
const SILENT_NS: u64 = NS_PER_S;

/// A participant, and what is said by it.
pub struct Voice {
    robot: Box<dyn Robot>,
    /// What is to be said.
    pub driver: Driver,
    /// The newest state and when it came, nanoseconds.
    pub newest: Option<(RobotState, u64)>,
    /// Charge of the robot's battery, percent.
    pub charge_percent: Option<u8>,
    begun_ns: u64,
    told: Told,
}

/// What the operator has been told.
#[derive(Debug, Default)]
struct Told {
    answers: Option<bool>,
    refused: bool,
    invalid: bool,
    down: bool,
}

impl Voice {
    /// Takes part in the robot's network. It begins with a stop.
    ///
    /// # Errors
    /// Where it cannot.
    pub fn open(settings: &Locomotion, now_ns: u64) -> Result<Self, TransportError> {
        // The network's own threads are begun by this one, and run as it does then. Where it may not hurry, the
        // supervisor's preflight has told.
        let _ = hurry_robot_thread();
        let place = Place { domain: settings.dds.domain, networks: settings.dds.networks.clone() };
        let robot: Box<dyn Robot> = match settings.link {
            LinkKind::Go2 => Box::new(SportRobot::open(&place).map_err(TransportError::service)?),
            LinkKind::Ros2 => {
                let ros2 = &settings.ros2;
                let (cmd_vel, odom) = (ros2.cmd_vel.clone(), ros2.odom.clone());
                let topics = Ros2Topics { cmd_vel, odom, stamped: ros2.stamped };
                Box::new(Ros2Robot::open(&place, &topics).map_err(TransportError::service)?)
            }
            LinkKind::Simulated | LinkKind::Unitree | LinkKind::Null => {
                return Err(TransportError::Service("locomotion.link names no robot on DDS".to_owned()));
            }
        };
        let driver = Driver::new(robot.stops(), now_ns);
        Ok(Self { robot, driver, newest: None, charge_percent: None, begun_ns: now_ns, told: Told::default() })
    }

    /// Says what is to be said now.
    pub fn speak(&mut self) {
        if let Some(say) = self.driver.say(monotonic_ns()) {
            self.robot.say(say);
        }
    }

    /// Hears what has come, and answers; what the operator is to know is told last.
    pub fn go_on(&mut self, io: &Io) {
        let (heard, now_ns) = (self.robot.hear(), monotonic_ns());
        if let Some(state) = heard.state {
            self.newest = Some((state, now_ns));
        }
        self.charge_percent = heard.charge_percent.or(self.charge_percent);
        let answers = self.newest.is_some_and(|(_, came_ns)| now_ns.saturating_sub(came_ns) <= SILENT_NS);
        // Of one that is silent nobody knows how it stands: it is commanded as if it stood.
        let posture = self.newest.filter(|_| answers).map_or(Posture::Ready, |(state, _)| state.posture);
        self.driver.stands(posture);
        if heard.remote_stop {
            self.driver.stopped_by_remote();
        }
        if heard.stop_answered {
            self.driver.stop_answered();
        }
        self.speak();
        let mut notes = Vec::new();
        if let Some((api, code)) = heard.refused.filter(|_| !std::mem::replace(&mut self.told.refused, true)) {
            notes.push(format!("the robot refuses {api:?} with error {code}"));
        }
        if heard.invalid > 0 && !std::mem::replace(&mut self.told.invalid, true) {
            notes
                .push("states of the robot are dropped: a number in them is not finite, or their attitude none".into());
        }
        let is_down = posture == Posture::Down;
        if is_down != std::mem::replace(&mut self.told.down, is_down) && is_down {
            notes.push("the robot lies or is limp: make it stand by its hand remote".to_owned());
        }
        notes.extend(self.answers(answers, now_ns));
        for text in notes {
            io.tell(&FromChild::Note { text });
        }
    }

    fn answers(&mut self, answers: bool, now_ns: u64) -> Option<String> {
        // Who has just begun has not been found by the network yet.
        let known = answers || self.newest.is_some() || now_ns.saturating_sub(self.begun_ns) > 3 * SILENT_NS;
        if !known || self.told.answers == Some(answers) {
            return None;
        }
        self.told.answers = Some(answers);
        let what = if answers { "answers" } else { "does not answer: is it on, is this its network and domain" };
        Some(format!("the robot on DDS {what}"))
    }
}
