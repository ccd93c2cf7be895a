//! What zero means, by link: the words that go to a robot that is to stand, held against the emulated robots. The table
//! is in docs/bring-up.md.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::Duration;

use dds::bus::{Robot, Ros2Robot, SportRobot};
use dds::{Driver, Posture, Say};
use emulators::{EmulatedRobot, EmulatedRos2, EmulatedSport};
use guidedog_tests::until;
use links::{BrakePath, Link, UnitreeBrake, UnitreeLink};
use messages::{NS_PER_S, Twist2};
use settings::{DdsSettings, Ros2Settings, UnitreeSettings};
use transport::monotonic_ns;
use unitree::{Command, DEAD_MAN_NS, Mode, Profile, Silence, State};

const AHEAD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.25 };
/// Beyond the domains that runs draw, so that no run meets these robots.
const DDS_DOMAIN: u16 = 201;

/// Commands as a robot hears them, with the time at which each was read.
struct Ear(UdpSocket, Profile);

impl Ear {
    fn new(profile: Profile) -> (Self, UnitreeSettings) {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        let Ok(SocketAddr::V4(robot)) = socket.local_addr() else { panic!("an address of IPv4") };
        socket.set_nonblocking(true).expect("set");
        let local = Some(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0));
        (Self(socket, profile), UnitreeSettings { profile, robot: Some(robot), local })
    }

    fn hear(&self) -> Vec<(u64, Command)> {
        let mut bytes = [0; 2000];
        std::iter::from_fn(|| {
            let count = self.0.recv(&mut bytes).ok()?;
            Some((monotonic_ns(), Command::decode(self.1, &bytes[..count]).expect("a command")))
        })
        .collect()
    }
}

/// What a link says while locomotion writes that velocity for so long.
fn said(link: &mut UnitreeLink, ear: &Ear, velocity: Twist2, for_ns: u64) -> Vec<(u64, Command)> {
    let (begun_ns, mut heard) = (monotonic_ns(), Vec::new());
    while monotonic_ns() - begun_ns < for_ns {
        link.write(velocity, DEAD_MAN_NS).expect("written");
        heard.extend(ear.hear());
        std::thread::sleep(Duration::from_millis(1));
    }
    heard
}

#[test]
fn zero_is_walk_mode_without_a_velocity_for_half_a_second_and_then_a_stand() {
    for profile in Profile::ALL {
        let (ear, settings) = Ear::new(profile);
        let mut link = UnitreeLink::open(&settings).expect("a link");
        let before = said(&mut link, &ear, Twist2::ZERO, NS_PER_S / 10);
        assert!(
            before.iter().all(|(_, command)| command.mode == Mode::Idle),
            "a robot that has not been moved may lie"
        );
        let walks = said(&mut link, &ear, AHEAD, NS_PER_S / 5);
        let heard = said(&mut link, &ear, Twist2::ZERO, NS_PER_S);
        let is_moved = |(_, command): &(u64, Command)| !command.velocity.is_zero();
        let moved_ns = walks.iter().chain(&heard).rev().find(|one| is_moved(one)).expect("it was moved").0;
        // What was on its way is heard first.
        let zeros: Vec<_> = heard.iter().skip_while(|one| is_moved(one)).collect();
        let stands = zeros.iter().position(|(_, command)| command.mode == Mode::Stand).expect("it stands");
        let (steps, rest) = zeros.split_at(stands);
        assert!(!steps.is_empty() && steps.iter().all(|(_, command)| command.mode == Mode::Walk), "{profile:?}");
        assert!(rest.iter().all(|(_, command)| command.mode == Mode::Stand), "{profile:?}");
        assert!(zeros.iter().all(|(_, command)| command.velocity.is_zero()), "{profile:?}");
        let after_s = (rest[0].0 - moved_ns) as f64 / NS_PER_S as f64;
        assert!((0.45..0.9).contains(&after_s), "{profile:?} stands after {after_s} s");
    }
}

/// The brake knows nothing of how the robot stands. Its robot steps in place until a link speaks to it again.
#[test]
fn the_brakes_zero_and_a_links_last_words_are_walk_mode() {
    for profile in Profile::ALL {
        let (ear, settings) = Ear::new(profile);
        let mut brake = UnitreeBrake::open(&settings).expect("a brake");
        brake.zero(1);
        let mut heard = Vec::new();
        until("the brake is heard", || {
            heard.extend(ear.hear());
            !heard.is_empty()
        });
        drop(brake);
        let mut link = UnitreeLink::open(&settings).expect("a link");
        said(&mut link, &ear, Twist2::ZERO, NS_PER_S / 10);
        drop(link);
        heard.extend(ear.hear().last());
        for (_, command) in heard {
            assert_eq!((command.mode, command.velocity), (Mode::Walk, Twist2::ZERO), "{profile:?}");
        }
    }
}

/// A robot on DDS with a link's driver, both in this thread.
struct Pair {
    driver: Driver,
    link: Box<dyn Robot>,
    robot: Box<dyn EmulatedRobot>,
}

impl Pair {
    /// One step of a millisecond: what the link says in it.
    fn step(&mut self, velocity: Twist2) -> Option<Say> {
        let now_ns = monotonic_ns();
        self.robot.serve(now_ns, State::default()).expect("its line works");
        let heard = self.link.hear();
        if let Some(state) = heard.state {
            self.driver.stands(state.posture);
        }
        if heard.stop_answered {
            self.driver.stop_answered();
        }
        self.driver.wish(velocity, now_ns + DEAD_MAN_NS);
        let say = self.driver.say(now_ns);
        if let Some(say) = say {
            self.link.say(say);
        }
        std::thread::sleep(Duration::from_millis(1));
        say
    }

    /// Walks, and then wishes for zero: what is said in the two seconds after, each with the time since, nanoseconds.
    fn stop(&mut self) -> Vec<(u64, Say)> {
        self.driver.stands(Posture::Ready);
        until("it walks", || {
            self.step(AHEAD);
            (self.robot.velocity(monotonic_ns()).vx_mps - AHEAD.vx_mps).abs() < 1e-9
        });
        let (begun_ns, mut said) = (monotonic_ns(), Vec::new());
        while monotonic_ns() - begun_ns < 2 * NS_PER_S {
            said.extend(self.step(Twist2::ZERO).map(|say| (monotonic_ns() - begun_ns, say)));
        }
        assert!(self.robot.velocity(monotonic_ns()).is_zero());
        said
    }
}

fn network() -> DdsSettings {
    DdsSettings { domain: DDS_DOMAIN, networks: vec![Ipv4Addr::LOCALHOST] }
}

#[test]
fn zero_is_a_stop_to_robots_on_dds_that_a_go2_answers() {
    let link: Box<dyn Robot> = Box::new(SportRobot::open(&network()).expect("a network"));
    let robot = EmulatedSport::new(&network(), Silence::HoldsLast).expect("a network");
    let driver = Driver::new(link.stops(), monotonic_ns());
    let mut pair = Pair { driver, link, robot: Box::new(robot) };
    let said = pair.stop();
    // Never BalanceStand: that only unlocks a robot that is to walk.
    assert!(!said.is_empty() && said.iter().all(|(_, say)| *say == Say::Stop), "{said:?}");
    assert!(said.iter().all(|(since_ns, _)| *since_ns < NS_PER_S), "it has answered: {said:?}");
    assert_eq!(pair.robot.posture(monotonic_ns()), "mode 1", "it balances");
}

#[test]
fn zero_is_a_twist_to_robots_on_dds_that_take_velocities_of_ros_2_for_a_second() {
    let topics = Ros2Settings::default();
    let link: Box<dyn Robot> = Box::new(Ros2Robot::open(&network(), &topics).expect("a network"));
    let robot = EmulatedRos2::new(&network(), &topics, Silence::HoldsLast).expect("a network");
    let driver = Driver::new(link.stops(), monotonic_ns());
    let mut pair = Pair { driver, link, robot: Box::new(robot) };
    let said = pair.stop();
    assert!(said.len() >= 10 && said.iter().all(|(_, say)| *say == Say::Stop), "{said:?}");
    assert!(said.iter().all(|(since_ns, _)| *since_ns < NS_PER_S * 3 / 2), "nothing is said after a second: {said:?}");
}
