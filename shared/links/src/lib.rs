//! The ways to command a robot. `locomotion` has a [`Link`]; `brake` has a [`BrakePath`] of its own, that shares
//! nothing with it.

mod bridge;
mod null;
mod simulated;
mod unitree;

use messages::{Pose2, Twist2};
use settings::{LinkKind, Locomotion};
use transport::{Io, TransportError};

/// How long the robots' own dead man's switch and their states hold, whatever the line to them.
pub use ::unitree::{DEAD_MAN_NS, STATE_MAX_AGE_NS};

pub use self::unitree::{PERIOD_NS as UNITREE_PERIOD_NS, UnitreeBrake, UnitreeLink};
pub use bridge::{BridgeBrake, BridgeLink, FromBridge, ToBridge, Told, WORD_MAX};
pub use null::{NullBrake, NullLink};
pub use simulated::{BRAKE_MESSAGE_LEN, BrakeMessage, SimulatedBrake, SimulatedLink};

/// A way to command a robot. No call blocks.
pub trait Link {
    /// Commands a velocity in the robot frame, that holds for `for_ns` nanoseconds where nothing follows, but no longer
    /// than the link's own dead man's switch lets it. A link without one leaves it to the robot, which may keep it.
    ///
    /// # Errors
    /// Where the command cannot be handed to the robot.
    fn write(&mut self, velocity: Twist2, for_ns: u64) -> Result<(), TransportError>;

    /// What the robot told last of itself, where it tells anything.
    ///
    /// # Errors
    /// Where the robot's report cannot be read.
    fn report(&mut self) -> Result<RobotReport, TransportError>;

    /// The operator has resumed: a stop that came by the robot's hand remote is over, unless it comes again.
    fn forget_remote_stop(&mut self) {}

    /// What the operator is to know of the line to the robot, once; no news, no text.
    fn news(&mut self) -> Option<String> {
        None
    }
}

/// What a robot tells of itself; what it does not tell, or has not told lately, is none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RobotReport {
    /// Its velocity, robot frame.
    pub velocity: Option<Twist2>,
    /// Where it believes to be, in a frame of its own, and how long ago that was heard, nanoseconds.
    pub own_from_robot: Option<(Pose2, u64)>,
    /// How its body was held then, about the forward and about the left axis, radians.
    pub roll_pitch_rad: [f64; 2],
    /// Charge of its battery, percent.
    pub charge_percent: Option<u8>,
    /// Whether somebody has stopped it by its hand remote.
    pub remote_stop: bool,
}

/// The brake's second way to the robot. No call blocks.
pub trait BrakePath {
    /// Looks after the path, at every tick: what is gone is opened again.
    fn keep(&mut self) {}

    /// Commands zero, and that commands of locomotion's incarnations up to `fenced` are worth nothing.
    fn zero(&mut self, fenced: u32);
}

type Opened<T> = Result<Box<T>, TransportError>;

/// The code of a link: locomotion's way to the robot, and the brake's.
struct LinkCode {
    link: fn(&Locomotion, &mut Io) -> Opened<dyn Link>,
    brake: fn(&Locomotion, &Io) -> Opened<dyn BrakePath>,
}

fn code(kind: LinkKind) -> LinkCode {
    match kind {
        LinkKind::Simulated => LinkCode {
            link: |_, io| Ok(Box::new(SimulatedLink::open(io)?)),
            brake: |_, io| Ok(Box::new(SimulatedBrake::open(io)?)),
        },
        LinkKind::Unitree => LinkCode {
            link: |settings, _| {
                let link = UnitreeLink::open(&settings.unitree)?;
                link.speak_on_panic();
                Ok(Box::new(link))
            },
            brake: |settings, _| Ok(Box::new(UnitreeBrake::open(&settings.unitree)?)),
        },
        LinkKind::Go2 | LinkKind::Ros2 => LinkCode {
            link: |_, io| Ok(Box::new(BridgeLink::new(io))),
            brake: |_, io| Ok(Box::new(BridgeBrake::new(io))),
        },
        LinkKind::Null => {
            LinkCode { link: |_, _| Ok(Box::new(NullLink::default())), brake: |_, _| Ok(Box::new(NullBrake)) }
        }
    }
}

/// The link of these settings.
///
/// # Errors
/// Where it cannot be opened.
pub fn open_link(settings: &Locomotion, io: &mut Io) -> Result<Box<dyn Link>, TransportError> {
    (code(settings.link).link)(settings, io)
}

/// The brake's path of these settings.
///
/// # Errors
/// Where it cannot be opened.
pub fn open_brake_path(settings: &Locomotion, io: &Io) -> Result<Box<dyn BrakePath>, TransportError> {
    (code(settings.link).brake)(settings, io)
}
