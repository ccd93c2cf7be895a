//! The faults that can be injected: what each does, in numbers, and why these numbers. One table for the command line,
//! the supervisor, the publishers that apply them and the matrix that tests them.

mod dice;

use serde::{Deserialize, Serialize};

pub use dice::Dice;

use crate::topic::TOPICS;
use crate::{ServiceId, TopicId};

/// A slow stream lets one message of so many through: every stream of the table is then over its max age between two
/// (a scan a second, a pose every 200 ms, a beat every 200 ms).
pub const SLOW_EVERY: u64 = 10;
/// A delayed message is so late: twice the max age of a scan, so that no message that has an age is still fresh, and
/// under the second within which a cue must be accepted.
pub const DELAY_NS: u64 = 400_000_000;
/// An intermittent stream is silent for a time drawn from this range: always longer than the max age of a scan. It
/// begins with silence.
pub const SILENT_NS: (u64, u64) = (300_000_000, 600_000_000);
/// And sends for a time drawn from this one: long enough that who waits for it takes it up again.
pub const SENDING_NS: (u64, u64) = (100_000_000, 400_000_000);
/// A wrong length is so many times the right one. A radius taken for a diameter is the classic among such errors.
pub const WRONG_SCALE: f64 = 2.0;
/// A wrong beat tells of streams so much older than they are: over twice the max age of any.
pub const WRONG_AGE_NS: u64 = 1_000_000_000;
/// Each turn of a slow process's loop takes so much longer: over the beat limit of a critical service (120 ms), under
/// that of what stands for the world.
pub const SLOW_TURN_NS: u64 = 150_000_000;
/// A leaking process keeps so much more memory at each beat: the 32 MiB of a small service within two seconds.
pub const LEAK_BYTES: usize = 512 << 10;
/// And so much in all: the machine belongs to others too.
pub const LEAK_MAX_BYTES: usize = 256 << 20;
/// Three datagrams of so many are lost on a lossy line: for 2 ms between two of them, seldom more than 20 in a row.
pub const LOSS_OF: u64 = 10;
/// One bit of so many flips on a noisy line.
pub const NOISE_BITS: u64 = 2_000;
/// A mount that was bent is so far off, radians: three degrees.
pub const TILT_RAD: f64 = 0.0524;
/// A battery that is nearly empty, percent.
pub const LOW_CHARGE_PERCENT: u8 = 5;
/// A process that exits on start does so this many times: the third life of it is well.
pub const EXITS_ON_START: u32 = 2;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// Nothing is published.
    Off,
    /// Every message carries the seq of the last good one.
    StuckSeq,
    /// Every message carries the stamp of the last good one.
    StuckStamp,
    /// Every message carries the content of the first, under a header of its own.
    StuckBytes,
    /// Numbers are random: NaN, infinities and absurd sizes among them.
    Garbage,
    /// A plausible wrong value.
    Wrong,
    /// One message of [`SLOW_EVERY`]; a process's loop turns [`SLOW_TURN_NS`] late.
    Slow,
    /// Every message is [`DELAY_NS`] late, with the stamp that it had.
    Delayed,
    /// Bursts of messages and of silence, by seed.
    Intermittent,
    /// The camera shows no floor.
    NoFloor,
    /// The camera is mounted [`TILT_RAD`] otherwise than its frames say.
    Tilted,
    /// SIGKILL.
    Kill,
    /// SIGSTOP.
    Hang,
    /// Memory is taken and not given back.
    Leak,
    /// The next [`EXITS_ON_START`] starts fail; the present life is killed.
    ExitOnStart,
    /// The disk that the recorder writes to is full.
    FullDisk,
    /// `/dev/shm` is full.
    FullShm,
    /// The plug is pulled.
    Unplugged,
    /// Bits flip on the line.
    Noise,
    /// The device talks at another speed.
    WrongBaud,
    /// Datagrams are lost.
    Loss,
    /// Every datagram comes twice.
    Duplicated,
    /// The device hears, and says nothing.
    Silent,
    /// The robot's battery is nearly empty.
    LowBattery,
    /// Somebody stops the robot by its hand remote.
    RemoteStop,
    /// Somebody presses the emergency stop.
    Pressed,
}

/// A device at the end of a line, where it is emulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Device {
    /// The lidar at its serial line.
    Lidar,
    /// The robot at its network cable.
    Robot,
    /// The emergency stop at its serial line.
    Estop,
    /// The depth camera at its socket.
    Camera,
}

impl Device {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Lidar, Self::Robot, Self::Estop, Self::Camera];

    /// Its name, behind `line/`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lidar => "lidar",
            Self::Robot => "robot",
            Self::Estop => "estop",
            Self::Camera => "camera",
        }
    }
}

/// What a fault is done to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// A stream; for `health` also whose.
    Stream(TopicId, ServiceId),
    /// A process.
    Service(ServiceId),
    /// An emulated device and its line.
    Line(Device),
    /// The machine.
    Host,
}

/// A row of the table.
#[derive(Debug, Clone, Copy)]
pub struct FaultSpec {
    /// Which.
    pub fault: Fault,
    /// Its name on the command line, in the matrix and in reports.
    pub name: &'static str,
    /// What it does, with its numbers.
    pub what: &'static str,
}

const fn row(fault: Fault, name: &'static str, what: &'static str) -> FaultSpec {
    FaultSpec { fault, name, what }
}

/// The table.
pub const FAULTS: [FaultSpec; 26] = [
    row(Fault::Off, "off", "stream: nothing is published"),
    row(Fault::StuckSeq, "stuck_seq", "stream: the seq stays that of the last good message"),
    row(Fault::StuckStamp, "stuck_stamp", "stream: the stamp stays that of the last good message"),
    row(Fault::StuckBytes, "stuck_bytes", "stream: the content is frozen under fresh headers (also: stuck)"),
    row(Fault::Garbage, "garbage", "stream: random numbers, NaN, infinities and absurd sizes"),
    row(Fault::Wrong, "wrong", "stream: a plausible wrong value: lengths doubled, another action, another cue"),
    row(Fault::Slow, "slow", "stream: every 10th message only; process: each turn of its loop takes 150 ms longer"),
    row(
        Fault::Delayed,
        "delayed",
        "stream: every message 400 ms late, with its old stamp; line/robot: every datagram, either way; \
         line/camera: every frame",
    ),
    row(Fault::Intermittent, "intermittent", "stream: silent for 300 to 600 ms, sending for 100 to 400 ms, by seed"),
    row(Fault::NoFloor, "no_floor", "depth: pixels of the floor say nothing"),
    row(Fault::Tilted, "tilted", "depth: the camera is mounted 3 degrees otherwise than its frames say"),
    row(Fault::Kill, "kill", "process: SIGKILL"),
    row(Fault::Hang, "hang", "process: SIGSTOP"),
    row(Fault::Leak, "leak", "process: 512 KiB more memory at each beat, to 256 MiB"),
    row(Fault::ExitOnStart, "exit_on_start", "process: killed, and its next two lives exit as they start"),
    row(Fault::FullDisk, "full_disk", "host: the recorder's disk is full"),
    row(Fault::FullShm, "full_shm", "host: /dev/shm is full"),
    row(Fault::Unplugged, "unplugged", "line: the plug is pulled"),
    row(Fault::Noise, "noise", "line: a bit in 2,000 flips"),
    row(Fault::WrongBaud, "wrong_baud", "line/lidar: the device talks at another speed"),
    row(Fault::Loss, "loss", "line/robot: three datagrams of ten are lost, either way"),
    row(Fault::Duplicated, "duplicated", "line/robot: every datagram comes twice"),
    row(Fault::Silent, "silent", "line: the device hears, obeys, and says nothing"),
    row(Fault::LowBattery, "low_battery", "line/robot: its battery is at 5 %, where it tells of it"),
    row(
        Fault::RemoteStop,
        "remote_stop",
        "line/robot: somebody stops it by its hand remote, and lets it stand again at the end",
    ),
    row(Fault::Pressed, "pressed", "line/estop: somebody presses the emergency stop, and releases it at the end"),
];

/// The streams that a fault can be injected into by their names, as the topic table says; each service's health
/// besides. Those of the simulated world and of the clock are none: they stand for what is outside.
pub fn streams() -> impl Iterator<Item = TopicId> {
    TOPICS.iter().filter(|spec| spec.injectable).map(|spec| spec.id)
}

impl Fault {
    /// Every fault that a stream can have.
    pub const OF_STREAMS: [Self; 9] = [
        Self::Off,
        Self::StuckSeq,
        Self::StuckStamp,
        Self::StuckBytes,
        Self::Garbage,
        Self::Wrong,
        Self::Slow,
        Self::Delayed,
        Self::Intermittent,
    ];
    /// Every fault that the camera's stream can have.
    pub const OF_DEPTH: [Self; 11] = {
        let mut all = [Self::NoFloor; 11];
        let (streams, own) = all.split_at_mut(Self::OF_STREAMS.len());
        streams.copy_from_slice(&Self::OF_STREAMS);
        own.copy_from_slice(&[Self::NoFloor, Self::Tilted]);
        all
    };
    /// Every fault that a process can have.
    pub const OF_SERVICES: [Self; 5] = [Self::Kill, Self::Hang, Self::Slow, Self::Leak, Self::ExitOnStart];
    /// Every fault that the lidar's line can have.
    pub const OF_LIDAR_LINE: [Self; 4] = [Self::Unplugged, Self::Noise, Self::WrongBaud, Self::Silent];
    /// Every fault that the robot and its line can have.
    pub const OF_ROBOT_LINE: [Self; 8] = [
        Self::Unplugged,
        Self::Noise,
        Self::Loss,
        Self::Delayed,
        Self::Duplicated,
        Self::Silent,
        Self::LowBattery,
        Self::RemoteStop,
    ];
    /// Every fault that the emergency stop and its line can have.
    pub const OF_ESTOP_LINE: [Self; 3] = [Self::Pressed, Self::Unplugged, Self::Silent];
    /// Every fault that the camera and its line can have.
    pub const OF_CAMERA_LINE: [Self; 3] = [Self::Unplugged, Self::Silent, Self::Delayed];
    /// Every fault that the machine can have.
    pub const OF_HOST: [Self; 2] = [Self::FullDisk, Self::FullShm];

    /// The name of its row.
    #[must_use]
    pub fn name(self) -> &'static str {
        FAULTS.iter().find(|row| row.fault == self).map_or("none", |row| row.name)
    }

    /// The fault of that name, if there is one; `-` is as good as `_`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let name = name.replace('-', "_");
        let name = if name == "stuck" { "stuck_bytes" } else { &name };
        FAULTS.iter().find(|row| row.name == name).map(|row| row.fault)
    }
}

impl Target {
    /// The faults that it can have.
    #[must_use]
    pub fn faults(self) -> &'static [Fault] {
        match self {
            Self::Stream(TopicId::DepthFrame, _) => &Fault::OF_DEPTH,
            Self::Stream(..) => &Fault::OF_STREAMS,
            Self::Service(_) => &Fault::OF_SERVICES,
            Self::Line(Device::Lidar) => &Fault::OF_LIDAR_LINE,
            Self::Line(Device::Robot) => &Fault::OF_ROBOT_LINE,
            Self::Line(Device::Estop) => &Fault::OF_ESTOP_LINE,
            Self::Line(Device::Camera) => &Fault::OF_CAMERA_LINE,
            Self::Host => &Fault::OF_HOST,
        }
    }

    /// The target of that name: a stream of the topic table, `health/<service>`, a service, `line/lidar` and the
    /// like, or `host`. `odometry` and
    /// `cue` name both a stream and a service: the fault says which is meant, and where both can have it, it is the
    /// stream; `service/<name>` is always the service.
    #[must_use]
    pub fn from_name(name: &str, fault: Option<Fault>) -> Option<Self> {
        if name == "host" {
            return Some(Self::Host);
        }
        if let Some(whose) = name.strip_prefix("health/") {
            return ServiceId::from_name(whose).map(|of| Self::Stream(TopicId::Health, of));
        }
        if let Some(line) = name.strip_prefix("line/") {
            return Device::ALL.into_iter().find(|device| device.name() == line).map(Self::Line);
        }
        if let Some(service) = name.strip_prefix("service/") {
            return ServiceId::from_name(service).map(Self::Service);
        }
        let stream = streams().find(|topic| topic.name() == name);
        let stream = stream.map(|topic| Self::Stream(topic, ServiceId::None));
        let service = ServiceId::from_name(name).map(Self::Service);
        let fits = |target: &Self| fault.is_none_or(|fault| target.faults().contains(&fault));
        stream.filter(fits).or(service.filter(fits)).or(stream).or(service)
    }

    /// The services that publish a stream; the service itself; nobody for the machine.
    #[must_use]
    pub fn publishers(self) -> &'static [ServiceId] {
        match self {
            Self::Stream(TopicId::Health, of) | Self::Service(of) => of.alone(),
            Self::Stream(topic, _) => topic.spec().map_or(&[], |spec| spec.publishers),
            Self::Line(_) => ServiceId::Emulator.alone(),
            Self::Host => &[],
        }
    }
}

/// The target and the fault of those names; no fault for "none", which mends the target.
///
/// # Errors
/// Where there is no such fault or target, or the target cannot have the fault; the reason says what there is.
pub fn parse(target: &str, fault: &str) -> Result<(Target, Option<Fault>), String> {
    let names = |faults: &[Fault]| faults.iter().map(|fault| fault.name()).collect::<Vec<_>>().join(", ");
    let kind = Fault::from_name(fault);
    if kind.is_none() && fault != "none" {
        return Err(format!("there is no fault {fault}; known: {}, none", names(&FAULTS.map(|row| row.fault))));
    }
    let Some(found) = Target::from_name(target, kind) else {
        return Err(format!("there is no stream, no service and no line {target}"));
    };
    match kind.filter(|kind| !found.faults().contains(kind)) {
        Some(kind) => Err(format!("{found} can be {}, not {}", names(found.faults()), kind.name())),
        None => Ok((found, kind)),
    }
}

impl core::fmt::Display for Target {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Stream(TopicId::Health, of) => write!(f, "health/{of}"),
            Self::Stream(topic, _) => write!(f, "{topic}"),
            // A stream of that name is meant by the bare word.
            Self::Service(service @ (ServiceId::Odometry | ServiceId::Cue)) => write!(f, "service/{service}"),
            Self::Service(service) => write!(f, "{service}"),
            Self::Line(device) => write!(f, "line/{}", device.name()),
            Self::Host => f.write_str("host"),
        }
    }
}

/// A fault to inject.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Injection {
    /// Into what.
    pub target: Target,
    /// Which; none mends the target.
    pub fault: Option<Fault>,
    /// Seed of what is random about it.
    pub seed: u64,
    /// Run time at which it was injected, nanoseconds: bursts go on from there, whoever publishes meanwhile.
    pub since_ns: u64,
    /// How long it lasts, nanoseconds of run time; without it, until it is mended.
    pub for_ns: Option<u64>,
}

impl Injection {
    /// Run time at which it ends by itself, nanoseconds.
    #[must_use]
    pub fn until_ns(&self) -> u64 {
        self.for_ns.map_or(u64::MAX, |span| self.since_ns.saturating_add(span))
    }
}

#[cfg(test)]
mod tests {
    use super::{Device, FAULTS, Fault, Target, streams};
    use crate::{ServiceId, TopicId};

    #[test]
    fn every_fault_has_one_row_and_every_name_comes_back() {
        for row in FAULTS {
            assert_eq!(FAULTS.iter().filter(|other| other.fault == row.fault).count(), 1, "{}", row.name);
            assert_eq!(Fault::from_name(row.name), Some(row.fault));
        }
        assert_eq!(Fault::from_name("exit-on-start"), Some(Fault::ExitOnStart));
        assert_eq!(Fault::from_name("stuck"), Some(Fault::StuckBytes));
        assert_eq!(Fault::from_name("broken"), None);
    }

    #[test]
    fn every_target_comes_back_by_its_name_and_somebody_publishes_every_stream() {
        let streams = streams().map(|topic| Target::Stream(topic, ServiceId::None));
        let health = ServiceId::ALL.into_iter().map(|of| Target::Stream(TopicId::Health, of));
        let services = ServiceId::ALL.into_iter().map(Target::Service);
        let lines = Device::ALL.into_iter().map(Target::Line);
        for target in streams.chain(health).chain(services).chain(lines) {
            for fault in target.faults() {
                assert_eq!(Target::from_name(&target.to_string(), Some(*fault)), Some(target), "{target}");
            }
            assert!(!target.publishers().is_empty(), "{target}");
        }
        let odometry = Target::Service(ServiceId::Odometry);
        assert_eq!(Target::from_name("odometry", Some(Fault::Kill)), Some(odometry));
        assert_eq!(Target::from_name("world/truth", None), None);
    }
}
