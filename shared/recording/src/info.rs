//! What a recording says about itself: MCAP's metadata record `guidedog`.

use std::collections::BTreeMap;
use std::str::FromStr;

use serde::Serialize;

/// The version of the format written. Those from version 1 on are read.
pub const FORMAT_VERSION: u32 = 2;

/// Version 1 knew scans and odometry only.
pub(crate) const OLDEST_VERSION: u32 = 1;

/// Name of the metadata record, written last.
pub(crate) const METADATA_NAME: &str = "guidedog";

/// Name of the metadata record that a live recording begins with: what is known by then.
pub(crate) const BEGUN_NAME: &str = "guidedog.begun";

/// Name of the metadata record with the settings of the run.
pub(crate) const SETTINGS_NAME: &str = "guidedog.settings";

/// The one entry of that record.
pub(crate) const SETTINGS_KEY: &str = "toml";

/// What a recording says about itself goes into reports, and over lines between processes.
const BYTES_MAX: usize = 3000;

const RECORDS: &str = "records.";
const ANOMALIES: &str = "anomalies.";
const LOST: &str = "run.lost.";

/// What whoever records has to say about the recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct About {
    /// File name of the log that it was imported from, or what else it was recorded from.
    pub source: String,
    /// Which robot.
    pub robot: String,
    /// Angle between the lidar's first and last beam, radians.
    pub field_of_view_rad: f64,
    /// Unix time of the first record, seconds, where it is known.
    pub first_wall_clock_s: Option<f64>,
    /// What was found wrong with the input, by kind.
    pub anomalies: BTreeMap<String, u64>,
    /// Of a live recording: the run.
    pub run: Option<RunAbout>,
}

/// What a live recording says about its run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunAbout {
    /// The run's name.
    pub name: String,
    /// Whether run time was stepped.
    pub stepped: bool,
    /// The seed of everything random in the world.
    pub seed: u64,
    /// Which life of the recorder wrote it.
    pub incarnation: u32,
    /// File name of the recording of depth frames beside this one.
    pub depth_file: Option<String>,
    /// Stepped time: the first step that was recorded.
    pub first_step: u64,
    /// Stepped time: the last step of the run; 0 where its end was not recorded.
    pub last_step: u64,
    /// How it ended; nothing while it goes on.
    pub ended: String,
    /// Messages that are missing, by topic: the recorder was too late for them, or its file could not take them.
    pub lost: BTreeMap<String, u64>,
}

impl RunAbout {
    /// Whether all of a stepped run was recorded, so that a replay can be equal to it byte for byte.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.stepped && self.first_step == 1 && self.last_step > 0 && self.lost.values().all(|n| *n == 0)
    }
}

/// What a finished recording says about itself.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Info {
    /// What whoever recorded it said.
    pub about: About,
    /// Records by topic name.
    pub records: BTreeMap<String, u64>,
    /// Run time of the first record, nanoseconds; 0 in an import.
    pub start_ns: u64,
    /// From the first record to the last, nanoseconds.
    pub duration_ns: u64,
}

impl Info {
    pub(crate) fn to_map(&self) -> BTreeMap<String, String> {
        let about = &self.about;
        let mut map = BTreeMap::from([
            ("format".to_owned(), FORMAT_VERSION.to_string()),
            ("source".to_owned(), about.source.clone()),
            ("robot".to_owned(), about.robot.clone()),
            ("field_of_view_rad".to_owned(), about.field_of_view_rad.to_string()),
            ("start_ns".to_owned(), self.start_ns.to_string()),
            ("duration_ns".to_owned(), self.duration_ns.to_string()),
        ]);
        if let Some(seconds) = about.first_wall_clock_s {
            map.insert("first_wall_clock_s".to_owned(), seconds.to_string());
        }
        map.extend(self.records.iter().map(|(topic, n)| (format!("{RECORDS}{topic}"), n.to_string())));
        map.extend(about.anomalies.iter().map(|(kind, n)| (format!("{ANOMALIES}{kind}"), n.to_string())));
        map.extend(about.run.iter().flat_map(RunAbout::entries));
        map
    }

    /// The error names the entry that is missing or wrong.
    pub(crate) fn from_map(map: &BTreeMap<String, String>) -> Result<Self, String> {
        check_size(map)?;
        let (start_ns, duration_ns) = (number::<u64>(map, "start_ns")?, number::<u64>(map, "duration_ns")?);
        if start_ns.checked_add(duration_ns).is_none() {
            return Err("metadata entries `start_ns` and `duration_ns` end after all time".to_owned());
        }
        Ok(Self {
            about: About {
                source: text(map, "source")?.to_owned(),
                robot: text(map, "robot")?.to_owned(),
                field_of_view_rad: number(map, "field_of_view_rad")?,
                first_wall_clock_s: match map.contains_key("first_wall_clock_s") {
                    true => Some(number(map, "first_wall_clock_s")?),
                    false => None,
                },
                anomalies: counts(map, ANOMALIES)?,
                run: if map.contains_key("run.name") { Some(RunAbout::from_map(map)?) } else { None },
            },
            records: counts(map, RECORDS)?,
            start_ns,
            duration_ns,
        })
    }
}

impl RunAbout {
    fn entries(&self) -> Vec<(String, String)> {
        let mut entries = vec![
            ("run.name".to_owned(), self.name.clone()),
            ("run.stepped".to_owned(), self.stepped.to_string()),
            ("run.seed".to_owned(), self.seed.to_string()),
            ("run.incarnation".to_owned(), self.incarnation.to_string()),
            ("run.first_step".to_owned(), self.first_step.to_string()),
            ("run.last_step".to_owned(), self.last_step.to_string()),
            ("run.ended".to_owned(), self.ended.clone()),
        ];
        entries.extend(self.depth_file.iter().map(|name| ("run.depth_file".to_owned(), name.clone())));
        entries.extend(self.lost.iter().map(|(topic, n)| (format!("{LOST}{topic}"), n.to_string())));
        entries
    }

    fn from_map(map: &BTreeMap<String, String>) -> Result<Self, String> {
        Ok(Self {
            name: text(map, "run.name")?.to_owned(),
            stepped: number(map, "run.stepped")?,
            seed: number(map, "run.seed")?,
            incarnation: number(map, "run.incarnation")?,
            depth_file: map.get("run.depth_file").cloned(),
            first_step: number(map, "run.first_step")?,
            last_step: number(map, "run.last_step")?,
            ended: text(map, "run.ended")?.to_owned(),
            lost: counts(map, LOST)?,
        })
    }
}

pub(crate) fn check_size(map: &BTreeMap<String, String>) -> Result<(), String> {
    // As it travels: control characters are six bytes each.
    let bytes = serde_json::to_string(map).map_or(usize::MAX, |json| json.len());
    if bytes <= BYTES_MAX { Ok(()) } else { Err(format!("the metadata has {bytes} bytes, over {BYTES_MAX}")) }
}

/// The format version that the metadata claims.
pub(crate) fn format_version(map: &BTreeMap<String, String>) -> Result<u32, String> {
    number(map, "format")
}

fn text<'a>(map: &'a BTreeMap<String, String>, key: &str) -> Result<&'a str, String> {
    map.get(key).map(String::as_str).ok_or_else(|| format!("metadata entry `{key}` is missing"))
}

fn number<T: FromStr>(map: &BTreeMap<String, String>, key: &str) -> Result<T, String> {
    let text = text(map, key)?;
    text.parse().map_err(|_| format!("metadata entry `{key}` is not what it should be: {text:?}"))
}

fn counts(map: &BTreeMap<String, String>, prefix: &str) -> Result<BTreeMap<String, u64>, String> {
    map.keys()
        .filter_map(|key| key.strip_prefix(prefix).map(|name| (key, name)))
        .map(|(key, name)| Ok((name.to_owned(), number(map, key)?)))
        .collect()
}
