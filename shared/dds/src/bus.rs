//! The network: a participant that speaks to one robot, and one that is a robot.
//!
//! A write never waits: what the network cannot take now is said again at the next period.

use std::net::UdpSocket;

use messages::Twist2;
use rustdds::no_key::{DataReader, DataWriter};
use rustdds::policy::{History, Reliability};
use rustdds::{DomainParticipant, DomainParticipantBuilder, Duration, QosPolicies, QosPolicyBuilder, TopicKind};
use serde::Serialize;
use serde::de::DeserializeOwned;
use settings::{DdsSettings, Ros2Settings};

use crate::ros2::{Header, ODOMETRY, Odometry, TWIST, TWIST_STAMPED, Twist, TwistStamped, dds_topic};
use crate::sport::{self, Api, LowState, Request, Response, SportModeState};
use crate::{RobotState, Say, Stops};

/// Why a participant cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("DDS domain {domain}: {what} cannot be had: {why}")]
pub struct BusError {
    domain: u16,
    what: String,
    why: String,
}

struct Bus {
    domain: u16,
    participant: DomainParticipant,
}

impl Bus {
    fn open(dds: &DdsSettings) -> Result<Self, BusError> {
        let mut builder = DomainParticipantBuilder::new(dds.domain);
        for network in &dds.networks {
            // With one that is not there nothing would ever be heard, and nothing said why.
            UdpSocket::bind((*network, 0)).map_err(|error| BusError {
                domain: dds.domain,
                what: network.to_string(),
                why: format!("it is to be an address of this machine in the robot's network ({error})"),
            })?;
        }
        if !dds.networks.is_empty() {
            builder = builder.with_only_networks(dds.networks.iter().copied());
        }
        let domain = dds.domain;
        let failed = |why: String| BusError { domain, what: "a participant".to_owned(), why };
        let participant = builder.build().map_err(|error| failed(error.to_string()))?;
        Ok(Self { domain, participant })
    }

    fn writer<T: Serialize>(&self, topic: [&str; 2], qos: &QosPolicies) -> Result<DataWriter<T>, BusError> {
        let failed = |error: rustdds::dds::CreateError| self.error(topic[0], &error);
        let publisher = self.participant.create_publisher(qos).map_err(failed)?;
        let topic = self.topic(topic, qos).map_err(failed)?;
        publisher.create_datawriter_no_key_cdr::<T>(&topic, None).map_err(failed)
    }

    fn reader<T: DeserializeOwned + 'static>(
        &self,
        topic: [&str; 2],
        qos: &QosPolicies,
    ) -> Result<DataReader<T>, BusError> {
        let failed = |error: rustdds::dds::CreateError| self.error(topic[0], &error);
        let subscriber = self.participant.create_subscriber(qos).map_err(failed)?;
        let topic = self.topic(topic, qos).map_err(failed)?;
        subscriber.create_datareader_no_key_cdr::<T>(&topic, None).map_err(failed)
    }

    fn topic(&self, [name, kind]: [&str; 2], qos: &QosPolicies) -> rustdds::dds::CreateResult<rustdds::Topic> {
        self.participant.create_topic(name.to_owned(), kind.to_owned(), qos, TopicKind::NoKey)
    }

    fn error(&self, topic: &str, error: &rustdds::dds::CreateError) -> BusError {
        BusError { domain: self.domain, what: topic.to_owned(), why: error.to_string() }
    }
}

/// What has to arrive. What is not acknowledged is kept, and sent again in its order: see [`Robot::renew`].
fn reliable(depth: i32) -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: Duration::ZERO })
        .history(History::KeepLast { depth })
        .build()
}

/// What comes again and again.
fn best_effort() -> QosPolicies {
    QosPolicyBuilder::new().reliability(Reliability::BestEffort).history(History::KeepLast { depth: 1 }).build()
}

/// Everything that waits; what cannot be read is passed over and counted.
fn each<T: DeserializeOwned + 'static>(reader: &mut DataReader<T>, mut take: impl FnMut(T)) -> u32 {
    /// So many that cannot be read are passed over at once.
    const WRONG_MAX: u32 = 16;
    let mut wrong = 0;
    while wrong < WRONG_MAX {
        match reader.take_next_sample() {
            Ok(Some(sample)) => take(sample.into_value()),
            Ok(None) => break,
            Err(_) => wrong += 1,
        }
    }
    wrong
}

/// What has come of a robot since it was last asked.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Heard {
    /// The newest state.
    pub state: Option<RobotState>,
    /// Charge of its battery, percent, and whether its hand remote says stop.
    pub low: Option<(u8, bool)>,
    /// It has answered a stop of ours.
    pub stop_answered: bool,
    /// What it answered to something that it did not do.
    pub refused: Option<(Api, i32)>,
    /// What was none of its messages, and states with numbers that are none.
    pub invalid: u32,
}

/// A robot to speak to.
pub trait Robot: Send {
    /// Says it. Whether the network has taken it the robot's answers tell.
    fn say(&mut self, say: Say);

    /// Forgets what the robot has not acknowledged. It is out of reach, and is not to hear the moves of before when it
    /// is back.
    fn renew(&mut self);

    /// Whether it tells of its hand remote, without which it is not to be moved.
    fn has_remote(&self) -> bool;

    /// What has come.
    fn hear(&mut self) -> Heard;

    /// How it takes note of a stop.
    fn stops(&self) -> Stops;
}

/// A Go2 or B2.
pub struct SportRobot {
    requests: DataWriter<Request>,
    responses: DataReader<Response>,
    states: DataReader<SportModeState>,
    low_states: DataReader<LowState>,
    /// Of the last request. Ours begin with the number of this process.
    id: i64,
    /// Of the first stop since the robot was last told anything else: an answer to an older one says nothing of now.
    first_stop: Option<i64>,
    bus: Bus,
}

/// Bits of a request's number that count; above them stands who asks.
const COUNT_BITS: u32 = 32;

impl SportRobot {
    /// Takes part.
    ///
    /// # Errors
    /// Where it cannot.
    pub fn open(dds: &DdsSettings) -> Result<Self, BusError> {
        let bus = Bus::open(dds)?;
        Ok(Self {
            requests: bus.writer(sport::REQUEST, &reliable(1))?,
            responses: bus.reader(sport::RESPONSE, &reliable(16))?,
            states: bus.reader(sport::STATE, &best_effort())?,
            low_states: bus.reader(sport::LOW_STATE, &best_effort())?,
            id: i64::from(std::process::id()) << COUNT_BITS,
            first_stop: None,
            bus,
        })
    }
}

impl Robot for SportRobot {
    fn say(&mut self, say: Say) {
        self.id += 1;
        self.first_stop = (say == Say::Stop).then(|| self.first_stop.unwrap_or(self.id));
        let request = match say {
            Say::Move(velocity) => Request::walk(self.id, velocity),
            Say::Stop => Request::plain(self.id, Api::StopMove),
            Say::Balance => Request::plain(self.id, Api::BalanceStand),
        };
        let _ = self.requests.write(request, None);
    }

    fn renew(&mut self) {
        if let Ok(requests) = self.bus.writer(sport::REQUEST, &reliable(1)) {
            self.requests = requests;
        }
    }

    fn has_remote(&self) -> bool {
        true
    }

    fn hear(&mut self) -> Heard {
        let mut heard = Heard::default();
        let (first_stop, last, ours) = (self.first_stop, self.id, self.id >> COUNT_BITS);
        heard.invalid += each(&mut self.responses, |response| {
            let id = response.identity.id;
            let api = Api::of(response.identity.api_id).filter(|_| id >> COUNT_BITS == ours);
            match (api, response.code) {
                (Some(Api::StopMove), 0) => {
                    heard.stop_answered |= first_stop.is_some_and(|first| (first..=last).contains(&id));
                }
                (Some(api), code) if code != 0 => heard.refused = Some((api, code)),
                _ => {}
            }
        });
        let mut none = 0;
        none += each(&mut self.states, |state| match state.state() {
            Some(state) => heard.state = Some(state),
            None => heard.invalid += 1,
        });
        none += each(&mut self.low_states, |low| {
            let pressed = heard.low.is_some_and(|(_, pressed)| pressed) || low.remote().says_stop();
            heard.low = Some((low.bms_state.soc, pressed));
        });
        heard.invalid += none;
        heard
    }

    fn stops(&self) -> Stops {
        Stops::Answered
    }
}

enum Velocities {
    Plain(DataWriter<Twist>),
    Stamped(DataWriter<TwistStamped>),
}

impl Velocities {
    fn open(bus: &Bus, topics: &Ros2Settings) -> Result<Self, BusError> {
        let cmd_vel = dds_topic(&topics.cmd_vel);
        Ok(if topics.stamped {
            Self::Stamped(bus.writer([&cmd_vel, TWIST_STAMPED], &reliable(1))?)
        } else {
            Self::Plain(bus.writer([&cmd_vel, TWIST], &reliable(1))?)
        })
    }
}

/// A robot that takes velocities of ROS 2.
pub struct Ros2Robot {
    velocities: Velocities,
    topics: Ros2Settings,
    odometry: DataReader<Odometry>,
    bus: Bus,
}

impl Ros2Robot {
    /// Takes part.
    ///
    /// # Errors
    /// Where it cannot.
    pub fn open(dds: &DdsSettings, topics: &Ros2Settings) -> Result<Self, BusError> {
        let bus = Bus::open(dds)?;
        let odometry = bus.reader([&dds_topic(&topics.odom), ODOMETRY], &best_effort())?;
        Ok(Self { velocities: Velocities::open(&bus, topics)?, topics: topics.clone(), odometry, bus })
    }
}

impl Robot for Ros2Robot {
    fn say(&mut self, say: Say) {
        let twist = Twist::from(match say {
            Say::Move(velocity) => velocity,
            Say::Stop | Say::Balance => Twist2::ZERO,
        });
        let _ = match &self.velocities {
            Velocities::Plain(writer) => writer.write(twist, None).is_ok(),
            Velocities::Stamped(writer) => {
                let header = Header { frame_id: "base_link".to_owned(), ..Header::default() };
                writer.write(TwistStamped { header, twist }, None).is_ok()
            }
        };
    }

    fn renew(&mut self) {
        if let Ok(velocities) = Velocities::open(&self.bus, &self.topics) {
            self.velocities = velocities;
        }
    }

    fn has_remote(&self) -> bool {
        false
    }

    fn hear(&mut self) -> Heard {
        let mut heard = Heard::default();
        let none = each(&mut self.odometry, |odometry| match odometry.state() {
            Some(state) => heard.state = Some(state),
            None => heard.invalid += 1,
        });
        heard.invalid += none;
        heard
    }

    fn stops(&self) -> Stops {
        Stops::Unanswered
    }
}

/// A Go2's side of the network.
pub struct SportServer {
    requests: DataReader<Request>,
    responses: DataWriter<Response>,
    states: DataWriter<SportModeState>,
    low_states: DataWriter<LowState>,
    _bus: Bus,
}

impl SportServer {
    /// Takes part.
    ///
    /// # Errors
    /// Where it cannot.
    pub fn open(dds: &DdsSettings) -> Result<Self, BusError> {
        let bus = Bus::open(dds)?;
        Ok(Self {
            requests: bus.reader(sport::REQUEST, &reliable(16))?,
            responses: bus.writer(sport::RESPONSE, &reliable(16))?,
            states: bus.writer(sport::STATE, &reliable(1))?,
            low_states: bus.writer(sport::LOW_STATE, &reliable(1))?,
            _bus: bus,
        })
    }

    /// Every request that waits.
    pub fn each_request(&mut self, take: impl FnMut(Request)) {
        let _ = each(&mut self.requests, take);
    }

    /// Answers.
    pub fn answer(&mut self, response: Response) {
        let _ = self.responses.write(response, None);
    }

    /// Says how it is.
    pub fn tell(&mut self, state: SportModeState, low: LowState) {
        let _ = self.states.write(state, None);
        let _ = self.low_states.write(low, None);
    }
}

enum VelocitiesIn {
    Plain(DataReader<Twist>),
    Stamped(DataReader<TwistStamped>),
}

/// A ROS 2 robot's side of the network.
pub struct Ros2Server {
    velocities: VelocitiesIn,
    odometry: DataWriter<Odometry>,
    _bus: Bus,
}

impl Ros2Server {
    /// Takes part.
    ///
    /// # Errors
    /// Where it cannot.
    pub fn open(dds: &DdsSettings, topics: &Ros2Settings) -> Result<Self, BusError> {
        let bus = Bus::open(dds)?;
        let cmd_vel = dds_topic(&topics.cmd_vel);
        let velocities = if topics.stamped {
            VelocitiesIn::Stamped(bus.reader([&cmd_vel, TWIST_STAMPED], &reliable(1))?)
        } else {
            VelocitiesIn::Plain(bus.reader([&cmd_vel, TWIST], &reliable(1))?)
        };
        Ok(Self { velocities, odometry: bus.writer([&dds_topic(&topics.odom), ODOMETRY], &reliable(1))?, _bus: bus })
    }

    /// The newest velocity that waits.
    pub fn velocity(&mut self) -> Option<Twist2> {
        let mut newest = None;
        let _ = match &mut self.velocities {
            VelocitiesIn::Plain(reader) => each(reader, |twist| newest = Some(twist.into())),
            VelocitiesIn::Stamped(reader) => each(reader, |stamped: TwistStamped| newest = Some(stamped.twist.into())),
        };
        newest
    }

    /// Says where it is.
    pub fn tell(&mut self, odometry: Odometry) {
        let _ = self.odometry.write(odometry, None);
    }
}
