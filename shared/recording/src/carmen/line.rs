//! What one line of a log says.

use std::f64::consts::PI;
use std::str::SplitAsciiWhitespace;

use messages::{Pose2, Twist2};

/// Fewer or more readings are no scan of a laser that sees 180 degrees.
const READINGS_MIN: usize = 30;
const READINGS_MAX: usize = 1441;

/// No robot's clock shows more: it is the year 2096. Less keeps run time within its 64 bits.
const TIME_S_MAX: f64 = 4e9;

/// No robot's odometry shows more.
const POSE_MAX: f64 = 1e7;

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LineError {
    /// A field is missing.
    #[error("{message} ends before its field {field}")]
    Missing {
        /// The message.
        message: &'static str,
        /// The field.
        field: &'static str,
    },
    /// A field is no number, or no finite one where it must be.
    #[error("{message} field {field} is {text:?}, which is no number that it can have")]
    Number {
        /// The message.
        message: &'static str,
        /// The field.
        field: &'static str,
        /// What stands there.
        text: String,
    },
    /// A count of readings that no scan has.
    #[error("FLASER announces {text:?} readings; a scan has {READINGS_MIN} to {READINGS_MAX}")]
    Count {
        /// The count.
        text: String,
    },
    /// More or fewer readings than announced.
    #[error("FLASER announces {announced} readings, and its fields leave {found}")]
    Readings {
        /// As announced.
        announced: usize,
        /// As found.
        found: i64,
    },
    /// More fields than the message has.
    #[error("{message} goes on after its last field")]
    Extra {
        /// The message.
        message: &'static str,
    },
    /// A line without an end.
    #[error("the line is over 1 MiB long")]
    TooLong,
}

/// The two times of a message, seconds, and who sent it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamps<'a> {
    pub ipc_s: f64,
    pub host: &'a str,
    pub logger_s: f64,
}

/// What a line says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Line<'a> {
    /// Nothing.
    Blank,
    /// A parameter; the time where there is one.
    Param { name: &'a str, value: &'a str, ipc_s: Option<f64> },
    /// Odometry, with the velocities that the robot reported.
    Odom { pose: Pose2, twist: Twist2, stamps: Stamps<'a> },
    /// A scan, whose readings are in the buffer, and the odometry at its time.
    Laser { pose: Pose2, stamps: Stamps<'a> },
    /// A message that is not imported.
    Known(&'a str),
    /// No message of CARMEN.
    Unknown(&'a str),
}

/// Parses a line; the readings of a scan go into `readings_m`, as they stand.
pub fn parse<'a>(line: &'a str, readings_m: &mut Vec<f32>) -> Result<Line<'a>, LineError> {
    let mut words = line.split_ascii_whitespace();
    let Some(word) = words.next() else {
        return Ok(Line::Blank);
    };
    match word {
        _ if word.starts_with('#') => Ok(Line::Blank),
        "PARAM" => Ok(param(words)),
        "ODOM" => odom(words),
        "FLASER" => laser(words, readings_m),
        _ if is_known(word) => Ok(Line::Known(word)),
        _ => Ok(Line::Unknown(word)),
    }
}

fn is_known(word: &str) -> bool {
    const WORDS: [&str; 12] = [
        "SYNC",
        "RLASER",
        "TRUEPOS",
        "LASER",
        "MARKER",
        "SONAR",
        "BUMPER",
        "GPS",
        "NMEAGGA",
        "NMEARMC",
        "IMU",
        "REMISSIONFLASER",
    ];
    // ROBOTLASER1, RAWLASER3, LASER4
    let numbered = word.trim_end_matches(|c: char| c.is_ascii_digit());
    WORDS.contains(&word) || ["ROBOTLASER", "RAWLASER", "LASER"].contains(&numbered)
}

fn param(mut words: SplitAsciiWhitespace<'_>) -> Line<'_> {
    let (name, value) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let ipc_s = words.next().and_then(|text| text.parse().ok());
    Line::Param { name, value, ipc_s }
}

fn odom(words: SplitAsciiWhitespace<'_>) -> Result<Line<'_>, LineError> {
    let mut fields = Fields { message: "ODOM", words };
    let pose = fields.pose(["x", "y", "theta"])?;
    let (vx_mps, wz_radps) = (fields.real("tv", POSE_MAX)?, fields.real("rv", POSE_MAX)?);
    fields.real("accel", f64::MAX)?;
    let stamps = fields.stamps()?;
    fields.end()?;
    Ok(Line::Odom { pose, twist: Twist2 { vx_mps, vy_mps: 0.0, wz_radps }, stamps })
}

fn laser<'a>(mut words: SplitAsciiWhitespace<'a>, readings_m: &mut Vec<f32>) -> Result<Line<'a>, LineError> {
    /// x y theta odom_x odom_y odom_theta ipc_time host logger_time
    const AFTER: i64 = 9;
    const MESSAGE: &str = "FLASER";
    let text = words.next().ok_or(LineError::Missing { message: MESSAGE, field: "num_readings" })?;
    let count = text.parse().ok().filter(|count| (READINGS_MIN..=READINGS_MAX).contains(count));
    let Some(announced) = count else {
        return Err(LineError::Count { text: text.chars().take(40).collect() });
    };
    // A wrong count is told as such, before a host's name is told to be no reading.
    let found = words.clone().count() as i64 - AFTER;
    if found != announced as i64 {
        return Err(LineError::Readings { announced, found });
    }
    readings_m.clear();
    for text in words.by_ref().take(announced) {
        readings_m.push(text.parse().map_err(|_| no_number(MESSAGE, "range", text))?);
    }
    let mut fields = Fields { message: MESSAGE, words };
    // The laser's own pose: the odometry's with the laser's offset, or one corrected later.
    fields.pose(["x", "y", "theta"])?;
    let pose = fields.pose(["odom_x", "odom_y", "odom_theta"])?;
    Ok(Line::Laser { pose, stamps: fields.stamps()? })
}

/// The fields of a message that are left to read.
struct Fields<'a> {
    message: &'static str,
    words: SplitAsciiWhitespace<'a>,
}

impl<'a> Fields<'a> {
    fn text(&mut self, field: &'static str) -> Result<&'a str, LineError> {
        self.words.next().ok_or(LineError::Missing { message: self.message, field })
    }

    fn real(&mut self, field: &'static str, most: f64) -> Result<f64, LineError> {
        let text = self.text(field)?;
        let number = text.parse().ok().filter(|number: &f64| number.abs() <= most);
        number.ok_or_else(|| no_number(self.message, field, text))
    }

    fn pose(&mut self, names: [&'static str; 3]) -> Result<Pose2, LineError> {
        let (x_m, y_m) = (self.real(names[0], POSE_MAX)?, self.real(names[1], POSE_MAX)?);
        Ok(Pose2::new(x_m, y_m, wrapped(self.real(names[2], POSE_MAX)?)))
    }

    fn stamps(&mut self) -> Result<Stamps<'a>, LineError> {
        let ipc_s = self.real("ipc_time", TIME_S_MAX)?;
        let host = self.text("host")?;
        Ok(Stamps { ipc_s, host, logger_s: self.real("logger_time", TIME_S_MAX)? })
    }

    fn end(&mut self) -> Result<(), LineError> {
        self.words.next().map_or(Ok(()), |_| Err(LineError::Extra { message: self.message }))
    }
}

fn no_number(message: &'static str, field: &'static str, text: &str) -> LineError {
    LineError::Number { message, field, text: text.chars().take(40).collect() }
}

/// An angle in (-pi, pi].
pub fn wrapped(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    PI - (PI - angle_rad).rem_euclid(2.0 * PI)
}

/// Angle of the first beam and from each to the next, radians, in a scan of `count` readings over 180 degrees.
pub fn geometry(count: usize) -> (f64, f64) {
    let steps = if count.is_multiple_of(2) { count } else { count - 1 };
    (-0.5 * PI, PI / steps.max(1) as f64)
}
