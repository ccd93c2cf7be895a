//! SocNavBench (Biswas et al. 2022): a robot among recorded pedestrians, from its original files
//! (`CMU-TBD/SocNavBench`): `episode_params_val.ini`, `dataset_params.ini` and the tracks.
//!
//! Its maps are meshes and pickles of a simulator, which are not read: nothing but people is in the way.

pub mod metrics;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use configparser::ini::Ini;
use guidance::se2::{Point, Se2};
use nalgebra::Vector2;
use serde_json::Value;
use world::{Tracks, World};

use crate::walk::{self, Passage};
use crate::{Crowd, Recorded, YardstickError, file};

/// Radius of a pedestrian, metres (`agent_params`, `radius`).
pub const PEDESTRIAN_M: f64 = 0.2;
/// A robot that is so near to the goal is there, metres (`agent_params`, `goal_margin`).
const GOAL_M: f64 = 0.3;
/// No ceiling is lower out of doors, metres.
const OPEN_M: f64 = 10.0;
/// No place is farther from the origin, metres; no episode begins later, seconds; no dataset has more pedestrians.
const PLACE_MAX_M: f64 = 1e4;
const TIME_MAX_S: f64 = 36_000.0;
const PEDESTRIANS_MAX: i64 = 1_000_000_000;

/// The keys of a file by section: text as it stands there.
type Sections = Vec<(String, BTreeMap<String, String>)>;

/// Pedestrians of a dataset who take part in an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Name of the dataset.
    pub dataset: String,
    /// When its first pedestrian appears, seconds (`datasets_start_t`).
    pub start_s: f64,
    /// From this pedestrian on, up to that one; -1: to the last (`ped_ranges`).
    pub range: [i64; 2],
}

/// An episode as its file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Its name, with which its section begins.
    pub name: String,
    /// The place.
    pub map: String,
    /// Who walks there.
    pub parts: Vec<Part>,
    /// The robot's start and goal: x, y, yaw, metres and radians.
    pub robot: [[f64; 3]; 2],
    /// Time that it has, seconds.
    pub time_max_s: f64,
    /// People who are to be simulated, and are not recorded.
    pub simulated: usize,
}

/// How the tracks of a dataset are to be read (`dataset_params.ini`).
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// The file's path in SocNavBench.
    pub file: String,
    /// Frames of a second.
    pub fps: f64,
    /// Added to all times, seconds.
    pub delay_s: f64,
    /// Where the tracks' origin is in the map.
    pub map_from_tracks: Se2,
    /// The tracks' y is the map's x.
    pub swaps: bool,
    /// The sign of x and of y.
    pub signs: [f64; 2],
}

/// The episodes of a file, in its order.
///
/// # Errors
/// Where it cannot be read, or a key is missing or wrong. The error names file, section and key.
pub fn episodes(path: &Path) -> Result<Vec<Episode>, YardstickError> {
    let name = path.display().to_string();
    let of = |(section, keys): (String, BTreeMap<String, String>)| {
        let keys = Keys { file: &name, section: &section, keys: &keys };
        keys.episode()
    };
    let all = sections(&name, &file::text(path)?)?;
    let episodes = all.into_iter().filter(|(section, _)| section != "episodes_params").map(of);
    let episodes = episodes.collect::<Result<Vec<_>, _>>()?;
    if episodes.is_empty() {
        return Err(YardstickError::content(&name, "no episode in it"));
    }
    Ok(episodes)
}

/// The datasets of a file by name.
///
/// # Errors
/// As [`episodes()`].
pub fn datasets(path: &Path) -> Result<BTreeMap<String, Dataset>, YardstickError> {
    let name = path.display().to_string();
    let of = |(section, keys): (String, BTreeMap<String, String>)| {
        let dataset = Keys { file: &name, section: &section, keys: &keys }.dataset()?;
        Ok((section, dataset))
    };
    let all = sections(&name, &file::text(path)?)?;
    all.into_iter().filter(|(section, _)| section != "dataset_params").map(of).collect()
}

/// The file of a dataset's tracks in a folder: by the dataset's folder in SocNavBench (`eth/...csv` is `eth.csv`),
/// packed or not, or as it lies there.
#[must_use]
pub fn tracks_file(folder: &Path, dataset: &Dataset) -> Option<PathBuf> {
    let short = dataset.file.split('/').next().unwrap_or_default();
    let names = [format!("{short}.csv"), format!("{short}.csv.xz"), dataset.file.clone()];
    names.iter().map(|name| folder.join(name)).find(|path| path.is_file())
}

/// The tracks of a file.
///
/// # Errors
/// Where it cannot be read or used.
pub fn tracks(path: &Path) -> Result<Tracks, YardstickError> {
    Ok(Tracks::parse(&path.display().to_string(), &file::text(path)?)?)
}

impl Episode {
    /// From start to goal among recorded people; `tracks` has those of each dataset that takes part.
    ///
    /// # Errors
    /// The first dataset that is not there.
    pub fn passage(
        &self,
        datasets: &BTreeMap<String, Dataset>,
        tracks: &BTreeMap<String, Tracks>,
    ) -> Result<Passage, String> {
        let mut people = Vec::new();
        for part in &self.parts {
            let dataset = datasets.get(&part.dataset).ok_or_else(|| format!("no dataset {}", part.dataset))?;
            let tracks = tracks.get(&part.dataset).ok_or_else(|| format!("no tracks of {}", part.dataset))?;
            people.extend(recorded(part, dataset, tracks, self.time_max_s));
        }
        let [[x_m, y_m, yaw_rad], [goal_x_m, goal_y_m, _]] = self.robot;
        Ok(Passage {
            world: World::new(OPEN_M, Vec::new()),
            crowd: Crowd { people, radius_m: PEDESTRIAN_M },
            world_from_start: walk::start(x_m, y_m, yaw_rad),
            goal: Point::new(goal_x_m, goal_y_m),
            goal_m: GOAL_M,
            begins_m: 0.0,
            time_max_s: self.time_max_s,
            is_localised: true,
        })
    }
}

/// The people of a part (`PrerecordedHuman.generate`): the frame of the first of them is its start.
fn recorded(part: &Part, dataset: &Dataset, tracks: &Tracks, time_max_s: f64) -> Vec<Recorded> {
    let [from, to] = part.range;
    let most = tracks.pedestrians().map(|(number, _)| number).max().unwrap_or(0);
    let last = from + if to == -1 { most - 1 } else { (to - from).min(most) };
    let begins = tracks.of(from + 1).and_then(|track| track.first());
    let Some(first_frame) = begins.or_else(|| tracks.pedestrians().find_map(|(_, track)| track.first())) else {
        return Vec::new();
    };
    let mut people = Vec::new();
    for (number, track) in tracks.pedestrians().filter(|(number, _)| (from + 1..=last).contains(number)) {
        let time_s = |frame: i64| (frame - first_frame.frame) as f64 / dataset.fps;
        let Some(first) = track.first() else { continue };
        if time_s(first.frame) > time_max_s {
            break;
        }
        let place = |sighting: &world::tracks::Sighting| dataset.in_map(sighting.x_m, sighting.y_m);
        let later_s = dataset.delay_s + part.start_s;
        let mut places: Vec<(f64, Point)> =
            track.iter().map(|sighting| (time_s(sighting.frame) + later_s, place(sighting))).collect();
        // They stand where they appear until they set out.
        if part.start_s > 0.0 {
            places.insert(0, (time_s(first.frame) + dataset.delay_s, place(first)));
        }
        people.push(Recorded { name: format!("{} {number}", part.dataset), places });
    }
    people
}

impl Dataset {
    /// A place of the tracks in the map (`gather_posn_data`).
    fn in_map(&self, x_m: f64, y_m: f64) -> Point {
        let (x_m, y_m) = (self.signs[0] * x_m, self.signs[1] * y_m);
        self.map_from_tracks * if self.swaps { Point::new(y_m, x_m) } else { Point::new(x_m, y_m) }
    }
}

/// Sections of an INI file in order, comments taken off.
fn sections(name: &str, text: &str) -> Result<Sections, YardstickError> {
    let mut ini = Ini::new_cs();
    let read = ini.read(text.to_owned()).map_err(|error| YardstickError::content(name, error))?;
    let mut order: Vec<String> = Vec::new();
    for line in text.lines().map(str::trim).filter(|line| line.starts_with('[')) {
        let section = line[1..].split(']').next().unwrap_or_default().trim().to_owned();
        if order.contains(&section) {
            return Err(YardstickError::content(name, format!("section [{section}] stands twice")));
        }
        order.push(section);
    }
    let keys = |section: &String| {
        let keys = read.get(section).into_iter().flatten();
        keys.filter_map(|(key, value)| Some((key.clone(), value.clone()?))).collect()
    };
    Ok(order.into_iter().map(|section| (section.clone(), keys(&section))).collect())
}

/// The keys of a section.
struct Keys<'a> {
    file: &'a str,
    section: &'a str,
    keys: &'a BTreeMap<String, String>,
}

impl Keys<'_> {
    fn refuse(&self, key: &str, what: &str) -> YardstickError {
        YardstickError::content(self.file, format!("[{}] {key}: {what}", self.section))
    }

    fn text(&self, key: &str) -> Result<&str, YardstickError> {
        self.keys.get(key).map(String::as_str).ok_or_else(|| self.refuse(key, "the key is missing"))
    }

    /// A literal of Python: numbers, texts, lists and tuples.
    fn value<T: serde::de::DeserializeOwned>(&self, key: &str) -> Result<T, YardstickError> {
        let text = self.text(key)?.replace(['('], "[").replace([')'], "]").replace('\'', "\"");
        let value: Value = serde_json::from_str(&text).map_err(|_| self.refuse(key, "no list of Python"))?;
        serde_json::from_value(value).map_err(|error| self.refuse(key, &error.to_string()))
    }

    fn number(&self, key: &str, within: [f64; 2]) -> Result<f64, YardstickError> {
        let number = self.text(key)?.parse::<f64>().ok().filter(|number| (within[0]..=within[1]).contains(number));
        number.ok_or_else(|| self.refuse(key, &format!("no number from {} to {}", within[0], within[1])))
    }

    fn flag(&self, key: &str) -> Result<bool, YardstickError> {
        match self.text(key)? {
            "True" => Ok(true),
            "False" => Ok(false),
            _ => Err(self.refuse(key, "neither True nor False")),
        }
    }

    fn episode(&self) -> Result<Episode, YardstickError> {
        let names: Vec<String> = self.value("pedestrian_datasets")?;
        let starts: Vec<f64> = self.value("datasets_start_t")?;
        let ranges: Vec<[i64; 2]> = self.value("ped_ranges")?;
        if names.len() != starts.len() || names.len() != ranges.len() {
            return Err(self.refuse("pedestrian_datasets", "as many start times and ranges are wanted"));
        }
        if starts.iter().any(|start_s| !(0.0..=TIME_MAX_S).contains(start_s)) {
            return Err(self.refuse("datasets_start_t", &format!("a time is not from 0 to {TIME_MAX_S}")));
        }
        let is_range = |[from, to]: &[i64; 2]| {
            (0..=PEDESTRIANS_MAX).contains(from) && (*to == -1 || (*from..=PEDESTRIANS_MAX).contains(to))
        };
        if !ranges.iter().all(is_range) {
            return Err(self.refuse("ped_ranges", "pairs from 0 on are wanted, or -1 for the last"));
        }
        if !self.section.chars().all(|c| c.is_alphanumeric() || "_-".contains(c)) {
            let what = format!("[{}]: letters, digits, _ and - are wanted: pictures have this name", self.section);
            return Err(YardstickError::content(self.file, what));
        }
        let parts = names.into_iter().zip(starts).zip(ranges);
        let simulated: Vec<Value> = self.value("agents_start")?;
        Ok(Episode {
            name: self.section.to_owned(),
            map: self.text("map_name")?.to_owned(),
            parts: parts.map(|((dataset, start_s), range)| Part { dataset, start_s, range }).collect(),
            robot: self.start_and_goal()?,
            time_max_s: self.number("max_time", [0.1, TIME_MAX_S])?,
            simulated: simulated.len(),
        })
    }

    fn start_and_goal(&self) -> Result<[[f64; 3]; 2], YardstickError> {
        let both: [[f64; 3]; 2] = self.value("robot_start_goal")?;
        both.iter().try_for_each(|pose| self.check_pose("robot_start_goal", pose))?;
        let [[x_m, y_m, _], [goal_x_m, goal_y_m, _]] = both;
        if (goal_x_m - x_m).hypot(goal_y_m - y_m) <= GOAL_M {
            return Err(self.refuse("robot_start_goal", "the robot is at the goal when it starts"));
        }
        Ok(both)
    }

    /// Refuses a pose that is nowhere.
    fn check_pose(&self, key: &str, pose: &[f64; 3]) -> Result<(), YardstickError> {
        match pose.iter().find(|number| number.abs() > PLACE_MAX_M) {
            Some(number) => Err(self.refuse(key, &format!("{number} is over {PLACE_MAX_M}"))),
            None => Ok(()),
        }
    }

    fn dataset(&self) -> Result<Dataset, YardstickError> {
        let offset: [f64; 3] = self.value("offset")?;
        self.check_pose("offset", &offset)?;
        let [x_m, y_m, yaw_rad] = offset;
        let sign = |is_flipped: bool| if is_flipped { -1.0 } else { 1.0 };
        Ok(Dataset {
            file: self.text("file_name")?.to_owned(),
            fps: self.number("fps", [0.1, 1000.0])?,
            delay_s: self.number("spawn_delay_s", [0.0, 3600.0])?,
            map_from_tracks: Se2::new(Vector2::new(x_m, y_m), yaw_rad),
            swaps: self.flag("swapxy")?,
            signs: [sign(self.flag("flipxn")?), sign(self.flag("flipyn")?)],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Part, datasets, episodes, recorded};
    use std::path::PathBuf;
    use world::Tracks;

    const EPISODE: &str = "[episodes_params]\ntests=['t_a']\n\n[t_a]\nmap_name=ETH ; the place\n\
        pedestrian_datasets=[\"eth\"]\ndatasets_start_t = [0]\nped_ranges=[(1, -1)]\nagents_start=[]\n\
        robot_start_goal=[[8, 5, 1.5], [12, 15, 1.5]] ; start and goal\nmax_time=20\n";
    const DATASET: &str = "[dataset_params]\n[eth] ; recommended map: ETH\nfile_name=eth/e.csv\nfps=10\n\
        spawn_delay_s = 0\noffset=[1.5, 14, 0]\nswapxy=True\nflipxn=True\nflipyn=False\n";

    fn written(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        (folder, path)
    }

    #[test]
    fn episodes_and_datasets_are_read_as_they_stand_there() {
        let (_kept, path) = written("e.ini", EPISODE);
        let all = episodes(&path).expect("episodes");
        assert_eq!(all.len(), 1);
        assert_eq!((all[0].name.as_str(), all[0].map.as_str(), all[0].time_max_s), ("t_a", "ETH", 20.0));
        assert_eq!(all[0].robot, [[8.0, 5.0, 1.5], [12.0, 15.0, 1.5]]);
        assert_eq!(all[0].parts, [Part { dataset: "eth".into(), start_s: 0.0, range: [1, -1] }]);
        let (_kept, path) = written("d.ini", DATASET);
        let dataset = &datasets(&path).expect("datasets")["eth"];
        // y of the tracks is the map's x, and x with the other sign its y.
        let at = dataset.in_map(2.0, 3.0);
        assert!((at.x - 4.5).abs() < 1e-12 && (at.y - 12.0).abs() < 1e-12, "{at:?}");
    }

    #[test]
    fn time_begins_with_the_first_pedestrian_of_the_range() {
        let (_kept, path) = written("d.ini", DATASET);
        let dataset = &datasets(&path).expect("datasets")["eth"];
        // Pedestrians 1 to 4: 1 is before the range, 3 comes 2 s after 2, and 4 is the last, who is left out.
        let tracks = "0,10,11,15,30,31,32,33\n1,2,2,1,3,3,4,4\n0,0,1,0,5,6,0,0\n0,0,0,0,0,0,0,0\n";
        let tracks = Tracks::parse("t", tracks).expect("tracks");
        let part = |start_s: f64| Part { dataset: "eth".into(), start_s, range: [1, -1] };
        let people = recorded(&part(0.0), dataset, &tracks, 60.0);
        let times = |person: usize| people[person].places.iter().map(|(at_s, _)| *at_s).collect::<Vec<_>>();
        assert_eq!((people.len(), times(0), times(1)), (3, vec![0.0, 0.1], vec![2.0, 2.1]));
        // With a start time they stand where they begin until then.
        let later = recorded(&part(3.0), dataset, &tracks, 60.0);
        assert_eq!(later[0].places.iter().map(|(at_s, _)| *at_s).collect::<Vec<_>>(), [0.0, 3.0, 3.1]);
        assert_eq!(later[0].places[0].1, later[0].places[1].1);
        assert_eq!(recorded(&part(0.0), dataset, &tracks, 1.0).len(), 1, "who comes after the end is left out");
        // Numbers of pedestrians may have gaps of any size.
        let sparse = Tracks::parse("t", "0,1,2\n1,2,900000000000\n0,0,0\n0,0,0\n").expect("tracks");
        let all = Part { range: [0, -1], ..part(0.0) };
        assert_eq!(recorded(&all, dataset, &sparse, 60.0).len(), 2, "the last one is left out");
    }

    #[test]
    fn what_is_wrong_is_named_by_file_section_and_key() {
        for (from, to, why) in [
            ("max_time=20", "max_time=soon", "[t_a] max_time: no number from"),
            ("max_time=20", "", "[t_a] max_time: the key is missing"),
            ("[12, 15, 1.5]]", "[12, 15]]", "[t_a] robot_start_goal: "),
            ("[[8, 5, 1.5],", "[[nan, 5, 1.5],", "[t_a] robot_start_goal: no list of Python"),
            ("= [0]", "= [0, 0]", "[t_a] pedestrian_datasets: as many start times"),
            ("= [0]", "= [-1]", "[t_a] datasets_start_t: a time is not from 0 to 36000"),
            ("= [0]", "= [1e300]", "[t_a] datasets_start_t: a time is not from 0 to 36000"),
            ("(1, -1)", "(9223372036854775807, -1)", "[t_a] ped_ranges: pairs from 0 on"),
            ("(1, -1)", "(5, 2)", "[t_a] ped_ranges: pairs from 0 on"),
            ("[8, 5, 1.5]", "[8e99, 5, 1.5]", "[t_a] robot_start_goal: 8"),
            ("[8, 5, 1.5]", "[12, 15, 0]", "[t_a] robot_start_goal: the robot is at the goal"),
            ("[t_a]", "[../t_a]", "[../t_a]: letters, digits, _ and - are wanted"),
            ("map_name=ETH", "[t_a]\nmap_name=ETH", "section [t_a] stands twice"),
        ] {
            let (_kept, path) = written("e.ini", &EPISODE.replacen(from, to, 1));
            let error = episodes(&path).expect_err(why).to_string();
            assert!(error.contains("e.ini: ") && error.contains(why), "{error}\nnot {why}");
        }
        let (_kept, path) = written("d.ini", &DATASET.replace("swapxy=True", "swapxy=yes"));
        let error = datasets(&path).expect_err("no flag").to_string();
        assert!(error.contains("[eth] swapxy: neither True nor False"), "{error}");
        let (_kept, path) = written("e.ini", "[episodes_params]\n");
        assert!(episodes(&path).expect_err("none").to_string().contains("no episode in it"));
    }
}
