//! A lidar's side of the conversation: answers what it is asked and scans what is around it.
//!
//! Pure as the session: what came and when goes in, what is to be sent comes out.

use messages::NS_PER_S;
use serde::{Deserialize, Serialize};

use crate::request::answer;
use crate::{Conf, Descriptor, FirstOfFrame, Format, Health, Heard, Info, Request, Requests, Sample, SampleRate};
use crate::{angle_ahead_deg, session::Motor, session::motor_of};

/// What kind of lidar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// RPLIDAR A1M8.
    A1,
    /// RPLIDAR A1 with firmware that cannot be asked for its modes.
    A1Old,
    /// RPLIDAR A2M8.
    A2,
    /// RPLIDAR A3M1.
    A3,
    /// RPLIDAR S1.
    S1,
    /// RPLIDAR S2.
    S2,
    /// RPLIDAR S3.
    S3,
    /// RPLIDAR C1.
    C1,
}

/// A scan mode.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mode {
    name: &'static str,
    format: Format,
    sample_ns: u64,
    range_max_m: u32,
}

const fn mode(name: &'static str, format: Format, sample_ns: u64, range_max_m: u32) -> Mode {
    Mode { name, format, sample_ns, range_max_m }
}

impl Model {
    /// All of them.
    pub const ALL: [Self; 8] = [Self::A1, Self::A1Old, Self::A2, Self::A3, Self::S1, Self::S2, Self::S3, Self::C1];

    /// Its name on a command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::A1 => "a1",
            Self::A1Old => "a1-old",
            Self::A2 => "a2",
            Self::A3 => "a3",
            Self::S1 => "s1",
            Self::S2 => "s2",
            Self::S3 => "s3",
            Self::C1 => "c1",
        }
    }

    /// Bits a second on its line.
    #[must_use]
    pub fn baud(self) -> u32 {
        match self {
            Self::A1 | Self::A1Old | Self::A2 => 115_200,
            Self::A3 | Self::S1 => 256_000,
            Self::C1 => 460_800,
            Self::S2 | Self::S3 => 1_000_000,
        }
    }

    /// Turns a second, where the motor is not told otherwise.
    fn turns_per_s(self) -> f64 {
        match self {
            Self::A1 | Self::A1Old => 8.0,
            _ => 10.0,
        }
    }

    fn info(self) -> Info {
        let (model, firmware) = match self {
            Self::A1 => (0x18, 0x011d),
            Self::A1Old => (0x18, 0x0110),
            Self::A2 => (0x28, 0x011d),
            Self::A3 => (0x31, 0x011d),
            Self::S1 => (0x61, 0x0100),
            Self::S2 => (0x71, 0x0101),
            Self::S3 => (0x81, 0x0102),
            Self::C1 => (0x41, 0x0101),
        };
        Info { model, firmware, hardware: 7, serial: *b"emulated by gdog" }
    }

    /// The modes, and which of them is advised.
    fn modes(self) -> (&'static [Mode], usize) {
        const A: &[Mode] = &[
            mode("Standard", Format::Standard, 508_000, 12),
            mode("Express", Format::Express, 254_000, 12),
            mode("Boost", Format::Ultra, 127_000, 12),
            mode("Sensitivity", Format::Ultra, 127_000, 12),
        ];
        const A3: &[Mode] =
            &[mode("Standard", Format::Standard, 250_000, 16), mode("Sensitivity", Format::Ultra, 62_500, 25)];
        const S1: &[Mode] =
            &[mode("Standard", Format::Standard, 217_000, 40), mode("DenseBoost", Format::Dense, 108_700, 40)];
        const S2: &[Mode] =
            &[mode("Standard", Format::Standard, 62_500, 30), mode("DenseBoost", Format::Dense, 31_250, 30)];
        const S3: &[Mode] =
            &[mode("Standard", Format::Standard, 62_500, 40), mode("UltraDense", Format::UltraDense, 31_250, 40)];
        const C1: &[Mode] =
            &[mode("Standard", Format::Standard, 200_000, 12), mode("DenseBoost", Format::Dense, 200_000, 12)];
        match self {
            Self::A1 | Self::A1Old | Self::A2 => (A, 3),
            Self::A3 => (A3, 1),
            Self::S1 => (S1, 1),
            Self::S2 => (S2, 1),
            Self::S3 => (S3, 1),
            Self::C1 => (C1, 0),
        }
    }

    fn can_be_asked(self) -> bool {
        self != Self::A1Old
    }
}

/// A scan that runs.
#[derive(Debug, Clone, Copy)]
struct Scan {
    mode: Mode,
    begun_ns: u64,
    /// The next frame.
    frame: u64,
}

/// An emulated lidar.
#[derive(Debug, Clone)]
pub struct Emulated {
    model: Model,
    requests: Requests,
    health: Health,
    turns_per_s: f64,
    scan: Option<Scan>,
}

impl Emulated {
    /// A lidar that stands.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let turns_per_s = model.turns_per_s();
        Self { model, requests: Requests::default(), health: Health::default(), turns_per_s, scan: None }
    }

    /// From now on it says that it is so, until it is reset.
    pub fn set_health(&mut self, health: Health) {
        self.health = health;
    }

    /// Whether a scan runs.
    #[must_use]
    pub fn scans(&self) -> bool {
        self.scan.is_some()
    }

    /// Takes what came and adds what is answered.
    pub fn received(&mut self, now_ns: u64, bytes: &[u8], out: &mut Vec<u8>) {
        for heard in self.requests.push(bytes) {
            if let Heard::Request(request) = heard {
                self.answer(request, now_ns, out);
            }
        }
    }

    fn answer(&mut self, request: Request, now_ns: u64, out: &mut Vec<u8>) {
        let (modes, _) = self.model.modes();
        match request {
            Request::Stop => self.scan = None,
            Request::Reset => {
                self.scan = None;
                self.health = Health::default();
                out.extend(b"RP LIDAR System.\r\nFirmware Ver emulated\r\n");
            }
            Request::Scan => self.begin(modes[0], now_ns, out),
            Request::ScanMode(number) => {
                // Mode 0 of who cannot be asked is express.
                let number = if self.model.can_be_asked() { usize::from(number) } else { 1 };
                if let Some(mode) = modes.get(number) {
                    self.begin(*mode, now_ns, out);
                }
            }
            Request::Info => once(answer::INFO, &self.model.info().encode(), out),
            Request::Health => once(answer::HEALTH, &self.health.encode(), out),
            Request::SampleRate => {
                let us = |mode: Mode| (mode.sample_ns / 1000) as u16;
                let rate = SampleRate { standard_us: us(modes[0]), express_us: us(modes[1]) };
                once(answer::SAMPLE_RATE, &rate.encode(), out);
            }
            Request::Conf(conf, mode) if self.model.can_be_asked() => {
                if let Some(data) = self.configured(conf, usize::from(mode.unwrap_or_default())) {
                    once(answer::CONF, &[&(conf as u32).to_le_bytes()[..], &data].concat(), out);
                }
            }
            Request::Conf(..) => {}
            Request::MotorPwm(pwm) => self.turn(f64::from(pwm) / 660.0 * self.model.turns_per_s()),
            Request::MotorRpm(rpm) => self.turn(f64::from(rpm) / 60.0),
            Request::MotorBoard => {
                let obeys = u32::from(motor_of(self.model.info().model) == Motor::Pwm && self.model != Model::C1);
                once(answer::MOTOR_BOARD, &obeys.to_le_bytes(), out);
            }
        }
    }

    fn configured(&self, conf: Conf, number: usize) -> Option<Vec<u8>> {
        let (modes, advised) = self.model.modes();
        let mode = modes.get(number)?;
        Some(match conf {
            Conf::ModeCount => (modes.len() as u16).to_le_bytes().to_vec(),
            Conf::TypicalMode => (advised as u16).to_le_bytes().to_vec(),
            Conf::SampleTime => ((mode.sample_ns * 256 / 1000) as u32).to_le_bytes().to_vec(),
            Conf::RangeMax => (mode.range_max_m * 256).to_le_bytes().to_vec(),
            Conf::AnswerType => vec![mode.format.answer_type()],
            Conf::Name => [mode.name.as_bytes(), &[0]].concat(),
            Conf::MotorSpeed => [600_u16.to_le_bytes(), 660_u16.to_le_bytes()].concat(),
            Conf::Mac => vec![2, 0, 0, 0, 0, 1],
        })
    }

    fn turn(&mut self, turns_per_s: f64) {
        self.turns_per_s = turns_per_s.min(20.0);
        if self.turns_per_s == 0.0 {
            self.scan = None;
        }
    }

    fn begin(&mut self, mode: Mode, now_ns: u64, out: &mut Vec<u8>) {
        if self.turns_per_s == 0.0 {
            self.turns_per_s = self.model.turns_per_s();
        }
        let length = mode.format.frame_bytes() as u32;
        out.extend(Descriptor { length, repeats: true, answer_type: mode.format.answer_type() }.encode());
        self.scan = Some(Scan { mode, begun_ns: now_ns, frame: 0 });
    }

    /// When the next frame is whole, nanoseconds.
    #[must_use]
    pub fn next_frame_ns(&self) -> Option<u64> {
        self.scan.map(|scan| scan.time_ns(scan.mode.format.frame_samples() as u64))
    }

    /// Adds the frames that are whole by now. `measure` gives the range at a clockwise angle in degrees at a time,
    /// metres; none where nothing comes back.
    pub fn advance(&mut self, now_ns: u64, mut measure: impl FnMut(f64, u64) -> Option<f32>, out: &mut Vec<u8>) {
        let turns_per_s = self.turns_per_s;
        let Some(scan) = &mut self.scan else { return };
        let count = scan.mode.format.frame_samples() as u64;
        while scan.time_ns(count) <= now_ns {
            let samples: Vec<Sample> = (0..=count).map(|i| scan.sample(i, turns_per_s, &mut measure)).collect();
            let first = FirstOfFrame {
                angle_deg: samples[0].angle_deg,
                restarted: scan.frame == 0,
                lidar_us: (scan.time_ns(0) / 1000) as u32,
            };
            let (samples, next) = samples.split_at(count as usize);
            scan.mode.format.encode(first, samples, &next[0], out);
            scan.frame += 1;
        }
    }
}

impl Scan {
    /// When that sample of the next frame is measured, nanoseconds.
    fn time_ns(&self, sample: u64) -> u64 {
        let count = self.mode.format.frame_samples() as u64;
        self.begun_ns + (self.frame * count + sample) * self.mode.sample_ns
    }

    fn sample(&self, i: u64, turns_per_s: f64, measure: &mut impl FnMut(f64, u64) -> Option<f32>) -> Sample {
        let stamp_ns = self.time_ns(i);
        let turned = |at_ns: u64| (at_ns - self.begun_ns) as f64 / NS_PER_S as f64 * turns_per_s;
        let turns = turned(stamp_ns);
        let starts_turn =
            turned(stamp_ns.saturating_sub(self.mode.sample_ns).max(self.begun_ns)).floor() < turns.floor();
        let angle_deg = turns.fract() * 360.0;
        let mut at =
            |angle_deg: f64| measure(angle_deg, stamp_ns).filter(|range_m| *range_m < self.mode.range_max_m as f32);
        let range_m = match self.mode.format {
            // Its raw angle is ahead of where it measures, the more the farther.
            Format::Ultra => {
                let near_m = at(angle_deg - angle_ahead_deg(Some(2.0)));
                at(angle_deg - angle_ahead_deg(near_m))
            }
            _ => at(angle_deg),
        };
        Sample { starts_turn, angle_deg, range_m, quality: 47, stamp_ns }
    }
}

fn once(answer_type: u8, payload: &[u8], out: &mut Vec<u8>) {
    out.extend(Descriptor { length: payload.len() as u32, repeats: false, answer_type }.encode());
    out.extend(payload);
}
