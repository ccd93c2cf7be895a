//! `guidedog yardstick`: public benchmarks of navigation, walked with this project's sensors and shield.

mod barn;
mod socnavbench;

use std::io::Write as _;
use std::path::Path;

use guidance::se2::Point;
use guidance::{ActionTable, InteractionModel};
use policies::{GeometricConfig, Model, Pilot, SoloConfig, SoloEngine};
use serde_json::{Value, json};
use settings::{PlannerUse, PolicyModel, Profile, Settings};
use yardsticks::{Body, Config, Noise, Passage, Trace, Walk};

use crate::args::yardstick::{BodyArg, HowArgs, Yardstick, YardstickArgs, YardstickNoise};
use crate::evaluate::{may_write, picture};
use crate::exit::Failure;
use crate::out;
use crate::workers::Work;

/// Decision period of a robot that walks alone, seconds.
const ALONE_S: f64 = 0.2;

/// `guidedog yardstick`.
///
/// # Errors
/// Where a file cannot be used or written, or an argument is out of its bounds.
pub fn yardstick(args: &YardstickArgs, as_json: bool) -> Result<(), Failure> {
    match &args.which {
        Yardstick::Barn(args) => barn::barn(args, as_json),
        Yardstick::Socnavbench(args) => socnavbench::socnavbench(args, as_json),
    }
}

/// Who walks, with what sensors, and how it decides.
struct How {
    config: Config,
    settings: Settings,
    model: Option<Model>,
    body: BodyArg,
    seed: u64,
}

impl How {
    fn of(args: &HowArgs) -> Result<Self, Failure> {
        if args.policy == PolicyModel::Steps {
            return Err(Failure::input("the policy steps goes nowhere: there is nothing to measure"));
        }
        if args.body == BodyArg::Pair && args.actions.is_some() {
            return Err(Failure::input("--actions is of --body robot: the pair has the table of its configuration"));
        }
        let settings = crate::prepare::load(Profile::Go2, args.config.as_deref())?;
        let interaction: InteractionModel = settings.interaction().map_err(Failure::of_input)?;
        let mut base = episodes::Config::of(&settings).map_err(Failure::of_input)?;
        base.noise = match args.noise {
            YardstickNoise::Noisy => Noise::Noisy,
            YardstickNoise::Legged => Noise::Legged,
        };
        if args.noise == YardstickNoise::Noisy {
            // It stands at once.
            base.shield.reach.carried_s = [0.0; 3];
        }
        let config = Config { base, interaction, draw: settings.shield.choice.seeded(args.seed) };
        let (config, model) = match args.body {
            BodyArg::Robot => (config.alone(table(args.actions.as_deref())?, ALONE_S), None),
            BodyArg::Pair => (config, crate::prepare::model(&args.policy, &settings)?),
        };
        Ok(Self { config, settings, model, body: args.body, seed: args.seed })
    }

    fn walk(&self) -> Result<Walk, Failure> {
        let base = &self.config.base;
        let body = match self.body {
            BodyArg::Robot => {
                let radius_m = base.shield.robot_radius_m + base.shield.margin_m;
                let config = SoloConfig { dt_s: base.dt_s, radius_m, reach: base.shield.reach };
                Body::Robot(Box::new(SoloEngine::new(config, base.table.clone())))
            }
            BodyArg::Pair => {
                let geometric = GeometricConfig::of(&self.settings).map_err(Failure::of_input)?;
                let library = self.settings.policy.onnx_runtime.as_deref();
                let planner: PlannerUse = self.settings.policy.planner;
                let engine = policies::engine(self.model.as_ref(), geometric, planner, &base.table, library);
                Body::Pair(Box::new(Pilot::new(engine.map_err(Failure::of_input)?)))
            }
        };
        Ok(Walk::new(self.config.clone(), body))
    }

    /// Walks each passage; `report` says what becomes of one, by its number.
    fn run<T: Send>(
        &self,
        args: &HowArgs,
        passages: &[&Passage],
        report: impl Fn(usize, &Trace) -> T + Sync,
    ) -> Result<Vec<T>, Failure> {
        let work = Work { threads: args.workers, count: passages.len(), pieces: "walks" };
        work.run(
            || self.walk(),
            |walk, number| {
                let seed = episodes::part_seed(self.seed, number as u64);
                let trace = walk.walk(passages[number], seed).map_err(Failure::of_run)?;
                Ok(report(number, &trace))
            },
        )
    }

    /// The picture of a walk.
    fn picture(&self, passage: &Passage, trace: &Trace, words: &str) -> String {
        let robot: Vec<Point> = trace.robot.iter().map(|robot| Point::from(robot.translation.vector)).collect();
        picture::walked(&passage.world, &robot, &trace.handler, passage.goal, &self.config.base.bodies, words)
    }
}

/// What a walk came to: its figures as an object, and its picture where one is wanted.
struct Outcome {
    figures: Value,
    picture: Option<String>,
}

/// Refuses places where nothing can be written, before anything is walked.
fn check(args: &HowArgs) -> Result<(), Failure> {
    args.pictures.as_deref().map_or(Ok(()), may_write)?;
    if let Some(path) = &args.outcomes {
        let failed = |error: std::io::Error| Failure::input(format!("{}: {error}", path.display()));
        std::fs::File::create_new(path).and_then(|_| std::fs::remove_file(path)).map_err(failed)?;
    }
    Ok(())
}

/// Reports figures, and with them what could not be written of the outcomes.
fn conclude(
    mut report: Value,
    written: Result<(), Failure>,
    as_json: bool,
    lines: fn(&Value) -> Vec<String>,
) -> Result<(), Failure> {
    if let Err(failure) = &written {
        report["error"] = json!(failure.message);
    }
    if as_json {
        out::json(&report)?;
        return written.map_err(|failure| Failure { told: true, ..failure });
    }
    out::report(lines(&report))?;
    written
}

/// Writes what is wanted of the outcomes; `name` gives a picture's name.
fn write(args: &HowArgs, outcomes: &[Outcome], name: impl Fn(&Value) -> String) -> Result<(), Failure> {
    let failed = |path: &Path, error: std::io::Error| Failure::run(format!("{}: {error}", path.display()));
    if let Some(path) = &args.outcomes {
        let lines: String = outcomes.iter().map(|outcome| format!("{}\n", outcome.figures)).collect();
        let write = || std::fs::File::create_new(path)?.write_all(lines.as_bytes());
        write().map_err(|error| failed(path, error))?;
    }
    if let Some(folder) = &args.pictures {
        for outcome in outcomes {
            let Some(picture) = &outcome.picture else { continue };
            let path = folder.join(format!("{}.svg", name(&outcome.figures)));
            std::fs::write(&path, picture).map_err(|error| failed(&path, error))?;
        }
    }
    Ok(())
}

/// The action table of a robot that walks alone.
fn table(path: Option<&Path>) -> Result<ActionTable, Failure> {
    let Some(path) = path else { return Ok(ActionTable::solo()) };
    let failed = |error: &dyn std::error::Error| Failure::input(format!("{}: {error}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| failed(&error))?;
    ActionTable::parse(&text).map_err(|error| failed(&error))
}
