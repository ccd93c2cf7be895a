//! Unitree's AlienGo and Go1, over UDP.
//!
//! A thread of its own talks to the robot at a fixed rate, so that something always comes, and is a dead man's switch
//! for the loop that wishes: see [`Driver`]. Nothing is shared with it but two numbers that are swapped as a
//! whole. A change to zero does not wait for it: it is sent by whoever wishes it, and the thread says nothing older
//! after it.

use std::net::{SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use ::unitree::{Command, DEAD_MAN_NS, Driver, Gait, Mode, Profile, STATE_MAX_AGE_NS, State, WireError};
use messages::{NS_PER_S, Pose2, Twist2};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;
use settings::UnitreeSettings;
use transport::{TransportError, hurry_robot_thread, monotonic_ns};

use crate::{BrakePath, Link, RobotReport};

/// From one command to the next, nanoseconds: the makers' libraries send at 500 Hz.
pub const PERIOD_NS: u64 = 2_000_000;
/// Zero: at once in every gait.
const ZERO: Command = Command {
    trigger: false,
    mode: Mode::Walk,
    gait: Gait::Untold,
    velocity: Twist2::ZERO,
    foot_raise_m: 0.0,
    body_height_m: 0.0,
};
/// The longest message of any profile, and some more: one that is longer is seen to be.
const MESSAGE_MAX: usize = 1200;
/// Zero, so often, where nobody is left to go on: a datagram may be lost.
const LAST_WORDS: usize = 10;
/// A robot that says nothing for so long does not answer, nanoseconds.
const SILENT_NS: u64 = NS_PER_S;
/// After so long without a refused datagram the next one is news, nanoseconds.
const WELL_NS: u64 = 10 * NS_PER_S;
/// Where the kernel gives no real-time priority.
const NO_HURRY: &str = "the robot's line has no real-time priority: commands may be late on a loaded machine; give the \
                        process CAP_SYS_NICE, or raise `ulimit -r`";
/// How often at most the states that wait are read at one tick.
const READS_MAX: usize = 16;

/// What loop and thread share.
#[derive(Debug, Default)]
struct Shared {
    /// The wish: three velocities, as [`pack`] has them, so that no half of one is ever read.
    wish: AtomicU64,
    /// Until when it holds, nanoseconds.
    until_ns: AtomicU64,
    over: AtomicBool,
    /// The newest state and when it came, where that was lately. The loop only ever tries to lock it.
    state: Mutex<Option<(State, u64)>>,
    remote_stop: AtomicBool,
    /// The thread is to forget a stop by the hand remote; it takes this back once it has.
    forget: AtomicBool,
    /// The thread has begun; whether it may hurry is known from then on.
    begun: AtomicBool,
    may_hurry: AtomicBool,
    refused: AtomicU64,
    /// Why the last of them was.
    refusal: Mutex<Option<WireError>>,
}

impl Shared {
    fn is_over(&self) -> bool {
        self.over.load(Ordering::SeqCst)
    }
}

/// Ten-thousandths of a metre or radian a second in 16 bits each: as far as 3.2767, more than any limit allows.
const UNITS_PER_ONE: f64 = 10_000.0;

fn pack(velocity: Twist2) -> u64 {
    let part = |value: f64| u64::from((value * UNITS_PER_ONE).round() as i16 as u16);
    part(velocity.vx_mps) | part(velocity.vy_mps) << 16 | part(velocity.wz_radps) << 32
}

fn unpack(packed: u64) -> Twist2 {
    let part = |shift: u32| f64::from((packed >> shift) as u16 as i16) / UNITS_PER_ONE;
    Twist2 { vx_mps: part(0), vy_mps: part(16), wz_radps: part(32) }
}

/// A robot by UDP.
#[derive(Debug)]
pub struct UnitreeLink {
    profile: Profile,
    socket: Arc<UdpSocket>,
    robot: SocketAddrV4,
    shared: Arc<Shared>,
    last: Twist2,
    /// As of the last report.
    newest: Option<(State, u64)>,
    told: Told,
    thread: Option<JoinHandle<()>>,
}

/// What the operator has been told of the line.
#[derive(Debug, Default)]
struct Told {
    hurry: bool,
    /// Whether the robot answers.
    answers: Option<bool>,
    /// When it did last, or was first asked, nanoseconds.
    answered_ns: u64,
    /// Why a datagram was refused, and when the last one was, nanoseconds.
    refusal: Option<WireError>,
    refused_ns: u64,
    /// When that was told.
    refusal_ns: u64,
}

impl UnitreeLink {
    /// Opens the socket and begins to talk: zero, and nothing else until something is wished.
    ///
    /// # Errors
    /// Where the socket cannot be had or the thread not be started.
    pub fn open(settings: &UnitreeSettings) -> Result<Self, TransportError> {
        Self::open_at(settings, true)
    }

    /// The same, with real-time priority (where the machine gives it) only if wanted: to measure what it is worth.
    ///
    /// # Errors
    /// As [`UnitreeLink::open`].
    pub fn open_at(settings: &UnitreeSettings, hurry: bool) -> Result<Self, TransportError> {
        let (profile, robot) = (settings.profile, settings.robot());
        let socket = Arc::new(connected(robot, settings.local())?);
        let shared = Arc::new(Shared::default());
        let (theirs, line) = (Arc::clone(&shared), Arc::clone(&socket));
        let thread = std::thread::Builder::new()
            .name("robot".to_owned())
            .spawn(move || talk(profile, &line, &theirs, hurry))
            .map_err(TransportError::service)?;
        let told = Told { answered_ns: monotonic_ns(), ..Told::default() };
        Ok(Self { profile, socket, robot, shared, last: Twist2::ZERO, newest: None, told, thread: Some(thread) })
    }

    /// Whether the thread runs before what is not real-time.
    #[must_use]
    pub fn hurries(&self) -> bool {
        self.shared.may_hurry.load(Ordering::Relaxed)
    }

    /// Datagrams that were no state of this robot.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.shared.refused.load(Ordering::Relaxed)
    }

    /// Where this process panics, the robot hears zero before it ends, and nothing else any more.
    pub fn speak_on_panic(&self) {
        let (profile, socket, shared) = (self.profile, Arc::clone(&self.socket), Arc::clone(&self.shared));
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |why| {
            shared.over.store(true, Ordering::SeqCst);
            // Where the thread is in the midst of its tick, these come after.
            sleep_until(monotonic_ns() + PERIOD_NS);
            last_words(profile, &socket, &shared);
            before(why);
        }));
    }
}

fn connected(robot: SocketAddrV4, local: SocketAddrV4) -> Result<UdpSocket, TransportError> {
    let failed = |what: &str| {
        let text = format!("the robot's line from {local} to {robot} cannot be {what}");
        move |error| TransportError::service(format!("{text}: {error}"))
    };
    let socket = UdpSocket::bind(local).map_err(failed("opened"))?;
    // From here on the kernel drops what comes from anybody else.
    socket.connect(robot).map_err(failed("connected"))?;
    socket.set_nonblocking(true).map_err(failed("set up"))?;
    Ok(socket)
}

/// Sends a command; what cannot be sent now is sent at the next tick.
fn send(profile: Profile, socket: &UdpSocket, command: &Command) {
    let mut bytes = [0; MESSAGE_MAX];
    let bytes = &mut bytes[..profile.command_len()];
    command.encode(profile, bytes);
    let _ = socket.send(bytes);
}

fn last_words(profile: Profile, socket: &UdpSocket, shared: &Shared) {
    for _ in 0..LAST_WORDS {
        say_zero(profile, socket, shared);
    }
}

/// Who was stopped by the hand remote is not told to walk, were it at zero: it may lie.
fn say_zero(profile: Profile, socket: &UdpSocket, shared: &Shared) {
    if !shared.remote_stop.load(Ordering::SeqCst) {
        send(profile, socket, &ZERO);
    }
}

/// The thread: hears, decides and speaks at every tick.
fn talk(profile: Profile, socket: &UdpSocket, shared: &Shared, hurry: bool) {
    shared.may_hurry.store(hurry && hurry_robot_thread(), Ordering::Relaxed);
    shared.begun.store(true, Ordering::Release);
    let mut driver = Driver::new(profile);
    let mut next_ns = monotonic_ns();
    while !shared.is_over() {
        let now_ns = monotonic_ns();
        let forget = shared.forget.load(Ordering::Acquire);
        if forget {
            driver.forget_remote_stop();
        }
        hear(profile, socket, shared, &mut driver, now_ns);
        if forget {
            shared.forget.store(false, Ordering::Release);
        }
        driver.wish(unpack(shared.wish.load(Ordering::Acquire)), shared.until_ns.load(Ordering::Acquire));
        let command = driver.command(now_ns);
        // Zero may have been sent by others since the wish was read: nothing older is to come after it.
        let outdated = || !command.velocity.is_zero() && (shared.wish.load(Ordering::SeqCst) == 0 || shared.is_over());
        if !outdated() {
            send(profile, socket, &command);
            if outdated() {
                say_zero(profile, socket, shared);
            }
        }
        // What was missed is not made up for.
        next_ns = (next_ns + PERIOD_NS).max(now_ns);
        sleep_until(next_ns);
    }
    last_words(profile, socket, shared);
}

fn sleep_until(at_ns: u64) {
    let at = Timespec { tv_sec: (at_ns / NS_PER_S) as i64, tv_nsec: (at_ns % NS_PER_S) as i64 };
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &at);
}

fn hear(profile: Profile, socket: &UdpSocket, shared: &Shared, driver: &mut Driver, now_ns: u64) {
    let mut bytes = [0; MESSAGE_MAX];
    for _ in 0..READS_MAX {
        let Ok(count) = socket.recv(&mut bytes) else { break };
        match State::decode(profile, &bytes[..count]) {
            Ok(state) => driver.received(state, now_ns),
            Err(why) => {
                shared.refused.fetch_add(1, Ordering::Relaxed);
                if let Ok(mut last) = shared.refusal.try_lock() {
                    *last = Some(why);
                }
            }
        }
    }
    shared.remote_stop.store(driver.remote_stop(), Ordering::Release);
    if let Ok(mut state) = shared.state.try_lock() {
        *state = driver.state(now_ns);
    }
}

impl Link for UnitreeLink {
    fn write(&mut self, velocity: Twist2, for_ns: u64) -> Result<(), TransportError> {
        let stops = velocity.is_zero() && !self.last.is_zero();
        self.last = velocity;
        self.shared.wish.store(pack(velocity), Ordering::SeqCst);
        self.shared.until_ns.store(monotonic_ns() + for_ns.min(DEAD_MAN_NS), Ordering::Release);
        if stops {
            say_zero(self.profile, &self.socket, &self.shared);
        }
        match &self.thread {
            Some(thread) if !thread.is_finished() => Ok(()),
            _ => Err(TransportError::Service(format!("nobody talks to the robot at {} any more", self.robot))),
        }
    }

    fn report(&mut self) -> Result<RobotReport, TransportError> {
        if let Ok(state) = self.shared.state.try_lock() {
            self.newest = *state;
        }
        // As long as the thread has not forgotten a stop, what it says of it is of before.
        let forgets = self.shared.forget.load(Ordering::Acquire);
        let remote_stop = !forgets && self.shared.remote_stop.load(Ordering::Acquire);
        let now_ns = monotonic_ns();
        // What the thread left behind ages, whether it lives or not.
        self.newest = self.newest.filter(|(_, came_ns)| now_ns.saturating_sub(*came_ns) <= STATE_MAX_AGE_NS);
        let Some((state, came_ns)) = self.newest else {
            return Ok(RobotReport { remote_stop, ..RobotReport::default() });
        };
        let [x_m, y_m, _] = state.position_m.map(f64::from);
        let [roll_rad, pitch_rad, yaw_rad] = state.roll_pitch_yaw_rad();
        Ok(RobotReport {
            velocity: Some(state.velocity),
            own_from_robot: Some((Pose2::new(x_m, y_m, yaw_rad), now_ns.saturating_sub(came_ns))),
            roll_pitch_rad: [roll_rad, pitch_rad],
            charge_percent: state.charge_percent,
            remote_stop,
        })
    }

    fn forget_remote_stop(&mut self) {
        self.shared.forget.store(true, Ordering::Release);
    }

    /// As of the last report.
    fn news(&mut self) -> Option<String> {
        if !self.told.hurry && self.shared.begun.load(Ordering::Acquire) {
            self.told.hurry = true;
            if !self.hurries() {
                return Some(NO_HURRY.to_owned());
            }
        }
        let (answers, now_ns) = (self.newest.is_some(), monotonic_ns());
        // Told again for another reason, and after a while in which all was well.
        let refusal = self.shared.refusal.try_lock().ok().and_then(|mut last| last.take());
        if let Some(why) = refusal {
            let [well, may_tell] = [(self.told.refused_ns, WELL_NS), (self.told.refusal_ns, SILENT_NS)]
                .map(|(at_ns, span_ns)| now_ns.saturating_sub(at_ns) > span_ns);
            self.told.refused_ns = now_ns;
            if may_tell && (well || self.told.refusal != Some(why)) {
                (self.told.refusal, self.told.refusal_ns) = (Some(why), now_ns);
                return Some(format!("what comes from {} is no state of {}: {why}", self.robot, self.profile.name()));
            }
        }
        if answers {
            self.told.answered_ns = now_ns;
        }
        // One that is late is no news yet.
        let silent = now_ns.saturating_sub(self.told.answered_ns) > SILENT_NS;
        if answers != silent && self.told.answers != Some(answers) {
            self.told.answers = Some(answers);
        } else {
            return None;
        }
        let what = if answers { "answers" } else { "does not answer: is it on, is its cable in, is this its address" };
        Some(format!("the robot at {} {what}", self.robot))
    }
}

impl Drop for UnitreeLink {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            // It says its last words first; what else it had to say is lost with it.
            let _ = thread.join();
        }
    }
}

/// The brake's own socket.
#[derive(Debug)]
pub struct UnitreeBrake {
    profile: Profile,
    socket: UdpSocket,
}

impl UnitreeBrake {
    /// Opens it, at whatever port is free.
    ///
    /// # Errors
    /// Where no socket can be had.
    pub fn open(settings: &UnitreeSettings) -> Result<Self, TransportError> {
        let any = SocketAddrV4::new(std::net::Ipv4Addr::UNSPECIFIED, 0);
        Ok(Self { profile: settings.profile, socket: connected(settings.robot(), any)? })
    }
}

impl BrakePath for UnitreeBrake {
    /// The robot knows nothing of incarnations: locomotion is dead by now, which is what fences it. The brake hears
    /// nothing of the robot either, and may be all that ends a walk.
    fn zero(&mut self, _fenced: u32) {
        send(self.profile, &self.socket, &ZERO);
    }
}

#[cfg(test)]
mod tests {
    use messages::Twist2;

    use super::{pack, unpack};

    #[test]
    fn a_velocity_is_shared_as_a_whole() {
        for velocity in [
            Twist2::ZERO,
            Twist2 { vx_mps: 0.5, vy_mps: -0.3536, wz_radps: 0.3491 },
            Twist2 { vx_mps: -3.2, vy_mps: 3.2, wz_radps: -3.2 },
        ] {
            assert_eq!(unpack(pack(velocity)), velocity);
        }
        let wild = Twist2 { vx_mps: f64::NAN, vy_mps: 1e9, wz_radps: f64::NEG_INFINITY };
        assert_eq!(unpack(pack(wild)), Twist2 { vx_mps: 0.0, vy_mps: 3.2767, wz_radps: -3.2768 });
    }
}
