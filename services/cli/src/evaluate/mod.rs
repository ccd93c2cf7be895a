//! `guidedog evaluate`: many episodes, on all cores, and what became of them.

mod explain;
mod failures;
mod figures;
mod floor;
mod log;
mod outcome;
pub mod picture;
mod replay;
mod words;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use episodes::{Arrival, Config, Episode, Handlers, Harness, Noise, Places, part_seed};
use messages::CueKind;
use policies::{GeometricConfig, Model, Pilot};
use serde_json::{Map, Value, json};
use settings::{Choice, HandlerModel, PlannerUse, PolicyModel, Profile, Settings};
use sha2::{Digest as _, Sha256};
use world::{Crowd, FloorPlan, GeneratorConfig, GridMap};

use crate::args::evaluate::{EvaluateArgs, HandlersArg, HarnessArg, NoiseArg, PeopleArg, TasksArg};
use crate::exit::Failure;
use crate::out;
use crate::workers::Work;
use log::{Log, Outcomes};
use outcome::{Outcome, Way, walk};

/// Cues are given so much too early or too late, metres.
const TIMING_M: f64 = 5.0;
/// What `--worlds` calls those that are no maps: corridors, and corridors like those of buildings.
const GENERATED: &str = "generated";
const BUILDINGS: &str = "buildings";
/// Number of first episodes, and of those that went wrong, that have a picture.
const PICTURES: usize = 12;

/// `guidedog evaluate`.
///
/// # Errors
/// Where a file cannot be read or written, or an argument is out of its bounds.
pub fn evaluate(args: &EvaluateArgs, as_json: bool) -> Result<(), Failure> {
    if !args.merge.is_empty() {
        let (mut head, outcomes) = log::merge(&args.merge)?;
        if let Some(head) = head.as_object_mut() {
            head.remove(log::SHARD);
        }
        args.outcomes.as_ref().map_or(Ok(()), |path| log::write(path, &head, &outcomes))?;
        let report = report(head, &outcomes, failures::summary(&outcomes, None, None))?;
        return tell(&report, as_json);
    }
    if !args.replay.is_empty() {
        return replay::replay(args, as_json);
    }
    check(args)?;
    let evaluation = Evaluation::of(args, settings_of(args)?)?;
    [&args.pictures, &args.failures].into_iter().flatten().try_for_each(|folder| may_write(folder))?;
    args.failures.as_ref().map_or(Ok(()), |folder| failures::may_replace(folder))?;
    if let Some(count) = args.explain {
        return explain::explain(&evaluation, args, count, as_json);
    }
    let head = evaluation.head(args);
    let outcomes = evaluation.logged(args, &head)?;
    let summary = failures::summary(&outcomes, Some(&words::given()), args.failures.as_deref());
    let mut report = report(head, &outcomes, summary)?;
    let all: Vec<Outcome> = outcomes.values().cloned().collect();
    if args.paired {
        let numbers: Vec<usize> = (0..args.episodes as usize).collect();
        let without = evaluation.run(args, evaluation.way(1.0, false), &numbers, None)?;
        let without: Vec<Outcome> = without.into_iter().map(|(_, outcome)| outcome).collect();
        report["without_shield"] = json!({});
        figures::add(&mut report["without_shield"], &without);
        report["difference"] = figures::difference(&all, &without);
    }
    let drawn = args.pictures.as_ref().map_or(Ok(()), |folder| evaluation.draw(args, folder, &all));
    let store = |folder: &PathBuf| failures::store(&evaluation, args, folder, &outcomes);
    let drawn = drawn.and_then(|()| args.failures.as_ref().map_or(Ok(()), store));
    if let Err(failure) = &drawn {
        report["error"] = json!(failure.message);
    }
    tell(&report, as_json)?;
    drawn.map_err(|failure| Failure { told: true, ..failure })
}

/// The configuration of the episodes.
fn settings_of(args: &EvaluateArgs) -> Result<Settings, Failure> {
    if args.config.set.iter().any(|set| set.trim_start().starts_with("policy.model")) {
        return Err(Failure::input("--set policy.model: evaluate takes its policy from --policy"));
    }
    let profile = if args.noise == NoiseArg::Legged { Profile::Go2 } else { Profile::Walk };
    crate::prepare::load(profile, args.config.operator())
}

/// The figures of episodes that `head` describes, of which those of `failures` failed.
fn report(head: Value, outcomes: &Outcomes, failures: Value) -> Result<Value, Failure> {
    let mut report = head;
    if let Some(report) = report.as_object_mut() {
        log::ONLY_THERE.iter().for_each(|key| drop(report.remove(*key)));
    }
    let (wanted, done) = (report["episodes"].as_u64().unwrap_or(0), outcomes.len() as u64);
    report["episodes"] = json!(done);
    if done < wanted {
        report["episodes_missing"] = json!(wanted - done);
    }
    report["outcomes_sha256"] = json!(log::digest(outcomes)?);
    report["failures"] = failures;
    let all: Vec<Outcome> = outcomes.values().cloned().collect();
    figures::add(&mut report, &all);
    if report["tasks"] == json!(word(&TasksArg::Drops)) {
        floor::add(&mut report, &all);
    }
    Ok(report)
}

/// Refuses what cannot be run, before anything is.
fn check(args: &EvaluateArgs) -> Result<(), Failure> {
    let refused = |what: &str| Err(Failure::input(what));
    if !(0.0..=1.0).contains(&args.beta_test) {
        return Err(Failure::input(format!("--beta-test is {}, not in 0..1", args.beta_test)));
    }
    if args.paired && args.beta_test >= 1.0 {
        return refused(
            "--paired compares with episodes without the shield, which those of --beta-test 1 are themselves",
        );
    }
    let is_word = |path: &PathBuf| [GENERATED, BUILDINGS].map(Path::new).contains(&path.as_path());
    if args.worlds.len() > 1 && args.worlds.iter().any(is_word) {
        return refused("--worlds has \"generated\", \"buildings\" or maps, not two of them");
    }
    if args.tasks == TasksArg::Orientation && args.worlds != [Path::new(GENERATED)] {
        return refused("--tasks orientation is of straight, empty corridors: --worlds generated");
    }
    if args.tasks == TasksArg::Orientation && args.people == PeopleArg::Social {
        return refused("--tasks orientation is of empty corridors: --people none");
    }
    if args.tasks == TasksArg::Drops && args.worlds != [Path::new(GENERATED)] {
        return refused(
            "--tasks drops is of --worlds generated: maps tell of no floor, and the others have even floor",
        );
    }
    Ok(())
}

/// The pictures come last; that they cannot be written is found out first.
///
/// # Errors
/// Where nothing can be written into that folder.
pub fn may_write(folder: &Path) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::input(format!("{}: {error}", folder.display()));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let probe = folder.join(format!(".guidedog-{}", std::process::id()));
    std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe)).map_err(failed)
}

/// Refuses folders, pipes and devices.
///
/// # Errors
/// Where a path is no regular file.
fn regular(path: &Path) -> Result<(), Failure> {
    let wrong = |why: &dyn std::fmt::Display| Failure::input(format!("{}: {why}", path.display()));
    let metadata = std::fs::metadata(path).map_err(|error| wrong(&error))?;
    if metadata.is_file() { Ok(()) } else { Err(wrong(&"it is no regular file")) }
}

/// The kind of worlds that `--worlds` means, where it names no maps.
fn generated(args: &EvaluateArgs) -> Option<GeneratorConfig> {
    match args.worlds[..] {
        [ref word] if word == Path::new(GENERATED) => Some(GeneratorConfig::default()),
        [ref word] if word == Path::new(BUILDINGS) => Some(GeneratorConfig::of_buildings()),
        _ => None,
    }
}

fn world_names(args: &EvaluateArgs) -> Vec<String> {
    args.worlds.iter().map(|path| path.display().to_string()).collect()
}

/// Digests of this program and of the maps.
fn files_sha256(args: &EvaluateArgs) -> [Value; 2] {
    let read = |path: &Path| std::fs::read(path).ok().map(|bytes| sha256(&bytes));
    let program = std::env::current_exe().ok().and_then(|program| read(&program));
    [json!(program), json!(maps(&args.worlds).iter().map(|map| read(map)).collect::<Vec<_>>())]
}

fn picture_name(kind: &str, number: usize) -> String {
    format!("{kind}-{number}.svg")
}

/// The maps and the images that they name.
fn maps(worlds: &[PathBuf]) -> Vec<PathBuf> {
    let image = |map: &PathBuf| GridMap::image(map).ok();
    worlds.iter().flat_map(|map| std::iter::once(map.clone()).chain(image(map))).collect()
}

fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The word of an argument's choice, as it is given.
pub fn word(choice: &impl clap::ValueEnum) -> Option<String> {
    choice.to_possible_value().map(|value| value.get_name().to_owned())
}

/// What all episodes have in common.
struct Evaluation {
    choice: Choice,
    planner: PlannerUse,
    settings: Settings,
    config: Arc<Config>,
    model: Option<Model>,
}

impl Evaluation {
    fn of(args: &EvaluateArgs, settings: Settings) -> Result<Self, Failure> {
        if args.policy == PolicyModel::Steps {
            return Err(Failure::input("the policy steps guides no one: there is nothing to evaluate"));
        }
        let model = crate::prepare::model(&args.policy, &settings)?;
        let config = Arc::new(config(args, &settings)?);
        let choice = args.choice.map_or(settings.shield.choice, Into::into);
        let planner = args.planner.map_or(settings.policy.planner, Into::into);
        Ok(Self { choice, planner, settings, config, model })
    }

    /// A pilot for episodes with that suppression factor. Without a shield no planner asks one.
    fn pilot(&self, beta: f64) -> Result<Pilot, Failure> {
        let table = self.settings.policy.actions.table();
        let mut geometric = GeometricConfig::of(&self.settings).map_err(Failure::of_input)?;
        geometric.shield = geometric.shield.filter(|_| beta < 1.0);
        let library = self.settings.policy.onnx_runtime.as_deref();
        let engine = policies::engine(self.model.as_ref(), geometric, self.planner, &table, library)
            .map_err(Failure::of_input)?;
        Ok(Pilot::new(engine))
    }

    /// What describes the episodes: those of an equal one are the same.
    fn head(&self, args: &EvaluateArgs) -> Value {
        let mut head = json!({
            "policy": args.policy,
            "sha256": self.model.as_ref().map(|model| &model.sha256),
            "worlds": world_names(args),
            "episodes": args.episodes,
            "noise": word(&args.noise),
            "beta_test": args.beta_test,
            "harness": word(&args.harness),
            "handlers": word(&args.handlers),
            "tasks": word(&args.tasks),
            "camera": args.camera,
            "choice": self.choice,
            "planner": self.planner,
            "seed": args.seed,
            "settings_sha256": serde_json::to_vec(&self.settings).ok().map(|text| sha256(&text)),
        });
        if args.people != PeopleArg::Paths {
            head["people"] = json!(word(&args.people));
        }
        if let Some([part, of]) = args.shard {
            head[log::SHARD] = json!(format!("{part}/{of}"));
        }
        if args.outcomes.is_some() {
            // Another program, or other maps of the same names, has other episodes.
            let [program, worlds] = files_sha256(args);
            head[log::ONLY_THERE[0]] = program;
            head[log::ONLY_THERE[1]] = worlds;
        }
        head
    }

    /// What decides how an episode of these arguments comes out.
    fn digests(&self, args: &EvaluateArgs) -> Map<String, Value> {
        let ([program, worlds], head) = (files_sha256(args), self.head(args));
        let all = [
            ("program_sha256", program),
            ("worlds_sha256", worlds),
            ("policy", head["policy"].clone()),
            ("policy_sha256", head["sha256"].clone()),
            ("settings_sha256", head["settings_sha256"].clone()),
        ];
        all.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }

    fn way(&self, beta: f64, traced: bool) -> Way {
        Way { beta, choice: self.choice, traced }
    }

    fn episode(&self) -> Result<Episode, Failure> {
        Episode::new(self.config.clone()).map_err(Failure::of_input)
    }

    /// The episodes that are wanted, with those that a file has already; each is written there as it ends.
    fn logged(&self, args: &EvaluateArgs, head: &Value) -> Result<Outcomes, Failure> {
        let (log, mut outcomes) = match &args.outcomes {
            None => (None, Outcomes::new()),
            Some(path) if args.resume && path.exists() => {
                Log::resume(path, head).map(|(log, outcomes)| (Some(log), outcomes))?
            }
            Some(path) => (Some(Log::create(path, head)?), Outcomes::new()),
        };
        let is_ours = |number: &usize| args.shard.is_none_or(|[part, of]| *number as u32 % of == part - 1);
        let is_new = |number: &usize| !outcomes.contains_key(number);
        let numbers: Vec<usize> = (0..args.episodes as usize).filter(is_ours).filter(is_new).collect();
        outcomes.extend(self.run(args, self.way(args.beta_test, false), &numbers, log.as_ref())?);
        Ok(outcomes)
    }

    /// Runs the episodes of these numbers; each comes with its number.
    fn run(
        &self,
        args: &EvaluateArgs,
        way: Way,
        numbers: &[usize],
        log: Option<&Log>,
    ) -> Result<Vec<(usize, Outcome)>, Failure> {
        let work = Work { threads: args.workers, count: numbers.len(), pieces: "episodes" };
        work.run(
            || Ok((self.pilot(way.beta)?, self.episode()?)),
            |(pilot, episode), index| {
                let number = numbers[index];
                let seed = part_seed(args.seed, number as u64);
                let outcome = walk(episode, pilot, &self.config, seed, way)?;
                log.map_or(Ok(()), |log| log.add(number, &outcome))?;
                Ok((number, outcome))
            },
        )
    }

    /// Walks the first episodes again, and those that went wrong, and draws where they went, in place of what an
    /// earlier evaluation drew there.
    fn draw(&self, args: &EvaluateArgs, folder: &Path, outcomes: &[Outcome]) -> Result<(), Failure> {
        let failed = |path: &Path, error: std::io::Error| Failure::run(format!("{}: {error}", path.display()));
        let is_wrong = |number: &usize| {
            let report = &outcomes[*number].report;
            report.collisions > 0 || !report.success
        };
        let (mut episode, mut pilot) = (self.episode()?, self.pilot(args.beta_test)?);
        let way = self.way(args.beta_test, true);
        let numbers = 0..outcomes.len();
        let first = numbers.clone().take(PICTURES).map(|number| ("first", number));
        let wrong = numbers.filter(is_wrong).take(PICTURES).map(|number| ("wrong", number));
        for earlier in ["first", "wrong"].into_iter().flat_map(|kind| old_pictures(folder, kind)) {
            std::fs::remove_file(&earlier).map_err(|error| failed(&earlier, error))?;
        }
        for (kind, number) in first.chain(wrong) {
            let seed = part_seed(args.seed, number as u64);
            let outcome = walk(&mut episode, &mut pilot, &self.config, seed, way)?;
            let path = folder.join(picture_name(kind, number));
            std::fs::write(&path, picture::svg(&outcome, &self.config.bodies)).map_err(|error| failed(&path, error))?;
        }
        Ok(())
    }
}

/// Those of that kind that are there.
fn old_pictures(folder: &Path, kind: &'static str) -> Vec<PathBuf> {
    let is_ours = |path: &PathBuf| {
        let number = path.file_name().and_then(|name| name.to_str()?.strip_prefix(kind)?.strip_prefix('-'));
        number.and_then(|number| number.strip_suffix(".svg")).is_some_and(|number| number.parse::<u32>().is_ok())
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(is_ours).collect()
}

fn config(args: &EvaluateArgs, settings: &Settings) -> Result<Config, Failure> {
    if settings.handler.model == HandlerModel::Rod {
        return Err(Failure::input(
            "handler.model of the configuration is \"rod\": episodes have --harness rigid or delayed",
        ));
    }
    let mut config = Config::of(settings).map_err(Failure::of_input)?;
    config.frames = 0;
    config.noise = match args.noise {
        NoiseArg::Ideal => Noise::Ideal,
        NoiseArg::Noisy => Noise::Noisy,
        NoiseArg::Legged => Noise::Legged,
    };
    config.harness = match args.harness {
        HarnessArg::Rigid => Harness::Rigid,
        HarnessArg::Delayed => Harness::Delayed,
    };
    config.handlers = match args.handlers {
        HandlersArg::Nominal => Handlers::Nominal,
        HandlersArg::Personal => Handlers::Personal,
    };
    if let Some(depth) = &mut config.depth {
        [depth.width, depth.height] = args.camera;
        depth.validate().map_err(|error| Failure::input(format!("--camera: {error}")))?;
    }
    config.arrival = Arrival { must_be_free: args.tasks == TasksArg::Drops, ..Arrival::DENSE };
    config.measure = episodes::RewardMeasure::Start;
    config.reward.motion_penalty = 0.0;
    let mut worlds = generated(args).unwrap_or_default();
    match args.people {
        PeopleArg::Paths => {}
        PeopleArg::Social => (worlds.people, worlds.crowd) = (1.0, Crowd::Social),
        PeopleArg::None => worlds.people = 0.0,
    }
    match args.tasks {
        TasksArg::Mixed => {}
        TasksArg::Orientation => {
            config.cues = vec![(CueKind::Forward, 1.0)];
            (worlds.clutter_per_m, worlds.people, worlds.bends) = (0.0, 0.0, 0.0);
        }
        TasksArg::Timing => {
            config.cues = vec![(CueKind::Left, 0.5), (CueKind::Right, 0.5)];
            config.timing_max_m = Some(TIMING_M);
        }
        TasksArg::Drops => config.cues = vec![(CueKind::Forward, 0.4), (CueKind::Left, 0.3), (CueKind::Right, 0.3)],
    }
    if args.tasks == TasksArg::Drops {
        config.places = Places::Drops(worlds);
    } else if generated(args).is_some() {
        config.has_time = worlds.buildings > 0.0;
        config.places = Places::Generated(worlds);
    } else {
        let plans = args.worlds.iter().map(|path| FloorPlan::load(path)).collect::<Result<Vec<_>, _>>();
        config.places = Places::Plans(Arc::new(plans.map_err(Failure::of_input)?), worlds);
        config.has_time = true;
    }
    config.check_tasks().map_err(|error| Failure::input(format!("{}: {error}", world_names(args).join(", "))))?;
    Ok(config)
}

fn tell(report: &Value, as_json: bool) -> Result<(), Failure> {
    out::tell(as_json, report, || vec![figures::text(report)])
}
