//! Whether a Go2 and its handler stay within the hull that was judged: `hull [DECISIONS [CONFIG]]` lets them carry out
//! random actions on open floor, and stop after a few.

use std::path::Path;

use episodes::OpenFloor;
use guidedog_mujoco::motion::LeggedMotion;
use guidedog_simulator::Motion;
use settings::Profile;
use world::{Route, Scenario, World};

const LEGS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/legs/go2");

fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let decisions = std::env::args().nth(1).map_or(Ok(500), |text| text.parse())?;
    let config = std::env::args().nth(2);
    let mut settings = settings::load(Profile::Mujoco, config.as_deref().map(Path::new))?;
    let mujoco = &mut settings.simulation.mujoco;
    mujoco.model.get_or_insert(Path::new(LEGS).join("go2.xml").into());
    mujoco.policy.get_or_insert(Path::new(LEGS).join("policy.onnx").into());
    let route = Route { cues: Vec::new(), goal: None, time_limit_s: None };
    let (start, disturbances) = (messages::Pose2::default(), Vec::new());
    let scenario = Scenario { world: Path::new("open floor").into(), start, route, disturbances };
    let mut motion = LeggedMotion::new(&settings, &scenario, &World::new(2.6, Vec::new()))?;
    let step = |command| motion.step(command).map(|()| motion.truth());
    let excess = OpenFloor::new(&settings)?.measure(decisions, settings.simulation.seed, step)?;
    println!("{excess}");
    Ok(())
}
