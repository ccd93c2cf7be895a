//! `emulate`: devices that are not there, as processes of their own.

use std::path::Path;
use std::time::{Duration, Instant};

use emulators::EmulatedRplidar;
use rplidar::Model;
use serial::PseudoTerminal;
use settings::{Millis, Settings};
use transport::monotonic_ns;
use world::{LidarConfig, Scenario, Scene};

use crate::args::{Device, EmulateArgs, LidarModel};
use crate::exit::Failure;
use crate::launch::Signals;
use crate::out::say;
use crate::prepare::scenario_file;

/// Between two looks at the line: short against a frame of any lidar but the fastest, which then come in twos.
const PAUSE: Duration = Duration::from_millis(1);

/// `guidedog emulate`
///
/// # Errors
/// Where the port cannot be made or the scenario is wrong.
pub fn emulate(args: &EmulateArgs) -> Result<(), Failure> {
    match &args.device {
        Device::Rplidar { port, model, scenario, duration } => rplidar(port, *model, scenario, *duration),
    }
}

impl From<LidarModel> for Model {
    fn from(model: LidarModel) -> Self {
        match model {
            LidarModel::A1 => Self::A1,
            LidarModel::A1Old => Self::A1Old,
            LidarModel::A2 => Self::A2,
            LidarModel::A3 => Self::A3,
            LidarModel::S1 => Self::S1,
            LidarModel::S2 => Self::S2,
            LidarModel::S3 => Self::S3,
            LidarModel::C1 => Self::C1,
        }
    }
}

fn rplidar(port: &Path, model: LidarModel, scenario: &str, duration: Option<Millis>) -> Result<(), Failure> {
    let scenario = Scenario::load(&scenario_file(scenario)?).map_err(Failure::of_input)?;
    let world = scenario.load_world().map_err(Failure::of_input)?;
    let model = Model::from(model);
    let terminal = PseudoTerminal::open(port)
        .map_err(|error| Failure::input(format!("no port can be made at {}: {error}", port.display())))?;
    let config = LidarConfig::from(&Settings::default().lidar);
    let mut lidar = EmulatedRplidar::new(terminal, model, config, 1).map_err(Failure::of_input)?;
    let scene = Scene { world: &world, world_from_robot: scenario.start, world_from_handler: None, walkers: &[] };
    lidar.look(&scene, 0);
    let signals = Signals::of_this_process()?;
    say(format!("RPLIDAR {model:?} at {}, {} baud; Ctrl-C ends it", port.display(), model.baud()));
    let (begun, lasts) = (Instant::now(), duration.map(|duration| Duration::from_nanos(duration.ns())));
    while !signals.came() && lasts.is_none_or(|lasts| begun.elapsed() < lasts) {
        lidar.serve(monotonic_ns()).map_err(Failure::of_run)?;
        std::thread::sleep(PAUSE);
    }
    Ok(())
}
