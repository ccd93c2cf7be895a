//! The wayfinding task for Python: what `guidedog evaluate` runs, and nothing of its own.

use std::path::PathBuf;
use std::sync::Arc;

use episodes::{Batch, Config, Handlers, Harness, Noise, Places, Report, RewardMeasure};
use guidance::ActionTable;
use guidance::observation::{CHANNELS, FRAMES_MAX, LENGTH, OBSERVATION, SECTORS, STATE};
use messages::CueKind;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use world::{FloorPlan, GeneratorConfig};

/// Observations, and for each action whether the shield forbids it.
type Seen<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<bool>>);
/// The same after a step, with rewards and the episodes that ended.
type Stepped<'py> =
    (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<bool>>, Bound<'py, PyArray1<f64>>, Vec<Bound<'py, PyDict>>);

fn wrong(what: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(what.to_string())
}

fn one_of<T: Copy>(key: &str, value: &str, choices: &[(&str, T)]) -> PyResult<T> {
    let found = choices.iter().find(|(name, _)| *name == value);
    found.map(|(_, choice)| *choice).ok_or_else(|| {
        let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
        wrong(format!("{key} = \"{value}\" is none of {names:?}"))
    })
}

fn finite(key: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let number = value.extract::<f64>().ok().filter(|number| number.is_finite());
    number.ok_or_else(|| wrong(format!("{key} = {value} is no finite number")))
}

fn within(key: &str, value: &Bound<'_, PyAny>, most: f64, what: &str) -> PyResult<f64> {
    match finite(key, value)? {
        number if (0.0..=most).contains(&number) => Ok(number),
        number => Err(wrong(format!("{key} = {number} is no {what} from 0 to {most}"))),
    }
}

fn count(key: &str, value: &Bound<'_, PyAny>, most: usize) -> PyResult<usize> {
    let count = value.extract::<usize>().ok().filter(|count| (1..=most).contains(count));
    count.ok_or_else(|| {
        let most = if most < usize::MAX { format!("from 1 to {most}") } else { "of at least 1".to_owned() };
        wrong(format!("{key} = {value} is no whole number {most}"))
    })
}

fn plans(value: &Bound<'_, PyAny>) -> PyResult<Vec<FloorPlan>> {
    let paths = value.extract::<Vec<PathBuf>>().ok().filter(|paths| !paths.is_empty());
    let paths = paths.ok_or_else(|| wrong(format!("maps = {value} is no list of floor plans")))?;
    paths.iter().map(|path| FloorPlan::load(path).map_err(wrong)).collect()
}

/// The robot, sensors and handler that episodes of this noise begin with.
fn base(options: Option<&Bound<'_, PyDict>>) -> PyResult<Config> {
    let noise = options.map(|options| options.get_item("noise")).transpose()?.flatten();
    let is_legged = noise.is_some_and(|noise| noise.to_string() == "legged");
    // A network learns the paper's actions. Where to step back is the planner's to say.
    let table = ActionTable::eight();
    Ok(Config { table, ..if is_legged { Config::go2() } else { Config::default() } })
}

fn config(options: Option<&Bound<'_, PyDict>>) -> PyResult<Config> {
    let (mut config, mut buildings) = (base(options)?, 0.0);
    for (key, value) in options.into_iter().flatten() {
        let key: String = key.extract()?;
        let text = || value.to_string();
        let number = || finite(&key, &value);
        match key.as_str() {
            "noise" => {
                let choices = [("ideal", Noise::Ideal), ("noisy", Noise::Noisy), ("legged", Noise::Legged)];
                config.noise = one_of(&key, &text(), &choices)?;
            }
            "harness" => {
                config.harness = one_of(&key, &text(), &[("rigid", Harness::Rigid), ("delayed", Harness::Delayed)])?;
            }
            "handlers" => {
                let choices = [("nominal", Handlers::Nominal), ("personal", Handlers::Personal)];
                config.handlers = one_of(&key, &text(), &choices)?;
            }
            "measure" => {
                config.measure =
                    one_of(&key, &text(), &[("start", RewardMeasure::Start), ("line", RewardMeasure::Line)])?;
            }
            "maps" => config.places = Places::Plans(Arc::new(plans(&value)?), GeneratorConfig::default()),
            "buildings" => buildings = within(&key, &value, 1.0, "share")?,
            "memory" => {
                let remembers = value.extract::<bool>();
                let remembers = remembers.map_err(|_| wrong(format!("memory = {value} is neither True nor False")))?;
                config.awareness.memory = config.awareness.memory.filter(|_| remembers);
            }
            "decisions" => config.decisions = count(&key, &value, usize::MAX)?,
            "frames" => config.frames = count(&key, &value, FRAMES_MAX)?,
            "orientation_max_deg" => {
                config.orientation_max_rad = within(&key, &value, 180.0, "angle")?.to_radians();
            }
            "walked_before" => config.walked_before = within(&key, &value, 1.0, "share")?,
            "heading_weight" => config.reward.heading_weight = number()?,
            "heading_margin_rad" => config.reward.heading_margin_rad = number()?,
            "collision_penalty" => config.reward.collision_penalty = number()?,
            "time_penalty" => config.reward.time_penalty = number()?,
            "motion_penalty" => config.reward.motion_penalty = number()?,
            "followed_reward" => config.followed_reward = number()?,
            "forbidden_penalty" => config.forbidden_penalty = number()?,
            _ => return Err(wrong(format!("there is no option \"{key}\""))),
        }
    }
    match &mut config.places {
        Places::Generated(worlds) => worlds.buildings = buildings,
        _ if buildings > 0.0 => return Err(wrong("buildings is a share of generated worlds, and maps are given")),
        _ => {}
    }
    config.check_tasks().map_err(wrong)?;
    Ok(config)
}

/// Many episodes side by side, on all cores, without the interpreter's lock.
#[pyclass]
struct Episodes {
    config: Arc<Config>,
    batch: Batch,
    actions: usize,
    frames: usize,
    begun: bool,
}

#[pymethods]
impl Episodes {
    #[new]
    #[pyo3(signature = (count, options = None))]
    fn new(count: usize, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let config = Arc::new(config(options)?);
        let (actions, frames) = (config.table.len(), config.frames);
        let batch = Batch::new(&config, count).map_err(wrong)?;
        Ok(Self { config, batch, actions, frames, begun: false })
    }

    /// What a manifest tells of them: what handlers are drawn from, least and greatest, and what they are decided with.
    fn about<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let ranges = self.config.handler_ranges();
        let told = PyDict::new(py);
        told.set_item("dt_ms", (self.config.dt_s * 1e3).round() as u64)?;
        told.set_item("depth", self.config.depth.is_some())?;
        told.set_item("memory", self.config.awareness.memory.is_some())?;
        told.set_item("alpha", ranges.alpha)?;
        told.set_item("offset_x_m", ranges.x_m)?;
        told.set_item("offset_y_m", ranges.y_m)?;
        Ok(told)
    }

    /// Begins all episodes anew.
    fn begin<'py>(&mut self, py: Python<'py>, seed: u64) -> PyResult<Seen<'py>> {
        py.detach(|| self.batch.begin(seed));
        self.begun = true;
        self.seen(py)
    }

    /// What each action is worth in each, metres of way, as the teacher says, who knows the way, the world and the
    /// handler as they are; minus infinity where the shield forbids it.
    fn taught<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.must_have_begun()?;
        Ok(PyArray2::from_vec2(py, &py.detach(|| self.batch.taught()))?)
    }

    /// One decision in each; an episode that ends is followed by another one at once.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray1<'py, i64>) -> PyResult<Stepped<'py>> {
        self.must_have_begun()?;
        let count = self.actions as i64;
        let is_one = |action: &&i64| (0..count).contains(*action);
        let given: Vec<usize> = actions.as_array().iter().filter(is_one).map(|action| *action as usize).collect();
        if given.len() != self.batch.len() || actions.as_array().len() != given.len() {
            return Err(wrong(format!("{} actions from 0 to {} are wanted", self.batch.len(), count - 1)));
        }
        py.detach(|| self.batch.step(&given));
        let rewards: Vec<f64> = self.batch.rewards().collect();
        let mut finished = Vec::new();
        for episode in self.batch.finished() {
            let info = report(py, &episode.report)?;
            info.set_item("place", episode.place)?;
            info.set_item("observation", episode.observation.into_pyarray(py))?;
            info.set_item("unsafe", self.mask(episode.unsafe_mask).into_pyarray(py))?;
            finished.push(info);
        }
        let (observations, masks) = self.seen(py)?;
        Ok((observations, masks, rewards.into_pyarray(py), finished))
    }
}

impl Episodes {
    fn must_have_begun(&self) -> PyResult<()> {
        if self.begun { Ok(()) } else { Err(wrong("no episode has begun: begin, or reset, comes first")) }
    }

    fn mask(&self, unsafe_mask: u32) -> Vec<bool> {
        (0..self.actions).map(|action| unsafe_mask >> action & 1 == 1).collect()
    }

    fn seen<'py>(&self, py: Python<'py>) -> PyResult<Seen<'py>> {
        let count = self.batch.len();
        let mut observations = Vec::with_capacity(count * self.frames * LENGTH);
        let mut masks = Vec::with_capacity(count * self.actions);
        for episode in self.batch.episodes() {
            observations.extend_from_slice(episode.observation());
            masks.extend(self.mask(episode.unsafe_mask()));
        }
        let observations = observations.into_pyarray(py).reshape([count, self.frames * LENGTH])?;
        Ok((observations, masks.into_pyarray(py).reshape([count, self.actions])?))
    }
}

fn report<'py>(py: Python<'py>, report: &Report) -> PyResult<Bound<'py, PyDict>> {
    let info = PyDict::new(py);
    let cue = match report.cue {
        CueKind::Stop => "stop",
        CueKind::Forward => "forward",
        CueKind::Left => "left",
        CueKind::Right => "right",
    };
    info.set_item("cue", cue)?;
    info.set_item("success", report.success)?;
    info.set_item("to_stand", report.to_stand)?;
    info.set_item("decisions", report.decisions)?;
    info.set_item("collisions", report.collisions)?;
    info.set_item("robot_collisions", report.robot_collisions)?;
    info.set_item("handler_collisions", report.handler_collisions)?;
    info.set_item("hit_by_others", report.hit_by_others)?;
    info.set_item("distance_m", report.distance_m)?;
    info.set_item("walked_m", report.walked_m)?;
    info.set_item("all_unsafe", report.all_unsafe)?;
    info.set_item("unsafe_taken", report.unsafe_taken)?;
    info.set_item("reward", report.reward)?;
    Ok(info)
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("OBSERVATION", OBSERVATION)?;
    module.add("SECTORS", SECTORS)?;
    module.add("CHANNELS", CHANNELS)?;
    module.add("STATE", STATE)?;
    module.add("LENGTH", LENGTH)?;
    let table = ActionTable::eight();
    let names: Vec<&str> = table.actions().iter().map(|action| action.name.as_str()).collect();
    module.add("ACTIONS", names)?;
    module.add("ACTION_TABLE_ID", table.id())?;
    module.add_class::<Episodes>()
}
