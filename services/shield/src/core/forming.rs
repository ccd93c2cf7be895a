//! Where the handler walks: beside the robot, or behind it through a narrow passage.

use guidance::{ActionTable, HarnessError, InteractionModel};
use messages::{Formation, Mode, Outcome, PolicyAction};
use settings::Settings;

use super::Core;

/// How the handler follows in a formation, and the actions as the robot makes them there.
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub model: InteractionModel,
    pub table: ActionTable,
}

impl Place {
    pub fn of(settings: &Settings, table: &ActionTable, formation: Formation) -> Result<Self, HarnessError> {
        Ok(Self { model: settings.interaction_in(formation)?, table: table.slowed(settings.speed_in(formation)) })
    }
}

impl Core {
    /// The formation in force.
    pub(super) fn formation(&self) -> Formation {
        self.mode.map_or(Formation::Beside, |mode| mode.formation)
    }

    /// The actions as they are made in it.
    pub(super) fn table(&self) -> &ActionTable {
        &self.config.places[self.formation() as usize].table
    }

    /// A handler who changes place is lost until a scan has shown them there for a second.
    pub(super) fn take_formation(&mut self, mode: &Mode) {
        if self.formation() != mode.formation {
            let place = &self.config.places[mode.formation as usize];
            self.awareness.take_place(&place.model);
            self.shield.take_place(&place.model);
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
