//! Policies: from a situation to probabilities over the action table, by geometry or by a learnt network.
//!
//! Whoever decides, the service on the robot or the evaluation, does it through [`Pilot`].

pub mod geometric;
mod learnt;
mod model;
mod planned;
mod solo;
mod steps;

use std::path::Path;

use guidance::cue::CueTrack;
use guidance::se2::pose2;
use guidance::{ActionTable, Evidence, HandlerBody, InteractionModel, Se2};
use messages::{CueKind, Formation, MAX_ACTIONS, ScanHeader};
use settings::{PlannerUse, PolicyModel};

pub use geometric::{GeometricConfig, GeometricEngine};
pub use inference::RuntimeError;
pub use learnt::LearntEngine;
pub use model::{Expected, GeometricTuning, Manifest, Model, ModelError, ModelKind, OBSERVATION, Trained};
pub use planned::PlannedEngine;
pub use solo::{SoloConfig, SoloEngine, SoloSituation};
pub use steps::StepsEngine;

/// Probabilities over the action table; those beyond it are 0.
pub type Probabilities = [f32; MAX_ACTIONS];

/// What one decision is made from, all seen from where the robot is now.
#[derive(Debug, Clone, Copy)]
pub struct Situation<'a> {
    /// Stands beside the ranges.
    pub scan: &'a ScanHeader,
    /// The lidar's readings, metres; see [`messages::LidarScan`].
    pub ranges: &'a [f32],
    /// Scan, depth and memory as the shield has them.
    pub evidence: Evidence<'a>,
    /// Where the handler is taken to be.
    pub handler: HandlerBody,
    /// The robot in the odometry frame.
    pub odom_from_robot: Se2,
    /// Which life of the odometry that frame belongs to; another one voids what was remembered.
    pub odometry_incarnation: u32,
    /// The robot in the cue's start frame.
    pub start_from_robot: Se2,
    /// The cue in force; stop where there is none.
    pub cue: CueKind,
    /// Whether the cue in force is another one than at the last decision.
    pub cue_is_new: bool,
    /// Where the handler walks.
    pub formation: Formation,
}

/// An engine could not decide.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// The network gave something that is no number.
    #[error("the model's output {0} is not finite")]
    NotFinite(&'static str),
    /// The runtime failed.
    #[error("the model could not be run: {0}")]
    Run(String),
}

/// From a situation to probabilities. Called once in each decision period, whatever the cue, so that it can remember.
pub trait Engine: Send {
    /// Probabilities over the table that the engine was made for, summing to 1.
    ///
    /// # Errors
    /// Where nothing could be decided.
    fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError>;

    /// The formation that the last decision asks for, if another one than that in force. It stands. Most engines know
    /// of none.
    fn asks_for(&self) -> Option<Formation> {
        None
    }

    /// Whether the engine knows how to walk with the handler behind the robot. No network was trained for it.
    fn walks_in_single_file(&self) -> bool {
        false
    }

    /// Another handler takes the handle, who follows by that model beside the robot. Networks see where the handler is,
    /// and ask for no model.
    fn take_handler(&mut self, _model: &InteractionModel) {}
}

impl<'a> From<&Situation<'a>> for geometric::Observation<'a> {
    fn from(situation: &Situation<'a>) -> Self {
        Self {
            scan: situation.scan,
            ranges: situation.ranges,
            obstacles: situation.evidence.depth.map_or(&[][..], guidance::DepthView::points),
            shield: Some((situation.evidence, situation.handler)),
            handler: Some(situation.handler.center),
            odom_from_robot: pose2(&situation.odom_from_robot),
            odometry_incarnation: situation.odometry_incarnation,
            start_from_robot: pose2(&situation.start_from_robot),
            cue: situation.cue,
            cue_is_new: situation.cue_is_new,
            formation: situation.formation,
        }
    }
}

impl Engine for GeometricEngine {
    fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        Ok(Self::decide(self, &situation.into()))
    }

    fn asks_for(&self) -> Option<Formation> {
        Self::asks_for(self)
    }

    fn walks_in_single_file(&self) -> bool {
        true
    }

    fn take_handler(&mut self, model: &InteractionModel) {
        Self::take_handler(self, model);
    }
}

/// What every engine is held to: no engine decides against a stop, nor goes on looking for an opening for ever.
pub struct Pilot {
    engine: Box<dyn Engine>,
    track: CueTrack,
    formation: Formation,
}

impl Pilot {
    /// The pilot with that engine.
    #[must_use]
    pub fn new(engine: Box<dyn Engine>) -> Self {
        Self { engine, track: CueTrack::default(), formation: Formation::Beside }
    }

    /// One decision: certain to stand where that is not the engine's to say ([`CueTrack::must_stand`]), the engine's
    /// probabilities otherwise.
    ///
    /// # Errors
    /// Where the engine could not decide.
    pub fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        if situation.cue_is_new {
            self.track.clear();
        }
        self.track.observe(&situation.start_from_robot);
        let decided = self.engine.decide(situation)?;
        if self.track.must_stand(situation.cue) {
            self.formation = situation.formation;
            return Ok(stand());
        }
        if situation.formation == Formation::Behind && !self.engine.walks_in_single_file() {
            self.formation = Formation::Beside;
            return Ok(stand());
        }
        self.formation = self.engine.asks_for().unwrap_or(situation.formation);
        Ok(decided)
    }

    /// See [`Engine::take_handler`].
    pub fn take_handler(&mut self, model: &InteractionModel) {
        self.engine.take_handler(model);
    }

    /// Where the last decision wants the handler to walk.
    #[must_use]
    pub fn formation(&self) -> Formation {
        self.formation
    }
}

/// Certain to stand.
#[must_use]
pub fn stand() -> Probabilities {
    let mut probabilities = [0.0; MAX_ACTIONS];
    probabilities[ActionTable::STOP] = 1.0;
    probabilities
}

/// The engine of that name, with its model where it has one ([`Model::named`]).
///
/// # Errors
/// As [`engine`].
pub fn named_engine(
    name: &PolicyModel,
    model: Option<&Model>,
    config: GeometricConfig,
    planner: PlannerUse,
    table: &ActionTable,
    library: Option<&Path>,
) -> Result<Box<dyn Engine>, ModelError> {
    match name {
        PolicyModel::Steps => Ok(Box::new(StepsEngine::new(table, config.dt_s))),
        PolicyModel::Guide | PolicyModel::Geometric | PolicyModel::File(_) => {
            engine(model, config, planner, table, library)
        }
    }
}

/// The engine of a model; without one the geometric engine as it is built, for that team and table. What a network
/// proposes the planner judges, as `planner` says.
///
/// # Errors
/// Where the runtime or the model cannot be loaded.
pub fn engine(
    model: Option<&Model>,
    mut config: GeometricConfig,
    planner: PlannerUse,
    table: &ActionTable,
    library: Option<&Path>,
) -> Result<Box<dyn Engine>, ModelError> {
    if let Some(Model { path, manifest, kind, .. }) = model {
        match kind {
            ModelKind::Learnt { bytes } => {
                let network = Box::new(LearntEngine::load(path, bytes, manifest, library)?);
                if planner == PlannerUse::Off {
                    return Ok(network);
                }
                let geometric = GeometricEngine::new(config, table.clone());
                return Ok(Box::new(PlannedEngine::new(network, geometric, planner)));
            }
            ModelKind::Geometric(tuning) => {
                tuning.apply(&mut config);
                return Ok(Box::new(GeometricEngine::new(config, manifest.actions.table())));
            }
        }
    }
    Ok(Box::new(GeometricEngine::new(config, table.clone())))
}
