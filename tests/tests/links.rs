//! The link to Unitree's robots and the brake's path, over UDP, against emulated robots that keep their last command.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use emulators::{EmulatedRobot, EmulatedUnitree, OpenFloor};
use guidedog_tests::until;
use links::{BrakePath, Link, UnitreeBrake, UnitreeLink};
use messages::{Fault, Twist2};
use settings::UnitreeSettings;
use transport::monotonic_ns;
use unitree::{Command, DEAD_MAN_NS, Mode, Profile, Silence};

const AHEAD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: 0.0, wz_radps: 0.25 };

/// An emulated robot at a port of its own, in a thread of its own.
struct Robot {
    address: SocketAddrV4,
    motion: Arc<Mutex<(Mode, Twist2)>>,
    fault: Arc<Mutex<Option<Fault>>>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Robot {
    fn new(profile: Profile) -> Self {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        let Ok(SocketAddr::V4(address)) = socket.local_addr() else { panic!("an address of IPv4") };
        let mut robot = EmulatedUnitree::new(socket, profile, Silence::HoldsLast).expect("a robot");
        let mut floor = OpenFloor::default();
        let motion = Arc::new(Mutex::new((robot.mode(), Twist2::ZERO)));
        let (over, fault) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(None)));
        let (theirs, suffered, ends) = (Arc::clone(&motion), Arc::clone(&fault), Arc::clone(&over));
        let thread = std::thread::spawn(move || {
            while !ends.load(Ordering::Relaxed) {
                let now_ns = monotonic_ns();
                robot.suffer(suffered.lock().expect("not poisoned").map(|fault| (fault, 1)));
                let measured = floor.go_on(now_ns, robot.velocity(now_ns));
                robot.serve(now_ns, measured).expect("its socket works");
                *theirs.lock().expect("not poisoned") = (robot.mode(), robot.velocity(monotonic_ns()));
                std::thread::sleep(Duration::from_micros(500));
            }
        });
        Self { address, motion, fault, over, thread: Some(thread) }
    }

    fn velocity(&self) -> Twist2 {
        self.motion.lock().expect("not poisoned").1
    }

    fn mode(&self) -> Mode {
        self.motion.lock().expect("not poisoned").0
    }

    /// Somebody does that to it: presses the stop on its hand remote, pulls its plug, or makes good.
    fn suffers(&self, fault: Option<Fault>) {
        *self.fault.lock().expect("not poisoned") = fault;
    }

    fn link(&self, profile: Profile) -> UnitreeLink {
        UnitreeLink::open(&settings(profile, self.address)).expect("a link")
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn settings(profile: Profile, robot: SocketAddrV4) -> UnitreeSettings {
    UnitreeSettings { profile, robot: Some(robot), local: Some(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)) }
}

/// Wishes as locomotion does, again and again, until the robot goes so.
fn walk(link: &mut UnitreeLink, robot: &Robot, velocity: Twist2) {
    until("the robot walks as it is wished", || {
        link.write(velocity, DEAD_MAN_NS).expect("written");
        (robot.velocity().vx_mps - velocity.vx_mps).abs() < 1e-3
    });
}

#[test]
fn every_robot_walks_as_it_is_wished_and_says_how_fast() {
    for profile in Profile::ALL {
        let robot = Robot::new(profile);
        let mut link = robot.link(profile);
        assert!(robot.velocity().is_zero(), "{profile:?}");
        walk(&mut link, &robot, AHEAD);
        until("it says how fast it goes", || {
            link.write(AHEAD, DEAD_MAN_NS).expect("written");
            let measured = link.report().expect("read").velocity;
            measured.is_some_and(|measured| (measured.vx_mps - AHEAD.vx_mps).abs() < 1e-3)
        });
        assert_eq!(link.refused(), 0, "{profile:?}");
        link.write(Twist2::ZERO, DEAD_MAN_NS).expect("written");
        until("zero", || robot.velocity().is_zero());
        until("it stands after a while", || robot.mode() == Mode::Stand);
        walk(&mut link, &robot, AHEAD);
    }
}

#[test]
fn a_loop_that_hangs_lets_the_robot_stand() {
    let robot = Robot::new(Profile::Go138);
    let mut link = robot.link(Profile::Go138);
    walk(&mut link, &robot, AHEAD);
    // Nothing more is wished; the link's thread lives on.
    until("the dead man's switch", || robot.velocity().is_zero());
}

#[test]
fn the_last_words_of_a_link_are_zero() {
    let robot = Robot::new(Profile::AlienGo384);
    let mut link = robot.link(Profile::AlienGo384);
    walk(&mut link, &robot, AHEAD);
    drop(link);
    until("zero at the end", || robot.velocity().is_zero());
}

/// A process that was killed says no last words, and the robot keeps what it was told: this is what the brake is for.
#[test]
fn the_brake_stops_a_robot_whose_link_was_killed() {
    for profile in Profile::ALL {
        let robot = Robot::new(profile);
        let killed = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        let mut bytes = vec![0; profile.command_len()];
        until("it walks", || {
            for trigger in [true, false] {
                let command = Command { mode: Mode::Walk, velocity: AHEAD, trigger, ..Command::default() };
                command.encode(profile, &mut bytes);
                killed.send_to(&bytes, robot.address).expect("sent");
            }
            !robot.velocity().is_zero()
        });
        drop(killed);
        let mut brake = UnitreeBrake::open(&settings(profile, robot.address)).expect("a brake");
        until("the brake's zero", || {
            brake.zero(1);
            robot.velocity().is_zero()
        });
    }
}

#[test]
fn who_is_not_the_robot_is_not_heard() {
    let profile = Profile::Go138;
    let silent = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let Ok(SocketAddr::V4(robot)) = silent.local_addr() else { panic!("an address of IPv4") };
    let mut link = UnitreeLink::open(&settings(profile, robot)).expect("a link");
    // The link speaks first: that is how its port is known here.
    let mut heard = [0; 2000];
    let (_, line) = silent.recv_from(&mut heard).expect("a command");
    let mut bytes = vec![0; profile.state_len()];
    unitree::State::default().encode(profile, &mut bytes);
    let stranger = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    for _ in 0..10 {
        let _ = stranger.send_to(&bytes, line);
    }
    // What the robot itself says comes after, and is heard; garbage of its own is counted.
    silent.send_to(&bytes[1..], line).expect("sent");
    until("garbage is counted", || link.refused() == 1);
    assert_eq!(link.report().expect("read").velocity, None, "a stranger was heard");
    until("the robot is heard", || {
        silent.send_to(&bytes, line).expect("sent");
        link.report().expect("read").velocity.is_some()
    });
}

#[test]
fn a_panic_ends_with_zero() {
    let robot = Robot::new(Profile::Go138);
    let mut link = robot.link(Profile::Go138);
    link.speak_on_panic();
    walk(&mut link, &robot, AHEAD);
    let _ = std::panic::catch_unwind(|| panic!("as locomotion might"));
    until("zero after a panic, whatever is wished still", || {
        let _ = link.write(AHEAD, DEAD_MAN_NS);
        robot.velocity().is_zero()
    });
}

#[test]
fn a_robot_tells_where_it_is_its_battery_and_who_stopped_it() {
    let robot = Robot::new(Profile::Go138);
    let mut link = robot.link(Profile::Go138);
    walk(&mut link, &robot, AHEAD);
    until("it is elsewhere", || {
        link.write(AHEAD, DEAD_MAN_NS).expect("written");
        let report = link.report().expect("read");
        report.own_from_robot.is_some_and(|(pose, age_ns)| pose.x_m > 0.05 && age_ns < 100_000_000)
    });
    assert_eq!(link.report().expect("read").charge_percent, Some(80));
    robot.suffers(Some(Fault::LowBattery));
    until("its battery is low", || link.report().expect("read").charge_percent == Some(5));
    robot.suffers(Some(Fault::RemoteStop));
    until("the stop is told", || link.report().expect("read").remote_stop);
    robot.suffers(None);
    until("the remote is let go of", || robot.mode() != Mode::Damping);
    for _ in 0..20 {
        link.write(AHEAD, DEAD_MAN_NS).expect("written");
        assert!(link.report().expect("read").remote_stop && robot.velocity().is_zero(), "it holds");
        std::thread::sleep(Duration::from_millis(2));
    }
    link.forget_remote_stop();
    assert!(!link.report().expect("read").remote_stop, "forgotten from here on");
    walk(&mut link, &robot, AHEAD);
}

#[test]
fn the_operator_is_told_once_whether_the_robot_answers() {
    let robot = Robot::new(Profile::AlienGo384);
    let mut link = robot.link(Profile::AlienGo384);
    let mut told = Vec::new();
    let mut hear = |link: &mut UnitreeLink, what: &str| {
        until(what, || {
            link.write(Twist2::ZERO, DEAD_MAN_NS).expect("written");
            link.report().expect("read");
            told.extend(link.news().filter(|text| !text.contains("priority")));
            told.last().is_some_and(|text| text.contains(what))
        });
    };
    hear(&mut link, "answers");
    robot.suffers(Some(Fault::Unplugged));
    hear(&mut link, "does not answer: is it on");
    robot.suffers(None);
    hear(&mut link, "answers");
    assert_eq!(told.len(), 3, "{told:?}");
}
