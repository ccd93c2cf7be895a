//! The first pass over a log: checks every line, and gathers what only the whole log tells.

use std::collections::BTreeMap;
use std::path::Path;

use messages::{Pose2, Twist2};

use super::input::{Lines, Next};
use super::line::{Line, LineError, Stamps, parse};
use super::report::{Anomaly, Counts, ImportError};

/// A week at 16 messages a second; some 100 bytes each.
const ENTRIES_MAX: usize = 10_000_000;

/// At or over it no laser of the time saw anything: a SICK LMS says 81.83 or 81.91.
const RANGE_MAX_M: f32 = 81.0;

/// A lower ceiling is only believed when a parameter says so: it might be a wall.
const CEILING_MIN_M: f32 = 20.0;

/// One reading in so many equals the ceiling where there is one; aces has one in 119.
const CEILING_SHARE: u64 = 1000;

/// Words of a log of binary data must not use up the memory.
const WORDS_MAX: usize = 64;

/// What an ODOM or FLASER line says, but for the readings.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Whether it is a FLASER line.
    pub laser: bool,
    /// When it was sent, seconds.
    pub ipc_s: f64,
    /// When it was logged, seconds.
    pub logger_s: f64,
    /// The robot's odometry.
    pub pose: Pose2,
    /// The velocities that an ODOM line reports; zero for a scan.
    pub twist: Twist2,
}

/// What the whole log tells.
#[derive(Debug, Default)]
pub struct Survey {
    /// ODOM and FLASER lines in the order of the log.
    pub entries: Vec<Entry>,
    pub lines: u64,
    /// Readings of the first scan.
    pub beams: usize,
    /// How far forward the laser is, metres.
    pub laser_offset_m: f64,
    /// The host of the first scan.
    pub robot: String,
    pub first_wall_clock_s: Option<f64>,
    pub skipped: BTreeMap<String, u64>,
    pub counts: Counts,
    pub truncated_at_line: Option<u64>,
    last_beams: usize,
    laser_max_m: Option<f32>,
    readings: u64,
    ceiling_m: f32,
    at_ceiling: u64,
}

/// Surveys the log at `path`.
pub fn survey(path: &Path, allow_truncated: bool) -> Result<Survey, ImportError> {
    let mut lines = Lines::open(path)?;
    let mut survey = Survey::default();
    let mut readings_m = Vec::new();
    let mut begun = false;
    loop {
        let read = lines.count();
        let (number, text, whole) = match lines.advance()? {
            Next::Line { number, text, whole } => (number, text, whole),
            Next::End => break,
            Next::CutOff if allow_truncated => {
                survey.truncated_at_line = Some(read + 1);
                break;
            }
            Next::CutOff => return Err(ImportError::TruncatedStream { path: path.to_owned(), lines: read }),
        };
        let text = String::from_utf8_lossy(text);
        let line = parse(&text, &mut readings_m);
        if let (false, Ok(Line::Unknown(word))) = (begun, &line) {
            let word = word.chars().take(40).collect();
            return Err(ImportError::NotCarmen { path: path.to_owned(), line: number, word });
        }
        begun |= !matches!(line, Ok(Line::Blank));
        if !whole && matches!(line, Err(_) | Ok(Line::Unknown(_))) {
            if !allow_truncated {
                return Err(ImportError::TruncatedLine { path: path.to_owned(), line: number });
            }
            survey.truncated_at_line = Some(number);
            break;
        }
        let taken = line.and_then(|line| survey.take(line, &readings_m));
        taken.map_err(|error| ImportError::Line { path: path.to_owned(), line: number, error })?;
        if survey.entries.len() > ENTRIES_MAX {
            return Err(ImportError::TooLong { path: path.to_owned(), most: ENTRIES_MAX });
        }
    }
    survey.lines = lines.count();
    if survey.beams == 0 {
        return Err(ImportError::NoScan { path: path.to_owned(), lines: survey.lines, skipped: survey.skipped });
    }
    Ok(survey)
}

impl Survey {
    /// Readings at or over it hit nothing, metres.
    pub fn range_max_m(&self) -> f32 {
        let ceiling = self.ceiling_m >= CEILING_MIN_M && self.at_ceiling * CEILING_SHARE >= self.readings;
        let ceiling_m = if ceiling { self.ceiling_m } else { RANGE_MAX_M };
        RANGE_MAX_M.min(ceiling_m).min(self.laser_max_m.unwrap_or(RANGE_MAX_M))
    }

    fn take(&mut self, line: Line<'_>, readings_m: &[f32]) -> Result<(), LineError> {
        match line {
            Line::Blank => {}
            Line::Param { name, value, ipc_s } => self.take_param(name, value, ipc_s)?,
            Line::Odom { pose, twist, stamps } => self.take_entry(false, pose, twist, stamps),
            Line::Laser { pose, stamps } => {
                if self.beams == 0 {
                    self.robot = stamps.host.to_owned();
                }
                self.take_readings(readings_m);
                self.take_entry(true, pose, Twist2::ZERO, stamps);
            }
            Line::Known(word) => self.skip(word),
            Line::Unknown(word) => {
                self.counts.add(Anomaly::UnknownMessage, 1);
                self.skip(word);
            }
        }
        Ok(())
    }

    fn skip(&mut self, word: &str) {
        let word: String = word.chars().take(40).collect();
        let room = self.skipped.len() < WORDS_MAX || self.skipped.contains_key(&word);
        *self.skipped.entry(if room { word } else { "others".to_owned() }).or_default() += 1;
    }

    fn take_param(&mut self, name: &str, value: &str, ipc_s: Option<f64>) -> Result<(), LineError> {
        let number = |field: &'static str, least: f64, most: f64| {
            let number = value.parse().ok().filter(|number: &f64| (least..=most).contains(number));
            number.ok_or_else(|| LineError::Number { message: "PARAM", field, text: value.chars().take(40).collect() })
        };
        match name {
            // No robot in a corridor is larger; no laser sees less, and a lower number would make walls vanish.
            "robot_frontlaser_offset" => self.laser_offset_m = number("robot_frontlaser_offset", -3.0, 3.0)?,
            "robot_front_laser_max" => {
                self.laser_max_m = Some(number("robot_front_laser_max", 3.0, 1000.0)? as f32);
            }
            _ => {}
        }
        self.see_time(ipc_s);
        Ok(())
    }

    fn take_entry(&mut self, laser: bool, pose: Pose2, twist: Twist2, stamps: Stamps<'_>) {
        self.see_time(Some(stamps.ipc_s));
        self.see_time(Some(stamps.logger_s));
        self.entries.push(Entry { laser, ipc_s: stamps.ipc_s, logger_s: stamps.logger_s, pose, twist });
    }

    fn see_time(&mut self, seconds: Option<f64>) {
        /// Before it (1998) there were no such logs; a time since boot is less.
        const UNIX_S_MIN: f64 = 9e8;
        self.first_wall_clock_s = self.first_wall_clock_s.or(seconds.filter(|&seconds| seconds >= UNIX_S_MIN));
    }

    fn take_readings(&mut self, readings_m: &[f32]) {
        let count = readings_m.len();
        if self.beams == 0 {
            self.beams = count;
        } else if count != self.last_beams {
            self.counts.add(Anomaly::BeamCountChanged, 1);
        }
        self.last_beams = count;
        if ![180, 181, 360, 361].contains(&count) {
            self.counts.add(Anomaly::UnusualBeamCount, 1);
        }
        self.readings += count as u64;
        for &reading_m in readings_m {
            if reading_m.is_finite() && reading_m > self.ceiling_m {
                (self.ceiling_m, self.at_ceiling) = (reading_m, 0);
            }
            self.at_ceiling += u64::from(reading_m == self.ceiling_m);
        }
    }
}
