//! The wayfinding task in simulation: one cue, a hundred decisions (Kim et al. 2023, sections 3 and 5). What is learnt
//! from and what is evaluated on are the same episodes, made of the same worlds, sensors, shield, observation and
//! reward.
//!
//! No clock, no I/O: the same configuration and seed give the same episode, to the bit.

pub mod batch;
pub mod config;
pub mod episode;
pub mod excess;
mod explain;
pub mod failure;
mod judged;
mod of_settings;
pub mod score;
pub mod task;
pub mod teacher;
pub mod walked;

pub use batch::{Batch, Finished};
pub use config::{Arrival, Config, HandlerRanges, Handlers, Harness, NoTask, Noise, Places, RewardMeasure};
pub use episode::{Episode, Step};
pub use excess::{Excess, OpenFloor};
pub use explain::explain;
pub use failure::{Asked, Class, Failure, Thing, Watch};
pub use score::{FloorReport, Held, Report, Score, StepCounts};
pub use task::{Goal, Task};
pub use teacher::Teacher;
pub use walked::Walked;

/// The seed of part `part` of something with the seed `seed`: what the parts draw does not hang together.
#[must_use]
pub fn part_seed(seed: u64, part: u64) -> u64 {
    guidance::seed::mixed(seed, part.wrapping_add(1))
}
