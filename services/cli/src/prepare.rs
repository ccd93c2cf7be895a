//! Settings of a run, checked as a whole before anything is started: what is wrong is told here, with file and line.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use policies::{Expected, GeometricConfig, Model};
use recording::{Part, later_lives};
use settings::{
    Millis, Operator, PhysicsKind, PolicyModel, Profile, Settings, SimulatedNoise, Source, VoiceSettings, VoiceSource,
};
use world::{Physics, PhysicsConfig, Scenario, World};

use crate::args::{ConfigArgs, PaceArgs, WalkArgs, WorldArgs};
use crate::exit::Failure;
use crate::legs;
use crate::out::say;

/// Where nothing else is said.
pub const DEFAULT_SCENARIO: &str = "corridor";
/// A recording can begin where so much can be written.
const PROBE_BYTES: usize = 1 << 16;
/// Time limit of a walk that has a goal and no limit of its own.
const LIMIT_WITH_GOAL: &str = "600s";
/// Time limit of a walk that has neither.
const LIMIT_WITHOUT_GOAL: &str = "120s";

/// A simulated run that can be started.
#[derive(Debug)]
pub struct Prepared {
    /// Its settings, paths absolute.
    pub settings: Settings,
    /// What the settings say of world, start and route.
    pub scenario: Scenario,
    /// The scenario's world.
    pub world: Arc<World>,
}

/// The settings of a walk.
///
/// # Errors
/// Where the configuration, a world, a map or a route is missing or wrong, or the start is not free.
pub fn walk(args: &WalkArgs) -> Result<Prepared, Failure> {
    let mut settings = walk_settings(&args.world, false)?;
    if let Some(seed) = args.seed {
        settings.simulation.seed = seed;
        settings.shield.seed = seed;
    }
    settings.walk.time_limit = args.time_limit.or(settings.walk.time_limit);
    let errors = &mut settings.walk.errors;
    errors.orientation_deg = args.orientation_error.unwrap_or(errors.orientation_deg);
    errors.timing_m = args.timing_error.unwrap_or(errors.timing_m);
    settings::check(&settings).map_err(Failure::input)?;
    let mut prepared = check(settings)?;
    if prepared.settings.walk.time_limit.is_none() && prepared.scenario.route.time_limit_s.is_none() {
        let limit = if prepared.scenario.route.goal.is_some() { LIMIT_WITH_GOAL } else { LIMIT_WITHOUT_GOAL };
        prepared.settings.walk.time_limit = Some(Millis::try_from(limit.to_owned()).map_err(Failure::input)?);
    }
    Ok(prepared)
}

/// The settings of `guidedog up`: of a robot and sensors that are there, or of a simulated world. Where nothing else is
/// said, that is the default scenario's with its start, and nobody but the operator gives cues.
///
/// # Errors
/// As [`walk`], where a world is named beside devices that all are real, and where a real robot's response was not
/// measured or nothing watches its floor.
pub fn up(args: &WorldArgs) -> Result<Settings, Failure> {
    let settings = walk_settings(args, true)?;
    if settings.has_world() {
        return check(settings).map(|prepared| prepared.settings);
    }
    if settings.walk.scenario.is_some() || settings.walk.map.is_some() {
        return Err(Failure::input("no sensor is simulated: there is no world for a scenario or a map"));
    }
    settings::check_origin(&settings).map_err(Failure::input)?;
    settings::check_floor(&settings).map_err(Failure::input)?;
    check_policy_and_script(&settings)?;
    speech(&settings)?;
    Ok(settings)
}

/// The settings of a run in which nobody gives cues, whatever the configuration says, and nothing is recorded: the
/// robot stands.
///
/// # Errors
/// As [`up`].
pub fn standing(config: Option<&Path>) -> Result<Settings, Failure> {
    let pace =
        PaceArgs { config: ConfigArgs { file: config.map(Path::to_owned), set: Vec::new() }, ..PaceArgs::default() };
    let mut settings = up(&WorldArgs { pace, ..WorldArgs::default() })?;
    only_place(&mut settings.walk)?;
    settings.walk.cues = None;
    (settings.cue.script, settings.cue.forward_when_ready) = (None, false);
    settings.record.path = None;
    settings.planned.clear();
    Ok(settings)
}

/// Leaves of a scenario its world and where it begins.
fn only_place(walk: &mut settings::Walk) -> Result<(), Failure> {
    if let Some(file) = walk.scenario.take() {
        let scenario = Scenario::load(&file).map_err(Failure::of_input)?;
        (walk.map, walk.start) = (Some(absolute(&scenario.world)?.into()), Some(scenario.start));
    }
    Ok(())
}

/// The recording that `--record` names, absolute.
///
/// # Errors
/// Where it is there already, or cannot be made.
pub fn record_path(pace: &PaceArgs) -> Result<Option<PathBuf>, Failure> {
    let Some(path) = &pace.record else { return Ok(None) };
    let path = new_recording(path)?;
    // The recorder creates the file again: this only finds out now whether it can, and whether the disk is full.
    let probe = || {
        let written = std::fs::File::create_new(&path)?.write_all(&[0; PROBE_BYTES]);
        std::fs::remove_file(&path).and(written)
    };
    probe().map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
    Ok(Some(path))
}

/// The path of a recording that is to be written, absolute.
///
/// # Errors
/// Where it is there already, or its folder is not.
pub fn new_recording(path: &Path) -> Result<PathBuf, Failure> {
    let path = absolute(path)?;
    if path.extension().is_none_or(|extension| extension != "mcap") {
        return Err(Failure::input(format!("{}: a recording is called NAME.mcap", path.display())));
    }
    // A recorder that is restarted goes on in a file of its own.
    let parts = [Part::Small, Part::Depth].map(|part| part.path(&path));
    let there = parts.into_iter().filter(|file| file.symlink_metadata().is_ok());
    if let Some(file) = there.chain(later_lives(&path)).next() {
        return Err(Failure::input(format!("{} already exists", file.display())));
    }
    match path.parent() {
        Some(folder) if folder.is_dir() => Ok(path),
        folder => Err(Failure::input(format!("{} is no folder", folder.unwrap_or(Path::new("/")).display()))),
    }
}

/// The configuration as `--config` and `--set` give it; relative paths in it start at its own folder.
///
/// # Errors
/// Where the file cannot be read, a key is unknown or a value is wrong.
pub fn load(profile: Profile, config: impl Into<Operator>) -> Result<Settings, Failure> {
    with_speech_files(settings::load(profile, config).map_err(Failure::of_input)?)
}

/// Settings that name the files that hearing needs, where the robot is to hear.
///
/// # Errors
/// Where the present folder is gone.
pub fn with_speech_files(mut settings: Settings) -> Result<Settings, Failure> {
    let voice = &mut settings.cue.voice;
    if voice.source != VoiceSource::Absent {
        find_speech(voice)?;
    }
    Ok(settings)
}

/// Cues are spoken: into the microphone, or that file or pipe where its name is not empty.
fn hear(settings: &mut Settings, stream: &Path) -> Result<(), Failure> {
    let voice = &mut settings.cue.voice;
    if stream.as_os_str().is_empty() {
        voice.source = VoiceSource::Microphone;
    } else {
        let stream = absolute(stream)?;
        crate::cues::check_stream(&stream)?;
        (voice.source, voice.stream) = (VoiceSource::Stream, Some(stream.into()));
    }
    find_speech(voice)?;
    // Who speaks to it wants an answer; and before it starts it gives a tone.
    settings.speak.on = true;
    settings::check(settings).map_err(Failure::input)
}

/// The configuration on top of what is built in for the physics and the robot that are asked for: by the command line,
/// or else by the configuration.
fn load_for(args: &WorldArgs) -> Result<Settings, Failure> {
    let config = args.pace.config.operator();
    let mut settings = load(Profile::Walk, config.clone())?;
    let physics = args.physics.unwrap_or(settings.simulation.physics);
    let noise = args.noise.unwrap_or(settings.simulation.noise);
    match (physics, noise) {
        (PhysicsKind::Mujoco, _) => {
            settings = load(Profile::Mujoco, config)?;
            legs::find(&mut settings.simulation.mujoco)?;
        }
        (PhysicsKind::Flat, SimulatedNoise::Legged) => settings = load(Profile::Go2, config)?,
        (PhysicsKind::Flat, SimulatedNoise::Noisy) => {}
    }
    (settings.simulation.physics, settings.simulation.noise) = (physics, noise);
    Ok(settings)
}

/// The settings of a simulated walk, with the default scenario where none is named.
///
/// # Errors
/// As [`walk`].
pub fn walk_settings(args: &WorldArgs, operator_only: bool) -> Result<Settings, Failure> {
    let mut settings = load_for(args)?;
    if args.emulated {
        settings.emulate();
        settings::check(&settings).map_err(Failure::input)?;
    }
    if let Some(stream) = &args.voice {
        hear(&mut settings, Path::new(stream))?;
    }
    if settings.lidar.source == Source::Absent || settings.odometry.source == Source::Absent {
        return Err(Failure::input("neither lidar.source nor odometry.source can be \"absent\" in a walk"));
    }
    if settings.replays() {
        return Err(Failure::input("a source is \"replayed\", and no recording is named: that is `guidedog replay`"));
    }
    if let Some(path) = record_path(&args.pace)? {
        settings.record.path = Some(path.into());
    }
    if let Some(mut model) = args.policy.clone() {
        if let Some(file) = model.file_mut() {
            *file = absolute(file)?.into();
        }
        settings.policy.model = model;
    }
    settings.faults.allowed |= args.pace.faults;
    allow_planned(&settings)?;
    let simulated = settings.has_world();
    if !simulated && settings.simulation.noise == SimulatedNoise::Legged {
        return Err(Failure::input(
            "simulation.noise is \"legged\", and no sensor is simulated: it is a Go2's profile",
        ));
    }
    if !simulated && !operator_only {
        return Err(Failure::input(
            "no sensor is simulated, and a walk is a simulated one: `guidedog up` runs devices",
        ));
    }
    let walk = &mut settings.walk;
    if let Some(name) = &args.scenario {
        *walk = settings::Walk {
            scenario: Some(scenario_file(name)?.into()),
            time_limit: walk.time_limit,
            errors: walk.errors.clone(),
            ..Default::default()
        };
    } else if let Some(map) = &args.map {
        let map = Some(absolute(map)?.into());
        *walk = settings::Walk {
            map,
            start: args.start,
            time_limit: walk.time_limit,
            errors: walk.errors.clone(),
            ..Default::default()
        };
    } else if simulated && walk.scenario.is_none() && walk.map.is_none() {
        let file = scenario_file(DEFAULT_SCENARIO)?;
        walk.scenario = Some(file.into());
        if operator_only {
            only_place(walk)?;
        }
    }
    if let Some(cues) = &args.cues {
        walk.cues = Some(absolute(cues)?.into());
    }
    Ok(settings)
}

/// Faults that are planned in a run that allows none are told now, and not when their time comes.
///
/// # Errors
/// Where there are any.
pub fn allow_planned(settings: &Settings) -> Result<(), Failure> {
    if settings.plans_faults() && !settings.faults.allowed {
        return Err(Failure::input(
            "faults are planned ([[planned]]), and the run allows none: --faults, or faults.allowed",
        ));
    }
    Ok(())
}

/// Reads everything that the run will read.
///
/// # Errors
/// As [`walk`].
pub fn check(settings: Settings) -> Result<Prepared, Failure> {
    check_policy_and_script(&settings)?;
    speech(&settings)?;
    let scenario = world::scenario_of(&settings).map_err(Failure::of_input)?;
    let world = Arc::new(scenario.load_world().map_err(Failure::of_input)?);
    let file = settings.walk.scenario.as_ref().or(settings.walk.map.as_ref());
    let config = PhysicsConfig::from(&settings);
    // The start is checked on the level; MuJoCo knows ramps.
    let mut level = Arc::clone(&world);
    let file_of = |error: &world::WorldError| {
        let file = file.map(|file| format!("{}: ", file.display())).unwrap_or_default();
        Failure::input(format!("{file}{}", crate::exit::chain(error)))
    };
    if settings.simulation.physics == settings::PhysicsKind::Mujoco {
        Arc::make_mut(&mut level).flatten();
    }
    Physics::new(level, config, scenario.start).map_err(|error| file_of(&error))?;
    Ok(Prepared { settings, scenario, world })
}

/// Loads the policy as its process will, so that a model that cannot be loaded is an error now, not eleven restarts.
///
/// # Errors
/// As [`model`], and where no engine can be made of it.
pub fn check_policy(settings: &Settings) -> Result<(), Failure> {
    let model = model(&settings.policy.model, settings)?;
    let policy = &settings.policy;
    let config = GeometricConfig::of(settings).map_err(Failure::of_input)?;
    let (table, library) = (policy.actions.table(), policy.onnx_runtime.as_deref());
    policies::named_engine(&policy.model, model.as_ref(), config, policy.planner, &table, library)
        .map(|_| ())
        .map_err(Failure::of_input)
}

fn check_policy_and_script(settings: &Settings) -> Result<(), Failure> {
    check_policy(settings)?;
    let Some(script) = &settings.cue.script else { return Ok(()) };
    world::Route::load(script)
        .map(|_| ())
        .map_err(|error| Failure::input(format!("cue.script of the configuration: {}", crate::exit::chain(&error))))
}

/// The language that the robot is to speak is there, and whole; so is the folder of what it says; and a tone before a
/// spoken cue is given by somebody.
fn speech(settings: &Settings) -> Result<(), Failure> {
    settings::check_tone(settings).map_err(Failure::input)?;
    if !settings.speak.on {
        return Ok(());
    }
    speech::Language::load(&settings.speak.language)
        .map_err(|error| Failure::input(format!("speak.language of the configuration: {error}")))?;
    let Some(file) = &settings.speak.file else { return Ok(()) };
    if file.is_dir() || !file.parent().is_some_and(Path::is_dir) {
        let what = "it is a folder, or in none: a WAV file is to be written there";
        return Err(Failure::input(format!("speak.file of the configuration: {}: {what}", file.display())));
    }
    Ok(())
}

/// The model of that name, loaded and verified; none for the geometric engine as it is built. Where it was not trained
/// with a handler like the configured one, that is told.
///
/// # Errors
/// Where it cannot be read, or does not fit its manifest or these settings.
pub fn model(name: &PolicyModel, settings: &Settings) -> Result<Option<Model>, Failure> {
    let model = Model::named(name, &Expected::of(settings)).map_err(Failure::of_input)?;
    if let Some(strange) = model.as_ref().and_then(|model| model.strange(settings)) {
        say(format!("guidedog: the policy {} was not trained with {strange}", PathBuf::from(name.clone()).display()));
    }
    Ok(model)
}

/// A path that does not depend on the present folder.
///
/// # Errors
/// Where that is gone.
pub fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|error| Failure::input(format!("{}: {error}", path.display())))
}

/// The file of a scenario that is given by its name or as a file.
///
/// # Errors
/// Where there is none of that name; the message lists those that there are.
pub fn scenario_file(name: &str) -> Result<PathBuf, Failure> {
    if name.contains('/') || Path::new(name).extension().is_some_and(|extension| extension == "toml") {
        return absolute(Path::new(name));
    }
    find_scenario(name, &config_folders())
}

/// A file that hearing needs: in `cues` where configuration lies. Where there is none, the first place, for the error.
///
/// # Errors
/// Where the present folder is gone.
pub fn find_speech_file(name: &str) -> Result<PathBuf, Failure> {
    find_config_file(&Path::new("cues").join(name))
}

/// The place of a configuration file; where it is missing, the first place that was searched.
///
/// # Errors
/// Where the present folder is gone.
pub fn find_config_file(name: &Path) -> Result<PathBuf, Failure> {
    let places: Vec<PathBuf> = config_folders().iter().map(|folder| folder.join(name)).collect();
    absolute(places.iter().find(|path| path.is_file()).or(places.first()).map_or(Path::new(""), PathBuf::as_path))
}

/// Names the files that hearing needs, where the configuration does not.
fn find_speech(voice: &mut VoiceSettings) -> Result<(), Failure> {
    if voice.model.is_none() {
        voice.model = Some(find_speech_file("cues.toml")?.into());
    }
    if voice.embedding.is_none() {
        voice.embedding = Some(find_speech_file("embedding.onnx")?.into());
    }
    Ok(())
}

fn find_scenario(name: &str, folders: &[PathBuf]) -> Result<PathBuf, Failure> {
    let file = |folder: &PathBuf| folder.join("scenarios").join(format!("{name}.toml"));
    if let Some(found) = folders.iter().map(file).find(|file| file.is_file()) {
        return absolute(&found);
    }
    let known = known_scenarios(folders);
    if known.is_empty() {
        return Err(Failure::input(format!(
            "no scenario \"{name}\": no config/scenarios is here, above the program, or in $GUIDEDOG_CONFIG"
        )));
    }
    Err(Failure::input(format!("no scenario \"{name}\"; known: {}", known.join(", "))))
}

/// Where configuration may lie: `$GUIDEDOG_CONFIG`, `./config`, and `config` in the folders above the program.
fn config_folders() -> Vec<PathBuf> {
    let named = std::env::var_os("GUIDEDOG_CONFIG").map(PathBuf::from);
    let program = std::env::current_exe().unwrap_or_default();
    let above = program.ancestors().skip(1).map(|folder| folder.join("config"));
    named.into_iter().chain([PathBuf::from("config")]).chain(above).collect()
}

fn known_scenarios(folders: &[PathBuf]) -> Vec<String> {
    let entries = folders.iter().filter_map(|folder| folder.join("scenarios").read_dir().ok());
    let names = entries.flatten().flatten().filter_map(|entry| {
        let path = entry.path();
        let is_scenario = path.extension().is_some_and(|extension| extension == "toml");
        is_scenario.then(|| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()))?
    });
    let mut names: Vec<String> = names.collect();
    names.sort();
    names.dedup();
    names
}

#[cfg(test)]
mod tests {
    use super::{find_scenario, load, scenario_file};
    use settings::Profile;
    use std::path::PathBuf;

    fn config() -> PathBuf {
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config")
    }

    #[test]
    fn an_unknown_scenario_lists_the_known_ones() {
        let error = find_scenario("nowhere", &[config()]).expect_err("there is none");
        assert!(error.message.contains("corridor, crossing, curve"), "{}", error.message);
        assert_eq!(error.code, crate::exit::EXIT_BAD_INPUT);
        assert!(find_scenario("curve", &[config()]).is_ok());
    }

    #[test]
    fn a_scenario_may_be_a_file() {
        let path = scenario_file("some/where.toml").expect("a file need not be looked up");
        assert!(path.is_absolute() && path.ends_with("some/where.toml"));
    }

    #[test]
    fn paths_in_a_configuration_start_at_its_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("mine.toml");
        std::fs::write(&file, "[walk]\nscenario = \"here.toml\"\n").expect("it is written");
        let settings = load(Profile::Walk, Some(file.as_path())).expect("it is right");
        assert_eq!(settings.walk.scenario.as_deref(), Some(folder.path().join("here.toml").as_path()));
    }
}
