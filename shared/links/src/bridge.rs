//! A robot on DDS, through `bridge` and `backstop`: processes of their own, so that neither locomotion nor the brake
//! has a network of threads in it.
//!
//! What goes to and fro are fixed words over a line in the run directory, whose closing each end notices at once. Every
//! wish says until when it holds, and the bridge judges that again.

use std::path::PathBuf;

use messages::{Pose2, Twist2};
use transport::{Io, Line, Received, TransportError, monotonic_ns};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{BrakePath, DEAD_MAN_NS, Link, RobotReport, STATE_MAX_AGE_NS};

/// Room for the longest word, bytes.
pub const WORD_MAX: usize = 128;

/// What is said to bridge and backstop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ToBridge {
    /// Locomotion is here, in this life.
    Locomotion(u32),
    /// The brake is here.
    Brake,
    /// The backstop is here.
    Backstop,
    /// A velocity in the robot frame, until then on the monotonic clock, nanoseconds.
    Wish(Twist2, u64),
    /// Zero, whatever else is wished.
    Zero,
    /// A stop by the hand remote is over, unless it comes again; the how many-th since that life said hello.
    ForgetRemoteStop(u32),
}

/// How a robot moves and is held.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Told {
    /// Its velocity, robot frame.
    pub velocity: Twist2,
    /// Where it believes to be.
    pub own_from_robot: Pose2,
    /// How its body is held, about the forward and about the left axis, radians.
    pub roll_pitch_rad: [f64; 2],
    /// When that came, on the monotonic clock, nanoseconds.
    pub came_ns: u64,
}

/// What the bridge knows of the robot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FromBridge {
    /// How it moves and is held, where it told that.
    pub state: Option<Told>,
    /// Charge of its battery, percent.
    pub charge_percent: Option<u8>,
    /// Whether somebody has stopped it by its hand remote.
    pub remote_stop: bool,
    /// The last [`ToBridge::ForgetRemoteStop`] that it has heard: what is said of one before is of before.
    pub forgotten: u32,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct ToWire {
    magic: [u8; 4],
    kind: u32,
    count: u64,
    until_ns: u64,
    velocity: [f64; 3],
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct FromWire {
    magic: [u8; 4],
    has_state: u8,
    has_charge: u8,
    charge_percent: u8,
    remote_stop: u8,
    forgotten: u64,
    came_ns: u64,
    velocity: [f64; 3],
    pose: [f64; 3],
    roll_pitch_rad: [f64; 2],
}

const TO_MAGIC: [u8; 4] = *b"GDT1";
const FROM_MAGIC: [u8; 4] = *b"GDF1";

fn numbers(velocity: Twist2) -> [f64; 3] {
    [velocity.vx_mps, velocity.vy_mps, velocity.wz_radps]
}

fn twist([vx_mps, vy_mps, wz_radps]: [f64; 3]) -> Twist2 {
    Twist2 { vx_mps, vy_mps, wz_radps }
}

impl ToBridge {
    /// Sends it; `false` where nobody takes it.
    #[must_use]
    pub fn send(self, line: &Line) -> bool {
        let (kind, count, velocity, until_ns) = match self {
            Self::Locomotion(incarnation) => (1, incarnation, Twist2::ZERO, 0),
            Self::Brake => (2, 0, Twist2::ZERO, 0),
            Self::Backstop => (3, 0, Twist2::ZERO, 0),
            Self::Wish(velocity, until_ns) => (4, 0, velocity, until_ns),
            Self::Zero => (5, 0, Twist2::ZERO, 0),
            Self::ForgetRemoteStop(count) => (6, count, Twist2::ZERO, 0),
        };
        let velocity = numbers(velocity);
        let wire = ToWire { magic: TO_MAGIC, kind, count: u64::from(count), until_ns, velocity };
        line.send_bytes(wire.as_bytes())
    }

    /// The word that the bytes are; a velocity that is not finite is none.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let wire = ToWire::read_from_bytes(bytes).ok().filter(|wire| wire.magic == TO_MAGIC)?;
        match wire.kind {
            1 => u32::try_from(wire.count).ok().map(Self::Locomotion),
            2 => Some(Self::Brake),
            3 => Some(Self::Backstop),
            4 => Some(Self::Wish(twist(wire.velocity), wire.until_ns)).filter(|_| twist(wire.velocity).is_finite()),
            5 => Some(Self::Zero),
            6 => u32::try_from(wire.count).ok().map(Self::ForgetRemoteStop),
            _ => None,
        }
    }
}

impl FromBridge {
    /// Sends it; `false` where nobody takes it.
    #[must_use]
    pub fn send(self, line: &Line) -> bool {
        let Told { velocity, own_from_robot: pose, roll_pitch_rad, came_ns } = self.state.unwrap_or_default();
        let wire = FromWire {
            magic: FROM_MAGIC,
            has_state: self.state.is_some().into(),
            has_charge: self.charge_percent.is_some().into(),
            charge_percent: self.charge_percent.unwrap_or_default(),
            remote_stop: self.remote_stop.into(),
            forgotten: u64::from(self.forgotten),
            came_ns,
            velocity: numbers(velocity),
            pose: [pose.x_m, pose.y_m, pose.yaw_rad],
            roll_pitch_rad,
        };
        line.send_bytes(wire.as_bytes())
    }

    /// The word that the bytes are.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let wire = FromWire::read_from_bytes(bytes).ok().filter(|wire| wire.magic == FROM_MAGIC)?;
        let [x_m, y_m, yaw_rad] = wire.pose;
        let state = Told {
            velocity: twist(wire.velocity),
            own_from_robot: Pose2::new(x_m, y_m, yaw_rad),
            roll_pitch_rad: wire.roll_pitch_rad,
            came_ns: wire.came_ns,
        };
        Some(Self {
            state: (wire.has_state == 1).then_some(state),
            charge_percent: (wire.has_charge == 1).then_some(wire.charge_percent),
            remote_stop: wire.remote_stop == 1,
            forgotten: u32::try_from(wire.forgotten).ok()?,
        })
    }
}

/// A line that is made again when it is gone; `hello` is said first on each.
#[derive(Debug)]
struct Bound {
    path: PathBuf,
    hello: ToBridge,
    line: Option<Line>,
}

impl Bound {
    fn new(path: PathBuf, hello: ToBridge) -> Self {
        Self { path, hello, line: None }
    }
}

impl Bound {
    /// Sees to it that there is a line, where the other end is there: whether it is another one than before.
    fn keep(&mut self) -> bool {
        if self.line.as_ref().is_some_and(Line::is_open) {
            return false;
        }
        self.line = Line::connect(&self.path).filter(|line| self.hello.send(line));
        true
    }
}

/// Commands a robot through the bridge.
#[derive(Debug)]
pub struct BridgeLink {
    bridge: Bound,
    newest: FromBridge,
    /// So many stops by the hand remote were forgotten on this line.
    forgets: u32,
}

impl BridgeLink {
    /// The bridge is sought from the first command on.
    #[must_use]
    pub fn new(io: &Io) -> Self {
        let hello = ToBridge::Locomotion(io.identity().incarnation);
        Self { bridge: Bound::new(io.domain.dir.bridge_socket(), hello), newest: FromBridge::default(), forgets: 0 }
    }
}

impl BridgeLink {
    /// The line to the bridge; on a new one nothing has been heard or forgotten yet.
    fn line(&mut self) -> Option<&Line> {
        if self.bridge.keep() {
            (self.newest, self.forgets) = (FromBridge::default(), 0);
        }
        self.bridge.line.as_ref()
    }
}

impl Link for BridgeLink {
    /// Where there is no bridge nobody is commanded, and the backstop stops the robot; the supervisor tells of it.
    fn write(&mut self, velocity: Twist2, for_ns: u64) -> Result<(), TransportError> {
        if let Some(line) = self.line() {
            let _ = ToBridge::Wish(velocity, monotonic_ns() + for_ns.min(DEAD_MAN_NS)).send(line);
        }
        Ok(())
    }

    fn report(&mut self) -> Result<RobotReport, TransportError> {
        let (mut bytes, mut newest) = ([0; WORD_MAX], None);
        if let Some(line) = self.line() {
            while let Received::Message(len, _) = line.receive_bytes(&mut bytes) {
                newest = FromBridge::of(&bytes[..len]).or(newest);
            }
        }
        self.newest = newest.unwrap_or(self.newest);
        let now_ns = monotonic_ns();
        let young = self.newest.state.filter(|told| now_ns.saturating_sub(told.came_ns) <= STATE_MAX_AGE_NS);
        Ok(RobotReport {
            velocity: young.map(|told| told.velocity),
            own_from_robot: young.map(|told| (told.own_from_robot, now_ns.saturating_sub(told.came_ns))),
            roll_pitch_rad: young.map_or([0.0; 2], |told| told.roll_pitch_rad),
            charge_percent: self.newest.charge_percent,
            // Until it has forgotten a stop, what it says of it is of before.
            remote_stop: self.newest.remote_stop && self.newest.forgotten == self.forgets,
        })
    }

    fn forget_remote_stop(&mut self) {
        // On the line that there is now: a new one counts from its beginning.
        let _ = self.line();
        self.forgets += 1;
        if let Some(line) = &self.bridge.line {
            let _ = ToBridge::ForgetRemoteStop(self.forgets).send(line);
        }
    }
}

/// The brake's way through the backstop.
#[derive(Debug)]
pub struct BridgeBrake(Bound);

impl BridgeBrake {
    /// The backstop is sought from the first tick on.
    #[must_use]
    pub fn new(io: &Io) -> Self {
        Self(Bound::new(io.domain.dir.backstop_socket(), ToBridge::Brake))
    }
}

impl BrakePath for BridgeBrake {
    fn keep(&mut self) {
        let _ = self.0.keep();
    }

    fn zero(&mut self, _fenced: u32) {
        // Sent again 20 ms later: there is nothing better to do where the backstop is gone, too.
        let _ = self.0.keep();
        if let Some(line) = &self.0.line {
            let _ = ToBridge::Zero.send(line);
        }
    }
}

#[cfg(test)]
mod tests {
    use messages::{Pose2, Twist2};
    use transport::{Line, Received};

    use super::{FromBridge, ToBridge, Told, WORD_MAX};

    const AHEAD: Twist2 = Twist2 { vx_mps: 0.5, vy_mps: -0.25, wz_radps: 0.125 };

    fn over(send: impl FnOnce(&Line) -> bool) -> Vec<u8> {
        let (near, far) = Line::pair().expect("a line");
        assert!(send(&near));
        let mut bytes = [0; WORD_MAX];
        let Received::Message(len, _) = far.receive_bytes(&mut bytes) else { panic!("a word") };
        bytes[..len].to_vec()
    }

    #[test]
    fn every_word_is_there_and_back_and_nothing_else_is_one() {
        for word in [
            ToBridge::Locomotion(7),
            ToBridge::Brake,
            ToBridge::Backstop,
            ToBridge::Wish(AHEAD, 123),
            ToBridge::Zero,
            ToBridge::ForgetRemoteStop(3),
        ] {
            let bytes = over(|line| word.send(line));
            assert_eq!(ToBridge::of(&bytes), Some(word));
            assert_eq!(ToBridge::of(&bytes[1..]), None);
            assert_eq!(FromBridge::of(&bytes), None);
        }
        let wild = over(|line| ToBridge::Wish(Twist2 { vx_mps: f64::NAN, ..AHEAD }, 0).send(line));
        assert_eq!(ToBridge::of(&wild), None);
        let (own_from_robot, roll_pitch_rad) = (Pose2::new(1.0, 2.0, 0.5), [0.1, -0.2]);
        let state = Some(Told { velocity: AHEAD, own_from_robot, roll_pitch_rad, came_ns: 99 });
        for word in
            [FromBridge { state, charge_percent: Some(0), remote_stop: true, forgotten: 4 }, FromBridge::default()]
        {
            let bytes = over(|line| word.send(line));
            assert_eq!((FromBridge::of(&bytes), ToBridge::of(&bytes)), (Some(word), None));
        }
    }
}
