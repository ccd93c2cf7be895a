//! The domain: actions, cues, interaction models, the handler's estimate and the action shield of Kim et al. 2023.
//!
//! No I/O, no clock, no thread, no randomness of its own: same input, same output, to the bit.

pub mod accord;
pub mod action;
pub mod awareness;
pub mod boundary;
pub mod contact;
pub mod cue;
pub mod depth;
mod floor_watch;
pub mod handler;
pub mod hull;
pub mod interaction;
pub mod memory;
pub mod observation;
pub mod scan;
pub mod se2;
pub mod second;
pub mod seed;
pub mod shield;
pub mod tilt;
mod tilt_watch;
pub mod track;
pub mod travel_line;
pub mod wayfinding;

pub use action::{Action, ActionTable};
pub use awareness::{Awareness, AwarenessConfig, Pose};
pub use depth::{DepthView, FloorCell, FloorInView, FloorStep, Slopes, Stance, StepMax};
pub use floor_watch::FloorWatch;
pub use handler::{Company, HandlerBody, HandlerEstimate, HandlerLimits, Nobody};
pub use hull::{Disc, Discs, Hull};
pub use interaction::{DelayedHarness, HarnessError, Interaction, InteractionModel, RigidHarness, RotatingRod};
pub use memory::{Floor, Footing, Memory, MemoryConfig, Remembered};
pub use scan::{Beam, BeamKind, Beams, ScanError};
pub use se2::Se2;
pub use second::SecondView;
pub use shield::{Draw, EdgeDistance, Evidence, Judgement, Motion, Reach, Shield, ShieldConfig, Suppressed, Work};
pub use tilt::Tilt;
pub use tilt_watch::TiltWatch;
pub use track::{Held, Pace, PoseTrack};
pub use travel_line::{Foot, TravelLine};
pub use wayfinding::{CueStart, Delta, HandlerErrors, Measure, Reward, RewardConfig};

#[cfg(test)]
mod testing {
    use proptest::prelude::ProptestConfig;

    /// Ten thousand cases, or as many as `PROPTEST_CASES` says.
    pub(crate) fn cases() -> ProptestConfig {
        let asked = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
        let cases = asked.unwrap_or(10_000);
        ProptestConfig { cases, max_global_rejects: cases.saturating_mul(10), ..ProptestConfig::default() }
    }
}
