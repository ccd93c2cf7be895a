//! Recordings of a handler walking with the robot, as CSV.

use std::collections::BTreeMap;
use std::io::{Read, Write};

use guidance::Se2;
use guidance::se2::{exp, log, pose2, se2};
use messages::Pose2;
use serde::{Deserialize, Serialize};

/// Two samples of a recording lie at most this far apart, seconds.
const GAP_MAX_S: f64 = 0.25;
/// A recording shorter than this tells nothing, seconds.
const LENGTH_MIN_S: f64 = 1.0;
/// No place is farther away, metres.
const PLACE_MAX_M: f64 = 1e4;

/// One line of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Who.
    pub subject: String,
    /// Which of the robot's trajectories.
    pub trajectory: String,
    /// Which walk of it.
    pub repetition: u32,
    /// Seconds since the recording's beginning, or any other.
    pub t_s: f64,
    /// The robot, world frame.
    pub robot_x_m: f64,
    /// The robot, world frame.
    pub robot_y_m: f64,
    /// The robot, world frame.
    pub robot_yaw_rad: f64,
    /// The handler, world frame.
    pub human_x_m: f64,
    /// The handler, world frame.
    pub human_y_m: f64,
    /// The handler, world frame.
    pub human_yaw_rad: f64,
}

/// The columns of the file: the fields of [`Row`].
const COLUMNS: [&str; 10] = [
    "subject",
    "trajectory",
    "repetition",
    "t_s",
    "robot_x_m",
    "robot_y_m",
    "robot_yaw_rad",
    "human_x_m",
    "human_y_m",
    "human_yaw_rad",
];

/// A moment of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Seconds.
    pub t_s: f64,
    /// The robot.
    pub world_from_robot: Se2,
    /// The handler.
    pub world_from_handler: Se2,
}

/// One walk.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Who.
    pub subject: String,
    /// Which of the robot's trajectories.
    pub trajectory: String,
    /// Which walk of it.
    pub repetition: u32,
    /// In the order of time, at least two.
    pub samples: Vec<Sample>,
}

/// What is wrong with a file; its author is at fault.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// It is no CSV of these columns, or a cell is no number.
    #[error("{file}:{line}: {what}")]
    Line {
        /// The file.
        file: String,
        /// Line, from 1; the heading is the first.
        line: u64,
        /// What is wrong there.
        what: String,
    },
    /// There is nothing to fit.
    #[error("{file}: {what}")]
    File {
        /// The file.
        file: String,
        /// What is wrong.
        what: String,
    },
}

impl Recording {
    /// Robot and handler at equal steps from the first sample on, between two samples on the way from one to the other.
    #[must_use]
    pub fn steps(&self, dt_s: f64) -> Vec<(Se2, Se2)> {
        let (Some(first), Some(last)) = (self.samples.first(), self.samples.last()) else { return Vec::new() };
        let count = ((last.t_s - first.t_s) / dt_s + 1e-9).floor() as usize;
        (0..=count).map(|k| self.at(first.t_s + k as f64 * dt_s)).collect()
    }

    fn at(&self, t_s: f64) -> (Se2, Se2) {
        let next = self.samples.partition_point(|sample| sample.t_s <= t_s).clamp(1, self.samples.len() - 1);
        let (a, b) = (&self.samples[next - 1], &self.samples[next]);
        let share = ((t_s - a.t_s) / (b.t_s - a.t_s)).clamp(0.0, 1.0);
        let between = |a: &Se2, b: &Se2| a * exp(log(&(a.inverse() * b), 1.0), share);
        (between(&a.world_from_robot, &b.world_from_robot), between(&a.world_from_handler, &b.world_from_handler))
    }
}

/// Reads all recordings of a file. `file` names it in errors.
///
/// # Errors
/// Where a column is missing or unknown, a cell is no finite number, times are not rising, a gap is over 0.25 s, or
/// there is no recording of a second; with the line.
pub fn read(file: &str, input: impl Read) -> Result<Vec<Recording>, DataError> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(input);
    let mut walks: BTreeMap<(String, String, u32), Vec<(u64, Sample)>> = BTreeMap::new();
    let headers = reader.headers().map_err(|error| of_csv(file, &error))?.clone();
    check_heading(&headers).map_err(|what| DataError::Line { file: file.to_owned(), line: 1, what })?;
    for record in reader.records() {
        let record = record.map_err(|error| of_csv(file, &error))?;
        let line = record.position().map_or(1, csv::Position::line);
        let row: Row = record.deserialize(Some(&headers)).map_err(|error| of_csv(file, &error))?;
        let sample = sample(&row).map_err(|what| DataError::Line { file: file.to_owned(), line, what })?;
        walks.entry((row.subject, row.trajectory, row.repetition)).or_default().push((line, sample));
    }
    if walks.is_empty() {
        return Err(DataError::File { file: file.to_owned(), what: "no row after the heading".to_owned() });
    }
    walks.into_iter().map(|(key, samples)| recording(file, key, samples)).collect()
}

/// Whether the heading names every column, and each once.
fn check_heading(headers: &csv::StringRecord) -> Result<(), String> {
    for column in COLUMNS {
        match headers.iter().filter(|name| *name == column).count() {
            1 => {}
            0 => return Err(format!("the column {column} is missing")),
            _ => return Err(format!("the column {column} is there twice")),
        }
    }
    match headers.iter().find(|name| !COLUMNS.contains(name)) {
        Some(name) => Err(format!("unknown column {name}")),
        None => Ok(()),
    }
}

fn of_csv(file: &str, error: &csv::Error) -> DataError {
    let line = error.position().map_or(1, csv::Position::line);
    let what = match error.kind() {
        csv::ErrorKind::Deserialize { err, .. } => err.to_string(),
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells, where there are {expected_len} columns")
        }
        _ => error.to_string(),
    };
    DataError::Line { file: file.to_owned(), line, what }
}

fn sample(row: &Row) -> Result<Sample, String> {
    for (key, value) in [
        ("t_s", row.t_s),
        ("robot_x_m", row.robot_x_m),
        ("robot_y_m", row.robot_y_m),
        ("robot_yaw_rad", row.robot_yaw_rad),
        ("human_x_m", row.human_x_m),
        ("human_y_m", row.human_y_m),
        ("human_yaw_rad", row.human_yaw_rad),
    ] {
        if !value.is_finite() || (key != "t_s" && value.abs() > PLACE_MAX_M) {
            return Err(format!("{key}: {value} is not finite, or over {PLACE_MAX_M}"));
        }
    }
    Ok(Sample {
        t_s: row.t_s,
        world_from_robot: se2(Pose2::new(row.robot_x_m, row.robot_y_m, row.robot_yaw_rad)),
        world_from_handler: se2(Pose2::new(row.human_x_m, row.human_y_m, row.human_yaw_rad)),
    })
}

fn recording(
    file: &str,
    (subject, trajectory, repetition): (String, String, u32),
    samples: Vec<(u64, Sample)>,
) -> Result<Recording, DataError> {
    let name = format!("subject {subject}, trajectory {trajectory}, repetition {repetition}");
    let steps = || samples.windows(2).map(|pair| (pair[1].0, &pair[0].1, &pair[1].1));
    let refuse = |line, what: String| Err(DataError::Line { file: file.to_owned(), line, what });
    // Rows that are out of order look like gaps as well.
    if let Some((line, a, b)) = steps().find(|(_, a, b)| b.t_s <= a.t_s) {
        let how = if b.t_s == a.t_s { "stands twice".to_owned() } else { format!("comes after {}", a.t_s) };
        return refuse(line, format!("t_s: {} {how} in {name}", b.t_s));
    }
    if let Some((line, a, b)) = steps().find(|(_, a, b)| b.t_s - a.t_s > GAP_MAX_S) {
        let gap = b.t_s - a.t_s;
        return refuse(line, format!("t_s: a gap of {gap:.3} s in {name}, over {GAP_MAX_S} s"));
    }
    let length_s =
        samples.last().map_or(0.0, |(_, last)| last.t_s) - samples.first().map_or(0.0, |(_, first)| first.t_s);
    if length_s < LENGTH_MIN_S {
        let what = format!("{name} is {length_s:.2} s long, under {LENGTH_MIN_S} s");
        return Err(DataError::File { file: file.to_owned(), what });
    }
    let samples = samples.into_iter().map(|(_, sample)| sample).collect();
    Ok(Recording { subject, trajectory, repetition, samples })
}

/// Writes recordings as [`read`] reads them.
///
/// # Errors
/// Where the output cannot be written.
pub fn write(recordings: &[Recording], output: impl Write) -> Result<(), csv::Error> {
    let mut writer = csv::Writer::from_writer(output);
    for recording in recordings {
        for sample in &recording.samples {
            let (robot, human) = (pose2(&sample.world_from_robot), pose2(&sample.world_from_handler));
            let micro = |value: f64| (value * 1e6).round() / 1e6;
            writer.serialize(Row {
                subject: recording.subject.clone(),
                trajectory: recording.trajectory.clone(),
                repetition: recording.repetition,
                t_s: micro(sample.t_s),
                robot_x_m: micro(robot.x_m),
                robot_y_m: micro(robot.y_m),
                robot_yaw_rad: micro(robot.yaw_rad),
                human_x_m: micro(human.x_m),
                human_y_m: micro(human.y_m),
                human_yaw_rad: micro(human.yaw_rad),
            })?;
        }
    }
    writer.flush()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{read, write};

    const HEADING: &str =
        "subject,trajectory,repetition,t_s,robot_x_m,robot_y_m,robot_yaw_rad,human_x_m,human_y_m,human_yaw_rad\n";

    fn rows(times: &[f64]) -> String {
        times.iter().map(|t| format!("a,1,1,{t},{t},0,0,-0.7,0,0\n")).collect()
    }

    fn error(text: &str) -> String {
        read("d.csv", text.as_bytes()).expect_err("it is wrong").to_string()
    }

    #[test]
    fn what_is_written_is_read_again() {
        let text = format!("{HEADING}{}", rows(&[0.0, 0.2, 0.4, 0.6, 0.8, 1.0]));
        let recordings = read("d.csv", text.as_bytes()).expect("right");
        assert_eq!((recordings.len(), recordings[0].samples.len()), (1, 6));
        let mut again = Vec::new();
        write(&recordings, &mut again).expect("written");
        assert_eq!(read("d.csv", again.as_slice()).expect("right"), recordings);
        assert_eq!(recordings[0].steps(0.5).len(), 3);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let wrong = |times: &[f64]| error(&format!("{HEADING}{}", rows(times)));
        assert!(wrong(&[0.0, 0.1, 0.1]).starts_with("d.csv:4: t_s: 0.1 stands twice"));
        assert!(wrong(&[0.0, 0.2, 0.1]).starts_with("d.csv:4: t_s: 0.1 comes after 0.2"));
        assert!(wrong(&[0.0, 0.1, 0.9]).starts_with("d.csv:4: t_s: a gap of 0.800 s"));
        assert!(wrong(&[0.0, f64::NAN]).starts_with("d.csv:3: t_s: NaN is not finite"));
        assert!(wrong(&[0.0, 0.1]).contains("is 0.10 s long"));
        assert!(error(&format!("{HEADING}a,1,1,x,0,0,0,0,0,0\n")).starts_with("d.csv:2:"));
        assert!(error(&format!("{HEADING}a,1,1,0\n")).contains("4 cells"));
        assert!(wrong(&[0.0, 0.6, 0.3]).starts_with("d.csv:4: t_s: 0.3 comes after 0.6"), "not as a gap");
        assert!(error("subject,t_s\na,1\n").starts_with("d.csv:1: the column trajectory is missing"));
        assert!(error(&HEADING.replace("t_s", "subject")).starts_with("d.csv:1: the column subject is there twice"));
        assert!(error(&HEADING.replace('\n', ",mood\n")).starts_with("d.csv:1: unknown column mood"));
        assert!(error(HEADING).contains("no row"));
    }
}
