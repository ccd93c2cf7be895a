//! A learnt policy: an ONNX network, fed with what [`guidance::observation`] makes of a situation.
//!
//! Inputs `senses` [1, frames x LENGTH] and, of a recurrent network, `memory` [1, size]; outputs `logits` [1, actions]
//! and `memory_next`. The network gives raw logits: the shield is not in it.

use std::path::Path;

use guidance::Se2;
use guidance::observation::{Frames, Senses};
use inference::{Session, TensorRef};
use messages::MAX_ACTIONS;

use crate::model::{Manifest, ModelError};
use crate::{Engine, EngineError, Probabilities, Situation};

/// A network and what it remembers.
pub struct LearntEngine {
    session: Session,
    actions: usize,
    temperature: f32,
    frames: Frames,
    /// The recurrent state; empty where there is none.
    memory: Vec<f32>,
    before: Option<(u32, Se2)>,
}

impl LearntEngine {
    /// Loads a network of the manifest's shape, and runs it once.
    ///
    /// # Errors
    /// Where it cannot be loaded or run, or is of another shape.
    pub fn load(path: &Path, bytes: &[u8], manifest: &Manifest, library: Option<&Path>) -> Result<Self, ModelError> {
        let wrong = |what: String| ModelError::Content { path: path.to_owned(), what };
        let session = inference::session(bytes, library).map_err(&wrong)?;
        let mut engine = Self {
            session,
            actions: manifest.actions.table().len(),
            temperature: manifest.temperature.map_or(1.0, |temperature| temperature.get() as f32),
            frames: Frames::new(manifest.frames),
            memory: vec![0.0; manifest.memory],
            before: None,
        };
        // A network of another shape is found out now, and not in the middle of a walk.
        engine.run().map_err(|error| wrong(error.to_string()))?;
        engine.memory.fill(0.0);
        Ok(engine)
    }

    /// What the network was fed with at the last decision.
    #[must_use]
    pub fn observation(&self) -> &[f32] {
        self.frames.senses()
    }

    /// Probabilities from what the frames hold; the recurrent state goes on.
    fn run(&mut self) -> Result<Probabilities, EngineError> {
        let failed = |error: inference::Error| EngineError::Run(error.to_string());
        let senses = self.frames.senses();
        let senses = TensorRef::from_array_view(([1, senses.len()], senses)).map_err(failed)?;
        let outputs = if self.memory.is_empty() {
            self.session.run(inference::inputs!["senses" => senses])
        } else {
            let memory = TensorRef::from_array_view(([1, self.memory.len()], &self.memory[..])).map_err(failed)?;
            self.session.run(inference::inputs!["senses" => senses, "memory" => memory])
        };
        let outputs = outputs.map_err(failed)?;
        let output = |name: &'static str, wanted: usize| {
            let value = outputs.get(name).ok_or_else(|| EngineError::Run(format!("it has no output \"{name}\"")))?;
            let (_, numbers) = value.try_extract_tensor::<f32>().map_err(failed)?;
            if numbers.len() != wanted {
                return Err(EngineError::Run(format!("\"{name}\" has {} numbers, not {wanted}", numbers.len())));
            }
            if !numbers.iter().all(|number| number.is_finite()) {
                return Err(EngineError::NotFinite(name));
            }
            Ok(numbers)
        };
        let probabilities = softmax(output("logits", self.actions)?, self.temperature);
        if !self.memory.is_empty() {
            let next = output("memory_next", self.memory.len())?.to_vec();
            self.memory.copy_from_slice(&next);
        }
        // Of finite logits too, where the temperature is next to nothing.
        if !probabilities.iter().all(|p| p.is_finite()) {
            return Err(EngineError::NotFinite("logits, as probabilities,"));
        }
        Ok(probabilities)
    }
}

impl Engine for LearntEngine {
    /// What was seen and remembered before a cue has no place in the cue's frame: with a new cue, and with a new
    /// odometry frame, both begin anew.
    fn decide(&mut self, situation: &Situation<'_>) -> Result<Probabilities, EngineError> {
        let here = (situation.odometry_incarnation, situation.odom_from_robot);
        let before = self.before.replace(here).filter(|(incarnation, _)| *incarnation == here.0);
        let begins = situation.cue_is_new || before.is_none();
        if begins {
            self.memory.fill(0.0);
        }
        let odom_from_before = before.map_or(here.1, |(_, pose)| pose);
        let senses = Senses {
            beams: situation.evidence.beams,
            depth: situation.evidence.depth,
            memory: situation.evidence.memory,
            handler: situation.handler,
            start_from_robot: situation.start_from_robot,
            before_from_robot: odom_from_before.inverse() * here.1,
            cue: situation.cue,
        };
        self.frames.push(&senses, begins);
        self.run()
    }
}

/// Probabilities of logits: the lower the temperature, the surer.
fn softmax(logits: &[f32], temperature: f32) -> Probabilities {
    let greatest = logits.iter().copied().fold(f32::MIN, f32::max);
    let mut probabilities = [0.0; MAX_ACTIONS];
    let mut sum = 0.0;
    for (p, logit) in probabilities.iter_mut().zip(logits) {
        *p = ((logit - greatest) / temperature).exp();
        sum += *p;
    }
    probabilities.iter_mut().for_each(|p| *p /= sum);
    probabilities
}
