//! The conversation with a lidar, from the first byte to a running scan: who it is, how it is, its mode, its motor.
//!
//! Pure: who has the port hands in what came and when, and takes out what is to be done. What a running scan lacks for
//! [`SILENCE_NS`] begins the conversation anew; what does not come about after some tries ends the session, with the
//! reason.

use std::collections::VecDeque;

use messages::NS_PER_S;

use crate::request::answer;
use crate::{Conf, Counters, Decoder, Descriptor, Format, Health, Info, Request, Sample, SampleRate, Timing};

/// A lidar needs so long after a stop until it says nothing of the old scan any more, nanoseconds.
const STOP_NS: u64 = 100_000_000;
/// ... and so long after a reset until it answers.
const RESET_NS: u64 = 2 * NS_PER_S;
/// An answer comes within a few milliseconds, behind what was under way.
const ANSWER_NS: u64 = 500_000_000;
/// A scan begins when the motor turns fast enough.
const SPIN_UP_NS: u64 = 4 * NS_PER_S;
/// A running scan that gives no whole frame for so long has ended.
pub const SILENCE_NS: u64 = 500_000_000;
/// How often a question is asked.
const TRIES: u32 = 3;
/// How often a conversation is begun anew without a frame.
const RESTARTS: u32 = 3;
/// What comes before an answer and is none; more is the noise of a wrong line speed.
const REST_MAX: usize = 4096;
/// No lidar has more.
const MODES_MAX: u16 = 16;
/// From this firmware on a lidar can be asked for its modes; the newer series always can.
const CONF_FIRMWARE: u16 = 0x0118;
const CONF_SERIES: u8 = 4;
/// As the maker's library turns it where the lidar advises nothing.
const MOTOR_PWM: u16 = 660;

/// What is wanted of a lidar.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// Bits a second on the line.
    pub baud: u32,
    /// The scan mode by its maker's name, such as `Standard`, `Boost` or `DenseBoost`; the one that the maker advises
    /// where none is named.
    pub mode: Option<String>,
    /// Turns a minute, where the lidar's motor obeys such a wish.
    pub motor_rpm: u16,
    /// Whether the speed is only tried: who does not answer at once has another.
    pub searches: bool,
}

/// What is to be done with the port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Do {
    /// Send this.
    Write(Vec<u8>),
    /// Turn the motor of an A1 on or off: data terminal ready, cleared where it is to turn. A port without the line is
    /// no error.
    Motor(bool),
}

/// A lidar that scans.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Who it is.
    pub info: Info,
    /// The mode's name.
    pub mode: String,
    /// How its samples are packed.
    pub format: Format,
    /// From one sample to the next, nanoseconds.
    pub sample_ns: u64,
    /// The farthest that it sees in this mode, metres, where it says so.
    pub range_max_m: Option<f64>,
}

/// Why there is no scan.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SessionError {
    /// Not a byte came.
    #[error("nothing answers at {baud} baud: is the lidar powered, and is it this port?")]
    Silent {
        /// Bits a second.
        baud: u32,
    },
    /// Bytes came, and no answer was among them.
    #[error("what comes at {baud} baud is no answer of an RPLIDAR: wrong `baud`, or another device at this port")]
    Garbled {
        /// Bits a second.
        baud: u32,
    },
    /// It said that it is broken, after a reset too.
    #[error("the lidar says that it is broken, error {code:#06x}, after a reset too: is its motor blocked?")]
    Broken {
        /// The maker's number for why.
        code: u16,
    },
    /// It has no mode of that name.
    #[error("the lidar has no mode \"{wanted}\", only {}", known.join(", "))]
    NoMode {
        /// What was asked for.
        wanted: String,
        /// The names of its modes.
        known: Vec<String>,
    },
    /// Its samples are packed in a way that is not read here.
    #[error(
        "the lidar's mode \"{mode}\" packs samples as type {answer_type:#04x}, which is not read: name another `mode`"
    )]
    UnreadMode {
        /// The mode's name.
        mode: String,
        /// The answer type.
        answer_type: u8,
    },
    /// It answers, and does not scan.
    #[error("the lidar answers and does not scan: is its motor free to turn, and its power enough?")]
    NoScan,
}

/// Where a conversation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// What it still says of an old scan is not listened to.
    Stopping,
    Resetting,
    Info,
    Health,
    SampleRate,
    /// Which mode: the advised one, or how many there are.
    Modes,
    /// The name of a mode, to find the one that is wanted.
    Search(u16),
    /// What there is to know of the chosen mode.
    Mode(Conf),
    MotorBoard,
    Starting,
    Running,
}

/// A conversation.
#[derive(Debug, Clone)]
pub struct Session {
    wanted: Wanted,
    step: Step,
    /// When the step is given up, or over, nanoseconds.
    until_ns: u64,
    tries: u32,
    restarts: u32,
    was_reset: bool,
    heard_bytes: bool,
    rest: Vec<u8>,
    to_do: VecDeque<Do>,
    found: Found,
    /// From one sample of a standard scan to the next, nanoseconds.
    standard_ns: u64,
    /// The names of the modes before the one that is looked at.
    known: Vec<String>,
    mode_count: u16,
    /// The chosen one.
    mode: u16,
    decoder: Option<Decoder>,
    /// Of the scans before this one.
    counters: Counters,
    error: Option<SessionError>,
}

impl Session {
    /// Begins a conversation.
    #[must_use]
    pub fn new(wanted: Wanted, now_ns: u64) -> Self {
        let found = Found {
            info: Info::default(),
            mode: String::new(),
            format: Format::Standard,
            sample_ns: 0,
            range_max_m: None,
        };
        let mut session = Self {
            wanted,
            step: Step::Stopping,
            until_ns: now_ns,
            tries: 0,
            restarts: 0,
            was_reset: false,
            heard_bytes: false,
            rest: Vec::new(),
            to_do: VecDeque::new(),
            found,
            standard_ns: 0,
            known: Vec::new(),
            mode_count: 0,
            mode: 0,
            decoder: None,
            counters: Counters::default(),
            error: None,
        };
        session.enter(Step::Stopping, now_ns);
        session
    }

    /// What is to be done next with the port.
    pub fn next_to_do(&mut self) -> Option<Do> {
        self.to_do.pop_front()
    }

    /// When [`Session::tick`] has something to do, nanoseconds.
    #[must_use]
    pub fn next_timer_ns(&self) -> u64 {
        self.until_ns
    }

    /// Why there will be no scan; the session is over then.
    #[must_use]
    pub fn error(&self) -> Option<&SessionError> {
        self.error.as_ref()
    }

    /// The lidar, once it scans.
    #[must_use]
    pub fn running(&self) -> Option<&Found> {
        (self.step == Step::Running).then_some(&self.found)
    }

    /// What was met in all scans so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        let here = self.decoder.as_ref().map(Decoder::counters).unwrap_or_default();
        self.counters.and(here)
    }

    /// Says what ends a scan and stops the motor.
    #[must_use]
    pub fn farewell(&self) -> Vec<Do> {
        let motor = match motor_of(self.found.info.model) {
            Motor::Dtr => Do::Motor(false),
            Motor::Pwm => Do::Write(Request::MotorPwm(0).encode()),
            Motor::Rpm => Do::Write(Request::MotorRpm(0).encode()),
        };
        vec![Do::Write(Request::Stop.encode()), motor]
    }

    /// Takes what came until `now_ns`, and adds the samples that are in it.
    pub fn received(&mut self, now_ns: u64, bytes: &[u8], samples: &mut Vec<Sample>) {
        if self.error.is_some() || bytes.is_empty() {
            return;
        }
        if let (Step::Running, Some(decoder)) = (self.step, &mut self.decoder) {
            let before = decoder.counters().frames;
            decoder.push(bytes, now_ns, samples);
            if decoder.counters().frames > before {
                self.until_ns = now_ns + SILENCE_NS;
                self.restarts = 0;
            }
            return;
        }
        self.heard_bytes = true;
        if matches!(self.step, Step::Stopping | Step::Resetting) {
            return;
        }
        self.rest.extend_from_slice(bytes);
        while let Some((descriptor, after)) = Descriptor::find(&self.rest) {
            if !self.listen(descriptor, after, now_ns, samples) {
                break;
            }
        }
        let excess = self.rest.len().saturating_sub(REST_MAX);
        self.rest.drain(..excess);
    }

    /// Does what is due.
    pub fn tick(&mut self, now_ns: u64) {
        if self.error.is_some() || now_ns < self.until_ns {
            return;
        }
        match self.step {
            Step::Stopping => self.enter(Step::Info, now_ns),
            Step::Resetting => self.enter(Step::Stopping, now_ns),
            Step::Running => self.begin_anew(now_ns),
            _ if self.tries < self.tries_max() => self.ask(now_ns),
            // Whose motor says nothing of itself turns by itself.
            Step::MotorBoard => self.enter(Step::Starting, now_ns),
            // Old firmware that has no express scan has the standard one.
            Step::Starting if self.found.format != Format::Standard && !self.can_be_asked() => {
                (self.found.format, self.found.sample_ns) = (Format::Standard, self.standard_ns);
                self.found.mode = "Standard".to_owned();
                self.enter(Step::Starting, now_ns);
            }
            Step::Starting => self.begin_anew(now_ns),
            _ if !self.heard_bytes => self.error = Some(SessionError::Silent { baud: self.wanted.baud }),
            _ => self.error = Some(SessionError::Garbled { baud: self.wanted.baud }),
        }
    }

    fn tries_max(&self) -> u32 {
        if self.step == Step::Info && self.wanted.searches { 1 } else { TRIES }
    }

    fn begin_anew(&mut self, now_ns: u64) {
        self.counters = self.counters();
        self.decoder = None;
        self.restarts += 1;
        if self.restarts > RESTARTS {
            self.error = Some(SessionError::NoScan);
        } else {
            self.enter(Step::Stopping, now_ns);
        }
    }

    fn enter(&mut self, step: Step, now_ns: u64) {
        self.step = step;
        self.tries = 0;
        self.rest.clear();
        match step {
            Step::Stopping => {
                self.to_do.push_back(Do::Write(Request::Stop.encode()));
                self.until_ns = now_ns + STOP_NS;
            }
            Step::Resetting => {
                self.to_do.push_back(Do::Write(Request::Reset.encode()));
                self.until_ns = now_ns + RESET_NS;
            }
            Step::Running => self.until_ns = now_ns + SILENCE_NS,
            Step::Starting => {
                self.turn_motor();
                self.ask(now_ns);
            }
            _ => self.ask(now_ns),
        }
    }

    /// Asks what the step is about, once more.
    fn ask(&mut self, now_ns: u64) {
        self.tries += 1;
        let starting = self.step == Step::Starting;
        self.until_ns = now_ns + if starting { SPIN_UP_NS } else { ANSWER_NS };
        if let Some(request) = self.request() {
            self.to_do.push_back(Do::Write(request.encode()));
        }
    }

    fn request(&self) -> Option<Request> {
        Some(match self.step {
            Step::Stopping | Step::Resetting | Step::Running => return None,
            Step::Info => Request::Info,
            Step::Health => Request::Health,
            Step::SampleRate => Request::SampleRate,
            Step::Modes if self.wanted.mode.is_some() => Request::Conf(Conf::ModeCount, None),
            Step::Modes => Request::Conf(Conf::TypicalMode, None),
            Step::Search(mode) => Request::Conf(Conf::Name, Some(mode)),
            Step::Mode(conf) => Request::Conf(conf, Some(self.mode)),
            Step::MotorBoard => Request::MotorBoard,
            Step::Starting if self.found.format == Format::Standard => Request::Scan,
            Step::Starting => Request::ScanMode(self.mode as u8),
        })
    }

    fn turn_motor(&mut self) {
        self.to_do.push_back(match motor_of(self.found.info.model) {
            Motor::Dtr => Do::Motor(true),
            Motor::Pwm => Do::Write(Request::MotorPwm(MOTOR_PWM).encode()),
            Motor::Rpm => Do::Write(Request::MotorRpm(self.wanted.motor_rpm).encode()),
        });
    }

    /// Takes the answer that begins with that descriptor, if it is whole; says whether there may be another behind it.
    fn listen(&mut self, descriptor: Descriptor, after: usize, now_ns: u64, samples: &mut Vec<Sample>) -> bool {
        if self.step == Step::Starting && self.begins_scan(descriptor) {
            let rest = self.rest.split_off(after);
            let timing =
                Timing { sample_ns: self.found.sample_ns, byte_ns: 10 * NS_PER_S / u64::from(self.wanted.baud.max(1)) };
            self.decoder = Some(Decoder::new(self.found.format, timing));
            self.enter(Step::Running, now_ns);
            self.received(now_ns, &rest, samples);
            return false;
        }
        let expected = !descriptor.repeats && Some(descriptor.answer_type) == self.answer_type();
        if !expected || descriptor.length as usize > REST_MAX / 2 {
            // Bytes of something else, or an answer to what was asked before.
            self.rest.drain(..after - Descriptor::LEN + 1);
            return true;
        }
        let Some(payload) = self.rest.get(after..after + descriptor.length as usize) else { return false };
        let payload = payload.to_vec();
        self.rest.drain(..after + payload.len());
        // What is no answer to what was asked is asked again when its time is up.
        let _ = self.answered(&payload, now_ns);
        self.error.is_none()
    }

    fn begins_scan(&self, descriptor: Descriptor) -> bool {
        let format = self.found.format;
        descriptor.repeats
            && descriptor.answer_type == format.answer_type()
            && descriptor.length as usize == format.frame_bytes()
    }

    fn answer_type(&self) -> Option<u8> {
        Some(match self.step {
            Step::Info => answer::INFO,
            Step::Health => answer::HEALTH,
            Step::SampleRate => answer::SAMPLE_RATE,
            Step::Modes | Step::Search(_) | Step::Mode(_) => answer::CONF,
            Step::MotorBoard => answer::MOTOR_BOARD,
            _ => return None,
        })
    }

    /// Whether its modes can be asked for.
    fn can_be_asked(&self) -> bool {
        self.found.info.model >> 4 >= CONF_SERIES || self.found.info.firmware >= CONF_FIRMWARE
    }

    /// Goes on with what was answered; `None` where it is no answer to what was asked.
    fn answered(&mut self, payload: &[u8], now_ns: u64) -> Option<()> {
        match self.step {
            Step::Info => {
                self.found.info = Info::decode(payload)?;
                self.enter(Step::Health, now_ns);
            }
            Step::Health => self.judge(Health::decode(payload)?, now_ns),
            Step::SampleRate => {
                let rate = SampleRate::decode(payload)?;
                self.standard_ns = u64::from(rate.standard_us.max(1)) * 1000;
                let standard = self.wanted.mode.as_deref().is_some_and(|mode| mode.eq_ignore_ascii_case("standard"));
                let (mode, format, sample_ns) = match standard {
                    true => ("Standard", Format::Standard, self.standard_ns),
                    false => ("Express", Format::Express, u64::from(rate.express_us.max(1)) * 1000),
                };
                self.found = Found { mode: mode.to_owned(), format, sample_ns, ..self.found.clone() };
                self.enter(Step::Starting, now_ns);
            }
            Step::Modes | Step::Search(_) | Step::Mode(_) => {
                let (number, data) = payload.split_first_chunk::<4>()?;
                let Some(Request::Conf(asked, _)) = self.request() else { return None };
                (u32::from_le_bytes(*number) == asked as u32).then_some(())?;
                self.configured(data, now_ns)?;
            }
            Step::MotorBoard => self.enter(Step::Starting, now_ns),
            _ => return None,
        }
        Some(())
    }

    fn judge(&mut self, health: Health, now_ns: u64) {
        if health.status == Health::ERROR {
            if self.was_reset {
                self.error = Some(SessionError::Broken { code: health.code });
            } else {
                self.was_reset = true;
                self.enter(Step::Resetting, now_ns);
            }
        } else if self.can_be_asked() {
            self.known.clear();
            self.enter(Step::Modes, now_ns);
        } else {
            self.enter(Step::SampleRate, now_ns);
        }
    }

    /// Goes on with the answer to a question about settings.
    fn configured(&mut self, data: &[u8], now_ns: u64) -> Option<()> {
        let word = || Some(u32::from_le_bytes(data.get(..4)?.try_into().ok()?));
        let short = || Some(u16::from_le_bytes(data.get(..2)?.try_into().ok()?));
        match self.step {
            Step::Modes if self.wanted.mode.is_some() => {
                self.mode_count = short()?.min(MODES_MAX);
                self.search(0, now_ns);
            }
            Step::Modes => {
                self.mode = short()?;
                self.enter(Step::Mode(Conf::Name), now_ns);
            }
            Step::Search(mode) => {
                let name = text(data);
                if self.wanted.mode.as_ref().is_some_and(|wanted| wanted.eq_ignore_ascii_case(&name)) {
                    self.mode = mode;
                    self.enter(Step::Mode(Conf::Name), now_ns);
                } else {
                    self.known.push(name);
                    self.search(mode + 1, now_ns);
                }
            }
            Step::Mode(Conf::Name) => {
                self.found.mode = text(data);
                self.enter(Step::Mode(Conf::AnswerType), now_ns);
            }
            Step::Mode(Conf::AnswerType) => {
                let answer_type = *data.first()?;
                let Some(format) = Format::of_answer_type(answer_type) else {
                    self.error = Some(SessionError::UnreadMode { mode: self.found.mode.clone(), answer_type });
                    return Some(());
                };
                self.found.format = format;
                self.enter(Step::Mode(Conf::SampleTime), now_ns);
            }
            Step::Mode(Conf::SampleTime) => {
                self.found.sample_ns = (u64::from(word()?) * 1000 / 256).max(1);
                self.enter(Step::Mode(Conf::RangeMax), now_ns);
            }
            Step::Mode(_) => {
                self.found.range_max_m = Some(f64::from(word()?) / 256.0);
                let asks = motor_of(self.found.info.model) == Motor::Pwm;
                self.enter(if asks { Step::MotorBoard } else { Step::Starting }, now_ns);
            }
            _ => return None,
        }
        Some(())
    }

    fn search(&mut self, mode: u16, now_ns: u64) {
        if mode < self.mode_count {
            self.enter(Step::Search(mode), now_ns);
        } else {
            let wanted = self.wanted.mode.clone().unwrap_or_default();
            self.error = Some(SessionError::NoMode { wanted, known: std::mem::take(&mut self.known) });
        }
    }
}

/// How a lidar's motor is turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Motor {
    /// By the line data terminal ready: A1.
    Dtr,
    /// By its duty: A2, A3; the C1 turns by itself.
    Pwm,
    /// By its speed: the S series.
    Rpm,
}

pub(crate) fn motor_of(model: u8) -> Motor {
    match model >> 4 {
        0 | 1 => Motor::Dtr,
        2..=5 => Motor::Pwm,
        _ => Motor::Rpm,
    }
}

/// A name as the lidar tells it: text that ends with a zero.
fn text(data: &[u8]) -> String {
    let end = data.iter().position(|byte| *byte == 0).unwrap_or(data.len());
    String::from_utf8_lossy(&data[..end]).into_owned()
}
