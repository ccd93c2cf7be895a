//! What is said to a lidar, and what it answers once.

/// Begins every request, and the first byte of every answer.
pub(crate) const START: u8 = 0xa5;
/// The second byte of every answer.
const ANSWER: u8 = 0x5a;
/// Commands from here on have a payload, its length before and a checksum after it.
const WITH_PAYLOAD: u8 = 0x80;

/// A request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Ends a scan.
    Stop,
    /// Boots the lidar anew.
    Reset,
    /// Begins a standard scan.
    Scan,
    /// Begins a scan of that mode.
    ScanMode(u8),
    /// Asks for [`Info`].
    Info,
    /// Asks for [`Health`].
    Health,
    /// Asks for [`SampleRate`].
    SampleRate,
    /// Asks for a setting, of that mode where it has one of each.
    Conf(Conf, Option<u16>),
    /// Turns the motor, 0 to 1023; 0 stops it. Of the A2 and A3.
    MotorPwm(u16),
    /// Turns the motor, turns a minute; 0 stops it. Of the S series.
    MotorRpm(u16),
    /// Asks whether the motor obeys [`Request::MotorPwm`].
    MotorBoard,
}

/// What can be asked of a lidar's settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Conf {
    /// How many scan modes there are, `u16`.
    ModeCount = 0x70,
    /// From one sample to the next, microseconds in 1/256, `u32`.
    SampleTime = 0x71,
    /// The farthest that is seen, metres in 1/256, `u32`.
    RangeMax = 0x74,
    /// The answer type of the scan, `u8`.
    AnswerType = 0x75,
    /// The mode that the maker advises, `u16`.
    TypicalMode = 0x7c,
    /// The mode's name, text.
    Name = 0x7f,
    /// The motor's speed that the maker advises: turns a minute and PWM, `u16` each.
    MotorSpeed = 0x01,
    /// The network address of those that have one, six bytes.
    Mac = 0x79,
}

impl Conf {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::ModeCount,
        Self::SampleTime,
        Self::RangeMax,
        Self::AnswerType,
        Self::TypicalMode,
        Self::Name,
        Self::MotorSpeed,
        Self::Mac,
    ];

    fn of(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|conf| *conf as u32 == number)
    }
}

impl Request {
    /// The bytes on the wire.
    #[must_use]
    pub fn encode(self) -> Vec<u8> {
        let (command, payload) = self.parts();
        let mut bytes = vec![START, command];
        if command >= WITH_PAYLOAD {
            bytes.push(payload.len() as u8);
            bytes.extend(payload);
            bytes.push(bytes.iter().fold(0, |sum, byte| sum ^ byte));
        }
        bytes
    }

    fn parts(self) -> (u8, Vec<u8>) {
        match self {
            Self::Stop => (0x25, vec![]),
            Self::Reset => (0x40, vec![]),
            Self::Scan => (0x20, vec![]),
            Self::ScanMode(mode) => (0x82, vec![mode, 0, 0, 0, 0]),
            Self::Info => (0x50, vec![]),
            Self::Health => (0x52, vec![]),
            Self::SampleRate => (0x59, vec![]),
            Self::Conf(conf, mode) => {
                let mut payload = (conf as u32).to_le_bytes().to_vec();
                payload.extend(mode.into_iter().flat_map(u16::to_le_bytes));
                (0x84, payload)
            }
            Self::MotorPwm(pwm) => (0xf0, pwm.to_le_bytes().to_vec()),
            Self::MotorRpm(rpm) => (0xa8, rpm.to_le_bytes().to_vec()),
            Self::MotorBoard => (0xff, vec![0; 4]),
        }
    }

    fn of(command: u8, payload: &[u8]) -> Option<Self> {
        let word = |at: usize| Some(u16::from_le_bytes(payload.get(at..at + 2)?.try_into().ok()?));
        Some(match command {
            0x25 => Self::Stop,
            0x40 => Self::Reset,
            // Forced or not: begun where the lidar would wait for its motor.
            0x20 | 0x21 => Self::Scan,
            0x82 => Self::ScanMode(*payload.first()?),
            0x50 => Self::Info,
            0x52 => Self::Health,
            0x59 => Self::SampleRate,
            0x84 => {
                let conf = Conf::of(u32::from_le_bytes(payload.get(..4)?.try_into().ok()?))?;
                Self::Conf(conf, word(4))
            }
            0xf0 => Self::MotorPwm(word(0)?),
            0xa8 => Self::MotorRpm(word(0)?),
            0xff => Self::MotorBoard,
            _ => return None,
        })
    }
}

/// Reads requests: the lidar's side.
#[derive(Debug, Clone, Default)]
pub struct Requests {
    rest: Vec<u8>,
}

/// What came to a lidar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heard {
    /// A request that is known.
    Request(Request),
    /// A whole one that is not.
    Unknown(u8),
}

impl Requests {
    /// Takes bytes and gives what is whole.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Heard> {
        self.rest.extend_from_slice(bytes);
        let mut heard = Vec::new();
        loop {
            let start = self.rest.iter().position(|byte| *byte == START).unwrap_or(self.rest.len());
            self.rest.drain(..start);
            let Some(&command) = self.rest.get(1) else { return heard };
            if command < WITH_PAYLOAD {
                heard.push(Request::of(command, &[]).map_or(Heard::Unknown(command), Heard::Request));
                self.rest.drain(..2);
                continue;
            }
            let Some(&length) = self.rest.get(2) else { return heard };
            let whole = usize::from(length) + 4;
            let Some(request) = self.rest.get(..whole) else { return heard };
            if request.iter().fold(0, |sum, byte| sum ^ byte) == 0 {
                let known = Request::of(command, &request[3..whole - 1]);
                heard.push(known.map_or(Heard::Unknown(command), Heard::Request));
                self.rest.drain(..whole);
            } else {
                self.rest.drain(..1);
            }
        }
    }
}

/// What comes before an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Descriptor {
    /// Bytes of the answer, or of each of many.
    pub length: u32,
    /// Whether more follow until they are stopped.
    pub repeats: bool,
    /// What it is.
    pub answer_type: u8,
}

impl Descriptor {
    /// Its length on the wire.
    pub const LEN: usize = 7;

    /// The bytes on the wire.
    #[must_use]
    pub fn encode(self) -> [u8; Self::LEN] {
        let [a, b, c, d] = (self.length | u32::from(self.repeats) << 30).to_le_bytes();
        [START, ANSWER, a, b, c, d, self.answer_type]
    }

    /// The first one in such bytes, and where what follows it begins.
    #[must_use]
    pub fn find(bytes: &[u8]) -> Option<(Self, usize)> {
        let at = bytes.windows(Self::LEN).position(|window| window[..2] == [START, ANSWER])?;
        let found = &bytes[at..at + Self::LEN];
        let word = u32::from_le_bytes([found[2], found[3], found[4], found[5]]);
        let descriptor = Self { length: word & 0x3fff_ffff, repeats: word >> 30 == 1, answer_type: found[6] };
        Some((descriptor, at + Self::LEN))
    }
}

/// Types of answers that come once.
pub(crate) mod answer {
    pub(crate) const INFO: u8 = 0x04;
    pub(crate) const HEALTH: u8 = 0x06;
    pub(crate) const SAMPLE_RATE: u8 = 0x15;
    pub(crate) const CONF: u8 = 0x20;
    pub(crate) const MOTOR_BOARD: u8 = 0xff;
}

/// Who a lidar is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Info {
    /// High nibble: the series; low nibble: which of it.
    pub model: u8,
    /// Major and minor version, in one number.
    pub firmware: u16,
    /// Of the board.
    pub hardware: u8,
    /// Its serial number.
    pub serial: [u8; 16],
}

impl Info {
    /// Its length on the wire.
    pub const LEN: usize = 20;

    /// The bytes on the wire.
    #[must_use]
    pub fn encode(&self) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        bytes[0] = self.model;
        bytes[1..3].copy_from_slice(&self.firmware.to_le_bytes());
        bytes[3] = self.hardware;
        bytes[4..].copy_from_slice(&self.serial);
        bytes
    }

    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let [model, minor, major, hardware, serial @ ..] = bytes else { return None };
        let firmware = u16::from_le_bytes([*minor, *major]);
        Some(Self { model: *model, firmware, hardware: *hardware, serial: serial.try_into().ok()? })
    }

    /// The firmware's version, as its maker writes it.
    #[must_use]
    pub fn firmware_text(&self) -> String {
        format!("{}.{:02}", self.firmware >> 8, self.firmware & 0xff)
    }
}

/// How a lidar says that it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Health {
    /// 0 well, 1 a warning, 2 broken until it is reset.
    pub status: u8,
    /// The maker's number for why.
    pub code: u16,
}

impl Health {
    /// Well.
    pub const GOOD: u8 = 0;
    /// Broken until it is reset.
    pub const ERROR: u8 = 2;

    /// The bytes on the wire.
    #[must_use]
    pub fn encode(self) -> [u8; 3] {
        let [low, high] = self.code.to_le_bytes();
        [self.status, low, high]
    }

    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let [status, low, high] = bytes.try_into().ok()?;
        Some(Self { status, code: u16::from_le_bytes([low, high]) })
    }
}

/// How fast a lidar samples.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SampleRate {
    /// From one sample of a standard scan to the next, microseconds.
    pub standard_us: u16,
    /// Of an express scan.
    pub express_us: u16,
}

impl SampleRate {
    /// The bytes on the wire.
    #[must_use]
    pub fn encode(self) -> [u8; 4] {
        let ([a, b], [c, d]) = (self.standard_us.to_le_bytes(), self.express_us.to_le_bytes());
        [a, b, c, d]
    }

    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let [a, b, c, d] = bytes.try_into().ok()?;
        Some(Self { standard_us: u16::from_le_bytes([a, b]), express_us: u16::from_le_bytes([c, d]) })
    }
}

#[cfg(test)]
mod tests {
    use super::{Conf, Descriptor, Health, Heard, Info, Request, Requests, SampleRate};

    fn hex(text: &str) -> Vec<u8> {
        (0..text.len() / 2).map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).expect("hex")).collect()
    }

    /// As the maker's library sends them.
    fn spoken() -> Vec<(&'static str, Request)> {
        vec![
            ("a525", Request::Stop),
            ("a540", Request::Reset),
            ("a520", Request::Scan),
            ("a550", Request::Info),
            ("a552", Request::Health),
            ("a559", Request::SampleRate),
            ("a58205000000000022", Request::ScanMode(0)),
            ("a58205010000000023", Request::ScanMode(1)),
            ("a584047000000055", Request::Conf(Conf::ModeCount, None)),
            ("a584047c00000059", Request::Conf(Conf::TypicalMode, None)),
            ("a5840671000000010057", Request::Conf(Conf::SampleTime, Some(1))),
            ("a5840674000000010052", Request::Conf(Conf::RangeMax, Some(1))),
            ("a5840675000000010053", Request::Conf(Conf::AnswerType, Some(1))),
            ("a584067f000000010059", Request::Conf(Conf::Name, Some(1))),
            ("a584040100000024", Request::Conf(Conf::MotorSpeed, None)),
            ("a58404790000005c", Request::Conf(Conf::Mac, None)),
            ("a5f0029402c1", Request::MotorPwm(660)),
            ("a5a802580255", Request::MotorRpm(600)),
            ("a5ff04000000005e", Request::MotorBoard),
        ]
    }

    #[test]
    fn requests_are_those_of_the_makers_library() {
        for (text, request) in spoken() {
            assert_eq!(request.encode(), hex(text), "{request:?}");
        }
    }

    #[test]
    fn a_lidar_hears_them_in_pieces_and_through_noise() {
        let spoken = spoken();
        let mut bytes = Vec::new();
        for (text, _) in &spoken {
            bytes.extend([0x17, 0x00]);
            bytes.extend(hex(text));
        }
        for size in [1, 3, bytes.len()] {
            let mut requests = Requests::default();
            let heard: Vec<Heard> = bytes.chunks(size).flat_map(|piece| requests.push(piece)).collect();
            assert_eq!(heard, spoken.iter().map(|(_, request)| Heard::Request(*request)).collect::<Vec<_>>());
        }
        assert_eq!(Requests::default().push(&hex("a577a525")), [Heard::Unknown(0x77), Heard::Request(Request::Stop)]);
    }

    #[test]
    fn answers_are_there_and_back() {
        let descriptor = Descriptor { length: 4, repeats: false, answer_type: 0x15 };
        assert_eq!(descriptor.encode(), [0xa5, 0x5a, 4, 0, 0, 0, 0x15]);
        let scan = [0xa5, 0x5a, 0x84, 0, 0, 0x40, 0x84];
        let mut banner = b"RP LIDAR System.\r\n".to_vec();
        banner.extend(scan);
        let (found, after) = Descriptor::find(&banner).expect("a descriptor");
        assert_eq!((found, after), (Descriptor { length: 132, repeats: true, answer_type: 0x84 }, banner.len()));
        assert_eq!(found.encode(), scan);
        let info = Info { model: 0x18, firmware: 0x011d, hardware: 7, serial: [9; 16] };
        assert_eq!(Info::decode(&info.encode()), Some(info));
        assert_eq!(info.firmware_text(), "1.29");
        let health = Health { status: Health::ERROR, code: 0x8001 };
        assert_eq!(Health::decode(&health.encode()), Some(health));
        let rate = SampleRate { standard_us: 508, express_us: 254 };
        assert_eq!(SampleRate::decode(&rate.encode()), Some(rate));
        assert_eq!((Info::decode(&[1; 19]), Health::decode(&[1; 4]), SampleRate::decode(&[])), (None, None, None));
    }
}
