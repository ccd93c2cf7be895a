//! Settings of a replay, checked as a whole before anything is started.

use std::path::Path;

use messages::{ServiceId, TopicId};
use recording::{Info, Reader, Record};
use settings::{Ask, AttitudeSource, CueOrigin, LinkKind, Profile, Replay, Settings, Source};

use crate::args::{PaceArgs, ReplayArgs, Stream, WorldArgs};
use crate::exit::Failure;
use crate::prepare;

/// A replay that can be started.
#[derive(Debug)]
pub struct PreparedReplay {
    /// Its settings, paths absolute.
    pub settings: Settings,
    /// What the recording says about itself.
    pub info: recording::Info,
    /// Whether other settings than those of the recorded run were laid over them: its decisions are then not the
    /// recorded ones.
    pub experiment: bool,
}

/// The settings of a replay: those of the recorded run, where the recording brings them along.
///
/// # Errors
/// Where the configuration is wrong, the recording is none, or a stream that is asked for is not in it.
pub fn replay(args: &ReplayArgs) -> Result<PreparedReplay, Failure> {
    let mut reader = Reader::open(&args.recording).map_err(Failure::of_input)?;
    let info = reader.info().clone();
    let recorded = reader.settings().map_err(Failure::of_input)?;
    let missing = reader.depth_missing().map(Path::to_owned);
    reader.check_bytes().map_err(Failure::of_input)?;
    let mut pixels = 0;
    // All of it, so that a damaged recording is told now and not in the middle of the run.
    for record in reader {
        if let Record::DepthFrame(frame) = record.map_err(Failure::of_input)? {
            pixels = pixels.max(frame.data.len());
        }
    }
    let mut settings = base(args, recorded.as_deref())?;
    settings.record.path = prepare::record_path(&args.pace)?.map(Into::into);
    let streams = Streams { info: &info, recording: &args.recording, missing: missing.as_deref() };
    if args.streams.is_empty() {
        streams.all(&mut settings)?;
    } else {
        streams.only(&args.streams, &mut settings)?;
    }
    let depth = &settings.depth;
    if depth.source == Source::Replayed && pixels > (depth.width * depth.height) as usize {
        return Err(Failure::input(format!(
            "{} has depth frames of {pixels} pixels, over depth.width x depth.height = {} x {}",
            args.recording.display(),
            depth.width,
            depth.height
        )));
    }
    settings.replay.recording = Some(prepare::absolute(&args.recording)?.into());
    choose_part(args, &info, &mut settings.replay)?;
    keep_plan(args, &mut settings);
    prepare::allow_planned(&settings)?;
    settings::check(&settings).map_err(Failure::input)?;
    let experiment = recorded.is_some() && (args.pace.config.is_given() || !args.streams.is_empty());
    if settings.has_world() {
        settings = prepare::check(settings)?.settings;
    } else {
        prepare::check_policy(&settings)?;
    }
    Ok(PreparedReplay { settings, info, experiment })
}

/// The settings that the recording brings along, or those of a laser log, with the operator's on top.
fn base(args: &ReplayArgs, recorded: Option<&str>) -> Result<Settings, Failure> {
    let config = args.pace.config.operator();
    match recorded {
        Some(text) => {
            let name = format!("the settings recorded in {}", args.recording.display());
            let mut recorded = settings::load_over(&name, text, None).map_err(Failure::of_input)?;
            // A recording, whoever made it, starts no program here.
            recorded.planned.retain(|planned| !matches!(planned.ask, Ask::PolicySwap { .. } | Ask::PolicyRollback {}));
            let text = toml::to_string(&recorded).map_err(Failure::of_input)?;
            let mut settings = settings::load_over(&name, &text, config).map_err(Failure::of_input)?;
            // The recorded run may itself have been a replay.
            settings.replay = settings::Replay::default();
            prepare::with_speech_files(settings)
        }
        None if args.streams.is_empty() => prepare::load(Profile::Carmen, config),
        None => {
            let pace = PaceArgs { config: args.pace.config.clone(), ..PaceArgs::default() };
            prepare::walk_settings(&WorldArgs { pace, ..WorldArgs::default() }, false)
        }
    }
}

/// Which part of the recording is played, and how many times.
fn choose_part(args: &ReplayArgs, info: &Info, replay: &mut Replay) -> Result<(), Failure> {
    replay.differences = None;
    replay.from = args.from.or(replay.from);
    replay.times = args.times.unwrap_or(replay.times);
    replay.to = args.to.or(replay.to);
    if let Some(duration) = args.duration {
        replay.to = Some(replay.from.map_or(Ok(duration), |from| from.plus(duration)).map_err(Failure::input)?);
    }
    if let (Some(from), Some(to)) = (replay.from, replay.to)
        && from >= to
    {
        return Err(Failure::input("nothing is left of the recording: --from is not before --to"));
    }
    if replay.from.is_some_and(|from| from.ns() > info.duration_ns) {
        let lasts_s = messages::s_from_ns(info.duration_ns);
        return Err(Failure::input(format!("{} lasts {lasts_s:.2} s only", args.recording.display())));
    }
    Ok(())
}

/// What was planned for the recorded run happens again where it can: at the same times, and where it is not in the
/// streams already.
fn keep_plan(args: &ReplayArgs, settings: &mut Settings) {
    let replay = &settings.replay;
    let same_times = (replay.from, replay.to, replay.times) == (None, None, 1);
    if !same_times || (args.pace.speed.is_none() && !args.against) {
        settings.planned.clear();
        return;
    }
    let played = settings.replayed_topics();
    let publishes =
        |service: &ServiceId| played.iter().any(|t| t.spec().is_some_and(|spec| spec.publishers.contains(service)));
    settings.planned.retain(|planned| match &planned.ask {
        Ask::Cue { .. } => !played.contains(&TopicId::Cue),
        Ask::Inject { target, fault, .. } => {
            messages::fault::parse(target, fault).is_ok_and(|(target, _)| !target.publishers().iter().any(&publishes))
        }
        _ => true,
    });
}

/// Which streams of a recording are played.
struct Streams<'a> {
    info: &'a Info,
    recording: &'a Path,
    /// The file of depth frames that should be there.
    missing: Option<&'a Path>,
}

impl Streams<'_> {
    fn has(&self, topic: TopicId) -> bool {
        self.info.records.get(topic.name()).is_some_and(|n| *n > 0)
    }

    fn lacks(&self, topic: TopicId) -> Failure {
        let missing = self.missing.filter(|_| topic == TopicId::DepthFrame);
        let why = missing.map(|path| format!(": {} is missing", path.display())).unwrap_or_default();
        Failure::input(format!("{} has no {}{why}", self.recording.display(), topic.name()))
    }

    /// The whole recording, in the place of the world.
    fn all(&self, settings: &mut Settings) -> Result<(), Failure> {
        // A log may have no odometry: the run then says what it lacks.
        if !self.has(TopicId::LidarScan) {
            return Err(self.lacks(TopicId::LidarScan));
        }
        (settings.lidar.source, settings.odometry.source) = (Source::Replayed, Source::Replayed);
        // The recorded poses are corrected already, and have their attitude.
        settings.odometry.matching.on = Some(false);
        settings.odometry.attitude = AttitudeSource::Told;
        if let Some(second) = &mut settings.lidar.second {
            if !self.has(TopicId::SecondScan) {
                return Err(self.lacks(TopicId::SecondScan));
            }
            second.source = Source::Replayed;
        }
        if settings.depth.source != Source::Absent {
            if !self.has(TopicId::DepthFrame) {
                let Failure { message, .. } = self.lacks(TopicId::DepthFrame);
                return Err(Failure::input(format!(
                    "{message}; to replay without it: --config with [depth] source = \"absent\", needed = false"
                )));
            }
            settings.depth.source = Source::Replayed;
        }
        if self.info.about.run.is_some() {
            // The recorded cues are the handler's; nobody else gives any.
            settings.cue = settings::CueSettings { source: CueOrigin::Replayed, ..settings::CueSettings::default() };
        }
        settings.locomotion.link = LinkKind::Null;
        settings.simulation.emulated.on = false;
        settings.estop = settings::Estop::default();
        // Nobody is guided.
        settings.speak.on = false;
        Ok(())
    }

    /// Single streams, beside the drivers as they are configured.
    fn only(&self, streams: &[Stream], settings: &mut Settings) -> Result<(), Failure> {
        for stream in streams {
            let topic = match stream {
                Stream::Scan => {
                    settings.lidar.source = Source::Replayed;
                    TopicId::LidarScan
                }
                Stream::Odometry => {
                    settings.odometry.source = Source::Replayed;
                    settings.odometry.matching.on = Some(false);
                    settings.odometry.attitude = AttitudeSource::Told;
                    TopicId::Odometry
                }
                Stream::Depth => {
                    settings.depth.source = Source::Replayed;
                    TopicId::DepthFrame
                }
                Stream::Cue => {
                    settings.cue.source = CueOrigin::Replayed;
                    TopicId::Cue
                }
            };
            if !self.has(topic) {
                return Err(self.lacks(topic));
            }
        }
        let other = |stream: Stream, source: Source| !streams.contains(&stream) && source == Source::Replayed;
        if other(Stream::Scan, settings.lidar.source)
            || other(Stream::Odometry, settings.odometry.source)
            || other(Stream::Depth, settings.depth.source)
            || settings.lidar.second.as_ref().is_some_and(|second| second.source == Source::Replayed)
        {
            return Err(Failure::input(
                "a driver that is not among --streams has no source: its settings say \"replayed\"",
            ));
        }
        if !settings.has_world() {
            return Err(Failure::input("no driver is left beside --streams: leave them out to replay all"));
        }
        Ok(())
    }
}
