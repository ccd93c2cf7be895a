//! Where the handler walks: beside the robot, or behind it through a narrow passage.

use guidance::{HarnessError, InteractionModel};
use messages::{Formation, Mode, Outcome, PolicyAction};
use settings::Settings;

use super::Core;

/// How the handler follows in each formation.
#[derive(Debug, Clone)]
pub(super) struct Places {
    pub beside: InteractionModel,
    behind: InteractionModel,
}

impl Places {
    pub fn of(settings: &Settings) -> Result<Self, HarnessError> {
        let [beside, behind] = [Formation::Beside, Formation::Behind].map(|place| settings.interaction_in(place));
        Ok(Self { beside: beside?, behind: behind? })
    }

    fn model(&self, formation: Formation) -> &InteractionModel {
        match formation {
            Formation::Beside => &self.beside,
            Formation::Behind => &self.behind,
        }
    }
}

impl Core {
    /// A handler who changes place is lost until a scan has shown them there for a second.
    pub(super) fn take_formation(&mut self, mode: &Mode) {
        let before = self.mode.map_or(Formation::Beside, |mode| mode.formation);
        if before != mode.formation {
            let model = self.config.places.model(mode.formation);
            self.awareness.take_place(model);
            self.shield.take_place(model);
        }
    }

    /// What a decision that wants another formation comes to.
    pub(super) fn asked(&self, action: &PolicyAction) -> Option<Outcome> {
        let in_force = self.mode?.formation;
        let asks = self.is_cued_forward() && action.formation != in_force;
        asks.then_some(match action.formation {
            Formation::Behind => Outcome::Narrow,
            Formation::Beside => Outcome::Wide,
        })
    }

    /// Why nothing can be judged for a decision, if so. A handler who changes place is seen nowhere for a while.
    pub(super) fn unusable(&self, now_ns: u64, action: &PolicyAction) -> Option<Outcome> {
        let why = self.awareness.unusable(now_ns)?;
        (why != Outcome::HandlerNotSeen || self.asked(action).is_none()).then_some(why)
    }
}
