//! What is said to the robot, and what has come of it.

use dds::bus::{Heard, Robot, Ros2Robot, SportRobot};
use dds::{Driver, Posture, RobotState};
use links::STATE_MAX_AGE_NS;
use messages::NS_PER_S;
use settings::{DdsRobot, FarEnd, Locomotion};
use transport::{FromChild, Io, TransportError, hurry_network_thread, monotonic_ns};

/// A robot that said nothing for so long does not answer, nanoseconds.
const SILENT_NS: u64 = NS_PER_S;

/// A participant, and what is said by it.
pub struct Voice {
    robot: Box<dyn Robot>,
    /// What is to be said.
    pub driver: Driver,
    /// The newest state and when it came, nanoseconds.
    pub newest: Option<(RobotState, u64)>,
    /// Charge of the robot's battery, percent, and when that and the hand remote were last told of, nanoseconds.
    low: Option<(u8, u64)>,
    /// Whether the robot has been heard lately.
    pub answers: bool,
    begun_ns: u64,
    /// The network's threads run before what is not real-time.
    hurries: bool,
    /// What came at the last look.
    heard: Heard,
    told: Told,
}

/// What the operator has been told.
#[derive(Debug, Default)]
struct Told {
    answers: Option<bool>,
    hurry: bool,
    remote: bool,
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
        // The network's threads are begun by one that hurries, and run as it does.
        let settings = settings.clone();
        let opened = std::thread::spawn(move || (hurry_network_thread(), open(&settings)));
        let (hurries, robot) =
            opened.join().map_err(|_| TransportError::Service("DDS could not be begun".to_owned()))?;
        let robot = robot?;
        let driver = Driver::new(robot.stops(), now_ns);
        let (newest, low, heard, told) = (None, None, Heard::default(), Told::default());
        Ok(Self { robot, driver, newest, low, answers: false, begun_ns: now_ns, hurries, heard, told })
    }

    /// Says what is to be said now. What the network does not take is said again.
    pub fn speak(&mut self) {
        if let Some(say) = self.driver.say(monotonic_ns()) {
            self.robot.say(say);
        }
    }

    /// Charge of the robot's battery, percent, where it told lately.
    pub fn charge_percent(&self, now_ns: u64) -> Option<u8> {
        self.low.filter(|(_, came_ns)| now_ns.saturating_sub(*came_ns) <= SILENT_NS).map(|(percent, _)| percent)
    }

    /// Whether a stop by the hand remote would be noticed, where the robot has one that tells.
    pub fn hears_remote(&self, now_ns: u64) -> bool {
        !self.robot.has_remote() || self.charge_percent(now_ns).is_some()
    }

    /// Takes what has come of the robot.
    pub fn hear(&mut self) {
        let (heard, now_ns) = (self.robot.hear(), monotonic_ns());
        self.heard = heard;
        if let Some(state) = heard.state {
            self.newest = Some((state, now_ns));
        }
        if let Some((percent, pressed)) = heard.low {
            self.low = Some((percent, now_ns));
            if pressed {
                self.driver.stopped_by_remote();
            }
        }
        let age_ns = self.newest.map_or(u64::MAX, |(_, came_ns)| now_ns.saturating_sub(came_ns));
        match (self.answers, age_ns <= SILENT_NS) {
            // What it has not heard by now it is not to hear later.
            (true, false) => self.robot.renew(),
            (false, true) => self.driver.begin_again(now_ns),
            _ => {}
        }
        self.answers = age_ns <= SILENT_NS;
        let young = self.newest.filter(|_| age_ns <= STATE_MAX_AGE_NS).map(|(state, _)| state);
        // Who lies does not move, whatever it says; of one that is silent nobody knows how it stands.
        self.driver.stands(match young {
            Some(state) if state.posture != Posture::Down || state.velocity.is_standing() => state.posture,
            _ => Posture::Ready,
        });
        if heard.stop_answered {
            self.driver.stop_answered();
            self.told.refused = false;
        }
    }

    /// Tells the operator what is new since the last look.
    pub fn tell(&mut self, io: &Io) {
        for text in self.news(monotonic_ns()) {
            io.tell(&FromChild::Note { text });
        }
    }

    fn news(&mut self, now_ns: u64) -> Vec<String> {
        let (heard, mut notes) = (self.heard, Vec::new());
        if !self.hurries && !std::mem::replace(&mut self.told.hurry, true) {
            let fix = "give the process CAP_SYS_NICE, or raise `ulimit -r`";
            notes.push(format!("the robot's network has no real-time priority: words may be late; {fix}"));
        }
        if let Some((api, code)) = heard.refused.filter(|_| !std::mem::replace(&mut self.told.refused, true)) {
            notes.push(format!("the robot refuses {api:?} with error {code}: is it in its sport mode, and standing?"));
        }
        if heard.invalid > 0 && !std::mem::replace(&mut self.told.invalid, true) {
            notes.push("words of the robot are dropped: they are of another kind of robot, or no numbers".to_owned());
        }
        let is_down = self.newest.is_some_and(|(state, _)| state.posture == Posture::Down);
        if is_down != std::mem::replace(&mut self.told.down, is_down) && is_down {
            notes.push("the robot lies or is limp: make it stand by its hand remote".to_owned());
        }
        // Its states come first, and these a moment later.
        let is_deaf =
            self.answers && now_ns.saturating_sub(self.begun_ns) > 3 * SILENT_NS && !self.hears_remote(now_ns);
        if is_deaf != std::mem::replace(&mut self.told.remote, is_deaf) && is_deaf {
            notes.push(
                "rt/lowstate does not come: hand remote and battery are unknown, and the robot is not moved".into(),
            );
        }
        notes.extend(self.tell_answers(now_ns));
        notes
    }

    fn tell_answers(&mut self, now_ns: u64) -> Option<String> {
        let answers = self.answers;
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

fn open(settings: &Locomotion) -> Result<Box<dyn Robot>, TransportError> {
    let FarEnd::DdsRobot(robot) = settings.link.row().far_end else {
        return Err(TransportError::Service("locomotion.link names no robot on DDS".to_owned()));
    };
    let dds = &settings.dds;
    Ok(match robot {
        DdsRobot::Go2 => Box::new(SportRobot::open(dds).map_err(TransportError::service)?),
        DdsRobot::Ros2 => Box::new(Ros2Robot::open(dds, &settings.ros2).map_err(TransportError::service)?),
    })
}
